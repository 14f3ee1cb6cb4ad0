"""A track: what is known of the lane from frame to frame, and its update with the evidence of the next frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.car import SPEED
from lanes.tracking.fitting import FIT
from lanes.tracking.lane import Lane
from lanes.tracking.lines import LineObservation, Observations, describe_lane, inner_stripe_shift, observe_lines
from lanes.tracking.marking_type import MarkingVotes, Votes, add_votes
from lanes.tracking.markings import FrameEvidence
from lanes.tracking.model import CENTRE, LEFT_SIDE, RIGHT_SIDE, WIDTH, lateral_std_m, score_lanes
from lanes.tracking.state import KalmanState
from lanes.tracking.update import initial_state, update_lane, update_state


@dataclass(frozen=True)
class TrackParameters:
    """When a track is seen and certain, and when its lane changes; tuned on the rendered suite."""

    # Smallest sum of both lines' supports of a lane that is seen.
    min_total_support: float = 0.06
    # Largest standard deviation of a line at this distance while the lane is not seen.
    max_std_m: float = 0.4
    max_std_at_m: float = 15.0
    # Distance of the car's centre beyond a line at which the adjacent lane becomes the ego lane; a hysteresis.
    lane_change_m: float = 0.1


TRACK = TrackParameters()


@dataclass(frozen=True, eq=False)
class Track:
    """The lane after a frame.

    Attributes
    ----------
    estimate : KalmanState
        It follows the centres of double lines.
    observations : (LineObservation, LineObservation)
        What was last seen of the left and the right line.
    votes : (MarkingVotes, MarkingVotes)
        On the marking types of the two lines.
    lane : Lane
        The estimate in metres; double lines are bounded by their inner stripes.
    """

    estimate: KalmanState
    observations: Observations
    votes: Votes
    lane: Lane

    @property
    def certain(self) -> bool:
        """Whether the lines are known well enough without detection."""
        return lateral_std_m(self.estimate.lane_covariance, TRACK.max_std_at_m).max() <= TRACK.max_std_m

    @property
    def seen(self) -> bool:
        """Whether the lane was seen in the frame."""
        return total_support(self.observations) >= TRACK.min_total_support


def start_track(lane: Lane, speed_mps: float | None) -> Track:
    """The track of a detected lane, for a car of given or usual speed."""
    profiles = [line.profile for line in lane.lines]
    model = lane.model - inner_stripe_shift([p if p and p.double else None for p in profiles])
    left, right = (LineObservation(line.support, line.reach_m, line.profile) for line in lane.lines)
    estimate = initial_state(model, lane.covariance * FIT.variance_inflation, speed_mps)
    return Track(estimate, (left, right), add_votes((MarkingVotes(), MarkingVotes()), profiles), lane)


def update_track(
    track: Track,
    evidence: FrameEvidence,
    view: BirdsEyeView,
    *,
    elapsed_s: float,
    speed_mps: float | None,
    margin: float,
    outwards: bool,
    profiles_of: tuple[int, ...],
) -> Track:
    """The track after the next frame: predict, update, observe the lines, count votes.

    Parameters
    ----------
    track : Track
    evidence : FrameEvidence
    view : BirdsEyeView
        The view of the evidence.
    elapsed_s : float
        Since the previous frame.
    speed_mps : float or None
        Speed of the car, if given.
    margin : float
        Score of the lane minus that of the next best one, from the latest search.
    outwards : bool
        As of `update_lane`.
    profiles_of : tuple of {0, 1}
        As of `observe_lines`.
    """
    predicted = track.estimate.predict(elapsed_s, steady_speed=speed_mps is not None)
    if speed_mps is not None:
        predicted.mean[SPEED] = speed_mps
    fit = update_lane(evidence.stripes, predicted, view, outwards=outwards)
    estimate = update_state(predicted, fit.lane[0], np.linalg.inv(fit.information[0]))
    observations = observe_lines(fit, evidence, previous=track.observations, profiles_of=profiles_of)
    if total_support(observations) < TRACK.min_total_support:
        distance_m = float(estimate.mean[SPEED]) * elapsed_s
        observations = tuple(line.coast(distance_m) for line in track.observations)
    profiles = [line.profile if k in profiles_of else None for k, line in enumerate(observations)]
    votes = add_votes(track.votes, profiles, [evidence.stripes.x_m[members] for members in fit.members[0]])
    estimate, observations, votes = to_ego_lane(estimate, observations, votes)
    return Track(estimate, observations, votes, describe_estimate(estimate, observations, votes, margin))


def total_support(observations: Observations) -> float:
    """Sum of both lines' supports."""
    return observations[0].support + observations[1].support


def to_ego_lane(
    estimate: KalmanState, observations: Observations, votes: Votes
) -> tuple[KalmanState, Observations, Votes]:
    """After the car's centre has crossed a line: the adjacent lane, whose lines swap names; else unchanged."""
    lane = estimate.lane
    if abs(lane[CENTRE]) < lane[WIDTH] / 2 + TRACK.lane_change_m:
        return estimate, observations, votes
    if lane[CENTRE] < 0:
        return estimate.adjacent(LEFT_SIDE), (LineObservation(), observations[0]), (MarkingVotes(), votes[0])
    return estimate.adjacent(RIGHT_SIDE), (observations[1], LineObservation()), (votes[1], MarkingVotes())


def describe_estimate(estimate: KalmanState, observations: Observations, votes: Votes, margin: float) -> Lane:
    """The lane of an estimate, bounded by the inner stripes of double lines.

    Single lines are not shifted: the filter estimates their centres better than one profile does.
    """
    profiles = [
        line.profile if line_votes.marking_type.double and line.profile and line.profile.double else None
        for line, line_votes in zip(observations, votes, strict=True)
    ]
    lane, support = estimate.lane, np.array([[line.support for line in observations]])
    return describe_lane(
        lane + inner_stripe_shift(profiles),
        estimate.lane_covariance,
        observations,
        score=float(score_lanes(lane[None], support)[0]),
        margin=margin,
    )
