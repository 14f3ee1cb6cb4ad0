"""Roads, also hairpins and crests: clothoids, and the truth of lines that turn away or dip behind a crest."""

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
from simulator.road.markings import WHITE, Marking
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
STATIONS = [0.0, 30.0, 40.0, 85.0, 95.0, 120.0, 130.0, 165.0, 200.0]
HAIRPINS = RoadGeometry(
    STATIONS, [0.0, 0.0, 1 / 20, 1 / 20, 0.0, 0.0, -1 / 16, -1 / 16, 0.0]
)
# Uphill 9 %, over a crest of R 230 m, down, and through a dip.
HILLY = HeightProfile([0.0, 60.0, 90.0, 110.0, 140.0], [0.09, 0.09, -0.04, -0.04, 0.06])
# A crest every 52 m.
WAVES = HeightProfile(
    4.0 * np.arange(65), 0.055 * np.sin(2 * np.pi * 4.0 * np.arange(65) / 52.0)
)


def test_heading_and_position_are_the_integrals_of_curvature():
    s = np.linspace(0, 330, 33_001)
    curvature = np.interp(s, S_BEND.stations_m, S_BEND.values)
    step = s[1]
    heading = np.concatenate(
        [[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * step)]
    )
    middle = (heading[1:] + heading[:-1]) / 2
    x = np.concatenate([[0], np.cumsum(np.cos(middle) * step)])
    y = np.concatenate([[0], np.cumsum(np.sin(middle) * step)])
    np.testing.assert_allclose(S_BEND.heading(s), heading, atol=1e-7)
    np.testing.assert_allclose(S_BEND.position(s), np.column_stack([x, y]), atol=1e-5)


def test_heights_are_those_above_the_plane_that_the_car_stands_on():
    """Uphill they are 0. Behind the crest the road falls by half its length times its change of grade."""
    heights_m = HILLY.height_above_plane(np.array([30.0, 60.0, 90.0]), 20.0)
    assert heights_m == pytest.approx([0.0, 0.0, -0.13 * 30 / 2])


@pytest.mark.parametrize("lateral_m", [1.83, -1.83])
def test_polynomial_touches_the_line_to_third_order(lateral_m):
    pose = VehiclePose(210.0, 0.4, 0.03)
    line = line_polynomial(S_BEND, pose, lateral_m)
    x = np.linspace(-3, 3, 7)
    cubic = (
        line.c0_m + line.c1 * x + line.c2_per_m * x**2 / 2 + line.c3_per_m2 * x**3 / 6
    )
    np.testing.assert_allclose(
        line_lateral(S_BEND, pose, lateral_m, x), cubic, atol=1e-5
    )
    # Without the cubic term the error is larger, so c3 matters.
    assert (
        np.abs(
            line_lateral(S_BEND, pose, lateral_m, x) - cubic + line.c3_per_m2 * x**3 / 6
        ).max()
        > 1e-4
    )


@pytest.mark.parametrize(
    ("pose", "lateral_m"),
    [(VehiclePose(20.0, 0.4, -0.02), 1.6), (VehiclePose(112.0, 0.0, 0.02), -1.6)],
)
def test_lateral_position_in_a_hairpin_is_that_of_the_first_crossing_or_nan(
    pose, lateral_m
):
    s = pose.s_m + np.arange(-5, 60, 1e-3)
    x, y = pose.to_car(HAIRPINS, offset_point(HAIRPINS, s, lateral_m)).T
    got = line_lateral(HAIRPINS, pose, lateral_m, VIDEO_X_M)
    first = [int(np.argmax(x > at)) if (x > at).any() else None for at in VIDEO_X_M]
    turned = np.abs(HAIRPINS.heading(s) - pose.absolute_heading(HAIRPINS)) > np.radians(
        80
    )
    expected = [np.nan if i is None or turned[:i].any() else y[i] for i in first]
    assert np.isnan(expected).any() and np.isfinite(expected).sum() >= 3
    np.testing.assert_allclose(got, expected, atol=6e-3)


@pytest.mark.parametrize(
    ("road", "start_m", "fewest"),
    [
        (HAIRPINS, 112.0, 20),
        (
            RoadGeometry([0.0, 60.0, 100.0], [1 / 200, 1 / 200, -1 / 120], HILLY),
            30.0,
            30,
        ),
        (
            RoadGeometry([0.0, 60.0, 100.0], [1 / 200, 1 / 200, -1 / 120], HILLY),
            75.0,
            30,
        ),
    ],
    ids=["hairpin", "before a crest", "on a crest"],
)
def test_truth_lies_on_the_paint_in_hairpins_and_on_crests(road, start_m, fewest):
    """White lines of a narrow lane, up to where the road turns away or dips behind the crest."""
    drive = small_drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=(1.6, -1.6),
        markings=tuple(
            Marking(lateral, 0.15, WHITE, wear=0.0) for lateral in (1.6, -1.6)
        ),
        surface=Surface(
            (Zone(-100.0, "fresh asphalt"),), right_edge_m=-2.4, left_edge_m=5.4
        ),
        motion=Motion(start_m, 0.0, 0.2, rear_axle_m=1.6),
    )
    frame = render_frame(drive)
    # Paint is blue too, dry grass is not.
    paint = frame.image[..., 2] > 120
    from_paint = cv2.distanceTransform((~paint).astype(np.uint8), cv2.DIST_L2, 5)
    columns = np.array(
        [line_pixels(frame.truth, side, drive.camera_at(0.0)) for side in (0, 1)]
    )
    # Farther lines are narrower than a pixel.
    shown = (columns >= 0) & (H_SAMPLES > 430)
    off_px = from_paint[
        np.broadcast_to(H_SAMPLES, columns.shape)[shown],
        np.rint(columns[shown]).astype(int),
    ]
    assert (
        len(off_px) >= fewest
        and np.quantile(off_px, 0.97) <= 1.0
        and off_px.max() < 2.5
    )


def column_on_ground(ground: Ground, row: int, lateral_m: float) -> float:
    """Column of an image row at which d falls through `lateral_m`, at the nearest such ground; -2 without any."""
    left, right = (
        ground.d[row, cut] - lateral_m for cut in (slice(None, -1), slice(1, None))
    )
    seen = ground.visible[row, :-1] & ground.visible[row, 1:]
    # A larger step is one over a crest.
    crossings = np.flatnonzero((left >= 0) & (right < 0) & (left - right < 0.5) & seen)
    if not len(crossings):
        return NOT_VISIBLE
    at = min(crossings, key=lambda column: ground.distance[row, column])
    return at + left[at] / (left[at] - right[at])


@pytest.mark.parametrize("start_m", [5.0, 20.0])
def test_lines_are_where_the_rays_of_the_pixels_meet_the_ground_and_end_where_a_crest_hides_them(
    start_m,
):
    road, pose = (
        RoadGeometry([0.0, 400.0], [1 / 300, 1 / 300], WAVES),
        VehiclePose(start_m, 0.2),
    )
    truth = lane_truth(road, pose, (1.6, -1.6), time_s=0.0, pitch_rad=0.0)
    ground = cast_on_ground(pixel_rays(DASHCAM), DASHCAM, RoadAhead(road, pose))
    on_ground = ground.top < H_SAMPLES
    for side, lateral_m in enumerate((1.6, -1.6)):
        expected = [
            column_on_ground(ground, row - ground.top, lateral_m)
            for row in H_SAMPLES[on_ground]
        ]
        assert NOT_VISIBLE in expected
        np.testing.assert_allclose(
            line_pixels(truth, side, DASHCAM)[on_ground], expected, atol=0.1
        )
