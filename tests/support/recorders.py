"""Robot logs as other programs record them.

MCAP files of every profile and encoding, with messages of Foxglove.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PROTOBUF = {
    "CameraCalibration": CameraCalibration,
    "CompressedImage": CompressedImage,
    "CompressedVideo": CompressedVideo,
    "RawImage": RawImage,
}
# Definitions of the same messages in foxglove_msgs, which rosbags does not know.
ROS = {
    "RawImage": """
        builtin_interfaces/Time timestamp
        string frame_id
        uint32 width
        uint32 height
        string encoding
        uint32 step
        uint8[] data""",
    "CameraCalibration": """
        builtin_interfaces/Time timestamp
        string frame_id
        uint32 width
        uint32 height
        string distortion_model
        float64[] D
        float64[9] K
        float64[9] R
        float64[12] P""",
}
# Encodings of the definition of messages, by that of the messages.
SCHEMA_ENCODINGS = {
    "json": "jsonschema",
    "protobuf": "protobuf",
    "cdr": "ros2msg",
    "ros1": "ros1msg",
}


@dataclass(frozen=True)
class RecordedTopic:
    """A topic: type and encoding of its messages, and times of the recording, ns.

    `definition` is that of the messages; that of ROS is not read.
    """

    type_name: str
    encoding: str
    recorded_ns: Sequence[int]
    messages: Sequence[bytes]
    definition: bytes = b"not read"


def foxglove_topic(
    kind: str,
    encoding: str,
    stamps_ns: Sequence[int],
    rows: Sequence[Mapping[str, Any]],
) -> RecordedTopic:
    """A topic with the fields of `rows` in protobuf, json, or CDR (foxglove_msgs).

    It is recorded later, and irregularly.
    """
    serialize = {
        "protobuf": _serialize_protobuf,
        "json": _serialize_json,
        "cdr": _serialize_ros,
    }[encoding]
    recorded_ns, messages = [], []
    for number, (stamp_ns, row) in enumerate(zip(stamps_ns, rows, strict=True)):
        recorded_ns.append(stamp_ns + 30_000_000 + 7_000_000 * (number % 2))
        messages.append(serialize(kind, *divmod(stamp_ns, 10**9), row))

    name = f"foxglove_msgs/msg/{kind}" if encoding == "cdr" else f"foxglove.{kind}"
    definition = b"not read"
    if encoding == "protobuf":
        definition = build_file_descriptor_set(PROTOBUF[kind]).SerializeToString()
    return RecordedTopic(name, encoding, recorded_ns, messages, definition)


def _serialize_protobuf(
    kind: str, seconds: int, nanoseconds: int, row: Mapping[str, Any]
) -> bytes:
    message = PROTOBUF[kind](**row)
    message.timestamp.seconds = seconds
    message.timestamp.nanos = nanoseconds
    return message.SerializeToString()


def _serialize_json(
    kind: str, seconds: int, nanoseconds: int, row: Mapping[str, Any]
) -> bytes:
    content: dict[str, Any] = {"timestamp": {"sec": seconds, "nsec": nanoseconds}}
    for name, value in row.items():
        is_binary = isinstance(value, bytes)
        content[name] = base64.b64encode(value).decode() if is_binary else value
    return json.dumps(content).encode()


def _serialize_ros(
    kind: str, seconds: int, nanoseconds: int, row: Mapping[str, Any]
) -> bytes:
    store = get_typestore(Stores.ROS2_HUMBLE)
    name = f"foxglove_msgs/msg/{kind}"
    store.register(get_types_from_msg(ROS[kind], name))
    stamp = store.types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
    fields: dict[str, Any] = {"timestamp": stamp, "frame_id": "camera"}
    for field, value in row.items():
        if isinstance(value, bytes):
            value = np.frombuffer(value, np.uint8)
        fields[field] = np.array(value) if isinstance(value, list) else value
    return bytes(store.serialize_cdr(store.types[name](**fields), name))


def write_mcap(
    path: Path,
    topics: Mapping[str, RecordedTopic],
    *,
    profile: str = "",
    compression: str = "ZSTD",
    **options: Any,
) -> Path:
    """Write an MCAP file with mcap's writer; `options` are those of its layout."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType[compression], **options)
        writer.start(profile=profile, library="a test")
        for name, topic in topics.items():
            schema_encoding = SCHEMA_ENCODINGS.get(topic.encoding, "any")
            schema = writer.register_schema(
                topic.type_name, schema_encoding, topic.definition
            )
            channel = writer.register_channel(name, topic.encoding, schema)
            recorded = zip(topic.recorded_ns, topic.messages, strict=True)
            for sequence, (time_ns, data) in enumerate(recorded):
                writer.add_message(channel, time_ns, data, time_ns, sequence)
        writer.finish()
    return path
