"""Drawing on copies of RGB pictures: areas, lines, text, thumbnails.

The input is never changed and may be read-only; `lanes.drawing.canvas` draws in place. Points are (column u, row v) in
pixels, floats, shape (N, 2), pixel centres at integers; rows with NaN are dropped. All functions raise PictureError if
the picture is not RGB (height, width, 3), uint8.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np

from lanes.drawing.canvas import (
    LANE_COLOUR,
    Colour,
    Plane,
    blend_polygon,
    darken_box,
    draw_polyline,
    draw_text_line,
    finite_points,
    fit_text,
    line_height,
    put_text,
)
from lanes.io.frames import require_rgb


def fill_lane(
    image: np.ndarray, left_px: np.ndarray, right_px: np.ndarray, *, colour: Colour = LANE_COLOUR, alpha: float = 0.3
) -> np.ndarray:
    """A copy of the picture with the area between two lines tinted with opacity `alpha`, 0 to 1.

    The lines (N, 2) and (M, 2) both run from far to near or both from near to far; with fewer than two points in one of
    them nothing is drawn.
    """
    drawn, left, right = _copy_rgb(image), finite_points(left_px), finite_points(right_px)
    if len(left) >= 2 and len(right) >= 2:
        blend_polygon(drawn, np.vstack([left, right[::-1]]), colour, alpha)
    return drawn


def draw_line(image: np.ndarray, points_px: np.ndarray, *, colour: Colour, width_px: float = 4.0) -> np.ndarray:
    """A copy of the RGB picture with a polyline through points (N, 2); fewer than two points draw nothing."""
    drawn = _copy_rgb(image)
    draw_polyline(drawn, finite_points(points_px), colour, width_px)
    return drawn


def write_text(image: np.ndarray, lines: str | Sequence[str], **options: Any) -> np.ndarray:
    """A copy of the RGB picture with lines of text; options and exceptions as for `lanes.drawing.canvas.put_text`."""
    drawn = _copy_rgb(image)
    put_text(drawn, lines, **options)
    return drawn


def draw_mosaic(image: np.ndarray, thumbnails: Mapping[str, np.ndarray], *, lines: Sequence[str] = ()) -> np.ndarray:
    """A copy of the picture with thumbnails, and text to their right, on a dark strip along the upper quarter.

    `thumbnails` are RGB pictures or masks (see `to_rgb`) of any size by title, at least one, in order from the left.
    `lines` of text take the right 30 % of the strip.
    """
    drawn = _copy_rgb(image)
    height, width = image.shape[:2]
    strip_height, margin = height // 4, max(2, height // 90)
    title_size = max(6, height // 36)
    darken_box(Plane(drawn), (0, 0, width, strip_height), 0.75)
    left, top = margin, margin + line_height(title_size)
    room = (width * (0.7 if lines else 1.0) - margin) / len(thumbnails) - margin
    for title, thumbnail in thumbnails.items():
        small = _shrink(to_rgb(thumbnail), int(room), strip_height - margin - top)
        drawn[top : top + small.shape[0], left : left + small.shape[1]] = small
        size, *_ = fit_text([title], title_size, small.shape[1] + margin, strip_height)
        draw_text_line(Plane(drawn), title, left, margin, size)
        left += small.shape[1] + margin
    if lines:
        put_text(drawn[:strip_height, left:], lines, size_px=round(height / 24), panel_alpha=0)
    return drawn


def to_rgb(picture: np.ndarray) -> np.ndarray:
    """A new RGB picture from RGB, gray (height, width) uint8, or a mask of bool or of 0 and 1."""
    picture = np.asarray(picture)
    if picture.ndim == 2:
        if picture.dtype == bool or (picture.size and picture.max() <= 1):
            picture = (picture > 0).astype(np.uint8) * 255
        picture = np.repeat(picture[:, :, None], 3, axis=2)
    return _copy_rgb(picture)


def _copy_rgb(image: np.ndarray) -> np.ndarray:
    require_rgb(image)
    return image.copy()


def _shrink(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """The picture resized to fit into `width` x `height`, with its aspect ratio."""
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = max(1, int(picture.shape[1] * scale)), max(1, int(picture.shape[0] * scale))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
