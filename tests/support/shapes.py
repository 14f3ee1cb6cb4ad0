"""Camera matrices, lane parameters by name, and lanes with given errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lanes.car import CarMotion, Departure, TrackedCar
from lanes.detect.confidence import error_variance_factor
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.road import parameter_vector

SEEN = LineEvidence(0.5, True, 40.0)


def intrinsics(fu_px: float, fv_px: float, u_px: float, v_px: float) -> np.ndarray:
    """Camera matrix (3, 3) with focal lengths and principal point."""
    matrix = np.diag([fu_px, fv_px, 1.0])
    matrix[:2, 2] = (u_px, v_px)
    return matrix


def a_lane(*, width: float = 3.5, **parameters: float | Sequence[float]) -> np.ndarray:
    """`parameter_vector` of a lane 3.5 m wide, if nothing else is said."""
    return parameter_vector(width=width, **parameters)


def straight_car(camera_yaw_rad: float) -> TrackedCar:
    """A car in the middle of a straight lane, seen by a camera with a wrong yaw."""
    motion = CarMotion(
        speed_mps=25.0,
        path_per_m=0.0,
        course_rad=camera_yaw_rad,
        turning_std_per_m=0.0,
        course_std_rad=0.0,
        speed_std_mps=0.0,
    )
    departure = Departure(
        left_m=0.9,
        right_m=0.9,
        drift_mps=0.0,
        side=None,
        time_to_crossing_s=float("inf"),
        due=False,
    )
    return TrackedCar(camera_yaw_rad, motion, departure)


def found_lane(
    model: np.ndarray,
    std: np.ndarray,
    lines: tuple = (SEEN, SEEN),
    *,
    score: float = 1.0,
    **others: object,
) -> Lane:
    """A lane (15,) found in a still, whose errors have these standard deviations."""
    assumed = np.diag(std**2) / error_variance_factor(model, tracked=False)
    return Lane(model, model, assumed, lines, score=score, **others)
