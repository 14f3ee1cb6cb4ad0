"""Speed: CPU time of every system for a frame, and time from file to file.

Times are ratios that are measured in one run, so that they are comparable between
machines. For a frame the unit is one `cv2.undistort` of the same frame on one OpenCV
thread, from file to file it is a bare transcode with the same decoder and encoder. Of
several rounds the fastest one counts: other processes only ever add to a time.
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
from lanes.camera.model import Camera, load_camera
from lanes.describe import format_table
from lanes.show.draw import track_lane
from lanes.tracking.tracker import LaneTracker
from lanes.video.images import opencv_threads
from lanes.video.reader import index_video, inspect_video, open_video, read_video
from lanes.video.writer import open_mp4, process_video
from simulator.processes import available_cpus

# Frames whose processing is timed, kept in memory (2.8 MB each), and the first ones,
# which do not count: the tracker searches in each frame until its lane is confirmed.
FRAMES = 60
WARM_UP = 10
TRACKING = f"{TRACKER}, tracking"
COLD = f"{TRACKER}, cold"
TRANSCODED = "bare transcode"
LEGEND = """\
CPU time to detect, measure and draw a frame on one core. undistorts, ms: the median
frame; mean: all frames. The unit is one cv2.undistort of the same frame. Searches
raise the mean.
"""

Process = Callable[[np.ndarray], object]


class FrameTime(NamedTuple):
    """CPU time of a frame in undistortions (the median frame, so that rare searches do
    not count; the mean) and ms.
    """

    undistorts: float
    mean: float
    ms: float


class FileTime(NamedTuple):
    """Wall and CPU time per frame of the fastest run, in ms and relative to the bare
    transcode.
    """

    wall_ms: float
    cpu_ms: float
    wall_ratio: float
    cpu_ratio: float


def describe_speed(video: Path) -> str:
    """Tables of the speed on a video with its camera file (.yaml) next to it, and the
    machine.
    """
    camera = load_camera(video.with_suffix(".yaml"))
    machine = f"{describe_machine()}; {describe_load()}"
    with closing(read_video(video)) as read:
        frames = list(islice(read, FRAMES))
    of_frames = time_frames(frames, camera, all_systems(camera))
    of_files = time_files(video, camera)
    return (
        f"{_time_table(['undistorts', 'mean', 'ms'], of_frames)}\n{LEGEND}\n"
        f"{_time_table(['ms per frame', 'CPU ms', 'ratio', 'CPU ratio'], of_files)}\n"
        "From file to file; ratios to a bare transcode with the same decoder and "
        f"encoder.\n\nMeasured on {machine}."
    )


def _time_table(headings: Sequence[str], times: Mapping[str, Sequence[float]]) -> str:
    cells = {name: [f"{time:.2f}" for time in row] for name, row in times.items()}
    return format_table(headings, cells)


def all_systems(camera: Camera) -> dict[str, Callable[[], Process]]:
    """The start of each system: the tracker while tracking and cold (reset before each
    frame), and each recipe.
    """
    starts: dict[str, Callable[[], Process]] = {
        TRACKING: lambda: track_lane(LaneTracker(camera)),
        COLD: partial(_start_cold, camera),
    }
    for name in RECIPES:
        starts[name] = partial(_draw_recipe, name, camera)
    return starts


def time_frames(
    frames: Sequence[np.ndarray],
    camera: Camera,
    systems: Mapping[str, Callable[[], Process]],
    *,
    rounds: int = 3,
) -> dict[str, FrameTime]:
    """CPU time of each system for consecutive frames (height, width, 3) uint8.

    The first WARM_UP do not count.

    A system starts anew in each round, and may draw on the frames. The systems take
    turns. The frames are in memory, because the threads of a decoder would count.
    """
    seconds: dict[str, list[np.ndarray]] = {name: [] for name in systems}
    with opencv_threads(1):
        for _ in range(rounds):
            for name, start in systems.items():
                round_s = _time_round(start(), frames, camera)
                seconds[name].append(round_s)
    return {name: _fastest(np.array(of_rounds)) for name, of_rounds in seconds.items()}


def _start_cold(camera: Camera) -> Process:
    tracker = LaneTracker(camera)
    draw = track_lane(tracker)

    def forget_and_draw(frame: np.ndarray) -> object:
        tracker.reset()
        return draw(frame)

    return forget_and_draw


def _draw_recipe(name: str, camera: Camera) -> Process:
    return follow_lane(start_recipe(name, camera))


def _time_round(
    process: Process, frames: Sequence[np.ndarray], camera: Camera
) -> np.ndarray:
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
    """From seconds (rounds, frames, 2): the fastest round counts for each frame, for
    the unit and the system alike.
    """
    unit_s, system_s = seconds.min(axis=0)[WARM_UP:].T
    median_s = float(np.median(system_s))
    return FrameTime(
        undistorts=median_s / float(np.median(unit_s)),
        mean=float(system_s.mean() / unit_s.mean()),
        ms=1e3 * median_s,
    )


def time_files(source: Path, camera: Camera, *, rounds: int = 5) -> dict[str, FileTime]:
    """Time of a bare transcode, of an RGB round trip and of the annotation (with
    telemetry) of a video, in turns.

    The RGB round trip is the fixed cost of any function of RGB pictures.
    """
    info = inspect_video(source)
    with TemporaryDirectory() as folder:
        target = Path(folder, "out.mp4")
        process = partial(process_video, source, target, progress=False)

        def annotate() -> None:
            draw = track_lane(LaneTracker(camera, fps=info.fps))
            process(draw, telemetry=target.with_suffix(".csv"))

        ways: dict[str, Callable[[], object]] = {
            TRANSCODED: lambda: transcode(source, target),
            "through RGB": lambda: process(lambda frame: frame),
            "annotated": annotate,
        }
        seconds = []
        for _ in range(rounds):
            seconds.append([_time_run(run) for run in ways.values()])

    frame_ms = 1e3 / info.frames * np.min(seconds, axis=0)
    ratios = frame_ms / frame_ms[0]
    numbers = np.column_stack([frame_ms, ratios]).tolist()
    return {name: FileTime(*row) for name, row in zip(ways, numbers, strict=True)}


def _time_run(run: Callable[[], object]) -> tuple[float, float]:
    """Wall and CPU seconds."""
    wall_s = time.perf_counter()
    cpu_s = time.process_time()
    with opencv_threads(1):  # as in `python -m lanes annotate`
        run()
    return time.perf_counter() - wall_s, time.process_time() - cpu_s


def transcode(source: Path, target: Path) -> None:
    """Decode and encode a video with the settings of `process_video`, without sound."""
    with open_video(source) as read:
        stream = read.streams.video[0]
        stream.thread_type = "AUTO"
        codec = stream.codec_context
        size = (codec.width, codec.height)
        rate = index_video(source).rate
        tick = stream.time_base or Fraction(1)
        written, output = open_mp4(target, size, rate, tick)
        with written:
            for frame in read.decode(stream):
                frame.pict_type = 0  # the encoder chooses the key frames
                written.mux(output.encode(frame))
            written.mux(output.encode(None))


@lru_cache(maxsize=1)
def describe_machine() -> str:
    """Processor, cores available to this process, operating system and versions, in one
    line.
    """
    cores = available_cpus()
    plural = "" if cores == 1 else "s"
    return (
        f"{_processor()} ({cores} core{plural}), "
        f"{platform.system()} {platform.machine()}, Python "
        f"{platform.python_version()}, "
        f"NumPy {np.__version__}, OpenCV {cv2.__version__}, PyAV {av.__version__}"
    )


def _processor() -> str:
    """Name of the processor.

    On Linux from /proc/cpuinfo, because `platform` knows only the architecture there.
    """
    try:
        cpuinfo = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        cpuinfo = ""
    for line in cpuinfo.splitlines():
        key, _, name = line.partition(":")
        if key.startswith("model name") and name.strip():
            return name.strip()
    return platform.processor() or platform.machine() or "unknown processor"


def describe_load() -> str:
    """Load average of the last minute, in words; unknown on systems without it."""
    if not hasattr(os, "getloadavg"):
        return "load unknown"
    last_minute, *_ = os.getloadavg()
    return f"load {last_minute:.1f} at the start"
