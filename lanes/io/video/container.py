"""Opening and decoding of local video files; damaged packets are skipped."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from lanes.io.files import require_file
from lanes.io.images import MAX_PIXELS

# Formats of recorders, phones and editors. Playlists and lists of files (hls, dash, concat, image2) are excluded: they
# make FFmpeg open further files or network addresses that the author of the file chose.
FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,yuv4mpegpipe,gif"
# Frame rates that a 32-bit clock and the tracker can handle.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000


class VideoError(ValueError):
    """A video cannot be used; the message names the file, the fault and a remedy."""


def open_video(path: str | Path) -> av.container.InputContainer:
    """Open a video file; FFmpeg cannot open any other file or address named in it.

    Raises FileNotFoundError, or VideoError if it is not a video of one of `FORMATS` or claims more than `MAX_PIXELS`.
    """
    path = require_file(path, "video", error=VideoError)
    # FFmpeg decodes the first frames while it opens a file: the limit applies to these.
    options = {"protocol_whitelist": "file", "format_whitelist": FORMATS, "max_pixels": str(MAX_PIXELS)}
    try:
        # Without the prefix a name such as "concat:a.mp4" would select a protocol.
        container = av.open(f"file:{path}", options=options)
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: cannot be read as a video ({error.strerror}): it is not a video, a playlist, or cut off; copy it "
            "again, or convert it to mp4."
        ) from error
    try:
        _require_pictures(path, container)
    except VideoError:
        container.close()
        raise
    container.streams.video[0].codec_context.options = {"max_pixels": str(MAX_PIXELS)}
    return container


def decode_frames(container: av.container.InputContainer, stream: av.stream.Stream) -> Iterator[Any]:
    """The undamaged frames of a stream in order: of video or sound."""
    for packet in container.demux(stream):
        yield from decoded(packet)


def decoded(packet: av.Packet) -> Iterator[Any]:
    """The frames that a packet completes; none from a damaged packet, and none that FFmpeg concealed errors in."""
    try:
        yield from (frame for frame in packet.decode() if not frame.is_corrupt)
    except av.FFmpegError:
        return


def translate_errors(items: Iterator, path: str | Path) -> Iterator:
    """The same items; FFmpeg's errors become a VideoError that names `path`."""
    try:
        yield from items
    except av.FFmpegError as error:
        raise VideoError(f"{path}: is damaged ({error.strerror}); copy or export it again.") from error


def frame_rate(stream: av.VideoStream, path: str | Path) -> Fraction:
    """Frames per second; raises VideoError if the file has no frame rate, or one that is not usable."""
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise VideoError(f"{path}: does not say its frame rate; convert it to mp4 first.")
    if not MIN_FPS <= rate <= MAX_FPS:
        raise VideoError(f"{path}: says that it has {float(rate):g} frames per second; convert it to mp4 first.")
    return rate


def start_time(stream: av.VideoStream) -> Fraction:
    """Presentation time of the first frame on the container's clock, seconds; not 0 in transport streams."""
    if stream.start_time is None or stream.time_base is None:
        return Fraction(0)
    return stream.start_time * stream.time_base


def _require_pictures(path: Path, container: av.container.InputContainer) -> None:
    """Refuse a file without a video stream, without a decoder for it, or with too large pictures."""
    if not container.streams.video:
        kinds = " and ".join(sorted({stream.type for stream in container.streams})) or "none"
        raise VideoError(f"{path}: holds no frame of a video (its streams: {kinds}); name a video file.")
    codec = container.streams.video[0].codec_context
    if codec is None:
        raise VideoError(f"{path}: holds no frame that can be decoded; copy or export it again.")
    if codec.width * codec.height > MAX_PIXELS:
        raise VideoError(
            f"{path}: claims {codec.width}x{codec.height} pixels, more than the maximum of "
            f"{MAX_PIXELS / 1e6:.0f} million; convert it to a smaller size."
        )
