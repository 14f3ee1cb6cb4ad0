"""Explanation of a lane detection: every step from the raw picture to the lane in metres, with its numbers.

    picture -> bird's-eye view -> marking response -> stripes -> votes -> fit -> lane

If the detection fails, the explanation names the step, the reason and what to do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.explain.steps import (
    RE_ESTIMATE_POSE,
    Step,
    check_birdseye,
    check_fit,
    check_lane,
    check_markings,
    check_stripes,
    describe_input,
    describe_votes,
)
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.confidence import FEATURES, feature_weights, lane_features
from lanes.tracking.detector import RIVAL_M, search_still
from lanes.tracking.fitting import LaneFit, fit_starts, near_stripes
from lanes.tracking.lane import Lane
from lanes.tracking.markings import FrameEvidence
from lanes.tracking.model import CENTRE, SIDES, WIDTH, is_ego_lane
from lanes.tracking.tracker import TrackedLane
from lanes.tracking.voting import vote_lanes


@dataclass(frozen=True, eq=False)
class Candidate:
    """A lane that was fitted to the stripes.

    `index` is its number in the fit, `model` (15,) as in `lanes.tracking.model`; `support` (2,) is the share of rows
    with paint, left and right; `reason` describes the lane, and says why it was rejected if it was.
    """

    index: int
    model: np.ndarray
    support: np.ndarray
    score: float
    chosen: bool
    reason: str


@dataclass(frozen=True, eq=False)
class Explanation:
    """A picture and the result of every detection step; `lanes.explain.panels.show_explanation` draws it.

    Attributes
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, raw.
    steps : tuple of Step
        In order of execution; only the last one may have failed.
    evidence : FrameEvidence or None
        Bird's-eye view, marking response and stripes; None if the camera sees no road.
    votes : ndarray (hypotheses, bins) or None
        Vote table of `lanes.tracking.voting`; None without near stripes.
    candidates : tuple of Candidate
        Best first.
    """

    image: np.ndarray
    camera: Camera
    view: BirdsEyeView
    steps: tuple[Step, ...]
    evidence: FrameEvidence | None = None
    votes: np.ndarray | None = None
    fit: LaneFit | None = None
    candidates: tuple[Candidate, ...] = ()
    lane: Lane | None = None

    @property
    def tracked(self) -> TrackedLane:
        """The lane with its confidence, as for a still."""
        return TrackedLane.from_still(self.lane)

    @property
    def failed(self) -> Step | None:
        """The step that failed, or that gives a low confidence; None if no step failed."""
        return next((step for step in self.steps if step.failure), None)

    @property
    def undistorted_camera(self) -> Camera:
        """The camera without its distortion, for drawing on the undistorted picture."""
        return replace(self.camera, distortion=np.zeros(5))

    def describe(self) -> str:
        """Text of several lines: steps, result, rejected lanes, failure and advice."""
        lines = [f"{step.name:<10} {step.summary}" for step in self.steps]
        lines += [f"{name:<10} {words}" for name, words in self.tracked.summary().items()]
        lines += self.confidence_summary()
        lines += [f"rejected   {c.reason}" for c in self.candidates if not c.chosen]
        if self.failed:
            lines += [f"failed at  {self.failed.name}: {self.failed.failure}", f"what to do {self.failed.advice}"]
        return "\n".join(lines)

    def confidence_summary(self) -> list[str]:
        """Lines of text with the features of the confidence, their weights and their contributions to the log odds.

        Features without weight are left out: they count only for tracked lanes, or for a pose from the same picture.
        """
        if self.lane is None:
            return []
        parts = list(zip(FEATURES, lane_features(self.lane), feature_weights(self.lane), strict=True))
        lines = [
            f"  {name}: {value:.2f} x {weight:.2f} = {value * weight:+.2f}" for name, value, weight in parts if weight
        ]
        return ["confidence, as log odds:", *lines, f"  total {sum(v * w for _, v, w in parts):+.2f}"]

    def __repr__(self) -> str:
        return f"Explanation({self.tracked}, failed at {self.failed.name if self.failed else 'no step'})"


def explain_frame(image: np.ndarray, camera: Camera, *, pose_failure: str = "") -> Explanation:
    """Detect the lane in a raw RGB picture and keep the result of every step.

    The lane equals that of `lanes.tracking.detector.find_lane`. `pose_failure` says why the pose of `camera` is only
    assumed; it is empty if the pose is known.

    Raises
    ------
    PictureError
        If the picture is not RGB or not of the camera's size.
    CameraError
        If the camera has no pose.
    """
    camera.require_size(image)
    camera.require_pose()
    view = BirdsEyeView(camera)
    steps = describe_input(image, camera, pose_failure)
    try:
        evidence, lane = search_still(image, view)
    except CameraError as error:
        failed = Step("birdseye", "no road in the picture", str(error), RE_ESTIMATE_POSE)
        return Explanation(image, camera, view, _up_to_failure([*steps, failed]))
    if pose_failure:
        # Later steps are meaningless without the camera pose. The evidence is kept for the figure.
        return Explanation(image, camera, view, tuple(steps), evidence)
    steps += [check_birdseye(evidence, view), check_markings(evidence, view), check_stripes(evidence)]
    if not len(near_stripes(evidence.stripes)):
        return Explanation(image, camera, view, _up_to_failure(steps), evidence)
    votes, starts = vote_lanes(evidence.stripes, view)
    fit = fit_starts(starts, evidence.stripes, view)
    candidates = _candidates(fit, found=lane is not None)
    steps += [describe_votes(starts), check_fit(candidates[0].score, candidates[0].support, seen=lane is not None)]
    if lane is not None:
        # A lane was found, so an earlier failure was not decisive.
        steps = [replace(step, failure="", advice="") for step in steps] + [check_lane(lane)]
    return Explanation(image, camera, view, _up_to_failure(steps), evidence, votes, fit, candidates, lane)


def _up_to_failure(steps: list[Step]) -> tuple[Step, ...]:
    failed = next((n for n, step in enumerate(steps) if step.failure), len(steps))
    return tuple(steps[: failed + 1])


def _candidates(fit: LaneFit, *, found: bool) -> tuple[Candidate, ...]:
    """The fitted lanes with the reasons for their selection or rejection, best first, near duplicates removed."""
    support, score = fit.support, fit.score
    order = np.argsort(-score, kind="stable").tolist()
    best, candidates = order[0], []
    for n in order:
        lane = fit.lane[n]
        if n != best and np.abs(lane - fit.lane[best])[[CENTRE, WIDTH]].max() <= RIVAL_M:
            continue
        paint = f"paint {support[n, 0]:.0%} left, {support[n, 1]:.0%} right"
        verdict = f"{paint}, score {score[n]:.2f}"
        if n != best:
            why = _why_rejected(lane, support[n], support[best])
            verdict = f"{why} ({paint}), score {score[n]:.2f} against {score[best]:.2f}"
        side = "left" if lane[CENTRE] > 0 else "right"
        reason = f"{lane[WIDTH]:.1f} m wide, centre {abs(lane[CENTRE]):.1f} m {side}: {verdict}"
        candidates.append(Candidate(n, lane, support[n], float(score[n]), found and n == best, reason))
    return tuple(candidates)


def _why_rejected(lane: np.ndarray, support: np.ndarray, best_support: np.ndarray) -> str:
    if not is_ego_lane(lane[None])[0]:
        return "not the ego lane"
    return "less paint" if np.sqrt(support).sum() < np.sqrt(best_support).sum() else "larger prior penalty"


def stripes_on_lines(explanation: Explanation) -> np.ndarray:
    """The line of the lane that each stripe (N,) lies on: +1 left, -1 right, 0 none.

    Stripes on the far lines of adjacent lanes are 0, although they take part in the fit.
    """
    if explanation.lane is None or explanation.fit is None:
        return np.zeros(len(explanation.evidence.stripes) if explanation.evidence else 0)
    return SIDES @ explanation.fit.members[explanation.candidates[0].index]
