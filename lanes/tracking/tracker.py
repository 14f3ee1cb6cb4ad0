"""The lane over time: a state machine around the Kalman filter.

    view -> evidence -> predict -> measure -> update -> search, if due -> Lane

While the lane is tracked, the search without memory runs once in a while as a challenger, so that a wrong lane does not
stay. The estimate of a frame uses that frame and all earlier ones. It is not smoothed, so that it follows the beginning
of a bend without delay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import exp
from pathlib import Path

import numpy as np

from lanes.camera.model import Camera, require_camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LIKELY_CONFIDENCE, SURE_CONFIDENCE
from lanes.detect.evidence import Evidence, Stripes, find_evidence
from lanes.detect.fit import Fit
from lanes.detect.lane import COASTING, LOST, SEARCHING, TRACKING, FarEvidence, Lane, LineEvidence
from lanes.detect.markings import Markings
from lanes.detect.road import CENTRE, LEFT_SIDE, RIGHT_SIDE, WIDTH, lateral_gradients, lateral_std_m
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
from lanes.tracking.departure import DepartureWatch
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
    to_adjacent_lane,
    update,
    without_wrong_yaw,
)

# By the parameters of a lane: lateral positions of its lines 5, 20 and 35 m ahead.
LATERAL_IN_VIEW = lateral_gradients(np.array([5.0, 20.0, 35.0]))


@dataclass(frozen=True)
class TrackerSettings:
    """Detector, filter, and the state machine, which was tuned on the rendered suite where no source is given."""

    detector: DetectorSettings = field(default_factory=DetectorSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    # Smallest score (sum of the square roots of both lines' supports) of a detection that starts a track. While a track
    # has less, every frame is searched. A track is confirmed after a number of detections, and given up
    # after the same number of searches in a row that found another lane with a score that is larger by a margin.
    min_score: float = 0.45
    confirmations: int = 3
    challenger_margin: float = 0.1
    # The lane is not seen if its lines have together less than the support that each needs to be seen. A track is given
    # up after `max_coast_s` without a seen lane, or earlier if a line has a larger standard deviation 15 m ahead.
    max_coast_s: float = 1.0
    max_std_m: float = 0.4
    # Periods of searches while a sure lane is tracked, and, with the network, otherwise; while none is seen, each frame
    # is searched with the band filter. The third is for lanes looked for with a camera pose of their own.
    search_period_s: float = 1.0
    start_period_s: float = 0.2
    pose_period_s: float = 0.5
    # After 5 s without a likely lane the second and the third grow with this time, to at most this number of times, and
    # no frame in between is searched.
    slowest: float = 4.0
    # Half widths of the views while tracking: the narrowest is used that contains both lines 5, 20 and 35 m ahead. The
    # search uses the second one.
    half_widths_m: tuple[float, ...] = (4.5, 9.0, 13.0)
    # Shortest time between samples of what never moves in the image.
    static_period_s: float = 0.5


@dataclass(frozen=True, eq=False)
class Track:
    """A lane that is followed: its estimate, the lane of the last frame, and what decides on its state."""

    estimate: State
    lane: Lane
    departure: DepartureWatch
    # Searches that found the lane, and the last ones in a row that found another, better one.
    confirmed: int
    lost_comparisons: int
    # Frames since the start; those with a seen lane since it coasts; time since the lane was seen.
    frames: int
    regained: int
    unseen_s: float


class LaneTracker:
    """Tracks the lane through consecutive images of one camera.

    >>> tracker = LaneTracker(camera, fps=25)                                         # doctest: +SKIP
    >>> lane = tracker.update(image)                                                  # doctest: +SKIP

    Parameters
    ----------
    camera : Camera
        With its pose.
    fps : float
        Frames per second.
    speed_mps : float, optional
        Speed of the car; estimated if not given. Assign `tracker.speed_mps` when it changes.
    find_pose : callable, optional
        Looks for the lane and the camera pose in one image; for a camera whose pose was estimated or changes. While no
        lane is likely it is called twice a second, and the tracker goes on with the pose of a lane that is more likely.
    settings : TrackerSettings
    markings : callable, optional, as for `lanes.find_lane`
    confidence_shift : float
        Added to the log odds of all lanes that are found with the pose of `camera`, if that is doubtful.

    Attributes
    ----------
    evidence : Evidence or None
        What the last image showed.
    search : Search or None
        The search in the last image, None if none was due.
    prediction : State or None
        What the filter predicted for the last image, None if the lane is lost or was found by `search`.
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
    ) -> None:
        self.fps = require_number(fps, "fps", positive=True)
        self.speed_mps = None if speed_mps is None else require_number(speed_mps, "speed_mps")
        if not 0 <= (self.speed_mps or 0) <= MAX_SPEED_MPS:
            raise LaneError(f"speed_mps must be from 0 to {MAX_SPEED_MPS:g}; got {speed_mps!r}.")
        self.settings = TrackerSettings() if settings is None else require_type(settings, TrackerSettings, "settings")
        self.find_pose, self.markings, self._confidence_shift = find_pose, markings, confidence_shift
        self._use(require_camera(camera))

    @property
    def camera(self) -> Camera:
        """The camera with the pose that the lane was found with."""
        return self.view.camera

    @property
    def lane(self) -> Lane | None:
        """The lane in the last image, as `update` returned it."""
        return self._track.lane if self._track else None

    def _use(self, camera: Camera) -> None:
        """Begin with another pose of the camera."""
        camera.require_pose()
        near_m, widths_m = self.settings.detector.near_m, self.settings.half_widths_m
        self._views = tuple(BirdsEyeView.from_image_border(camera, near_m, half_width_m=half) for half in widths_m)
        self.view = self._views[min(1, len(self._views) - 1)]
        self.evidence: Evidence | None = None
        self.search: Search | None = None
        self.reset()

    def reset(self) -> None:
        """Forget everything, as between two drives."""
        s = self.settings
        self._static, self._lane_moves = StaticPattern(self._views[-1], s.static_period_s), False
        self._since_pose_s, self._unlikely_s = s.pose_period_s, 0.0
        self._forget_lane()

    def _forget_lane(self) -> None:
        """Search from scratch; what never moves in the images of this camera is still known."""
        self._track: Track | None = None
        self.prediction: State | None = None
        self.fit: Fit | None = None
        self._since_search_s = self.settings.search_period_s

    def __repr__(self) -> str:
        state = self.lane.state if self.lane else LOST
        return f"LaneTracker({self.camera.width}x{self.camera.height} px, {self.fps:g} frames a second, {state})"

    def update(self, image: np.ndarray | str | Path, *, elapsed_s: float | None = None) -> Lane | None:
        """Process the next image.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8, or path
            RGB, raw.
        elapsed_s : float, optional
            Time since the previous image, if it is not 1 / fps (dropped frames). The tracker starts again if it is
            longer than `settings.max_coast_s` or negative.

        Returns
        -------
        Lane or None
            None while no lane is known.

        Raises
        ------
        PictureError
            If the image is not RGB or not of the camera's size.
        LaneError
            If `elapsed_s` is not a number, or `markings` returns no mask.
        """
        s, image = self.settings, self.view.camera.require_size(image)
        elapsed_s = 1 / self.fps if elapsed_s is None else require_number(elapsed_s, "elapsed_s", finite=False)
        if not 0 <= elapsed_s <= s.max_coast_s:
            self._forget_lane()
            # NaN and a clock that was set back must not stop the periods: max(0.0, nan) is 0.0
            elapsed_s = max(0.0, elapsed_s)
        self.search = None
        self._since_search_s += elapsed_s
        search, full = self._is_due()
        view = self._narrowest_view(self.lane, self.view if search else self._views[0])
        evidence = find_evidence(image, view, s.detector.paint, markings=self.markings, quick=not full)
        evidence = replace(evidence, confidence_shift=evidence.confidence_shift + self._confidence_shift)
        self.evidence, challenger = self._without_static(evidence, elapsed_s, search=search)
        if self._track:
            self._track = self._follow(self._track, self.evidence, elapsed_s)
            if self._track is None:
                self._forget_lane()
        if search:
            self._track = self._compare(self._track, challenger)
        self._try_other_pose(image, elapsed_s)
        return self.lane

    def _try_other_pose(self, image: np.ndarray, elapsed_s: float) -> None:
        """While no lane is likely, look for one with a camera pose from this image alone, and go on with its pose."""
        confidence = self.lane.confidence if self.lane else 0.0
        likely = confidence >= LIKELY_CONFIDENCE
        self._since_pose_s += elapsed_s
        self._unlikely_s = 0.0 if likely else self._unlikely_s + elapsed_s
        due = self._since_pose_s >= self._slower * self.settings.pose_period_s
        if self.find_pose is None or likely or not due:
            return
        still = self.find_pose(image)
        if still and still.lane:
            # for the track the pose is known, so that an odd width counts in full
            as_tracked = replace(still.lane, same_lane_share=None)
            if min(still.confidence, as_tracked.confidence) > max(confidence, LIKELY_CONFIDENCE):
                self._use(still.camera)
                self._confidence_shift = 0.0
                self.evidence, self.search = still.evidence, still.search
                self._track = self._start(still.lane)
        self._since_pose_s = 0.0

    @property
    def _slower(self) -> float:
        """How many times longer the periods are, because no likely lane was seen for some time."""
        return min(max(self._unlikely_s / 5.0, 1.0), self.settings.slowest)

    def _is_due(self) -> tuple[bool, bool]:
        """Whether to search this frame without memory, and whether with the network, too."""
        s, lane, lost = self.settings, self.lane, bool(self._track and self._track.lost_comparisons)
        seen = lane is not None and lane.state == TRACKING and lane.score >= s.min_score and not lost
        sure = seen and lane is not None and lane.confidence >= SURE_CONFIDENCE
        # half a frame earlier, so that rounding does not skip one
        due = self._since_search_s >= (s.search_period_s if sure else self._slower * s.start_period_s) - 0.5 / self.fps
        if due:
            self._since_search_s = 0.0
        return due or (not seen and self._slower == 1.0), due and not sure

    def _follow(self, track: Track, evidence: Evidence, elapsed_s: float) -> Track | None:
        """The track in the next frame: it coasts if the lane is not seen, and is given up (None) after some time."""
        s = self.settings
        predicted = predict(track.estimate, elapsed_s, s.filter, speed_mps=self.speed_mps)
        fit = measure(evidence.stripes, predicted, evidence.view, s.detector.fit)
        self.prediction, self.fit = predicted, fit
        estimate = update(predicted, fit.lanes[0], fit.covariance[0], s.filter)
        if self.speed_mps is None:
            estimate = without_wrong_yaw(estimate, s.filter)
        track = replace(track, frames=track.frames + 1)
        last, moved_m = track.lane, float(estimate.mean[SPEED]) * elapsed_s
        lines, seen = self._observe(track, fit, evidence, moved_m)
        # the views of most frames do not contain the far lines of the adjacent lanes: searches see them; in between
        # they end where the last search saw them end, and are dropped nearer than 12 m, where they leave the image
        nearer = [far and replace(far, reach_m=far.reach_m - moved_m) for far in last.far_evidence]
        far_left, far_right = (far if far and far.reach_m >= 12.0 else None for far in nearer)
        estimate, lines, far = self._to_ego_lane(estimate, lines, (far_left, far_right))
        state, regained, unseen_s = last.state, track.regained + (last.state == COASTING), 0.0
        if seen and regained >= s.confirmations:
            state, regained = TRACKING, 0
        elif not seen:
            unseen_s = track.unseen_s + elapsed_s
            certain = lateral_std_m(estimate.lane_covariance, 15.0).max() <= s.max_std_m
            if state == SEARCHING or unseen_s > s.max_coast_s or not certain:
                return None
            state, regained = COASTING, 0
        lane = replace(last, state=state, evidence=lines, far_evidence=far, clear_share=clear_share(fit))
        lane = replace(lane, confidence_shift=evidence.confidence_shift)
        lane = self._describe(lane, estimate, track.departure, elapsed_s)
        return replace(track, estimate=estimate, lane=lane, regained=regained, unseen_s=unseen_s)

    def _observe(
        self, track: Track, fit: Fit, evidence: Evidence, moved_m: float
    ) -> tuple[tuple[LineEvidence, LineEvidence], bool]:
        """What is seen of both lines in this frame, and whether the lane is seen.

        If not, they end where they did before, nearer by the distance driven.
        """
        last = track.lane.evidence
        # profiles seldom change: in ten frames that of each line is measured once, in turn
        profiles_of = {0: (0,), 5: (1,)}.get(track.frames % 10, ())
        lines = observe_lines(fit, evidence, last, profiles_of=profiles_of)
        if sum(line.support for line in lines) >= 2 * self.settings.detector.fit.min_support:
            return lines, True
        unseen = [replace(line, support=0.0, seen=False, reach_m=max(line.reach_m - moved_m, 0.0)) for line in last]
        return (unseen[0], unseen[1]), False

    def _to_ego_lane(
        self, estimate: State, lines: tuple[LineEvidence, LineEvidence], far: FarEvidence
    ) -> tuple[State, tuple[LineEvidence, LineEvidence], FarEvidence]:
        """After the car's centre has crossed a line: the adjacent lane, whose lines swap names; else unchanged.

        The far lines of the adjacent lane are unknown until the next search.
        """
        centre, width = estimate.lane[[CENTRE, WIDTH]]
        centre += self.view.camera.offset_m  # seen from the middle of the car
        # 0.1 m beyond the line, so that it does not change back and forth
        if abs(centre) < width / 2 + 0.1:
            return estimate, lines, far
        prior = self.settings.detector.fit.prior
        if centre < 0:
            return to_adjacent_lane(estimate, LEFT_SIDE, prior), (LineEvidence(), lines[0]), (None, None)
        return to_adjacent_lane(estimate, RIGHT_SIDE, prior), (lines[1], LineEvidence()), (None, None)

    def _compare(self, track: Track | None, challenger: Lane | None) -> Track | None:
        """The track after a search without memory found a lane, or a new one with that lane if it is better."""
        s = self.settings
        if challenger is None or challenger.score < s.min_score:
            return track and replace(track, lost_comparisons=0)
        if track is None:
            return self._start(challenger)
        lane = track.lane
        if self._is_same_lane(challenger, lane):
            confirmed = track.confirmed + 1
            sure = challenger.confidence >= SURE_CONFIDENCE or confirmed >= s.confirmations
            state = TRACKING if sure and lane.state == SEARCHING else lane.state
            lane = replace(lane, state=state, far_evidence=challenger.far_evidence)
            return replace(track, lane=lane, confirmed=confirmed, lost_comparisons=0)
        if lane.state == TRACKING and challenger.score <= lane.score + s.challenger_margin:
            return replace(track, lost_comparisons=0)
        better = lane.state == SEARCHING and challenger.confidence > lane.confidence
        if better or track.lost_comparisons + 1 >= s.confirmations:
            return self._start(challenger)
        return replace(track, lost_comparisons=track.lost_comparisons + 1)

    def _start(self, found: Lane) -> Track:
        """A track that begins with a detected lane."""
        self._forget_lane()
        inflated = found.fit_covariance * self.settings.detector.fit.variance_inflation
        estimate = initial_state(found.centres, inflated, self.speed_mps, self.settings.filter)
        state, watch = TRACKING if found.confidence >= SURE_CONFIDENCE else SEARCHING, DepartureWatch()
        lane = self._describe(replace(found, state=state), estimate, watch, 0.0)
        return Track(estimate, lane, watch, confirmed=1, lost_comparisons=0, frames=0, regained=0, unseen_s=0.0)

    def _describe(self, lane: Lane, estimate: State, watch: DepartureWatch, elapsed_s: float) -> Lane:
        """The lane with the numbers of the estimate; double lines are bounded by their inner stripes."""
        left, right = lane.evidence
        # single lines are not shifted: the filter estimates their centres better than one profile does
        model = estimate.lane + inner_stripe_shift(left.double_profile, right.double_profile)
        motion = car_motion(estimate, self.settings.filter)
        departure = watch.update(model, motion, self.camera, elapsed_s)
        described = replace(
            lane,
            model=model,
            centres=estimate.lane,
            fit_covariance=estimate.lane_covariance,
            score=lane_score(lane.evidence),
            same_lane_share=None,
            camera_yaw_rad=float(estimate.mean[CAMERA_YAW]),
            motion=motion,
            departure=departure,
        )
        if lane.state != TRACKING or described.confidence < LIKELY_CONFIDENCE:
            return replace(described, departure=replace(departure, due=False))
        return described

    def _without_static(self, evidence: Evidence, elapsed_s: float, *, search: bool) -> tuple[Evidence, Lane | None]:
        """The evidence without stripes that never move, and the lane that a `search` finds in it.

        Every `static_period_s` the evidence is a sample of what never moves. Nothing is left out unless a search finds
        a lane that moves: on a straight road without any sway, as in some simulators, solid lines do not move either.
        """
        static, sample = self._static.update(evidence.stripes, evidence.view, elapsed_s)
        if static.any():
            moving, lane = replace(evidence, stripes=evidence.stripes.select(~static)), None
            if search or (sample and not self._lane_moves):
                lane = self._search(moving)
                if lane is not None and lane.score >= self.settings.min_score:
                    if not self._lane_moves and self.lane and not self._is_same_lane(lane, self.lane):
                        # the track began on the stripes that never move
                        self._track = self._start(lane)
                    self._lane_moves = True
                elif self.lane is None:
                    self._lane_moves = False
            if self._lane_moves:
                return moving, lane
        return evidence, self._search(evidence) if search else None

    def _search(self, evidence: Evidence) -> Lane | None:
        """The lane found in the evidence without memory."""
        found = search_lane(evidence, self.settings.detector)
        self.search = found.search
        return found.lane

    def _narrowest_view(self, lane: Lane | None, least: BirdsEyeView) -> BirdsEyeView:
        """The narrowest view that contains both lines of a lane with a margin of 0.8 m, not narrower than `least`."""
        reach_m = float(np.abs(LATERAL_IN_VIEW @ lane.model).max()) + 0.8 if lane else 0.0
        reach_m = max(reach_m, least.half_width_m)
        return next((view for view in self._views if reach_m <= view.half_width_m), self._views[-1])

    def _is_same_lane(self, found: Lane, known: Lane) -> bool:
        """Whether both lines of a detected lane are those of the known one.

        They are if they differ by less than three of its standard deviations 6, 12 and 20 m ahead. This limit is at
        least 0.15 m and at most 0.3 m.
        """
        at_m = np.array([6.0, 12.0, 20.0])
        tolerance_m = np.clip(3.0 * lateral_std_m(known.fit_covariance, at_m), 0.15, 0.3)
        # lines of a hairpin may turn back before these distances: NaN counts as the same
        return not (np.abs(found.lateral_m(at_m) - known.lateral_m(at_m)) > tolerance_m).any()


