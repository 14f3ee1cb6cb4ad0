"""Robot logs behave like videos: the images on one topic of a log, with their times.

`lanes.ros.log_files` opens logs and reads messages, `lanes.ros.log_images` decodes
their pixels. `index_log` finds the images, repairs their times and numbers them as
frames; `read_log` reads a part of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lanes.errors import VideoError
from lanes.files import require_file
from lanes.recording import (
    CLOCK_RESET_S,
    MAX_FPS,
    MAX_SHORT_SHARE,
    MIN_FPS,
    MIN_STEP,
    count_bits,
    usual_rate,
)
from lanes.ros.log_files import LogReader, Topic, file_of_log, open_log
from lanes.ros.log_images import (
    decode_image,
    decode_video,
    find_peak,
    is_key_frame,
)

# Types of messages with an image each, and others of videos.
_IMAGE_KINDS = ("Image", "RawImage", "CompressedImage", "CompressedVideo")
_OTHER_KINDS = ("FFMPEGPacket", "H264Packet")
_PACKAGES = ("sensor_msgs", "foxglove", "foxglove_msgs")
# Encodings of messages that are read.
_ENCODINGS = ("cdr", "ros1", "protobuf", "json")
# Raw images whose largest values show the bits of the camera.
_SAMPLED_PEAKS = 16
# A longer step is that of a clock, or joins two recordings. It is shortened to a step
# after which the tracker starts again.
_JUMP_S = 60.0
_SHORTENED_S = 5.0


@dataclass(frozen=True, eq=False)
class LogIndex:
    """The images on a topic, (N,), in the order of their times.

    Attributes
    ----------
    topic : str
    size : (int, int)
        Width and height, pixels.
    fps : float
        Images per second between gaps.
    stamps_ns : ndarray of shape (N,), int
        From the headers, since 1970; from the recording if they have none or restart.
    recorded_ns : ndarray of shape (N,), int
        Times of the recording.
    times_s : ndarray of shape (N,)
        From the first image on.
    numbers : ndarray of shape (N,), int
        Frame numbers; they skip missing images if the rate is constant.
    places : ndarray of shape (N,), int
        Places among the messages of the topic.
    bits : int
        Bits of the values of raw images with two bytes.
    note : str
        Corrections of the times in words; empty without any.
    codec : str
        That of a video; empty for images.
    key_frames : ndarray of shape (N,), bool, or None
        Frames of a video from which on it can be decoded.
    """

    topic: str
    size: tuple[int, int]
    fps: float
    stamps_ns: np.ndarray
    recorded_ns: np.ndarray
    times_s: np.ndarray
    numbers: np.ndarray
    places: np.ndarray
    bits: int
    note: str = ""
    codec: str = ""
    key_frames: np.ndarray | None = None


def index_log(path: str | Path, topic: str | None = None) -> LogIndex:
    """The images on a topic, by default the only one with images.

    The log is read once for calls in a row. Raises FileNotFoundError, or VideoError if
    the log cannot be read, or has no such images, or several cameras.
    """
    path = Path(path)
    status = require_file(file_of_log(path), "robot log", error=VideoError).stat()
    return _index_log(path, topic, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4)
def _index_log(path: Path, topic: str | None, *version: int) -> LogIndex:
    with open_log(path) as log:
        topic = _choose_topic(path, log.topics, topic)
        scan = _scan_messages(log, topic, f"{path}: {topic}")
    if scan.size is None:
        raise VideoError(
            f"{path}: no image on {topic} can be decoded; "
            "record raw images, JPEG or PNG."
        )

    stamps_ns, outliers = _usable_stamps(scan.stamps_ns, scan.recorded_ns)
    order = np.argsort(stamps_ns, kind="stable")
    stamps_ns = stamps_ns[order]

    timeline = _make_timeline(stamps_ns)
    if not MIN_FPS <= timeline.fps <= MAX_FPS:
        raise VideoError(
            f"{path}: has {len(order)} images on {topic}, {timeline.fps:g} per second; "
            "name a log of a drive."
        )
    return LogIndex(
        topic=topic,
        size=scan.size,
        fps=timeline.fps,
        stamps_ns=stamps_ns,
        recorded_ns=scan.recorded_ns[order],
        times_s=timeline.times_s,
        numbers=timeline.numbers,
        places=order,
        bits=scan.bits,
        note=_describe_times(outliers, timeline.jumps_s),
        codec=scan.codec,
        key_frames=scan.key_frames[order] if scan.codec else None,
    )


# What a log has.


def _choose_topic(path: Path, topics: dict[str, Topic], topic: str | None) -> str:
    """The topic, or the only one with images; VideoError with those there are."""
    known = [found for found in topics.values() if found.count]
    images = sorted(found.name for found in known if _is_read(found))
    cameras = {name.removesuffix("/compressed") for name in images}
    if topic in images:
        return topic
    if topic is None and len(cameras) == 1:
        return images[0]  # raw images come before their compressed copies

    others = []
    for found in known:
        if found.kind in (*_IMAGE_KINDS, *_OTHER_KINDS) and found.name not in images:
            others.append(found)
    is_asked_for = any(found.name == topic for found in others)
    if others and (not images or is_asked_for):
        listed = [
            f"{found.type_name} ({found.encoding}) on {found.name}" for found in others
        ]
        raise VideoError(
            f"{path}: has {', '.join(listed)}, which is not read; "
            "record images, or convert a video in it to mp4."
        )
    there = ", ".join(images) if images else "no topic"
    missing = f", not on {topic}" if topic else ""
    remedy = "choose one of them with --topic" if images else "name another log"
    raise VideoError(f"{path}: has images on {there}{missing}; {remedy}.")


def _is_read(topic: Topic) -> bool:
    """Whether the messages of a topic are images that are read."""
    has_images = topic.kind in _IMAGE_KINDS and topic.package in _PACKAGES
    return has_images and topic.encoding in _ENCODINGS


@dataclass(frozen=True, eq=False)
class _Scan:
    """What the messages of a topic show, in their order, and the size of an image.

    `size` is None if no image can be decoded. See `LogIndex`.
    """

    size: tuple[int, int] | None
    stamps_ns: np.ndarray
    recorded_ns: np.ndarray
    bits: int
    codec: str
    key_frames: np.ndarray


def _scan_messages(log: LogReader, topic: str, name: str) -> _Scan:
    """Read all messages, and decode the first image that is not damaged."""
    stamps_ns = []
    all_recorded_ns = []
    key_frames = []
    peaks = []
    is_video = log.topics[topic].kind == "CompressedVideo"
    every = max(1, log.topics[topic].count // _SAMPLED_PEAKS)
    codec = ""
    for place, (recorded_ns, message) in enumerate(log.messages(topic)):
        stamps_ns.append(_stamp_ns(message))
        all_recorded_ns.append(recorded_ns)
        if is_video:
            codec = codec or str(message.format).lower()
            key_frames.append(is_key_frame(message.data, codec))
        elif place % every == 0:
            peaks.append(find_peak(message, name))

    messages = enumerate(message for _, message in log.messages(topic))
    _, first = next(_decode(messages, codec, name), (0, None))
    return _Scan(
        size=None if first is None else first.shape[1::-1],
        stamps_ns=np.array(stamps_ns, np.int64),
        recorded_ns=np.array(all_recorded_ns, np.int64),
        bits=count_bits(peaks),
        codec=codec,
        key_frames=np.array(key_frames, bool),
    )


def _stamp_ns(message: Any) -> int:
    """The time in the header of a message of ROS, or of Foxglove's schemas."""
    has_header = hasattr(message, "header")
    stamp = message.header.stamp if has_header else message.timestamp
    fields: dict[str, Any] = stamp if isinstance(stamp, dict) else vars(stamp)
    # by ROS 2, by ROS 1 and Foxglove, by the JSON of ROS 1
    seconds = fields.get("sec", fields.get("secs", 0))
    nanoseconds = 0
    for name in ("nanosec", "nsec", "nsecs"):
        nanoseconds = fields.get(name, nanoseconds)
    return int(seconds) * 10**9 + int(nanoseconds)


