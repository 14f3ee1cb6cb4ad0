"""Input files are checked, outputs are written atomically, writers lock each other out,
and telemetry survives.
"""

from __future__ import annotations

import errno
import os
import socket
import stat
from pathlib import Path

import numpy as np
import pytest

from lanes import files
from lanes.errors import PictureError
from lanes.files import (
    atomic_write,
    partial_files,
    read_telemetry,
    read_text,
    require_file,
    write_atomically,
    write_telemetry,
)
from tests.support.project import names

# In. tests/end_to_end/test_bad_input.py has missing, empty and unreadable files,
# folders, pipes, devices and links.


def test_a_socket_is_refused(tmp_path):
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(path))
        with pytest.raises(PictureError, match="socket: is a socket; name a test file"):
            require_file(path, "test", error=PictureError)


@pytest.mark.parametrize("name", ["gone/too", "long" * 99, "nul\0"])
def test_a_name_that_no_file_can_have_is_one_of_no_file(tmp_path, name):
    with pytest.raises(FileNotFoundError, match="no such test file"):
        require_file(tmp_path / name, "test", error=PictureError)


def test_the_byte_order_mark_of_windows_is_no_text(tmp_path):
    path = tmp_path / "a"
    path.write_text("\ufeffof Windows", encoding="utf-8")
    assert read_text(path, "test") == "of Windows"


def test_what_is_no_text_is_refused(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"1234\xff")
    with pytest.raises(PictureError, match="byte 4 is not UTF-8"):
        read_text(path, "test", error=PictureError)


def test_a_file_that_is_too_large_is_refused(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    with pytest.raises(PictureError, match="MB large"):
        read_text(path, "test", error=PictureError, max_bytes=4)


# Out.


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_a_full_disk_is_reported_and_keeps_the_old_file(tmp_path, monkeypatch, call):
    path = tmp_path / "a.txt"
    write_atomically(path, b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, full)
    with pytest.raises(OSError, match=r"a\.txt.*No space left"):
        write_atomically(path, b"new")
    assert names(tmp_path) == {"a.txt"}
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.ENOTSUP])
def test_a_folder_that_is_read_only_is_reported(tmp_path, monkeypatch, number):
    """There is a folder, in which nothing can be written, nor removed."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    for name in ("write_bytes", "unlink"):
        monkeypatch.setattr(Path, name, refuse)
    words = rf"a\.txt: cannot be written \({os.strerror(number)}\); choose another fol"
    with pytest.raises(OSError, match=words):
        write_atomically(tmp_path / "a.txt", b"new")


def test_permissions_are_those_of_any_new_file(tmp_path):
    ours = tmp_path / "a"
    other = tmp_path / "b"
    write_atomically(ours, b"")
    other.touch()
    mode = stat.S_IMODE(ours.stat().st_mode)
    assert mode == stat.S_IMODE(other.stat().st_mode)


def test_a_link_stays_a_link(tmp_path):
    real = tmp_path / "there" / "real.txt"
    write_atomically(real, b"old")
    link = tmp_path / "link.txt"
    link.symlink_to(real)

    write_atomically(link, b"new")

    assert link.is_symlink()
    assert real.read_bytes() == b"new"


def test_a_pipe_is_not_replaced(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(OSError, match=r"pipe: cannot be written \(it is a pipe"):
        write_atomically(path, b"new")
    assert names(tmp_path) == {"pipe"}
    assert path.is_fifo()


def test_a_folder_is_not_replaced(tmp_path):
    path = tmp_path / "folder"
    path.mkdir()
    with pytest.raises(OSError, match=r"folder: cannot be written \(it is a folder"):
        write_atomically(path, b"new")
    assert names(tmp_path) == {"folder"}
    assert path.is_dir()


def test_a_device_is_not_replaced():
    """Root could rename a file over /dev/null."""
    with pytest.raises(OSError, match="it is a device"):
        write_atomically("/dev/null", b"new")


def test_a_second_writer_is_refused_until_the_first_one_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_LOCK_TIMEOUT_S", 0.1)
    path = tmp_path / "a.txt"
    words = r"a\.txt: cannot be written \(another run is writing it; wait"
    with atomic_write(path) as partial:
        with pytest.raises(OSError, match=words):
            write_atomically(path, b"second")
        partial.write_text("first")
    assert path.read_text() == "first"


def test_another_output_can_be_written_meanwhile(tmp_path):
    with atomic_write(tmp_path / "a.txt"):
        write_atomically(tmp_path / "a.csv", b"another output")
    assert names(tmp_path) == {"a.txt", "a.csv"}


def test_the_files_of_a_killed_writer_are_replaced(tmp_path):
    path = tmp_path / "a.txt"
    for leftover in partial_files(path):
        leftover.write_text("of a killed process, longer than what follows")

    write_atomically(path, b"third")

    assert names(tmp_path) == {"a.txt"}
    assert path.read_text() == "third"


# Telemetry.

# nine digits
OFFSET_M = np.float64(-0.123456789)


@pytest.fixture
def table(tmp_path) -> dict[str, np.ndarray]:
    """What is read of three rows, with a column that begins in the last one."""
    rows = [
        {"frame": 0, "time_s": 0.0, "state": "found", "offset_m": OFFSET_M},
        {"frame": 1, "time_s": 0.04, "state": "lost", "offset_m": None},
        {"frame": 2, "time_s": 0.08, "state": "found", "offset_m": np.nan},
    ]
    rows[2]["curvature_per_m"] = np.float32(0.5)
    return read_telemetry(write_telemetry(tmp_path / "new" / "drive.csv", rows))


def test_the_columns_of_a_table_are_in_their_order(table):
    assert list(table) == ["frame", "time_s", "state", "offset_m", "curvature_per_m"]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("frame", [0, 1, 2]),
        ("state", ["found", "lost", "found"]),
        ("offset_m", [OFFSET_M, np.nan, np.nan]),
        ("curvature_per_m", [np.nan, np.nan, 0.5]),
    ],
)
def test_a_column_survives_writing_and_reading(table, name, values):
    np.testing.assert_array_equal(table[name], values)


def test_numbers_are_written_with_nine_digits(tmp_path):
    row = {"frame": 7, "offset_m": 1 / 3, "note": "a, b"}
    path = write_telemetry(tmp_path / "drive.csv", [row])
    assert path.read_bytes() == b'frame,offset_m,note\n7,0.333333333,"a, b"\n'


def test_a_table_without_rows_has_empty_columns(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("frame,offset_m\n")
    table = read_telemetry(path)
    assert list(table) == ["frame", "offset_m"]
    assert [len(column) for column in table.values()] == [0, 0]


def test_a_missing_table_is_named(tmp_path):
    words = r"drive\.csv: there is no such telemetry"
    with pytest.raises(FileNotFoundError, match=words):
        read_telemetry(tmp_path / "drive.csv")
