"""Scores of every system on hand-labelled stills. Are stated uncertainty and confidence true there?"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.systems import DETECTOR, TRACKER, column_detector
from lanes.camera import Camera
from lanes.describe import format_table, number_cells
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.images import read_image
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.pose import PoseEstimate, detect_in_drive, ensure_pose
from lanes.score import PictureScore, lateral_errors_m, reliability, score_picture, summarize
from lanes.stills import StillDetection

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


def score_pictures(
    labels: Sequence[LaneColumns],
    pictures: Iterable[np.ndarray],
    camera: Camera,
    systems: Sequence[str],
    *,
    detect: Callable[[np.ndarray], StillDetection],
    progress: Callable[[int, int], None] | None = None,
) -> tuple[dict[str, list[PictureScore]], list[StillCheck]]:
    """Scores of systems on labelled pictures (height, width, 3) uint8, and checks of the lanes that `detect` finds.

    Each picture is processed independently. `detect` is tracker and detector; there are no checks without one of them.
    `progress` is called as progress(pictures done, pictures in total). Raises PictureError if a picture is not of the
    camera's size.
    """
    others = {system: column_detector(system, camera) for system in systems if system not in (TRACKER, DETECTOR)}
    scores: dict[str, list[PictureScore]] = {system: [] for system in systems}
    checks: list[StillCheck] = []
    for done, (label, image) in enumerate(zip(labels, pictures, strict=True), 1):
        camera.require_size(image, label.name)
        for system, columns_of in others.items():
            lines = LaneColumns(label.name, label.rows, np.round(columns_of(image, label.rows), 1), EGO_SIDES)
            scores[system].append(score_picture(label, lines, camera.size))
        if len(others) < len(systems):
            found = detect(image)
            check = check_lane(found.lane, label, found.camera) if found.lane else None
            checks += [check] if check else []
            score = check.score if check else score_picture(label, None, camera.size)
            for system in systems:
                scores[system] += [score] if system not in others else []
        if progress:
            progress(done, len(labels))
    return scores, checks


@dataclass(frozen=True, eq=False)
class LabelledFolder:
    """Scores of each system on the labelled stills of one camera, the checks of the detected lanes, and the pose.

    `checks` is empty if neither tracker nor detector is scored; `estimate` is None if the camera had a pose.
    """

    scores: dict[str, list[PictureScore]]
    checks: list[StillCheck]
    estimate: PoseEstimate | None

    def describe_pose(self) -> str:
        """The estimated pose in words."""
        return self.estimate.describe() if self.estimate else "camera pose: that of the camera file"


def score_folder(
    labels: Sequence[LaneColumns],
    files: Sequence[Path],
    lens: Camera,
    systems: Sequence[str],
    progress: Callable[[str], Callable[[int, int], None]],
    *,
    markings: Markings | None = None,
) -> LabelledFolder:
    """Scores and checks on the labelled pictures of one camera, whose pose is estimated from them if it has none.

    `progress`, called with the name of a part of the work, returns its callback (done, total). Errors are those of
    `ensure_pose` and `score_pictures`.
    """
    camera, estimate = ensure_pose(lens, files, progress=progress("pose"), markings=markings)
    detect, report = (lambda image: detect_in_drive(image, camera, estimate, markings)[0]), progress("stills")
    pictures = map(read_image, files)
    scored = score_pictures(labels, pictures, camera, systems, detect=detect, progress=report)
    return LabelledFolder(*scored, estimate)


def join_scores(folders: Iterable[LabelledFolder]) -> dict[str, list[PictureScore]]:
    """The scores of each system on the stills of all cameras."""
    scores: dict[str, list[PictureScore]] = {}
    for folder in folders:
        for system, some in folder.scores.items():
            scores.setdefault(system, []).extend(some)
    return scores


def describe_labelled(scores: Mapping[str, Sequence[PictureScore]]) -> str:
    """A table of the summary, a line for each system."""
    return format_table(*number_cells({system: summarize(some) for system, some in scores.items()}))


@dataclass(frozen=True, eq=False)
class StillCheck:
    """What a lane, detected in a labelled still, states about itself, and its score.

    `z` (2, 3) are errors of both lines at COMPARED_AT_M, in standard deviations of the position at a picture row
    (`row_std_m`), NaN where nothing is compared. `other_lines` is the number of errors above OTHER_LINE_M, which are
    left out.
    """

    z: np.ndarray
    other_lines: int
    score: PictureScore


def check_lane(lane: Lane, label: LaneColumns, camera: Camera) -> StillCheck:
    """The check of a lane that is detected in a single picture."""
    found = LaneColumns(label.name, label.rows, lane.columns(camera, label.rows), EGO_SIDES, lane.confidence)
    error_m = lateral_errors_m(label.ego_lane(camera.size), found, camera, COMPARED_AT_M)
    other = np.abs(error_m) > OTHER_LINE_M
    error_m[other] = np.nan
    label_std_m = LABEL_STD_PX * COMPARED_AT_M / camera.matrix[0, 0]
    row_std = row_std_m(lane, COMPARED_AT_M, camera.require_pose().height_m)
    score = score_picture(label, found, camera.size)
    return StillCheck(error_m / np.hypot(row_std, label_std_m), int(other.sum()), score)


def row_std_m(lane: Lane, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Standard deviation (2, N) of the lines' lateral positions at the picture rows of distances x (N,) on a flat road.

    Pitch and width of a lane are correlated: both decide where the lines are in the picture. Errors of the pitch, which
    displace the lines on the road, hardly displace them in the picture that they are fitted to.
    """
    gradients = parameter_gradients(lambda lanes: lines_on_view(lanes, x_m, height_m), lane.model)
    return propagated_std(gradients, lane.covariance)


def describe_checks(checks: Sequence[StillCheck]) -> str:
    """Tables of z at each distance, and of the right lanes by confidence."""
    rows = {}
    for distance_m, z, cell in zip(COMPARED_AT_M, np.moveaxis(all_z(checks), 2, 0), _z_cells(checks), strict=True):
        rows[f"lateral, {distance_m:.0f} m"] = [f"{np.isfinite(z).sum()}", cell]
    stated = reliability(check.score for check in checks)
    return (
        f"{format_table(('compared', 'z'), rows)}\n"
        f"left out, error above {OTHER_LINE_M:g} m: {sum(check.other_lines for check in checks)}\n"
        f"{format_table(*number_cells(stated))}\n{LEGEND}"
    )


def summarize_checks(checks: Sequence[StillCheck]) -> str:
    """The same in one line."""
    sure = reliability(check.score for check in checks)["0.9 or more"]
    at = "/".join(f"{x:.0f}" for x in COMPARED_AT_M)
    return (
        f"z at {at} m: {', '.join(_z_cells(checks))}; 0.9 or more: {sure['right']} of {sure['lanes']} right, "
        f"{sure['of right lanes']:.0%} of the right lanes"
    )


def all_z(checks: Sequence[StillCheck]) -> np.ndarray:
    """(N, 2, 3) z of N stills."""
    return np.array([check.z for check in checks]).reshape(-1, 2, len(COMPARED_AT_M))


def _z_cells(checks: Sequence[StillCheck]) -> list[str]:
    """Summaries of z in words, for each distance."""
    return [describe_z(z_summary(some[np.isfinite(some)])) for some in np.moveaxis(all_z(checks), 2, 0)]
