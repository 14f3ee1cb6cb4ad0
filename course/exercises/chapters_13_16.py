"""Exercises of chapters 13 to 16: explain a result, measure the errors, a finder of one's own, learn the filter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmark.scored_drive import COMMITTED, PROJECT_ROOT
from benchmark.systems import OwnFinder
from course.accuracy import score_finders
from course.exercises.drawings import draw_occlusion
from course.exercises.hints import Checks, HintError, require, require_equal, require_shape, tried
from course.exercises.occlusion import FIRST_ROW, LARGEST_M, SHAPE, SQUARE_PX, require_occlusion
from lanes.camera import Camera, load_camera
from lanes.detect.search import find_lane
from lanes.draw import draw_lane
from lanes.video.reader import read_video


def check_occlusion_map(
    occlusion_map: Callable[[np.ndarray, Camera], Any], *, image: np.ndarray, camera: Camera
) -> str:
    """13.1: by how many metres the lane moves if a square of the image is covered, an array (5, 16)."""
    given = image.copy()
    answer = tried(occlusion_map(given, camera))
    require(np.shape(answer) != SHAPE[::-1], f"the shape is {SHAPE[::-1]}. Rows come first: {SHAPE}.")
    moved_m = require_shape(answer, SHAPE, f"return an array of shape {SHAPE}")
    finite = "the map has NaN or infinite values. Where no lane is found it holds 1."
    require(np.isfinite(moved_m).all(), finite)
    require(moved_m.min() >= 0, "the map has negative values. Take the absolute difference.")
    require(moved_m.max() <= LARGEST_M, f"the map has a value of {moved_m.max():.2f} m. Limit it to 1 m.")
    if (lane := find_lane(image, camera)) is None:
        raise HintError("there is no lane in this image; take another one.")
    draw_occlusion(draw_lane(image, lane, camera, style="lines"), moved_m, FIRST_ROW)
    require(
        np.array_equal(given, image),
        "you cover the image itself, so the squares add up. Begin with image.copy() for each square.",
    )
    require_occlusion(moved_m, image, lane, camera)
    row, column = np.unravel_index(moved_m.argmax(), SHAPE)
    return (
        f"the lane moves most, by {moved_m.max():.2f} m, without the square [{row}, {column}], whose upper left corner "
        f"is at row {FIRST_ROW + SQUARE_PX * row}, column {SQUARE_PX * column}."
    )


# 14.1: number of frames, and the shares of right frames that are asked for.
FRAMES, LEAST_RIGHT = 4000, (0.8, 0.9, 0.95)
SHARE_MISTAKES = (
    "you keep the least confident frames first: sort the other way round.",
    "you stop where the share first falls below the limit; farther on it can rise again. Take the last place at which "
    "it is reached.",
    "this is the share of frames with a confidence above the limit. The confidence need not be true: count the right "
    "frames.",
    "this is the share of right frames among all. How many can be kept?",
    "this is a number of frames. Divide by all frames.",
)


def check_largest_share(largest_share: Callable[[np.ndarray, np.ndarray, float], float]) -> str:
    """14.1: the largest share of frames to keep, the most confident ones, of which a given share is right."""
    # the frames of a system that is too sure; no two of them are equally sure
    random = np.random.default_rng(14)
    confidence = random.uniform(0.5, 1, FRAMES)
    right = random.random(FRAMES) < confidence**2

    def share(flags: np.ndarray, least: float) -> float:
        answer = tried(largest_share(confidence.copy(), flags.copy(), least))
        return require_shape(answer, (), "return one number, the share of the frames that are kept")

    found = [share(right, least) for least in LEAST_RIGHT]
    true, *wrong = np.transpose([_kept_shares(confidence, right, least) for least in LEAST_RIGHT])
    otherwise = (
        f"for {LEAST_RIGHT[0]:.0%} yours is {found[0]:.3f}, the true share {true[0]:.3f}. Sort by confidence, highest "
        "first; of the first k frames the share of right ones is a cumulative mean."
    )
    require_equal(found, true, dict(zip(SHARE_MISTAKES, wrong, strict=True)), otherwise, atol=1e-9)
    none = share(np.zeros(FRAMES, bool), 0.9)
    require(none == 0, f"if no frame is right, none can be kept: return 0, not {none}.")
    return (
        f"to be right in {LEAST_RIGHT[-1]:.0%}, this system may show {true[-1]:.0%} of its frames; in "
        f"{LEAST_RIGHT[0]:.0%}, {true[0]:.0%} of them."
    )


def _kept_shares(confidence: np.ndarray, right: np.ndarray, least: float) -> list[float]:
    """The share to keep, and those that the `SHARE_MISTAKES` lead to."""
    counts = np.arange(1, len(right) + 1)
    falling, rising = (np.cumsum(right[order]) / counts for order in (np.argsort(-confidence), np.argsort(confidence)))
    kept, from_below = (counts[shares >= least][-1:].sum() for shares in (falling, rising))
    until_below = np.flatnonzero(falling < least)[0]
    shares = [frames / len(right) for frames in (kept, from_below, until_below)]
    return [*shares, (confidence >= least).mean(), right.mean(), kept]


# 15.1: share of right frames on the motorway and on challenge, and of wrong ones in the hairpins. The table of the
# chapter has those of the joint fit alone.
LEAST_ACCURACY, MOST_WRONG, HAIRPINS = 0.9, 0.2, "harder-challenge"


def check_honest_finder(find: OwnFinder) -> str:
    """15.1: a finder that is right on good roads, and returns None in hairpins instead of a wrong lane."""
    if used := {"find_lane", "LaneTracker", "track"} & set(find.__code__.co_names):
        raise HintError(
            f"{min(used)} is the engine. Build your finder from your own parts: joint_finder and your mask."
        )
    videos = [PROJECT_ROOT / "test_videos" / file for file in COMMITTED.values()]
    first = (find(next(read_video(video)), load_camera(video.with_suffix(".yaml"))) for video in videos)
    tried(next((lines for lines in first if lines is not None), None))
    rows = {scene: scores["yours"] for scene, scores in score_finders({"yours": find})}
    wrong = {scene: float(row["confident_and_wrong_share"]) for scene, row in rows.items()}
    each = [f"{scene} {row['accuracy']:.0%} right, {wrong[scene]:.0%} wrong" for scene, row in rows.items()]
    reached, good = ", ".join(each), rows.keys() - {HAIRPINS}
    require(
        any(rows[scene]["lateral_5_20m_median_m"] <= 3 for scene in good),
        f"{reached}. The lines are metres away from the truth: are they in metres, left line first?",
    )
    too_few = [scene for scene in rows if scene in good and rows[scene]["accuracy"] < LEAST_ACCURACY]
    careful = f"{reached}. On {' and '.join(too_few)} too few frames are right: is the finder too careful?"
    require(not too_few, careful)
    hairpins = f"{reached}. In the hairpins, return None where the fit does not explain what is seen."
    require(wrong[HAIRPINS] <= MOST_WRONG, hairpins)
    return f"{reached}."


# 16.1: examples and their cells; step of the differences that the gradient is compared with, and its largest error.
EXAMPLES, CELLS, STEP, GRADIENT_TOLERANCE = 60, 21, 1e-5, 1e-4


def check_loss_gradient(gradient: Callable[..., tuple[np.ndarray, float]]) -> str:
    """16.1: the gradient of the cross-entropy by the weights and the bias."""
    rng = np.random.default_rng(16)
    cells, is_paint = rng.normal(size=(EXAMPLES, CELLS)), rng.random(EXAMPLES) < 0.3
    weights, bias = rng.normal(0, 0.2, CELLS), -0.4
    answer = tried(gradient(cells.copy(), is_paint.copy(), weights.copy(), bias))
    try:
        by_weights, by_bias = (np.asarray(part, float) for part in answer)
    except (TypeError, ValueError):
        two = "return two things: the derivatives by the weights, an array (21,), and the derivative by b."
        raise HintError(two) from None
    shapes = f"the shapes are {by_weights.shape} and {by_bias.shape}; they must be (21,) and ()."
    require((by_weights.shape, by_bias.shape) == ((CELLS,), ()), shapes)
    # central differences by each weight, then by the bias, as if it were the weight of an input that is always 1
    inputs, parameters = np.column_stack([cells, np.ones(EXAMPLES)]), np.array([*weights, bias])
    steps = STEP * np.eye(CELLS + 1)
    losses = np.array([[_loss(inputs, is_paint, parameters + s * step) for s in (1, -1)] for step in steps])
    *expected, expected_bias = -np.diff(losses)[:, 0] / (2 * STEP)
    mistakes = {
        "this points downhill. The gradient points uphill; the descent subtracts it.": -np.array(expected),
        "this is the gradient of the sum. L is the mean over the examples.": EXAMPLES * np.array(expected),
    }
    error = float(np.abs(by_weights - expected).max())
    otherwise = f"the derivatives by the weights are off by up to {error:.3f}. Does the factor p (1 - p) cancel?"
    require_equal(by_weights, expected, mistakes, otherwise, atol=GRADIENT_TOLERANCE)
    constant = f"the derivative by b is {by_bias:.3f} instead of {expected_bias:.3f}. Its input is always 1."
    require_equal(by_bias, expected_bias, {}, constant, atol=GRADIENT_TOLERANCE)
    return f"within {max(error, 1e-6):.0e} of the differences of L."


def _loss(inputs: np.ndarray, is_paint: np.ndarray, parameters: np.ndarray) -> float:
    log_odds = inputs @ parameters
    return float(np.logaddexp(0, np.where(is_paint, -log_odds, log_odds)).mean())


CHECKS: Checks = {
    "13.1": check_occlusion_map,
    "14.1": check_largest_share,
    "15.1": check_honest_finder,
    "16.1": check_loss_gradient,
}
