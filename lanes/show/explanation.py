"""Explanation of a lane detection: every step from the raw image to the lane in metres,
with its numbers.

    image -> pose -> bird's-eye view -> markings -> stripes -> votes or prediction
    -> fit -> lane

It reads the results that the detection or the tracker kept. If no lane was found, or a
doubtful one, it names the step, the reason and what to do.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lanes.camera.field_of_view import OTHER_VIEWS
from lanes.camera.model import Camera, CameraPose, require_camera
from lanes.describe import describe_bend
from lanes.detect.birdseye import lightness
from lanes.detect.confidence import (
    LEAST_CONFIDENCE,
    LIKELY_CONFIDENCE,
    ROAD_WIDTH,
    log_odds_losses,
)
from lanes.detect.evidence import Evidence, strength_weight
from lanes.detect.fit import Fit, FitSettings, near_stripes
from lanes.detect.lane import COASTING, Lane, stated
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
from lanes.telemetry import LOST
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import TimedFrame

# Advice if the pose may be wrong: one that was given, and one that was estimated from
# the files that are explained.
RE_ESTIMATE_POSE = (
    "Estimate the camera pose from pictures of this drive (python -m lanes pose)."
)
OTHER_PICTURES = (
    f"The pose was estimated from these files: give the field of view ({OTHER_VIEWS}), "
    "another part of the video (--start, --end) or pictures that show both lines by "
    "day, or a camera file with the pose (--camera). Annotate stills of several "
    "cameras with --each."
)
# Median lightness of a road that is too dark or too bright to show paint, and the
# smallest range of its lightness, 0 to 255.
BLACK_BELOW = 20
GLARING_ABOVE = 240
LEAST_CONTRAST = 6
# A larger pitch motion, in standard deviations of the prior, is no bump.
MAX_PITCH_STDS = 3
# Stripes parallel to the lane in a strip of this width are a line, if they are on this
# share of the rows. Strips are searched up to this distance to either side, and not so
# near to a line of the lane, where the second stripe of a double one lies.
STRIP_M = 0.4
LEAST_PAINT = 0.1
STRIPS_HALF_WIDTH_M = 8.0
BESIDE_LINE_M = 0.6
# A start hypothesis whose centre or width differs by more is another lane.
OTHER_LANE_M = 0.5


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
    `candidates` are those lanes that a search compared, best first. `history` says
    since when the track has this lane and this pose, in words by name.
    `lanes.show.figures.show_explanation` draws it.
    """

    image: np.ndarray
    camera: Camera
    steps: tuple[Step, ...]
    detection: StillDetection | None = None
    fit: Fit | None = None
    prediction: np.ndarray | None = None
    candidates: tuple[Candidate, ...] = ()
    history: Mapping[str, str] = field(default_factory=dict)

    @property
    def lane(self) -> Lane | None:
        """The lane found, also with a confidence too low to state it."""
        return self.detection.lane if self.detection else None

    @property
    def failed(self) -> Step | None:
        """The step that failed, or that gives a low confidence; None if no step
        failed.
        """
        return self.steps[-1] if self.steps[-1].failure else None

    def describe(self) -> str:
        """Text of several lines: steps, result, failure and advice."""
        lines = [f"{step.name:<10} {step.summary}" for step in self.steps]
        lines += self.describe_result()
        if self.failed:
            lines.append(f"failed at  {self.failed.name}: {self.failed.failure}")
            lines.append(f"what to do {self.failed.advice}")
        return "\n".join(lines)

    def describe_result(self) -> list[str]:
        """Lines of text: the lane, the terms of its confidence, the weakest evidence,
        since when it is tracked, the best rejected lanes.

        Of a lane that is not stated only the place is given.
        """
        words = {"state": LOST}
        if self.lane:
            if stated(self.lane):
                words = self.lane.summary()
            else:
                words["not stated"] = _describe_place(self.lane.model)
            odds = _describe_log_odds(self.lane)
            confidence = f"{self.lane.confidence:.0%}"
            if stated(self.lane):
                confidence += self.lane.describe_reach()
            words["confidence"] = f"{confidence}, {odds}"
            words["weakest"], _ = _weakest_evidence(self.lane, "")
            ignored = describe_ignored(self.lane, self.fit) if self.fit else None
            if ignored:
                words["ignored"] = ignored
            words |= self.history

        lines = [f"{name:<10} {text}" for name, text in words.items()]
        rejected = [lane for lane in self.candidates if not lane.chosen]
        lines += [f"rejected   {lane.reason}" for lane in rejected[:3]]
        return lines

    __str__ = describe

    def __repr__(self) -> str:
        result = f"failed at {self.failed.name}" if self.failed else "all steps passed"
        return f"Explanation({self.lane}, {result})"


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
        advice = _pose_advice(pose_doubt)
        steps = _first_steps(image, camera, pose_doubt)
        steps.append(Step("birdseye", "no road in the picture", str(error), advice))
        return Explanation(image, camera, _up_to_failure(steps))
    return _explain_detection(image, camera, pose_doubt, detection)


