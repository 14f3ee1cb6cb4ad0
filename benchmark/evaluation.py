"""Drives with known truth (scenes of the suite, and other videos), and the evaluation
of systems on them.

drives -> PreparedDrive (rendered, camera with pose) -> DriveEstimates (cached in a
file) -> Result (errors)
"""

from __future__ import annotations

import hashlib
import inspect
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmark import estimates, systems
from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import (
    AHEAD_M,
    DriveEstimates,
    LaneEstimate,
    read_estimates,
    write_estimates,
)
from benchmark.scores import Result, Row, score_rows
from benchmark.speed import describe_machine
from benchmark.systems import OwnFinder, require_system, source_files, start_system
from lanes import recording
from lanes.camera.model import Camera, camera_to_dict, load_camera
from lanes.detect.markings import Markings
from lanes.files import hash_sources, read_telemetry
from lanes.pose.estimate import estimate_pose
from lanes.tracking.tracker import TrackerSettings
from lanes.video import images, reader
from lanes.video.reader import TimedFrame, inspect_video, read_timed_frames
from simulator.processes import run_all

# The project's top folder, with the committed videos in test_videos/.
PROJECT_ROOT = Path(__file__).resolve().parents[1]
# Scenes of the suite with a committed video. It is scored instead of a new rendering,
# as everybody has it.
COMMITTED = {
    "motorway": "project_video.mp4",
    "challenge": "challenge_video.mp4",
    "harder-challenge": "harder_challenge_video.mp4",
}
NO_LANE = "no lane"
# Difficulty of a video that is not a scene of the suite.
CUSTOM = "custom"


@dataclass(frozen=True)
class BenchmarkDrive:
    """A video with its truth (.csv) and camera (.yaml) next to it.

    `video` is None until it is rendered.

    `seed` is the number of a scene's variant; 0 is the scene itself.
    """

    name: str
    difficulty: str
    description: str
    video: Path | None
    seed: int = 0

    @property
    def label(self) -> str:
        """The name in tables; it includes the number of a variant."""
        return f"{self.name}-{self.seed}" if self.seed else self.name

    def require_video(self) -> Path:
        """The video; a missing one is rendered into the cache."""
        if self.video:
            return self.video
        from simulator.scenes.suite import render_scene

        # by one process, because the drives of a run are spread over the workers
        return render_scene(self.name, seed=self.seed, workers=1)


def drive_from_video(video: str | Path, *, difficulty: str = CUSTOM) -> BenchmarkDrive:
    """The drive of a video file with its truth (.csv) and camera (.yaml) next to it.

    Raises FileNotFoundError if the video, its truth or its camera is missing.
    """
    video = Path(video)
    files = {
        "video": video,
        "truth": video.with_suffix(".csv"),
        "camera": video.with_suffix(".yaml"),
    }
    for content, file in files.items():
        if not file.is_file():
            raise FileNotFoundError(
                f"{file}: there is no such {content} file; a drive is a video with its "
                ".csv and .yaml next to it."
            )
    return BenchmarkDrive(video.stem, difficulty, f"{video}", video)


def list_drives(*, seed: int = 0) -> dict[str, BenchmarkDrive]:
    """All scenes of the suite by name, or variant number `seed` of each."""
    # here and in `require_video`, because own videos are scored without the renderer
    from simulator.scenes.suite import SUITE

    drives = {}
    for name, scene in SUITE.items():
        video = None
        if name in COMMITTED and not seed:
            committed = PROJECT_ROOT / "test_videos" / COMMITTED[name]
            if committed.is_file():
                video = committed
        drives[name] = BenchmarkDrive(
            name=name,
            difficulty=scene.difficulty,
            description=scene.description,
            video=video,
            seed=seed,
        )
    return drives


def choose_drives(names: list[str], *, seed: int = 0) -> list[BenchmarkDrive]:
    """Drives by scene name or video path; all scenes if the list is empty.

    A video with the name of a scene gets the difficulty of that scene. `seed` is the
    number of the variant of each scene. Raises ValueError if a name is neither a scene
    nor a video, and FileNotFoundError as `drive_from_video`.
    """
    known = list_drives(seed=seed)
    if not names:
        return list(known.values())
    return [_choose_drive(name, known) for name in names]


