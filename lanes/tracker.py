"""The lane over time: a Kalman filter in metres that knows when it has lost the lane.

    picture -> observe -> predict -> gate -> follow -> Lane
                             (every few frames: search as if nothing were known, and compare)

What is predicted is not smoothed: each frame's estimate is the best of that frame given all earlier ones, and in a bend
that begins it bends with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera import Camera
from lanes.confidence import chance, track_features
from lanes.departure import DepartureWarning, watch_departure
from lanes.follow import TOGETHER, correct_lane, gate_stripes
from lanes.lane import LEAST_WEIGHT, Lane, LaneLine, Sight, describe_lane, observe, search_lane
from lanes.lanemodel import CENTRE, CURVATURE, HEADING, PITCH, RATE, SIDES, WIDTH, line_coefficients
from lanes.linekind import KindVotes, LineKind
from lanes.motion import AIM, PATH, SPEED, Belief, first_belief
from lanes.roadview import RoadView

SEARCHING, TRACKING, COASTING, LOST = "searching", "tracking", "coasting", "lost"
# A lane counts as there from this score (sum of the roots of both lines' supports) on, and when so many frames in a row
# found it independently; it stays while its lines have any support.
LEAST_SCORE, CONFIRMATIONS = 0.45, 3
# Without evidence the prediction is shown for this long at most, and only while it is this sure 15 m ahead.
LONGEST_COAST_S, WIDEST_STD_M = 1.0, 0.4
# While tracking the lane is searched anew this often, and given up when another one scores better so often in a row.
RECHECK_EVERY, OBJECTIONS, BETTER = 10, 3, 0.1
# Sum of both lines' supports below which a followed lane counts as unseen.
LEAST_STRENGTH = 0.08
# The car's middle is so far over a line before the lines change their names: not at each touch of it.
CROSSED_M = 0.1
# Two lanes are the same if their lines lie within this at these distances.
SAME_M, SAME_AT_M = 0.3, np.array([6.0, 12.0, 20.0])


@dataclass(frozen=True, eq=False)
class TrackedLane:
    """The lane in one frame of a drive.

    Attributes
    ----------
    state : str
        "tracking": seen in this frame and before; "searching": seen, not yet confirmed; "coasting": not seen now,
        predicted from before; "lost": not known, `lane` is None.
    confidence : float
        Probability that both lines are right within 0.2 m from 5 to 30 m ahead; see `lanes.confidence`.
    lane : Lane or None
        Where it is, with standard deviations, in metres; `lane.left.paint` and `.dashed` say what the lines are.
    speed_mps : float or None
        Given, or estimated from how the lane moves.
    warning : DepartureWarning or None
        Time to line crossing; None when lost.
    """

    state: str
    confidence: float = 0.0
    lane: Lane | None = None
    speed_mps: float | None = None
    warning: DepartureWarning | None = None
    kinds: tuple[LineKind, LineKind] = (LineKind(), LineKind())
    features: np.ndarray | None = None

    @property
    def offset_m(self) -> float | None:
        """How far the car stands left of the lane's middle; None when lost, as all the following."""
        return self.lane and self.lane.offset_m

    @property
    def offset_std_m(self) -> float | None:
        """Standard deviation of the offset."""
        return self.lane and self.lane.offset_std_m

    @property
    def heading_rad(self) -> float | None:
        """Direction of the road seen from the car, > 0 to the left."""
        return self.lane and self.lane.heading_rad

    @property
    def curvature_per_m(self) -> float | None:
        """Curvature of the lane beside the car, > 0 bends left."""
        return self.lane and self.lane.curvature_per_m

    @property
    def curvature_std_per_m(self) -> float | None:
        """Standard deviation of the curvature."""
        return self.lane and self.lane.curvature_std_per_m

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the two lines."""
        return self.lane and self.lane.width_m

    @property
    def pitch_rad(self) -> float | None:
        """How much farther down than its mount says the camera looks."""
        return self.lane and self.lane.pitch_rad

    @property
    def left(self) -> LaneLine | None:
        """The left line: coefficients, reach, support, paint."""
        return self.lane and self.lane.left

    @property
    def right(self) -> LaneLine | None:
        """The right line."""
        return self.lane and self.lane.right

    @property
    def time_to_crossing_s(self) -> float | None:
        """Until the tyres are on a line; infinite when the car keeps to its lane."""
        return self.warning and self.warning.time_to_crossing_s


class LaneTracker:
    """Follows the lane through consecutive pictures of one camera.

    Parameters
    ----------
    camera : Camera
        With its mount.
    fps : float
        Pictures a second.
    speed_mps : float, optional
        How fast the car drives; estimated where not given. Assign `tracker.speed_mps` when it changes.
    """

    def __init__(self, camera: Camera, *, fps: float = 25.0, speed_mps: float | None = None) -> None:
        if not fps > 0:
            raise ValueError(f"a video has more than 0 pictures a second; got fps={fps}.")
        self.view = RoadView(camera)
        self.fps, self.speed_mps = fps, speed_mps
        self.reset()

    def reset(self) -> None:
        """Forget everything, as between two drives."""
        self._belief: Belief | None = None
        self._lane: Lane | None = None
        self._state = LOST
        self._confirmed = self._objections = self._since_check = 0
        self._unseen_s, self._margin = 0.0, 0.0
        self._votes = (KindVotes(), KindVotes())

    def update(self, image: np.ndarray, *, elapsed_s: float | None = None) -> TrackedLane:
        """Look at the next picture.

        Parameters
        ----------
        image : ndarray of shape (height, width, 3), uint8
            RGB, as taken.
        elapsed_s : float, optional
            Time since the picture before, where it is not 1 / fps (dropped frames).

        Returns
        -------
        TrackedLane
        """
        elapsed_s = 1 / self.fps if elapsed_s is None else elapsed_s
        sight = observe(image, self.view)
        if self._belief is not None:
            self._follow(sight, elapsed_s)
        if self._due_for_search():
            self._search(sight)
        return self._report()

    def _follow(self, sight: Sight, elapsed_s: float) -> None:
        """Predict, take the stripes near the prediction, and correct it with them."""
        belief = self._belief.predict(elapsed_s, steady_speed=self.speed_mps is not None)
        if self.speed_mps is not None:
            belief.mean[SPEED] = self.speed_mps
        near = gate_stripes(sight.stripes, belief, self.view)
        fit = correct_lane(near, belief, self.view)
        lane = describe_lane(fit, Sight(sight.view_image, near), self.view)
        if lane is None or strength(lane) < LEAST_STRENGTH:
            self._coast(belief, elapsed_s)
            return
        belief = belief.corrected(fit.lane[0], np.linalg.inv(fit.information[0]))
        self._votes = tuple(
            votes.add(line, near.x_m[(fit.side[0] == side) & (fit.weight[0] > LEAST_WEIGHT)])
            for votes, line, side in zip(self._votes, (lane.left, lane.right), SIDES, strict=True)
        )
        self._belief, self._lane, self._unseen_s = belief, lane, 0.0
        self._change_lane()

    def _coast(self, belief: Belief, elapsed_s: float) -> None:
        """Go on without evidence, for a while."""
        self._unseen_s += elapsed_s
        too_long = self._unseen_s > LONGEST_COAST_S or belief.lateral_std_m(15.0) > WIDEST_STD_M
        if self._state == SEARCHING or too_long:
            self.reset()
            return
        distance_m = float(belief.mean[SPEED]) * elapsed_s
        self._belief, self._lane, self._state = belief, carry_lane(self._lane, belief, distance_m), COASTING

    def _change_lane(self) -> None:
        """When the car's middle has crossed a line, its lane is the neighbouring one and lines change their names."""
        model = self._belief.lane
        if abs(model[CENTRE]) < model[WIDTH] / 2 + CROSSED_M:
            return
        side = -np.sign(model[CENTRE])
        self._belief = self._belief.beside(side)
        self._lane = carry_lane(self._lane, self._belief, 0.0, from_side=side)
        shared = self._votes[0 if side > 0 else 1]
        self._votes = (KindVotes(), shared) if side > 0 else (shared, KindVotes())

    def _due_for_search(self) -> bool:
        self._since_check += 1
        return self._state != TRACKING or self._objections > 0 or self._since_check >= RECHECK_EVERY

    def _search(self, sight: Sight) -> None:
        """Look for the lane as if nothing were known: to begin, to confirm, or to object."""
        self._since_check = 0
        fit = search_lane(sight.stripes, self.view)
        rival = describe_lane(fit, sight, self.view) if fit else None
        if rival is None or rival.score < LEAST_SCORE:
            self._objections = 0
        elif self._belief is None:
            self._start(rival)
        elif same_lane(rival, self._lane):
            self._objections, self._margin = 0, rival.margin
            self._confirmed += 1
            if self._confirmed >= CONFIRMATIONS and self._unseen_s == 0:
                self._state = TRACKING
        elif self._state != TRACKING or rival.score > self._lane.score + BETTER:
            self._objections += 1
            self._margin = self._lane.score - rival.score
            if self._state == SEARCHING or self._objections >= OBJECTIONS:
                self._start(rival)
        else:
            self._objections = 0

    def _start(self, lane: Lane) -> None:
        """Begin again with a lane that was found without memory."""
        self.reset()
        covariance = lane.covariance * TOGETHER
        self._belief, self._lane = first_belief(lane.model, covariance, self.speed_mps), lane
        self._state, self._confirmed, self._margin = SEARCHING, 1, lane.margin

    def _report(self) -> TrackedLane:
        if self._lane is None:
            return TrackedLane(LOST)
        features = track_features(self._lane, margin=self._margin, unseen_s=self._unseen_s, confirmed=self._confirmed)
        path, speed, aim = (float(self._belief.mean[k]) for k in (PATH, SPEED, AIM))
        return TrackedLane(
            self._state,
            chance(features),
            self._lane,
            speed,
            watch_departure(self._lane, speed, path_per_m=path, aim_rad=aim),
            (self._votes[0].kind, self._votes[1].kind),
            features,
        )


