"""Estimate the camera pose from images of a drive: height, pitch, yaw and roll from the
lanes that they show.

The edges along the road give a first pitch and yaw, the lanes in some images, searched
at several heights, a first height and roll (`lanes.pose.votes`). Then the lane is
looked for in each image (`lanes.detect.search`). Lines that are parallel on the road
give the pitch of the image. Their direction gives the yaw, because the heading of a car
in its lane averages to zero over a drive. The lane width gives the height. Lanes of
equal width that look narrower on one side give the roll. The pose is the median over
the images.

No drive is refused: where few images show a lane, or the images allow another height,
the pose is doubtful, and where none does, it is assumed. The confidence of its lanes
says the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lanes.camera.field_of_view import OTHER_VIEWS, find_camera
from lanes.camera.model import Camera, CameraPose, PoseStd, require_camera
from lanes.describe import describe_std
from lanes.detect.confidence import LIKELY_CONFIDENCE, SURE_CONFIDENCE, WEIGHTS
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings
from lanes.detect.search import (
    DETECTOR,
    HEIGHT_RANGE_M,
    DetectorSettings,
    StillDetection,
    detect_still,
    detect_with_own_pose,
)
from lanes.equality import ByValue
from lanes.errors import CameraError, PoseError, require_type
from lanes.pose.votes import (
    AHEAD,
    PRIOR_HEIGHT_LOG_STD,
    PRIOR_ROLL_STD_RAD,
    USUAL_GRID,
    WIDE_GRID,
    Direction,
    OtherPoses,
    PoseOptions,
    as_table,
    find_edge_direction,
    find_edges,
    first_pose,
    median_pose,
    pose_shown_by,
    std_of_median,
    weighted_median,
)
from lanes.video.images import require_rgb
from lanes.video.sources import find_sources, list_paths, require_topic, sample_images

# 12 ft, the lane of US Interstates (AASHTO, A Policy on Design Standards: Interstate
# System). Motorway lanes elsewhere are 3.50 to 3.75 m wide, hence the standard
# deviation.
LANE_WIDTH_M = 3.66
_LANE_WIDTH_STD_M = 0.10
# Lanes that end at the edge of a road vary more. Those of one road differ by 4 % from
# their mean.
_EDGE_WIDTH_STD_M = 0.7
_LANE_LOG_STD = 0.04
# In one image the car pitches, and heads out of its lane, by these angles.
_CAR_PITCH_STD_RAD = np.radians(0.3)
_CAR_HEADING_STD_RAD = np.radians(1.0)
# In one image of a drive the direction differs from that of the drive by these angles:
# the car brakes or climbs, and changes lanes, or somebody knocked the camera.
_MOVED_PITCH_STD_RAD = np.radians(2.0)
_MOVED_YAW_STD_RAD = np.radians(4.0)
# Lengths of edges and lines are limits for images of this width; larger ones do not
# show more.
_WIDTH_PX = 1280
# Images whose edges vote, in half a second; more images of a drive are not independent,
# and their edges would be surer than they are right.
_EDGE_PICTURES = 8
# In a smaller image a line is thinner than a pixel a few metres ahead.
_MIN_SIZE_PX = 48
# Smallest share of images with a likely lane; with less the pose is doubtful.
_FEW_LANES = 0.25
_WIDTH_RANGE_M = (2.0, 6.0)
# Images taken from the files of a drive; more did not improve the estimate.
POSE_PICTURES = 24
# States of a pose. Estimated: lanes in many images determine it. Doubtful: few images
# show a lane, or they leave the height open. Assumed: no lane is seen; it has the
# direction of the edges at most, and the prior's standard deviations.
ESTIMATED, DOUBTFUL, ASSUMED = "estimated", "doubtful", "assumed"

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class PoseEstimate(ByValue):
    """The camera with the estimated pose, and the standard deviations of the pose.

    `height_std_m` includes the uncertainty of the assumed lane width. `frames_used` are
    the images with a likely lane between two lines. `lane_width_m` determines the
    height, or follows from a given height; it is None if the pose is doubtful. `notes`
    name what the images do not determine. If the pose was estimated from a single
    image, `still` is the detection in it, and the pose is that of its lane.
    `confidence_shift` is added to the log odds of lanes that are found with the pose:
    the images allow other heights, too.
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

    @property
    def known_height_m(self) -> float | None:
        """The height, if it was given, or if lanes in many images determine it."""
        if self.state == ESTIMATED:
            return self.pose.height_m
        return self.given_height_m

    def summary(self) -> dict[str, str]:
        """Each number with its standard deviation and its sign in words, by name."""
        pose = self.pose
        if self.lane_width_m is not None:
            source = f"lane {self.lane_width_m:.2f} m wide"
        else:
            source = "assumed" if self.height_std_m else "given"
        doubt = "" if self.state == ESTIMATED else f", the pose is {self.state}"
        pitch = _describe_angle(
            pose.pitch_rad, self.pitch_std_rad, "looks down", "looks up"
        )
        yaw = _describe_angle(
            pose.yaw_rad, self.yaw_std_rad, "looks left", "looks right"
        )
        roll = _describe_angle(
            pose.roll_rad, self.roll_std_rad, "right side down", "left side down"
        )
        return {
            "height": f"{pose.height_m:.2f} ± {self.height_std_m:.2f} m ({source})",
            "pitch": pitch,
            "yaw": yaw,
            "roll": roll,
            "pictures": f"{self.frames_used} of {self.frames_total} used{doubt}",
        }

    def describe(self) -> str:
        """Several lines of text: the summary and the notes."""
        lines = [f"{name:<8} {text}" for name, text in self.summary().items()]
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)

    def summary_line(self) -> str:
        """One line with the numbers."""
        numbers = self.summary()
        del numbers["pictures"]
        return f"pose: {_join_words(numbers)}"

    def describe_accuracy(self) -> str:
        """One sentence with the expected accuracy of offset, lane width, distances and
        curvature.

        They are standard deviations, which those of the lanes contain.
        """
        height_m = self.pose.height_m
        # lines that are 1.8 m to the side
        by_roll_m = self.roll_std_rad * (height_m + 1.8**2 / height_m)
        width = ""
        if self.height_std_m:
            why = "the height is assumed"
            if self.state == ESTIMATED:
                why = "lanes may be wider or narrower"
            width = f" and {self.height_std_m / height_m:.0%} ({why})"
        others = ", distances and curvature likewise"
        if not self.camera.calibrated:
            others = (
                "; distances ahead may be off as much as the focal length, which was "
                "not calibrated, and curvature twice as much"
            )
        offset_m = float(np.hypot(by_roll_m, self.camera.lens_std_m))
        return (
            f"the camera adds ± {describe_std(offset_m)} m{width} to offset and lane "
            f"width, which the ± of the results contain{others}"
        )

    def __repr__(self) -> str:
        return f"PoseEstimate({_join_words(self.summary())})"


