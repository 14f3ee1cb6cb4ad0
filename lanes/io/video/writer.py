"""Frames into video files that browsers play, through PyAV (FFmpeg inside this process)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange

from lanes.io.files import PartialFile, translate_write_errors
from lanes.io.frames import Frame, YuvColourSpace, YuvFrame, require_rgb
from lanes.io.video.container import VideoError, decode_frames, open_video, start_time, translate_errors
from lanes.io.video.reader import STAMP_TOLERANCE_S, VideoInfo, inspect_video

# Sound that an mp4 file may hold and browsers play; any other is encoded as AAC.
_COPIED_SOUND = {"aac", "mp3", "opus", "flac"}
# x264's own default of constant quality.
CRF = 23
# x264 makes other bytes with another number of threads: a fixed one gives the same file on every machine. Four are as
# fast as any other number on two cores.
ENCODER_THREADS = 4


class VideoWriter:
    """Write frames as an mp4 file that browsers play: H.264, yuv420p, index in front.

    RGB becomes BT.601 colours; what comes as videos store it, `YuvFrame`, stays as it is.

    Use it in a `with` block. The file gets its name at the end of the block, when its frames have been counted; if the
    block raises, nothing of it remains and an earlier file of that name is untouched. `written` then says what the file
    holds.

    Parameters
    ----------
    path : str or Path
        Ends in .mp4; the folder is created where needed.
    fps : float
        Frames per second. Taken as the nearest fraction with a denominator up to 1001, so that 29.97 and the like of
        television are exact when given as 30000 / 1001.
    crf : int, in range 0..51
        x264's constant quality; lower is better and larger.
    sound_from : str or Path, optional
        A video whose sound goes along, from the time of the first written frame to that of the last.
    threads : int
        Encode; with another number the file has other bytes.

    Raises
    ------
    VideoError
        If the name does not end in .mp4, no frame was written, or the frames differ in size.
    OSError
        If the folder cannot be written to.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        fps: float,
        crf: int = CRF,
        sound_from: str | Path | None = None,
        threads: int = ENCODER_THREADS,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() != ".mp4":
            raise VideoError(f"{path}: cannot write this kind of video; end the name in .mp4.")
        self.frames = 0
        self.written: VideoInfo | None = None
        self._rate = Fraction(fps).limit_denominator(1001)
        # Ticks shorter than 0.1 ms, a whole number of them to a frame: exact for a constant rate, fine for any other.
        per_frame = math.ceil(10_000 / self._rate.numerator)
        self._tick = Fraction(1, self._rate.numerator * per_frame)
        self._ticks_per_frame = self._rate.denominator * per_frame
        self._crf, self._threads = crf, threads
        self._sound_from = sound_from
        self._sound: SoundTrack | None = None
        self._partial: PartialFile | None = None
        self._container: av.container.OutputContainer | None = None
        self._size: tuple[int, int] | None = None
        self._zero_s = 0.0
        self._last_pts = -1

    def __enter__(self) -> VideoWriter:
        # Made at once, so that an unwritable folder is known before minutes of work.
        with translate_write_errors(self.path):
            self._partial = PartialFile(self.path)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            if self._container is not None:
                with suppress(av.FFmpegError):
                    self._container.close()
            if self._sound is not None:
                self._sound.close()
            self._partial.discard()

    def write(self, image: Frame, time_s: float | None = None) -> None:
        """Append a frame.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8, or YuvFrame
            RGB, or as videos store it; all of one kind and size. H.264 stores colours for squares of four pixels: an
            odd width or height is made even by repeating the last column or row, so that nothing is lost and no pixel
            moves.
        time_s : float, optional
            When the frame is shown, in the time of `sound_from`; the first written frame becomes the start of the
            file. Without it the frames follow each other at the frame rate.
        """
        self.encode(self.convert(image, time_s))

    def convert(self, image: Frame, time_s: float | None = None) -> av.VideoFrame:
        """The first half of `write`: the frame in the video's colours and with its time.

        An RGB image is free again then; the frame of a `YuvFrame` lives on its data.
        """
        if not isinstance(image, YuvFrame):
            require_rgb(image, f"frame {self.frames} of {self.path}")
        time_s = self.frames / float(self._rate) if time_s is None else time_s
        if self._size is None:
            self._size, self._zero_s = image.shape[1::-1], time_s
        if image.shape[1::-1] != self._size:
            raise VideoError(
                f"{self.path}: frame {self.frames} is {image.shape[1]}x{image.shape[0]} pixels, the first one was "
                f"{self._size[0]}x{self._size[1]}; all frames of a video must have one size."
            )
        frame = _frame_of(image if isinstance(image, YuvFrame) else YuvFrame.from_rgb(image))
        self._stamp(frame, time_s - self._zero_s)
        self.frames += 1
        return frame

    def encode(self, frame: av.VideoFrame) -> None:
        """The second half of `write`, to be called for the converted frames in their order; by any thread."""
        try:
            if self._container is None:
                self._open_container(frame)
            self._container.mux(self._stream.encode(frame))
            if self._sound is not None:
                self._sound.write_until(frame.time)
        except av.FFmpegError as error:
            raise self._unwritable(error) from error

    def _open_container(self, frame: av.VideoFrame) -> None:
        size, full = (frame.width, frame.height), frame.color_range == ColorRange.JPEG
        colour_space = YuvColourSpace(frame.colorspace, full, int(frame.color_primaries), int(frame.color_trc))
        self._container, self._stream = open_mp4(
            self._partial.name, size, self._rate, self._tick, colour_space, crf=self._crf, threads=self._threads
        )
        if self._sound_from is not None:
            self._sound = SoundTrack(self._sound_from, self._container, start_s=self._zero_s)

    def _stamp(self, frame: av.VideoFrame, time_s: float) -> None:
        nearest = round(time_s * self._rate)
        constant_rate = abs(time_s - float(nearest / self._rate)) < STAMP_TOLERANCE_S
        pts = nearest * self._ticks_per_frame if constant_rate else round(time_s / float(self._tick))
        # Two frames at one time, as some recorders write them, would be refused by the container.
        self._last_pts = frame.pts = max(pts, self._last_pts + 1)
        frame.time_base = self._tick
        frame.duration = self._ticks_per_frame

    def _finish(self) -> None:
        if self._container is None:
            raise VideoError(f"{self.path}: no frame was written, so there is no video; give at least one.")
        try:
            self._container.mux(self._stream.encode(None))
            if self._sound is not None:
                self._sound.finish((self._last_pts + self._ticks_per_frame) * float(self._tick))
            self._container.close()
        except av.FFmpegError as error:
            raise self._unwritable(error) from error
        self.written = inspect_video(self._partial.name)
        if self.written.frames != self.frames:
            raise VideoError(
                f"{self.path}: only {self.written.frames} of {self.frames} frames arrived in the file; try again."
            )
        with translate_write_errors(self.path):
            self._partial.commit()

    def _unwritable(self, error: OSError | av.FFmpegError) -> OSError:
        kind = type(error) if type(error).__module__ == "builtins" else OSError
        return kind(f"{self.path}: cannot be written ({error.strerror}); choose another folder or free some space.")


