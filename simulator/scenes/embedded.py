"""Writes the committed stills and videos with their ground truth."""

from __future__ import annotations

from pathlib import Path

from lanes.images import write_image
from simulator.processes import available_workers, run_all
from simulator.rendering.render import render_frame
from simulator.rendering.video import VIDEO_CRF, VIDEO_SECONDS, Progress, write_video
from simulator.road.truth import truth_entry, write_truth_json
from simulator.scenes.challenge import CHALLENGE_CRF, HARDER_CRF, challenge_video, harder_challenge_video
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.project_video import project_video
from simulator.scenes.stills import still_scenes

# Committed videos by name: drive, length in seconds, and constant rate factor of x264.
VIDEOS = {
    "project_video": (project_video, VIDEO_SECONDS, VIDEO_CRF),
    "challenge_video": (challenge_video, 9.0, CHALLENGE_CRF),
    "harder_challenge_video": (harder_challenge_video, 10.0, HARDER_CRF),
}


def write_stills(folder: str | Path, *, progress: Progress | None = None, workers: int | None = None) -> list[Path]:
    """Files written: the eight stills and their truth.json, in a folder that is created where needed.

    `progress` is called as progress(pictures done, number of pictures). `workers` is the number of processes (default:
    one for each available CPU) and does not change the files.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """
    folder = Path(folder)
    scenes = still_scenes()
    frames = run_all(render_frame, list(scenes.values()), workers=workers or available_workers(), progress=progress)
    written, entries = [], []
    for (name, drive), frame in zip(scenes.items(), frames, strict=True):
        path = write_image(folder / f"{name}.jpg", frame.image)
        raw_file, camera = f"{folder.name}/{path.name}", drive.camera_at(0.0)
        entries.append(truth_entry(frame.truth, raw_file=raw_file, camera=camera, hidden=frame.hidden))
        written.append(path)
    write_truth_json(folder / "truth.json", DASHCAM, entries)
    return [*written, folder / "truth.json"]


def write_course_video(
    folder: str | Path, name: str, *, seconds: float = VIDEO_SECONDS, progress: Progress | None = None
) -> list[Path]:
    """Write a video of VIDEOS with its truth and camera into a folder, `seconds` at most; see `write_video`."""
    drive, length_s, crf = VIDEOS[name]
    path = Path(folder) / f"{name}.mp4"
    return write_video(path, drive=drive(), seconds=min(seconds, length_s), crf=crf, progress=progress)
