"""The score of a lane of the engine for a label, with its errors in standard
deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from lanes.camera.model import Camera
from lanes.detect.lane import Lane
from lanes.detect.road import lines_on_view, parameter_gradients, propagated_std
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.score import StillScore, lateral_errors_m, score_still

# Distances at which lines are compared.
COMPARED_AT_M = np.array([8.0, 15.0, 25.0])
# Standard deviation of a labelled column: 95 % of the differences between two labellers
# are below 3.2 px.
LABEL_STD_PX = 1.6
# With a larger error another line was found.
OTHER_LINE_M = 1.0
NOT_COMPARED = np.full((2, len(COMPARED_AT_M)), np.nan)


@dataclass(frozen=True, eq=False)
class ScoredLane:
    """The score of what a system found for a label, and the lane with its errors if it
    is the engine.

    `lane` is None without one. `z` (2, 3) are errors of both lines at COMPARED_AT_M, in
    standard deviations of the position at a picture row (`row_std_m`), NaN where
    nothing is compared. `other_lines` is the number of errors above OTHER_LINE_M, which
    are left out.
    """

    score: StillScore
    lane: Lane | None = None
    z: np.ndarray = field(default_factory=NOT_COMPARED.copy)
    other_lines: int = 0


def score_lane(lane: Lane | None, label: LaneColumns, camera: Camera) -> ScoredLane:
    """The score of a lane that is detected in a single picture by `camera`, whose pose
    it has.
    """
    if lane is None:
        return ScoredLane(score_still(label, None, camera.size))
    columns = lane.columns(camera, label.rows)
    found = LaneColumns(label.name, label.rows, columns, EGO_SIDES, lane.confidence)
    score = score_still(label, found, camera.size)

    true = label.ego_lane(camera.size)
    error_m = lateral_errors_m(true, found, camera, COMPARED_AT_M)
    other = np.abs(error_m) > OTHER_LINE_M
    label_std_m = LABEL_STD_PX * COMPARED_AT_M / camera.matrix[0, 0]
    lane_std_m = row_std_m(lane, COMPARED_AT_M, camera.require_pose().height_m)
    z = error_m / np.hypot(lane_std_m, label_std_m)
    return ScoredLane(score, lane, np.where(other, np.nan, z), int(other.sum()))


def row_std_m(lane: Lane, x_m: np.ndarray, height_m: float) -> np.ndarray:
    """Standard deviation (2, N) of the lines' lateral positions at the picture rows of
    distances x (N,) on a flat road.

    Pitch and width of a lane are correlated: both decide where the lines are in the
    picture. Errors of the pitch, which displace the lines on the road, hardly displace
    them in the picture that they are fitted to.
    """
    on_view = partial(lines_on_view, x_m=x_m, height_m=height_m)
    gradients = parameter_gradients(on_view, lane.model)
    return propagated_std(gradients, lane.covariance)


def all_z(scored: Sequence[ScoredLane]) -> np.ndarray:
    """(N, 2, 3) z of N stills."""
    return np.array([one.z for one in scored]).reshape(-1, *(2, len(COMPARED_AT_M)))
