"""From file to file: the annotated video against a bare transcode, and the memory that a long video takes.

The bare transcode decodes and encodes with the settings of `annotate_video` and does nothing else: its frames stay as
they were decoded, in YUV. Beside it a run that only converts them to RGB and back tells what a function of RGB pictures
costs before it has done anything.
"""

from __future__ import annotations

import multiprocessing
import re
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_file import load_camera
from lanes.drives.overlay_styles import track_lane
from lanes.io.threads import one_thread
from lanes.io.video.container import open_video
from lanes.io.video.pipeline import YuvProcess, annotate_video
from lanes.io.video.reader import inspect_video
from lanes.io.video.writer import open_mp4
from lanes.tracking.tracker import LaneTracker


@dataclass(frozen=True)
class FileTime:
    """Of the fastest run: time and processor time of a frame in ms, and both as multiples of the bare transcode's."""

    wall_ms: float
    processor_ms: float
    wall_ratio: float
    processor_ratio: float


def transcode(source: Path, target: Path) -> None:
    """Decode and encode a video, with the settings of `annotate_video`, without sound."""
    with open_video(source) as read:
        stream = read.streams.video[0]
        stream.thread_type = "AUTO"
        codec = stream.codec_context
        size = codec.width, codec.height
        written, output = open_mp4(target, size, stream.average_rate, stream.time_base)
        with written:
            for frame in read.decode(stream):
                frame.pict_type = 0  # which frames are key frames is the encoder's own choice
                written.mux(output.encode(frame))
            written.mux(output.encode(None))


def time_files(
    source: Path, camera: Camera, *, rounds: int = 5, progress: Callable[[int, int], None] | None = None
) -> dict[str, FileTime]:
    """Bare transcode, RGB round trip and annotation of a video in turn, `rounds` times; telemetry is written too.

    Of each way the fastest run counts, for the clock and for the processor: what others do only ever adds to it.
    """
    info = inspect_video(source)
    with TemporaryDirectory() as folder:
        target, table = Path(folder, "out.mp4"), Path(folder, "out.csv")
        ways = {
            "bare transcode": lambda: transcode(source, target),
            "through RGB": lambda: annotate_video(source, target, lambda frame: frame, progress=False),
            "annotated": lambda: _annotate(source, target, camera, info.fps, table),
        }
        seconds = np.empty((rounds, len(ways), 2))
        for run in range(rounds):
            for way, work in enumerate(ways.values()):
                seconds[run, way] = _seconds_of(work)
                if progress:
                    progress(run * len(ways) + way + 1, rounds * len(ways))
    frame_ms = 1e3 / info.frames * seconds.min(axis=0)
    ratios = frame_ms / frame_ms[0]
    return {name: FileTime(*map(float, (*frame_ms[k], *ratios[k]))) for k, name in enumerate(ways)}


def peak_memory_mb(source: Path, camera_file: Path, frames: int) -> float:
    """Peak of the resident memory of a process of its own that annotates so many frames of the repeated video, MB."""
    with TemporaryDirectory() as folder:
        long = repeat_video(source, Path(folder, "long.mp4"), frames)
        # spawned: a forked process would begin with this one's memory
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            return pool.submit(_annotate_and_weigh, long, Path(folder, "out.mp4"), camera_file, frames).result()


def repeat_video(source: Path, target: Path, frames: int) -> Path:
    """A video of at least so many frames: the packets of `source` again and again, without encoding them anew."""
    info = inspect_video(source)
    with av.open(str(target), "w") as written:
        for turn in range(-(-frames // info.frames)):
            with open_video(source) as read:
                stream = read.streams.video[0]
                output = written.streams.video[0] if turn else written.add_stream_from_template(stream)
                shift = round(turn * info.duration_s / stream.time_base)
                for packet in read.demux(stream):
                    if packet.size:
                        packet.pts, packet.dts, packet.stream = packet.pts + shift, packet.dts + shift, output
                        written.mux(packet)
    return target


def _annotate(source: Path, target: Path, camera: Camera, fps: float, table: Path, end_s: float | None = None) -> None:
    process = YuvProcess(track_lane(LaneTracker(camera, fps=fps), camera))
    with one_thread():  # as the command does it
        annotate_video(source, target, process, end_s=end_s, progress=False, telemetry=table)


def _annotate_and_weigh(source: Path, target: Path, camera_file: Path, frames: int) -> float:
    fps = inspect_video(source).fps
    _annotate(source, target, load_camera(camera_file), fps, target.with_suffix(".csv"), end_s=frames / fps)
    return _own_peak_mb()


def _own_peak_mb() -> float:
    """Peak of this process's resident memory; Linux counts in getrusage what was there before this program began."""
    status = Path("/proc/self/status")
    if status.is_file():
        return int(re.search(r"VmHWM:\s*(\d+) kB", status.read_text())[1]) / 1e3
    import resource  # not there on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def _seconds_of(work: Callable[[], object]) -> tuple[float, float]:
    wall_s, processor_s = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall_s, time.process_time() - processor_s
