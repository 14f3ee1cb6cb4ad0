"""Pixels of the two lines: histogram, sliding windows, and the band around a line."""

import numpy as np
import pytest
from pytest import approx

from helpers import (
    band_pixels,
    binary_pixels,
    find_peaks,
    lane_histogram,
    sliding_windows,
)

parametrize = pytest.mark.parametrize


def paint_view(*lines, first_row=0):
    """A view with lines 15 pixels wide through the columns that functions give."""
    rows, columns = np.indices((720, 1280))
    binary = np.zeros((720, 1280), np.uint8)
    for line in lines:
        distances = np.abs(columns - np.round(line(rows)))
        binary[(distances <= 7) & (rows >= first_row)] = 255
    return binary


def upright(row):
    return 300 + 0 * row


def slanted(row):
    return 150 + 0.4 * row


def bent(row):
    return 1000 - 3e-4 * (719 - row) ** 2


def test_histogram_counts_the_lower_half_or_the_rows_asked_for():
    binary = np.zeros((10, 6), np.uint8)
    binary[:, 2] = 255
    binary[0:3, 4] = 255
    assert lane_histogram(binary).tolist() == [0, 0, 5, 0, 0, 0]
    assert lane_histogram(binary, (0, 3)).tolist() == [0, 0, 3, 0, 3, 0]


@parametrize(
    ("histogram", "peaks"),
    [
        (
            [0, 5, 1, 0, 2, 9],
            (1, 5),
        ),
        (
            [4, 4, 0, 0, 4, 4],
            (1, 4),
        ),
        (
            [0, 0, 0, 0, 3, 0],
            (None, 4),
        ),
        ([7, 0, 0, 0], (0, None)),
        ([0], (None, None)),
        ([3], (None, 0)),
    ],
)
def test_peaks_left_and_right_of_the_middle(histogram, peaks):
    assert find_peaks(np.array(histogram)) == peaks


def test_windows_slide_along_a_slanted_and_a_bent_line():
    """A window that stays at the peak, as one original's did, loses both lines."""
    found = sliding_windows(paint_view(slanted, bent), margin_px=60)
    for windows in found.windows:
        rows = [[640 - 80 * k, 719 - 80 * k] for k in range(9)]
        assert windows[:, 1::2].tolist() == rows
    for pixels, line in zip(found.pixels, (slanted, bent), strict=True):
        u, v = pixels.T
        assert np.abs(u - line(v)).max() < 9
        assert len(pixels) > 0.97 * 15 * 720
    left, _, right, _ = found.windows[0][-1]
    assert abs((left + right) / 2 - slanted(80)) < 40


@parametrize(
    ("enough", "left_edge"),
    [
        (50, 300 - 80),
        (49, 364.5 - 80),
    ],
)
def test_more_pixels_than_the_number_are_needed_to_move_a_window(enough, left_edge):
    """The published rule is "more than 50"; here are 50 at the edge of the window."""
    binary = paint_view(upright, first_row=640)
    binary[600:605, 360:370] = 255
    found = sliding_windows(binary, margin_px=80, recentre_pixels=enough)
    assert found.windows[0][2][0] == approx(left_edge, abs=1)


def test_the_pixels_of_a_flooded_window_are_dropped():
    binary = paint_view(upright)
    binary[160:240, 200:400] = 255
    caught = sliding_windows(binary, margin_px=75, flood_pixels=9500).pixels[0]
    rows = caught[:, 1]
    assert not ((rows >= 160) & (rows < 240)).any()
    assert ((rows >= 80) & (rows < 160)).any()
    everything = sliding_windows(binary, margin_px=75).pixels[0]
    assert len(everything) > len(caught)


def test_the_window_above_a_flooded_one_is_recentred_all_the_same():
    """Recipe C drops the pixels only: the next window is moved by them."""
    binary = paint_view(upright)
    binary[160:240, 300:420] = 255
    found = sliding_windows(binary, margin_px=75, flood_pixels=5000)
    kept = sliding_windows(binary, margin_px=75)
    assert found.windows[0].tolist() == kept.windows[0].tolist()
    left_edges = found.windows[0][:, 0]
    assert left_edges[7] > left_edges[6] + 20


def test_band_takes_the_pixels_beside_the_known_line_only():
    binary = paint_view(slanted, bent)
    pixels = binary_pixels(binary)
    known = np.array([0.0, 0.4, 150.0])
    assert len(band_pixels(pixels, known, 10)) == 15 * 720
    assert band_pixels(pixels[:0], known, 10).shape == (0, 2)
    narrow = band_pixels(pixels, known, 3.1)
    v, u = np.nonzero(binary)
    near = np.abs(u - slanted(v)) <= 3.1
    expected = np.column_stack([u[near], v[near]])
    assert narrow.tolist() == expected.tolist()
