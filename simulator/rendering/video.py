"""Renders a drive to a video file with its ground truth and camera."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

from lanes.camera import save_camera
from lanes.files import atomic_write
from lanes.video.reader import inspect_video
from simulator.processes import map_ordered
from simulator.rendering.drive import Drive
from simulator.rendering.render import render_frame
from simulator.rendering.shared_assets import asset_jobs
from simulator.road.truth import Truth, truth_row, write_truth_csv

Progress = Callable[[int, int], None]

# CRF 21 preserves the texture of asphalt at about 6 Mbit/s.
VIDEO_CRF = 21
# Smaller files for 0.08 s more a frame, because videos are committed.
VIDEO_PRESET = "slow"
# One encoder thread, because x264 output depends on the number of threads.
# faststart: browsers can play the file while it loads.
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
    """Write a drive as H.264 video (.mp4), with a CSV of its ground truth (a row for each frame) and its camera.

    Parameters
    ----------
    crf : int
        Constant rate factor of x264: lower values give better quality and larger files.
    preset : str
        Speed preset of x264, "ultrafast" to "placebo". Slower ones give smaller files.
    progress : callable, optional
        Called as progress(frames done, number of frames).
    workers : int, optional
        Number of processes; it does not change the files. Default: one for each available CPU.

    Returns
    -------
    list of Path
        Video, CSV and camera, all with the same stem.

    Raises
    ------
    OSError
        If the folder cannot be written to or the encoder fails.
    """
    path = Path(path)
    count = round(seconds * VIDEO_FPS)
    with atomic_write(path) as unfinished:
        rows = _encode(unfinished, drive, count, ["-crf", str(crf), "-preset", preset], progress, workers)
        # The encoder is a separate process, which can be killed or run out of disk space silently.
        if inspect_video(unfinished).frames != count:
            raise OSError(f"the encoder wrote fewer than {count} frames")
    write_truth_csv(path.with_suffix(".csv"), rows)
    save_camera(drive.camera, path.with_suffix(".yaml"))
    return [path, path.with_suffix(".csv"), path.with_suffix(".yaml")]


def _encode(
    path: Path, drive: Drive, count: int, quality: list[str], progress: Progress | None, workers: int | None
) -> list[dict]:
    """Render and encode `count` frames; returns the rows of the truth CSV."""
    # Imported here, because it is slow and only rendering needs it.
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
    rows, assets = [], asset_jobs(drive)
    frames = map_ordered(partial(_render, drive), [*assets, *range(count)], workers=workers)
    with closing(writer), closing(frames):
        writer.send(None)
        for number, frame in enumerate(frame for frame in frames if frame is not None):
            image, truth = frame
            writer.send(image)
            rows.append(truth_row(truth, frame=number))
            if progress:
                progress(number + 1, count)
    return rows


def _render(drive: Drive, job: int | Callable[[], object]) -> tuple[bytes, Truth] | None:
    """Bytes and truth of the frame with number `job`; None for a job that fills the disk cache."""
    if callable(job):
        job()
        return None
    frame = render_frame(drive, job / VIDEO_FPS)
    return frame.image.tobytes(), frame.truth
