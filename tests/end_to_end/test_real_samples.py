"""Samples of real roads for the network: labels of both forms become cells of views."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.real_roads.sets import RoadSet
from lanes.camera.model import save_camera
from lanes.detect.birdseye import BirdsEyeView, lightness
from lanes.detect.markings import FINE_ROWS
from lanes.labels import NO_POINT, LaneColumns
from lanes.video.images import write_image
from tests.benchmark.test_labelled_stills import write_lines
from tests.support.clips import write_drive
from tests.support.labelme_files import labelme_file, line_strip
from tests.support.painted_drive import BENDS
from tests.support.painted_drive import CAMERA as DRIVE_CAMERA
from tests.support.painted_roads import Road, dashcam
from tools import train_marking_network
from tools.marking_samples import UNKNOWN, Sample
from tools.real_samples import (
    OPEN_M,
    lines_in_view,
    read_sets,
    take_real_samples,
    with_teacher,
)

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# The lane is labelled; its right border has no paint. The line of another lane is not
# labelled. Lines end beyond these distances.
LEFT_M = 1.9
RIGHT_M = -1.5
OTHER_M = 5.4
LABELLED_M = np.geomspace(6, 40, 60)
ROWS = np.arange(210, 350, 10)
IN_ROWS = (VIEW.x_m > 9) & (VIEW.x_m < 25)


def label_of(*lateral_m: float) -> dict:
    """An entry of JSON lines: lines along the road at these lateral positions."""
    lanes = []
    for y_m in lateral_m:
        points_m = np.column_stack([LABELLED_M, np.full(60, y_m)])
        u, v = CAMERA.road_to_pixels(points_m)[::-1].T
        columns = np.interp(ROWS, v, u, left=NO_POINT, right=NO_POINT)
        lanes.append(columns.tolist())
    return {"h_samples": ROWS.tolist(), "lanes": lanes}


def write_road(path: Path) -> Path:
    road = Road(CAMERA).lines(LEFT_M, OTHER_M)
    write_image(path, road.image())
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A still with labels in the form of TuSimple."""
    folder = tmp_path_factory.mktemp("roads")
    write_road(folder / "mine" / "0.png")
    entry = {"raw_file": "mine/0.png"} | label_of(LEFT_M, RIGHT_M)
    write_lines(folder / "labels.jsonl", [entry])
    return folder


def take(path: Path, **options: object) -> list[Sample]:
    """The samples of the only set in a folder or file of labels."""
    [roads] = read_sets(path, CAMERA)
    taken = take_real_samples(roads, **options)
    assert taken.skipped == []
    return taken.samples


@pytest.fixture(scope="module")
def sample(folder) -> Sample:
    [sample] = take(folder)
    return sample


def from_line_m(cells: np.ndarray, line_m: float) -> np.ndarray:
    """Distances of cells (rows, columns) bool from a line."""
    return np.abs(VIEW.y_m[np.nonzero(cells)[1]] - line_m)


