"""Road markings and their coverage of each pixel.

Lines along the road, arrows, diamonds and words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from simulator.painting import blend_pixels, sample
from simulator.road.ground import Ground, dash_coverage, strip_coverage

# Linear reflectance relative to fresh white paint.
WHITE = (1.0, 0.99, 0.95)
YELLOW = (1.05, 0.60, 0.06)
# Broken line of ten feet of paint and thirty feet of gap (MUTCD 3A.06).
DASH_PAINT_M = 3.05
DASH_GAP_M = 9.15
# Dot spacing of three feet (Caltrans standard plan A20A). A dot is 10 cm wide and 2 cm
# high, so it looks longer.
BOTTS_IN_A_DASH = 4
BOTTS_EVERY_M = 0.914
BOTTS_LENGTH_M = 0.16
# Raised markers are 0.10 m square and 2 cm high, so each looks about twice as long from
# the car. Next to a solid line they are 14.6 m apart, 0.12 m beside its edge.
MARKER_WIDTH_M = 0.10
MARKER_LENGTH_M = 0.20
MARKERS_EVERY_M = 14.63
MARKER_ASIDE_M = 0.12
ENDLESS_M = 1e5
# Resolution of the stencils: 1.6 cm across the road, 3.1 cm along it; pixels of border.
ACROSS_PX_PER_M = 64
ALONG_PX_PER_M = 32
BORDER_PX = 4
# Outlines as shares of width (0 left, 1 right) and length (0 near, 1 far), after MUTCD
# figures 3B-21 and 3B-24.
OUTLINES = {
    "arrow": [
        [0.38, 0],
        [0.62, 0],
        [0.62, 0.58],
        [1, 0.58],
        [0.5, 1],
        [0, 0.58],
        [0.38, 0.58],
    ],
    "left arrow": [
        [0.68, 0],
        [0.9, 0],
        [0.9, 0.55],
        [0.78, 0.72],
        [0.45, 0.72],
        [0.45, 1],
        [0, 0.62],
        [0.45, 0.26],
        [0.45, 0.52],
        [0.62, 0.52],
        [0.68, 0.45],
    ],
    "diamond": [
        [0.5, 0],
        [1, 0.5],
        [0.5, 1],
        [0, 0.5],
    ],
}
DIAMOND_STROKE = 0.24


@dataclass(frozen=True)
class Marking:
    """One longitudinal marking.

    Its centre is `lateral_m` left of the reference line, `width_m` the width of one
    stripe, `colour` linear RGB, 1.0 = sunlit white paint. A broken line has the lengths
    `dash_m` of paint and gap; a dash begins at `phase_m`. With `double_gap_m` > 0 it is
    a double line with this gap between the inner edges of its stripes. `wear` is 0 for
    fresh paint, 1 for mostly worn off. The paint reaches from `start_m` to `end_m`.

    With `dots` there are raised reflectors: in the middle of each gap, or every 14.6 m
    next to a solid line. With `botts` each dash is replaced by four round ceramic dots
    0.91 m apart, as in California. `slope` is dd/ds of a line that crosses the road at
    an angle; it starts at `lateral_m`.
    """

    lateral_m: float
    width_m: float = 0.12
    colour: tuple[float, float, float] = WHITE
    dashed: bool = False
    phase_m: float = 0.0
    double_gap_m: float = 0.0
    wear: float = 0.15
    dots: bool = False
    dash_m: tuple[float, float] = (DASH_PAINT_M, DASH_GAP_M)
    start_m: float = -ENDLESS_M
    end_m: float = ENDLESS_M
    slope: float = 0.0
    botts: bool = False

    @property
    def stripes(self) -> list[tuple[float, float]]:
        """Lateral edges (low, high) of the stripes, metres."""
        if not self.double_gap_m:
            half = self.width_m / 2
            return [(self.lateral_m - half, self.lateral_m + half)]
        left = self.lateral_m + self.double_gap_m / 2
        right = self.lateral_m - self.double_gap_m / 2
        return [(left, left + self.width_m), (right - self.width_m, right)]

    def coverage(self, ground: Ground) -> tuple[np.ndarray, np.ndarray]:
        """Share of each pixel that is covered by fresh paint.

        The lateral edges are integrated exactly over the pixel, the ends of dashes over
        its length along the road. Returns the pixels with paint (K,), as indices into
        the raveled ground arrays, and the share (K,) of each.
        """
        start = np.float32(self.start_m - ground.station_m)
        end = np.float32(self.end_m - ground.station_m)
        slope = np.float32(self.slope)
        if slope:
            ground = replace(ground, d=ground.d - slope * (ground.s - start))

        stripes = self.stripes
        pixels = ground.pixels_between(stripes[-1][0], stripes[0][1])
        part = ground.at(pixels)
        d_u = part.d_u - slope * part.s_u
        d_v = part.d_v - slope * part.s_v
        share = strip_coverage(part.d, d_u, d_v, *stripes[0])
        for edges in stripes[1:]:
            share = share + strip_coverage(part.d, d_u, d_v, *edges)

        if self.dashed:
            share = share * self._dash_share(part)
        if (self.start_m, self.end_m) != (-ENDLESS_M, ENDLESS_M):
            share = share * _between(part.s, part.footprint_s, start, end)
        return pixels, share

    def _dash_share(self, part: Ground) -> np.ndarray:
        """Share of the length of each footprint (K,) that is on a dash or a dot."""
        period = sum(self.dash_m)
        s = part.s + np.float32((part.station_m - self.phase_m) % period)
        footprint = part.footprint_s
        if not self.botts:
            return dash_coverage(s, footprint, self.dash_m[0], period)
        share = np.zeros_like(s)
        for dot in range(BOTTS_IN_A_DASH):
            s_dot = s - BOTTS_EVERY_M * np.float32(dot)
            share += dash_coverage(s_dot, footprint, BOTTS_LENGTH_M, period)
        return share


def _between(
    s: np.ndarray,
    footprint: np.ndarray,
    start: np.float32,
    end: np.float32,
) -> np.ndarray:
    """Share of [s - footprint/2, s + footprint/2] between `start` and `end`."""
    low = np.maximum(s - footprint / 2, start)
    high = np.minimum(s + footprint / 2, end)
    return np.clip((high - low) / np.maximum(footprint, 1e-4), 0, 1)


@dataclass(frozen=True)
class Symbol:
    """Symbol painted on the road.

    `kind` is "arrow", "left arrow", "diamond", or a word to be written. `s_m` is the
    arc length of its near end, `lateral_m` the lateral position of its centre.
    """

    s_m: float
    lateral_m: float
    kind: str
    length_m: float
    width_m: float
    wear: float = 0.2
    colour: tuple[float, float, float] = WHITE

    def coverage(self, ground: Ground) -> tuple[np.ndarray, np.ndarray]:
        """Pixels and shares of the symbol; see `Marking.coverage`."""
        near = np.float32(self.s_m - ground.station_m)
        far = near + np.float32(self.length_m)
        left = np.float32(self.lateral_m + self.width_m / 2)

        # Pixels whose footprints can overlap the symbol.
        margin = ground.footprint_s
        inside = (ground.s > near - margin) & (ground.s < far + margin)
        aside = np.abs(ground.d - np.float32(self.lateral_m))
        inside &= aside < np.float32(self.width_m / 2 + 0.1)
        pixels = np.flatnonzero(inside & ground.visible)
        part = ground.at(pixels)
        if not len(pixels):
            return pixels, part.s

        # Footprints are much longer than wide, so only the rows are averaged.
        levels = _stencil(self.kind, self.length_m, self.width_m)
        footprint_px = np.median(part.footprint_s) * ALONG_PX_PER_M
        halvings = np.rint(np.log2(max(footprint_px, 1.0)))
        level = int(np.clip(halvings, 0, len(levels) - 1))
        row = ((far - part.s) * ALONG_PX_PER_M + 0.5) / 2**level - 0.5
        column = (left - part.d) * ACROSS_PX_PER_M
        return pixels, sample(levels[level], column + BORDER_PX, row + BORDER_PX)


def paint_markings(
    albedo: np.ndarray,
    markings: Sequence[Marking | Symbol],
    ground: Ground,
    *,
    seed: int,
) -> None:
    """Paint the markings onto the road's reflectance (rows, width, 3), in place."""
    for number, marking in enumerate(markings):
        pixels, coverage = marking.coverage(ground)
        if not len(pixels):
            continue
        if marking.wear:
            coverage = coverage * worn(marking.wear, ground.at(pixels), seed + number)
        colour = np.array(marking.colour, np.float32)
        blend_pixels(albedo, pixels, coverage, colour)
        if isinstance(marking, Marking) and marking.dots:
            pixels, coverage = _raised_markers(marking).coverage(ground)
            blend_pixels(albedo, pixels, coverage, colour)


