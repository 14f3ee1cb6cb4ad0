"""Estimate the camera pose from images of a drive: height, pitch, yaw and roll from the lanes that they show.

The edges along the road give a first pitch and yaw (`lanes.vanishing_point`). The lanes in some images, searched at
several heights, vote for height and roll (`lanes.pose_votes`). Then the lane is looked for in each image
(`lanes.stills`). Lines that are parallel on the road give the pitch of the image. Their direction gives the yaw,
because the heading of a car in its lane averages to zero over a drive. The lane width gives the height. Lanes of equal
width that look narrower on one side give the roll. The pose is the median over the images.

No drive is refused: where few images show a lane, or the images allow another height, the pose is doubtful, and where
none does, it is assumed. The confidence of its lanes says the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, count, islice
from operator import attrgetter
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lanes.camera import Camera, CameraPose, require_camera
from lanes.detect.confidence import LIKELY_CONFIDENCE, SURE_CONFIDENCE, WEIGHTS
from lanes.detect.markings import Markings
from lanes.detect.search import DETECTOR, DetectorSettings, StillDetection
from lanes.errors import ByValue, CameraError, PoseError, require_type
from lanes.field_of_view import find_camera
from lanes.images import require_rgb
from lanes.pose_votes import (
    PRIOR_HEIGHT_LOG_STD,
    PRIOR_HEIGHT_M,
    PRIOR_ROLL_STD_RAD,
    Rivals,
    Shown,
    first_pose,
    median_pose,
    shown_by,
    std_of_median,
    table,
    weighted_median,
)
from lanes.sources import find_sources, require_topic, sample_images
from lanes.stills import HEIGHT_RANGE_M, detect_still, detect_with_own_pose
from lanes.vanishing_point import AHEAD, Direction, find_edge_direction

# 12 ft, the lane of US Interstates (AASHTO, A Policy on Design Standards: Interstate System). Motorway lanes elsewhere
# are 3.50 to 3.75 m wide, hence the standard deviation. The second one is that of lanes that end at the edge of a road.
LANE_WIDTH_M, LANE_WIDTH_STD_M, EDGE_LANE_WIDTH_STD_M = 3.66, 0.10, 0.7
# Standard deviation, in one image, of the pitch motion of the car, of its heading in the lane, and of the lane width of
# one road relative to its mean.
PITCH_MOTION_STD_RAD, HEADING_STD_RAD, LANE_WIDTH_SCATTER = np.radians(0.3), np.radians(1.0), 0.04
# Images of a drive whose edges are used, and that are searched with several poses each, in half a second, before all
# are with one. More images of a drive are not independent: their edges would be surer than they are right.
FIRST_IMAGES = 8
# Share of the images with a likely lane, below which the pose is doubtful.
MIN_LIKELY_SHARE = 0.25
# Images are resized to this width: the pixel limits of `lanes.vanishing_point` are for it, and more pixels do not show
# more stripes.
WORKING_WIDTH_PX = 1280

# Images taken from the files of a drive; more did not improve the estimate.
POSE_PICTURES = 24

# States of a pose: most of its numbers come from lanes in the images; from lanes in few of them, or at a height that
# they do not decide; from the edges in the images or from nothing, with the standard deviations of any camera.
ESTIMATED, DOUBTFUL, ASSUMED = "estimated", "doubtful", "assumed"

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class PoseEstimate(ByValue):
    """The camera with the estimated pose, and the standard deviations of the pose.

    `height_std_m` includes the uncertainty of the assumed lane width. `frames_used` are the images with a likely lane
    between two lines.
    `lane_width_m` determines the height, or follows from a given height; it is None if the pose is doubtful. `notes`
    name what the images do not determine. If the pose was estimated from a single image, `still` is what was found in
    it, and the pose is that of its lane. `confidence_shift` is added to the log odds of lanes that are found with the
    pose: the images allow other heights, too.
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
    confidence_shift: float = 0.0

    @property
    def pose(self) -> CameraPose:
        """The estimated pose."""
        return self.camera.require_pose()

    @property
    def state(self) -> str:
        """`ESTIMATED`, `DOUBTFUL` or `ASSUMED`."""
        if not self.frames_used:
            return ASSUMED
        return DOUBTFUL if self.lane_width_m is None else ESTIMATED

    @property
    def given_height_m(self) -> float | None:
        """The height, if it was given and not estimated."""
        return None if self.height_std_m else self.pose.height_m

    def summary(self) -> dict[str, str]:
        """Each number with its standard deviation and its sign in words, by name."""
        pose, source = self.pose, "assumed" if self.height_std_m else "given"
        doubt = "" if self.state == ESTIMATED else f", the pose is {self.state}"
        if self.lane_width_m is not None:
            source = f"lane {self.lane_width_m:.2f} m wide"
        return {
            "height": f"{pose.height_m:.2f} ± {self.height_std_m:.2f} m ({source})",
            "pitch": _describe_angle(pose.pitch_rad, self.pitch_std_rad, "looks down", "looks up"),
            "yaw": _describe_angle(pose.yaw_rad, self.yaw_std_rad, "looks left", "looks right"),
            "roll": _describe_angle(pose.roll_rad, self.roll_std_rad, "right side down", "left side down"),
            "pictures": f"{self.frames_used} of {self.frames_total} used{doubt}",
        }

    def describe(self) -> str:
        """Several lines of text: the summary and the notes."""
        lines = [f"{name:<8} {text}" for name, text in self.summary().items()]
        return "\n".join(lines + [f"note: {note}" for note in self.notes])

    def summary_line(self) -> str:
        """One line with the numbers."""
        return f"pose: {', '.join(f'{name} {text}' for name, text in self.summary().items() if name != 'pictures')}"

    def describe_accuracy(self) -> str:
        """One sentence with the expected accuracy of offset, lane width, distances and curvature.

        The centimetres are at least the 95th percentile of the offset error on the rendered drive: with its calibrated
        lens, and without distortion at focal lengths from 0.7 to 1.5 times the true one (docs/own_camera.md).
        """
        height_m = self.pose.height_m
        # two standard deviations of the roll, which moves lines 1.8 m beside the camera
        by_roll_cm = 200 * self.roll_std_rad * (height_m + 1.8**2 / height_m)
        why = "lanes may be wider or narrower" if self.state == ESTIMATED else "the height is assumed"
        width = f" and {self.height_std_m / height_m:.0%} ({why})" if self.height_std_m else ""
        good = (
            f"expect offset and lane width to be good to {max(1 if self.camera.calibrated else 3, by_roll_cm):.0f} cm"
        )
        if self.camera.calibrated:
            return f"{good}{width}, distances and curvature likewise"
        return (
            f"{good}{width}; distances ahead to be off as much as the focal length, which was not calibrated, and "
            "curvature twice as much"
        )

    def __repr__(self) -> str:
        return f"PoseEstimate({', '.join(f'{name} {text}' for name, text in self.summary().items())})"


