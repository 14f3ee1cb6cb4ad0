"""Hairpins, crests, changes of lane and roads without lanes: where places are, and what the truth says of them."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from lanes.io.telemetry import read_telemetry
from simulator.landscape.sky import BackdropStyle
from simulator.light.lens import Lens
from simulator.light.sunlight import Sun
from simulator.objects.placement import PlacedObject
from simulator.objects.scene_objects import Car
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import RoadGeometry, VehiclePose, line_lateral, offset_point, surface_points
from simulator.road.ground import cast_on_ground, pixel_rays
from simulator.road.painted_lines import WHITE, Marking, paint_coverage
from simulator.road.profile import HeightProfile
from simulator.road.road_ahead import RoadAhead
from simulator.road.surface import Surface, Zone
from simulator.road.symbols import Symbol, symbol_coverage
from simulator.road.truth import (
    NOT_VISIBLE,
    VIDEO_X_M,
    lane_truth,
    line_pixels,
    truth_entry,
    truth_row,
    write_truth_csv,
)
from simulator.scenes.dashcam import DASHCAM

SMALL = DASHCAM.scaled((640, 360))
STATIONS = [0.0, 30.0, 40.0, 85.0, 95.0, 120.0, 130.0, 165.0, 200.0]
HAIRPINS = RoadGeometry(STATIONS, [0.0, 0.0, 1 / 20, 1 / 20, 0.0, 0.0, -1 / 16, -1 / 16, 0.0])
# Uphill 9 %, over a crest of R 230 m, down, and through a dip.
HILLY = HeightProfile([0.0, 60.0, 90.0, 110.0, 140.0], [0.09, 0.09, -0.04, -0.04, 0.06])


def test_height_is_the_integral_of_the_slope():
    s = np.linspace(-20, 160, 180_001)
    summed = np.concatenate([[0], np.cumsum(HILLY.slope((s[1:] + s[:-1]) / 2) * np.diff(s))])
    np.testing.assert_allclose(HILLY.height(s), summed - np.interp(0, s, summed), atol=1e-9)
    # What a car sees of a crest 30 m ahead whose slope changes by 0.065 on the way: the parabola falls away.
    assert HILLY.height_above_plane(75.0, 60.0) == pytest.approx(-0.5 * 0.13 / 30 * 15**2)
    assert HeightProfile([5.0], [0.07]).height_above_plane(80.0, 20.0) == pytest.approx(0)


@pytest.mark.parametrize(
    "pose",
    [VehiclePose(20.0, 0.4, -0.02), VehiclePose(60.0, -0.3, -0.07), VehiclePose(112.0), VehiclePose(150.0, 0.2, 0.1)],
)
def test_places_in_hairpins_are_found_again(pose):
    """Points up to the edges of a two-lane road, all the way that the next bend does not cover."""
    s, d = (a.ravel() for a in np.meshgrid(np.linspace(-5, 70, 600), np.linspace(-3, 6, 25)))
    points = pose.to_car(HAIRPINS, offset_point(HAIRPINS, pose.s_m + s, d)).astype(np.float32)
    got_s, got_d = RoadAhead(HAIRPINS, pose).locate(*points.T)
    np.testing.assert_allclose(got_d, d, atol=4e-3)
    np.testing.assert_allclose(got_s, s, atol=1e-2)


@pytest.mark.parametrize("profile", [HILLY, HeightProfile([0.0, 80.0, 100.0], [0.0, 0.0, 0.12])])
@pytest.mark.parametrize("s_m", [45.0, 70.0, 84.0])
def test_rays_end_on_the_first_ground_that_they_meet(profile, s_m):
    road = RoadGeometry([0.0, 100.0], [1 / 90, 1 / 90], profile)
    ahead = RoadAhead(road, VehiclePose(s_m, 0.3, 0.01))
    rays = pixel_rays(SMALL) @ SMALL.pose.rotation().astype(np.float32)
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, ahead)
    seen = ground.visible & (ground.distance < 80)
    points = np.column_stack([ground.x[seen], ground.y[seen]])
    ray = rays[ground.top :][seen].astype(float)
    height = SMALL.pose.height_m + ray[:, 2] / ray[:, 0] * points[:, 0]
    off = np.abs(ahead.lift_to_surface(points)[:, 2] - height)
    # Only where a ray grazes a crest is it a matter of pixels which side it meets.
    assert np.quantile(off, 0.995) < 2e-3
    for got, looked_up in zip((ground.s, ground.d), ahead.locate(ground.x, ground.y), strict=True):
        np.testing.assert_allclose(got[seen], looked_up[seen], atol=1e-3)
    before = np.linspace(0.05, 0.97, 40)[:, None, None] * np.column_stack([points, height - SMALL.pose.height_m])[::97]
    surface = ahead.lift_to_surface(before[..., :2].reshape(-1, 2))[:, 2]
    assert (before[..., 2].ravel() + SMALL.pose.height_m - surface).min() > -0.01


def test_level_slope_looks_like_level_ground():
    ramp = RoadGeometry([0.0, 300.0], [1 / 200, 1 / 200], HeightProfile([0.0, 300.0], [0.08, 0.08]))
    assert np.abs(surface_points(ramp, VehiclePose(20.0), np.linspace(0, 90, 10), 1.5)[:, 2]).max() < 1e-12


@pytest.mark.parametrize(
    ("pose", "lateral_m"), [(VehiclePose(20.0, 0.4, -0.02), 1.6), (VehiclePose(112.0, 0.0, 0.02), -1.6)]
)
def test_lateral_place_in_a_hairpin_is_that_of_the_first_passage_or_none(pose, lateral_m):
    s = pose.s_m + np.arange(-5, 60, 1e-3)
    x, y = pose.to_car(HAIRPINS, offset_point(HAIRPINS, s, lateral_m)).T
    got = line_lateral(HAIRPINS, pose, lateral_m, VIDEO_X_M)
    first = [int(np.argmax(x > at)) if (x > at).any() else None for at in VIDEO_X_M]
    turned = np.abs(HAIRPINS.heading(s) - pose.absolute_heading(HAIRPINS)) > np.radians(80)
    expected = [np.nan if i is None or turned[:i].any() else y[i] for i in first]
    assert np.isnan(expected).any() and np.isfinite(expected).sum() >= 3
    np.testing.assert_allclose(got, expected, atol=6e-3)


def test_a_change_of_lane_renames_the_lines_when_the_middle_of_the_car_crosses():
    motion = Motion(0.0, 25.0, 0.2, shift_m=-3.6, shift_start_s=1.0, shift_seconds=3.0)
    lines = (1.8, -1.8, -5.4)
    road = RoadGeometry([0.0, 300.0], [1 / 800, 1 / 800])
    times = np.arange(0, 5, 0.04)
    truths = [lane_truth(road, motion.pose(t), lines, time_s=t, pitch_rad=0.0) for t in times]
    offsets = np.array([t.offset_m for t in truths])
    jumps = np.flatnonzero(np.abs(np.diff(offsets)) > 1)
    assert len(jumps) == 1
    before, after = truths[jumps[0]], truths[jumps[0] + 1]
    assert before.laterals_m == (1.8, -1.8) and after.laterals_m == (-1.8, -5.4)
    # The right line becomes the left one: same paint, other name.
    assert before.right.c0_m == pytest.approx(after.left.c0_m, abs=0.1)
    assert offsets[0] == pytest.approx(0.2) and offsets[-1] == pytest.approx(0.2)
    # The heading is the slope of the path.
    lateral = [motion.pose(t).lateral_m for t in (1.99, 2.01)]
    assert np.tan(motion.pose(2.0).heading_rad) == pytest.approx((lateral[1] - lateral[0]) / 0.02 / 25, rel=1e-3)


def test_a_road_without_a_lane_has_rows_that_say_so(tmp_path):
    truth = lane_truth(HAIRPINS, VehiclePose(10.0, 0.5, 0.1), (), time_s=0.4, pitch_rad=0.02)
    assert not truth.has_lane
    assert (line_pixels(truth, 0, SMALL) == NOT_VISIBLE).all()
    write_truth_csv(tmp_path / "a.csv", [truth_row(truth, frame=0), truth_row(truth, frame=1)])
    table = read_telemetry(tmp_path / "a.csv")
    assert table["frame"].tolist() == [0, 1] and table["pitch_rad"].tolist() == [0.02, 0.02]
    missing = {name for name, values in table.items() if np.isnan(values).all()}
    assert set(table) - missing == {"frame", "time_s", "pitch_rad"}
    entry = truth_entry(truth, raw_file="a.jpg", camera=SMALL, hidden=np.zeros((360, 640), bool))
    assert "NaN" not in json.dumps(entry)
    assert entry["offset_m"] is None and set(entry["left_y_m"]) == {None}


def test_speed_knots_give_the_way_between_them():
    motion = Motion(5.0, 12.0, later_speeds=((2.0, 6.0), (4.0, 6.0)))
    assert [motion.pose(t).s_m for t in (0.0, 1.0, 2.0, 3.0, 5.0)] == pytest.approx([5.0, 15.5, 23.0, 29.0, 41.0])
    assert replace(motion, later_speeds=()).pose(3.0).s_m == 41.0


def painted_drive(road: RoadGeometry, start_m: float, **parts) -> Drive:
    """White lines only, no wear, no noise; small pictures, because only places matter."""
    surface = Surface((Zone(-100.0, "fresh asphalt"),), right_edge_m=-2.4, left_edge_m=5.4)
    drive = Drive(
        camera=SMALL,
        road=road,
        line_laterals_m=(1.6, -1.6),
        markings=tuple(Marking(lateral, 0.15, WHITE, wear=0.0) for lateral in (1.6, -1.6)),
        surface=surface,
        sun=Sun(1.0, 0.9),
        motion=Motion(start_m, 0.0, 0.2, rear_axle_m=1.6),
        lens=Lens(noise=0.0, sharpening=0.0, blur_px=0.0, vignette=0.0, adaptation=0.0),
        backdrop=BackdropStyle(tree_density=0.0),
        bonnet=False,
        seed=7,
    )
    return replace(drive, **parts)


@pytest.mark.parametrize(
    ("road", "start_m"),
    [
        (HAIRPINS, 22.0),
        (HAIRPINS, 112.0),
        (RoadGeometry([0.0, 60.0, 100.0], [1 / 200, 1 / 200, -1 / 120], HILLY), 30.0),
        (RoadGeometry([0.0, 60.0, 100.0], [1 / 200, 1 / 200, -1 / 120], HILLY), 105.0),
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
        # Not what the crest hides, and nothing outside the picture.
        rising = np.minimum.accumulate(np.nan_to_num(pixels[:, 1], nan=1e9)) > pixels[:, 1] - 0.5
        inside = rising & (pixels > [2, 215]).all(axis=1) & (pixels < [637, 357]).all(axis=1)
        columns, rows = np.rint(pixels[inside]).astype(int).T
        off += list(from_paint[rows, columns])
    assert len(off) > 60
    assert np.quantile(off, 0.97) <= 1.0 and max(off) < 2.5


def test_a_crest_hides_what_stands_behind_it():
    road = RoadGeometry([0.0, 200.0], [0.0, 0.0], HeightProfile([0.0, 40.0, 60.0], [0.08, 0.08, -0.10]))
    ahead = RoadAhead(road, VehiclePose(20.0))
    crest_distance_m = ahead.crest_distance_m(SMALL.pose.height_m)
    assert 25 < crest_distance_m < 45
    assert (
        RoadAhead(replace(road, profile=HeightProfile([0.0], [0.05])), VehiclePose(20.0)).crest_distance_m(1.3)
        == np.inf
    )
    bare = render_frame(painted_drive(road, 20.0)).image
    for s_m, changes in ((20.0 + 0.7 * crest_distance_m, True), (20.0 + crest_distance_m + 45.0, False)):
        item = PlacedObject(s_m, 0.4, Car(0, 0, 0.0, "red"))
        picture = render_frame(painted_drive(road, 20.0, objects=(item,))).image
        assert (np.abs(picture.astype(int) - bare).max() > 60) == changes


def test_painted_stencils_cover_their_area_where_they_are():
    """A diamond 3.7 m by 1 m with a stroke of 24 % of its half: seen from above its area is known."""
    road, pose = RoadGeometry([0.0, 200.0], [1 / 150, 1 / 150]), VehiclePose(50.0, 0.3)
    ground = cast_on_ground(pixel_rays(DASHCAM), DASHCAM, RoadAhead(road, pose))
    pixels, coverage = symbol_coverage(Symbol(58.0, -0.4, "diamond", 3.7, 1.0), ground, station_m=50.0)
    s, d = ground.s.ravel()[pixels], ground.d.ravel()[pixels]
    area = np.abs(ground.s_u * ground.d_v - ground.s_v * ground.d_u).ravel()[pixels]
    assert (coverage * area).sum() == pytest.approx(0.5 * 3.7 * (1 - (1 - 2 * 0.24) ** 2), rel=0.04)
    assert np.average(s, weights=coverage * area) == pytest.approx(58.0 - 50.0 + 3.7 / 2, abs=0.05)
    assert np.average(d, weights=coverage * area) == pytest.approx(-0.4, abs=0.02)


def test_botts_dots_missing_stretches_and_skew_lines_are_where_they_should_be():
    road, pose = RoadGeometry([0.0, 200.0], [0.0, 0.0]), VehiclePose(50.0, 0.1)
    ground = cast_on_ground(pixel_rays(DASHCAM), DASHCAM, RoadAhead(road, pose))
    places = (ground.s.ravel(), ground.d.ravel())

    def painted(**options):
        pixels, coverage = paint_coverage(Marking(-1.5, 0.10, wear=0.0, **options), ground, station_m=50.0)
        return [place[pixels[coverage > 0.5]] for place in places]

    s, _ = painted(dashed=True, botts=True, phase_m=56.0)
    near = np.sort(s[s < 10])
    groups = np.split(near, np.flatnonzero(np.diff(near) > 0.4) + 1)
    assert [group.mean() for group in groups] == pytest.approx([6.08 + k * 0.914 for k in range(4)], abs=0.04)
    s, _ = painted(start_m=58.0, end_m=64.0)
    assert (s.min(), s.max()) == pytest.approx((8.0, 14.0), abs=0.1)
    s, d = painted(slope=0.05, start_m=55.0)
    np.testing.assert_allclose(d, -1.5 + 0.05 * (s - 5.0), atol=0.08)
