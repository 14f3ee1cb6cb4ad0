"""Many drives in parallel on Dask: on the cores of this machine, or on the workers of a Dask scheduler.

Dask schedules the tasks, restarts dead workers and repeats failed tasks. The tasks themselves are in
`lanes.cluster.tasks`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.cluster.manifest import (
    SUMMARY,
    Manifest,
    describe_totals,
    missing_outputs,
    read_finished,
    write_summary,
)
from lanes.cluster.tasks import DriveJob, Plan, begin_drive, finish_drive, run_piece
from lanes.drives.settings import DriveSettings
from lanes.io.files import exclusive_writer
from lanes.io.processes import sigint_blocked

if TYPE_CHECKING:
    from distributed import Client, Future

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
