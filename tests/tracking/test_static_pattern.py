"""What never moves in the image stays known with another camera pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.camera.model import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Stripes
from lanes.tracking.static_pattern import StaticPattern

POSE = CameraPose(height_m=1.3, pitch_rad=0.06)
CAMERA = Camera.from_fov((640, 360), 60, POSE)
OTHER = CAMERA.with_pose(replace(POSE, pitch_rad=0.08, yaw_rad=0.05))
PERIOD_S = 0.5
# A streak in the windscreen, from below the middle of the image down to the right.
STREAK_PX = np.column_stack([np.linspace(350, 470, 60), np.linspace(240, 330, 60)])


def view_of(camera: Camera) -> BirdsEyeView:
    return BirdsEyeView.from_image_border(camera, 2.5, half_width_m=13.0)


def stripes_at(pixels: np.ndarray, view: BirdsEyeView) -> Stripes:
    """A stripe in the row of the view nearest to each pixel."""
    x_m, y_m = view.camera.pixels_to_road(pixels).T
    row = np.abs(view.x_m - x_m[:, None]).argmin(axis=1)
    some = np.ones(len(row))
    return Stripes(
        row=row,
        x_m=x_m,
        y_m=y_m,
        angle=0 * some,
        step=some,
        weight=some,
        std_m=some,
        angle_std_rad=some,
        edge=some < 0,
        full_weight=some,
        measurable=some > 0,
    )


def pattern_of_streak(*, before: int = 0) -> StaticPattern:
    """The pattern after ten samples of the streak beside stripes that move.

    In the samples `before` these, there are only the stripes that move.
    """
    view = view_of(CAMERA)
    pattern = StaticPattern(view, PERIOD_S)
    rng = np.random.default_rng(0)
    for sample in range(before + 10):
        moving_px = STREAK_PX - [150, 0] + rng.normal(0, 30, STREAK_PX.shape)
        moving_px[:, 1] = np.maximum(moving_px[:, 1], 230)
        seen_px = moving_px
        if sample >= before:
            seen_px = np.vstack([STREAK_PX, moving_px])
        pattern.update(stripes_at(seen_px, view), view, PERIOD_S)
    return pattern


def static_share(pattern: StaticPattern, pixels: np.ndarray, camera: Camera) -> float:
    view = view_of(camera)
    is_static, _ = pattern.update(stripes_at(pixels, view), view, 0.0)
    return float(is_static.mean())


def test_a_streak_is_static_with_the_pose_that_it_was_seen_with():
    assert static_share(pattern_of_streak(), STREAK_PX, CAMERA) == 1.0


def test_a_streak_that_comes_later_in_a_drive_is_static_after_ten_samples():
    assert static_share(pattern_of_streak(before=40), STREAK_PX, CAMERA) == 1.0


def test_a_streak_is_static_at_once_with_another_pose():
    pattern = pattern_of_streak().seen_in(view_of(OTHER))
    assert static_share(pattern, STREAK_PX, OTHER) > 0.8


def test_other_places_are_not_static_with_another_pose():
    pattern = pattern_of_streak().seen_in(view_of(OTHER))
    beside_px = STREAK_PX + [25, 0]
    assert static_share(pattern, beside_px, OTHER) == 0.0


def test_without_the_other_pose_the_pattern_is_elsewhere():
    assert static_share(pattern_of_streak(), STREAK_PX, OTHER) < 0.3
