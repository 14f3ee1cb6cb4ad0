"""One long drive as pieces that are annotated on their own, and joined.

The tracker has a memory, so that each piece begins to look some seconds before its first frame. It then knows nearly
the same as one that has followed the lane from the beginning: after `WARM_UP_S` the states are the same, offsets differ
by less than 1 cm, headings by less than 0.1 degrees, curvatures by less than 0.1 per km, and each by less than one of
the standard deviations that the tracker gives it (tests/cluster/test_pieces.py; docs/many_drives.md has the times).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lanes.drives.annotation import PreparedDrive, conclude_drive, output_for
from lanes.drives.settings import DriveResult, DriveSettings
from lanes.io.telemetry import read_telemetry, write_telemetry
from lanes.io.video.join import join_videos
from lanes.io.video.pipeline import annotate_video, count_missing

# On the rendered drive offsets then differ by 4 mm and curvatures by 0.03 per km; after 1 s by 8 mm and 0.15 per km.
WARM_UP_S = 5.0


@dataclass(frozen=True)
class Piece:
    """Part of a drive, in seconds since the first frame of its video; `end_s` is None where it goes on to the end."""

    number: int
    start_s: float
    end_s: float | None


def cut_drive(drive: PreparedDrive, settings: DriveSettings, piece_s: float) -> tuple[Piece, ...]:
    """Pieces of about `piece_s` seconds; a drive shorter than one and a half of them stays whole.

    They begin half a frame before a frame, so that no rounding can put a frame into two pieces or none.
    """
    info = drive.info
    length_s = min(settings.end_s or info.duration_s, info.duration_s) - settings.start_s
    count = max(1, int(length_s / piece_s + 0.5))
    inner = settings.start_s + length_s * np.arange(1, count) / count
    cuts = [settings.start_s, *((np.round(inner * info.fps) - 0.5) / info.fps).tolist(), settings.end_s]
    return tuple(Piece(number, cuts[number], cuts[number + 1]) for number in range(count))


def annotate_piece(drive: PreparedDrive, piece: Piece, settings: DriveSettings, folder: Path) -> float:
    """Annotate one piece into `folder`, unless that was done before; returns the seconds that it took, at least."""
    target = _file_of(piece, folder)
    telemetry = target.with_suffix(".csv")
    # It gets its name after the video.
    if telemetry.exists():
        return float(read_telemetry(telemetry)["latency_ms"].sum() / 1e3)
    began_s = time.perf_counter()
    annotate_video(
        drive.video,
        target,
        drive.follow(settings.style),
        start_s=piece.start_s,
        end_s=piece.end_s,
        progress=settings.progress,
        telemetry=telemetry,
        sound=False,
        warm_up_s=WARM_UP_S,
        overlapped=settings.overlapped,
        info=drive.info,
    )
    return time.perf_counter() - began_s


def join_pieces(
    drive: PreparedDrive, pieces: Sequence[Piece], settings: DriveSettings, folder: Path, elapsed_s: float
) -> DriveResult:
    """Join the pieces in `folder` to what `annotate_drive` writes; `elapsed_s` is what they took."""
    target = output_for(drive.video, settings.output)
    videos = [_file_of(piece, folder) for piece in pieces]
    tables = [read_telemetry(video.with_suffix(".csv")) for video in videos]
    starts_s = [table["time_s"][0] for table in tables]
    write_telemetry(target.with_suffix(".csv"), _rows(tables))
    join_videos(videos, starts_s, target, sound_from=drive.video if drive.info.has_audio else None)
    frames = read_telemetry(target.with_suffix(".csv"))["frame"]
    piece = {"start_s": settings.start_s, "end_s": settings.end_s}
    missing = count_missing(drive.info, int(frames[0]), int(frames[-1]), len(frames), **piece)
    source = str(drive.video)
    return conclude_drive(source, target, drive.camera, drive.pose, settings, elapsed_s, missing=missing)


def _file_of(piece: Piece, folder: Path) -> Path:
    return folder / f"{piece.number:04}.mp4"


def _rows(tables: Sequence[dict[str, np.ndarray]]) -> Iterator[dict[str, object]]:
    """The rows of all tables, numbered through; numbers that are left out for damaged frames stay so."""
    number = int(tables[0]["frame"][0])
    for table in tables:
        shift = number - int(table["frame"][0])
        for values in zip(*table.values(), strict=True):
            row = dict(zip(table, values, strict=True))
            number = int(row["frame"]) + shift
            yield {**row, "frame": number}
        number += 1
