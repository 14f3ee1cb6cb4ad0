"""Road markings and their coverage of each pixel: lines along the road, arrows, diamonds and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

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
# Dot spacing of three feet (Caltrans standard plan A20A). A dot is 10 cm wide and 2 cm high, so it looks longer.
BOTTS_EVERY_M, BOTTS_LENGTH_M = 0.914, 0.16
ENDLESS_M = 1e5
# Resolution of the stencils: 1.6 cm across the road, 3.1 cm along it.
ACROSS_PX_PER_M, ALONG_PX_PER_M = 64, 32
# Outlines as shares of width (0 left, 1 right) and length (0 near, 1 far), after MUTCD figures 3B-21 and 3B-24.
OUTLINES = {
    "arrow": [[0.38, 0], [0.62, 0], [0.62, 0.58], [1, 0.58], [0.5, 1], [0, 0.58], [0.38, 0.58]],
    "left arrow": [
        [0.68, 0], [0.9, 0], [0.9, 0.55], [0.78, 0.72], [0.45, 0.72], [0.45, 1], [0, 0.62], [0.45, 0.26], [0.45, 0.52],
        [0.62, 0.52], [0.68, 0.45],
    ],
    "diamond": [[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5]],
}  # fmt: skip
DIAMOND_STROKE = 0.24


@dataclass(frozen=True)
class Marking:
    """One longitudinal marking.

    Its centre is `lateral_m` left of the reference line, `width_m` the width of one stripe, `colour` linear RGB, 1.0 =
    sunlit white paint. A broken line has the lengths `dash_m` of paint and gap; a dash begins at `phase_m`. With
    `double_gap_m` > 0 it is a double line with this gap between the inner edges of its stripes. `wear` is 0 for fresh
    paint, 1 for mostly worn off. The paint reaches from `start_m` to `end_m`.

    With `dots` there are raised reflectors: in the middle of each gap, or every 14.6 m next to a solid line. With
    `botts` each dash is replaced by four round ceramic dots 0.91 m apart, as in California. `slope` is dd/ds of a line
    that crosses the road at an angle; it starts at `lateral_m`.
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
            return [(self.lateral_m - self.width_m / 2, self.lateral_m + self.width_m / 2)]
        left, right = self.lateral_m + self.double_gap_m / 2, self.lateral_m - self.double_gap_m / 2
        return [(left, left + self.width_m), (right - self.width_m, right)]

    def coverage(self, ground: Ground) -> tuple[np.ndarray, np.ndarray]:
        """Share of each pixel that is covered by fresh paint.

        The lateral edges are integrated exactly over the pixel, the ends of dashes over its length along the road.
        Returns the pixels with paint (K,), as indices into the raveled ground arrays, and the share (K,) of each.
        """
        low, high = min(e[0] for e in self.stripes), max(e[1] for e in self.stripes)
        start, end = np.float32(self.start_m - ground.station_m), np.float32(self.end_m - ground.station_m)
        if slope := np.float32(self.slope):
            ground = replace(ground, d=ground.d - slope * (ground.s - start))
        pixels = ground.pixels_between(low, high)
        part = ground.at(pixels)
        s, footprint = part.s, part.footprint_s
        d_u, d_v = part.d_u - slope * part.s_u, part.d_v - slope * part.s_v
        share: Any = sum(strip_coverage(part.d, d_u, d_v, *edges) for edges in self.stripes)
        if self.dashed:
            period = sum(self.dash_m)
            s_dash = s + np.float32((ground.station_m - self.phase_m) % period)
            count, paint_m = (4, BOTTS_LENGTH_M) if self.botts else (1, self.dash_m[0])
            places = np.float32(BOTTS_EVERY_M) * np.arange(count, dtype=np.float32)
            share = share * sum(dash_coverage(s_dash - place, footprint, paint_m, period) for place in places)
        if (self.start_m, self.end_m) != (-ENDLESS_M, ENDLESS_M):
            share = share * _between(s, footprint, start, end)
        return pixels, share


def _between(s: np.ndarray, footprint: np.ndarray, start: np.float32, end: np.float32) -> np.ndarray:
    """Share of [s - footprint/2, s + footprint/2] between `start` and `end`."""
    inside = np.minimum(s + footprint / 2, end) - np.maximum(s - footprint / 2, start)
    return np.clip(inside / np.maximum(footprint, np.float32(1e-4)), 0, 1)


