"""Has the camera moved in its pose during a drive? Told from telemetry alone.

The tracker measures in every frame how much farther down than its pose says the camera looks, and where the road
points. Bumps, grades and steering come and go; what changes at one moment and stays is the camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lanes.tracking.tracked_lane import TRACKING

# Frames are summed up by the second, and both parts last at least so many seconds: bumps and bends pass sooner.
LEAST_SECONDS = 5
# Changes below this are not worth a new pose: on a rendered drive 0.8 degrees of pitch move the offset by 1 cm.
LEAST_RAD = np.radians(0.8)
# A change is one if it is so many of its standard deviations: the best split is looked for, and seconds hang together.
SURE = 6.0


@dataclass(frozen=True)
class PoseChange:
    """When the camera moved, and how it looks since: `pitch_rad` farther down, `yaw_rad` farther to the left."""

    time_s: float
    pitch_rad: float
    yaw_rad: float

    def describe(self) -> str:
        """A sentence for people, with what to do."""
        ways = [
            _describe_turn(self.pitch_rad, "down", "up"),
            _describe_turn(self.yaw_rad, "to the left", "to the right"),
        ]
        return (
            f"the camera seems to have moved after {self.time_s:.0f} s: since then it looks "
            f"{' and '.join(filter(None, ways))}; annotate the two parts on their own (--start, --end), each with its "
            "own pose."
        )


def find_pose_change(rows: Mapping[str, np.ndarray]) -> PoseChange | None:
    """Look for the moment at which the camera moved in its pose.

    Parameters
    ----------
    rows : mapping of str to ndarray of shape (N,)
        Telemetry of one drive: time_s, state, pitch_rad, heading_rad, offset_m.

    Returns
    -------
    PoseChange or None
        None if nothing tells of a move, which includes drives with less than `LEAST_SECONDS` tracked before and after.
    """
    seconds, pitch, heading = _by_second(rows)
    (pitched, pitch_rad), (turned, yaw_rad) = _largest_change(pitch), _largest_change(-heading)
    if not pitch_rad and not yaw_rad:
        return None
    split = pitched if abs(pitch_rad) > abs(yaw_rad) else turned
    return PoseChange(float(seconds[split]), pitch_rad, yaw_rad)


def _by_second(rows: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seconds with tracked frames, and for each the pitch and the heading that is not explained by weaving."""
    tracked = np.asarray(rows["state"]) == TRACKING
    second = np.floor(np.asarray(rows["time_s"], float)).astype(int)
    seconds = np.unique(second[tracked])
    frames = [np.flatnonzero(tracked & (second == s)) for s in seconds]
    pitch, heading, offset = (
        np.array([np.median(np.asarray(rows[name])[f]) for f in frames])
        for name in ("pitch_rad", "heading_rad", "offset_m")
    )
    return seconds, pitch, heading - _weaving(heading, offset)


def _weaving(heading: np.ndarray, offset_m: np.ndarray) -> np.ndarray:
    """The part of the headings (N,) that goes with moving sideways, each second, at whatever speed."""
    if len(heading) < 3:
        return np.zeros_like(heading)
    sideways = np.gradient(offset_m)
    # Fitted to the changes from second to second, so that a step in the heading does not count.
    steps = np.diff(sideways)
    slope = steps @ np.diff(heading) / max(steps @ steps, 1e-9)
    return slope * sideways


def _largest_change(values: np.ndarray) -> tuple[int, float]:
    """Where (N,) values split best into two levels, and by how much these differ; 0 where that may be chance."""
    offs = []
    for split in range(1, len(values)):
        levels = np.median(values[:split]), np.median(values[split:])
        offs.append(np.abs(values - np.where(np.arange(len(values)) < split, *levels)))
    if not offs:
        return 0, 0.0
    split = 1 + int(np.argmin([off.sum() for off in offs]))
    before, after = split, len(values) - split
    # A median of n normal values has the variance pi / 2n.
    std = 1.4826 * np.median(offs[split - 1]) * np.sqrt(np.pi / 2 * (1 / before + 1 / after))
    change = float(np.median(values[split:]) - np.median(values[:split]))
    sure = min(before, after) >= LEAST_SECONDS and abs(change) > max(LEAST_RAD, SURE * std)
    return split, change if sure else 0.0


def _describe_turn(angle_rad: float, positive: str, negative: str) -> str | None:
    return (
        f"{np.degrees(abs(angle_rad)):.1f} deg farther {positive if angle_rad > 0 else negative}" if angle_rad else None
    )
