"""The steps of finding a lane, judged: what each made of a picture, where it failed, why, and what to do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.camera import Camera
from lanes.io.describe import describe_bend
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.confidence import FEATURES, STILL_WEIGHTS, USUAL_WIDTH_M, lane_features, lateral_std_m
from lanes.tracking.detector import near_stripes
from lanes.tracking.fitting import START
from lanes.tracking.lane import Lane
from lanes.tracking.lines import LEAST_SUPPORT
from lanes.tracking.markings import LEAST_STRENGTH, FrameEvidence, lightness
from lanes.tracking.model import CURVATURE, PITCH, PRIOR_STD, WIDTH
from lanes.tracking.tracked_lane import TrackedLane
from lanes.tracking.tracker import LEAST_SCORE

# A road this dark or this bright (grey levels of 255) shows next to nothing of its paint; and one whose grey levels
# spread less than this has none, or something lies before the lens.
DARK, GLARING, FLAT = 20, 240, 8
# Below this probability a lane is rather wrong than right, and said to be unsure.
UNSURE = 0.5
# A frame's own pitch beyond three standard deviations of what cars do is no bump.
ODD_PITCH_RAD = 3 * PRIOR_STD[PITCH]

POSE_AGAIN = "Estimate the camera pose again from pictures of this very drive (python -m lanes pose)."


@dataclass(frozen=True)
class Step:
    """One step: its name, its numbers in words; where it failed, why, and what to do."""

    name: str
    words: str
    failure: str = ""
    advice: str = ""


def judge_picture(image: np.ndarray) -> Step:
    """Size and brightness."""
    return Step("picture", f"{image.shape[1]}x{image.shape[0]} px, mean brightness {image.mean():.0f} of 255")


def judge_pose(camera: Camera, trouble: str) -> Step:
    """Where the camera is thought to sit, and why that is a mere assumption, if it is one."""
    if trouble:
        return Step("pose", f"assumed, {camera.pose.describe()}", trouble, POSE_AGAIN)
    return Step("pose", camera.pose.describe())


def judge_birdseye(evidence: FrameEvidence, view: BirdsEyeView) -> Step:
    """How much road is seen, and how well it is lit."""
    levels = lightness(evidence.view_image)[view.seen]
    low, middle, high = np.percentile(levels, [0.1, 50, 99.9])
    words = f"picture covers {view.seen.mean():.0%} of {view.near_m:g} to {view.far_m:g} m, brightness {middle:.0f}"
    if middle < DARK:
        return Step(
            "view",
            words,
            f"the road is almost black (median {middle:.0f} of 255).",
            "Let the camera expose for the road, switch on the headlights, or skip this stretch.",
        )
    if middle > GLARING:
        return Step(
            "view",
            words,
            f"the road is glaring white (median {middle:.0f} of 255).",
            "Let the camera expose for the road, or wipe the windscreen; low sun cannot be helped.",
        )
    if high - low < FLAT:
        return Step(
            "view",
            words,
            f"the road has no contrast (grey levels {low:.0f} to {high:.0f}).",
            "See whether fog, dirt or blur lies before the lens, and whether the camera looks at the road at all.",
        )
    return Step("view", words)


def judge_markings(evidence: FrameEvidence, view: BirdsEyeView) -> Step:
    """Whether anything looks painted."""
    strength = evidence.response.strength[view.seen]
    best = float(strength.max(initial=0))
    words = (
        f"strongest {best:.0f} x noise, {(strength > LEAST_STRENGTH).mean():.1%} of the road above {LEAST_STRENGTH:g}"
    )
    if best > LEAST_STRENGTH:
        return Step("paint", words)
    return Step(
        "paint",
        words,
        "nothing is brighter or yellower than the road on both its sides and as wide as painted lines are.",
        "Look whether the road has lines at all, and whether they are in the view from above; if not: " + POSE_AGAIN,
    )


def judge_stripes(evidence: FrameEvidence) -> Step:
    """Whether there are stripes where the search begins."""
    count, near = len(evidence.stripes), len(near_stripes(evidence.stripes))
    words = f"{count} candidates, {near} of them within {START[-1][0]} m"
    if near:
        return Step("stripes", words)
    return Step(
        "stripes",
        words,
        f"no stripe is nearer than {START[-1][0]} m, where the search begins.",
        "See whether the bonnet or a car hides the road, or the lines end here; else: " + POSE_AGAIN,
    )


def judge_votes(starts: np.ndarray) -> Step:
    """What the stripes suggest, lanes (K, 15)."""
    best = starts[0]
    return Step(
        "votes",
        f"{len(starts)} lanes suggested, best: {best[WIDTH]:.1f} m wide, {describe_bend(float(best[CURVATURE]))}",
    )


def judge_fit(score: float, support: np.ndarray) -> Step:
    """The best lane after the fit, with the supports (2,) of its lines."""
    words = f"score {score:.2f}, paint on {support[0]:.0%} left, {support[1]:.0%} right"
    if support.max() >= LEAST_SUPPORT:
        return Step("fit", words)
    return Step(
        "fit",
        words,
        f"neither line of the best lane has paint on {LEAST_SUPPORT:.0%} of its rows: the stripes do not line up.",
        "See in the view from above whether the road has lines here, and whether they run side by side. If they do, "
        "the car is crossing a line or in a hairpin, and a video bridges it; if they spread or close, the pose is "
        "wrong. " + POSE_AGAIN,
    )


def judge_lane(lane: Lane) -> Step:
    """The lane, and whether to believe it."""
    confidence = TrackedLane.from_still(lane).confidence
    words = f"confidence {confidence:.0%}, margin over the next lane {lane.margin:.2f}"
    if confidence >= UNSURE and abs(lane.pitch_rad) < ODD_PITCH_RAD:
        return Step("lane", words)
    if abs(lane.pitch_rad) >= ODD_PITCH_RAD:
        way = "down" if lane.pitch_rad > 0 else "up"
        why = f"the camera seems to look {np.degrees(abs(lane.pitch_rad)):.1f} deg farther {way} than its pose says."
        return Step("lane", words, why, POSE_AGAIN + " On a crest or a bump it passes by itself.")
    unseen = [name for name, line in (("left", lane.left), ("right", lane.right)) if not line.seen]
    if lane.score < LEAST_SCORE:
        why = f"hardly any paint supports it (score {lane.score:.2f}; a video starts from {LEAST_SCORE} on)."
        advice = "See in the paint and the stripes whether the road has lines at all here."
    elif unseen:
        why = f"the {unseen[0]} line is not seen; its place follows from the other one and the usual width."
        advice = (
            "Nothing is wrong if the road has no such line: a video carries the width over from where it was seen. If "
            "it has one, and the lines do not run side by side in the view from above, the camera pose is wrong. "
            + POSE_AGAIN
        )
    elif _width_is_to_blame(lane):
        why = (
            f"a lane {lane.width_m:.1f} m wide is odd (usual: {USUAL_WIDTH_M} m): the road is no usual one, or one of "
            "the lines is a kerb, a crack or another lane's."
        )
        advice = "See in the fit which of the two lines lies on paint; if all lanes come out like this: " + POSE_AGAIN
    else:
        why = (
            f"the worse line is known to no more than {lateral_std_m(lane, 20.0):.1f} m at 20 m ahead: the paint found "
            f"ends after {lane.left.reach_m:.0f} m (left) and {lane.right.reach_m:.0f} m (right)."
        )
        advice = "Use the video instead of a still: the tracker adds up what many frames show."
    return Step("lane", words, why, advice)


def _width_is_to_blame(lane: Lane) -> bool:
    """Whether the lane would be believed if it were as wide as others."""
    parts = lane_features(lane) * STILL_WEIGHTS
    return bool(parts.sum() - parts[FEATURES.index("odd width")] >= np.log(UNSURE / (1 - UNSURE)))
