"""Scores of every system on hand-labelled stills. Are stated uncertainty and confidence true there?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.systems import DETECTOR, TRACKER, ColumnDetector, column_detector
from lanes.camera import Camera
from lanes.console import progress_line
from lanes.describe import format_table, number_cells
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.images import read_image
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.pose import PoseEstimate, detect_in_drive, ensure_pose
from lanes.score import StillScore, lateral_errors_m, reliability, score_still, summarize

# Distances at which lines are compared.
COMPARED_AT_M = np.array([8.0, 15.0, 25.0])
# Standard deviation of a labelled column: 95 % of the differences between two labellers are below 3.2 px.
LABEL_STD_PX = 1.6
# With a larger error another line was found.
OTHER_LINE_M = 1.0
LEGEND = """\
z: lateral error against the label, both projected to the flat road, divided by its standard deviation: that of the lane
at this picture row and 1.6 px of the label. Cells: root mean square (1 is wanted), percent within 1 and 2 (68/95).
Right: every labelled line is matched."""


@dataclass(frozen=True, eq=False)
class ScoredLane:
    """The lane found for a label, None without one, its score, and its errors.

    `z` (2, 3) are errors of both lines at COMPARED_AT_M, in standard deviations of the position at a picture row
    (`row_std_m`), NaN where nothing is compared. `other_lines` is the number of errors above OTHER_LINE_M, which are
    left out.
    """

    score: StillScore
    lane: Lane | None
    z: np.ndarray
    other_lines: int = 0


@dataclass(frozen=True, eq=False)
class LabelledFolder:
    """Scores of each system on the labelled stills of one camera, the lanes of the engine, and the pose.

    `engine` is empty if neither tracker nor detector is scored; `estimate` is None if the camera had a pose.
    """

    scores: dict[str, list[StillScore]]
    engine: list[ScoredLane]
    estimate: PoseEstimate | None

    def describe_pose(self) -> str:
        """The estimated pose in words."""
        return self.estimate.describe() if self.estimate else "camera pose: that of the camera file"


def score_folder(
    labels: Sequence[LaneColumns],
    files: Sequence[Path],
    lens: Camera,
    systems: Sequence[str],
    *,
    markings: Markings | None = None,
) -> LabelledFolder:
    """Scores on the labelled pictures of one camera, whose pose is estimated from them if it has none.

    Each picture is processed independently. Errors are those of `ensure_pose`, and PictureError if a picture is not of
    the camera's size.
    """
    camera, estimate = ensure_pose(lens, files, progress=progress_line("pose"), markings=markings)
    others = {system: column_detector(system, camera) for system in systems if system not in (TRACKER, DETECTOR)}
    scores: dict[str, list[StillScore]] = {system: [] for system in systems}
    engine: list[ScoredLane] = []
    report = progress_line("stills")
    for done, (label, file) in enumerate(zip(labels, files, strict=True), 1):
        image = camera.require_size(read_image(file), label.name)
        if len(others) < len(systems):
            found, _ = detect_in_drive(image, camera, estimate, markings)
            engine.append(score_lane(found.lane, label, found.camera))
        for system, some in scores.items():
            some.append(_score(label, others[system], image, camera) if system in others else engine[-1].score)
        report(done, len(labels))
    return LabelledFolder(scores, engine, estimate)


def _score(label: LaneColumns, columns_of: ColumnDetector, image: np.ndarray, camera: Camera) -> StillScore:
    found = LaneColumns(label.name, label.rows, np.round(columns_of(image, label.rows), 1), EGO_SIDES)
    return score_still(label, found, camera.size)


def describe_labelled(folders: Sequence[LabelledFolder]) -> str:
    """A table of the scores on the stills of all cameras, a line for each system."""
    scores = {system: [one for folder in folders for one in folder.scores[system]] for system in folders[0].scores}
    return format_table(*number_cells({system: summarize(some) for system, some in scores.items()}))


def score_lane(lane: Lane | None, label: LaneColumns, camera: Camera) -> ScoredLane:
    """The score of a lane that is detected in a single picture by `camera`, whose pose it has."""
    if lane is None:
        return ScoredLane(score_still(label, None, camera.size), None, np.full((2, len(COMPARED_AT_M)), np.nan))
    found = LaneColumns(label.name, label.rows, lane.columns(camera, label.rows), EGO_SIDES, lane.confidence)
    error_m = lateral_errors_m(label.ego_lane(camera.size), found, camera, COMPARED_AT_M)
    other = np.abs(error_m) > OTHER_LINE_M
    label_std_m = LABEL_STD_PX * COMPARED_AT_M / camera.matrix[0, 0]
    row_std = row_std_m(lane, COMPARED_AT_M, camera.require_pose().height_m)
    z = np.where(other, np.nan, error_m / np.hypot(row_std, label_std_m))
    return ScoredLane(score_still(label, found, camera.size), lane, z, int(other.sum()))


def row_std_m(lane: Lane, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Standard deviation (2, N) of the lines' lateral positions at the picture rows of distances x (N,) on a flat road.

    Pitch and width of a lane are correlated: both decide where the lines are in the picture. Errors of the pitch, which
    displace the lines on the road, hardly displace them in the picture that they are fitted to.
    """
    gradients = parameter_gradients(lambda lanes: lines_on_view(lanes, x_m, height_m), lane.model)
    return propagated_std(gradients, lane.covariance)


def describe_lanes(scored: Sequence[ScoredLane]) -> str:
    """Tables of z at each distance, and of the right lanes by confidence."""
    compared, cells = np.isfinite(all_z(scored)).sum(axis=(0, 1)), _z_cells(scored)
    rows = {f"lateral, {x:.0f} m": [f"{n}", cell] for x, n, cell in zip(COMPARED_AT_M, compared, cells, strict=True)}
    return (
        f"{format_table(('compared', 'z'), rows)}\n"
        f"left out, error above {OTHER_LINE_M:g} m: {sum(one.other_lines for one in scored)}\n"
        f"{format_table(*number_cells(reliability(one.score for one in scored)))}\n{LEGEND}"
    )


def summarize_lanes(scored: Sequence[ScoredLane]) -> str:
    """The same in one line."""
    sure = reliability(one.score for one in scored)["0.9 or more"]
    at = "/".join(f"{x:.0f}" for x in COMPARED_AT_M)
    return (
        f"z at {at} m: {', '.join(_z_cells(scored))}; 0.9 or more: {sure['right']} of {sure['lanes']} right, "
        f"{sure['of right lanes']:.0%} of the right lanes"
    )


def all_z(scored: Sequence[ScoredLane]) -> np.ndarray:
    """(N, 2, 3) z of N stills."""
    return np.array([one.z for one in scored]).reshape(-1, 2, len(COMPARED_AT_M))


def _z_cells(scored: Sequence[ScoredLane]) -> list[str]:
    """Summaries of z in words, for each distance."""
    return [describe_z(z_summary(some[np.isfinite(some)])) for some in np.moveaxis(all_z(scored), 2, 0)]
