"""Concatenation of the pieces of an annotated video without re-encoding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path

import av

from lanes.errors import VideoError
from lanes.files import atomic_write
from lanes.video.reader import inspect_video, open_video, translate_errors
from lanes.video.writer import SoundTrack, inspect_output


def join_videos(
    pieces: Sequence[Path], starts_s: Sequence[float], target: Path, *, sound_from: str | Path | None = None
) -> int:
    """Concatenate videos written by `VideoWriter` with the same settings, atomically; returns the number of frames.

    Every piece begins with a key frame and all have the same decoder configuration, so that packets only need new time
    stamps. `starts_s` has the time of the first frame of each piece in the whole drive; the output begins at the first
    of them. The sound of the video `sound_from` is copied, from `starts_s[0]` to the last frame.

    Raises
    ------
    VideoError
        If a piece is damaged or encoded with other settings, or frames are missing in the output.
    OSError
        If `target` cannot be written.
    """
    with atomic_write(target) as partial:
        with ExitStack() as opened:
            container = opened.enter_context(
                av.open(str(partial), "w", format="mp4", options={"movflags": "+faststart"})
            )
            like = opened.enter_context(open_video(pieces[0])).streams.video[0]
            stream = container.add_stream_from_template(like)
            # The time base of the pieces, so that no time stamp is rounded.
            stream.time_base = like.time_base
            track = None
            if sound_from is not None:
                track = SoundTrack(sound_from, container, start_s=starts_s[0])
                opened.callback(track.close)
            frames, end_s = 0, 0.0
            for packet, packet_end_s in _packets(pieces, starts_s, like):
                packet.stream = stream
                frames += 1
                end_s = max(end_s, packet_end_s)
                container.mux(packet)
                if track:
                    track.write_until(end_s)
            if track:
                track.finish(end_s)
        inspect_output(partial, frames, target)
    return frames


def _packets(
    pieces: Sequence[Path], starts_s: Sequence[float], like: av.VideoStream
) -> Iterator[tuple[av.Packet, float]]:
    """The packets of all pieces in decoding order, with time stamps of the output, and the time when each ends."""
    header, tick = like.codec_context.extradata, like.time_base or Fraction(1)
    last_dts = None
    for path, start_s in zip(pieces, starts_s, strict=True):
        inspect_video(path)  # refuses a piece that was cut off
        shift = round((start_s - starts_s[0]) / float(tick))
        with open_video(path) as piece:
            video = piece.streams.video[0]
            if (video.codec_context.extradata, video.time_base) != (header, tick):
                raise VideoError(
                    f"{path}: was encoded with other settings than the piece before it; annotate the video again."
                )
            for packet in translate_errors(piece.demux(video), path):
                if not packet.size:
                    continue
                packet.pts += shift
                # Decoding times precede presentation times: where the rate changes at a joint, two could be equal.
                packet.dts = packet.dts + shift if last_dts is None else max(packet.dts + shift, last_dts + 1)
                last_dts = packet.dts
                yield packet, float((packet.pts + packet.duration) * tick)
