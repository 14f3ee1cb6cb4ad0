"""Many drives in parallel: on processes of this machine, or on the workers of Dask.

One drive is one task of a `concurrent.futures` executor. Drives whose worker died, and
those that failed with an error that may pass, are repeated. A finished drive has a
manifest, a JSON file next to its outputs that is written last. It holds the fingerprint
of the drive (input, settings and versions) and the sizes of the outputs. While neither
changes, the drive is skipped.
"""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import platform
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import av

import lanes
from lanes.annotation import DriveSettings
from lanes.camera.model import camera_to_dict
from lanes.console import plain_warnings, sigint_blocked
from lanes.detect.markings import Markings, runtime_versions
from lanes.drive import (
    annotate_drive,
    output_path,
    planned_outputs,
    versions,
)
from lanes.errors import VideoError
from lanes.files import (
    hash_sources,
    read_text,
    remove_partial,
    require_file,
    write_atomically,
    write_telemetry,
)
from lanes.ros.log_files import file_of_log
from lanes.show.lane_messages import MESSAGES_SUFFIX
from lanes.show.report import frame_lengths_s, seconds_lost, share_tracked
from lanes.video.images import opencv_threads
from lanes.video.sources import Sources, require_distinct_outputs

# How many times a task is repeated after its worker died, or a disk or the network
# failed.
RETRIES = 2
# Table of all drives, in the output folder, and its columns with numbers.
_SUMMARY = Path("summary", "drives.csv")
_MEASURES = ("tracked_share", "lost_s", "frames", "missing", "length_s")


@dataclass(frozen=True, eq=False)
class DriveJob:
    """A drive to annotate, as sent to a worker.

    All paths are absolute: workers may have other working directories.
    """

    video: Path
    settings: DriveSettings
    fingerprint: Mapping[str, Any]

    @property
    def manifest(self) -> Path:
        """Path of the manifest, next to the annotated video."""
        return manifest_path(self.video, self.settings.output)

    @property
    def outputs(self) -> list[Path]:
        """The files to write, except the manifest."""
        suffixes = [".mp4", ".csv", MESSAGES_SUFFIX]
        if self.settings.report:
            suffixes.append(".html")
        return [self.manifest.with_suffix(suffix) for suffix in suffixes]

    def output_sizes(self) -> dict[str, int]:
        """Sizes in bytes, by name, of the outputs that exist."""
        existing = [path for path in self.outputs if path.is_file()]
        return {path.name: path.stat().st_size for path in existing}


@dataclass(frozen=True)
class FinishedDrive:
    """Content of a manifest.

    Fingerprint, sizes of the outputs in bytes by name, and results.
    """

    fingerprint: Mapping[str, Any]
    outputs: Mapping[str, int]
    description: str
    tracked_share: float
    lost_s: float
    frames: int
    missing: int
    length_s: float


def annotate_many(
    videos: Sequence[Path],
    settings: DriveSettings,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    log: Callable[[str], None] = print,
) -> tuple[list[FinishedDrive], list[Exception]]:
    """Annotate the videos that are not finished yet, and write a table of all.

    Parameters
    ----------
    videos : sequence of Path
    settings : DriveSettings
    workers : int, optional
        Number of processes on this machine; by default one per core.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers are used instead.
    log : callable
        Called with a message for each event.

    Returns
    -------
    list of FinishedDrive
        Also those of earlier runs.
    list of Exception
        An error for each other drive.

    Raises
    ------
    OSError
        If Dask cannot be used or the table cannot be written.
    ValueError
        If an output would overwrite a video or another output.
    """
    planned = planned_outputs(Sources(tuple(videos), ()), settings)
    require_distinct_outputs(planned)
    settings = replace(settings, output=settings.output.absolute(), progress=False)

    finished: list[FinishedDrive] = []
    unfinished: list[DriveJob] = []
    failed: dict[Path, Exception] = {}
    for video in map(Path.absolute, videos):
        try:
            job = DriveJob(video, settings, fingerprint(video, settings))
        except (FileNotFoundError, VideoError) as error:
            failed[video] = error
            continue
        drive = read_finished(job)
        if drive:
            finished.append(drive)
        else:
            unfinished.append(job)

    counts = f"{len(finished)} of {len(videos)} drives were finished before"
    if unfinished:
        with open_executor(unfinished, workers, scheduler) as (executor, where):
            log(f"{where}; {counts}")
            for job, future in _submit(executor, unfinished):
                outcome = outcome_of(job, future)
                if isinstance(outcome, FinishedDrive):
                    finished.append(outcome)
                    log(outcome.description)
                else:
                    failed[job.video] = outcome

    rows = _summary_rows(finished, failed)
    table = write_telemetry(settings.output / _SUMMARY, rows)
    done = f"{len(finished)} drives finished, {len(failed)} failed"
    log(f"{done}; {counts}; wrote {table}")
    return finished, list(failed.values())


