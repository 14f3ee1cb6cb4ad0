"""Video files opened through PyAV (FFmpeg inside this process): their properties, and
their frames one by one.

One pass over the packets gives the index of a file. `read_timed_frames` is the one way
that frames are read; damaged ones are skipped, and the others keep their times.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from itertools import chain, islice
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.bitstream import BitStreamFilterContext
from av.container import InputContainer
from av.sidedata.sidedata import Type as SideDataType
from av.video.reformatter import VideoReformatter

from lanes.console import progress_bar
from lanes.equality import ByValue
from lanes.errors import VideoError, require_number
from lanes.files import require_file, require_path
from lanes.recording import (
    CLOCK_RESET_S,
    JUMP_FRAMES,
    MAX_FPS,
    MAX_PIXELS,
    MAX_SHORT_SHARE,
    MIN_FPS,
    MIN_STEP,
    to_8_bits,
    usual_rate,
)
from lanes.ros.log_files import is_robot_log
from lanes.ros.robot_log import index_log, read_log
from lanes.video.images import is_transposed, make_upright, upright_axes

# Formats of recorders, phones and editors. Playlists and lists of files (hls, dash,
# concat, image2) are excluded: they make FFmpeg open further files or network addresses
# that the author of the file chose.
_FORMATS = (
    "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,ogg,mxf,nut,h264,hevc,m4v,mjpeg,"
    "yuv4mpegpipe,gif"
)
# Formats whose packets have a place in the order of decoding only. FFmpeg's guesses of
# presentation times are wrong for reordered frames and at gaps; players show a frame at
# the place of the packet that completes it.
_WITHOUT_PRESENTATION_TIMES = ("avi", "mpegvideo")
# A larger step forward is a clock that was set, as by the first report of an RTP
# stream, which is since the year 1900.
CLOCK_SET_S = 86_400.0
# Pixels of 16 bits, in which cameras with 12 bits store theirs.
_DEEP_FORMATS = ("gray16", "rgb48", "bgr48", "rgba64", "bgra64", "gbrp16")
# Colours that look pale if they are taken for those of BT.709: primaries of BT.2020 and
# P3, and the transfer functions of BT.2020, PQ and HLG (ITU-T H.273, tables 2 and 3).
_WIDE_PRIMARIES = (9, 11, 12)
_WIDE_TRANSFERS = (14, 15, 16, 18)
_NOT_DECODED = "holds no frame that can be decoded; copy or export it again."
# Some containers round time stamps to a millisecond: a time stamp this close to a limit
# counts as equal.
STAMP_TOLERANCE_S = 1e-3
# Types of NAL units with messages (SEI), the length of their headers in bytes, and the
# type of a message of display orientation (ITU-T H.264 and H.265, annex D).
_MESSAGE_UNITS = {"h264": (6, 1), "hevc": (39, 2)}
_DISPLAY_ORIENTATION = 47
# No codec reorders frames over a longer time.
_REORDERED_S = 1.0
# Frames that wait between two threads. One would be enough if every step took constant
# time.
QUEUE_SIZE = 3
MIRRORED_WORDS = (
    "is shown mirrored, as its display matrix says: if the road is mirrored, too, left "
    "and right are exchanged; remove the flip then (ffmpeg -display_rotation 0 -i "
    "VIDEO -c copy NEW)"
)


@dataclass(frozen=True)
class VideoInfo:
    """Properties of a video file.

    Width and height are those shown, after rotation and with square pixels. `missing`
    counts frames that the header announces or the time stamps have gaps for, but that
    are not in the file.
    """

    width: int
    height: int
    fps: float
    frames: int
    duration_s: float
    sound_tracks: int = 0
    missing: int = 0
    topic: str | None = None  # of the images in a robot log
    orientation: int = 1  # in EXIF, as the display matrix says
    note: str = ""  # corrections of the times of a robot log, in words
    # Code points of ITU-T H.273, tables 2 and 3; 1 for all that look like BT.709.
    primaries: int = 1
    transfer: int = 1

    @property
    def has_audio(self) -> bool:
        return self.sound_tracks > 0

    @property
    def mirrored(self) -> bool:
        """Whether the display matrix mirrors the stored images, as players show it."""
        return self.orientation in (2, 4, 5, 7)


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """What one pass over the packets of a video says.

    `rate` is in frames per second, between gaps; `constant_rate` says whether frame n
    is at n / `rate`. `start_s` is the presentation time of the first frame on the
    container's clock; it may be damaged. `times_s` (N,) are those of the frames since
    then, sorted; empty if some frames have no time stamp. `has_one_clock` says
    whether the time stamps of all frames are on it, `states_turns` whether a frame may
    state how it and those after it are turned.
    """

    info: VideoInfo
    rate: Fraction
    constant_rate: bool
    start_s: Fraction
    times_s: np.ndarray
    has_one_clock: bool
    states_turns: bool


@dataclass(frozen=True, eq=False)
class TimedFrame(ByValue):
    """One frame: its number, its time since the video's first frame, and the RGB image
    (height, width, 3), uint8.
    """

    number: int
    time_s: float
    image: np.ndarray = field(repr=False)
    # Seconds since the previous frame that was read, None for the first; they vary in
    # videos of variable rate.
    elapsed_s: float | None = None
    # Time that a tracker took for it.
    latency_ms: float = 0.0


# What one pass over the packets of a file says.


def open_video(path: str | Path) -> InputContainer:
    """Open a video file; FFmpeg cannot open any other file or address named in it.

    Raises FileNotFoundError, or VideoError if it is not a video of one of `_FORMATS` or
    claims more than `MAX_PIXELS`.
    """
    path = require_file(path, "video", error=VideoError)
    # FFmpeg decodes the first frames while it opens a file: the limit applies to these,
    # and below to all others.
    options = {
        "protocol_whitelist": "file",
        "format_whitelist": _FORMATS,
        "max_pixels": str(MAX_PIXELS),
    }
    try:
        # Without the prefix a name such as "concat:a.mp4" would select a protocol.
        container = av.open(f"file:{path}", options=options)
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: cannot be read as a video ({error.strerror}): it is not a video, "
            "a playlist, or cut off; copy it again, or convert it to mp4."
        ) from error

    streams = container.streams
    if not streams.video or streams.video[0].codec_context is None:
        fault = _NOT_DECODED
        if not streams.video:
            kinds = sorted({stream.type for stream in streams})
            found = " and ".join(kinds) or "none"
            fault = (
                f"holds no frame of a video (its streams: {found}); name a video file."
            )
        container.close()
        raise VideoError(f"{path}: {fault}")

    streams.video[0].codec_context.options = {"max_pixels": str(MAX_PIXELS)}
    return container


def decode_frames(
    container: InputContainer, stream: av.VideoStream, index: VideoIndex
) -> Iterator[av.VideoFrame]:
    """The undamaged frames of a video stream in order."""
    placed = _are_placed(container)
    last_pts = None
    packets = read_packets(container, stream)
    if index.states_turns:
        packets = _mark_turns(packets, stream)
    for packet in packets:
        for frame in decode_packet(packet):
            if placed:
                # the last frames are completed by the end of the file
                if frame.dts is None and last_pts is not None:
                    frame.pts = last_pts + round(1 / (index.rate * frame.time_base))
                else:
                    frame.pts = frame.dts
                last_pts = frame.pts
            if not frame.is_corrupt:
                yield frame


def _are_placed(container: InputContainer) -> bool:
    """Whether the place of a packet in the file is the time of a frame."""
    return container.format.name in _WITHOUT_PRESENTATION_TIMES


def frame_orientation(frame: av.VideoFrame, before: int = 1) -> int:
    """The EXIF orientation of a frame by the message in its packet or its display
    matrix, to the nearest quarter turn; without them that of the frame `before`.

    A message holds until the next one. The matrix of a file is that of every frame.
    """
    stated: Any = frame.opaque
    if stated:
        return stated[-1]
    side_data: Any = frame.side_data  # PyAV's types know its numbers only
    matrix = side_data.get(SideDataType.DISPLAYMATRIX)
    if matrix is None:
        return before
    # of a row vector (column, row) in the stored image to one on the screen
    # (libavutil/display.h)
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5].tolist()
    if abs(a) >= abs(c):
        axes = np.sign([(a, 0), (0, d)])
    else:
        axes = np.sign([(0, c), (b, 0)])

    for orientation in range(1, 9):
        if np.array_equal(upright_axes(orientation), axes):
            return orientation
    return 1


def read_packets(
    container: InputContainer, *streams: av.stream.Stream
) -> Iterator[av.Packet]:
    """The packets of these or all streams; a file that is damaged after some packets
    ends there.

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
            raise VideoError(
                f"{path}: is damaged ({error.strerror}); copy or export it again."
            ) from error


