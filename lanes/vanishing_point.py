"""Vanishing point of a road in raw images, before the camera pose is known.

Lane lines, kerbs, barriers, parked cars and rows of houses run along the road, and their images converge in one point.
Its row gives the pitch of the camera, its column the yaw. All edges of all images vote for it. It is accurate to a
degree, which is enough to look for the lane.
"""

from __future__ import annotations

import cv2
import numpy as np

from lanes.camera import Camera

# Prior of pitch and yaw: cameras are aimed ahead by hand. The yaw contains the heading of the car.
_PRIOR_PITCH_STD_RAD, _PRIOR_YAW_STD_RAD = np.radians(6.0), np.radians(10.0)
# Angles that are tried. The prior alone has a standard deviation of 4.8 degrees on this grid of pitches.
_PITCH_GRID_RAD, _YAW_GRID_RAD = np.radians(np.arange(-10, 10.01, 0.25)), np.radians(np.arange(-15, 15.01, 0.5))
# Standard deviations of an edge's direction, because roads are not quite straight, and of the position of its ends, in
# ray coordinates: 1.5 px at a focal length of 1000 px.
_DIRECTION_STD_RAD, _END_STD = np.radians(1.0), 0.0015
# An edge has a vote for each of these lengths, in ray coordinates, up to four.
_VOTE_LENGTH = 0.05


# Pitch and yaw of a camera, radians, each with its standard deviation; of a camera of which nothing is known.
Direction = tuple[tuple[float, float], tuple[float, float]]
AHEAD: Direction = ((0.0, float(_PRIOR_PITCH_STD_RAD)), (0.0, float(_PRIOR_YAW_STD_RAD)))


def find_edge_direction(images: list[np.ndarray], camera: Camera) -> Direction:
    """Pitch and yaw of a camera, each with its standard deviation, radians, from all edges of its RGB images.

    The images are (height, width, 3), uint8. Where no edges converge, the result is the prior: a camera that looks
    ahead.
    """
    votes = np.zeros((len(_PITCH_GRID_RAD), len(_YAW_GRID_RAD)))
    for image in images:
        middle, along = _find_edges(image, camera)
        votes += _vote(middle, along, np.minimum(np.hypot(*along.T) / _VOTE_LENGTH, 4.0))
    pitch_penalty = 0.5 * (_PITCH_GRID_RAD / _PRIOR_PITCH_STD_RAD)[:, None] ** 2
    log_prior = -pitch_penalty - 0.5 * (_YAW_GRID_RAD / _PRIOR_YAW_STD_RAD) ** 2
    # two votes for each factor e: chosen so that errors and standard deviations agree on real drives
    log_posterior = votes / 2.0 + log_prior
    posterior = np.exp(log_posterior - log_posterior.max())
    return _mode_and_std(_PITCH_GRID_RAD, posterior.sum(axis=1)), _mode_and_std(_YAW_GRID_RAD, posterior.sum(axis=0))


def _find_edges(image: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N, 2) and vectors from end to end (N, 2) of the slanting edges, in ray coordinates.

    Edges shorter than 20 px have no reliable direction. Flatter or steeper ones belong to cross beams and poles.
    """
    found = cv2.createLineSegmentDetector().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))[0]
    ends = np.empty((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(float)
    across, down = np.abs(ends[:, 1] - ends[:, 0]).T
    slope_deg = np.degrees(np.arctan2(down, across))
    ends = ends[(np.hypot(across, down) > 20) & (slope_deg > 8) & (slope_deg < 75)]
    ends = camera.rays(ends.reshape(-1, 2))[:, :2].reshape(-1, 2, 2)
    return ends.mean(axis=1), ends[:, 1] - ends[:, 0]


def _vote(middle: np.ndarray, along: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Sum of the weights of the edges that point at the vanishing point of each pitch and yaw: (pitches, yaws)."""
    length = np.hypot(*along.T)
    to_x = np.tan(_YAW_GRID_RAD)[:, None] / np.cos(_PITCH_GRID_RAD)[:, None, None] - middle[:, 0]
    to_y = -np.tan(_PITCH_GRID_RAD)[:, None, None] - middle[:, 1]
    distance = np.hypot(to_x, to_y)
    angle = np.abs(to_x * along[:, 1] - to_y * along[:, 0]) / length / np.maximum(distance, _VOTE_LENGTH)
    std = np.hypot(_DIRECTION_STD_RAD, _END_STD / length)
    # An edge that contains the point does not lead there.
    return (weight * np.exp(-0.5 * (angle / std) ** 2) * (distance > length / 2)).sum(axis=-1)


def _mode_and_std(values: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """Maximum of a density given on a grid, and the standard deviation about it."""
    mode = float(values[np.argmax(density)])
    return mode, float(np.sqrt(np.average((values - mode) ** 2, weights=density)))
