"""Robot logs: the images on one topic of a ROS 1 bag (.bag) or a ROS 2 bag (.db3, .mcap), read with rosbags.

A log behaves like a video: `lanes.video.reader` makes frames of it. No definitions of messages are read from the log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lanes.errors import LaneError, VideoError
from lanes.files import require_file
from lanes.video.container import CLOCK_RESET_S, MAX_FPS, MAX_SHORT_SHARE, MIN_FPS, MIN_STEP

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
# Encodings of raw images (sensor_msgs/image_encodings.hpp): bytes per pixel, and OpenCV's conversion to RGB.
ENCODINGS: dict[str, tuple[int, int | None]] = {"rgb8": (3, None), "bgr8": (3, cv2.COLOR_BGR2RGB)}
ENCODINGS |= {"rgba8": (4, cv2.COLOR_RGBA2RGB), "bgra8": (4, cv2.COLOR_BGRA2RGB), "mono8": (1, cv2.COLOR_GRAY2RGB)}
ENCODINGS |= {f"bayer_{p.lower()}8": (1, getattr(cv2, f"COLOR_Bayer{p}2RGB")) for p in ("RGGB", "BGGR", "GBRG", "GRBG")}


@dataclass(frozen=True, eq=False)
class LogIndex:
    """The images on a topic, (N,), in the order of their recording, and their width and height.

    `stamps_ns` are from the headers, since 1970, or from the recording if headers have none or restart. `times_s` count
    from the first image; `numbers` skip missing images if the rate is constant.
    """

    topic: str
    size: tuple[int, int]
    fps: float
    stamps_ns: np.ndarray
    recorded_ns: np.ndarray
    times_s: np.ndarray
    numbers: np.ndarray


def is_robot_log(path: str | Path) -> bool:
    """Whether a file is a robot log: by its name, as rosbags decides."""
    return Path(path).suffix in (".bag", ".db3", ".mcap")


def index_log(path: str | Path, topic: str | None = None) -> LogIndex:
    """The images on a topic, by default the only one with images; the log is read once for calls in a row.

    Raises FileNotFoundError, or VideoError if the log cannot be read, or has no such images, or several cameras.
    """
    path = require_file(path, "robot log", error=VideoError)
    return _index_log(path, topic, path.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _index_log(path: Path, topic: str | None, *version: int) -> LogIndex:
    found, first = [], None
    with open_log(path) as (reader, deserialize):
        topic = _choose_topic(path, reader.topics, topic)
        for connection, recorded_ns, data in reader.messages(reader.topics[topic].connections):
            message = deserialize(data, connection.msgtype)
            found.append((message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, recorded_ns))
            first = decode_image(message, f"{path}: {topic}") if first is None else first
    if first is None:
        raise VideoError(f"{path}: no image on {topic} can be decoded; record raw images, JPEG or PNG.")
    stamps_ns, recorded_ns = np.array(found).T
    if not stamps_ns.all() or (np.diff(stamps_ns) < -1e9 * CLOCK_RESET_S).any():
        stamps_ns = recorded_ns
    times_s = np.maximum.accumulate(stamps_ns - stamps_ns[0]) / 1e9
    steps_s = np.diff(times_s)
    usual_s = steps_s[(steps_s > 0) & (steps_s < 1.5 * np.median(steps_s[steps_s > 0]))] if times_s[-1] else [np.inf]
    fps = round(float(1 / np.mean(usual_s)), 6)
    if not MIN_FPS <= fps <= MAX_FPS:
        raise VideoError(f"{path}: has {len(found)} images on {topic}, {fps:g} per second; name a log of a drive.")
    constant = (steps_s * fps < MIN_STEP).mean() <= MAX_SHORT_SHARE
    numbers = np.append(0, np.cumsum(np.maximum(np.rint(steps_s * fps), 1) if constant else np.ones(len(steps_s))))
    return LogIndex(topic, first.shape[1::-1], fps, stamps_ns, recorded_ns, times_s, numbers.astype(int))


def decode_image(message: Any, name: str = "image") -> np.ndarray | None:
    """The RGB image (height, width, 3), uint8, of a ROS message, raw or compressed; None if it is damaged.

    Raises VideoError about `name` if raw pixels have an encoding that is not one of `ENCODINGS`.
    """
    data = np.frombuffer(message.data, np.uint8)
    if hasattr(message, "format"):
        options = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        return cv2.imdecode(data, options) if len(data) else None
    if message.encoding not in ENCODINGS:
        raise VideoError(f"{name} has the encoding {message.encoding!r}; record one of {', '.join(ENCODINGS)}.")
    (channels, code), height, width, step = ENCODINGS[message.encoding], message.height, message.width, message.step
    if not 0 < width * channels <= step or not 0 < height * step <= len(data):
        return None
    pixels = data[: height * step].reshape(height, step)[:, : width * channels].reshape(height, width, channels)
    return pixels.copy() if code is None else cv2.cvtColor(pixels, code)


def _choose_topic(path: Path, topics: dict[str, Any], topic: str | None) -> str:
    images = sorted(name for name, info in topics.items() if info.msgtype in IMAGE_TYPES and info.msgcount)
    if topic in images or (topic is None and len({name.removesuffix("/compressed") for name in images}) == 1):
        return topic or images[0]  # raw images come before their compressed copies
    there, remedy = ", ".join(images) or "no topic", "choose one of them with --topic" if images else "name another log"
    raise VideoError(f"{path}: has images on {there}{f', not on {topic}' if topic else ''}; {remedy}.")


@contextmanager
def open_log(path: Path | str) -> Iterator[tuple[Any, Callable]]:
    """Reader of a log, and the function that deserializes its messages; errors of the block become a VideoError."""
    path, ros1 = Path(path), Path(path).suffix == ".bag"
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        with rosbag1.Reader(path) if ros1 else rosbag2.Reader(path) as reader:
            yield reader, store.deserialize_ros1 if ros1 else store.deserialize_cdr
    except LaneError:
        raise
    except ImportError as error:
        raise VideoError(f"{path}: robot logs need rosbags, which is missing; run `pip install rosbags`.") from error
    except Exception as error:  # damaged files make rosbags raise many types
        raise VideoError(f"{path}: is cut off, damaged, encrypted or no robot log ({error}); copy it again.") from error