def _submit(
    executor: Executor, jobs: Sequence[DriveJob]
) -> Iterator[tuple[DriveJob, Future]]:
    """Jobs and their futures as they are done, begun with the largest videos."""
    large_first = sorted(jobs, key=_size_bytes, reverse=True)
    with sigint_blocked():  # the workers end with this process
        pending = {executor.submit(run_job, job): job for job in large_first}
    for future in as_completed(pending):
        yield pending[future], future


def _size_bytes(job: DriveJob) -> int:
    return job.fingerprint["size_bytes"]


def _summary_rows(
    finished: Sequence[FinishedDrive], failed: Mapping[Path, Exception]
) -> Iterator[dict[str, object]]:
    """Rows of failed drives, then of the others, those with the worst tracks first."""
    for video, error in sorted(failed.items()):
        yield {
            "drive": video.stem,
            "state": "failed",
            "reason": str(error),
            "source": str(video),
        }

    for drive in sorted(finished, key=_worst_first):
        source = drive.fingerprint["source"]
        measures = {name: getattr(drive, name) for name in _MEASURES}
        yield {
            "drive": Path(source).stem,
            "state": "finished",
            **measures,
            "source": source,
        }


def _worst_first(drive: FinishedDrive) -> tuple[float, float, str]:
    return drive.tracked_share, -drive.lost_s, drive.fingerprint["source"]


# Finished drives.


def parallel_outputs(videos: Sequence[Path], folder: Path) -> list[Path]:
    """What `annotate_many` writes into a folder beside the outputs of each drive: the
    manifests, and the table.
    """
    manifests = [manifest_path(video, folder) for video in videos]
    return [*manifests, folder / _SUMMARY]


def manifest_path(video: Path, folder: Path) -> Path:
    """Path of the manifest of a drive that is annotated into `folder`."""
    return output_path(video, folder).with_suffix(".json")


def fingerprint(video: Path, settings: DriveSettings) -> dict[str, Any]:
    """Everything that the outputs of a drive depend on.

    Input (path, size, time of change), settings and versions.
    """
    file = require_file(file_of_log(video), "video", error=VideoError)
    status = file.stat()
    used = dict(vars(settings))
    del used["output"], used["progress"]
    used["camera"] = settings.camera and camera_to_dict(settings.camera)
    used["field"] = settings.field and asdict(settings.field)
    used["markings"] = repr(settings.markings)
    found = {
        "source": str(video),
        "size_bytes": status.st_size,
        "mtime_ns": status.st_mtime_ns,
        "settings": used,
        "versions": all_versions(settings.markings),
    }
    # to and from JSON, as a manifest, because JSON turns tuples into lists
    return json.loads(json.dumps(found))


def all_versions(markings: Markings | None) -> dict[str, str]:
    """Versions that the results depend on, and a digest of the code of `lanes`."""
    found = {**versions(), "lanes": _code_digest()}
    return found if markings is None else found | runtime_versions(markings)


