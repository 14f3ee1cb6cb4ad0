"""Images of robot logs: raw and compressed messages, and those of a video, to RGB arrays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import chain
from typing import Any

import av
import cv2
import numpy as np

from lanes.errors import VideoError
from lanes.video.images import MAX_PIXELS

# Encodings of raw images (sensor_msgs/image_encodings.hpp, and names of drivers): values of a pixel, and OpenCV's
# conversion to RGB. Those that end in 10, 12, 14 or 16 have that many bits a value, in two bytes.
_RGB, _BGR, _RGBA, _BGRA = (3, None), (3, cv2.COLOR_BGR2RGB), (4, cv2.COLOR_RGBA2RGB), (4, cv2.COLOR_BGRA2RGB)
_MONO = (1, cv2.COLOR_GRAY2RGB)
_COLOURS: dict[str, tuple[int, int | None]] = {"rgb": _RGB, "bgr": _BGR, "rgba": _RGBA, "bgra": _BGRA, "mono": _MONO}
_BITS = (8, 10, 12, 14, 16)
_ENCODINGS = {f"{name}{bits}": found for bits in _BITS for name, found in _COLOURS.items()}
_BAYER = {f"bayer_{p.lower()}": getattr(cv2, f"COLOR_Bayer{p}2RGB") for p in ("RGGB", "BGGR", "GBRG", "GRBG")}
_ENCODINGS |= {f"{name}{bits}": (1, code) for bits in _BITS for name, code in _BAYER.items()}
_ENCODINGS |= {"8UC1": _MONO, "8UC3": _BGR, "8UC4": _BGRA, "16UC3": _BGR}
_ENCODINGS |= dict.fromkeys(("yuv422", "uyvy"), (2, cv2.COLOR_YUV2RGB_UYVY))
_ENCODINGS |= dict.fromkeys(("yuv422_yuy2", "yuyv", "yuy2"), (2, cv2.COLOR_YUV2RGB_YUY2))
# A plane of brightness, and one or two of colour below it, half as high in all.
_PLANAR = {"nv12": cv2.COLOR_YUV2RGB_NV12, "nv21": cv2.COLOR_YUV2RGB_NV21, "i420": cv2.COLOR_YUV2RGB_I420}
# Named where an encoding is refused.
_COMMON = ("rgb8", "bgr8", "rgba8", "bgra8", "mono8", "bayer_*8", "the same with 16", "yuv422", "yuv422_yuy2", "nv12")
# Formats of compressed messages that are not an image each.
_VIDEO_CODECS = re.compile(r"\b(h\.?26[45]|avc|hevc|av1|vp[89]|theora)\b", re.IGNORECASE)
# Codecs of foxglove.CompressedVideo: FFmpeg's names, and of the units (NAL) of an image that needs no other one the
# position of their type in the first byte, and the types.
_CODECS = {"h264": ("h264", 0, (5,)), "h265": ("hevc", 1, range(16, 22)), "vp9": ("vp9", 0, ()), "av1": ("av1", 0, ())}


def decode_image(message: Any, name: str = "image", *, bits: int | None = None) -> np.ndarray | None:
    """The RGB image (height, width, 3), uint8, of a message, raw or compressed; None if it is damaged.

    `bits` are those of its values if they have two bytes, see `count_bits`; by default what the image itself shows.
    Raises VideoError about `name` if the encoding or the format is not one that is read.
    """
    image = _unpack(message, name)
    if image is None or image.dtype == np.uint8:
        return image
    bits = bits or count_bits([int(image.max())])
    return np.minimum(image >> (bits - 8), 255).astype(np.uint8)


def find_peak(message: Any, name: str) -> int:
    """The largest value of an image, if its values have two bytes; 0 of all others."""
    image = _unpack(message, name)
    return int(image.max()) if image is not None and image.dtype == np.uint16 else 0


def count_bits(peaks: list[int]) -> int:
    """Bits of the values of a camera, from the largest values of some of its images: 12 bits come in words of 16."""
    return next(bits for bits in _BITS if max(peaks, default=0) < 1 << bits)


def _unpack(message: Any, name: str) -> np.ndarray | None:
    """The RGB image, uint8 or uint16; see `decode_image`."""
    data = np.frombuffer(message.data, np.uint8)
    if hasattr(message, "format"):
        return _uncompress(data, str(message.format), name)
    height, width, step, encoding = message.height, message.width, message.step, message.encoding
    if (code := _PLANAR.get(encoding)) is not None:
        height = height * 3 // 2
        if width % 2 or height % 3 or not 0 < width <= step or not 0 < height * step <= len(data):
            return None
        if encoding == "i420" and step > width:
            return None  # its planes of colour have half the step
        return cv2.cvtColor(np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :width]), code)
    if encoding not in _ENCODINGS:
        raise VideoError(f"{name} has the encoding {encoding!r}; record one of {', '.join(_COMMON)}.")
    channels, code = _ENCODINGS[encoding]
    size = 2 if re.search(r"1[0246](UC3)?$", encoding) else 1
    row = width * channels * size
    if not 0 < row <= step or not 0 < height * step <= len(data):
        return None
    pixels: np.ndarray = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    if size == 2:
        pixels = pixels.view(np.dtype(np.uint16).newbyteorder(">" if getattr(message, "is_bigendian", 0) else "<"))
        pixels = pixels.astype(np.uint16, copy=False)
    pixels = pixels.reshape(height, width, channels)
    return pixels.copy() if code is None else cv2.cvtColor(pixels, code)


def _uncompress(data: np.ndarray, format_: str, name: str) -> np.ndarray | None:
    """The RGB image of a compressed message. `format_` begins with the encoding before the compression, if any."""
    if codec := _VIDEO_CODECS.search(format_):
        raise VideoError(f"{name} is a video in {codec[0]}, not images; record JPEG or PNG, or convert it to mp4.")
    if "compresseddepth" in format_.lower():
        raise VideoError(f"{name} has depths ({format_!r}), not images of a camera; name the topic of one.")
    encoding = format_.partition(";")[0].strip().lower()
    if not len(data):
        return None
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        return None
    if image.ndim == 2:
        pattern = encoding.rstrip("0123456789")
        if encoding.startswith("bayer") and pattern not in _BAYER:
            raise VideoError(
                f"{name} has the format {format_!r}, an unknown mosaic; record one of {', '.join(_BAYER)}."
            )
        return cv2.cvtColor(image, _BAYER.get(pattern, cv2.COLOR_GRAY2RGB))
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB)


def decode_video(messages: Iterable[tuple[int, Any]], codec: str, name: str) -> Iterator[tuple[int, np.ndarray]]:
    """(index, RGB image) of (index, message) with a frame each of a video without B frames; damaged ones are left out.

    Raises VideoError about `name` if the codec is not known.
    """
    if codec not in _CODECS:
        raise VideoError(f"{name} is a video in {codec!r}; record {', '.join(_CODECS)}, or images.")
    context: Any = av.CodecContext.create(_CODECS[codec][0], "r")
    context.thread_count = 1  # more would hold frames back
    context.options = {"max_pixels": str(MAX_PIXELS)}
    for index, message in chain(messages, [(0, None)]):
        packet = av.Packet(bytes(message.data)) if message else None  # the last one flushes
        if packet is not None:
            packet.pts = index
        with suppress(av.FFmpegError):
            for frame in context.decode(packet):
                if not frame.is_corrupt and frame.pts is not None:
                    yield frame.pts, frame.to_ndarray(format="rgb24")


def is_key_frame(data: Any, codec: str) -> bool:
    """Whether the frame in the data of a message can be decoded without those before it; unknown ones are not."""
    _, shift, types = _CODECS.get(codec, ("", 0, ()))
    mask = 0x1F if shift == 0 else 0x3F
    units = re.finditer(rb"\x00\x00\x01(.)", bytes(data), re.DOTALL)
    return any((unit[1][0] >> shift) & mask in types for unit in units)
