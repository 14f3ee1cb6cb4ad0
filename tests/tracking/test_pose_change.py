"""A change of the camera pose during a drive is detected; bumps, bends and weaving are
not mistaken for one.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from lanes.pose.change import describe_other_poses, find_pose_change, find_wrong_yaw


class TestWrongYaw:
    """The camera is turned in every frame of 20 seconds, on the clock of the video."""

    @pytest.fixture
    def rows(self) -> dict[str, np.ndarray]:
        return {
            "time_s": 100 + np.arange(0, 20, 0.1),
            "state": np.full(200, "tracking"),
            "camera_yaw_rad": np.full(200, 0.05),
        }

    def test_is_found(self, rows):
        assert find_wrong_yaw(rows) == pytest.approx(-0.05)

    def test_is_not_found_in_a_short_drive(self, rows):
        short = {name: column[:95] for name, column in rows.items()}
        assert find_wrong_yaw(short) is None

    def test_is_not_found_without_a_lane(self, rows):
        rows["state"][:] = "lost"
        assert find_wrong_yaw(rows) is None

    def test_is_not_found_if_it_is_unsteady(self, rows):
        rows["camera_yaw_rad"][150:] = 0.0
        assert find_wrong_yaw(rows) is None


def made(
    pitch_deg: np.ndarray, heading_deg: np.ndarray | float = 0.0
) -> dict[str, np.ndarray]:
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
    """The car takes 12 s to the next lane, and the drive may end meanwhile: the offset
    jumps by the width of a lane.
    """
    share = np.clip((TIMES_S - 38) / 12, 0, 1)
    across_m = 3.5 * share**2 * (3 - 2 * share)
    heading_deg = np.degrees(-np.gradient(across_m, TIMES_S) / 15.0)
    rows = made(np.zeros(len(TIMES_S)), heading_deg) | {
        "offset_m": across_m - 3.5 * np.round(across_m / 3.5)
    }
    assert (
        find_pose_change(
            {name: column[until_s > TIMES_S] for name, column in rows.items()}
        )
        is None
    )


class TestChange:
    """After 50 seconds the camera looks down and to the left: the lane seems to turn
    right. Every other frame has no lane.
    """

    @pytest.fixture
    def rows(self) -> dict[str, np.ndarray]:
        is_late = TIMES_S > 50
        rows = made(np.where(is_late, 1.0, 0.0), np.where(is_late, -1.2, 0.0))
        rows["time_s"] += 100
        lose(rows, np.s_[::2])
        return rows

    def test_has_its_size_and_sides(self, rows):
        change = find_pose_change(rows)
        angles_deg = np.degrees([change.pitch_rad, change.yaw_rad])
        assert angles_deg == pytest.approx([1.0, 1.2], abs=0.1)

    def test_has_its_time_on_the_clock_of_the_video(self, rows):
        assert find_pose_change(rows).time_s == pytest.approx(150, abs=1)

    def test_is_described(self, rows):
        words = (
            r"after 1(49|50|51) s: since then it looks 1\.0 deg farther down and "
            r"1\.2 deg farther to the left; annotate"
        )
        assert re.search(words, find_pose_change(rows).describe())

    def test_of_the_yaw_alone_is_found(self, rows):
        rows["pitch_rad"] = np.zeros(len(TIMES_S))
        assert find_pose_change(rows).time_s == pytest.approx(150, abs=1)

    def test_is_not_found_if_the_lane_is_lost_soon_after(self, rows):
        lose(rows, TIMES_S > 52)
        assert find_pose_change(rows) is None


def lose(rows: dict[str, np.ndarray], frames: slice | np.ndarray) -> None:
    rows["state"][frames] = "lost"
    rows["pitch_rad"][frames] = np.nan


def test_each_of_two_other_poses_has_a_line():
    lines = describe_other_poses({3.0: "1.3 m high", 4.5: "1.4 m high"})
    assert len(lines) == 2
    assert lines[1].startswith("from 4.5 s on")
    assert lines[1].endswith("1.4 m high")


def test_more_other_poses_are_one_line():
    (line,) = describe_other_poses({3.0: "a", 4.5: "b", 21.55: "1.5 m high"})
    assert "3 times from 3.0 to 21.6 s" in line
    assert line.endswith("the last: 1.5 m high")
