"""Run every system over every drive, several at a time; what is finished is kept, so that a broken-off run goes on.

drives -> stage (render, take or estimate the pose) -> measure (follow all frames, keep) -> Result (against truth)
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from benchmark import estimates, systems
from benchmark.errors import frame_errors
from benchmark.estimates import read_readings, write_readings
from benchmark.evaluation import Staged, follow_drive, stage, true_lane
from benchmark.machine import describe_machine
from benchmark.scored_drive import BenchmarkDrive
from benchmark.scores import Result
from benchmark.suite_drives import with_video
from benchmark.systems import SOURCES, require_system
from lanes.camera.camera_file import camera_to_dict
from lanes.io.disk_cache import cache_folder
from lanes.io.processes import run_all
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
    prepare = partial(_prepare, estimated_pose=estimated_pose)
    prepared = run_all(prepare, drives, workers=workers, progress=report("scenes"))
    tasks = [(drive, system) for drive in prepared for system in systems]
    measure = partial(_measure, folder=folder, workers=workers)
    paths = run_all(measure, tasks, workers=workers, progress=report("benchmark"))
    return [_result(drive, system, path) for (drive, system), path in zip(tasks, paths, strict=True)]


def _prepare(drive: BenchmarkDrive, *, estimated_pose: bool) -> Staged:
    """Render the drive where needed, and read or estimate its camera pose."""
    # The scenes are already spread over the processes.
    return stage(with_video(drive, workers=1), estimated_pose=estimated_pose)


def _measure(task: tuple[Staged, str], *, folder: Path, workers: int) -> Path:
    return measure(*task, folder, workers)


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


def _key(staged: Staged, system: str) -> str:
    """Twelve digits that change with all that the readings depend on."""
    digest = hashlib.sha256(staged.drive.video.read_bytes())
    digest.update(f"{describe_machine()} {staged.camera and camera_to_dict(staged.camera)}".encode())
    own = [Path(module.__file__) for module in (estimates, systems)]
    for source in (*own, *SOURCES[system]):
        for file in sorted(source.rglob("*.py")) if source.is_dir() else [source]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