def _describe_angle(angle_rad: float, std_rad: float, positive: str, negative: str) -> str:
    degrees = round(float(np.degrees(angle_rad)), 2) + 0.0  # not -0.00
    direction = f" ({positive if degrees > 0 else negative})" if degrees else ""
    return f"{degrees:.2f} ± {np.degrees(std_rad):.2f} deg{direction}"


def estimate_pose(
    source: str | Path | np.ndarray | Iterable[str | Path | np.ndarray],
    camera: Camera | None = None,
    *,
    lane_width_m: float | None = None,
    height_m: float | None = None,
    max_pictures: int = POSE_PICTURES,
    start_s: float = 0.0,
    end_s: float | None = None,
    topic: str | None = None,
    progress: Progress | None = None,
    markings: Markings | None = None,
    settings: DetectorSettings = DETECTOR,
) -> PoseEstimate:
    """Height, pitch, yaw and roll of a camera, estimated from images of one drive.

    >>> camera = lanes.estimate_pose("drive.mp4", camera).camera  # doctest: +SKIP

    Only the intrinsics of `camera` are used; an existing pose is ignored. Without a camera they are those of the files
    (`camera_info`, EXIF), or of a horizontal field of view of 60 degrees, and a warning says so. In a single image the
    lane is looked for with several poses; the estimate is that of the most probable lane, `PoseEstimate.still`.

    Parameters
    ----------
    source : path, array, or iterable of paths or of arrays
        A video, a picture, a folder of them, or a pattern such as ``drive/*.jpg``; or images (height, width, 3), uint8,
        RGB, raw, of the camera's size. All images are kept in memory; 20 to 60, spread over the drive, are enough.
    lane_width_m : float, optional
        Distance between the centres of the ego lane's lines; it determines the height. By default `LANE_WIDTH_M` for
        several images; the height of a single one is then assumed.
    height_m : float, optional
        Measured height of the camera above the road. If given, the lane width is not used.
    max_pictures : int
        Number of images taken from files, evenly spaced.
    start_s, end_s, topic
        Part of each video, seconds since its first frame; topic of the images in robot logs, by default the only one.
    progress : callable, optional
        Called with (searches done, searches in all): most images are searched twice.
    markings : callable, optional, as for `lanes.find_lane`

    Raises
    ------
    PoseError
        If there are no images, or too small ones. If the given lane width or height is not plausible.
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read, or an image is not of the camera's size.
    CameraError
        If the pose estimated from a single image sees no road.
    """
    if lane_width_m is not None and not 2.0 <= lane_width_m <= 6.0:
        raise PoseError(f"a lane {lane_width_m} m wide is not plausible; give 2 to 6 metres.")
    if height_m is not None and not HEIGHT_RANGE_M[0] <= height_m <= HEIGHT_RANGE_M[1]:
        raise PoseError(f"a camera {height_m} m above the road is not plausible; give 0.5 to 4.5 metres.")
    require_type(settings, DetectorSettings, "settings")
    files, images = _list_images(source)
    require_topic(files, topic)
    if files and camera is None:
        camera = find_camera(next(sample_images(files, 1, topic=topic)).shape[1::-1], files, topic)
    if files:
        part: dict[str, Any] = {"start_s": start_s, "end_s": end_s, "topic": topic}
        images = sample_images(files, max_pictures, require=require_camera(camera).require_size, **part)
    first = list(islice(images, 1))
    if not first:
        raise PoseError("no picture was given; name stills or a video of the drive.")
    camera = require_camera(camera or find_camera(require_rgb(first[0], "picture 1").shape[1::-1]))
    try:
        resized, resized_camera = _resize(chain(first, images), camera)
    except PoseError as error:
        raise PoseError(f"{files[0]}: {error}" if files else str(error)) from error
    alone = len(resized) == 1
    edges = find_edge_direction(_first_images(resized), resized_camera)

    def estimate_from(direction: Direction) -> PoseEstimate:
        start = CameraPose(height_m or PRIOR_HEIGHT_M, direction[0][0], direction[1][0])
        if alone:
            log_std = PRIOR_HEIGHT_LOG_STD if height_m is None else 0.0
            still = detect_with_own_pose(first[0], camera.with_pose(start), log_std, markings, settings)
            if lane_width_m and log_std and still.lane:
                return _with_lane_width(first[0], still, lane_width_m, direction, markings, settings)
            return _pose_from_still(still, log_std, direction)
        width_m, posed = lane_width_m or LANE_WIDTH_M, resized_camera.with_pose(start)
        return _pose_from_lanes(resized, posed, width_m, height_m, progress, markings, settings)

    estimate = estimate_from(edges)
    if 2 * estimate.frames_used < estimate.frames_total:
        # in a wood or a city the edges may run elsewhere; most cameras look ahead
        tried = [estimate, estimate_from(AHEAD)]
        if not alone and sum((angle / std) ** 2 for (angle, _), (_, std) in zip(edges, AHEAD, strict=True)) > 1:
            tried.reverse()  # without lanes, edges that run far from ahead are more likely those of something else
        estimate = max(tried, key=attrgetter("frames_used"))
    return estimate if alone else replace(estimate, camera=camera.with_pose(estimate.pose))


