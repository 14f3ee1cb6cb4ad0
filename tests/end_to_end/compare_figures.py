"""Pytest plugin that makes nbval compare figures: `-p tests.end_to_end.compare_figures`.

nbval 0.11 skips pictures, so a wrong figure would pass. Comparing bytes would be too strict: they change with every
matplotlib release and by a grey level between CPUs. So the decoded pixels are compared, with a tolerance.
"""

from __future__ import annotations

import base64

import cv2
import numpy as np

# Simulated x86 generations differ by one level in few pixels; another curve or title changes far more than this.
MEAN_LEVELS = 0.5
STRONG_LEVELS = 16
STRONG_SHARE = 0.002


def pytest_collectstart(collector) -> None:
    """Wrap the comparison of every notebook cell once the notebook is collected."""
    from nbval.plugin import IPyNbCell

    if getattr(IPyNbCell, "compares_figures", False):
        return
    compare_text = IPyNbCell.compare_outputs

    def compare_outputs(self, test, ref, skip_compare=None):
        same = compare_text(self, test, ref, skip_compare)
        fault = figure_fault(pictures(ref), pictures(test))
        if fault:
            self.comparison_traceback.append(f"figure: {fault}")
        return same and not fault

    IPyNbCell.compare_outputs = compare_outputs
    IPyNbCell.compares_figures = True


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
            return f"mean difference {difference.mean():.2f} levels, {strong:.2%} of values differ strongly"
    return None
