"""Stripe segments in a raw picture, and edges and shadows without any."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lanes.camera import Camera
from lanes.vanishing_point import find_segments

CAMERA = Camera.from_fov((640, 360), 60)
HORIZON = 120.0


def road(level=90):
    noise = np.random.default_rng(0).normal(level, 2, (360, 640, 1))
    return np.repeat(noise.clip(0, 255).astype(np.uint8), 3, axis=2)


def stripe(image, k, colour, width=0.09):
    """A stripe from the point (320, 120) on, `k` columns to the right and `width` columns wider each row."""
    ends = [(320 + (k + s * width / 2) * t, HORIZON + t) for t, s in ((20, -1), (230, -1), (230, 1), (20, 1))]
    return cv2.fillPoly(image, [np.round(np.array(ends) * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)


@pytest.mark.parametrize("colour", [(230, 230, 230), (140, 100, 30)])
@pytest.mark.parametrize("k", [-1.3, 0.7])
def test_centres_and_slopes_of_a_painted_stripe(colour, k):
    s = find_segments(stripe(road(), k, colour), CAMERA, HORIZON)
    assert s.rows.sum() > 150
    u, v = s.x * CAMERA.matrix[0, 0] + CAMERA.matrix[0, 2], s.y * CAMERA.matrix[1, 1] + CAMERA.matrix[1, 2]
    assert np.abs(u - 320 - k * (v - HORIZON)).max() < 1.0
    assert np.abs(s.slope - k).max() < 4 * s.slope_std.max()


def test_edges_shadows_and_dark_stripes_score_nothing():
    image = road()
    image[:, 400:] = 200
    cv2.fillPoly(image, [np.array([[40, 360], [230, 140], [240, 140], [120, 360]])], (30, 30, 30))
    assert len(find_segments(stripe(image, -0.2, (20, 20, 20)), CAMERA, HORIZON)) == 0


def test_rolling_back_turns_pieces_about_the_axis():
    s = find_segments(stripe(road(), 0.7, (230, 230, 230)), CAMERA, HORIZON)
    there_and_back = s.without_roll(0.03).without_roll(-0.03)
    np.testing.assert_allclose(there_and_back.slope, s.slope)
    np.testing.assert_allclose(there_and_back.x, s.x)
    # A roll lowers the right side of the camera, so its correction moves the right part of the picture down.
    right = s.x > 0
    assert (s.without_roll(0.03).y[right] > s.y[right]).all()
