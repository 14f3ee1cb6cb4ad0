"""The drives of the benchmark: the scenes of the suite, and other videos with truth and camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmark.scored_drive import COMMITTED, CUSTOM, PROJECT_ROOT, BenchmarkDrive, drive_from_video
from simulator.scenes.suite import SUITE, render_scene


def list_drives(*, seed: int = 0) -> dict[str, BenchmarkDrive]:
    """All scenes of the suite by name, or variant number `seed` of each."""
    drives = {}
    for name, scene in SUITE.items():
        committed = PROJECT_ROOT / "test_videos" / COMMITTED.get(name, "")
        video = committed if committed.is_file() and not seed else None
        drives[name] = BenchmarkDrive(name, scene.difficulty, scene.description, video, seed)
    return drives


def choose_drives(names: list[str], *, seed: int = 0) -> list[BenchmarkDrive]:
    """Drives by scene name or video path; all scenes if the list is empty.

    A video with the name of a scene gets the difficulty of that scene. `seed` is the number of the variant of each
    scene (`simulator.scenes.suite.render_scene`).

    Raises
    ------
    FileNotFoundError
        If a video, its truth (.csv) or its camera (.yaml) is missing.
    ValueError
        If a name is neither a scene nor a video.
    """
    known = list_drives(seed=seed)
    return [known[name] if name in known else _video_drive(name, known) for name in names or known]


def ensure_video(drive: BenchmarkDrive, *, workers: int | None = None) -> BenchmarkDrive:
    """The drive with its video; a missing one is rendered into the cache by `workers` processes."""
    return drive if drive.video else replace(drive, video=render_scene(drive.name, seed=drive.seed, workers=workers))


def _video_drive(name: str, known: dict[str, BenchmarkDrive]) -> BenchmarkDrive:
    stem, suffix = Path(name).stem, Path(name).suffix
    if not suffix:
        raise ValueError(f"there is no scene {name!r}; give a video file, or one of {', '.join(known)}.")
    return drive_from_video(name, difficulty=known[stem].difficulty if stem in known else CUSTOM)
