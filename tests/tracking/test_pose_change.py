"""A change of the camera pose during a drive is detected; bumps, bends and weaving are not mistaken for one."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.lane import telemetry_row
from lanes.tracking.pose_change import describe_wrong_yaw, find_pose_change, find_wrong_yaw
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import PaintedDrive, lane_lines, s_bend

pytestmark = pytest.mark.slow

FPS = 12
BUMPY = Motion(speed_mps=25.0, offset_m=0.1, wander_m=0.3, pitch_rad=np.radians(0.6))
TURN = np.radians(1.5)


def telemetry(*, seconds: float = 16, moved_s: float = 8, **turn: float) -> dict[str, np.ndarray]:
    """Telemetry of a bumpy drive through bends; the camera pose changes by `turn` at `moved_s`."""
    before = PaintedDrive(s_bend(), lane_lines(), BUMPY)
    pose = before.camera.pose
    moved = replace(pose, **{name: getattr(pose, name) + angle for name, angle in turn.items()})
    after = replace(before, camera=before.camera.with_pose(moved))
    tracker, rows = LaneTracker(before.camera, fps=FPS), []
    for time_s in np.arange(0, seconds, 1 / FPS):
        frame = (before if time_s < moved_s else after).frame(time_s)
        rows.append({"time_s": time_s} | telemetry_row(tracker.update(frame)))
    numbers = "time_s", "pitch_rad", "heading_rad", "offset_m", "camera_yaw_rad"
    columns = {name: np.array([row[name] for row in rows], float) for name in numbers}
    return columns | {"state": np.array([row["state"] for row in rows])}


@pytest.mark.parametrize(
    ("turn", "half_s", "pitch_deg", "yaw_deg", "words"),
    [
        ({"pitch_rad": TURN}, 8, 1.5, 0, r"since then it looks 1.\d deg farther down; annotate"),
        # in bends the heading of the lane varies more than the pitch
        ({"yaw_rad": -TURN}, 15, 0, -1.5, r"since then it looks 1.\d deg farther to the right; annotate"),
    ],
)
def test_a_camera_that_moves_half_way_is_detected(turn, half_s, pitch_deg, yaw_deg, words):
    change = find_pose_change(telemetry(seconds=2 * half_s, moved_s=half_s, **turn))
    # for two seconds the tracker explains the change of pitch as a vertical curve of the road
    assert change.time_s == pytest.approx(half_s, abs=2)
    assert np.degrees([change.pitch_rad, change.yaw_rad]) == pytest.approx([pitch_deg, yaw_deg], abs=0.6)
    assert re.search(words, change.describe())


def test_an_ordinary_bumpy_drive_has_no_pose_change():
    rows = telemetry(seconds=12)
    assert np.degrees(np.nanstd(rows["pitch_rad"])) > 0.2
    assert (rows["state"] == "tracking").mean() > 0.8
    assert find_pose_change(rows) is None and find_wrong_yaw(rows) is None


@pytest.mark.parametrize(("yaw_deg", "side"), [(-2.0, "right"), (1.5, "left")])
def test_a_wrong_yaw_is_named(yaw_deg, side):
    words = f"{abs(yaw_deg)} deg farther to the {side} than its pose says"
    assert describe_wrong_yaw(np.radians(yaw_deg)).endswith(words)


def test_a_short_drive_and_an_unsteady_yaw_are_no_wrong_yaw():
    time_s, yaw_rad = np.arange(0, 20, 0.1), np.full(200, 0.05)
    rows = {"time_s": time_s, "state": np.full(200, "tracking"), "camera_yaw_rad": yaw_rad}
    assert find_wrong_yaw(rows) == pytest.approx(-0.05)
    assert find_wrong_yaw({name: column[:95] for name, column in rows.items()}) is None
    assert find_wrong_yaw(rows | {"state": np.full(200, "lost")}) is None
    assert find_wrong_yaw(rows | {"camera_yaw_rad": np.where(time_s < 15, 0.05, 0.0)}) is None


def made(pitch_deg: np.ndarray, heading_deg: np.ndarray | float = 0.0) -> dict[str, np.ndarray]:
    times = np.arange(len(pitch_deg)) / 25
    noise = np.random.default_rng(0).normal(0, 0.2, (2, len(times)))
    return {
        "time_s": times,
        "state": np.full(len(times), "tracking"),
        "pitch_rad": np.radians(pitch_deg + noise[0]),
        "heading_rad": np.radians(heading_deg + noise[1]),
        "offset_m": np.zeros(len(times)),
    }


TIMES_S = np.arange(0, 60, 0.04)


@pytest.mark.parametrize(
    "pitch_deg",
    [
        np.where((TIMES_S > 20) & (TIMES_S < 24), 2.0, 0.0),
        np.where(TIMES_S > 57, 2.0, 0.0),
        1.2 * np.sin(TIMES_S / 3),
        np.where(TIMES_S > 30, 0.5, 0.0),
    ],
    ids=["a crest", "too late", "hilly", "too little"],
)
def test_temporary_and_small_changes_are_not_detected(pitch_deg):
    assert find_pose_change(made(pitch_deg)) is None


@pytest.mark.parametrize("until_s", [60, 50, 45])
def test_a_lane_change_is_no_moved_camera(until_s):
    """The car takes 12 s to the next lane, and the drive may end meanwhile: the offset jumps by the width of a lane."""
    share = np.clip((TIMES_S - 38) / 12, 0, 1)
    across_m = 3.5 * share**2 * (3 - 2 * share)
    heading_deg = np.degrees(-np.gradient(across_m, TIMES_S) / 15.0)
    rows = made(np.zeros(len(TIMES_S)), heading_deg) | {"offset_m": across_m - 3.5 * np.round(across_m / 3.5)}
    assert find_pose_change({name: column[until_s > TIMES_S] for name, column in rows.items()}) is None


def test_time_and_size_of_a_late_small_change():
    change = find_pose_change(made(np.where(TIMES_S > 50, 1.0, 0.0), np.where(TIMES_S > 50, -1.2, 0.0)))
    assert change.time_s == pytest.approx(50, abs=1)
    assert np.degrees([change.pitch_rad, change.yaw_rad]) == pytest.approx([1.0, 1.2], abs=0.1)


def test_frames_without_a_lane_do_not_count():
    rows = made(np.where(TIMES_S > 30, 1.5, 0.0))
    lost = TIMES_S > 31
    rows["state"][lost] = "lost"
    rows["pitch_rad"][lost] = np.nan
    assert find_pose_change(rows) is None
    rows["state"][:] = "lost"
    assert find_pose_change(rows) is None
