"""The lane of a robot log as ROS 2 messages in an MCAP file, for Foxglove, RViz and PlotJuggler.

They have the time stamps of the images. `/lane/lines` is a MarkerArray in the frame `base_link`, here the road frame: x
forward, y left, z up, metres, from the road below the camera, or beside it at the middle of the car. The other topics
are columns of the telemetry, with units in their names, one Float64 each, because every tool plots these; NaN if
nothing is known.
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
from lanes.detect.lane import Lane, telemetry_row
from lanes.detect.road import road_height
from lanes.files import MESSAGES_SUFFIX, TelemetryWriter, atomic_write, translate_write_errors
from lanes.ros.robot_log import LogIndex
from lanes.tracking.tracker import LaneTracker

_TYPES = {n: "std_msgs/msg/Float64" for n in telemetry_row(None) if n.endswith(("confidence", "_m", "_rad"))}
_TYPES["lines"] = "visualization_msgs/msg/MarkerArray"
# Shares of the reach of a line that have a point; width of lines; opacity of one that is seen, and of one that is not.
_SHARES, _WIDTH_M, _SEEN_ALPHA, INFERRED_ALPHA = np.linspace(0, 1, 24) ** 2, 0.12, 1.0, 0.4


@contextmanager
def write_lane_messages(path: Path, tracker: LaneTracker, log: LogIndex) -> Iterator[TelemetryWriter]:
    """A writer of the table `path` that also writes messages next to it; its rows are the last image of `tracker`."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    mcap = path.with_suffix(MESSAGES_SUFFIX)
    with atomic_write(mcap) as partial, _spool(partial.with_suffix(".spool")) as folder:
        writer = Writer(folder / "lane", version=9, storage_plugin=StoragePlugin.MCAP)  # writes a folder
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            yield LaneMessageWriter(path, tracker, log, writer, get_typestore(Stores.ROS2_HUMBLE))
        with translate_write_errors(mcap):
            os.replace(folder / "lane" / "lane.mcap", partial)


@contextmanager
def _spool(folder: Path) -> Iterator[Path]:
    """A folder beside the output, as the system's temporary one may be in memory; one of a killed run is removed."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class LaneMessageWriter(TelemetryWriter):
    """See `write_lane_messages`; `writer` and `store` are rosbags' writer of messages and its types of them."""

    def __init__(self, path: Path, tracker: LaneTracker, log: LogIndex, writer: Any, store: Any) -> None:
        super().__init__(path)
        self._tracker, self._writer, self._store = tracker, writer, store
        self._stamps_ns = dict(zip(log.numbers.tolist(), log.stamps_ns.tolist(), strict=True))
        add = writer.add_connection
        self._topics = {name: add(f"/lane/{name}", kind, typestore=store) for name, kind in _TYPES.items()}

    def write(self, row: Mapping[str, Any]) -> None:
        """Append a row, and the messages of its frame."""
        super().write(row)
        stamp_ns = self._stamps_ns[row["frame"]]
        values = {**row, "lines": self._make_markers(self._tracker.lane, stamp_ns)}
        for name, topic in self._topics.items():
            message = self._store.types[topic.msgtype](np.nan if values[name] is None else values[name])
            with translate_write_errors(self.path.with_suffix(MESSAGES_SUFFIX)):
                self._writer.write(topic, stamp_ns, self._store.serialize_cdr(message, topic.msgtype))

    def _make_markers(self, lane: Lane | None, stamp_ns: int) -> list:
        """Markers of the left, the right and the far lines; that of a line that is not known deletes it."""
        t = {name.rpartition("/")[2]: kind for name, kind in self._store.types.items()}
        header, no_bytes = t["Header"](t["Time"](*divmod(stamp_ns, 10**9)), "base_link"), np.empty(0, np.uint8)
        pose, scale = t["Pose"](t["Point"](0, 0, 0), t["Quaternion"](0, 0, 0, 1)), t["Vector3"](_WIDTH_M, 0, 0)
        texture, mesh = t["CompressedImage"](header, "", no_bytes), t["MeshFile"]("", no_bytes)
        colour = np.divide(LANE_COLOUR if lane and lane.confidence >= LIKELY_CONFIDENCE else UNLIKELY_COLOUR, 255)
        markers, ends_m = [], lane.ends_m if lane else (0.0, 0.0)
        for number, line in enumerate((*lane.lines, *lane.adjacent) if lane else (None,) * 4):
            x_m = _SHARES * (line.reach_m if number > 1 else ends_m[number]) if line else _SHARES
            offset_m = lane.camera_offset_m if lane else 0.0
            yz_m = (line.y(x_m) + offset_m, road_height(line.model, x_m)) if line else ()
            points = [t["Point"](*xyz) for xyz in np.column_stack([x_m, *yz_m]) if line and np.isfinite(xyz).all()]
            rgba = t["ColorRGBA"](*colour, _SEEN_ALPHA if line and line.seen else INFERRED_ALPHA)
            action = t["Marker"].ADD if points else t["Marker"].DELETE
            what = (header, "lane", number, t["Marker"].LINE_STRIP, action, pose, scale, rgba, t["Duration"](0, 0))
            markers.append(t["Marker"](*what, False, points, [], "", texture, [], "", "", mesh, False))
        return markers
