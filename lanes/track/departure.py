"""Lane departure: time to line crossing, and whether to warn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lanes.detect.road import CURVATURE, HEADING, LEFT_SIDE, RIGHT_SIDE, line_coefficients
from lanes.track.filter import CarMotion

# Half of the track of a passenger car: from its centre to the outside of its tyres.
HALF_TRACK_M = 0.9
# ISO 17361 asks for a warning no later than 0.3 m beyond the line for passenger cars; warnings earlier than about 1.5 s
# are perceived as false.
WARN_S = 1.0
# Warnings in more than this share of the tracked frames are due to the place of the camera: on motorways cars leave
# their lane every few minutes, for seconds.
MANY_WARNINGS = 0.2


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
    # Whether to warn: a crossing is less than a second away with certainty, or happening; never for an uncertain lane.
    due: bool

    def describe(self) -> str | None:
        """Words for the picture; None if no warning is due."""
        if not self.due:
            return None
        crossing = "crossing" if self.time_to_crossing_s == 0 else f"{self.time_to_crossing_s:.1f} s to"
        return f"lane departure: {crossing} the {self.side} line"


def describe_many_warnings(rows: Mapping[str, np.ndarray]) -> str | None:
    """Words about a drive whose telemetry, columns (N,), has warnings most of the time; None if it has few."""
    tracked, warned = np.isfinite(rows["offset_m"]).sum(), np.isin(rows["departure"], ("left", "right")).sum()
    if warned <= MANY_WARNINGS * tracked:
        return None
    return (
        f"lane departure warnings in {warned} of {tracked} frames; they are those of a car {2 * HALF_TRACK_M:g} m wide "
        "with the camera in the middle: if it is elsewhere, give --camera-offset."
    )


def watch_departure(lane: np.ndarray, motion: CarMotion, camera_offset_m: float = 0.0) -> Departure:
    """Time to line crossing of a car in a lane (15,), which is relative to its camera (`Camera.offset_m`).

    A warning is due only if the car would also cross the line with its course and its turning one standard deviation
    nearer to those of the lane. The lines move sideways by v sin(h) t + (k - path) (v t)^2 / 2; the crossing is the
    first positive root.
    """
    left_m, right_m = (line_coefficients(lane, side)[0] + camera_offset_m for side in (LEFT_SIDE, RIGHT_SIDE))
    left, right = left_m - HALF_TRACK_M, -right_m - HALF_TRACK_M
    speed, heading = motion.speed_mps, float(lane[HEADING]) - motion.course_rad
    turning = float(lane[CURVATURE]) - motion.path_per_m
    drift = -speed * float(np.sin(heading))
    side, time_s = _crossing(left, right, drift, -turning * speed**2)
    least_drift = -speed * float(np.sin(_towards_zero(heading, motion.course_std_rad)))
    least_turning = _towards_zero(turning, motion.turning_std_per_m)
    _, latest_s = _crossing(left, right, least_drift, -least_turning * speed**2)
    return Departure(left, right, drift, side, time_s, max(time_s, latest_s) < WARN_S)


def _crossing(left_m: float, right_m: float, drift_mps: float, turning_mps2: float) -> tuple[str | None, float]:
    """The line that is crossed first, None if none is, and the time until then."""
    times = {"left": _time_to(left_m, drift_mps, turning_mps2), "right": _time_to(right_m, -drift_mps, -turning_mps2)}
    side = min(times, key=times.__getitem__)
    return side if np.isfinite(times[side]) else None, times[side]


def _towards_zero(value: float, by: float) -> float:
    """A value moved towards zero, no farther than zero."""
    return float(np.sign(value)) * max(abs(value) - by, 0.0)


def _time_to(distance_m: float, speed: float, acceleration: float) -> float:
    """First time at which speed t + acceleration t^2 / 2 reaches the distance; 0 if it is negative.

    Infinite if it takes more than 20 s, or if the lateral motion is so slow that the car keeps its lane.
    """
    if distance_m <= 0:
        return 0.0
    root = speed**2 + 2 * acceleration * distance_m
    if speed < 0.05 or root < 0:
        return float("inf")
    time_s = 2 * distance_m / (speed + np.sqrt(root))
    return float(time_s) if time_s < 20.0 else float("inf")
