"""Lines, areas and text on RGB images.

Points are (column u, row v) in pixels, floats, shape (N, 2), pixel centres at integers, accurate to 1/16 px.
`draw_polyline`, `blend_polygon` and `put_text` draw in place, on RGB images (height, width, 3), uint8.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from math import sqrt

import cv2
import numpy as np

Colour = tuple[int, int, int]

# RGB colours of images and plots.
LANE_COLOUR: Colour = (0, 220, 90)
UNLIKELY_COLOUR: Colour = (255, 170, 0)
LEFT_COLOUR: Colour = (255, 70, 60)
RIGHT_COLOUR: Colour = (60, 130, 255)
WINDOW_COLOUR: Colour = (255, 210, 0)
PANEL_COLOUR: Colour = (16, 18, 22)

# On OpenCV's scale, where 400 is regular and 600 semi-bold.
_FONT_WEIGHT = 500
# Fractional bits of OpenCV's drawing coordinates: 1/16 px is finer than anti-aliasing shows.
_SHIFT = 4


def draw_polyline(
    image: np.ndarray, points_px: np.ndarray, colour: Colour, width_px: float, *, closed: bool = False
) -> None:
    """Draw a polyline through points (N, 2); fewer than two points draw nothing."""
    if len(points_px) < 2:
        return
    # Measured on OpenCV 5.0 with anti-aliasing: 1 gives 1.3 px, an even n gives n + 1.4 px, an odd n the same as n + 1.
    thickness = max(1, 2 * round((width_px - 1.4) / 2))
    cv2.polylines(image, [_to_fixed_point(points_px)], closed, colour, thickness, cv2.LINE_AA, _SHIFT)


def blend_polygon(
    image: np.ndarray, polygon_px: np.ndarray, colour: Colour, alpha: float, *, edge: int = cv2.LINE_AA
) -> None:
    """Blend a polygon (N, 2) of one colour into the image with weight `alpha`.

    If lines will cover the polygon's edges, `edge=cv2.LINE_8` fills it in a quarter of the time.
    """
    height, width = image.shape[:2]
    (left, top), (right, bottom) = polygon_px.min(axis=0).tolist(), polygon_px.max(axis=0).tolist()
    left, right = np.clip([left - 1, right + 2], 0, width).astype(int).tolist()
    top, bottom = np.clip([top - 1, bottom + 2], 0, height).astype(int).tolist()
    part = image[top:bottom, left:right]
    if part.size:
        filled = part.copy()
        fill_polygon(filled, polygon_px - (left, top), colour, edge=edge)
        cv2.addWeighted(filled, alpha, part, 1 - alpha, 0, dst=part)


def fill_polygon(image: np.ndarray, polygon_px: np.ndarray, colour: Colour, *, edge: int = cv2.LINE_AA) -> None:
    """Fill a polygon (N, 2); fewer than three points draw nothing."""
    if len(polygon_px) > 2:
        cv2.fillPoly(image, [_to_fixed_point(polygon_px)], colour, edge, _SHIFT)


def draw_dots(image: np.ndarray, points_px: np.ndarray, colour: Colour, width_px: float, step_px: float) -> None:
    """Draw a dotted line through points (N, 2), the last one included: round dots of a width, a step apart."""
    if len(points_px) < 2:
        return
    height, width = image.shape[:2]
    along_px = np.append(0.0, np.hypot(*np.diff(points_px, axis=0).T).cumsum())
    # a point far outside of the image makes the line long
    at_px = np.arange(along_px[-1], 0.0, -step_px)[: 4 * (width + height)]
    dots = np.column_stack([np.interp(at_px, along_px, axis) for axis in points_px.T])
    inside = ((dots > -width_px) & (dots < np.add((width, height), width_px))).all(axis=1)
    radius = round(width_px / 2 * (1 << _SHIFT))
    for centre in _to_fixed_point(dots[inside]).tolist():
        cv2.circle(image, centre, radius, colour, cv2.FILLED, cv2.LINE_AA, _SHIFT)


def put_text(
    image: np.ndarray, lines: str | Sequence[str], *, size_px: int | None = None, panel_alpha: float = 0.6
) -> None:
    """Write lines of white text at the top left, on a dark panel that keeps them readable on any background.

    Latin, Greek and Cyrillic letters and signs such as ° and ± are supported. The font size is that of `text_size` by
    default, and smaller if the text would not fit. `panel_alpha` is the opacity of the panel, 0 to 1.
    """
    lines = [lines] if isinstance(lines, str) else list(lines)
    if not lines:
        return
    height, width = image.shape[:2]
    size, box_width, box_height = _fit_text(lines, size_px or text_size(width, height), width, height)
    panel = image[:box_height, :box_width]
    # The mean of the three channels: blending the panel's slight blue takes twice as long, and is not visible.
    cv2.convertScaleAbs(panel, dst=panel, alpha=1 - panel_alpha, beta=panel_alpha * sum(PANEL_COLOUR) / 3)
    # OpenCV would wrap a long line at the left edge, over the line before: the wrap range is put out of reach.
    align, wrap_range = cv2.PUT_TEXT_ALIGN_LEFT, (0, 1 << 20)
    for number, line in enumerate(lines):
        position = _text_margin(size), _text_margin(size) // 2 + number * _line_height(size) + size
        cv2.putText(image, line, position, (255, 255, 255), _font(), size, _FONT_WEIGHT, align, wrap_range)


def text_size(width: int, height: int) -> int:
    """Default font size for images of a size: the same for all frames of a video, whatever the text, pixels."""
    return max(14, round(sqrt(width * height) / 32))


def _line_height(size_px: int) -> int:
    """Height of a line of text with its spacing, pixels."""
    return size_px + max(2, size_px // 3)


def _text_margin(size_px: int) -> int:
    """Horizontal margin of text, pixels; the vertical one is half, because few letters fill the line's height."""
    return max(2, round(size_px * 0.6))


def finite_points(points_px: np.ndarray) -> np.ndarray:
    """Points (N, 2) as floats, without rows that contain NaN or infinity."""
    points = np.asarray(points_px, float).reshape(-1, 2)
    return points[np.isfinite(points).all(axis=1)]


def _to_fixed_point(points_px: np.ndarray) -> np.ndarray:
    """Integers (N, 2) of 1/16 px for OpenCV's drawing functions."""
    # a million is far outside any image, and fits in 32 bits
    return np.round(points_px.clip(-1e6, 1e6) * (1 << _SHIFT)).astype(np.int32)


def _fit_text(lines: Sequence[str], size: int, width: int, height: int) -> tuple[int, int, int]:
    """Largest font size up to `size` at which `lines` and their margins fit; and their width and height, pixels."""
    for smaller in range(max(size, 1), 0, -1):
        box_width = max(_text_width(line, smaller) for line in lines) + 2 * _text_margin(smaller)
        box_height = len(lines) * _line_height(smaller) + _text_margin(smaller)
        if box_width <= width and box_height <= height:
            break
    return smaller, min(box_width, width), min(box_height, height)


@cache
def _font() -> cv2.FontFace:
    # OpenCV's outline font; its stroke fonts have no letters and signs beyond ASCII. Commands that write no text do not
    # wait for it.
    return cv2.FontFace("sans")


@lru_cache(maxsize=64)
def _text_width(line: str, size: int) -> int:
    """Width in pixels; cached, because it takes as long as drawing, and most lines stay the same for several frames."""
    return cv2.getTextSize((0, 0), line, (0, 0), _font(), size, _FONT_WEIGHT)[2]
