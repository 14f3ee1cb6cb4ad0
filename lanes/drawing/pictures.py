"""Drawing on pictures: the lane, lines, text, the diagnostic strip.

Functions take a picture and return a new one; their input is never changed, so read-only frames are welcome. Those who
have several things to draw on one copy take `lanes.drawing.canvas`, which draws in place.
Points are (column u, row v) in pixels, floats, shape (N, 2), pixel centres at integers; rows with NaN are dropped.
Edges are anti-aliased, and places count to 1/16 px.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from lanes.drawing.canvas import (
    LANE_COLOUR,
    TEXT_COLOUR,
    Colour,
    Layer,
    blend_polygon,
    draw_polyline,
    draw_text_line,
    fit_text,
    line_height,
    put_text,
    shade,
)
from lanes.io.frames import require_rgb

# A straight stretch of the undistorted picture is bent by the lens: steps this short follow it to 0.01 px.
_STEP_PX = 8.0


def fill_lane(
    image: np.ndarray, left_px: np.ndarray, right_px: np.ndarray, *, colour: Colour = LANE_COLOUR, alpha: float = 0.3
) -> np.ndarray:
    """Tint the area between two lines.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    left_px, right_px : ndarray of shape (N, 2) and (M, 2)
        The two borders, both from far to near or both from near to far.
    colour : tuple of three int
        RGB.
    alpha : float, in range 0..1
        0 leaves the picture as it is, 1 paints over it.

    Returns
    -------
    ndarray of the same shape, uint8
        Unchanged copy where a border has fewer than two points.
    """
    require_rgb(image)
    left, right = _finite(left_px), _finite(right_px)
    if len(left) < 2 or len(right) < 2:
        return image.copy()
    drawn = image.copy()
    blend_polygon(drawn, np.vstack([left, right[::-1]]), colour, alpha)
    return drawn


def draw_line(image: np.ndarray, points_px: np.ndarray, *, colour: Colour, width_px: float = 4.0) -> np.ndarray:
    """Draw a polyline through `points_px`, (N, 2), `width_px` wide; fewer than two points draw nothing."""
    require_rgb(image)
    drawn = image.copy()
    draw_polyline(drawn, _finite(points_px), colour, width_px)
    return drawn


def write_text(
    image: np.ndarray,
    lines: str | Sequence[str],
    *,
    corner: str = "top left",
    size_px: int | None = None,
    colour: Colour = TEXT_COLOUR,
    panel_alpha: float = 0.6,
) -> np.ndarray:
    """Write lines of text into a corner, on a dark panel so that they can be read on any background.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    lines : str or sequence of str
        One string a line; any letters of Latin, Greek or Cyrillic and signs such as ° and ± can be used.
    corner : {"top left", "top right", "bottom left", "bottom right"}
    size_px : int, optional
        Height of the letters' line in pixels, 1/24 of the picture's height by default. Made smaller where the text
        would not fit, so that nothing is cut off.
    colour : tuple of three int
        RGB of the letters.
    panel_alpha : float, in range 0..1
        How much the panel hides of the picture.

    Raises
    ------
    ValueError
        If `corner` is none of the four.
    """
    require_rgb(image)
    drawn = image.copy()
    put_text(drawn, lines, corner=corner, size_px=size_px, colour=colour, panel_alpha=panel_alpha)
    return drawn


def draw_mosaic(
    image: np.ndarray, thumbnails: Sequence[np.ndarray], titles: Sequence[str], *, lines: Sequence[str] = ()
) -> np.ndarray:
    """Put small pictures of the steps on a dark strip along the top, with text to their right.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB; the strip covers its upper quarter.
    thumbnails : sequence of ndarray
        RGB pictures or masks (see `to_rgb`) of any size, shown in order from the left; usually binary, warp and fit.
    titles : sequence of str
        One for each thumbnail.
    lines : sequence of str
        Text for the right of the strip; the thumbnails then leave it 30 % of the width.

    Raises
    ------
    ValueError
        If there are not as many titles as thumbnails, or none.
    """
    require_rgb(image)
    if len(thumbnails) != len(titles) or not titles:
        raise ValueError(f"one title for each thumbnail is needed; got {len(thumbnails)} and {len(titles)}.")
    height, width = image.shape[:2]
    strip_height, margin = height // 4, max(2, height // 90)
    title_size = max(6, height // 36)
    drawn = image.copy()
    shade(Layer(drawn), (0, 0, width, strip_height), 0.75)
    room = (width * (0.7 if lines else 1.0) - margin) / len(titles) - margin
    cell = (int(room), strip_height - 2 * margin - line_height(title_size))
    left = margin
    for thumbnail, title in zip(thumbnails, titles, strict=True):
        small = _shrink(to_rgb(thumbnail), cell)
        top = margin + line_height(title_size)
        drawn[top : top + small.shape[0], left : left + small.shape[1]] = small
        size, *_ = fit_text([title], title_size, small.shape[1] + margin, strip_height)
        draw_text_line(Layer(drawn), title, left, margin, size, TEXT_COLOUR)
        left += small.shape[1] + margin
    if lines:
        rest = np.ascontiguousarray(drawn[:strip_height, left:])
        drawn[:strip_height, left:] = write_text(rest, lines, size_px=round(height / 24), panel_alpha=0)
    return drawn


def to_rgb(picture: np.ndarray) -> np.ndarray:
    """A new RGB picture from an RGB one, a gray one (height, width) uint8, or a mask of bool or of 0 and 1."""
    picture = np.asarray(picture)
    if picture.ndim == 2:
        if picture.dtype == bool or (picture.size and picture.max() <= 1):
            picture = (picture > 0).astype(np.uint8) * 255
        picture = np.repeat(picture[:, :, None], 3, axis=2)
    require_rgb(picture)
    return picture.copy()


def _finite(points_px: np.ndarray) -> np.ndarray:
    points = np.asarray(points_px, float).reshape(-1, 2)
    return points[np.isfinite(points).all(axis=1)]


def _shrink(picture: np.ndarray, cell: tuple[int, int]) -> np.ndarray:
    """Resize to fit into `cell` (width, height), keeping the shape."""
    scale = min(cell[0] / picture.shape[1], cell[1] / picture.shape[0])
    size = max(1, int(picture.shape[1] * scale)), max(1, int(picture.shape[0] * scale))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
