"""Video files opened through PyAV (FFmpeg inside this process): their packets, and what one pass over these says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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
from lanes.images import MAX_PIXELS, is_transposed, upright_axes

# Formats of recorders, phones and editors. Playlists and lists of files (hls, dash, concat, image2) are excluded: they
# make FFmpeg open further files or network addresses that the author of the file chose.
_FORMATS = "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,yuv4mpegpipe,gif"
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
# The rate varies if more than this share of the frames follow sooner than this, in frames of a constant rate.
MIN_STEP, MAX_SHORT_SHARE = 0.75, 0.1
_NOT_DECODED = "holds no frame that can be decoded; copy or export it again."


@dataclass(frozen=True)
class VideoInfo:
    """Properties of a video file.

    Width and height are those shown, after rotation and with square pixels. `missing` counts frames that the header
    announces or the time stamps have gaps for, but that are not in the file.
    """

    width: int
    height: int
    fps: float
    frames: int
    duration_s: float
    has_audio: bool
    missing: int = 0
    topic: str | None = None  # of the images in a robot log
    orientation: int = 1  # in EXIF, as the display matrix says
    note: str = ""  # what was changed of the times of a robot log, in words

    @property
    def mirrored(self) -> bool:
        """Whether the display matrix mirrors the stored images, as players show it."""
        return self.orientation in (2, 4, 5, 7)


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """What one pass over the packets of a video says.

    `rate` is in frames per second; `constant_rate` says whether that is also the rate of the steps. `start_s` is the
    presentation time of the first frame on the container's clock; it may be damaged. `stamps` (N,) are those of the
    frames that are shown, sorted.
    """

    info: VideoInfo
    rate: Fraction
    constant_rate: bool
    start_s: Fraction
    stamps: np.ndarray


def open_video(path: str | Path) -> InputContainer:
    """Open a video file; FFmpeg cannot open any other file or address named in it.

    Raises FileNotFoundError, or VideoError if it is not a video of one of `_FORMATS` or claims more than `MAX_PIXELS`.
    """
    path = require_file(path, "video", error=VideoError)
    # FFmpeg decodes the first frames while it opens a file: the limit applies to these, and below to all others.
    options = {"protocol_whitelist": "file", "format_whitelist": _FORMATS, "max_pixels": str(MAX_PIXELS)}
    try:
        # Without the prefix a name such as "concat:a.mp4" would select a protocol.
        container = av.open(f"file:{path}", options=options)
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: cannot be read as a video ({error.strerror}): it is not a video, a playlist, or cut off; copy it "
            "again, or convert it to mp4."
        ) from error
    streams = container.streams
    if not streams.video or streams.video[0].codec_context is None:
        kinds = " and ".join(sorted({stream.type for stream in streams})) or "none"
        without = f"holds no frame of a video (its streams: {kinds}); name a video file."
        fault = _NOT_DECODED if streams.video else without
        container.close()
        raise VideoError(f"{path}: {fault}")
    streams.video[0].codec_context.options = {"max_pixels": str(MAX_PIXELS)}
    return container


def decode_frames(container: InputContainer, stream: av.VideoStream) -> Iterator[av.VideoFrame]:
    """The undamaged frames of a video stream in order."""
    placed, last = container.format.name in _WITHOUT_PRESENTATION_TIMES, None
    for packet in read_packets(container, stream):
        for frame in decode_packet(packet):
            if placed:
                if frame.dts is None and last is not None:  # the last frames are completed by the end of the file
                    rate, tick = stream.average_rate or stream.guessed_rate, stream.time_base
                    frame.pts = last + max(round(1 / (rate * tick)) if rate and tick else 1, 1)
                else:
                    frame.pts = frame.dts
                last = frame.pts
            if not frame.is_corrupt:
                yield frame


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
    """The packets of these or all streams; a file that is damaged after some packets ends there.

    Raises VideoError if it is damaged before.
    """
    count = 0
    try:
        for packet in container.demux(*streams):
            yield packet
            count += 1
    except av.FFmpegError as error:
        if not count:
            path = container.name.removeprefix("file:")
            raise VideoError(f"{path}: is damaged ({error.strerror}); copy or export it again.") from error


def index_video(path: str | Path, *, whole: bool = True) -> VideoIndex:
    """The index of a video, made once for calls in a row; one frame is decoded.

    If not the `whole` file is needed, it is read up to the first frame, unless its rate includes jumps in time: `info`
    and `stamps` are those of the packets up to there. A file that was cut off has its frames up to there. Raises
    FileNotFoundError, or VideoError if the file is empty, not a video, without frames, or without a usable frame rate.
    """
    file = require_file(path, "video", error=VideoError).stat()
    return _index_video(str(path), whole, file.st_mtime_ns, file.st_size)


@lru_cache(maxsize=16)
def _index_video(path: str, whole: bool, *version: int) -> VideoIndex:
    with open_video(path) as container:
        stream, stored, end_s, early, first = container.streams.video[0], 0, 0.0, 0, None
        shown: list[tuple[int | None, int | None]] = []  # time stamps of presentation and of decoding
        for packet in read_packets(container):
            if packet.pts is not None:
                end_s = max(end_s, float((packet.pts + (packet.duration or 0)) * packet.time_base))
            if packet.stream is stream:
                stored += packet.size > 0
                # A clip cut without re-encoding begins with frames that are only references for later ones.
                if packet.size and not packet.is_discard:
                    shown.append((packet.pts, packet.dts))
                if first is None:
                    early, first = len(shown), next(decode_packet(packet), None)
                if first is not None and not whole and not _has_jumps(stream):
                    break
        if first is None:
            raise VideoError(f"{path}: {_NOT_DECODED}")
        stamps = np.sort([pts for pts, _ in shown if pts is not None])
        rate = _frame_rate(stream, stamps, path)
        # average rate and base rate differ by less than 2 %
        constant = stream.guessed_rate is not None and abs(stream.guessed_rate / rate - 1) < 0.02
        length_s, gaps = _measure_stamps([pts for pts, _ in shown], rate, stream.time_base, constant)
        orientation = frame_orientation(first)
        width, height = square_size(first, stream)[:: -1 if is_transposed(orientation) else 1]
        info = VideoInfo(
            width=width,
            height=height,
            fps=float(rate),
            frames=len(shown),
            duration_s=round(length_s, 6),
            has_audio=bool(container.streams.audio),
            missing=max(stream.frames - stored, gaps + _count_cut_off(container, rate, end_s)),
            orientation=orientation,
        )
        return VideoIndex(info, rate, constant, _start_s(container, shown[:early], first), stamps)


def _start_s(container: InputContainer, packets: Sequence[tuple], first: av.VideoFrame) -> Fraction:
    """Presentation time of the first frame by the stamps of the packets up to that which completes it, seconds.

    FFmpeg's own start time is that of the first five seconds, where a video may begin later than its sound.
    """
    stream, placed = container.streams.video[0], container.format.name in _WITHOUT_PRESENTATION_TIMES
    stamps = [dts if placed else pts for pts, dts in packets if pts is not None]
    if placed and stream.codec_context.has_b_frames and first.dts is not None:
        stamps = [first.dts]
    return min((stamp for stamp in stamps if stamp is not None), default=0) * (stream.time_base or Fraction(0))


def square_size(frame: av.VideoFrame, stream: av.VideoStream) -> tuple[int, int]:
    """Width and height of a frame before rotation, one of them enlarged so that the pixels are square."""
    aspect = stream.sample_aspect_ratio or Fraction(1)
    if not Fraction(1, 4) <= aspect <= 4:  # nonsense
        aspect = Fraction(1)
    return round(frame.width * max(aspect, Fraction(1))), round(frame.height / min(aspect, Fraction(1)))


def _has_jumps(stream: av.VideoStream) -> bool:
    """Whether the average rate of a stream is so low, less than 0.9 of the base rate, that it may include jumps."""
    rate = stream.average_rate or stream.guessed_rate or MIN_FPS
    return rate < MIN_FPS or rate < 0.9 * float(stream.guessed_rate or rate)


def _frame_rate(stream: av.VideoStream, stamps: np.ndarray, path: str) -> Fraction:
    """Frames per second, without jumps in time; raises VideoError if there is no frame rate, or one not usable."""
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise VideoError(f"{path}: has no frame rate; convert it to mp4 first.")
    if _has_jumps(stream):
        steps = np.diff(stamps)
        usual = steps[steps <= JUMP_FRAMES * np.median(steps)] if len(steps) else steps
        if stream.time_base and len(usual) < len(steps) and usual.any():
            rate = Fraction(1 / float(usual.mean() * stream.time_base)).limit_denominator(1001)
    if not MIN_FPS <= rate <= MAX_FPS:
        raise VideoError(f"{path}: states an implausible {float(rate):g} frames per second; convert it to mp4 first.")
    return rate


def _measure_stamps(
    stamps: Sequence[int | None], rate: Fraction, tick: Fraction | None, constant_rate: bool
) -> tuple[float, int]:
    """Length in seconds from the first frame to the end of the last, and number of frames missing in between.

    It is 0 if some packets have no time stamp, or if the rate is not constant. Outliers do not count, nor do the holes
    between two recordings.
    """
    known, length_s = [pts for pts in stamps if pts is not None], float(len(stamps) / rate)
    if tick is None or not known or len(known) < len(stamps):
        return length_s, 0
    # in frames; floats, because thousands of fractions take longer than to read the file
    order = np.argsort(known, kind="stable")
    # no codec reorders 16 frames
    places, away = np.array(known)[order] * float(tick * rate), np.abs(order - np.arange(len(order))) > 16
    if away.mean() < MAX_SHORT_SHARE:
        places = places[~away]
    steps = np.diff(places)
    steps[steps > CLOCK_SET_S * float(rate)] = 1
    if not constant_rate or (steps < MIN_STEP).sum() > MAX_SHORT_SHARE * len(steps):
        return (float((steps.sum() + 1) / rate) if (steps > JUMP_FRAMES).any() else length_s), 0
    gaps = np.maximum(np.rint(steps) - 1, 0)
    length, outliers = len(places) + int(gaps.sum()), len(known) - len(places)
    return float(length / rate), max(count_missing(gaps) - outliers, 0)


def count_missing(gaps: np.ndarray) -> int:
    """Number of frames missing in `gaps` (N,) between frames; longer ones than `JUMP_FRAMES` are no loss."""
    return int(gaps[gaps <= JUMP_FRAMES].sum())


def _count_cut_off(container: InputContainer, rate: Fraction, end_s: float) -> int:
    """Number of frames that the header announces beyond the last packet, at `end_s`."""
    # In Matroska and NUT the duration counts from zero, in all others from the first packet.
    begin = 0 if {"matroska", "nut"} & {*container.format.name.split(",")} else container.start_time or 0
    cut_off_s = ((container.duration or 0) + begin) / av.time_base - end_s
    return round(cut_off_s * rate) if cut_off_s > 0.5 else 0  # some headers round to half a second


def decode_packet(packet: av.Packet) -> Iterator[Any]:
    """The frames that a packet completes; none from a damaged packet."""
    try:
        yield from packet.decode()
    except av.FFmpegError:
        return