@cache
def _code_digest() -> str:
    return hash_sources(Path(lanes.__file__).parent)


def read_finished(job: DriveJob) -> FinishedDrive | None:
    """The manifest of a drive if it is finished, else None.

    An unreadable or foreign file counts as no manifest.
    """
    try:
        text = read_text(job.manifest, "manifest", max_bytes=1_000_000)
        drive = FinishedDrive(**json.loads(text))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    for name in _MEASURES:
        if not isinstance(getattr(drive, name), int | float):
            return None
    is_same = drive.fingerprint == job.fingerprint
    return drive if is_same and drive.outputs == job.output_sizes() else None


# The task, which runs on a worker.


def run_job(job: DriveJob) -> FinishedDrive | Exception:
    """Annotate a drive and write its manifest.

    Returns the manifest, or an error that would occur again. Raises any other error,
    such as that of a full disk, so that the task is repeated.
    """
    # an earlier worker may have finished the drive and died before it returned
    finished = read_finished(job)
    if finished:
        return finished
    try:
        _require_same_versions(job)
        with plain_warnings(), opencv_threads(1):
            return _annotate(job)
    except FileNotFoundError as error:
        return FileNotFoundError(
            f"{error} (worker on {platform.node()} in {os.getcwd()}; all workers must "
            "see the drives by the same path)"
        )
    except OSError as error:
        may_pass = _plain(error)
    except Exception as error:
        return _plain(error)
    # not raised above, where an error of PyAV would become its context
    raise may_pass


def _plain(error: Exception) -> Exception:
    """The error as it can be sent to another process: without errors of PyAV."""
    if isinstance(error, av.FFmpegError):
        kind = OSError if isinstance(error, OSError) else ValueError
        error = kind(str(error))
    error.__cause__ = error.__context__ = None
    return error


def _require_same_versions(job: DriveJob) -> None:
    wanted = job.fingerprint["versions"]
    others = []
    for name, found in all_versions(job.settings.markings).items():
        if found != wanted[name]:
            others.append(f"{name} {found}")
    if others:
        raise ValueError(
            f"the worker on {platform.node()} has {', '.join(others)}, so that its "
            "results would differ; install the same versions on all machines."
        )


def _annotate(job: DriveJob) -> FinishedDrive:
    result = annotate_drive(job.video, job.settings)
    times_s = result.telemetry["time_s"]
    drive = FinishedDrive(
        fingerprint=job.fingerprint,
        outputs=job.output_sizes(),
        description=result.description,
        tracked_share=share_tracked(result.telemetry),
        lost_s=seconds_lost(result.telemetry),
        frames=len(times_s),
        missing=result.missing,
        length_s=float(frame_lengths_s(times_s).sum()),
    )
    content = json.dumps(asdict(drive), indent=1)
    write_atomically(job.manifest, content.encode(errors="replace"))
    return drive


def outcome_of(job: DriveJob, future: Future) -> FinishedDrive | Exception:
    """The result of a task, or an error that names the video.

    The outputs must be visible on this machine.
    """
    try:
        outcome = future.result()
    except CancelledError:
        outcome = OSError("was lost by the scheduler; run the command again.")
    except BrokenExecutor:
        times = RETRIES + 1
        outcome = OSError(f"its worker died {times} times; memory may be short.")
    except Exception as error:
        outcome = error

    if isinstance(outcome, FinishedDrive):
        unseen = dict(outcome.outputs.items() - job.output_sizes().items())
        if not unseen:
            return outcome
        outcome = OSError(
            f"its worker wrote {', '.join(sorted(unseen))}, but not into "
            f"{job.settings.output} as seen from here; use an output folder on storage "
            "that all workers share."
        )
    words = str(outcome)
    if not isinstance(outcome, OSError | ValueError):
        words = f"{type(outcome).__name__}: {outcome}"
    elif str(job.video) in words:
        return outcome
    return OSError(f"{job.video}: {words}")