@dataclass(frozen=True)
class Symbol:
    """Symbol painted on the road: `kind` is "arrow", "left arrow", "diamond", or a word to be written.

    `s_m` is the arc length of its near end, `lateral_m` the lateral position of its centre.
    """

    s_m: float
    lateral_m: float
    kind: str
    length_m: float = 3.6
    width_m: float = 1.2
    wear: float = 0.2
    colour: tuple[float, float, float] = WHITE

    def coverage(self, ground: Ground) -> tuple[np.ndarray, np.ndarray]:
        """Pixels and shares of the symbol; see `Marking.coverage`."""
        near = np.float32(self.s_m - ground.station_m)
        far = near + np.float32(self.length_m)
        left = np.float32(self.lateral_m + self.width_m / 2)
        margin = ground.footprint_s
        inside = (ground.s > near - margin) & (ground.s < far + margin) & ground.visible
        inside &= np.abs(ground.d - np.float32(self.lateral_m)) < np.float32(self.width_m / 2 + 0.1)
        pixels = np.flatnonzero(inside)
        part = ground.at(pixels)
        if not len(pixels):
            return pixels, part.s
        levels = _stencil(self.kind, self.length_m, self.width_m)
        # Footprints are much longer than wide, so only the rows are averaged.
        footprint_px = np.median(part.footprint_s) * ALONG_PX_PER_M
        level = int(np.clip(np.rint(np.log2(max(footprint_px, 1.0))), 0, len(levels) - 1))
        row = ((far - part.s) * np.float32(ALONG_PX_PER_M) + np.float32(0.5)) / np.float32(2**level) - np.float32(0.5)
        column = (left - part.d) * np.float32(ACROSS_PX_PER_M)
        return pixels, sample(levels[level], column + 4, row + 4)


def paint_markings(albedo: np.ndarray, markings: Sequence[Marking | Symbol], ground: Ground, *, seed: int) -> None:
    """Paint the markings onto the road's reflectance (rows, width, 3) float32, in place."""
    for number, marking in enumerate(markings):
        pixels, coverage = marking.coverage(ground)
        if not len(pixels):
            continue
        if marking.wear:
            coverage = coverage * worn(marking.wear, ground.at(pixels), seed + number)
        colour = np.array(marking.colour, np.float32)
        blend_pixels(albedo, pixels, coverage, colour)
        if isinstance(marking, Marking) and marking.dots:
            blend_pixels(albedo, *_dots(marking).coverage(ground), colour)


def worn(wear: float, ground: Ground, seed: int) -> np.ndarray:
    """Share of paint left on the ground after wear by chips and tyres; `wear` as in Marking."""
    chips = ground.noise(seed, (0.10, 0.05), fading_m=0.10)
    broad = ground.noise(seed, (2.5, 0.6), fading_m=2.5, shift_m=3)
    lost = np.clip((chips * 0.8 + broad * 0.7 - 1.6) * 0.9 + 1.5 * wear, 0, 1) * min(1.0, 3 * wear)
    return (1 - 0.12 * wear) * (1 - np.float32(0.85) * lost)


def _dots(marking: Marking) -> Marking:
    """Raised markers, 0.10 m square: 12.2 m apart in the middle of the gaps, or 14.6 m apart next to a solid line."""
    paint, gap = marking.dash_m
    period, side = (paint + gap, 0.0) if marking.dashed else (14.63, marking.width_m / 2 + 0.12)
    first = marking.phase_m + (paint + gap / 2 if marking.dashed else 0.0)
    # Markers are 2 cm high, so each looks about twice as long from the car.
    dash_m, centre_m = (0.20, period - 0.20), marking.lateral_m - float(np.copysign(side, marking.lateral_m))
    return Marking(centre_m, 0.10, marking.colour, dashed=True, phase_m=first, dash_m=dash_m)


@lru_cache(maxsize=32)
def _stencil(kind: str, length_m: float, width_m: float) -> list[np.ndarray]:
    """Pyramid of the stencil, float32 0..1: far end in the first row, 4 px of border; each level has half the rows."""
    fine = 4
    rows, columns = round(length_m * ALONG_PX_PER_M) * fine, round(width_m * ACROSS_PX_PER_M) * fine
    picture = _outline(kind, rows, columns) if kind in OUTLINES else _word(kind, rows, columns)
    picture = cv2.resize(picture, (columns // fine, rows // fine), interpolation=cv2.INTER_AREA)
    levels: list[np.ndarray] = [picture.astype(np.float32) / 255]
    while levels[-1].shape[0] > 8:
        size = (levels[-1].shape[1], levels[-1].shape[0] // 2)
        levels.append(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA))
    return [np.pad(level, 4) for level in levels]


def _outline(kind: str, rows: int, columns: int) -> np.ndarray:
    picture = np.zeros((rows, columns), np.uint8)
    shape = np.array(OUTLINES[kind])
    cv2.fillPoly(picture, [np.rint([0, rows] + shape * [columns, -rows]).astype(np.int32)], 255)
    if kind == "diamond":
        inner = 0.5 + (shape - 0.5) * (1 - 2 * DIAMOND_STROKE)
        cv2.fillPoly(picture, [np.rint([0, rows] + inner * [columns, -rows]).astype(np.int32)], 0)
    return picture


def _word(text: str, rows: int, columns: int) -> np.ndarray:
    """Stencil filled with a word in block letters."""
    scale, stroke = 8.0, 40
    (wide, tall), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)
    picture = np.zeros((tall + 2 * stroke, wide + 2 * stroke), np.uint8)
    cv2.putText(picture, text, (stroke, tall + stroke), cv2.FONT_HERSHEY_SIMPLEX, scale, 255, stroke)
    inked = np.argwhere(picture)
    (top, left), (bottom, right) = inked.min(axis=0), inked.max(axis=0) + 1
    return cv2.resize(picture[top:bottom, left:right], (columns, rows), interpolation=cv2.INTER_AREA)
