"""Explanation of a lane detection: every step from the raw image to the lane in metres,
with its numbers.

    image -> pose -> bird's-eye view -> markings -> stripes -> votes or prediction ->
    fit -> lane

It reads the results that the detection or the tracker kept. If no lane was found, or a
doubtful one, it names the step, the reason and what to do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lanes.camera.model import Camera, require_camera
from lanes.describe import describe_bend
from lanes.detect.birdseye import lightness
from lanes.detect.confidence import (
    LIKELY_CONFIDENCE,
    USUAL_WIDTH_M,
    WIDTH_STD_M,
    log_odds_losses,
)
from lanes.detect.evidence import Evidence, strength_weight
from lanes.detect.fit import FIT, Fit, near_stripes
from lanes.detect.lane import COASTING, LOST, Lane
from lanes.detect.road import (
    CENTRE,
    CURVATURE,
    PITCH,
    SIDES,
    WIDTH,
    is_ego_lane,
    lateral_std_m,
)
from lanes.detect.search import Search, StillDetection, detect_still
from lanes.equality import ByValue
from lanes.errors import CameraError
from lanes.pose.change import describe_wrong_yaw
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import TimedFrame

# Advice if the pose may be wrong: one that was given, and one that was estimated from
# the files that are explained.
RE_ESTIMATE_POSE = (
    "Estimate the camera pose from pictures of this drive (python -m lanes pose)."
)
OTHER_PICTURES = (
    "The pose was estimated from these files: give the field of view (--hfov), another "
    "part of the video (--start, "
    "--end) or pictures that show both lines by day, or a camera file with the pose "
    "(--camera). Annotate stills of "
    "several cameras with --each."
)
# Stripes parallel to the lane in a strip of this width are a line, if they are on this
# share of the rows.
STRIP_M, LEAST_PAINT = 0.4, 0.15


@dataclass(frozen=True)
class Step:
    """One step of the detection: name, numbers as text, and reason and advice if it
    failed.
    """

    name: str
    summary: str
    failure: str = ""
    advice: str = ""


@dataclass(frozen=True, eq=False)
class Candidate(ByValue):
    """A lane that was fitted to the stripes; `reason` describes it, and says why it was
    rejected if it was.
    """

    model: np.ndarray  # (15,), see `lanes.detect.road`
    chosen: bool
    reason: str


@dataclass(frozen=True, eq=False)
class Explanation(ByValue):
    """A raw RGB image (height, width, 3), uint8, and the result of every detection step
    in it.

    `steps` are in order of execution; only the last one may have failed. `detection` is
    None if the camera sees no road. `fit` is that of the lane, or the best one of a
    search without a lane. `prediction` (15,) is the tracked lane before the fit.
    `candidates` are those lanes that a search compared, best first.
    `lanes.show.figures.show_explanation` draws it.
    """

    image: np.ndarray
    camera: Camera
    steps: tuple[Step, ...]
    detection: StillDetection | None = None
    fit: Fit | None = None
    prediction: np.ndarray | None = None
    candidates: tuple[Candidate, ...] = ()

    @property
    def lane(self) -> Lane | None:
        """The lane found."""
        return self.detection.lane if self.detection else None

    @property
    def failed(self) -> Step | None:
        """The step that failed, or that gives a low confidence; None if no step failed."""
        return self.steps[-1] if self.steps[-1].failure else None

    def describe(self) -> str:
        """Text of several lines: steps, result, failure and advice."""
        lines = [
            f"{step.name:<10} {step.summary}" for step in self.steps
        ] + self.describe_result()
        if self.failed:
            lines += [
                f"failed at  {self.failed.name}: {self.failed.failure}",
                f"what to do {self.failed.advice}",
            ]
        return "\n".join(lines)

    def describe_result(self) -> list[str]:
        """Lines of text: the lane, the terms of its confidence, the weakest evidence,
        the best rejected lanes.
        """
        words = {"state": LOST}
        if self.lane:
            terms = self.lane.log_odds_terms
            total = " ".join(f"{term:+z.2f} ({name})" for name, term in terms.items())
            odds = f"log odds {sum(terms.values()):+z.2f} = {total}"
            words = self.lane.summary() | {
                "confidence": f"{self.lane.confidence:.0%}, {odds}"
            }
            words["weakest"], _ = _weakest_evidence(self.lane, "")
            ignored = describe_ignored(self.lane, self.fit) if self.fit else None
            words |= {"ignored": ignored} if ignored else {}
        rejected = [f"rejected   {c.reason}" for c in self.candidates if not c.chosen]
        return [f"{name:<10} {text}" for name, text in words.items()] + rejected[:3]

    __str__ = describe

    def __repr__(self) -> str:
        return f"Explanation({self.lane}, {f'failed at {self.failed.name}' if self.failed else 'all steps passed'})"


def explain(
    image: np.ndarray | str | Path,
    camera: Camera,
    *,
    detection: StillDetection | None = None,
    pose_doubt: str | None = None,
) -> Explanation:
    """Every step of the lane detection in a raw RGB image, or a path of one, with its
    result in words.

    >>> print(lanes.explain(image, camera))  # doctest: +SKIP

    Parameters
    ----------
    detection : StillDetection, optional
        The detection in the image, if it is known; otherwise that of
        `lanes.detect.search.detect_still`.
    pose_doubt : str, optional
        Given if the pose of `camera` was estimated from the same files: why it is
        uncertain, or empty. It is the failed step if no lane is found.

    Raises
    ------
    PictureError
        If the image is not RGB or not of the camera's size.
    CameraError
        If the camera has no pose.
    """
    image = require_camera(camera).require_size(image)
    try:
        detection = detection or detect_still(image, camera)
    except CameraError as error:
        advice = RE_ESTIMATE_POSE if pose_doubt is None else OTHER_PICTURES
        failed = Step("birdseye", "no road in the picture", str(error), advice)
        return Explanation(
            image,
            camera,
            _up_to_failure([*_first_steps(image, camera, pose_doubt), failed]),
        )
    return _explain_detection(image, camera, pose_doubt, detection)


def explain_tracked(
    frames: Iterable[TimedFrame], tracker: LaneTracker, *, pose_doubt: str | None = None
) -> Explanation:
    """Every step of the tracker in the last of some consecutive frames, in which it
    tracks the lane.

    `pose_doubt` and errors are those of `explain`; there is at least one frame.
    """
    track = []
    lane = None
    for frame in frames:
        try:
            tracker.update(frame.image, elapsed_s=frame.elapsed_s)
        except CameraError:  # no road in view
            return explain(frame.image, tracker.camera, pose_doubt=pose_doubt)
        lane = tracker.tracked_lane
        seen = lane is not None and any(line.seen for line in lane.evidence)
        track.append((frame.time_s, lane.state if lane else LOST, seen))
    assert tracker.evidence is not None
    detection = StillDetection(tracker.evidence, tracker.search, lane)
    return _explain_detection(
        frame.image,
        tracker.camera,
        pose_doubt,
        detection,
        tracker,
        _describe_track(track),
    )


def _explain_detection(
    image: np.ndarray,
    camera: Camera,
    pose_doubt: str | None,
    detection: StillDetection,
    tracker: LaneTracker | None = None,
    track: str = "",
) -> Explanation:
    """Explanation of a detection in an image, or in a frame of a tracker; `track`
    describes the frames before.
    """
    evidence = detection.evidence
    search = detection.search
    lane = detection.lane
    advice = RE_ESTIMATE_POSE if pose_doubt is None else OTHER_PICTURES
    fit, predicted = (tracker.fit, tracker.prediction) if tracker else (None, None)
    fit = fit or (search.fit if search else None)
    steps = [*_first_steps(image, camera, pose_doubt), _check_birdseye(evidence)]
    steps += [_check_markings(evidence, advice), _check_stripes(evidence, advice)]
    if search:
        best = search.starts.lanes[0]
        votes = f"best: {best[WIDTH]:.1f} m wide, {describe_bend(best[CURVATURE])}"
        steps.append(
            Step("votes", f"{len(search.starts.lanes)} lanes proposed, {votes}")
        )
    if predicted:
        steps.append(Step("prediction", f"{track}; {_describe_place(predicted.lane)}"))
    if fit:
        steps.append(_check_fit(fit, advice))
    if lane is not None:
        # A lane was found, so an earlier failure was not decisive.
        steps = [replace(step, failure="", advice="") for step in steps] + [
            _check_lane(lane, advice, pose_doubt)
        ]
    elif track:
        steps = [
            replace(step, failure=step.failure and f"{step.failure} Before: {track}.")
            for step in steps
        ]
    candidates = (
        _list_candidates(search, fit, found=lane is not None) if search and fit else ()
    )
    prediction = predicted.lane if predicted else None
    return Explanation(
        image, camera, _up_to_failure(steps), detection, fit, prediction, candidates
    )


def _first_steps(
    image: np.ndarray, camera: Camera, pose_doubt: str | None
) -> list[Step]:
    pose = camera.require_pose().describe()
    return [
        Step(
            "picture",
            f"{camera.width}x{camera.height} px, mean brightness {image.mean():.0f} of 255",
        ),
        Step("pose", pose, pose_doubt or "", OTHER_PICTURES),
    ]


def _describe_track(track: Sequence[tuple[float, str, bool]]) -> str:
    """The track before the last frame in words, from time, state and whether the lane
    was seen, of each frame.
    """
    *before, (now_s, _, _) = track
    seen_s = [time_s for time_s, _, seen in before if seen]
    if not seen_s:
        return "no lane was known"
    last = max(n for n, (_, state, _) in enumerate(before) if state != LOST)
    next_s, next_state, _ = track[last + 1]
    if next_state == LOST:
        return f"the track was lost at {next_s:.2f} s, {next_s - seen_s[-1]:.2f} s after the lane was last seen"
    began_s = max(
        (time_s for time_s, state, _ in before if state == LOST), default=before[0][0]
    )
    return f"{before[last][1]}, lane known for {now_s - began_s:.2f} s and last seen {now_s - seen_s[-1]:.2f} s ago"


def _up_to_failure(steps: list[Step]) -> tuple[Step, ...]:
    failed = next((n for n, step in enumerate(steps) if step.failure), len(steps))
    return tuple(steps[: failed + 1])


def _check_birdseye(evidence: Evidence) -> Step:
    """Check that the road in the bird's-eye view is neither too dark nor too bright to
    show paint, and has contrast.
    """
    view = evidence.view
    levels = lightness(evidence.view_image)[view.seen]
    low, median, high = np.percentile(levels, [0.1, 50, 99.9])
    part = f"{view.seen.mean():.0%} of {view.near_m:.0f} to {view.far_m:.0f} m"
    summary = f"picture covers {part}, brightness {median:.0f}"
    failure = ""
    if median < 20:
        failure = f"the road is almost black (median {median:.0f} of 255)."
    elif median > 240:
        failure = f"the road is glaring white (median {median:.0f} of 255)."
    elif high - low < 6:
        failure = f"the road has no contrast (grey levels {low:.0f} to {high:.0f})."
    advice = (
        "Take another part (--start, --end). Before a drive clean the windscreen, and "
        "set the exposure for the road."
    )
    return Step("birdseye", summary, failure, advice)


def _check_markings(evidence: Evidence, pose_advice: str) -> Step:
    """Check that the marking response is large enough anywhere."""
    strength = evidence.response.strength[evidence.view.seen]
    minimum = evidence.settings.min_strength
    best = strength.max(initial=0)
    share = (strength > minimum).mean()
    summary = f"strongest {best:.0f} x noise, {share:.1%} of the road above {minimum:g}"
    failure = "nothing is brighter or yellower than the road on both sides of it and as wide as a painted line."
    if "network" in evidence.sources:
        best_p, minimum_p = strength_weight(
            np.array([best, minimum]), evidence.settings
        )
        summary = f"probability of paint up to {best_p:.0%}, {share:.1%} of the road above {minimum_p:.0%}"
        failure = f"no paint is found with a probability above {minimum_p:.0%}."
    advice = "Check whether the road has lines, and whether the bird's-eye view shows them. If it does not: "
    return Step(
        "markings", summary, "" if best > minimum else failure, advice + pose_advice
    )


def _check_stripes(evidence: Evidence, pose_advice: str) -> Step:
    """Check that there are stripes at the near end of the road, where the search
    starts.
    """
    count = len(evidence.stripes)
    near = len(near_stripes(evidence.stripes, FIT))
    near_m = FIT.start[-1][0]
    summary = f"{count} candidates, {near} of them within {near_m} m"
    failure = (
        "" if near else f"no stripe is nearer than {near_m} m, where the search starts."
    )
    advice = "Check whether the bonnet or a car hides the road, or the lines end here. If not: "
    return Step("stripes", summary, failure, advice + pose_advice)


def _check_fit(fit: Fit, pose_advice: str) -> Step:
    """Why no lane was found: the best one is not seen after the fit, or its score is
    too small to start a track.
    """
    support = fit.support[0]
    summary = f"score {np.sqrt(support).sum():.2f}, {_describe_paint(support)}"
    failure = "the score of the best lane is too small to start a track"
    if not fit.seen[0]:
        failure = f"the best lane and its neighbours have paint on less than {FIT.min_support:.0%} of the rows"
    return Step(
        "fit",
        summary,
        f"{failure}: the stripes do not line up.",
        "Check in the bird's-eye view whether the road has lines here, and whether "
        "they are parallel. If they are, the "
        "car is crossing a line or in a hairpin, and in a video the tracker bridges "
        "it. If they diverge or converge, "
        "the camera pose is wrong. " + pose_advice,
    )


def _check_lane(lane: Lane, pose_advice: str, pose_doubt: str | None) -> Step:
    """Check the confidence and the pitch motion of the lane found: a bump does not
    exceed three standard deviations.
    """
    summary = f"{lane.state}, confidence {lane.confidence:.0%}, score {lane.score:.2f}"
    if abs(lane.pitch_rad) >= 3 * FIT.prior.std[PITCH]:
        turned = f"{np.degrees(abs(lane.pitch_rad)):.1f} deg farther {'down' if lane.pitch_rad > 0 else 'up'}"
        failure = f"the camera seems to look {turned} than its pose says."
        return Step(
            "lane",
            summary,
            failure,
            "On a crest or a bump no action is needed. Otherwise: " + pose_advice,
        )
    if lane.confidence < LIKELY_CONFIDENCE:
        failure, advice = _weakest_evidence(lane, pose_advice)
        if pose_doubt:
            failure = f"{failure} The camera pose is doubtful, too: {pose_doubt}"
            advice = f"{advice.removesuffix(pose_advice)} {pose_advice}"
        return Step("lane", summary, failure, advice)
    return Step("lane", summary)


def _weakest_evidence(lane: Lane, pose_advice: str) -> tuple[str, str]:
    """What speaks most against a lane, likely or not, and what to do."""
    unseen = [
        name
        for name, line in (("left", lane.left), ("right", lane.right))
        if not line.seen
    ]
    if lane.state == COASTING and len(unseen) == 2:
        failure = "neither line is seen; the lane is predicted from the frames before."
        return (
            failure,
            "No action is needed if a car or a shadow hides the lines for less than a second.",
        )
    if unseen:
        return (
            f"the {unseen[0]} line is not seen; its position follows from the other "
            "line and the usual lane width.",
            "If the road has no such line, no action is needed: in a video the tracker "
            "keeps the lane width from "
            "earlier frames. If it has one, and the lines are not parallel in the "
            "bird's-eye view, the camera pose is "
            "wrong. " + pose_advice,
        )
    losses = log_odds_losses(lane.features)
    feature = max(losses, key=losses.__getitem__)
    # what costs less than 1 of the log odds is no weakness
    return _describe_weakness(
        lane, feature if losses[feature] >= 1 else "weaker line", pose_advice
    )


def _describe_weakness(lane: Lane, feature: str, pose_advice: str) -> tuple[str, str]:
    """A feature of the confidence in words, and what to do if it is bad."""
    left, right = lane.lines
    frames = "No action is needed if the next frames are better."
    if not lane.tracked:
        frames = "Use the video instead of a still: the tracker combines many frames."
    if feature == "odd heading":
        yaw_rad = lane.camera_yaw_rad or 0.0
        if abs(yaw_rad) > abs(lane.heading_rad):
            return describe_wrong_yaw(-yaw_rad) + ".", pose_advice
        return (
            f"the lane points {np.degrees(abs(lane.heading_rad)):.1f} deg away from "
            "the car's direction, more than "
            "in a usual bend or lane change.",
            "In a sharp lane change no action is needed. Otherwise: " + pose_advice,
        )
    words = {
        "other lanes": (
            f"only {lane.same_lane_share or 0:.0%} of the camera poses that fit this "
            "picture show this lane, because "
            "one picture shows the pose only roughly.",
            "Give a camera file with a pose, or several pictures or a video of the "
            "drive: `python -m lanes pose`.",
        ),
        "odd width": (
            f"the lane width of {lane.width_m:.1f} m is implausible (usual: "
            f"{USUAL_WIDTH_M} m): one of the "
            "lines may be a kerb, a crack or a line of another lane, or the road is "
            "unusual.",
            "Check in the panel with the fit which line lies on paint. If all lanes are like this: "
            + pose_advice,
        ),
        "between": (
            f"other lines run between those of the lane: {lane.clear_share:.0%} of the "
            "stripes along it are its own.",
            "Check in the panel with the stripes what lies between the lines: a floor "
            "of tiles, a road with other "
            "markings, or two lanes that are taken for one. If a line of the lane itself lies there: "
            + pose_advice,
        ),
        "weaker line": (
            f"there is paint on {min(left.support, 1):.0%} of the left and "
            f"{min(right.support, 1):.0%} of the right "
            "line.",
            frames,
        ),
        "near std": (
            "the worse line has a standard deviation of "
            f"{lateral_std_m(lane.covariance, 20.0).max():.1f} m at 20 m "
            f"ahead: the paint found ends after {left.reach_m:.0f} m (left) and "
            f"{right.reach_m:.0f} m (right).",
            frames,
        ),
    }
    return words.get(
        feature, (f"{feature!r} contributes least to the confidence.", frames)
    )


def describe_ignored(lane: Lane, fit: Fit) -> str | None:
    """The line with most paint that is none of the lane's or of the adjacent lanes',
    and why; None if there is none.
    """
    stripes = fit.stripes.select(fit.stripes.x_m < FIT.support_far_m)
    # positions beside the car of lines through the stripes that are parallel to the
    # middle of the lane
    beside_m = (
        stripes.y_m - fit.lines_y_m[0].mean(axis=0)[stripes.row] + lane.model[CENTRE]
    )
    taken_m = [line.offset_m for line in (*lane.lines, *lane.adjacent) if line]
    places_m = np.arange(-8.0, 8.0, STRIP_M / 4)
    places_m = places_m[(np.abs(places_m[:, None] - taken_m) > 2 * STRIP_M).all(axis=1)]
    paint = (
        (np.abs(places_m[:, None] - beside_m) < STRIP_M / 2)
        @ stripes.weight
        / fit.visible_rows.max()
    )
    if not len(paint) or paint.max() < LEAST_PAINT:
        return None
    at_m = places_m[paint.argmax()]
    share = min(paint.max(), 1.0)
    side, other = (lane.left, lane.right) if at_m > 0 else (lane.right, lane.left)
    width_m = abs(at_m - other.offset_m)
    reason = (
        f"the lane would be {width_m:.1f} m wide with it (usual: {USUAL_WIDTH_M} m)"
    )
    if abs(width_m - USUAL_WIDTH_M) < abs(lane.width_m - USUAL_WIDTH_M) + WIDTH_STD_M:
        reason = f"the line at {side.offset_m:+.1f} m has paint on {min(side.support, 1):.0%}"
    return f"a line at {at_m:+.1f} m with paint on {share:.0%} of the rows, because {reason}"


def _list_candidates(search: Search, fit: Fit, *, found: bool) -> tuple[Candidate, ...]:
    """The fitted lane, and the other start hypotheses after their fit to the near
    stripes, with what they lack.
    """
    near = search.starts
    chosen = fit.lanes[0]
    lacks = "less paint near the car"
    if fit is not search.fit:
        lacks = "not the tracked lane"
    candidates = [
        Candidate(
            chosen,
            found,
            f"{_describe_place(chosen)}: {_describe_paint(fit.support[0])}",
        )
    ]
    share = near.marked_rows / max(int((fit.view.x_m < FIT.start[-1][0]).sum()), 1)
    for lane, paint in zip(near.lanes, share, strict=True):
        # others are the same lane
        if np.abs(lane - chosen)[[CENTRE, WIDTH]].max() > 0.5:
            why = lacks if is_ego_lane(lane[None])[0] else "not the ego lane"
            candidates.append(
                Candidate(
                    lane,
                    False,
                    f"{_describe_place(lane)}: {why} ({_describe_paint(paint)})",
                )
            )
    return tuple(candidates)


def _describe_place(lane: np.ndarray) -> str:
    left_m, right_m = lane[CENTRE] + SIDES * lane[WIDTH] / 2
    return f"lines at {left_m:+.1f} and {right_m:+.1f} m"


def _describe_paint(support: np.ndarray) -> str:
    left, right = np.minimum(support, 1)
    return f"paint on {left:.0%} left, {right:.0%} right"
