"""The lane over time: a Kalman filter in metres that knows when it has lost the lane.

    picture -> observe -> predict -> gate -> correct -> describe        (once a second: search as if nothing were known)

What is predicted is not smoothed: each frame's estimate is the best of that frame given all earlier ones, and in a bend
that begins it bends with it.
"""

from __future__ import annotations

import numpy as np

from lanes.camera.camera import Camera
from lanes.io.describe import html_table
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.confidence import rate_lane
from lanes.tracking.departure import watch_departure
from lanes.tracking.detector import describe_lane, search_lane
from lanes.tracking.fitting import VARIANCE_INFLATION, LaneFit
from lanes.tracking.lane import Lane
from lanes.tracking.lines import LEAST_WEIGHT, LineObservation, describe_tracked_lane, inner_stripes, observe_lines
from lanes.tracking.marking_type import MarkingVotes
from lanes.tracking.markings import FrameEvidence, Stripes, extract_evidence
from lanes.tracking.model import CENTRE, SIDES, WIDTH
from lanes.tracking.state import PATH, SPEED, KalmanState
from lanes.tracking.tracked_lane import COASTING, LOST, SEARCHING, TRACKING, TrackedLane
from lanes.tracking.update import initial_state, update_lane

# A lane that was found counts as there from this score (sum of the roots of both lines' supports) on, and as surely
# there when so many searches in a row have found it; a followed one is there while its lines' supports add up to this.
LEAST_SCORE, CONFIRMATIONS, LEAST_SUPPORT = 0.45, 3, 0.06
# Without evidence the prediction is shown for this long at most, and only while it is this sure 15 m ahead.
LONGEST_COAST_S, WIDEST_STD_M = 1.0, 0.4
# While tracking the lane is searched anew this often, and given up when another one scores so much better so often.
RECHECK_S, BETTER, OBJECTIONS = 1.0, 0.1, 3
# The paint of a line is looked at again after so many frames, left and right in turn.
PAINT_EVERY = 10
# On an even road it takes no longer than this to notice that it begins to bend or wave: some metres of a drive.
OUTWARDS_S = 0.25
# The car's middle is so far over a line before the lines change their names: not at each touch of it.
CROSSED_M = 0.1
# Two lanes are the same if their lines lie within this at these distances.
DUPLICATE_M, SAME_AT_M = 0.3, np.array([6.0, 12.0, 20.0])
# A line with less than this share of the other one's support is not evidence enough to change the lane's width.
WEAK = 0.5
# While tracking only a part of the road is looked at: the narrowest of these that has both lines well inside.
HALVES_M, MARGIN_M, NARROW_AT_M = (3.0, 4.0, 5.0, 9.0, 13.0), 0.8, (5.0, 20.0, 35.0)