# A place of the image is static if it is occupied in this share of the samples; a smallest number of them is needed.
MIN_SHARE, MIN_SAMPLES = 0.7, 6.0
# Smallest share of occupied places that the previous sample did not have. While driving it is 0.4 to 1; if the car
# stands, everything is static, and the sample is left out.
MIN_MOVED = 0.3
# Width of a column, metres: stripes within 1 to 2 columns are at the same place.
COLUMN_M = 0.02


class StaticPattern:
    """Counts how often stripes lie at each place of a view, over samples of a drive, `period_s` apart.

    It finds what stays at the same place of the image while the car drives: guide lines and captions that the camera
    draws, stripes on the bonnet, reflections in the windscreen. Markings of the road move: cars sway in their lane and
    pitch, so that even a solid line on a straight road seldom stays within 3 cm for some seconds. On nine rendered
    drives and four of other cameras, at most 0.4 % of the stripes of the detected lines are called static.

    Places are the rows of the view, which is the widest one, and columns of `COLUMN_M`. A place also counts as occupied
    if one of its neighbours in the same row is.
    """

    def __init__(self, view: BirdsEyeView, period_s: float) -> None:
        self._left_m = view.y_m[0]
        self._period_s = self._since_sample_s = period_s
        shape = len(view.x_m), int(self._columns(view.y_m)[-1]) + 1
        self._counts = np.zeros(shape, np.float32)
        # samples that saw a column
        self._samples = np.zeros(shape[1])
        self._previous, self._previous_seen = np.zeros(shape, bool), slice(0, 0)

    def update(self, stripes: Stripes, view: BirdsEyeView, elapsed_s: float) -> tuple[np.ndarray, bool]:
        """Which stripes (N,) lie at places that are occupied in most samples, and whether they are a sample now."""
        row, column = stripes.row, self._columns(stripes.y_m)
        samples = self._samples[column]
        static = (samples >= MIN_SAMPLES) & (self._counts[row, column] >= MIN_SHARE * samples)
        self._since_sample_s += elapsed_s
        sampled = self._since_sample_s >= self._period_s
        if sampled:
            first, last = self._columns(view.y_m[[0, -1]])
            self._add(row, column, slice(first, last + 1))
            self._since_sample_s = 0.0
        return static, sampled

    def _columns(self, y_m: np.ndarray) -> np.ndarray:
        """Columns at lateral positions."""
        return np.round((self._left_m - y_m) / COLUMN_M).astype(int)

    def _add(self, row: np.ndarray, column: np.ndarray, seen: slice) -> None:
        """Count a sample with occupied places (N,), which sees the columns `seen`.

        It does not count if it shows nearly the same places as the sample before.
        """
        occupied = np.zeros(self._counts.shape, bool)
        for shift in (-1, 0, 1):
            occupied[row, np.clip(column + shift, 0, occupied.shape[1] - 1)] = True
        comparable = np.zeros(occupied.shape[1], bool)
        comparable[self._previous_seen] = True
        compared = comparable[column]
        moved = ~self._previous[row, column][compared]
        self._previous, self._previous_seen = occupied, seen
        if not len(moved) or moved.mean() < MIN_MOVED:
            return
        kept = exp(-1 / 30)  # after 30 samples the weight of one has fallen to 1 / e
        self._counts[:, seen] *= kept
        self._counts[:, seen] += occupied[:, seen]
        self._samples[seen] *= kept
        self._samples[seen] += 1
