"""Robot logs behave like videos: the images on one topic with their times, of which `reader` makes frames."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lanes.errors import VideoError
from lanes.files import require_file
from lanes.video.container import CLOCK_RESET_S, MAX_FPS, MAX_SHORT_SHARE, MIN_FPS, MIN_STEP
from lanes.video.log_images import count_bits, decode_image, decode_video, find_peak, is_key_frame
from lanes.video.log_reader import LOG_NAMES, METADATA, Topic, is_bag_folder, open_log

# Types of messages with an image each, and others of videos.
_IMAGE_KINDS = ("Image", "RawImage", "CompressedImage", "CompressedVideo")
_OTHER_KINDS = ("FFMPEGPacket", "H264Packet")
PACKAGES = ("sensor_msgs", "foxglove", "foxglove_msgs")
# Encodings of messages that are read.
_READ = ("cdr", "ros1", "protobuf", "json")
# A stamp is an outlier if it is farther than this from the median of those of five images.
_OUTLIER_S = 1.0
# A longer step is that of a clock, or joins two recordings. It is shortened to a step after which the tracker starts
# again.
_JUMP_S, _SHORTENED_S = 60.0, 5.0
# Images whose largest values are looked at.
_PEAKS = 16


@dataclass(frozen=True, eq=False)
class LogIndex:
    """The images on a topic, (N,), in the order of their times, and their width and height.

    `stamps_ns` are from the headers, since 1970, or from the recording if headers have none or restart. `times_s` count
    from the first image; `numbers` skip missing images if the rate is constant. `places` are their places among the
    messages of the topic. `note` says in words what was changed of the times; empty if nothing was. Images of a video
    in a `codec` are decoded from one of the `key_frames` (N,) on.
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


def is_robot_log(path: str | Path) -> bool:
    """Whether a file is a robot log, by its name, or a folder is a recording of ROS 2."""
    return bool(re.search(LOG_NAMES, str(path))) or is_bag_folder(path)


def file_of_log(path: Path) -> Path:
    """The file that says which recording a path is: of the folder of one its metadata, else the path itself."""
    return path / METADATA if is_bag_folder(path) else path


def index_log(path: str | Path, topic: str | None = None) -> LogIndex:
    """The images on a topic, by default the only one with images; the log is read once for calls in a row.

    Raises FileNotFoundError, or VideoError if the log cannot be read, or has no such images, or several cameras.
    """
    path = Path(path)
    status = require_file(file_of_log(path), "robot log", error=VideoError).stat()
    return _index_log(path, topic, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4)
