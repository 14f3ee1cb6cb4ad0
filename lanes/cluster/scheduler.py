"""Many drives at the same time: on the cores of this machine, or on whatever machines a Dask scheduler has.

Who does what when, what happens if a worker dies, and how often something is tried again is Dask's business; what is
done for a drive is in `lanes.cluster.tasks`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.cluster.manifest import Manifest, missing_outputs, read_finished
from lanes.cluster.summary import SUMMARY, describe_totals, write_summary
from lanes.cluster.tasks import DriveJob, Plan, begin_drive, finish_drive, work_on_piece
from lanes.drives.settings import DriveSettings
from lanes.io.files import exclusive_writer

if TYPE_CHECKING:
    from distributed import Client, Future

# How long to wait for a scheduler to answer.
CONNECT_S = 10


class ClusterError(OSError):
    """Dask, a worker or what they share is not as it must be; the message says what to do."""


@dataclass(frozen=True, kw_only=True)
class ClusterSettings:
    """Where many drives are annotated, and how.

    Parameters
    ----------
    scheduler : str, optional
        Address of a Dask scheduler.
    workers : int, optional
        Without a scheduler: processes on this machine, each with one thread.
    piece_s : float
        About how long the pieces of long drives are.
    retries : int
        How often a task is tried again when its worker dies, or a disk or the network fails.
    """

    scheduler: str | None = None
    workers: int | None = None
    piece_s: float = 300.0
    retries: int = 2


def annotate_many(
    videos: Sequence[Path], settings: DriveSettings, cluster: ClusterSettings, *, tell: Callable[[str], None]
) -> tuple[list[Manifest], list[OSError | ValueError]]:
    """Annotate videos that are not finished yet, and write the summary of all.

    Parameters
    ----------
    videos : sequence of Path
        At least one; no two of one name.
    settings : DriveSettings
    cluster : ClusterSettings
    tell : callable
        Called with sentences for people, as things happen.

    Returns
    -------
    (list of Manifest, list of OSError or ValueError)
        Of the finished drives, those of earlier runs included; why the others failed.

    Raises
    ------
    ClusterError
        If Dask is not installed, or no scheduler answers.
    OSError
        If the summary cannot be written.
    """
    jobs = [DriveJob.of(video, settings, cluster.piece_s) for video in videos]
    known = [read_finished(job.key, job.settings.output) for job in jobs]
    before = [manifest for manifest in known if manifest]
    if before:
        tell(f"{len(before)} of {len(jobs)} drives were finished before")
    outcomes = _annotate_left([job for job, manifest in zip(jobs, known, strict=True) if not manifest], cluster, tell)
    finished = before + [outcome for outcome in outcomes.values() if isinstance(outcome, Manifest)]
    failed = {job.video: outcome for job, outcome in outcomes.items() if isinstance(outcome, Exception)}
    table = write_summary(settings.output, finished, failed)
    tell(f"{describe_totals(finished, len(failed), len(before))}\nwrote {table}")
    return finished, list(failed.values())


def _annotate_left(
    jobs: Sequence[DriveJob], cluster: ClusterSettings, tell: Callable[[str], None]
) -> dict[DriveJob, Manifest | Exception]:
    """What came of each job; Dask is started only if there is one."""
    outcomes: dict[DriveJob, Manifest | Exception] = {}
    if not jobs:
        return outcomes
    try:
        with connect(cluster) as client, exclusive_writer(jobs[0].settings.output / SUMMARY):
            tell(f"{len(client.nthreads())} workers; dashboard: {client.dashboard_link}")
            for job, outcome in annotate_all(client, jobs, retries=cluster.retries):
                outcomes[job] = outcome
                if isinstance(outcome, Manifest):
                    tell(outcome.told)
    finally:
        # Workers elsewhere finish what they have begun even if this process is interrupted; ours are gone by now.
        if not cluster.scheduler:
            for job in jobs:
                if job not in outcomes:
                    job.remove_leftovers()
    return outcomes


@contextmanager
def connect(cluster: ClusterSettings) -> Iterator[Client]:
    """A client of the scheduler that is asked for, or of one on this machine with workers of its own.

    Raises
    ------
    ClusterError
        If Dask is not installed, or no scheduler answers.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ClusterError(
            "--workers and --scheduler need Dask, which is not installed; run "
            "`pip install -r requirements-cluster.txt`, or leave them out to annotate one drive after the other."
        ) from error
    if cluster.scheduler:
        try:
            client = Client(cluster.scheduler, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"{cluster.scheduler}: no Dask scheduler answers there ({error}); start one with `dask scheduler`, and "
                "name the address that it prints."
            ) from error
        with client:
            yield client
        return
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": cluster.retries}),
        LocalCluster(
            n_workers=cluster.workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            # Warnings of Dask are about workers that end or are started again: that is told where it costs a drive.
            silence_logs=logging.ERROR,
        ) as local,
        Client(local) as client,
    ):
        yield client


def annotate_all(
    client: Client, jobs: Sequence[DriveJob], *, retries: int = 2
) -> Iterator[tuple[DriveJob, Manifest | Exception]]:
    """Annotate drives, large files first; each comes back as soon as it is finished, or has failed for good.

    What a file or its settings make impossible fails at once. All else that goes wrong, such as a full disk, is tried
    again `retries` times, and so is what a worker was doing that died.
    """
    from distributed import as_completed

    begun = {
        client.submit(begin_drive, job, retries=retries, pure=False): job
        for job in sorted(jobs, key=lambda job: -job.key.size_bytes)
    }
    waiting = as_completed(begun)
    for future in waiting:
        job, outcome = begun.pop(future), _outcome(future)
        if isinstance(outcome, Plan):
            joined = _submit_pieces(client, job, outcome, retries)
            begun[joined] = job
            waiting.add(joined)
        else:
            yield job, _seen_here(job, outcome)


def _submit_pieces(client: Client, job: DriveJob, plan: Plan, retries: int) -> Future:
    """Before drives that were not begun yet, so that few are in pieces at the same time."""
    pieces = [
        client.submit(work_on_piece, job, plan.drive, piece, retries=retries, pure=False, priority=1)
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


def _seen_here(job: DriveJob, outcome: Manifest | Exception) -> Manifest | Exception:
    """The same, unless a worker wrote into a folder of its own."""
    if isinstance(outcome, Exception):
        name = str(job.video)
        return outcome if name in str(outcome) else ClusterError(f"{name}: {outcome}")
    missing = missing_outputs(outcome, job.settings.output)
    if not missing:
        return outcome
    return ClusterError(
        f"{job.video}: its worker wrote {', '.join(missing)}, but not into {job.settings.output} as seen from here; "
        "choose an output folder on storage that all workers share."
    )
