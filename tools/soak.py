"""Hours of driving through `python -m lanes annotate`: does memory stay flat, is every frame there, does nothing drift?

    python -m tools.soak --hours 1

A short drive is repeated by copying its packets, with a sound track that clicks once in each repetition; the command
runs in a process of its own, whose memory is looked at every few seconds. Afterwards frames, their times and the sound
are compared with those of the input, and the telemetry of each repetition with that of the second one (the first one
begins without knowing the lane).
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

ROOT = Path(__file__).parents[1]

from benchmark.machine import describe_machine  # noqa: E402
from lanes.io.telemetry import read_telemetry  # noqa: E402
from lanes.io.video.reader import inspect_video  # noqa: E402

SOUND_HZ, CLICK_S = 16000, 0.05
WATCH_EVERY_S = 5.0
# Less is the rounding of times, which grows with them.
SAME = 1e-6


def repeat_drive(source: Path, target: Path, repetitions: int) -> None:
    """The packets of a video again and again, and a click at the beginning of each repetition."""
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
    """Run a command to its end; (samples, 2): seconds since its start and its resident memory in MB."""
    began_s, samples = time.monotonic(), []
    with subprocess.Popen(command, cwd=ROOT) as process:
        while process.poll() is None:
            status = Path(f"/proc/{process.pid}/status").read_text()
            memory = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")]
            samples += [(time.monotonic() - began_s, int(memory[0]) / 1e3)] if memory else []
            time.sleep(WATCH_EVERY_S)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)}: ended with {process.returncode}")
    return np.array(samples)


def packet_times(path: Path, kind: str) -> np.ndarray:
    """When each packet of the first stream of a kind, "video" or "audio", is shown or heard; sorted seconds."""
    with av.open(str(path)) as container:
        stream = getattr(container.streams, kind)[0]
        return np.sort([float(p.pts * p.time_base) for p in container.demux(stream) if p.size])


def farthest(telemetry: Path, frames: int) -> dict[str, tuple[float, float]]:
    """How far values lie from those of the same frame in the second repetition: most in the next, in the last tenth.

    By column; for words the share of frames that differ. Repetitions are not equal to the last bit, because the tracker
    looks for the lane anew once a second, wherever in the drive that is.
    """
    found = {}
    for name, values in read_telemetry(telemetry).items():
        if name in ("frame", "time_s", "latency_ms"):
            continue
        second, *others = values.reshape(-1, frames)[1:]
        tenth = -(-len(others) // 10)
        numbers = values.dtype.kind == "f"
        found[name] = tuple(
            max(
                float(np.nanmax(np.abs(turn - second), initial=0) if numbers else np.mean(turn != second))
                for turn in part
            )
            for part in (others[:tenth], others[-tenth:])
        )
    return found


def describe_memory(samples: np.ndarray) -> str:
    """A table of ten parts of the run, and the trend over all but the first and last of them."""
    parts = np.array_split(samples, min(10, len(samples)))
    lines = [f"  {part[-1, 0]:7.0f} s  {part[:, 1].mean():6.0f} MB, at most {part[:, 1].max():.0f}" for part in parts]
    middle = np.concatenate(parts[1:-1] or parts)
    slope = np.polyfit(middle[:, 0], middle[:, 1], 1)[0] * 3600
    return "\n".join(["memory over time", *lines, f"  trend between {slope:+.1f} MB an hour"])


def soak(video: Path, hours: float) -> bool:
    """Run it, print a table, tell whether all is as it should be."""
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
        apart = farthest(output / "long.csv", info.frames)
        sizes = [p.stat().st_size / 1e6 for p in (long, output / "long.mp4")]
    late_s = np.abs(shown[1] - shown[0]).max() if len(shown[0]) == len(shown[1]) else np.inf
    # what the encoder puts before the first frame and after the last is left out
    in_time = len(np.intersect1d(*(np.round(times_s, 4) for times_s in heard)))
    frames, played_h = len(shown[0]), len(shown[0]) / info.fps / 3600
    print(f"{video.name} {repetitions} times: {played_h:.2f} h, {info.width}x{info.height}, {sizes[0]:.0f} MB")
    print(f"on {describe_machine()}")
    print(f"{elapsed_s / 60:.1f} min, {frames / elapsed_s:.1f} frames/s, {sizes[1]:.0f} MB written")
    print(f"frames in {frames}, out {len(shown[1])}, shown at most {1e3 * late_s:.3f} ms off")
    print(f"packets of sound in {len(heard[0])}, out {len(heard[1])}, of them at their time {in_time}")
    print("farthest from the second repetition, in the tenth after it and in the last one")
    print("\n".join(f"  {name:22}{first:10.2g}{last:10.2g}" for name, (first, last) in apart.items()))
    print(describe_memory(samples))
    drifts = any(last > 2 * first + SAME for first, last in apart.values())
    return bool(late_s < 1e-3 and in_time == len(heard[1]) >= len(heard[0]) - 3 and not drifts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0, help="how long the drive is (default: %(default)g)")
    parser.add_argument(
        "--video", type=Path, default=ROOT / "test_videos" / "project_video.mp4", help="what is repeated"
    )
    options = parser.parse_args()
    sys.exit(not soak(options.video, options.hours))
