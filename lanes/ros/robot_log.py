"""Robot logs behave like videos: ROS 1 bags, files and folders of ROS 2 bags, and MCAP files of any kind.

`open_log` gives topics and messages: those of ROS, or those of Foxglove's schemas with the fields of ROS. No
definitions of messages are read from the log. rosbags reads .bag files and deserializes messages of ROS; mcap reads
MCAP files of all profiles. `index_log` gives the images on one topic with their times, of which `reader` makes frames.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np

from lanes.errors import LaneError, VideoError
from lanes.files import parse_yaml, protobuf_fields, read_text, require_file
from lanes.ros.log_images import count_bits, decode_image, decode_video, find_peak, is_key_frame
from lanes.video import CLOCK_RESET_S, MAX_FPS, MAX_SHORT_SHARE, MIN_FPS, MIN_STEP

# Ends of the names of logs, also compressed by rosbag2.
_LOG_NAMES = r"\.(bag|db3|mcap)(\.zstd?)?$"
_METADATA, _RECORDING = "metadata.yaml", "rosbag2_bagfile_information"
# What a message compressed by rosbag2 begins with; one in CDR begins with a zero.
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
# Fields of Foxglove's schemas in protobuf (https://docs.foxglove.dev/docs/sdk/schemas): name and kind by number.
_FIELDS: dict[str, dict[int, tuple[str, type]]] = {
    "CompressedImage": {1: ("timestamp", dict), 2: ("data", bytes), 3: ("format", str)},
    "CompressedVideo": {1: ("timestamp", dict), 3: ("data", bytes), 4: ("format", str)},
    "RawImage": {
        1: ("timestamp", dict),
        **{2: ("width", int), 3: ("height", int), 4: ("encoding", str), 5: ("step", int), 6: ("data", bytes)},
    },
    "CameraCalibration": {
        **{2: ("width", int), 3: ("height", int), 4: ("distortion_model", str)},
        **{5: ("D", list), 6: ("K", list), 7: ("R", list), 8: ("P", list)},
    },
}
# Types of the fields of the same schemas as ROS messages (foxglove_msgs), which rosbags does not know; they follow time
# and frame in the same order. Lengths of lists that have a fixed one.
_ROS_TYPES = {str: "string", int: "uint32", bytes: "uint8[]", list: "float64[{}]"}
_LENGTHS = {"K": 9, "R": 9, "P": 12}


@dataclass(frozen=True)
class Topic:
    """A topic of a log: the type and encoding of its messages as the log names them, and their number."""

    name: str
    type_name: str
    encoding: str
    count: int

    @property
    def package(self) -> str:
        """The package of the type, such as sensor_msgs in sensor_msgs/msg/Image, or foxglove in foxglove.RawImage."""
        return re.split(r"[./]", self.type_name)[0]

    @property
    def kind(self) -> str:
        """The type without its package, such as Image."""
        return re.split(r"[./]", self.type_name)[-1]


# An open file: its channels, each a key and a topic, and a function that yields (time of the recording in ns, data) of
# the channels with some keys from a time in ns on. A topic has several channels if several programs write to it.
_OpenFile = tuple[list[tuple[Any, Topic]], Callable[[list[Any], int], Iterator[tuple[int, bytes]]]]


class LogReader:
    """Topics and messages of an open log, which may have several files."""

    def __init__(self, files: list[_OpenFile]) -> None:
        self._files = files
        self.topics: dict[str, Topic] = {}
        for _, topic in (channel for channels, _ in files for channel in channels):
            before = self.topics.get(topic.name)
            self.topics[topic.name] = replace(topic, count=topic.count + (before.count if before else 0))

    def messages(self, topic: str, start_ns: int = 0) -> Iterator[tuple[int, Any]]:
        """(time of the recording in ns, message) on a topic, recorded not before `start_ns`, in the log's order."""
        decode = _decoder(self.topics[topic])
        for channels, read in self._files:
            keys = [key for key, of_channel in channels if of_channel.name == topic]
            for time_ns, data in read(keys, start_ns) if keys else ():
                yield time_ns, decode(data)


def is_robot_log(path: str | Path) -> bool:
    """Whether a file is a robot log, by its name, or a folder is a recording of ROS 2."""
    return bool(re.search(_LOG_NAMES, str(path), re.IGNORECASE)) or is_bag_folder(path)


def is_bag_folder(path: str | Path) -> bool:
    """Whether a path is the folder of a ROS 2 recording; other programs write files of that name as well."""
    with suppress(OSError, ValueError), Path(path, _METADATA).open("rb") as file:
        return _RECORDING.encode() in file.read(1000)
    return False


def file_of_log(path: Path) -> Path:
    """The file that says which recording a path is: of the folder of one its metadata, else the path itself."""
    return path / _METADATA if is_bag_folder(path) else path


