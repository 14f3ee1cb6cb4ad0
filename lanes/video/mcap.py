"""MCAP files: the messages of each channel, read record by record (https://mcap.dev/spec).

All profiles, schemas and encodings are read, with and without an index; rosbags reads those of ROS 2 only.
"""

from __future__ import annotations

import struct
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

MAGIC = b"\x89MCAP0\r\n"
# Kinds of records that are read; the others, such as attachments, are skipped.
SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS, DATA_END = KINDS = 0x03, 0x04, 0x05, 0x06, 0x08, 0x0B, 0x0F
_FOOTER = struct.Struct("<BQQQI8s")
# A chunk is some megabytes; recorders that write one per file stay below this.
MAX_CHUNK_BYTES = 4 << 30


@dataclass(frozen=True)
class Channel:
    """A topic of an MCAP file: the name of its schema, and how its messages are encoded."""

    topic: str
    schema: str
    encoding: str


class McapFile:
    """An MCAP file that is open for reading; use it in a `with` block.

    Raises ValueError if the file is cut off or damaged.
    """

    def __init__(self, path: Path) -> None:
        self._file: BinaryIO = path.open("rb")
        try:
            self._schemas: dict[int, str] = {0: ""}
            self._channels_at: dict[int, set[int]] = {}  # of chunks, by their place in the file
            self.channels: dict[int, Channel] = {}
            self.counts = self._read_summary() or self._count_messages()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> McapFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def messages(self, channels: set[int], start_ns: int = 0) -> Iterator[tuple[int, int, bytes]]:
        """(channel, time of the recording in ns, data) of messages on `channels`, not before `start_ns`.

        They are in the order of the file.
        """
        for kind, content in self._data_records(channels, start_ns):
            if kind == MESSAGE:
                channel, _, time_ns, _ = struct.unpack_from("<HIQQ", content)
                if channel in channels and time_ns >= start_ns:
                    yield channel, time_ns, bytes(content[22:])

    def _read_summary(self) -> dict[int, int] | None:
        """Number of messages by channel from the summary at the end of the file; None if it does not say it."""
        if self._file.read(len(MAGIC)) != MAGIC:
            raise ValueError("it does not begin as an MCAP file")
        self._file.seek(0, 2)
        if self._file.tell() < _FOOTER.size + len(MAGIC):
            raise ValueError("it is too short")
        self._file.seek(-_FOOTER.size, 2)
        kind, length, summary, _, _, magic = _FOOTER.unpack(self._file.read(_FOOTER.size))
        if magic != MAGIC or (kind, length) != (0x02, 20):
            raise ValueError("it does not end as an MCAP file")
        counts = None
        self._file.seek(summary)
        for kind, content in _records(self._file) if summary else ():
            if kind == CHUNK_INDEX:
                place, _, length = struct.unpack_from("<QQI", content, 16)
                self._channels_at[place] = {
                    number for number, _ in struct.iter_unpack("<HQ", content[36 : 36 + length])
                }
            elif kind == STATISTICS:
                (length,) = struct.unpack_from("<I", content, 42)
                counts = dict(struct.iter_unpack("<HQ", content[46 : 46 + length]))
            self._describe(kind, content)
        return counts if counts is not None and counts.keys() <= self.channels.keys() else None

    def _count_messages(self) -> dict[int, int]:
        counts = Counter[int]()
        for kind, content in self._data_records():
            self._describe(kind, content)
            if kind == MESSAGE:
                counts.update(struct.unpack_from("<H", content))
        return counts

    def _describe(self, kind: int, content: memoryview) -> None:
        """Keep what a schema or channel record says."""
        if kind == SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            self._schemas[number] = _strings(content, 2, 1)[0]
        elif kind == CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            topic, encoding = _strings(content, 4, 2)
            self.channels[number] = Channel(topic, self._schemas.get(schema, ""), encoding)

    def _data_records(self, channels: set[int] | None = None, start_ns: int = 0) -> Iterator[tuple[int, memoryview]]:
        """The records before the summary, without chunks that end before `start_ns` or have none of the `channels`."""

        def needed(place: int) -> bool:
            known = self._channels_at.get(place)
            if channels and known and not channels & known:
                return False
            _, end_ns = struct.unpack("<QQ", self._file.read(16))
            return end_ns >= start_ns

        self._file.seek(len(MAGIC))
        for kind, content in _records(self._file, needed):
            if kind == DATA_END:
                return
            if kind == CHUNK:
                yield from _records_of(_decompress(content))
            else:
                yield kind, content


def _records(file: BinaryIO, needed: Callable[[int], bool] = lambda _: True) -> Iterator[tuple[int, memoryview]]:
    """Kind and content of each record up to the footer, of chunks only if the one at this place is `needed`."""
    while len(head := file.read(9)) == 9:
        kind, length = struct.unpack("<BQ", head)
        begin = file.tell()
        if kind == 0x02:
            return
        if kind not in KINDS or (kind == CHUNK and not needed(begin - 9)):
            file.seek(begin + length)
            continue
        file.seek(begin)
        if length > MAX_CHUNK_BYTES or len(content := file.read(length)) < length:
            raise ValueError("a record is cut off")
        yield kind, memoryview(content)


def _records_of(chunk: bytes) -> Iterator[tuple[int, memoryview]]:
    """Kind and content of each record of a chunk."""
    content, at = memoryview(chunk), 0
    while at < len(content):
        kind, length = struct.unpack_from("<BQ", content, at)
        if at + 9 + length > len(content):
            raise ValueError("a record in a chunk is cut off")
        yield kind, content[at + 9 : at + 9 + length]
        at += 9 + length


def _decompress(chunk: memoryview) -> bytes:
    """The records of a chunk."""
    (size,) = struct.unpack_from("<Q", chunk, 16)
    (name,) = _strings(chunk, 28, 1)
    begin = 28 + 4 + len(name.encode()) + 8
    data = bytes(chunk[begin:])
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes is too large")
    if name == "zstd":
        data = import_zstd().ZstdDecompressor().decompress(data, size + 1)  # a few bytes could stand for gigabytes
    elif name == "lz4":
        data = import_module("lz4.frame").LZ4FrameDecompressor().decompress(data, size + 1)
    elif name:
        raise ValueError(f"its chunks are compressed as {name!r}")
    if len(data) != size:
        raise ValueError("a chunk is damaged")
    return data


def import_zstd() -> ModuleType:
    """The module for Zstandard of Python 3.14, or the package that rosbags requires."""
    return import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")


def _strings(content: memoryview, at: int, count: int) -> list[str]:
    """Strings that follow each other, each after its length."""
    found = []
    for _ in range(count):
        (length,) = struct.unpack_from("<I", content, at)
        found.append(bytes(content[at + 4 : at + 4 + length]).decode())
        at += 4 + length
    return found
