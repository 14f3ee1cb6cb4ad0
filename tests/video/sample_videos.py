"""Videos of numbered frames, and functions that read their numbers,
sound and packets.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.support.clips import encode

SIZE = (160, 96)
YELLOW = (255, 200, 0)
NTSC = Fraction(30000, 1001)


def numbered(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A picture with its number as ten bars, white for 1 and black for 0, on a coloured
    background.
    """
    width, height = size
    image = np.empty((height, width, 3), np.uint8)
    image[:] = YELLOW
    for bit in range(10):
        image[height // 2 :, bit * 16 : bit * 16 + 16] = (
            235 if number >> bit & 1 else 20
        )
    return image


def number_of(image: np.ndarray) -> int:
    row = image[-10:-2].mean(axis=(0, 2))
    return sum(int(row[bit * 16 + 8] > 128) << bit for bit in range(10))


def make_video(path: Path, frames: int = 25, *, size=SIZE, **settings) -> Path:
    """A video of numbered frames in any container; `settings` are those of `encode`."""
    pixels = "yuv420p" if size[0] % 2 == 0 else "yuv444p"
    options = {"preset": "ultrafast", "g": "12"}
    return encode(
        path,
        (numbered(n, size) for n in range(frames)),
        pixels=pixels,
        options=options,
        **settings,
    )


def set_rotation(source: Path, target: Path, degrees: int) -> None:
    """Write the matrix of a clockwise turn into the track header of an mp4."""
    cos, sin = {90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees]
    set_matrix(source, target, cos, sin, -sin, cos)


def set_matrix(source: Path, target: Path, a: int, b: int, c: int, d: int) -> None:
    """Write a display matrix into the track header of an mp4 (ISO 14496-12, 8.3.2)."""
    data = bytearray(source.read_bytes())
    at = data.index(b"tkhd") + 4 + 4 + 20 + 16
    data[at : at + 36] = struct.pack(
        ">9i", a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30
    )
    target.write_bytes(data)


def state_turns(
    codec: str, turns: Mapping[int, int | None]
) -> Callable[[list[av.Packet]], list[av.Packet]]:
    """An edit for `encode`: the stream states at these frames how many degrees it is to
    be turned anticlockwise (ITU-T H.274, display orientation; it persists), or with
    None that it is no longer to be turned.
    """
    unit = {"libx264": b"\x06", "libx265": b"\x4e\x01"}[codec]

    def edit(packets: list[av.Packet]) -> list[av.Packet]:
        for number, degrees in turns.items():
            message = b"\x2f\x01\xa0\x80"  # cancels the one before
            if degrees is not None:
                # no flips, the turn in 16 bits, a period of 1, no extension, end
                bits = f"000{degrees * 2**16 // 360:016b}01001"
                message = b"\x2f\x03" + int(bits, 2).to_bytes(3, "big") + b"\x80"
            before = packets[number]
            packet = av.Packet(b"\0\0\0\1" + unit + message + bytes(before))
            packet.stream = before.stream
            packet.time_base = before.time_base
            packet.pts = before.pts
            packet.dts = before.dts
            packet.is_keyframe = before.is_keyframe
            packets[number] = packet
        return packets

    return edit


def make_video_with_unknown_sound(
    path: Path, frames: int, tracks: int = 1, **options
) -> Path:
    """An avi whose first sound track has the number of no codec, in the first entry of its
    header (WAVEFORMAT.wFormatTag).
    """
    make_video(path, frames, sound=("pcm_s16le",) * tracks, **options)
    data = bytearray(path.read_bytes())
    at = data.index(b"strf", data.index(b"auds")) + 8
    data[at : at + 2] = b"\x34\x12"
    path.write_bytes(data)
    return path


def tone_starts_s(path: Path, track: int = 0) -> float:
    with av.open(str(path)) as container:
        stream = container.streams.audio[track]
        for frame in container.decode(stream):
            loud = np.flatnonzero(np.abs(frame.to_ndarray().astype(float)[0]) > 0.1)
            if len(loud):
                return frame.time + loud[0] / frame.sample_rate
    return np.nan


def sound_packets(path: Path) -> list[tuple[float, bytes]]:
    """Each audio packet with its time, rounded to 0.1 ms."""
    with av.open(str(path)) as container:
        packets = container.demux(container.streams.audio[0])
        return [
            (round(float(p.pts * p.time_base), 4), bytes(p)) for p in packets if p.size
        ]


def unchanged(frame: np.ndarray) -> np.ndarray:
    return frame
