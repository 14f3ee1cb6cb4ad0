"""Lane departure: time to line crossing, and whether to warn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lanes.camera.model import CAR_WIDTH_M, Camera
from lanes.car import CarMotion, Departure
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.road import (
    CENTRE,
    CURVATURE,
    HEADING,
    LEFT_SIDE,
    RIGHT_SIDE,
    WIDTH,
    line_coefficients,
)

# ISO 17361 asks for a warning no later than 0.3 m beyond the line for passenger cars;
# warnings earlier than about 1.5 s are perceived as false.
WARN_S = 1.25
# Lateral speed from which on a car leaves its lane, the least one of ISO 17361. A
# slower one is lane keeping, also with the tyres on a line.
LEAST_DRIFT_MPS = 0.1
# Time constant over which the lateral motion is seen; a warning needs a motion of at
# least half of the estimated speed. There is none of a crossing foreseen for a shorter
# time: on 15 real clips 69 of 207 frames with a warning were false.
SEEN_S = 0.5
SEEN_FACTOR = 2.0
# A new track, pose or width settles in this time; until then no crossing is foreseen.
# The width is new if it differs so much from its mean over `SEEN_S`.
SETTLED_S = 1.0
NEW_WIDTH_M = 0.25
# If the tyres of a car would be on a line in more than this share of the frames, its
# camera or width is another one: on motorways cars leave their lane every few minutes,
# for seconds.
MANY_CROSSINGS = 0.2


def describe_crossings(
    rows: Mapping[str, np.ndarray], car_width_m: float
) -> str | None:
    """Words about a drive whose telemetry, columns (N,), has tyres on a line too often
    to be true; else None.
    """
    likely = rows["confidence"] >= LIKELY_CONFIDENCE
    to_line_m = rows["lane_width_m"] - 2 * np.abs(rows["offset_m"])
    crossing = likely & (to_line_m < car_width_m)
    if crossing.sum() <= MANY_CROSSINGS * likely.sum():
        return None
    return (
        f"the tyres would be on a line in {crossing.sum()} of {likely.sum()} frames if "
        f"the car is {car_width_m:g} m wide and the camera in its middle; otherwise "
        "give --camera-offset (> 0: left as the camera looks) or --car-width."
    )


class DepartureWatch:
    """Departure of the car from its lane over time."""

    def __init__(self) -> None:
        # centre and width of the lane, averaged over `SEEN_S`
        self._centre_m: float | None = None
        self._width_m: float | None = None
        self._foreseen_s = 0.0
        self._settled_s = 0.0

    def update(
        self, lane: np.ndarray, motion: CarMotion, camera: Camera, elapsed_s: float
    ) -> Departure:
        """The departure in the next frame, from the lane (15,) and the car's motion.

        None is due in the first second of a watch, and after a new width.
        """
        centre_m = float(lane[CENTRE])
        width_m = float(lane[WIDTH])
        # the mean so far, of the lane that the car is in now
        before_m = centre_m if self._centre_m is None else self._centre_m
        before_m += width_m * round((centre_m - before_m) / width_m)
        kept = float(np.exp(-elapsed_s / SEEN_S))
        self._centre_m = centre_m + (before_m - centre_m) * kept

        last_m = width_m if self._width_m is None else self._width_m
        self._width_m = width_m + (last_m - width_m) * kept
        self._settled_s += elapsed_s
        if abs(width_m - self._width_m) > NEW_WIDTH_M:
            self._settled_s = 0.0

        departure = watch_departure(
            lane,
            motion,
            camera.offset_m,
            car_width_m=camera.car_width_m,
            seen_drift_mps=(self._centre_m - centre_m) / SEEN_S,
        )
        self._foreseen_s = self._foreseen_s + elapsed_s if departure.due else 0.0
        is_seen = self._foreseen_s >= SEEN_S and self._settled_s >= SETTLED_S
        return replace(departure, due=is_seen)


def watch_departure(
    lane: np.ndarray,
    motion: CarMotion,
    camera_offset_m: float = 0.0,
    *,
    car_width_m: float = CAR_WIDTH_M,
    seen_drift_mps: float | None = None,
) -> Departure:
    """Time to line crossing of a car in a lane (15,), which is relative to its camera.

    `camera_offset_m` is `Camera.offset_m`. A warning is due only if a slower motion
    would also cross the line: with course and turning one standard deviation nearer to
    those of the lane, and a drift of at most `SEEN_FACTOR` times the observed one. The
    lines move sideways by v sin(h) t + (k - path) (v t)^2 / 2; the crossing is the
    first positive root.
    """
    # distances of the tyres from the lines
    left_line_m = line_coefficients(lane, LEFT_SIDE)[0] + camera_offset_m
    right_line_m = line_coefficients(lane, RIGHT_SIDE)[0] + camera_offset_m
    left_m = left_line_m - car_width_m / 2
    right_m = -right_line_m - car_width_m / 2

    # the motion as estimated
    speed = motion.speed_mps
    heading = float(lane[HEADING]) - motion.course_rad
    turning = float(lane[CURVATURE]) - motion.path_per_m
    drift = -speed * float(np.sin(heading))
    side, time_s = _crossing(left_m, right_m, drift, -turning * speed**2)

    # the slowest motion that the uncertainty allows
    least_heading = _nearer_to_0(heading, motion.course_std_rad)
    least_turning = _nearer_to_0(turning, motion.turning_std_per_m)
    least_drift = -speed * float(np.sin(least_heading))
    if seen_drift_mps is not None:
        seen = SEEN_FACTOR * seen_drift_mps
        least_drift = min(max(least_drift, min(seen, 0.0)), max(seen, 0.0))
    _, latest_s = _crossing(left_m, right_m, least_drift, -least_turning * speed**2)

    return Departure(
        left_m=left_m,
        right_m=right_m,
        drift_mps=drift,
        side=side,
        time_to_crossing_s=time_s,
        due=max(time_s, latest_s) < WARN_S,
    )


def _nearer_to_0(value: float, std: float) -> float:
    """A value one standard deviation nearer to 0, or 0."""
    return value - float(np.clip(value, -std, std))


def _crossing(
    left_m: float, right_m: float, drift_mps: float, turning_mps2: float
) -> tuple[str | None, float]:
    """The line that is crossed first, None if none is, and the time until then."""
    left_s = _time_to(left_m, drift_mps, turning_mps2)
    right_s = _time_to(right_m, -drift_mps, -turning_mps2)
    side, time_s = ("left", left_s) if left_s <= right_s else ("right", right_s)
    return (side if np.isfinite(time_s) else None), time_s


def _time_to(distance_m: float, speed: float, acceleration: float) -> float:
    """First time at which speed t + acceleration t^2 / 2 reaches the distance; 0 if it
    is negative.

    Infinite if it takes more than 20 s, or if the lateral motion is so slow that the
    car keeps its lane.
    """
    root = speed**2 + 2 * acceleration * max(distance_m, 0.0)
    if speed < LEAST_DRIFT_MPS or root < 0:
        return float("inf")
    if distance_m <= 0:
        return 0.0
    time_s = 2 * distance_m / (speed + np.sqrt(root))
    return float(time_s) if time_s < 20.0 else float("inf")
