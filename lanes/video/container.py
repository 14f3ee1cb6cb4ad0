"""Video files opened through PyAV (FFmpeg inside this process): their packets, frames, rate and clock."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import InputContainer
from av.sidedata.sidedata import Type as SideDataType

from lanes.errors import VideoError
from lanes.files import require_file
from lanes.images import MAX_PIXELS, upright_axes

# Formats of recorders, phones and editors. Playlists and lists of files (hls, dash, concat, image2) are excluded: they
# make FFmpeg open further files or network addresses that the author of the file chose.
FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,yuv4mpegpipe,gif"
# Formats whose packets have a place in the order of decoding only. FFmpeg's guesses of presentation times are wrong for
# reordered frames and at gaps; players show a frame at the place of the packet that completes it.
_WITHOUT_PRESENTATION_TIMES = ("avi", "mpegvideo")
# Frame rates that a 32-bit clock and the tracker can handle.
MIN_FPS, MAX_FPS = Fraction(1, 10), 1000
# A larger step back in time is a recorder's restarted clock, as in concatenated clips.
CLOCK_RESET_S = 0.25
# A larger step forward is a clock that was set, as by the first report of an RTP stream, which is since the year 1900.
CLOCK_SET_S = 86_400.0
# More frames of the usual rate than this are not missing in a hole: another recording begins behind it.
JUMP_FRAMES = 1500
# Up to so many frames in a row whose time stamps leave the order, and come back to it, are outliers.
MAX_OUTLIERS = 4
# The rate varies if more than this share of the frames follow sooner than this, in frames of a constant rate.
MIN_STEP, MAX_SHORT_SHARE = 0.75, 0.1
# A smaller share of the base rate is an average rate that may include jumps in time.
_MIN_RATE_SHARE = 0.9
# The rate is constant if average rate and base rate differ by a smaller share than this.
_SAME_RATE = 0.02
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
    placed, last = container.format.name in _WITHOUT_PRESENTATION_TIMES, None
    for packet in read_packets(container, stream):
        for frame in decode_packet(packet):
            if placed:
                # the last frames are completed by the end of the file
                frame.pts = frame.dts if frame.dts is not None or last is None else last + _frame_ticks(stream)
                last = frame.pts
            if not frame.is_corrupt:
                yield frame


def _frame_ticks(stream: av.VideoStream) -> int:
    """Length of a frame in units of the stream's time base, at its rate; at least 1."""
    rate, tick = stream.average_rate or stream.guessed_rate, stream.time_base
    return max(round(1 / (rate * tick)), 1) if rate and tick else 1


def frame_orientation(frame: av.VideoFrame) -> int:
    """The EXIF orientation of a frame by its display matrix, to the nearest quarter turn; 1 without one."""
    side_data: Any = frame.side_data  # PyAV's types know its numbers only
    matrix = side_data.get(SideDataType.DISPLAYMATRIX)
    if matrix is None:
        return 1
    # of a row vector (column, row) in the stored image to one on the screen (libavutil/display.h)
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5].tolist()
    axes = np.sign([(a, 0), (0, d)] if abs(a) >= abs(c) else [(0, c), (b, 0)])
    return next((n for n in range(1, 9) if (upright_axes(n) == axes).all()), 1)


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
    """Frames per second, without jumps in time; raises VideoError if there is no frame rate, or one not usable."""
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise VideoError(f"{path}: does not say its frame rate; convert it to mp4 first.")
    if rate < MIN_FPS or rate < _MIN_RATE_SHARE * float(stream.guessed_rate or rate):
        steps = np.diff(frame_stamps(path))
        usual = steps[steps <= JUMP_FRAMES * np.median(steps)] if len(steps) else steps
        if stream.time_base and len(usual) < len(steps) and usual.any():
            rate = Fraction(1 / float(usual.mean() * stream.time_base)).limit_denominator(1001)
    if not MIN_FPS <= rate <= MAX_FPS:
        raise VideoError(f"{path}: says that it has {float(rate):g} frames per second; convert it to mp4 first.")
    return rate


def rate_is_constant(rate: Fraction, stream: av.VideoStream) -> bool:
    """Whether the average rate of a stream is also that of its steps."""
    return stream.guessed_rate is not None and abs(stream.guessed_rate / rate - 1) < _SAME_RATE


def frame_stamps(path: str | Path) -> np.ndarray:
    """Time stamps (N,) of the frames that are shown, sorted; the file is read once for calls in a row."""
    file = Path(path).stat()
    return _sorted_stamps(str(path), file.st_mtime_ns, file.st_size)


@lru_cache(maxsize=2)
def _sorted_stamps(path: str, *version: int) -> np.ndarray:
    with open_video(path) as container:
        packets = read_packets(container, container.streams.video[0])
        return np.sort([p.pts for p in packets if p.size and not p.is_discard and p.pts is not None])


def start_time(path: str | Path) -> Fraction:
    """Presentation time of a video's first frame on the container's clock, seconds; it may be damaged.

    The packets are read for it, once for calls in a row: FFmpeg looks at the first five seconds only, where a video may
    begin later than its sound.
    """
    file = Path(path).stat()
    return _start_time(str(path), file.st_mtime_ns, file.st_size)


@lru_cache(maxsize=16)
def _start_time(path: str, *version: int) -> Fraction:
    with open_video(path) as container:
        stream, stamps = container.streams.video[0], []
        placed = container.format.name in _WITHOUT_PRESENTATION_TIMES
        for packet in read_packets(container, stream):
            if packet.size and not packet.is_discard and packet.pts is not None:
                stamps.append(packet.dts if placed else packet.pts)
            if first := next(decode_packet(packet), None):
                if placed and stream.codec_context.has_b_frames and first.dts is not None:
                    stamps = [first.dts]
                break
        return min((stamp for stamp in stamps if stamp is not None), default=0) * (stream.time_base or Fraction(0))


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
