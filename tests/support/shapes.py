"""Lane parameters by name, and stripes at given positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lanes.detect.evidence import PAINT, Stripes, strength_weight
from lanes.detect.road import parameter_vector

# Growth from row to row and width of the columns of the usual view; focal length of the camera.
GROWTH, CELL_M, FOCAL_PX = 0.022, 0.05, 1150.0


def a_lane(**parameters: float | Sequence[float]) -> np.ndarray:
    """`parameter_vector` of a lane 3.5 m wide, if nothing else is said."""
    return parameter_vector(**{"width": 3.5, **parameters})


def stripes_at(
    row: np.ndarray,
    x_m: np.ndarray,
    y_m: np.ndarray,
    angle: np.ndarray,
    strength: np.ndarray | float = 30.0,
    *,
    growth: float = GROWTH,
    cell_m: float = CELL_M,
) -> Stripes:
    """Stripes (N,) of the given places, directions and strength in a view of such rows and columns."""
    step = x_m * growth / (1 + growth) / cell_m
    weight = strength_weight(np.broadcast_to(strength, len(x_m)) + 0.0)
    std_m = np.hypot(PAINT.position_std_m, x_m / FOCAL_PX)
    edge = np.zeros(len(x_m), bool)
    return Stripes(row, x_m, y_m, angle, step, weight, std_m, np.full(len(x_m), PAINT.angle_std_rad), edge, ~edge)
