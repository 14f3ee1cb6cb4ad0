"""Lane departure: time to line crossing, and whether to warn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.detect.lane import Lane
from lanes.detect.road import CURVATURE
from lanes.track.filter import CarMotion


@dataclass(frozen=True)
class DepartureParameters:
    """When a warning is due."""

    # Half of the track of a passenger car: from its centre to the outside of its tyres.
    half_track_m: float = 0.9
    # ISO 17361 asks for a warning no later than 0.3 m beyond the line for passenger cars; warnings earlier than about
    # 1.5 s are perceived as false.
    warn_s: float = 1.0
    # Slower lateral motion counts as lane keeping.
    min_drift_mps: float = 0.05
    # Crossings later than this are not reported.
    max_time_s: float = 20.0


DEPARTURE = DepartureParameters()


@dataclass(frozen=True)
class Departure:
    """Distance and time of the car to the lines."""

    # Distance from the tyres to the centre of the left and of the right line, beside the car; < 0 beyond it.
    left_m: float
    right_m: float
    # Lateral speed, positive left.
    drift_mps: float
    # The line that the car approaches: "left", "right" or None.
    side: str | None
    # Time until the tyres are on that line if car and road continue as now; 0 on the line, infinite in lane keeping or
    # when it is more than 20 s away.
    time_to_crossing_s: float
    # Whether to warn: a crossing is less than a second away with certainty, or happening.
    due: bool

    def describe(self) -> str | None:
        """Words for the picture; None if no warning is due."""
        if not self.due:
            return None
        crossing = "crossing" if self.time_to_crossing_s == 0 else f"{self.time_to_crossing_s:.1f} s to"
        return f"lane departure: {crossing} the {self.side} line"


def watch_departure(lane: Lane, motion: CarMotion) -> Departure:
    """Time to line crossing of a car in a lane.

    A warning is due only if the car would also cross the line with its course and its turning one standard deviation
    nearer to those of the lane. The lines move sideways by v sin(h) t + (k - path) (v t)^2 / 2; the crossing is the
    first positive root.
    """
    left, right = lane.left.offset_m - DEPARTURE.half_track_m, -lane.right.offset_m - DEPARTURE.half_track_m
    heading = lane.heading_rad - motion.course_rad
    turning = float(lane.model[CURVATURE]) - motion.path_per_m
    speed = motion.speed_mps
    drift = -speed * float(np.sin(heading))
    side, time_s = _crossing(left, right, drift, -turning * speed**2)
    least_drift = -speed * float(np.sin(_towards_zero(heading, motion.course_std_rad)))
    least_turning = _towards_zero(turning, motion.turning_std_per_m)
    _, latest_s = _crossing(left, right, least_drift, -least_turning * speed**2)
    return Departure(left, right, drift, side, time_s, max(time_s, latest_s) < DEPARTURE.warn_s)


def _crossing(left_m: float, right_m: float, drift_mps: float, turning_mps2: float) -> tuple[str | None, float]:
    """The line that is crossed first, None if none is, and the time until then."""
    times = {"left": _time_to(left_m, drift_mps, turning_mps2), "right": _time_to(right_m, -drift_mps, -turning_mps2)}
    side = min(times, key=times.__getitem__)
    return side if np.isfinite(times[side]) else None, times[side]


def _towards_zero(value: float, by: float) -> float:
    """A value moved towards zero, no farther than zero."""
    return float(np.sign(value)) * max(abs(value) - by, 0.0)


def _time_to(distance_m: float, speed: float, acceleration: float) -> float:
    """First time at which speed t + acceleration t^2 / 2 reaches the distance; 0 if it is negative, or infinite."""
    if distance_m <= 0:
        return 0.0
    if speed < DEPARTURE.min_drift_mps:
        return float("inf")
    root = speed**2 + 2 * acceleration * distance_m
    if root < 0:
        return float("inf")
    time_s = 2 * distance_m / (speed + np.sqrt(root))
    return float(time_s) if time_s < DEPARTURE.max_time_s else float("inf")
