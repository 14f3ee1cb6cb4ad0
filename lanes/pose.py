"""Estimate the camera pose from images of a drive: height, pitch, yaw and roll from the lane lines.

Parallel lines on a flat road meet in a vanishing point on the horizon (`lanes.vanishing_point`). Its row gives the
pitch. Its column gives the yaw, because the heading of a car in its lane averages to zero over a drive. The lane width
in metres, divided by the lane width in camera heights, gives the height. Lanes of equal width that look narrower on one
side give the roll. If too few images show two lines that are a lane apart, the angles come from all their edges, and
the height is the usual one: no drive is refused, and the confidence of its lanes says the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lanes.camera import Camera, CameraPose
from lanes.describe import html_table
from lanes.errors import PoseError
from lanes.sources import find_sources, sample_images
from lanes.stills import HEIGHT_RANGE_M, StillDetection, detect_with_own_pose
from lanes.vanishing_point import (
    X0_BINS,
    Y0_BINS,
    RoadLines,
    Segments,
    drop_static,
    find_edge_direction,
    find_segments,
    fit_parallel_lines,
    hough_votes,
    mode_and_std,
    std_about,
)

# 12 ft, the lane of US Interstates (AASHTO, A Policy on Design Standards: Interstate System). Motorway lanes elsewhere
# are 3.50 to 3.75 m wide, hence the standard deviation.
LANE_WIDTH_M, LANE_WIDTH_STD_M = 3.66, 0.10
# Prior of the camera height, log-normal: 1.1 to 1.6 m in passenger cars, up to 2.5 m in vans and lorries.
PRIOR_HEIGHT_M, PRIOR_HEIGHT_LOG_STD = 1.35, 0.25
# Prior of the roll: cameras are installed level by eye, within about a degree.
PRIOR_ROLL_STD_RAD = np.radians(1.0)
# Prior of the road direction in the image: cameras are aimed ahead by eye, and cars drive along their lane.
PRIOR_DIRECTION_STD_RAD = np.radians(10.0)
# Standard deviation, in one image, of the pitch motion of the car and of its heading in the lane.
PITCH_MOTION_STD_RAD, HEADING_STD_RAD = np.radians(0.3), np.radians(1.0)
# Acceptance limits, chosen on painted roads of known pose (tests/test_pose.py). At least: stripe rows in an image,
# share of images with parallel lines, share of those with two lines a lane apart.
MIN_STRIPE_ROWS, MIN_LINES_SHARE, MIN_LANE_SHARE = 60, 0.25, 0.3
# At most: scatter of the road direction between images, and its median angle to the optical axis.
MAX_DIRECTION_SCATTER_DEG, MAX_DIRECTION_DEG = 10.0, 12.0
# Images of a drive without a pose from lane lines that are searched with several heights, in half a second each.
LANES_FOR_HEIGHT = 6
# Images are resized to this width: the pixel limits of `lanes.vanishing_point` are for it, and more pixels do not show
# more stripes.
WORKING_WIDTH_PX = 1280

# Images taken from the files of a drive; more did not improve the estimate.
POSE_PICTURES = 40

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The camera with the estimated pose, and the standard deviations of the pose.

    `height_std_m` includes the uncertainty of the assumed lane width. `frames_used` are the images with at least two
    parallel lines. `lane_width_m` determines the height, or follows from a given height; it is None if the height does
    not come from lane lines. `notes` name what the images do not determine. If the pose was estimated from a single
    image, `still` is what was found in it, and the pose is that of its lane.
    """

    camera: Camera
    height_std_m: float
    pitch_std_rad: float
    yaw_std_rad: float
    roll_std_rad: float
    frames_used: int
    frames_total: int
    lane_width_m: float | None
    notes: tuple[str, ...] = ()
    still: StillDetection | None = None

    @property
    def pose(self) -> CameraPose:
        """The estimated pose."""
        return self.camera.require_pose()

    def summary(self) -> dict[str, str]:
        """Each number with its standard deviation and its sign in words, by name."""
        pose, source = self.pose, "assumed" if self.height_std_m else "given"
        if self.lane_width_m is not None:
            source = f"lane {self.lane_width_m:.2f} m wide"
        return {
            "height": f"{pose.height_m:.2f} ± {self.height_std_m:.2f} m ({source})",
            "pitch": _describe_angle(pose.pitch_rad, self.pitch_std_rad, "looks down", "looks up"),
            "yaw": _describe_angle(pose.yaw_rad, self.yaw_std_rad, "looks left", "looks right"),
            "roll": _describe_angle(pose.roll_rad, self.roll_std_rad, "right side down", "left side down"),
            "pictures": f"{self.frames_used} of {self.frames_total} used",
        }

    def describe(self) -> str:
        """Several lines of text: the summary and the notes."""
        lines = [f"{name:<8} {text}" for name, text in self.summary().items()]
        return "\n".join(lines + [f"note: {note}" for note in self.notes])

    def summary_line(self) -> str:
        """One line with the numbers, and with what they were estimated from."""
        numbers = ", ".join(f"{name} {text}" for name, text in self.summary().items() if name != "pictures")
        return f"pose from {'all edges' if self.lane_width_m is None else 'lane lines'}: {numbers}"

    def describe_accuracy(self) -> str:
        """One sentence with the expected accuracy of offset, lane width, distances and curvature.

        The centimetres are the 95th percentile of the offset error on the rendered drive: with its calibrated lens, and
        without distortion at focal lengths from 0.7 to 1.5 times the true one (docs/own_camera.md).
        """
        height_share = self.height_std_m / self.pose.height_m
        why = "the height is assumed" if self.lane_width_m is None else "lanes may be wider or narrower"
        width = f" and {height_share:.0%} ({why})" if height_share else ""
        if self.camera.distortion.any():
            return f"expect offset and lane width to be good to 1 cm{width}, distances and curvature likewise"
        return (
            f"expect offset and lane width to be good to 3 cm{width}; distances ahead to be off as much as the focal "
            "length, which was not calibrated, and curvature twice as much"
        )

    def __repr__(self) -> str:
        return f"PoseEstimate({', '.join(f'{name} {text}' for name, text in self.summary().items())})"

    def _repr_html_(self) -> str:
        notes = {f"note {number}": note for number, note in enumerate(self.notes, 1)}
        return html_table("Camera pose", self.summary() | notes)


