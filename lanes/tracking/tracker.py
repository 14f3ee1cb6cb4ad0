"""The lane over time: a state machine around the Kalman filter.

    view -> evidence -> search, if due
    -> predict -> measure -> update -> compare -> Lane

While the lane is tracked, the search without memory runs once in a while as a
challenger, so that a wrong lane does not stay. The estimate of a frame uses that frame
and all earlier ones. It is not smoothed, so that it follows the beginning of a bend
without delay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lanes.camera.model import Camera, require_camera
from lanes.car import TrackedCar
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LIKELY_CONFIDENCE, SURE_CONFIDENCE
from lanes.detect.evidence import Evidence, find_evidence
from lanes.detect.fit import Fit
from lanes.detect.lane import (
    COASTING,
    FROZEN,
    SEARCHING,
    TRACKING,
    Lane,
    LineEvidence,
    stated,
)
from lanes.detect.markings import Markings
from lanes.detect.road import (
    CENTRE,
    LEFT_SIDE,
    RIGHT_SIDE,
    WIDTH,
    lateral_gradients,
    lateral_std_m,
)
from lanes.detect.search import (
    DetectorSettings,
    Search,
    StillDetection,
    clear_share,
    inner_stripe_shift,
    lane_score,
    observe_lines,
    search_lane,
)
from lanes.errors import LaneError, require_number, require_type
from lanes.telemetry import LOST
from lanes.tracking.departure import DepartureWatch
from lanes.tracking.drive_width import DriveWidth
from lanes.tracking.far_lines import FarLines
from lanes.tracking.filter import (
    CAMERA_YAW,
    MAX_SPEED_MPS,
    SPEED,
    FilterSettings,
    State,
    car_motion,
    initial_state,
    measure,
    predict,
    seen_along_the_car,
    to_adjacent_lane,
    update,
    without_wrong_yaw,
)
from lanes.tracking.repeated import RepeatedImages
from lanes.tracking.static_pattern import StaticPattern
from lanes.tracking.turned_camera import TurnedCamera

# By the parameters of a lane: lateral positions of its lines 5, 20 and 35 m ahead.
LATERAL_IN_VIEW = lateral_gradients(np.array([5.0, 20.0, 35.0]))
# Margin of the narrowest view around these positions.
VIEW_MARGIN_M = 0.8
# The car is in the adjacent lane when its middle is so far beyond the line: a
# hysteresis, so that the lane does not change back and forth.
BEYOND_LINE_M = 0.1
# Two lanes are the same one if their lines differ by less than three standard
# deviations at these distances. The limit is at least and at most these lengths.
COMPARED_AT_M = np.array([6.0, 12.0, 20.0])
SAME_LINE_STDS = 3.0
SAME_LINE_M = (0.15, 0.3)
# An image that is repeated for longer is no copied frame: the picture stands still.
FROZEN_S = 0.5
# Time without a likely lane after which searches become rarer.
FULL_RATE_S = 5.0


@dataclass(frozen=True)
class TrackerSettings:
    """Detector, filter, and the state machine.

    It was tuned on the rendered suite where no source is given.
    """

    detector: DetectorSettings = field(default_factory=DetectorSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    # Smallest score (sum of the square roots of both lines' supports) of a detection
    # that starts a track. While a track has less, every frame is searched.
    min_score: float = 0.45
    # Detections that confirm a track. It is given up after the same number of searches
    # in a row that found another lane with a score that is larger by a margin.
    confirmations: int = 3
    challenger_margin: float = 0.1
    # The lane is not seen if its lines have together less than the support that each
    # needs to be seen. A track is given up after `max_coast_s` without a seen lane, or
    # earlier if a line has a larger standard deviation 15 m ahead.
    max_coast_s: float = 1.0
    max_std_m: float = 0.4
    # Periods of searches while a sure lane is tracked, and, with the network,
    # otherwise; while none is seen, each frame is searched with the band filter. The
    # third is for lanes looked for with a camera pose of their own.
    search_period_s: float = 1.0
    start_period_s: float = 0.2
    pose_period_s: float = 0.5
    # After 5 s without a likely lane the second and the third grow with this time, to
    # at most this number of times, and no frame in between is searched.
    slowest: float = 4.0
    # Half widths of the views while tracking: the narrowest is used that contains both
    # lines 5, 20 and 35 m ahead. The search uses the second one.
    half_widths_m: tuple[float, ...] = (4.5, 9.0, 13.0)
    # Shortest time between samples of what never moves in the image.
    static_period_s: float = 0.5


class SearchSchedule:
    """When to search without memory, and when to look for another camera pose.

    Times are counted in seconds, because frame rates differ and frames are dropped.
    """

    def __init__(self, settings: TrackerSettings, fps: float) -> None:
        self._settings = settings
        # half a frame earlier, so that rounding does not skip one
        self._early_s = 0.5 / fps
        self._since_search_s = settings.search_period_s
        self._since_pose_s = settings.pose_period_s
        self._unlikely_s = 0.0

    @property
    def slowdown(self) -> float:
        """Factor of the periods, because no likely lane was seen for some time."""
        factor = self._unlikely_s / FULL_RATE_S
        return min(max(factor, 1.0), self._settings.slowest)

    def advance(self, elapsed_s: float) -> None:
        """Begin a frame."""
        self._since_search_s += elapsed_s

    def is_search_due(self, *, sure: bool) -> bool:
        """Whether the period of searches is over, of a `sure` lane or another one."""
        period_s = self.slowdown * self._settings.start_period_s
        if sure:
            period_s = self._settings.search_period_s
        return self._since_search_s >= period_s - self._early_s

    def searched(self) -> None:
        """A search is made in this frame."""
        self._since_search_s = 0.0

    def search_next(self) -> None:
        """The next frame is searched."""
        self._since_search_s = self._settings.search_period_s

    def end_frame(self, elapsed_s: float, *, likely: bool) -> None:
        """End a frame, whose lane is `likely` or not."""
        self._since_pose_s += elapsed_s
        self._unlikely_s = 0.0 if likely else self._unlikely_s + elapsed_s

    def is_pose_due(self) -> bool:
        """Whether another camera pose may be looked for."""
        return self._since_pose_s >= self.slowdown * self._settings.pose_period_s

    def pose_tried(self) -> None:
        """Another pose is looked for in this frame."""
        self._since_pose_s = 0.0


class Due(NamedTuple):
    """What is due in a frame: a search, and the network in its evidence."""

    search: bool
    network: bool


@dataclass(frozen=True, eq=False)
class Track:
    """A lane that is followed: its estimate, the lane of the last frame, and counts."""

    estimate: State
    lane: Lane
    departure: DepartureWatch
    far: FarLines = FarLines()
    # Searches that found the lane.
    confirmed: int = 1
    # Last searches in a row that found another, better lane.
    lost_comparisons: int = 0
    # Frames since the start.
    frames: int = 0
    # Frames with a seen lane since it coasts.
    regained: int = 0
    # Time since the lane was seen.
    unseen_s: float = 0.0


class LaneTracker:
    """Tracks the lane through consecutive images of one camera.

    >>> tracker = LaneTracker(camera, fps=25)  # doctest: +SKIP
    >>> lane = tracker.update(image)  # doctest: +SKIP

    Parameters
    ----------
    camera : Camera
        With its pose.
    fps : float
        Frames per second.
    speed_mps : float, optional
        Speed of the car; estimated if not given. Assign `tracker.speed_mps` when it
        changes.
    find_pose : callable, optional
        Looks for the lane and the camera pose in one image; for a camera whose pose was
        estimated or changes. While no lane is likely it is called twice a second, and
        the tracker goes on with the pose of a lane that is more likely.
    settings : TrackerSettings
    markings : callable, optional, as for `lanes.find_lane`
    confidence_shift : float
        Added to the log odds of all lanes that are found with the pose of `camera`, if
        that is doubtful.
    lane_width_m : float, optional
        Width of the drive's lanes, if the pose was estimated with it.

    Attributes
    ----------
    evidence : Evidence or None
        What the last image showed.
    search : Search or None
        The search in the last image, None if none was due.
    prediction : State or None
        What the filter predicted for the last image, None if the lane is lost or was
        found by `search`.
    fit : Fit or None
        The fit to the last image with the prediction as prior, None without prediction.

    Raises
    ------
    LaneError
        If `fps` is not a positive number.
    CameraError
        If the camera has no pose.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        fps: float = 25.0,
        speed_mps: float | None = None,
        find_pose: Callable[[np.ndarray], StillDetection | None] | None = None,
        settings: TrackerSettings | None = None,
        markings: Markings | None = None,
        confidence_shift: float = 0.0,
        lane_width_m: float | None = None,
    ) -> None:
        self.fps = require_number(fps, "fps", positive=True)
        self.speed_mps = None
        if speed_mps is not None:
            self.speed_mps = require_number(speed_mps, "speed_mps")
            if not 0 <= self.speed_mps <= MAX_SPEED_MPS:
                raise LaneError(
                    f"speed_mps must be from 0 to {MAX_SPEED_MPS:g}; got {speed_mps!r}."
                )
        if settings is None:
            settings = TrackerSettings()
        self.settings = require_type(settings, TrackerSettings, "settings")
        self.find_pose = find_pose
        self.markings = markings
        self._confidence_shift = confidence_shift
        self._first_width = DriveWidth()
        if lane_width_m is not None:
            self._first_width = DriveWidth.of_pose(lane_width_m)
        self._use(require_camera(camera))
        self.reset()

    @property
    def camera(self) -> Camera:
        """The camera with the pose that the lane was found with."""
        return self.view.camera

    @property
    def lane(self) -> Lane | None:
        """The lane in the last image, as `update` returned it."""
        return stated(self.tracked_lane)

    @property
    def tracked_lane(self) -> Lane | None:
        """The lane that is followed, also with a confidence too low to state it."""
        return self._track.lane if self._track else None

    @property
    def track_frames(self) -> int:
        """Number of frames since the track of this lane began; 0 without one."""
        return self._track.frames if self._track else 0

    def _use(self, camera: Camera) -> None:
        """Begin with another pose of the camera."""
        camera.require_pose()
        near_m = self.settings.detector.near_m
        views = [
            BirdsEyeView.from_image_border(camera, near_m, half_width_m=half_width_m)
            for half_width_m in self.settings.half_widths_m
        ]
        self._views = tuple(views)
        self.view = views[min(1, len(views) - 1)]
        self._turned = TurnedCamera()
        self.evidence: Evidence | None = None
        self.search: Search | None = None

    def reset(self) -> None:
        """Forget everything, as between two drives."""
        period_s = self.settings.static_period_s
        self._static = StaticPattern(self._views[-1], period_s)
        self._lane_moves = False
        self._width = self._first_width
        self._images = RepeatedImages()
        # time that an image was repeated, and that was not predicted
        self._repeated_s = 0.0
        self._unpredicted_s = 0.0
        self._begin_search()

    def _begin_search(self) -> None:
        """Search at the full rate; what never moves in the images is still known."""
        self._schedule = SearchSchedule(self.settings, self.fps)
        self._forget_lane()

    def _forget_lane(self) -> None:
        """Search from scratch; what never moves in the images is still known."""
        self._track: Track | None = None
        self.prediction: State | None = None
        self.fit: Fit | None = None
        self._schedule.search_next()

    def __repr__(self) -> str:
        state = self.lane.state if self.lane else LOST
        size = f"{self.camera.width}x{self.camera.height}"
        return f"LaneTracker({size} px, {self.fps:g} frames a second, {state})"

    def update(
        self, image: np.ndarray | str | Path, *, elapsed_s: float | None = None
    ) -> Lane | None:
        """Process the next image.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8, or path
            RGB, raw.
        elapsed_s : float, optional
            Time since the previous image, if it is not 1 / fps (dropped frames). The
            tracker starts again if it is longer than `settings.max_coast_s` or
            negative.

        Returns
        -------
        Lane or None
            None while no lane is known, or only one with a confidence below 0.15. An
            image that repeats the last one is no measurement: the lane is that of the
            last one, and after half a second it is predicted.

        Raises
        ------
        PictureError
            If the image is not RGB or not of the camera's size.
        LaneError
            If `elapsed_s` is not a number, or `markings` returns no mask.
        """
        image = self.camera.require_size(image)
        elapsed_s = self._time_to_predict(elapsed_s)
        if self._is_repeated(image, elapsed_s - self._unpredicted_s):
            self._wait(elapsed_s)
            return self.lane

        self._unpredicted_s = self._repeated_s = 0.0
        elapsed_s = self._begin_frame(elapsed_s)
        due = self._plan_frame()
        evidence = self._find_evidence(image, due)
        self.evidence, challenger = self._search_evidence(evidence, due, elapsed_s)
        if self._track:
            self._keep(self._follow(self._track, self.evidence, elapsed_s))
        if due.search:
            self._track = self._compare(self._track, challenger)
        self._learn_width(elapsed_s)
        self._turn_with_camera(elapsed_s)
        self._try_other_pose(image, elapsed_s)
        return self.lane

    def _time_to_predict(self, elapsed_s: float | None) -> float:
        """Time since the last frame that the track was predicted for."""
        if elapsed_s is None:
            elapsed_s = 1 / self.fps
        elapsed_s = require_number(elapsed_s, "elapsed_s", finite=False)
        return self._unpredicted_s + elapsed_s

    def _is_repeated(self, image: np.ndarray, elapsed_s: float) -> bool:
        """Whether the image is no measurement, because it equals the last one.

        Of a lane that is not seen it is one, except where the picture stands still.
        """
        stands_still = self._repeated_s != 0
        is_equal = self._images.repeats(image, elapsed_s)
        return is_equal and (stands_still or self._sees_lane())

    def _wait(self, elapsed_s: float) -> None:
        """Pass over a repeated image.

        A copied frame adds nothing to a lane that it shows. Where the picture stands
        still, the lane is predicted, until it is too uncertain.
        """
        self._repeated_s += elapsed_s - self._unpredicted_s
        self._unpredicted_s = elapsed_s
        if not self._repeated_s > FROZEN_S:
            return
        self._unpredicted_s = 0.0
        elapsed_s = self._begin_frame(elapsed_s)
        if self._track:
            self._keep(self._predict_only(self._track, elapsed_s))

    def _predict_only(self, track: Track, elapsed_s: float) -> Track | None:
        """The track after some time without a measurement; None if it is given up."""
        settings = self.settings.filter
        estimate = predict(
            track.estimate, elapsed_s, settings, speed_mps=self.speed_mps
        )
        std_m = lateral_std_m(estimate.lane_covariance, 15.0).max()
        if std_m > self.settings.max_std_m:
            return None
        moved_m = float(estimate.mean[SPEED]) * elapsed_s
        lines = _unseen_lines(track.lane.evidence, moved_m)
        lane = replace(track.lane, state=FROZEN, evidence=lines)
        lane = self._describe(lane, estimate, track.departure, elapsed_s)
        return replace(track, estimate=estimate, lane=lane, regained=0)

    def _begin_frame(self, elapsed_s: float) -> float:
        """Time since the previous frame; a gap too long to bridge ends the track."""
        if not 0 <= elapsed_s <= self.settings.max_coast_s:
            self._forget_lane()
            # NaN and a clock that was set back must not stop the periods:
            # max(0.0, nan) is 0.0
            elapsed_s = max(0.0, elapsed_s)
        self.search = None
        self._schedule.advance(elapsed_s)
        return elapsed_s

    def _plan_frame(self) -> Due:
        """What is due in this frame."""
        is_seen = self._is_seen()
        is_sure = is_seen and self._confidence() >= SURE_CONFIDENCE
        is_due = self._schedule.is_search_due(sure=is_sure)
        if is_due:
            self._schedule.searched()
        is_lost = not is_seen and self._schedule.slowdown == 1.0
        return Due(search=is_due or is_lost, network=is_due and not is_sure)

    def _keep(self, track: Track | None) -> None:
        """Go on with a track; without one, search from scratch."""
        self._track = track
        if track is None:
            self._forget_lane()

    def _confidence(self) -> float:
        """Confidence of the lane that is followed; 0 without one."""
        return self.tracked_lane.confidence if self.tracked_lane else 0.0

    def _is_seen(self) -> bool:
        """Whether the track saw its lane in the last frame, and won all comparisons."""
        track = self._track
        if track is None or track.lane.state != TRACKING or track.lost_comparisons:
            return False
        return track.lane.score >= self.settings.min_score

    def _sees_lane(self) -> bool:
        """Whether there is a track, and it saw its lane in the last frame."""
        return self._track is not None and not self._track.unseen_s

    def _find_evidence(self, image: np.ndarray, due: Due) -> Evidence:
        """The evidence in the narrowest view; in a wide one for a search."""
        least = self.view if due.search else self._views[0]
        evidence = find_evidence(
            image,
            self._narrowest_view(self.tracked_lane, least),
            self.settings.detector.paint,
            markings=self.markings,
            quick=not due.network,
        )
        shift = evidence.confidence_shift + self._confidence_shift
        return replace(evidence, confidence_shift=shift)

    def _search_evidence(
        self, evidence: Evidence, due: Due, elapsed_s: float
    ) -> tuple[Evidence, Lane | None]:
        """The evidence that counts, and the lane of the search, if one is due.

        What never moves does not count, if the lane is found without it.
        """
        is_static, is_sample = self._static.update(
            evidence.stripes, evidence.view, elapsed_s
        )
        if is_static.any():
            found = None
            moving = replace(evidence, stripes=evidence.stripes.select(~is_static))
            if due.search or (is_sample and not self._lane_moves):
                found = self._search(moving)
                self._judge_static(found)
            if self._lane_moves:
                return moving, found
        return evidence, self._search(evidence) if due.search else None

    def _judge_static(self, moving: Lane | None) -> None:
        """Decide whether what never moves is left out, by the lane found without it.

        On a straight road without any sway, as in some simulators, solid lines do not
        move either. Nothing is left out unless a search finds a lane that moves.
        """
        known = self.tracked_lane
        if moving is None or moving.score < self.settings.min_score:
            if known is None:
                self._lane_moves = False
            return
        is_other = known is not None and not _is_same_lane(moving, known)
        if is_other and not self._lane_moves:
            # the track began on the stripes that never move
            self._track = self._start(moving)
        self._lane_moves = True

    def _learn_width(self, elapsed_s: float) -> None:
        """Learn the width of the drive from a tracked lane whose lines are seen."""
        lane = self.tracked_lane
        # a track that began in this frame was not seen since the previous one
        is_new = self._track is None or not self._track.frames
        if lane is None or lane.state != TRACKING or is_new:
            return
        if all(line.seen for line in lane.evidence):
            weight_s = lane.confidence * elapsed_s
            self._width = self._width.after(lane.width_m, weight_s)

    def _turn_with_camera(self, elapsed_s: float) -> None:
        """Go on with another yaw of the camera if it was turned, and stays so.

        The track goes on, too: its lane is seen from another direction.
        """
        track = self._track
        if track is None or track.unseen_s or track.lane.state != TRACKING:
            return
        estimate = track.estimate
        yaw_rad = float(estimate.mean[CAMERA_YAW])
        std_rad = float(np.sqrt(estimate.covariance[CAMERA_YAW, CAMERA_YAW]))
        self._turned = self._turned.after(yaw_rad, std_rad, elapsed_s)
        if not self._turned.lasts:
            return

        pose = self.camera.require_pose()
        turned = replace(pose, yaw_rad=pose.yaw_rad - yaw_rad)
        evidence = self.evidence
        search = self.search
        self._use(self.camera.with_pose(turned))
        self._static = self._static.seen_in(self._views[-1])
        self.evidence = evidence
        self.search = search
        estimate = seen_along_the_car(estimate)
        lane = replace(track.lane, camera=self.camera)
        lane = self._describe(lane, estimate, track.departure, 0.0)
        self._track = replace(track, estimate=estimate, lane=lane)

    def _try_other_pose(self, image: np.ndarray, elapsed_s: float) -> None:
        """While no lane is likely, look for one with a camera pose from this image.

        If it is likely, the tracker goes on with its pose.
        """
        confidence = self._confidence()
        is_likely = confidence >= LIKELY_CONFIDENCE
        self._schedule.end_frame(elapsed_s, likely=is_likely)
        if self.find_pose is None or is_likely or not self._schedule.is_pose_due():
            return

        still = self.find_pose(image)
        self._schedule.pose_tried()
        if still is None or still.lane is None:
            return
        # for the track the pose is known, so that an odd width counts in full
        as_tracked = self._of_drive(still.lane.with_known_pose())
        least = min(still.confidence, as_tracked.confidence)
        if least <= max(confidence, LIKELY_CONFIDENCE):
            return
        self._use(still.camera)
        self._static = self._static.seen_in(self._views[-1])
        self._begin_search()
        self._schedule.pose_tried()
        self._confidence_shift = 0.0
        self.evidence = still.evidence
        self.search = still.search
        self._track = self._start(still.lane)

    def _follow(
        self, track: Track, evidence: Evidence, elapsed_s: float
    ) -> Track | None:
        """The track in the next frame.

        It coasts if the lane is not seen, and is given up (None) after some time.
        """
        # predict, measure, update
        s = self.settings
        predicted = predict(
            track.estimate, elapsed_s, s.filter, speed_mps=self.speed_mps
        )
        fit = measure(evidence.stripes, predicted, evidence.view, s.detector.fit)
        self.prediction = predicted
        self.fit = fit
        estimate = update(predicted, fit.lanes[0], fit.covariance[0], s.filter)
        if self.speed_mps is None:
            estimate = without_wrong_yaw(estimate, s.filter)

        # what is seen of the lines
        track = replace(track, frames=track.frames + 1)
        moved_m = float(estimate.mean[SPEED]) * elapsed_s
        lines, is_seen = self._observe(track, fit, evidence, moved_m)
        far = track.far.moved(moved_m)
        estimate, lines, far = self._to_ego_lane(estimate, lines, far)

        state = self._next_state(track, estimate, elapsed_s, seen=is_seen)
        if state is None:
            return None
        # frames in a row with a seen lane, while it is not yet tracked again
        regained = 0
        if is_seen and state != TRACKING:
            regained = track.regained + (track.lane.state in (COASTING, FROZEN))
        lane = replace(
            track.lane,
            state=state,
            evidence=lines,
            far_evidence=far.stated,
            clear_share=clear_share(fit),
            confidence_shift=evidence.confidence_shift,
        )
        return replace(
            track,
            estimate=estimate,
            lane=self._describe(lane, estimate, track.departure, elapsed_s),
            far=far,
            regained=regained,
            unseen_s=0.0 if is_seen else track.unseen_s + elapsed_s,
        )

    def _next_state(
        self, track: Track, estimate: State, elapsed_s: float, *, seen: bool
    ) -> str | None:
        """The state of the lane in the next frame; None if the track is given up."""
        state = track.lane.state
        if state == FROZEN:
            state = COASTING
        if seen:
            regained = track.regained + (state == COASTING)
            return TRACKING if regained >= self.settings.confirmations else state
        if state == SEARCHING:
            return None
        is_long = track.unseen_s + elapsed_s > self.settings.max_coast_s
        std_m = lateral_std_m(estimate.lane_covariance, 15.0).max()
        is_certain = std_m <= self.settings.max_std_m
        return COASTING if is_certain and not is_long else None

    def _observe(
        self, track: Track, fit: Fit, evidence: Evidence, moved_m: float
    ) -> tuple[tuple[LineEvidence, LineEvidence], bool]:
        """What is seen of both lines in this frame, and whether the lane is seen.

        If not, they end where they did before, nearer by the distance driven.
        """
        last = track.lane.evidence
        # profiles seldom change: in ten frames that of each line is measured once
        profiles_of = {0: (0,), 5: (1,)}.get(track.frames % 10, ())
        lines = observe_lines(fit, evidence, last, profiles_of=profiles_of)
        support = sum(line.support for line in lines)
        if support >= 2 * self.settings.detector.fit.min_support:
            return lines, True

        return _unseen_lines(last, moved_m), False

    def _to_ego_lane(
        self,
        estimate: State,
        lines: tuple[LineEvidence, LineEvidence],
        far: FarLines,
    ) -> tuple[State, tuple[LineEvidence, LineEvidence], FarLines]:
        """The lane that the car's middle is in, whose lines may have new names.

        After it has crossed a line that is the adjacent lane. Its far lines are unknown
        until the next searches. Otherwise nothing changes.
        """
        centre_m = estimate.lane[CENTRE] + self.view.camera.offset_m
        if abs(centre_m) < estimate.lane[WIDTH] / 2 + BEYOND_LINE_M:
            return estimate, lines, far

        prior = self.settings.detector.fit.prior
        left, right = lines
        unknown = LineEvidence()
        if centre_m < 0:
            moved = to_adjacent_lane(estimate, LEFT_SIDE, prior)
            return moved, (unknown, left), FarLines()
        moved = to_adjacent_lane(estimate, RIGHT_SIDE, prior)
        return moved, (right, unknown), FarLines()

    def _compare(self, track: Track | None, challenger: Lane | None) -> Track | None:
        """The track after a search without memory found a lane.

        It is a new one with that lane if the lane is better.
        """
        s = self.settings
        if challenger is None or challenger.score < s.min_score:
            return track and replace(track, lost_comparisons=0)
        challenger = self._of_drive(challenger)
        if track is None:
            return self._start(challenger)

        lane = track.lane
        if _is_same_lane(challenger, lane):
            return self._confirm(track, challenger)
        is_better = challenger.score > lane.score + s.challenger_margin
        # before the width of the drive is known, a single search is no better judge
        is_judged = self._width.learnt is not None
        is_unlikely = lane.confidence < LIKELY_CONFIDENCE <= challenger.confidence
        is_likelier = is_judged and is_unlikely
        if lane.state == TRACKING and not (is_better or is_likelier):
            return replace(track, lost_comparisons=0)

        lost = track.lost_comparisons + 1
        is_surer = challenger.confidence > lane.confidence
        if lost >= s.confirmations or (lane.state == SEARCHING and is_surer):
            return self._start(challenger)
        return replace(track, lost_comparisons=lost)

    def _of_drive(self, lane: Lane) -> Lane:
        """A lane whose width is compared with that of the drive."""
        return replace(lane, usual_width=self._width.usual)

    def _confirm(self, track: Track, found: Lane) -> Track:
        """The track after a search found its lane."""
        confirmed = track.confirmed + 1
        is_enough = confirmed >= self.settings.confirmations
        is_sure = found.confidence >= SURE_CONFIDENCE or is_enough
        state = track.lane.state
        if is_sure and state == SEARCHING:
            state = TRACKING
        far = track.far.searched(found.far_evidence)
        lane = replace(track.lane, state=state, far_evidence=far.stated)
        return replace(
            track, lane=lane, far=far, confirmed=confirmed, lost_comparisons=0
        )

    def _start(self, found: Lane) -> Track:
        """A track that begins with a detected lane."""
        self._forget_lane()
        s = self.settings
        inflated = found.fit_covariance * s.detector.fit.variance_inflation
        estimate = initial_state(found.centres, inflated, self.speed_mps, s.filter)
        is_sure = found.confidence >= SURE_CONFIDENCE
        state = TRACKING if is_sure else SEARCHING
        far = FarLines().searched(found.far_evidence)
        lane = replace(found, state=state, far_evidence=far.stated)
        watch = DepartureWatch()
        lane = self._describe(lane, estimate, watch, 0.0)
        return Track(estimate=estimate, lane=lane, departure=watch, far=far)

    def _describe(
        self, lane: Lane, estimate: State, watch: DepartureWatch, elapsed_s: float
    ) -> Lane:
        """The lane with the numbers of the estimate.

        Double lines are bounded by their inner stripes. Single lines are not shifted:
        the filter estimates their centres better than one profile does.
        """
        left, right = lane.evidence
        shift = inner_stripe_shift(left.double_profile, right.double_profile)
        model = estimate.lane + shift
        motion = car_motion(estimate, self.settings.filter)
        departure = watch.update(model, motion, self.camera, elapsed_s)
        car = TrackedCar(float(estimate.mean[CAMERA_YAW]), motion, departure)
        described = replace(
            lane.with_known_pose(),
            model=model,
            centres=estimate.lane,
            fit_covariance=estimate.lane_covariance,
            score=lane_score(lane.evidence),
            usual_width=self._width.usual,
            car=car,
        )
        is_likely = described.confidence >= LIKELY_CONFIDENCE
        # an inferred line is not seen to come nearer
        is_seen = right.seen if departure.side == "right" else left.seen
        if lane.state != TRACKING or not is_likely or not is_seen:
            quiet = replace(car, departure=replace(departure, due=False))
            return replace(described, car=quiet)
        return described

    def _search(self, evidence: Evidence) -> Lane | None:
        """The lane found in the evidence without memory."""
        found = search_lane(evidence, self.settings.detector, self._width.learnt)
        self.search = found.search
        return found.lane

    def _narrowest_view(self, lane: Lane | None, least: BirdsEyeView) -> BirdsEyeView:
        """The narrowest view that contains both lines of a lane with a margin.

        It is not narrower than `least`.
        """
        reach_m = 0.0
        if lane:
            lateral_m = np.abs(LATERAL_IN_VIEW @ lane.model)
            reach_m = float(lateral_m.max()) + VIEW_MARGIN_M
        reach_m = max(reach_m, least.half_width_m)
        for view in self._views:
            if reach_m <= view.half_width_m:
                return view
        return self._views[-1]


def _unseen_lines(
    last: tuple[LineEvidence, LineEvidence], moved_m: float
) -> tuple[LineEvidence, LineEvidence]:
    """Both lines where they are not seen, after a distance driven."""
    unseen = []
    for line in last:
        reach_m = max(line.reach_m - moved_m, 0.0)
        unseen.append(replace(line, support=0.0, seen=False, reach_m=reach_m))
    return unseen[0], unseen[1]


def _is_same_lane(found: Lane, known: Lane) -> bool:
    """Whether both lines of a detected lane are those of the known one.

    They are if they differ by less than `SAME_LINE_STDS` of its standard deviations.
    """
    std_m = lateral_std_m(known.fit_covariance, COMPARED_AT_M)
    tolerance_m = np.clip(SAME_LINE_STDS * std_m, *SAME_LINE_M)
    found_m = found.lateral_m(COMPARED_AT_M)
    known_m = known.lateral_m(COMPARED_AT_M)
    # lines of a hairpin may turn back before these distances: NaN counts as the same
    is_apart = np.abs(found_m - known_m) > tolerance_m
    return not is_apart.any()
