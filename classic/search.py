"""Pixels of the two lane lines in a warped binary: histogram, sliding windows, band around the previous line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

from classic.fit import LineFit


class Window(NamedTuple):
    """One search window, columns and rows in pixels, both ends included."""

    left: float
    top: int
    right: float
    bottom: int


@dataclass(frozen=True, eq=False)
class WindowSearch:
    """Result of a search: pixels (N, 2) as (column, row) of each line, and the search windows."""

    left_pixels: np.ndarray
    right_pixels: np.ndarray
    left_windows: tuple[Window, ...] = ()
    right_windows: tuple[Window, ...] = ()

    @property
    def windows_px(self) -> np.ndarray:
        """(N, 4) left, top, right, bottom edge of each window, for drawing."""
        return np.array(self.left_windows + self.right_windows, float).reshape(-1, 4)


def lane_histogram(binary: np.ndarray, rows_px: tuple[int, int] | None = None) -> np.ndarray:
    """Number of set pixels (width,) in each column of a binary (height, width), in `rows_px` (first, end).

    The default is the lower half, where lines are nearly vertical.
    """
    first, end = rows_px or (binary.shape[0] // 2, binary.shape[0])
    return np.count_nonzero(binary[first:end], axis=0)


def find_peaks(histogram: np.ndarray) -> tuple[int | None, int | None]:
    """Columns of the highest peak left and right of the centre; None if a half is empty.

    Of equally high columns the one closest to the centre is used, so that a mirrored image has mirrored peaks.
    """
    middle = len(histogram) // 2
    left, right = histogram[:middle][::-1], histogram[middle:]
    return (
        middle - 1 - int(left.argmax()) if left.any() else None,
        middle + int(right.argmax()) if right.any() else None,
    )


def binary_pixels(binary: np.ndarray) -> np.ndarray:
    """(column, row) of every set pixel, (N, 2) int32, sorted by row."""
    found = cv2.findNonZero(binary)
    return np.empty((0, 2), np.int32) if found is None else found.reshape(-1, 2)


def sliding_windows(
    binary: np.ndarray,
    *,
    count: int = 9,
    margin_px: float = 80,
    recentre_pixels: int = 50,
    flood_pixels: int | None = None,
    histogram_rows_px: tuple[int, int] | None = None,
) -> WindowSearch:
    """Pixels of each line from a stack of windows that starts at the histogram peak and goes up.

    Parameters
    ----------
    binary : ndarray of shape (height, width), uint8
        Warped binary.
    count : int
        Number of windows, which together cover the full height.
    margin_px : float
        Half the width of a window.
    recentre_pixels : int
        A window with at least this many pixels moves the next one to their mean column.
    flood_pixels : int, optional
        A window with at least this many pixels is dropped, because the threshold is flooded there.
    histogram_rows_px : tuple of int, optional
        First and end row of the histogram, see `lane_histogram`.

    Returns
    -------
    WindowSearch
        A line without a peak has no windows and no pixels.
    """
    peaks = find_peaks(lane_histogram(binary, histogram_rows_px))
    pixels = binary_pixels(binary)
    edges = np.linspace(binary.shape[0], 0, count + 1).round().astype(int)
    # Pixels are sorted by row, so those in the rows of a window are one slice.
    bounds = np.searchsorted(pixels[:, 1], edges)
    strips = [
        (top, bottom - 1, pixels[start:end])
        for (bottom, top), (end, start) in zip(pairwise(edges.tolist()), pairwise(bounds), strict=True)
    ]
    (left, left_windows), (right, right_windows) = (
        _stack_windows(strips, column, margin_px, recentre_pixels, flood_pixels) for column in peaks
    )
    return WindowSearch(left, right, left_windows, right_windows)


def band_pixels(pixels: np.ndarray, line: LineFit, margin_px: float) -> np.ndarray:
    """The pixels, of (N, 2), within `margin_px` of a line along the row."""
    # One evaluation per row and a lookup for each pixel is ten times faster than one evaluation per pixel.
    if not len(pixels):
        return pixels
    columns = line.columns(np.arange(pixels[:, 1].max() + 1)).astype(np.float32)
    return pixels[np.abs(pixels[:, 0] - columns[pixels[:, 1]]) <= margin_px]


def search_band(binary: np.ndarray, left: LineFit | None, right: LineFit | None, *, margin_px: float) -> WindowSearch:
    """Pixels of a warped binary within `margin_px` columns of known lines, for example those of the previous frame.

    A line that is None has no pixels. The result has no windows.
    """
    pixels = binary_pixels(binary)
    left_pixels, right_pixels = (band_pixels(pixels, line, margin_px) if line else pixels[:0] for line in (left, right))
    return WindowSearch(left_pixels, right_pixels)


def _stack_windows(
    strips: Sequence[tuple[int, int, np.ndarray]],
    column: float | None,
    margin_px: float,
    recentre_pixels: int,
    flood_pixels: int | None,
) -> tuple[np.ndarray, tuple[Window, ...]]:
    """Pixels and windows of one line; strips are (top row, bottom row, pixels), from the bottom to the top."""
    found, windows = [np.empty((0, 2), np.int32)], []
    if column is None:
        return found[0], ()
    for top, bottom, pixels in strips:
        inside = pixels[np.abs(pixels[:, 0] - column) <= margin_px]
        windows.append(Window(column - margin_px, top, column + margin_px, bottom))
        if flood_pixels is not None and len(inside) >= flood_pixels:
            continue
        found.append(inside)
        if len(inside) >= max(recentre_pixels, 1):
            column = float(inside[:, 0].mean())
    return np.concatenate(found), tuple(windows)
