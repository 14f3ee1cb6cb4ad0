"""Speed: CPU time of every system for a frame, and time from file to file.

Times are ratios that are measured in one run, so that they are comparable between machines. For a frame the unit is one
`cv2.undistort` of the same frame on one OpenCV thread, from file to file it is a bare transcode with the same decoder
and encoder. Of several rounds the fastest one counts: other processes only ever add to a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from benchmark.machine import describe_load, describe_machine
from benchmark.systems import TRACKER
from helpers import RECIPES, LaneFinder, follow_lane, get_recipe
from lanes.camera import Camera, load_camera
from lanes.describe import format_table
from lanes.draw import track_lane
from lanes.images import opencv_threads
from lanes.tracking.tracker import LaneTracker
from lanes.video.container import frame_rate, open_video
from lanes.video.process import process_video
from lanes.video.reader import inspect_video, read_video
from lanes.video.writer import open_mp4

# Frames whose processing is timed, kept in memory (2.8 MB each), and the first ones, which do not count: the tracker
# searches in each frame until its lane is confirmed.
FRAMES, WARM_UP = 60, 10
TRACKING, COLD = f"{TRACKER}, tracking", f"{TRACKER}, cold"
TRANSCODED = "bare transcode"

Progress = Callable[[int, int], None]
Process = Callable[[np.ndarray], object]


@dataclass(frozen=True)
class FrameTime:
    """CPU time of one system to detect, measure and draw a frame.

    `ms` and `undistorts` are those of the median frame, so that the tracker's rare searches do not count; `mean` is in
    undistortions, too, over all frames.
    """

    ms: float
    undistorts: float
    mean: float


@dataclass(frozen=True)
class FileTime:
    """Wall time and CPU time per frame of the fastest run, in ms and relative to the bare transcode."""

    wall_ms: float
    cpu_ms: float
    wall_ratio: float
    cpu_ratio: float


@dataclass(frozen=True)
class Speed:
    """Times by system, and by processing from file to file."""

    frames: dict[str, FrameTime]
    files: dict[str, FileTime]
    machine: str

    def describe(self) -> str:
        """Two text tables, and the machine."""
        frames = {name: [f"{t.undistorts:.2f}", f"{t.mean:.2f}", f"{t.ms:.1f}"] for name, t in self.frames.items()}
        files = {
            name: [f"{t.wall_ms:.1f}", f"{t.cpu_ms:.1f}", f"{t.wall_ratio:.2f}", f"{t.cpu_ratio:.2f}"]
            for name, t in self.files.items()
        }
        return "\n".join(
            [
                format_table(["undistorts", "mean", "ms"], frames),
                "CPU time to detect, measure and draw a frame on one core. undistorts, ms: the median frame; mean: all",
                "frames. The unit is one cv2.undistort of the same frame. Searches raise the mean.\n",
                format_table(["ms per frame", "CPU ms", "ratio", "CPU ratio"], files),
                "From file to file; ratios to a bare transcode with the same decoder and encoder.\n",
                f"Measured on {self.machine}.",
            ]
        )


def measure_speed(video: Path, *, progress: Callable[[str], Progress] | None = None) -> Speed:
    """Speed on a video with its camera file (.yaml) next to it.

    `progress`, called with the name of a part, returns the callback (done, total) for it.
    """
    camera, machine = load_camera(video.with_suffix(".yaml")), f"{describe_machine()}; {describe_load()}"
    report = progress or (lambda _: lambda *_: None)
    with closing(read_video(video)) as frames:
        first = list(islice(frames, FRAMES))
    times = time_frames(first, camera, progress=report("frames"))
    return Speed(times, time_files(video, camera, progress=report("files")), machine)


def time_frames(
    frames: Sequence[np.ndarray], camera: Camera, *, rounds: int = 3, progress: Progress | None = None
) -> dict[str, FrameTime]:
    """CPU time of each system for consecutive frames (height, width, 3) uint8; the first WARM_UP do not count.

    The systems are the tracker while tracking and cold (reset before each frame), and each recipe. They take turns. The
    frames are in memory, because the threads of a decoder would count.
    """
    systems = _systems(camera)
    seconds: dict[str, list[np.ndarray]] = {name: [] for name in systems}
    turns = [(name, start) for _ in range(rounds) for name, start in systems.items()]
    with opencv_threads(1):
        for done, (name, start) in enumerate(turns, 1):
            seconds[name].append(_time_round(start(), frames, camera))
            if progress:
                progress(done, len(turns))
    return {name: _fastest(np.array(rounds_s)) for name, rounds_s in seconds.items()}


def _systems(camera: Camera) -> dict[str, Callable[[], Process]]:
    """Functions that start a drive and return the function that processes its frames."""

    def start_cold() -> Process:
        cold = LaneTracker(camera)
        draw = track_lane(cold)

        def forget_and_draw(frame: np.ndarray) -> object:
            cold.reset()
            return draw(frame)

        return forget_and_draw

    def start_recipe(name: str) -> Callable[[], Process]:
        return lambda: follow_lane(LaneFinder(get_recipe(name, camera.size), camera), camera)

    tracker = {TRACKING: lambda: track_lane(LaneTracker(camera)), COLD: start_cold}
    return tracker | {name: start_recipe(name) for name in RECIPES}


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
    return FrameTime(1e3 * median_s, median_s / float(np.median(unit_s)), float(system_s.mean() / unit_s.mean()))


def time_files(
    source: Path, camera: Camera, *, rounds: int = 5, progress: Progress | None = None
) -> dict[str, FileTime]:
    """Time of a bare transcode, of an RGB round trip and of the annotation (with telemetry) of a video, in turns.

    The RGB round trip is the fixed cost of any function of RGB pictures.
    """
    info = inspect_video(source)
    with TemporaryDirectory() as folder:
        target = Path(folder, "out.mp4")
        processings = {
            TRANSCODED: lambda: transcode(source, target),
            "through RGB": lambda: process_video(source, target, lambda frame: frame, progress=False),
            "annotated": lambda: process_video(
                source,
                target,
                track_lane(LaneTracker(camera, fps=info.fps)),
                progress=False,
                telemetry=target.with_suffix(".csv"),
            ),
        }
        seconds = np.empty((rounds, len(processings), 2))
        for run in range(rounds):
            for k, process in enumerate(processings.values()):
                wall_s, cpu_s = time.perf_counter(), time.process_time()
                with opencv_threads(1):  # as in `python -m lanes annotate`
                    process()
                seconds[run, k] = time.perf_counter() - wall_s, time.process_time() - cpu_s
                if progress:
                    progress(run * len(processings) + k + 1, rounds * len(processings))
    frame_ms = 1e3 / info.frames * seconds.min(axis=0)
    ratios = frame_ms / frame_ms[0]
    return {name: FileTime(*map(float, (*frame_ms[k], *ratios[k]))) for k, name in enumerate(processings)}


def transcode(source: Path, target: Path) -> None:
    """Decode and encode a video with the settings of `process_video`, without sound."""
    with open_video(source) as read:
        stream = read.streams.video[0]
        stream.thread_type = "AUTO"
        codec = stream.codec_context
        size = codec.width, codec.height
        rate, tick = frame_rate(stream, source), stream.time_base or Fraction(1)
        written, output = open_mp4(target, size, rate, tick)
        with written:
            for frame in read.decode(stream):
                frame.pict_type = 0  # the encoder chooses the key frames
                written.mux(output.encode(frame))
            written.mux(output.encode(None))
