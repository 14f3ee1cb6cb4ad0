"""Renders a drive to a video file with its ground truth and camera."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

from lanes.camera import save_camera
from lanes.files import atomic_write, translate_write_errors
from lanes.video.reader import inspect_video
from simulator.processes import map_ordered
from simulator.rendering.drive import Drive
from simulator.rendering.render import render_frame
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
    """Files written: a drive as H.264 video (.mp4), its ground truth (.csv, a row for each frame) and camera (.yaml).

    `crf` and `preset` are quality and speed of x264. `progress` is called as progress(frames done, number of frames).
    `workers` is the number of processes (default: one for each available CPU) and does not change the files. Raises
    OSError if the folder cannot be written to or the encoder fails.
    """
    path = Path(path)
    count = round(seconds * VIDEO_FPS)
    with atomic_write(path) as unfinished, translate_write_errors(path):
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
    rows = []
    frames = map_ordered(partial(_render, drive), range(count), workers=workers)
    with closing(writer), closing(frames):
        writer.send(None)
        for number, (image, truth) in enumerate(frames):
            writer.send(image)
            rows.append(truth_row(truth, frame=number))
            if progress:
                progress(number + 1, count)
    return rows


def _render(drive: Drive, number: int) -> tuple[bytes, Truth]:
    """Bytes and truth of a frame."""
    frame = render_frame(drive, number / VIDEO_FPS)
    return frame.image.tobytes(), frame.truth