class TestCells:
    def test_paint_lies_on_the_labelled_line(self, sample):
        paint = sample.label[0] == 1
        assert from_line_m(paint, LEFT_M).max() < 0.15
        assert paint[IN_ROWS].any(axis=1).all()

    def test_a_labelled_line_without_paint_is_an_edge(self, sample):
        edge = sample.label[1] == 1
        assert from_line_m(edge, RIGHT_M).max() < 0.15
        assert edge[IN_ROWS].any(axis=1).all()

    def test_cells_between_the_lines_are_neither(self, sample):
        between = (VIEW.y_m < LEFT_M - OPEN_M) & (VIEW.y_m > RIGHT_M + OPEN_M)
        assert set(sample.label[:, IN_ROWS][..., between].ravel()) == {0}

    def test_cells_beside_the_lane_are_open(self, sample):
        beside = (VIEW.y_m > LEFT_M + OPEN_M) | (VIEW.y_m < RIGHT_M - OPEN_M)
        assert set(sample.label[..., beside].ravel()) == {UNKNOWN}

    def test_cells_next_to_a_line_are_open(self, sample):
        beside = np.abs(np.abs(VIEW.y_m - LEFT_M) - 0.25) < 0.05
        assert set(sample.label[:, IN_ROWS][..., beside].ravel()) == {UNKNOWN}

    def test_rows_beyond_the_label_are_open(self, sample):
        beyond = VIEW.x_m > 45
        assert set(sample.label[:, beyond].ravel()) == {UNKNOWN}

    def test_worse_views_with_pose_errors_have_their_labels_on_the_paint(self, folder):
        first, *others = take(folder, views=5)
        for sample in others:
            assert not np.array_equal(sample.label, first.label)
            fine = sample.fine_image[FINE_ROWS // 2 :: FINE_ROWS]
            light = lightness(fine).astype(float)
            paint = light[sample.label[0] == 1].mean()
            road = light[sample.label[0] == 0].mean()
            assert paint > 1.4 * road


def test_a_gap_in_a_label_is_no_line():
    columns = np.array(label_of(LEFT_M)["lanes"])
    whole = lines_in_view(LaneColumns("a", ROWS, columns), VIEW)
    columns[0, 4:6] = NO_POINT
    [line_m] = lines_in_view(LaneColumns("a", ROWS, columns), VIEW)
    missing = np.isfinite(whole[0]) & np.isnan(line_m)
    u, v = CAMERA.road_to_pixels(
        np.column_stack([VIEW.x_m, np.full(len(VIEW.x_m), LEFT_M)])
    ).T
    np.testing.assert_array_equal(missing, (v > ROWS[3] + 0.5) & (v < ROWS[6] - 0.5))
    np.testing.assert_allclose(line_m[np.isfinite(line_m)], LEFT_M, atol=0.02)


def test_labels_of_labelme_give_the_same_cells(folder, sample, tmp_path):
    picture = write_road(tmp_path / "0.png")
    shapes = []
    for name, columns in zip(
        ("left", "right"), label_of(LEFT_M, RIGHT_M)["lanes"], strict=True
    ):
        points = []
        for column, row in zip(columns, ROWS, strict=True):
            if column >= 0:
                # labelme counts from the corner of the first pixel
                points.append((column + 0.5, row + 0.5))
        shapes.append(line_strip(name, *points))
    content = labelme_file(picture.name, CAMERA.size, shapes)
    picture.with_suffix(".json").write_text(json.dumps(content))
    [other] = take(tmp_path)
    both = (sample.label != UNKNOWN) & (other.label != UNKNOWN)
    assert both.sum() > 0.8 * (sample.label != UNKNOWN).sum()
    np.testing.assert_array_equal(sample.label[both], other.label[both])
    np.testing.assert_array_equal(sample.fine_image, other.fine_image)


class TestLeftOut:
    def reasons(self, folder: Path, entries: list[dict], **options: object) -> str:
        write_lines(folder / "labels.jsonl", entries)
        [roads] = read_sets(folder, **options)
        taken = take_real_samples(roads)
        assert taken.samples == []
        return "\n".join(taken.skipped)

    def test_a_missing_still(self, tmp_path):
        entries = [{"raw_file": "a/0.png"} | label_of(LEFT_M)]
        assert "a/0.png: there is no such image file" in self.reasons(tmp_path, entries)

    def test_a_still_without_a_line(self, tmp_path):
        write_road(tmp_path / "a" / "0.png")
        entries = [{"raw_file": "a/0.png"} | label_of()]
        assert self.reasons(tmp_path, entries) == "a/0.png: has no line"

    def test_a_still_that_shows_no_pose(self, tmp_path):
        black = np.zeros((360, 640, 3), np.uint8)
        write_image(tmp_path / "a" / "0.png", black)
        entries = [{"raw_file": "a/0.png"} | label_of(LEFT_M)]
        reasons = self.reasons(tmp_path, entries)
        assert reasons.startswith("a: no image shows the camera pose")

    def test_a_still_of_another_size_than_the_others(self, tmp_path):
        entries = []
        for number in range(3):
            file = write_road(tmp_path / "a" / f"{number}.png")
            entries.append({"raw_file": f"a/{number}.png"} | label_of(LEFT_M))
        write_image(file, np.zeros((180, 320, 3), np.uint8))
        write_lines(tmp_path / "labels.jsonl", entries)
        [roads] = read_sets(tmp_path, CAMERA)
        taken = take_real_samples(roads)
        assert taken.images == 2
        assert taken.skipped == ["a/2.png: is of another size than the others"]

    def test_a_damaged_still(self, tmp_path):
        file = write_road(tmp_path / "a" / "0.png")
        file.write_bytes(file.read_bytes()[:100])
        entries = [{"raw_file": "a/0.png"} | label_of(LEFT_M)]
        assert "0.png" in self.reasons(tmp_path, entries)

    def test_a_camera_that_sees_no_road(self, tmp_path):
        write_road(tmp_path / "a" / "0.png")
        entries = [{"raw_file": "a/0.png"} | label_of(LEFT_M)]
        upwards = replace(CAMERA.require_pose(), pitch_rad=-1.2)
        reasons = self.reasons(tmp_path, entries, lens=CAMERA.with_pose(upwards))
        assert reasons.startswith("a/0.png: the camera sees no road")

    def test_stills_that_a_camera_does_not_fit(self, tmp_path):
        write_road(tmp_path / "a" / "0.png")
        entries = [{"raw_file": "a/0.png"} | label_of(LEFT_M)]
        square = replace(CAMERA, width=360)
        reasons = self.reasons(tmp_path, entries, lens=square)
        assert "another aspect ratio" in reasons


class TestTeacher:
    """Labels are kept where the mask is the same, otherwise open."""

    def agreed(self, sample: Sample, mask: float) -> np.ndarray:
        image = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)

        def teacher(image: np.ndarray) -> np.ndarray:
            return np.full(image.shape[:2], mask, np.float32)

        return with_teacher(sample.label, image, VIEW, teacher)

    def test_lines_that_it_does_not_see_are_open(self, sample):
        agreed = self.agreed(sample, 0.0)
        kept = np.where(sample.label == 1, UNKNOWN, sample.label)
        np.testing.assert_array_equal(agreed, kept)

    def test_road_that_it_takes_for_a_line_is_open(self, sample):
        agreed = self.agreed(sample, 1.0)
        kept = np.where(sample.label == 0, UNKNOWN, sample.label)
        np.testing.assert_array_equal(agreed, kept)

    @pytest.mark.slow
    def test_it_adds_tracked_frames_between_the_labelled_ones(self, tmp_path):
        clip = write_drive(tmp_path / "clip.mp4", BENDS, 31)
        unused = LaneColumns("a", ROWS, np.empty((0, len(ROWS))))
        roads = RoadSet("a", tmp_path, DRIVE_CAMERA, clips={clip: {20: unused}})

        def teacher(image: np.ndarray) -> np.ndarray:
            return (lightness(image) > 150).astype(np.float32)

        taken = take_real_samples(roads, teacher=teacher)
        assert taken.skipped == []
        assert 1 <= taken.images <= 2  # 10 and 30, if sure
        for sample in taken.samples:
            assert (sample.label[0] == 1).any()


