"""Results in a notebook: a short `repr` in words, and an HTML table of the same content."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import CalibrationReport, Camera, CameraPose
from lanes.pose import PoseEstimate
from lanes.stills import find_lane
from lanes.track.tracker import LaneTracker, TrackedLane
from tests.support.painted_roads import YELLOW, Road, dashcam

CAMERA = dashcam(width=1280)
# The car is 0.35 m right of the centre of a lane 3.6 m wide that bends left with a radius of 400 m.
OFFSET_M, BEND = -0.35, 1 / 400


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    road = Road(CAMERA)
    for side, colour in ((1, YELLOW), (-1, (225, 225, 220))):
        road.line(lambda x, s=side: s * 1.8 - OFFSET_M + BEND * x**2 / 2, colour=colour)
    return road.image()


def rows_of(html: str) -> dict[str, str]:
    return dict(re.findall(r"<tr><th>(.*?)</th><td>(.*?)</td></tr>", html))


def test_a_lane_gives_the_offset_and_the_bend(picture):
    lane = find_lane(picture, CAMERA)
    assert re.fullmatch(
        r"Lane\(0\.3[3-7] ± 0\.\d\d m right of centre, bends left, R (39|40|41)0 m, 3\.\d\d ± 0\.\d\d m wide\)",
        repr(lane),
    )
    rows = rows_of(lane._repr_html_())
    assert list(rows) == ["offset", "bend", "heading", "width", "left line", "right line"]
    assert re.fullmatch(r"2\.1\d ± 0\.\d\d m left, paint on \d+% of its rows, up to \d+ m", rows["left line"])
    assert re.fullmatch(r"1\.4\d ± 0\.\d\d m right, paint .*", rows["right line"])


def test_an_invisible_line_is_marked_as_inferred():
    only_left = Road(CAMERA).line(lambda x: 1.8 + 0 * x).image()
    lane = find_lane(only_left, CAMERA)
    assert lane.summary()["right line"].endswith("inferred from other lines")


def test_a_lost_lane_has_no_numbers():
    assert repr(TrackedLane("lost")) == "TrackedLane(lost, confidence 0.00, None)"
    assert rows_of(TrackedLane("lost")._repr_html_()) == {"state": "lost"}


def test_a_tracker_gives_its_state_and_speed(picture):
    tracker = LaneTracker(CAMERA, fps=20, speed_mps=25.0)
    assert repr(tracker) == "LaneTracker(1280x720 px, 20 pictures a second, lost)"
    for _ in range(4):
        tracked = tracker.update(picture)
    assert repr(tracker) == "LaneTracker(1280x720 px, 20 pictures a second, tracking)"
    rows = rows_of(tracker._repr_html_())
    assert rows["speed"] == "90 km/h"
    assert rows["state"] == "tracking"
    assert rows["offset"] == tracked.summary()["offset"] in repr(tracked)
    assert tracked.confidence > 0.5
    assert f"confidence {tracked.confidence:.2f}" in repr(tracked)


def test_a_camera_gives_lens_pose_and_calibration():
    camera = replace(CAMERA, report=CalibrationReport(0.254, {"a": 0.2, "b": 0.3}))
    assert repr(camera) == (
        "Camera(1280x720 px, focal length 1150 px, field of view 58.2 deg, "
        "pose 1.30 m high, pitch -0.57, yaw -0.69, roll 0.00 deg)"
    )
    assert rows_of(camera._repr_html_())["calibration"] == "2 boards, error 0.25 px"
    assert "no distortion, pose unknown" in repr(Camera.from_fov((640, 360), 90))


@pytest.mark.parametrize("hfov_deg", [30.0, 57.5, 120.0])
def test_the_field_of_view_is_the_one_asked_for(hfov_deg):
    assert Camera.from_fov((1920, 1080), hfov_deg).hfov_deg == pytest.approx(hfov_deg)


def test_a_pose_comes_with_standard_deviations_and_notes():
    pose = CameraPose(1.32, np.radians(-1.8), np.radians(-1.36), 0.0)
    estimate = PoseEstimate(CAMERA.with_pose(pose), 0.04, 0.001, 0.002, 0.0175, 12, 40, 3.66, ("roll <unknown>",))
    assert repr(estimate).startswith("PoseEstimate(height 1.32 ± 0.04 m (lane 3.66 m wide), pitch -1.80 ± 0.06 deg, ")
    rows = rows_of(estimate._repr_html_())
    assert rows["roll"] == "0.00 ± 1.00 deg"
    assert rows["pictures"] == "12 of 40 used"
    assert rows["note 1"] == "roll &lt;unknown&gt;"
