"""Checks of the steps of lane detection in one picture: summary, failure and advice for each step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.camera import Camera
from lanes.io.describe import describe_bend
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.confidence import CONFIDENCE, FEATURES, LIKELY_CONFIDENCE, feature_weights, lane_features
from lanes.tracking.fitting import FIT, near_stripes
from lanes.tracking.lane import Lane
from lanes.tracking.markings import MARKINGS, FrameEvidence, lightness, strength_weight
from lanes.tracking.model import CURVATURE, PITCH, PRIOR_STD, WIDTH, lateral_std_m
from lanes.tracking.tracker import TRACKER, TrackedLane

# Median grey levels (of 255) below and above which hardly any paint is visible, and the least range of grey levels of
# a road with visible paint.
DARK, BRIGHT, FLAT = 20, 240, 8
# Lanes with nothing between their lines have a larger share of stripes on them.
USUAL_CLEAR_SHARE = 0.9
# Pitch motion beyond three prior standard deviations is not caused by a bump.
MAX_PITCH_RAD = 3 * PRIOR_STD[PITCH]

RE_ESTIMATE_POSE = "Estimate the camera pose again from pictures of this drive (python -m lanes pose)."


@dataclass(frozen=True)
class Step:
    """One step of the detection: name, numbers as text, and reason and advice if it failed."""

    name: str
    summary: str
    failure: str = ""
    advice: str = ""


def describe_input(image: np.ndarray, camera: Camera, pose_failure: str) -> list[Step]:
    """The picture and the camera pose; `pose_failure` says why the pose is only assumed, and is empty otherwise."""
    picture = Step("picture", f"{image.shape[1]}x{image.shape[0]} px, mean brightness {image.mean():.0f} of 255")
    pose = camera.require_pose().describe()
    if pose_failure:
        return [picture, Step("pose", f"assumed, {pose}", pose_failure, RE_ESTIMATE_POSE)]
    return [picture, Step("pose", pose)]


def check_birdseye(evidence: FrameEvidence, view: BirdsEyeView) -> Step:
    """Check that the road in the bird's-eye view is neither too dark nor too bright, and has contrast."""
    levels = lightness(evidence.view_image)[view.seen]
    low, median, high = np.percentile(levels, [0.1, 50, 99.9])
    summary = f"picture covers {view.seen.mean():.0%} of {view.near_m:g} to {view.far_m:g} m, brightness {median:.0f}"
    failure = advice = ""
    if median < DARK:
        failure = f"the road is almost black (median {median:.0f} of 255)."
        advice = "Set the exposure for the road, switch on the headlights, or skip this part of the drive."
    elif median > BRIGHT:
        failure = f"the road is glaring white (median {median:.0f} of 255)."
        advice = "Set the exposure for the road, or clean the windscreen. There is no remedy for low sun."
    elif high - low < FLAT:
        failure = f"the road has no contrast (grey levels {low:.0f} to {high:.0f})."
        advice = "Check for fog, dirt or blur, and whether the camera looks at the road."
    return Step("birdseye", summary, failure, advice)


def check_markings(evidence: FrameEvidence, view: BirdsEyeView) -> Step:
    """Check that the marking response is large enough anywhere."""
    strength, minimum = evidence.response.strength[view.seen], MARKINGS.min_strength
    best, share = strength.max(initial=0), (strength > minimum).mean()
    summary = f"strongest {best:.0f} x noise, {share:.1%} of the road above {minimum:g}"
    failure = "nothing is brighter or yellower than the road on both sides of it and as wide as a painted line."
    if evidence.response.learned:
        best_p, minimum_p = strength_weight(np.array([best, minimum]))
        summary = f"probability of paint up to {best_p:.0%}, {share:.1%} of the road above {minimum_p:.0%}"
        failure = f"the network finds no paint with a probability above {minimum_p:.0%}."
    if best > minimum:
        return Step("markings", summary)
    advice = "Check whether the road has lines, and whether the bird's-eye view shows them. If it does not: "
    return Step("markings", summary, failure, advice + RE_ESTIMATE_POSE)


def check_stripes(evidence: FrameEvidence) -> Step:
    """Check that there are stripes at the near end of the road, where the search starts."""
    count, near = len(evidence.stripes), len(near_stripes(evidence.stripes))
    summary = f"{count} candidates, {near} of them within {FIT.start[-1][0]} m"
    if near:
        return Step("stripes", summary)
    failure = f"no stripe is nearer than {FIT.start[-1][0]} m, where the search starts."
    advice = "Check whether the bonnet or a car hides the road, or the lines end here. If not: "
    return Step("stripes", summary, failure, advice + RE_ESTIMATE_POSE)


def describe_votes(starts: np.ndarray) -> Step:
    """Describe the best of the lanes (K, 15) with the most votes."""
    width_m, bend = starts[0, WIDTH], describe_bend(float(starts[0, CURVATURE]))
    return Step("votes", f"{len(starts)} lanes proposed, best: {width_m:.1f} m wide, {bend}")


