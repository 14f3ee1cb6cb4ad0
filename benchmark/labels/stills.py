"""Scores of every system on hand-labelled stills."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from benchmark.labels.tusimple import LaneColumns, LineScore, score_lines, summarize_lines
from benchmark.reporting.tables import format_table
from benchmark.systems import column_detector
from lanes.camera.camera import Camera

COLUMNS = ("lines", "accuracy", "matched", "FP", "FN", "median error")


def score_pictures(
    labels: Sequence[LaneColumns],
    pictures: Iterable[np.ndarray],
    camera: Camera,
    systems: Sequence[str],
    *,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, list[LineScore]]:
    """Scores of systems on labelled pictures (height, width, 3) uint8, each processed independently.

    The scores of a system are those of the left and right line of each picture in turn. `progress` is called as
    progress(pictures done, pictures in total).

    Raises
    ------
    PictureError
        If a picture is not of the camera's size.
    """
    detectors = {system: column_detector(system, camera) for system in systems}
    scores: dict[str, list[LineScore]] = {system: [] for system in systems}
    for done, (label, image) in enumerate(zip(labels, pictures, strict=True), 1):
        camera.require_size(image, label.name)
        for system, detect in detectors.items():
            detected = LaneColumns(label.name, label.rows, np.round(detect(image, label.rows), 1))
            scores[system] += score_lines(label, detected)
        if progress:
            progress(done, len(labels))
    return scores


def describe_labelled(scores: Mapping[str, Sequence[LineScore]]) -> str:
    """A table of the summary, a line for each system."""
    rows = {}
    for system, lines in scores.items():
        row = summarize_lines(lines)
        shares = [f"{row[name]:.3f}" for name in ("accuracy", "matched", "fp", "fn")]
        rows[system] = [f"{row['lines']:.0f}", *shares, f"{row['error_px']:.1f} px"]
    return format_table(COLUMNS, rows)
