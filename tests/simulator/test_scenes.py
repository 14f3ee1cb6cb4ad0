"""The benchmark suite: names, cached videos, validity of every scene; and its variants."""

from dataclasses import replace

import numpy as np
import pytest

from benchmark.evaluation import PROJECT_ROOT
from simulator.rendering.render import render_frame
from simulator.road.truth import H_SAMPLES, line_pixels, visible_pixels
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


def test_a_scene_is_rendered_once_and_again_when_the_renderer_changes(
    tmp_path, monkeypatch
):
    calls = []

    def write(path, **options):
        calls.append(options["seconds"])
        for suffix in (".mp4", ".csv", ".yaml"):
            path.with_suffix(suffix).write_text("")

    monkeypatch.setattr(suite, "write_video", write)
    first, again = (
        render_scene("motorway", tmp_path),
        render_scene("motorway", tmp_path),
    )
    assert first == again and calls == [10.0]
    first.with_suffix(".yaml").unlink()
    render_scene("motorway", tmp_path)
    monkeypatch.setattr(suite, "_renderer_hash", lambda: "changed")
    assert render_scene("motorway", tmp_path) != first
    assert calls == [10.0] * 3
    with pytest.raises(ValueError, match="no scene 'motorwya'.*motorway"):
        render_scene("motorwya")
    monkeypatch.setenv("LANES_CACHE", str(tmp_path))
    assert scene_path("motorway").parent == tmp_path
    monkeypatch.delenv("LANES_CACHE")
    assert PROJECT_ROOT not in cache_folder().parents


@pytest.mark.parametrize("scene", SUITE.values(), ids=SUITE)
def test_every_drive_has_a_lane_between_stripes_exactly_where_its_difficulty_says_so(
    scene,
):
    """The inner stripe of a double line bounds the lane."""
    drive = scene.drive()
    truths = [drive.truth(t) for t in np.linspace(0, scene.seconds, 9)]
    assert {truth.has_lane for truth in truths} == {scene.difficulty != "no lane"}
    assert truths[-1].pose.s_m > truths[0].pose.s_m + 15
    if scene.difficulty == "no lane":
        return
    assert 0.05 < max(abs(t.offset_m) for t in truths) < 2.0
    assert max(abs(t.curvature_per_m) for t in truths) > 1 / 1000
    assert all(
        np.isfinite(t.line_y(side, np.array([5.0]))).all()
        for t in truths
        for side in (0, 1)
    )
    middles = [
        (low + high) / 2 for marking in drive.markings for low, high in marking.stripes
    ]
    left, right = drive.truth(0.0).laterals_m
    for line in (left, right):
        assert min(abs(line - middle) for middle in middles) < 0.02
        assert not any(
            right + 0.02 < middle < left - 0.02 and abs(middle - line) < 0.3
            for middle in middles
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-lane", "rain", "wet-night", "lorry"])
def test_in_any_weather_paint_is_in_the_picture_where_the_truth_says(name):
    """What changes in the picture without its lane lines is centred on the true columns, where nothing hides them."""
    drive = replace(SUITE[name].drive(), bonnet=False)
    frame, bare = (render_frame(d, 1.0) for d in (drive, replace(drive, markings=())))
    paint = np.abs(frame.image.astype(float) - bare.image).max(axis=2)
    off = {0: [], 1: []}
    for side in (0, 1):
        columns = visible_pixels(
            line_pixels(frame.truth, side, drive.camera_at(1.0)), frame.hidden
        )
        for row, u in zip(H_SAMPLES, columns, strict=True):
            at = np.arange(round(float(u)) - 25, round(float(u)) + 26)
            if (
                u > 30
                and row > 450
                and at[-1] < drive.camera.width
                and paint[row, at].max() > 20
            ):
                weight = np.clip(paint[row, at] - 10, 0, None)
                off[side].append((weight * at).sum() / weight.sum() - u)
    assert len(off[0]) >= 4 and len(off[0] + off[1]) >= 8
    assert np.median(np.abs(off[0] + off[1])) < 0.5 and np.abs(np.median(off[0])) < 0.5


def test_a_variant_is_the_same_each_time_and_differs_from_the_others_and_variant_zero_is_the_drive_itself():
    drive = SUITE["hairpin-right"].drive()
    assert vary_drive(drive, 0) is drive
    first, again, other = (vary_drive(drive, seed) for seed in (1, 1, 2))
    assert (
        first.motion == again.motion
        and first.camera.pose == again.camera.pose
        and first.lens == again.lens
    )
    assert first.motion != other.motion and first.camera.pose != other.camera.pose
    assert len({drive.seed, first.seed, other.seed}) == 3


def test_a_road_is_scaled_in_plan_and_keeps_its_slopes_and_its_paint_varies():
    drive = SUITE["crests"].drive()
    varied = vary_drive(drive, 3)
    scale = varied.road.stations_m[-1] / drive.road.stations_m[-1]
    low, high = ROAD_SCALE
    assert low <= scale <= high and scale != 1
    np.testing.assert_allclose(varied.road.values * scale, drive.road.values)
    np.testing.assert_allclose(varied.road.profile.values, drive.road.profile.values)
    # the same bend, enlarged: the angle does not change
    assert varied.road.heading(60.0 * scale) == pytest.approx(
        float(drive.road.heading(60.0))
    )
    wear = [
        new.wear / old.wear
        for new, old in zip(varied.markings, drive.markings, strict=True)
    ]
    low, high = WEAR
    assert low <= min(wear) <= max(wear) <= high and len(np.unique(wear)) == len(wear)