# Times.


def _usable_stamps(
    stamps_ns: np.ndarray, recorded_ns: np.ndarray
) -> tuple[np.ndarray, int]:
    """The stamps (N,) in the order of recording, and how many outliers were replaced.

    They are the times of the recording if the stamps cannot be used.
    """
    outliers = _find_outliers(stamps_ns)
    good = np.flatnonzero(~outliers)
    if outliers.any() and len(good) > 1:
        # from the first one on: floats of nanoseconds since 1970 have steps of 256
        base_ns = stamps_ns[good[0]]
        good_ns = (stamps_ns[good] - base_ns).astype(float)
        between_ns = np.interp(np.arange(len(stamps_ns)), good, good_ns)
        replaced_ns = base_ns + np.rint(between_ns).astype(np.int64)
        stamps_ns = np.where(outliers, replaced_ns, stamps_ns)

    latest_ns = np.maximum.accumulate(stamps_ns)
    restarts = (latest_ns - stamps_ns).max() > 1e9 * CLOCK_RESET_S
    is_constant = len(stamps_ns) > 1 and np.ptp(stamps_ns) == 0
    if not stamps_ns.all() or restarts or is_constant:
        return recorded_ns, 0
    return stamps_ns, int(outliers.sum())


def _find_outliers(stamps_ns: np.ndarray) -> np.ndarray:
    """Which stamps (N,) are far from the median of five in a row.

    Far is more than a second, and three usual steps.
    """
    if len(stamps_ns) < 3:
        return np.zeros(len(stamps_ns), bool)

    # continued beyond the ends by a reflection: the median of stamps in order is
    # always the one in the middle
    before = 2 * stamps_ns[0] - stamps_ns[2:0:-1]
    after = 2 * stamps_ns[-1] - stamps_ns[-2:-4:-1]
    continued = np.concatenate([before, stamps_ns, after])
    five = np.lib.stride_tricks.sliding_window_view(continued, 5)
    residual_ns = np.abs(stamps_ns - np.median(five, axis=1))
    usual_ns = np.median(np.abs(np.diff(stamps_ns)))
    return residual_ns > max(1e9, 3 * usual_ns)


