"""Exercises of chapter 8, draw the lane back and track it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from course.exercises.drawings import draw_bar
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, find_mistake, hint
from course.plots import plot_series
from lanes.camera import Camera

# 8.1: distance of the bar, and how far its ends may be off.
BAR_AT_M, TOLERANCE_PX = 7.0, 2.0
# 8.2: seconds of the video that begin beside a car, frames a second, largest offset error (1.06 m without a check, 0.19
# m with that of the solution), and the share of the frames that must have a lane.
ALONGSIDE_S, FPS = (4.68, 7.2), 25
OFFSET_TOLERANCE_M, LEAST_FOUND = 0.4, 0.6

Line = Sequence[float] | np.ndarray
IsPlausible = Callable[[Line, Line], object]


def check_bar(bar_px: np.ndarray, *, left: Line, right: Line, camera: Camera, image: np.ndarray) -> Verdict:
    """8.1: raw pixels (2, 2) of the ends of a bar across the lane; lines are (c2 / 2, c1, c0) in metres.

    The bar is drawn on `image`.
    """
    if np.shape(bar_px) != (2, 2):
        return hint(f"give two points (column, row), an array of shape (2, 2); yours has shape {np.shape(bar_px)}.")
    ends_m = np.array([(BAR_AT_M, np.polyval(line, BAR_AT_M)) for line in (left, right)])
    true_px = camera.road_to_pixels(ends_m)

    mistakes = {
        "the points are (row, column). OpenCV's order is (column, row).": true_px[:, ::-1],
        "you forgot the lens on the way back: these are undistorted pixels.": camera.undistort_points(true_px),
        "left and right are exchanged. y is positive to the left.": true_px[::-1],
        "the sign of y is wrong: it is positive to the left of the car.": camera.road_to_pixels(ends_m * [1, -1]),
    }
    drawn_px = np.asarray(bar_px, float)
    draw_bar(image, drawn_px, true_px)
    off_px = dict(zip(("left", "right"), np.linalg.norm(drawn_px - true_px, axis=1), strict=True))
    if max(off_px.values()) <= TOLERANCE_PX:
        return correct(f"both ends are within {max(*off_px.values(), 0.1):.1f} px.")
    if mistake := find_mistake(drawn_px, mistakes, atol=TOLERANCE_PX):
        return hint(mistake)
    which = " and ".join(f"the {side} end is {off:.0f} px off" for side, off in off_px.items() if off > TOLERANCE_PX)
    return hint(f"{which}. The way: metres, view, undistorted image, through the lens.")


def check_sanity(
    is_plausible: IsPlausible,
    *,
    follow: Callable[[IsPlausible, float, float], np.ndarray],
    lane: tuple[Line, Line],
    truth: Mapping[str, np.ndarray] | None,
) -> Verdict:
    """8.2: the sanity check of a memory, tried on pairs of lines (A, B, C) and on a drive that begins beside a car.

    `follow` gives the offset of each frame between two times, for a memory with a sanity check.
    """
    left, right = lane
    answer = is_plausible(left, right)
    if answer is None:
        return NOT_TRIED
    if not answer:
        return hint("it refuses the lane of chapter 7. The width of a lane is about 3.7 m, give or take half a metre.")
    for sentence, pair in _wrong_pairs(left, right).items():
        if is_plausible(*pair):
            return hint(sentence)
    before, after = (follow(check, *ALONGSIDE_S) for check in (lambda left, right: True, is_plausible))
    return _judge_drive(before, after, truth)


def _wrong_pairs(left: Line, right: Line) -> dict[str, tuple[Line, Line]]:
    """Pairs of lines that are no lane, each with the hint to one who accepts it."""
    spread = np.add(left, (0, 0.35, -0.35 * 719))
    bend = np.array([4.5e-3, -2 * 4.5e-3 * 719, 4.5e-3 * 719**2])
    width = np.array([0, 0, np.polyval(np.subtract(left, right), 719)])
    return {
        "it accepts the same line twice. Which width has a lane?": (left, left),
        "it accepts a lane whose left line is on the right. Which sign has the width?": (right, left),
        "it accepts lines 3.6 m apart near the car and 4.4 m apart 25 m ahead: they are not parallel.": (spread, right),
        "it accepts a bend of 50 m radius. Which curvature can a motorway have?": (right + bend + width, right + bend),
    }


def _judge_drive(before: np.ndarray, after: np.ndarray, truth: Mapping[str, np.ndarray] | None) -> Verdict:
    """Offsets (N,) without and with the sanity check against the truth, and a plot of them."""
    times_s = ALONGSIDE_S[0] + np.arange(len(after)) / FPS
    curves = {"before": before, "with your check": after}
    found = np.mean(np.isfinite(after))
    if truth is not None:
        first = round(ALONGSIDE_S[0] * FPS)
        curves["truth"] = truth["offset_m"][first : first + len(after)]
    plot_series(times_s, {"offset (m)": curves}, title="The memory that begins beside the car")
    if found < LEAST_FOUND:
        return hint(f"only {found:.0%} of the frames have a lane: the check is too strict.")
    if truth is None:
        return correct(f"{found:.0%} of the frames have a lane (no truth known for this video).")
    worst = {name: float(np.nanmax(np.abs(curves[name] - curves["truth"]))) for name in ("before", "with your check")}
    if worst["with your check"] > OFFSET_TOLERANCE_M:
        return hint(f"the offset is still wrong by {worst['with your check']:.1f} m. Which pair does it believe there?")
    return correct(
        f"the offset was wrong by up to {worst['before']:.1f} m, now by {worst['with your check']:.1f} m; "
        f"{found:.0%} of the frames have a lane."
    )


CHECKS: Checks = {"8.1": check_bar, "8.2": check_sanity}
