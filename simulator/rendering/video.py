"""Render the course's pictures and video into files, each with its truth."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path

from lanes.camera.camera_file import save_camera
from lanes.io.files import atomic_write
from lanes.io.processes import map_ordered
from lanes.io.video.reader import inspect_video
from simulator.rendering.drive import Drive
from simulator.rendering.render import render_frame
from simulator.rendering.shared_assets import asset_jobs
from simulator.road.truth import Truth, truth_row, write_truth_csv

Progress = Callable[[int, int], None]

# 21 keeps the texture of asphalt at about 6 Mbit/s.
VIDEO_CRF = 21
# What is committed is worth 0.08 s a frame to be small.
VIDEO_PRESET = "slow"
# One encoder thread: with more, x264 cuts the picture differently and the bytes depend on the machine.
# faststart lets browsers play while loading.
ENCODER = ["-threads", "1", "-movflags", "+faststart", "-bitexact"]

VIDEO_SECONDS = 10.0
VIDEO_FPS = 25


def write_video(
    path: str | Path,
    *,
    drive: Drive,
    seconds: float = VIDEO_SECONDS,
    crf: int = VIDEO_CRF,
    preset: str = VIDEO_PRESET,
    progress: Progress | None = None,
    workers: int | None = None,
) -> list[Path]:
    """Write a drive as H.264 video, with a CSV of its truth (a row a frame) and its camera beside it.

    Parameters
    ----------
    path : str or Path
        Ends in .mp4; the other two get the same stem.
    drive : Drive
    seconds : float
    crf : int
        Quality of the encoder, lower is better and larger.
    preset : str
        How long the encoder (x264) may think to make the file smaller: "ultrafast" to "placebo".
    progress : callable, optional
        Called as progress(frames done, frames in all).
    workers : int, optional
        Processes that render; the files do not depend on it. Default: as many as CPUs may be used.

    Returns
    -------
    list of Path
        Video, CSV, camera.

    Raises
    ------
    OSError
        If the folder cannot be written to or the encoder fails.
    """
    path = Path(path)
    count = round(seconds * VIDEO_FPS)
    with atomic_write(path) as unfinished:
        rows = _encode(unfinished, drive, count, ["-crf", str(crf), "-preset", preset], progress, workers)
        # The encoder is a process of its own, which may be killed or meet a full disk without a word.
        if inspect_video(unfinished).frames != count:
            raise OSError(f"not all of the {count} frames arrived in the file")
    write_truth_csv(path.with_suffix(".csv"), rows)
    save_camera(drive.camera, path.with_suffix(".yaml"))
    return [path, path.with_suffix(".csv"), path.with_suffix(".yaml")]


def _encode(
    path: Path, drive: Drive, count: int, quality: list[str], progress: Progress | None, workers: int | None
) -> list[dict]:
    """Render and encode `count` frames; the truth's rows."""
    # Only who renders waits for it: the notebook scores videos without.
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path),
        drive.camera.size,
        fps=VIDEO_FPS,
        codec="libx264",
        quality=None,
        macro_block_size=1,
        output_params=[*quality, *ENCODER],
    )
    rows, before = [], asset_jobs(drive)
    frames = map_ordered(partial(_render, drive), [*before, *range(count)], workers=workers)
    with closing(writer), closing(frames):
        writer.send(None)
        for number, (image, truth) in enumerate(islice(frames, len(before), None)):
            writer.send(image)
            rows.append(truth_row(truth, frame=number))
            if progress:
                progress(number + 1, count)
    return rows


def _render(drive: Drive, job: int | Callable[[], object]) -> tuple[bytes, Truth] | None:
    """One frame of a drive, by number; what the encoder and the table need of it, and no more, goes back.

    Before the frames come their ingredients, of which nothing does.
    """
    if callable(job):
        job()
        return None
    frame = render_frame(drive, job / VIDEO_FPS)
    return frame.image.tobytes(), frame.truth