def _describe_angle(angle_rad: float, std_rad: float, positive: str, negative: str) -> str:
    degrees = round(float(np.degrees(angle_rad)), 2) + 0.0  # not -0.00
    direction = f" ({positive if degrees > 0 else negative})" if degrees else ""
    return f"{degrees:.2f} ± {np.degrees(std_rad):.2f} deg{direction}"


def estimate_pose(
    source: str | Path | np.ndarray | Iterable[str | Path | np.ndarray],
    camera: Camera,
    *,
    lane_width_m: float = LANE_WIDTH_M,
    height_m: float | None = None,
    max_pictures: int = POSE_PICTURES,
    start_s: float = 0.0,
    end_s: float | None = None,
    progress: Progress | None = None,
) -> PoseEstimate:
    """Height, pitch, yaw and roll of a camera, estimated from images of one drive.

    >>> camera = lanes.estimate_pose("drive.mp4", camera).camera  # doctest: +SKIP

    Only the intrinsics of `camera` are used; an existing pose is ignored. In a single image the lane is looked for with
    several poses; the estimate is that of the most probable lane, and `PoseEstimate.still` holds the lane.

    Parameters
    ----------
    source : path, array, or iterable of paths or of arrays
        A video, a picture, a folder of them, or a pattern such as ``drive/*.jpg``; or images (height, width, 3), uint8,
        RGB, raw, of the camera's size. All images are kept in memory; 20 to 60, spread over the drive, are enough.
    lane_width_m : float
        Distance between the centres of the ego lane's lines; it determines the height.
    height_m : float, optional
        Measured height of the camera above the road. If given, the lane width is not used.
    max_pictures : int
        Number of images taken from files, evenly spaced.
    start_s, end_s : float
        Part of each video, seconds since its first frame.
    progress : callable, optional
        Called with (images done, images in all).

    Raises
    ------
    PoseError
        If there are no images, or too small ones. If the given lane width or height is not plausible.
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read, or an image is not of the camera's size.
    CameraError
        If the pose estimated from a single image sees no road.
    """
    if not 2.0 <= lane_width_m <= 6.0:
        raise PoseError(f"a lane {lane_width_m} m wide is not plausible; give 2 to 6 metres.")
    if height_m is not None and not HEIGHT_RANGE_M[0] <= height_m <= HEIGHT_RANGE_M[1]:
        raise PoseError(f"a camera {height_m} m above the road is not plausible; give 0.5 to 4.5 metres.")
    files, images = _list_images(source)
    if files:
        images = sample_images(files, max_pictures, require=camera.require_size, start_s=start_s, end_s=end_s)
    first = list(islice(images, 1))
    try:
        resized, resized_camera = _resize(chain(first, images), camera)
    except PoseError as error:
        raise PoseError(f"{files[0]}: {error}" if files else str(error)) from error
    try:
        estimate = _pose_from_lines(resized, resized_camera, lane_width_m, height_m, progress)
    except PoseError as error:
        estimate = _pose_from_edges(resized, resized_camera, height_m, error)
    if estimate.frames_total > 1:
        return replace(estimate, camera=camera.with_pose(estimate.pose))
    height_log_std = estimate.height_std_m / estimate.pose.height_m
    still = detect_with_own_pose(first[0], camera.with_pose(estimate.pose), height_log_std)
    height_std_m = height_log_std * still.camera.require_pose().height_m
    return replace(estimate, camera=still.camera, height_std_m=height_std_m, still=still)


