"""Scores of every system on hand-labelled stills. Are stated uncertainty and confidence true there?"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from benchmark.consistency import describe_z, z_summary
from benchmark.errors import CONFIDENT
from benchmark.labels.tusimple import LaneColumns, LineScore, picture_is_right, score_lines, summarize_lines
from benchmark.reporting.tables import format_table
from benchmark.systems import DETECTOR, TRACKER, column_detector
from lanes.camera import Camera
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.images import read_image
from lanes.pose import PoseEstimate, ensure_pose
from lanes.stills import find_lane

COLUMNS = ("lines", "accuracy", "matched", "FP", "FN", "median error")
# Distances at which lines are compared. Rows count whose distance on the road differs by less than this share.
COMPARED_AT_M = np.array([8.0, 15.0, 25.0])
DISTANCE_SHARE = 0.08
# Standard deviation of a labelled column: 95 % of the differences between two labellers are below 3.2 px.
LABEL_STD_PX = 1.6
# With a larger error another line was found.
OTHER_LINE_M = 1.0
LEGEND = """\
z: lateral error against the label, both projected to the flat road at the same picture row, divided by its standard
deviation: that of the lane at this row and 1.6 px of the label. Cells: root mean square (1 is wanted), percent within 1
and 2 (68/95). Right: every labelled line is matched."""


def score_pictures(
    labels: Sequence[LaneColumns],
    pictures: Iterable[np.ndarray],
    camera: Camera,
    systems: Sequence[str],
    *,
    progress: Callable[[int, int], None] | None = None,
    markings: Markings | None = None,
) -> dict[str, list[LineScore]]:
    """Scores of systems on labelled pictures (height, width, 3) uint8, each processed independently.

    The scores of a system are those of the left and right line of each picture in turn. `progress` is called as
    progress(pictures done, pictures in total). Raises PictureError if a picture is not of the camera's size.
    """
    detectors = {system: column_detector(system, camera, markings=markings) for system in systems}
    scores: dict[str, list[LineScore]] = {system: [] for system in systems}
    for done, (label, image) in enumerate(zip(labels, pictures, strict=True), 1):
        camera.require_size(image, label.name)
        for system, detect in detectors.items():
            detected = LaneColumns(label.name, label.rows, np.round(detect(image, label.rows), 1))
            scores[system] += score_lines(label, detected, width_px=camera.width)
        if progress:
            progress(done, len(labels))
    return scores


@dataclass(frozen=True, eq=False)
class LabelledFolder:
    """Scores of each system on the labelled stills of one camera, the checks of the detected lanes, and the pose.

    `checks` is empty if neither tracker nor detector is scored; `estimate` is None if the camera had a pose.
    """

    scores: dict[str, list[LineScore]]
    checks: list[StillCheck]
    estimate: PoseEstimate | None

    def describe_pose(self) -> str:
        """The estimated pose in words."""
        return self.estimate.describe() if self.estimate else "camera pose: that of the camera file"


def split_folders(labels: Sequence[LaneColumns]) -> dict[str, list[LaneColumns]]:
    """The labels of the pictures in each top folder below the file of the labels."""
    folders: dict[str, list[LaneColumns]] = {}
    for label in labels:
        folders.setdefault(PurePosixPath(label.name).parts[0], []).append(label)
    return folders


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
    report = progress("stills")
    scores = score_pictures(labels, map(read_image, files), camera, systems, progress=report, markings=markings)
    detects = not {TRACKER, DETECTOR}.isdisjoint(systems)
    checks = check_stills(labels, map(read_image, files), camera, markings=markings) if detects else []
    return LabelledFolder(scores, checks, estimate)


def join_scores(folders: Iterable[LabelledFolder]) -> dict[str, list[LineScore]]:
    """The scores of each system on the stills of all cameras."""
    scores: dict[str, list[LineScore]] = {}
    for folder in folders:
        for system, lines in folder.scores.items():
            scores.setdefault(system, []).extend(lines)
    return scores


def describe_labelled(scores: Mapping[str, Sequence[LineScore]]) -> str:
    """A table of the summary, a line for each system."""
    rows = {}
    for system, lines in scores.items():
        row = summarize_lines(lines)
        shares = [f"{row[name]:.3f}" for name in ("accuracy", "matched", "fp", "fn")]
        rows[system] = [f"{row['lines']:.0f}", *shares, f"{row['error_px']:.1f} px"]
    return format_table(COLUMNS, rows)


@dataclass(frozen=True, eq=False)
class StillCheck:
    """What a lane, detected in a labelled still, states about itself, and what is true.

    `z` (2, 3) are errors of both lines at COMPARED_AT_M, in standard deviations of the position at a picture row
    (`row_std_m`), NaN where nothing is compared. `other_lines` is the number of errors above OTHER_LINE_M, which are
    left out. `right` says whether all labelled lines are matched; None if none is long enough to be scored.
    """

    z: np.ndarray
    other_lines: int
    confidence: float
    right: bool | None


def check_stills(
    labels: Sequence[LaneColumns],
    pictures: Iterable[np.ndarray],
    camera: Camera,
    *,
    markings: Markings | None = None,
) -> list[StillCheck]:
    """Checks of the lanes that are detected in labelled pictures, each processed independently."""
    checks = []
    for label, image in zip(labels, pictures, strict=True):
        lane = find_lane(image, camera, markings=markings)
        if lane is not None:
            checks.append(check_lane(lane, label, camera))
    return checks


def check_lane(lane: Lane, label: LaneColumns, camera: Camera) -> StillCheck:
    """The check of a lane that is detected in a single picture."""
    columns = lane.columns(camera, label.rows)
    error_m = np.array(
        [_lateral_errors(*pair, label.rows, camera) for pair in zip(columns, label.columns, strict=True)]
    )
    other = np.abs(error_m) > OTHER_LINE_M
    error_m[other] = np.nan
    label_std_m = LABEL_STD_PX * COMPARED_AT_M / camera.matrix[0, 0]
    row_std = row_std_m(lane, COMPARED_AT_M, camera.require_pose().height_m)
    return StillCheck(
        error_m / np.hypot(row_std, label_std_m),
        int(other.sum()),
        lane.confidence,
        picture_is_right(label, LaneColumns(label.name, label.rows, columns), width_px=camera.width),
    )


def row_std_m(lane: Lane, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Standard deviation (2, N) of the lines' lateral positions at the picture rows of distances x (N,) on a flat road.

    Pitch and width of a lane are correlated: both decide where the lines are in the picture. Errors of the pitch, which
    displace the lines on the road, hardly displace them in the picture that they are fitted to.
    """
    gradients = parameter_gradients(lambda lanes: lines_on_view(lanes, x_m, height_m), lane.model)
    return propagated_std(gradients, lane.covariance)


