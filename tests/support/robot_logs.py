"""Small robot logs for tests, written with rosbags: ROS 1 bags, ROS 2 bags (folders) and their bare files."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags is not installed: pip install rosbags")
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from lanes.camera.model import Camera
from lanes.video.reader import read_timed_frames

BEGIN_NS = 1_700_000_000_250_000_000
# Images of one shade each, and the times of a log of them.
TINY = [np.full((8, 12, 3), 20 * number, np.uint8) for number in range(6)]
TINY_TIMES_S = np.arange(6) / 10
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


def stamps_at(times_s: Sequence[float]) -> list[int]:
    """Header stamps of images at these times, ns."""
    return [BEGIN_NS + round(1e9 * time_s) for time_s in times_s]


def file_of(path: Path) -> Path:
    """The file of a log, which is in a folder if it has no suffix."""
    return path if path.suffix else path / f"{path.name}.db3"


def shades(path: Path, **options: Any) -> list[float]:
    """Mean grey of each frame."""
    return [float(frame.image.mean()) for frame in read_timed_frames(path, **options)]


def make_header(stamp_ns: int, types: Any = ROS2.types) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    first = {"seq": 0} if types is ROS1.types else {}
    return types["std_msgs/msg/Header"](**first, stamp=stamp, frame_id="camera")


def make_image(image: np.ndarray, stamp_ns: int, encoding: str = "rgb8", types: Any = ROS2.types) -> Any:
    """A raw image message, in rgb8 or bgr8; or a compressed one, if the encoding is a suffix."""
    header, (height, width) = make_header(stamp_ns, types), image.shape[:2]
    if encoding.startswith("."):
        data = cv2.imencode(encoding, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].ravel()
        return types["sensor_msgs/msg/CompressedImage"](header, f"rgb8; {encoding[1:]} compressed bgr8", data)
    pixels = image[..., ::-1] if encoding == "bgr8" else image
    return types["sensor_msgs/msg/Image"](header, height, width, encoding, 0, 3 * width, pixels.ravel())


def stamp_images(images: Sequence[np.ndarray], stamps: Sequence[int], *options: Any) -> list[tuple[int, Any]]:
    """(header stamp, message) of each image, as many as there are of both; `options` are those of `make_image`."""
    return [(stamp, make_image(image, stamp, *options)) for image, stamp in zip(images, stamps, strict=False)]


def make_camera_info(camera: Camera, stamp_ns: int, types: Any = ROS2.types, **changes: Any) -> Any:
    """The calibration of a camera as a message; `changes` are fields by their names in ROS 2."""
    fields: dict[str, Any] = {
        "header": make_header(stamp_ns, types),
        "height": camera.height,
        "width": camera.width,
        "distortion_model": camera.model.name,
        "d": camera.distortion.astype(float),
        "k": camera.matrix.ravel().astype(float),
        "r": np.eye(3).ravel(),
        "p": np.column_stack([camera.matrix, np.zeros(3)]).ravel(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False),
    }
    return types["sensor_msgs/msg/CameraInfo"](*(fields | changes).values())


def write_messages(
    path: Path, topics: Mapping[str, Sequence[tuple[int, Any]]], *, mcap: bool = False, compression: str = "NONE"
) -> Path:
    """Write (time of the recording in ns, message) of each topic to a log of the kind of its suffix; returns the path.

    Without a suffix it is the folder of a ROS 2 bag, in SQLite or MCAP, with a `compression` of rosbag2 by its name.
    """
    ros1, mcap = path.suffix == ".bag", mcap or path.suffix.lower() == ".mcap"
    plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "log") if path.suffix else path
        bag = rosbag1.Writer(path) if ros1 else rosbag2.Writer(folder, version=9, storage_plugin=plugin)
        store = ROS1 if ros1 else ROS2
        if not ros1:
            bag.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
        serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
        with bag as writer:
            for topic, messages in topics.items():
                kind = messages[0][1].__msgtype__
                connection = writer.add_connection(topic, kind, typestore=store)
                for time_ns, message in messages:
                    writer.write(connection, time_ns, serialize(message, kind))
        if path.suffix and not ros1:
            shutil.copyfile(folder / f"log{path.suffix.lower()}", path)
    return path


def write_log(
    path: Path,
    images: Sequence[np.ndarray],
    times_s: Sequence[float] = (),
    *,
    stamps_ns: Sequence[int] | None = None,
    recorded_ns: Sequence[int] | None = None,
    camera: Camera | None = None,
    topic: str = "/camera/image_raw",
    **changes: Any,
) -> Path:
    """Write a log of images with header stamps at `times_s`, or `stamps_ns`; recorded later, and irregularly.

    With a camera also its `camera_info`, which has `changes`.
    """
    types = (ROS1 if path.suffix == ".bag" else ROS2).types
    stamps = stamps_at(times_s) if stamps_ns is None else stamps_ns
    if recorded_ns is None:
        recorded_ns = [stamp + 90_000_000 + 7_000_000 * (number % 2) for number, stamp in enumerate(stamps)]
    made = (message for _, message in stamp_images(images, stamps, "rgb8", types))
    topics = {topic: list(zip(recorded_ns, made, strict=True))}
    if camera:
        topics["/camera/camera_info"] = [(recorded_ns[0], make_camera_info(camera, stamps[0], types, **changes))]
    return write_messages(path, topics)
