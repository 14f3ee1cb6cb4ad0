"""Files in and out: checks of input files, atomic writes, locks on outputs, and
telemetry (CSV).

An output is written to ``STEM.partial.SUFFIX`` in the same folder and renamed when it
is complete. Meanwhile the writer holds a lock, which the operating system releases when
the process ends. A second writer of the same output is refused; after a killed process
the next run writes the same partial file again.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import io
import json
import os
import re
import stat
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from filelock import FileLock, Timeout

from lanes.errors import LaneError

_PARTIAL = ".partial"
# Suffix of the messages that are written next to the video of a robot log; other than
# that of a log.
MESSAGES_SUFFIX = ".lane.mcap"
# A second writer waits this long for the lock: as long as it takes to write a small
# file.
_LOCK_TIMEOUT_S = 1.0
NO_PERMISSION = "{}: permission denied; get read permission, or copy it."
_STREAMS = "Cameras and streams: read them in your own loop, see docs/own_loop.md."
# What is there instead of a file, by `stat`; anything else is a device.
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}


def require_path(path: object) -> Path:
    """The path; raises LaneError for what is none, and FileNotFoundError for the
    address of a stream.
    """
    if not isinstance(path, str | os.PathLike):
        raise LaneError(f"{path!r:.60}: is no path; give that of one file. {_STREAMS}")
    name = os.fspath(path)
    if is_stream(name):
        raise FileNotFoundError(f"{name}: is no file. {_STREAMS}")
    return Path(name)


def is_stream(name: str) -> bool:
    """Whether a name is that of a camera or of a stream, and not of a file."""
    # pathlib makes rtsp:/camera of rtsp://camera
    is_address = re.match(r"[a-z][a-z0-9+.-]+:/", name, re.IGNORECASE)
    return bool(is_address or name.isdecimal()) and not os.path.lexists(name)


def require_file(
    path: str | Path,
    kind: str,
    *,
    error: type[ValueError] = ValueError,
    max_bytes: int | None = None,
) -> Path:
    """The path, if it is a readable, ordinary file; a pipe would block the reader, a
    device would fill the memory.

    `kind` is the expected content, for the error message: "image", "video". Raises
    FileNotFoundError if the file does not exist, otherwise `error`.
    """
    path = require_path(path)
    try:
        found = path.stat()
    except PermissionError as refused:
        raise error(NO_PERMISSION.format(path)) from refused
    except (OSError, ValueError) as missing:  # ValueError: a NUL in the name
        raise FileNotFoundError(
            f"{path}: there is no such {kind} file; check the name and the folder."
        ) from missing
    if not stat.S_ISREG(found.st_mode):
        remedy = f"name a {kind} file"
        if stat.S_ISDIR(found.st_mode):
            remedy += f" in it, or {path / '*'} for all of them"
        raise error(f"{path}: is {_describe_kind(found)}; {remedy}.")
    if not os.access(path, os.R_OK):
        raise error(NO_PERMISSION.format(path))
    if not found.st_size:
        raise error(f"{path}: the file is empty; copy it again from its source.")
    if max_bytes is not None and found.st_size > max_bytes:
        raise error(
            f"{path}: is {found.st_size / 1e6:.0f} MB large, more than the maximum of "
            f"a {kind} file ({max_bytes / 1e6:g} MB); name another file."
        )
    return path


def require_no_input_among(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise ValueError if one of the outputs would overwrite one of the inputs."""
    read = set(map(_identity, inputs))
    for output in outputs:
        if _identity(output) in read:
            raise ValueError(
                f"{output}: is one of the inputs and would be overwritten; name "
                "another file or folder."
            )


def _identity(path: Path) -> object:
    """What is the same for all names of a file: links, mounts, capitals on macOS."""
    try:
        found = path.stat()
    except OSError:
        # unlike `Path.resolve`, this accepts circular links
        return os.path.realpath(path)
    return found.st_dev, found.st_ino


def read_text(
    path: str | Path,
    kind: str,
    *,
    error: type[ValueError] = ValueError,
    max_bytes: int | None = None,
) -> str:
    """The text of a UTF-8 file; parameters and exceptions as for `require_file`, and
    `error` if it is not UTF-8.
    """
    data = require_file(path, kind, error=error, max_bytes=max_bytes).read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as wrong:
        raise error(
            f"{path}: is not a text file (byte {wrong.start} is not UTF-8); name a "
            f"{kind} file."
        ) from wrong


class _PlainLoader(yaml.SafeLoader):
    """Loader of YAML without aliases: a few of them stand for gigabytes."""

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node:
        if self.check_event(yaml.AliasEvent):
            line = self.peek_event().start_mark.line + 1
            raise yaml.YAMLError(f"line {line} has an alias, which is not allowed")
        return super().compose_node(parent, index)


