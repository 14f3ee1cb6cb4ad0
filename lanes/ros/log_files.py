"""Topics and messages of robot logs: ROS 1 bags, ROS 2 bags, MCAP files of any kind.

Libraries read what they can: rosbags the .bag files and all messages of ROS, mcap the
MCAP files of all profiles, mcap-protobuf-support the messages in protobuf.

Ours is what rosbags' readers of ROS 2 recordings (0.11.9) do not do. They open SQLite
files without the write-ahead log of a killed recorder, so that its last messages are
missing without a word. They open no names with `?` or `%`, no suffix in capitals, no
compressed file without its folder, and only MCAP files of the profile "ros2".
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import sqlite3
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
from lanes.files import parse_yaml, read_text

# Ends of the names of logs, also compressed by rosbag2.
_LOG_NAMES = r"\.(bag|db3|mcap)(\.zstd?)?$"
_METADATA = "metadata.yaml"
_RECORDING = "rosbag2_bagfile_information"
# What a message compressed by rosbag2 begins with; one in CDR begins with a zero.
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

# Between the parts of a type's name: of ROS, of protobuf, and of OMG IDL, in which DDS
# adds an underscore to types.
_PARTS_OF_TYPE = r"[./]|::"

# Foxglove's schemas as messages of ROS, which rosbags does not know:
# https://docs.foxglove.dev/docs/sdk/schemas. They begin with time and frame.
_STAMPED = "builtin_interfaces/Time timestamp\nstring frame_id\n"
_FOXGLOVE = {
    "CompressedImage": "uint8[] data\nstring format",
    "CompressedVideo": "uint8[] data\nstring format",
    "RawImage": (
        "uint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data"
    ),
    "CameraCalibration": (
        "uint32 width\nuint32 height\nstring distortion_model\n"
        "float64[] D\nfloat64[9] K\nfloat64[9] R\nfloat64[12] P"
    ),
}
# Values in JSON of fields that are left out, by type.
_DEFAULTS: dict[str, Any] = {"uint8[]": "", "string": "", "uint32": 0}
# Types of ROS that have the fields of Foxglove's, with a header.
_LIKE_FOXGLOVE = {"Image": "RawImage", "CameraInfo": "CameraCalibration"}

# A message and the time of its recording, ns.
Recorded = tuple[int, Any]


@dataclass(frozen=True)
class Topic:
    """A topic of a log: type and encoding of its messages, and their number.

    The names are those of the log. `schema` is that of messages in protobuf.
    """

    name: str
    type_name: str
    encoding: str
    count: int
    schema: Any = None

    @property
    def package(self) -> str:
        """The package of the type: foxglove of foxglove.RawImage."""
        return re.split(_PARTS_OF_TYPE, self.type_name)[0]

    @property
    def kind(self) -> str:
        """The type without its package: Image of sensor_msgs/msg/Image."""
        return re.split(_PARTS_OF_TYPE, self.type_name)[-1].rstrip("_")


@dataclass(frozen=True)
class LogFile:
    """An open file of a log.

    `channels` are keys and their topics: a topic has several if several programs write
    to it. `read` yields (time of the recording in ns, data) of the messages with some
    keys, from a time in ns on.
    """

    channels: list[tuple[Any, Topic]]
    read: Callable[[list[Any], int], Iterator[tuple[int, bytes]]]


class LogReader:
    """Topics and messages of an open log, which may have several files."""

    def __init__(self, files: list[LogFile]) -> None:
        self._files = files
        self.topics: dict[str, Topic] = {}
        for file in files:
            for _, topic in file.channels:
                before = self.topics.get(topic.name)
                count = topic.count + (before.count if before else 0)
                self.topics[topic.name] = replace(topic, count=count)

    def messages(self, topic: str, start_ns: int = 0) -> Iterator[Recorded]:
        """Times of the recording, ns, and messages on a topic, in the log's order.

        They are recorded at or after `start_ns`; damaged ones are left out. Messages of
        Foxglove's schemas have a `timestamp`, a mapping or a message of ROS, all others
        a `header`.
        """
        decode = _decoder_of(self.topics[topic])
        for file in self._files:
            keys = [key for key, found in file.channels if found.name == topic]
            if not keys:
                continue
            for time_ns, data in file.read(keys, start_ns):
                try:
                    message = decode(data)
                except ImportError:
                    raise
                except Exception:  # a damaged message raises many types
                    continue
                yield time_ns, message


def is_robot_log(path: str | Path) -> bool:
    """Whether a path is a robot log, by its name, or the folder of a recording."""
    has_name = re.search(_LOG_NAMES, str(path), re.IGNORECASE)
    return bool(has_name) or is_bag_folder(path)


def is_bag_folder(path: str | Path) -> bool:
    """Whether a path is the folder of a ROS 2 recording.

    Other programs write files of the name of its metadata as well.
    """
    with suppress(OSError, ValueError), Path(path, _METADATA).open("rb") as file:
        return _RECORDING.encode() in file.read(1000)
    return False


def file_of_log(path: Path) -> Path:
    """The file that identifies a recording: the metadata of a folder, or itself."""
    return path / _METADATA if is_bag_folder(path) else path


@contextmanager
def open_log(path: Path | str) -> Iterator[LogReader]:
    """Reader of a log; errors of the block become a VideoError."""
    path = Path(path)
    try:
        # also writes the lane of logs that are read without it
        import_module("rosbags")
        with ExitStack() as opened:
            parts = _list_parts(path) if path.is_dir() else [path]
            files = []
            for part in parts:
                file = _unpack(part, opened)
                open_file = _OPENERS[file.suffix.lower()]
                files.append(open_file(file, opened))
            yield LogReader(files)
    except LaneError:
        raise
    except ImportError as error:
        raise VideoError(
            f"{path}: robot logs need packages ({error}); "
            "run `pip install rosbags mcap mcap-protobuf-support`."
        ) from error
    except Exception as error:  # damaged files raise many types
        remedy = "copy it again"
        if ".mcap" in path.name.lower():
            remedy += ", or repair it with `mcap recover` (github.com/foxglove/mcap)"
        raise VideoError(
            f"{path}: is cut off, damaged, encrypted or no robot log ({error}); "
            f"{remedy}."
        ) from error


# Recordings of rosbag2.


def _list_parts(folder: Path) -> list[Path]:
    """The files of a ROS 2 recording in the order of its metadata."""
    file = folder / _METADATA
    text = read_text(file, "metadata", error=VideoError, max_bytes=20_000_000)
    recorded = parse_yaml(text)[_RECORDING]["relative_file_paths"]
    names = [PurePath(name).name for name in recorded]
    if not names:
        raise VideoError(
            f"{folder}: {_METADATA} names no file; name another recording."
        )

    for name in names:
        if not (folder / name).is_file():
            raise VideoError(
                f"{folder}: {name}, which {_METADATA} names, is missing; copy it there."
            )
    return [folder / name for name in names]


def _unpack(path: Path, opened: ExitStack) -> Path:
    """The file; if rosbag2 has compressed it, an unpacked one in a temporary folder."""
    if path.suffix.lower() not in (".zstd", ".zst"):
        return path
    folder = opened.enter_context(TemporaryDirectory())
    unpacked = Path(folder, path.stem)
    zstandard = import_module("zstandard")
    with zstandard.open(path, "rb") as source, unpacked.open("wb") as target:
        shutil.copyfileobj(source, target)
    return unpacked


def _open_database(path: Path, opened: ExitStack) -> LogFile:
    """A file of rosbag2 in SQLite."""
    path, mode = _complete_database(path, opened)
    log = path.with_name(f"{path.name}-wal")
    was_killed = log.is_file() and log.stat().st_size > 0
    if was_killed:
        mode = "mode=ro"
    uri = f"{path.absolute().as_uri()}?{mode}"
    connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
    database = opened.enter_context(closing(connection))
    try:
        query = "SELECT id, name, type, serialization_format FROM topics"
        rows = database.execute(query).fetchall()
    except sqlite3.OperationalError as error:
        if not was_killed:
            raise
        raise VideoError(
            f"{path}: its recorder was killed, and its log {log.name} cannot be read; "
            "copy both into a folder with write permission."
        ) from error

    query = "SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"
    counts = dict(database.execute(query))
    channels = []
    for number, name, type_name, encoding in rows:
        topic = Topic(name, type_name, encoding, counts.get(number, 0))
        channels.append((number, topic))

    def read(numbers: list[int], start_ns: int) -> Iterator[tuple[int, bytes]]:
        places = ",".join("?" * len(numbers))
        query = (
            f"SELECT timestamp, data FROM messages WHERE topic_id IN ({places}) "
            "AND timestamp >= ? ORDER BY timestamp, id"
        )
        return database.execute(query, [*numbers, start_ns])

    return LogFile(channels, read)


def _complete_database(path: Path, opened: ExitStack) -> tuple[Path, str]:
    """The database, and how SQLite opens it; a copy if its recorder was killed while it
    wrote without a write-ahead log: SQLite takes back what was written by halves.
    """
    journal = path.with_name(f"{path.name}-journal")
    if not journal.is_file() or not journal.stat().st_size:
        # As it is: SQLite would write files beside a database in WAL mode, even if
        # nothing is in its log.
        return path, "immutable=1"
    folder = Path(opened.enter_context(TemporaryDirectory()))
    for file in (path, journal):
        shutil.copyfile(file, folder / file.name)
    return folder / path.name, "mode=rw"


# Other files.


def _open_bag(path: Path, opened: ExitStack) -> LogFile:
    """A ROS 1 bag."""
    from rosbags import rosbag1

    bag = opened.enter_context(rosbag1.Reader(path))
    channels = []
    for connection in bag.connections:
        count = connection.msgcount
        topic = Topic(connection.topic, connection.msgtype, "ros1", count)
        channels.append((connection, topic))

    def read(connections: list[Any], start_ns: int) -> Iterator[tuple[int, bytes]]:
        for _, time_ns, data in bag.messages(connections, start=start_ns):
            yield time_ns, data

    return LogFile(channels, read)


def _open_mcap(path: Path, opened: ExitStack) -> LogFile:
    """An MCAP file of any profile, also without an index."""
    from mcap.reader import NonSeekingReader, SeekingReader

    file = opened.enter_context(path.open("rb"))
    summary = SeekingReader(file).get_summary()
    has_index = _is_complete(summary)

    def messages(**part: Any) -> Iterator[tuple[Any, Any, Any]]:
        file.seek(0)
        reader = SeekingReader(file) if has_index else NonSeekingReader(file)
        return reader.iter_messages(log_time_order=False, **part)

    def read(topics: list[str], start_ns: int) -> Iterator[tuple[int, bytes]]:
        for _, _, message in messages(topics=topics, starting_at=start_ns):
            yield message.log_time, message.data

    counts: Counter[int] = Counter()
    recorded: dict[int, tuple[Any, Any]] = {}
    if has_index:
        counts.update(summary.statistics.channel_message_counts)
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            recorded[channel.id] = (schema, channel)
    else:
        for schema, channel, _ in messages():
            counts[channel.id] += 1
            recorded[channel.id] = (schema, channel)

    channels = []
    for schema, channel in recorded.values():
        topic = Topic(
            name=channel.topic,
            type_name=schema.name if schema else "",
            encoding=channel.message_encoding,
            count=counts[channel.id],
            schema=schema,
        )
        channels.append((channel.topic, topic))
    return LogFile(channels, read)


def _is_complete(summary: Any) -> bool:
    """Whether the index of an MCAP file has all schemas and channels: it may not."""
    if not summary or not summary.statistics:
        return False
    counted = summary.statistics.channel_message_counts.keys()
    used = {channel.schema_id for channel in summary.channels.values()}
    return counted <= summary.channels.keys() and used <= {0, *summary.schemas}


_OPENERS = {".bag": _open_bag, ".db3": _open_database, ".mcap": _open_mcap}


# Messages.


def _decoder_of(topic: Topic) -> Callable[[bytes], Any]:
    """The function that makes a message of the data of a topic, compressed or not."""
    if topic.encoding == "protobuf":
        return _protobuf_decoder(topic)
    if topic.encoding == "json":
        return _json_decoder(topic)
    return _ros_decoder(topic)


def _ros_decoder(topic: Topic) -> Callable[[bytes], Any]:
    """Messages of ROS, in CDR or as in ROS 1, whose types rosbags knows."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    is_ros1 = topic.encoding == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    deserialize = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    name = f"{topic.package}/msg/{topic.kind}"
    if name not in store.types:
        definition = _STAMPED + _FOXGLOVE[topic.kind]
        store.register(get_types_from_msg(definition, name))

    def decode(data: bytes) -> Any:
        if data[:4] == _ZSTD_MAGIC:
            decompressor = import_module("zstandard").ZstdDecompressor()
            data = decompressor.decompressobj().decompress(data)
        return deserialize(data, name)

    return decode