@contextmanager
def open_log(path: Path | str) -> Iterator[LogReader]:
    """Reader of a log; errors of the block become a VideoError."""
    path = Path(path)
    try:
        import_module("rosbags")  # also writes the lane of logs that are read without it
        with ExitStack() as opened:
            parts = [_unpacked(part, opened) for part in (_list_parts(path) if path.is_dir() else [path])]
            yield LogReader([_OPENERS[part.suffix.lower()](part, opened) for part in parts])
    except LaneError:
        raise
    except ImportError as error:
        raise VideoError(f"{path}: robot logs need two packages ({error}); run `pip install rosbags mcap`.") from error
    except Exception as error:  # damaged files raise many types
        raise VideoError(f"{path}: is cut off, damaged, encrypted or no robot log ({error}); copy it again.") from error


def _list_parts(folder: Path) -> list[Path]:
    """The files of a ROS 2 recording in the order of its metadata."""
    described = parse_yaml(read_text(folder / _METADATA, "metadata", error=VideoError, max_bytes=20_000_000))
    names = [PurePath(name).name for name in described[_RECORDING]["relative_file_paths"]]
    if missing := [name for name in names if not (folder / name).is_file()]:
        raise VideoError(f"{folder}: {missing[0]}, which {_METADATA} names, is missing; copy it there.")
    if not names:
        raise VideoError(f"{folder}: {_METADATA} names no file; name another recording.")
    return [folder / name for name in names]


def _unpacked(path: Path, opened: ExitStack) -> Path:
    """The file; if rosbag2 has compressed it, the unpacked one in a temporary folder."""
    if path.suffix.lower() not in (".zstd", ".zst"):
        return path
    unpacked = Path(opened.enter_context(TemporaryDirectory()), path.stem)
    with import_module("zstandard").open(path, "rb") as source, unpacked.open("wb") as target:
        shutil.copyfileobj(source, target)
    return unpacked


def _open_bag(path: Path, opened: ExitStack) -> _OpenFile:
    from rosbags import rosbag1

    bag = opened.enter_context(rosbag1.Reader(path))

    def read(connections: list[Any], start_ns: int) -> Iterator[tuple[int, bytes]]:
        return ((time_ns, data) for _, time_ns, data in bag.messages(connections, start=start_ns))

    return [(c, Topic(c.topic, c.msgtype, "ros1", c.msgcount)) for c in bag.connections], read


def _open_database(path: Path, opened: ExitStack) -> _OpenFile:
    log = path.with_name(f"{path.name}-wal")
    # As it is: SQLite would write files next to a database in WAL mode, even if nothing is in its log.
    mode = "mode=ro" if log.is_file() and log.stat().st_size else "immutable=1"
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, check_same_thread=False)
    database = opened.enter_context(closing(connection))
    try:
        rows = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    except sqlite3.OperationalError as error:
        if mode != "mode=ro":
            raise
        fault = f"its recorder was killed, and its log {log.name} cannot be read"
        raise VideoError(f"{path}: {fault}; copy both into a folder with write permission.") from error
    counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))

    def read(numbers: list[int], start_ns: int) -> Iterator[tuple[int, bytes]]:
        which = f"topic_id IN ({','.join('?' * len(numbers))}) AND timestamp >= ? ORDER BY timestamp, id"
        return database.execute(f"SELECT timestamp, data FROM messages WHERE {which}", [*numbers, start_ns])

    return [(n, Topic(name, kind, encoding, counts.get(n, 0))) for n, name, kind, encoding in rows], read


def _open_mcap(path: Path, opened: ExitStack) -> _OpenFile:
    from mcap.reader import NonSeekingReader, SeekingReader

    file = opened.enter_context(path.open("rb"))
    index = SeekingReader(file).get_summary()
    # an index may leave out schemas and channels
    complete = index and index.statistics and index.statistics.channel_message_counts.keys() <= index.channels.keys()
    complete = complete and {channel.schema_id for channel in index.channels.values()} <= {0, *index.schemas}

    def messages(**part: Any) -> Iterator[tuple[Any, Any, Any]]:
        file.seek(0)
        reader = SeekingReader(file) if complete else NonSeekingReader(file)
        return reader.iter_messages(log_time_order=False, **part)

    def read(topics: list[str], start_ns: int) -> Iterator[tuple[int, bytes]]:
        return ((m.log_time, m.data) for _, _, m in messages(topics=topics, starting_at=start_ns))

    if complete:
        counts = index.statistics.channel_message_counts
        channels = {c.id: (index.schemas.get(c.schema_id), c) for c in index.channels.values()}
    else:
        found = [(schema, channel) for schema, channel, _ in messages()]
        counts, channels = Counter(channel.id for _, channel in found), {pair[1].id: pair for pair in found}
    kinds = [(schema.name if schema else "", c) for schema, c in channels.values()]
    return [(c.topic, Topic(c.topic, kind, c.message_encoding, counts.get(c.id, 0))) for kind, c in kinds], read


_OPENERS = {".bag": _open_bag, ".db3": _open_database, ".mcap": _open_mcap}


