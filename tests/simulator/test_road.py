"""Roads, also hairpins and crests: clothoids, road coordinates, ray casting, ground truth, occlusion by crests."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import (
    HeightProfile,
    RoadGeometry,
    VehiclePose,
    line_lateral,
    line_polynomial,
    offset_point,
    surface_points,
)
from simulator.road.ground import cast_on_ground, pixel_rays
from simulator.road.markings import WHITE, Marking
from simulator.road.road_ahead import RoadAhead
from simulator.road.surface import Surface, Zone
from simulator.road.truth import VIDEO_X_M
from simulator.scenes.dashcam import DASHCAM
from tests.simulator.small_drive import small_drive

SMALL = DASHCAM.scaled((640, 360))
S_BEND = RoadGeometry([0.0, 75.0, 125.0, 175.0, 255.0, 330.0], [0.0, 0.0, 1 / 300, 1 / 300, -1 / 200, -1 / 200])
STATIONS = [0.0, 30.0, 40.0, 85.0, 95.0, 120.0, 130.0, 165.0, 200.0]
HAIRPINS = RoadGeometry(STATIONS, [0.0, 0.0, 1 / 20, 1 / 20, 0.0, 0.0, -1 / 16, -1 / 16, 0.0])
# Uphill 9 %, over a crest of R 230 m, down, and through a dip.
HILLY = HeightProfile([0.0, 60.0, 90.0, 110.0, 140.0], [0.09, 0.09, -0.04, -0.04, 0.06])


def test_heading_and_position_are_the_integrals_of_curvature():
    s = np.linspace(0, 330, 330_001)
    curvature = np.interp(s, S_BEND.stations_m, S_BEND.values)
    step = s[1]
    heading = np.concatenate([[0], np.cumsum((curvature[1:] + curvature[:-1]) / 2 * step)])
    middle = (heading[1:] + heading[:-1]) / 2
    x = np.concatenate([[0], np.cumsum(np.cos(middle) * step)])
    y = np.concatenate([[0], np.cumsum(np.sin(middle) * step)])
    np.testing.assert_allclose(S_BEND.heading(s), heading, atol=1e-9)
    np.testing.assert_allclose(S_BEND.position(s), np.column_stack([x, y]), atol=1e-6)


@pytest.mark.parametrize("lateral_m", [1.83, -1.83])
def test_polynomial_touches_the_line_to_third_order(lateral_m):
    pose = VehiclePose(210.0, 0.4, 0.03)
    line = line_polynomial(S_BEND, pose, lateral_m)
    x = np.linspace(-3, 3, 7)
    cubic = line.c0_m + line.c1 * x + line.c2_per_m * x**2 / 2 + line.c3_per_m2 * x**3 / 6
    np.testing.assert_allclose(line_lateral(S_BEND, pose, lateral_m, x), cubic, atol=1e-5)
    # Without the cubic term the error is larger, so c3 matters.
    assert np.abs(line_lateral(S_BEND, pose, lateral_m, x) - cubic + line.c3_per_m2 * x**3 / 6).max() > 1e-4


@pytest.mark.parametrize(
    ("road", "pose", "ahead_m", "lateral_m", "within_m"),
    [
        (S_BEND, VehiclePose(60.0, 0.4, -0.05), (0, 120), (-15, 15), 1e-3),
        (HAIRPINS, VehiclePose(20.0, 0.4, -0.02), (-5, 70), (-3, 6), 4e-3),
        (HAIRPINS, VehiclePose(150.0, 0.2, 0.1), (-5, 70), (-3, 6), 4e-3),
    ],
)
def test_points_get_their_road_coordinates(road, pose, ahead_m, lateral_m, within_m):
    """Those of a hairpin are up to the edges of a two-lane road, as far as the next bend does not overlap."""
    s, d = (a.ravel() for a in np.meshgrid(np.linspace(*ahead_m, 600), np.linspace(*lateral_m, 25)))
    points = pose.to_car(road, offset_point(road, pose.s_m + s, d)).astype(np.float32)
    got_s, got_d = RoadAhead(road, pose).locate(*points.T)
    np.testing.assert_allclose(got_d, d, atol=within_m)
    np.testing.assert_allclose(got_s, s, atol=2.5 * within_m)


@pytest.mark.parametrize(
    ("profile", "s_m"), [(HILLY, 45.0), (HILLY, 84.0), (HeightProfile([0.0, 80.0, 100.0], [0.0, 0.0, 0.12]), 70.0)]
)
def test_rays_end_at_their_first_intersection_with_the_ground(profile, s_m):
    road = RoadGeometry([0.0, 100.0], [1 / 90, 1 / 90], profile)
    ahead = RoadAhead(road, VehiclePose(s_m, 0.3, 0.01))
    rays = pixel_rays(SMALL) @ SMALL.pose.rotation.astype(np.float32)
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, ahead)
    seen = ground.visible & (ground.distance < 80)
    points = np.column_stack([ground.x[seen], ground.y[seen]])
    ray = rays[ground.top :][seen].astype(float)
    height = SMALL.pose.height_m + ray[:, 2] / ray[:, 0] * points[:, 0]
    off = np.abs(ahead.lift_to_surface(points)[:, 2] - height)
    # Rays that graze a crest can hit either side of it.
    assert np.quantile(off, 0.995) < 2e-3
    for got, looked_up in zip((ground.s, ground.d), ahead.locate(ground.x, ground.y), strict=True):
        np.testing.assert_allclose(got[seen], looked_up[seen], atol=1e-3)
    before = np.linspace(0.05, 0.97, 40)[:, None, None] * np.column_stack([points, height - SMALL.pose.height_m])[::97]
    surface = ahead.lift_to_surface(before[..., :2].reshape(-1, 2))[:, 2]
    assert (before[..., 2].ravel() + SMALL.pose.height_m - surface).min() > -0.01


@pytest.mark.parametrize(
    ("pose", "lateral_m"), [(VehiclePose(20.0, 0.4, -0.02), 1.6), (VehiclePose(112.0, 0.0, 0.02), -1.6)]
)
def test_lateral_position_in_a_hairpin_is_that_of_the_first_crossing_or_nan(pose, lateral_m):
    s = pose.s_m + np.arange(-5, 60, 1e-3)
    x, y = pose.to_car(HAIRPINS, offset_point(HAIRPINS, s, lateral_m)).T
    got = line_lateral(HAIRPINS, pose, lateral_m, VIDEO_X_M)
    first = [int(np.argmax(x > at)) if (x > at).any() else None for at in VIDEO_X_M]
    turned = np.abs(HAIRPINS.heading(s) - pose.absolute_heading(HAIRPINS)) > np.radians(80)
    expected = [np.nan if i is None or turned[:i].any() else y[i] for i in first]
    assert np.isnan(expected).any() and np.isfinite(expected).sum() >= 3
    np.testing.assert_allclose(got, expected, atol=6e-3)


def painted_drive(road: RoadGeometry, start_m: float, **changes) -> Drive:
    """White lines of a narrow lane; `changes` are fields of Drive."""
    return small_drive(
        camera=SMALL,
        road=road,
        line_laterals_m=(1.6, -1.6),
        markings=tuple(Marking(lateral, 0.15, WHITE, wear=0.0) for lateral in (1.6, -1.6)),
        surface=Surface((Zone(-100.0, "fresh asphalt"),), right_edge_m=-2.4, left_edge_m=5.4),
        motion=Motion(start_m, 0.0, 0.2, rear_axle_m=1.6),
        **changes,
    )


@pytest.mark.parametrize(
    ("road", "start_m"),
    [
        (HAIRPINS, 112.0),
        (RoadGeometry([0.0, 60.0, 100.0], [1 / 200, 1 / 200, -1 / 120], HILLY), 30.0),
    ],
)
def test_truth_lies_on_the_paint_in_hairpins_and_on_crests(road, start_m):
    drive = painted_drive(road, start_m)
    frame = render_frame(drive)
    # Paint is blue too, dry grass is not.
    paint = frame.image[..., 2] > 120
    from_paint = cv2.distanceTransform((~paint).astype(np.uint8), cv2.DIST_L2, 5)
    off = []
    for side in (0, 1):
        points = surface_points(
            road, frame.truth.pose, start_m + np.arange(2.5, 26.0, 0.2), frame.truth.laterals_m[side]
        )
        pixels = drive.camera_at(0.0).road_to_pixels(points)
        # Only points in the image that no crest hides.
        rising = np.minimum.accumulate(np.nan_to_num(pixels[:, 1], nan=1e9)) > pixels[:, 1] - 0.5
        inside = rising & (pixels > [2, 215]).all(axis=1) & (pixels < [637, 357]).all(axis=1)
        columns, rows = np.rint(pixels[inside]).astype(int).T
        off += list(from_paint[rows, columns])
    assert len(off) > 60
    assert np.quantile(off, 0.97) <= 1.0 and max(off) < 2.5
