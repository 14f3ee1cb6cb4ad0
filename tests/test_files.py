"""Input files are checked, outputs are written atomically, writers lock each other out, and telemetry survives."""

from __future__ import annotations

import os
import socket
import stat

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

# --- in: tests/end_to_end/test_bad_input.py has missing, empty and unreadable files, folders, pipes, devices and links


def test_odd_files_are_refused_by_name(tmp_path):
    """A socket, names that no file can have, files that are too large or no text."""
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        with pytest.raises(PictureError, match="socket: is a socket; name a test file"):
            require_file(tmp_path / "socket", "test", error=PictureError)
    for name in ("gone/too", "long" * 99, "nul\0"):
        with pytest.raises(FileNotFoundError, match="no such test file"):
            require_file(tmp_path / name, "test", error=PictureError)
    (tmp_path / "a").write_text("\ufeffof Windows", encoding="utf-8")
    assert read_text(tmp_path / "a", "test") == "of Windows"
    (tmp_path / "a").write_bytes(b"1234\xff")
    with pytest.raises(PictureError, match="byte 4 is not UTF-8"):
        read_text(tmp_path / "a", "test", error=PictureError)
    with pytest.raises(PictureError, match="MB large"):
        read_text(tmp_path / "a", "test", error=PictureError, max_bytes=4)


# --- out


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_a_full_disk_is_reported_and_keeps_the_old_file(tmp_path, monkeypatch, call):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    write_atomically(tmp_path / "a.txt", b"old")
    monkeypatch.setattr(os, call, full)
    with pytest.raises(OSError, match=r"a\.txt.*No space left"):
        write_atomically(tmp_path / "a.txt", b"new")
    assert names(tmp_path) == {"a.txt"} and (tmp_path / "a.txt").read_bytes() == b"old"


def test_permissions_are_those_of_any_new_file_and_a_link_stays_a_link(tmp_path):
    write_atomically(tmp_path / "a", b"")
    (tmp_path / "b").touch()
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "b").stat().st_mode)
    (tmp_path / "there").mkdir()
    write_atomically(tmp_path / "there" / "real.txt", b"old")
    (tmp_path / "link.txt").symlink_to(tmp_path / "there" / "real.txt")
    write_atomically(tmp_path / "link.txt", b"new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "there" / "real.txt").read_bytes() == b"new"


@pytest.mark.parametrize(("kind", "words"), [("pipe", "is a pipe"), ("folder", "is a folder")])
def test_only_files_are_replaced(tmp_path, kind, words):
    """Root could rename a file over /dev/null."""
    path = tmp_path / kind
    os.mkfifo(path) if kind == "pipe" else path.mkdir()
    with pytest.raises(OSError, match=f"{kind}: cannot be written \\(it {words}"):
        write_atomically(path, b"new")
    assert names(tmp_path) == {kind} and not path.is_file()
    with pytest.raises(OSError, match="it is a device"):
        write_atomically("/dev/null", b"new")


def test_a_second_writer_is_refused_until_the_first_one_ends_or_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_LOCK_TIMEOUT_S", 0.1)
    with atomic_write(tmp_path / "a.txt") as partial:
        with pytest.raises(OSError, match=r"a\.txt: cannot be written \(another run is writing it; wait"):
            write_atomically(tmp_path / "a.txt", b"second")
        write_atomically(tmp_path / "a.csv", b"another output")
        partial.write_text("first")
    assert names(tmp_path) == {"a.txt", "a.csv"} and (tmp_path / "a.txt").read_text() == "first"
    for leftover in partial_files(tmp_path / "a.txt"):
        leftover.write_text("of a killed process, longer than what follows")
    write_atomically(tmp_path / "a.txt", b"third")
    assert names(tmp_path) == {"a.txt", "a.csv"} and (tmp_path / "a.txt").read_text() == "third"


# --- telemetry


def test_telemetry_survives_writing_and_reading_with_nine_digits_and_without_rows(tmp_path):
    rows = [
        {"frame": 0, "time_s": 0.0, "state": "found", "offset_m": np.float64(-0.123456789)},
        {"frame": 1, "time_s": 0.04, "state": "lost", "offset_m": None},
        {"frame": 2, "time_s": 0.08, "state": "found", "offset_m": np.nan, "curvature_per_m": np.float32(0.5)},
    ]
    table = read_telemetry(write_telemetry(tmp_path / "new" / "drive.csv", rows))
    assert list(table) == ["frame", "time_s", "state", "offset_m", "curvature_per_m"]
    np.testing.assert_array_equal(table["frame"], [0, 1, 2])
    assert table["state"].tolist() == ["found", "lost", "found"]
    np.testing.assert_array_equal(table["offset_m"], [-0.123456789, np.nan, np.nan])
    np.testing.assert_array_equal(table["curvature_per_m"], [np.nan, np.nan, 0.5])
    path = write_telemetry(tmp_path / "drive.csv", [{"frame": 7, "offset_m": 1 / 3, "note": "a, b"}])
    assert path.read_bytes() == b'frame,offset_m,note\n7,0.333333333,"a, b"\n'
    path.write_text("frame,offset_m\n")
    assert {name: len(column) for name, column in read_telemetry(path).items()} == {"frame": 0, "offset_m": 0}
    path.unlink()
    with pytest.raises(FileNotFoundError, match=r"drive\.csv: there is no such telemetry"):
        read_telemetry(path)
