"""The benchmark suite: names, cached videos, validity of scenes; and its variants."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from simulator.rendering.drive import Drive, SuiteScene
from simulator.rendering.render import render_frame
from simulator.road.truth import H_SAMPLES, Truth, line_pixels, visible_pixels
from simulator.scenes import suite
from simulator.scenes.suite import (
    ROAD_SCALE,
    SUITE,
    WEAR,
    cache_folder,
    render_scene,
    scene_path,
    vary_drive,
)
from tests.simulator.small_drive import largest_difference, weighted_column

WITH_LANE = {
    name: scene for name, scene in SUITE.items() if scene.difficulty != "no lane"
}
# Scopes keep the tests of a scene together, so that it is made once.
SCENES = pytest.mark.parametrize(
    "scene",
    SUITE.values(),
    ids=SUITE,
    scope="module",
)
SCENES_WITH_LANE = pytest.mark.parametrize(
    "scene", WITH_LANE.values(), ids=WITH_LANE, scope="module"
)


@pytest.fixture
def rendered(monkeypatch) -> list[float]:
    """Lengths of the videos that were rendered; they are empty files."""
    seconds: list[float] = []

    def write(path, **options):
        seconds.append(options["seconds"])
        for suffix in (".mp4", ".csv", ".yaml"):
            path.with_suffix(suffix).write_text("")

    monkeypatch.setattr(suite, "write_video", write)
    return seconds


def test_a_scene_is_rendered_once(tmp_path, rendered):
    first = render_scene("motorway", tmp_path)
    again = render_scene("motorway", tmp_path)
    assert first == again
    assert rendered == [10.0]


def test_an_incomplete_scene_is_rendered_again(tmp_path, rendered):
    render_scene("motorway", tmp_path).with_suffix(".yaml").unlink()
    render_scene("motorway", tmp_path)
    assert rendered == [10.0] * 2


def test_a_scene_is_rendered_again_when_the_renderer_changes(
    tmp_path, rendered, monkeypatch
):
    first = render_scene("motorway", tmp_path)
    monkeypatch.setattr(suite, "_renderer_hash", lambda: "changed")
    assert render_scene("motorway", tmp_path) != first
    assert rendered == [10.0] * 2


def test_an_unknown_scene_is_named_with_those_that_exist():
    with pytest.raises(ValueError, match="no scene 'motorwya'.*motorway"):
        render_scene("motorwya")


def test_the_cache_folder_can_be_chosen(tmp_path, monkeypatch):
    monkeypatch.setenv("LANES_CACHE", str(tmp_path))
    assert scene_path("motorway").parent == tmp_path


def test_the_cache_folder_is_outside_of_the_project(monkeypatch):
    monkeypatch.delenv("LANES_CACHE", raising=False)
    assert PROJECT_ROOT not in cache_folder().parents


@lru_cache(maxsize=1)
def drive_of(scene: SuiteScene) -> Drive:
    return scene.drive()


@lru_cache(maxsize=1)
def truths_of(scene: SuiteScene) -> list[Truth]:
    """Truth at nine times from the start to the end."""
    drive = drive_of(scene)
    return [drive.truth(time_s) for time_s in np.linspace(0, scene.seconds, 9)]


@SCENES
def test_a_drive_has_a_lane_exactly_where_its_difficulty_says_so(scene):
    has_lane = {truth.has_lane for truth in truths_of(scene)}
    assert has_lane == {scene.difficulty != "no lane"}


@SCENES
def test_a_drive_covers_more_than_15_m(scene):
    truths = truths_of(scene)
    assert truths[-1].pose.s_m > truths[0].pose.s_m + 15


@SCENES_WITH_LANE
def test_the_car_is_off_the_centre_of_its_lane_but_in_it(scene):
    offsets = [abs(truth.offset_m) for truth in truths_of(scene)]
    assert 0.05 < max(offsets) < 2.0


@SCENES_WITH_LANE
def test_every_drive_has_a_bend(scene):
    curvatures = [abs(truth.curvature_per_m) for truth in truths_of(scene)]
    assert max(curvatures) > 1 / 1000


@SCENES_WITH_LANE
@pytest.mark.parametrize("side", [0, 1])
def test_every_line_is_known_5_m_ahead(scene, side):
    for truth in truths_of(scene):
        (lateral_m,) = truth.line_y(side, np.array([5.0]))
        assert np.isfinite(lateral_m)


def stripe_centres(drive: Drive) -> np.ndarray:
    edges = [edge for marking in drive.markings for edge in marking.stripes]
    return np.mean(edges, axis=1)


@SCENES_WITH_LANE
def test_every_line_is_a_stripe(scene):
    drive = drive_of(scene)
    stripes = stripe_centres(drive)
    for line_m in drive.truth(0.0).laterals_m:
        assert np.abs(stripes - line_m).min() < 0.02


@SCENES_WITH_LANE
def test_the_inner_stripe_of_a_double_line_bounds_the_lane(scene):
    drive = drive_of(scene)
    stripes = stripe_centres(drive)
    left_m, right_m = drive.truth(0.0).laterals_m
    in_lane = stripes[(right_m + 0.02 < stripes) & (stripes < left_m - 0.02)]
    for line_m in (left_m, right_m):
        assert not (np.abs(in_lane - line_m) < 0.3).any()


def paint_offsets_px(
    drive: Drive,
    time_s: float,
) -> list[list[float]]:
    """Distances, for each line, of its paint from the true columns.

    The paint is what changes in the picture without its lane lines, where nothing hides
    them.
    """
    frame = render_frame(drive, time_s)
    bare = render_frame(replace(drive, markings=()), time_s)
    paint = largest_difference(frame.image, bare.image)
    offsets: list[list[float]] = [[], []]
    for side in (0, 1):
        columns = line_pixels(frame.truth, side, drive.camera_at(time_s))
        columns = visible_pixels(columns, frame.hidden)
        for row, u in zip(H_SAMPLES, columns, strict=True):
            column = round(float(u))
            at = np.arange(column - 25, column + 26)
            inside = u > 30 and at[-1] < drive.camera.width
            if not inside or row <= 450 or paint[row, at].max() <= 20:
                continue
            centre = weighted_column(paint[row, at] - 10, at)
            offsets[side].append(centre - u)
    return offsets


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-lane", "rain", "wet-night", "lorry"])
def test_in_any_weather_paint_is_in_the_picture_where_the_truth_says(name):
    drive = replace(SUITE[name].drive(), bonnet=False)
    left_px, right_px = paint_offsets_px(drive, 1.0)
    assert len(left_px) >= 4
    assert len(left_px + right_px) >= 8
    assert np.median(np.abs(left_px + right_px)) < 0.5
    assert np.abs(np.median(left_px)) < 0.5


@pytest.fixture(scope="module")
def hairpin() -> Drive:
    return SUITE["hairpin-right"].drive()


def test_variant_zero_is_the_drive_itself(hairpin):
    assert vary_drive(hairpin, 0) is hairpin


@pytest.mark.parametrize("part", ["motion", "lens", "seed"])
def test_a_variant_is_the_same_each_time(hairpin, part):
    first = vary_drive(hairpin, 1)
    again = vary_drive(hairpin, 1)
    assert getattr(first, part) == getattr(again, part)


def test_the_camera_of_a_variant_is_the_same_each_time(hairpin):
    assert vary_drive(hairpin, 1).camera.pose == vary_drive(hairpin, 1).camera.pose


def test_two_variants_differ(hairpin):
    first = vary_drive(hairpin, 1)
    other = vary_drive(hairpin, 2)
    assert first.motion != other.motion
    assert first.camera.pose != other.camera.pose
    assert len({hairpin.seed, first.seed, other.seed}) == 3


@pytest.fixture(scope="module")
def crests() -> Drive:
    return SUITE["crests"].drive()


@pytest.fixture(scope="module")
def varied_crests(crests) -> Drive:
    return vary_drive(crests, 3)


def test_the_road_of_a_variant_is_scaled_in_plan(crests, varied_crests):
    road = crests.road
    varied = varied_crests.road
    scale = varied.stations_m[-1] / road.stations_m[-1]
    low, high = ROAD_SCALE
    assert low <= scale <= high
    assert scale != 1
    np.testing.assert_allclose(varied.values * scale, road.values)
    # The same bend, enlarged: the angle does not change.
    angle = float(road.heading(60.0))
    assert varied.heading(60.0 * scale) == pytest.approx(angle)


def test_the_road_of_a_variant_keeps_its_slopes(crests, varied_crests):
    slopes = varied_crests.road.profile.values
    np.testing.assert_allclose(slopes, crests.road.profile.values)


def test_the_wear_of_each_line_varies(crests, varied_crests):
    wear = []
    for new, old in zip(varied_crests.markings, crests.markings, strict=True):
        wear.append(new.wear / old.wear)
    low, high = WEAR
    assert low <= min(wear)
    assert max(wear) <= high
    assert len(set(wear)) == len(wear)