def parse_yaml(text: str) -> Any:
    """The numbers, strings, lists and mappings in YAML; raises yaml.YAMLError for tags
    and aliases.
    """
    return yaml.load(text, _PlainLoader)


def list_files(folder: str | Path) -> list[Path]:
    """The files of a folder, without hidden and partial ones.

    Raises FileNotFoundError if the folder does not exist, ValueError if it is not
    readable.
    """
    folder = Path(folder)
    if folder.is_file():
        raise ValueError(f"{folder}: is a file; name the folder that holds it.")
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder}: there is no such folder; name the folder that holds the files."
        )
    try:
        found = [path for path in folder.iterdir() if path.is_file()]
    except PermissionError as error:
        raise ValueError(NO_PERMISSION.format(folder)) from error
    # macOS adds hidden files such as ._board1.png.
    return [path for path in found if not _is_hidden(path)]


def _is_hidden(path: Path) -> bool:
    return path.name.startswith(".") or _PARTIAL in path.name


def hash_sources(*sources: Path) -> str:
    """Twelve hexadecimal digits that change with the content of the files; a folder
    stands for its Python files.
    """
    digest = hashlib.sha256()
    for source in sources:
        files = sorted(source.rglob("*.py")) if source.is_dir() else [source]
        for file in files:
            name = file.name
            if file != source:
                name = file.relative_to(source).as_posix()
            digest.update(f"{name}\0".encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:12]


def read_json_lines(
    path: str | Path, kind: str, *, max_bytes: int | None = None
) -> Iterator[tuple[int, Any]]:
    """Number and content of each line of a file of JSON lines, without blank ones;
    ValueError names a line that is bad.

    `kind` is what a line holds, for the message.
    """
    text = read_text(path, kind, max_bytes=max_bytes)
    # Not splitlines: it also splits at characters that JSON allows inside strings.
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        try:
            content = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise ValueError(
                f"{path}: line {number} is not a {kind} ({error!s:.200}); write it as "
                "JSON."
            ) from error
        yield number, content


def write_json_lines(path: str | Path, rows: Iterable[Mapping[str, Any]]) -> Path:
    """Write a JSON object per line atomically; returns the path.

    Raises OSError if the file cannot be written.
    """
    text = "".join(json.dumps(row) + "\n" for row in rows)
    # an empty file would be refused as a failed copy
    write_atomically(path, text.encode() or b"\n")
    return Path(path)


def write_atomically(path: str | Path, data: bytes) -> None:
    """Write a file that is either complete or not there, see `atomic_write`."""
    path = Path(path)
    with atomic_write(path) as partial, translate_write_errors(path):
        partial.write_bytes(data)


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """The name of a partial file to write to; it is renamed to `path` after the block,
    or removed if the block raises.

    A link is replaced at its target and stays a link. The folder is created where
    needed. Raises OSError if the file cannot be written, or if another process is
    writing it; errors of the block are not reworded.
    """
    with ExitStack() as until_written:
        with translate_write_errors(path):
            target = Path(os.path.realpath(path))
            # Root could rename a file over /dev/null.
            if target.exists() and not target.is_file():
                raise OSError(f"it is {_describe_kind(target.stat())}")
            target.parent.mkdir(parents=True, exist_ok=True)
            partial, lock_path = partial_files(target)
            until_written.enter_context(locked(lock_path))
            until_written.callback(_remove, partial)
            partial.write_bytes(b"")
        yield partial
        with translate_write_errors(path):
            # Flushed to the disk, so that a full disk is noticed.
            with partial.open("rb+") as file:
                os.fsync(file.fileno())
            os.replace(partial, target)


def remove_partial(path: Path) -> None:
    """Remove the partial file of an output whose writer has ended; that of another
    writer stays.
    """
    partial, lock_path = partial_files(Path(os.path.realpath(path)))
    if partial.exists() or lock_path.exists():
        with suppress(OSError), locked(lock_path, timeout_s=0):
            partial.unlink(missing_ok=True)


@contextmanager
def locked(path: Path, *, timeout_s: float = _LOCK_TIMEOUT_S) -> Iterator[None]:
    """Hold the lock file `path` during the block, and remove it.

    Raises OSError if another process holds it.
    """
    lock = FileLock(path, timeout=timeout_s, thread_local=False)
    try:
        lock.acquire()
    except Timeout as error:
        raise OSError("another run is writing it; wait until that is done") from error
    except OSError:
        # a file system without locks, or one that refuses to write the partial file as
        # well
        pass
    try:
        yield
    finally:
        # Removed while locked: a process that waits for this lock notices and creates
        # the file again.
        _remove(path)
        lock.release()


