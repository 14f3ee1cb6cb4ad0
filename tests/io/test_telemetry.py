"""Telemetry: values survive writing and reading, and missing values are not zero."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.files import read_telemetry, write_telemetry


def test_round_trip(tmp_path):
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


def test_text(tmp_path):
    path = write_telemetry(tmp_path / "drive.csv", [{"frame": 7, "offset_m": 1 / 3, "note": "a, b"}])
    assert path.read_bytes() == b'frame,offset_m,note\n7,0.333333333,"a, b"\n'


def test_header_alone(tmp_path):
    (tmp_path / "drive.csv").write_text("frame,offset_m\n")
    table = read_telemetry(tmp_path / "drive.csv")
    assert {name: len(column) for name, column in table.items()} == {"frame": 0, "offset_m": 0}


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"drive\.csv: there is no such telemetry"):
        read_telemetry(tmp_path / "drive.csv")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"hello",
        b"hello\nworld\n",
        b"Dear all,\n\nhello\n",
        b"frame,offset_m\n1,2\n3\n",
        b"frame\n1,2\n",
        b"frame\n\xff\xfe\n",
    ],
)
def test_files_that_are_not_a_table(tmp_path, content):
    (tmp_path / "drive.csv").write_bytes(content)
    with pytest.raises(ValueError, match=r"drive\.csv: (is not a (telemetry table|text file)|the file is empty)"):
        read_telemetry(tmp_path / "drive.csv")


def test_failure_keeps_the_earlier_file(tmp_path):
    path = write_telemetry(tmp_path / "drive.csv", [{"frame": 1}])

    def rows():
        yield {"frame": 2}
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_telemetry(path, rows())
    assert path.read_text() == "frame\n1\n"
    assert len(list(tmp_path.iterdir())) == 1