def strength(lane: Lane) -> float:
    """How much paint speaks for a lane: the sum of both lines' supports."""
    return lane.left.support + lane.right.support


def carry_lane(lane: Lane, belief: Belief, distance_m: float, *, from_side: float = 0.0) -> Lane:
    """The lane as the belief says, its lines seen `distance_m` ago; with `from_side` the neighbour of that lane.

    A line that was a line of that lane keeps its paint; evidence comes nearer as the car moves on.
    """
    model, std = belief.lane, np.sqrt(np.diag(belief.lane_covariance))
    known = {0.0: (lane.left, lane.right), 1.0: (None, lane.left), -1.0: (lane.right, None)}[from_side]
    left, right = (
        LaneLine(
            *line_coefficients(model, side),
            c0_std_m=belief.lateral_std_m(0.0),
            support=old.support if old and not distance_m else 0.0,
            reach_m=max(old.reach_m - distance_m, 0.0) if old else 0.0,
            seen=bool(old and not distance_m and old.seen),
            paint=old.paint if old else None,
        )
        for side, old in zip(SIDES, known, strict=True)
    )
    return replace(
        lane,
        offset_m=float(-model[CENTRE]),
        offset_std_m=float(std[CENTRE]),
        heading_rad=float(model[HEADING]),
        curvature_per_m=float(model[CURVATURE] / (1 - model[CURVATURE] * model[CENTRE])),
        curvature_std_per_m=float(std[CURVATURE]),
        curvature_rate_per_m2=float(model[RATE]),
        width_m=float(model[WIDTH]),
        width_std_m=float(std[WIDTH]),
        pitch_rad=float(model[PITCH]),
        left=left,
        right=right,
        model=model.copy(),
        covariance=belief.lane_covariance.copy(),
    )


def same_lane(one: Lane, other: Lane) -> bool:
    """Whether two lanes have the same lines, or share the one that the car is just crossing."""
    y = [np.stack([lane.line_y(SAME_AT_M, side) for side in SIDES]) for lane in (one, other)]
    pairs = [y[0] - y[1], y[0][:1] - y[1][1:], y[0][1:] - y[1][:1]]
    return any(bool(np.nanmax(np.abs(difference)) < SAME_M) for difference in pairs)
