"""The number of OpenCV threads, set for the duration of a block."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2


@contextmanager
def one_thread() -> Iterator[None]:
    """Run OpenCV on one thread in the `with` block.

    Use it for reproducible results (with more threads the order of summation varies), for timing, and if other threads
    use the processor already: OpenCV's threads would then mostly wait, and waiting takes processor time.
    """
    with _threads(1):
        yield


@contextmanager
def all_threads() -> Iterator[None]:
    """Run OpenCV on its default number of threads in the `with` block, if other processes wait for the result."""
    with _threads(-1):
        yield


@contextmanager
def _threads(count: int) -> Iterator[None]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
