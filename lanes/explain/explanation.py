"""Why a picture gives the lane that it gives, or none: every step from raw pixels to metres, with its numbers.

    picture -> view from above -> paint -> stripes -> votes -> fit -> lane

Where a step comes to nothing, that is the place where the picture failed, and each has its own remedy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.explain.steps import (
    POSE_AGAIN,
    Step,
    judge_birdseye,
    judge_fit,
    judge_lane,
    judge_markings,
    judge_picture,
    judge_pose,
    judge_stripes,
    judge_votes,
)
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.confidence import FEATURES, STILL_WEIGHTS, lane_features
from lanes.tracking.detector import (
    RIVAL_M,
    describe_lane,
    is_other_lane,
    near_stripes,
    score_lanes,
    search_lane,
    vote_lanes,
)
from lanes.tracking.fitting import LaneFit
from lanes.tracking.lane import Lane
from lanes.tracking.lines import LEAST_WEIGHT, support_of
from lanes.tracking.markings import FrameEvidence, extract_evidence
from lanes.tracking.model import CENTRE, SIDES, WIDTH, lateral_gradient, lines_on_view
from lanes.tracking.tracked_lane import TrackedLane


@dataclass(frozen=True, eq=False)
class Candidate:
    """A lane that was followed to the end.

    Attributes
    ----------
    model : ndarray (15,)
        Parameters as in `lanes.tracking.model`.
    support : ndarray (2,)
        Share of the left and the right line's rows that have paint on them.
    score : float
    chosen : bool
    reason : str
        Why it was chosen, or why not.
    """

    model: np.ndarray
    support: np.ndarray
    score: float
    chosen: bool
    reason: str


@dataclass(frozen=True, eq=False)
class Explanation:
    """A picture and what every step made of it; `lanes.explain.panels.show_explanation` draws it.

    Attributes
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, as taken.
    camera : Camera
    view : BirdsEyeView
    sight : Sight or None
        Road from above, evidence and stripes; None where the camera sees no road.
    votes : ndarray (H, BINS) or None
        Of `lanes.tracking.voting`; None without stripes nearby.
    fit : LaneFit or None
    candidates : tuple of Candidate
        Best first.
    lane : Lane or None
    steps : tuple of Step
        In the order in which they were done; the last one may have failed.
    """

    image: np.ndarray
    camera: Camera
    view: BirdsEyeView
    evidence: FrameEvidence | None
    votes: np.ndarray | None
    fit: LaneFit | None
    candidates: tuple[Candidate, ...]
    lane: Lane | None
    steps: tuple[Step, ...]

    @property
    def tracked(self) -> TrackedLane:
        """The result as a frame of its own, with its confidence."""
        return TrackedLane.from_still(self.lane)

    @property
    def failed(self) -> Step | None:
        """The step at which it failed, or that leaves it unsure; None if all is well."""
        return next((step for step in self.steps if step.failure), None)

    @property
    def undistorted_camera(self) -> Camera:
        """The camera without its distortion, for drawing on the undistorted picture."""
        return replace(self.camera, distortion=np.zeros(5))

    def line_stds_m(self, x_m: np.ndarray) -> np.ndarray:
        """Standard deviations (2, N) of the left and right line's lateral place at distances (N,), metres."""
        gradients = np.array([[lateral_gradient(x, side) for x in x_m] for side in SIDES])
        return np.sqrt(((gradients @ self.lane.covariance) * gradients).sum(axis=-1))

    def describe(self) -> str:
        """Lines for people: the steps, the result, what was rejected, and what to do."""
        lines = [f"{step.name:<10} {step.words}" for step in self.steps]
        lines += [f"{name:<10} {words}" for name, words in self.tracked.summary().items()]
        lines += self.confidence_summary()
        lines += [f"rejected   {c.reason}" for c in self.candidates if not c.chosen]
        if self.failed:
            lines += [f"failed at  {self.failed.name}: {self.failed.failure}", f"what to do {self.failed.advice}"]
        return "\n".join(lines)

    def confidence_summary(self) -> list[str]:
        """What the confidence is made of: each feature, its weight, and what it adds to the log odds."""
        if self.lane is None:
            return []
        parts = list(zip(FEATURES, lane_features(self.lane), STILL_WEIGHTS, strict=True))
        lines = [f"  {name}: {value:.2f} x {weight:.2f} = {value * weight:+.2f}" for name, value, weight in parts]
        return ["confidence, as log odds:", *lines, f"  in all {sum(v * w for _, v, w in parts):+.2f}"]

    def __repr__(self) -> str:
        return f"Explanation({self.tracked}, failed at {self.failed.name if self.failed else 'no step'})"


