"""Pytest plugin for nbval: `-p tests.end_to_end.nbval_plugin`.

nbval 0.11 compares the text of the outputs. This plugin also compares the figures, and adds the checks of
`tests.end_to_end.notebook_reader` to the project's notebook.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from tests.end_to_end.compare_figures import figure_fault, pictures


def pytest_collectstart(collector: pytest.Collector) -> None:
    """Extend nbval's classes before the notebook is collected."""
    from nbval.plugin import IPyNbCell, IPyNbFile

    from tests.end_to_end.notebook_reader import NOTEBOOK, reader_items

    if getattr(IPyNbCell, "compares_figures", False):
        return
    collect_cells, kill_kernel = IPyNbFile.collect, IPyNbFile.teardown
    run_cell, compare_text = IPyNbCell.runtest, IPyNbCell.compare_outputs

    def collect(self) -> Iterator[pytest.Item]:
        cells = list(collect_cells(self))
        yield from cells
        if self.path == NOTEBOOK:
            yield from reader_items(self, cells)

    def teardown(self) -> None:
        # nbval kills the kernel. A kernel that is shut down before saves which lines it ran (make coverage).
        if self.kernel is not None and self.kernel.is_alive():
            self.kernel.km.shutdown_kernel()
        kill_kernel(self)

    def runtest(self) -> None:
        started_s = time.perf_counter()
        try:
            run_cell(self)
        finally:
            self.duration_s = time.perf_counter() - started_s

    def compare_outputs(self, test, ref, skip_compare=None) -> bool:
        same = compare_text(self, test, ref, skip_compare)
        fault = figure_fault(pictures(ref), pictures(test))
        if fault:
            self.comparison_traceback.append(f"figure: {fault}")
        return same and not fault

    IPyNbFile.collect, IPyNbFile.teardown = collect, teardown
    IPyNbCell.runtest, IPyNbCell.compare_outputs = runtest, compare_outputs
    IPyNbCell.compares_figures = True
