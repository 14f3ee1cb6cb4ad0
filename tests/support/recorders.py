"""Robot logs as other programs record them: MCAP files of every profile and encoding, compressed and split bags."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import CompressionType, Writer

_KINDS = descriptor_pb2.FieldDescriptorProto
# Fields of Foxglove's schemas that are written: name, number and type.
SCHEMAS = {
    "foxglove.CompressedImage": [("data", 2, _KINDS.TYPE_BYTES), ("format", 3, _KINDS.TYPE_STRING)],
    "foxglove.CompressedVideo": [("data", 3, _KINDS.TYPE_BYTES), ("format", 4, _KINDS.TYPE_STRING)],
    "foxglove.RawImage": [
        ("width", 2, _KINDS.TYPE_FIXED32),
        ("height", 3, _KINDS.TYPE_FIXED32),
        ("encoding", 4, _KINDS.TYPE_STRING),
        ("step", 5, _KINDS.TYPE_FIXED32),
        ("data", 6, _KINDS.TYPE_BYTES),
    ],
    "foxglove.CameraCalibration": [
        ("frame_id", 9, _KINDS.TYPE_STRING),
        ("width", 2, _KINDS.TYPE_FIXED32),
        ("height", 3, _KINDS.TYPE_FIXED32),
        ("distortion_model", 4, _KINDS.TYPE_STRING),
        ("D", 5, _KINDS.TYPE_DOUBLE),
        ("K", 6, _KINDS.TYPE_DOUBLE),
        ("P", 8, _KINDS.TYPE_DOUBLE),
    ],
}


def _message_class(name: str) -> Any:
    """The class of a message of Foxglove's schemas, as protoc would make it."""
    file = descriptor_pb2.FileDescriptorProto(name=f"{name}.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    kind = file.message_type.add(name=name.rpartition(".")[2])
    stamp = {"type": _KINDS.TYPE_MESSAGE, "type_name": ".google.protobuf.Timestamp", "label": _KINDS.LABEL_OPTIONAL}
    kind.field.add(name="timestamp", number=1, **stamp)
    for field, number, type_ in SCHEMAS[name]:
        label = _KINDS.LABEL_REPEATED if type_ == _KINDS.TYPE_DOUBLE else _KINDS.LABEL_OPTIONAL
        kind.field.add(name=field, number=number, type=type_, label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def serialize(name: str, encoding: str, stamp_ns: int, fields: dict[str, Any]) -> bytes:
    """A message of Foxglove's schemas in protobuf or JSON."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    if encoding == "json":
        plain = {k: base64.b64encode(v).decode() if isinstance(v, bytes) else v for k, v in fields.items()}
        return json.dumps({"timestamp": {"sec": seconds, "nsec": nanoseconds}, **plain}).encode()
    message = _message_class(name)(**fields)
    message.timestamp.seconds, message.timestamp.nanos = seconds, nanoseconds
    return message.SerializeToString()


def write_mcap(
    path: Path,
    topics: dict[str, tuple[str, str, str, Sequence[tuple[int, bytes]]]],
    *,
    profile: str = "",
    compression: str = "ZSTD",
    **options: Any,
) -> Path:
    """Write an MCAP file with Foxglove's writer.

    `topics` have the name of the schema, its encoding, that of the messages, and (time of the recording in ns, data) of
    each message.
    """
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType[compression], **options)
        writer.start(profile=profile, library="a test")
        for topic, (schema, schema_encoding, encoding, messages) in topics.items():
            number = writer.register_schema(schema, schema_encoding, b"not read")
            channel = writer.register_channel(topic, encoding, number)
            for sequence, (time_ns, data) in enumerate(messages):
                writer.add_message(channel, time_ns, data, time_ns, sequence)
        writer.finish()
    return path
