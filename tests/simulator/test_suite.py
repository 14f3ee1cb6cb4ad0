"""The suite of hard roads: its names, and the cache of what is rendered."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmark.dataset import PROJECT_ROOT
from lanes.camera.camera import undistort
from lanes.io.disk_cache import cache_folder, cached_array
from lanes.io.processes import map_ordered
from simulator.objects.bonnet import bonnet_outline
from simulator.rendering.render import render_frame
from simulator.scenes import suite
from simulator.scenes.scene import SuiteScene
from simulator.scenes.suite import SUITE, render_scene, scene_path


def test_every_scene_is_found_under_its_own_name():
    assert all(
        scene.name == name and scene.seconds > 1 and scene.description.endswith(".") for name, scene in SUITE.items()
    )
    assert SUITE["motorway"].difficulty == "clean"


def test_a_scene_is_rendered_once_and_again_when_the_renderer_changes(tmp_path, monkeypatch):
    calls = []

    def write(path, **options):
        calls.append(options["seconds"])
        for suffix in (".mp4", ".csv", ".yaml"):
            path.with_suffix(suffix).write_text("")

    monkeypatch.setattr(suite, "write_video", write)
    first, again = render_scene("motorway", tmp_path), render_scene("motorway", tmp_path)
    assert first == again and calls == [10.0]
    first.with_suffix(".yaml").unlink()
    render_scene("motorway", tmp_path)
    monkeypatch.setattr(suite, "_renderer_hash", lambda: "changed")
    assert render_scene("motorway", tmp_path) != first
    assert calls == [10.0] * 3


def test_the_cache_is_outside_the_project_and_can_be_named(tmp_path, monkeypatch):
    monkeypatch.delenv("LANES_CACHE", raising=False)
    assert PROJECT_ROOT not in cache_folder().parents
    monkeypatch.setenv("LANES_CACHE", str(tmp_path))
    assert scene_path("motorway").parent == tmp_path
    assert scene_path("motorway", tmp_path / "own").parent == tmp_path / "own"


def test_refuses_unknown_scenes_by_name():
    with pytest.raises(ValueError, match="no scene 'motorwya'.*motorway"):
        render_scene("motorwya")
    with pytest.raises(ValueError, match="Wet Night"):
        SuiteScene("Wet Night", "hard", 3.0, "Rain.", lambda: None)
    with pytest.raises(ValueError, match="'tough'"):
        SuiteScene("night", "tough", 3.0, "Rain.", lambda: None)


@pytest.mark.parametrize("scene", SUITE.values(), ids=SUITE)
def test_every_drive_has_a_lane_exactly_where_its_difficulty_says_so(scene):
    """And stays on its road, off the middle, with a bend or a shift somewhere."""
    drive = scene.drive()
    truths = [drive.truth(t) for t in np.linspace(0, scene.seconds, 9)]
    assert {truth.has_lane for truth in truths} == {scene.difficulty != "no lane"}
    if scene.difficulty != "no lane":
        assert max(abs(t.offset_m) for t in truths) > 0.05 and max(abs(t.offset_m) for t in truths) < 2.0
        assert max(abs(t.curvature_per_m) for t in truths) > 1 / 1000
        assert all(np.isfinite(t.line_y(side, np.array([5.0]))).all() for t in truths for side in (0, 1))
    assert truths[-1].pose.s_m > truths[0].pose.s_m + 15


@pytest.mark.parametrize("scene", SUITE.values(), ids=SUITE)
def test_the_lines_of_a_lane_are_the_middles_of_stripes(scene):
    """Of a double line the stripe beside the lane bounds it: where both stripes bound lanes, only the nearer does."""
    drive = scene.drive()
    middles = [(low + high) / 2 for marking in drive.markings for low, high in marking.stripes]
    left, right = drive.truth(0.0).laterals_m
    for line in (left, right) if drive.line_laterals_m else ():
        assert min(abs(line - middle) for middle in middles) < 0.02
        assert not any(right + 0.02 < middle < left - 0.02 and abs(middle - line) < 0.3 for middle in middles)


def test_what_is_kept_is_made_once_and_a_broken_cache_is_done_without(monkeypatch, tmp_path):
    made, expected = [], np.arange(6.0).reshape(2, 3)

    def make() -> np.ndarray:
        made.append(1)
        return expected

    monkeypatch.setenv("LANES_CACHE", str(tmp_path / "cache"))
    source = tmp_path / "source.py"
    source.write_text("a = 1")
    for _ in range(2):
        np.testing.assert_array_equal(cached_array("things/a", [source], make), expected)
        assert len(made) == 1
    (file,) = (tmp_path / "cache" / "things").iterdir()
    file.write_bytes(file.read_bytes()[:90])
    np.testing.assert_array_equal(cached_array("things/a", [source], make), expected)
    source.write_text("a = 2")
    cached_array("things/a", [source], make)
    assert len(made) == 3
    (tmp_path / "no folder").write_text("")
    monkeypatch.setenv("LANES_CACHE", str(tmp_path / "no folder"))
    np.testing.assert_array_equal(cached_array("things/a", [source], make), expected)


def keep_slowly(number: int) -> tuple[int, float]:
    """What three processes want at once; says who made it."""
    made = []

    def make() -> np.ndarray:
        made.append(number)
        time.sleep(0.3)
        return np.full(3, 7.0)

    array = cached_array("things/slow", [], make)
    return len(made), float(array.sum())


def test_of_several_that_want_the_same_one_makes_it_and_only_the_latest_stay(monkeypatch, tmp_path):
    monkeypatch.setenv("LANES_CACHE", str(tmp_path))
    made, sums = zip(*map_ordered(keep_slowly, range(6), workers=3), strict=True)
    assert sum(made) == 1 and set(sums) == {21.0}
    for number in range(4):
        cached_array(f"few/{number}", [], lambda n=number: np.arange(n + 1.0), max_files=2)
        # The time of a file is known to a hundredth of a second.
        time.sleep(0.02)
    assert sorted(path.name[0] for path in (tmp_path / "few").iterdir()) == ["2", "3"]


def test_a_frame_costs_no_more_than_fifty_undistortions():
    """Cars, trees, walls and ground; measured 32 on a quiet machine, 34 on a busy one, so half as much again is let."""
    drive, threads = SUITE["lorry"].drive(), cv2.getNumThreads()
    image = render_frame(drive, 0.0).image
    cv2.setNumThreads(1)
    try:
        ratios = [
            seconds_of(lambda t=time_s: render_frame(drive, t))
            / seconds_of(lambda: [undistort(image, drive.camera) for _ in range(5)])
            for time_s in (0.5, 1.0, 1.5, 2.0)
        ]
    finally:
        cv2.setNumThreads(threads)
    assert 5 * min(ratios) < 50


def seconds_of(call: Callable[[], object]) -> float:
    """Of this thread's own work: others that load the machine hardly change it."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


@pytest.mark.parametrize("name", ["fog", "wet-night"])
def test_what_the_bonnet_hides_may_be_left_out_in_any_weather(name):
    """Fog and water are laid over the ground that is there: all of it, or what is seen before the bonnet."""
    drive = SUITE[name].drive()
    with_bonnet, without = (render_frame(replace(drive, bonnet=bonnet), 1.0) for bonnet in (True, False))
    edge = int(bonnet_outline(drive.camera.size).min()) - 20
    assert with_bonnet.hidden[-1].all() and not without.hidden[-1].all()
    apart = cv2.absdiff(with_bonnet.image[:edge], without.image[:edge])
    assert apart.max() <= 1
