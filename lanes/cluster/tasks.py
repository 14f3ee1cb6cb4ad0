"""The tasks of a worker: inspect a drive, annotate it or a piece of it, join the pieces, write the manifest.

    begin_drive -> manifest                                  (a short drive is one task)
                -> run_piece ... -> finish_drive -> manifest (a long drive is cut, see `lanes.cluster.pieces`)

Tasks can be repeated: outputs get their final names when they are complete, and the manifest is written last. A task
returns an error that would occur again, such as an unusable file, instead of its result.
"""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from glob import escape
from pathlib import Path

from lanes.cluster.manifest import (
    KEY_DIGITS,
    DriveKey,
    Manifest,
    add_to_data_set,
    all_versions,
    read_finished,
    write_manifest,
)
from lanes.cluster.pieces import Piece, annotate_piece, cut_drive, join_pieces
from lanes.drives.annotation import PreparedDrive, annotate_prepared, output_path, prepare_drive
from lanes.drives.settings import DriveSettings
from lanes.io.files import remove_stale_partials
from lanes.io.threads import opencv_threads
from lanes.io.video.container import VideoError


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
