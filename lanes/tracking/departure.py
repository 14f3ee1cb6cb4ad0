"""How soon the car crosses a line, and whether to say so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.tracking.lane import Lane

# From the middle of a car to the outside of its tyres, and how soon a warning is due (ISO 17361 asks for no later than
# the crossing of the line by 0.3 m on passenger cars; warnings earlier than about 1.5 s are felt to be false ones).
HALF_TRACK_M = 0.9
WARN_S = 1.0
# Moving sideways slower than this is keeping to the lane.
LEAST_DRIFT_MPS = 0.05
LONGEST_S = 20.0


@dataclass(frozen=True)
class DepartureWarning:
    """The car's way to the lines.

    Attributes
    ----------
    left_m, right_m : float
        From the tyres to the middle of the left and of the right line, beside the car; < 0 when over it.
    drift_mps : float
        Sideways speed, > 0 to the left.
    side : {"left", "right", None}
        To which line the car moves.
    time_to_crossing_s : float
        Until the tyres are on that line if car and road go on as now; 0 when on it, infinite when keeping to the lane
        or farther away than 20 s.
    due : bool
        Warn: a crossing is surely less than a second away, or happening.
    """

    left_m: float
    right_m: float
    drift_mps: float
    side: str | None
    time_to_crossing_s: float
    due: bool

    def describe(self) -> str | None:
        """Words for the picture; None when there is nothing to warn of."""
        if not self.due:
            return None
        crossing = "crossing" if self.time_to_crossing_s == 0 else f"{self.time_to_crossing_s:.1f} s to"
        return f"lane departure: {crossing} the {self.side} line"


def watch_departure(
    lane: Lane,
    speed_mps: float,
    *,
    path_per_m: float = 0.0,
    course_rad: float = 0.0,
    half_track_m: float = HALF_TRACK_M,
    turning_std_per_m: float = 0.0,
    course_std_rad: float = 0.0,
) -> DepartureWarning:
    """How soon the car leaves `lane`.

    Parameters
    ----------
    lane : Lane
    speed_mps : float
    path_per_m : float
        Curvature of the path that the car steers: relative to the lane it turns by the difference of both.
    course_rad : float
        Direction in which the camera moves, seen from it.
    half_track_m : float
        From the car's middle to the outside of its tyres.
    turning_std_per_m, course_std_rad : float
        How well that difference of curvatures and the course along the lane are known. A warning is due if the car
        would cross the line even were it to turn and to drift by so much less.

    Returns
    -------
    DepartureWarning

    Notes
    -----
    The lane's lines move sideways by v sin(h) t + (k - path) (v t)^2 / 2; the crossing is the first positive root.
    """
    left, right = lane.left.c0_m - half_track_m, -lane.right.c0_m - half_track_m
    along = lane.heading_rad - course_rad
    turning = lane.curvature_per_m - path_per_m
    drift = -speed_mps * float(np.sin(along))
    side, time = _crossing(left, right, drift, -turning * speed_mps**2)
    surely = -speed_mps * float(np.sin(_less(along, course_std_rad)))
    _, late = _crossing(left, right, surely, -_less(turning, turning_std_per_m) * speed_mps**2)
    return DepartureWarning(left, right, drift, side, time, late < WARN_S)


def _crossing(left_m: float, right_m: float, drift_mps: float, turning_mps2: float) -> tuple[str | None, float]:
    """The line that is crossed first, None if none is, and when."""
    times = {"left": _time_to(left_m, drift_mps, turning_mps2), "right": _time_to(right_m, -drift_mps, -turning_mps2)}
    side = min(times, key=times.get)
    return side if np.isfinite(times[side]) else None, times[side]


def _less(value: float, by: float) -> float:
    """A value nearer to zero by so much, and zero if it would pass it."""
    return float(np.sign(value)) * max(abs(value) - by, 0.0)


def _time_to(distance_m: float, speed: float, acceleration: float) -> float:
    """First time at which speed t + acceleration t^2 / 2 reaches the distance; 0 when past it, inf when not soon."""
    if distance_m <= 0:
        return 0.0
    if speed < LEAST_DRIFT_MPS:
        return float("inf")
    root = speed**2 + 2 * acceleration * distance_m
    if root < 0:
        return float("inf")
    time = 2 * distance_m / (speed + np.sqrt(root))
    return float(time) if time < LONGEST_S else float("inf")
