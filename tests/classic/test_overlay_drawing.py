"""Drawing of a classic lane: through the lens, one line only, search windows, pixels and fits."""

from __future__ import annotations

import numpy as np
import pytest

from classic.overlay import draw_fit, draw_lane, draw_pixels, draw_windows
from lanes.camera import Camera
from lanes.canvas import LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR, fill_lane
from lanes.errors import PictureError
from tests.support.drawing import assert_draws_on_a_copy, gray_picture, read_only_noise

LEFT = np.array([[60.0, 20.0], [20.0, 80.0]])
RIGHT = np.array([[100.0, 20.0], [140.0, 80.0]])


@pytest.fixture
def gray() -> np.ndarray:
    return gray_picture()


@pytest.fixture
def lens() -> Camera:
    """A lens that moves a point near the corner by more than ten pixels."""
    matrix = np.array([[120.0, 0, 79.5], [0, 120.0, 47.5], [0, 0, 1]])
    return Camera(160, 96, matrix, np.array([-0.25, 0.03, 0.001, -0.001, 0.0]))


ALL = {
    "draw_lane": lambda p: draw_lane(p, LEFT, RIGHT),
    "draw_windows": lambda p: draw_windows(p, [[10, 10, 30, 30]]),
    "draw_pixels": lambda p: draw_pixels(p, [[3, 4]], colour=LEFT_COLOUR),
    "draw_fit": lambda p: draw_fit(p, LEFT, RIGHT),
}


@pytest.mark.parametrize("name", ALL)
def test_every_function_draws_on_a_copy(name):
    assert_draws_on_a_copy(ALL[name])


class TestDrawLane:
    def test_goes_through_the_lens(self, lens):
        """A line that is straight after undistortion is drawn on the curved marking of the raw picture."""
        straight = np.array([[5.0, 8.0], [30.0, 92.0]])
        many = np.column_stack([np.linspace(5, 30, 200), np.linspace(8, 92, 200)])
        paint = lens.distort_points(many)
        drawn = draw_lane(np.zeros((96, 160, 3), np.uint8), straight, None, lens, line_width_px=3)
        rows, columns = np.nonzero(drawn[..., 0] > 120)
        inside = paint[(paint[:, 1] > rows.min()) & (paint[:, 1] < rows.max())]
        for u, v in inside[::20]:
            assert columns[rows == round(v)].mean() == pytest.approx(u, abs=1.0)
        # Without the lens model the line would lie elsewhere, so the example is sensitive to it.
        assert np.abs(paint - many).max() > 5

    def test_without_camera_points_are_taken_as_they_are(self, gray):
        expected = fill_lane(gray, LEFT, RIGHT)
        np.testing.assert_array_equal(draw_lane(gray, LEFT, RIGHT, line_width_px=0), expected)

    def test_left_is_red_and_right_is_blue(self, gray):
        drawn = draw_lane(gray, LEFT, RIGHT, line_width_px=4)
        np.testing.assert_array_equal(drawn[50, 40], LEFT_COLOUR)
        np.testing.assert_array_equal(drawn[50, 120], RIGHT_COLOUR)

    def test_one_line_only(self, gray):
        drawn = draw_lane(gray, None, RIGHT, line_width_px=4)
        np.testing.assert_array_equal(drawn[50, 120], RIGHT_COLOUR)
        np.testing.assert_array_equal(drawn[:, :90], gray[:, :90])

    def test_no_line_at_all(self):
        picture = read_only_noise()
        np.testing.assert_array_equal(draw_lane(picture, None, None), picture)

    def test_picture_of_another_size_is_refused(self, gray, lens):
        with pytest.raises(PictureError, match="150x96 pixels, but the camera was calibrated for 160x96"):
            draw_lane(np.ascontiguousarray(gray[:, :150]), LEFT, RIGHT, lens)


class TestSearch:
    def test_windows_are_outlines(self):
        drawn = draw_windows(np.zeros((96, 160), np.uint8), [[20, 30, 60, 50]])
        # One pixel wide and smooth, so the colour is not quite full.
        np.testing.assert_allclose(drawn[30, 40], WINDOW_COLOUR, atol=30)
        np.testing.assert_allclose(drawn[40, 20], WINDOW_COLOUR, atol=30)
        assert not drawn[40, 40].any()

    def test_no_windows(self, gray):
        np.testing.assert_array_equal(draw_windows(gray, np.empty((0, 4))), gray)

    def test_pixels_outside_are_left_out(self, gray):
        drawn = draw_pixels(gray, [[5, 7], [-1, 3], [160, 3], [3, 96]], colour=LEFT_COLOUR)
        assert [tuple(p) for p in np.argwhere((drawn != gray).any(axis=2))] == [(7, 5)]

    def test_fit(self, gray):
        drawn = draw_fit(gray, None, [[100, 0], [100, 95]])
        np.testing.assert_allclose(drawn[50, 100], RIGHT_COLOUR, atol=30)
