"""Small robot logs for tests, written with rosbags.

ROS 1 bags, ROS 2 bags (folders) and their bare files.
"""

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
ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
# (time of the recording in ns, message) of each message on a topic.
Messages = Sequence[tuple[int, Any]]


def stamps_at(times_s: Sequence[float]) -> list[int]:
    """Header stamps of images at these times, ns."""
    return [BEGIN_NS + round(1e9 * time_s) for time_s in times_s]


def file_of(path: Path) -> Path:
    """The file of a log, which is in a folder if it has no suffix."""
    return path if path.suffix else path / f"{path.name}.db3"


def shades(path: Path, **options: Any) -> list[float]:
    """Mean grey of each frame."""
    frames = read_timed_frames(path, **options)
    return [float(frame.image.mean()) for frame in frames]


def make_header(stamp_ns: int, types: Any = ROS2.types) -> Any:
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    first = {"seq": 0} if types is ROS1.types else {}
    return types["std_msgs/msg/Header"](**first, stamp=stamp, frame_id="camera")


def make_image(
    image: np.ndarray, stamp_ns: int, encoding: str = "rgb8", types: Any = ROS2.types
) -> Any:
    """A raw image message, in rgb8 or bgr8; compressed if the encoding is a suffix."""
    header = make_header(stamp_ns, types)
    if encoding.startswith("."):
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        _, data = cv2.imencode(encoding, bgr)
        format_ = f"rgb8; {encoding[1:]} compressed bgr8"
        return types["sensor_msgs/msg/CompressedImage"](header, format_, data.ravel())

    height, width = image.shape[:2]
    pixels = image[..., ::-1] if encoding == "bgr8" else image
    return types["sensor_msgs/msg/Image"](
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=3 * width,
        data=pixels.ravel(),
    )


def stamp_images(
    images: Sequence[np.ndarray], stamps_ns: Sequence[int], *options: Any
) -> list[tuple[int, Any]]:
    """(header stamp, message) of each image, as many as there are of both.

    `options` are those of `make_image`.
    """
    made = []
    for image, stamp_ns in zip(images, stamps_ns, strict=False):
        made.append((stamp_ns, make_image(image, stamp_ns, *options)))
    return made


def make_camera_info(
    camera: Camera, stamp_ns: int, types: Any = ROS2.types, **changes: Any
) -> Any:
    """The calibration of a camera; `changes` are fields by their names in ROS 2."""
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
    fields |= changes
    # some are upper case in ROS 1
    return types["sensor_msgs/msg/CameraInfo"](*fields.values())


class Damaged(bytes):
    """The data of a message that cannot be read, of this type."""

    __msgtype__ = "sensor_msgs/msg/CameraInfo"


def write_messages(
    path: Path,
    topics: Mapping[str, Messages],
    *,
    mcap: bool = False,
    compression: str = "NONE",
) -> Path:
    """Write messages to a log of the kind of the path's suffix; returns the path.

    Without a suffix it is the folder of a ROS 2 bag, in SQLite or MCAP, with a
    `compression` of rosbag2 by its name.
    """
    if path.suffix == ".bag":
        with rosbag1.Writer(path) as bag:
            _write_topics(bag, topics, ROS1, ROS1.serialize_ros1)
        return path

    is_mcap = mcap or path.suffix.lower() == ".mcap"
    plugin = rosbag2.StoragePlugin.MCAP if is_mcap else rosbag2.StoragePlugin.SQLITE3
    mode = rosbag2.CompressionMode[compression]
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent, "log") if path.suffix else path
        bag = rosbag2.Writer(folder, version=9, storage_plugin=plugin)
        bag.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
        with bag:
            _write_topics(bag, topics, ROS2, ROS2.serialize_cdr)
        if path.suffix:
            shutil.copyfile(folder / f"log{path.suffix.lower()}", path)
    return path


def _write_topics(
    bag: Any, topics: Mapping[str, Messages], store: Any, serialize: Any
) -> None:
    for topic, messages in topics.items():
        _, first = messages[0]
        kind = first.__msgtype__
        connection = bag.add_connection(topic, kind, typestore=store)
        for time_ns, message in messages:
            is_damaged = isinstance(message, Damaged)
            data = bytes(message) if is_damaged else serialize(message, kind)
            bag.write(connection, time_ns, data)


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
    """Write a log of images with header stamps at `times_s`, or `stamps_ns`.

    They are recorded later, and irregularly. With a camera the log also has its
    `camera_info`, which has `changes`.
    """
    types = (ROS1 if path.suffix == ".bag" else ROS2).types
    if stamps_ns is None:
        stamps_ns = stamps_at(times_s)
    if recorded_ns is None:
        recorded_ns = []
        for number, stamp_ns in enumerate(stamps_ns):
            recorded_ns.append(stamp_ns + 90_000_000 + 7_000_000 * (number % 2))

    made = stamp_images(images, stamps_ns, "rgb8", types)
    messages = [message for _, message in made]
    topics = {topic: list(zip(recorded_ns, messages, strict=True))}
    if camera:
        info = make_camera_info(camera, stamps_ns[0], types, **changes)
        topics["/camera/camera_info"] = [(recorded_ns[0], info)]
    return write_messages(path, topics)
