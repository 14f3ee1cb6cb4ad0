"""Robot logs opened: ROS 1 bags, files and folders of ROS 2 bags, and MCAP files of any kind, as topics and messages.

Messages are those of ROS, or those of Foxglove's schemas with the fields of ROS. No definitions of messages are read
from the log. rosbags reads .bag files and deserializes messages of ROS.
"""

from __future__ import annotations

import base64
import json
import shutil
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

from lanes.errors import LaneError, VideoError
from lanes.files import parse_yaml, read_text
from lanes.video.mcap import McapFile, import_zstd

# Ends of the names of logs, also compressed by rosbag2.
LOG_NAMES = r"\.(bag|db3|mcap)(\.zstd?)?$"
METADATA, RECORDING = "metadata.yaml", "rosbag2_bagfile_information"
# What a message compressed by rosbag2 begins with; one in CDR begins with a zero.
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
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
# The same types as messages of ROS (foxglove_msgs), which rosbags does not know: the fields after time and frame.
_IMAGE_FIELDS = "uint8[] data\nstring format\n"
_ROS_FIELDS = {
    "CompressedImage": _IMAGE_FIELDS,
    "CompressedVideo": _IMAGE_FIELDS,
    "RawImage": "uint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data\n",
    "CameraCalibration": (
        "uint32 width\nuint32 height\nstring distortion_model\nfloat64[] D\nfloat64[9] K\nfloat64[9] R\nfloat64[12] P\n"
    ),
}


@dataclass(frozen=True)
class Topic:
    """A topic of a log: the short type of its messages, such as CompressedImage, its package, and their number."""

    name: str
    package: str
    kind: str
    count: int
    encoding: str

    @property
    def type_name(self) -> str:
        """Text such as "foxglove.CompressedVideo (protobuf)"."""
        separator = "." if self.package == "foxglove" else "/msg/"
        return f"{self.package}{separator}{self.kind} ({self.encoding})"


class LogReader:
    """Topics and messages of a log that is open."""

    def __init__(self, topics: dict[str, Topic], read: Callable[[str, int], Iterator[tuple[int, Any]]]) -> None:
        self.topics = topics
        self._read = read

    def messages(self, topic: str, start_ns: int = 0) -> Iterator[tuple[int, Any]]:
        """(time of the recording in ns, message) on a topic, recorded not before `start_ns`, in the log's order."""
        return self._read(topic, start_ns)


def is_bag_folder(path: str | Path) -> bool:
    """Whether a path is the folder of a ROS 2 recording; other programs write files of that name as well."""
    with suppress(OSError, ValueError), Path(path, METADATA).open("rb") as file:
        return RECORDING.encode() in file.read(1000)
    return False


@contextmanager
def open_log(path: Path | str) -> Iterator[LogReader]:
    """Reader of a log; errors of the block become a VideoError."""
    path = Path(path)
    try:
        import_module("rosbags")  # also writes the lane of logs that are read without it
        with ExitStack() as opened:
            parts = _list_parts(path) if path.is_dir() else [path]
            readers = [opened.enter_context(_open_file(_unpacked(part, opened))) for part in parts]
            yield readers[0] if len(readers) == 1 else _join(readers)
    except LaneError:
        raise
    except ImportError as error:
        raise VideoError(f"{path}: robot logs need rosbags, which is missing; run `pip install rosbags`.") from error
    except Exception as error:  # damaged files raise many types
        raise VideoError(f"{path}: is cut off, damaged, encrypted or no robot log ({error}); copy it again.") from error


def _list_parts(folder: Path) -> list[Path]:
    """The files of a ROS 2 recording in the order of its metadata."""
    described = parse_yaml(read_text(folder / METADATA, "metadata", error=VideoError, max_bytes=20_000_000))
    names = [PurePath(name).name for name in described[RECORDING]["relative_file_paths"]]
    if missing := [name for name in names if not (folder / name).is_file()]:
        raise VideoError(f"{folder}: {missing[0]}, which {METADATA} names, is missing; copy it there.")
    if not names:
        raise VideoError(f"{folder}: {METADATA} names no file; name another recording.")
    return [folder / name for name in names]


def _unpacked(path: Path, opened: ExitStack) -> Path:
    """The file, or if rosbag2 has compressed it, what was in it, in a temporary folder."""
    if path.suffix not in (".zstd", ".zst"):
        return path
    unpacked = Path(opened.enter_context(TemporaryDirectory()), path.stem)
    with import_zstd().open(path, "rb") as source, unpacked.open("wb") as target:
        shutil.copyfileobj(source, target)
    return unpacked


def _join(readers: list[LogReader]) -> LogReader:
    """Parts of a recording as one log."""
    topics: dict[str, Topic] = {}
    for reader in readers:
        for name, topic in reader.topics.items():
            count = topic.count + (topics[name].count if name in topics else 0)
            topics[name] = Topic(name, topic.package, topic.kind, count, topic.encoding)

    def read(topic: str, start_ns: int) -> Iterator[tuple[int, Any]]:
        for reader in readers:
            if topic in reader.topics:
                yield from reader.messages(topic, start_ns)

    return LogReader(topics, read)


@contextmanager
def _open_file(path: Path) -> Iterator[LogReader]:
    with {".bag": _open_bag, ".db3": _open_database, ".mcap": _open_mcap}[path.suffix](path) as reader:
        yield reader


