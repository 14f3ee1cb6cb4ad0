"""Neighbours for a loop over frames: one reads ahead of it, one writes behind it, each in a thread of its own.

Decoding and encoding release Python's lock, so that the frame being processed, the next and the one before are worked
on at once. Order and results are those of the plain loop, and so are the errors: what goes wrong beside the loop is
raised in it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

# Items between two threads. One would do if each step always took the same time; more than a few only take memory.
ROOM = 3


def read_ahead(items: Generator[Item], *, room: int = ROOM) -> Generator[Item]:
    """The same items in the same order, at most `room` of them fetched before they are asked for.

    Close it when leaving early (`contextlib.closing`): it waits for the item being fetched, and closes `items`.
    """
    end = object()
    pool = ThreadPoolExecutor(1, "read_ahead")
    try:
        waiting = deque(pool.submit(next, items, end) for _ in range(room))
        while (item := waiting.popleft().result()) is not end:
            waiting.append(pool.submit(next, items, end))
            yield item
    finally:
        pool.shutdown(cancel_futures=True)
        items.close()


@contextmanager
def write_behind(write: Callable[[Item], object], *, room: int = ROOM) -> Iterator[Callable[[Item], None]]:
    """A function that hands an item to `write` and returns at once, unless `room` items wait already.

    At the end of the `with` block all have been written. What `write` raises comes out of a later call or of the end of
    the block; then, and when the block itself raises, the items that still wait are dropped. Either way nothing is
    being written any more when the block is left.
    """
    pool = ThreadPoolExecutor(1, "write_behind")
    waiting: deque[Future] = deque()

    def put(item: Item) -> None:
        if len(waiting) == room:
            waiting.popleft().result()
        waiting.append(pool.submit(write, item))

    try:
        yield put
        for written in waiting:
            written.result()
    finally:
        pool.shutdown(cancel_futures=True)