def check_fit(score: float, support: np.ndarray, *, seen: bool) -> Step:
    """Check that the best lane is seen after the fit; `support` (2,) is that of its two lines."""
    summary = f"score {score:.2f}, paint on {support[0]:.0%} left, {support[1]:.0%} right"
    if seen:
        return Step("fit", summary)
    return Step(
        "fit",
        summary,
        f"the lines of the best lane and its neighbours have paint on less than {FIT.min_support:.0%} of the rows: the "
        "stripes do not line up.",
        "Check in the bird's-eye view whether the road has lines here, and whether they are parallel. If they are, the "
        "car is crossing a line or in a hairpin, and in a video the tracker bridges it. If they diverge or converge, "
        "the camera pose is wrong. " + RE_ESTIMATE_POSE,
    )


def check_lane(lane: Lane) -> Step:
    """Check the confidence and the pitch motion of the lane found."""
    confidence = TrackedLane.from_still(lane).confidence
    summary = f"confidence {confidence:.0%}, margin over the next lane {lane.margin or 0:.2f}"
    if abs(lane.pitch_rad) >= MAX_PITCH_RAD:
        turned = f"{np.degrees(abs(lane.pitch_rad)):.1f} deg farther {'down' if lane.pitch_rad > 0 else 'up'}"
        failure = f"the camera seems to look {turned} than its pose says."
        return Step("lane", summary, failure, RE_ESTIMATE_POSE + " On a crest or a bump no action is needed.")
    if confidence < LIKELY_CONFIDENCE:
        return Step("lane", summary, *_explain_low_confidence(lane))
    return Step("lane", summary)


def _explain_low_confidence(lane: Lane) -> tuple[str, str]:
    """Failure and advice for the most likely cause of a low confidence."""
    unseen = [name for name, line in (("left", lane.left), ("right", lane.right)) if not line.seen]
    if lane.score < TRACKER.min_score:
        return (
            f"hardly any paint supports the lane (score {lane.score:.2f}; "
            f"the tracker starts from {TRACKER.min_score} on).",
            "Check in the panels with the marking response and the stripes whether the road has lines here.",
        )
    if unseen:
        return (
            f"the {unseen[0]} line is not seen; its position follows from the other line and the usual lane width.",
            "If the road has no such line, no action is needed: in a video the tracker keeps the lane width from "
            "earlier frames. If it has one, and the lines are not parallel in the bird's-eye view, the camera pose is "
            "wrong. " + RE_ESTIMATE_POSE,
        )
    if _is_the_cause(lane, "other lanes"):
        return (
            f"only {lane.same_lane_share:.0%} of the camera poses that fit this picture show this lane, because one "
            "picture shows the pose only roughly.",
            "Give a camera file with a pose, or several pictures or a video of the drive: `python -m lanes pose`.",
        )
    if _is_the_cause(lane, "odd heading"):
        return (
            f"the lane points {np.degrees(abs(lane.heading_rad)):.1f} deg away from the car's direction, more than "
            "in a usual bend or lane change.",
            RE_ESTIMATE_POSE + " In a sharp lane change no action is needed.",
        )
    if _is_the_cause(lane, "odd width"):
        return (
            f"the lane width of {lane.width_m:.1f} m is implausible (usual: {CONFIDENCE.usual_width_m} m): one of the "
            "lines may be a kerb, a crack or a line of another lane, or the road is unusual.",
            "Check in the panel with the fit which line lies on paint. If all lanes are like this: " + RE_ESTIMATE_POSE,
        )
    tiles = _describe_tiles(lane)
    if tiles and _is_the_cause(lane, "between", "transverse"):
        return (
            tiles + ".",
            "Check in the panel with the stripes what lies between the lines: a floor of tiles, a crossing, or a road "
            "with other markings. If a line of the lane itself lies there: " + RE_ESTIMATE_POSE,
        )
    std_m = lateral_std_m(lane.covariance, 20.0).max()
    return (
        f"the worse line has a standard deviation of {std_m:.1f} m at 20 m ahead: the paint found "
        f"ends after {lane.left.reach_m:.0f} m (left) and {lane.right.reach_m:.0f} m (right).",
        "Use the video instead of a still: the tracker combines many frames.",
    )


def _describe_tiles(lane: Lane) -> str:
    """Lines across the lane and between its own, as tiles have them; empty if there are none."""
    parts = []
    if lane.transverse_stripes:
        parts.append(f"painted stripes cross the lane ({lane.transverse_stripes} of them)")
    if lane.clear_share < USUAL_CLEAR_SHARE:
        share = f"of the stripes along it only {lane.clear_share:.0%} are on its lines"
        parts.append(f"other lines run between those of the lane: {share}")
    return ", and ".join(parts)


def _is_the_cause(lane: Lane, *features: str) -> bool:
    """Whether the confidence would be high enough without these features."""
    log_odds = lane_features(lane) * feature_weights(lane)
    without = log_odds.sum() - sum(log_odds[FEATURES.index(feature)] for feature in features)
    return bool(without >= np.log(LIKELY_CONFIDENCE / (1 - LIKELY_CONFIDENCE)))
