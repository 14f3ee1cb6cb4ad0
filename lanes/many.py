"""Many drives in parallel on Dask: on the cores of this machine, or on the workers of a Dask scheduler.

One drive is one task. Dask replaces dead workers and repeats their tasks, and those that failed with an error that may
pass. A finished drive has a manifest, a JSON file next to its outputs that is written last. It holds the fingerprint of
the drive (input, settings and versions) and the sizes of the outputs. While neither changes, the drive is skipped.
"""

from __future__ import annotations

import json
import logging
import os
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import av

import lanes
from lanes.annotation import DriveSettings
from lanes.camera.model import camera_to_dict
from lanes.console import plain_warnings, sigint_blocked
from lanes.drive import annotate_drive, output_path, versions
from lanes.errors import VideoError
from lanes.files import hash_sources, read_text, remove_partial, require_file, write_atomically, write_telemetry
from lanes.ros.lane_messages import MESSAGES_SUFFIX
from lanes.ros.robot_log import file_of_log
from lanes.show.report import frame_lengths_s, seconds_lost, share_tracked
from lanes.video.sources import require_distinct_outputs

if TYPE_CHECKING:
    from distributed import Client, Future

# How many times a task is repeated after its worker died, or a disk or the network failed.
RETRIES = 2
# Time to wait for a scheduler to answer.
CONNECT_TIMEOUT_S = 10
# Table of all drives, in the output folder, and its columns with numbers.
_SUMMARY = Path("summary", "drives.csv")
_MEASURES = ("tracked_share", "lost_s", "frames", "missing", "length_s")


@dataclass(frozen=True, eq=False)
class DriveJob:
    """A drive to annotate, as sent to a worker. All paths are absolute: workers may have other working directories."""

    video: Path
    settings: DriveSettings
    fingerprint: Mapping[str, Any]

    @property
    def manifest(self) -> Path:
        """Path of the manifest, next to the annotated video."""
        return output_path(self.video, self.settings.output).with_suffix(".json")

    @property
    def outputs(self) -> list[Path]:
        """The files to write, except the manifest."""
        suffixes = [".mp4", ".csv", MESSAGES_SUFFIX] + ([".html"] if self.settings.report else [])
        return [self.manifest.with_suffix(suffix) for suffix in suffixes]


@dataclass(frozen=True)
class FinishedDrive:
    """Content of a manifest: fingerprint, sizes of the outputs in bytes by name, and results."""

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
    """Annotate the videos that are not finished yet, and write a table of all, failed ones and the worst ones first.

    Returns the finished drives, also those of earlier runs, and an error for each other drive. `workers` is the number
    of processes on this machine (default: one per core); those of the Dask scheduler with the address `scheduler` are
    used instead if it is given. `log` is called with a message for each event. Raises OSError if Dask cannot be used or
    the table cannot be written, and ValueError if an output would overwrite a video or another output.
    """
    require_distinct_outputs(videos, [output_path(video, settings.output) for video in videos])
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
        if drive := _read_finished(job):
            finished.append(drive)
        else:
            unfinished.append(job)
    counts = f"{len(finished)} of {len(videos)} drives were finished before"
    if unfinished:
        try:
            with connect(workers, scheduler) as client:
                log(f"{len(client.nthreads())} workers; dashboard: {client.dashboard_link}; {counts}")
                from distributed import as_completed

                large_first = sorted(unfinished, key=lambda job: -job.fingerprint["size_bytes"])
                pending = {client.submit(run_job, job, retries=RETRIES, pure=False): job for job in large_first}
                for future in as_completed(pending):
                    job, outcome = pending[future], _outcome(pending[future], future)
                    if isinstance(outcome, Exception):
                        failed[job.video] = outcome
                    else:
                        finished.append(outcome)
                        log(outcome.description)
        finally:
            # Workers on this machine have ended here, also after an interruption; those of a scheduler go on.
            for job in [] if scheduler else unfinished:
                for output in (*job.outputs, job.manifest):
                    remove_partial(output)
    table = write_telemetry(settings.output / _SUMMARY, _summary_rows(finished, failed))
    log(f"{len(finished)} drives finished, {len(failed)} failed; {counts}; wrote {table}")
    return finished, list(failed.values())


def _summary_rows(finished: Sequence[FinishedDrive], failed: Mapping[Path, Exception]) -> Iterator[dict[str, object]]:
    for video, error in sorted(failed.items()):
        yield {"drive": video.stem, "state": "failed", "reason": str(error), "source": str(video)}
    for drive in sorted(finished, key=lambda drive: (drive.tracked_share, -drive.lost_s, drive.fingerprint["source"])):
        video, measures = Path(drive.fingerprint["source"]), {name: getattr(drive, name) for name in _MEASURES}
        yield {"drive": video.stem, "state": "finished", **measures, "source": str(video)}


# Finished drives.


def fingerprint(video: Path, settings: DriveSettings) -> dict[str, Any]:
    """Everything that the outputs of a drive depend on: input (path, size, time of change), settings and versions."""
    status = require_file(file_of_log(video), "video", error=VideoError).stat()
    used = {name: value for name, value in vars(settings).items() if name not in ("output", "progress")}
    used["camera"] = settings.camera and camera_to_dict(settings.camera)
    used |= {"field": settings.field and asdict(settings.field), "markings": repr(settings.markings)}
    found = {"source": str(video), "size_bytes": status.st_size, "mtime_ns": status.st_mtime_ns}
    # To and from JSON, as a manifest, because JSON turns tuples into lists.
    return json.loads(json.dumps(found | {"settings": used, "versions": all_versions()}))


