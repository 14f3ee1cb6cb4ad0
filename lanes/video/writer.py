"""Videos that browsers play, with sound, written through PyAV (FFmpeg inside this
process), and made of other videos.

`process_video` goes from file to file: every frame is read, passed to a function and
written, once, in order and at its own time. Decoding and encoding release Python's
global lock: three frames are read, processed and written at the same time.
"""

from __future__ import annotations

import inspect
import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.container import InputContainer, OutputContainer

from lanes.errors import PictureError, VideoError, require_number
from lanes.files import (
    TelemetryWriter,
    atomic_write,
    require_path,
    translate_write_errors,
)
from lanes.recording import CLOCK_RESET_S, MAX_FPS, MIN_FPS
from lanes.video.images import is_rgb, require_rgb
from lanes.video.reader import (
    CLOCK_SET_S,
    QUEUE_SIZE,
    STAMP_TOLERANCE_S,
    TimedFrame,
    VideoInfo,
    count_lost,
    decode_packet,
    index_video,
    inspect_video,
    open_video,
    read_frames,
    read_packets,
)

Row = Mapping[str, object]

# Audio codecs that mp4 allows at every sampling rate and browsers play; any other
# becomes AAC of this sampling rate.
_COPIED_CODECS = {"aac", "opus", "flac"}
_SOUND_RATE_HZ = 48_000
# Code points of ITU-T H.273, tables 2 to 4: BT.601 in the limited range, which FFmpeg
# assumes for videos without tags; players disagree on these. Primaries of BT.2020 have
# the matrix of BT.2020, which players expect with them.
_COLOUR_TAGS = {"colorspace": 6, "color_range": 1, "color_primaries": 1, "color_trc": 1}
_BT_2020 = 9


