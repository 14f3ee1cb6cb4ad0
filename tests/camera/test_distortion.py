"""Lens distortion: undistorting and distorting is the identity, for lenses from narrow to very wide."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lanes.camera import Camera, undistort
from tests.support.examples import examples
from tests.support.painted_drive import CAMERA

# Residual of the iterative undistortion, pixels.
POINT_PX = 1e-6


@st.composite
def lenses(draw: st.DrawFn) -> Camera:
    """Lens whose distortion is monotonic up to the corners of the picture."""
    width = draw(st.integers(100, 4000))
    height = round(width * draw(st.floats(0.4, 1.0)))
    focal_px = width / 2 / np.tan(np.radians(draw(st.floats(30, 100))) / 2)
    k1, k2, k3 = draw(st.floats(-0.35, 0.2)), draw(st.floats(-0.1, 0.15)), draw(st.floats(-0.02, 0.02))
    p1, p2 = draw(st.floats(-0.002, 0.002)), draw(st.floats(-0.002, 0.002))
    middle = [size / 2 + draw(st.floats(-0.02, 0.02)) * width for size in (width, height)]
    matrix = np.array([[focal_px, 0, middle[0]], [0, focal_px * draw(st.floats(0.98, 1.02)), middle[1]], [0, 0, 1]])
    camera = Camera(width, height, matrix, np.array([k1, k2, p1, p2, k3]))
    # The undistorted corners must be inside the monotonic range of the distortion.
    r = np.linspace(0, 0.9 * min(camera.largest_ray, 5.0), 500)
    assume((r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)).max() > 1.1 * np.hypot(width, height) / 2 / focal_px)
    return camera


@examples(60)
@given(lenses(), st.integers(0, 2**32 - 1))
def test_undistorting_and_distorting_points_is_the_identity(camera, seed):
    pixels = np.random.default_rng(seed).uniform(0, 1, (40, 2)) * camera.size
    pixels = np.vstack([pixels, [[0, 0], [camera.width - 1, 0], [0, camera.height - 1]]])
    np.testing.assert_allclose(camera.distort_points(camera.undistort_points(pixels)), pixels, atol=POINT_PX)


def test_corners_of_a_very_wide_lens_need_many_iterations():
    """The corners of a lens of 100 degrees have an error of a pixel after 50 iterations."""
    focal_px = 1736 / 2 / np.tan(np.radians(50))
    matrix = np.array([[focal_px, 0, 868], [0, focal_px, 482], [0, 0, 1]])
    camera = Camera(1736, 964, matrix, np.array([-0.25, 0.05, 0.001, 0.001, 0.0]))
    corners = np.array([[0.0, 0.0], [1735, 0], [0, 963], [1735, 963]])
    np.testing.assert_allclose(camera.distort_points(camera.undistort_points(corners)), corners, atol=POINT_PX)


@pytest.mark.parametrize("least", [0.0, 5e-324, 1e-310, -1e-310, 1e-30])
def test_tiny_coefficients_equal_zero(least):
    """The polynomial has its maximum where 1 + 3 k1 r^2 = 0; tiny further coefficients must not divide by zero."""
    folding = replace(CAMERA, distortion=np.array([-0.3, least, 0, 0, least]))
    assert folding.largest_ray == pytest.approx(np.sqrt(1 / 0.9))
    assert replace(CAMERA, distortion=np.array([0.3, least, 0, 0, least])).largest_ray > 1e6


@pytest.mark.parametrize("size", [(640, 360), (1280, 720)])
@pytest.mark.parametrize("seed", [0, 1])
def test_undistorting_and_distorting_a_picture_changes_it_by_interpolation_only(size, seed):
    """Two interpolations of a smooth picture change it by two levels at most; pixels outside are ignored."""
    camera, rng = CAMERA.scaled(size), np.random.default_rng(seed)
    coarse = rng.integers(0, 256, (9, 16, 3), dtype=np.uint8)
    picture = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    v, u = np.mgrid[: size[1], : size[0]]
    place = camera.undistort_points(np.column_stack([u.ravel(), v.ravel()])).reshape(*u.shape, 2).astype(np.float32)
    back = cv2.remap(undistort(picture, camera), place[..., 0], place[..., 1], cv2.INTER_LINEAR)
    inside = ((place >= 1) & (place <= np.array(size) - 2)).all(axis=2)
    error = np.abs(back.astype(int) - picture)[inside]
    assert inside.mean() > 0.85
    assert error.max() <= 2 and error.mean() < 0.4
