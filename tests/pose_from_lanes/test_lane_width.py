"""Camera height from the distances of parallel lines: which two of them bound a lane."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.pose import PRIOR_HEIGHT_M, HeightAndRoll, estimate_height_and_roll
from lanes.vanishing_point import RoadLines

LANE_M, HEIGHT_M = 3.66, 2.0
FULL, FEW = 40, 8


def height_from(
    lateral_m: list[float], rows: list[int], *, height_m: float = HEIGHT_M, pictures: int = 1
) -> HeightAndRoll:
    """The height that follows from lines at these lateral positions in each picture of a camera that is so high."""
    lines = RoadLines(0.0, 0.0, 0.0, 0.01, 0.01, np.array(lateral_m) / height_m, np.array(rows))
    return estimate_height_and_roll([lines] * pictures, LANE_M, PRIOR_HEIGHT_M, 0.0)


@pytest.mark.parametrize("offset_m", [-0.5, 0.0, 0.5])
def test_the_height_is_that_of_a_lane_around_the_car(offset_m):
    height = height_from([offset_m - LANE_M / 2, offset_m + LANE_M / 2], [FULL, FULL])
    assert height.height_m == pytest.approx(HEIGHT_M, rel=0.03)


@pytest.mark.parametrize("side", [-1, 1])
def test_two_lanes_whose_common_line_is_worn_are_not_one_lane(side):
    """Taken for one lane of 3.66 m, they would be seen from a height of 1 m by a car far from its middle."""
    lines = [(-side * LANE_M / 2, FULL), (side * LANE_M / 2, FEW), (side * 1.5 * LANE_M, FULL)]
    height = height_from(*map(list, zip(*sorted(lines), strict=True)))
    assert height.height_m == pytest.approx(HEIGHT_M, rel=0.03)


def test_the_height_of_a_level_camera_is_not_that_of_a_rolled_one():
    """A seam beside the lane is as far from its line as a lane of a camera that is 3.3 m high and rolled."""
    right_m = -0.4 - LANE_M / 2
    found = height_from([right_m - 1.2, right_m, right_m + LANE_M], [FULL, FULL, FULL // 2], height_m=1.2, pictures=8)
    assert (found.height_m, found.roll_rad) == (pytest.approx(1.2, rel=0.03), 0.0)


def test_a_lane_beside_the_car_counts_wherever_it_is():
    """The car changes lanes: the lane to its right is a lane all the same."""
    height = height_from([-1.5 * LANE_M, -LANE_M / 2, LANE_M / 2], [FULL, FULL, FEW])
    assert height.height_m == pytest.approx(HEIGHT_M, rel=0.03)


def test_two_lines_alone_leave_more_doubt_than_four():
    two = height_from([-LANE_M / 2, LANE_M / 2], [FULL, FULL])
    four = height_from([-1.5 * LANE_M, -LANE_M / 2, LANE_M / 2, 1.5 * LANE_M], [FULL] * 4)
    assert two.height_std_m > 2 * four.height_std_m
