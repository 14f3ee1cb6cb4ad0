"""Telemetry: CSV with one row per frame and units in the column names; rendered videos have their truth like this."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from lanes.io.files import atomic_write, read_text, translate_write_errors


class TelemetryWriter:
    """Writer of CSV rows, atomically, in a `with` block.

    Rows are collected in a temporary file, because the columns are complete only at the end. If the block raises, an
    earlier file of that name is unchanged.

    The folder is created where needed; entering the block raises OSError if it cannot be written to.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._columns: dict[str, None] = {}

    def __enter__(self) -> TelemetryWriter:
        with translate_write_errors(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            # File names of pictures may contain bytes that are not UTF-8.
            self._rows = TemporaryFile("w+", encoding="utf-8", errors="replace", newline="", dir=self.path.parent)
        self._csv = csv.writer(self._rows, lineterminator="\n")
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            # A full disk is reported above already.
            with suppress(OSError):
                self._rows.close()

    def write(self, row: Mapping[str, object]) -> None:
        """Append a row: column name to value.

        The table has the columns of all rows, in order of first appearance. Missing values, None and NaN become empty
        fields. Raises OSError if the row cannot be written.
        """
        self._columns |= dict.fromkeys(row)
        with translate_write_errors(self.path):
            self._csv.writerow(_field(row.get(name)) for name in self._columns)

    def _finish(self) -> None:
        with atomic_write(self.path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
            self._rows.seek(0)
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(self._columns)
            # Early rows lack the columns that appeared later.
            writer.writerows(row + [""] * (len(self._columns) - len(row)) for row in csv.reader(self._rows))


def write_telemetry(path: str | Path, rows: Iterable[Mapping[str, object]]) -> Path:
    """Write rows as CSV, see `TelemetryWriter`; returns the path."""
    with TelemetryWriter(path) as table:
        for row in rows:
            table.write(row)
    return table.path


def read_telemetry(path: str | Path) -> dict[str, np.ndarray]:
    """Read a telemetry or truth CSV into one array (rows,) for each column.

    Columns of numbers become float64 with NaN for empty fields, all others str.

    Raises
    ------
    FileNotFoundError, ValueError
        If the file does not exist, or is not a CSV table with a header, a column "frame" and rows of equal length.
    """
    text = read_text(path, "telemetry")
    try:
        header, *rows = csv.reader(io.StringIO(text))
        if "frame" not in header:
            raise ValueError("its header names no column 'frame'")
        columns = list(zip(*rows, strict=True)) or [()] * len(header)
        if len(columns) != len(header):
            raise ValueError("header and rows differ in length")
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: is not a telemetry table ({error}); write it with write_telemetry.") from error
    return {name: _column(fields) for name, fields in zip(header, columns, strict=True)}


def _field(value: object) -> object:
    if value is None:
        return ""
    if isinstance(value, (float, np.floating)):
        # Nine digits resolve micrometres over kilometres and hide the last bits, which differ between processors.
        return "" if np.isnan(value) else f"{value:.9g}"
    return value


def _column(fields: tuple[str, ...]) -> np.ndarray:
    try:
        return np.array([float(field) if field else np.nan for field in fields])
    except ValueError:
        return np.array(fields)
