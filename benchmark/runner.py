"""The whole benchmark: every system on every drive, on several processes; finished estimates are cached.

drives -> PreparedDrive (rendered, camera with pose) -> DriveEstimates (cached in a file) -> Result (errors)
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from benchmark import estimates, evaluation, systems
from benchmark.errors import frame_errors
from benchmark.estimates import AHEAD_M, read_estimates, write_estimates
from benchmark.evaluation import BenchmarkDrive, PreparedDrive, prepare_drive, read_truth, run_systems
from benchmark.scores import Result
from benchmark.speed import describe_machine
from benchmark.systems import require_system, source_files
from lanes import images as frames
from lanes import video
from lanes.camera import camera_to_dict
from lanes.detect.markings import Markings
from lanes.files import hash_sources
from lanes.video import reader
from lanes.video.reader import inspect_video
from simulator.processes import run_all

Progress = Callable[[int, int], None]


def run_benchmark(
    drives: Sequence[BenchmarkDrive],
    systems: Sequence[str],
    *,
    workers: int = 1,
    estimated_pose: bool = False,
    markings: Markings | None = None,
    folder: Path | None = None,
    progress: Callable[[str], Progress] | None = None,
) -> list[Result]:
    """Results in the order of `drives`, then of `systems` (names in `systems.SYSTEMS`).

    `workers` processes run, with one OpenCV thread each. With `estimated_pose` the systems get the pose that is
    estimated from the video instead of the true one; the lens is always the true one. `markings` are those of tracker
    and detector (`lanes.detect.markings.MarkingModel`; None: our own). Finished estimates are cached in
    `folder` (default: a folder in the project's cache); an entry is used again while video, camera, machine and the
    sources of the system are unchanged. `progress`, called with the name of a part of the work, returns its callback
    (done, total). Raises ValueError if a system is unknown, or a video and its truth do not belong together.
    """
    for system in systems:
        require_system(system)
    from simulator.scenes.suite import cache_folder

    folder = folder or cache_folder() / "benchmark"
    report = progress or (lambda what: lambda done, total: None)
    prepare = partial(prepare_drive, estimated_pose=estimated_pose, markings=markings)
    prepared = run_all(prepare, drives, workers=workers, progress=report("scenes"))
    tasks = [(drive, system) for drive in prepared for system in systems]
    estimate = partial(cached_estimates, folder=folder, workers=workers)
    paths = run_all(estimate, tasks, workers=workers, progress=report("benchmark"))
    return [_result(drive, system, path) for (drive, system), path in zip(tasks, paths, strict=True)]


def cached_estimates(task: tuple[PreparedDrive, str], *, folder: Path, workers: int) -> Path:
    """The file with the estimates of a system for a drive; the system runs if there is no such file yet."""
    prepared, system = task
    label = system.replace("/", "-").replace(":", "-")  # an own finder is named file.py:function
    path = folder / f"{prepared.drive.label}-{label}-{_cache_key(prepared, system)}.npz"
    if not path.is_file():
        fps = inspect_video(prepared.drive.require_video()).fps
        metadata = {"workers": workers, "fps": fps, "machine": describe_machine()}
        write_estimates(path, run_systems(prepared, [(system, 1)])[0], **metadata)
    return path


def _result(prepared: PreparedDrive, system: str, path: Path) -> Result:
    estimates, metadata = read_estimates(path)
    drive = prepared.drive
    try:
        errors = frame_errors(estimates, read_truth(drive))
    except ValueError as error:
        raise ValueError(f"{drive.video}: {error}") from error
    return Result(drive.label, drive.difficulty, system, errors, prepared.pose, **metadata)


def _cache_key(prepared: PreparedDrive, system: str) -> str:
    """Digits that depend on everything that the estimates depend on."""
    modules = (estimates, evaluation, systems, frames, video, reader)
    sources = (Path(inspect.getfile(module)) for module in modules)
    files = hash_sources(prepared.drive.require_video(), *sources, *source_files(system))
    conditions = describe_machine(), AHEAD_M.tolist(), camera_to_dict(prepared.camera), prepared.markings
    return hashlib.sha256(repr((files, *conditions)).encode()).hexdigest()[:8]
