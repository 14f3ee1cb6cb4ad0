"""Speed and memory: stages of a frame, whole files, peak memory; ratios are measured in one run on one machine."""

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
from lanes.camera import load_camera
from lanes.video.reader import read_video

# Kept in memory, 2.8 MB each.
FRAMES = 60
# Frames of a short and a long video, to compare their peak memory.
SHORT_VIDEO, LONG_VIDEO = 400, 4000


@dataclass(frozen=True)
class Speed:
    """Times by system and by processing from file to file, and peak memory in MB by number of frames."""

    frames: dict[str, FrameTime]
    files: dict[str, FileTime]
    memory_mb: dict[int, float]
    machine: str

    def describe(self) -> str:
        """Three text tables, and the machine."""
        memory = [f"{frames} frames: at most {peak:.0f} MB of memory" for frames, peak in self.memory_mb.items()]
        tables = _describe_frames(self.frames), _describe_files(self.files), "\n".join(memory)
        return "\n\n".join([*tables, f"Measured on {self.machine}."])


def measure_speed(video: Path, *, progress: Callable[[str], Callable[[int, int], None]] | None = None) -> Speed:
    """Speed and memory on a video with its camera file (.yaml) next to it.

    `progress`, called with the name of a part, returns the callback (done, total) for it.
    """
    camera, machine = load_camera(video.with_suffix(".yaml")), f"{describe_machine()}; {describe_load()}"
    report = progress or (lambda _: lambda *_: None)
    with closing(read_video(video)) as frames:
        first = list(islice(frames, FRAMES))
    times = time_frames(first, camera, progress=report("frames"))
    files = time_files(video, camera, progress=report("files"))
    memory, report_memory = {}, report("memory")
    for number, count in enumerate((SHORT_VIDEO, LONG_VIDEO)):
        memory[count] = peak_memory_mb(video, video.with_suffix(".yaml"), count)
        report_memory(number + 1, 2)
    return Speed(times, files, memory, machine)


def _describe_frames(times: dict[str, FrameTime]) -> str:
    lines = [f"{'':22}undistorts    mean      ms"]
    for name, t in times.items():
        lines.append(f"{name:22}{t.undistorts:10.2f}{t.mean:8.2f}{t.ms:8.1f}")
        lines += [f"  {stage:20}{'':10}{value:8.2f}" for stage, value in t.stages.items()]
    table = "\n".join(lines)
    return (
        f"{table}\nCPU time to detect, measure and draw a frame on one core. undistorts, ms: the median frame. mean:\n"
        "over all frames, the sum of the stages. The fastest of three rounds counts for each frame. The unit is one\n"
        "cv2.undistort of the same frame on one OpenCV thread, measured just before. While tracking, frames are YUV\n"
        "as in their video, otherwise RGB. Searches raise the mean."
    )


def _describe_files(times: dict[str, FileTime]) -> str:
    rows = {
        name: [f"{t.wall_ms:.1f}", f"{t.cpu_ms:.1f}", f"{t.wall_ratio:.2f}", f"{t.cpu_ratio:.2f}"]
        for name, t in times.items()
    }
    table = format_table(["ms per frame", "CPU ms", "ratio", "CPU ratio"], rows)
    return (
        f"{table}\nFrom file to file, the fastest of five runs; ratios to a bare transcode with the same decoder and\n"
        "encoder."
    )
