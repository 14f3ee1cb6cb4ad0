"""Read-ahead and write-behind: order, results and errors of the plain loop, and no thread remains."""

from __future__ import annotations

import threading
import time
from contextlib import closing

import pytest

from lanes.video.process import _read_ahead, _write_behind


def counting(log: list[int], most: int = 10, error: Exception | None = None):
    for number in range(most):
        log.append(number)
        yield number
    if error:
        raise error


def test_all_items_in_order():
    assert list(read_ahead(counting([], 100))) == list(range(100))
    assert list(read_ahead(counting([], 0))) == []


def test_reads_ahead_up_to_the_queue_size():
    log: list[int] = []
    with closing(read_ahead(counting(log), queue_size=3)) as items:
        assert next(items) == 0
        wait_until(lambda: len(log) == 4)
        time.sleep(0.05)
        assert log == [0, 1, 2, 3]


def test_reading_runs_in_another_thread():
    """The reader and the loop wait for each other, which needs two threads."""
    asked, read = threading.Event(), threading.Event()

    def items():
        yield 0
        assert asked.wait(5)
        read.set()
        yield 1

    with closing(read_ahead(items())) as found:
        next(found)
        asked.set()
        assert read.wait(5)


def test_error_of_the_reader_comes_after_the_items_before_it():
    seen = []
    with pytest.raises(ValueError, match="damaged"):
        for item in read_ahead(counting([], 5, ValueError("damaged"))):
            seen.append(item)
    assert seen == [0, 1, 2, 3, 4]


def test_leaving_early_closes_the_source():
    closed = []

    def items():
        try:
            yield from range(10)
        finally:
            closed.append(True)

    with closing(read_ahead(items())) as found:
        next(found)
    assert closed == [True]
    assert not threads("read_ahead")


def test_all_items_are_written_in_order():
    written = []
    with write_behind(lambda item: (time.sleep(0.002), written.append(item))) as write:
        for number in range(20):
            write(number)
    assert written == list(range(20))
    assert not threads("write_behind")


def test_a_slow_writer_blocks_the_loop():
    gate, written = threading.Event(), []
    with write_behind(lambda item: (gate.wait(5), written.append(item)), queue_size=2) as write:
        write(0)
        write(1)
        threading.Timer(0.05, gate.set).start()
        assert written == []
        write(2)
        assert written[:1] == [0]
    assert written == [0, 1, 2]


@pytest.mark.parametrize("failing", [3, 9])
def test_error_of_the_writer_ends_the_loop(failing):
    def refuse(item):
        if item == failing:
            raise OSError("disk full")

    given = []
    with pytest.raises(OSError, match="disk full"), write_behind(refuse, queue_size=2) as write:
        for number in range(10):
            given.append(number)
            write(number)
    assert len(given) <= failing + 3
    assert not threads("write_behind")


def test_error_of_the_loop_drops_waiting_items():
    written, started = [], threading.Event()

    def slow(item):
        started.set()
        time.sleep(0.05)
        written.append(item)

    with pytest.raises(KeyboardInterrupt), write_behind(slow, queue_size=5) as write:
        for number in range(5):
            write(number)
        started.wait(5)
        raise KeyboardInterrupt
    assert written == [0]
    assert not threads("write_behind")


def threads(name: str) -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith(name)]


def wait_until(condition) -> None:
    for _ in range(500):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("waited for 5 s")