class TestCommand:
    def options(self, *words: str) -> object:
        parser = train_marking_network.argparse.ArgumentParser()
        train_marking_network.add_arguments(parser)
        return parser.parse_args(words)

    def test_it_says_what_it_takes(self, folder, tmp_path, capsys):
        save_camera(CAMERA, tmp_path / "camera.yaml")
        words = ("--camera", str(tmp_path / "camera.yaml"), "--views", "2")
        options = self.options("--real", str(folder), *words)
        assert len(train_marking_network.take_real(options)) == 2
        assert capsys.readouterr().out == "mine: 2 samples of 1 images\n"

    def test_it_takes_the_sets_of_a_half_only(self, folder):
        [roads] = read_sets(folder)
        [other] = {"A", "B"} - {roads.half}
        options = self.options("--real", str(folder), "--half", other)
        with pytest.raises(ValueError, match="no labelled still gives a sample"):
            train_marking_network.take_real(options)

    def test_it_names_the_packages_that_it_needs(self, monkeypatch, capsys):
        monkeypatch.setitem(train_marking_network.sys.modules, "torch", None)
        monkeypatch.delitem(
            train_marking_network.sys.modules, "tools.marking_network", raising=False
        )
        monkeypatch.setattr("sys.argv", ["train_marking_network"])
        assert train_marking_network.main() == 2
        assert "pip install torch onnx" in capsys.readouterr().err
