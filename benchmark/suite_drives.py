"""The drives that systems are scored on: the scenes of the suite, and videos with their truth and camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmark.dataset import PROJECT_ROOT
from benchmark.scored_drive import BenchmarkDrive, own_drive
from simulator.scenes.suite import SUITE, render_scene

# Scenes of the suite whose videos are committed: these are scored, as a student has them.
COMMITTED = {
    "motorway": "project_video.mp4",
    "challenge": "challenge_video.mp4",
    "harder-challenge": "harder_challenge_video.mp4",
}


def list_drives() -> dict[str, BenchmarkDrive]:
    """All scenes of the suite by name."""
    drives = {}
    for name, scene in SUITE.items():
        committed = PROJECT_ROOT / "test_videos" / COMMITTED.get(name, "")
        drives[name] = BenchmarkDrive(
            name, scene.difficulty, scene.description, committed if committed.is_file() else None
        )
    return drives


def choose_drives(names: list[str]) -> list[BenchmarkDrive]:
    """Drives by name, all if none is named; a name may also be that of a video with .csv and .yaml beside it.

    A video that is called like a scene is one of its difficulty.

    Raises
    ------
    FileNotFoundError
        If a video is not there, or lacks its truth or its camera.
    ValueError
        If a name is neither.
    """
    known = list_drives()
    return [known[name] if name in known else _video_drive(name, known) for name in names or known]


def with_video(drive: BenchmarkDrive, *, workers: int | None = None) -> BenchmarkDrive:
    """The drive with its video, which is rendered into the cache by `workers` processes if there is none."""
    return drive if drive.video else replace(drive, video=render_scene(drive.name, workers=workers))


def _video_drive(name: str, known: dict[str, BenchmarkDrive]) -> BenchmarkDrive:
    stem, suffix = Path(name).stem, Path(name).suffix
    if not suffix:
        raise ValueError(f"there is no scene {name!r}; give a video file, or one of {', '.join(known)}.")
    return own_drive(name, difficulty=known[stem].difficulty if stem in known else "own")
