"""The samples that `tools.train_marking_network` learns from."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.network import finer_view
from tests.support.painted_roads import Road, dashcam
from tools.marking_samples import UNKNOWN, connect_dots, label_cells, take_sample

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# Both lines of a lane.
LEFT_M, RIGHT_M = 1.8, -1.7


def test_cells_are_labelled_where_pictures_with_and_without_lines_differ():
    """Cells with paint are 1 within the width of the line, and 0 elsewhere; noise in both pictures is no paint."""
    fine, road = finer_view(VIEW), Road(CAMERA, noise=6.0)
    bare = road.image()
    for lateral_m in (LEFT_M, RIGHT_M):
        road.line(lambda x, y=lateral_m: y + 0 * x)
    label = label_cells(fine.warp(road.image()), fine.warp(bare))
    assert label.shape == VIEW.shape
    rows = VIEW.x_m < 20
    beside_m = np.minimum(np.abs(VIEW.y_m - LEFT_M), np.abs(VIEW.y_m - RIGHT_M))
    seen = VIEW.seen[rows]
    assert np.all(label[rows][:, beside_m < 0.03][seen[:, beside_m < 0.03]] == 1)
    assert np.all(label[rows][:, beside_m > 0.4][seen[:, beside_m > 0.4]] == 0)


@pytest.mark.slow
def test_samples_are_the_same_in_each_run():
    first, again = (take_sample(9) for _ in range(2))
    np.testing.assert_array_equal(first.fine_image, again.fine_image)
    np.testing.assert_array_equal(first.label, again.label)
    assert set(np.unique(first.label)) == {0, 1, UNKNOWN}
    assert 0.003 < (first.label == 1).mean() < 0.1


def test_samples_without_a_road_have_no_paint():
    sample = take_sample(20)
    assert set(np.unique(sample.label)) <= {0, UNKNOWN} and 0 in sample.label


def test_dots_are_connected_to_the_dash_that_they_stand_for():
    """Cells of the dash near a dot are paint; those far from any visible dot are left open."""
    dots, dashes = np.zeros((40, 30), np.uint8), np.zeros((40, 30), np.uint8)
    dashes[5:30, 14:17] = 1
    dots[[6, 12], 15] = 1
    connected = connect_dots(dots, dashes)
    assert np.all(connected[5:17, 14:17] == 1)
    assert np.all(connected[17:30, 14:17] == UNKNOWN)
    assert not connected[:, :13].any() and not connected[30:].any()