@cache
def all_versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results depend on, and a digest of the code of `lanes`."""
    return {**versions(), "lanes": hash_sources(Path(lanes.__file__).parent)}


def _read_finished(job: DriveJob) -> FinishedDrive | None:
    """The manifest of a drive if it is finished, else None. An unreadable or foreign file counts as no manifest."""
    try:
        drive = FinishedDrive(**json.loads(read_text(job.manifest, "manifest", max_bytes=1_000_000)))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    valid = all(isinstance(getattr(drive, name), int | float) for name in _MEASURES)
    return drive if valid and (drive.fingerprint, drive.outputs) == (job.fingerprint, _output_sizes(job)) else None


def _output_sizes(job: DriveJob) -> dict[str, int]:
    """Sizes in bytes, by name, of the outputs of a drive that exist."""
    return {path.name: path.stat().st_size for path in job.outputs if path.is_file()}


# The task, which runs on a worker.


def run_job(job: DriveJob) -> FinishedDrive | Exception:
    """Annotate a drive and write its manifest; returns the manifest, or an error that would occur again.

    Raises any other error, such as that of a full disk, so that Dask repeats the task.
    """
    # An earlier worker may have finished the drive and died before it returned.
    if finished := _read_finished(job):
        return finished
    worker, wanted = platform.node(), job.fingerprint["versions"]
    if other := ", ".join(f"{name} {found}" for name, found in all_versions().items() if found != wanted[name]):
        remedy = "install the same versions on all machines"
        return ValueError(f"the worker on {worker} has {other}, so that its results would differ; {remedy}.")
    failed: Exception | None = None
    try:
        with plain_warnings():
            result = annotate_drive(job.video, job.settings)
    except FileNotFoundError as error:
        where = f"worker on {worker} in {os.getcwd()}; all workers must see the drives by the same path"
        failed = FileNotFoundError(f"{error} ({where})")
    except (OSError, ValueError) as error:
        failed = error
        if isinstance(error, av.FFmpegError):
            failed = OSError(str(error)) if isinstance(error, OSError) else ValueError(str(error))
    if failed:
        # PyAV's errors cannot be sent to another process, not even as the cause of another error.
        failed.__cause__ = failed.__context__ = None
        if isinstance(failed, OSError) and not isinstance(failed, FileNotFoundError):
            raise failed
        return failed
    time_s, length_s = result.telemetry["time_s"], float(frame_lengths_s(result.telemetry["time_s"]).sum())
    measures = share_tracked(result.telemetry), seconds_lost(result.telemetry), len(time_s), result.missing, length_s
    drive = FinishedDrive(job.fingerprint, _output_sizes(job), result.description, *measures)
    write_atomically(job.manifest, json.dumps(asdict(drive), indent=1).encode(errors="replace"))
    return drive


# Dask.


def _outcome(job: DriveJob, future: Future) -> FinishedDrive | Exception:
    """The result of a task, whose outputs must be visible on this machine, or an error that names the video."""
    outcome = future.result() if future.status == "finished" else future.exception()
    if isinstance(outcome, FinishedDrive):
        unseen = sorted(dict(outcome.outputs.items() - _output_sizes(job).items()))
        if not unseen:
            return outcome
        words = f"its worker wrote {', '.join(unseen)}, but not into {job.settings.output} as seen from here; "
        words += "use an output folder on storage that all workers share."
    elif isinstance(outcome, OSError | ValueError):
        if str(job.video) in str(outcome):
            return outcome
        words = str(outcome)
    else:
        words = f"{type(outcome).__name__}: {outcome}" if outcome else "lost by the scheduler; run the command again."
    return OSError(f"{job.video}: {words}")


@contextmanager
def connect(workers: int | None = None, scheduler: str | None = None) -> Iterator[Client]:
    """A Dask client of a scheduler, or of new processes on this machine; raises OSError if there is none."""
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise OSError(
            "--workers and --scheduler need Dask, which is not installed; run "
            "`pip install 'dask[distributed]' bokeh`, or omit them to annotate one drive after the other."
        ) from error
    with ExitStack() as resources:
        if scheduler:
            try:
                client = Client(scheduler, timeout=CONNECT_TIMEOUT_S)
            except (OSError, ValueError) as error:
                raise OSError(
                    f"{scheduler}: no Dask scheduler answers there ({error}); start one with `dask scheduler`, and "
                    "give the address that it prints."
                ) from error
        else:
            resources.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": RETRIES}))
            # Dask warns about each worker that ends or restarts. A failed drive is reported by this program.
            quiet = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.ERROR}
            with sigint_blocked():  # the workers end with this process
                local = LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, **quiet)
            client = Client(resources.enter_context(local))
        try:
            yield resources.enter_context(client)
        except KeyboardInterrupt:
            # Callbacks of the scheduler that are cut off by its end log errors without meaning.
            logging.getLogger("tornado.application").setLevel(logging.CRITICAL)
            raise