def _pose_from_still(still: StillDetection, log_std: float, direction: Direction) -> PoseEstimate:
    """The pose of the most probable lane in a single image, which was searched from poses near a `direction`."""
    used = int(still.confidence >= LIKELY_CONFIDENCE)
    return PoseEstimate(
        camera=still.camera,
        height_std_m=log_std * still.camera.require_pose().height_m,
        pitch_std_rad=(direction if used else AHEAD)[0][1],
        yaw_std_rad=(direction if used else AHEAD)[1][1],
        roll_std_rad=PRIOR_ROLL_STD_RAD,
        frames_used=used,
        frames_total=1,
        lane_width_m=None,
        notes=("height and roll are assumed, and the yaw contains the car's heading in its lane",),
        still=still,
    )


def _with_lane_width(
    image: np.ndarray,
    still: StillDetection,
    lane_width_m: float,
    direction: Direction,
    markings: Markings | None,
    settings: DetectorSettings,
) -> PoseEstimate:
    """The pose of a single image at the height at which its lane has a given width."""
    pose, lane = still.camera.require_pose(), still.lane
    height_m = float(np.clip(pose.height_m * lane_width_m / (lane.width_m if lane else lane_width_m), *HEIGHT_RANGE_M))
    posed = still.camera.with_pose(replace(pose, height_m=height_m))
    still = detect_with_own_pose(image, posed, 0.0, markings, settings)
    estimate = _pose_from_still(still, LANE_WIDTH_STD_M / lane_width_m, direction)
    note = "the roll is assumed, and the yaw contains the car's heading in its lane"
    return replace(estimate, lane_width_m=lane_width_m, notes=(note,))