def index_video(path: str | Path) -> VideoIndex:
    """The index of a video, made once for calls in a row; one frame is decoded.

    A file that was cut off has its frames up to there. Raises FileNotFoundError, or
    VideoError if the file is empty, not a video, without frames, or without a usable
    frame rate.
    """
    file = require_file(path, "video", error=VideoError)
    status = file.stat()
    return _index_video(str(path), status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _index_video(path: str, *version: int) -> VideoIndex:
    with open_video(path) as container:
        stream = container.streams.video[0]
        packets = _scan_packets(container)
        first = packets.first
        if first is None:
            raise VideoError(f"{path}: {_NOT_DECODED}")

        tick = stream.time_base or Fraction(0)
        start = _start(packets, stream)
        known = [stamp - start for stamp in packets.stamps if stamp is not None]
        times_s = np.array(known) * float(tick)
        steps = _steps_between(times_s, len(packets.stamps))
        rate = _frame_rate(stream, steps.steps_s, path)
        drive = _measure_steps(steps, float(rate))

        announced = stream.frames
        if packets.are_placed and round(1 / (rate * tick)) > 1:
            announced = 0  # a chunk for each tick, most of them empty
        not_stored = announced - packets.stored
        cut_off = _count_cut_off(container, rate, packets.end_s)

        orientation = frame_orientation(first)
        width, height = square_size(first, stream)
        if is_transposed(orientation):
            width, height = height, width
        info = VideoInfo(
            width=width,
            height=height,
            fps=float(rate),
            frames=len(packets.stamps),
            duration_s=round(drive.length_s, 6),
            sound_tracks=len(container.streams.audio),
            missing=max(not_stored, drive.missing + cut_off),
            orientation=orientation,
            primaries=_known(first.color_primaries, _WIDE_PRIMARIES),
            transfer=_known(first.color_trc, _WIDE_TRANSFERS),
        )
        shown_s = np.sort(times_s[times_s >= 0])
        return VideoIndex(
            info=info,
            rate=rate,
            constant_rate=drive.is_constant,
            start_s=start * tick,
            times_s=shown_s,
            has_one_clock=steps.have_one_clock,
            states_turns=packets.state_turns,
        )


def _known(code: int, wide: Sequence[int]) -> int:
    return code if code in wide else 1


@dataclass(frozen=True, eq=False)
class _Packets:
    """The first frame of a video, and what its packets say.

    `stamps` has the time of each frame that is shown, in ticks: that of its decoding if
    the frames `are_placed`, that of its presentation otherwise. The first `early` of
    them are those up to the packet that completes the first frame. `stored` frames are
    in the file. `end_s` is the end of the last packet of any stream. `state_turns` is
    explained in `VideoIndex`.
    """

    first: av.VideoFrame | None
    are_placed: bool
    stamps: list[int | None]
    early: int
    stored: int
    end_s: float
    state_turns: bool


def _scan_packets(container: InputContainer) -> _Packets:
    stream = container.streams.video[0]
    are_placed = _are_placed(container)
    first = None
    stamps: list[int | None] = []
    early = 0
    stored = 0
    end_s = 0.0
    state_turns = False
    for packet in _mark_turns(read_packets(container), stream):
        if packet.pts is not None:
            end_pts = packet.pts + (packet.duration or 0)
            end_s = max(end_s, float(end_pts * packet.time_base))
        if packet.stream is not stream:
            continue

        stored += packet.size > 0
        # A clip cut without re-encoding begins with frames that are only references for
        # later ones.
        if packet.size and not packet.is_discard:
            stamps.append(packet.dts if are_placed else packet.pts)
        if first is None:
            early = len(stamps)
            first = next(decode_packet(packet), None)
        state_turns = state_turns or packet.opaque is not None
    return _Packets(first, are_placed, stamps, early, stored, end_s, state_turns)


def _mark_turns(
    packets: Iterator[av.Packet], stream: av.VideoStream
) -> Iterator[av.Packet]:
    """The packets; the `opaque` of those with a message of display orientation, and of
    the frames decoded from them, is a list with the EXIF orientation.
    """
    unit = _MESSAGE_UNITS.get(stream.codec_context.name)
    if unit is None:
        yield from packets
        return

    unit_type, header_bytes = unit
    stream.codec_context.copy_opaque = True
    messages = BitStreamFilterContext(f"filter_units=pass_types={unit_type}", stream)
    for packet in packets:
        if packet.stream is stream and packet.size:
            copy = av.Packet(bytes(packet))  # the filter empties it
            with suppress(av.FFmpegError):  # a damaged packet
                for units in messages.filter(copy):
                    packet.opaque = _find_orientations(bytes(units), header_bytes)
        yield packet


def _find_orientations(units: bytes, header_bytes: int) -> list[int] | None:
    """The EXIF orientations that messages in NAL units state, which begin with start
    codes; None without one.
    """
    orientations = []
    for unit in units.split(b"\0\0\1")[1:]:
        # two zeros are followed by a 3 that is not part of the message
        messages = unit[header_bytes:].replace(b"\0\0\3", b"\0\0")
        while len(messages) > 2:  # then comes the end
            kind, messages = _read_number(messages)
            size, messages = _read_number(messages)
            if kind == _DISPLAY_ORIENTATION:
                orientations.append(_read_orientation(messages))
            messages = messages[size:]
    return orientations or None


def _read_orientation(message: bytes) -> int:
    """The EXIF orientation nearest to that of a message: it may cancel the one before,
    or flip horizontally and vertically, and then turn anticlockwise.
    """
    first_bytes = message[:3].ljust(3, b"\0")
    bits = f"{int.from_bytes(first_bytes, 'big'):024b}"
    cancels, flips_columns, flips_rows = (bit == "1" for bit in bits[:3])
    if cancels:
        return 1
    quarter_turns = round(int(bits[3:19], 2) / 2**14)

    stored = np.arange(4).reshape(2, 2)
    shown = np.flip(stored, 1) if flips_columns else stored
    shown = np.flip(shown, 0) if flips_rows else shown
    shown = np.rot90(shown, quarter_turns)
    of_each = {o: make_upright(stored, o) for o in range(1, 9)}
    return next(o for o, image in of_each.items() if np.array_equal(image, shown))


def _read_number(data: bytes) -> tuple[int, bytes]:
    """The sum of the bytes up to the first that is not 255, and the rest."""
    rest = data.lstrip(b"\xff")
    return 255 * (len(data) - len(rest)) + sum(rest[:1]), rest[1:]


def _start(packets: _Packets, stream: av.VideoStream) -> int:
    """Time stamp of the first frame by those of the packets up to that which completes
    it.

    FFmpeg's own start time is that of the first five seconds, where a video may begin
    later than its sound.
    """
    delayed = packets.are_placed and stream.codec_context.has_b_frames
    if packets.first and packets.first.dts is not None and delayed:
        return packets.first.dts
    early = packets.stamps[: packets.early]
    return min((stamp for stamp in early if stamp is not None), default=0)


def square_size(frame: av.VideoFrame, stream: av.VideoStream) -> tuple[int, int]:
    """Width and height of a frame before rotation, one of them enlarged so that the
    pixels are square.
    """
    aspect = stream.sample_aspect_ratio or Fraction(1)
    if not Fraction(1, 4) <= aspect <= 4:  # nonsense
        aspect = Fraction(1)
    width = round(frame.width * max(aspect, Fraction(1)))
    height = round(frame.height / min(aspect, Fraction(1)))
    return width, height


@dataclass(frozen=True, eq=False)
class _Steps:
    """Seconds from one frame to the next (M,) in the order of presentation.

    `have_one_clock` says that there is no step from one clock to another. `frames` are
    in the file, `outliers` of them without a usable time stamp.
    """

    steps_s: np.ndarray
    have_one_clock: bool
    frames: int
    outliers: int


def _steps_between(times_s: np.ndarray, frames: int) -> _Steps:
    """The steps between the known times (N,) of frames, in the order of the file.

    There is none between two recordings on clocks of their own, and none at all if too
    many times are not known.
    """
    if len(times_s) <= (1 - MAX_SHORT_SHARE) * frames:
        return _Steps(np.empty(0), True, frames, 0)

    # no codec reorders 16 frames
    order = np.argsort(times_s, kind="stable")
    moved = np.abs(order - np.arange(len(order)))
    away = moved > 16
    if away.mean() < MAX_SHORT_SHARE:
        recordings = [times_s[order][~away]]
    else:
        begins = np.flatnonzero(np.diff(times_s) < -_REORDERED_S) + 1
        recordings = [np.sort(part) for part in np.split(times_s, begins)]

    steps_s = np.concatenate([np.diff(recording) for recording in recordings])
    steps_s = steps_s[steps_s <= CLOCK_SET_S]
    stamped = sum(map(len, recordings))
    have_one_clock = len(steps_s) == stamped - 1
    return _Steps(steps_s, have_one_clock, frames, frames - stamped)


def _frame_rate(stream: av.VideoStream, steps_s: np.ndarray, path: str) -> Fraction:
    """Frames per second between gaps by the steps (M,) between frames, as an exact
    fraction where one fits; as the header states only where no step is known.

    Raises VideoError if the frame rate is missing or not usable.
    """
    stated = [rate for rate in (stream.average_rate, stream.guessed_rate) if rate]
    measured = usual_rate(steps_s)
    if measured:
        whole = max(round(measured), 1)
        usual = [Fraction(whole), Fraction(1000 * whole, 1001)]
        length_s = steps_s[steps_s * measured <= JUMP_FRAMES].sum()
        rate = (
            _fitting_rate(stated, measured, length_s)
            or _fitting_rate(usual, measured, length_s)
            or Fraction(measured).limit_denominator(1001)
        )
    elif stated:
        rate = stated[0]
    else:
        raise VideoError(f"{path}: has no frame rate; convert it to mp4 first.")

    if not MIN_FPS <= rate <= MAX_FPS:
        raise VideoError(
            f"{path}: has an implausible {float(rate):g} frames per second; convert it "
            "to mp4 first."
        )
    return rate


def _fitting_rate(
    candidates: Sequence[Fraction], measured: float, length_s: float
) -> Fraction | None:
    """The candidate next to the measured rate, if it gives the same number of frames in
    a length of time.
    """
    nearest = min(candidates, key=lambda rate: abs(rate - measured), default=None)
    if nearest is None or abs(nearest - measured) * length_s >= 0.5:
        return None
    return nearest


@dataclass(frozen=True)
class _Drive:
    """Whether frame n is at n / rate, seconds from the first frame to the end of the
    last, and the number of frames missing in between: none if the rate varies.
    """

    is_constant: bool
    length_s: float
    missing: int


def _measure_steps(steps: _Steps, rate: float) -> _Drive:
    places = steps.steps_s * rate
    whole = np.rint(places)
    # The rate varies if many steps are shorter or longer than a frame, or many frames
    # leave their places.
    odd = (places < MIN_STEP) | (whole > 1)
    left = np.abs(np.cumsum(places - whole)) > 0.5
    is_constant = max(odd.sum(), left.sum()) <= MAX_SHORT_SHARE * len(places)

    # a step for each frame, those without a known step have the usual one
    unknown = steps.frames - steps.outliers - len(places)
    if not is_constant:
        return _Drive(False, float(steps.steps_s.sum()) + unknown / rate, 0)
    missing = count_missing(np.maximum(whole - 1, 0)) - steps.outliers
    return _Drive(True, float(whole.sum() + unknown) / rate, max(missing, 0))


def count_missing(gaps: np.ndarray) -> int:
    """Number of frames missing in `gaps` (N,) between frames; longer ones than
    `JUMP_FRAMES` are no loss.
    """
    return int(gaps[gaps <= JUMP_FRAMES].sum())


def count_lost(
    info: VideoInfo, numbers: Sequence[int], start_s: float, end_s: float | None
) -> int:
    """Number of frames of a part that are damaged or not in the file, by the `numbers`
    of those that were read.
    """
    to_end = end_s is None or end_s >= info.duration_s
    if start_s == 0 and to_end:
        return max(0, info.frames + info.missing - len(numbers))
    return count_missing(np.diff(numbers) - 1)


def _count_cut_off(container: InputContainer, rate: Fraction, end_s: float) -> int:
    """Number of frames that the header announces beyond the last packet, at `end_s`."""
    # In Matroska and NUT the duration counts from zero, in all others from the first
    # packet.
    names = container.format.name.split(",")
    announced = container.duration or 0
    if "matroska" not in names and "nut" not in names:
        announced += container.start_time or 0
    cut_off_s = announced / av.time_base - end_s
    # some headers round to half a second
    if cut_off_s <= 0.5:
        return 0
    return round(cut_off_s * rate)


def decode_packet(packet: av.Packet) -> Iterator[Any]:
    """The frames that a packet completes; none from a damaged packet."""
    try:
        yield from packet.decode()
    except av.FFmpegError:
        return


# Properties and frames, of video files and robot logs.


def inspect_video(
    path: str | Path, *, topic: str | None = None, start_s: float = 0.0
) -> VideoInfo:
    """Properties of a video file, with the frames counted; reads the whole file but
    decodes one frame.

    A file that was cut off has its frames up to there. `topic` is that of the images in
    a robot log, by default the only one. Width and height are those at `start_s`, for a
    part behind a change of size. Raises FileNotFoundError, or VideoError if the file is
    empty, not a video, or without frames.
    """
    if not is_robot_log(path):
        info = index_video(path).info
        if not 0 < start_s < info.duration_s:
            return info
        with closing(read_video(path, start_s=start_s)) as images:
            height, width, _ = next(images).shape
        return replace(info, width=width, height=height)

    log = index_log(path, topic)
    width, height = log.size
    count = len(log.numbers)
    length_s = log.times_s[-1].item() + 1 / log.fps
    return VideoInfo(
        width=width,
        height=height,
        fps=log.fps,
        frames=count,
        duration_s=round(length_s, 6),
        missing=int(log.numbers[-1]) + 1 - count,
        topic=log.topic,
        note=log.note,
    )


def read_video(
    path: str | Path, *, start_s: float = 0.0, end_s: float | None = None
) -> Generator[np.ndarray]:
    """Yield the RGB images (height, width, 3), uint8, of `read_timed_frames`;
    parameters and exceptions as there.
    """
    require_path(path)
    for frame in read_timed_frames(path, start_s=start_s, end_s=end_s):
        yield frame.image


def read_timed_frames(
    path: str | Path,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    topic: str | None = None,
) -> Generator[TimedFrame]:
    """Yield the frames with start_s <= time < end_s, seconds since the first frame, in
    order; None reads to the end.

    The images are turned and mirrored as the file's display matrix says, and the caller
    may write to them. Damaged frames are skipped; if the frame rate is constant, their
    numbers are skipped too. `topic` is as for `inspect_video`. Raises
    FileNotFoundError, or VideoError if the file is not a video, its frame size changes,
    or it ends before `start_s`.
    """
    start_s = require_number(start_s, "start_s")
    until_s = math.inf
    if end_s is not None:
        end_s = require_number(end_s, "end_s", finite=False)
        until_s = end_s
    if not 0 <= start_s < until_s:
        raise VideoError(
            f"{path}: cannot read from {start_s} s to {end_s} s; give 0 <= start_s < "
            "end_s."
        )

    if is_robot_log(path):
        read = _read_log(path, start_s, until_s, topic)
    else:
        read = _read_frames(path, start_s, until_s)
    last_s = None
    for number, time_s, image in read:
        elapsed_s = None
        if last_s is not None:
            elapsed_s = time_s - last_s
        yield TimedFrame(number, time_s, image, elapsed_s)
        last_s = time_s

    if last_s is None:
        until = "" if end_s is None else f" and before {end_s:g} s"
        raise VideoError(
            f"{path}: has no frame at or after {start_s:g} s{until}; name another part "
            "of it."
        )


def read_frames(
    path: str | Path,
    info: VideoInfo,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: bool = False,
) -> Generator[TimedFrame]:
    """The frames of `read_timed_frames`; another thread reads up to `QUEUE_SIZE` in
    advance.

    With `progress` a bar shows how far they are, if stderr is a terminal or a notebook.
    """
    until_s = min(end_s or info.duration_s, info.duration_s)
    expected = max(round((until_s - start_s) * info.fps), 0)
    items = read_timed_frames(path, start_s=start_s, end_s=end_s, topic=info.topic)
    with (
        closing(items),
        ThreadPoolExecutor(1) as thread,
        progress_bar(None, "frame", expected, shown=progress) as bar,
    ):
        waiting = deque(thread.submit(next, items, None) for _ in range(QUEUE_SIZE))
        while True:
            frame = waiting.popleft().result()
            if frame is None:
                break
            waiting.append(thread.submit(next, items, None))
            yield frame
            bar.update()


def _read_log(
    path: str | Path, start_s: float, end_s: float, topic: str | None
) -> Iterator[tuple[int, float, np.ndarray]]:
    log = index_log(path, topic)
    latest_s = log.times_s + STAMP_TOLERANCE_S
    first, end = np.searchsorted(latest_s, [start_s, end_s]).tolist()
    for index, image in read_log(path, log, first, end):
        number = log.numbers[index].item()
        time_s = log.times_s[index].item()
        yield number, time_s, image


def _read_frames(
    path: str | Path, start_s: float, end_s: float
) -> Iterator[tuple[int, float, np.ndarray]]:
    index = index_video(path)
    number = None
    part_size = None
    orientation = 1
    # shared: its setup takes half as long as one conversion
    converter = VideoReformatter()
    with closing(_frames_from(path, index, start_s)) as frames:
        for frame, time_s, stream in frames:
            orientation = frame_orientation(frame, orientation)
            if time_s < start_s - STAMP_TOLERANCE_S:
                continue
            if time_s > end_s - STAMP_TOLERANCE_S:
                break

            size = square_size(frame, stream)
            image = _upright_rgb(frame, size, orientation, converter, path)
            part_size = part_size or image.shape
            if image.shape != part_size:
                raise VideoError(
                    f"{path}: changes from {part_size[1]}x{part_size[0]} to "
                    f"{image.shape[1]}x{image.shape[0]} pixels at {float(time_s):.2f} "
                    "s; cut it there (--start, --end), or convert it to one size."
                )

            place = round(time_s * index.rate)
            if number is None:
                number = place
                if not index.constant_rate and start_s > 0:
                    earlier = index.times_s < float(time_s) - 1e-6
                    number = int(earlier.sum())
            elif index.constant_rate:
                number = max(number + 1, place)
            else:
                number += 1
            yield number, float(time_s), image


def _frames_from(
    path: str | Path, index: VideoIndex, start_s: float
) -> Generator[tuple[av.VideoFrame, Fraction, av.VideoStream]]:
    """Frames with their times and their stream, from a key frame before `start_s` on.

    Where a seek is not possible, or ends behind `start_s`, as in transport streams with
    few key frames, they are from the first one on; also where the clock restarts, or
    where a frame before says how they are turned.
    """
    seeks = start_s > 1 and index.has_one_clock and not index.states_turns
    attempts = (True, False) if seeks else (False,)
    for seek in attempts:
        with open_video(path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            if seek:
                # one second early, because some containers seek coarsely
                at_s = start_s - 1 + index.start_s
                tick = stream.time_base or Fraction(1)
                try:
                    container.seek(int(at_s / tick), stream=stream)
                except av.FFmpegError:  # a raw stream
                    continue

            frames = _timed(decode_frames(container, stream, index), index, path)
            first = next(frames, None)
            if first is None:
                continue
            _, first_s = first
            if seek and first_s > start_s - STAMP_TOLERANCE_S:
                continue
            for frame, time_s in chain([first], frames):
                yield frame, time_s, stream
            return


def _timed(
    frames: Iterator[av.VideoFrame], index: VideoIndex, path: str | Path
) -> Iterator[tuple[av.VideoFrame, Fraction]]:
    """Frames with their times in seconds since the first one, monotonic."""
    last_s: Fraction | None = None
    zero_s = index.start_s
    # looked at where the time stamps leave their order
    ahead: deque[av.VideoFrame] = deque()
    while True:
        frame = ahead.popleft() if ahead else next(frames, None)
        if frame is None:
            return
        # Only raw streams have no time stamps, and they have no gaps.
        after_s = Fraction(0)
        if last_s is not None:
            after_s = last_s + 1 / index.rate
        time_s = _stamp_s(frame, zero_s, after_s)
        if last_s is not None and not 0 <= time_s - last_s <= CLOCK_RESET_S:
            # up to four frames in a row are outliers
            ahead.extend(islice(frames, 4 - len(ahead)))
            later_s = [_stamp_s(later, zero_s, after_s) for later in ahead]
            time_s = _without_outlier(last_s, time_s, later_s)
            if not last_s - CLOCK_RESET_S <= time_s <= last_s + CLOCK_SET_S:
                zero_s -= after_s - time_s
                time_s = after_s

        if last_s is not None:
            time_s = max(time_s, last_s)
        last_s = time_s
        yield frame, time_s


def _stamp_s(frame: av.VideoFrame, zero_s: Fraction, otherwise_s: Fraction) -> Fraction:
    """Seconds from `zero_s` to the time stamp of a frame; `otherwise_s` without one."""
    if frame.pts is None or frame.time_base is None:
        return otherwise_s
    return frame.pts * frame.time_base - zero_s


def _without_outlier(
    last_s: Fraction, time_s: Fraction, later: Sequence[Fraction]
) -> Fraction:
    """A time stamp after `last_s`, or one between it and a later stamp that follows it,
    if the first does not.
    """
    for steps, later_s in enumerate(later, 2):
        follows = last_s < later_s <= last_s + CLOCK_SET_S
        between = last_s - CLOCK_RESET_S <= time_s <= later_s + CLOCK_RESET_S
        if follows and not between:
            return last_s + (later_s - last_s) / steps
    return time_s


def _upright_rgb(
    frame: av.VideoFrame,
    size: tuple[int, int],
    orientation: int,
    converter: VideoReformatter,
    path: str | Path,
) -> np.ndarray:
    """The upright RGB image of a frame of `size` (width, height) before rotation."""
    width, height = size
    try:
        is_deep = frame.format.name.startswith(_DEEP_FORMATS)
        values = "rgb48le" if is_deep else "rgb24"
        rgb = converter.reformat(frame, width, height, format=values, threads=1)
        image = to_8_bits(rgb.to_ndarray())
    except av.FFmpegError as error:
        raise VideoError(
            f"{path}: its colours cannot be converted to RGB (matrix "
            f"{frame.colorspace} of Recommendation H.273, {frame.format.name}); export "
            "it with the colours of BT.709."
        ) from error
    return make_upright(image, orientation)


def describe_jumps(time_s: np.ndarray, fps: float) -> str:
    """What jumps in the times (N,) of frames mean, in words; empty without any."""
    steps_s = np.diff(time_s)
    jumps = np.flatnonzero(steps_s * fps > JUMP_FRAMES)
    if not jumps.size:
        return ""
    named = [f"by {steps_s[k]:.0f} s after {time_s[k]:.1f} s" for k in jumps[:5]]
    where = ", ".join(named)
    return (
        f"its clock jumps {where}: another recording begins there, and the tracker "
        "starts again"
    )
