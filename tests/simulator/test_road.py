"""Roads, also hairpins and crests.

Clothoids, and the truth of lines that turn away or dip behind a crest.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from simulator.rendering.drive import Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import (
    HeightProfile,
    RoadGeometry,
    VehiclePose,
    line_lateral,
    line_polynomial,
    offset_point,
)
from simulator.road.ground import Ground, RoadAhead, cast_on_ground, pixel_rays
from simulator.road.markings import Marking
from simulator.road.surface import Surface, Zone
from simulator.road.truth import (
    H_SAMPLES,
    NOT_VISIBLE,
    VIDEO_X_M,
    lane_truth,
    line_pixels,
)
from simulator.scenes.freeway import DASHCAM
from tests.simulator.small_drive import small_drive

S_BEND = RoadGeometry(
    [0.0, 75.0, 125.0, 175.0, 255.0, 330.0],
    [0.0, 0.0, 1 / 300, 1 / 300, -1 / 200, -1 / 200],
)
HAIRPINS = RoadGeometry(
    [0.0, 30.0, 40.0, 85.0, 95.0, 120.0, 130.0, 165.0, 200.0],
    [0.0, 0.0, 1 / 20, 1 / 20, 0.0, 0.0, -1 / 16, -1 / 16, 0.0],
)
# Uphill 9 %, over a crest of R 230 m, down, and through a dip.
HILLY = HeightProfile(
    [0.0, 60.0, 90.0, 110.0, 140.0],
    [0.09, 0.09, -0.04, -0.04, 0.06],
)
HILLY_BENDS = RoadGeometry(
    [0.0, 60.0, 100.0],
    [1 / 200, 1 / 200, -1 / 120],
    HILLY,
)
# A crest every 52 m.
WAVE_STATIONS_M = 4.0 * np.arange(65)
WAVES = HeightProfile(
    WAVE_STATIONS_M, 0.055 * np.sin(2 * np.pi * WAVE_STATIONS_M / 52.0)
)
# Lines of a narrow lane.
NARROW_M = (1.6, -1.6)


def integrate(rate: np.ndarray, step: float) -> np.ndarray:
    """Sums of a rate in the middle of each step, from 0 on."""
    return np.concatenate([[0], np.cumsum(rate * step)])


def middles(values: np.ndarray) -> np.ndarray:
    return (values[1:] + values[:-1]) / 2


def test_heading_is_the_integral_of_curvature():
    s, step = np.linspace(0, 330, 33_001, retstep=True)
    curvature = np.interp(s, S_BEND.stations_m, S_BEND.values)
    heading = integrate(middles(curvature), step)
    np.testing.assert_allclose(S_BEND.heading(s), heading, atol=1e-7)


def test_position_is_the_integral_of_the_direction():
    s, step = np.linspace(0, 330, 33_001, retstep=True)
    curvature = np.interp(s, S_BEND.stations_m, S_BEND.values)
    heading = middles(integrate(middles(curvature), step))
    x = integrate(np.cos(heading), step)
    y = integrate(np.sin(heading), step)
    expected = np.column_stack([x, y])
    np.testing.assert_allclose(S_BEND.position(s), expected, atol=1e-5)


def test_heights_are_those_above_the_plane_that_the_car_stands_on():
    """Uphill they are 0.

    Behind the crest the road falls by half its length times its change of grade.
    """
    heights_m = HILLY.height_above_plane(np.array([30.0, 60.0, 90.0]), 20.0)
    assert heights_m == pytest.approx([0.0, 0.0, -0.13 * 30 / 2])


@pytest.mark.parametrize("lateral_m", [1.83, -1.83])
def test_polynomial_touches_the_line_to_third_order(lateral_m):
    pose = VehiclePose(210.0, 0.4, 0.03)
    x = np.linspace(-3, 3, 7)
    lateral = line_lateral(S_BEND, pose, lateral_m, x)
    line = line_polynomial(S_BEND, pose, lateral_m)
    quadratic = line.c0_m + line.c1 * x + line.c2_per_m * x**2 / 2
    cubic = quadratic + line.c3_per_m2 * x**3 / 6
    np.testing.assert_allclose(lateral, cubic, atol=1e-5)
    # Without the cubic term the error is larger, so c3 matters.
    assert np.abs(lateral - quadratic).max() > 1e-4


def first_crossings(pose: VehiclePose, lateral_m: float) -> list[float]:
    """Lateral positions of a line of HAIRPINS where it first reaches VIDEO_X_M.

    NaN where it has turned by more than 80 degrees before. By dense sampling.
    """
    s = pose.s_m + np.arange(-5, 60, 1e-3)
    x, y = pose.to_car(HAIRPINS, offset_point(HAIRPINS, s, lateral_m)).T
    turn = HAIRPINS.heading(s) - pose.absolute_heading(HAIRPINS)
    turned = np.abs(turn) > np.radians(80)
    crossings = []
    for at in VIDEO_X_M:
        beyond = x > at
        first = int(np.argmax(beyond))
        reached = beyond.any() and not turned[:first].any()
        crossings.append(y[first] if reached else np.nan)
    return crossings


@pytest.mark.parametrize(
    ("pose", "lateral_m"),
    [
        (VehiclePose(20.0, 0.4, -0.02), 1.6),
        (VehiclePose(112.0, 0.0, 0.02), -1.6),
    ],
)
def test_lateral_position_in_a_hairpin_is_that_of_the_first_crossing_or_nan(
    pose, lateral_m
):
    expected = first_crossings(pose, lateral_m)
    assert np.isnan(expected).any()
    assert np.isfinite(expected).sum() >= 3
    lateral = line_lateral(HAIRPINS, pose, lateral_m, VIDEO_X_M)
    np.testing.assert_allclose(lateral, expected, atol=6e-3)


@pytest.mark.parametrize(
    ("road", "start_m", "fewest"),
    [
        pytest.param(HAIRPINS, 112.0, 20, id="hairpin"),
        pytest.param(HILLY_BENDS, 30.0, 30, id="before a crest"),
        pytest.param(HILLY_BENDS, 75.0, 30, id="on a crest"),
    ],
)
def test_truth_lies_on_the_paint_in_hairpins_and_on_crests(road, start_m, fewest):
    """White lines of a narrow lane.

    Up to where the road turns away or dips behind the crest.
    """
    drive = small_drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=NARROW_M,
        markings=tuple(Marking(line_m, 0.15, wear=0.0) for line_m in NARROW_M),
        surface=Surface(
            (Zone(-100.0, "fresh asphalt"),),
            right_edge_m=-2.4,
            left_edge_m=5.4,
        ),
        motion=Motion(start_m, 0.0, 0.2, rear_axle_m=1.6),
    )
    frame = render_frame(drive)

    # Paint is blue too, dry grass is not.
    paint = frame.image[..., 2] > 120
    not_paint = (~paint).astype(np.uint8)
    from_paint_px = cv2.distanceTransform(not_paint, cv2.DIST_L2, 5)
    off_px = []
    for side in (0, 1):
        columns = line_pixels(frame.truth, side, drive.camera_at(0.0))
        # Farther lines are narrower than a pixel.
        shown = (columns >= 0) & (H_SAMPLES > 430)
        at = np.rint(columns[shown]).astype(int)
        off_px.extend(from_paint_px[H_SAMPLES[shown], at])
    assert len(off_px) >= fewest
    assert np.quantile(off_px, 0.97) <= 1.0
    assert max(off_px) < 2.5


def column_on_ground(ground: Ground, row: int, lateral_m: float) -> float:
    """Column of an image row at which d falls through `lateral_m`.

    At the nearest such ground; -2 without any.
    """
    offset = ground.d[row] - lateral_m
    left = offset[:-1]
    right = offset[1:]
    seen = ground.visible[row, :-1] & ground.visible[row, 1:]
    # A larger step is one over a crest.
    small_step = left - right < 0.5
    crossings = np.flatnonzero((left >= 0) & (right < 0) & small_step & seen)
    if not len(crossings):
        return NOT_VISIBLE
    at = crossings[np.argmin(ground.distance[row, crossings])]
    return at + left[at] / (left[at] - right[at])


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("start_m", [5.0, 20.0])
def test_lines_are_where_pixel_rays_meet_the_ground_and_end_behind_crests(
    start_m, side
):
    road = RoadGeometry([0.0, 400.0], [1 / 300, 1 / 300], WAVES)
    pose = VehiclePose(start_m, 0.2)
    ground = cast_on_ground(pixel_rays(DASHCAM), DASHCAM, RoadAhead(road, pose))
    on_ground = ground.top < H_SAMPLES
    rows = H_SAMPLES[on_ground] - ground.top
    expected = [column_on_ground(ground, row, NARROW_M[side]) for row in rows]
    assert NOT_VISIBLE in expected

    truth = lane_truth(road, pose, NARROW_M, time_s=0.0, pitch_rad=0.0)
    columns = line_pixels(truth, side, DASHCAM)
    np.testing.assert_allclose(columns[on_ground], expected, atol=0.1)
