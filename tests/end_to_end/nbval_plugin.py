"""Pytest plugin for nbval: `-p tests.end_to_end.nbval_plugin`.

It makes nbval stricter and hides nothing: nbval 0.11 compares the text of the outputs
and skips figures. This plugin compares
their pixels with a tolerance, because bytes change with every matplotlib release and by
a grey level between CPUs. It also adds the checks of `tests.end_to_end.notebook_reader`
to the project's notebook.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

# Simulated x86 generations differ by one level in few pixels; another curve or title
# changes far more than this.
MEAN_LEVELS = 0.5
STRONG_LEVELS = 16
STRONG_SHARE = 0.002


def pictures(outputs: list) -> list[np.ndarray]:
    """Decode the pictures among a cell's outputs."""
    found = []
    for output in outputs:
        for kind in ("image/jpeg", "image/png"):
            if kind in output.get("data", {}):
                data = np.frombuffer(base64.b64decode(output["data"][kind]), np.uint8)
                found.append(cv2.imdecode(data, cv2.IMREAD_COLOR).astype(np.int16))
    return found


def figure_fault(expected: list[np.ndarray], got: list[np.ndarray]) -> str | None:
    """Describe the difference between two lists of pictures; None if there is none."""
    if len(expected) != len(got):
        return f"{len(got)} instead of {len(expected)}"
    for old, new in zip(expected, got, strict=True):
        if old.shape != new.shape:
            return f"size {new.shape} instead of {old.shape}"
        difference = np.abs(old - new)
        strong = np.mean(difference > STRONG_LEVELS)
        if difference.mean() > MEAN_LEVELS or strong > STRONG_SHARE:
            mean = f"mean difference {difference.mean():.2f} levels"
            return f"{mean}, {strong:.2%} of values differ strongly"
    return None


def pytest_collectstart(collector: pytest.Collector) -> None:
    """Extend nbval's classes before the notebook is collected."""
    from nbval.plugin import IPyNbCell, IPyNbFile

    from tests.end_to_end.notebook_reader import NOTEBOOK, reader_items

    if getattr(IPyNbCell, "compares_figures", False):
        return
    collect_cells = IPyNbFile.collect
    kill_kernel = IPyNbFile.teardown
    compare_text = IPyNbCell.compare_outputs

    def collect(self) -> Iterator[pytest.Item]:
        cells = list(collect_cells(self))
        yield from cells
        if self.path == NOTEBOOK:
            yield from reader_items(self, cells)

    def teardown(self) -> None:
        # nbval kills the kernel. A kernel that is shut down before saves which lines it
        # ran (make coverage).
        if self.kernel is not None and self.kernel.is_alive():
            self.kernel.km.shutdown_kernel()
        kill_kernel(self)

    def compare_outputs(self, test, ref, skip_compare=None) -> bool:
        same = compare_text(self, test, ref, skip_compare)
        fault = figure_fault(pictures(ref), pictures(test))
        if fault:
            self.comparison_traceback.append(f"figure: {fault}")
        return same and not fault

    IPyNbFile.collect = collect
    IPyNbFile.teardown = teardown
    IPyNbCell.compare_outputs = compare_outputs
    IPyNbCell.compares_figures = True
