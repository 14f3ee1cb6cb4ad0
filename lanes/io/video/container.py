"""Opening, scanning and decoding of local video files; damaged packets are skipped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av

from lanes.io.files import require_file
from lanes.io.images import MAX_PIXELS

# Formats of recorders, phones and editors. Playlists and lists of files (hls, dash, concat, image2) are excluded: they
# make FFmpeg open further files or network addresses that the author of the file chose.
FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,yuv4mpegpipe,gif"
# Frame rates that a 32-bit clock and the tracker can handle.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000
# A file was cut off if its header announces more than this beyond its last packet; some round to half a second.
CUT_OFF_S = 0.5
# The rate is constant if average rate and base rate differ by a smaller share than this.
SAME_RATE = 0.02


class VideoError(ValueError):
    """A video cannot be used; the message names the file, the fault and a remedy."""


@dataclass(frozen=True)
class PacketScan:
    """Frames stored, and missing or damaged; seconds shown, missing ones included; the first frame decoded."""

    frames: int
    missing: int
    duration_s: float
    first: av.VideoFrame


def open_video(path: str | Path) -> av.container.InputContainer:
    """Open a video file; FFmpeg cannot open any other file or address named in it.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    VideoError
        If it is not a video of one of `FORMATS`, or claims more than `MAX_PIXELS`.
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


def scan_packets(path: str | Path, container: av.container.InputContainer) -> PacketScan:
    """Count the frames of a video by its packets; only the first frame is decoded.

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
            # A clip cut without re-encoding begins with frames that are only references for later ones.
            if packet.size and not packet.is_discard:
                stamps.append(packet.pts)
            first = first or next(_decoded(packet), None)
    if first is None:
        raise VideoError(f"{path}: holds no frame that can be decoded; copy or export it again.")
    _refuse_cut_off(path, container, stored, end_s)
    rate = frame_rate(stream, path)
    missing = max(0, stream.frames - stored) or _count_gaps(stamps, rate, stream)
    return PacketScan(len(stamps), missing, round(float((len(stamps) + missing) / rate), 6), first)


def decode_frames(container: av.container.InputContainer, stream: av.stream.Stream) -> Iterator[av.frame.Frame]:
    """The undamaged frames of a stream in order."""
    for packet in container.demux(stream):
        yield from _decoded(packet)


def translate_errors(items: Iterator, path: str | Path) -> Iterator:
    """The same items; FFmpeg's errors become a VideoError that names `path`."""
    try:
        yield from items
    except av.FFmpegError as error:
        raise VideoError(f"{path}: is damaged ({error.strerror}); copy or export it again.") from error


def frame_rate(stream: av.VideoStream, path: str | Path) -> Fraction:
    """Frames per second.

    Raises
    ------
    VideoError
        If the file has no frame rate, or one outside `MIN_FPS` to `MAX_FPS`.
    """
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise VideoError(f"{path}: does not say its frame rate; convert it to mp4 first.")
    if not MIN_FPS <= rate <= MAX_FPS:
        raise VideoError(f"{path}: says that it has {float(rate):g} frames per second; convert it to mp4 first.")
    return rate


def frames_between(elapsed_s: Fraction | float, rate: Fraction, stream: av.VideoStream) -> int:
    """Difference of the frame numbers of two frames `elapsed_s` apart; 1 if the rate is not constant."""
    constant = stream.guessed_rate and abs(stream.guessed_rate / rate - 1) < SAME_RATE
    return max(1, round(elapsed_s * rate)) if constant else 1


def start_time(stream: av.VideoStream) -> Fraction:
    """Presentation time of the first frame on the container's clock, seconds; not 0 in transport streams."""
    return (stream.start_time or 0) * stream.time_base


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


def _count_gaps(stamps: list[int | None], rate: Fraction, stream: av.VideoStream) -> int:
    """Number of frames missing between time stamps; 0 if some packets have no time stamp."""
    if None in stamps:
        return 0
    times = sorted(pts * stream.time_base for pts in stamps)
    return sum(frames_between(later - earlier, rate, stream) - 1 for earlier, later in pairwise(times))


def _refuse_cut_off(path: str | Path, container: av.container.InputContainer, stored: int, end_s: float) -> None:
    """Refuse a file that ends before its header announces; frames missing in the middle are counted elsewhere."""
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
    """The frames that a packet completes; none from a damaged packet, and none that FFmpeg concealed errors in."""
    try:
        yield from (frame for frame in packet.decode() if not frame.is_corrupt)
    except av.FFmpegError:
        return
