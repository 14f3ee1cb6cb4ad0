"""The bird's-eye view: marks on the road appear in their cells."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from tests.support.painted_roads import Road, dashcam


@pytest.mark.parametrize(
    ("width", "x", "y"),
    [
        (1280, 6.5, 1.2),
        (1283, 12.0, -2.7),
        (1283, 25.0, 3.4),
        (1921, 45.0, -0.6),
        (640, 6.0, 2.6),
    ],
)
def test_a_mark_on_the_road_appears_in_its_cells(width, x, y):
    camera = dashcam(width)
    view = BirdsEyeView(camera)
    road = Road(camera, noise=0).paint(
        lambda px, py: (abs(px - x) < 0.06 * x) & (abs(py - y) < 0.3), (255, 255, 255)
    )
    lightness = view.warp(road.image()).sum(axis=2).astype(float)
    bright = lightness - np.median(lightness[view.seen])
    bright[~view.seen | (bright < 200)] = 0
    # The mark is symmetric in y but covers more rows on its near side, as rows do;
    # weigh them by their depth.
    depth = view.x_m[:, None]
    assert (bright * view.y_m).sum() / bright.sum() == pytest.approx(y, abs=0.02)
    assert (bright * depth * depth).sum() / (bright * depth).sum() == pytest.approx(
        x, rel=0.02
    )


def test_near_cells_average_the_pixels_they_cover():
    # Fine texture near the car must become gray, not a pattern of its own.
    camera = dashcam(1280)
    view = BirdsEyeView(camera)
    checks = np.indices((camera.height, camera.width)).sum(axis=0) % 2 * 200
    seen = view.warp(np.repeat(checks[..., None], 3, axis=2).astype(np.uint8))[
        view.x_m < 12
    ]
    assert np.std(seen[view.seen[view.x_m < 12]]) < 1.5


def test_cells_outside_the_picture_are_unseen_and_go_on_as_the_picture_ends():
    view = BirdsEyeView(dashcam())
    image = np.random.default_rng(2).integers(50, 200, (360, 640, 3), np.uint8)
    warped = view.warp(image)
    assert not view.seen[-1, 0]
    assert view.seen[-1, len(view.y_m) // 2]
    for cells, seen in zip(warped, view.seen, strict=True):
        first, last = np.flatnonzero(seen)[[0, -1]]
        assert (cells[:first] == cells[first]).all()
        assert (cells[last:] == cells[last]).all()
    black = view.blacken(warped)
    assert (black[~view.seen] == 0).all()
    assert (black[view.seen] == warped[view.seen]).all()
