"""Road markings: coverage, width and place.

Double lines, dashes, Botts' dots, limited and oblique lines.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.ground import Ground, RoadAhead, cast_on_ground, pixel_rays
from simulator.road.markings import Marking, paint_markings
from simulator.scenes.freeway import DASHCAM
from tests.simulator.small_drive import FULL, SMALL

# The line of the test of coverage, and its dashes ahead of the car at 50 m.
LINE_M = -1.8
HALF_WIDTH_M = 0.06
DASH_PERIOD_M = 12.2
DASH_M = 3.05
# Window of pixels that shows the line from 15 m to 40 m ahead, and rays in a pixel.
ROWS = slice(197, 232)
COLUMNS = slice(335, 425)
RAYS = 17


def share_of_rays_on_paint(ahead: RoadAhead, *, dashed: bool) -> np.ndarray:
    """Share of the 17 x 17 rays of each pixel of the window that meet paint."""
    u = subpixels(COLUMNS)
    v = subpixels(ROWS)
    columns, rows = np.meshgrid(u, v)
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    x, y = SMALL.pixels_to_road(pixels).astype(np.float32).T
    s, d = ahead.locate(x, y)
    painted = np.abs(d - LINE_M) < HALF_WIDTH_M
    if dashed:
        painted &= (s + 49.0) % DASH_PERIOD_M < DASH_M
    blocks = painted.reshape(len(v) // RAYS, RAYS, -1, RAYS)
    return blocks.mean(axis=(1, 3))


def subpixels(pixels: slice) -> np.ndarray:
    """Coordinates of the rays in a range of pixels; a pixel's centre is a whole one."""
    number = np.arange(pixels.start * RAYS, pixels.stop * RAYS)
    return number / RAYS + 0.5 / RAYS - 0.5


@pytest.mark.parametrize(
    ("dashed", "worst", "mean"),
    [
        (False, 0.02, 5e-4),
        (True, 0.3, 2e-3),
    ],
)
def test_coverage_is_the_share_of_rays_that_meet_paint(dashed, worst, mean):
    """It is exact along a line, and approximate where a dash ends at its edge."""
    road = RoadGeometry([0.0, 300.0], [1 / 300, 1 / 300])
    ahead = RoadAhead(road, VehiclePose(50.0, 0.3, 0.01))
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, ahead)
    marking = Marking(LINE_M, 2 * HALF_WIDTH_M, dashed=dashed, phase_m=1.0)

    pixels, coverage = marking.coverage(ground)

    got = np.zeros((SMALL.height, SMALL.width), np.float32)
    got[ground.top :].ravel()[pixels] = coverage
    expected = share_of_rays_on_paint(ahead, dashed=dashed)
    assert expected.max() == 1.0
    off = np.abs(got[ROWS, COLUMNS] - expected)
    assert off.mean() < mean
    assert off.max() < worst


def straight_road(camera, pose: VehiclePose) -> Ground:
    """Ground of a straight road in each pixel."""
    ahead = RoadAhead(RoadGeometry([0.0, 300.0], [0.0, 0.0]), pose)
    return cast_on_ground(pixel_rays(camera), camera, ahead)


def stripes_at(
    marking: Marking,
    x_m: float,
) -> list[tuple[float, float]]:
    """Centre and width in metres of the stripes in the image row `x_m` ahead.

    From left to right.
    """
    ground = straight_road(FULL, VehiclePose(50.0))
    image = np.zeros((*ground.s.shape, 3), np.float32)
    paint_markings(image, (marking,), ground, seed=1)

    place = np.array([[x_m, marking.lateral_m]])
    _, v = FULL.road_to_pixels(place)[0]
    row = round(float(v)) - ground.top
    paint = image[row, :, 0]
    d = ground.d[row]
    pixel_width = np.abs(ground.d_u[row])

    bordered = np.pad(paint > 0.02, 1).astype(int)
    edges = np.flatnonzero(np.diff(bordered)).reshape(-1, 2)
    stripes = []
    for first, last in edges:
        run = slice(first, last)
        centre = float(np.average(d[run], weights=paint[run]))
        width = float((paint * pixel_width)[run].sum())
        stripes.append((centre, width))
    return stripes


@pytest.mark.parametrize(
    ("width_m", "gap_m", "x_m"),
    [
        (0.12, 0.10, 7.0),
        (0.10, 0.20, 14.0),
    ],
)
def test_double_line_is_two_stripes_of_the_right_width_with_the_right_gap(
    width_m, gap_m, x_m
):
    double = Marking(1.8, width_m, double_gap_m=gap_m, wear=0.0)
    (left, left_width), (right, right_width) = stripes_at(double, x_m)
    assert left_width == pytest.approx(width_m, rel=0.03)
    assert right_width == pytest.approx(width_m, rel=0.03)
    assert left - right - width_m == pytest.approx(gap_m, abs=0.004)
    assert (left + right) / 2 == pytest.approx(1.8, abs=0.003)


def painted_places(**options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Road coordinates, s from the car at 50 m, of the pixels that are mostly paint."""
    ground = straight_road(DASHCAM, VehiclePose(50.0, 0.1))
    marking = Marking(-1.5, 0.10, wear=0.0, **options)
    pixels, coverage = marking.coverage(ground)
    painted = pixels[coverage > 0.5]
    return ground.s.ravel()[painted], ground.d.ravel()[painted]


def test_dashes_begin_and_end_where_they_should():
    s, _ = painted_places(dashed=True, phase_m=56.0)
    first = s[s < 15]
    assert first.min() == pytest.approx(6.0, abs=0.1)
    assert first.max() == pytest.approx(9.05, abs=0.1)
    assert s[s > 15].min() == pytest.approx(18.2, abs=0.1)


def test_four_botts_dots_stand_in_place_of_a_dash():
    s, _ = painted_places(dashed=True, botts=True, phase_m=56.0)
    near = np.sort(s[s < 10])
    gaps = np.flatnonzero(np.diff(near) > 0.4)
    dots = np.split(near, gaps + 1)
    expected = [6.08 + k * 0.914 for k in range(4)]
    assert [dot.mean() for dot in dots] == pytest.approx(expected, abs=0.04)


def test_a_limited_line_begins_and_ends_where_it_should():
    s, _ = painted_places(start_m=58.0, end_m=64.0)
    assert s.min() == pytest.approx(8.0, abs=0.1)
    assert s.max() == pytest.approx(14.0, abs=0.1)


def test_an_oblique_line_leaves_its_lateral_position_with_its_slope():
    s, d = painted_places(slope=0.05, start_m=55.0)
    expected = -1.5 + 0.05 * (s - 5.0)
    np.testing.assert_allclose(d, expected, atol=0.08)
