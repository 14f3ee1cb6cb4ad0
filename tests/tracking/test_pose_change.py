"""A change of the camera pose during a drive is detected; bumps, bends and weaving are
not mistaken for one.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from lanes.pose.change import find_pose_change, find_wrong_yaw


def test_a_short_drive_and_an_unsteady_yaw_are_no_wrong_yaw():
    time_s = 100 + np.arange(0, 20, 0.1)
    yaw_rad = np.full(200, 0.05)  # on the clock of the video
    rows = {
        "time_s": time_s,
        "state": np.full(200, "tracking"),
        "camera_yaw_rad": yaw_rad,
    }
    assert find_wrong_yaw(rows) == pytest.approx(-0.05)
    assert find_wrong_yaw({name: column[:95] for name, column in rows.items()}) is None
    assert find_wrong_yaw(rows | {"state": np.full(200, "lost")}) is None
    assert (
        find_wrong_yaw(rows | {"camera_yaw_rad": np.where(time_s < 115, 0.05, 0.0)})
        is None
    )


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


def test_time_size_and_side_of_a_change_on_the_clock_of_the_video():
    """The lane seems to turn right if the camera turns left.

    Frames without a lane do not count.
    """
    rows = made(np.where(TIMES_S > 50, 1.0, 0.0), np.where(TIMES_S > 50, -1.2, 0.0))
    rows["time_s"] += 100
    rows["state"][::2], rows["pitch_rad"][::2] = "lost", np.nan
    change = find_pose_change(rows)
    assert change.time_s == pytest.approx(150, abs=1)
    assert np.degrees([change.pitch_rad, change.yaw_rad]) == pytest.approx(
        [1.0, 1.2], abs=0.1
    )
    words = r"after 1(49|50|51) s: since then it looks 1\.0 deg farther down and 1\.2 deg farther to the left; annotate"
    assert re.search(words, change.describe())
    assert find_pose_change(
        rows | {"pitch_rad": np.zeros(len(TIMES_S))}
    ).time_s == pytest.approx(150, abs=1)
    late = TIMES_S > 52
    rows["state"][late], rows["pitch_rad"][late] = "lost", np.nan
    assert find_pose_change(rows) is None
