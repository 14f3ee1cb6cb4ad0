"""Drawing in place, on pictures in RGB and on those of videos (`YuvFrame`) alike: lines, areas, text.

`lanes.drawing.pictures` makes of this what most need: functions that take a picture and return another. Points are
(column u, row v) in pixels, floats, shape (N, 2), pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np

from lanes.io.frames import Frame, YuvColourSpace, YuvFrame, rgb_to_yuv

Colour = tuple[int, int, int]

# One colour (RGB) for each kind of thing, in pictures and in plots alike.
LANE_COLOUR: Colour = (0, 220, 90)
LEFT_COLOUR: Colour = (255, 70, 60)
RIGHT_COLOUR: Colour = (60, 130, 255)
WINDOW_COLOUR: Colour = (255, 210, 0)
TEXT_COLOUR: Colour = (255, 255, 255)
PANEL_COLOUR: Colour = (16, 18, 22)

CORNERS = ("top left", "top right", "bottom left", "bottom right")

# Fractional bits of the integers that OpenCV's drawing takes: 4 bits are 1/16 px, finer than anti-aliasing shows.
SHIFT = 4
# Points further out are pulled to here, well inside 32-bit integers and far outside any picture.
FARTHEST_PX = 1e6


@dataclass(frozen=True, eq=False)
class Layer:
    """An array to draw on: a whole picture in RGB, or one plane of another, whose elements are `step` pixels wide."""

    pixels: np.ndarray
    step: int = 1
    channel: int | None = None
    colour_space: YuvColourSpace | None = None

    def box(self, left: int, top: int, right: int, bottom: int) -> np.ndarray:
        """View of a rectangle given in pixels of the picture."""
        step = self.step
        return self.pixels[top // step : -(-bottom // step), left // step : -(-right // step)]

    def value(self, colour: Colour) -> tuple[float, ...]:
        """What stands for an RGB colour here."""
        return colour if self.colour_space is None else (rgb_to_yuv(colour, self.colour_space)[self.channel],)

    def place(self, corners: np.ndarray) -> tuple[np.ndarray, int]:
        """Where to draw for integers of 1/16 px of the picture: integers, and how many of their bits are fraction.

        They count half as much on elements of two pixels, of which the first is centred half a pixel after the first
        pixel.
        """
        return (corners, SHIFT) if self.step == 1 else (corners - (1 << SHIFT - 1), SHIFT + 1)


def layers_of(picture: Frame) -> tuple[Layer, ...]:
    """The arrays to draw on; brightness, or all of an RGB picture, is the first."""
    if isinstance(picture, YuvFrame):
        return tuple(Layer(plane, 1 + (k > 0), k, picture.colour_space) for k, plane in enumerate(picture.planes))
    return (Layer(picture),)


def draw_polyline(picture: Frame, points_px: np.ndarray, colour: Colour, width_px: float) -> None:
    """Draw a polyline through points (N, 2)."""
    if len(points_px) < 2:
        return
    corners = to_fixed_point(points_px)
    for layer in layers_of(picture):
        places, shift = layer.place(corners)
        thickness = line_thickness(width_px / layer.step)
        # smooth edges take four times as long, and nobody sees them in planes of colour, which are coarse
        edge = cv2.LINE_AA if layer.step == 1 else cv2.LINE_8
        cv2.polylines(layer.pixels, [places], False, layer.value(colour), thickness, edge, shift)


def blend_polygon(
    picture: Frame,
    polygon_px: np.ndarray,
    colour: Colour,
    alpha: float,
    *,
    edge: int = cv2.LINE_AA,
) -> None:
    """Mix `colour` in by `alpha` inside a polygon (N, 2); only its bounding box is worked on.

    Where lines will cover the edges, `edge=cv2.LINE_8` fills in a quarter of the time.
    """
    height, width = picture.shape[:2]
    (left, top), (right, bottom) = polygon_px.min(axis=0).tolist(), polygon_px.max(axis=0).tolist()
    # even, so that a plane of half the size has a corner there, too
    left, top = (int(min(max(low - 1, 0), size)) // 2 * 2 for low, size in ((left, width), (top, height)))
    right, bottom = (int(min(max(high + 2, 0), size)) for high, size in ((right, width), (bottom, height)))
    corners = to_fixed_point(polygon_px - (left, top))
    for layer in layers_of(picture):
        part = layer.box(left, top, right, bottom)
        if part.size:
            tinted, (places, shift) = part.copy(), layer.place(corners)
            cv2.fillPoly(tinted, [places], layer.value(colour), edge, shift)
            cv2.addWeighted(tinted, alpha, part, 1 - alpha, 0, dst=part)


def put_text(
    picture: Frame,
    lines: str | Sequence[str],
    *,
    corner: str = "top left",
    size_px: int | None = None,
    colour: Colour = TEXT_COLOUR,
    panel_alpha: float = 0.6,
) -> None:
    """Write lines of text in place; see `lanes.drawing.pictures.write_text`."""
    if corner not in CORNERS:
        raise ValueError(f"corner must be one of {', '.join(CORNERS)}; got {corner!r}.")
    lines = [lines] if isinstance(lines, str) else list(lines)
    if not lines:
        return
    height, width = picture.shape[:2]
    size, box_width, box_height = fit_text(lines, size_px or round(height / 24), width, height)
    left = 0 if "left" in corner else width - box_width
    top = 0 if "top" in corner else height - box_height
    box = left, top, left + box_width, top + box_height
    finest, *coarse = layers_of(picture)
    shade(finest, box, panel_alpha)
    for plane in coarse:
        # letters are too fine for it: all of the panel takes their hue, which is none where they are white
        plane.box(*box)[:] = plane.value(colour)
    left, top = left + _margin(size), top + _margin(size) // 2
    for number, line in enumerate(lines):
        draw_text_line(finest, line, left, top + number * line_height(size), size, colour)


def shade(layer: Layer, box: tuple[int, int, int, int], alpha: float) -> None:
    """Darken a rectangle (left, top, right, bottom)."""
    part, panel = layer.box(*box), layer.value(PANEL_COLOUR)
    # one level for the three channels: to mix the panel's slight blue in takes twice as long, and nobody sees it
    cv2.convertScaleAbs(part, dst=part, alpha=1 - alpha, beta=alpha * sum(panel) / len(panel))


def to_fixed_point(points_px: np.ndarray) -> np.ndarray:
    """Integers (N, 2) of 1/16 px, as OpenCV's drawing takes them."""
    return np.round(points_px.clip(-FARTHEST_PX, FARTHEST_PX) * (1 << SHIFT)).astype(np.int32)