def ensure_pose(camera: Camera, source: Any, **options: Any) -> tuple[Camera, PoseEstimate | None]:
    """The camera with a pose: its own, or that of `estimate_pose`; the estimate is None if the camera had a pose."""
    if camera.pose is not None:
        return camera, None
    estimate = estimate_pose(source, camera, **options)
    return estimate.camera, estimate


def _list_images(source: Any) -> tuple[list[Path], Iterator[np.ndarray]]:
    """The files of a source of `estimate_pose`, or its images."""
    if isinstance(source, str | Path | np.ndarray):
        source = [source]
    items = iter(source)
    first = list(islice(items, 1))
    if not first or isinstance(first[0], np.ndarray):
        return [], chain(first, items)
    sources = find_sources(map(str, chain(first, items)))
    return [*sources.stills, *sources.videos], iter(())


def _resize(images: Iterable[np.ndarray], camera: Camera) -> tuple[list[np.ndarray], Camera]:
    """Images and camera at `WORKING_WIDTH_PX`."""
    # in a smaller image a line is thinner than a pixel a few metres ahead
    if min(camera.size) < 48:
        raise PoseError(
            f"pictures of {camera.width}x{camera.height} pixels are too small to show lines; give larger pictures."
        )
    resized_camera = camera.scaled((WORKING_WIDTH_PX, round(camera.height * WORKING_WIDTH_PX / camera.width)))
    size, interpolation = resized_camera.size, cv2.INTER_AREA if camera.width > WORKING_WIDTH_PX else cv2.INTER_LINEAR
    resized = []
    for number, image in enumerate(images, 1):
        image = camera.require_size(image, f"picture {number}")
        resized.append(image if camera.size == size else cv2.resize(image, size, interpolation=interpolation))
    if not resized:
        raise PoseError("no picture was given; name stills or a video of the drive.")
    return resized, resized_camera


def _pose_from_edges(
    images: list[np.ndarray], camera: Camera, height_m: float | None, no_lines: PoseError
) -> PoseEstimate:
    """The pose of images without parallel lane lines: angles from all their edges, height and roll assumed."""
    pitch, yaw = find_edge_direction(images, camera, MAX_INDEPENDENT_IMAGES)
    estimate = PoseEstimate(
        camera=camera.with_pose(CameraPose(height_m or PRIOR_HEIGHT_M, pitch[0], yaw[0])),
        height_std_m=0.0 if height_m else PRIOR_HEIGHT_LOG_STD * PRIOR_HEIGHT_M,
        pitch_std_rad=pitch[1],
        yaw_std_rad=yaw[1],
        roll_std_rad=PRIOR_ROLL_STD_RAD,
        frames_used=len(images),
        frames_total=len(images),
        lane_width_m=None,
        notes=(f"{no_lines} Pitch and yaw are from the vanishing point of all edges; height and roll are assumed.",),
    )
    return estimate if height_m or len(images) == 1 else _with_height_of_lanes(estimate, images)


