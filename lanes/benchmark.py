"""Results against truth: how far a found lane is from the true one, and how much of a binary is paint.

Truth is a frame of truth.json (see lanes.dataset): points of both lines in the road frame, metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lanes.camera import Camera
from lanes.result import LaneResult
from lanes.search import binary_pixels
from lanes.view import view_to_road

# Where a driver needs the lane: from the bonnet to about a second ahead on a motorway.
NEAR_M, FAR_M = 5.0, 30.0


def worst_lateral_error_m(result: LaneResult, truth: dict | None) -> float | None:
    """Largest lateral distance between found and true lines, 5 to 30 m ahead, metres.

    Infinite where a line was not found: a lane that is lost is not half right. None where no truth is known.
    """
    if truth is None:
        return None
    if result.left_road is None or result.right_road is None:
        return np.inf
    x = np.array(truth["x_m"])
    ahead = (x >= NEAR_M) & (x <= FAR_M)
    errors = [
        np.abs(line.lateral_m(x[ahead]) - np.array(truth[key])[ahead])
        for line, key in ((result.left_road, "left_y_m"), (result.right_road, "right_y_m"))
    ]
    return float(np.max(errors))


def paint_share(
    result: LaneResult, truth: dict | None, camera: Camera, *, beside_m: float = 1.0, paint_m: float = 0.2
) -> float | None:
    """Share of a recipe's set pixels that lie on the paint of the own lane.

    Counted are the pixels from 5 to 30 m ahead in the own lane and `beside_m` to each side of it; right are those
    within `paint_m` of the centre of a line (half a painted line, and as much again for blur).

    Parameters
    ----------
    result : LaneResult
        Its `steps.warped_binary` is judged.
    truth : dict or None
        A frame of truth.json.
    camera : Camera
        With a mount.

    Returns
    -------
    float or None
        In range 0..1; None where no truth is known or nothing is set there.
    """
    if truth is None:
        return None
    x, y = view_to_road(binary_pixels(result.steps.warped_binary), result.warp, camera).T
    left, right = (np.interp(x, truth["x_m"], truth[key]) for key in ("left_y_m", "right_y_m"))
    counted = (x >= NEAR_M) & (x <= FAR_M) & (y < left + beside_m) & (y > right - beside_m)
    if not counted.any():
        return None
    on_paint = np.minimum(np.abs(y - left), np.abs(y - right)) <= paint_m
    return float(on_paint[counted].mean())


def describe_error(error_m: float | None) -> str:
    """Words for an error: "0.12 m", "lost" where nothing was found, "unknown" where there is no truth."""
    if error_m is None:
        return "unknown"
    return f"{error_m:.2f} m" if np.isfinite(error_m) else "lost"


def format_table(columns: Sequence[str], rows: Mapping[str, Sequence[str]]) -> str:
    """Lay out texts in columns of equal width: a heading line, then a line for each named row."""
    width = 2 + max(len(text) for texts in (columns, *rows.values()) for text in texts)
    name_width = max(map(len, rows), default=0)
    lines = [("", columns), *rows.items()]
    return "\n".join(name.ljust(name_width) + "".join(text.rjust(width) for text in texts) for name, texts in lines)
