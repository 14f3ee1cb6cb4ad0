"""Read-ahead and write-behind for a loop over frames, each in its own thread.

Decoding and encoding release Python's global lock, so that three frames are decoded, processed and encoded at the same
time. Order and results are those of the plain loop. Exceptions of both threads are raised in the loop.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

# Items between two threads. One would be enough if every step took constant time; many would only take memory.
QUEUE_SIZE = 3


def read_ahead(items: Generator, *, queue_size: int = QUEUE_SIZE) -> Generator:
    """The same items in the same order; up to `queue_size` are fetched in advance by another thread.

    Close it when leaving early (`contextlib.closing`): closing waits for the item being fetched and closes `items`.
    """
    end = object()
    pool = ThreadPoolExecutor(1, "read_ahead")
    try:
        waiting = deque(pool.submit(next, items, end) for _ in range(queue_size))
        while (item := waiting.popleft().result()) is not end:
            waiting.append(pool.submit(next, items, end))
            yield item
    finally:
        pool.shutdown(cancel_futures=True)
        items.close()


@contextmanager
def write_behind(write: Callable, *, queue_size: int = QUEUE_SIZE) -> Iterator[Callable]:
    """A function that queues an item for `write` in another thread; it blocks while `queue_size` items are waiting.

    All items have been written at the end of the `with` block. An exception of `write` is raised by a later call or at
    the end of the block. After an exception, also of the block itself, the waiting items are dropped. In all cases the
    thread has ended when the block is left.
    """
    pool = ThreadPoolExecutor(1, "write_behind")
    waiting: deque[Future] = deque()

    def put(item: object) -> None:
        if len(waiting) == queue_size:
            waiting.popleft().result()
        waiting.append(pool.submit(write, item))

    try:
        yield put
        for written in waiting:
            written.result()
    finally:
        pool.shutdown(cancel_futures=True)