class LaneTracker:
    """Follows the lane through consecutive pictures of one camera.

    Parameters
    ----------
    camera : Camera
        With its pose.
    fps : float
        Pictures a second.
    speed_mps : float, optional
        How fast the car drives; estimated where not given. Assign `tracker.speed_mps` when it changes.
    """

    def __init__(self, camera: Camera, *, fps: float = 25.0, speed_mps: float | None = None) -> None:
        if not fps > 0:
            raise ValueError(f"a video has more than 0 pictures a second; got fps={fps}.")
        self.view = BirdsEyeView(camera)
        self.fps, self.speed_mps = fps, speed_mps
        self._views = tuple(BirdsEyeView(camera, half_width_m=half) for half in HALVES_M)
        self.reset()

    def reset(self) -> None:
        """Forget everything, as between two drives."""
        self._estimate: KalmanState | None = None
        self._lane: Lane | None = None
        self._state = LOST
        self._confirmed = self._objections = self._regained = self._since_search = 0
        self._unseen_s, self._margin = 0.0, 0.0
        self._seen = (LineObservation(), LineObservation())
        self._votes = (MarkingVotes(), MarkingVotes())

    def summary(self) -> dict[str, str]:
        """What the tracker is set to, and what it knows now, by name."""
        camera = self.view.camera
        speed = "estimated" if self.speed_mps is None else f"{3.6 * self.speed_mps:.0f} km/h, given"
        settings = {"camera": f"{camera.width}x{camera.height} px, {camera.pose.height_m:.2f} m above the road"}
        return settings | {"pictures a second": f"{self.fps:g}", "speed": speed} | self._report().summary()

    def __repr__(self) -> str:
        camera = self.view.camera
        return f"LaneTracker({camera.width}x{camera.height} px, {self.fps:g} pictures a second, {self._state})"

    def _repr_html_(self) -> str:
        return html_table("LaneTracker", self.summary())

    def update(self, image: np.ndarray, *, elapsed_s: float | None = None) -> TrackedLane:
        """Look at the next picture.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8
            RGB, as taken.
        elapsed_s : float, optional
            Time since the picture before, where it is not 1 / fps (dropped frames). After more than `LONGEST_COAST_S`,
            and when the clock was set back, the tracker begins anew.

        Returns
        -------
        TrackedLane

        Raises
        ------
        PictureError
            If the picture is not RGB or not of the camera's size.
        """
        elapsed_s = 1 / self.fps if elapsed_s is None else elapsed_s
        if not 0 <= elapsed_s <= LONGEST_COAST_S:
            self.reset()
        self._since_search += 1
        search = self._state != TRACKING or self._objections > 0 or self._since_search >= RECHECK_S * self.fps
        view = self.view if search else self._narrowest_view()
        evidence = extract_evidence(image, view)
        if self._estimate is not None:
            self._follow(evidence, view, elapsed_s)
        if search:
            self._search(evidence)
        return self._report()

    def _narrowest_view(self) -> BirdsEyeView:
        lines = self._lane.left, self._lane.right
        reach_m = max(
            abs(line.c0_m + x * (line.c1 + x * (line.c2_per_m / 2 + x * line.c3_per_m2 / 6)))
            for line in lines
            for x in NARROW_AT_M
        )
        fitting = (view for view in self._views if reach_m < view.half_width_m - MARGIN_M)
        return next(fitting, self._views[-1])

    def _follow(self, evidence: FrameEvidence, view: BirdsEyeView, elapsed_s: float) -> None:
        """Predict, take the stripes near the prediction, and correct it with them."""
        estimate = self._estimate.predict(elapsed_s, steady_speed=self.speed_mps is not None)
        if self.speed_mps is not None:
            estimate.mean[SPEED] = self.speed_mps
        outwards = self._since_search % max(round(OUTWARDS_S * self.fps), 1) == 0
        fit = update_lane(evidence.stripes, estimate, view, outwards=outwards)
        look_at = {0: 0, PAINT_EVERY // 2: 1}.get(self._since_search % PAINT_EVERY)
        seen = observe_lines(fit, evidence, view, self._seen, look_at)
        self._estimate = estimate.updated(fit.lane[0], np.linalg.inv(fit.information[0]))
        if seen[0].support + seen[1].support < LEAST_SUPPORT:
            self._coast(elapsed_s)
        else:
            self._seen, self._unseen_s = seen, 0.0
            self._regained += self._state == COASTING
            if self._regained >= CONFIRMATIONS:
                self._state, self._regained = TRACKING, 0
        if self._estimate is not None:
            self._count_kinds(fit, evidence.stripes, look_at)
            self._change_lane()
            self._describe()

    def _coast(self, elapsed_s: float) -> None:
        """Go on without evidence worth the name, for a while."""
        self._unseen_s += elapsed_s
        too_long = self._unseen_s > LONGEST_COAST_S or self._estimate.lateral_std_m(15.0) > WIDEST_STD_M
        if self._state == SEARCHING or too_long:
            self.reset()
            return
        distance_m = float(self._estimate.mean[SPEED]) * elapsed_s
        self._seen = self._seen[0].behind(distance_m), self._seen[1].behind(distance_m)
        self._state, self._regained = COASTING, 0

    def _change_lane(self) -> None:
        """When the car's middle has crossed a line, its lane is the neighbouring one and lines change their names."""
        lane = self._estimate.lane
        if abs(lane[CENTRE]) < lane[WIDTH] / 2 + CROSSED_M:
            return
        to_left = lane[CENTRE] < 0
        self._estimate = self._estimate.beside(1.0 if to_left else -1.0)
        self._seen = (LineObservation(), self._seen[0]) if to_left else (self._seen[1], LineObservation())
        self._votes = (MarkingVotes(), self._votes[0]) if to_left else (self._votes[1], MarkingVotes())

    def _count_kinds(self, fit: LaneFit, stripes: Stripes, looked_at: int | None) -> None:
        votes = list(self._votes)
        for k, side in enumerate(SIDES):
            votes[k] = votes[k].add_gaps(stripes.x_m[(fit.side[0] == side) & (fit.weight[0] > LEAST_WEIGHT)])
            if k == looked_at and self._seen[k].profile:
                votes[k] = votes[k].add_profile(self._seen[k].profile)
        self._votes = votes[0], votes[1]

    def _describe(self) -> None:
        double = tuple(bool(votes.kind.double) for votes in self._votes)
        self._lane = describe_tracked_lane(self._estimate, self._seen, double, self._margin)

    def _search(self, evidence: FrameEvidence) -> None:
        """Look for the lane as if nothing were known: to begin, to confirm, or to object."""
        self._since_search = 0
        fit = search_lane(evidence.stripes, self.view)
        rival = describe_lane(fit, evidence, self.view) if fit else None
        if rival is None or rival.score < LEAST_SCORE:
            self._objections = 0
        elif self._estimate is None:
            self._start(rival)
        elif same_lane(rival, self._lane):
            self._objections, self._margin = 0, rival.margin
            self._confirmed += 1
            if self._confirmed >= CONFIRMATIONS and self._state == SEARCHING:
                self._state = TRACKING
        elif self._state != TRACKING or rival.score > self._lane.score + BETTER:
            self._objections += 1
            self._margin = self._lane.score - rival.score
            if self._state == SEARCHING or self._objections >= OBJECTIONS:
                self._start(rival)
        else:
            self._objections = 0

    def _start(self, lane: Lane) -> None:
        """Begin again with a lane that was found without memory; what is followed of a double line is its middle."""
        self.reset()
        paint = lane.left.profile, lane.right.profile
        model = lane.model - inner_stripes([p if p and p.double else None for p in paint])
        self._estimate, self._lane = initial_state(model, lane.covariance * VARIANCE_INFLATION, self.speed_mps), lane
        self._seen = tuple(
            LineObservation(line.support, line.reach_m, line.profile) for line in (lane.left, lane.right)
        )
        self._votes = tuple(MarkingVotes().add_profile(p) if p else MarkingVotes() for p in paint)
        self._state, self._confirmed, self._margin = SEARCHING, 1, lane.margin

    def _report(self) -> TrackedLane:
        if self._lane is None:
            return TrackedLane(LOST)
        path, speed = (float(self._estimate.mean[k]) for k in (PATH, SPEED))
        return TrackedLane(
            self._state,
            rate_lane(self._lane, followed=True),
            self._lane,
            speed,
            watch_departure(
                self._lane,
                speed,
                path_per_m=path,
                course_rad=self._estimate.course_rad,
                turning_std_per_m=self._estimate.turning_std_per_m,
                course_std_rad=self._estimate.course_std_rad,
            ),
            (self._votes[0].kind, self._votes[1].kind),
        )


def same_lane(found: Lane, known: Lane) -> bool:
    """Whether a lane found anew is the known one.

    It is if it has the same lines; if it shares the one that the car is just crossing; and if it shares one and shows
    little paint of the other: then the known lane knows better where that one is, and how wide the lane.
    """
    y, known_y = found.lateral_m(SAME_AT_M), known.lateral_m(SAME_AT_M)
    # in a hairpin lines may have turned back before they come so far
    same = ~(np.abs(y - known_y) > DUPLICATE_M).any(axis=1)
    crossing = [y[0] - known_y[1], y[1] - known_y[0]]
    left, right = found.left.support, found.right.support
    return bool(
        same.all()
        or any(np.all(np.abs(difference) < DUPLICATE_M) for difference in crossing)
        or (same[0] and right < WEAK * left)
        or (same[1] and left < WEAK * right)
    )
