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
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
