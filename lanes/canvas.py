"""Lines, areas and text on RGB images.

Points are (column u, row v) in pixels, floats, shape (N, 2), pixel centres at integers,
accurate to 1/16 px. `draw_polyline`, `blend_polygon` and `put_text` draw in place, on
RGB images (height, width, 3), uint8.
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
# Fractional bits of OpenCV's drawing coordinates: 1/16 px is finer than anti-aliasing
# shows.
_SHIFT = 4


def draw_polyline(
    image: np.ndarray,
    points_px: np.ndarray,
    colour: Colour,
    width_px: float,
    *,
    closed: bool = False,
) -> None:
    """Draw a polyline through points (N, 2); fewer than two points draw nothing."""
    if len(points_px) < 2:
        return
    # Measured on OpenCV 5.0 with anti-aliasing: 1 gives 1.3 px, an even n gives
    # n + 1.4 px, an odd n the same as n + 1.
    thickness = max(1, 2 * round((width_px - 1.4) / 2))
    points = [_to_fixed_point(points_px)]
    cv2.polylines(image, points, closed, colour, thickness, cv2.LINE_AA, _SHIFT)


def blend_polygon(
    image: np.ndarray,
    polygon_px: np.ndarray,
    colour: Colour,
    alpha: float,
    *,
    edge: int = cv2.LINE_AA,
) -> None:
    """Blend a polygon (N, 2) of one colour into the image with weight `alpha`.

    If lines will cover the polygon's edges, `edge=cv2.LINE_8` fills it in a quarter of
    the time.
    """
    # only the part of the image around the polygon
    height, width = image.shape[:2]
    first = np.clip(polygon_px.min(axis=0) - 1, 0, (width, height))
    last = np.clip(polygon_px.max(axis=0) + 2, 0, (width, height))
    left, top = first.astype(int).tolist()
    right, bottom = last.astype(int).tolist()
    part = image[top:bottom, left:right]
    if not part.size:
        return
    filled = part.copy()
    fill_polygon(filled, polygon_px - (left, top), colour, edge=edge)
    cv2.addWeighted(filled, alpha, part, 1 - alpha, 0, dst=part)


def fill_polygon(
    image: np.ndarray,
    polygon_px: np.ndarray,
    colour: Colour,
    *,
    edge: int = cv2.LINE_AA,
) -> None:
    """Fill a polygon (N, 2); fewer than three points draw nothing."""
    if len(polygon_px) > 2:
        cv2.fillPoly(image, [_to_fixed_point(polygon_px)], colour, edge, _SHIFT)


def draw_dots(
    image: np.ndarray,
    points_px: np.ndarray,
    colour: Colour,
    width_px: float,
    step_px: float,
) -> None:
    """Draw a dotted line through points (N, 2), the last one included: round dots of a
    width, a step apart.
    """
    if len(points_px) < 2:
        return
    lengths_px = np.hypot(*np.diff(points_px, axis=0).T)
    along_px = np.append(0.0, lengths_px.cumsum())
    # a point far outside of the image makes the line long
    height, width = image.shape[:2]
    at_px = np.arange(along_px[-1], 0.0, -step_px)[: 4 * (width + height)]
    u = np.interp(at_px, along_px, points_px[:, 0])
    v = np.interp(at_px, along_px, points_px[:, 1])
    dots = np.column_stack([u, v])

    end = np.add((width, height), width_px)
    inside = (dots > -width_px) & (dots < end)
    radius = round(width_px / 2 * (1 << _SHIFT))
    for centre in _to_fixed_point(dots[inside.all(axis=1)]).tolist():
        cv2.circle(image, centre, radius, colour, cv2.FILLED, cv2.LINE_AA, _SHIFT)


def put_text(
    image: np.ndarray,
    lines: str | Sequence[str],
    *,
    size_px: int | None = None,
    panel_alpha: float = 0.6,
) -> None:
    """Write lines of white text at the top left, on a dark panel that keeps them
    readable on any background.

    Latin, Greek and Cyrillic letters and signs such as ° and ± are supported. The font
    size is that of `text_size` by default, and smaller if the text would not fit.
    `panel_alpha` is the opacity of the panel, 0 to 1.
    """
    lines = [lines] if isinstance(lines, str) else list(lines)
    if not lines:
        return
    height, width = image.shape[:2]
    largest_px = size_px or text_size(width, height)
    size, box_width, box_height = _fit_text(lines, largest_px, width, height)

    # The mean of the three channels: blending the panel's slight blue takes twice as
    # long, and is not visible.
    shade = panel_alpha * sum(PANEL_COLOUR) / 3
    panel = image[:box_height, :box_width]
    cv2.convertScaleAbs(panel, dst=panel, alpha=1 - panel_alpha, beta=shade)

    left = _text_margin(size)
    bottom = left // 2 + size
    for line in lines:
        cv2.putText(
            image,
            line,
            (left, bottom),
            (255, 255, 255),
            _font(),
            size,
            _FONT_WEIGHT,
            cv2.PUT_TEXT_ALIGN_LEFT,
            # OpenCV would wrap a long line at the left edge, over the line before: the
            # wrap range is put out of reach.
            (0, 1 << 20),
        )
        bottom += _line_height(size)


def text_size(width: int, height: int) -> int:
    """Default font size for images of a size: the same for all frames of a video,
    whatever the text, pixels.
    """
    return max(14, round(sqrt(width * height) / 32))


def _line_height(size_px: int) -> int:
    """Height of a line of text with its spacing, pixels."""
    return size_px + max(2, size_px // 3)


def _text_margin(size_px: int) -> int:
    """Horizontal margin of text, pixels; the vertical one is half, because few letters
    fill the line's height.
    """
    return max(2, round(size_px * 0.6))


def finite_points(points_px: np.ndarray) -> np.ndarray:
    """Points (N, 2) as floats, without rows that contain NaN or infinity."""
    points = np.asarray(points_px, float).reshape(-1, 2)
    return points[np.isfinite(points).all(axis=1)]


def _to_fixed_point(points_px: np.ndarray) -> np.ndarray:
    """Integers (N, 2) of 1/16 px for OpenCV's drawing functions."""
    # a million is far outside any image, and fits in 32 bits
    points = points_px.clip(-1e6, 1e6) * (1 << _SHIFT)
    return np.round(points).astype(np.int32)


def _fit_text(
    lines: Sequence[str], size: int, width: int, height: int
) -> tuple[int, int, int]:
    """Largest font size up to `size` at which `lines` and their margins fit; and their
    width and height, pixels.
    """
    for smaller in range(max(size, 1), 0, -1):
        margin = _text_margin(smaller)
        longest = max(_text_width(line, smaller) for line in lines)
        box_width = longest + 2 * margin
        box_height = len(lines) * _line_height(smaller) + margin
        if box_width <= width and box_height <= height:
            break
    return smaller, min(box_width, width), min(box_height, height)


@cache
def _font() -> cv2.FontFace:
    # OpenCV's outline font; its stroke fonts have no letters and signs beyond ASCII.
    # Commands that write no text do not wait for it.
    return cv2.FontFace("sans")


@lru_cache(maxsize=64)
def _text_width(line: str, size: int) -> int:
    """Width in pixels; cached, because it takes as long as drawing, and most lines stay
    the same for several frames.
    """
    box = cv2.getTextSize((0, 0), line, (0, 0), _font(), size, _FONT_WEIGHT)
    return box[2]
