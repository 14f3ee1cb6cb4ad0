"""Images of robot logs: raw and compressed messages, and those of a video, to RGB."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from typing import Any

import av
import cv2
import numpy as np

from lanes.errors import VideoError
from lanes.recording import BITS, MAX_PIXELS, to_8_bits


@dataclass(frozen=True)
class _Encoding:
    """How a raw image is stored: values of a pixel, and OpenCV's conversion to RGB.

    `bytes_each` are those of a value. The conversion of RGB is None.
    """

    channels: int
    to_rgb: int | None
    bytes_each: int = 1


# Channels and conversion by the beginning of a name that ends in the number of bits.
_COLOURS: dict[str, tuple[int, int | None]] = {
    "rgb": (3, None),
    "bgr": (3, cv2.COLOR_BGR2RGB),
    "rgba": (4, cv2.COLOR_RGBA2RGB),
    "bgra": (4, cv2.COLOR_BGRA2RGB),
    "mono": (1, cv2.COLOR_GRAY2RGB),
}
_BAYER = {
    "bayer_rggb": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg": cv2.COLOR_BayerGRBG2RGB,
}


def _make_encodings() -> dict[str, _Encoding]:
    """Encodings by their names in sensor_msgs/image_encodings.hpp and of drivers."""
    encodings = {
        "8UC1": _Encoding(1, cv2.COLOR_GRAY2RGB),
        "8UC3": _Encoding(3, cv2.COLOR_BGR2RGB),
        "8UC4": _Encoding(4, cv2.COLOR_BGRA2RGB),
        "16UC3": _Encoding(3, cv2.COLOR_BGR2RGB, 2),
    }
    for name in ("yuv422", "uyvy"):
        encodings[name] = _Encoding(2, cv2.COLOR_YUV2RGB_UYVY)
    for name in ("yuv422_yuy2", "yuyv", "yuy2"):
        encodings[name] = _Encoding(2, cv2.COLOR_YUV2RGB_YUY2)
    for bits in BITS:
        bytes_each = 1 if bits == 8 else 2
        for name, (channels, to_rgb) in _COLOURS.items():
            encodings[f"{name}{bits}"] = _Encoding(channels, to_rgb, bytes_each)
        for name, to_rgb in _BAYER.items():
            encodings[f"{name}{bits}"] = _Encoding(1, to_rgb, bytes_each)
    return encodings


_ENCODINGS = _make_encodings()
# A plane of brightness, and one or two of colour below it, half as high in all.
_PLANAR = {
    "nv12": cv2.COLOR_YUV2RGB_NV12,
    "nv21": cv2.COLOR_YUV2RGB_NV21,
    "i420": cv2.COLOR_YUV2RGB_I420,
}
# Named where an encoding is refused.
_COMMON = (
    "rgb8, bgr8, rgba8, bgra8, mono8, bayer_*8, the same with 16, yuv422, yuv422_yuy2, "
    "nv12"
)
# Formats of compressed messages that are not an image each.
_VIDEO_CODECS = re.compile(
    r"\b(h\.?26[45]|avc|hevc|av1|vp[89]|theora)\b", re.IGNORECASE
)


@dataclass(frozen=True)
class _Codec:
    """A codec of foxglove.CompressedVideo: names of FFmpeg's decoders, and key frames.

    A key frame has a unit (NAL) of one of `key_units`. The type of a unit is in its
    first byte: `mask` after a shift by `shift` bits.
    """

    decoders: tuple[str, ...]
    key_units: Iterable[int] = ()
    shift: int = 0
    mask: int = 0


_CODECS = {
    "h264": _Codec(("h264",), key_units=(5,), mask=0x1F),
    "h265": _Codec(("hevc",), key_units=range(16, 22), shift=1, mask=0x3F),
    "vp9": _Codec(("vp9", "libvpx-vp9")),
    # FFmpeg's own, "av1", needs a graphics card
    "av1": _Codec(("libdav1d", "libaom-av1", "av1")),
}


def decode_image(
    message: Any, name: str = "image", *, bits: int | None = None
) -> np.ndarray | None:
    """The RGB image (height, width, 3), uint8, of a message; None if it is damaged.

    `bits` are those of its values if they have two bytes, see `count_bits`; by default
    what the image itself shows. Raises VideoError about `name` if the encoding or the
    format is not one that is read.
    """
    image = _unpack(message, name)
    return None if image is None else to_8_bits(image, bits)


def find_peak(message: Any, name: str) -> int:
    """The largest value of an image, if its values have two bytes; 0 of all others."""
    image = _unpack(message, name)
    if image is None or image.dtype != np.uint16:
        return 0
    return int(image.max())


def _unpack(message: Any, name: str) -> np.ndarray | None:
    """The RGB image, uint8 or uint16; see `decode_image`."""
    data = np.frombuffer(message.data, np.uint8)
    if hasattr(message, "format"):
        return _uncompress(data, str(message.format), name)
    if message.encoding in _PLANAR:
        return _unpack_planes(message, data)
    encoding = _ENCODINGS.get(message.encoding)
    if encoding is None:
        unknown = f"the encoding {message.encoding!r}"
        raise VideoError(f"{name} has {unknown}; record one of {_COMMON}.")

    row_bytes = message.width * encoding.channels * encoding.bytes_each
    rows = _cut_rows(data, message.height, message.step, row_bytes)
    if rows is None:
        return None
    if encoding.bytes_each == 2:
        stored = np.dtype(">u2" if getattr(message, "is_bigendian", 0) else "<u2")
        rows = rows.view(stored).astype(np.uint16, copy=False)
    pixels = rows.reshape(message.height, message.width, encoding.channels)
    if encoding.to_rgb is None:
        return pixels.copy()
    return cv2.cvtColor(pixels, encoding.to_rgb)


def _unpack_planes(message: Any, data: np.ndarray) -> np.ndarray | None:
    """The RGB image of planes of brightness and colour."""
    rows = message.height * 3 // 2
    if message.width % 2 or rows % 3:
        return None
    if message.encoding == "i420" and message.step > message.width:
        return None  # its planes of colour have half the step
    planes = _cut_rows(data, rows, message.step, message.width)
    if planes is None:
        return None
    return cv2.cvtColor(planes, _PLANAR[message.encoding])


def _cut_rows(
    data: np.ndarray, height: int, step: int, row_bytes: int
) -> np.ndarray | None:
    """The bytes (height, row_bytes) of rows that begin each `step`; None if cut off."""
    if not 0 < row_bytes <= step or not 0 < height * step <= len(data):
        return None
    stored = data[: height * step].reshape(height, step)
    return np.ascontiguousarray(stored[:, :row_bytes])


def _uncompress(data: np.ndarray, format_: str, name: str) -> np.ndarray | None:
    """The RGB image of a compressed message.

    `format_` begins with the encoding before the compression, if any.
    """
    codec = _VIDEO_CODECS.search(format_)
    if codec:
        raise VideoError(
            f"{name} is a video in {codec[0]}, not images; record JPEG or PNG, or "
            "convert it to mp4."
        )
    if "compresseddepth" in format_.lower():
        raise VideoError(
            f"{name} has depths ({format_!r}), not images of a camera; "
            "name the topic of one."
        )
    if not len(data):
        return None

    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        return None
    if image.ndim == 2:
        return cv2.cvtColor(image, _gray_conversion(format_, name))
    has_alpha = image.shape[2] == 4
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGB if has_alpha else cv2.COLOR_BGR2RGB)


def _gray_conversion(format_: str, name: str) -> int:
    """OpenCV's conversion to RGB of one channel: gray, or a mosaic of filters."""
    encoding = format_.partition(";")[0].strip().lower()
    pattern = encoding.rstrip("0123456789")
    if pattern in _BAYER:
        return _BAYER[pattern]
    if encoding.startswith("bayer"):
        known = ", ".join(_BAYER)
        raise VideoError(
            f"{name} has the format {format_!r}, an unknown mosaic; "
            f"record one of {known}."
        )
    return cv2.COLOR_GRAY2RGB


