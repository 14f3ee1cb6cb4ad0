"""Soak test of `python -m lanes annotate`: hours of driving, memory, every frame, no drift.

    python -m tools.soak --hours 1

The packets of a short drive are repeated, with a sound track that clicks once in each repetition. The command runs in
a separate process, whose memory is sampled every few seconds. Then frames, time stamps and sound are compared with the
input, and the telemetry of each repetition with that of the second one. (The first one starts without a lane.)
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import numpy as np

from benchmark.machine import describe_machine
from benchmark.scored_drive import PROJECT_ROOT
from lanes.files import read_telemetry
from lanes.video.reader import inspect_video

SOUND_HZ, CLICK_S = 16000, 0.05
SAMPLE_EVERY_S = 5.0
# Smaller differences are rounding of the times, which grows with them.
ROUNDING = 1e-6


def repeat_drive(source: Path, target: Path, repetitions: int) -> None:
    """Write the packets of a video repeatedly, with a click at the start of each repetition."""
    info = inspect_video(source)
    rng = np.random.default_rng(1)
    click = np.zeros(round(info.duration_s * SOUND_HZ), np.float32)
    click[: int(CLICK_S * SOUND_HZ)] = rng.uniform(-0.5, 0.5, int(CLICK_S * SOUND_HZ))
    with av.open(str(target), "w") as written, av.open(str(source)) as read:
        stream = read.streams.video[0]
        packets = [(p.pts, p.dts, p.is_keyframe, bytes(p)) for p in read.demux(stream) if p.size]
        output = written.add_stream_from_template(stream)
        output.time_base = stream.time_base
        sound = written.add_stream("aac", rate=SOUND_HZ, layout="mono")
        for turn in range(repetitions):
            shift = round(turn * info.duration_s / stream.time_base)
            for pts, dts, key, data in packets:
                packet = av.Packet(data)
                packet.pts, packet.dts, packet.is_keyframe = pts + shift, dts + shift, key
                packet.time_base, packet.stream = stream.time_base, output
                written.mux(packet)
            frame = av.AudioFrame.from_ndarray(click[None], format="fltp", layout="mono")
            frame.sample_rate, frame.pts = SOUND_HZ, turn * click.size
            written.mux(sound.encode(frame))
        written.mux(sound.encode(None))


def run_watched(command: Sequence[str]) -> np.ndarray:
    """Run a command; return (samples, 2): seconds since its start and its resident memory in MB."""
    start_s, samples = time.monotonic(), []
    with subprocess.Popen(command, cwd=PROJECT_ROOT) as process:
        while process.poll() is None:
            status = Path(f"/proc/{process.pid}/status").read_text()
            memory = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")]
            samples += [(time.monotonic() - start_s, int(memory[0]) / 1e3)] if memory else []
            time.sleep(SAMPLE_EVERY_S)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)}: ended with {process.returncode}")
    return np.array(samples)


def packet_times(path: Path, kind: str) -> np.ndarray:
    """Sorted presentation times of the packets of the first "video" or "audio" stream, seconds."""
    with av.open(str(path)) as container:
        stream = getattr(container.streams, kind)[0]
        return np.sort([float(p.pts * p.time_base) for p in container.demux(stream) if p.size])


def largest_differences(telemetry: Path, frames: int) -> dict[str, tuple[float, float]]:
    """Largest differences from the second repetition, by column: in the first and in the last tenth of the others.

    For words it is the share of frames that differ. Repetitions are not equal to the last bit, because the tracker
    searches once a second, each time at another frame of the drive.
    """
    differences = {}
    for name, values in read_telemetry(telemetry).items():
        if name in ("frame", "time_s", "latency_ms"):
            continue
        second, *others = values.reshape(-1, frames)[1:]
        tenth = -(-len(others) // 10)
        numbers = values.dtype.kind == "f"
        differences[name] = tuple(
            max(
                float(np.nanmax(np.abs(turn - second), initial=0) if numbers else np.mean(turn != second))
                for turn in part
            )
            for part in (others[:tenth], others[-tenth:])
        )
    return differences


def describe_memory(samples: np.ndarray) -> str:
    """A table of ten parts of the run, and the trend without the first and the last part."""
    parts = np.array_split(samples, min(10, len(samples)))
    lines = [f"  {part[-1, 0]:7.0f} s  {part[:, 1].mean():6.0f} MB, at most {part[:, 1].max():.0f}" for part in parts]
    middle = np.concatenate(parts[1:-1] or parts)
    slope = np.polyfit(middle[:, 0], middle[:, 1], 1)[0] * 3600
    return "\n".join(["memory over time", *lines, f"  trend between {slope:+.1f} MB an hour"])


def soak(video: Path, hours: float) -> bool:
    """Run the soak test and print its results; True if frames, sound and telemetry are as expected."""
    info = inspect_video(video)
    repetitions = max(3, round(hours * 3600 / info.duration_s))
    with TemporaryDirectory() as folder:
        long, output = Path(folder, "long.mp4"), Path(folder, "out")
        repeat_drive(video, long, repetitions)
        command = [sys.executable, "-m", "lanes", "annotate", "--camera", str(video.with_suffix(".yaml")), str(long)]
        began_s = time.monotonic()
        samples = run_watched([*command, "-o", str(output)])
        elapsed_s = time.monotonic() - began_s
        shown, heard = ([packet_times(p, kind) for p in (long, output / "long.mp4")] for kind in ("video", "audio"))
        apart = largest_differences(output / "long.csv", info.frames)
        sizes = [p.stat().st_size / 1e6 for p in (long, output / "long.mp4")]
    late_s = np.abs(shown[1] - shown[0]).max() if len(shown[0]) == len(shown[1]) else np.inf
    # the encoder adds packets before the first frame and after the last one
    in_time = len(np.intersect1d(*(np.round(times_s, 4) for times_s in heard)))
    frames, played_h = len(shown[0]), len(shown[0]) / info.fps / 3600
    print(f"{video.name} {repetitions} times: {played_h:.2f} h, {info.width}x{info.height}, {sizes[0]:.0f} MB")
    print(f"on {describe_machine()}")
    print(f"{elapsed_s / 60:.1f} min, {frames / elapsed_s:.1f} frames/s, {sizes[1]:.0f} MB written")
    print(f"frames in {frames}, out {len(shown[1])}, times differ by at most {1e3 * late_s:.3f} ms")
    print(f"packets of sound in {len(heard[0])}, out {len(heard[1])}, {in_time} of them at the same time")
    print("largest differences from the second repetition, in the first tenth after it and in the last tenth")
    print("\n".join(f"  {name:22}{first:10.2g}{last:10.2g}" for name, (first, last) in apart.items()))
    print(describe_memory(samples))
    drifts = any(last > 2 * first + ROUNDING for first, last in apart.values())
    return bool(late_s < 1e-3 and in_time == len(heard[1]) >= len(heard[0]) - 3 and not drifts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0, help="length of the drive (default: %(default)g)")
    parser.add_argument(
        "--video",
        type=Path,
        default=PROJECT_ROOT / "test_videos" / "project_video.mp4",
        help="video to repeat (default: the committed project video)",
    )
    options = parser.parse_args()
    sys.exit(not soak(options.video, options.hours))