def _protobuf_decoder(topic: Topic) -> Callable[[bytes], Any]:
    """Messages of Foxglove's schemas in protobuf, as the log defines them."""
    from mcap_protobuf.decoder import DecoderFactory

    parse = DecoderFactory().decoder_for(topic.encoding, topic.schema)
    if parse is None:
        raise VideoError(
            f"{topic.name} has no definition of its messages in protobuf; record again."
        )

    def decode(data: bytes) -> SimpleNamespace:
        message = parse(data)
        names = [field.name for field in message.DESCRIPTOR.fields]
        fields = {name: getattr(message, name) for name in names}
        stamp = message.timestamp
        fields["timestamp"] = {"sec": stamp.seconds, "nsec": stamp.nanos}
        return SimpleNamespace(**fields)

    return decode


def _json_decoder(topic: Topic) -> Callable[[bytes], Any]:
    """Messages of ROS or of Foxglove's schemas in JSON; all names in lower case.

    Bytes are in base64, or a list of numbers.
    """
    kind = _LIKE_FOXGLOVE.get(topic.kind, topic.kind)
    defaults: dict[str, Any] = {"timestamp": SimpleNamespace()}
    for line in _FOXGLOVE[kind].splitlines():
        field_type, name = line.split()
        defaults[name.lower()] = _DEFAULTS.get(field_type, [])

    def decode(data: bytes) -> SimpleNamespace:
        content = json.loads(data, object_hook=_lower_case)
        fields = dict(defaults)
        for name, value in vars(content).items():
            if value is not None:
                fields[name] = value
        if "data" in fields:
            stored = fields["data"]
            is_text = isinstance(stored, str)
            fields["data"] = base64.b64decode(stored) if is_text else bytes(stored)
        return SimpleNamespace(**fields)

    return decode


def _lower_case(mapping: dict[str, Any]) -> SimpleNamespace:
    """An object of JSON, with names in lower case: ROS 1 and 2 differ in them."""
    return SimpleNamespace(**{name.lower(): value for name, value in mapping.items()})
