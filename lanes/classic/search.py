"""Pixels of the two lane lines in a warped binary: histogram, sliding windows, band around the previous line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from lanes.classic.fit import LineFit


@dataclass(frozen=True)
class Window:
    """One search window, columns and rows in pixels, both ends included, and the number of pixels in it."""

    left: float
    top: int
    right: float
    bottom: int
    pixels: int


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
        return window_edges(self.left_windows + self.right_windows)


def window_edges(windows: Sequence[Window]) -> np.ndarray:
    """(N, 4) left, top, right, bottom edge of each window in pixels."""
    return np.array([(w.left, w.top, w.right, w.bottom) for w in windows], float).reshape(-1, 4)


def lane_histogram(binary: np.ndarray, *, first_row: int | None = None, last_row: int | None = None) -> np.ndarray:
    """Number of set pixels (width,) in each column of a binary (height, width), in rows first_row..last_row-1.

    The default is the lower half, where lines are nearly vertical.
    """
    height = binary.shape[0]
    rows = binary[height // 2 if first_row is None else first_row : height if last_row is None else last_row]
    return np.count_nonzero(rows, axis=0)


def find_peaks(histogram: np.ndarray) -> tuple[int | None, int | None]:
    """Columns of the highest peak left and right of the centre; None if a half is empty.

    Of equally high columns the one closest to the centre is used, so that a mirrored picture has mirrored peaks.
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
    first_row: int | None = None,
    last_row: int | None = None,
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
    first_row, last_row : int, optional
        Rows of the histogram, see `lane_histogram`.

    Returns
    -------
    WindowSearch
        A line without a peak has no windows and no pixels.
    """
    peaks = find_peaks(lane_histogram(binary, first_row=first_row, last_row=last_row))
    pixels = binary_pixels(binary)
    edges = np.linspace(binary.shape[0], 0, count + 1).round().astype(int)
    # Pixels are sorted by row, so those in the rows of a window are one slice.
    bounds = np.searchsorted(pixels[:, 1], edges)
    settings = (edges, bounds, margin_px, recentre_pixels, flood_pixels)
    (left, left_windows), (right, right_windows) = (_stack_windows(pixels, column, *settings) for column in peaks)
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
    found = (band_pixels(pixels, line, margin_px) if line else pixels[:0] for line in (left, right))
    return WindowSearch(*found)


def _stack_windows(
    pixels: np.ndarray,
    column: float | None,
    edges: np.ndarray,
    bounds: np.ndarray,
    margin_px: float,
    recentre_pixels: int,
    flood_pixels: int | None,
) -> tuple[np.ndarray, tuple[Window, ...]]:
    """Pixels and windows of one line, from the bottom row to the top."""
    if column is None:
        return pixels[:0], ()
    found, windows = [], []
    for i in range(len(edges) - 1):
        rows = pixels[bounds[i + 1] : bounds[i]]
        inside = rows[np.abs(rows[:, 0] - column) <= margin_px]
        windows.append(
            Window(column - margin_px, int(edges[i + 1]), column + margin_px, int(edges[i]) - 1, len(inside))
        )
        if flood_pixels is not None and len(inside) >= flood_pixels:
            continue
        found.append(inside)
        if len(inside) >= max(recentre_pixels, 1):
            column = float(inside[:, 0].mean())
    return np.concatenate(found) if found else pixels[:0], tuple(windows)