def _choose_drive(name: str, known: dict[str, BenchmarkDrive]) -> BenchmarkDrive:
    if name in known:
        return known[name]
    video = Path(name)
    if not video.suffix:
        raise ValueError(
            f"there is no scene {name!r}; give a video file, or one of "
            f"{', '.join(known)}."
        )
    scene = known.get(video.stem)
    return drive_from_video(video, difficulty=scene.difficulty if scene else CUSTOM)


@dataclass(frozen=True)
class PreparedDrive:
    """A drive with a video, and the camera for the systems with the pose, and where
    this is from.

    `markings` are those of the tracker and the detector, see `lanes.find_lane`; None:
    our own.
    """

    drive: BenchmarkDrive
    camera: Camera
    pose: str
    markings: Markings | None = None


def prepare_drive(
    drive: BenchmarkDrive,
    *,
    estimated_pose: bool = False,
    markings: Markings | None = None,
) -> PreparedDrive:
    """The drive, rendered if needed, and its camera with the true pose, or with one
    estimated from the video.
    """
    video = drive.require_video()
    camera = load_camera(video.with_suffix(".yaml"))
    pose = "true"
    if estimated_pose:
        camera = estimate_pose(video, camera, markings=markings).camera
        pose = "estimated"
    return PreparedDrive(replace(drive, video=video), camera, pose, markings)


class _Running:
    """A system that runs on each `every`-th frame of a drive."""

    def __init__(
        self,
        system: str | OwnFinder,
        every: int,
        prepared: PreparedDrive,
        fps: float,
        settings: TrackerSettings | None,
    ) -> None:
        self.every = every
        self.find, self.to_estimate = start_system(
            system,
            prepared.camera,
            fps / every,
            settings=settings,
            markings=prepared.markings,
        )
        self.last_s: float | None = None
        self.estimates: list[LaneEstimate] = []
        self.time_ms: list[float] = []

    def see(self, frame: TimedFrame) -> None:
        """Add the estimate for a frame, and the time that it took."""
        elapsed_s = None
        if self.last_s is not None:
            elapsed_s = frame.time_s - self.last_s
        self.last_s = frame.time_s

        start = time.perf_counter()
        found = self.find(frame.image, elapsed_s)
        self.time_ms.append(1000 * (time.perf_counter() - start))
        self.estimates.append(self.to_estimate(found))


def run_systems(
    prepared: PreparedDrive,
    systems: Sequence[tuple[str | OwnFinder, int]],
    *,
    end_s: float | None = None,
    settings: TrackerSettings | None = None,
) -> list[DriveEstimates]:
    """Estimates of systems for each `every`-th frame of a drive before `end_s`.

    `systems` are pairs (system, every); the video is decoded once. `settings` are those
    of the tracker.
    """
    video = prepared.drive.require_video()
    fps = inspect_video(video).fps
    running = [
        _Running(system, every, prepared, fps, settings) for system, every in systems
    ]
    for number, frame in enumerate(read_timed_frames(video, end_s=end_s)):
        for one in running:
            if number % one.every == 0:
                one.see(frame)
    return [DriveEstimates.from_frames(one.estimates, one.time_ms) for one in running]


def score_video(
    video: str | Path, system: str | OwnFinder, *, end_s: float | None = None
) -> Row:
    """Score a system of `SYSTEMS`, or a finder of one's own, on a video: a row of the
    benchmark's table.

    All frames up to the time `end_s` count. The truth (.csv) and the camera with pose
    (.yaml) are next to the video. Raises ValueError if the system is unknown, or video
    and truth do not belong together.
    """
    name = system.__name__ if callable(system) else system
    (row,) = score_systems(video, {name: (system, 1)}, end_s=end_s)
    return row


def score_systems(
    video: str | Path,
    systems: Mapping[str, tuple[str | OwnFinder, int]],
    *,
    end_s: float | None = None,
) -> list[Row]:
    """`score_video` for several systems, pairs (system, every) by name.

    Each sees each `every`-th frame; the video is decoded once. A system with a memory
    needs every frame.
    """
    for system, _ in systems.values():
        if not callable(system):
            require_system(system)
    drive = drive_from_video(video)
    found = run_systems(prepare_drive(drive), list(systems.values()), end_s=end_s)
    truth = read_truth(drive)
    fps = inspect_video(video).fps

    rows = []
    for (name, (_, every)), lanes in zip(systems.items(), found, strict=True):
        frames = slice(0, len(lanes.offset_m) * every, every)
        errors = frame_errors(lanes, truth.select(frames))
        result = Result(drive.name, drive.difficulty, name, errors, fps=fps / every)
        # each alone: only systems on the same frames can be compared
        row, _ = score_rows([result])
        rows.append(row)
    return rows