def explain_frame(image: np.ndarray, camera: Camera, *, pose_trouble: str = "") -> Explanation:
    """Go through all steps of finding the lane in a picture, and keep what each of them made.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, as taken.
    camera : Camera
        With its pose.
    pose_trouble : str
        Why that pose is a mere assumption; empty if it is none.

    Returns
    -------
    Explanation
        Its lane is that of `lanes.tracking.detector.find_lane`.

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
    empty = Explanation(image, camera, view, None, None, None, (), None, ())
    steps = [judge_picture(image), judge_pose(camera, pose_trouble)]
    try:
        evidence = extract_evidence(image, view)
    except CameraError as error:
        failed = Step("view", "no road in the picture", str(error), POSE_AGAIN)
        return replace(empty, steps=_until_failure([*steps, failed]))
    if pose_trouble:
        # Without the camera pose nothing that follows means anything, but it may show the eye why.
        return replace(empty, evidence=evidence, steps=tuple(steps))
    steps += [judge_birdseye(evidence, view), judge_markings(evidence, view), judge_stripes(evidence)]
    near = near_stripes(evidence.stripes)
    if not len(near):
        return replace(empty, evidence=evidence, steps=_until_failure(steps))
    votes, starts = vote_lanes(near, view)
    fit = search_lane(evidence.stripes, view)
    lane = describe_lane(fit, evidence, view)
    candidates = _candidates(fit, evidence, view, found=lane is not None)
    steps += [judge_votes(starts), judge_fit(candidates[0].score, candidates[0].support)]
    if lane is not None:
        # What looked doubtful on the way has turned out to be enough.
        steps = [replace(step, failure="", advice="") for step in steps] + [judge_lane(lane)]
    return Explanation(image, camera, view, evidence, votes, fit, candidates, lane, _until_failure(steps))


def _until_failure(steps: list[Step]) -> tuple[Step, ...]:
    failed = next((n for n, step in enumerate(steps) if step.failure), len(steps))
    return tuple(steps[: failed + 1])


def _candidates(fit: LaneFit, evidence: FrameEvidence, view: BirdsEyeView, *, found: bool) -> tuple[Candidate, ...]:
    """The fitted lanes, best first, each with the reason for its fate; what became the best one is left out."""
    support = support_of(fit, lines_on_view(fit.lane, view.x_m, view.height_m), evidence.stripes, view)
    score = score_lanes(fit.lane, support)
    order = np.argsort(-score, kind="stable")
    best = order[0]
    kept = []
    for n in order:
        same = np.abs(fit.lane[n] - fit.lane[best])[[CENTRE, WIDTH]].max() <= RIVAL_M
        if n == best or not same:
            reason = _fate(fit.lane[n], support[n], score[n], best=(support[best], score[best]), chosen=n == best)
            kept.append(Candidate(fit.lane[n], support[n], float(score[n]), bool(found and n == best), reason))
    return tuple(kept)


def _fate(lane: np.ndarray, support: np.ndarray, score: float, *, best: tuple[np.ndarray, float], chosen: bool) -> str:
    which = f"{lane[WIDTH]:.1f} m wide, middle {abs(lane[CENTRE]):.1f} m {'left' if lane[CENTRE] > 0 else 'right'}"
    paint = f"paint {support[0]:.0%} left, {support[1]:.0%} right"
    if chosen:
        return f"{which}: {paint}, score {score:.2f}"
    if is_other_lane(lane[None])[0]:
        why = "the car is not in it"
    elif np.sqrt(support).sum() < np.sqrt(best[0]).sum():
        why = "less paint"
    else:
        why = "a less usual lane"
    return f"{which}: {why} ({paint}), score {score:.2f} against {best[1]:.2f}"


def stripes_on_lines(explanation: Explanation) -> np.ndarray:
    """Which line of the found lane each stripe (N,) lies on: +1 left, -1 right, 0 neither.

    The far lines of the lanes beside are neither, though they help to tell how the road lies.
    """
    if explanation.fit is None or explanation.lane is None:
        return np.zeros(len(explanation.evidence.stripes) if explanation.evidence else 0)
    fit = explanation.fit
    chosen = next(c for c in explanation.candidates if c.chosen)
    best = int(np.flatnonzero((fit.lane == chosen.model).all(axis=1))[0])
    own = np.isin(fit.side[best], SIDES) & (fit.weight[best] > LEAST_WEIGHT)
    return np.where(own, fit.side[best], 0.0)
