"""Stills: the lane in each of them, of one camera or of cameras of their own."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from lanes.annotation import Annotation, DriveSettings
from lanes.detect.lane import Lane, stated
from lanes.detect.search import StillDetection
from lanes.drive_camera import camera_for, describe_lens, pose_for
from lanes.errors import LaneError, PictureError, PoseError
from lanes.files import TelemetryWriter
from lanes.pose.estimate import ESTIMATED, PoseEstimate, detect_in_drive
from lanes.show.draw import draw_lane
from lanes.show.report import describe_confidence, describe_shares
from lanes.telemetry import LOST, telemetry_row
from lanes.video.images import read_image, write_image

# Table of the stills in the output folder.
STILLS_TABLE = "pictures.csv"


@dataclass(frozen=True, eq=False)
class StillResult:
    """A still with its detection and the time of the detection.

    `pose` is the estimate that it was made with, None if the camera had a pose.
    """

    path: Path
    image: np.ndarray
    detection: StillDetection
    pose: PoseEstimate | None
    run_time_ms: float

    @property
    def lane(self) -> Lane | None:
        """The lane, if its confidence is high enough to state it."""
        return stated(self.detection.lane)


def annotate_stills(stills: Sequence[Path], settings: DriveSettings) -> Annotation:
    """Find the lane in each still independently, and write images and a table.

    The annotated images have the same names. A still that cannot be used is skipped;
    see `Annotation.failures`. Errors are those of `annotate`.
    """
    failures: list[LaneError] = []
    detected = detect_stills(stills, settings, failures)
    # raises if no still can be used, before anything is written
    first = next(detected)

    outputs: list[Path] = []
    lines: list[str] = []
    common_pose = None
    path = settings.output / STILLS_TABLE
    with TelemetryWriter(path) as table:
        for still in chain([first], detected):
            lane = still.lane
            row = {"frame": len(outputs), "picture": still.path.name}
            outputs.append(_write_annotated(still, settings))
            table.write(row | telemetry_row(lane))
            if still.pose is None or still.pose.still is None:
                common_pose = still.pose
                continue
            found = LOST
            if lane:
                found = f"{lane.state} (confidence {lane.confidence:.2f})"
            lens = describe_lens(settings, still.path)
            lines.append(f"{still.path}: {found}; {still.pose.summary_line()}{lens}")

    if common_pose:
        lines.append(common_pose.describe())
        if common_pose.state != ESTIMATED:
            lines.append(
                "hint: few pictures show this camera pose. If the pictures are of "
                "several cameras, annotate them with --each."
            )
    telemetry = table.columns()
    found_words = f"{describe_shares(telemetry)}{describe_confidence(telemetry)}"
    lines.append(
        f"stills: {len(outputs)} pictures, {found_words}; wrote them and {path.name} "
        f"to {path.parent}"
    )
    return Annotation(
        outputs=(*outputs, path),
        telemetry=telemetry,
        description="\n".join(lines),
        pose=common_pose,
        failures=tuple(failures),
    )


def _write_annotated(still: StillResult, settings: DriveSettings) -> Path:
    detection = still.detection
    drawn = draw_lane(
        still.image,
        still.lane,
        detection.camera,
        style=settings.style,
        evidence=detection.evidence,
    )
    return write_image(settings.output / still.path.name, drawn)


def still_outputs(
    stills: Sequence[Path], settings: DriveSettings
) -> list[tuple[Path, Path]]:
    """The files that `annotate_stills` writes, each with the still that it is of."""
    planned = [(still, settings.output / still.name) for still in stills]
    tables = [(still, settings.output / STILLS_TABLE) for still in stills[:1]]
    return planned + tables


def detect_stills(
    stills: Sequence[Path], settings: DriveSettings, failures: list[LaneError]
) -> Iterator[StillResult]:
    """The detection in each still, one after the other.

    Errors of stills that cannot be used go to `failures`. If none of the stills can be
    used, the errors are raised as one.
    """
    groups = [[path] for path in stills] if settings.each else [stills]
    none_used = True
    for group in groups:
        try:
            for still in _detect_group(group, settings, failures):
                none_used = False
                yield still
        except LaneError as error:
            failures.append(error)
    if none_used:
        raise type(failures[-1])("\n".join(map(str, failures)))


def _detect_group(
    stills: Sequence[Path], settings: DriveSettings, failures: list[LaneError]
) -> Iterator[StillResult]:
    """The detection in each still of one camera; see `detect_in_drive` for the pose."""
    size, usable, images = _usable_stills(stills, failures)
    if not usable:
        return
    began_s = time.perf_counter()
    camera = camera_for(settings, size, usable[0])
    # a still that is alone stays in memory; several could fill it
    source = images[0] if images else usable
    try:
        camera, pose = pose_for(settings, camera, source)
    except PoseError as error:
        raise PoseError(f"{usable[0]}: {error}") from error

    for path in usable:
        if images:
            image = images[0]
        else:
            began_s = time.perf_counter()
            image = read_image(path)
        detection, pose_used = detect_in_drive(image, camera, pose, settings.markings)
        elapsed_s = time.perf_counter() - began_s
        yield StillResult(path, image, detection, pose_used, 1e3 * elapsed_s)


def _usable_stills(
    stills: Sequence[Path], failures: list[LaneError]
) -> tuple[tuple[int, int], list[Path], list[np.ndarray]]:
    """The most common size of the stills, those that have it, and their images.

    There are images only if one still alone can be read. The errors of the others go to
    `failures`.
    """
    sizes: dict[Path, tuple[int, int]] = {}
    for path in stills:
        try:
            image = read_image(path)
            sizes[path] = image.shape[1::-1]
        except PictureError as error:
            failures.append(error)
    if not sizes:
        return (0, 0), [], []

    counts = Counter(sizes.values())
    (common, _) = counts.most_common(1)[0]
    usable = []
    for path, size in sizes.items():
        if size == common:
            usable.append(path)
            continue
        failures.append(
            PictureError(
                f"{path}: is {size[0]}x{size[1]}, the others used are "
                f"{common[0]}x{common[1]}; annotate it alone, or all with --each."
            )
        )
    return common, usable, [image] if len(sizes) == 1 else []