def worn(
    wear: float,
    ground: Ground,
    seed: int,
) -> np.ndarray:
    """Share of paint left on the ground after wear by chips and tyres.

    `wear` is that of Marking.
    """
    chips = ground.noise(seed, (0.10, 0.05), fading_m=0.10)
    broad = ground.noise(seed, (2.5, 0.6), fading_m=2.5, shift_m=3)
    damage = (chips * 0.8 + broad * 0.7 - 1.6) * 0.9 + 1.5 * wear
    lost = np.clip(damage, 0, 1) * min(1.0, 3 * wear)
    return (1 - 0.12 * wear) * (1 - 0.85 * lost)


def _raised_markers(marking: Marking) -> Marking:
    """Raised markers of a line: in the middle of its gaps, or beside a solid line."""
    lateral_m = marking.lateral_m
    phase_m = marking.phase_m
    if marking.dashed:
        paint, gap = marking.dash_m
        period = paint + gap
        phase_m += paint + gap / 2
    else:
        period = MARKERS_EVERY_M
        aside = marking.width_m / 2 + MARKER_ASIDE_M
        lateral_m -= float(np.copysign(aside, lateral_m))
    return Marking(
        lateral_m,
        MARKER_WIDTH_M,
        marking.colour,
        dashed=True,
        phase_m=phase_m,
        dash_m=(MARKER_LENGTH_M, period - MARKER_LENGTH_M),
    )