def _remove(path: Path) -> None:
    """Remove a file, if it is there and can be removed; on a read-only file system an
    error would hide why nothing was written.
    """
    with suppress(OSError):
        path.unlink(missing_ok=True)


def partial_files(path: Path) -> tuple[Path, Path]:
    """The partial file of an output, and the lock of its writer; both are in the
    output's folder.
    """
    stem = path.stem
    # File systems allow 255 bytes: longer names would leave no room for what is added.
    if len(os.fsencode(path.name)) > 230:
        stem = f"{stem[:40]}-{zlib.crc32(os.fsencode(stem)):08x}"
    name = f"{stem}{_PARTIAL}{path.suffix}"
    return path.with_name(name), path.with_name(f"{name}.lock")


@contextmanager
def translate_write_errors(path: Path) -> Iterator[None]:
    """Reword an OSError raised in the block: the message names `path` and says what to
    do.
    """
    try:
        yield
    except OSError as error:
        remedy = "choose another folder or free some space"
        if error.errno == errno.ENAMETOOLONG:
            remedy = "rename the source, or give a shorter name"
        reason = error.strerror or error
        raise type(error)(f"{path}: cannot be written ({reason}); {remedy}.") from error


def _describe_kind(found: os.stat_result) -> str:
    return _KINDS.get(stat.S_IFMT(found.st_mode), "a device")


# Telemetry: CSV with one row per frame and units in the column names; rendered videos
# have their truth in this form.


class TelemetryWriter:
    """Writer of a CSV table: keeps the rows of a `with` block in memory, and writes
    them atomically at its end.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._columns: dict[str, list] = {}
        self._rows = 0

    def __enter__(self) -> TelemetryWriter:
        with translate_write_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            return
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(self._columns)
        for row in zip(*self._columns.values(), strict=True):
            writer.writerow(map(_field, row))
        # File names of stills may contain bytes that are not UTF-8.
        write_atomically(self.path, table.getvalue().encode(errors="replace"))

    def write(self, row: Mapping[str, object]) -> None:
        """Append a row: column name to value.

        Missing values, None and NaN become empty fields, truth values 1 and 0.

        The table has the columns of all rows, in order of first appearance.
        """
        for name in row:
            self._columns.setdefault(name, [None] * self._rows)
        for name, values in self._columns.items():
            values.append(row.get(name))
        self._rows += 1

    def columns(self) -> dict[str, np.ndarray]:
        """One array (rows,) for each column, as `read_telemetry` returns them."""
        table = {}
        for name, values in self._columns.items():
            if any(isinstance(value, str) for value in values):
                table[name] = np.array([value or "" for value in values])
            else:
                table[name] = np.array(values, float)
        return table


def write_telemetry(path: str | Path, rows: Iterable[Mapping[str, object]]) -> Path:
    """Write rows as CSV, see `TelemetryWriter`; returns the path."""
    with TelemetryWriter(path) as table:
        for row in rows:
            table.write(row)
    return table.path


def read_telemetry(path: str | Path) -> dict[str, np.ndarray]:
    """Read a telemetry or truth CSV into one array (rows,) for each column.

    Columns of numbers become float64 with NaN for empty fields, all others str. Raises
    FileNotFoundError, or ValueError if the file is not a CSV table with a header, a
    column "frame" and rows of equal length.
    """
    text = read_text(path, "telemetry")
    try:
        header, *rows = csv.reader(io.StringIO(text))
        if "frame" not in header:
            raise ValueError("its header names no column 'frame'")
        columns = list(zip(*rows, strict=True))
        if not columns:
            columns = [()] * len(header)
        if len(columns) != len(header):
            raise ValueError("header and rows differ in length")
    except (ValueError, csv.Error) as error:
        raise ValueError(
            f"{path}: is not a telemetry table ({error}); write it with "
            "write_telemetry."
        ) from error
    table = {}
    for name, fields in zip(header, columns, strict=True):
        table[name] = _column(fields)
    return table


def _field(value: object) -> object:
    if value is None:
        return ""
    if isinstance(value, (float, np.floating)):
        # Nine digits resolve micrometres over kilometres and hide the last bits, which
        # differ between processors.
        return "" if np.isnan(value) else f"{value:.9g}"
    return int(value) if isinstance(value, bool) else value


def _column(fields: tuple[str, ...]) -> np.ndarray:
    try:
        return np.array([float(field or "nan") for field in fields])
    except ValueError:
        return np.array(fields)
