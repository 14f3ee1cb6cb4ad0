"""Video files, opened: local files only, looked through packet by packet, damaged packets left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av

from lanes.io.files import require_file
from lanes.io.images import MAX_PIXELS

# What recorders, phones and editors write. Playlists and lists of files (hls, dash, concat, image2) are left out: these
# open further files, or the network, by names that whoever made them has chosen.
FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,yuv4mpegpipe,gif"
# Frames in a second that a clock of 32 bits and a tracker can live with.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000
# A container that lasts so much longer than all that is in it was cut off; some round the length to half a second.
CUT_OFF_S = 0.5
# Rates by all frames and by the shortest step that differ by less than this are one: the rate is constant.
SAME_RATE = 0.02


class VideoError(ValueError):
    """A video cannot be used; the message names the file, what is wrong and what to do."""


@dataclass(frozen=True)
class PacketScan:
    """What the packets of a video tell: frames there, frames missing or damaged, seconds shown, the first frame."""

    frames: int
    missing: int
    duration_s: float
    first: av.VideoFrame


def open_video(path: str | Path) -> av.container.InputContainer:
    """Open a file that must exist and hold a video stream; nothing but this file is read, whatever is in it."""
    path = require_file(path, "video", error=VideoError)
    # The limit is for the look at the first frames that FFmpeg takes when it opens a file.
    options = {"protocol_whitelist": "file", "format_whitelist": FORMATS, "max_pixels": str(MAX_PIXELS)}
    try:
        # The prefix keeps names such as "concat:a.mp4" what they are.
        container = av.open(f"file:{path}", options=options)
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: cannot be read as a video ({error.strerror}): it is none, a playlist, or it was cut off; copy it "
            "again, or convert it to mp4."
        ) from error
    try:
        _require_pictures(path, container)
    except VideoError:
        container.close()
        raise
    container.streams.video[0].codec_context.options = {"max_pixels": str(MAX_PIXELS)}
    return container


def scan_packets(path: str | Path, container: av.container.InputContainer) -> PacketScan:
    """Count the packets of a video; only the first frame that can be is decoded.

    Raises
    ------
    VideoError
        If no frame can be decoded, or the file was cut off.
    """
    stream = container.streams.video[0]
    stored, stamps, end_s, first = 0, [], 0.0, None
    for packet in translate_errors(container.demux(), path):
        if packet.pts is not None:
            end_s = max(end_s, float((packet.pts + (packet.duration or 0)) * packet.time_base))
        if packet.stream is stream:
            stored += packet.size > 0
            # A clip that was cut without encoding it again begins with frames that serve only to decode the others.
            if packet.size and not packet.is_discard:
                stamps.append(packet.pts)
            first = first or next(_decoded(packet), None)
    if first is None:
        raise VideoError(f"{path}: holds no frame that can be decoded; copy or export it again.")
    _require_whole(path, container, stored, end_s)
    rate = frame_rate(stream, path)
    missing = max(0, stream.frames - stored) or _holes(stamps, rate, stream)
    return PacketScan(len(stamps), missing, round(float((len(stamps) + missing) / rate), 6), first)


def decode_frames(container: av.container.InputContainer, stream: av.stream.Stream) -> Iterator[av.frame.Frame]:
    """The frames of a stream in order, without those that are damaged."""
    for packet in container.demux(stream):
        yield from _decoded(packet)


def translate_errors(items: Iterator, path: str | Path) -> Iterator:
    """The same items; FFmpeg's errors on the way become sentences."""
    try:
        yield from items
    except av.FFmpegError as error:
        raise VideoError(f"{path}: is damaged ({error.strerror}); copy or export it again.") from error


def frame_rate(stream: av.VideoStream, path: str | Path) -> Fraction:
    """Frames per second; refuses a file that does not tell it, or one that is none."""
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise VideoError(f"{path}: does not say its frame rate; convert it to mp4 first.")
    if not MIN_FPS <= rate <= MAX_FPS:
        raise VideoError(f"{path}: says that it has {float(rate):g} frames per second; convert it to mp4 first.")
    return rate


def frames_between(elapsed_s: Fraction | float, rate: Fraction, stream: av.VideoStream) -> int:
    """How many frames further a frame is that comes `elapsed_s` after another one: 1 where the rate is not constant."""
    constant = stream.guessed_rate and abs(stream.guessed_rate / rate - 1) < SAME_RATE
    return max(1, round(elapsed_s * rate)) if constant else 1


def start_time(stream: av.VideoStream) -> Fraction:
    """When the first frame is shown, in the container's seconds: not 0 in transport streams."""
    return (stream.start_time or 0) * stream.time_base


def _require_pictures(path: Path, container: av.container.InputContainer) -> None:
    """Refuse a file without pictures, or with such that nobody could decode or keep in memory."""
    if not container.streams.video:
        kinds = " and ".join(sorted({stream.type for stream in container.streams})) or "none"
        raise VideoError(f"{path}: holds no frame of a video (its streams: {kinds}); name a video file.")
    codec = container.streams.video[0].codec_context
    if codec is None:
        raise VideoError(f"{path}: holds no frame that can be decoded; copy or export it again.")
    if codec.width * codec.height > MAX_PIXELS:
        raise VideoError(
            f"{path}: claims {codec.width}x{codec.height} pixels, more than this program takes "
            f"({MAX_PIXELS / 1e6:.0f} million); convert it to a smaller size."
        )


def _holes(stamps: list[int | None], rate: Fraction, stream: av.VideoStream) -> int:
    """Frames that are missing between those with these time stamps; 0 where some have none."""
    if None in stamps:
        return 0
    times = sorted(pts * stream.time_base for pts in stamps)
    return sum(frames_between(later - earlier, rate, stream) - 1 for earlier, later in pairwise(times))


def _require_whole(path: str | Path, container: av.container.InputContainer, stored: int, end_s: float) -> None:
    """Refuse a file that holds less than its header announces, at its end; what is missing inside is told later."""
    stream = container.streams.video[0]
    announced_s = ((container.duration or 0) + (container.start_time or 0)) / av.time_base
    frame_s = float(1 / frame_rate(stream, path))
    in_frames_s = float(start_time(stream)) + stream.frames * frame_s
    if announced_s - end_s > CUT_OFF_S or (stored < stream.frames and in_frames_s - end_s > 1.5 * frame_s):
        announced_s = max(announced_s, in_frames_s)
        raise VideoError(
            f"{path}: is cut off after {end_s:.2f} of the {announced_s:.2f} s that it announces; copy it again."
        )


def _decoded(packet: av.Packet) -> Iterator[av.frame.Frame]:
    """The frames that a packet completes; none where it is damaged, and none that FFmpeg has patched up."""
    try:
        yield from (frame for frame in packet.decode() if not frame.is_corrupt)
    except av.FFmpegError:
        return