def _first_images(images: list[np.ndarray]) -> list[np.ndarray]:
    """At most `FIRST_IMAGES` of the images, evenly spaced."""
    chosen = np.linspace(0, len(images) - 1, min(len(images), FIRST_IMAGES)).round().astype(int)
    return [images[k] for k in chosen]


def detect_in_drive(
    image: np.ndarray,
    camera: Camera,
    drive: PoseEstimate | None,
    markings: Markings | None = None,
    settings: DetectorSettings = DETECTOR,
) -> tuple[StillDetection, PoseEstimate | None]:
    """What is found in an image of a drive, and the pose estimate that it was found with.

    `drive` is the estimate that `ensure_pose` returned with the camera; None if the pose is known. If it shows no
    sure lane, the pose of the image alone is tried, too, and the more probable lane is taken. Errors are those of
    `find_lane`.
    """
    if drive is None:
        return detect_still(image, camera, settings, markings=markings), None
    if drive.still:
        return drive.still, drive
    found = detect_still(image, camera, settings, markings=markings)
    if found.lane:
        shift = found.lane.confidence_shift + drive.confidence_shift
        found = replace(found, lane=replace(found.lane, confidence_shift=shift))
    if found.confidence < SURE_CONFIDENCE or drive.state != ESTIMATED:
        with suppress(CameraError):
            options: dict[str, Any] = {"height_m": drive.given_height_m, "markings": markings}
            own = estimate_pose(image, camera, settings=settings, **options)
            if own.still and own.still.confidence > found.confidence:
                return own.still, own
    return found, drive


def ensure_pose(camera: Camera, source: Any, **options: Any) -> tuple[Camera, PoseEstimate | None]:
    """The camera with a pose: its own, or that of `estimate_pose`; the estimate is None if the camera had a pose."""
    if camera.pose is not None:
        return camera, None
    estimate = estimate_pose(source, camera, **options)
    return estimate.camera, estimate


def _list_images(source: Any) -> tuple[Sequence[Path], Iterator[np.ndarray]]:
    """The files of a source of `estimate_pose`, or its images."""
    if isinstance(source, str | Path | np.ndarray):
        source = [source]
    items = iter(source)
    first = list(islice(items, 1))
    if not first or isinstance(first[0], np.ndarray):
        return [], chain(first, items)
    return find_sources(map(str, chain(first, items))).files, iter(())


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
    return resized, resized_camera


