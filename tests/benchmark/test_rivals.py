"""Lane finders side by side: Hough lines, lines of a mask, and the table of all."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark import rivals
from benchmark.real_roads import read_road_sets
from benchmark.rivals_lines import hough_columns, mask_columns, stripe_centres
from lanes.camera.model import Camera
from lanes.detect.markings import TrainingWindow, crop_rows
from lanes.labels import NO_POINT
from tests.benchmark.test_labelled_stills import write_lines, write_still
from tests.support.onnx_file import LOGITS, threshold, write_model
from tests.support.painted_drive import SMALL
from tests.support.painted_roads import Arc, Road, dashcam

CAMERA = dashcam()
ROWS = np.arange(230, 350, 10)
SIDES_M = (1.8, -1.7)


def true_columns(arc: Arc, camera: Camera = CAMERA) -> np.ndarray:
    """Columns (2, R) of both lines at ROWS."""
    x_m = np.geomspace(3, 140, 2000)
    columns = []
    for side_m in SIDES_M:
        points = np.column_stack([x_m, arc.lateral_m(side_m, x_m)])
        u, v = camera.road_to_pixels(points).T
        columns.append(np.interp(ROWS, v[::-1], u[::-1]))
    return np.array(columns)


def mask_of(road: Road, sides_m: Sequence[float] = SIDES_M) -> np.ndarray:
    """The true mask of lines, 0.3 m wide; by default those of the lane."""

    def is_marking(_: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        return np.min([np.abs(y_m - side_m) for side_m in sides_m], axis=0) < 0.15

    return road.cover(is_marking)[..., 0]


class TestHoughLines:
    def test_finds_a_straight_lane(self):
        image = Road(CAMERA).lines(*SIDES_M).image()
        found = hough_columns(image, ROWS, horizon=0.5)
        np.testing.assert_allclose(found, true_columns(Arc()), atol=12)

    def test_end_below_the_horizon(self):
        image = Road(CAMERA).lines(*SIDES_M).image()
        found = hough_columns(image, np.array([150, 200, 280]), horizon=0.6)
        assert (found[:, :2] == NO_POINT).all()
        assert (found[:, 2] != NO_POINT).all()

    def test_are_none_on_a_bare_road(self):
        image = np.full((360, 640, 3), 98, np.uint8)
        assert (hough_columns(image, ROWS) == NO_POINT).all()


class TestLinesOfAMask:
    @pytest.mark.parametrize("arc", [Arc(), Arc(1 / 150, offset_m=0.4)])
    def test_are_the_true_ones(self, arc):
        mask = mask_of(Road(CAMERA, arc=arc))
        found = mask_columns(mask, ROWS, covers=(0, 360), size=CAMERA.size)
        np.testing.assert_allclose(found, true_columns(arc), atol=6)

    def test_are_those_next_to_the_car(self):
        mask = mask_of(Road(CAMERA), (9.0, 5.4, *SIDES_M, -5.3, -9.0))
        found = mask_columns(mask, ROWS, covers=(0, 360), size=CAMERA.size)
        np.testing.assert_allclose(found, true_columns(Arc()), atol=6)

    def test_of_a_window_are_at_the_rows_of_the_image(self):
        mask = mask_of(Road(CAMERA))
        rows = TrainingWindow(0.3).rows(CAMERA)
        assert rows != (0, 360)
        found = mask_columns(crop_rows(mask, rows), ROWS, covers=rows, size=CAMERA.size)
        np.testing.assert_allclose(found, true_columns(Arc()), atol=4)

    def test_are_none_in_an_empty_mask(self):
        empty = np.zeros((90, 160))
        found = mask_columns(empty, ROWS, covers=(0, 360), size=CAMERA.size)
        assert (found == NO_POINT).all()

    def test_begin_at_the_centres_of_its_runs(self):
        row, column = stripe_centres(np.array([[1, 1, 1, 0, 1], [0, 1, 1, 0, 0]]) > 0)
        assert row.tolist() == [0, 0, 1]
        assert column.tolist() == [1, 4, 1.5]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three labelled stills of one camera, and one still of a set without a pose."""
    folder = tmp_path_factory.mktemp("roads")
    entries = []
    for file in ("road/0.png", "road/1.png", "road/2.png", "mixed/0.png"):
        label = write_still(folder / file, SMALL, len(entries) / 5)
        entries.append({"raw_file": file} | label)
    write_lines(folder / "labels.jsonl", entries)
    entries = LOGITS | {"horizon": 0.45}
    write_model(folder / "net.onnx", {"lines": threshold()}, entries)
    return folder


@pytest.mark.slow
def test_the_command_prints_a_row_for_each_rival(folder, monkeypatch, capsys):
    network = f"{folder}/net.onnx"
    words = [str(folder), "--network", network, "--several-cameras", "mixed"]
    monkeypatch.setattr(sys, "argv", ["rivals", *words])
    rivals.main()
    rows = {}
    for line in capsys.readouterr().out.splitlines():
        name, *cells = line.split("  ")
        rows[name] = " ".join(cells).split()

    assert {"Hough lines", "hls_sobel", "hls_sobel_pose", "ours, own pose"} <= set(rows)
    assert {"net.onnx, whole image", "net.onnx, window"} <= set(rows)
    for name in ("ours, pose of the set", "ours with net.onnx, window"):
        assert rows[name][0] == "1.000"
        assert "3 of 3" in " ".join(rows[name])


def test_the_pose_is_that_of_the_stills_of_the_usual_size(folder):
    (roads,) = [of_one for of_one in read_road_sets(folder) if of_one.name == "road"]
    posed = rivals.pose_of_set(replace(roads, lens=replace(SMALL, pose=None)))
    assert posed.camera.pose.pitch_rad == pytest.approx(
        SMALL.pose.pitch_rad, abs=np.radians(0.5)
    )
    assert len(posed.roads.labels) == 3


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="Linux")
def test_the_peak_memory_grows_with_what_is_used():
    before_mb = rivals.peak_memory_mb()
    used = np.ones(int(before_mb + 50) * 2**17)
    assert rivals.peak_memory_mb() > before_mb + 40
    assert used.any()