def _index_log(path: Path, topic: str | None, *version: int) -> LogIndex:
    found, peaks, codec, keys = [], [], "", []
    with open_log(path) as log:
        topic = _choose_topic(path, log.topics, topic)
        name, every = f"{path}: {topic}", max(1, log.topics[topic].count // _PEAKS)
        for place, (recorded_ns, message) in enumerate(log.messages(topic)):
            found.append((_stamp_ns(message), recorded_ns))
            if log.topics[topic].kind == "CompressedVideo":
                codec = codec or str(message.format).lower()
                keys.append(is_key_frame(message.data, codec))
            elif place % every == 0:
                peaks.append(find_peak(message, name))
        first = next((image for _, image in _decode(enumerate(m for _, m in log.messages(topic)), codec, name)), None)
    if first is None:
        raise VideoError(f"{path}: no image on {topic} can be decoded; record raw images, JPEG or PNG.")
    stamps_ns, recorded_ns = np.array(found, np.int64).T
    stamps_ns, outliers = _usable_stamps(stamps_ns, recorded_ns)
    order = np.argsort(stamps_ns, kind="stable")
    stamps_ns, recorded_ns = stamps_ns[order], recorded_ns[order]
    steps_s = np.diff(stamps_ns) / 1e9
    jumps, note = steps_s > _JUMP_S, _describe_times(outliers, steps_s)
    steps_s[jumps] = _SHORTENED_S
    fps = _usual_rate(steps_s)
    if not MIN_FPS <= fps <= MAX_FPS:
        raise VideoError(f"{path}: has {len(found)} images on {topic}, {fps:g} per second; name a log of a drive.")
    constant = (steps_s * fps < MIN_STEP).mean() <= MAX_SHORT_SHARE
    skipped = np.where(constant & ~jumps, np.maximum(np.rint(steps_s * fps), 1), 1)
    times_s, numbers = np.append(0, np.cumsum(steps_s)), np.append(0, np.cumsum(skipped)).astype(int)
    size, bits, key_frames = first.shape[1::-1], count_bits(peaks), np.array(keys)[order] if keys else None
    return LogIndex(topic, size, fps, stamps_ns, recorded_ns, times_s, numbers, order, bits, note, codec, key_frames)


def read_log(path: str | Path, log: LogIndex, first: int, end: int) -> Iterator[tuple[int, np.ndarray]]:
    """(index, image) of the images first <= index < `end` of a log in order, without damaged ones."""
    if first >= end:
        return
    begin = first
    if log.key_frames is not None:
        begin = int(np.flatnonzero(log.key_frames[: first + 1])[-1]) if log.key_frames[: first + 1].any() else 0
    begin_ns = int(log.recorded_ns[begin:end].min())
    # Where each message that is read from there on comes in the order of the times.
    indices = np.argsort(log.places)[np.sort(log.places[log.recorded_ns >= begin_ns])]
    with open_log(path) as reader:
        recorded = zip(indices.tolist(), (message for _, message in reader.messages(log.topic, begin_ns)), strict=False)
        for index, image in _decode(_in_order(recorded, begin, end), log.codec, f"{path}: {log.topic}", log.bits):
            if index >= first:
                yield index, image


def _in_order(messages: Iterable[tuple[int, Any]], begin: int, end: int) -> Iterator[tuple[int, Any]]:
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
    """(index, image) of the (index, message) that can be decoded; of a video if there is a `codec`."""
    if codec:
        yield from decode_video(messages, codec, name)
        return
    for index, message in messages:
        if (image := decode_image(message, name, bits=bits)) is not None:
            yield index, image


def _stamp_ns(message: Any) -> int:
    """The time in the header of a message of ROS, or of Foxglove's schemas."""
    stamp = message.header.stamp if hasattr(message, "header") else message.timestamp
    fields: dict[str, int] = stamp if isinstance(stamp, dict) else vars(stamp)
    return int(fields.get("sec", 0)) * 10**9 + int(fields.get("nanosec", fields.get("nsec", 0)))


def _usable_stamps(stamps_ns: np.ndarray, recorded_ns: np.ndarray) -> tuple[np.ndarray, int]:
    """The stamps in the order of recording, and how many outliers were replaced; or the times of the recording."""
    outliers = _find_outliers(stamps_ns)
    good = np.flatnonzero(~outliers)
    if outliers.any() and len(good) > 1:
        # from the first one on, because floats of nanoseconds since 1970 have steps of 256
        base = stamps_ns[good[0]]
        between = np.interp(np.arange(len(stamps_ns)), good, (stamps_ns[good] - base).astype(float))
        stamps_ns = np.where(outliers, base + np.rint(between).astype(np.int64), stamps_ns)
    restarts = (np.maximum.accumulate(stamps_ns) - stamps_ns).max() > 1e9 * CLOCK_RESET_S
    if not stamps_ns.all() or restarts or (len(stamps_ns) > 1 and np.ptp(stamps_ns) == 0):
        return recorded_ns, 0
    return stamps_ns, int(outliers.sum())


def _find_outliers(stamps_ns: np.ndarray) -> np.ndarray:
    """Which stamps (N,) are far from the median of five in a row."""
    if len(stamps_ns) < 3:
        return np.zeros(len(stamps_ns), bool)
    # continued beyond the ends by a reflection: the median of stamps in order is always the one in the middle
    before, after = 2 * stamps_ns[0] - stamps_ns[2:0:-1], 2 * stamps_ns[-1] - stamps_ns[-2:-4:-1]
    five = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, stamps_ns, after]), 5)
    usual_ns = np.median(np.abs(np.diff(stamps_ns)))
    return np.abs(stamps_ns - np.median(five, axis=1)) > max(1e9 * _OUTLIER_S, 3 * usual_ns)


def _describe_times(outliers: int, steps_s: np.ndarray) -> str:
    """What is changed of the times, in words; empty if nothing is."""
    jumps = int((steps_s > _JUMP_S).sum())
    words = [f"{outliers} time stamps far from those of the images around them are replaced"] if outliers else []
    if jumps:
        words.append(f"{jumps} jumps of its clock, of up to {steps_s.max():.0f} s, are shortened to {_SHORTENED_S:g} s")
    return "; ".join(words)


def _usual_rate(steps_s: np.ndarray) -> float:
    """Images per second between gaps."""
    known_s = steps_s[steps_s > 0]
    usual_s = known_s[known_s < 1.5 * np.median(known_s)] if len(known_s) else [np.inf]
    return round(float(1 / np.mean(usual_s)), 6)


def _choose_topic(path: Path, topics: dict[str, Topic], topic: str | None) -> str:
    known = [t for t in topics.values() if t.count]
    images = sorted(t.name for t in known if t.kind in _IMAGE_KINDS and t.package in PACKAGES and t.encoding in _READ)
    if topic in images or (topic is None and len({name.removesuffix("/compressed") for name in images}) == 1):
        return topic or images[0]  # raw images come before their compressed copies
    there, remedy = ", ".join(images) or "no topic", "choose one of them with --topic" if images else "name another log"
    others = [t for t in known if t.kind in (*_IMAGE_KINDS, *_OTHER_KINDS) and t.name not in images]
    if others and (not images or any(t.name == topic for t in others)):
        listed = ", ".join(f"{t.type_name} ({t.encoding}) on {t.name}" for t in others)
        raise VideoError(f"{path}: has {listed}, which is not read; record images, or convert a video in it to mp4.")
    raise VideoError(f"{path}: has images on {there}{f', not on {topic}' if topic else ''}; {remedy}.")