@lru_cache(maxsize=32)
def _stencil(
    kind: str,
    length_m: float,
    width_m: float,
) -> list[np.ndarray]:
    """Pyramid of the stencil, float32 0..1, with a border; the far end comes first.

    Each level has half the rows of the one before.
    """
    fine = 4
    rows = round(length_m * ALONG_PX_PER_M)
    columns = round(width_m * ACROSS_PX_PER_M)
    draw = _outline if kind in OUTLINES else _word
    picture = draw(kind, rows * fine, columns * fine)
    picture = cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA)

    levels: list[np.ndarray] = [picture.astype(np.float32) / 255]
    while rows > 8:
        rows //= 2
        half = cv2.resize(levels[-1], (columns, rows), interpolation=cv2.INTER_AREA)
        levels.append(half)
    return [np.pad(level, BORDER_PX) for level in levels]


def _outline(
    kind: str,
    rows: int,
    columns: int,
) -> np.ndarray:
    """Stencil (rows, columns) of one of OUTLINES, filled with 255."""
    picture = np.zeros((rows, columns), np.uint8)
    shape = np.array(OUTLINES[kind])
    outlines = [(shape, 255)]
    if kind == "diamond":
        inner = 0.5 + (shape - 0.5) * (1 - 2 * DIAMOND_STROKE)
        outlines.append((inner, 0))
    for outline, value in outlines:
        corners = np.rint([0, rows] + outline * [columns, -rows]).astype(np.int32)
        cv2.fillPoly(picture, [corners], value)
    return picture


def _word(
    text: str,
    rows: int,
    columns: int,
) -> np.ndarray:
    """Stencil filled with a word in block letters."""
    font = cv2.FONT_HERSHEY_SIMPLEX
    scale = 8.0
    stroke = 40
    (wide, tall), _ = cv2.getTextSize(text, font, scale, stroke)
    picture = np.zeros((tall + 2 * stroke, wide + 2 * stroke), np.uint8)
    cv2.putText(picture, text, (stroke, tall + stroke), font, scale, 255, stroke)

    inked = np.argwhere(picture)
    top, left = inked.min(axis=0)
    bottom, right = inked.max(axis=0) + 1
    letters = picture[top:bottom, left:right]
    return cv2.resize(letters, (columns, rows), interpolation=cv2.INTER_AREA)
