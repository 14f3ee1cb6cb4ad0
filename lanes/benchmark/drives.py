"""The drives that systems are scored on: the scenes of the suite, and videos with their truth and camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from lanes.dataset import PROJECT_ROOT
from lanes.scenes.suite import SUITE, render_scene

# Scenes of the suite whose videos are committed: these are scored, as a student has them.
COMMITTED = {
    "motorway": "project_video.mp4",
    "challenge": "challenge_video.mp4",
    "harder-challenge": "harder_challenge_video.mp4",
}
NO_LANE = "no lane"


@dataclass(frozen=True)
class BenchmarkDrive:
    """A video with its truth (.csv) and camera (.yaml) beside it; `video` is None where it is yet to be rendered."""

    name: str
    difficulty: str
    what: str
    video: Path | None

    def at_hand(
        self, progress: Callable[[int, int], None] | None = None, *, workers: int | None = None
    ) -> BenchmarkDrive:
        """The same with its video, rendered into the cache if it has none, by so many processes."""
        if self.video is not None:
            return self
        path = render_scene(self.name, progress=progress, workers=workers)
        return BenchmarkDrive(self.name, self.difficulty, self.what, path)


def list_drives() -> dict[str, BenchmarkDrive]:
    """All scenes of the suite by name."""
    drives = {}
    for name, scene in SUITE.items():
        committed = PROJECT_ROOT / "test_videos" / COMMITTED.get(name, "")
        drives[name] = BenchmarkDrive(name, scene.difficulty, scene.what, committed if committed.is_file() else None)
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
    return [known[name] if name in known else _own_drive(name, known) for name in names or known]


def _own_drive(name: str, known: dict[str, BenchmarkDrive]) -> BenchmarkDrive:
    video = Path(name)
    if not video.suffix:
        raise ValueError(f"there is no scene {name!r}; give a video file, or one of {', '.join(known)}.")
    for file, what in ((video, "video"), (video.with_suffix(".csv"), "truth"), (video.with_suffix(".yaml"), "camera")):
        if not file.is_file():
            raise FileNotFoundError(
                f"{file}: there is no such {what}; a drive is a video with .csv and .yaml beside it."
            )
    difficulty = known[video.stem].difficulty if video.stem in known else "own"
    return BenchmarkDrive(video.stem, difficulty, f"{video}", video)
