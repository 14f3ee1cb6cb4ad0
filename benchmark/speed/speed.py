"""How fast: stages of a frame, files, memory; everything as ratios measured in one run on one machine."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from benchmark.machine import describe_load, describe_machine
from benchmark.reporting.tables import format_table
from benchmark.speed.stages import FrameTime, time_frames
from benchmark.speed.transcode import FileTime, peak_memory_mb, time_files
from lanes.camera.camera_file import load_camera
from lanes.io.video.reader import read_frames

# They are kept in memory, 2.8 MB each.
FRAMES = 60
# A short and a long video whose peaks of memory are compared.
SHORT, LONG = 400, 4000


@dataclass(frozen=True)
class Speed:
    """What `measure_speed` found: by system, by way from file to file, MB by number of frames, and on what machine."""

    frames: dict[str, FrameTime]
    files: dict[str, FileTime]
    memory_mb: dict[int, float]
    machine: str

    def describe(self) -> str:
        """Three tables in words, and the machine."""
        tables = _describe_frames(self.frames), _describe_files(self.files), _describe_memory(self.memory_mb)
        return "\n\n".join([*tables, f"Measured on {self.machine}."])


def measure_speed(video: Path, *, progress: Callable[[str], Callable[[int, int], None]] | None = None) -> Speed:
    """Measure on a video with its camera file (.yaml) beside it.

    Parameters
    ----------
    video : Path
    progress : callable, optional
        Takes the name of a part and gives a function for (done, total).
    """
    camera, machine = load_camera(video.with_suffix(".yaml")), f"{describe_machine()}; {describe_load()}"
    report = progress or (lambda _: lambda *_: None)
    with closing(read_frames(video)) as frames:
        first = list(islice(frames, FRAMES))
    frames = time_frames(first, camera, progress=report("frames"))
    files = time_files(video, camera, progress=report("files"))
    memory, told = {}, report("memory")
    for number, count in enumerate((SHORT, LONG)):
        memory[count] = peak_memory_mb(video, video.with_suffix(".yaml"), count)
        told(number + 1, 2)
    return Speed(frames, files, memory, machine)


def _describe_frames(times: dict[str, FrameTime]) -> str:
    lines = [f"{'':22}undistorts    mean      ms"]
    for name, found in times.items():
        lines.append(f"{name:22}{found.undistorts:10.2f}{found.mean:8.2f}{found.ms:8.1f}")
        lines += [f"  {stage:20}{'':10}{value:8.2f}" for stage, value in found.stages.items()]
    table = "\n".join(lines)
    return (
        f"{table}\nDetect, measure and draw a frame on one core: processor time of the frame in the middle, and the\n"
        "mean, which the stages divide; of each frame the fastest of three rounds. An undistort is one cv2.undistort\n"
        "of the same frame on one OpenCV thread, measured just before, in the same way. While tracking, frames are\n"
        "as their video stores them, otherwise RGB; a search each second raises the mean."
    )


def _describe_files(times: dict[str, FileTime]) -> str:
    rows = {
        name: [f"{t.wall_ms:.1f}", f"{t.processor_ms:.1f}", f"{t.wall_ratio:.2f}", f"{t.processor_ratio:.2f}"]
        for name, t in times.items()
    }
    table = format_table(["ms a frame", "processor ms", "ratio", "processor ratio"], rows)
    return (
        f"{table}\nFrom file to file: the fastest of five runs; ratios are to that of a bare transcode with the same\n"
        "decoder and encoder."
    )


def _describe_memory(memory_mb: dict[int, float]) -> str:
    return "\n".join(f"{frames} frames: at most {peak:.0f} MB of memory" for frames, peak in memory_mb.items())
