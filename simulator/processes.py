"""Jobs on several processes.

Each is spawned, has one OpenCV thread, and exits with its parent.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from threading import Thread
from typing import Any, TypeVar

import cv2

from lanes.console import sigint_blocked
from lanes.video.images import opencv_threads

Job = TypeVar("Job")
Result = TypeVar("Result")

# One video encoder keeps up with no more than 8 processes that render.
MAX_DEFAULT_WORKERS = 8


def available_cpus() -> int:
    """Number of CPUs that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def available_workers() -> int:
    """Number of CPUs that this process may use, at most MAX_DEFAULT_WORKERS."""
    return min(available_cpus(), MAX_DEFAULT_WORKERS)


def map_ordered(
    function: Callable[[Job], Result],
    jobs: Iterable[Job],
    *,
    workers: int | None = None,
    ahead: int | None = None,
) -> Generator[Result]:
    """Yield the results of `function` in the order of the jobs.

    Close the generator to end the workers early.

    The function is one of a module, or a functools.partial of one, and is sent to each
    worker once; the jobs can be pickled. `workers` processes run (default:
    `available_workers()`); 1 runs the jobs in this process. `ahead` jobs are submitted
    ahead of the results taken (default: two a worker, so that images do not pile up in
    memory). Raises ValueError if `workers` is less than 1, and OSError if a worker
    died. Exceptions of the function are raised unchanged.
    """
    if workers is None:
        workers = available_workers()
    if workers < 1:
        raise ValueError(f"workers is a number of processes, 1 or more, not {workers}.")
    if workers == 1:
        return (function(job) for job in jobs)
    return _map_on_workers(function, iter(jobs), workers, ahead or 2 * workers)


def run_all(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Return the results of `map_ordered`, each computed on one OpenCV thread.

    `progress` is called with (done, all). All jobs are submitted at once.
    """
    results = []
    with opencv_threads(1):
        for result in map_ordered(function, jobs, workers=workers, ahead=len(jobs)):
            results.append(result)
            if progress:
                progress(len(results), len(jobs))
    return results


def _map_on_workers(
    function: Callable, jobs: Iterator, workers: int, ahead: int
) -> Generator:
    # Not forked: a forked child inherits the locks of OpenCV's and FFmpeg's thread
    # pools without their threads.
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        workers,
        mp_context=spawn,
        initializer=_start_worker,
        initargs=(function,),
    )
    try:
        with sigint_blocked():
            submitted = deque(pool.submit(_run_job, job) for job in islice(jobs, ahead))
        while submitted:
            result = submitted.popleft().result()
            for job in islice(jobs, 1):
                submitted.append(pool.submit(_run_job, job))
            yield result
    except BrokenProcessPool as error:
        raise OSError(
            "a worker process ended before its work was done: memory may be short, or "
            'a script calls this outside of `if __name__ == "__main__":`; correct '
            "that, or use workers=1."
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


class _Worker:
    """Function that is kept between jobs.

    Caches keyed by its arguments (a camera, a road) stay valid.
    """

    function: Callable


def _start_worker(function: Callable) -> None:
    """In each worker: one OpenCV thread, because the processes share the CPUs.

    Ctrl-C is ignored between jobs.
    """
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    Thread(target=_exit_with_parent, daemon=True).start()
    _Worker.function = function


def _exit_with_parent() -> None:
    """An idle worker would wait for jobs forever if its parent was killed."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def _run_job(job: Any) -> Any:
    """In each worker: Ctrl-C raises KeyboardInterrupt during a job.

    So it can remove unfinished files.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return _Worker.function(job)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
