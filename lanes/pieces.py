"""A long drive in pieces that are annotated independently and then joined.

The tracker has a state, so each piece starts tracking `WARM_UP_S` before its first frame. The result is then close to
that of a tracker that started with the drive: states are equal, offsets differ by less than 1 cm, headings by less than
0.1 degrees, curvatures by less than 0.1 per km. Each difference is below the tracker's own standard deviation
(tests/cluster/test_pieces.py; docs/many_drives.md has the differences over time).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lanes.annotate import DriveResult, DriveSettings, PreparedDrive, conclude_drive, output_path, track_video
from lanes.files import read_telemetry, write_telemetry
from lanes.video.join import join_videos
from lanes.video.process import count_missing

# Measured on the rendered drive: after 5 s offsets differ by 4 mm and curvatures by 0.03 per km, after 1 s by 8 mm and
# 0.15 per km.
WARM_UP_S = 5.0


@dataclass(frozen=True)
class Piece:
    """Part of a drive, in seconds since the first frame of its video; `end_s` None: up to the end."""

    number: int
    start_s: float
    end_s: float | None


def cut_drive(drive: PreparedDrive, settings: DriveSettings, piece_s: float) -> tuple[Piece, ...]:
    """Pieces of about `piece_s` seconds; a drive shorter than 1.5 `piece_s` is one piece.

    Each cut lies halfway between two frames, so that rounding cannot put a frame into two pieces or into none.
    """
    info = drive.info
    length_s = min(settings.end_s or info.duration_s, info.duration_s) - settings.start_s
    count = max(1, int(length_s / piece_s + 0.5))
    inner = settings.start_s + length_s * np.arange(1, count) / count
    cuts = [settings.start_s, *((np.round(inner * info.fps) - 0.5) / info.fps).tolist(), settings.end_s]
    return tuple(Piece(number, cuts[number], cuts[number + 1]) for number in range(count))


def annotate_piece(drive: PreparedDrive, piece: Piece, settings: DriveSettings, folder: Path) -> float:
    """Annotate one piece into `folder`, unless that was done before; returns the time that it took, in seconds.

    For a piece that was done before, the time is the sum of the latencies in its telemetry.
    """
    target = _video_path(piece, folder)
    telemetry = target.with_suffix(".csv")
    # The telemetry gets its final name after the video, so that its existence means a finished piece.
    if telemetry.exists():
        return float(read_telemetry(telemetry)["latency_ms"].sum() / 1e3)
    began_s = time.perf_counter()
    part = replace(settings, start_s=piece.start_s, end_s=piece.end_s)
    track_video(drive, target, part, sound=False, warm_up_s=WARM_UP_S)
    return time.perf_counter() - began_s


def join_pieces(
    drive: PreparedDrive, pieces: Sequence[Piece], settings: DriveSettings, folder: Path, elapsed_s: float
) -> DriveResult:
    """Join all pieces, in order, from `folder` into the files that `annotate_drive` writes.

    `elapsed_s` is the total time that the pieces took. Raises VideoError if a piece is damaged.
    """
    target = output_path(drive.video, settings.output)
    videos = [_video_path(piece, folder) for piece in pieces]
    tables = [read_telemetry(video.with_suffix(".csv")) for video in videos]
    starts_s = [table["time_s"][0] for table in tables]
    write_telemetry(target.with_suffix(".csv"), _join_rows(tables))
    sound = drive.info.has_audio
    join_videos(videos, starts_s, target, sound_from=drive.video if sound else None)
    frames = read_telemetry(target.with_suffix(".csv"))["frame"]
    missing = count_missing(
        drive.info, int(frames[0]), int(frames[-1]), len(frames), start_s=settings.start_s, end_s=settings.end_s
    )
    source = str(drive.video)
    return conclude_drive(source, target, drive.camera, drive.pose, settings, elapsed_s, missing=missing, sound=sound)


def _video_path(piece: Piece, folder: Path) -> Path:
    return folder / f"{piece.number:04}.mp4"


def _join_rows(tables: Sequence[dict[str, np.ndarray]]) -> Iterator[dict[str, object]]:
    """The rows of all tables with continuous frame numbers; the numbers of damaged frames are still skipped."""
    number = int(tables[0]["frame"][0])
    for table in tables:
        shift = number - int(table["frame"][0])
        for values in zip(*table.values(), strict=True):
            row = dict(zip(table, values, strict=True))
            number = int(row["frame"]) + shift
            yield {**row, "frame": number}
        number += 1
