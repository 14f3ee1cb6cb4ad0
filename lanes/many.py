"""Manifest of a finished drive, a JSON file next to its outputs, so that no drive is annotated twice; summary of all.

The manifest is written last. A drive is finished if its manifest exists, names the same input, settings and versions,
and all its outputs exist with the sizes in the manifest. Every other drive is annotated.

The summary has one telemetry data set, one table of drives with the worst first, and totals.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import shutil
import signal
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache, wraps
from glob import escape
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import lanes
from lanes.annotate import (
    DriveResult,
    DriveSettings,
    PreparedDrive,
    annotate_prepared,
    output_path,
    prepare_drive,
    versions,
)
from lanes.camera import camera_to_dict
from lanes.errors import VideoError
from lanes.files import (
    atomic_write,
    exclusive_writer,
    read_telemetry,
    read_text,
    remove_stale_partials,
    require_file,
    write_atomically,
    write_telemetry,
)
from lanes.images import opencv_threads
from lanes.pieces import Piece, annotate_piece, cut_drive, join_pieces

if TYPE_CHECKING:
    from distributed import Client, Future

# Hexadecimal digits of a key: 48 bits, enough to keep all drives of an output folder apart.
KEY_DIGITS = 12
# Largest manifest that is read. A real one has a few kilobytes.
MAX_MANIFEST_BYTES = 1_000_000
SUMMARY, DATA_SET = "summary", "telemetry"
MEASURES = ("tracked_share", "lost_s", "frames", "missing", "length_s", "cpu_s", "pieces")


@dataclass(frozen=True)
class DriveKey:
    """Everything the outputs of a drive depend on: input (path, size, modification time), settings and versions."""

    source: str
    size_bytes: int
    mtime_ns: int
    settings: Mapping[str, Any]
    versions: Mapping[str, str]

    @classmethod
    def from_video(cls, video: Path, settings: DriveSettings, piece_s: float) -> DriveKey:
        """The key of a drive in its present state; raises FileNotFoundError or VideoError if it is not a file."""
        status = require_file(video, "video", error=VideoError).stat()
        used = {
            "camera": settings.camera and camera_to_dict(settings.camera),
            "field": settings.field and asdict(settings.field),
            **{name: getattr(settings, name) for name in ("style", "start_s", "end_s", "report", "overlapped")},
            "piece_s": piece_s,
        }
        return cls(str(video), status.st_size, status.st_mtime_ns, used, all_versions())

    def digest(self) -> str:
        """The first `KEY_DIGITS` hexadecimal digits of a hash of the key."""
        content = json.dumps(asdict(self), sort_keys=True).encode(errors="replace")
        return hashlib.sha256(content).hexdigest()[:KEY_DIGITS]


@dataclass(frozen=True)
class Manifest:
    """Inputs, outputs and results of a finished drive.

    Attributes
    ----------
    outputs : mapping of str to int
        Names of the files in the output folder and their sizes in bytes.
    frames, missing, tracked_share, lost_s
        As in `DriveResult`.
    length_s : float
        Duration of the annotated video.
    cpu_s : float
        Processor time of all tasks of the drive.
    pieces : int
        Number of pieces that the drive was cut into.
    description : str
        A sentence about the drive, see `DriveResult.describe`.
    """

    key: DriveKey
    outputs: Mapping[str, int]
    frames: int
    missing: int
    length_s: float
    tracked_share: float
    lost_s: float
    cpu_s: float
    pieces: int
    description: str


@cache
def all_versions() -> dict[str, str]:
    """Versions of Python and of the packages that the results depend on, and a digest of the code of `lanes`."""
    digest = hashlib.sha256()
    root = Path(lanes.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return {**versions(), "lanes": digest.hexdigest()[:12]}


def manifest_path(video: Path, folder: Path) -> Path:
    """Path of the manifest of a drive, next to the annotated video."""
    return output_path(video, folder).with_suffix(".json")


def write_manifest(key: DriveKey, result: DriveResult, *, cpu_s: float, pieces: int) -> Manifest:
    """Write the manifest of a drive whose outputs are complete."""
    written = [path for path in (result.video, result.telemetry, result.report) if path]
    time_s = read_telemetry(result.telemetry)["time_s"]
    length_s = float(time_s[-1] - time_s[0]) * len(time_s) / max(len(time_s) - 1, 1)
    manifest = Manifest(
        key=key,
        outputs={path.name: path.stat().st_size for path in written},
        frames=result.frames,
        missing=result.missing,
        length_s=round(length_s, 6),
        tracked_share=result.tracked_share,
        lost_s=result.lost_s,
        cpu_s=round(cpu_s, 3),
        pieces=pieces,
        description=result.describe(),
    )
    write_atomically(result.video.with_suffix(".json"), json.dumps(asdict(manifest), indent=1).encode(errors="replace"))
    return manifest


def read_finished(key: DriveKey, folder: Path) -> Manifest | None:
    """The manifest of a drive if it is finished, else None. An unreadable or foreign file counts as no manifest."""
    path = manifest_path(Path(key.source), folder)
    try:
        content = json.loads(read_text(path, "manifest", max_bytes=MAX_MANIFEST_BYTES))
        manifest = Manifest(**{**content, "key": DriveKey(**content["key"])})
        _require_types(manifest)
        # Compared as JSON, because JSON turns tuples into lists.
        same = json.loads(json.dumps(asdict(key))) == json.loads(json.dumps(asdict(manifest.key)))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return manifest if same and not missing_outputs(manifest, folder) else None


def _require_types(manifest: Manifest) -> None:
    """Raise TypeError if an entry has the wrong type, or an output is not in the output folder."""
    numbers = ("frames", "missing", "length_s", "tracked_share", "lost_s", "cpu_s", "pieces")
    kinds = {name: (int, float) for name in numbers} | {"outputs": dict, "description": str}
    if not all(isinstance(getattr(manifest, name), kind) for name, kind in kinds.items()):
        raise TypeError("an entry of the manifest has the wrong type")
    if not all(isinstance(size, int) and name == Path(name).name for name, size in manifest.outputs.items()):
        raise TypeError("an output of the manifest is not in the output folder")


def missing_outputs(manifest: Manifest, folder: Path) -> Sequence[str]:
    """Names of the outputs that are not in `folder`, or have another size."""
    return [
        name
        for name, size_bytes in manifest.outputs.items()
        if not (folder / name).is_file() or (folder / name).stat().st_size != size_bytes
    ]


def add_to_data_set(telemetry: Path, folder: Path) -> Path:
    """Copy a drive's telemetry into the data set of `folder`; returns the path written.

    The data set is CSV with Hive partitioning by drive. Dask, DuckDB, Spark and Arrow read its folders (drive=NAME,
    special characters percent-encoded) as one table with a column `drive`.
    """
    part = _data_set_part(folder, telemetry.stem)
    with atomic_write(part) as partial:
        shutil.copyfile(telemetry, partial)
    return part


def _data_set_part(folder: Path, drive: str) -> Path:
    return folder / SUMMARY / DATA_SET / f"drive={quote(drive, safe=' ')}" / "part.csv"


def write_summary(folder: Path, finished: Sequence[Manifest], failed: Mapping[Path, Exception]) -> Path:
    """Write the table of drives, failed ones first, then by tracked share from the worst on; returns its path.

    The telemetry that an earlier run added for a drive that has failed now is removed from the data set.
    """
    for video in failed:
        _data_set_part(folder, video.stem).unlink(missing_ok=True)
    rows = [{"drive": video.stem, "state": "failed", "reason": str(error)} for video, error in sorted(failed.items())]
    rows += [
        {
            "drive": Path(manifest.key.source).stem,
            "state": "finished",
            **{name: getattr(manifest, name) for name in MEASURES},
            "source": manifest.key.source,
        }
        for manifest in sorted(finished, key=_rank)
    ]
    return write_telemetry(folder / SUMMARY / "drives.csv", rows)


def describe_totals(finished: Sequence[Manifest], failed: int, skipped: int) -> str:
    """A sentence about all drives."""
    counts = f"{len(finished)} drives finished ({skipped} of them before), {failed} failed"
    length_s = sum(m.length_s for m in finished)
    if not length_s:
        return f"{counts}."
    frames = sum(m.frames for m in finished)
    tracked = sum(m.tracked_share * m.frames for m in finished) / frames
    lost_s = sum(m.lost_s for m in finished)
    per_minute_s = 60 * sum(m.cpu_s for m in finished) / length_s
    worst = min(finished, key=_rank)
    return (
        f"{counts}: {length_s / 3600:.3g} hours of video, {frames} frames, lane tracked in {tracked:.0%} of them, lost "
        f"for {lost_s:.1f} s; {per_minute_s:.0f} s of processor time for a minute of video. Worst: "
        f"{Path(worst.key.source).name}, tracked in {worst.tracked_share:.0%}."
    )


def _rank(manifest: Manifest) -> tuple[float, float, str]:
    """Sort key of a drive, the worst first."""
    return manifest.tracked_share, -manifest.lost_s, manifest.key.source


# The tasks of a worker: inspect a drive, annotate it or a piece of it, join the pieces, write the manifest.
#
#     begin_drive -> manifest                                  (a short drive is one task)
#                 -> run_piece ... -> finish_drive -> manifest (a long drive is cut, see `lanes.pieces`)
#
# Tasks can be repeated: outputs get their final names when they are complete, and the manifest is written last. A task
# returns an error that would occur again, such as an unusable file, instead of its result.


@dataclass(frozen=True, eq=False)
class DriveJob:
    """A drive to annotate, as sent to a worker."""

    key: DriveKey
    settings: DriveSettings

    @classmethod
    def from_video(cls, video: Path, settings: DriveSettings, piece_s: float) -> DriveJob:
        """The job for a drive, with absolute paths because workers may have other working directories."""
        settings = replace(settings, output=settings.output.absolute(), progress=False, overlapped=False)
        return cls(DriveKey.from_video(video.absolute(), settings, piece_s), settings)

    @property
    def video(self) -> Path:
        """Absolute path of the video."""
        return Path(self.key.source)

    @property
    def folder(self) -> Path:
        """Folder for the pieces of this drive; another input or other settings give another folder."""
        target = output_path(self.video, self.settings.output)
        return target.with_name(f"{target.stem}.pieces.{self.key.digest()}")

    def remove_leftovers(self) -> None:
        """Remove the partial files of killed runs, and pieces of another input or of other settings."""
        target = output_path(self.video, self.settings.output)
        remove_stale_partials(target)
        digits = "[0-9a-f]" * KEY_DIGITS
        for path in target.parent.glob(f"{escape(target.stem)}.pieces.{digits}"):
            if path != self.folder:
                shutil.rmtree(path, ignore_errors=True)


@dataclass(frozen=True, eq=False)
class Plan:
    """A long drive, inspected and cut into pieces; `cpu_s` is the processor time of that."""

    drive: PreparedDrive
    pieces: tuple[Piece, ...]
    cpu_s: float


@dataclass(frozen=True)
class PieceTiming:
    """Processor time and wall-clock time of a piece."""

    cpu_s: float
    elapsed_s: float


def _return_permanent_errors(task: Callable) -> Callable:
    """A task that returns errors that would occur again; it raises other errors, so that Dask repeats it."""

    @wraps(task)
    def run(job: DriveJob, *inputs: object) -> object:
        try:
            _require_same_versions(all_versions(), job.key.versions)
            with opencv_threads(1):
                return task(job, *inputs)
        except FileNotFoundError as error:
            here = f"worker on {platform.node()} in {os.getcwd()}"
            return FileNotFoundError(f"{error} ({here}; all workers must see the drives by the same path)")
        except ValueError as error:
            return error

    return run


@_return_permanent_errors
def begin_drive(job: DriveJob) -> Manifest | Plan:
    """Annotate a short drive, or inspect and cut a long one."""
    # An earlier worker may have finished the drive and died before it returned.
    if finished := read_finished(job.key, job.settings.output):
        return finished
    job.remove_leftovers()
    began_s = time.process_time()
    drive = prepare_drive(job.video, job.settings)
    pieces = cut_drive(drive, job.settings, job.key.settings["piece_s"])
    if len(pieces) > 1:
        return Plan(drive, pieces, time.process_time() - began_s)
    result = annotate_prepared(drive, job.settings)
    add_to_data_set(result.telemetry, job.settings.output)
    return write_manifest(job.key, result, cpu_s=time.process_time() - began_s, pieces=1)


@_return_permanent_errors
def run_piece(job: DriveJob, drive: PreparedDrive, piece: Piece) -> PieceTiming:
    """Annotate one piece of a long drive."""
    began_s = time.process_time()
    elapsed_s = annotate_piece(drive, piece, job.settings, job.folder)
    return PieceTiming(time.process_time() - began_s, elapsed_s)


@_return_permanent_errors
def finish_drive(job: DriveJob, plan: Plan, done: Sequence[PieceTiming | Exception]) -> Manifest | Exception:
    """Join the pieces of a long drive; returns the error of a failed piece."""
    if failed := next((outcome for outcome in done if isinstance(outcome, Exception)), None):
        return failed
    if finished := read_finished(job.key, job.settings.output):
        return finished
    began_s = time.process_time()
    timings = [outcome for outcome in done if isinstance(outcome, PieceTiming)]
    try:
        elapsed_s = sum(piece.elapsed_s for piece in timings)
        result = join_pieces(plan.drive, plan.pieces, job.settings, job.folder, elapsed_s)
    except VideoError:
        # The next run must not use the same damaged piece.
        shutil.rmtree(job.folder, ignore_errors=True)
        raise
    add_to_data_set(result.telemetry, job.settings.output)
    cpu_s = plan.cpu_s + sum(piece.cpu_s for piece in timings) + time.process_time() - began_s
    manifest = write_manifest(job.key, result, cpu_s=cpu_s, pieces=len(done))
    shutil.rmtree(job.folder)
    return manifest


def _require_same_versions(here: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    differing = [
        f"{name} {here.get(name)} instead of {version}" for name, version in wanted.items() if here.get(name) != version
    ]
    if differing:
        raise ValueError(
            f"the worker on {platform.node()} has {', '.join(differing)}, so that its results would differ; install "
            "the same versions on all machines."
        )


# Many drives in parallel on Dask: on the cores of this machine, or on the workers of a Dask scheduler.
#
# Dask schedules the tasks, restarts dead workers and repeats failed tasks. The tasks themselves are in
# `lanes.many`.

# Time to wait for a scheduler to answer.
CONNECT_TIMEOUT_S = 10


class ClusterError(OSError):
    """Dask, a worker or the shared storage is not usable; the message says what to do."""


@dataclass(frozen=True, kw_only=True)
class ClusterSettings:
    """Where and how many drives are annotated.

    Parameters
    ----------
    scheduler : str, optional
        Address of a Dask scheduler.
    workers : int, optional
        Number of processes on this machine, each with one thread; used without a scheduler.
    piece_s : float
        Approximate length of the pieces of a long drive.
    retries : int
        How many times a task is repeated when its worker dies, or a disk or the network fails.
    """

    scheduler: str | None = None
    workers: int | None = None
    piece_s: float = 300.0
    retries: int = 2


def annotate_many(
    videos: Sequence[Path], settings: DriveSettings, cluster: ClusterSettings, *, log: Callable[[str], None]
) -> tuple[list[Manifest], list[Exception]]:
    """Annotate the videos that are not finished yet, and write the summary of all.

    There is at least one video, and their file names are distinct. `log` is called with a message for each event.

    Returns
    -------
    finished : list of Manifest
        Manifests of the finished drives, including those of earlier runs.
    failures : list of OSError or ValueError
        One error for each other drive.

    Raises
    ------
    ClusterError
        If Dask is not installed, or no scheduler answers.
    OSError
        If the summary cannot be written.
    """
    jobs = [DriveJob.from_video(video, settings, cluster.piece_s) for video in videos]
    known = [read_finished(job.key, job.settings.output) for job in jobs]
    before = [manifest for manifest in known if manifest]
    if before:
        log(f"{len(before)} of {len(jobs)} drives were finished before")
    outcomes = _annotate_unfinished(
        [job for job, manifest in zip(jobs, known, strict=True) if not manifest], cluster, log
    )
    finished = before + [outcome for outcome in outcomes.values() if isinstance(outcome, Manifest)]
    failed = {job.video: outcome for job, outcome in outcomes.items() if isinstance(outcome, Exception)}
    table = write_summary(settings.output, finished, failed)
    log(f"{describe_totals(finished, len(failed), len(before))}\nwrote {table}")
    return finished, list(failed.values())


def _annotate_unfinished(
    jobs: Sequence[DriveJob], cluster: ClusterSettings, log: Callable[[str], None]
) -> dict[DriveJob, Manifest | Exception]:
    """The manifest or the error of each job; Dask is started only if there are jobs."""
    outcomes: dict[DriveJob, Manifest | Exception] = {}
    if not jobs:
        return outcomes
    try:
        with connect(cluster) as client, exclusive_writer(jobs[0].settings.output / SUMMARY):
            log(f"{len(client.nthreads())} workers; dashboard: {client.dashboard_link}")
            for job, outcome in annotate_all(client, jobs, retries=cluster.retries):
                outcomes[job] = outcome
                if isinstance(outcome, Manifest):
                    log(outcome.description)
    finally:
        # Local workers have ended here, also after an interruption. Workers of a scheduler still finish their tasks.
        if not cluster.scheduler:
            for job in jobs:
                if job not in outcomes:
                    job.remove_leftovers()
    return outcomes


@contextmanager
def connect(cluster: ClusterSettings) -> Iterator[Client]:
    """A Dask client of `cluster.scheduler`, or of a new local cluster with `cluster.workers` processes.

    Raises ClusterError if Dask is not installed, or no scheduler answers.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ClusterError(
            "--workers and --scheduler need Dask, which is not installed; run "
            "`pip install 'dask[distributed]' bokeh`, or omit them to annotate one drive after the other."
        ) from error
    if cluster.scheduler:
        with _connect_to(cluster.scheduler) as client:
            yield client
        return
    with dask.config.set({"distributed.scheduler.allowed-failures": cluster.retries}), ExitStack() as resources:
        # Ctrl-C in a terminal reaches all processes. The workers ignore it, and end with this one.
        with sigint_blocked():
            local = resources.enter_context(
                LocalCluster(
                    n_workers=cluster.workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",
                    # Dask warns about each worker that ends or restarts. A failed drive is reported by this program.
                    silence_logs=logging.ERROR,
                )
            )
        client = resources.enter_context(Client(local))
        try:
            yield client
        except KeyboardInterrupt:
            # Callbacks of the scheduler that are cut off by its end log errors without meaning.
            logging.getLogger("tornado.application").setLevel(logging.CRITICAL)
            raise


