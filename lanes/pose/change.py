"""Detect from the telemetry of a drive that the camera moved, or that the yaw of its
pose is wrong.

In every frame the tracker measures the pitch relative to the camera pose and the
direction of the road. Bumps, grades and steering change them for a moment. A change at
one moment that lasts until the end comes from the camera.

It also estimates the direction of the car's axis, seen from the camera. Where the yaw
of the pose is right, it is straight ahead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lanes.detect.confidence import USUAL_WIDTH_M
from lanes.detect.lane import TRACKING

# Frames are averaged by the second. Both parts must last at least this long, because
# bumps and bends pass sooner.
MIN_PART_S = 5
# Smallest change: a smaller one does not need a new pose (on a rendered drive 0.8
# degrees of pitch move the offset by 1 cm). The number of standard deviations is high
# because the best of all splits is taken and because the values of successive seconds
# are correlated.
MIN_CHANGE_RAD = np.radians(0.8)
MIN_CHANGE_STDS = 6.0
# A wrong yaw is larger than this in nearly all frames, those between these percentiles:
# in bends the estimate is less accurate. Larger than the error of a pose from a drive,
# and large enough to move a line by 0.5 m at 30 m.
MIN_WRONG_YAW_RAD = np.radians(1.0)
WRONG_YAW_PERCENTILES = (10, 90)


@dataclass(frozen=True)
class PoseChange:
    """Time and size of a change of the camera pose.

    `time_s` is on the clock of the video. The changes of pitch (> 0 looks farther down)
    and yaw (> 0 looks farther left) are 0 where they are not significant.
    """

    time_s: float
    pitch_rad: float
    yaw_rad: float

    def describe(self) -> str:
        """One sentence with the change and what to do."""
        turns = []
        if self.pitch_rad:
            turns.append(_describe_turn(self.pitch_rad, "down", "up"))
        if self.yaw_rad:
            turns.append(_describe_turn(self.yaw_rad, "to the left", "to the right"))
        return (
            f"the camera seems to have moved after {self.time_s:.0f} s: since then it "
            f"looks {' and '.join(turns)}; annotate the two parts separately (--start, "
            "--end), each with its own pose."
        )


def _describe_turn(angle_rad: float, positive: str, negative: str) -> str:
    direction = positive if angle_rad > 0 else negative
    return f"{np.degrees(abs(angle_rad)):.1f} deg farther {direction}"


def find_wrong_yaw(rows: Mapping[str, np.ndarray]) -> float | None:
    """By how many radians the camera looks farther left than its pose says; None if
    that is not significant.

    `rows` is the telemetry of one drive: columns (N,) time_s, state and camera_yaw_rad.
    The first `MIN_PART_S` of the drive do not count, and as much must follow.
    """
    time_s = np.asarray(rows["time_s"], float)
    since_s = time_s - time_s[0]  # a part of a drive has the times of the video
    is_tracked = np.asarray(rows["state"]) == TRACKING
    counts = is_tracked & (since_s >= MIN_PART_S)
    if not counts.any() or since_s[counts].max() < 2 * MIN_PART_S:
        return None
    yaw_rad = -np.asarray(rows["camera_yaw_rad"], float)[counts]
    low_rad, high_rad = np.percentile(yaw_rad, WRONG_YAW_PERCENTILES)
    if low_rad > MIN_WRONG_YAW_RAD or high_rad < -MIN_WRONG_YAW_RAD:
        return float(np.median(yaw_rad))
    return None


def describe_wrong_yaw(yaw_rad: float) -> str:
    """The result of `find_wrong_yaw` in words."""
    side = "left" if yaw_rad > 0 else "right"
    angle_deg = np.degrees(abs(yaw_rad))
    return (
        f"the camera seems to look {angle_deg:.1f} deg farther to the {side} than its "
        "pose says"
    )


def find_pose_change(rows: Mapping[str, np.ndarray]) -> PoseChange | None:
    """The moment at which the camera moved; None if no change is significant and lasts
    `MIN_PART_S` on both sides.

    `rows` is the telemetry of one drive: columns (N,) time_s, state, pitch_rad,
    heading_rad and offset_m.
    """
    seconds, pitch, heading = _values_per_second(rows)
    pitch_split, pitch_rad = _largest_step(pitch)
    yaw_split, yaw_rad = _largest_step(-heading)
    if not pitch_rad and not yaw_rad:
        return None
    split = pitch_split if abs(pitch_rad) > abs(yaw_rad) else yaw_split
    return PoseChange(float(seconds[split]), pitch_rad, yaw_rad)


def _values_per_second(
    rows: Mapping[str, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seconds with tracked frames, their median pitch, and their median heading.

    The heading is without the effect of weaving.
    """
    tracked = np.asarray(rows["state"]) == TRACKING
    second = np.floor(np.asarray(rows["time_s"], float)).astype(int)
    seconds = np.unique(second[tracked])
    frames = [np.flatnonzero(tracked & (second == s)) for s in seconds]

    # the offset of a car that changes lanes jumps to the other side: the lateral speed
    # is that across all lanes
    offset_m = np.asarray(rows["offset_m"], float).copy()
    offset_m[tracked] = np.unwrap(offset_m[tracked], period=USUAL_WIDTH_M)
    pitch = _medians(np.asarray(rows["pitch_rad"], float), frames)
    heading = _medians(np.asarray(rows["heading_rad"], float), frames)
    offset = _medians(offset_m, frames)

    if len(seconds) >= 3:
        # weaving is proportional to the lateral speed; the factor (1 / speed) is fitted
        # to differences between seconds, so that a step of the heading has little
        # influence
        lateral_speed = np.gradient(offset)
        differences = np.diff(lateral_speed)
        square = max(differences @ differences, 1e-9)
        factor = differences @ np.diff(heading) / square
        heading = heading - factor * lateral_speed
    return seconds, pitch, heading


