"""Vanishing point: stripe segments in raw images, parallel lines through exact segments, edges of streets."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lanes.camera import Camera, CameraPose
from lanes.vanishing_point import Segments, find_edge_direction, find_segments, fit_parallel_lines
from tests.support.streets import NOT_STREETS, paint_street

CAMERA = Camera.from_fov((640, 360), 60)
HORIZON = 120.0
# The vanishing point of the exact segments, in ray coordinates.
X0, Y0 = 0.031, -0.042


class TestSegments:
    @staticmethod
    def road() -> np.ndarray:
        noise = np.random.default_rng(0).normal(90, 2, (360, 640, 1))
        return np.repeat(noise.clip(0, 255).astype(np.uint8), 3, axis=2)

    @staticmethod
    def stripe(image: np.ndarray, k: float, colour: tuple[int, int, int], width: float = 0.09) -> np.ndarray:
        """A stripe from the point (320, 120) on, `k` columns to the right and `width` columns wider each row."""
        ends = [(320 + (k + s * width / 2) * t, HORIZON + t) for t, s in ((20, -1), (230, -1), (230, 1), (20, 1))]
        return cv2.fillPoly(image, [np.round(np.array(ends) * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)

    @pytest.mark.parametrize("colour", [(230, 230, 230), (140, 100, 30)])
    @pytest.mark.parametrize("k", [-1.3, 0.7])
    def test_centres_and_slopes_are_those_of_a_painted_stripe(self, colour, k):
        s = find_segments(self.stripe(self.road(), k, colour), CAMERA, HORIZON)
        assert s.rows.sum() > 150
        u, v = s.x * CAMERA.matrix[0, 0] + CAMERA.matrix[0, 2], s.y * CAMERA.matrix[1, 1] + CAMERA.matrix[1, 2]
        assert np.abs(u - 320 - k * (v - HORIZON)).max() < 1.0
        assert np.abs(s.slope - k).max() < 4 * s.slope_std.max()

    def test_edges_shadows_and_dark_stripes_give_none(self):
        image = self.road()
        image[:, 400:] = 200
        cv2.fillPoly(image, [np.array([[40, 360], [230, 140], [240, 140], [120, 360]])], (30, 30, 30))
        assert len(find_segments(self.stripe(image, -0.2, (20, 20, 20)), CAMERA, HORIZON).x) == 0

    def test_removing_a_roll_turns_them_about_the_axis(self):
        s = find_segments(self.stripe(self.road(), 0.7, (230, 230, 230)), CAMERA, HORIZON)
        there_and_back = s.without_roll(0.03).without_roll(-0.03)
        np.testing.assert_allclose(there_and_back.slope, s.slope)
        np.testing.assert_allclose(there_and_back.x, s.x)
        # A roll lowers the right side of the camera, so its correction moves the right part of the image down.
        right = s.x > 0
        assert (s.without_roll(0.03).y[right] > s.y[right]).all()


def segments_of(k: np.ndarray, half_curvature: float, noise: float = 0.0) -> Segments:
    """Exact segments of lines at lateral positions k, eight each, with noise in x."""
    t, k = np.tile(np.geomspace(0.06, 0.4, 8), len(k)), np.repeat(k, 8)
    c = half_curvature * (1 + 2 * half_curvature * k)
    x = X0 + k * t + c / t + np.random.default_rng(0).normal(0, noise, len(t))
    ones = np.ones_like(t)
    return Segments(x, Y0 + t, k - c / t**2, 3e-4 * ones, 0.01 * ones, 20 * ones)


class TestParallelLines:
    LATERAL = np.array([-4.0, -1.3, 1.4])

    @pytest.mark.parametrize("half_curvature", [0.0, 0.003, -0.01])
    def test_horizon_direction_and_curvature_are_found(self, half_curvature):
        lines = fit_parallel_lines(segments_of(self.LATERAL, half_curvature), Y0 + 0.01, 0.016)
        assert lines.y0 == pytest.approx(Y0, abs=3e-4)
        assert lines.x0 == pytest.approx(X0, abs=1e-3)
        assert lines.half_curvature == pytest.approx(half_curvature, abs=2e-4)
        np.testing.assert_allclose(lines.lateral, self.LATERAL, atol=0.02)

    def test_other_segments_are_left_out(self):
        clean = segments_of(self.LATERAL, 0.002, noise=3e-4)
        x, y, slope = np.random.default_rng(4).uniform([-0.5, 0.0, -6], [0.5, 0.4, 6], (12, 3)).T
        junk = Segments(x, y, slope, np.full(12, 3e-4), np.full(12, 0.01), np.full(12, 20.0))
        both = Segments(*(np.concatenate([getattr(s, name) for s in (clean, junk)]) for name in vars(clean)))
        lines = fit_parallel_lines(both, Y0 + 0.006, 0.016)
        assert lines.y0 == pytest.approx(Y0, abs=1.5e-3)
        assert abs(lines.y0 - Y0) < 4 * lines.y0_std + 5e-4

    def test_fewer_than_two_lines_are_none(self):
        assert fit_parallel_lines(segments_of(np.array([1.4]), 0.0), Y0, 0.016) is None
        assert fit_parallel_lines(Segments(*np.empty((6, 0))), Y0, 0.016) is None


class TestEdges:
    @pytest.mark.parametrize(("pitch_deg", "yaw_deg"), [(2.5, -1.8), (-4.0, 5.0), (6.0, 0.0)])
    def test_a_street_without_lane_lines_shows_pitch_and_yaw(self, pitch_deg, yaw_deg):
        camera = Camera.from_fov((1280, 720), 62, CameraPose(1.5, *np.radians([pitch_deg, yaw_deg])))
        pitch, yaw = np.degrees(find_edge_direction(paint_street(camera), camera))
        assert pitch[0] == pytest.approx(pitch_deg, abs=0.6) and pitch[1] < 1.5
        assert yaw[0] == pytest.approx(yaw_deg, abs=1.0)

    @pytest.mark.parametrize("image", NOT_STREETS.values(), ids=NOT_STREETS)
    def test_edges_that_do_not_converge_are_none(self, image):
        assert find_edge_direction(image, Camera.from_fov((1280, 720), 60)) is None
