"""Telemetry: the columns of a lane, and the row of a frame.

`lanes.files.TelemetryWriter` writes the rows into a CSV file. The time of a frame and
its number come before these columns. docs/conventions.md describes each column.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import attrgetter

import numpy as np

from lanes.detect.lane import Lane, Line

Value = str | float | None
# Columns by name, arrays (frames,), as `lanes.files.read_telemetry` returns them.
Telemetry = Mapping[str, np.ndarray]

# In the column `state`: no lane is known.
LOST = "lost"
# The numbers of a camera pose, after "pose_".
POSE_NAMES = ("height_m", "pitch_rad", "yaw_rad", "roll_rad")


def _line_columns(side: str) -> dict[str, Callable[[Lane], Value]]:
    """The columns of the "left" or the "right" line."""
    line: Callable[[Lane], Line] = attrgetter(side)
    return {
        f"{side}_c0_m": lambda lane: line(lane).coefficients[0],
        f"{side}_c1": lambda lane: line(lane).coefficients[1],
        f"{side}_c2_per_m": lambda lane: line(lane).coefficients[2],
        f"{side}_c3_per_m2": lambda lane: line(lane).coefficients[3],
        f"{side}_kind": lambda lane: line(lane).kind,
        f"{side}_colour": lambda lane: line(lane).colour,
        f"{side}_double": lambda lane: line(lane).double,
    }


def _far_offset_m(side: int) -> Callable[[Lane], Value]:
    """The column of a far line of the adjacent lanes: 0 is left, 1 is right."""

    def offset_m(lane: Lane) -> Value:
        line = lane.adjacent[side]
        return line.offset_m if line else None

    return offset_m


def _due_departure(lane: Lane) -> Value:
    """The line that the car is about to cross, if a warning is due."""
    departure = lane.departure
    return departure.side if departure and departure.due else None


def _of_pose(name: str) -> Callable[[Lane], Value]:
    """The column of a number of the camera pose."""

    def number(lane: Lane) -> Value:
        pose = lane.camera.pose if lane.camera else None
        return getattr(pose, name) if pose else None

    return number


# The columns by name, in order, each with its value of a lane.
COLUMNS: dict[str, Callable[[Lane], Value]] = {
    "state": attrgetter("state"),
    "confidence": attrgetter("confidence"),
    "confident_to_m": attrgetter("confident_to_m"),
    "offset_m": attrgetter("offset_m"),
    "offset_std_m": attrgetter("offset_std_m"),
    "heading_rad": attrgetter("heading_rad"),
    "curvature_per_m": attrgetter("curvature_per_m"),
    "curvature_std_per_m": attrgetter("curvature_std_per_m"),
    "lane_width_m": attrgetter("width_m"),
    "pitch_rad": attrgetter("pitch_rad"),
    "camera_yaw_rad": attrgetter("camera_yaw_rad"),
    **_line_columns("left"),
    **_line_columns("right"),
    "far_left_c0_m": _far_offset_m(0),
    "far_right_c0_m": _far_offset_m(1),
    "departure": _due_departure,
    **{f"pose_{name}": _of_pose(name) for name in POSE_NAMES},
}


def telemetry_row(lane: Lane | None) -> dict[str, Value]:
    """Telemetry of a frame, by column name; None where the lane is lost."""
    if lane is None:
        unknown: dict[str, Value] = dict.fromkeys(COLUMNS)
        return unknown | {"state": LOST, "confidence": 0.0}
    return {name: value(lane) for name, value in COLUMNS.items()}
