"""Time from file to file, annotation compared with a bare transcode, and peak memory for a long video.

The bare transcode decodes and encodes with the settings of `process_video`; its frames stay in YUV. A third run
converts them to RGB and back: the fixed cost of any function of RGB images.
"""

from __future__ import annotations

import multiprocessing
import re
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import numpy as np

from lanes.camera import Camera, load_camera
from lanes.draw import track_lane
from lanes.images import opencv_threads
from lanes.track.tracker import LaneTracker
from lanes.video.process import process_video
from lanes.video.reader import frame_rate, inspect_video, open_video
from lanes.video.writer import open_mp4


@dataclass(frozen=True)
class FileTime:
    """Wall time and CPU time per frame of the fastest run, in ms and relative to the bare transcode."""

    wall_ms: float
    cpu_ms: float
    wall_ratio: float
    cpu_ratio: float


def transcode(source: Path, target: Path) -> None:
    """Decode and encode a video with the settings of `process_video`, without sound."""
    with open_video(source) as read:
        stream = read.streams.video[0]
        stream.thread_type = "AUTO"
        codec = stream.codec_context
        size, colours = (codec.width, codec.height), inspect_video(source).colours
        rate, tick = frame_rate(stream, source), stream.time_base or Fraction(1)
        written, output = open_mp4(target, size, rate, tick, colours)
        with written:
            for frame in read.decode(stream):
                frame.pict_type = 0  # the encoder chooses the key frames
                written.mux(output.encode(frame))
            written.mux(output.encode(None))


def time_files(
    source: Path, camera: Camera, *, rounds: int = 5, progress: Callable[[int, int], None] | None = None
) -> dict[str, FileTime]:
    """Time a bare transcode, an RGB round trip and the annotation (with telemetry) of a video, in turns.

    The fastest of `rounds` runs counts, for wall time and CPU time: other processes only ever add to a time.
    """
    info = inspect_video(source)
    with TemporaryDirectory() as folder:
        target, table = Path(folder, "out.mp4"), Path(folder, "out.csv")
        processings = {
            "bare transcode": lambda: transcode(source, target),
            "through RGB": lambda: process_video(source, target, lambda frame: frame, progress=False),
            "annotated": lambda: _annotate(source, target, camera, info.fps, table),
        }
        seconds = np.empty((rounds, len(processings), 2))
        for run in range(rounds):
            for k, process in enumerate(processings.values()):
                wall_s, cpu_s = time.perf_counter(), time.process_time()
                process()
                seconds[run, k] = time.perf_counter() - wall_s, time.process_time() - cpu_s
                if progress:
                    progress(run * len(processings) + k + 1, rounds * len(processings))
    frame_ms = 1e3 / info.frames * seconds.min(axis=0)
    ratios = frame_ms / frame_ms[0]
    return {name: FileTime(*map(float, (*frame_ms[k], *ratios[k]))) for k, name in enumerate(processings)}


def peak_memory_mb(source: Path, camera_file: Path, frames: int) -> float:
    """Peak resident memory of a separate process that annotates `frames` frames of the repeated video, MB."""
    with TemporaryDirectory() as folder:
        long = repeat_video(source, Path(folder, "long.mp4"), frames)
        # not forked: a forked process starts with the memory of this one
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            return pool.submit(_annotation_peak_mb, long, Path(folder, "out.mp4"), camera_file, frames).result()


def repeat_video(source: Path, target: Path, frames: int) -> Path:
    """A video of at least `frames` frames: the packets of `source`, repeated without encoding."""
    info = inspect_video(source)
    with av.open(str(target), "w") as written:
        for turn in range(-(-frames // info.frames)):
            with open_video(source) as read:
                stream = read.streams.video[0]
                output = written.streams.video[0] if turn else written.add_stream_from_template(stream)
                shift = round(turn * info.duration_s / (stream.time_base or 1))
                for packet in read.demux(stream):
                    if packet.size and packet.pts is not None and packet.dts is not None:
                        packet.pts, packet.dts, packet.stream = packet.pts + shift, packet.dts + shift, output
                        written.mux(packet)
    return target


def _annotate(source: Path, target: Path, camera: Camera, fps: float, table: Path, end_s: float | None = None) -> None:
    process = track_lane(LaneTracker(camera, fps=fps), camera)
    with opencv_threads(1):  # as in `python -m lanes annotate`
        process_video(source, target, process, end_s=end_s, progress=False, telemetry=table)


def _annotation_peak_mb(source: Path, target: Path, camera_file: Path, frames: int) -> float:
    fps = inspect_video(source).fps
    _annotate(source, target, load_camera(camera_file), fps, target.with_suffix(".csv"), end_s=frames / fps)
    return _own_peak_mb()


def _own_peak_mb() -> float:
    """Peak resident memory of this process; on Linux getrusage also counts the memory before the exec."""
    status = Path("/proc/self/status")
    if status.is_file() and (peak_kb := re.search(r"VmHWM:\s*(\d+) kB", status.read_text())):
        return int(peak_kb[1]) / 1e3
    import resource  # missing on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