def _topic(name: str, type_name: str, count: int, encoding: str) -> Topic:
    """A topic with a type such as sensor_msgs/msg/Image, sensor_msgs/Image or foxglove.CompressedImage."""
    words = type_name.replace(".", "/").split("/")
    return Topic(name, words[0], words[-1], count, encoding)


@contextmanager
def _open_bag(path: Path) -> Iterator[LogReader]:
    from rosbags import rosbag1

    with rosbag1.Reader(path) as bag:
        topics = {n: _topic(n, info.msgtype or "/", info.msgcount, "ros1") for n, info in bag.topics.items()}

        def read(name: str, start_ns: int) -> Iterator[tuple[int, Any]]:
            decode = _decoder(topics[name])
            for _, time_ns, data in bag.messages(bag.topics[name].connections, start=start_ns):
                yield time_ns, decode(data)

        yield LogReader(topics, read)


@contextmanager
def _open_database(path: Path) -> Iterator[LogReader]:
    log = path.with_name(f"{path.name}-wal")
    # As it is: SQLite would write files next to a database in WAL mode, even if nothing is in its log.
    mode = "mode=ro" if log.is_file() and log.stat().st_size else "immutable=1"
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, check_same_thread=False)) as database:
        try:
            rows = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
        except sqlite3.OperationalError as error:
            if mode != "mode=ro":
                raise
            fault = f"its recorder was killed, and its log {log.name} cannot be read"
            raise VideoError(f"{path}: {fault}; copy both into a folder that may be written to.") from error
        numbers: dict[str, list[int]] = {}
        counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
        topics = {}
        for number, name, kind, encoding in rows:
            numbers.setdefault(name, []).append(number)
            topics[name] = _topic(name, kind, sum(counts.get(n, 0) for n in numbers[name]), encoding)

        def read(name: str, start_ns: int) -> Iterator[tuple[int, Any]]:
            decode, ids = _decoder(topics[name]), numbers[name]
            which = f"topic_id IN ({','.join('?' * len(ids))}) AND timestamp >= ? ORDER BY timestamp, id"
            command = f"SELECT timestamp, data FROM messages WHERE {which}"
            for time_ns, data in database.execute(command, [*ids, start_ns]):
                yield time_ns, decode(data)

        yield LogReader(topics, read)


@contextmanager
def _open_mcap(path: Path) -> Iterator[LogReader]:
    with McapFile(path) as mcap:
        topics: dict[str, Topic] = {}
        numbers: dict[str, set[int]] = {}
        for number, channel in mcap.channels.items():
            numbers.setdefault(channel.topic, set()).add(number)
            count = sum(mcap.counts.get(n, 0) for n in numbers[channel.topic])
            topics[channel.topic] = _topic(channel.topic, channel.schema, count, channel.encoding)

        def read(name: str, start_ns: int) -> Iterator[tuple[int, Any]]:
            decode = _decoder(topics[name])
            for _, time_ns, data in mcap.messages(numbers[name], start_ns):
                yield time_ns, decode(data)

        yield LogReader(topics, read)


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
        definition = f"builtin_interfaces/Time timestamp\nstring frame_id\n{_ROS_FIELDS[topic.kind]}"
        store.register(get_types_from_msg(definition, name))
    deserialize = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    return lambda data: deserialize(import_zstd().decompress(data) if data[:4] == ZSTD_MAGIC else data, name)


def _parse_json(data: bytes, fields: dict[int, tuple[str, type]]) -> SimpleNamespace:
    """A message of Foxglove's schemas in JSON; bytes are in base64."""
    content = json.loads(data)
    values = {name: content.get(name) or kind() for name, kind in fields.values()}
    for name, kind in fields.values():
        if kind is bytes:
            values[name] = base64.b64decode(values[name])
    return SimpleNamespace(**values)


def _parse_protobuf(data: bytes, fields: dict[int, tuple[str, type]]) -> SimpleNamespace:
    """A message of Foxglove's schemas in protobuf (https://protobuf.dev/programming-guides/encoding)."""
    message = SimpleNamespace(**{name: kind() for name, kind in fields.values()})
    for number, value in _protobuf_entries(data):
        name, kind = fields.get(number, ("", bytes))
        if kind is dict:
            entries = dict(_protobuf_entries(value))
            value = {"sec": entries.get(1, 0), "nsec": entries.get(2, 0)}
        elif kind is list:
            values = struct.unpack(f"<{len(value) // 8}d", value) if isinstance(value, bytes) else [value]
            value = [*getattr(message, name), *values]
        elif kind is str:
            value = value.decode()
        if name:
            setattr(message, name, value)
    return message


def _protobuf_entries(data: bytes) -> Iterator[tuple[int, Any]]:
    """Number and value of each field; eight bytes that are no string are a double."""
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        if key & 7 == 0:
            value, at = _varint(data, at)
            yield key >> 3, value
            continue
        length = {1: 8, 5: 4}.get(key & 7)
        if length is None:
            if key & 7 != 2:
                raise ValueError("a protobuf message is damaged")
            length, at = _varint(data, at)
        if at + length > len(data):
            raise ValueError("a protobuf message is cut off")
        entry = data[at : at + length]
        at += length
        yield key >> 3, struct.unpack({1: "<d", 5: "<I"}[key & 7], entry)[0] if key & 7 != 2 else entry


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number of variable length, and the place behind it."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at
