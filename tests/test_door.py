"""`import lanes`: what it takes, and results that print and compare well.

Wrong calls are in tests/test_misuse.py.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest

import lanes
from lanes.annotation import AnnotateOptions, DriveSettings
from lanes.camera.model import save_camera
from lanes.video.images import write_image
from tests.support.clips import FPS, write_clip
from tests.support.painted_drive import BENDS, SMALL

IMAGE = BENDS.frame(0)


@pytest.fixture(scope="module")
def still(tmp_path_factory) -> Path:
    return write_image(tmp_path_factory.mktemp("door") / "still.png", IMAGE)


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    return write_clip(
        tmp_path_factory.mktemp("door") / "drive.mp4",
        map(BENDS.frame, np.arange(12) / FPS),
    )


OPTIONS = get_type_hints(AnnotateOptions)


def test_each_option_of_annotate_has_the_type_of_its_setting():
    settings = get_type_hints(DriveSettings)
    for name in ("output", "camera", "field", "camera_options"):
        del settings[name]
    assert settings == OPTIONS


@pytest.mark.parametrize("name", OPTIONS)
def test_each_option_of_annotate_is_described(name):
    described = re.findall(r"^    ([\w, ]+) : ", lanes.annotate.__doc__, re.MULTILINE)
    assert name in ", ".join(described).split(", ")


def test_a_path_stands_for_its_image(still):
    lane = lanes.find_lane(still, SMALL)
    assert (
        lane
        == lanes.find_lane(str(still), SMALL)
        == lanes.find_lane(lanes.read_image(still), SMALL)
    )
    np.testing.assert_array_equal(
        lanes.draw_lane(still, lane, SMALL), lanes.draw_lane(IMAGE, lane, SMALL)
    )
    assert (
        lanes.LaneTracker(SMALL).update(still)
        == lanes.LaneTracker(SMALL).update(IMAGE)
        is not None
    )
    assert str(lanes.explain(still, SMALL)) == lanes.explain(IMAGE, SMALL).describe()
    with pytest.raises(
        lanes.PictureError,
        match=r"still\.png: is 640x360 pixels, but the camera .* 1280x720",
    ):
        lanes.find_lane(still, lanes.Camera.from_fov((1280, 720), 60, SMALL.pose))
    with pytest.raises(
        FileNotFoundError, match=r"gone\.png: there is no such image file"
    ):
        lanes.find_lane("gone.png", SMALL)


def test_results_compare_by_value(still, tmp_path):
    one = lanes.find_lane(IMAGE, SMALL)
    other = lanes.find_lane(still, SMALL)
    assert one == other
    assert hash(one) == hash(other)
    assert one is not other
    assert one.left == other.left != other.right
    assert one != replace(other, model=other.model + 1e-9)
    assert one != replace(other, score=0.5)
    assert one != "lane"
    camera = lanes.load_camera(save_camera(SMALL, tmp_path / "camera.yaml"))
    assert camera == SMALL
    assert hash(camera) == hash(SMALL)
    assert camera != SMALL.with_pose(None)
    assert lanes.estimate_pose(IMAGE, SMALL) == lanes.estimate_pose(still, camera)
    written = [lanes.annotate(still, tmp_path / "out", camera) for _ in range(2)]
    assert written[0] == written[1]


def test_results_print_on_one_line(still, drive, tmp_path):
    (result,) = lanes.annotate(drive, tmp_path, SMALL, progress=False, report=False)
    lane = lanes.find_lane(still, SMALL)
    numbers = r"0\.\d\d ± 0\.\d\d m left of centre, bends left, R \d+0 m, 3\.[56]\d ± 0\.\d\d m wide"
    assert re.fullmatch(rf"Lane\(found, confidence 0\.\d\d, {numbers}\)", repr(lane))
    assert repr(lane.left).startswith("Line(left, 1.")
    assert "yellow solid" in repr(lane.left)
    tracker = lanes.LaneTracker(SMALL, fps=25, speed_mps=25.0)
    assert tracker.update(IMAGE).summary()["speed"] == "90 km/h"
    assert "640x360 px, 25 frames" in repr(tracker)
    assert repr(result) == "Annotation(12 rows of telemetry, drive.mp4, drive.csv)"
    (frame, _), *_ = lanes.track(drive, SMALL)
    assert all(
        "\n" not in repr(x) and len(repr(x)) < 250
        for x in (lane, lane.left, result, frame, SMALL)
    )


def test_a_video_without_a_camera_is_tracked_and_the_field_of_view_said_once(drive):
    with warnings.catch_warnings(record=True) as said:
        warnings.resetwarnings()
        (_, first), *_, (_, last) = lanes.track(drive, end_s=0.2)
        estimate = lanes.estimate_pose(drive, max_pictures=1)
    assert last.state == "tracking"
    assert first.curvature_per_m != last.curvature_per_m
    assert estimate.camera.size == SMALL.size
    assert estimate.camera.hfov_deg == pytest.approx(60)
    assert lanes.estimate_pose([IMAGE]).camera.with_pose(
        None
    ) == estimate.camera.with_pose(None)
    about = [
        str(warning.message)
        for warning in said
        if "field of view" in str(warning.message)
    ]
    assert len(about) == 1
    assert "60.0 deg, assumed" in about[0]
    assert about[0].endswith("Give a camera.")


def test_the_pose_of_a_drive_shows_its_progress_in_a_terminal(
    drive, tmp_path, monkeypatch, capsys
):
    options = {"report": False, "end_s": 0.1, "lane_width_m": 3.6}
    lanes.annotate(drive, tmp_path / "a", SMALL.with_pose(None), **options)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    lanes.annotate(drive, tmp_path / "b", SMALL.with_pose(None), **options)
    assert re.search(
        r"\rpose: 100%.* ([3-9]|\d\d+)/\1 \[\d\d:\d\d<00:00.*\n",
        capsys.readouterr().err,
    )


def test_the_given_speed_is_that_of_the_annotated_drive(drive, tmp_path, monkeypatch):
    reset = lanes.LaneTracker.reset
    trackers = []
    monkeypatch.setattr(
        lanes.LaneTracker,
        "reset",
        lambda tracker: trackers.append(tracker) or reset(tracker),
    )
    lanes.annotate(drive, tmp_path, SMALL, speed_mps=13.0, progress=False, report=False)
    next(lanes.track(drive, SMALL, speed_mps=13.0))
    assert [tracker.speed_mps for tracker in trackers] == [13.0, 13.0]
