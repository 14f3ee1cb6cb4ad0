"""Detection without memory: the ego lane of a single picture."""

from __future__ import annotations

import numpy as np

from lanes.io.frames import Frame
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.fitting import LaneFit, fit_starts, near_stripes
from lanes.tracking.lane import Lane
from lanes.tracking.lines import (
    LINES,
    describe_lane,
    inner_stripe_shift,
    line_support,
    observe_lines,
)
from lanes.tracking.markings import FrameEvidence, Stripes, extract_evidence
from lanes.tracking.model import CENTRE, WIDTH, ego_score
from lanes.tracking.voting import vote_lanes

# Lanes whose centre or width differs by more than this are different lanes; tuned on the labelled Udacity stills.
RIVAL_M = 0.5


def find_lane(image: Frame, view: BirdsEyeView) -> Lane | None:
    """Find the ego lane in a single picture.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8, or YuvFrame
        RGB, or as its video stores it; raw.
    view : BirdsEyeView
        Of the camera that took it.

    Returns
    -------
    Lane or None
        None if neither line is seen.

    Raises
    ------
    PictureError
        If the picture is not RGB or not of the camera's size.
    CameraError
        If the camera has no pose, or sees no road.
    """
    return search_lane(extract_evidence(image, view), view)


def search_lane(evidence: FrameEvidence, view: BirdsEyeView) -> Lane | None:
    """The ego lane in the evidence of one frame; None if neither line is seen."""
    fit = fit_hypotheses(evidence.stripes, view)
    return choose_lane(fit, evidence) if fit else None


def fit_hypotheses(stripes: Stripes, view: BirdsEyeView) -> LaneFit | None:
    """The lanes that the stripes vote for, fitted; None if there are no stripes near the car."""
    if not len(near_stripes(stripes)):
        return None
    _, starts = vote_lanes(stripes, view)
    return fit_starts(starts, stripes, view)


def choose_lane(fit: LaneFit, evidence: FrameEvidence) -> Lane | None:
    """The fitted lane with the best score; None if neither of its lines is seen."""
    support = line_support(fit)
    score = ego_score(fit.lane, support)
    best = int(score.argmax())
    if support[best].max() < LINES.min_support:
        return None
    rivals = np.abs(fit.lane - fit.lane[best])[:, [CENTRE, WIDTH]].max(axis=1) > RIVAL_M
    observations = observe_lines(fit, evidence, index=best)
    model = fit.lane[best] + inner_stripe_shift([line.profile for line in observations])
    return describe_lane(
        model,
        np.linalg.inv(fit.information[best]),
        observations,
        score=float(score[best]),
        margin=float(score[best] - score[rivals].max(initial=0.0)),
    )
