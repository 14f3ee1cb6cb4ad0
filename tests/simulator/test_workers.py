"""Work spread over processes: the order of results, errors, early ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from functools import partial

import pytest

from benchmark.dataset import PROJECT_ROOT
from simulator.workers import available_workers, ordered


def slow_square(number: int) -> tuple[int, int]:
    """Even numbers take longer, so that results come out of order."""
    time.sleep(0.1 if number % 2 == 0 else 0.0)
    return number**2, os.getpid()


def reciprocal(number: int) -> float:
    return 1 / number


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_jobs(workers):
    squares, processes = zip(*ordered(slow_square, range(9), workers=workers), strict=True)
    assert squares == tuple(n**2 for n in range(9))
    assert (os.getpid() in processes, len(set(processes))) == ((True, 1) if workers == 1 else (False, 2))


def test_an_error_in_a_worker_comes_through_and_ends_the_others():
    results = ordered(reciprocal, [2, 4, 0, 8], workers=2)
    assert [next(results), next(results)] == [0.5, 0.25]
    with pytest.raises(ZeroDivisionError):
        next(results)
    assert multiprocessing.active_children() == []


def test_few_jobs_are_taken_ahead_of_what_is_wanted():
    """Pictures that wait for the encoder would fill the memory."""
    taken = []
    results = ordered(abs, (taken.append(n) or n for n in range(100)), workers=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert len(taken) <= 3 + 2 * 2
    results.close()
    assert multiprocessing.active_children() == []


def test_a_worker_that_dies_is_an_error_that_says_what_to_do():
    with pytest.raises(OSError, match="worker process ended .* workers=1"):
        list(ordered(partial(os._exit), [3], workers=2))


def test_refuses_no_workers():
    assert available_workers() >= 1
    with pytest.raises(ValueError, match="not 0"):
        ordered(abs, [1], workers=0)


def test_interrupt_ends_all_processes_without_a_word_from_them():
    code = (
        "import os, signal\n"
        "from simulator.workers import ordered\n"
        "from tests.simulator.test_workers import slow_square\n"
        "results = ordered(slow_square, range(1000), workers=2)\n"
        "next(results); print('ready', flush=True); list(results)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=PROJECT_ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout.readline() == "ready\n"
    # As the terminal does it: to the whole group.
    os.killpg(process.pid, signal.SIGINT)
    # Returns when the last process that can still write has ended.
    _, said = process.communicate(timeout=20)
    assert said.count("Traceback") == 1 and said.rstrip().endswith("KeyboardInterrupt")