class VideoWriter:
    """Writer of an mp4 file that browsers play: H.264, yuv420p, index at the start, all
    tags of colours.

    Use it in a `with` block. The file is renamed to `path` at the end of the block,
    after its frames were counted. If the block raises, the unfinished file is removed
    and an earlier file of that name is not changed. `frames` counts the frames
    converted so far; after the block `written` has the properties of the finished file.

    Parameters
    ----------
    path : str or Path
        Ends in .mp4; the folder is created where needed.
    fps : float
        Rounded to the nearest fraction with a denominator up to 1001: television rates
        such as 30000 / 1001 are exact.
    sound_from : str or Path, optional
        A video whose sound tracks are copied or encoded again, from the time of the
        first written frame on. Sound that cannot be decoded is left out.
    sound_end_s : float, optional
        End of the sound, on the clock of `sound_from`; by default all of it is written,
        also after the last frame.
    primaries, transfer : int
        Code points of the colours, as in `VideoInfo`; by default those of BT.709.

    Raises
    ------
    LaneError, OSError
        If `path` is no .mp4, no frame was written, frames differ in size or are not
        RGB, or the file cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        fps: float,
        sound_from: str | Path | None = None,
        sound_end_s: float | None = None,
        primaries: int = 1,
        transfer: int = 1,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() != ".mp4":
            raise VideoError(
                f"{path}: cannot write this kind of video; end the name in .mp4."
            )
        self.frames = 0

        rate = Fraction(require_number(fps, "fps", positive=True))
        self._rate = rate.limit_denominator(1001)
        if not MIN_FPS <= self._rate <= MAX_FPS:
            raise VideoError(
                f"{path}: {fps} frames a second cannot be written; give "
                f"{float(MIN_FPS):g} to {MAX_FPS}."
            )
        # Time base below 0.1 ms with a whole number of ticks per frame: exact for a
        # constant rate.
        per_frame = math.ceil(10_000 / self._rate.numerator)
        self._tick = Fraction(1, self._rate.numerator * per_frame)
        self._ticks_per_frame = self._rate.denominator * per_frame

        self._tags = _COLOUR_TAGS | {
            "color_primaries": primaries,
            "color_trc": transfer,
        }
        if primaries == _BT_2020:
            self._tags["colorspace"] = _BT_2020

        self._sound_from = sound_from
        self._sound_end_s = math.inf if sound_end_s is None else sound_end_s
        self._resources = ExitStack()
        self._sound: _Sound | None = None
        self._container: OutputContainer | None = None
        self._size: tuple[int, int] | None = None
        self._zero_s = 0.0
        self._last_pts = -1

    def __enter__(self) -> VideoWriter:
        # Created at once, so that an unwritable folder is reported before minutes of
        # work.
        self._partial = self._resources.enter_context(atomic_write(self.path))
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if kind is not None:
            self._resources.__exit__(kind, *error)
            return
        with self._resources:
            self._finish()

    def write(self, image: np.ndarray, time_s: float | None = None) -> None:
        """Append an RGB image (height, width, 3), uint8.

        All images have one size. H.264 needs an even width and height: an odd one is
        padded by repeating the last column or row, so that no pixel is lost or moved.
        `time_s` is the presentation time on the clock of `sound_from`; the file begins
        at the first written frame. Without it frames follow at the frame rate.
        """
        self.encode(self.convert(image, time_s))

    def convert(self, image: np.ndarray, time_s: float | None = None) -> av.VideoFrame:
        """First half of `write`: the frame in YUV with its time stamp.

        `image` may be overwritten afterwards.
        """
        image = require_rgb(image, f"frame {self.frames} of {self.path}")
        if time_s is None:
            time_s = self.frames / float(self._rate)
        else:
            time_s = require_number(time_s, "time_s")

        height, width = image.shape[:2]
        size = width, height
        if self._size is None:
            self._size = size
            self._zero_s = time_s
        if size != self._size:
            first_width, first_height = self._size
            raise VideoError(
                f"{self.path}: frame {self.frames} is {width}x{height} pixels, the "
                f"first one was {first_width}x{first_height}; all frames of a video "
                "must have one size."
            )

        if height % 2 or width % 2:
            padding = (0, height % 2), (0, width % 2), (0, 0)
            image = np.pad(image, padding, "edge")
        if self._tags["colorspace"] == _BT_2020:
            rgb = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame = rgb.reformat(format="yuv420p", dst_colorspace=_BT_2020)
        else:  # several times as fast
            planes = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420)
            yuv = np.asarray(planes, np.uint8)
            frame = av.VideoFrame.from_ndarray(yuv, format="yuv420p")
        _tag(frame, self._tags)
        self._stamp(frame, time_s - self._zero_s)
        self.frames += 1
        return frame

    def encode(self, frame: av.VideoFrame) -> None:
        """Second half of `write`: encode the converted frames in order; may run in
        another thread.
        """
        with self._ffmpeg_errors():
            container = self._container or self._open_container(frame)
            container.mux(self._stream.encode(frame))
            if self._sound is not None:
                self._sound.write_until(frame.time)

    def _open_container(self, frame: av.VideoFrame) -> OutputContainer:
        size = frame.width, frame.height
        container, self._stream = open_mp4(
            self._partial, size, self._rate, self._tick, self._tags
        )
        self._container = container
        self._resources.callback(_close_quietly, container)

        if self._sound_from is not None:
            source = self._resources.enter_context(open_video(self._sound_from))
            self._sound = _Sound(
                source,
                container,
                start_s=self._zero_s,
                length_s=self._sound_end_s - self._zero_s,
            )
        return container

    def _stamp(self, frame: av.VideoFrame, time_s: float) -> None:
        nearest = round(time_s * self._rate)
        nearest_s = float(nearest / self._rate)
        if abs(time_s - nearest_s) < STAMP_TOLERANCE_S:
            pts = nearest * self._ticks_per_frame
        else:
            pts = round(time_s / float(self._tick))

        # Some recorders write two frames with one time stamp, which mp4 does not allow.
        self._last_pts = max(pts, self._last_pts + 1)
        frame.pts = self._last_pts
        frame.time_base = self._tick
        frame.duration = self._ticks_per_frame

    def _finish(self) -> None:
        if self._container is None:
            raise VideoError(
                f"{self.path}: no frame was written; a video needs at least one."
            )

        with self._ffmpeg_errors():
            self._container.mux(self._stream.encode(None))
            if self._sound is not None:
                self._sound.finish()
            self._container.close()

        self.written = inspect_video(self._partial)
        if self.written.frames != self.frames:
            raise VideoError(
                f"{self.path}: only {self.written.frames} of {self.frames} frames are "
                "in the output file; try again."
            )

    @contextmanager
    def _ffmpeg_errors(self) -> Iterator[None]:
        try:
            yield
        except av.FFmpegError as error:
            raise OSError(
                f"{self.path}: cannot be written ({error.strerror}); choose another "
                "folder or free some space."
            ) from error


@dataclass
class _SoundTrack:
    """A sound track that is written: copied, or encoded again if it has an `encoder`.

    `zero_s` is the time of the first written frame on the track's clock, `last_s` that
    of the latest packet since then.
    """

    output: av.AudioStream
    encoder: av.AudioStream | None
    zero_s: float
    last_s: float = -math.inf

    def place(self, piece: Any) -> float:
        """Stamp a packet or a frame for the output; seconds since the first frame."""
        time_s = float(piece.pts * piece.time_base) - self.zero_s
        earliest_s = self.last_s - CLOCK_RESET_S
        continues = earliest_s <= time_s <= self.last_s + CLOCK_SET_S
        if self.last_s > -math.inf and not continues:
            self.zero_s -= self.last_s - time_s
            time_s = self.last_s
        self.last_s = time_s

        if self.encoder:
            # In avi a tick can be a whole frame of MP3, longer than one of AAC: two of
            # these would have one time.
            piece.time_base = Fraction(1, piece.sample_rate)
        else:
            piece.stream = self.output
        piece.pts = round(time_s / piece.time_base)
        piece.dts = piece.pts
        return time_s


class _Sound:
    """The sound tracks of `source` that can be decoded, written to `target` interleaved
    with the frames.
    """

    def __init__(
        self,
        source: InputContainer,
        target: OutputContainer,
        *,
        start_s: float,
        length_s: float,
    ) -> None:
        self._source = source
        self._target = target
        self._length_s = length_s
        index = index_video(source.name.removeprefix("file:"))
        zero_s = start_s + float(index.start_s)
        if start_s > 0 and index.has_one_clock:
            source.seek(int(zero_s * av.time_base))

        self._tracks: dict[av.AudioStream, _SoundTrack] = {}
        for stream in source.streams.audio:
            codec = stream.codec_context
            if codec is None:  # FFmpeg does not know it
                continue
            encoder = None
            if codec.name not in _COPIED_CODECS:
                encoder = target.add_stream("aac", rate=_SOUND_RATE_HZ)
            output = encoder or target.add_stream_from_template(stream)
            output.metadata["language"] = stream.metadata.get("language", "und")
            self._tracks[stream] = _SoundTrack(output, encoder, zero_s)
        self._pieces = self._read()
        self._next = next(self._pieces, None)

    def write_until(self, time_s: float) -> None:
        """Write the sound before `time_s`, seconds since the first written frame."""
        while self._next is not None:
            piece_s, piece, track = self._next
            if piece_s >= time_s:
                break
            self._write(piece, track)
            self._next = next(self._pieces, None)

    def finish(self) -> None:
        """Write the other sound, and what the encoders hold back."""
        self.write_until(math.inf)
        for track in self._tracks.values():
            self._write(None, track)

    def _write(self, piece: Any, track: _SoundTrack) -> None:
        # FFmpeg refuses, for instance, damaged packets, repeated time stamps and other
        # channels; the video goes on.
        with suppress(ValueError):
            if track.encoder:
                self._target.mux(track.encoder.encode(piece))
            elif piece:
                self._target.mux(piece)

    def _read(self) -> Iterator[tuple[float, Any, _SoundTrack]]:
        """Packets for the output or frames for the encoder, from the first written
        frame on, with their times since then and their tracks.
        """
        if not self._tracks:
            return
        for packet in read_packets(self._source, *self._tracks):
            track = self._tracks[packet.stream]
            pieces = decode_packet(packet) if track.encoder else [packet]
            for piece in pieces:
                if piece.pts is None:
                    continue
                time_s = track.place(piece)
                # tracks take turns more often than once a second
                if time_s > self._length_s + 1:
                    return
                if piece.pts >= 0 and time_s < self._length_s:
                    yield time_s, piece, track


def open_mp4(
    path: Path,
    size: tuple[int, int],
    rate: Fraction,
    tick: Fraction,
    tags: Mapping[str, int] = _COLOUR_TAGS,
) -> tuple[OutputContainer, av.VideoStream]:
    """An mp4 container open for writing and its H.264 stream for frames of `size`
    (width, height).
    """
    index_first = {"movflags": "+faststart"}
    container = av.open(str(path), "w", format="mp4", options=index_first)

    # veryfast: 1.6 times as fast as x264's default, at about the same size (measured at
    # 1280x720); its default quality
    settings = {"preset": "veryfast", "crf": "23"}
    stream = container.add_stream("libx264", rate=rate, options=settings)
    codec = stream.codec_context
    codec.width, codec.height = size
    codec.pix_fmt = "yuv420p"
    codec.time_base = tick
    # The bytes of x264 depend on its number of threads: a fixed number gives the same
    # file on every machine. Four are as fast as any other number on two cores.
    codec.thread_count = 4
    _tag(codec, tags)
    return container, stream


def _tag(target: av.VideoCodecContext | av.VideoFrame, tags: Mapping[str, int]) -> None:
    for name, code in tags.items():
        setattr(target, name, code)


def _close_quietly(container: OutputContainer) -> None:
    with suppress(av.FFmpegError):
        container.close()


# From file to file.


def process_video(
    source: str | Path,
    target: str | Path,
    function: Callable[..., np.ndarray | tuple[np.ndarray, Row]],
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: bool = True,
    telemetry: str | Path | TelemetryWriter | None = None,
    info: VideoInfo | None = None,
) -> VideoInfo:
    """Apply a function to every frame of a video, and write an mp4 that browsers play,
    with the source's sound.

    Parameters
    ----------
    source, target : str or Path
        `target` ends in .mp4 and is written atomically: after an exception or Ctrl-C an
        earlier file of that name is unchanged, and no other file remains. It has the
        frame rate and time stamps of `source`.
    function : callable
        Takes an RGB image (height, width, 3), uint8, which it may overwrite. Returns an
        RGB image, or a pair of that and a mapping with the frame's telemetry. It is
        called once per frame, in order, in the caller's thread. All returned images
        must have the same size. If it has a parameter `elapsed_s`, it gets the seconds
        since the previous frame, None for the first; they vary in videos of variable
        rate.
    start_s, end_s : float
        As for `read_timed_frames`.
    progress : bool
        Show frames per second and the remaining time, in a terminal or a notebook only.
    telemetry : str, Path or TelemetryWriter, optional
        CSV file with a row per frame: frame (counted from the start of `source`),
        time_s, the telemetry of `function`, and, unless that contains it, latency_ms,
        the time that `function` took.
    info : VideoInfo, optional
        Result of `inspect_video(source)`, if known; otherwise the file is read twice.

    Returns
    -------
    VideoInfo
        Properties of `target`, with its frames counted; every processed frame is in it.
        `missing` counts the frames of `source` that are damaged or not there: they are
        skipped, and the others keep their times.

    Raises
    ------
    FileNotFoundError, LaneError, OSError
        If `source` cannot be used, `function` refuses a frame or returns no RGB image,
        or an output cannot be written.
    """
    start_s = require_number(start_s, "start_s")
    if end_s is not None:
        end_s = require_number(end_s, "end_s", finite=False)
    require_path(source)
    info = info or inspect_video(source)
    with translate_write_errors(Path(target)):
        same = Path(target).exists() and os.path.samefile(source, target)
    if same:
        raise VideoError(
            f"{target}: is the source itself; write the output under another name."
        )

    if isinstance(telemetry, str | Path):
        telemetry = TelemetryWriter(telemetry)
    sound_from = source if info.has_audio else None
    writer = VideoWriter(
        target,
        fps=info.fps,
        sound_from=sound_from,
        sound_end_s=end_s,
        primaries=info.primaries,
        transfer=info.transfer,
    )
    takes_time = _takes_time(function)
    frames = read_frames(source, info, start_s=start_s, end_s=end_s, progress=progress)
    numbers: list[int] = []
    with (
        # This order renames the telemetry file only after the video.
        telemetry or nullcontext() as table,
        writer,
        closing(frames),
        _write_behind(writer.encode) as encode,
    ):
        for frame in frames:
            name = f"frame {frame.number} of {source}"
            image, row = _apply(function, frame, takes_time, name)
            # Converted in this thread: `function` may return the same array every time.
            converted = writer.convert(image, frame.time_s)
            encode(converted)
            if table:
                time_s = round(frame.time_s, 6)
                table.write({"frame": frame.number, "time_s": time_s, **row})
            numbers.append(frame.number)

    missing = count_lost(info, numbers, start_s, end_s)
    return replace(writer.written, missing=missing)


def _takes_time(function: Callable) -> bool:
    """Whether a function has the parameter `elapsed_s`."""
    try:
        return "elapsed_s" in inspect.signature(function).parameters
    except ValueError:  # functions written in C have no signature
        return False


def _apply(
    function: Callable, frame: TimedFrame, takes_time: bool, name: str
) -> tuple[np.ndarray, Row]:
    """The image that `function` returns, and its telemetry with the latency; errors
    begin with the frame's `name`.
    """
    began_s = time.perf_counter()
    try:
        if takes_time:
            result = function(frame.image, elapsed_s=frame.elapsed_s)
        else:
            result = function(frame.image)
    except PictureError as error:
        # The message begins with "image", because `function` does not know the frame's
        # number.
        fault = str(error).removeprefix("image: ")
        raise PictureError(f"{name}: {fault}") from error
    except Exception as error:
        error.add_note(f"(while processing {name})")
        raise
    latency_s = time.perf_counter() - began_s

    row: Row = {}
    if isinstance(result, tuple):
        result, row = result
    if not is_rgb(result):
        got = type(result).__name__
        if isinstance(result, np.ndarray):
            got = f"{result.dtype} of shape {result.shape}"
        raise VideoError(
            f"{name}: the function returned {got}; it must return an RGB image "
            "(height, width, 3), uint8."
        )
    latency_ms = row.get("latency_ms", round(latency_s * 1e3, 3))
    return result, {**row, "latency_ms": latency_ms}


@contextmanager
def _write_behind(write: Callable) -> Iterator[Callable]:
    """A function that queues an item for `write` in another thread; it blocks while
    `QUEUE_SIZE` items are waiting.

    An exception of `write` is raised by a later call or at the end of the block. All
    items are written at its end.
    """
    waiting: deque[Future] = deque()
    with ThreadPoolExecutor(1) as thread:

        def put(item: object) -> None:
            waiting.append(thread.submit(write, item))
            if len(waiting) > QUEUE_SIZE:
                oldest = waiting.popleft()
                oldest.result()

        yield put
        for written in waiting:
            written.result()
