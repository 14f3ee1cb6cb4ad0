"""Camera pose of a single picture: of the poses near the estimate, that with the most probable lane.

A single picture determines the height of the camera roughly, or not at all. With a wrong height two lines that are not
a lane apart are taken for the ego lane, or its own lines are too far apart. Several poses are therefore tried. If they
show the same lane, the pose does not matter; if they show different ones, the lane is doubtful.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lanes.camera import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import log_odds
from lanes.detect.search import find_lane
from lanes.errors import CameraError

if TYPE_CHECKING:
    from lanes.pose import PoseEstimate

# Heights of cameras in cars, vans and lorries.
HEIGHT_RANGE_M = 0.5, 4.5


@dataclass(frozen=True)
class PoseSearch:
    """Poses that are tried, and when two of them show the same lane; tuned on rendered photos (docs/ablation.md)."""

    # Steps of the logarithm of the height, in standard deviations of the estimate, and of the pitch, degrees.
    steps: tuple[tuple[float, float], ...] = (
        *((0.0, 0.0), (-1.2, 0.0), (1.2, 0.0)),
        *((-0.6, -0.3), (-0.6, 0.3), (0.6, -0.3), (0.6, 0.3)),
    )
    # Standard deviation of the pitch of the road relative to the estimate, degrees.
    pitch_std_deg: float = 0.5
    # Two lanes are the same if both lines are within this share of the picture's width in this share of the rows.
    same_within: float = 0.02
    same_rows: float = 0.8
    # Picture rows that are compared: from that of the road this far ahead down to this share of the height.
    rows: int = 25
    far_m: float = 60.0
    lowest: float = 0.98
    min_common_rows: int = 4


SEARCH = PoseSearch()


@dataclass(frozen=True, eq=False)
class TriedPose:
    """A camera pose, the logarithm of its probability with the lane that it shows, and that lane in the picture."""

    pose: CameraPose
    log_posterior: float
    # Columns (2, rows) of the left and the right line, in shares of the picture's width; negative where not seen.
    columns: np.ndarray


def search_pose(image: np.ndarray, camera: Camera, estimate: PoseEstimate) -> PoseEstimate:
    """The estimate with the pose, among those near it, that shows the most probable lane, and `same_lane_share`.

    A pose has the probability of its distance from the estimate, times the odds of the lane that it shows. The lane
    with the largest sum over all poses that show it is taken, and of these poses the most probable one.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, raw, of the camera's size.
    estimate : PoseEstimate
        From this picture. It is returned with a `same_lane_share` of 0 if no pose shows a lane.
    """
    tried = list(_try_poses(image, camera, estimate))
    if not tried:
        return replace(estimate, pose=replace(estimate.pose, same_lane_share=0.0))
    same = _same_lane(np.array([t.columns for t in tried]))
    log_posterior = np.array([t.log_posterior for t in tried])
    of_lane = np.flatnonzero(same[(same @ np.exp(log_posterior - log_posterior.max())).argmax()])
    best = of_lane[log_posterior[of_lane].argmax()]
    pose = replace(tried[best].pose, same_lane_share=float(same[best].sum() / len(SEARCH.steps)))
    return replace(estimate, pose=pose, height_std_m=estimate.height_std_m * pose.height_m / estimate.pose.height_m)


def _try_poses(image: np.ndarray, camera: Camera, estimate: PoseEstimate) -> Iterator[TriedPose]:
    """The poses of `SEARCH.steps` that show a lane."""
    height_log_std = estimate.height_std_m / estimate.pose.height_m
    top = camera.with_pose(estimate.pose).road_to_pixels(np.array([[SEARCH.far_m, 0.0]]))[0, 1]
    rows = np.linspace(top, SEARCH.lowest * camera.height, SEARCH.rows)
    for height_step, pitch_step_deg in SEARCH.steps:
        height_m = np.clip(estimate.pose.height_m * np.exp(height_step * height_log_std), *HEIGHT_RANGE_M)
        pitch_rad = estimate.pose.pitch_rad + np.radians(pitch_step_deg)
        pose = replace(estimate.pose, height_m=float(height_m), pitch_rad=float(pitch_rad), same_lane_share=1.0)
        tried = camera.with_pose(pose)
        try:
            lane = find_lane(image, BirdsEyeView(tried))
        except CameraError:  # this pose sees no road
            continue
        if lane is not None:
            log_prior = -0.5 * (height_step**2 + (pitch_step_deg / SEARCH.pitch_std_deg) ** 2)
            yield TriedPose(pose, log_prior + log_odds(lane), lane.pixels(tried, rows) / camera.width)


def _same_lane(columns: np.ndarray) -> np.ndarray:
    """(N, N) bool: which of the lanes with these `columns` (N, 2, rows) are the same in the picture; symmetric.

    Every lane is the same as itself, also if it is seen in few rows.
    """
    first, second = columns[:, None], columns[None]
    common = (first >= 0) & (second >= 0)
    near = common & (np.abs(first - second) < SEARCH.same_within)
    count = common.sum(axis=-1)
    enough = near.sum(axis=-1) >= SEARCH.same_rows * count
    return (enough & (count >= SEARCH.min_common_rows)).all(axis=-1) | np.eye(len(columns), dtype=bool)
