"""Labelled stills: scores of several cameras; stated uncertainty and confidence, with
drawn lanes and labels.
"""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.consistency import z_summary
from benchmark.real_roads.scored import (
    LABEL_STD_PX,
    ScoredLane,
    all_z,
    score_lane,
)
from benchmark.real_roads.sets import RoadSet, read_road_sets
from benchmark.real_roads.tables import describe
from benchmark.real_roads.ways import score_set
from lanes.camera.model import Camera, save_camera
from lanes.detect.confidence import error_variance_factor
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.road import lines_on_view
from lanes.labels import NO_POINT, LaneColumns
from lanes.tracking.tracker import TrackerSettings
from lanes.video.images import write_image
from tests.support.command_line import main
from tests.support.painted_drive import BENDS, CAMERA, SMALL
from tests.support.shapes import a_lane

HIGH = replace(SMALL.pose, height_m=1.6, pitch_rad=SMALL.pose.pitch_rad + 0.05)
CAMERAS = {"low": SMALL, "high": SMALL.with_pose(HIGH)}


def write_lines(path: Path, entries: list[dict]) -> None:
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))


def write_still(path: Path, camera: Camera, time_s: float) -> dict:
    """A still of BENDS by a camera; returns its label, without the name of the file."""
    drive = replace(BENDS, camera=camera)
    write_image(path, drive.frame(time_s))
    rows = np.arange(230, 311, 5)
    x_m = np.geomspace(2, 100, 400)
    lanes = []
    for side in (0, 1):
        y_m = drive.truth(time_s).line_y(side, x_m)
        u, v = camera.road_to_pixels(np.column_stack([x_m, y_m])).T
        columns = np.interp(rows, v[::-1], u[::-1])
        inside = (columns >= 0) & (columns < 640)
        lanes.append(np.where(inside, columns, NO_POINT).tolist())
    return {"h_samples": rows.tolist(), "lanes": lanes}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Labelled stills of two cameras with different poses; a black one of a third."""
    folder = tmp_path_factory.mktemp("cameras")
    entries = []
    for name, camera in CAMERAS.items():
        for number in range(4):
            file = f"{name}/{number}.png"
            label = write_still(folder / file, camera, number / 5)
            entries.append({"raw_file": file} | label)
    write_lines(folder / "low.jsonl", entries[:4])
    write_image(folder / "black" / "0.png", np.zeros((360, 640, 3), np.uint8))
    entries.append(entries[0] | {"raw_file": "black/0.png"})
    write_lines(folder / "labels.jsonl", entries)
    save_camera(SMALL.with_pose(None), folder / "lens.yaml")
    return folder


def read_set(folder: Path, name: str, **options: object) -> RoadSet:
    sets = {roads.name: roads for roads in read_road_sets(folder, **options)}
    return sets[name]


@pytest.fixture(scope="module")
def of_low(folder) -> list[ScoredLane]:
    """Each still of the set alone."""
    return score_set((read_set(folder, "low"), "own"), TrackerSettings())


@pytest.fixture(scope="module")
def of_black(folder) -> list[ScoredLane]:
    return score_set((read_set(folder, "black"), "own"), TrackerSettings())


def test_each_folder_is_a_set_in_one_of_the_halves(folder):
    sets = read_road_sets(folder)
    assert [roads.name for roads in sets] == ["black", "high", "low"]
    assert {roads.half for roads in sets} <= {"A", "B"}


def test_stills_are_scored_alone(of_low):
    assert [one.score.right for one in of_low] == [True] * 4


def test_stills_are_scored_with_the_pose_of_their_set(folder):
    scored = score_set((read_set(folder, "low"), "set"), TrackerSettings())
    assert [one.score.right for one in scored] == [True] * 4


def test_stills_of_several_cameras_have_no_common_pose(folder):
    roads = read_set(folder, "low", several_cameras=["low"])
    assert score_set((roads, "set"), TrackerSettings()) == []


def test_an_unknown_set_of_several_cameras_is_named(folder):
    with pytest.raises(ValueError, match=r"labels.jsonl: has no set lo; its sets are"):
        read_road_sets(folder, several_cameras=["lo"])


def test_without_a_clip_nothing_is_tracked(folder):
    assert score_set((read_set(folder, "low"), "clips"), TrackerSettings()) == []


def test_a_still_without_a_lane_is_wrong(of_black):
    (missed,) = of_black
    assert missed.lane is None
    assert missed.score.right is False


def test_the_table_has_a_row_for_each_set_and_for_all(folder, of_low, of_black):
    """Points of the sets (mean, lowest), images, right ones and their share."""
    sets = [read_set(folder, name) for name in ("black", "low")]
    lines = describe(sets, "own", [of_black, of_low]).splitlines()
    rows = [line.split() for line in lines]
    assert [sets[1].half, "low"] in [row[:2] for row in rows]
    assert rows[-1][:7] == ["own", "AB", "0.500", "0.000", "5", "4", "0.800"]


@pytest.fixture(scope="module")
def printed(folder) -> list[str]:
    """What the benchmark prints of all labels, each folder with its own pose."""
    hfov_deg = f"{SMALL.hfov_deg:.3f}"
    words = ["--labels", str(folder / "labels.jsonl"), "--hfov", hfov_deg]
    with redirect_stdout(io.StringIO()) as out:
        assert main(["benchmark", *words, "--system", "tracker", "--each-folder"]) == 0
    return out.getvalue().splitlines()


def line_of(lines: list[str], name: str) -> list[str]:
    """The cells of the only line with this name."""
    (line,) = (line for line in lines if line.startswith(f"{name} "))
    return line.removeprefix(name).split()


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (0, "low: 4 stills; z at 8/15/25 m: "),
        (1, "high: 4 stills; z at 8/15/25 m: "),
        (2, "black: 1 stills; "),
    ],
)
def test_each_folder_has_its_own_line(printed, place, words):
    assert printed[place].startswith(words)


def test_the_scores_are_those_of_all_folders(printed):
    """The black still has none of its two lines."""
    cells = line_of(printed, "tracker")
    assert cells[0] == "9"
    assert cells[-2] == "0.889"


def test_confident_lanes_are_counted(printed):
    lanes, right, *_ = line_of(printed, "0.9 or more")
    assert [lanes, right] == ["8", "8"]


def score_low(folder: Path, camera: str) -> int:
    labels = ["--labels", str(folder / "low.jsonl")]
    words = ["--camera", str(folder / camera), "--system", "tracker,best_channel"]
    return main(["benchmark", *labels, *words])


def test_recipes_are_scored_with_the_pose_of_the_set(folder, capsys):
    assert score_low(folder, "lens.yaml") == 0
    said = capsys.readouterr().out
    assert "height" in said
    assert line_of(said.splitlines(), "tracker")[:2] == ["4", "1.000"]
    assert line_of(said.splitlines(), "best_channel")[0] == "4"


def test_a_missing_camera_file_is_an_error(folder):
    assert score_low(folder, "no.file") == 2


# Lanes with drawn errors, against labels with drawn errors.
ROWS = np.arange(370.0, 700.0, 5.0)
TRUE = a_lane(centre=0.2, width=3.5, heading=0.02, curvature=1 / 400)
STD = a_lane(
    centre=0.05,
    width=0.04,
    heading=0.008,
    curvature=5e-4,
    rate=1e-9,
    pitch=1e-9,
    rate_steps=1e-12,
)
COVARIANCE = np.diag(STD**2)
SEEN = LineEvidence(0.9, True, 40.0)


def lane_of(model: np.ndarray, covariance: np.ndarray = COVARIANCE) -> Lane:
    """A lane that states this covariance."""
    factor = error_variance_factor(model, tracked=False)
    return Lane(model, model, covariance / factor, (SEEN, SEEN), score=1.0)


def label_of(model: np.ndarray, shift_px: np.ndarray | float = 0.0) -> LaneColumns:
    """The pixels of a lane, each line shifted by the error of the label."""
    columns = lane_of(model).columns(CAMERA, ROWS)
    shifted = columns + np.reshape(shift_px, (-1, 1))
    return LaneColumns("a", ROWS, np.where(columns >= 0, shifted, NO_POINT))


def drawn_z(covariance: np.ndarray, *, stated: float = 1.0) -> np.ndarray:
    """z (300, 2, 3); `stated` is that of the true standard deviations."""
    rng = np.random.default_rng(8)
    models = rng.multivariate_normal(TRUE, covariance, 300)
    shifts_px = rng.normal(0, LABEL_STD_PX, (300, 2))
    scored = []
    for model, shift_px in zip(models, shifts_px, strict=True):
        lane = lane_of(model, stated**2 * covariance)
        scored.append(score_lane(lane, label_of(TRUE, shift_px), CAMERA))
    z = all_z(scored)
    assert np.isfinite(z).mean() > 0.95
    return z


def z_rms(z: np.ndarray) -> np.ndarray:
    """(3,) root mean squares of (N, 2, 3)."""
    return np.sqrt(np.nanmean(z**2, axis=(0, 1)))


def test_the_rms_of_z_is_1_if_the_stated_std_is_true():
    assert z_rms(drawn_z(COVARIANCE)) == pytest.approx(1, abs=0.1)


def test_68_percent_of_z_are_within_1():
    z = drawn_z(COVARIANCE)
    summary = z_summary(z[np.isfinite(z)])
    assert summary["within_1"] == pytest.approx(0.68, abs=0.04)


def test_the_rms_of_z_is_larger_if_the_stated_std_is_too_small():
    """At most twice as large: the labels have a standard deviation of their own."""
    assert z_rms(drawn_z(COVARIANCE, stated=0.5)) == pytest.approx(1.75, abs=0.35)


def test_the_labels_have_a_std_of_their_own():
    """Also with lanes that have hardly any."""
    assert z_rms(drawn_z(COVARIANCE / 1e4)) == pytest.approx(1, abs=0.1)


def test_errors_of_the_pitch_are_not_in_the_picture_where_the_width_makes_up_for_them():
    """A pitch widens the lane in the picture; errors of both cancel 15 m ahead."""
    pitch = a_lane(width=0.0, pitch=1e-3)
    models = np.array([TRUE, TRUE + pitch])
    flat, pitched = lines_on_view(models, np.array([15.0]), CAMERA.pose.height_m)
    left_m, right_m = (pitched - flat).ravel()
    direction = 6 * (pitch + a_lane(width=right_m - left_m))
    covariance = COVARIANCE + np.outer(direction, direction)
    assert z_rms(drawn_z(covariance)) == pytest.approx(1, abs=0.1)


def test_another_line_is_wrong_and_has_no_z():
    label = label_of(TRUE + a_lane(centre=1.5, width=0.0))
    other = score_lane(lane_of(TRUE), label, CAMERA)
    assert np.isnan(other.z).all()
    assert other.other_lines == 6
    assert other.score.right is False


def score_true_lane(*unlabelled: int) -> ScoredLane:
    """The true lane against a label without these lines."""
    label = label_of(TRUE)
    label.columns[list(unlabelled)] = NO_POINT
    return score_lane(lane_of(TRUE), label, CAMERA)


def test_a_line_without_a_label_is_left_out():
    one = score_true_lane(0)
    assert np.isnan(one.z[0]).all()
    assert np.abs(one.z[1]).max() < 0.02
    assert one.score.right


def test_a_lane_where_none_is_labelled_is_wrong():
    assert score_true_lane(0, 1).score.right is False
