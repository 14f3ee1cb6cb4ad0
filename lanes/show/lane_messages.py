"""The lane of a robot log as ROS 2 messages in an MCAP file.

For Foxglove, RViz and PlotJuggler. They have the time stamps of the images.
`/lane/lines` is a MarkerArray in the frame `base_link`, here the road frame: x forward,
y left, z up, metres, from the road below the camera, or beside it at the middle of the
car. The other topics are columns of the telemetry, with units in their names, one
Float64 each, because every tool plots these; NaN if nothing is known.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lanes.canvas import LANE_COLOUR, UNLIKELY_COLOUR
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.lane import Lane, Line
from lanes.detect.road import road_height
from lanes.files import (
    MESSAGES_SUFFIX,
    TelemetryWriter,
    atomic_write,
    translate_write_errors,
)
from lanes.ros.robot_log import LogIndex
from lanes.telemetry import telemetry_row
from lanes.tracking.tracker import LaneTracker

_NUMBERS = [
    name for name in telemetry_row(None) if name.endswith(("confidence", "_m", "_rad"))
]
# Types of the messages by the name of their topic.
_TYPES = dict.fromkeys(_NUMBERS, "std_msgs/msg/Float64")
_TYPES["lines"] = "visualization_msgs/msg/MarkerArray"
# Shares of the reach of a line that have a point: closer together near the car.
_SHARES = np.linspace(0, 1, 24) ** 2
_WIDTH_M = 0.12
# Opacity of a line that is seen, and of one that is not.
_SEEN_ALPHA = 1.0
INFERRED_ALPHA = 0.4


@contextmanager
def write_lane_messages(
    path: Path, tracker: LaneTracker, log: LogIndex
) -> Iterator[TelemetryWriter]:
    """A writer of the table `path` that also writes messages next to it.

    Its rows are the last image of `tracker`.
    """
    from rosbags.rosbag2 import (
        CompressionFormat,
        CompressionMode,
        StoragePlugin,
        Writer,
    )
    from rosbags.typesys import Stores, get_typestore

    mcap = path.with_suffix(MESSAGES_SUFFIX)
    with atomic_write(mcap) as partial, _spool(partial.with_suffix(".spool")) as folder:
        # rosbags writes a folder
        recording = folder / "lane"
        writer = Writer(recording, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        store = get_typestore(Stores.ROS2_HUMBLE)
        with writer:
            yield LaneMessageWriter(path, tracker, log, writer, store)
        with translate_write_errors(mcap):
            os.replace(recording / "lane.mcap", partial)


@contextmanager
def _spool(folder: Path) -> Iterator[Path]:
    """A folder beside the output, as the system's temporary one may be in memory.

    One of a killed run is removed.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class LaneMessageWriter(TelemetryWriter):
    """See `write_lane_messages`; `writer` and `store` are rosbags' writer and types."""

    def __init__(
        self, path: Path, tracker: LaneTracker, log: LogIndex, writer: Any, store: Any
    ) -> None:
        super().__init__(path)
        self._tracker = tracker
        self._writer = writer
        self._store = store
        self._types = {}
        for name, message_type in store.types.items():
            self._types[name.rpartition("/")[2]] = message_type

        stamps_ns = log.stamps_ns.tolist()
        self._stamps_ns = dict(zip(log.numbers.tolist(), stamps_ns, strict=True))
        self._topics = {}
        for name, kind in _TYPES.items():
            topic = writer.add_connection(f"/lane/{name}", kind, typestore=store)
            self._topics[name] = topic

    def write(self, row: Mapping[str, Any]) -> None:
        """Append a row, and the messages of its frame."""
        super().write(row)
        stamp_ns = self._stamps_ns[row["frame"]]
        for name, topic in self._topics.items():
            value = row.get(name)
            if name == "lines":
                value = self._make_markers(self._tracker.lane, stamp_ns)
            elif value is None:
                value = np.nan
            message = self._store.types[topic.msgtype](value)
            data = self._store.serialize_cdr(message, topic.msgtype)
            with translate_write_errors(self.path.with_suffix(MESSAGES_SUFFIX)):
                self._writer.write(topic, stamp_ns, data)

    def _make_markers(self, lane: Lane | None, stamp_ns: int) -> list:
        """Markers of the left, the right and the far lines.

        That of a line that is not known deletes it.
        """
        if lane is None:
            nothing = np.empty((0, 3))
            colour = (*UNLIKELY_COLOUR, INFERRED_ALPHA)
            return [self._marker(n, stamp_ns, nothing, colour) for n in range(4)]

        is_likely = lane.confidence >= LIKELY_CONFIDENCE
        rgb = LANE_COLOUR if is_likely else UNLIKELY_COLOUR
        reaches_m = [*lane.ends_m]
        for line in lane.adjacent:
            reaches_m.append(line.reach_m if line else 0.0)

        markers = []
        lines = (*lane.lines, *lane.adjacent)
        for number, (line, reach_m) in enumerate(zip(lines, reaches_m, strict=True)):
            points = _points_of(line, reach_m, lane.camera_offset_m)
            is_seen = line is not None and line.seen
            colour = (*rgb, _SEEN_ALPHA if is_seen else INFERRED_ALPHA)
            markers.append(self._marker(number, stamp_ns, points, colour))
        return markers

    def _marker(
        self,
        number: int,
        stamp_ns: int,
        points: np.ndarray,
        colour: tuple[float, float, float, float],
    ) -> Any:
        """A marker of a line through points (N, 3); without any it deletes the line.

        `colour` is red, green and blue of 255, and the opacity.
        """
        types = self._types
        marker = types["Marker"]
        seconds, nanoseconds = divmod(stamp_ns, 10**9)
        header = types["Header"](
            stamp=types["Time"](sec=seconds, nanosec=nanoseconds), frame_id="base_link"
        )
        pose = types["Pose"](
            position=types["Point"](x=0, y=0, z=0),
            orientation=types["Quaternion"](x=0, y=0, z=0, w=1),
        )
        red, green, blue = np.divide(colour[:3], 255)
        no_bytes = np.empty(0, np.uint8)
        return marker(
            header=header,
            ns="lane",
            id=number,
            type=marker.LINE_STRIP,
            action=marker.ADD if len(points) else marker.DELETE,
            pose=pose,
            scale=types["Vector3"](x=_WIDTH_M, y=0, z=0),
            color=types["ColorRGBA"](r=red, g=green, b=blue, a=colour[3]),
            lifetime=types["Duration"](sec=0, nanosec=0),
            frame_locked=False,
            points=[types["Point"](x=x, y=y, z=z) for x, y, z in points],
            colors=[],
            texture_resource="",
            texture=types["CompressedImage"](header=header, format="", data=no_bytes),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=types["MeshFile"](filename="", data=no_bytes),
            mesh_use_embedded_materials=False,
        )


def _points_of(line: Line | None, reach_m: float, offset_m: float) -> np.ndarray:
    """Points (N, 3) of a line on the road up to `reach_m`, without unknown ones."""
    if line is None:
        return np.empty((0, 3))
    x_m = _SHARES * reach_m
    y_m = line.y(x_m) + offset_m
    z_m = road_height(line.model, x_m)
    points = np.column_stack([x_m, y_m, z_m])
    return points[np.isfinite(points).all(axis=1)]