def open_mp4(
    path: Path,
    size: tuple[int, int],
    rate: Fraction,
    tick: Fraction,
    colour_space: YuvColourSpace = YuvColourSpace(),  # noqa: B008 - it cannot be changed
    *,
    crf: int = CRF,
    threads: int = ENCODER_THREADS,
) -> tuple[av.container.OutputContainer, av.VideoStream]:
    """A file to be written and its stream of pictures of `size` (width, height), with all settings of the encoder."""
    container = av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
    # veryfast: 1.6 times as fast as x264's default, at about the same size (measured at 1280x720).
    stream = container.add_stream("libx264", rate=rate, options={"preset": "veryfast", "crf": str(crf)})
    codec = stream.codec_context
    codec.width, codec.height = size
    codec.pix_fmt = "yuv420p"
    codec.time_base = tick
    codec.thread_count = threads
    # Untagged video is shown in other colours by each player.
    codec.colorspace, codec.color_range = colour_space.matrix, _range_of(colour_space)
    codec.color_primaries, codec.color_trc = colour_space.primaries, colour_space.transfer
    return container, stream


class SoundTrack:
    """The sound track of `source`, brought into `target` piece by piece so that it lies beside the frames."""

    def __init__(self, source: str | Path, target: av.container.OutputContainer, *, start_s: float) -> None:
        self._path = source
        self._source = open_video(source)
        self._target = target
        self._start_s = start_s
        self._input = self._source.streams.audio[0]
        self._copied = self._input.codec_context.name in _COPIED_SOUND
        if self._copied:
            self._output = target.add_stream_from_template(self._input)
        else:
            self._output = target.add_stream("aac", rate=self._input.rate)
        self._pieces = self._from_start()
        self._next = next(self._pieces, None)

    def write_until(self, time_s: float) -> None:
        """Write what is heard before `time_s`, seconds since the first written frame."""
        while self._next is not None and self._next[0] < time_s:
            piece = self._next[1]
            if self._copied:
                piece.stream = self._output
                self._target.mux(piece)
            else:
                self._target.mux(self._output.encode(piece))
            self._next = next(self._pieces, None)

    def finish(self, time_s: float) -> None:
        """Write what is heard before `time_s`, and what the encoder holds back."""
        self.write_until(time_s)
        if not self._copied:
            self._target.mux(self._output.encode(None))

    def close(self) -> None:
        self._source.close()

    def _from_start(self) -> Iterator[tuple[float, av.Packet | av.AudioFrame]]:
        """Packets to copy, or frames to encode, from the first written frame on; with their times since it."""
        zero_s = self._start_s + float(start_time(self._source.streams.video[0]))
        if self._start_s > 0:
            self._source.seek(int(zero_s * av.time_base))
        pieces = self._source.demux(self._input) if self._copied else decode_frames(self._source, self._input)
        for piece in translate_errors(pieces, self._path):
            if piece.pts is None:
                continue
            piece.pts -= round(zero_s / piece.time_base)
            if self._copied:
                piece.dts = piece.pts
            if piece.pts >= 0:
                yield float(piece.pts * piece.time_base), piece


def _frame_of(picture: YuvFrame) -> av.VideoFrame:
    """The picture as FFmpeg takes it, without a copy where its height is a multiple of four."""
    width, height = picture.padded_size
    if height % 4 == 0:
        frame = av.VideoFrame.from_numpy_buffer(picture.data.reshape(-1, width), format="yuv420p")
    else:
        # For other heights PyAV mistakes the number of rows: the planes are copied one by one, which takes 1 ms.
        frame = av.VideoFrame(width, height, "yuv420p")
        for target, plane in zip(frame.planes, picture.planes, strict=True):
            # FFmpeg's rows are longer than the picture where that suits its vector instructions
            np.frombuffer(target, np.uint8).reshape(target.height, -1)[:, : target.width] = plane
    colour_space = picture.colour_space
    frame.colorspace, frame.color_range = colour_space.matrix, _range_of(colour_space)
    frame.color_primaries, frame.color_trc = colour_space.primaries, colour_space.transfer
    return frame


def _range_of(colour_space: YuvColourSpace) -> ColorRange:
    return ColorRange.JPEG if colour_space.full_range else ColorRange.MPEG