def decode_video(
    messages: Iterable[tuple[int, Any]], codec: str, name: str
) -> Iterator[tuple[int, np.ndarray]]:
    """Index and RGB image of the frames of a video without B frames.

    `messages` are (index, message) with a frame each; damaged ones are left out. Raises
    VideoError about `name` if the codec is not known.
    """
    if codec not in _CODECS:
        known = ", ".join(_CODECS)
        raise VideoError(f"{name} is a video in {codec!r}; record {known}, or images.")
    decoders = [name for name in _CODECS[codec].decoders if name in av.codecs_available]
    if not decoders:
        raise VideoError(
            f"{name} is a video in {codec!r}, which this FFmpeg cannot decode; record "
            "h264, or images."
        )
    context: Any = av.CodecContext.create(decoders[0], "r")
    context.thread_count = 1  # more would hold frames back
    context.options = {"max_pixels": str(MAX_PIXELS)}

    end_of_stream = (0, None)
    for index, message in chain(messages, [end_of_stream]):
        packet = None
        if message is not None:
            packet = av.Packet(bytes(message.data))
            packet.pts = index
        with suppress(av.FFmpegError):
            for frame in context.decode(packet):
                if not frame.is_corrupt and frame.pts is not None:
                    yield frame.pts, frame.to_ndarray(format="rgb24")


def is_key_frame(data: Any, codec: str) -> bool:
    """Whether a frame can be decoded without those before it; unknown ones are not."""
    if codec not in _CODECS:
        return False
    found = _CODECS[codec]
    for unit in re.finditer(rb"\x00\x00\x01(.)", bytes(data), re.DOTALL):
        unit_type = (unit[1][0] >> found.shift) & found.mask
        if unit_type in found.key_units:
            return True
    return False
