"""Stills to label in labelme, each with a file of the lines found (`lanes label`)."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from lanes.annotation import DriveSettings
from lanes.camera.model import Camera
from lanes.detect.lane import Lane, columns_at, stated
from lanes.errors import LaneError
from lanes.labelme import CHECKED, LINE_NAMES, Drawing, LineStrip, write_drawing
from lanes.stills import detect_stills
from lanes.video.images import read_image, write_image
from lanes.video.sources import sample_images

# How far a proposed line may lie beside the one found, pixels of an image 720 px high:
# a strip of a few points, which a person can drag, instead of one in each row.
_SIMPLIFIED_PX = 0.7
# Frames of one place in a video, decoded by different programs, differ by a PSNR of
# 38 dB; frames of different places by less than this.
_SAME_FRAME_DB = 30


def pick_stills(video: Path, settings: DriveSettings, count: int) -> Iterator[Path]:
    """Yield the paths of `count` frames spread over a part of a video.

    They are written as PNG into the settings' output folder; those of an earlier run
    stay. Raises LaneError if a file there is another image.
    """
    images = sample_images(
        [video],
        count,
        start_s=settings.start_s,
        end_s=settings.end_s,
        topic=settings.topic,
    )
    for number, image in enumerate(images, 1):
        path = settings.output / f"{video.stem}_{number:02d}_of_{count}.png"
        if not path.exists():
            write_image(path, image)
        elif not _is_same_frame(read_image(path), image):
            raise LaneError(
                f"{path}: is no frame of this part of {video}; give another output "
                "folder (-o)."
            )
        yield path


def _is_same_frame(image: np.ndarray, other: np.ndarray) -> bool:
    if image.shape != other.shape:
        return False
    return bool(cv2.PSNR(image, other) >= _SAME_FRAME_DB)


def label_file(still: Path) -> Path:
    """The file beside a still that labelme opens with it."""
    return still.with_suffix(".json")


def write_proposals(
    stills: Sequence[Path], settings: DriveSettings, failures: list[LaneError]
) -> list[Path]:
    """Write the lines found in each still into its labelme file; returns those written.

    A file that is there stays as it is. Errors of stills that cannot be used go to
    `failures`. Raises LaneError if two stills would share a file.
    """
    _require_a_file_each(stills)
    if all(label_file(still).exists() for still in stills):
        return []

    written = []
    # All stills, also those that have a file: they show the pose of the camera.
    for still in detect_stills(stills, settings, failures):
        path = label_file(still.path)
        if path.exists():
            continue
        height, width = still.image.shape[:2]
        drawing = Drawing(
            image=still.path.name,
            size=(width, height),
            strips=propose_lines(still.lane, still.detection.camera),
            checked=False,
        )
        written.append(write_drawing(path, drawing))
    return written


def _require_a_file_each(stills: Sequence[Path]) -> None:
    still_of: dict[Path, Path] = {}
    for still in stills:
        other = still_of.setdefault(label_file(still).absolute(), still)
        if other != still:
            raise LaneError(
                f"{still}: has the label file of {other.name}, {label_file(still)}; "
                "rename one of the stills."
            )


def propose_lines(lane: Lane | None, camera: Camera) -> tuple[LineStrip, ...]:
    """The lines of a lane that are seen, as far as they are seen and in the image.

    A lane that the overlay does not show has none.
    """
    lane = stated(lane)
    if lane is None:
        return ()

    seen = {}
    for name, line in zip(LINE_NAMES, [*lane.lines, *lane.adjacent], strict=True):
        if line is not None and line.seen:
            seen[name] = line.seen_pixels(camera)

    rows = np.arange(camera.height)
    strips = []
    for name, columns in zip(
        seen, columns_at(rows, list(seen.values()), camera), strict=True
    ):
        inside = columns >= 0
        points_px = np.column_stack([columns, rows])[inside]
        if len(points_px) > 1:
            strips.append(LineStrip(name, _simplify(points_px, camera.height)))
    return tuple(strips)


def _simplify(points_px: np.ndarray, height: int) -> np.ndarray:
    """The few of the points (N, 2) that make nearly the same line."""
    kept = cv2.approxPolyDP(
        points_px.astype(np.float32)[:, None],
        epsilon=_SIMPLIFIED_PX * height / 720,
        closed=False,
    )
    return kept[:, 0].astype(float)


def describe_proposals(stills: Sequence[Path], written: Sequence[Path]) -> str:
    """What was written, and the command that opens the stills in labelme, in words."""
    folder = os.path.commonpath([still.parent.absolute() for still in stills])
    names = ",".join(LINE_NAMES)
    command = ["labelme", folder, "--labels", names, "--validate-label", "exact"]
    there = sum(label_file(still).exists() for still in stills) - len(written)
    kept = f"; {there} were there and stay as they are" if there else ""
    return (
        f"wrote {len(written)} label files beside the stills{kept}\n"
        f"correct the lines in labelme, and tick {CHECKED} under Flags:\n"
        f"  {shlex.join(command)}"
    )
