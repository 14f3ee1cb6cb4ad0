"""The number of OpenCV threads, set for the duration of a block."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import cv2


def one_thread() -> AbstractContextManager[None]:
    """Run OpenCV on one thread in the `with` block.

    Use it for reproducible results (with more threads the order of summation varies), for timing, and if other threads
    use the processor already: OpenCV's threads would then mostly wait, and waiting takes processor time.
    """
    return _threads(1)


def all_threads() -> AbstractContextManager[None]:
    """Run OpenCV on its default number of threads in the `with` block, if other processes wait for the result."""
    return _threads(-1)


@contextmanager
def _threads(count: int) -> Iterator[None]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
