"""Description of a drive, and of a named drive of the suite.

A drive has road, objects, light, camera and motion of the car.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lanes.camera.model import Camera
from simulator.backdrop import BackdropStyle
from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import Glare, Shade, Sun
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.walls import Overpass
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.markings import Marking, Symbol
from simulator.road.surface import Surface
from simulator.road.truth import Truth, lane_truth
from simulator.weather import Fog, Night, Wet

# Speed at which a car in a bend moves along its longitudinal axis.
TANGENT_MPS = 20.0
Difficulty = Literal["clean", "medium", "hard", "no lane"]


@dataclass(frozen=True)
class Motion:
    """Motion of the car along the road, with lateral oscillation and pitch motion.

    The car is at arc length `start_m` at time 0. `later_speeds` are knots (time, speed)
    after `speed_mps` at time 0; linear in between, constant after the last. `offset_m`
    is the mean lateral position relative to the reference line, > 0 left; `wander_m`
    and `wander_period_s` are amplitude and period of a lateral sine, from which the
    heading follows; `heading_rad` is added to it. `pitch_rad` and `pitch_period_s` are
    amplitude and period of the pitch motion, `roll_rad` and `roll_period_s` those of a
    sway, a sine of the roll. A lane change is a lateral shift of `shift_m` (> 0 left).
    `rear_axle_m` is the distance of the rear axle behind the camera: the heading of a
    slow car is the direction of the road at its rear axle, so in a sharp bend it lags
    behind the road at the camera. The slip of the rear tyres turns the car inwards: the
    lag shrinks with the square of the speed, and is gone at TANGENT_MPS.
    """

    start_m: float = 0.0
    speed_mps: float = 27.0
    offset_m: float = 0.0
    wander_m: float = 0.0
    wander_period_s: float = 7.0
    pitch_rad: float = 0.0
    pitch_period_s: float = 1.3
    roll_rad: float = 0.0
    roll_period_s: float = 4.0
    heading_rad: float = 0.0
    later_speeds: tuple[tuple[float, float], ...] = ()
    shift_m: float = 0.0
    shift_start_s: float = 0.0
    shift_seconds: float = 4.0
    rear_axle_m: float = 0.0

    def pose(self, time_s: float) -> VehiclePose:
        """Pose at a time, without the lag of the rear axle (see `Drive.pose`)."""
        # Lateral position and speed of the oscillation, then of the lane change.
        rate = 2 * np.pi / self.wander_period_s
        lateral = self.offset_m + self.wander_m * np.sin(rate * time_s)
        aside_mps = self.wander_m * rate * np.cos(rate * time_s)
        share = (time_s - self.shift_start_s) / self.shift_seconds
        share = float(np.clip(share, 0, 1))
        lateral += self.shift_m * share**2 * (3 - 2 * share)
        aside_mps += self.shift_m * 6 * share * (1 - share) / self.shift_seconds

        station, speed = self.progress(time_s)
        heading = self.heading_rad
        if speed:
            heading += float(np.arctan(aside_mps / speed))
        return VehiclePose(station, float(lateral), heading)

    def progress(self, time_s: float) -> tuple[float, float]:
        """Arc length and speed at a time."""
        if not self.later_speeds:
            return self.start_m + self.speed_mps * time_s, self.speed_mps
        times, speeds = np.array([(0.0, self.speed_mps), *self.later_speeds]).T
        now = float(np.interp(time_s, times, speeds))
        past = times < time_s
        passed_times = np.append(times[past], time_s)
        passed_speeds = np.append(speeds[past], now)
        return self.start_m + float(np.trapezoid(passed_speeds, passed_times)), now

    def pitch(self, time_s: float) -> float:
        """Pitch motion at a time, radians: two sines of incommensurable periods."""
        phase = 2 * np.pi * time_s / self.pitch_period_s
        waves = 0.7 * np.sin(phase) + 0.3 * np.sin(2.63 * phase + 1.0)
        return float(self.pitch_rad * waves)

    def roll(self, time_s: float) -> float:
        """Roll motion at a time, radians."""
        phase = 2 * np.pi * time_s / self.roll_period_s
        return float(self.roll_rad * np.sin(phase))

    def moved(self, camera: Camera, time_s: float) -> Camera:
        """The camera with the pitch and the roll at a time."""
        pose = camera.require_pose()
        pitch_rad = pose.pitch_rad + self.pitch(time_s)
        roll_rad = pose.roll_rad + self.roll(time_s)
        moved = replace(pose, pitch_rad=pitch_rad, roll_rad=roll_rad)
        return camera.with_pose(moved)


@dataclass(frozen=True, eq=False)
class Drive:
    """Everything that a rendered image or video depends on.

    The types of the fields describe most of them.

    `line_laterals_m` are the lateral positions of the line centres from left to right:
    the two lines of the ego lane, or all lines if the car changes lanes; empty without
    a lane. `bonnet` says whether the car's bonnet is in the image. Without `exposure`,
    the exposure adapts slightly to each image at once; with it, it follows with a
    delay.
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
    rain: bool = False

    def truth(self, time_s: float = 0.0) -> Truth:
        """Ground truth of the frame at a time; no rendering."""
        return lane_truth(
            self.road,
            self.pose(time_s),
            self.line_laterals_m,
            time_s=time_s,
            pitch_rad=self.camera_at(time_s).require_pose().pitch_rad,
        )

    def pose(self, time_s: float) -> VehiclePose:
        """Pose of the car at a time."""
        pose = self.motion.pose(time_s)
        if not self.motion.rear_axle_m:
            return pose
        # From the camera back to the point of the car that moves along the car's
        # longitudinal axis.
        _, speed_mps = self.motion.progress(time_s)
        back_m = self.motion.rear_axle_m * (1 - (speed_mps / TANGENT_MPS) ** 2)
        lag = self.road.heading(pose.s_m) - self.road.heading(pose.s_m - back_m)
        return replace(pose, heading_rad=pose.heading_rad - float(lag))

    def camera_at(self, time_s: float) -> Camera:
        """Camera with the pitch and the roll at a time."""
        return self.motion.moved(self.camera, time_s)


@dataclass(frozen=True)
class SuiteScene:
    """A named drive of a few seconds.

    `drive` makes it, `description` is one sentence; the name is in file names.
    """

    name: str
    difficulty: Difficulty
    seconds: float
    description: str
    drive: Callable[[], Drive]
