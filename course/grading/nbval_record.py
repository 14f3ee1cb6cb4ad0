"""Pytest plugin: what nbval finds in each cell, as a line of JSON, as soon as the cell
is done.

    python -m pytest --nbval -p course.grading.nbval_record notebook.ipynb

The environment variable NBVAL_RECORD names the file. nbval notices that a kernel died
only at the timeout of the cell; with this plugin it notices within a second.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from queue import Empty

import pytest
from nbval.kernel import RunningKernel
from nbval.plugin import IPyNbCell

RECORD = "NBVAL_RECORD"
KERNEL_DIED = "the kernel died"
_wait_for_reply = RunningKernel.await_reply


def await_reply(kernel: RunningKernel, msg_id: str, timeout: float) -> None:
    """Wait for the end of a cell. Raises Empty after `timeout` seconds, RuntimeError if
    the kernel is dead.
    """
    end_s = time.monotonic() + timeout
    while True:
        try:
            _wait_for_reply(kernel, msg_id, timeout=1)
            return
        except Empty:
            if not kernel.is_alive():
                raise RuntimeError(KERNEL_DIED) from None
            if time.monotonic() > end_s:
                raise


def pytest_configure(config: pytest.Config) -> None:
    """Let nbval wait as above."""
    RunningKernel.await_reply = await_reply


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo) -> None:
    """Write the line of a cell; returns None, so that pytest makes its own report."""
    failed_before = call.when == "setup" and call.excinfo is not None
    if isinstance(item, IPyNbCell) and (call.when == "call" or failed_before):
        with Path(os.environ[RECORD]).open("a", encoding="utf-8") as file:
            file.write(json.dumps(describe_cell(item, call)) + "\n")


def describe_cell(cell: IPyNbCell, call: pytest.CallInfo) -> dict[str, object]:
    """What nbval found in a cell; see `course.grading.run.CellResult`."""
    outputs = cell.test_outputs or []
    errors = [output for output in outputs if output.output_type == "error"]
    streams = [output.text for output in outputs if output.get("name") == "stdout"]
    kernel = cell.parent.kernel
    return {
        "failed": None if call.excinfo is None else str(call.excinfo.value),
        "error": errors[0].ename if errors else None,
        "error_text": errors[0].evalue if errors else "",
        "printed": "".join(streams),
        "kernel_alive": kernel is not None and kernel.is_alive(),
    }