def _with_height_of_lanes(estimate: PoseEstimate, images: list[np.ndarray]) -> PoseEstimate:
    """The estimate with the height that shows the surest lane in one of some images, each looked at alone."""
    log_std = estimate.height_std_m / estimate.pose.height_m
    some = images[:: -(-len(images) // LANES_FOR_HEIGHT)]
    found = [detect_with_own_pose(image, estimate.camera, log_std) for image in some]
    best = max(found, key=attrgetter("confidence"))
    height_m = best.camera.require_pose().height_m
    pose = replace(estimate.pose, height_m=height_m)
    return replace(estimate, camera=estimate.camera.with_pose(pose), height_std_m=log_std * height_m)


def _pose_from_lines(
    images: list[np.ndarray], camera: Camera, lane_width_m: float, height_m: float | None, progress: Progress | None
) -> PoseEstimate:
    """The pose of images with parallel lane lines: the vanishing points of all of them, height and roll combined."""
    segments = _find_all_segments(images, camera, progress)
    horizon = _vote_horizon(segments)
    roll_rad = 0.0
    for _ in range(2):
        # Roll tilts the horizon. The second pass fits the lines again with the roll of the first pass removed.
        fits = (fit_parallel_lines(s.without_roll(roll_rad), horizon, 3 * PITCH_MOTION_STD_RAD) for s in segments)
        lines = [f for f in fits if f and f.y0_std < PITCH_MOTION_STD_RAD and f.rows.sum() >= MIN_STRIPE_ROWS]
        _require_lines(lines, len(images))
        (lanes_height_m, height_std_m), (roll_rad, roll_std_rad) = estimate_height_and_roll(
            lines, lane_width_m, height_m or PRIOR_HEIGHT_M, roll_rad
        )
    _require_lanes(lines, lane_width_m / lanes_height_m)
    pitches = -np.arctan([line.y0 for line in lines])
    # The vanishing point is the image of the direction ahead: x0 = tan(yaw) / cos(pitch), y0 = -tan(pitch).
    yaws = np.arctan([line.x0 for line in lines] * np.cos(pitches))
    pitch_rad, pitch_std_rad = _median(pitches, PITCH_MOTION_STD_RAD)
    yaw_rad, yaw_std_rad = _median(yaws, HEADING_STD_RAD)
    height_std_m = float(np.hypot(height_std_m, lanes_height_m * LANE_WIDTH_STD_M / lane_width_m))
    notes = []
    if roll_std_rad >= PRIOR_ROLL_STD_RAD:
        notes.append("no lane next to the ego lane is visible well enough to determine the roll; it is set to 0")
    if len(lines) < 5:
        notes.append("the yaw contains the car's heading in its lane, which averages to zero only over many pictures")
    return PoseEstimate(
        camera=camera.with_pose(CameraPose(height_m or lanes_height_m, pitch_rad, yaw_rad, roll_rad)),
        height_std_m=0.0 if height_m else height_std_m,
        pitch_std_rad=pitch_std_rad,
        yaw_std_rad=yaw_std_rad,
        roll_std_rad=roll_std_rad,
        frames_used=len(lines),
        frames_total=len(images),
        lane_width_m=lane_width_m * (height_m / lanes_height_m if height_m else 1),
        notes=tuple(notes),
    )


def _find_all_segments(images: list[np.ndarray], camera: Camera, progress: Progress | None) -> list[Segments]:
    """Stripe segments of each image, below the horizon of a coarse search in up to 20 images.

    Each of the four start rows of that search finds a part of the stripes.
    """
    few, rows = images[:: -(-len(images) // 20)], [share * camera.height for share in (0.3, 0.45, 0.6, 0.75)]
    coarse = drop_static([[find_segments(image, camera, row) for row in rows] for image in few], camera)
    coarse_y0 = _vote_horizon(coarse)
    horizon_row = float(camera.matrix[1, 2] + camera.matrix[1, 1] * coarse_y0)
    segments = []
    for done, image in enumerate(images, 1):
        segments.append(find_segments(image, camera, horizon_row))
        if progress:
            progress(done, len(images))
    return drop_static([[of_image] for of_image in segments], camera)


def _vote_horizon(segments: list[Segments]) -> float:
    """The y0 with most votes of all images; direction and curvature are free in each image."""
    prior = np.exp(-0.5 * (X0_BINS / PRIOR_DIRECTION_STD_RAD) ** 2)
    votes = sum((hough_votes(s) * prior).max(axis=(1, 2)) for s in segments)
    return float(Y0_BINS[np.argmax(votes)])


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
    """Raise PoseError unless enough images show two lines that are `lane_width` camera heights apart."""
    width, _, number = _line_pairs(lines)
    share = len(np.unique(number[np.abs(width / lane_width - 1) < 3 * LANE_WIDTH_SCATTER])) / len(lines)
    if share < MIN_LANE_SHARE:
        raise PoseError(
            f"only {share:.0%} of the {len(lines)} pictures with parallel lines show two that are a lane apart; "
            "give pictures that show both lines of the ego lane, or a camera file with the pose."
        )


def _median(values: np.ndarray, motion_std: float) -> tuple[float, float]:
    """Median over the images, and its standard deviation; `motion_std` is the prior scatter of an image."""
    # The scatter of few values is uncertain, so the prior counts like two more values.
    variance = (len(values) * _robust_std(values) ** 2 + 2 * motion_std**2) / (len(values) + 2)
    # The median of n normal values has the variance pi / 2n.
    return float(np.median(values)), float(np.sqrt(np.pi / 2 * variance / len(values)))


def _robust_std(values: np.ndarray) -> float:
    """Standard deviation from the median absolute deviation, which is robust against outliers."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


# Camera height and roll from the apparent width of the lanes.
#
# The lateral position k of a line is in camera heights. Two lines that bound a lane therefore differ by lane width /
# camera height in k. Lanes of one road have about the same width. Where the lanes on one side look wider than those on
# the other, the camera is rolled.

# Grids of the heights, as multiples of the prior height, and of the rolls.
HEIGHT_RATIOS, ROLL_GRID_RAD = np.geomspace(0.4, 2.5, 240), np.radians(np.linspace(-4, 4, 81))
# Relative standard deviation of the lane widths of one road. It is common to all images of a drive, which therefore
# count as at most eight independent ones.
LANE_WIDTH_SCATTER, MAX_INDEPENDENT_IMAGES = 0.04, 8
# Standard deviation of the car's distance from the middle of its lane.
OFFSET_STD_M = 0.4
# Likelihood of a pair of lines that do not bound one lane, relative to the peak for those that do.
OUTLIER_LIKELIHOOD = 0.05


def estimate_height_and_roll(
    lines: list[RoadLines], lane_width_m: float, prior_height_m: float, roll_rad: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Camera height and roll from the apparent width of the lanes, each with its standard deviation.

    `lines` are those of each image, corrected for the current estimate `roll_rad`. The approximate height
    `prior_height_m` distinguishes one lane from two lanes whose common line is worn off. The roll is 0 with the
    standard deviation of the prior if the images do not determine it.

    A remaining roll r moves a line from k to k + r (1 + k^2). A lane between k1 and k2 then looks 1 + r (k1 + k2) times
    as wide. A pair of lines may bound a lane or not, so the likelihood is a mixture with a constant. It is evaluated on
    a grid of heights and rolls, because it can have several maxima.
    """
    width, centre, _ = _line_pairs(lines)
    # Two lanes whose common line is worn off look like one wide lane, but the car is far from its middle.
    offset_m = centre / width * lane_width_m
    around = np.abs(offset_m) < lane_width_m / 2
    ego_likelihood = np.where(around, np.exp(-0.5 * (offset_m / OFFSET_STD_M) ** 2), 1.0)
    heights_m = prior_height_m * HEIGHT_RATIOS
    level_width = width[:, None] * (1 - 2 * ROLL_GRID_RAD * centre[:, None])
    residual = (level_width[:, None, :] * (heights_m / lane_width_m)[:, None] - 1) / LANE_WIDTH_SCATTER
    likelihood = ego_likelihood[:, None, None] * np.exp(-0.5 * residual**2)
    log_posterior = np.log(OUTLIER_LIKELIHOOD + likelihood).sum(axis=0)
    log_posterior *= min(1.0, MAX_INDEPENDENT_IMAGES / len(lines))
    height_stds = np.log(HEIGHT_RATIOS) / PRIOR_HEIGHT_LOG_STD
    log_posterior -= 0.5 * (height_stds[:, None] ** 2 + ((roll_rad + ROLL_GRID_RAD) / PRIOR_ROLL_STD_RAD) ** 2)
    posterior = np.exp(log_posterior - log_posterior.max())
    any_roll = posterior.sum(axis=1)
    roll, roll_std = mode_and_std(ROLL_GRID_RAD, posterior.sum(axis=0))
    # The roll is not observed if its posterior is hardly narrower than its prior.
    if roll_std > 0.85 * PRIOR_ROLL_STD_RAD:
        # the height of a nearly level camera: another one may belong to lines that are a lane only with a large roll
        tilt_rad = np.abs(roll_rad + ROLL_GRID_RAD)
        nearly_level = tilt_rad <= max(PRIOR_ROLL_STD_RAD / 2, tilt_rad.min())
        height_m = float(heights_m[np.argmax(posterior[:, nearly_level].sum(axis=1))])
        return (height_m, std_about(height_m, heights_m, any_roll)), (0.0, PRIOR_ROLL_STD_RAD)
    return mode_and_std(heights_m, any_roll), (roll_rad + roll, roll_std)


def _line_pairs(lines: list[RoadLines]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All pairs of lines of one image: distance and centre in k, index of the image."""
    pairs = []
    for number, image in enumerate(lines):
        left, right = (image.lateral[indices] for indices in np.triu_indices(len(image.lateral), 1))
        pairs.append(np.stack([right - left, (right + left) / 2, np.full(len(left), number)]))
    width, centre, numbers = np.hstack(pairs)
    return width, centre, numbers
