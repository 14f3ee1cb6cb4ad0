"""Work spread over processes, its results in order."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

import cv2

Job, Result = TypeVar("Job"), TypeVar("Result")

# A renderer holds half a gigabyte of panorama, plants and textures, and one encoder keeps up with no more than these.
MOST_WORKERS = 8


def available_workers() -> int:
    """How many processes are worth starting: the CPUs that this process may use, MOST_WORKERS at most."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)
    return min(len(allowed), MOST_WORKERS)


def ordered(function: Callable[[Job], Result], jobs: Iterable[Job], *, workers: int | None = None) -> Generator[Result]:
    """The results of `function` for each job, in the order of the jobs, whatever the number of processes.

    Parameters
    ----------
    function : callable
        Of a module, or a functools.partial of one: it is sent to other processes by name.
    jobs : iterable
        Picklable arguments.
    workers : int, optional
        Processes; 1 works in this one. Default: `available_workers()`.

    Returns
    -------
    generator of Result
        Close it to end the processes before all is done.

    Raises
    ------
    ValueError
        If `workers` is less than 1.
    OSError
        If a process ended before its work was done. What `function` raises comes through as it is.
    """
    workers = available_workers() if workers is None else workers
    if workers < 1:
        raise ValueError(f"workers is a number of processes, 1 or more, not {workers}.")
    return (function(job) for job in jobs) if workers == 1 else _spread(function, iter(jobs), workers)


def _spread(function: Callable, jobs: Iterator, workers: int) -> Generator:
    """Two jobs a worker are under way: the next one is there at once, and pictures do not pile up."""
    # Spawned, not forked: a forked child inherits OpenCV's thread pool without its threads, and hangs.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_start, initargs=(function,))
    try:
        with _interrupts_held():
            waiting = deque(pool.submit(_work, job) for job in islice(jobs, 2 * workers))
        while waiting:
            result = waiting.popleft().result()
            waiting.extend(pool.submit(_work, job) for job in islice(jobs, 1))
            yield result
    except BrokenProcessPool as error:
        raise OSError(
            "a worker process ended before its work was done: memory may be short, or a script calls this outside "
            'of `if __name__ == "__main__":`; correct that, or give workers=1.'
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _interrupts_held() -> Generator[None]:
    """Ctrl-C waits until this is over; processes started meanwhile hold it, too, until they can end quietly."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start(function: Callable) -> None:
    """In each worker: one thread, because the processes share the CPUs; Ctrl-C ends it at once and without a word."""
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    _work.function = function


def _work(job: Job) -> Result:
    """In each worker: the function, which came once, so that what it keeps of a camera and a road stays known."""
    return _work.function(job)
