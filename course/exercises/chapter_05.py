"""Exercise of chapter 5, separate paint from road."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from course.exercises.drawings import draw_paint
from course.exercises.paint import explain_missing, explain_wrong, rate_paint
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint
from helpers import FourPointWarp
from lanes.camera import Camera

MakeMask = Callable[[np.ndarray], "np.ndarray | None"]
# Clearly more than hls_sobel (51 %), or its colour and magnitude without the gradient of L (89 %). 62 % of 375 masks
# reach both limits: top-hats 41 to 81 columns wide, openings 21 to 61 rows tall, three channels, five thresholds.
LEAST_PRECISION = 0.92
# On the second image, whose solid line and dashes are less disturbed; a mask drawn for the first one has none of it.
LEAST_SECOND = 0.8, 0.45
# The solid line, and more than one of the two dashes: with one of them it is 54 %, with both 62 %.
LEAST_RECALL = 0.55


def check_paint_mask(
    make_mask: MakeMask,
    *,
    above: np.ndarray,
    warp: FourPointWarp,
    camera: Camera,
    truth: dict | None,
    second: np.ndarray,
    second_truth: dict | None,
) -> Verdict:
    """5.1: a mask of a bird's-eye view (height, width, 3) better than hls_sobel's, also on a second one."""
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
        return hint(f"{reached} (at least {LEAST_RECALL:.0%}). {explain_missing(rating, warp, camera)}")
    other = make_mask(second.copy())
    problem = "None" if other is None else _mask_problem(other, second.shape[:2])
    if other is None or problem:
        return hint(f"{reached} on this image. On the second one your function fails: {problem}")
    if second_truth is None:
        return correct(f"{reached}.")
    rated = rate_paint(other, warp, camera, second_truth)
    on_second = f"precision {rated.precision:.0%}, recall {rated.recall:.0%}"
    if rated.precision < LEAST_SECOND[0] or rated.recall < LEAST_SECOND[1]:
        draw_paint(second, rated)
        least = " and ".join(f"{share:.0%}" for share in LEAST_SECOND)
        return hint(
            f"{reached} on this image, but {on_second} on a second one (at least {least}): the mask knows where the "
            "lines of this image are, not what paint looks like."
        )
    return correct(f"{reached}; on a second image {on_second}.")


def _mask_problem(mask: object, shape: tuple[int, int]) -> str | None:
    """The fault in the form of a mask, or None."""
    if not isinstance(mask, np.ndarray) or mask.shape != shape or mask.dtype not in (np.uint8, bool):
        form = f"{mask.shape} {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
        return f"your function returned {form}; a mask has the shape {shape} and the type uint8, 0 or 255."
    return None if mask.any() else "the mask is empty: no pixel passes the threshold."


CHECKS: Checks = {"5.1": check_paint_mask}
