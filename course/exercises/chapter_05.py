"""Exercises of chapter 5, separate paint from road."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from classic.search import binary_pixels
from classic.warp import FourPointWarp, birdseye_to_road
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint
from course.measures import marking_precision, marking_recall
from lanes.camera import Camera

MakeMask = Callable[[np.ndarray], "np.ndarray | None"]

# Between the best combination of the published masks (precision 88 %) and width tests on two channels (100 %).
LEAST_PRECISION = 0.9
# A solid line and the dashes of the other one are about 64 %; a mask without the dashes has 48 %.
LEAST_RECALL = 0.6
# A gray level is a coarse step in half the light, so a few pixels change at every threshold.
LEAST_OVERLAP = 0.8
# Gradient of edges that every mask must have, levels of a step; the paint of the embedded pictures has 20 to 60.
STRONG_EDGE = 25.0
# Size and place of the glint, pixels from the upper left corner, and the part of the picture that it may change.
GLINT_FIRST_PX, GLINT_LAST_PX, GLINT_REACH_PX = 20, 60, 200


def check_paint_mask(
    make_mask: MakeMask, *, above: np.ndarray, warp: FourPointWarp, camera: Camera, truth: dict | None
) -> Verdict:
    """5.1: a mask of a bird's-eye view (height, width, 3) with a better precision than hls_sobel."""
    mask = make_mask(above.copy())
    if mask is None:
        return NOT_TRIED
    if problem := _mask_problem(mask, above.shape[:2]):
        return hint(problem)
    if truth is None:
        return hint(f"the mask covers {np.mean(mask > 0):.1%} of the view; no truth is known for this picture.")
    points_m = birdseye_to_road(binary_pixels(mask.astype(np.uint8)), warp, camera)
    precision, recall = marking_precision(points_m, truth) or 0.0, marking_recall(points_m, truth) or 0.0
    reached = f"precision {precision:.0%}, recall {recall:.0%}"
    dashed = marking_recall(points_m, {**truth, "left_y_m": truth["right_y_m"]}) or 0.0
    if precision < LEAST_PRECISION:
        return hint(f"{reached}. Too many pixels are not paint: look at the mask. What is as wide as a line?")
    if recall < LEAST_RECALL and dashed < 0.2:
        return hint(f"{reached}. The white dashes are missing (recall of the right line {dashed:.0%}).")
    if recall < LEAST_RECALL:
        return hint(f"{reached}. Parts of the lines are missing: the threshold is too strict.")
    return correct(f"{reached}.")


def check_relative_edges(make_mask: MakeMask, *, lightness: np.ndarray) -> Verdict:
    """5.2: a mask of the edges of a channel (height, width), the same in half the light and with a glint."""
    mask = make_mask(lightness.copy())
    if mask is None:
        return NOT_TRIED
    if problem := _mask_problem(mask, lightness.shape):
        return hint(problem)
    gradient = np.abs(cv2.Sobel(lightness, cv2.CV_32F, 1, 0, ksize=3)) / 4  # levels of a step
    strong, share = np.mean(mask[gradient >= STRONG_EDGE] > 0), np.mean(mask > 0)
    if strong < 0.7 or share > 0.1:
        return hint(f"the mask has {strong:.0%} of the strong edges and covers {share:.0%} of the view (allowed 10%).")
    in_half_light = make_mask(lightness // 2)
    half_light = 0.0 if in_half_light is None else _overlap(mask, in_half_light)
    if half_light < LEAST_OVERLAP:
        return hint(
            f"at half the light only {half_light:.0%} of the edges are the same. Divide the gradient by the brightness."
        )
    # in half the light the largest lightness is that of the glint
    glint = min(_same_with_glint(make_mask, channel) for channel in (lightness, lightness // 2))
    if glint < LEAST_OVERLAP:
        return hint(
            f"{half_light:.0%} the same at half the light, but with a glint in one corner only {glint:.0%}. "
            "The largest value and the gradients of the whole picture are no scale; use the usual brightness."
        )
    return correct(f"{half_light:.0%} of the edges are the same at half the light, {glint:.0%} with a glint.")


def _same_with_glint(make_mask: MakeMask, channel: np.ndarray) -> float:
    """Overlap of the masks of a channel without and with a glint, far from the glint."""
    mask, with_glint = make_mask(channel.copy()), make_mask(_add_glint(channel))
    if mask is None or with_glint is None:
        return 0.0
    far = np.ones(channel.shape, bool)
    far[:GLINT_REACH_PX, :GLINT_REACH_PX] = False
    return _overlap(mask[far], with_glint[far])


def _mask_problem(mask: object, shape: tuple[int, int]) -> str | None:
    """The fault in the form of a mask, or None."""
    if not isinstance(mask, np.ndarray) or mask.shape != shape or mask.dtype not in (np.uint8, bool):
        form = f"{mask.shape} {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
        return f"your function returned {form}; a mask has the shape {shape} and the type uint8, 0 or 255."
    return None if mask.any() else "the mask is empty: no pixel passes the threshold."


def _overlap(mask: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two masks."""
    mask, other = mask > 0, other > 0
    return float((mask & other).sum() / max((mask | other).sum(), 1))


def _add_glint(channel: np.ndarray) -> np.ndarray:
    """A copy with a small pattern of black and white squares, as sun on chrome or water makes."""
    picture = channel.copy()
    size = GLINT_LAST_PX - GLINT_FIRST_PX
    squares = np.indices((size, size)).sum(axis=0) // 4 % 2 * 255
    picture[GLINT_FIRST_PX:GLINT_LAST_PX, GLINT_FIRST_PX:GLINT_LAST_PX] = squares
    return picture


CHECKS: Checks = {"5.1": check_paint_mask, "5.2": check_relative_edges}
