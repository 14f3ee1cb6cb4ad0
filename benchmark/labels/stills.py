"""Every system on stills that were labelled by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmark.labels.tusimple import LaneColumns, LineScore, score_lines, summarize_lines
from benchmark.reporting.tables import format_table
from benchmark.systems import find_with
from lanes.camera.camera import Camera
from lanes.io.images import read_image

COLUMNS = ("lines", "accuracy", "matched", "FP", "FN", "median error")


def score_stills(
    labels: Sequence[LaneColumns],
    folder: str | Path,
    camera: Camera,
    systems: Sequence[str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, list[LineScore]]:
    """Let systems look at labelled pictures, each on its own.

    Parameters
    ----------
    labels : sequence of LaneColumns
        Their names are relative to `folder`.
    camera : Camera
        With its pose.
    systems : sequence of str
        In `systems.SYSTEMS`.
    progress : callable, optional
        Called as progress(pictures done, pictures in all).

    Returns
    -------
    dict of str to list of LineScore
        For each system a score for each of both lines in each picture.

    Raises
    ------
    FileNotFoundError, PictureError
        If a picture is missing, damaged or of another size than the camera's.
    """
    pictures = (read_image(Path(folder) / label.name) for label in labels)
    return score_pictures(labels, pictures, camera, systems, progress=progress)


def score_pictures(
    labels: Sequence[LaneColumns],
    pictures: Iterable[np.ndarray],
    camera: Camera,
    systems: Sequence[str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, list[LineScore]]:
    """The same for pictures (height, width, 3) uint8 that come one after the other, as many as labels.

    Raises
    ------
    PictureError
        If a picture is of another size than the camera's.
    """
    finders = {system: find_with(system, camera) for system in systems}
    scores: dict[str, list[LineScore]] = {system: [] for system in systems}
    for done, (label, image) in enumerate(zip(labels, pictures, strict=True), 1):
        camera.require_size(image, label.name)
        for system, find in finders.items():
            found = LaneColumns(label.name, label.rows, np.round(find(image, label.rows), 1))
            scores[system] += score_lines(label, found)
        if progress:
            progress(done, len(labels))
    return scores


def describe_labelled(scores: Mapping[str, Sequence[LineScore]]) -> str:
    """A table with a line for each system."""
    rows = {}
    for system, lines in scores.items():
        row = summarize_lines(lines)
        shares = [f"{row[name]:.3f}" for name in ("accuracy", "matched", "fp", "fn")]
        rows[system] = [f"{row['lines']:.0f}", *shares, f"{row['error_px']:.1f} px"]
    return format_table(COLUMNS, rows)
