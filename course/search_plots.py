"""Figures of chapter 6: the histogram, and the search of the recipes.

The functions plot given values and return the figure and its axes; they do not show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from course.plots import show_pictures
from helpers import (
    LEFT_COLOUR,
    RANSAC_COLOUR,
    RIGHT_COLOUR,
    WINDOW_COLOUR,
    Recipe,
    WindowSearch,
    band_pixels,
    binary_pixels,
    draw_lines,
    draw_pixels,
    draw_windows,
    fit_line,
)
from lanes.show.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = (LEFT_COLOUR, RIGHT_COLOUR)


def plot_histogram(
    binary: np.ndarray,
    histogram: np.ndarray,
    peaks: Sequence[float],
    *,
    first_row: int,
) -> tuple[Figure, np.ndarray]:
    """Plot the rows of a binary from `first_row` on, and below them their histogram.

    The columns of the peaks are marked in both.
    """
    height, width = binary.shape
    figure, axes = new_figure(2, 1, (10, 6), sharex=True)
    mask_axis, count_axis = axes
    mask_axis.imshow(
        binary[first_row:],
        cmap="gray",
        aspect="auto",
        extent=(0, width, height, first_row),
    )
    mask_axis.set_title(f"Rows {first_row} to {height - 1} of the mask")
    mask_axis.set_ylabel("row")

    count_axis.fill_between(np.arange(width), histogram, color="orange")
    count_axis.set_title("Histogram; red: highest peak of each half")
    count_axis.set_xlabel("column")
    count_axis.set_ylabel("set pixels")
    for peak in peaks:
        mask_axis.axvline(peak, color="red")
        count_axis.axvline(peak, color="red")
    return figure, axes


def show_search(
    binaries: Mapping[str, np.ndarray], recipes: Mapping[str, Recipe]
) -> tuple[Figure, np.ndarray]:
    """Plot the search of each recipe: windows in the upper row, bands in the lower one.

    Parameters
    ----------
    binaries : mapping of str to ndarray of shape (height, width), uint8
        Bird's-eye view by the name of the recipe.
    """
    climbed = []
    banded = []
    for name, binary in binaries.items():
        recipe = recipes[name]
        search = recipe.search_windows(binary)
        climbed.append(draw_search(binary, search))
        banded.append(draw_bands(binary, search, recipe.still_band_px))
    titles = [f"{name}: windows" for name in binaries]
    titles += ["its band and curve"] * len(binaries)
    return show_pictures(climbed + banded, titles, columns=len(binaries), width_in=15)


def draw_search(binary: np.ndarray, search: WindowSearch) -> np.ndarray:
    """The windows and the pixels that they caught, left red and right blue; RGB."""
    drawn = binary // 3
    for pixels, colour in zip(search.pixels, COLOURS, strict=True):
        drawn = draw_pixels(drawn, pixels, colour=colour)
    for windows in search.windows:
        drawn = draw_windows(drawn, windows)
    return drawn


def draw_bands(
    binary: np.ndarray, search: WindowSearch, margin_px: float
) -> np.ndarray:
    """The curve of each line, the band around it, and the pixels in it; RGB."""
    drawn = binary // 3
    to_border = np.array([0, 0, margin_px])
    every_pixel = binary_pixels(binary)
    for pixels, colour in zip(search.pixels, COLOURS, strict=True):
        line = fit_line(pixels)
        if line is None:
            continue
        band = band_pixels(every_pixel, line, margin_px)
        drawn = draw_pixels(drawn, band, colour=colour)
        borders = [line - to_border, line + to_border]
        drawn = draw_lines(drawn, borders, colour=RANSAC_COLOUR, width_px=3)
        drawn = draw_lines(drawn, [line], colour=WINDOW_COLOUR)
    return drawn
