"""Estimate the camera pose from images of a drive: height, pitch, yaw and roll from the lanes that they show.

The edges along the road give a first pitch and yaw, the lanes in some images, searched at several heights, a first
height and roll (`lanes.pose.votes`). Then the lane is looked for in each image (`lanes.detect.search`). Lines that are
parallel on the road give the pitch of the image. Their direction gives the yaw, because the heading of a car in its
lane averages to zero over a drive. The lane width gives the height. Lanes of equal width that look narrower on one side
give the roll. The pose is the median over the images.

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

from lanes.camera.field_of_view import find_camera
from lanes.camera.model import Camera, CameraPose, require_camera
from lanes.detect.confidence import LIKELY_CONFIDENCE, SURE_CONFIDENCE, WEIGHTS
from lanes.detect.markings import Markings
from lanes.detect.search import (
    DETECTOR,
    HEIGHT_RANGE_M,
    DetectorSettings,
    StillDetection,
    detect_still,
    detect_with_own_pose,
)
from lanes.errors import ByValue, CameraError, PoseError, require_type
from lanes.pose.votes import (
    AHEAD,
    PRIOR_HEIGHT_LOG_STD,
    PRIOR_HEIGHT_M,
    PRIOR_ROLL_STD_RAD,
    Direction,
    Given,
    Rivals,
    find_edge_direction,
    first_pose,
    median_pose,
    shown_by,
    std_of_median,
    table,
    weighted_median,
)
from lanes.video.images import require_rgb
from lanes.video.sources import find_sources, require_topic, sample_images

# 12 ft, the lane of US Interstates (AASHTO, A Policy on Design Standards: Interstate System). Motorway lanes elsewhere
# are 3.50 to 3.75 m wide, hence the standard deviation.
LANE_WIDTH_M, _LANE_WIDTH_STD_M = 3.66, 0.10
# Images taken from the files of a drive; more did not improve the estimate.
POSE_PICTURES = 24
# States of a pose. Estimated: lanes in many images determine it. Doubtful: few images show a lane, or they leave the
# height open. Assumed: no lane is seen; it has the direction of the edges at most, and the prior's standard deviations.
ESTIMATED, DOUBTFUL, ASSUMED = "estimated", "doubtful", "assumed"

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class PoseEstimate(ByValue):
    """The camera with the estimated pose, and the standard deviations of the pose.

    `height_std_m` includes the uncertainty of the assumed lane width. `frames_used` are the images with a likely lane
    between two lines.
    `lane_width_m` determines the height, or follows from a given height; it is None if the pose is doubtful. `notes`
    name what the images do not determine. If the pose was estimated from a single image, `still` is the detection in
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
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])

    def summary_line(self) -> str:
        """One line with the numbers."""
        return f"pose: {', '.join(f'{name} {text}' for name, text in self.summary().items() if name != 'pictures')}"

    def describe_accuracy(self) -> str:
        """One sentence with the expected accuracy of offset, lane width, distances and curvature.

        The centimetres are at least the 95th percentile of the offset error on the rendered drive: with its calibrated
        lens, and without distortion at focal lengths from 0.7 to 1.5 times the true one (docs/own_camera.md).
        """
        height_m = self.pose.height_m
        # two standard deviations of the roll, which moves lines that are 1.8 m to the side
        by_roll_cm = 200 * self.roll_std_rad * (height_m + 1.8**2 / height_m)
        why = "lanes may be wider or narrower" if self.state == ESTIMATED else "the height is assumed"
        width = f" and {self.height_std_m / height_m:.0%} ({why})" if self.height_std_m else ""
        least_cm, others = 1, ", distances and curvature likewise"
        if not self.camera.calibrated:
            least_cm, others = 3, "; distances ahead to be off as much as the focal length, which was not calibrated, "
            others += "and curvature twice as much"
        return f"expect offset and lane width to be good to {max(least_cm, by_roll_cm):.0f} cm{width}{others}"

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
        A video, a still, a folder of them, or a pattern such as ``drive/*.jpg``. Or raw RGB images (height, width, 3),
        uint8, of the camera's size. All images are kept in memory; 20 to 60, spread over the drive, are enough.
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
    if files:
        if camera is None:
            camera = find_camera(next(sample_images(files, 1, topic=topic)).shape[1::-1], files, topic)
        part: dict[str, Any] = {"start_s": start_s, "end_s": end_s, "topic": topic}
        images = sample_images(files, max_pictures, require=require_camera(camera).require_size, **part)
    first = list(islice(images, 1))
    if not first:
        raise PoseError("no picture was given; name stills or a video of the drive.")
    camera = require_camera(camera or find_camera(require_rgb(first[0], "picture 1").shape[1::-1]))
    if min(camera.size) < 48:  # a line is thinner than a pixel a few metres ahead
        size = f"{camera.width}x{camera.height}"
        name = f"{files[0]}: " if files else ""
        raise PoseError(f"{name}pictures of {size} pixels are too small to show lines; give larger pictures.")
    resized, resized_camera = _resize(chain(first, images), camera)
    alone = len(resized) == 1
    # in half a second; more images of a drive are not independent, and their edges would be surer than they are right
    chosen = np.linspace(0, len(resized) - 1, min(len(resized), 8)).round().astype(int)
    some = [resized[k] for k in chosen]
    edges = find_edge_direction(some, resized_camera)
    given = Given(lane_width_m or LANE_WIDTH_M, height_m, markings, settings)

    def estimate_from(direction: Direction) -> PoseEstimate:
        start = CameraPose(height_m or PRIOR_HEIGHT_M, direction.pitch_rad, direction.yaw_rad)
        if alone:
            return _pose_from_still(first[0], camera.with_pose(start), direction, given, bool(lane_width_m))
        return _pose_from_lanes(resized, some, resized_camera.with_pose(start), given, progress)

    estimate = estimate_from(edges)
    if 2 * estimate.frames_used < estimate.frames_total:
        # in a wood or a city the edges may run elsewhere; most cameras look ahead
        tried = [estimate, estimate_from(AHEAD)]
        far = (edges.pitch_rad / AHEAD.pitch_std_rad) ** 2 + (edges.yaw_rad / AHEAD.yaw_std_rad) ** 2 > 1
        if far and not alone:
            tried.reverse()  # without lanes, edges that run far from ahead are more likely those of something else
        estimate = max(tried, key=attrgetter("frames_used"))
    return estimate if alone else replace(estimate, camera=camera.with_pose(estimate.pose))


def _pose_from_still(
    image: np.ndarray, camera: Camera, direction: Direction, given: Given, use_width: bool
) -> PoseEstimate:
    """The pose of the most probable lane in a single image, which is searched from poses near a `direction`.

    With `use_width` it is that at the height at which the lane has the given width, unless the height is given.
    """
    log_std, lane_width_m = 0.0 if given.height_m else PRIOR_HEIGHT_LOG_STD, None
    still = detect_with_own_pose(image, camera, log_std, given.markings, given.settings)
    if use_width and log_std and still.lane:
        lane_width_m, pose = given.lane_width_m, still.camera.require_pose()
        height_m = float(np.clip(pose.height_m * lane_width_m / still.lane.width_m, *HEIGHT_RANGE_M))
        posed = still.camera.with_pose(replace(pose, height_m=height_m))
        still = detect_with_own_pose(image, posed, 0.0, given.markings, given.settings)
        log_std = _LANE_WIDTH_STD_M / lane_width_m
    used = int(still.confidence >= LIKELY_CONFIDENCE)
    known = direction if used else AHEAD
    assumed = "the roll is" if lane_width_m else "height and roll are"
    return PoseEstimate(
        camera=still.camera,
        height_std_m=log_std * still.camera.require_pose().height_m,
        pitch_std_rad=known.pitch_std_rad,
        yaw_std_rad=known.yaw_std_rad,
        roll_std_rad=PRIOR_ROLL_STD_RAD,
        frames_used=used,
        frames_total=1,
        lane_width_m=lane_width_m,
        notes=(f"{assumed} assumed, and the yaw contains the car's heading in its lane",),
        still=still,
    )


def detect_in_drive(
    image: np.ndarray,
    camera: Camera,
    drive: PoseEstimate | None,
    markings: Markings | None = None,
    settings: DetectorSettings = DETECTOR,
) -> tuple[StillDetection, PoseEstimate | None]:
    """The detection in an image of a drive, and the pose estimate that it was made with.

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
    """Images and camera at a width of 1280 px: the limits for edges are for it, and more do not show more stripes."""
    resized_camera = camera.scaled((1280, round(camera.height * 1280 / camera.width)))
    size, interpolation = resized_camera.size, cv2.INTER_AREA if camera.width > 1280 else cv2.INTER_LINEAR
    resized = []
    for number, image in enumerate(images, 1):
        image = camera.require_size(image, f"picture {number}")
        resized.append(image if camera.size == size else cv2.resize(image, size, interpolation=interpolation))
    return resized, resized_camera


def _pose_from_lanes(
    images: list[np.ndarray], first: list[np.ndarray], camera: Camera, given: Given, progress: Progress | None
) -> PoseEstimate:
    """The pose of several images: the median of what the lanes in them show, twice, the second time from the first."""
    searched = count(1)

    def counted(some: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        for image in some:
            yield image
            if progress:
                progress(next(searched), len(first) + 2 * len(images))

    start, rivals = first_pose(counted(first), camera, given)
    pose = start
    for _ in range(2):
        camera = camera.with_pose(pose)
        stills = (detect_still(image, camera, given.settings, markings=given.markings) for image in counted(images))
        shown = table([shown_by(still, given.lane_width_m) for still in stills])
        pose = median_pose(shown, start, given.height_m)
    return _summarise(shown, camera, rivals, given)


def _summarise(shown: np.ndarray, camera: Camera, rivals: Rivals, given: Given) -> PoseEstimate:
    """The estimate from what the lanes of the last pass have `shown` (images,), with standard deviations."""
    pose, total, (lane_width_m, height_m, *_) = camera.require_pose(), len(shown), given
    used = int(np.isfinite(shown["log_height"]).sum())
    # lanes that end at the edge of a road vary more; those of one road differ by 4 % from their mean
    width_std_m = 0.7 if 2 * np.nansum(shown["edge"]) > used else _LANE_WIDTH_STD_M
    of_lanes = std_of_median(shown["log_height"], 0.04)
    log_std = float(np.linalg.norm([of_lanes, width_std_m / lane_width_m, rivals.log_height_std]))
    # likely lanes in less than a quarter of the images
    few, undecided = used < max(1, 0.25 * total), not height_m and log_std > PRIOR_HEIGHT_LOG_STD
    width_ratio = 1.0  # of the lanes to the given width, which is not used if the height is given
    if height_m:
        shown_log = weighted_median(shown["log_height"], shown["confidence"], np.log(height_m))
        width_ratio = height_m / float(np.exp(shown_log))
    doubtful = few or undecided
    log_std = max(log_std, PRIOR_HEIGHT_LOG_STD) if doubtful else log_std
    pitch_std_rad, yaw_std_rad = AHEAD.pitch_std_rad, AHEAD.yaw_std_rad
    if used:
        # with a doubtful pose, the images without a likely lane speak for any other direction
        unseen = np.sqrt((1 - used / total) * doubtful)
        # in one image the car pitches by 0.3 degrees, and heads out of its lane by 1 degree
        pitch_std_rad = float(np.hypot(std_of_median(shown["pitch_rad"], np.radians(0.3)), unseen * pitch_std_rad))
        yaw_std_rad = float(np.hypot(std_of_median(shown["yaw_rad"], np.radians(1.0)), unseen * yaw_std_rad))
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