@dataclass(frozen=True, eq=False)
class _Timeline:
    """Times (N,) and frame numbers (N,) of images, see `LogIndex`.

    `jumps_s` are the steps of the clock that were shortened.
    """

    fps: float
    times_s: np.ndarray
    numbers: np.ndarray
    jumps_s: np.ndarray


def _make_timeline(stamps_ns: np.ndarray) -> _Timeline:
    """Times and frame numbers of images with sorted stamps (N,)."""
    steps_s = np.diff(stamps_ns) / 1e9
    is_jump = steps_s > _JUMP_S
    jumps_s = steps_s[is_jump]
    steps_s[is_jump] = _SHORTENED_S
    times_s = np.append(0, np.cumsum(steps_s))

    # at a constant rate a long step skips images, but not at a jump
    fps = round(usual_rate(steps_s), 6)
    frames = steps_s * fps
    short = np.count_nonzero(frames < MIN_STEP)
    is_constant = short <= MAX_SHORT_SHARE * len(frames)
    whole_frames = np.maximum(np.rint(frames), 1)
    advance = np.where(is_constant & ~is_jump, whole_frames, 1)
    numbers = np.append(0, np.cumsum(advance)).astype(int)
    return _Timeline(fps, times_s, numbers, jumps_s)


def _describe_times(outliers: int, jumps_s: np.ndarray) -> str:
    """The corrections of the times, in words; empty without any."""
    words = []
    if outliers:
        words.append(
            f"{outliers} time stamps far from those of the images around them are "
            "replaced"
        )
    if len(jumps_s):
        words.append(
            f"{len(jumps_s)} jumps of its clock, of up to {jumps_s.max():.0f} s, are "
            f"shortened to {_SHORTENED_S:g} s"
        )
    return "; ".join(words)


# Images.


def read_log(
    path: str | Path, log: LogIndex, first: int, end: int
) -> Iterator[tuple[int, np.ndarray]]:
    """Index and image of the images first <= index < `end` of a log, in order.

    Damaged ones are left out.
    """
    if first >= end:
        return
    begin = _decoded_from(log, first)
    begin_ns = int(log.recorded_ns[begin:end].min())

    # where each message that is read from there on comes in the order of the times
    places = np.sort(log.places[log.recorded_ns >= begin_ns])
    indices = np.argsort(log.places)[places].tolist()

    with open_log(path) as reader:
        messages = (message for _, message in reader.messages(log.topic, begin_ns))
        indexed = zip(indices, messages, strict=False)
        in_order = _in_order(indexed, begin, end)
        name = f"{path}: {log.topic}"
        for index, image in _decode(in_order, log.codec, name, log.bits):
            if index >= first:
                yield index, image


def _decoded_from(log: LogIndex, first: int) -> int:
    """Where decoding has to begin to show the `first` image: a key frame of a video."""
    if log.key_frames is None:
        return first
    before = np.flatnonzero(log.key_frames[: first + 1])
    return int(before[-1]) if len(before) else 0


def _in_order(
    messages: Iterable[tuple[int, Any]], begin: int, end: int
) -> Iterator[tuple[int, Any]]:
    """The (index, message) with begin <= index < `end`, sorted by the index."""
    waiting: dict[int, Any] = {}
    for index, message in messages:
        if begin <= index < end:
            waiting[index] = message
        while begin in waiting:
            yield begin, waiting.pop(begin)
            begin += 1
        if begin >= end:
            return


def _decode(
    messages: Iterable[tuple[int, Any]], codec: str, name: str, bits: int | None = None
) -> Iterator[tuple[int, np.ndarray]]:
    """(index, image) of the (index, message) that can be decoded.

    With a `codec` they are the frames of a video.
    """
    if codec:
        yield from decode_video(messages, codec, name)
        return
    for index, message in messages:
        image = decode_image(message, name, bits=bits)
        if image is not None:
            yield index, image