def _decoder(topic: Topic) -> Callable[[bytes], Any]:
    """The function that makes a message of the data of a topic, compressed or not."""
    if topic.encoding in ("protobuf", "json"):
        fields = _FIELDS[topic.kind]
        parse = _parse_json if topic.encoding == "json" else _parse_protobuf
        return lambda data: parse(data, fields)
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    ros1 = topic.encoding == "ros1"
    store, name = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE), f"{topic.package}/msg/{topic.kind}"
    if name not in store.types:
        definition = "builtin_interfaces/Time timestamp\nstring frame_id\n"
        for field, kind in _FIELDS[topic.kind].values():
            if kind is not dict:
                definition += f"{_ROS_TYPES[kind].format(_LENGTHS.get(field, ''))} {field}\n"
        store.register(get_types_from_msg(definition, name))
    deserialize = store.deserialize_ros1 if ros1 else store.deserialize_cdr

    def decode(data: bytes) -> Any:
        if data[:4] == _ZSTD_MAGIC:
            data = import_module("zstandard").ZstdDecompressor().decompressobj().decompress(data)
        return deserialize(data, name)

    return decode


def _parse_json(data: bytes, fields: dict[int, tuple[str, type]]) -> SimpleNamespace:
    """A message of Foxglove's schemas in JSON; bytes are in base64."""
    content = json.loads(data)
    values = {name: content.get(name) or kind() for name, kind in fields.values()}
    for name, kind in fields.values():
        if kind is bytes:
            values[name] = base64.b64decode(values[name])
    return SimpleNamespace(**values)


def _parse_protobuf(data: bytes, fields: dict[int, tuple[str, type]]) -> SimpleNamespace:
    """A message of Foxglove's schemas in protobuf."""
    message = SimpleNamespace(**{name: kind() for name, kind in fields.values()})
    for number, _, value in protobuf_fields(data):
        name, kind = fields.get(number, ("", bytes))
        if kind is dict:
            entries = {key: entry for key, _, entry in protobuf_fields(value)}
            value = {"sec": entries.get(1, 0), "nsec": entries.get(2, 0)}
        elif kind is list:
            value = [*getattr(message, name), *struct.unpack(f"<{len(value) // 8}d", value)]
        elif kind is str:
            value = value.decode()
        elif kind is int and isinstance(value, bytes):  # of a fixed length
            value = int.from_bytes(value, "little")
        if name:
            setattr(message, name, value)
    return message


# The images on a topic, and their times.

# Types of messages with an image each, and others of videos.
_IMAGE_KINDS = ("Image", "RawImage", "CompressedImage", "CompressedVideo")
_OTHER_KINDS = ("FFMPEGPacket", "H264Packet")
_PACKAGES = ("sensor_msgs", "foxglove", "foxglove_msgs")
# Encodings of messages that are read.
_READ = ("cdr", "ros1", "protobuf", "json")
# A longer step is that of a clock, or joins two recordings. It is shortened to a step after which the tracker starts
# again.
_JUMP_S, _SHORTENED_S = 60.0, 5.0


@dataclass(frozen=True, eq=False)
class LogIndex:
    """The images on a topic, (N,), in the order of their times, and their width and height.

    `stamps_ns` are from the headers, since 1970, or from the recording if headers have none or restart. `times_s` count
    from the first image; `numbers` skip missing images if the rate is constant. `places` are their places among the
    messages of the topic. `note` states corrections of the times in words; empty without any. Images of a video
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
        name, every = f"{path}: {topic}", max(1, log.topics[topic].count // 16)  # so many peaks are looked at
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
    """Which stamps (N,) are more than a second, and three usual steps, from the median of five in a row."""
    if len(stamps_ns) < 3:
        return np.zeros(len(stamps_ns), bool)
    # continued beyond the ends by a reflection: the median of stamps in order is always the one in the middle
    before, after = 2 * stamps_ns[0] - stamps_ns[2:0:-1], 2 * stamps_ns[-1] - stamps_ns[-2:-4:-1]
    five = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, stamps_ns, after]), 5)
    usual_ns = np.median(np.abs(np.diff(stamps_ns)))
    return np.abs(stamps_ns - np.median(five, axis=1)) > max(1e9, 3 * usual_ns)


def _describe_times(outliers: int, steps_s: np.ndarray) -> str:
    """The corrections of the times, in words; empty without any."""
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
    images = sorted(t.name for t in known if t.kind in _IMAGE_KINDS and t.package in _PACKAGES and t.encoding in _READ)
    if topic in images or (topic is None and len({name.removesuffix("/compressed") for name in images}) == 1):
        return topic or images[0]  # raw images come before their compressed copies
    there, remedy = ", ".join(images) or "no topic", "choose one of them with --topic" if images else "name another log"
    others = [t for t in known if t.kind in (*_IMAGE_KINDS, *_OTHER_KINDS) and t.name not in images]
    if others and (not images or any(t.name == topic for t in others)):
        listed = ", ".join(f"{t.type_name} ({t.encoding}) on {t.name}" for t in others)
        raise VideoError(f"{path}: has {listed}, which is not read; record images, or convert a video in it to mp4.")
    raise VideoError(f"{path}: has images on {there}{f', not on {topic}' if topic else ''}; {remedy}.")
