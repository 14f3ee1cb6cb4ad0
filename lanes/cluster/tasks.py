"""What a worker does for a drive: look into it, annotate it or a piece of it, join the pieces, write it down.

    begin_drive -> manifest                             (a drive of usual length is one task)
                -> work_on_piece ... -> finish_drive -> manifest    (a long one is cut, see `lanes.cluster.pieces`)

Nothing here knows who calls. Outputs get their names when they are whole and the manifest comes last, so that it does
not matter how often a task was begun, and by whom.
"""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path
from typing import TypeVar

from lanes.cluster.manifest import DIGITS, DriveKey, Manifest, all_versions, read_finished, write_manifest
from lanes.cluster.pieces import Piece, annotate_piece, cut_drive, join_pieces
from lanes.cluster.summary import add_to_data_set
from lanes.drives.annotation import PreparedDrive, follow_drive, output_for, prepare_drive
from lanes.drives.settings import DriveSettings
from lanes.io.files import remove_stale_partials
from lanes.io.threads import one_thread
from lanes.io.video.container import VideoError

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class DriveJob:
    """A drive to be annotated, as sent to a worker."""

    key: DriveKey
    settings: DriveSettings

    @classmethod
    def of(cls, video: Path, settings: DriveSettings, piece_s: float) -> DriveJob:
        """The job for a drive as it is now, by absolute paths: workers may have other working directories."""
        settings = replace(settings, output=settings.output.absolute(), progress=False, overlapped=False)
        return cls(DriveKey.of(video.absolute(), settings, piece_s), settings)

    @property
    def video(self) -> Path:
        """The drive's file."""
        return Path(self.key.source)

    @property
    def folder(self) -> Path:
        """Where its pieces wait; those of another input, or of other settings, are elsewhere."""
        target = output_for(self.video, self.settings.output)
        return target.with_name(f"{target.stem}.pieces.{self.key.digits()}")

    def remove_leftovers(self) -> None:
        """Remove what killed runs left of it: half-written files, and pieces that fit no more."""
        target = output_for(self.video, self.settings.output)
        remove_stale_partials(target)
        digits = "[0-9a-f]" * DIGITS
        for path in target.parent.glob(f"{escape(target.stem)}.pieces.{digits}"):
            if path != self.folder:
                shutil.rmtree(path, ignore_errors=True)


@dataclass(frozen=True, eq=False)
class Plan:
    """A long drive, looked into and cut; `cpu_s` is what that took."""

    drive: PreparedDrive
    pieces: tuple[Piece, ...]
    cpu_s: float


@dataclass(frozen=True)
class PieceDone:
    """What a piece took: processor time and time by the clock."""

    cpu_s: float
    elapsed_s: float


def begin_drive(job: DriveJob) -> Manifest | Plan | Exception:
    """Annotate a drive; if it is long, only look into it and cut it."""

    def work() -> Manifest | Plan:
        # The worker that finished it may have died before it could tell.
        if finished := read_finished(job.key, job.settings.output):
            return finished
        job.remove_leftovers()
        began_s = time.process_time()
        drive = prepare_drive(job.video, job.settings)
        pieces = cut_drive(drive, job.settings, job.key.settings["piece_s"])
        if len(pieces) > 1:
            return Plan(drive, pieces, time.process_time() - began_s)
        result = follow_drive(drive, job.settings)
        add_to_data_set(result.telemetry, job.settings.output)
        return write_manifest(job.key, result, cpu_s=time.process_time() - began_s, pieces=1)

    return _settle(work, job)


def work_on_piece(job: DriveJob, drive: PreparedDrive, piece: Piece) -> PieceDone | Exception:
    """Annotate one piece of a long drive."""

    def work() -> PieceDone:
        began_s = time.process_time()
        elapsed_s = annotate_piece(drive, piece, job.settings, job.folder)
        return PieceDone(time.process_time() - began_s, elapsed_s)

    return _settle(work, job)


def finish_drive(job: DriveJob, plan: Plan, done: Sequence[PieceDone | Exception]) -> Manifest | Exception:
    """Join the pieces of a long drive."""

    def work() -> Manifest:
        if finished := read_finished(job.key, job.settings.output):
            return finished
        began_s = time.process_time()
        try:
            elapsed_s = sum(piece.elapsed_s for piece in done)
            result = join_pieces(plan.drive, plan.pieces, job.settings, job.folder, elapsed_s)
        except VideoError:
            # The next run shall not find the same damaged piece.
            shutil.rmtree(job.folder, ignore_errors=True)
            raise
        add_to_data_set(result.telemetry, job.settings.output)
        cpu_s = plan.cpu_s + sum(piece.cpu_s for piece in done) + time.process_time() - began_s
        manifest = write_manifest(job.key, result, cpu_s=cpu_s, pieces=len(done))
        shutil.rmtree(job.folder)
        return manifest

    failed = next((outcome for outcome in done if isinstance(outcome, Exception)), None)
    return failed or _settle(work, job)


def _settle(work: Callable[[], Result], job: DriveJob) -> Result | Exception:
    """What `work` returns, or the error if trying again would be of no use; other errors are raised, for Dask."""
    try:
        _require_same(all_versions(), job.key.versions)
        with one_thread():
            return work()
    except FileNotFoundError as error:
        here = f"worker on {platform.node()} in {os.getcwd()}"
        return FileNotFoundError(f"{error} ({here}; all workers must see the drives by the same path)")
    except ValueError as error:
        return error


def _require_same(here: Mapping[str, str], wanted: Mapping[str, str]) -> None:
    differing = [
        f"{name} {here.get(name)} instead of {version}" for name, version in wanted.items() if here.get(name) != version
    ]
    if differing:
        raise ValueError(
            f"the worker on {platform.node()} has {', '.join(differing)}, so that its results would differ; install "
            "the same on all machines."
        )
