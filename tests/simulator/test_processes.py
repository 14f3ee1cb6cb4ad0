"""Jobs on several processes: order of results, errors, early ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import psutil
import pytest

from simulator.processes import map_ordered, run_all
from tests.support.command_line import WAIT_S
from tests.support.project import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("sigint")]

JOBS = range(9)


class Answer(NamedTuple):
    """Square of a number, and the process and its OpenCV threads that computed it."""

    square: int
    process: int
    threads: int


def slow_square(number: int) -> Answer:
    """Even numbers take longer, so that results come out of order."""
    time.sleep(0.1 if number % 2 == 0 else 0.0)
    return Answer(number**2, os.getpid(), cv2.getNumThreads())


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


def wait_for(
    condition: Callable[[], bool],
    *,
    seconds: float = WAIT_S,
) -> None:
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.fixture(scope="module", params=[1, 2])
def workers(request) -> int:
    return request.param


@pytest.fixture(scope="module")
def answers(workers) -> list[Answer]:
    return run_all(slow_square, JOBS, workers=workers)


def test_results_have_the_order_of_the_jobs(answers):
    assert [answer.square for answer in answers] == [number**2 for number in JOBS]


def test_each_job_has_one_opencv_thread(answers):
    assert {answer.threads for answer in answers} == {1}


def test_only_a_single_worker_is_this_process(answers, workers):
    processes = {answer.process for answer in answers}
    assert (os.getpid() in processes) == (workers == 1)


def meet_in(folder: Path, workers: int, number: int) -> int:
    """Wait until as many processes have a job; returns this one."""
    (folder / str(os.getpid())).touch()
    wait_for(lambda: len(list(folder.iterdir())) >= workers)
    return os.getpid()


def test_all_workers_get_jobs(workers, tmp_path):
    processes = run_all(partial(meet_in, tmp_path, workers), JOBS, workers=workers)
    assert len(set(processes)) == workers


def test_this_process_keeps_its_opencv_threads(workers):
    before = cv2.getNumThreads()
    run_all(slow_square, JOBS, workers=workers)
    assert cv2.getNumThreads() == before


def test_progress_counts_the_results(workers):
    reports = []
    run_all(
        slow_square,
        JOBS,
        workers=workers,
        progress=lambda *report: reports.append(report),
    )
    assert reports == [(done, 9) for done in range(1, 10)]


def test_an_error_in_a_job_is_raised_and_ends_the_workers(workers):
    with pytest.raises(ZeroDivisionError):
        list(map_ordered(reciprocal, [2, 0, 8], workers=workers))
    assert multiprocessing.active_children() == []


def test_a_dead_worker_says_what_to_do():
    with pytest.raises(OSError, match="worker process ended .* workers=1"):
        run_all(partial(os._exit), [3], workers=2)


def test_less_than_one_worker_is_refused():
    with pytest.raises(ValueError, match="not 0"):
        map_ordered(abs, [1], workers=0)


@pytest.fixture
def counted() -> tuple[Iterator[int], list[int]]:
    """Jobs, and a list of those that were taken."""
    taken: list[int] = []

    def jobs() -> Iterator[int]:
        for number in range(100):
            taken.append(number)
            yield number

    return jobs(), taken


def test_few_jobs_are_taken_ahead_of_the_results(counted):
    """Images that wait for the encoder would fill the memory."""
    jobs, taken = counted
    results = map_ordered(abs, jobs, workers=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert len(taken) <= 3 + 2 * 2
    results.close()


def test_closing_the_results_ends_the_workers(counted):
    jobs, _ = counted
    results = map_ordered(abs, jobs, workers=2)
    next(results)
    results.close()
    assert multiprocessing.active_children() == []


@pytest.fixture
def writing(tmp_path) -> Iterator[subprocess.Popen]:
    """A process in a group of its own, with two workers that both write a file."""
    code = (
        "from pathlib import Path\n"
        "from simulator.processes import run_all\n"
        "from tests.simulator.test_processes import write_slowly\n"
        f"paths = [Path({str(tmp_path)!r}, name) for name in 'ab']\n"
        "run_all(write_slowly, paths, workers=2)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        wait_for(lambda: len(list(tmp_path.iterdir())) == 2)
        yield process
        process.kill()


def test_an_interrupt_ends_all_processes_without_output_or_files_of_theirs(
    writing, tmp_path
):
    # As the terminal does it: to the whole group.
    os.killpg(writing.pid, signal.SIGINT)
    # Returns when the last process that can still write has ended.
    _, said = writing.communicate(timeout=WAIT_S)
    assert said.count("Traceback") == 1
    assert said.rstrip().endswith("KeyboardInterrupt")
    assert list(tmp_path.iterdir()) == []


def is_alive(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != "zombie"


def test_workers_exit_when_their_parent_is_killed(writing):
    workers = psutil.Process(writing.pid).children(recursive=True)
    assert len(workers) >= 2
    writing.kill()
    wait_for(lambda: not any(is_alive(worker) for worker in workers))
