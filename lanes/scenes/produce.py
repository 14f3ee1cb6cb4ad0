"""Render the course's pictures and video into files, each with its truth."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import imageio_ffmpeg

from lanes.camera import save_camera
from lanes.images import whole_file, write_image
from lanes.scenes.catalogue import VIDEO_FPS, VIDEO_SECONDS, project_video, still_scenes
from lanes.scenes.render import Drive, render_frame
from lanes.scenes.truth import truth_entry, truth_row, write_truth_csv, write_truth_json

Progress = Callable[[int, int], None]

# One encoder thread: with more, x264 cuts the picture differently and the bytes depend on the machine.
# crf 21 keeps the texture of asphalt at about 6 Mbit/s; faststart lets browsers play while loading.
ENCODER = ["-crf", "21", "-preset", "slow", "-threads", "1", "-movflags", "+faststart", "-bitexact"]


def write_stills(folder: str | Path, *, progress: Progress | None = None) -> list[Path]:
    """Write the eight test pictures and their truth.json.

    Parameters
    ----------
    folder : str or Path
        Created where needed; "test_images" in the project.
    progress : callable, optional
        Called as progress(pictures done, pictures in all).

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    OSError
        If the folder cannot be written to.
    """
    folder = Path(folder)
    scenes = still_scenes()
    written, entries = [], []
    for number, (name, drive) in enumerate(scenes.items(), 1):
        frame = render_frame(drive)
        path = write_image(folder / f"{name}.jpg", frame.image)
        raw_file = f"{folder.name}/{path.name}"
        entries.append(truth_entry(frame.truth, raw_file=raw_file, camera=drive.camera_at(0.0), hidden=frame.hidden))
        written.append(path)
        if progress:
            progress(number, len(scenes))
    camera = next(iter(scenes.values())).camera
    write_truth_json(folder / "truth.json", camera, entries)
    return [*written, folder / "truth.json"]


def write_video(
    path: str | Path,
    *,
    drive: Drive | None = None,
    seconds: float = VIDEO_SECONDS,
    progress: Progress | None = None,
) -> list[Path]:
    """Write a drive as H.264 video, with a CSV of its truth (a row a frame) and its camera beside it.

    Parameters
    ----------
    path : str or Path
        Ends in .mp4; the other two get the same stem.
    drive : Drive, optional
        The project video's by default.
    seconds : float
    progress : callable, optional
        Called as progress(frames done, frames in all).

    Returns
    -------
    list of Path
        Video, CSV, camera.

    Raises
    ------
    OSError
        If the folder cannot be written to or the encoder fails.
    """
    path, drive = Path(path), drive or project_video()
    count = round(seconds * VIDEO_FPS)
    with whole_file(path) as partial:
        rows = _encode(partial, drive, count, progress)
    write_truth_csv(path.with_suffix(".csv"), rows)
    save_camera(drive.camera, path.with_suffix(".yaml"))
    return [path, path.with_suffix(".csv"), path.with_suffix(".yaml")]


def _encode(path: Path, drive: Drive, count: int, progress: Progress | None) -> list[dict]:
    """Render and encode `count` frames; the truth's rows."""
    writer = imageio_ffmpeg.write_frames(
        str(path),
        drive.camera.size,
        fps=VIDEO_FPS,
        codec="libx264",
        quality=None,
        macro_block_size=1,
        output_params=ENCODER,
    )
    rows = []
    with closing(writer):
        writer.send(None)
        for number in range(count):
            frame = render_frame(drive, number / VIDEO_FPS)
            writer.send(frame.image.tobytes())
            rows.append(truth_row(frame.truth, frame=number))
            if progress:
                progress(number + 1, count)
    return rows
