"""Cells run by nbval in a copy of the course, in a process of their own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import nbformat
import psutil

from benchmark.evaluation import PROJECT_ROOT
from course.exercises.check import GRADING
from course.grading.nbval_record import RECORD

# What the notebook imports and reads.
PACKAGES = ("lanes", "simulator", "benchmark", "course")
DATA = ("camera_cal", "test_images", "test_videos", "docs")
# What a student may need beside the notebook: an image or a video of a road.
MEDIA = (".jpg", ".jpeg", ".png", ".mp4", ".mov", ".avi", ".mkv", ".webm")
# Time beyond that of a cell: the start of a kernel on a loaded machine, and nbval's own
# attempts to stop a cell.
PATIENCE_S = 120.0
# Variables of the teacher's shell that would change what the notebook does.
OWN_VARIABLES = ("LANES_DATA", "MPLBACKEND", "PYTHONPATH", "PYTEST_ADDOPTS")


@dataclass(frozen=True)
class CellResult:
    """What nbval found in a cell.

    `failed` is None or the reason, `error` the name of the exception and `error_text`
    its message, `printed` the text on stdout. `ended` is False if the cell did not end
    by itself and took the kernel with it.
    """

    failed: str | None
    error: str | None
    error_text: str
    printed: str
    ended: bool


NOT_RUN = CellResult("was not run", error=None, error_text="", printed="", ended=True)


def run_cells(
    cells: Sequence[nbformat.NotebookNode], *, media: Path, cell_timeout_s: float
) -> list[CellResult]:
    """Run code cells in grading mode, in a temporary copy of the course; returns a
    result for each.

    Images and videos of the folder `media` are copied along. A cell that runs longer
    than `cell_timeout_s` is interrupted. After a cell that ends the kernel, or cannot
    be interrupted, the others are `NOT_RUN`. Raises OSError if nbval ends without
    running a cell.
    """
    # A process that the student's code left behind may still write.
    temporary = tempfile.TemporaryDirectory(
        prefix="grading-", ignore_cleanup_errors=True
    )
    with temporary as name:
        folder = Path(name)
        _copy_course(folder)
        for file in media.iterdir():
            if file.suffix.lower() in MEDIA and file.is_file():
                shutil.copy(file, folder)
        notebook = nbformat.v4.new_notebook(cells=list(cells))
        nbformat.write(notebook, folder / "submission.ipynb")
        record = folder / "record.jsonl"
        record.touch()
        log = folder / "nbval.txt"
        ended = _run_nbval(folder, record, log, cell_timeout_s)
        if ended and cells and not record.stat().st_size:
            said = log.read_text(errors="replace")[-2000:]
            raise OSError(f"nbval ran no cell, not even the first; it said:\n{said}")
        return _read_record(record, len(cells))


def _copy_course(folder: Path) -> None:
    """Copy what the notebook needs, so that it cannot overwrite the teacher's files by
    accident.
    """
    shutil.copy2(PROJECT_ROOT / "helpers.py", folder)
    for name in PACKAGES + DATA:
        shutil.copytree(PROJECT_ROOT / name, folder / name)
    (folder / "output_images").mkdir()
    # Without a file of its own, pytest would look for one in the folders above.
    (folder / "pytest.ini").write_text("[pytest]\n")


def _run_nbval(folder: Path, record: Path, log: Path, cell_timeout_s: float) -> bool:
    """Run nbval on the notebook in `folder`; returns whether it ended by itself.

    A run without progress is ended with all processes that it started.
    """
    environment = {
        name: value for name, value in os.environ.items() if name not in OWN_VARIABLES
    }
    environment |= {GRADING: "1", RECORD: str(record), "JUPYTER_PLATFORM_DIRS": "1"}
    options = (
        f"--nbval --nbval-current-env --nbval-cell-timeout {cell_timeout_s} "
        "-p course.grading.nbval_record -p no:cacheprovider -p no:randomly -p no:xdist"
    )
    command = [sys.executable, "-m", "pytest", *options.split(), "submission.ipynb"]
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
        try:
            return _wait(process, record, cell_timeout_s + PATIENCE_S)
        finally:
            _end(process)
            process.wait()


def _wait(process: subprocess.Popen, record: Path, most_s: float) -> bool:
    """Wait for a process as long as it writes to its record at least every `most_s`;
    returns whether it ended.
    """
    written_bytes = -1
    while record.stat().st_size > written_bytes:
        written_bytes = record.stat().st_size
        try:
            process.wait(most_s)
            return True
        except subprocess.TimeoutExpired:
            continue
    return False


def _end(process: subprocess.Popen) -> None:
    """End a process and those that it started: the kernel has a session of its own."""
    try:
        running = psutil.Process(process.pid)
        family = [*running.children(recursive=True), running]
    except psutil.NoSuchProcess:
        return
    for member in family:
        try:
            member.kill()
        except psutil.NoSuchProcess:
            continue


def _read_record(record: Path, count: int) -> list[CellResult]:
    """The results of `count` cells from the lines that the plugin wrote."""
    results = [NOT_RUN] * count
    kernel_alive = True
    # Text after the last line break is a line that was cut off.
    lines = record.read_text(encoding="utf-8").split("\n")[:-1]
    for index, line in enumerate(lines):
        entry = json.loads(line)
        if not kernel_alive:
            break
        kernel_alive = entry["kernel_alive"]
        results[index] = CellResult(
            failed=entry["failed"],
            error=entry["error"],
            error_text=entry["error_text"],
            printed=entry["printed"],
            ended=kernel_alive,
        )
    unfinished = len(lines)
    if kernel_alive and unfinished < count:
        stopped = "did not end and could not be interrupted"
        results[unfinished] = CellResult(
            stopped, error=None, error_text="", printed="", ended=False
        )
    return results
