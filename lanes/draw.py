"""Drawing on pictures: the lane, lines, text, the diagnostic strip.

Functions take a picture and return a new one; their input is never changed, so read-only frames are welcome. Only
`tint_area`, `stroke_line` and `write_on` draw in place, for those who have several things to draw on one copy.
Points are (column u, row v) in pixels, floats, shape (N, 2), pixel centres at integers; rows with NaN are dropped.
Edges are anti-aliased, and places count to 1/16 px.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.images import require_rgb

Colour = tuple[int, int, int]

# One colour (RGB) for each kind of thing, in pictures and in plots alike.
LANE: Colour = (0, 220, 90)
LEFT: Colour = (255, 70, 60)
RIGHT: Colour = (60, 130, 255)
WINDOW: Colour = (255, 210, 0)
TEXT: Colour = (255, 255, 255)
PANEL: Colour = (16, 18, 22)

CORNERS = ("top left", "top right", "bottom left", "bottom right")

# Fractional bits of the integers that OpenCV's drawing takes: 4 bits are 1/16 px, finer than anti-aliasing shows.
_SHIFT = 4
# Points further out are pulled to here, well inside 32-bit integers and far outside any picture.
_FARTHEST_PX = 1e6
# A straight stretch of the undistorted picture is bent by the lens: steps this short follow it to 0.01 px.
_STEP_PX = 8.0


def fill_lane(
    image: np.ndarray, left_px: np.ndarray, right_px: np.ndarray, *, colour: Colour = LANE, alpha: float = 0.3
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
    tint_area(drawn, np.vstack([left, right[::-1]]), colour, alpha)
    return drawn


def draw_line(image: np.ndarray, points_px: np.ndarray, *, colour: Colour, width_px: float = 4.0) -> np.ndarray:
    """Draw a polyline through `points_px`, (N, 2), `width_px` wide; fewer than two points draw nothing."""
    require_rgb(image)
    drawn = image.copy()
    stroke_line(drawn, _finite(points_px), colour, width_px)
    return drawn


def draw_lane(
    image: np.ndarray,
    left_px: np.ndarray | None,
    right_px: np.ndarray | None,
    camera: Camera | None = None,
    *,
    colour: Colour = LANE,
    alpha: float = 0.3,
    line_width_px: float | None = None,
) -> np.ndarray:
    """Draw a lane on the picture as the camera took it.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB. The raw picture when `camera` is given, otherwise the one that the points belong to.
    left_px, right_px : ndarray of shape (N, 2) and (M, 2), or None
        The two lines, both from far to near or both from near to far. None where a line was not found:
        the other one is still drawn, and nothing is filled.
    camera : Camera, optional
        The points are then pixels of the undistorted picture, and go through the lens model: drawn as they are they
        would lie beside the paint of the raw picture.
    colour, alpha
        Of the area between the lines, see `fill_lane`.
    line_width_px : float, optional
        Width of the lines, red left and blue right; 0 leaves them out. The default is 1/160 of the picture's width.

    Raises
    ------
    PictureError
        If the picture is not RGB or not of the camera's size.
    """
    require_rgb(image)
    if camera is not None:
        camera.require_size(image)
    left, right = (_on_raw_picture(points, camera) for points in (left_px, right_px))
    drawn = fill_lane(image, left, right, colour=colour, alpha=alpha)
    width_px = image.shape[1] / 160 if line_width_px is None else line_width_px
    if width_px > 0:
        stroke_line(drawn, left, LEFT, width_px)
        stroke_line(drawn, right, RIGHT, width_px)
    return drawn


def write_text(
    image: np.ndarray,
    lines: str | Sequence[str],
    *,
    corner: str = "top left",
    size_px: int | None = None,
    colour: Colour = TEXT,
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
    write_on(drawn, lines, corner=corner, size_px=size_px, colour=colour, panel_alpha=panel_alpha)
    return drawn


def write_on(
    image: np.ndarray,
    lines: str | Sequence[str],
    *,
    corner: str = "top left",
    size_px: int | None = None,
    colour: Colour = TEXT,
    panel_alpha: float = 0.6,
) -> None:
    """Write lines of text on `image` in place; see `write_text`."""
    if corner not in CORNERS:
        raise ValueError(f"corner must be one of {', '.join(CORNERS)}; got {corner!r}.")
    lines = [lines] if isinstance(lines, str) else list(lines)
    if not lines:
        return
    height, width = image.shape[:2]
    size, box_width, box_height = _fitting_size(lines, size_px or round(height / 24), width, height)
    left = 0 if "left" in corner else width - box_width
    top = 0 if "top" in corner else height - box_height
    _shade(image, left, top, left + box_width, top + box_height, panel_alpha)
    for number, line in enumerate(lines):
        _letters(
            image, line, left + _margin(size), top + _margin(size) // 2 + number * _line_height(size), size, colour
        )


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
    _shade(drawn, 0, 0, width, strip_height, 0.75)
    room = (width * (0.7 if lines else 1.0) - margin) / len(titles) - margin
    cell = (int(room), strip_height - 2 * margin - _line_height(title_size))
    left = margin
    for thumbnail, title in zip(thumbnails, titles, strict=True):
        small = _shrink(to_rgb(thumbnail), cell)
        top = margin + _line_height(title_size)
        drawn[top : top + small.shape[0], left : left + small.shape[1]] = small
        size, *_ = _fitting_size([title], title_size, small.shape[1] + margin, strip_height)
        _letters(drawn, title, left, margin, size, TEXT)
        left += small.shape[1] + margin
    if lines:
        rest = np.ascontiguousarray(drawn[:strip_height, left:])
        drawn[:strip_height, left:] = write_text(rest, lines, size_px=round(height / 24), panel_alpha=0)
    return drawn


def stroke_line(image: np.ndarray, points_px: np.ndarray, colour: Colour, width_px: float) -> None:
    """Draw a polyline through points (N, 2) on `image` in place."""
    if len(points_px) >= 2:
        cv2.polylines(image, [_fixed_point(points_px)], False, colour, _thickness(width_px), cv2.LINE_AA, _SHIFT)


def tint_area(
    image: np.ndarray, polygon_px: np.ndarray, colour: Colour, alpha: float, *, edge: int = cv2.LINE_AA
) -> None:
    """Mix `colour` into `image` in place, by `alpha` inside a polygon (N, 2); only its bounding box is worked on.

    Where lines will cover the edges, `edge=cv2.LINE_8` fills in a quarter of the time.
    """
    height, width = image.shape[:2]
    (left, top), (right, bottom) = polygon_px.min(axis=0).tolist(), polygon_px.max(axis=0).tolist()
    left, top = (int(min(max(low - 1, 0), size)) for low, size in ((left, width), (top, height)))
    right, bottom = (int(min(max(high + 2, 0), size)) for high, size in ((right, width), (bottom, height)))
    part = image[top:bottom, left:right]
    if part.size:
        tinted = part.copy()
        cv2.fillPoly(tinted, [_fixed_point(polygon_px - (left, top))], colour, edge, _SHIFT)
        cv2.addWeighted(tinted, alpha, part, 1 - alpha, 0, dst=part)


def draw_windows(view: np.ndarray, windows_px: np.ndarray, *, colour: Colour = WINDOW) -> np.ndarray:
    """Draw search windows on a picture or mask.

    `windows_px` has shape (N, 4): left, top, right, bottom edge of each window in pixels. Returns RGB.
    """
    drawn = to_rgb(view)
    width = _thickness(drawn.shape[1] / 320)
    for left, top, right, bottom in np.asarray(windows_px, float).reshape(-1, 4):
        outline = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        cv2.polylines(drawn, [_fixed_point(outline)], True, colour, width, cv2.LINE_AA, _SHIFT)
    return drawn


def draw_pixels(view: np.ndarray, pixels_px: np.ndarray, *, colour: Colour) -> np.ndarray:
    """Colour single pixels of a picture or mask, (N, 2) whole columns and rows; those outside are left out."""
    drawn = to_rgb(view)
    columns, rows = np.asarray(pixels_px).reshape(-1, 2).astype(int).T
    inside = (columns >= 0) & (columns < drawn.shape[1]) & (rows >= 0) & (rows < drawn.shape[0])
    drawn[rows[inside], columns[inside]] = colour
    return drawn


def draw_fit(
    view: np.ndarray, left_px: np.ndarray | None, right_px: np.ndarray | None, *, band_px: float = 0.0
) -> np.ndarray:
    """Draw two fitted curves on a picture or mask, with the band of +- `band_px` columns that was searched.

    Returns RGB; a curve that is None is left out.
    """
    drawn = to_rgb(view)
    for points, colour in ((left_px, LEFT), (right_px, RIGHT)):
        if points is None:
            continue
        points = _finite(points)
        if band_px > 0:
            drawn = fill_lane(drawn, points - [band_px, 0], points + [band_px, 0], colour=WINDOW, alpha=0.3)
        drawn = draw_line(drawn, points, colour=colour, width_px=drawn.shape[1] / 200)
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


def _fixed_point(points_px: np.ndarray) -> np.ndarray:
    return np.round(points_px.clip(-_FARTHEST_PX, _FARTHEST_PX) * (1 << _SHIFT)).astype(np.int32)


def _thickness(width_px: float) -> int:
    """What to ask of OpenCV for a line that is `width_px` wide, to about a pixel.

    Measured on 5.0 with smooth edges: 1 gives 1.3 px, an even number n gives n + 1.4 px, an odd one as much as n + 1.
    """
    return max(1, 2 * round((width_px - 1.4) / 2))


def _on_raw_picture(points_px: np.ndarray | None, camera: Camera | None) -> np.ndarray:
    """Where the points of the undistorted picture lie on the raw one; none for None."""
    if points_px is None:
        return np.empty((0, 2))
    points = _finite(points_px)
    if camera is None or len(points) < 2:
        return points
    along = np.concatenate([[0], np.hypot(*np.diff(points, axis=0).T).cumsum()])
    # Evenly spaced places besides the given ones, so that no corner of the polyline is cut.
    places = np.union1d(along, np.arange(0, along[-1], _STEP_PX))
    return camera.distort_points(np.column_stack([np.interp(places, along, column) for column in points.T]))


def _shade(image: np.ndarray, left: int, top: int, right: int, bottom: int, alpha: float) -> None:
    """Darken a rectangle of `image` in place."""
    part = image[top:bottom, left:right]
    # one level for the three channels: to mix the panel's slight blue in takes twice as long, and nobody sees it
    cv2.convertScaleAbs(part, dst=part, alpha=1 - alpha, beta=alpha * sum(PANEL) / 3)


def _shrink(picture: np.ndarray, cell: tuple[int, int]) -> np.ndarray:
    """Resize to fit into `cell` (width, height), keeping the shape."""
    scale = min(cell[0] / picture.shape[1], cell[1] / picture.shape[0])
    size = max(1, int(picture.shape[1] * scale)), max(1, int(picture.shape[0] * scale))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


@cache
def _font() -> cv2.FontFace:
    # The outline font that comes with OpenCV: unlike its stroke fonts it has letters and signs beyond ASCII.
    return cv2.FontFace("sans")


def _line_height(size: int) -> int:
    return size + max(2, size // 3)


def _margin(size: int) -> int:
    """Space beside the letters; half of it goes above and below, where letters are seldom as tall as their line."""
    return max(2, round(size * 0.6))


def _fitting_size(lines: Sequence[str], size: int, width: int, height: int) -> tuple[int, int, int]:
    """Largest letter size up to `size` at which `lines` and their margins fit; with the width and height they take."""
    for smaller in range(max(size, 1), 0, -1):
        longest = max(_text_width(line, smaller) for line in lines)
        box_width = longest + 2 * _margin(smaller)
        box_height = len(lines) * _line_height(smaller) + _margin(smaller)
        if box_width <= width and box_height <= height:
            break
    return smaller, min(box_width, width), min(box_height, height)


@lru_cache(maxsize=64)
def _text_width(line: str, size: int) -> int:
    """Pixels; kept, because it takes as long as writing the line, and most lines stay the same for a few frames."""
    return cv2.getTextSize((0, 0), line, (0, 0), _font(), size, 500)[2]


def _letters(image: np.ndarray, line: str, left: int, top: int, size: int, colour: Colour) -> None:
    """Write one line in place; (left, top) is the upper left corner of its letters."""
    # Wrapping is moved out of reach: OpenCV would otherwise continue at the left edge, over the line before.
    cv2.putText(image, line, (left, top + size), colour, _font(), size, 500, cv2.PUT_TEXT_ALIGN_LEFT, (0, 1 << 20))
