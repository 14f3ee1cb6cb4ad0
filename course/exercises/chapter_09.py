"""Exercise of chapter 9, go from pixels to metres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from course.exercises.verdict import NOT_TRIED, Verdict, correct, find_mistake, hint
from lanes.camera import Camera, CameraPose

# Largest relative error of the answer. The small-angle formula is within 0.2 % of the camera's projection.
TOLERANCE = 0.02


@dataclass(frozen=True)
class PitchError:
    """A camera whose assumed pitch is `error_deg` too large, and a straight lane in its bird's-eye view."""

    height_m: float
    true_width_m: float
    true_distance_m: float
    error_deg: float

    def seen(self) -> tuple[float, float]:
        """The width of the lane in the view, and the distance at which the view shows it, metres."""
        pose = CameraPose(self.height_m, pitch_rad=np.radians(1.5))
        camera = Camera.from_fov((1280, 720), 60, pose)
        assumed = camera.with_pose(replace(pose, pitch_rad=pose.pitch_rad + np.radians(self.error_deg)))
        ends_m = [(self.true_distance_m, side * self.true_width_m / 2) for side in (1, -1)]
        (distance_m, left_m), (_, right_m) = assumed.pixels_to_road(camera.road_to_pixels(np.array(ends_m)))
        return left_m - right_m, distance_m


# Cameras of a car and a lorry; the view looks too far down and too far up.
CASES = (
    PitchError(1.30, 3.66, 30.0, 0.3),
    PitchError(1.30, 3.66, 30.0, -0.3),
    PitchError(2.40, 3.00, 18.0, 1.0),
    PitchError(1.55, 3.75, 42.0, -0.2),
)


def check_pitch_error(pitch_error_deg: Callable[[float, float, float, float], float]) -> Verdict:
    """9.1: the pitch error that makes a lane look too narrow or too wide, degrees."""
    seen = [case.seen() for case in CASES]
    answers = [
        pitch_error_deg(width_m, distance_m, case.height_m, case.true_width_m)
        for case, (width_m, distance_m) in zip(CASES, seen, strict=True)
    ]
    if any(answer is None for answer in answers):
        return NOT_TRIED
    if any(np.ndim(answer) for answer in answers):
        return hint("return one number, the error in degrees.")
    found, true = np.array(answers, float), np.array([case.error_deg for case in CASES])
    if np.allclose(found, true, rtol=TOLERANCE, atol=0):
        return correct(
            f"{len(CASES)} errors from {true.min()} to {true.max()} degrees are right within {TOLERANCE:.0%}."
        )
    stretch = np.array([case.true_width_m / width_m for case, (width_m, _) in zip(CASES, seen, strict=True)])
    mistakes = {
        "your answer is in radians. Use np.degrees.": np.radians(true),
        "the sign is wrong. If the lane looks too narrow, the assumed pitch is too large.": -true,
        "distance_m is the distance in the view, X'. The true one is X = X' w / w'.": true * stretch,
        "the ratio of the widths is upside down. If w' < w, the true distance is larger than X'.": -true * stretch,
        "the height is missing: the ray falls by h / X, not by 1 / X.": true / [case.height_m for case in CASES],
    }
    said = f"a lane {CASES[0].true_width_m} m wide that looks {seen[0][0]:.2f} m wide at {seen[0][1]:.1f} m: "
    said += f"yours is {found[0]:.3f}, true {true[0]:.3f}"
    if mistake := find_mistake(found, mistakes, rtol=TOLERANCE):
        return hint(f"{said}; {mistake}")
    return hint(
        f"{said} degrees. The ray falls by h / X' in the view, and by h / X on the road. Compare the two; take "
        "height and width from the arguments."
    )


CHECKS = {"9.1": check_pitch_error}
