"""Exercise of chapter 5, separate paint from road."""

from __future__ import annotations

import numpy as np

from classic.warp import FourPointWarp
from course.exercises.drawings import draw_paint
from course.exercises.paint import MakeMask, explain_missing, explain_wrong, rate_paint
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint
from lanes.camera import Camera

# Clearly more than hls_sobel (51 %), or its colour and magnitude without the gradient of L (89 %). 62 % of 375 masks
# reach both limits: top-hats 41 to 81 columns wide, openings 21 to 61 rows tall, three channels, five thresholds.
LEAST_PRECISION = 0.92
# The solid line, and more than one of the two dashes: with one of them it is 54 %, with both 62 %.
LEAST_RECALL = 0.55


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
    rating = rate_paint(mask, warp, camera, truth)
    draw_paint(above, rating)
    if rating.precision < LEAST_PRECISION:
        reached = f"precision {rating.precision:.1%} (at least {LEAST_PRECISION:.0%}), recall {rating.recall:.0%}"
        return hint(f"{reached}. {explain_wrong(rating, warp, camera)}")
    reached = f"precision {rating.precision:.0%}, recall {rating.recall:.0%}"
    if rating.recall < LEAST_RECALL:
        reason = explain_missing(rating, make_mask, warp, camera)
        return hint(f"{reached} (at least {LEAST_RECALL:.0%}). {reason}")
    return correct(f"{reached}.")


def _mask_problem(mask: object, shape: tuple[int, int]) -> str | None:
    """The fault in the form of a mask, or None."""
    if not isinstance(mask, np.ndarray) or mask.shape != shape or mask.dtype not in (np.uint8, bool):
        form = f"{mask.shape} {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
        return f"your function returned {form}; a mask has the shape {shape} and the type uint8, 0 or 255."
    return None if mask.any() else "the mask is empty: no pixel passes the threshold."


CHECKS: Checks = {"5.1": check_paint_mask}
