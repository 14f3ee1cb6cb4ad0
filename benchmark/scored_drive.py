"""A drive that systems are scored on: a video with its truth and its camera."""

from __future__ import annotations

from dataclasses import dataclass
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
