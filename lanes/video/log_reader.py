"""Robot logs opened: ROS 1 bags, files and folders of ROS 2 bags, and MCAP files of any kind, as topics and messages.

Messages are those of ROS, or those of Foxglove's schemas with the fields of ROS. No definitions of messages are read
from the log. rosbags reads .bag files and deserializes messages of ROS; mcap reads MCAP files of all profiles.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

from lanes.errors import LaneError, VideoError
from lanes.files import parse_yaml, protobuf_fields, read_text

# Ends of the names of logs, also compressed by rosbag2.
LOG_NAMES = r"\.(bag|db3|mcap)(\.zstd?)?$"
METADATA, _RECORDING = "metadata.yaml", "rosbag2_bagfile_information"
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


class LogReader:
    """Topics and messages of an open log, which may have several files."""

    def __init__(self, files: list[_OpenFile]) -> None:
        self._files = files
        self.topics: dict[str, Topic] = {}
        for _, topic in (channel for file in files for channel in file.channels):
            before = self.topics.get(topic.name)
            self.topics[topic.name] = replace(topic, count=topic.count + (before.count if before else 0))

    def messages(self, topic: str, start_ns: int = 0) -> Iterator[tuple[int, Any]]:
        """(time of the recording in ns, message) on a topic, recorded not before `start_ns`, in the log's order."""
        decode = _decoder(self.topics[topic])
        for file in self._files:
            keys = [key for key, of_channel in file.channels if of_channel.name == topic]
            for time_ns, data in file.read(keys, start_ns) if keys else ():
                yield time_ns, decode(data)


@dataclass(frozen=True)
class _OpenFile:
    """The channels of a file, each with its key, and a function that reads those of some keys from a time on.

    A topic has several channels if several programs write to it. The function yields (time of the recording in ns,
    data).
    """

    channels: list[tuple[Any, Topic]]
    read: Callable[[list[Any], int], Iterator[tuple[int, bytes]]]


def is_bag_folder(path: str | Path) -> bool:
    """Whether a path is the folder of a ROS 2 recording; other programs write files of that name as well."""
    with suppress(OSError, ValueError), Path(path, METADATA).open("rb") as file:
        return _RECORDING.encode() in file.read(1000)
    return False


@contextmanager
def open_log(path: Path | str) -> Iterator[LogReader]:
    """Reader of a log; errors of the block become a VideoError."""
    path = Path(path)
    try:
        import_module("rosbags")  # also writes the lane of logs that are read without it
        with ExitStack() as opened:
            parts = [_unpacked(part, opened) for part in (_list_parts(path) if path.is_dir() else [path])]
            yield LogReader([_OPENERS[part.suffix](part, opened) for part in parts])
    except LaneError:
        raise
    except ImportError as error:
        raise VideoError(f"{path}: robot logs need two packages ({error}); run `pip install rosbags mcap`.") from error
    except Exception as error:  # damaged files raise many types
        raise VideoError(f"{path}: is cut off, damaged, encrypted or no robot log ({error}); copy it again.") from error


def _list_parts(folder: Path) -> list[Path]:
    """The files of a ROS 2 recording in the order of its metadata."""
    described = parse_yaml(read_text(folder / METADATA, "metadata", error=VideoError, max_bytes=20_000_000))
    names = [PurePath(name).name for name in described[_RECORDING]["relative_file_paths"]]
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
    with import_module("zstandard").open(path, "rb") as source, unpacked.open("wb") as target:
        shutil.copyfileobj(source, target)
    return unpacked


def _open_bag(path: Path, opened: ExitStack) -> _OpenFile:
    from rosbags import rosbag1

    bag = opened.enter_context(rosbag1.Reader(path))

    def read(connections: list[Any], start_ns: int) -> Iterator[tuple[int, bytes]]:
        return ((time_ns, data) for _, time_ns, data in bag.messages(connections, start=start_ns))

    return _OpenFile([(c, Topic(c.topic, c.msgtype, "ros1", c.msgcount)) for c in bag.connections], read)


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
        raise VideoError(f"{path}: {fault}; copy both into a folder that may be written to.") from error
    counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))

    def read(numbers: list[int], start_ns: int) -> Iterator[tuple[int, bytes]]:
        which = f"topic_id IN ({','.join('?' * len(numbers))}) AND timestamp >= ? ORDER BY timestamp, id"
        return database.execute(f"SELECT timestamp, data FROM messages WHERE {which}", [*numbers, start_ns])

    return _OpenFile([(n, Topic(name, kind, encoding, counts.get(n, 0))) for n, name, kind, encoding in rows], read)


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
    return _OpenFile(
        [(c.topic, Topic(c.topic, kind, c.message_encoding, counts.get(c.id, 0))) for kind, c in kinds], read
    )


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
        definition = f"builtin_interfaces/Time timestamp\nstring frame_id\n{_ROS_FIELDS[topic.kind]}"
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
