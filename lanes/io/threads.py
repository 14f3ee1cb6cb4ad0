"""The number of OpenCV threads, set for the duration of a block."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2


@contextmanager
def opencv_threads(count: int) -> Iterator[None]:
    """Run OpenCV on `count` threads in the `with` block; -1 is its default number.

    Use one thread for reproducible results (with more threads the order of summation varies), for timing, and if other
    threads use the processor already: OpenCV's threads would then mostly wait, and waiting takes processor time. Use
    the default number if other processes wait for the result.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