class _TrackedFrame(NamedTuple):
    """Time of a frame, state of the lane, whether one of its lines was seen, width of a
    likely lane, number of frames since its track began, and camera pose.
    """

    time_s: float
    state: str
    seen: bool
    width_m: float | None
    track_frames: int
    pose: CameraPose


class _Tracking(NamedTuple):
    """What a tracker adds to a detection: the fit to the frame, the predicted lane
    (15,), the frames before in words, and since when it has lane and pose.
    """

    fit: Fit | None
    prediction: np.ndarray | None
    before: str
    history: Mapping[str, str]


def explain_tracked(
    frames: Iterable[TimedFrame],
    tracker: LaneTracker,
    *,
    pose_doubt: str | None = None,
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
        is_likely = lane is not None and lane.confidence >= LIKELY_CONFIDENCE
        tracked = _TrackedFrame(
            time_s=frame.time_s,
            state=lane.state if lane else LOST,
            seen=lane is not None and any(line.seen for line in lane.evidence),
            width_m=lane.width_m if lane and is_likely else None,
            track_frames=tracker.track_frames,
            pose=tracker.camera.require_pose(),
        )
        track.append(tracked)

    assert tracker.evidence is not None
    detection = StillDetection(
        tracker.evidence, tracker.settings.detector, tracker.search, lane
    )
    predicted = tracker.prediction
    tracking = _Tracking(
        fit=tracker.fit,
        prediction=None if predicted is None else predicted.lane,
        before=_describe_track(track),
        history=_describe_history(track),
    )
    return _explain_detection(
        frame.image, tracker.camera, pose_doubt, detection, tracking
    )


def _explain_detection(
    image: np.ndarray,
    camera: Camera,
    pose_doubt: str | None,
    detection: StillDetection,
    tracking: _Tracking | None = None,
) -> Explanation:
    """Explanation of a detection in an image, or in a frame of a tracker."""
    search = detection.search
    tracking = tracking or _Tracking(None, None, "", {})
    fit = tracking.fit
    if fit is None and search is not None:
        fit = search.fit

    steps = _first_steps(image, camera, pose_doubt)
    steps += _later_steps(detection, fit, tracking, _pose_advice(pose_doubt))
    if detection.lane is not None:
        # A lane was found, so an earlier failure was not decisive.
        steps = [replace(step, failure="", advice="") for step in steps]
        limits = detection.settings.fit
        steps.append(_check_lane(detection.lane, limits, pose_doubt))
    elif tracking.before:
        steps = [_with_track(step, tracking.before) for step in steps]

    candidates: tuple[Candidate, ...] = ()
    if search is not None and fit is not None:
        candidates = _list_candidates(search, fit, found=detection.lane is not None)
    return Explanation(
        image=image,
        camera=camera,
        steps=_up_to_failure(steps),
        detection=detection,
        fit=fit,
        prediction=tracking.prediction,
        candidates=candidates,
        history=tracking.history,
    )


def _pose_advice(pose_doubt: str | None) -> str:
    return RE_ESTIMATE_POSE if pose_doubt is None else OTHER_PICTURES


def _first_steps(
    image: np.ndarray, camera: Camera, pose_doubt: str | None
) -> list[Step]:
    """The image and the camera pose."""
    size = f"{camera.width}x{camera.height} px"
    brightness = f"mean brightness {image.mean():.0f} of 255"
    pose = camera.require_pose().describe()
    return [
        Step("picture", f"{size}, {brightness}"),
        Step("pose", pose, pose_doubt or "", OTHER_PICTURES),
    ]


def _later_steps(
    detection: StillDetection, fit: Fit | None, tracking: _Tracking, pose_advice: str
) -> list[Step]:
    """The steps from the bird's-eye view to the fit."""
    evidence = detection.evidence
    steps = [
        _check_birdseye(evidence),
        _check_markings(evidence, pose_advice),
        _check_stripes(evidence, detection.settings.fit, pose_advice),
    ]
    if detection.search is not None:
        steps.append(_describe_votes(detection.search))
    if tracking.prediction is not None:
        lines = _describe_place(tracking.prediction)
        steps.append(Step("prediction", f"{tracking.before}; {lines}"))
    if fit is not None:
        steps.append(_check_fit(fit, pose_advice))
    return steps


def _with_track(step: Step, before: str) -> Step:
    """The step; its failure, if any, says what was tracked before."""
    if not step.failure:
        return step
    return replace(step, failure=f"{step.failure} Before: {before}.")


def _describe_track(track: Sequence[_TrackedFrame]) -> str:
    """The track before the last frame, in words."""
    *before, now = track
    seen_s = [frame.time_s for frame in before if frame.seen]
    if not seen_s:
        return "no lane was known"
    last_seen_s = seen_s[-1]

    known = [n for n, frame in enumerate(before) if frame.state != LOST]
    following = track[known[-1] + 1]
    if following.state == LOST:
        unseen_s = following.time_s - last_seen_s
        return (
            f"the track was lost at {following.time_s:.2f} s, {unseen_s:.2f} s after "
            "the lane was last seen"
        )

    lost_s = [frame.time_s for frame in before if frame.state == LOST]
    began_s = lost_s[-1] if lost_s else before[0].time_s
    return (
        f"{before[known[-1]].state}, lane known for {now.time_s - began_s:.2f} s and "
        f"last seen {now.time_s - last_seen_s:.2f} s ago"
    )


def _describe_history(track: Sequence[_TrackedFrame]) -> dict[str, str]:
    """Since when the last frame's lane is tracked, and its pose used, in words by name.

    They name the width of the lanes before, and the pose of the first frame. A wrong
    lane that is tracked confidently often began with a change of one of them.
    """
    *_, now = track
    words = {}
    if now.state != LOST:
        began = max(len(track) - 1 - now.track_frames, 0)
        since = f"{track[began].time_s:.2f} s"
        before_m = [frame.width_m for frame in track[:began] if frame.width_m]
        if before_m:
            since += (
                f"; before that, likely lanes were {np.median(before_m):.2f} m wide"
            )
        words["lane since"] = since

    first = len(track) - 1
    while first and track[first - 1].pose == now.pose:
        first -= 1
    if first:
        found = f"{track[first].time_s:.2f} s, from that picture"
        words["pose since"] = f"{found}; at first {track[0].pose.describe()}"
    return words


def _up_to_failure(steps: list[Step]) -> tuple[Step, ...]:
    for number, step in enumerate(steps, start=1):
        if step.failure:
            return tuple(steps[:number])
    return tuple(steps)


def _check_birdseye(evidence: Evidence) -> Step:
    """Check that the road in the bird's-eye view is neither too dark nor too bright to
    show paint, and has contrast.
    """
    view = evidence.view
    levels = lightness(evidence.view_image)[view.seen]
    low, median, high = np.percentile(levels, [0.1, 50, 99.9])
    failure = ""
    if median < BLACK_BELOW:
        failure = f"the road is almost black (median {median:.0f} of 255)."
    elif median > GLARING_ABOVE:
        failure = f"the road is glaring white (median {median:.0f} of 255)."
    elif high - low < LEAST_CONTRAST:
        failure = f"the road has no contrast (grey levels {low:.0f} to {high:.0f})."

    part = f"{view.seen.mean():.0%} of {view.near_m:.0f} to {view.far_m:.0f} m"
    return Step(
        "birdseye",
        f"picture covers {part}, brightness {median:.0f}",
        failure,
        "Take another part (--start, --end). Before a drive clean the windscreen, and "
        "set the exposure for the road.",
    )


def _check_markings(evidence: Evidence, pose_advice: str) -> Step:
    """Check that the marking response is large enough anywhere."""
    settings = evidence.settings
    strength = evidence.response.strength[evidence.view.seen]
    best = strength.max(initial=0)
    least = settings.min_strength
    share = f"{(strength > least).mean():.1%} of the road"
    if "network" in evidence.sources:
        best_p, least_p = strength_weight(np.array([best, least]), settings)
        summary = (
            f"probability of paint up to {best_p:.0%}, {share} above {least_p:.0%}"
        )
        failure = f"no paint is found with a probability above {least_p:.0%}."
    else:
        summary = f"strongest {best:.0f} x noise, {share} above {least:g}"
        failure = (
            "nothing is brighter or yellower than the road on both sides of it and as "
            "wide as a painted line."
        )
    advice = (
        "Check whether the road has lines, and whether the bird's-eye view shows them. "
        "If it does not: "
    )
    return Step(
        "markings", summary, "" if best > least else failure, advice + pose_advice
    )


def _check_stripes(evidence: Evidence, settings: FitSettings, pose_advice: str) -> Step:
    """Check that there are stripes at the near end of the road, where the search
    starts.
    """
    near = len(near_stripes(evidence.stripes, settings))
    near_m, _ = settings.start[-1]
    failure = ""
    if not near:
        failure = f"no stripe is nearer than {near_m} m, where the search starts."
    advice = (
        "Check whether the bonnet or a car hides the road, or the lines end here. If "
        "not: "
    )
    return Step(
        "stripes",
        f"{len(evidence.stripes)} candidates, {near} of them within {near_m} m",
        failure,
        advice + pose_advice,
    )


def _describe_votes(search: Search) -> Step:
    proposed = search.starts.lanes
    bend = describe_bend(proposed[0, CURVATURE])
    best = f"best: {proposed[0, WIDTH]:.1f} m wide, {bend}"
    return Step("votes", f"{len(proposed)} lanes proposed, {best}")


def _check_fit(fit: Fit, pose_advice: str) -> Step:
    """Why no lane was found: the best one is not seen after the fit, or its score is
    too small to start a track.
    """
    support = fit.support[0]
    score = np.sqrt(support).sum()
    failure = "the score of the best lane is too small to start a track"
    if not fit.seen[0]:
        failure = (
            "the best lane and its neighbours have paint on less than "
            f"{fit.settings.min_support:.0%} of the rows"
        )
    advice = (
        "Check in the bird's-eye view whether the road has lines here, and whether "
        "they are parallel. If they are, the car is crossing a line or in a hairpin, "
        "and in a video the tracker bridges it. If they diverge or converge, the "
        "camera pose is wrong. "
    )
    return Step(
        "fit",
        f"score {score:.2f}, {_describe_paint(support)}",
        f"{failure}: the stripes do not line up.",
        advice + pose_advice,
    )


def _check_lane(lane: Lane, settings: FitSettings, pose_doubt: str | None) -> Step:
    """Check the pitch motion and the confidence of the lane found."""
    pose_advice = _pose_advice(pose_doubt)
    failure = ""
    advice = ""
    pitch_rad = abs(lane.pitch_rad)
    if not stated(lane):
        weakness, advice = _weakest_evidence(lane, pose_advice)
        failure = f"{weakness} Below {LEAST_CONFIDENCE:.0%} no lane is stated."
    elif pitch_rad >= MAX_PITCH_STDS * settings.prior.std[PITCH]:
        side = "down" if lane.pitch_rad > 0 else "up"
        turned = f"{np.degrees(pitch_rad):.1f} deg farther {side}"
        failure = f"the camera seems to look {turned} than its pose says."
        advice = f"On a crest or a bump no action is needed. Otherwise: {pose_advice}"
    elif lane.confidence < LIKELY_CONFIDENCE:
        failure, advice = _weakest_evidence(lane, pose_advice)
        if pose_doubt:
            failure = f"{failure} The camera pose is doubtful, too: {pose_doubt}"
            advice = f"{advice.removesuffix(pose_advice)} {pose_advice}"

    confidence = f"confidence {lane.confidence:.0%}"
    summary = f"{lane.state}, {confidence}, score {lane.score:.2f}"
    return Step("lane", summary, failure, advice)


def _describe_log_odds(lane: Lane) -> str:
    """The log odds of the confidence as a sum."""
    terms = lane.log_odds_terms
    summands = [f"{term:+z.2f} ({name})" for name, term in terms.items()]
    return f"log odds {sum(terms.values()):+z.2f} = {' '.join(summands)}"


def _weakest_evidence(lane: Lane, pose_advice: str) -> tuple[str, str]:
    """What speaks most against a lane, likely or not, and what to do."""
    unseen = []
    if not lane.left.seen:
        unseen.append("left")
    if not lane.right.seen:
        unseen.append("right")
    if lane.state == COASTING and len(unseen) == 2:
        return (
            "neither line is seen; the lane is predicted from the frames before.",
            "No action is needed if a car or a shadow hides the lines for less than a "
            "second.",
        )
    if unseen:
        advice = (
            "If the road has no such line, no action is needed: in a video the tracker "
            "keeps the lane width from earlier frames. If it has one, and the lines "
            "are not parallel in the bird's-eye view, the camera pose is wrong. "
        )
        return (
            f"the {unseen[0]} line is not seen; its position follows from the other "
            "line and the usual lane width.",
            advice + pose_advice,
        )

    losses = log_odds_losses(lane.features)
    feature = max(losses, key=losses.__getitem__)
    if losses[feature] < 1:  # no weakness
        feature = "weaker line"
    return _describe_weakness(lane, feature, pose_advice)


def _describe_weakness(lane: Lane, feature: str, pose_advice: str) -> tuple[str, str]:
    """A feature of the confidence in words, and what to do if it is bad."""
    advice = "No action is needed if the next frames are better."
    if not lane.tracked:
        advice = "Use the video instead of a still: the tracker combines many frames."
    left, right = lane.lines
    match feature:
        case "odd heading":
            return _describe_odd_heading(lane, pose_advice)
        case "other lanes":
            return _describe_other_lanes(lane)
        case "odd width":
            return _describe_odd_width(lane, pose_advice)
        case "clear share":
            return _describe_clutter(lane, pose_advice)
        case "weaker line":
            left_paint = f"{min(left.support, 1):.0%} of the left"
            right_paint = f"{min(right.support, 1):.0%} of the right"
            return f"there is paint on {left_paint} and {right_paint} line.", advice
        case "near std":
            std_m = lateral_std_m(lane.covariance, 20.0).max()
            weakness = (
                f"the worse line has a standard deviation of {std_m:.1f} m at 20 m "
                f"ahead: the paint found ends after {left.reach_m:.0f} m (left) and "
                f"{right.reach_m:.0f} m (right)."
            )
            return weakness, advice
    return f"{feature!r} contributes least to the confidence.", advice


def _describe_odd_heading(lane: Lane, pose_advice: str) -> tuple[str, str]:
    yaw_rad = lane.camera_yaw_rad or 0.0
    heading_rad = abs(lane.heading_rad)
    if abs(yaw_rad) > heading_rad and stated(lane):
        return f"{describe_wrong_yaw(-yaw_rad)}.", pose_advice
    return (
        f"the lane points {np.degrees(heading_rad):.1f} deg away from the car's "
        "direction, more than in a usual bend or lane change.",
        f"In a sharp lane change no action is needed. Otherwise: {pose_advice}",
    )


def _describe_other_lanes(lane: Lane) -> tuple[str, str]:
    return (
        f"only {lane.same_lane_share:.0%} of the camera poses that fit this "
        "picture show this lane, because one picture shows the pose only roughly.",
        "Give a camera file with a pose, or several pictures or a video of the drive: "
        "`python -m lanes pose`.",
    )


def _describe_odd_width(lane: Lane, pose_advice: str) -> tuple[str, str]:
    return (
        f"the lane width of {lane.width_m:.1f} m is implausible (usual: "
        f"{lane.usual_width.mean_m:.1f} m): one of the lines may be a kerb, a crack or "
        "a line of another lane, or the road is unusual.",
        "Check in the panel with the fit which line lies on paint. If all lanes are "
        f"like this: {pose_advice}",
    )


def _describe_clutter(lane: Lane, pose_advice: str) -> tuple[str, str]:
    return (
        "other lines run between those of the lane: "
        f"{lane.clear_share:.0%} of the stripes along it are its own.",
        "Check in the panel with the stripes what lies between the lines: a floor of "
        "tiles, a road with other markings, or two lanes that are taken for one. If a "
        f"line of the lane itself lies there: {pose_advice}",
    )


def describe_ignored(lane: Lane, fit: Fit) -> str | None:
    """The line with most paint that is none of the lane's or of the adjacent lanes',
    and why; None if there is none.
    """
    # Lines through the stripes, parallel to the middle of the lane, pass the car here.
    stripes = fit.stripes.select(fit.stripes.x_m < fit.settings.support_far_m)
    middle_y_m = fit.lines_y_m[0].mean(axis=0)
    beside_m = stripes.y_m - middle_y_m[stripes.row] + lane.model[CENTRE]
    # the lane of a hairpin turns back before some stripes
    is_beside = np.isfinite(beside_m)
    stripes = stripes.select(is_beside)
    beside_m = beside_m[is_beside]

    # strips away from the lines that were found
    found_m = [line.offset_m for line in (*lane.lines, *lane.adjacent) if line]
    strips_m = np.arange(-STRIPS_HALF_WIDTH_M, STRIPS_HALF_WIDTH_M, STRIP_M / 4)
    from_found_m = np.abs(strips_m[:, None] - found_m)
    free_m = strips_m[(from_found_m > BESIDE_LINE_M).all(axis=1)]

    # the strip with paint on most rows
    in_strip = np.abs(free_m[:, None] - beside_m) < STRIP_M / 2
    paint = in_strip @ stripes.weight / fit.visible_rows.max()
    if not len(paint) or paint.max() < LEAST_PAINT:
        return None
    share = min(paint.max(), 1.0)
    weight = in_strip[paint.argmax()] * stripes.weight
    ignored_m = float(np.average(beside_m, weights=weight))

    from_left_m = ignored_m - lane.left.offset_m
    from_right_m = ignored_m - lane.right.offset_m
    if abs(from_left_m) < abs(from_right_m):
        place = _describe_distance(from_left_m, "left")
    else:
        place = _describe_distance(from_right_m, "right")
    return (
        f"a line at {ignored_m:+.1f} m, {place}, with paint on {share:.0%} of the "
        f"rows, because {_why_ignored(lane, ignored_m)}"
    )


def _describe_distance(distance_m: float, line: str) -> str:
    """How far to the left (> 0) of the left or right line, in words."""
    direction = "left" if distance_m > 0 else "right"
    return f"{abs(distance_m):.1f} m {direction} of the {line} line"


def _why_ignored(lane: Lane, ignored_m: float) -> str:
    """Why the lane has another line than the one at `ignored_m` to the left."""
    chosen, other = (lane.right, lane.left)
    if ignored_m > 0:
        chosen, other = (lane.left, lane.right)
    width_m = abs(ignored_m - other.offset_m)
    usual_m = lane.usual_width.mean_m
    unusual_m = abs(width_m - usual_m)
    if unusual_m < abs(lane.width_m - usual_m) + ROAD_WIDTH.std_m:
        share = min(chosen.support, 1)
        return f"the line at {chosen.offset_m:+.1f} m has paint on {share:.0%}"
    return f"the lane would be {width_m:.1f} m wide with it (usual: {usual_m:.1f} m)"


def _list_candidates(search: Search, fit: Fit, *, found: bool) -> tuple[Candidate, ...]:
    """The fitted lane, and the other start hypotheses after their fit to the near
    stripes, with what they lack.
    """
    chosen = fit.lanes[0]
    reason = f"{_describe_place(chosen)}: {_describe_paint(fit.support[0])}"
    candidates = [Candidate(chosen, found, reason)]

    starts = search.starts
    near_m, _ = fit.settings.start[-1]
    rows = int((fit.view.x_m < near_m).sum())
    share = starts.marked_rows / max(rows, 1)
    for lane, support in zip(starts.lanes, share, strict=True):
        difference_m = np.abs(lane - chosen)[[CENTRE, WIDTH]]
        if difference_m.max() <= OTHER_LANE_M:
            continue
        if not is_ego_lane(lane[None])[0]:
            lacks = "not the ego lane"
        elif fit is not search.fit:
            lacks = "not the tracked lane"
        else:
            lacks = "less paint near the car"
        reason = f"{_describe_place(lane)}: {lacks} ({_describe_paint(support)})"
        candidates.append(Candidate(lane, False, reason))
    return tuple(candidates)


def _describe_place(lane: np.ndarray) -> str:
    left_m, right_m = lane[CENTRE] + SIDES * lane[WIDTH] / 2
    return f"lines at {left_m:+.1f} and {right_m:+.1f} m"


def _describe_paint(support: np.ndarray) -> str:
    left, right = np.minimum(support, 1)
    return f"paint on {left:.0%} left, {right:.0%} right"
