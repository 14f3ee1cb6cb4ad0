"""Line search in one binary of one frame; warping and window search are lazy and run at most once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np

from lanes.classic.fit import LineFit, fit_line, mean_distance_px, ransac_line
from lanes.classic.memory import LineMemory
from lanes.classic.recipe import Recipe
from lanes.classic.result import FoundLine
from lanes.classic.search import WindowSearch, band_pixels, binary_pixels, sliding_windows
from lanes.classic.warp import FourPointWarp


@dataclass(frozen=True, eq=False)
class Channel:
    """One binary of a frame with the line search of a recipe.

    `mask` (height, width), uint8, is of the bird's-eye view if the recipe warps first, else of the undistorted picture.
    """

    name: str
    mask: np.ndarray
    recipe: Recipe
    warp: FourPointWarp

    @cached_property
    def binary(self) -> np.ndarray:
        """The binary in the bird's-eye view."""
        return self.mask if self.recipe.warp_first else self.warp.warp(self.mask)

    @cached_property
    def pixels(self) -> np.ndarray:
        """Set pixels (N, 2) of the bird's-eye view."""
        return binary_pixels(self.binary)

    @cached_property
    def search(self) -> WindowSearch:
        """Sliding-window search of both lines."""
        r = self.recipe
        return sliding_windows(
            self.binary,
            count=r.windows,
            margin_px=r.margin_px,
            recentre_pixels=r.recentre_pixels,
            flood_pixels=r.flood_pixels,
            first_row=r.histogram_rows_px[0],
            last_row=r.histogram_rows_px[1],
        )

    def line_from_windows(self, side: int) -> FoundLine:
        """Left (0) or right (1) line: fit the pixels in the windows, then those in a band around that fit."""
        search = self.search
        pixels = (search.left_pixels, search.right_pixels)[side]
        windows = (search.left_windows, search.right_windows)[side]
        first = self._fit(pixels)
        if first is None:
            return FoundLine(None, pixels, self.name, windows)
        return replace(self.line_near(first, self.recipe.still_band_px), windows=windows)

    def line_near(self, known: LineFit, margin_px: float) -> FoundLine:
        """Fit the pixels within `margin_px` of a known line, along the row."""
        pixels = band_pixels(self.pixels, known, margin_px)
        return FoundLine(self._fit(pixels), pixels, self.name)

    def _fit(self, pixels: np.ndarray) -> LineFit | None:
        r = self.recipe
        if r.ransac_px is None:
            return fit_line(pixels, min_span_px=r.min_span_px)
        fit = ransac_line(
            pixels,
            trials=r.ransac_trials,
            samples=r.ransac_samples,
            residual_px=r.ransac_px,
            min_span_px=r.min_span_px,
        )
        return fit if fit and fit.pixels >= r.min_inlier_ratio * len(pixels) else None


def nearest_line(channels: Sequence[Channel], memory: LineMemory, side: int) -> FoundLine:
    """The line of the channel whose fit is closest to the average in `memory`."""
    prior, average = memory.search_prior, memory.average
    lines = [c.line_near(prior, c.recipe.margin_px) if prior else c.line_from_windows(side) for c in channels]
    height = channels[0].recipe.size[1]
    return min(lines, key=lambda line: mean_distance_px(line.fit, average, height) if line.fit else inf)