# Where tasks run.


@contextmanager
def open_executor(
    jobs: Sequence[DriveJob], workers: int | None, scheduler: str | None
) -> Iterator[tuple[Executor, str]]:
    """Processes on this machine, or the workers of a Dask scheduler; and how many.

    Processes on this machine end with the block, and leave no partial files of the
    jobs. Workers of a scheduler finish their current drives. Raises OSError if there is
    no scheduler.
    """
    if not scheduler:
        count = workers or os.cpu_count() or 1
        try:
            with LocalProcesses(count) as executor:
                yield executor, f"{count} workers on this machine"
        finally:
            _remove_partial_files(jobs)
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise OSError(
            "--scheduler needs Dask, which is not installed; run "
            "`pip install 'dask[distributed]' bokeh`, or give --workers to annotate on "
            "this machine."
        ) from error
    try:
        client = Client(scheduler)
    except (OSError, ValueError) as error:
        raise OSError(
            f"{scheduler}: no Dask scheduler answers there ({error}); start one with "
            "`dask scheduler`, and give the address that it prints."
        ) from error
    with client:
        count = len(client.nthreads())
        where = f"{count} workers; dashboard: {client.dashboard_link}"
        try:
            yield client.get_executor(pure=False, retries=RETRIES), where
        except KeyboardInterrupt:
            # callbacks that are cut off by the end log errors without meaning
            logging.getLogger("tornado.application").setLevel(logging.CRITICAL)
            raise


def _remove_partial_files(jobs: Sequence[DriveJob]) -> None:
    for job in jobs:
        for output in (*job.outputs, job.manifest):
            remove_partial(output)


class LocalProcesses(Executor):
    """Processes on this machine, one for each thread of a pool.

    A process that dies breaks its `ProcessPoolExecutor`. Each has one of its own, so
    that only the task is lost that killed it. It is repeated in a new process.
    """

    def __init__(self, count: int) -> None:
        # not forked: a forked child inherits locks of OpenCV's and FFmpeg's threads
        self._spawn = multiprocessing.get_context("spawn")
        # Processes end when `_held` is closed: by `shutdown`, or with this process.
        self._end, self._held = self._spawn.Pipe(duplex=False)
        self._threads = ThreadPoolExecutor(count)
        self._of_thread = threading.local()

    def submit(self, function: Callable, /, *args: Any, **options: Any) -> Future:
        """Run a function in a process; it and its arguments are pickled."""
        return self._threads.submit(self._run, function, *args, **options)

    def _run(self, function: Callable, *args: Any, **options: Any) -> Any:
        """Run a task, and repeat it after the death of the process or an OSError."""
        for attempt in range(RETRIES + 1):
            pool = self._pool()
            try:
                return pool.submit(function, *args, **options).result()
            except BrokenExecutor:
                pool.shutdown()  # until the process has released its locks
                del self._of_thread.pool
                if attempt == RETRIES or self._held.closed:
                    raise
            except OSError:
                if attempt == RETRIES:
                    raise
        raise AssertionError("unreachable")

    def _pool(self) -> ProcessPoolExecutor:
        if not hasattr(self._of_thread, "pool"):
            self._of_thread.pool = ProcessPoolExecutor(
                max_workers=1,
                mp_context=self._spawn,
                initializer=_watch_parent,
                initargs=(self._end,),
            )
        return self._of_thread.pool

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes at once, and cancel what has not begun."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._held.close()
        self._threads.shutdown(wait)


def _watch_parent(end: Connection) -> None:
    """In a process: end it when the other end of the pipe is closed."""
    from tqdm import tqdm  # late, as in `lanes.console`

    # by default a semaphore, which a process that ends at once leaves behind
    tqdm.set_lock(threading.RLock())

    def wait() -> None:
        try:
            end.recv()
        except EOFError:
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