def read_truth(drive: BenchmarkDrive) -> LaneTruth:
    """The true lane in the frames of a drive.

    NaN in all frames of a scene without a lane.
    """
    path = drive.require_video().with_suffix(".csv")
    columns = read_telemetry(path)
    try:
        truth = LaneTruth.from_columns(columns)
    except KeyError as error:
        raise ValueError(
            f"{path}: lacks the column {error}; use the truth that was written with "
            "the video."
        ) from error
    except ValueError as error:
        raise ValueError(
            f"{path}: is not a truth file ({error}); use the one written with the "
            "video."
        ) from error
    if drive.difficulty == NO_LANE:
        nothing = np.full_like(truth.lines_y_m, np.nan)
        truth = replace(truth, lines_y_m=nothing)
    return truth


def run_benchmark(
    drives: Sequence[BenchmarkDrive],
    systems: Sequence[str],
    *,
    workers: int = 1,
    estimated_pose: bool = False,
    markings: Markings | None = None,
    folder: Path | None = None,
    progress: Callable[[str], Callable[[int, int], None]] | None = None,
) -> list[Result]:
    """Results in the order of `drives`, then of `systems` (names in `systems.SYSTEMS`).

    `workers` processes run, with one OpenCV thread each. With `estimated_pose` the
    systems get the pose that is estimated from the video instead of the true one; the
    lens is always the true one. `markings` are those of tracker and detector
    (`lanes.detect.markings.MarkingSource`; None: our own). Finished estimates are
    cached in `folder` (default: a folder in the project's cache); an entry is used
    again while video, camera, machine and the sources of the system are unchanged.
    `progress`, called with the name of a part of the work, returns its callback (done,
    total). Raises ValueError if a system is unknown, or a video and its truth do not
    belong together.
    """
    for system in systems:
        require_system(system)
    from simulator.scenes.suite import cache_folder

    prepared = run_all(
        partial(prepare_drive, estimated_pose=estimated_pose, markings=markings),
        drives,
        workers=workers,
        progress=progress("scenes") if progress else None,
    )
    tasks = [(drive, system) for drive in prepared for system in systems]
    folder = folder or cache_folder() / "benchmark"
    paths = run_all(
        partial(cached_estimates, folder=folder, workers=workers),
        tasks,
        workers=workers,
        progress=progress("benchmark") if progress else None,
    )
    results = []
    for (drive, system), path in zip(tasks, paths, strict=True):
        results.append(_result(drive, system, path))
    return results


def cached_estimates(
    task: tuple[PreparedDrive, str], *, folder: Path, workers: int
) -> Path:
    """The file with the estimates of a system for a drive.

    The system runs if there is no such file yet.
    """
    prepared, system = task
    drive = prepared.drive
    # an own finder is named file.py:function
    name = system.replace("/", "-").replace(":", "-")
    path = folder / f"{drive.label}-{name}-{_cache_key(prepared, system)}.npz"
    if not path.is_file():
        (estimates,) = run_systems(prepared, [(system, 1)])
        write_estimates(
            path,
            estimates,
            workers=workers,
            fps=inspect_video(drive.require_video()).fps,
            machine=describe_machine(),
        )
    return path


def _result(prepared: PreparedDrive, system: str, path: Path) -> Result:
    estimates, metadata = read_estimates(path)
    drive = prepared.drive
    try:
        errors = frame_errors(estimates, read_truth(drive))
    except ValueError as error:
        raise ValueError(f"{drive.video}: {error}") from error
    return Result(
        drive.label, drive.difficulty, system, errors, prepared.pose, **metadata
    )


def _cache_key(prepared: PreparedDrive, system: str) -> str:
    """Digits that depend on everything that the estimates depend on."""
    modules = (estimates, systems, images, recording, reader)
    files = hash_sources(
        prepared.drive.require_video(),
        Path(__file__),
        *(Path(inspect.getfile(module)) for module in modules),
        *source_files(system),
    )
    conditions = (
        files,
        describe_machine(),
        AHEAD_M.tolist(),
        camera_to_dict(prepared.camera),
        prepared.markings,
    )
    return hashlib.sha256(repr(conditions).encode()).hexdigest()[:8]
