"""Comparison of figures in the outputs of two executions of the notebook.

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
