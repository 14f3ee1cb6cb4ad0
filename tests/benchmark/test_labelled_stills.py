"""Labelled stills: scores of several cameras; stated uncertainty and confidence, with
drawn lanes and labels.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.consistency import z_summary
from benchmark.real_roads import (
    LABEL_STD_PX,
    WAYS,
    all_z,
    describe,
    read_road_sets,
    score_lane,
    score_set,
)
from lanes.camera.model import save_camera
from lanes.detect.confidence import error_variance_factor
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.road import lines_on_view
from lanes.labels import NO_POINT, LaneColumns
from lanes.tracking.tracker import TrackerSettings
from lanes.video.images import write_image
from tests.support.command_line import main
from tests.support.painted_drive import BENDS, CAMERA, SMALL
from tests.support.shapes import a_lane

POSES = {
    "low": SMALL.pose,
    "high": replace(SMALL.pose, height_m=1.6, pitch_rad=SMALL.pose.pitch_rad + 0.05),
}
ROWS = np.arange(370.0, 700.0, 5.0)
X_M = np.geomspace(2, 100, 400)
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
SEEN = (LineEvidence(0.9, True, 40.0), LineEvidence(0.9, True, 40.0))
AT_M = np.array([8.0, 15.0, 25.0])
H = CAMERA.pose.height_m


def write_lines(path: Path, entries: list[dict]) -> None:
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Labelled stills of two cameras with different poses, and black ones of a third
    one.
    """
    folder = tmp_path_factory.mktemp("cameras")
    rows = np.arange(230, 311, 5)
    entries = []
    for name, pose in POSES.items():
        drive = replace(BENDS, camera=SMALL.with_pose(pose))
        for k in range(4):
            lanes = []
            for side in (0, 1):
                u, v = drive.camera.road_to_pixels(
                    np.column_stack([X_M, drive.truth(k / 5).line_y(side, X_M)])
                ).T
                columns = np.interp(rows, v[::-1], u[::-1])
                lanes.append(
                    np.where((columns >= 0) & (columns < 640), columns, -2).tolist()
                )
            entries.append(
                {
                    "raw_file": f"{name}/{k}.png",
                    "h_samples": rows.tolist(),
                    "lanes": lanes,
                }
            )
            write_image(folder / f"{name}/{k}.png", drive.frame(k / 5))
    write_lines(folder / "low.jsonl", entries[:4])
    write_image(folder / "black" / "0.png", np.zeros((360, 640, 3), np.uint8))
    write_lines(
        folder / "all.jsonl", [*entries, entries[0] | {"raw_file": "black/0.png"}]
    )
    save_camera(SMALL.with_pose(None), folder / "lens.yaml")
    return folder


def test_sets_of_real_roads_are_scored_alone_and_with_the_pose_of_their_set(folder):
    write_lines(
        folder / "labels.jsonl",
        [json.loads(line) for line in (folder / "all.jsonl").read_text().splitlines()],
    )
    black, high, low = read_road_sets(folder)
    scored = {way: score_set((low, way), TrackerSettings()) for way in WAYS}
    assert [len(scored[way]) for way in WAYS] == [4, 4, 0]  # no label names a clip
    assert all(one.score.right and one.lane for one in scored["own"] + scored["set"])
    (missed,) = score_set((black, "own"), TrackerSettings())
    assert missed.lane is None
    assert missed.score.right is False
    rows = [
        line.split()
        for line in describe(
            [black, low], "own", [[missed], scored["own"]]
        ).splitlines()
    ]
    assert [low.half, "low"] in [row[:2] for row in rows]
    assert rows[-1][:7] == ["own", "AB", "0.500", "0.000", "5", "4", "0.800"]
    assert {roads.half for roads in (black, high, low)} <= {"A", "B"}


def test_each_folder_has_its_own_pose(folder, capsys):
    options = [
        "--labels",
        str(folder / "all.jsonl"),
        "--hfov",
        f"{SMALL.hfov_deg:.3f}",
        "--system",
        "tracker",
    ]
    assert main(["benchmark", *options, "--each-folder"]) == 0
    lines = capsys.readouterr().out.splitlines()
    said = (
        "low: 4 stills; z at 8/15/25 m: ",
        "high: 4 stills; z at 8/15/25 m: ",
        "black: 1 stills; ",
    )
    assert [
        line.startswith(words) for line, words in zip(lines, said, strict=False)
    ] == [True] * 3
    (scores,) = (line.split() for line in lines if line.startswith("tracker "))
    assert [scores[1], scores[-2]] == [
        "9",
        "0.889",
    ]  # the black still has none of its two lines
    (confident,) = (line.split() for line in lines if line.startswith("0.9 or more "))
    assert confident[3:5] == ["8", "8"]