def _join_words(numbers: dict[str, str]) -> str:
    return ", ".join(f"{name} {text}" for name, text in numbers.items())


def _describe_angle(
    angle_rad: float, std_rad: float, positive: str, negative: str
) -> str:
    degrees = round(float(np.degrees(angle_rad)), 2) + 0.0  # not -0.00
    direction = ""
    if degrees:
        direction = f" ({positive if degrees > 0 else negative})"
    return f"{degrees:.2f} ± {np.degrees(std_rad):.2f} deg{direction}"


def estimate_pose(  # noqa: PLR0913 (options, called by name)
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

    Only the intrinsics of `camera` are used; an existing pose is ignored. Without a
    camera they are those of the files (`camera_info`, EXIF), or of a horizontal field
    of view of 60 degrees, and a warning says so. In a single image the lane is looked
    for with several poses; the estimate is that of the most probable lane,
    `PoseEstimate.still`.

    Parameters
    ----------
    source : path, array, or iterable of paths or of arrays
        A video, a still, a folder of them, or a pattern such as ``drive/*.jpg``. Or raw
        RGB images (height, width, 3), uint8, of the camera's size. All images are kept
        in memory; 20 to 60, spread over the drive, are enough.
    lane_width_m : float, optional
        Distance between the centres of the ego lane's lines; it determines the height.
        By default `LANE_WIDTH_M` for several images; the height of a single one is then
        assumed.
    height_m : float, optional
        Measured height of the camera above the road. If given, the lane width is not
        used.
    max_pictures : int
        Number of images taken from files, evenly spaced.
    start_s, end_s, topic
        Part of each video, seconds since its first frame; topic of the images in robot
        logs, by default the only one.
    progress : callable, optional
        Called with (searches done, searches in all): most images are searched twice.
    markings : callable, optional, as for `lanes.find_lane`

    Raises
    ------
    PoseError
        If there are no images, or too small ones. If the given lane width or height is
        not plausible.
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read, or an image is not of the camera's size.
    CameraError
        If the pose estimated from a single image sees no road.
    """
    low_m, high_m = _WIDTH_RANGE_M
    if lane_width_m is not None and not low_m <= lane_width_m <= high_m:
        raise PoseError(
            f"a lane {lane_width_m} m wide is not plausible; give 2 to 6 metres."
        )
    low_m, high_m = HEIGHT_RANGE_M
    if height_m is not None and not low_m <= height_m <= high_m:
        raise PoseError(
            f"a camera {height_m} m above the road is not plausible; give 0.5 to 4.5 "
            "metres."
        )
    require_type(settings, DetectorSettings, "settings")
    options = PoseOptions(
        lane_width_m=lane_width_m or LANE_WIDTH_M,
        is_width_given=bool(lane_width_m),
        height_m=height_m,
        markings=markings,
        settings=settings,
    )

    # the images, and the lens
    files, images = _list_images(source)
    require_topic(files, topic)
    if files:
        if camera is None:
            (image,) = sample_images(files, 1, start_s=start_s, topic=topic)
            camera = find_camera(image.shape[1::-1], files, topic)
        images = sample_images(
            files,
            max_pictures,
            require=require_camera(camera).require_size,
            start_s=start_s,
            end_s=end_s,
            topic=topic,
        )
    first = next(images, None)
    if first is None:
        raise PoseError("no picture was given; name stills or a video of the drive.")
    if camera is None:
        camera = find_camera(require_rgb(first, "picture 1").shape[1::-1])
    camera = require_camera(camera)
    if min(camera.size) < _MIN_SIZE_PX:
        name = f"{files[0]}: " if files else ""
        raise PoseError(
            f"{name}pictures of {camera.width}x{camera.height} pixels are too small to "
            "show lines; give larger pictures."
        )

    second = next(images, None)
    if second is None:
        return _pose_from_still(first, camera, options)
    resized, resized_camera = _resize(chain([first, second], images), camera)
    estimate = _pose_from_images(resized, resized_camera, options, progress)
    height_share = estimate.height_std_m / estimate.pose.height_m
    pose_std = PoseStd(height_share, estimate.roll_std_rad)
    posed = replace(camera, pose=estimate.pose, pose_std=pose_std)
    return replace(estimate, camera=posed)


def _pose_from_images(
    images: list[np.ndarray],
    camera: Camera,
    options: PoseOptions,
    progress: Progress | None,
) -> PoseEstimate:
    """The pose of several images, begun from the direction of their edges."""
    spread = np.linspace(0, len(images) - 1, min(len(images), _EDGE_PICTURES))
    some = [images[k] for k in spread.round().astype(int)]
    edges = [find_edges(image, camera) for image in some]
    direction = find_edge_direction(edges)
    estimate = _pose_from_lanes(images, some, camera, direction, options, progress)
    if not _shows_few_lanes(estimate):
        return estimate

    # in a wood or a city the edges may run elsewhere; most cameras look ahead
    ahead = _pose_from_lanes(images, some, camera, AHEAD, options, progress)
    # without lanes, edges that run far from ahead are more likely those of something
    # else
    is_far = direction.is_far_from(AHEAD)
    if is_far and ahead.frames_used == estimate.frames_used:
        estimate = ahead
    estimate = _with_more_lanes(estimate, ahead)

    # a camera that looks far up, down or aside
    wide = _find_wide_direction(edges)
    if wide is None or not _shows_few_lanes(estimate):
        return estimate
    aside = _pose_from_lanes(images, some, camera, wide, options, progress)
    return _with_more_lanes(estimate, aside)


def _find_wide_direction(edges: Sequence[np.ndarray]) -> Direction | None:
    """The direction of the edges beyond the usual one.

    None on the border of what is searched: the edges then lead farther, to nowhere.
    """
    direction = find_edge_direction(edges, grid=WIDE_GRID)
    is_new = not USUAL_GRID.contains(direction)
    return direction if is_new and WIDE_GRID.contains(direction) else None


def _shows_few_lanes(estimate: PoseEstimate) -> bool:
    """Whether less than half of the images show a likely lane."""
    return 2 * estimate.frames_used < estimate.frames_total


def _with_more_lanes(first: PoseEstimate, second: PoseEstimate) -> PoseEstimate:
    """The estimate with which more images show a likely lane; else the first one."""
    return second if second.frames_used > first.frames_used else first


def _pose_from_still(
    image: np.ndarray, camera: Camera, options: PoseOptions
) -> PoseEstimate:
    """The pose of a single image, begun from the direction of its edges."""
    (resized,), resized_camera = _resize([image], camera)
    edges = [find_edges(resized, resized_camera)]
    direction = find_edge_direction(edges, options.prior)
    estimate = _pose_from_direction(image, camera, direction, options)
    if estimate.frames_used:
        return estimate
    expected = _pose_from_direction(image, camera, options.prior, options)
    estimate = _with_more_lanes(estimate, expected)
    if estimate.frames_used or options.prior is not AHEAD:
        return estimate

    # a camera that looks far up, down or aside
    wide = _find_wide_direction(edges)
    if wide is None:
        return estimate
    aside = _pose_from_direction(image, camera, wide, options)
    return _with_more_lanes(estimate, aside)


def _pose_from_direction(
    image: np.ndarray, camera: Camera, direction: Direction, options: PoseOptions
) -> PoseEstimate:
    """The pose of the most probable lane in an image, searched near a `direction`.

    If the lane width is given it is that at the height at which the lane has this
    width, unless the height is given.
    """
    log_std = 0.0 if options.height_m else PRIOR_HEIGHT_LOG_STD
    start = camera.with_pose(options.start_pose(direction))
    if options.prior is AHEAD:
        # the pose of no drive is known
        start = replace(start, pose_std=PoseStd(log_std, PRIOR_ROLL_STD_RAD))
    still = detect_with_own_pose(
        image, start, log_std, options.settings, markings=options.markings
    )
    lane_width_m = None
    if options.is_width_given and log_std and still.lane:
        lane_width_m = options.lane_width_m
        posed = _scaled_to_width(still.camera, still.lane, lane_width_m)
        still = detect_with_own_pose(
            image, posed, 0.0, options.settings, markings=options.markings
        )
        log_std = _LANE_WIDTH_STD_M / lane_width_m

    used = int(still.confidence >= LIKELY_CONFIDENCE)
    known = direction if used else options.prior
    assumed = "the roll is" if lane_width_m else "height and roll are"
    note = f"{assumed} assumed, and the yaw contains the car's heading in its lane"
    return PoseEstimate(
        camera=still.camera,
        height_std_m=log_std * still.camera.require_pose().height_m,
        pitch_std_rad=known.pitch_std_rad,
        yaw_std_rad=known.yaw_std_rad,
        roll_std_rad=PRIOR_ROLL_STD_RAD,
        frames_used=used,
        frames_total=1,
        lane_width_m=lane_width_m,
        notes=(note,),
        still=still,
    )


def _scaled_to_width(camera: Camera, lane: Lane, lane_width_m: float) -> Camera:
    """The camera at the height at which the lane has the given width."""
    pose = camera.require_pose()
    height_m = pose.height_m * lane_width_m / lane.width_m
    height_m = float(np.clip(height_m, *HEIGHT_RANGE_M))
    return camera.with_pose(replace(pose, height_m=height_m))


def estimate_in_drive(
    image: np.ndarray,
    camera: Camera,
    drive: PoseEstimate,
    settings: DetectorSettings,
    *,
    markings: Markings | None = None,
) -> PoseEstimate:
    """The pose of a single image of a drive whose pose was estimated.

    A fixed camera has one height and one roll: those of the drive, if it determines
    them, are kept. Pitch and yaw may move around those of the drive. Errors are those
    of `estimate_pose`.
    """
    options = PoseOptions(
        lane_width_m=LANE_WIDTH_M,
        is_width_given=False,
        height_m=drive.known_height_m,
        markings=markings,
        settings=settings,
    )
    if drive.state == ESTIMATED:
        expected = Direction(
            pitch_rad=drive.pose.pitch_rad,
            pitch_std_rad=_MOVED_PITCH_STD_RAD,
            yaw_rad=drive.pose.yaw_rad,
            yaw_std_rad=_MOVED_YAW_STD_RAD,
        )
        options = replace(options, roll_rad=drive.pose.roll_rad, prior=expected)
    own = _pose_from_still(require_rgb(image), camera, options)
    if options.height_m is None:
        return own
    return replace(
        own,
        height_std_m=drive.height_std_m,
        roll_std_rad=drive.roll_std_rad,
        lane_width_m=drive.lane_width_m,
    )


def detect_in_drive(
    image: np.ndarray,
    camera: Camera,
    drive: PoseEstimate | None,
    markings: Markings | None = None,
    settings: DetectorSettings = DETECTOR,
) -> tuple[StillDetection, PoseEstimate | None]:
    """The detection in an image of a drive, and the pose estimate it was made with.

    `drive` is the estimate that `ensure_pose` returned with the camera; None if the
    pose is known. If it shows no sure lane, the pose of the image alone is tried, too,
    and the more probable lane is taken. Errors are those of `find_lane`.
    """
    if drive is None:
        return detect_still(image, camera, settings, markings=markings), None
    if drive.still:
        return drive.still, drive

    found = detect_still(image, camera, settings, markings=markings)
    if found.lane:
        shift = found.lane.confidence_shift + drive.confidence_shift
        found = replace(found, lane=replace(found.lane, confidence_shift=shift))
    if found.confidence >= SURE_CONFIDENCE and drive.state == ESTIMATED:
        return found, drive

    with suppress(CameraError):
        own = estimate_pose(
            image,
            camera,
            height_m=drive.given_height_m,
            markings=markings,
            settings=settings,
        )
        if own.still and own.still.confidence > found.confidence:
            return own.still, own
    return found, drive


def ensure_pose(
    camera: Camera, source: Any, **options: Any
) -> tuple[Camera, PoseEstimate | None]:
    """The camera with a pose: its own, or that of `estimate_pose`; the estimate is None
    if the camera had a pose.
    """
    if camera.pose is not None:
        return camera, None
    estimate = estimate_pose(source, camera, **options)
    return estimate.camera, estimate


def _list_images(source: Any) -> tuple[Sequence[Path], Iterator[np.ndarray]]:
    """The files of a source of `estimate_pose`, or its images."""
    if isinstance(source, np.ndarray):
        return [], iter([source])
    if isinstance(source, str | Path) or not isinstance(source, Iterable):
        return find_sources(list_paths(source)).files, iter(())
    items = iter(source)
    first = list(islice(items, 1))
    items = chain(first, items)
    if not first or isinstance(first[0], np.ndarray):
        return [], items
    return find_sources(list_paths(items)).files, iter(())


def _resize(
    images: Iterable[np.ndarray], camera: Camera
) -> tuple[list[np.ndarray], Camera]:
    """Images and camera at a width of `_WIDTH_PX`."""
    height_px = round(camera.height * _WIDTH_PX / camera.width)
    resized_camera = camera.scaled((_WIDTH_PX, height_px))
    interpolation = cv2.INTER_LINEAR
    if camera.width > _WIDTH_PX:
        interpolation = cv2.INTER_AREA
    resized = []
    for number, image in enumerate(images, 1):
        image = camera.require_size(image, f"picture {number}")
        if camera.size != resized_camera.size:
            image = cv2.resize(image, resized_camera.size, interpolation=interpolation)
        resized.append(image)
    return resized, resized_camera


def _pose_from_lanes(
    images: list[np.ndarray],
    first: list[np.ndarray],
    camera: Camera,
    direction: Direction,
    options: PoseOptions,
    progress: Progress | None,
) -> PoseEstimate:
    """The pose of several images, begun from a direction and the `first` of them.

    It is the median of what the lanes in them show, twice, the second time from the
    first.
    """
    total = len(first) + 2 * len(images)
    searched = 0

    def counted(some: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
        nonlocal searched
        for image in some:
            yield image
            searched += 1
            if progress:
                progress(searched, total)

    start_camera = camera.with_pose(options.start_pose(direction))
    start, others = first_pose(counted(first), start_camera, options)
    pose = start
    for _ in range(2):
        camera = camera.with_pose(pose)
        shown = []
        for image in counted(images):
            still = detect_still(
                image, camera, options.settings, markings=options.markings
            )
            shown.append(pose_shown_by(still, options.lane_width_m))
        table = as_table(shown)
        pose = median_pose(table, start, options.height_m)
    return _summarise(table, camera, others, options)


def _summarise(
    shown: np.ndarray, camera: Camera, others: OtherPoses, options: PoseOptions
) -> PoseEstimate:
    """The estimate with its standard deviations, from what lanes have `shown`.

    These are the lanes (images,) of the last pass, with the pose of `camera`.
    """
    pose = camera.require_pose()
    total = len(shown)
    used = int(np.isfinite(shown["log_height"]).sum())

    # the height, by the lane width
    has_edges = 2 * np.nansum(shown["edge"]) > used
    width_std_m = _EDGE_WIDTH_STD_M if has_edges else _LANE_WIDTH_STD_M
    of_lanes = std_of_median(shown["log_height"], _LANE_LOG_STD)
    of_width = width_std_m / options.lane_width_m
    log_std = float(np.linalg.norm([of_lanes, of_width, others.log_height_std]))
    is_undecided = not options.height_m and log_std > PRIOR_HEIGHT_LOG_STD
    lane_width_m = options.lane_width_m
    if options.height_m:
        shown_log = weighted_median(
            shown["log_height"], shown["confidence"], np.log(options.height_m)
        )
        lane_width_m = lane_width_m * (options.height_m / float(np.exp(shown_log)))

    has_few = used < max(1, _FEW_LANES * total)
    is_doubtful = has_few or is_undecided
    if is_doubtful:
        log_std = max(log_std, PRIOR_HEIGHT_LOG_STD)

    # pitch, yaw and roll
    pitch_std_rad = AHEAD.pitch_std_rad
    yaw_std_rad = AHEAD.yaw_std_rad
    if used:
        # with a doubtful pose, the images without a likely lane speak for any other
        # direction
        unseen = np.sqrt((1 - used / total) * is_doubtful)
        of_pitch = std_of_median(shown["pitch_rad"], _CAR_PITCH_STD_RAD)
        of_yaw = std_of_median(shown["yaw_rad"], _CAR_HEADING_STD_RAD)
        pitch_std_rad = float(np.hypot(of_pitch, unseen * pitch_std_rad))
        yaw_std_rad = float(np.hypot(of_yaw, unseen * yaw_std_rad))
    of_roll = std_of_median(shown["roll_rad"], PRIOR_ROLL_STD_RAD)
    is_roll_known = bool(pose.roll_rad or np.isfinite(shown["roll_rad"]).any())

    other_height_m = others.height_m if is_undecided else None
    notes = list(
        _notes(used, total, other_height_m, few=has_few, roll_known=is_roll_known)
    )
    if has_few and not camera.calibrated:
        notes[0] += f"; if they show them, try another field of view ({OTHER_VIEWS})"
    return PoseEstimate(
        camera=camera,
        height_std_m=0.0 if options.height_m else log_std * pose.height_m,
        pitch_std_rad=pitch_std_rad,
        yaw_std_rad=yaw_std_rad,
        roll_std_rad=float(np.hypot(of_roll, others.roll_std_rad)),
        frames_used=used,
        frames_total=total,
        lane_width_m=None if is_doubtful else lane_width_m,
        notes=tuple(notes),
        confidence_shift=(
            0.0 if options.height_m else others.share * WEIGHTS["other lanes"]
        ),
    )


def _notes(
    used: int, total: int, other_height_m: float | None, *, few: bool, roll_known: bool
) -> Iterator[str]:
    """What the images do not determine, most important first."""
    if few:
        yield (
            f"only {used} of {total} pictures show a likely lane between two lines "
            "with this pose; give pictures of a marked road by day, with the lines of "
            "the ego lane in view"
        )
    elif other_height_m:
        yield (
            f"the pictures allow a height of {other_height_m:.1f} m, too, at which "
            "other lines are those of the ego lane; give the height"
        )
    if not roll_known:
        yield (
            "no line beyond the ego lane is visible well enough to determine the roll; "
            "it is set to 0"
        )
    if used < 5:
        yield (
            "the yaw contains the car's heading in its lane, which averages to zero "
            "only over many pictures"
        )