def _pose_from_lanes(
    images: list[np.ndarray],
    camera: Camera,
    lane_width_m: float,
    height_m: float | None,
    progress: Progress | None,
    markings: Markings | None,
    settings: DetectorSettings,
) -> PoseEstimate:
    """The pose of several images: the median of what the lanes in them show, more than once with a better pose."""
    first, searched = _first_images(images), count(1)

    def counted(some: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        for image in some:
            yield image
            if progress:
                progress(next(searched), len(first) + 2 * len(images))

    pose, rivals = first_pose(counted(first), camera, lane_width_m, height_m, markings, settings)
    shown: list[Shown] = []
    for last in (False, True):
        camera = camera.with_pose(median_pose(table(shown), pose, height_m) if last else pose)
        stills = (detect_still(image, camera, settings, markings=markings) for image in counted(images))
        shown = [shown_by(still, lane_width_m) for still in stills]
    return _summarise(table(shown), camera, rivals, lane_width_m, height_m)


def _summarise(
    shown: np.ndarray, camera: Camera, rivals: Rivals, lane_width_m: float, height_m: float | None
) -> PoseEstimate:
    """The estimate from what the lanes of the last pass have `shown` (images,), with standard deviations."""
    pose, total = camera.require_pose(), len(shown)
    used = int(np.isfinite(shown["log_height"]).sum())
    width_std_m = EDGE_LANE_WIDTH_STD_M if 2 * np.nansum(shown["edge"]) > used else LANE_WIDTH_STD_M
    of_lanes = std_of_median(shown["log_height"], LANE_WIDTH_SCATTER)
    log_std = float(np.linalg.norm([of_lanes, width_std_m / lane_width_m, rivals.log_height_std]))
    few, undecided = used < max(1, MIN_LIKELY_SHARE * total), not height_m and log_std > PRIOR_HEIGHT_LOG_STD
    width_ratio = 1.0  # of the lanes to the given width, which is not used if the height is given
    if height_m:
        shown_log = weighted_median(shown["log_height"], shown["confidence"], np.log(height_m))
        width_ratio = height_m / float(np.exp(shown_log))
    doubtful = few or undecided
    log_std = max(log_std, PRIOR_HEIGHT_LOG_STD) if doubtful else log_std
    # with a doubtful pose, the images without a likely lane speak for any other direction
    unseen, (pitch_std_rad, yaw_std_rad) = (1 - used / total) * doubtful, [std for _, std in AHEAD]
    if used:
        of_pitch = std_of_median(shown["pitch_rad"], PITCH_MOTION_STD_RAD)
        of_yaw = std_of_median(shown["yaw_rad"], HEADING_STD_RAD)
        pitch_std_rad = float(np.hypot(of_pitch, np.sqrt(unseen) * pitch_std_rad))
        yaw_std_rad = float(np.hypot(of_yaw, np.sqrt(unseen) * yaw_std_rad))
    roll_known = bool(pose.roll_rad or np.isfinite(shown["roll_rad"]).any())
    return PoseEstimate(
        camera=camera,
        height_std_m=0.0 if height_m else log_std * pose.height_m,
        pitch_std_rad=pitch_std_rad,
        yaw_std_rad=yaw_std_rad,
        roll_std_rad=float(np.hypot(std_of_median(shown["roll_rad"], PRIOR_ROLL_STD_RAD), rivals.roll_std_rad)),
        frames_used=used,
        frames_total=total,
        lane_width_m=None if doubtful else lane_width_m * width_ratio,
        notes=tuple(_notes(used, total, few, rivals.height_m if undecided else None, roll_known)),
        confidence_shift=0.0 if height_m else rivals.share * WEIGHTS["other lanes"],
    )


def _notes(used: int, total: int, few: bool, rival_height_m: float | None, roll_known: bool) -> Iterator[str]:
    """What the images do not determine, most important first."""
    if few:
        yield (
            f"only {used} of {total} pictures show a likely lane between two lines with this pose; give pictures of a "
            "marked road by day, with the lines of the ego lane in view"
        )
    elif rival_height_m:
        yield (
            f"the pictures allow a height of {rival_height_m:.1f} m, too, at which other lines are those of the ego "
            "lane; give the height"
        )
    if not roll_known:
        yield "no line beyond the ego lane is visible well enough to determine the roll; it is set to 0"
    if used < 5:
        yield "the yaw contains the car's heading in its lane, which averages to zero only over many pictures"
