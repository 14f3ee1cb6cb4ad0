"""Speed: CPU time of every system for a frame, and time from file to file.

Times are ratios that are measured in one run, so that they are comparable between machines. For a frame the unit is one
`cv2.undistort` of the same frame on one OpenCV thread, from file to file it is a bare transcode with the same decoder
and encoder. Of several rounds the fastest one counts: other processes only ever add to a time.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from fractions import Fraction
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import av
import cv2
import numpy as np

from benchmark.systems import TRACKER, start_recipe
from helpers import RECIPES, follow_lane
from lanes.camera import Camera, load_camera
from lanes.describe import format_table
from lanes.draw import track_lane
from lanes.images import opencv_threads
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import index_video, inspect_video, open_video, read_video
from lanes.video.writer import open_mp4, process_video

# Frames whose processing is timed, kept in memory (2.8 MB each), and the first ones, which do not count: the tracker
# searches in each frame until its lane is confirmed.
FRAMES, WARM_UP = 60, 10
TRACKING, COLD = f"{TRACKER}, tracking", f"{TRACKER}, cold"
TRANSCODED = "bare transcode"
LEGEND = """\
CPU time to detect, measure and draw a frame on one core. undistorts, ms: the median frame; mean: all
frames. The unit is one cv2.undistort of the same frame. Searches raise the mean.
"""

Process = Callable[[np.ndarray], object]


class FrameTime(NamedTuple):
    """CPU time of a frame in undistortions (the median frame, so that rare searches do not count; the mean) and ms."""

    undistorts: float
    mean: float
    ms: float


class FileTime(NamedTuple):
    """Wall and CPU time per frame of the fastest run, in ms and relative to the bare transcode."""

    wall_ms: float
    cpu_ms: float
    wall_ratio: float
    cpu_ratio: float


def describe_speed(video: Path) -> str:
    """Tables of the speed on a video with its camera file (.yaml) next to it, and the machine."""
    camera, machine = load_camera(video.with_suffix(".yaml")), f"{describe_machine()}; {describe_load()}"
    with closing(read_video(video)) as frames:
        of_frames = time_frames(list(islice(frames, FRAMES)), camera, all_systems(camera))
    of_files = time_files(video, camera)
    tables = ({name: [f"{x:.2f}" for x in some] for name, some in of.items()} for of in (of_frames, of_files))
    frame_cells, file_cells = tables
    return (
        f"{format_table(['undistorts', 'mean', 'ms'], frame_cells)}\n{LEGEND}\n"
        f"{format_table(['ms per frame', 'CPU ms', 'ratio', 'CPU ratio'], file_cells)}\n"
        "From file to file; ratios to a bare transcode with the same decoder and encoder.\n\n"
        f"Measured on {machine}."
    )


def all_systems(camera: Camera) -> dict[str, Callable[[], Process]]:
    """The start of each system: the tracker while tracking and cold (reset before each frame), and each recipe."""
    return {
        TRACKING: lambda: track_lane(LaneTracker(camera)),
        COLD: lambda: _start_cold(camera),
        **{name: partial(_draw_recipe, name, camera) for name in RECIPES},
    }


def time_frames(
    frames: Sequence[np.ndarray], camera: Camera, systems: Mapping[str, Callable[[], Process]], *, rounds: int = 3
) -> dict[str, FrameTime]:
    """CPU time of each system for consecutive frames (height, width, 3) uint8; the first WARM_UP do not count.

    A system starts anew in each round, and may draw on the frames. The systems take turns. The frames are in memory,
    because the threads of a decoder would count.
    """
    seconds: dict[str, list[np.ndarray]] = {name: [] for name in systems}
    with opencv_threads(1):
        for _ in range(rounds):
            for name, start in systems.items():
                seconds[name].append(_time_round(start(), frames, camera))
    return {name: _fastest(np.array(rounds_s)) for name, rounds_s in seconds.items()}


def _start_cold(camera: Camera) -> Process:
    tracker = LaneTracker(camera)
    draw = track_lane(tracker)

    def forget_and_draw(frame: np.ndarray) -> object:
        tracker.reset()
        return draw(frame)

    return forget_and_draw


def _draw_recipe(name: str, camera: Camera) -> Process:
    return follow_lane(start_recipe(name, camera))


def _time_round(process: Process, frames: Sequence[np.ndarray], camera: Camera) -> np.ndarray:
    """Seconds (frames, 2): of cv2.undistort, and of the system."""
    seconds = []
    for frame in frames:
        copy = frame.copy()
        start_s = time.process_time()
        cv2.undistort(frame, camera.matrix, camera.distortion)
        middle_s = time.process_time()
        process(copy)
        seconds.append([middle_s - start_s, time.process_time() - middle_s])
    return np.array(seconds)


def _fastest(seconds: np.ndarray) -> FrameTime:
    """From seconds (rounds, frames, 2): the fastest round counts for each frame, for the unit and the system alike."""
    unit_s, system_s = seconds.min(axis=0)[WARM_UP:].T
    median_s = float(np.median(system_s))
    return FrameTime(median_s / float(np.median(unit_s)), float(system_s.mean() / unit_s.mean()), 1e3 * median_s)


def time_files(source: Path, camera: Camera, *, rounds: int = 5) -> dict[str, FileTime]:
    """Time of a bare transcode, of an RGB round trip and of the annotation (with telemetry) of a video, in turns.

    The RGB round trip is the fixed cost of any function of RGB pictures.
    """
    info = inspect_video(source)
    with TemporaryDirectory() as folder:
        target = Path(folder, "out.mp4")
        process = partial(process_video, source, target, progress=False)
        processings: dict[str, Callable[[], object]] = {
            TRANSCODED: lambda: transcode(source, target),
            "through RGB": lambda: process(lambda frame: frame),
            "annotated": lambda: process(
                track_lane(LaneTracker(camera, fps=info.fps)), telemetry=target.with_suffix(".csv")
            ),
        }
        seconds = np.array([[_time_run(run) for run in processings.values()] for _ in range(rounds)])
    frame_ms = 1e3 / info.frames * seconds.min(axis=0)
    numbers = np.column_stack([frame_ms, frame_ms / frame_ms[0]]).tolist()
    return {name: FileTime(*some) for name, some in zip(processings, numbers, strict=True)}


def _time_run(run: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU seconds."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    with opencv_threads(1):  # as in `python -m lanes annotate`
        run()
    return time.perf_counter() - wall_s, time.process_time() - cpu_s


def transcode(source: Path, target: Path) -> None:
    """Decode and encode a video with the settings of `process_video`, without sound."""
    with open_video(source) as read:
        stream = read.streams.video[0]
        stream.thread_type = "AUTO"
        codec = stream.codec_context
        rate, tick = index_video(source).rate, stream.time_base or Fraction(1)
        written, output = open_mp4(target, (codec.width, codec.height), rate, tick)
        with written:
            for frame in read.decode(stream):
                frame.pict_type = 0  # the encoder chooses the key frames
                written.mux(output.encode(frame))
            written.mux(output.encode(None))


@lru_cache(maxsize=1)
def describe_machine() -> str:
    """Processor, cores available to this process, operating system and versions, in one line."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return (
        f"{_processor()} ({cores} {'core' if cores == 1 else 'cores'}), {platform.system()} {platform.machine()}, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, OpenCV {cv2.__version__}, PyAV {av.__version__}"
    )


def _processor() -> str:
    """Name of the processor; on Linux from /proc/cpuinfo, because `platform` knows only the architecture there."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(filter(None, [*names, platform.processor(), platform.machine()]), "unknown processor")


def describe_load() -> str:
    """Load average of the last minute, in words; unknown on systems without it."""
    return f"load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else "load unknown"