def _lateral_errors(detected: np.ndarray, labelled: np.ndarray, rows: np.ndarray, camera: Camera) -> np.ndarray:
    """(3,) mean lateral error of a line at COMPARED_AT_M; NaN where no row has both."""
    both = (detected >= 0) & (labelled >= 0)
    road, true = (camera.pixels_to_road(np.column_stack([c[both], rows[both]])) for c in (detected, labelled))
    errors = road[:, 1] - true[:, 1]
    near = np.abs(road[:, 0] - COMPARED_AT_M[:, None]) < DISTANCE_SHARE * COMPARED_AT_M[:, None]
    return np.array([errors[some].mean() if some.any() else np.nan for some in near])


def describe_checks(checks: Sequence[StillCheck]) -> str:
    """Tables of z at each distance, and of the right lanes by confidence."""
    rows = {}
    for distance_m, z, cell in zip(COMPARED_AT_M, np.moveaxis(all_z(checks), 2, 0), _z_cells(checks), strict=True):
        rows[f"lateral, {distance_m:.0f} m"] = [f"{np.isfinite(z).sum()}", cell]
    confidence = {name: [cell] for name, cell in _confidence_cells(checks).items()}
    return (
        f"{format_table(('compared', 'z'), rows)}\n"
        f"left out, error above {OTHER_LINE_M:g} m: {sum(check.other_lines for check in checks)}\n"
        f"{format_table(('right',), confidence)}\n{LEGEND}"
    )


def summarize_checks(checks: Sequence[StillCheck]) -> str:
    """The same in one line."""
    cells = _z_cells(checks)
    shares = _confidence_cells(checks)
    confident, *_, share = shares.values()
    at = "/".join(f"{x:.0f}" for x in COMPARED_AT_M)
    return f"z at {at} m: {', '.join(cells)}; 0.9 or more: {confident} right, {share} of the right lanes"


def all_z(checks: Sequence[StillCheck]) -> np.ndarray:
    """(N, 2, 3) z of N stills."""
    return np.array([check.z for check in checks]).reshape(-1, 2, len(COMPARED_AT_M))


def _z_cells(checks: Sequence[StillCheck]) -> list[str]:
    """Summaries of z in words, for each distance."""
    return [describe_z(z_summary(some[np.isfinite(some)])) for some in np.moveaxis(all_z(checks), 2, 0)]


def _confidence_cells(checks: Sequence[StillCheck]) -> dict[str, str]:
    """How many lanes of each range of confidence are right, and how many of the right ones have 0.9 or more."""
    scored = [check for check in checks if check.right is not None]
    ranges = {
        f"{CONFIDENT:g} or more": (CONFIDENT, np.inf),
        f"{LIKELY_CONFIDENCE:g} to {CONFIDENT:g}": (LIKELY_CONFIDENCE, CONFIDENT),
        f"below {LIKELY_CONFIDENCE:g}": (-np.inf, LIKELY_CONFIDENCE),
    }
    cells = {}
    for name, (low, high) in ranges.items():
        rights = [check.right for check in scored if low <= check.confidence < high]
        cells[f"confidence {name}"] = f"{sum(map(bool, rights))} of {len(rights)}"
    right = [check.confidence >= CONFIDENT for check in scored if check.right]
    return cells | {f"right lanes with {CONFIDENT:g} or more": f"{sum(right)} of {len(right)}"}
