"""A drive along a rendered road: everything that its frames are made of, and how the car moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera.camera import Camera
from simulator.landscape.sky import BackdropStyle
from simulator.light.exposure import AutoExposure
from simulator.light.glare import Glare
from simulator.light.lens import Lens
from simulator.light.sunlight import Shade, Sun
from simulator.objects.overpass import Overpass
from simulator.objects.placement import PlacedObject, PlacedWall
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.painted_lines import Marking
from simulator.road.surface import Surface
from simulator.road.symbols import Symbol
from simulator.road.truth import Truth, lane_truth
from simulator.weather.fog import Fog
from simulator.weather.night import Night
from simulator.weather.rain import Rain
from simulator.weather.wet import Wet


@dataclass(frozen=True)
class Motion:
    """How the car moves: along the road at constant speed, wandering a little in its lane, nodding a little.

    Parameters
    ----------
    start_m : float
        Arc length at time 0.
    speed_mps : float
    offset_m : float
        Mean lateral place relative to the reference line, > 0 left.
    wander_m, wander_period_s : float
        Sideways sine on top of it; the heading follows from it.
    pitch_rad, pitch_period_s : float
        Amplitude and period of the nodding.
    heading_rad : float
        Additional heading relative to the road (for stills taken in the act of steering).
    later_speeds : tuple of (float, float)
        Further (time, speed) knots in order of time, linear in between; before the first, from `speed_mps` at 0.
    shift_m, shift_start_s, shift_seconds : float
        A change of lane: how far to the left it leads, when it begins, how long it takes.
    rear_axle_m : float
        How far the rear axle is behind the camera. A car points where its rear axle goes, so in a sharp bend its
        heading lags behind the road beside the camera.
    """

    start_m: float = 0.0
    speed_mps: float = 27.0
    offset_m: float = 0.0
    wander_m: float = 0.0
    wander_period_s: float = 7.0
    pitch_rad: float = 0.0
    pitch_period_s: float = 1.3
    heading_rad: float = 0.0
    later_speeds: tuple[tuple[float, float], ...] = ()
    shift_m: float = 0.0
    shift_start_s: float = 0.0
    shift_seconds: float = 4.0
    rear_axle_m: float = 0.0

    def pose(self, time_s: float) -> VehiclePose:
        """Place and heading at a moment, on a road without sharp bends."""
        rate = 2 * np.pi / self.wander_period_s
        part = float(np.clip((time_s - self.shift_start_s) / self.shift_seconds, 0, 1))
        lateral = self.offset_m + self.wander_m * np.sin(rate * time_s) + self.shift_m * part**2 * (3 - 2 * part)
        aside = self.wander_m * rate * np.cos(rate * time_s) + self.shift_m * 6 * part * (1 - part) / self.shift_seconds
        station, speed = self._progress(time_s)
        heading = self.heading_rad
        if speed:
            heading += float(np.arctan(aside / speed))
        return VehiclePose(station, float(lateral), heading)

    def _progress(self, time_s: float) -> tuple[float, float]:
        """Arc length and speed at a moment."""
        if not self.later_speeds:
            return self.start_m + self.speed_mps * time_s, self.speed_mps
        times, speeds = np.array([(0.0, self.speed_mps), *self.later_speeds]).T
        now = float(np.interp(time_s, times, speeds))
        knots = np.append(times[times < time_s], time_s)
        way = np.trapezoid(np.append(speeds[times < time_s], now), knots)
        return self.start_m + float(way), now

    def pitch(self, time_s: float) -> float:
        """Nodding angle at a moment: two sines that do not repeat together, as springs and road make them."""
        phase = 2 * np.pi * time_s / self.pitch_period_s
        return float(self.pitch_rad * (0.7 * np.sin(phase) + 0.3 * np.sin(2.63 * phase + 1.0)))


@dataclass(frozen=True, eq=False)
class Drive:
    """Everything that a rendered picture or video is made of.

    Parameters
    ----------
    camera : Camera
        With its pose.
    road : RoadGeometry
    line_laterals_m : tuple of float
        Lateral places of the centres of the ego lane's left and right lines; where the car changes lanes, of all lines
        from left to right; empty where there is no lane.
    markings, surface, sun, things, shades, backdrop, lens
        See their modules.
    bonnet : bool
        Whether the own bonnet is in the picture.
    motion : Motion
    seed : int
        Of everything that is random.
    exposure : AutoExposure, optional
        Follows the road's light with delay; without it the exposure follows each picture at once, by little.
    symbols : tuple of Symbol
        Arrows, diamonds and words on the road.
    fog : Fog, optional
    glare : Glare, optional
        Of a low sun ahead.
    night : Night, optional
    wet : Wet, optional
        The road mirrors the sky and the lamps of others, which are lit.
    rain : Rain, optional
        On the windscreen and in the air.
    """

    camera: Camera
    road: RoadGeometry
    line_laterals_m: tuple[float, ...]
    markings: tuple[Marking, ...]
    surface: Surface
    sun: Sun
    motion: Motion = Motion()
    objects: tuple[PlacedObject | PlacedWall | Overpass, ...] = ()
    shades: tuple[Shade, ...] = ()
    backdrop: BackdropStyle = BackdropStyle()
    lens: Lens = Lens()
    bonnet: bool = True
    seed: int = 0
    exposure: AutoExposure | None = None
    symbols: tuple[Symbol, ...] = ()
    fog: Fog | None = None
    glare: Glare | None = None
    night: Night | None = None
    wet: Wet | None = None
    rain: Rain | None = None

    def truth(self, time_s: float = 0.0) -> Truth:
        """What is known of the frame at a moment, without rendering it."""
        pitch = self.camera.pose.pitch_rad + self.motion.pitch(time_s)
        pose = self.pose(time_s)
        return lane_truth(self.road, pose, self.line_laterals_m, time_s=time_s, pitch_rad=pitch)

    def pose(self, time_s: float) -> VehiclePose:
        """Where the car is and where it points at a moment."""
        pose = self.motion.pose(time_s)
        if not self.motion.rear_axle_m:
            return pose
        lag = self.road.heading(pose.s_m) - self.road.heading(pose.s_m - self.motion.rear_axle_m)
        return replace(pose, heading_rad=pose.heading_rad - float(lag))

    def camera_at(self, time_s: float) -> Camera:
        """The camera as it nods at a moment."""
        return self.camera_at_pitch(self.truth(time_s).pitch_rad)

    def camera_at_pitch(self, pitch_rad: float) -> Camera:
        """The camera at a pitch angle."""
        return self.camera.with_pose(replace(self.camera.pose, pitch_rad=pitch_rad))
