"""The lane of a robot log as ROS 2 messages in an MCAP file, for Foxglove, RViz and PlotJuggler.

They have the time stamps of the images. `/lane/lines` is a MarkerArray in the frame `base_link`, here the road frame: x
forward, y left, z up, metres, from the road below the camera. The other topics are columns of the telemetry, with units
in their names, one Float64 each, because every tool plots these; NaN if nothing is known.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from lanes.canvas import LANE_COLOUR, UNLIKELY_COLOUR
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.lane import Lane, Line
from lanes.detect.road import road_height
from lanes.draw import SHORTEST_M
from lanes.files import TelemetryWriter, atomic_write, translate_write_errors
from lanes.track.tracker import LaneTracker
from lanes.video.robot_log import LogIndex

# Suffix of the file, unlike that of a log.
MESSAGES_SUFFIX = ".lane.mcap"
NUMBERS = ["confidence", "offset_m", "offset_std_m", "heading_rad", "curvature_per_m", "curvature_std_per_m"]
NUMBERS += ["lane_width_m", "left_c0_m", "right_c0_m", "far_left_c0_m", "far_right_c0_m", "latency_ms"]
TYPES = {"lines": "visualization_msgs/msg/MarkerArray"} | dict.fromkeys(NUMBERS, "std_msgs/msg/Float64")
# Points of a line; width of the lines; opacity of a line that is seen itself, and of one that is inferred.
POINTS, WIDTH_M, SEEN_ALPHA, INFERRED_ALPHA = 24, 0.12, 1.0, 0.4


class LaneMessageWriter(TelemetryWriter):
    """Writer of a robot log's telemetry: its table, and messages next to it; a row is the last image of `tracker`."""

    def __init__(self, path: str | Path, tracker: LaneTracker, log: LogIndex) -> None:
        super().__init__(path)
        self.messages_path, self._tracker = self.path.with_suffix(MESSAGES_SUFFIX), tracker
        self._stamps_ns = dict(zip(log.numbers.tolist(), log.stamps_ns.tolist(), strict=True))
        self._file = _open_mcap(self.messages_path)

    def __enter__(self) -> LaneMessageWriter:
        super().__enter__()
        self._writer, self._store = self._file.__enter__()
        add = self._writer.add_connection
        self._topics = {name: add(f"/lane/{name}", kind, typestore=self._store) for name, kind in TYPES.items()}
        return self

    def __exit__(self, *error: Any) -> None:
        self._file.__exit__(*error)
        super().__exit__(*error)

    def write(self, row: Mapping[str, Any]) -> None:
        """Append a row, and the messages of its frame."""
        super().write(row)
        stamp_ns = self._stamps_ns[row["frame"]]
        values = {**row, "lines": self._make_markers(self._tracker.lane, stamp_ns)}
        for name, topic in self._topics.items():
            message = self._store.types[topic.msgtype](np.nan if values[name] is None else values[name])
            with translate_write_errors(self.messages_path):
                self._writer.write(topic, stamp_ns, self._store.serialize_cdr(message, topic.msgtype))

    def _make_markers(self, lane: Lane | None, stamp_ns: int) -> list:
        """Markers of the left, the right and the far lines; that of a line that is not known deletes it."""
        t = {name.rpartition("/")[2]: kind for name, kind in self._store.types.items()}
        header, no_bytes = t["Header"](t["Time"](*divmod(stamp_ns, 10**9)), "base_link"), np.empty(0, np.uint8)
        pose, scale = t["Pose"](t["Point"](0, 0, 0), t["Quaternion"](0, 0, 0, 1)), t["Vector3"](WIDTH_M, 0, 0)
        texture, mesh = t["CompressedImage"](header, "", no_bytes), t["MeshFile"]("", no_bytes)
        likely, markers = lane is not None and lane.confidence >= LIKELY_CONFIDENCE, []
        for number, line in enumerate((*lane.lines, *lane.adjacent) if lane else (None,) * 4):
            points = [t["Point"](*xyz) for xyz in line_points_m(lane, line)] if lane and line else []
            alpha = SEEN_ALPHA if line and line.seen else INFERRED_ALPHA
            colour = t["ColorRGBA"](*np.divide(LANE_COLOUR if likely else UNLIKELY_COLOUR, 255), alpha)
            action = t["Marker"].ADD if points else t["Marker"].DELETE
            what = (header, "lane", number, t["Marker"].LINE_STRIP, action, pose, scale, colour, t["Duration"](0, 0))
            markers.append(t["Marker"](*what, False, points, [], "", texture, [], "", "", mesh, False))
        return markers


def line_points_m(lane: Lane, line: Line) -> np.ndarray:
    """Points (N, 3) of a line in the road frame, metres, from beside the car as far as it is drawn on images."""
    own = any(line is one for one in lane.lines)
    reach_m = max(lane.left.reach_m, lane.right.reach_m, SHORTEST_M) if own else line.reach_m
    x_m = reach_m * np.linspace(0, 1, POINTS) ** 2
    points = np.column_stack([x_m, line.y(x_m), road_height(line.model, x_m)])
    return points[np.isfinite(points).all(axis=1)]


@contextmanager
def _open_mcap(path: Path) -> Iterator[tuple[Any, Any]]:
    """A writer of an MCAP file, which is written whole, and the types of its messages."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    with atomic_write(path) as partial, TemporaryDirectory() as folder:
        writer = Writer(Path(folder, "lane"), version=9, storage_plugin=StoragePlugin.MCAP)  # writes a folder
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            yield writer, get_typestore(Stores.ROS2_HUMBLE)
        with translate_write_errors(path):
            shutil.copyfile(Path(folder, "lane", "lane.mcap"), partial)
