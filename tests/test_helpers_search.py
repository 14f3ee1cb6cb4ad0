"""Pixels of the two lines: histogram, sliding windows, and the band around a known line."""

import numpy as np
import pytest

from helpers import LineFit, band_pixels, binary_pixels, find_peaks, lane_histogram, sliding_windows


def paint_view(*lines, first_row=0):
    """A bird's-eye view with lines 15 pixels wide through the columns that functions give for a row."""
    rows, columns = np.indices((720, 1280))
    on_line = [np.abs(columns - np.round(line(rows))) <= 7 for line in lines]
    return np.where(np.any(on_line, axis=0) & (rows >= first_row), 255, 0).astype(np.uint8)


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


@pytest.mark.parametrize(
    ("histogram", "peaks"),
    [
        ([0, 5, 1, 0, 2, 9], (1, 5)),
        ([4, 4, 0, 0, 4, 4], (1, 4)),
        ([0, 0, 0, 0, 3, 0], (None, 4)),
        ([7, 0, 0, 0], (0, None)),
        ([0], (None, None)),
        ([3], (None, 0)),
    ],
)
def test_peaks_left_and_right_of_the_middle(histogram, peaks):
    assert find_peaks(np.array(histogram)) == peaks


def test_windows_slide_along_a_slanted_and_a_bent_line():
    """A window that stays where the histogram put it (as one original's did in video) loses both lines."""
    binary = paint_view(slanted, bent)
    found = sliding_windows(binary, margin_px=60)
    for windows in found.windows:
        assert windows[:, 1::2].tolist() == [[640 - 80 * k, 719 - 80 * k] for k in range(9)]
    for pixels, line in ((found.pixels[0], slanted), (found.pixels[1], bent)):
        assert np.abs(pixels[:, 0] - line(pixels[:, 1])).max() < 9
        assert len(pixels) > 0.97 * 15 * 720
    top = found.windows[0][-1]
    assert abs((top[0] + top[2]) / 2 - slanted(80)) < 40


def test_few_pixels_do_not_move_a_window():
    binary = paint_view(upright, first_row=640)
    binary[600:604, 360:370] = 255  # 40 pixels at the edge of the second window
    still = sliding_windows(binary, margin_px=80, recentre_pixels=50).windows[0]
    moved = sliding_windows(binary, margin_px=80, recentre_pixels=40).windows[0]
    assert still[2][0] == pytest.approx(300 - 80, abs=1)
    assert moved[2][0] == pytest.approx(364.5 - 80, abs=1)


def test_a_flooded_window_is_dropped():
    binary = paint_view(upright)
    binary[160:240, 200:400] = 255
    caught = sliding_windows(binary, margin_px=75, flood_pixels=9500).pixels[0]
    assert not ((caught[:, 1] >= 160) & (caught[:, 1] < 240)).any()
    assert ((caught[:, 1] >= 80) & (caught[:, 1] < 160)).any()
    assert len(sliding_windows(binary, margin_px=75).pixels[0]) > len(caught)


def test_band_takes_the_pixels_beside_the_known_line_only():
    binary = paint_view(slanted, bent)
    known = LineFit((0.0, 0.4, 150.0), 1)
    pixels = binary_pixels(binary)
    found = band_pixels(pixels, known, 10)
    assert len(found) == 15 * 720
    assert band_pixels(pixels[:0], known, 10).shape == (0, 2)
    narrow = band_pixels(pixels, known, 3.1)
    everything = np.argwhere(binary)[:, ::-1]
    assert narrow.tolist() == everything[np.abs(everything[:, 0] - slanted(everything[:, 1])) <= 3.1].tolist()
