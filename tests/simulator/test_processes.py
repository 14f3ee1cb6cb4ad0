"""Jobs on several processes: order of results, errors, early ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import cv2
import psutil
import pytest

from simulator.processes import map_ordered, run_all
from tests.support.command_line import WAIT_S
from tests.support.project import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("sigint")]


def slow_square(number: int) -> tuple[int, int, int]:
    """Square, process and OpenCV threads; even numbers take longer, so that results come out of order."""
    time.sleep(0.1 if number % 2 == 0 else 0.0)
    return number**2, os.getpid(), cv2.getNumThreads()


def reciprocal(number: int) -> float:
    return 1 / number


def write_slowly(path: Path) -> None:
    """Write a file, wait for the interrupt, remove the file."""
    try:
        path.write_text("unfinished")
        # longer than any test waits
        time.sleep(10 * WAIT_S)
    finally:
        path.unlink()


def wait_for(condition, *, seconds: float = WAIT_S) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.mark.parametrize("workers", [1, 2])
def test_results_in_the_order_of_the_jobs_each_on_one_opencv_thread_with_progress(workers):
    before, reports = cv2.getNumThreads(), []
    results = run_all(slow_square, range(9), workers=workers, progress=lambda *done: reports.append(done))
    squares, processes, threads = zip(*results, strict=True)
    assert squares == tuple(n**2 for n in range(9)) and set(threads) == {1} and cv2.getNumThreads() == before
    assert (os.getpid() in processes, len(set(processes))) == (workers == 1, workers)
    assert reports == [(done, 9) for done in range(1, 10)]


def test_an_error_in_a_job_is_raised_and_a_dead_worker_says_what_to_do():
    for workers in (1, 2):
        with pytest.raises(ZeroDivisionError):
            list(map_ordered(reciprocal, [2, 0, 8], workers=workers))
        assert multiprocessing.active_children() == []
    with pytest.raises(OSError, match="worker process ended .* workers=1"):
        run_all(partial(os._exit), [3], workers=2)
    with pytest.raises(ValueError, match="not 0"):
        map_ordered(abs, [1], workers=0)


def test_few_jobs_are_taken_ahead_of_the_results():
    """Images that wait for the encoder would fill the memory."""
    taken = []
    results = map_ordered(abs, (taken.append(n) or n for n in range(100)), workers=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert len(taken) <= 3 + 2 * 2
    results.close()
    assert multiprocessing.active_children() == []


@pytest.fixture
def writing(tmp_path):
    """A process in a group of its own, with two workers that are both writing a file."""
    code = (
        "from pathlib import Path\n"
        "from simulator.processes import run_all\n"
        "from tests.simulator.test_processes import write_slowly\n"
        f"run_all(write_slowly, [Path({str(tmp_path)!r}, name) for name in 'ab'], workers=2)\n"
    )
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, **options) as process:
        wait_for(lambda: len(list(tmp_path.iterdir())) == 2)
        yield process
        process.kill()


def test_an_interrupt_ends_all_processes_without_output_or_files_of_theirs(writing, tmp_path):
    # As the terminal does it: to the whole group.
    os.killpg(writing.pid, signal.SIGINT)
    # Returns when the last process that can still write has ended.
    _, said = writing.communicate(timeout=WAIT_S)
    assert said.count("Traceback") == 1 and said.rstrip().endswith("KeyboardInterrupt")
    assert list(tmp_path.iterdir()) == []


def test_workers_exit_when_their_parent_is_killed(writing):
    workers = psutil.Process(writing.pid).children(recursive=True)
    assert len(workers) >= 2
    writing.kill()
    wait_for(lambda: not any(worker.is_running() and worker.status() != "zombie" for worker in workers))