def _connect_to(scheduler: str) -> Client:
    from distributed import Client

    try:
        return Client(scheduler, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{scheduler}: no Dask scheduler answers there ({error}); start one with `dask scheduler`, and give the "
            "address that it prints."
        ) from error


def annotate_all(
    client: Client, jobs: Sequence[DriveJob], *, retries: int = 2
) -> Iterator[tuple[DriveJob, Manifest | Exception]]:
    """Annotate drives, large files first; yields each job with its manifest or error as soon as it is done.

    An unusable file or wrong settings fail at once. Other errors, such as a full disk or a dead worker, are retried up
    to `retries` times.
    """
    from distributed import as_completed

    pending = {
        client.submit(begin_drive, job, retries=retries, pure=False): job
        for job in sorted(jobs, key=lambda job: -job.key.size_bytes)
    }
    completed = as_completed(pending)
    for future in completed:
        job, outcome = pending.pop(future), _outcome(future)
        if isinstance(outcome, Plan):
            joined = _submit_pieces(client, job, outcome, retries)
            pending[joined] = job
            completed.add(joined)
        else:
            yield job, _require_visible_outputs(job, outcome)


def _submit_pieces(client: Client, job: DriveJob, plan: Plan, retries: int) -> Future:
    """Submit the pieces of a drive and their join; they have priority over new drives, so that few drives are open."""
    pieces = [
        client.submit(run_piece, job, plan.drive, piece, retries=retries, pure=False, priority=1)
        for piece in plan.pieces
    ]
    return client.submit(finish_drive, job, plan, pieces, retries=retries, pure=False, priority=2)


def _outcome(future: Future) -> Manifest | Plan | Exception:
    if future.status == "finished":
        return future.result()
    error = future.exception() if future.status == "error" else None
    if isinstance(error, OSError | ValueError):
        return error
    return ClusterError(f"{type(error).__name__}: {error}" if error else f"lost by the scheduler ({future.status})")


def _require_visible_outputs(job: DriveJob, outcome: Manifest | Exception) -> Manifest | Exception:
    """The outcome, or a ClusterError if the outputs of the worker are not visible on this machine."""
    if isinstance(outcome, Exception):
        name = str(job.video)
        return outcome if name in str(outcome) else ClusterError(f"{name}: {outcome}")
    missing = missing_outputs(outcome, job.settings.output)
    if not missing:
        return outcome
    return ClusterError(
        f"{job.video}: its worker wrote {', '.join(missing)}, but not into {job.settings.output} as seen from here; "
        "use an output folder on storage that all workers share."
    )


@contextmanager
def sigint_blocked() -> Generator[None]:
    """Delay Ctrl-C; processes started meanwhile inherit the blocked signal."""
    # Python starts its resource tracker with the first process, and unblocks the signal after that.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
