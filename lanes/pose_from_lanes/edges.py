"""Vanishing point of all straight edges of one picture, for pictures with too few lane lines.

Kerbs, parked cars, barriers and rows of houses run along the road, too. Their edges converge with those of the markings
in the vanishing point of the road. Each edge votes for the camera angles at which it points at that point.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.pose_from_lanes.lane_width import mode_and_std

# Prior of pitch and yaw: cameras are aimed ahead by hand. The yaw contains the heading of the car.
PRIOR_PITCH_STD_RAD, PRIOR_YAW_STD_RAD = np.radians(6.0), np.radians(10.0)
# Angles that are tried.
PITCH_GRID_RAD, YAW_GRID_RAD = np.radians(np.arange(-10, 10.01, 0.25)), np.radians(np.arange(-15, 15.01, 0.5))
# Shorter edges have no reliable direction. Flatter or steeper ones belong to cross beams and poles.
MIN_EDGE_PX, EDGE_SLOPE_RANGE_RAD = 20, np.radians([8.0, 75.0])
# Standard deviations of an edge's direction, because roads are not quite straight, and of the position of its ends, in
# ray coordinates: 1.5 px at a focal length of 1000 px.
DIRECTION_STD_RAD, END_STD = np.radians(1.0), 0.0015
# Weight of an edge: its length, in this unit and up to a largest weight, in ray coordinates.
WEIGHT_LENGTH, MAX_WEIGHT = 0.05, 4.0
# Votes that make a direction e times as probable: chosen so that errors and standard deviations agree on real drives.
VOTES_PER_E = 2.0
# A road is recognised if the votes for its direction, times the prior, are at least this share of all votes, and this
# many times the square root of all votes. Roads have 0.15 to 0.7 and 1.3 to 7, other pictures both in few cases.
MIN_SHARE, MIN_ROOT = 0.15, 1.3
# The prior alone has a standard deviation of 4.8 degrees on the grid.
MAX_PITCH_STD_RAD = np.radians(4.5)


@dataclass(frozen=True)
class EdgeDirection:
    """Camera pitch and yaw from the edges of one picture, with standard deviations."""

    pitch_rad: float
    pitch_std_rad: float
    yaw_rad: float
    yaw_std_rad: float


def find_edge_direction(image: np.ndarray, camera: Camera) -> EdgeDirection | None:
    """Pitch and yaw of a camera from one RGB picture (height, width, 3), uint8; None if its edges do not converge."""
    middle, along = _find_edges(image, camera)
    weight = np.minimum(np.hypot(*along.T) / WEIGHT_LENGTH, MAX_WEIGHT)
    votes = _vote(middle, along, weight)
    pitch_penalty = 0.5 * (PITCH_GRID_RAD / PRIOR_PITCH_STD_RAD)[:, None] ** 2
    log_prior = -pitch_penalty - 0.5 * (YAW_GRID_RAD / PRIOR_YAW_STD_RAD) ** 2
    log_posterior = votes / VOTES_PER_E + log_prior
    best = np.unravel_index(log_posterior.argmax(), votes.shape)
    posterior = np.exp(log_posterior - log_posterior[best])
    pitch_rad, pitch_std_rad = mode_and_std(PITCH_GRID_RAD, posterior.sum(axis=1))
    yaw_rad, yaw_std_rad = mode_and_std(YAW_GRID_RAD, posterior.sum(axis=0))
    agreeing, total = votes[best] * np.exp(log_prior[best]), weight.sum()
    if agreeing < max(MIN_SHARE * total, MIN_ROOT * np.sqrt(total)) or pitch_std_rad > MAX_PITCH_STD_RAD:
        return None
    return EdgeDirection(pitch_rad, pitch_std_rad, yaw_rad, yaw_std_rad)


def _find_edges(image: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N, 2) and vectors from end to end (N, 2) of the slanting edges, in ray coordinates."""
    found = cv2.createLineSegmentDetector().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))[0]
    ends = np.empty((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(float)
    across, down = np.abs(ends[:, 1] - ends[:, 0]).T
    slope = np.arctan2(down, across)
    least, most = EDGE_SLOPE_RANGE_RAD
    ends = ends[(np.hypot(across, down) > MIN_EDGE_PX) & (slope > least) & (slope < most)]
    ends = camera.rays(ends.reshape(-1, 2))[:, :2].reshape(-1, 2, 2)
    return ends.mean(axis=1), ends[:, 1] - ends[:, 0]


def _vote(middle: np.ndarray, along: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Sum of the weights of the edges that point at the vanishing point of each pitch and yaw: (pitches, yaws)."""
    length = np.hypot(*along.T)
    to_x = np.tan(YAW_GRID_RAD)[:, None] / np.cos(PITCH_GRID_RAD)[:, None, None] - middle[:, 0]
    to_y = -np.tan(PITCH_GRID_RAD)[:, None, None] - middle[:, 1]
    distance = np.hypot(to_x, to_y)
    angle = np.abs(to_x * along[:, 1] - to_y * along[:, 0]) / length / np.maximum(distance, WEIGHT_LENGTH)
    std = np.hypot(DIRECTION_STD_RAD, END_STD / length)
    # An edge that contains the point does not lead there.
    return (weight * np.exp(-0.5 * (angle / std) ** 2) * (distance > length / 2)).sum(axis=-1)
