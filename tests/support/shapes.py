"""Lane parameters by name, and stripes at given positions."""

from __future__ import annotations

import numpy as np

from lanes.tracking.markings import Stripes
from lanes.tracking.model import ADJACENT, PARAMETERS, RATE_STEPS, VERTICAL_CURVATURE

# The usual view's rows grow by this share from one to the next, and its columns are as wide.
GROWTH, CELL_M = 0.022, 0.05


def a_lane(
    *,
    centre: float = 0.0,
    width: float = 3.5,
    heading: float = 0.0,
    curvature: float = 0.0,
    rate: float = 0.0,
    pitch: float = 0.0,
    vertical: float | tuple[float, ...] = 0.0,
    rate_steps: float | tuple[float, ...] = 0.0,
    adjacent: float | tuple[float, ...] = 0.0,
) -> np.ndarray:
    """Lane parameters (15,), or their standard deviations.

    `vertical`, `rate_steps` and `adjacent` take one value for all of their parameters, or one for each.
    """
    lane = np.empty(PARAMETERS)
    lane[: VERTICAL_CURVATURE.start] = centre, width, heading, curvature, rate, pitch
    lane[VERTICAL_CURVATURE], lane[RATE_STEPS], lane[ADJACENT] = vertical, rate_steps, adjacent
    return lane


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
    """White stripes (N,) of the given places, directions and strength in a view of such rows and columns."""
    no = np.zeros(len(x_m), bool)
    step = x_m * growth / (1 + growth) / cell_m
    return Stripes(row, x_m, y_m, angle, step, np.broadcast_to(strength, len(x_m)) + 0.0, no)
