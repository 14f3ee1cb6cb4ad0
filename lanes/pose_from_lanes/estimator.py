"""Estimate the camera pose from pictures or files of a drive: height, pitch, yaw and roll from the lane lines.

Parallel lines on a flat road meet in a vanishing point on the horizon (`vanishing_point`). Its row gives the pitch. Its
column gives the yaw, because the heading of a car in its lane averages to zero over a drive. The lane width in metres,
divided by the lane width in camera heights, gives the height. Lanes of equal width that look narrower on one side give
the roll (`lane_width`). For one picture with too few lane lines the angles come from all its edges (`edges`), and the
height is the usual one. Of the poses near the estimate from one picture that with the most probable lane is taken
(`pose_search`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose
from lanes.io.footage import pick_pictures
from lanes.io.images import list_pictures
from lanes.pose_from_lanes.edges import find_edge_direction
from lanes.pose_from_lanes.lane_width import (
    PRIOR_HEIGHT_LOG_STD,
    PRIOR_HEIGHT_M,
    PRIOR_ROLL_STD_RAD,
    HeightAndRoll,
    estimate_height_and_roll,
    share_with_lane,
)
from lanes.pose_from_lanes.pose_estimate import PoseError, PoseEstimate
from lanes.pose_from_lanes.pose_search import HEIGHT_RANGE_M, search_pose
from lanes.pose_from_lanes.segments import Segments, drop_static, find_segments
from lanes.pose_from_lanes.vanishing_point import X0_BINS, Y0_BINS, RoadLines, fit_parallel_lines, hough_votes

# 12 ft, the lane of US Interstates (AASHTO, A Policy on Design Standards: Interstate System). Motorway lanes elsewhere
# are 3.50 to 3.75 m wide, hence the standard deviation.
LANE_WIDTH_M, LANE_WIDTH_STD_M = 3.66, 0.10
# Prior of the road direction in the picture: cameras are aimed ahead by eye, and cars drive along their lane.
PRIOR_DIRECTION_STD_RAD = np.radians(10.0)
# Standard deviation, in one picture, of the pitch motion of the car and of its heading in the lane.
PITCH_MOTION_STD_RAD, HEADING_STD_RAD = np.radians(0.3), np.radians(1.0)
# Acceptance limits, chosen on painted roads of known pose (tests/pose_from_lanes). At least: stripe rows in a
# picture, share of pictures with parallel lines, share of those with two lines a lane apart.
MIN_STRIPE_ROWS, MIN_LINES_SHARE, MIN_LANE_SHARE = 60, 0.25, 0.3
# At most: scatter of the road direction between pictures, and its median angle to the optical axis.
MAX_DIRECTION_SCATTER_DEG, MAX_DIRECTION_DEG = 10.0, 12.0
# With fewer pictures the heading of the car does not average to zero.
MIN_PICTURES_FOR_YAW = 5
EDGES_NOTE = (
    "one picture without two lane lines that show the pose: pitch and yaw are from the vanishing point of all its "
    "edges; height and roll are assumed"
)
# In a smaller picture a line is thinner than a pixel a few metres ahead.
MIN_SIDE_PX = 48
# Pictures are resized to this width; more pixels do not show more stripes.
WORKING_WIDTH_PX = 1280
# Pictures taken from the files of a drive; more did not improve the estimate.
POSE_PICTURES = 40
# Coarse search of the horizon: at most this number of pictures, and start rows as shares of the picture height. With
# all pictures of a small set the pose does not depend on their order.
COARSE_PICTURES, COARSE_HORIZONS = 20, np.array([0.3, 0.45, 0.6, 0.75])


def estimate_pose(
    images: Iterable[np.ndarray],
    camera: Camera,
    *,
    lane_width_m: float = LANE_WIDTH_M,
    height_m: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PoseEstimate:
    """Estimate height, pitch, yaw and roll of a camera from pictures of one drive.

    Only the intrinsics of `camera` are used; an existing pose is ignored.

    Parameters
    ----------
    images : iterable of ndarray of shape (height, width, 3), uint8
        RGB, raw, of the camera's size. All are kept in memory; 20 to 60, spread over the drive, are enough.
    lane_width_m : float
        Distance between the centres of the ego lane's lines; it determines the height.
    height_m : float, optional
        Measured height of the camera above the road. If given, the lane width is not used.
    progress : callable, optional
        Called with (pictures done, pictures in all).

    Raises
    ------
    PoseError
        If too few pictures show two parallel lines, the pictures disagree, or no lane of plausible width is visible,
        and if the edges of a single picture do not converge ahead either. If the given lane width or height is not
        plausible.
    PictureError
        If a picture is not of the camera's size.
    """
    _require_plausible(lane_width_m, height_m)
    images = iter(images)
    first = list(islice(images, 1))
    resized, resized_camera = _resize(chain(first, images), camera)
    if len(resized) > 1:
        return _pose_from_lines(resized, resized_camera, lane_width_m, height_m, progress)
    try:
        estimate = _pose_from_lines(resized, resized_camera, lane_width_m, height_m, progress)
    except PoseError as error:
        estimate = _pose_from_edges(resized[0], resized_camera, height_m, error)
    return search_pose(first[0], camera, estimate)


def _pose_from_lines(
    images: list[np.ndarray],
    camera: Camera,
    lane_width_m: float,
    height_m: float | None,
    progress: Callable[[int, int], None] | None,
) -> PoseEstimate:
    segments = _find_all_segments(images, camera, progress)
    horizon = _vote_horizon(segments)
    geometry = HeightAndRoll(PRIOR_HEIGHT_M, 0.0, 0.0, PRIOR_ROLL_STD_RAD)
    for _ in range(2):
        # Roll tilts the horizon. The second pass fits the lines again with the roll of the first pass removed.
        lines = _fit_pictures([s.without_roll(geometry.roll_rad) for s in segments], horizon)
        _require_lines(lines, len(images))
        geometry = estimate_height_and_roll(lines, lane_width_m, height_m or PRIOR_HEIGHT_M, geometry.roll_rad)
    _require_lanes(lines, lane_width_m / geometry.height_m)
    return _combine(lines, geometry, len(images), lane_width_m, height_m)


def _pose_from_edges(image: np.ndarray, camera: Camera, height_m: float | None, no_lines: PoseError) -> PoseEstimate:
    """The pose of one picture without parallel lane lines: angles from all its edges, height and roll assumed."""
    direction = find_edge_direction(image, camera)
    if direction is None:
        raise PoseError(f"{no_lines} No other edges converge ahead, so no road is recognised.") from no_lines
    return PoseEstimate(
        pose=CameraPose(height_m or PRIOR_HEIGHT_M, direction.pitch_rad, direction.yaw_rad, 0.0),
        height_std_m=0.0 if height_m else PRIOR_HEIGHT_LOG_STD * PRIOR_HEIGHT_M,
        pitch_std_rad=direction.pitch_std_rad,
        yaw_std_rad=direction.yaw_std_rad,
        roll_std_rad=PRIOR_ROLL_STD_RAD,
        frames_used=1,
        frames_total=1,
        lane_width_m=None,
        notes=(EDGES_NOTE,),
    )


def pose_from_pictures(
    camera: Camera, pictures: Iterable[np.ndarray], name: str, **options: Any
) -> tuple[Camera, PoseEstimate]:
    """The camera with the pose estimated from pictures, and the estimate; `options` are those of `estimate_pose`.

    The name of the drive precedes the message of a PoseError.
    """
    try:
        estimate = estimate_pose(pictures, camera, **options)
    except PoseError as error:
        raise PoseError(f"{name}: {error}") from error
    return camera.with_pose(estimate.pose), estimate


def pose_from_drive(
    camera: Camera,
    files: Sequence[Path],
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Camera, PoseEstimate | None]:
    """The camera with a pose: its own if it has one, otherwise the pose estimated from the files.

    `files` are stills and videos of one drive; of the videos the part from `start_s` to `end_s` is used. The second
    result is None if the camera already had a pose. `progress` and errors are those of `estimate_pose`.
    """
    if camera.pose is not None:
        return camera, None
    pictures = pick_pictures(list(files), POSE_PICTURES, require=camera.require_size, start_s=start_s, end_s=end_s)
    return pose_from_pictures(camera, pictures, str(files[0]), progress=progress)


def estimate_camera_pose(camera: Camera, folder: str | Path) -> Camera:
    """The camera with the pose estimated from a folder of pictures of one drive.

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    PictureError, PoseError
        If a picture cannot be read, or as in `estimate_pose`.
    """
    pictures = pick_pictures(list_pictures(folder), POSE_PICTURES, require=camera.require_size)
    return camera.with_pose(estimate_pose(pictures, camera).pose)


def _require_plausible(lane_width_m: float, height_m: float | None) -> None:
    if not 2.0 <= lane_width_m <= 6.0:
        raise PoseError(f"a lane {lane_width_m} m wide is not plausible; give 2 to 6 metres.")
    if height_m is not None and not HEIGHT_RANGE_M[0] <= height_m <= HEIGHT_RANGE_M[1]:
        raise PoseError(f"a camera {height_m} m above the road is not plausible; give 0.5 to 4.5 metres.")


def _resize(images: Iterable[np.ndarray], camera: Camera) -> tuple[list[np.ndarray], Camera]:
    """Pictures and camera at `WORKING_WIDTH_PX`; the pixel limits in `segments` are for this width."""
    if min(camera.size) < MIN_SIDE_PX:
        raise PoseError(
            f"pictures of {camera.width}x{camera.height} pixels are too small to show lines; give larger pictures."
        )
    resized_camera = camera.scaled((WORKING_WIDTH_PX, round(camera.height * WORKING_WIDTH_PX / camera.width)))
    size, interpolation = resized_camera.size, cv2.INTER_AREA if camera.width > WORKING_WIDTH_PX else cv2.INTER_LINEAR
    resized = []
    for number, image in enumerate(images, 1):
        camera.require_size(image, f"picture {number}")
        resized.append(image if camera.size == size else cv2.resize(image, size, interpolation=interpolation))
    if not resized:
        raise PoseError("no picture was given; name stills or a video of the drive.")
    return resized, resized_camera


def _find_all_segments(
    images: list[np.ndarray], camera: Camera, progress: Callable[[int, int], None] | None
) -> list[Segments]:
    """Stripe segments of each picture, below the horizon of a coarse search."""
    coarse_y0 = _coarse_horizon(images, camera)
    horizon_row = float(camera.matrix[1, 2] + camera.matrix[1, 1] * coarse_y0)
    segments = []
    for done, image in enumerate(images, 1):
        segments.append(find_segments(image, camera, horizon_row))
        if progress:
            progress(done, len(images))
    return drop_static([[of_picture] for of_picture in segments], camera)


def _coarse_horizon(images: list[np.ndarray], camera: Camera) -> float:
    """The y0 with most votes in a few pictures; each start row finds a part of the stripes."""
    few = images[:: -(-len(images) // COARSE_PICTURES)]
    rows = camera.height * COARSE_HORIZONS
    return _vote_horizon(drop_static([[find_segments(image, camera, row) for row in rows] for image in few], camera))


def _vote_horizon(segments: list[Segments]) -> float:
    """The y0 with most votes of all pictures; direction and curvature are free in each picture."""
    prior = np.exp(-0.5 * (X0_BINS / PRIOR_DIRECTION_STD_RAD) ** 2)
    votes = sum((hough_votes(s) * prior).max(axis=(1, 2)) for s in segments)
    return float(Y0_BINS[np.argmax(votes)])


def _fit_pictures(segments: list[Segments], horizon: float) -> list[RoadLines]:
    """Parallel lines of the pictures that show at least two and determine their horizon."""
    found = [fit_parallel_lines(s, horizon, 3 * PITCH_MOTION_STD_RAD) for s in segments]
    return [f for f in found if f is not None and f.y0_std < PITCH_MOTION_STD_RAD and f.rows.sum() >= MIN_STRIPE_ROWS]


def _require_lines(lines: list[RoadLines], total: int) -> None:
    if len(lines) < max(1, MIN_LINES_SHARE * total):
        raise PoseError(
            f"only {len(lines)} of {total} pictures show two or more parallel lane lines; "
            "give pictures of a marked road by day, with the lines of the ego lane in view."
        )
    directions_deg = np.degrees(np.arctan([line.x0 for line in lines]))
    median_deg, scatter_deg = np.median(directions_deg), _robust_std(directions_deg)
    if scatter_deg > MAX_DIRECTION_SCATTER_DEG or abs(median_deg) > MAX_DIRECTION_DEG:
        raise PoseError(
            f"the lines found in {len(lines)} pictures run {median_deg:.0f} degrees off the optical axis and scatter "
            f"by {scatter_deg:.0f} degrees: they are not lane lines, or the road is too winding; "
            "give pictures of a straighter stretch from a camera that looks ahead."
        )


def _require_lanes(lines: list[RoadLines], lane_width: float) -> None:
    share = share_with_lane(lines, lane_width)
    if share < MIN_LANE_SHARE:
        raise PoseError(
            f"only {share:.0%} of the {len(lines)} pictures with parallel lines show two that are a lane apart; "
            "give pictures that show both lines of the ego lane, or the lane width of this road."
        )


def _combine(
    lines: list[RoadLines], geometry: HeightAndRoll, total: int, lane_width_m: float, height_m: float | None
) -> PoseEstimate:
    """Combine the vanishing points of all pictures with height and roll."""
    pitches = -np.arctan([line.y0 for line in lines])
    # The vanishing point is the image of the direction ahead: x0 = tan(yaw) / cos(pitch), y0 = -tan(pitch).
    yaws = np.arctan([line.x0 for line in lines] * np.cos(pitches))
    pitch_rad, pitch_std_rad = _weighted_median(pitches, [line.y0_std for line in lines], PITCH_MOTION_STD_RAD)
    yaw_rad, yaw_std_rad = _weighted_median(yaws, [line.x0_std for line in lines], HEADING_STD_RAD)
    height_std_m = float(np.hypot(geometry.height_std_m, geometry.height_m * LANE_WIDTH_STD_M / lane_width_m))
    if height_m is not None:
        lane_width_m *= height_m / geometry.height_m
        height_std_m = 0.0
    return PoseEstimate(
        pose=CameraPose(height_m or geometry.height_m, pitch_rad, yaw_rad, geometry.roll_rad),
        height_std_m=height_std_m,
        pitch_std_rad=pitch_std_rad,
        yaw_std_rad=yaw_std_rad,
        roll_std_rad=geometry.roll_std_rad,
        frames_used=len(lines),
        frames_total=total,
        lane_width_m=lane_width_m,
        notes=_notes(lines, geometry),
    )


def _notes(lines: list[RoadLines], geometry: HeightAndRoll) -> tuple[str, ...]:
    notes = []
    if geometry.roll_std_rad >= PRIOR_ROLL_STD_RAD:
        notes.append("no lane next to the ego lane is visible well enough to determine the roll; it is set to 0")
    if len(lines) < MIN_PICTURES_FOR_YAW:
        notes.append("the yaw contains the car's heading in its lane, which averages to zero only over many pictures")
    return tuple(notes)


def _weighted_median(values: np.ndarray, stds: list[float], motion_std: float) -> tuple[float, float]:
    """Weighted median over the pictures, and its standard deviation; `motion_std` is the prior scatter of a picture."""
    weight = 1 / (np.square(stds) + motion_std**2)
    order = np.argsort(values)
    quantile = (np.cumsum(weight[order]) - 0.5 * weight[order]) / weight.sum()
    # The scatter of few values is uncertain, so the prior counts like two more values.
    variance = (len(values) * _robust_std(values) ** 2 + 2 * motion_std**2) / (len(values) + 2)
    # The median of n normal values has the variance pi / 2n.
    return float(np.interp(0.5, quantile, values[order])), float(np.sqrt(np.pi / 2 * variance / len(values)))


def _robust_std(values: np.ndarray) -> float:
    """Standard deviation from the median absolute deviation, which is robust against outliers."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))