def test_recipes_are_scored_with_the_pose_of_the_set(folder, capsys):
    camera = ["--camera", str(folder / "lens.yaml"), "--system", "tracker,best_channel"]
    assert main(["benchmark", "--labels", str(folder / "low.jsonl"), *camera]) == 0
    said = capsys.readouterr().out
    rows = {line.split()[0]: line.split() for line in said.splitlines() if line}
    assert "height" in said
    assert rows["tracker"][1:3] == ["4", "1.000"]
    assert rows["best_channel"][1] == "4"
    assert (
        main(
            [
                "benchmark",
                "--labels",
                str(folder / "low.jsonl"),
                "--camera",
                str(folder / "no.file"),
            ]
        )
        == 2
    )


def lane_of(model: np.ndarray, covariance: np.ndarray = np.diag(STD**2)) -> Lane:  # noqa: B008
    return Lane(
        model,
        model,
        covariance / error_variance_factor(model, tracked=False),
        SEEN,
        score=1.0,
    )


def label_of(model: np.ndarray, shift_px: np.ndarray | float = 0.0) -> LaneColumns:
    """The pixels of a lane, each line shifted by the error of the label."""
    columns = lane_of(model).columns(CAMERA, ROWS)
    return LaneColumns(
        "a",
        ROWS,
        np.where(columns >= 0, columns + np.reshape(shift_px, (-1, 1)), NO_POINT),
    )


def drawn_z(covariance: np.ndarray, *, stated: float = 1.0) -> np.ndarray:
    """z (300, 2, 3) of lanes with drawn errors, against labels with drawn errors."""
    rng = np.random.default_rng(8)
    models = rng.multivariate_normal(TRUE, covariance, 300)
    labels = [
        label_of(TRUE, shift_px) for shift_px in rng.normal(0, LABEL_STD_PX, (300, 2))
    ]
    lanes = [lane_of(model, stated**2 * covariance) for model in models]
    z = all_z(
        [
            score_lane(lane, label, CAMERA)
            for lane, label in zip(lanes, labels, strict=True)
        ]
    )
    assert np.isfinite(z).mean() > 0.95
    return z


def z_rms(z: np.ndarray) -> np.ndarray:
    """(3,) root mean squares of (N, 2, 3)."""
    return np.sqrt(np.nanmean(z**2, axis=(0, 1)))


def test_z_is_the_ratio_of_true_and_stated_std():
    """The labels have a standard deviation of their own, also with lanes that have
    hardly any.
    """
    z = drawn_z(np.diag(STD**2))
    assert z_rms(z) == pytest.approx(1, abs=0.1)
    assert z_summary(z[np.isfinite(z)])["within_1"] == pytest.approx(0.68, abs=0.04)
    half = z_rms(drawn_z(np.diag(STD**2), stated=0.5))
    assert ((half > 1.4) & (half < 2.1)).all()
    assert z_rms(drawn_z(np.diag(STD**2) / 1e4)) == pytest.approx(1, abs=0.1)


def test_errors_of_the_pitch_are_not_in_the_picture_where_the_width_makes_up_for_them():
    """A pitch widens the lane in the picture. Errors of both cancel there, 15 m ahead."""
    pitch = a_lane(width=0.0, pitch=1e-3)
    left, right = (
        lines_on_view((TRUE + pitch)[None], AT_M, H)[0]
        - lines_on_view(TRUE[None], AT_M, H)[0]
    )[:, 1]
    direction = 6 * (pitch + a_lane(width=right - left))
    assert z_rms(
        drawn_z(np.diag(STD**2) + np.outer(direction, direction))
    ) == pytest.approx(1, abs=0.1)


def test_another_line_and_missing_labels_are_left_out():
    far = score_lane(
        lane_of(TRUE), label_of(TRUE + a_lane(centre=1.5, width=0.0)), CAMERA
    )
    assert np.isnan(far.z).all()
    assert far.other_lines == 6
    assert far.score.right is False
    label = label_of(TRUE)
    label.columns[0] = NO_POINT
    one = score_lane(lane_of(TRUE), label, CAMERA)
    assert np.isnan(one.z[0]).all()
    assert np.abs(one.z[1]).max() < 0.02
    assert one.score.right
    label.columns[1] = NO_POINT
    # no lane is labelled
    assert score_lane(lane_of(TRUE), label, CAMERA).score.right is False
