"""How many threads OpenCV works with, for a while."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV on one thread in the `with` block.

    For results that do not vary (more threads add sums in another order each time), for measuring, and where other
    threads keep the processor busy already: OpenCV's own would mostly wait, and waiting takes processor time.
    """
    with _threads(1):
        yield


@contextmanager
def all_threads() -> Iterator[None]:
    """OpenCV on as many threads as it has by default in the `with` block: where other processes wait for the result."""
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
