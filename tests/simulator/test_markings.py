"""Road markings: coverage, width and place of double lines, dashes, Botts' dots, limited and oblique lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.ground import RoadAhead, cast_on_ground, pixel_rays
from simulator.road.markings import Marking, paint_markings
from simulator.scenes.freeway import DASHCAM
from tests.simulator.small_drive import POSE, SMALL


@pytest.mark.parametrize(
    ("dashed", "worst", "mean"), [(False, 0.02, 5e-4), (True, 0.3, 2e-3)]
)
def test_coverage_is_the_share_of_rays_that_meet_paint(dashed, worst, mean):
    """It is exact along a line, and approximate where a dash ends at a pixel on the edge of the line."""
    ahead = RoadAhead(
        RoadGeometry([0.0, 300.0], [1 / 300, 1 / 300]), VehiclePose(50.0, 0.3, 0.01)
    )
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, ahead)
    pixels, coverage = Marking(-1.8, 0.12, dashed=dashed, phase_m=1.0).coverage(ground)
    got = np.zeros((SMALL.height, SMALL.width), np.float32)
    got[ground.top :].ravel()[pixels] = coverage
    # The line from 15 m to 40 m ahead is in this window; each of its pixels has 17 x 17 rays.
    rows, columns, n = slice(197, 232), slice(335, 425), 17
    v, u = (
        np.arange(part.start * n, part.stop * n) / n + 0.5 / n - 0.5
        for part in (rows, columns)
    )
    points = SMALL.pixels_to_road(
        np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    ).astype(np.float32)
    s, d = (place.reshape(len(v), len(u)) for place in ahead.locate(*points.T))
    painted = (np.abs(d + 1.8) < 0.06) & (((s + 49.0) % 12.2 < 3.05) | (not dashed))
    expected = painted.reshape(len(v) // n, n, -1, n).mean(axis=(1, 3))
    assert expected.max() == 1.0
    off = np.abs(got[rows, columns] - expected)
    assert off.mean() < mean and off.max() < worst


def stripes_at(markings: tuple[Marking, ...], x_m: float) -> list[tuple[float, float]]:
    """Centre and width in metres of the stripes in the image row `x_m` ahead, from left to right."""
    camera, road = replace(DASHCAM, pose=POSE), RoadGeometry([0.0, 300.0], [0.0, 0.0])
    ground = cast_on_ground(
        pixel_rays(camera), camera, RoadAhead(road, VehiclePose(50.0))
    )
    black = np.zeros((*ground.s.shape, 3), np.float32)
    paint_markings(black, markings, ground, seed=1)
    row = (
        round(
            float(camera.road_to_pixels(np.array([[x_m, markings[0].lateral_m]]))[0, 1])
        )
        - ground.top
    )
    paint, d, step = black[row, :, 0], ground.d[row], np.abs(ground.d_u[row])
    edges = np.flatnonzero(
        np.diff(np.concatenate([[0], paint > 0.02, [0]]).astype(int))
    ).reshape(-1, 2)
    runs = [slice(a, b) for a, b in edges]
    return [
        (
            float(np.average(d[run], weights=paint[run])),
            float((paint * step)[run].sum()),
        )
        for run in runs
    ]


@pytest.mark.parametrize(
    ("width_m", "gap_m", "x_m"), [(0.12, 0.10, 7.0), (0.10, 0.20, 14.0)]
)
def test_double_line_is_two_stripes_of_the_right_width_with_the_right_gap(
    width_m, gap_m, x_m
):
    (left, left_width), (right, right_width) = stripes_at(
        (Marking(1.8, width_m, double_gap_m=gap_m, wear=0.0),), x_m
    )
    assert (left_width, right_width) == pytest.approx((width_m, width_m), rel=0.03)
    assert left - right - width_m == pytest.approx(gap_m, abs=0.004)
    assert (left + right) / 2 == pytest.approx(1.8, abs=0.003)


def test_dashes_botts_dots_limited_lines_and_oblique_lines_have_the_right_position():
    road, pose = RoadGeometry([0.0, 200.0], [0.0, 0.0]), VehiclePose(50.0, 0.1)
    ground = cast_on_ground(pixel_rays(DASHCAM), DASHCAM, RoadAhead(road, pose))
    places = (ground.s.ravel(), ground.d.ravel())

    def painted(**options):
        pixels, coverage = Marking(-1.5, 0.10, wear=0.0, **options).coverage(ground)
        return [place[pixels[coverage > 0.5]] for place in places]

    s, _ = painted(dashed=True, phase_m=56.0)
    dash = s[s < 15]
    assert (dash.min(), dash.max(), s[s > 15].min()) == pytest.approx(
        (6.0, 9.05, 18.2), abs=0.1
    )
    s, _ = painted(dashed=True, botts=True, phase_m=56.0)
    near = np.sort(s[s < 10])
    groups = np.split(near, np.flatnonzero(np.diff(near) > 0.4) + 1)
    assert [group.mean() for group in groups] == pytest.approx(
        [6.08 + k * 0.914 for k in range(4)], abs=0.04
    )
    s, _ = painted(start_m=58.0, end_m=64.0)
    assert (s.min(), s.max()) == pytest.approx((8.0, 14.0), abs=0.1)
    s, d = painted(slope=0.05, start_m=55.0)
    np.testing.assert_allclose(d, -1.5 + 0.05 * (s - 5.0), atol=0.08)
