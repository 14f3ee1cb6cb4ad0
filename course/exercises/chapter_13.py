"""Exercise of chapter 13, explain a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, hint
from lanes.camera import Camera
from lanes.explain import explain

# A camera that looks 60 degrees too far down sees no road beyond the bonnet, so a step fails before.
MAX_DEG = 60


def check_first_failure(
    first_failure: Callable[[np.ndarray, Camera], Any], *, images: Mapping[str, np.ndarray], camera: Camera
) -> Verdict:
    """13.1: the smallest pitch error, whole degrees down, at which a step fails, and the name of the step."""
    reached = []
    for name, image in images.items():
        found = first_failure(image.copy(), camera)
        if found is None:
            return NOT_TRIED
        if not isinstance(found, (tuple, list)) or len(found) != 2 or np.ndim(found[0]):
            return hint("return two values: the number of degrees and the name of the step.")
        found, expected = tuple(found), _first_failure(image, camera)
        if found != expected:
            return hint(f"{name}: {_explain_difference(found, expected, image, camera)}")
        reached.append(f"{name} fails from {expected[0]} deg on, step {expected[1]!r}")
    return correct(f"{'; '.join(reached)}.")


def _explain_difference(found: tuple, expected: tuple[int, str], image: np.ndarray, camera: Camera) -> str:
    """What is wrong with an answer (degrees, step) for one image."""
    degrees = found[0]
    if degrees == expected[0]:
        return f"{degrees} deg is right, but the second value is not the name of the failed step: take `.failed.name`."
    if found == _first_failure(image, camera, unit_rad=1.0):
        return "pitch_rad is in radians. Convert the degrees with np.radians."
    reasons = []
    if degrees == expected[0] - 1:
        reasons.append(f"at {degrees} deg no step fails yet. Return the first number at which one fails.")
    if found == _first_failure(image, camera, unit_rad=-np.radians(1)):
        reasons.append("you turned the camera up. A positive pitch looks down.")
    return " Or ".join(reasons) or (
        f"you say {degrees} deg, but a step fails at {expected[0]} deg. Try 0, 1, 2, ... degrees in "
        "turn; add them to the pitch of `camera`, not to that of the last try."
    )


def _first_failure(image: np.ndarray, camera: Camera, *, unit_rad: float = np.radians(1)) -> tuple[int, str]:
    """The smallest number of units of pitch at which a step fails, and its name."""
    pose = camera.require_pose()
    for count in range(MAX_DEG):
        turned = camera.with_pose(replace(pose, pitch_rad=pose.pitch_rad + count * unit_rad))
        if failed := explain(image, turned).failed:
            return count, failed.name
    return MAX_DEG, ""


CHECKS = {"13.1": check_first_failure}
