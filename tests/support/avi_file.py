"""AVI files written chunk by chunk, as recorders write them: also empty chunks, and chunks that complete no frame.

The layout is that of Microsoft's AVI RIFF file reference.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

# A tone from this frame on makes a shift of the sound noticeable.
SOUND_HZ = 8000


def encode_chunks(
    images: Mapping[int, np.ndarray], codec: str, pixels: str, **options: str
) -> tuple[dict[int, bytes], int]:
    """Packets of RGB images at 25 frames a second, by their place in the order of decoding; and the decoder's delay.

    The keys of `images` are the numbers of the frames. The decoder gives a frame at the place of its number plus delay.
    """
    context = av.CodecContext.create(codec, "w")
    context.height, context.width = next(iter(images.values())).shape[:2]
    context.pix_fmt, context.framerate, context.time_base, context.options = pixels, 25, Fraction(1, 25), options
    packets = []
    for number, image in images.items():
        frame = av.VideoFrame.from_ndarray(image).reformat(format=pixels)
        frame.pts = number
        packets += context.encode(frame)
    packets += context.encode(None)
    return {packet.dts - packets[0].dts: bytes(packet) for packet in packets}, -packets[0].dts


def write_avi(
    path: Path, chunks: Sequence[bytes], fourcc: str, size: tuple[int, int], *, tone_from: int | None = None
) -> Path:
    """Write a chunk for each frame, 25 a second; with `tone_from` also 16 bit PCM, a tone from this frame on."""
    data, index, samples = b"", b"", SOUND_HZ // 25
    for number, chunk in enumerate(chunks):
        pieces = {b"00dc": chunk}
        if tone_from is not None:
            wave = 0.5 * np.sin(2 * np.pi * 440 * np.arange(samples) / SOUND_HZ) * (number >= tone_from)
            pieces[b"01wb"] = (wave * 32767).astype("<i2").tobytes()
        for name, piece in pieces.items():
            index += struct.pack("<4sIII", name, 16, len(data) + 4, len(piece))
            data += _chunk(name, piece)
    width, height = size
    count, streams = len(chunks), 1 if tone_from is None else 2
    main = struct.pack("<10I16x", 40_000, 0, 0, 16, count, 0, streams, 0, width, height)
    video = struct.pack("<4s4s10I4H", b"vids", fourcc.encode(), 0, 0, 0, 1, 25, 0, count, 0, 0, 0, 0, 0, width, height)
    picture = struct.pack("<IiiHH4s5I", 40, width, height, 1, 24, fourcc.encode(), width * height * 3, 0, 0, 0, 0)
    headers = _chunk(b"avih", main) + _list(b"strl", _chunk(b"strh", video) + _chunk(b"strf", picture))
    if streams == 2:
        audio = struct.pack("<4s4x10I8x", b"auds", 0, 0, 0, 1, SOUND_HZ, 0, count * samples, 0, 0, 2)
        wave_format = struct.pack("<HHIIHH", 1, 1, SOUND_HZ, 2 * SOUND_HZ, 2, 16)
        headers += _list(b"strl", _chunk(b"strh", audio) + _chunk(b"strf", wave_format))
    riff = b"AVI " + _list(b"hdrl", headers) + _list(b"movi", data) + _chunk(b"idx1", index)
    path.write_bytes(_chunk(b"RIFF", riff))
    return path


def uncoded_frame(number: int) -> bytes:
    """A picture of MPEG-4 part 2 that repeats the one before (ISO 14496-2: vop_coded is 0), at 25 ticks a second."""
    bits = f"0101{number % 25:05b}100" + "1111"
    return b"\0\0\1\xb6" + int(bits, 2).to_bytes(2, "big")


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)


def _list(kind: bytes, data: bytes) -> bytes:
    return _chunk(b"LIST", kind + data)
