"""Run every system over every drive, several at a time; what is finished is kept, so that a broken-off run goes on.

drives -> stage (render, take or estimate the pose) -> measure (follow all frames, keep) -> Result (against truth)
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from threading import Thread

import cv2

from benchmark import readings, systems
from benchmark.errors import frame_errors
from benchmark.follow import Staged, follow_drive, stage, true_lane
from benchmark.machine import describe_machine
from benchmark.readings import read_readings, write_readings
from benchmark.scored_drive import BenchmarkDrive
from benchmark.scores import Result
from benchmark.suite_drives import with_video
from benchmark.systems import SOURCES, require_system
from lanes.camera.camera_file import camera_to_dict
from lanes.io.disk_cache import cache_folder
from lanes.io.video.reader import inspect_video

Progress = Callable[[int, int], None]


def run_benchmark(
    drives: Sequence[BenchmarkDrive],
    systems: Sequence[str],
    *,
    workers: int = 1,
    estimated_pose: bool = False,
    folder: Path | None = None,
    progress: Callable[[str], Progress] | None = None,
) -> list[Result]:
    """Score systems on drives.

    Parameters
    ----------
    drives : sequence of BenchmarkDrive
    systems : sequence of str
        In `systems.SYSTEMS`.
    workers : int
        Processes at the same time, each with one OpenCV thread.
    estimated_pose : bool
        The systems get the pose that `estimate_pose` finds in the video, instead of the true one. The lens is the
        true one always.
    folder : Path, optional
        Where finished results are kept: a folder in the cache by default. One is used again as long as video, camera,
        machine and the system's own sources are what they were.
    progress : callable, optional
        Called as progress(what), gives the callback (done, in all) for that part of the work.

    Returns
    -------
    list of Result
        In the order of `drives`, then of `systems`.

    Raises
    ------
    ValueError
        If a system is unknown, or a video and its truth do not belong together.
    OSError
        If a file cannot be read or written.
    """
    for system in systems:
        require_system(system)
    folder = folder or cache_folder() / "benchmark"
    report = progress or (lambda what: lambda done, total: None)
    # Fresh processes: forked ones may inherit the locks of OpenCV's and FFmpeg's threads.
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_begin_work) as pool:
        try:
            staged = _all_done(pool, prepare, [(drive, estimated_pose) for drive in drives], report("scenes"))
            tasks = [(drive, system, folder, workers) for drive in staged for system in systems]
            kept = _all_done(pool, measure, tasks, report("benchmark"))
        except BrokenProcessPool as error:
            raise OSError("a worker was killed, perhaps for want of memory; try again with fewer --workers.") from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [_result(task[0], task[1], path) for task, path in zip(tasks, kept, strict=True)]


def prepare(drive: BenchmarkDrive, estimated_pose: bool) -> Staged:
    """Render the drive where needed, and take or estimate the camera pose."""
    # Scenes are spread over the processes already; each is rendered by one.
    return stage(with_video(drive, workers=1), estimated_pose=estimated_pose)


def measure(staged: Staged, system: str, folder: Path, workers: int) -> Path:
    """Follow a drive with a system unless that was done before; the file in which its readings are."""
    path = folder / f"{staged.drive.name}-{system}-{_key(staged, system)}.json"
    if not path.is_file():
        fps = inspect_video(staged.drive.video).fps
        about = {"workers": workers, "fps": fps, "machine": describe_machine()}
        write_readings(path, follow_drive(staged, system), **about)
    return path


def _result(staged: Staged, system: str, path: Path) -> Result:
    readings, about = read_readings(path)
    drive = staged.drive
    try:
        errors = frame_errors(readings, true_lane(drive), staged.camera)
    except ValueError as error:
        raise ValueError(f"{drive.video}: {error}") from error
    workers, fps, machine = (about[name] for name in ("workers", "fps", "machine"))
    return Result(drive.name, drive.difficulty, system, errors, staged.pose, workers, fps, machine)


def _all_done(pool: ProcessPoolExecutor, work: Callable, tasks: Iterable[tuple], report: Progress) -> list:
    """The results of work(*task), in the order of the tasks."""
    futures = [pool.submit(_do, work, task) for task in tasks]
    for done, future in enumerate(as_completed(futures), 1):
        future.result()
        report(done, len(futures))
    return [future.result() for future in futures]


def _begin_work() -> None:
    """In each process: one thread for OpenCV, deaf to interruptions while idle, and no life after its parent's."""
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # An idle one waits for work for ever if the process that gives it was killed.
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    multiprocessing.parent_process().join()
    os._exit(1)


def _do(work: Callable, task: tuple) -> object:
    """In each process: work(*task); an interruption ends it and lets it remove what is half-written."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return work(*task)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _key(staged: Staged, system: str) -> str:
    """Twelve digits that change with all that the readings depend on."""
    digest = hashlib.sha256(staged.drive.video.read_bytes())
    digest.update(f"{describe_machine()} {staged.camera and camera_to_dict(staged.camera)}".encode())
    own = [Path(module.__file__) for module in (readings, systems)]
    for source in (*own, *SOURCES[system]):
        for file in sorted(source.rglob("*.py")) if source.is_dir() else [source]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
