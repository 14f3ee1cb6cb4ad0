"""Short videos for tests."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import av
import numpy as np

from lanes.camera import save_camera
from simulator.road.truth import truth_row, write_truth_csv
from tests.support.painted_drive import PaintedDrive

FPS = 25


def write_clip(path: Path, frames: Iterable[np.ndarray]) -> Path:
    """Encode frames (height, width, 3) as H.264 at 25 frames/s with little loss."""
    frames = list(frames)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=FPS, options={"crf": "12", "preset": "ultrafast"})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    return path


def write_drive(path: Path, drive: PaintedDrive, count: int) -> Path:
    """Encode the first frames of a drive, and write its truth (.csv) and camera (.yaml) next to the video."""
    times_s = [number / FPS for number in range(count)]
    write_clip(path, map(drive.frame, times_s))
    write_truth_csv(path.with_suffix(".csv"), [truth_row(drive.truth(t), frame=n) for n, t in enumerate(times_s)])
    save_camera(drive.camera, path.with_suffix(".yaml"))
    return path
