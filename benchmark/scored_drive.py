"""The drives of the benchmark: the scenes of the suite, and other videos with their truth and their camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

# The project's top folder, with the committed videos in test_videos/.
PROJECT_ROOT = Path(__file__).resolve().parents[1]
# Scenes of the suite with a committed video. It is scored instead of a new rendering, as everybody has it.
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
    """A video with its truth (.csv) and camera (.yaml) next to it; `video` is None until it is rendered.

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
        """The video; raises FileNotFoundError if the scene is not rendered yet."""
        if self.video is None:
            raise FileNotFoundError(f"scene {self.name} is not rendered yet; call ensure_video first.")
        return self.video


def drive_from_video(video: str | Path, *, difficulty: str = CUSTOM) -> BenchmarkDrive:
    """The drive of a video file with its truth (.csv) and camera (.yaml) next to it.

    Raises
    ------
    FileNotFoundError
        If the video, its truth or its camera is missing.
    """
    video = Path(video)
    for file, what in ((video, "video"), (video.with_suffix(".csv"), "truth"), (video.with_suffix(".yaml"), "camera")):
        if not file.is_file():
            raise FileNotFoundError(
                f"{file}: there is no such {what} file; a drive is a video with its .csv and .yaml next to it."
            )
    return BenchmarkDrive(video.stem, difficulty, f"{video}", video)


def list_drives(*, seed: int = 0) -> dict[str, BenchmarkDrive]:
    """All scenes of the suite by name, or variant number `seed` of each."""
    # here and in `ensure_video`, because own videos are scored without the renderer
    from simulator.scenes.suite import SUITE

    drives = {}
    for name, scene in SUITE.items():
        committed = PROJECT_ROOT / "test_videos" / COMMITTED.get(name, "")
        video = committed if committed.is_file() and not seed else None
        drives[name] = BenchmarkDrive(name, scene.difficulty, scene.description, video, seed)
    return drives


def choose_drives(names: list[str], *, seed: int = 0) -> list[BenchmarkDrive]:
    """Drives by scene name or video path; all scenes if the list is empty.

    A video with the name of a scene gets the difficulty of that scene. `seed` is the number of the variant of each
    scene. Raises ValueError if a name is neither a scene nor a video, and FileNotFoundError as `drive_from_video`.
    """
    known = list_drives(seed=seed)
    return [known[name] if name in known else _video_drive(name, known) for name in names or known]


def ensure_video(drive: BenchmarkDrive, *, workers: int | None = None) -> BenchmarkDrive:
    """The drive with its video; a missing one is rendered into the cache by `workers` processes."""
    from simulator.scenes.suite import render_scene

    return drive if drive.video else replace(drive, video=render_scene(drive.name, seed=drive.seed, workers=workers))


def _video_drive(name: str, known: dict[str, BenchmarkDrive]) -> BenchmarkDrive:
    stem, suffix = Path(name).stem, Path(name).suffix
    if not suffix:
        raise ValueError(f"there is no scene {name!r}; give a video file, or one of {', '.join(known)}.")
    return drive_from_video(name, difficulty=known[stem].difficulty if stem in known else CUSTOM)
