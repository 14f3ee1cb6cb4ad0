"""Robot logs as other programs record them: MCAP files of every profile and encoding, with messages of Foxglove."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# The fields that are written, as in the .proto files; field 1 is the timestamp.
SCHEMAS = {
    "CompressedImage": "bytes data = 2; string format = 3",
    "CompressedVideo": "bytes data = 3; string format = 4",
    "RawImage": "fixed32 width = 2; fixed32 height = 3; string encoding = 4; fixed32 step = 5; bytes data = 6",
    "CameraCalibration": "fixed32 width = 2; fixed32 height = 3; string distortion_model = 4; "
    "repeated double D = 5; repeated double K = 6; repeated double R = 7; repeated double P = 8",
}
# The same types in a message of ROS.
ROS_TYPES = {"bytes": "uint8[]", "string": "string", "fixed32": "uint32"}
ROS_TYPES |= {"D": "float64[]", "K": "float64[9]", "R": "float64[9]", "P": "float64[12]"}
# A topic: name of its type, encoding, and (time of the recording in ns, data) of each message.
Topic = tuple[str, str, Sequence[tuple[int, bytes]]]


def foxglove_topic(kind: str, encoding: str, stamps_ns: Sequence[int], rows: Sequence[Mapping[str, Any]]) -> Topic:
    """A topic with the fields of `rows` in protobuf, json, or CDR (foxglove_msgs); recorded later, and irregularly."""
    serialize = {"protobuf": _serialize_protobuf, "json": _serialize_json, "cdr": _serialize_ros}[encoding]
    recorded = [stamp + 30_000_000 + 7_000_000 * (number % 2) for number, stamp in enumerate(stamps_ns)]
    made = [serialize(kind, *divmod(stamp, 10**9), row) for stamp, row in zip(stamps_ns, rows, strict=True)]
    name = f"foxglove_msgs/msg/{kind}" if encoding == "cdr" else f"foxglove.{kind}"
    return name, encoding, list(zip(recorded, made, strict=True))


def _serialize_json(kind: str, seconds: int, nanoseconds: int, row: Mapping[str, Any]) -> bytes:
    plain = {
        name: base64.b64encode(value).decode() if isinstance(value, bytes) else value for name, value in row.items()
    }
    return json.dumps({"timestamp": {"sec": seconds, "nsec": nanoseconds}, **plain}).encode()


def _serialize_protobuf(kind: str, seconds: int, nanoseconds: int, row: Mapping[str, Any]) -> bytes:
    """As with the class that protoc makes."""
    file = descriptor_pb2.FileDescriptorProto(name=f"{kind}.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    message = file.message_type.add(name=kind)
    types = descriptor_pb2.FieldDescriptorProto
    stamp = {"type": types.TYPE_MESSAGE, "type_name": ".google.protobuf.Timestamp", "label": types.LABEL_OPTIONAL}
    message.field.add(name="timestamp", number=1, **stamp)
    for repeated, type_, name, number in re.findall(r"(repeated )?(\w+) (\w+) = (\d+)", SCHEMAS[kind]):
        label = types.LABEL_REPEATED if repeated else types.LABEL_OPTIONAL
        message.field.add(name=name, number=int(number), type=f"TYPE_{type_.upper()}", label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    made = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{kind}"))(**row)
    made.timestamp.seconds, made.timestamp.nanos = seconds, nanoseconds
    return made.SerializeToString()


def _serialize_ros(kind: str, seconds: int, nanoseconds: int, row: Mapping[str, Any]) -> bytes:
    """As a message of ROS, which rosbags does not know."""
    store, name = get_typestore(Stores.ROS2_HUMBLE), f"foxglove_msgs/msg/{kind}"
    definition = "builtin_interfaces/Time timestamp\nstring frame_id\n"
    for type_, field in re.findall(r"(\w+) (\w+) = ", SCHEMAS[kind]):
        definition += f"{ROS_TYPES.get(field) or ROS_TYPES[type_]} {field}\n"
    store.register(get_types_from_msg(definition, name))
    as_array = {bytes: lambda value: np.frombuffer(value, np.uint8), list: np.array}
    values = [as_array.get(type(value), lambda value: value)(value) for value in row.values()]
    stamp = store.types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
    return bytes(store.serialize_cdr(store.types[name](stamp, "camera", *values), name))


def write_mcap(
    path: Path, topics: Mapping[str, Topic], *, profile: str = "", compression: str = "ZSTD", **options: Any
) -> Path:
    """Write an MCAP file with Foxglove's writer; `options` are those of its layout."""
    schemas = {"json": "jsonschema", "protobuf": "protobuf", "cdr": "ros2msg", "ros1": "ros1msg"}
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType[compression], **options)
        writer.start(profile=profile, library="a test")
        for topic, (type_name, encoding, messages) in topics.items():
            number = writer.register_schema(type_name, schemas.get(encoding, "any"), b"not read")
            channel = writer.register_channel(topic, encoding, number)
            for sequence, (time_ns, data) in enumerate(messages):
                writer.add_message(channel, time_ns, data, time_ns, sequence)
        writer.finish()
    return path