def line_thickness(width_px: float) -> int:
    """What to ask of OpenCV for a line that is `width_px` wide, to about a pixel.

    Measured on 5.0 with smooth edges: 1 gives 1.3 px, an even number n gives n + 1.4 px, an odd one as much as n + 1.
    """
    return max(1, 2 * round((width_px - 1.4) / 2))


@cache
def _font() -> cv2.FontFace:
    # The outline font that comes with OpenCV: unlike its stroke fonts it has letters and signs beyond ASCII.
    return cv2.FontFace("sans")


def line_height(size: int) -> int:
    """Pixels from one line of text to the next."""
    return size + max(2, size // 3)


def _margin(size: int) -> int:
    """Space beside the letters; half of it goes above and below, where letters are seldom as tall as their line."""
    return max(2, round(size * 0.6))


def fit_text(lines: Sequence[str], size: int, width: int, height: int) -> tuple[int, int, int]:
    """Largest letter size up to `size` at which `lines` and their margins fit; with the width and height they take."""
    for smaller in range(max(size, 1), 0, -1):
        longest = max(_text_width(line, smaller) for line in lines)
        box_width = longest + 2 * _margin(smaller)
        box_height = len(lines) * line_height(smaller) + _margin(smaller)
        if box_width <= width and box_height <= height:
            break
    return smaller, min(box_width, width), min(box_height, height)


@lru_cache(maxsize=64)
def _text_width(line: str, size: int) -> int:
    """Pixels; kept, because it takes as long as writing the line, and most lines stay the same for a few frames."""
    return cv2.getTextSize((0, 0), line, (0, 0), _font(), size, 500)[2]


def draw_text_line(layer: Layer, line: str, left: int, top: int, size: int, colour: Colour) -> None:
    """Write one line; (left, top) is the upper left corner of its letters."""
    # Wrapping is moved out of reach: OpenCV would otherwise continue at the left edge, over the line before.
    place, beyond = (left, top + size), (0, 1 << 20)
    cv2.putText(layer.pixels, line, place, layer.value(colour), _font(), size, 500, cv2.PUT_TEXT_ALIGN_LEFT, beyond)
