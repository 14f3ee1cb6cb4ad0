"""Video files opened through PyAV (FFmpeg inside this process): their packets, frames, rate and clock."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import av
from av.container import InputContainer

from lanes.errors import VideoError
from lanes.files import require_file
from lanes.images import MAX_PIXELS

# Formats of recorders, phones and editors. Playlists and lists of files (hls, dash, concat, image2) are excluded: they
# make FFmpeg open further files or network addresses that the author of the file chose.
FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,yuv4mpegpipe,gif"
# Formats without presentation times. FFmpeg's guesses are in order for packets, and out of order for frames that were
# reordered.
WITHOUT_PRESENTATION_TIMES = ("avi", "mpegvideo")
# Frame rates that a 32-bit clock and the tracker can handle.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000
# A larger step back in time is a recorder's restarted clock, as in concatenated clips.
CLOCK_RESET_S = 0.25
# The rate varies if more than this share of the frames follow sooner than this, in frames of a constant rate.
MIN_STEP, MAX_SHORT_SHARE = 0.75, 0.1
NOT_DECODED = "holds no frame that can be decoded; copy or export it again."


def open_video(path: str | Path) -> InputContainer:
    """Open a video file; FFmpeg cannot open any other file or address named in it.

    Raises FileNotFoundError, or VideoError if it is not a video of one of `FORMATS` or claims more than `MAX_PIXELS`.
    """
    path = require_file(path, "video", error=VideoError)
    # FFmpeg decodes the first frames while it opens a file: the limit applies to these, and below to all others.
    options = {"protocol_whitelist": "file", "format_whitelist": FORMATS, "max_pixels": str(MAX_PIXELS)}
    try:
        # Without the prefix a name such as "concat:a.mp4" would select a protocol.
        container = av.open(f"file:{path}", options=options)
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: cannot be read as a video ({error.strerror}): it is not a video, a playlist, or cut off; copy it "
            "again, or convert it to mp4."
        ) from error
    if fault := _describe_fault(container):
        container.close()
        raise VideoError(f"{path}: {fault}")
    container.streams.video[0].codec_context.options = {"max_pixels": str(MAX_PIXELS)}
    return container


def decode_frames(container: InputContainer, stream: av.VideoStream) -> Iterator[av.VideoFrame]:
    """The undamaged frames of a video stream in order."""
    ordered = container.format.name in WITHOUT_PRESENTATION_TIMES
    stamps: list[int] = []  # of packets whose frames are not decoded yet
    for packet in read_packets(container, stream):
        if ordered and packet.size and packet.pts is not None:
            heappush(stamps, packet.pts)
        for frame in decode_packet(packet):
            if stamps:
                frame.pts = heappop(stamps)
            if not frame.is_corrupt:
                yield frame


def read_packets(container: InputContainer, *streams: av.stream.Stream) -> Iterator[av.Packet]:
    """The packets of these or all streams; a file that is damaged after some packets ends there."""
    count = 0
    try:
        for packet in container.demux(*streams):
            yield packet
            count += 1
    except av.FFmpegError:
        if not count:
            raise


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


def start_time(stream: av.VideoStream, path: str | Path) -> Fraction:
    """Presentation time of the first frame on the container's clock, seconds; not 0 in transport streams."""
    if stream.time_base is None:
        return Fraction(0)
    stamp = stream.start_time
    if stream.container.format.name in WITHOUT_PRESENTATION_TIMES:
        with open_video(path) as container:
            stamp = next((packet.pts for packet in read_packets(container, container.streams.video[0])), None)
    return (stamp or 0) * stream.time_base


def _describe_fault(container: InputContainer) -> str:
    """What is wrong with a file without a video stream or a decoder for it; else empty."""
    if not container.streams.video:
        kinds = " and ".join(sorted({stream.type for stream in container.streams})) or "none"
        return f"holds no frame of a video (its streams: {kinds}); name a video file."
    return NOT_DECODED if container.streams.video[0].codec_context is None else ""


def decode_packet(packet: av.Packet) -> Iterator[Any]:
    """The frames that a packet completes; none from a damaged packet."""
    try:
        yield from packet.decode()
    except av.FFmpegError:
        return