def _medians(values: np.ndarray, groups: Sequence[np.ndarray]) -> np.ndarray:
    """Median (G,) of the values at the indices of each group."""
    return np.array([np.median(values[group]) for group in groups])


def _largest_step(values: np.ndarray) -> tuple[int, float]:
    """Best split of (N,) values into two constant levels, and the step between these.

    The step is 0.0 if it is not significant.
    """
    split = 0
    step = 0.0
    least = np.full(1, np.inf)
    for at in range(1, len(values)):
        before = np.median(values[:at])
        after = np.median(values[at:])
        levels = np.where(np.arange(len(values)) < at, before, after)
        residuals = np.abs(values - levels)
        if residuals.sum() < least.sum():
            split = at
            step = float(after - before)
            least = residuals
    if not MIN_PART_S <= split <= len(values) - MIN_PART_S:
        return split, 0.0

    # the median of n normal values has the variance pi / 2n
    counts = 1 / split + 1 / (len(values) - split)
    std = 1.4826 * np.median(least) * np.sqrt(np.pi / 2 * counts)
    is_large = abs(step) > max(MIN_CHANGE_RAD, MIN_CHANGE_STDS * std)
    return split, step if is_large else 0.0


def describe_other_poses(found_at_s: Mapping[float, str]) -> list[str]:
    """Words on other poses that a tracker went on with, by their times.

    One line for each of up to two poses, and one line for more.
    """
    reason = "(the camera moved, or another one begins)"
    if len(found_at_s) <= 2:
        return [
            f"from {time_s:.1f} s on with another pose {reason}: {pose}"
            for time_s, pose in found_at_s.items()
        ]
    times_s = list(found_at_s)
    last_s = times_s[-1]
    return [
        f"with other poses {len(times_s)} times from {times_s[0]:.1f} to "
        f"{last_s:.1f} s {reason}, the last: {found_at_s[last_s]}"
    ]
