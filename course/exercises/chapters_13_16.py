"""Exercises of chapters 13 to 16: explain a result, measure the errors, a finder of
one's own, learn the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmark.evaluation import COMMITTED, PROJECT_ROOT
from benchmark.scores import Row
from benchmark.systems import OwnFinder
from course.exercises.hints import (
    HintError,
    require,
    require_equal,
    require_shape,
    tried,
)
from course.measures import score_finders
from lanes.camera.model import Camera, load_camera
from lanes.detect.lane import Lane
from lanes.detect.search import find_lane
from lanes.show.draw import draw_lane
from lanes.show.figures import new_figure
from lanes.video.reader import read_video

# 13.1, after M. D. Zeiler and R. Fergus, "Visualizing and understanding convolutional
# networks", European Conference on Computer Vision, 2014. Rows and columns of squares,
# their size and distance in pixels.
SHAPE = (4, 15)
SQUARE_PX = 160
STEP_PX = 80
# The first row of the image that is covered, and the gray level of a square.
FIRST_ROW = 320
GRAY = 128
# Distances at which lanes are compared: that of the exercise, and one that a reader may
# take instead, metres.
AHEAD_M = np.array([20.0, 10.0])
LARGEST_M = 1.0
CLOSE_M = 0.002
# A map is compared at the squares on the lines at these distances (metres), at two
# above the road, and where its own values are largest. Wrong covers are only tried
# where it is wrong.
ON_LINES_M = np.array([6.5, 8.0, 11.0, 15.0, 22.0])
ABOVE_ROAD = ([0, 0], [0, 14])
LARGEST_COUNT = 5
COMPARED_COUNT = 5

Cover = Callable[[np.ndarray, int, int], np.ndarray]


def choose_squares(moved_m: np.ndarray, lane: Lane, camera: Camera) -> np.ndarray:
    """The squares (N, 2), as (row, column), at which a map is compared with the right
    one.
    """
    left_m, right_m = lane.lateral_m(ON_LINES_M)
    left = np.column_stack([ON_LINES_M, left_m])
    right = np.column_stack([ON_LINES_M, right_m])
    columns_px, rows_px = camera.road_to_pixels(np.vstack([left, right])).T
    on_lines = np.column_stack([rows_px - FIRST_ROW, columns_px]) // STEP_PX
    inside = ((on_lines >= 0) & (on_lines < SHAPE)).all(axis=1)

    order = np.argsort(moved_m.ravel())
    largest = np.unravel_index(order[-LARGEST_COUNT:], SHAPE)
    squares = np.vstack([ABOVE_ROAD, on_lines[inside], np.column_stack(largest)])
    return np.unique(squares.astype(int), axis=0)


def cover_square(
    image: np.ndarray, row: int, column: int, *, level: int = GRAY
) -> np.ndarray:
    """A copy of an image with one square covered."""
    covered = image.copy()
    top = FIRST_ROW + STEP_PX * row
    left = STEP_PX * column
    covered[top : top + SQUARE_PX, left : left + SQUARE_PX] = level
    return covered


def require_occlusion(
    moved_m: np.ndarray, image: np.ndarray, lane: Lane, camera: Camera
) -> None:
    """Raise a `HintError` if a map is wrong at some of its squares.

    The uncovered image has this lane.
    """
    squares = choose_squares(moved_m, lane, camera)
    mine = moved_m[tuple(squares.T)]
    signed_m = _moves(image, lane, camera, squares, cover_square)
    size_m = np.minimum(np.abs(signed_m), LARGEST_M)
    expected = size_m[:, :, 0].max(axis=1)
    if np.allclose(mine, expected, rtol=0, atol=CLOSE_M):
        return
    require(
        moved_m.any(),
        "every value is 0. Cover parts of the road, and compare with the lane of the "
        "uncovered image.",
    )
    to_the_left_m = signed_m[:, :, 0].max(axis=1)
    mistakes = {
        "this is the left line alone. Take the larger of both.": size_m[:, 0, 0],
        "this is the right line alone. Take the larger of both.": size_m[:, 1, 0],
        "moves to one side are missing. Take the absolute difference.": np.clip(
            to_the_left_m, 0, LARGEST_M
        ),
        "this is 10 m ahead. Compare the lines 20 m ahead.": size_m[:, :, 1].max(
            axis=1
        ),
    }
    # wrong covers, where the map is most wrong
    wrong = np.argsort(-np.abs(expected - mine))[:COMPARED_COUNT]
    for sentence, cover in WRONG_COVERS.items():
        moved = np.abs(_moves(image, lane, camera, squares[wrong], cover)[:, :, 0])
        mistaken = mine.copy()
        mistaken[wrong] = np.minimum(moved.max(axis=1), LARGEST_M)
        mistakes[sentence] = mistaken

    place = squares[wrong[0]].tolist()
    otherwise = (
        f"at {place} it has {mine[wrong[0]]:.3f} m instead of {expected[wrong[0]]:.3f} "
        "m. "
        f"Is a square of {SQUARE_PX} x {SQUARE_PX} pixels gray, {GRAY}?"
    )
    require_equal(mine, expected, mistakes, otherwise, atol=CLOSE_M)


def draw_occlusion(image: np.ndarray, moved_m: np.ndarray) -> None:
    """13.1: a map (rows, columns) of squares, metres, on an image from
    FIRST_ROW down.
    """
    height, width = image.shape[:2]
    figure, (axis,) = new_figure(1, 1, (12, 6.2))
    axis.imshow(image)

    largest_m = max(float(moved_m.max()), 0.01)
    mean_m = _mean_of_squares(moved_m)
    share = np.clip(mean_m / largest_m, 0, 1)
    heat = axis.imshow(
        mean_m,
        alpha=0.75 * np.sqrt(share),
        cmap="autumn_r",
        vmin=0.0,
        vmax=largest_m,
        extent=(-0.5, width - 0.5, height - 0.5, FIRST_ROW - 0.5),
    )
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    axis.set_title("Your map: how far the lane moves if a square is covered")
    axis.set_axis_off()
    label = "moved, 20 m ahead (m)"
    figure.colorbar(heat, ax=axis, label=label, fraction=0.025)


def _mean_of_squares(moved_m: np.ndarray) -> np.ndarray:
    """The map (rows + 1, columns + 1) of cells of STEP_PX: the mean over the squares
    that cover each cell.
    """
    total = np.zeros((SHAPE[0] + 1, SHAPE[1] + 1))
    count = np.zeros_like(total)
    for row, column in np.ndindex(SHAPE):
        total[row : row + 2, column : column + 2] += moved_m[row, column]
        count[row : row + 2, column : column + 2] += 1
    return total / count


def _moves(
    image: np.ndarray, lane: Lane, camera: Camera, squares: np.ndarray, cover: Cover
) -> np.ndarray:
    """By how much both lines move to the left (squares, 2, distances), metres.

    `LARGEST_M` if no lane is found.
    """
    before_m = lane.lateral_m(AHEAD_M)
    moves = []
    for row, column in squares.tolist():
        found = find_lane(cover(image, row, column), camera)
        if found is None:
            moves.append(np.full_like(before_m, LARGEST_M))
        else:
            moves.append(found.lateral_m(AHEAD_M) - before_m)
    return np.array(moves)


def _cover_so_far(image: np.ndarray, row: int, column: int) -> np.ndarray:
    """A copy with this square and all before it covered."""
    covered = image.copy()
    for index in range(row * SHAPE[1] + column + 1):
        covered = cover_square(covered, *divmod(index, SHAPE[1]))
    return covered


WRONG_COVERS: dict[str, Cover] = {
    "the squares add up: begin with a new image.copy() for each square.": _cover_so_far,
    "you cover with black. Use gray, (128, 128, 128).": partial(cover_square, level=0),
}


def check_occlusion_map(
    occlusion_map: Callable[[np.ndarray, Camera], Any],
    *,
    image: np.ndarray,
    camera: Camera,
) -> str:
    """13.1: by how many metres the lane moves if a square of the image is covered.

    The answer is an array (4, 15).
    """
    given = image.copy()
    moved_m = _require_map(tried(occlusion_map(given, camera)))
    lane = find_lane(image, camera)
    if lane is None:
        raise HintError("there is no lane in this image; take another one.")
    draw_occlusion(draw_lane(image, lane, camera, style="lines"), moved_m)
    require(
        np.array_equal(given, image),
        "you cover the image itself, so the squares add up. Begin with image.copy() "
        "for "
        "each square.",
    )
    require_occlusion(moved_m, image, lane, camera)
    row, column = np.unravel_index(moved_m.argmax(), SHAPE)
    return (
        f"the lane moves most, by {moved_m.max():.2f} m, without the square [{row}, "
        f"{column}], whose upper left corner is at row {FIRST_ROW + STEP_PX * row}, "
        "column "
        f"{STEP_PX * column}."
    )


def _require_map(answer: Any) -> np.ndarray:
    """The answer as a map with plausible values."""
    turned = SHAPE[::-1]
    require(
        np.shape(answer) != turned, f"the shape is {turned}. Rows come first: {SHAPE}."
    )
    moved_m = require_shape(answer, SHAPE, f"return an array of shape {SHAPE}")
    require(
        np.isfinite(moved_m).all(),
        "the map has NaN or infinite values. Where no lane is found it holds 1.",
    )
    require(
        moved_m.min() >= 0, "the map has negative values. Take the absolute difference."
    )
    require(
        moved_m.max() <= LARGEST_M,
        f"the map has a value of {moved_m.max():.2f} m. Limit it to 1 m.",
    )
    return moved_m


# 14.1: number of frames, and the shares of right frames that are asked for.
FRAMES = 4000
LEAST_RIGHT = (0.8, 0.9, 0.95)


def check_largest_share(
    largest_share: Callable[[np.ndarray, np.ndarray, float], float],
) -> str:
    """14.1: the largest share of frames to keep, of which a given share is right."""
    # the frames of a system that is too sure; no two of them are equally sure
    random = np.random.default_rng(14)
    confidence = random.uniform(0.5, 1, FRAMES)
    right = random.random(FRAMES) < confidence**2

    def share(flags: np.ndarray, least: float) -> float:
        answer = tried(largest_share(confidence.copy(), flags.copy(), least))
        one = "return one number, the share of the frames that are kept"
        return require_shape(answer, (), one)

    found = [share(right, least) for least in LEAST_RIGHT]
    true = [_largest_share(confidence, right, least) for least in LEAST_RIGHT]
    mistakes = _share_mistakes(confidence, right)
    otherwise = (
        f"for {LEAST_RIGHT[0]:.0%} yours is {found[0]:.3f}, the true share "
        f"{true[0]:.3f}. "
        "Sort by confidence, highest first; of the first k frames the share of right "
        "ones "
        "is a cumulative mean."
    )
    require_equal(found, true, mistakes, otherwise, atol=1e-9)
    none = share(np.zeros(FRAMES, bool), 0.9)
    require(none == 0, f"if no frame is right, none can be kept: return 0, not {none}.")
    return (
        f"to be right in {LEAST_RIGHT[-1]:.0%}, this system may show {true[-1]:.0%} of "
        "its "
        f"frames; in {LEAST_RIGHT[0]:.0%}, {true[0]:.0%} of them."
    )


def _right_shares(right: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Of the first k frames in an order the share of right ones, for each k
    from 1 on.
    """
    counts = np.arange(1, len(right) + 1)
    return np.cumsum(right[order]) / counts


def _last_reached(shares: np.ndarray, least: float) -> int:
    """Number of frames up to the last place at which a share is reached, or 0."""
    reached = np.flatnonzero(shares >= least)
    return int(reached[-1]) + 1 if len(reached) else 0


def _largest_share(confidence: np.ndarray, right: np.ndarray, least: float) -> float:
    """The share of frames to keep."""
    shares = _right_shares(right, np.argsort(-confidence))
    return _last_reached(shares, least) / len(right)


def _share_mistakes(
    confidence: np.ndarray, right: np.ndarray
) -> dict[str, list[float]]:
    """What the usual mistakes lead to, for each of `LEAST_RIGHT`."""
    count = len(right)
    falling = _right_shares(right, np.argsort(-confidence))
    rising = _right_shares(right, np.argsort(confidence))
    least_first = []
    until_below = []
    above = []
    right_share = []
    frames = []
    for least in LEAST_RIGHT:
        least_first.append(_last_reached(rising, least) / count)
        until_below.append(int(np.flatnonzero(falling < least)[0]) / count)
        above.append(float((confidence >= least).mean()))
        right_share.append(float(right.mean()))
        frames.append(float(_last_reached(falling, least)))
    return {
        "you keep the least confident frames first: sort the other way "
        "round.": least_first,
        "you stop where the share first falls below the limit; farther on it can rise "
        "again. Take the last place at which it is reached.": until_below,
        "this is the share of frames with a confidence above the limit. The confidence "
        "need not be true: count the right frames.": above,
        "this is the share of right frames among all. How many can be "
        "kept?": right_share,
        "this is a number of frames. Divide by all frames.": frames,
    }


# 15.1: share of accurate frames on the motorway and on challenge, and of wrong ones in
# the hairpins. The table of the chapter has those of the joint fit alone.
LEAST_ACCURACY = 0.9
MOST_WRONG = 0.2
HAIRPINS = "harder-challenge"
ENGINE_NAMES = {"find_lane", "LaneTracker", "track"}


def check_honest_finder(find: OwnFinder) -> str:
    """15.1: accurate on good roads, None in hairpins instead of a wrong lane."""
    used = ENGINE_NAMES & set(find.__code__.co_names)
    if used:
        raise HintError(
            f"{min(used)} is the engine. Build your finder from your own parts: "
            "joint_finder and your mask."
        )
    _require_tried(find)

    # its scores on the three videos
    rows: dict[str, Row] = {}
    for scene, scores in score_finders({"yours": find}):
        rows[scene] = scores["yours"]
    each = []
    for scene, row in rows.items():
        wrong = row["confident_and_wrong_share"]
        each.append(f"{scene} {row['accuracy']:.0%} accurate, {wrong:.0%} wrong")
    reached = ", ".join(each)

    good_roads = [scene for scene in rows if scene != HAIRPINS]
    medians_m = [rows[scene]["lateral_5_20m_median_m"] for scene in good_roads]
    require(
        any(float(median_m) <= 3 for median_m in medians_m),
        f"{reached}. The lines are metres away from the truth: are they in metres, "
        "left "
        "line first?",
    )
    too_few = [s for s in good_roads if float(rows[s]["accuracy"]) < LEAST_ACCURACY]
    require(
        not too_few,
        f"{reached}. On {' and '.join(too_few)} too few frames are right: is the "
        "finder "
        "too careful?",
    )
    wrong_in_hairpins = float(rows[HAIRPINS]["confident_and_wrong_share"])
    require(
        wrong_in_hairpins <= MOST_WRONG,
        f"{reached}. In the hairpins, return None where the fit does not explain what "
        "is "
        "seen.",
    )
    return f"{reached}."


def _require_tried(find: OwnFinder) -> None:
    """The starter returns None for the first frame of every video."""
    for file in COMMITTED.values():
        video = PROJECT_ROOT / "test_videos" / file
        camera = load_camera(video.with_suffix(".yaml"))
        if find(next(read_video(video)), camera) is not None:
            return
    tried(None)


# 16.1: examples and their cells; step of the differences that the gradient is compared
# with, and its largest error.
EXAMPLES = 60
CELLS = 21
STEP = 1e-5
GRADIENT_TOLERANCE = 1e-4


def check_loss_gradient(gradient: Callable[..., tuple[np.ndarray, float]]) -> str:
    """16.1: the gradient of the cross-entropy by the weights and the bias."""
    rng = np.random.default_rng(16)
    cells = rng.normal(size=(EXAMPLES, CELLS))
    is_paint = rng.random(EXAMPLES) < 0.3
    weights = rng.normal(0, 0.2, CELLS)
    bias = -0.4
    answer = tried(gradient(cells.copy(), is_paint.copy(), weights.copy(), bias))
    by_weights, by_bias = _require_gradient(answer)

    # the bias is the weight of an input that is always 1
    inputs = np.column_stack([cells, np.ones(EXAMPLES)])
    *expected, expected_bias = _differences(
        inputs, is_paint, np.array([*weights, bias])
    )
    right = np.array(expected)
    mistakes = {
        "this points downhill. The gradient points uphill; the descent subtracts it.": (
            -right
        ),
        "this is the gradient of the sum. L is the mean over the examples.": (
            EXAMPLES * right
        ),
    }
    error = float(np.abs(by_weights - right).max())
    otherwise = (
        f"the derivatives by the weights are off by up to {error:.3f}. Does the factor "
        "p (1 - p) cancel?"
    )
    require_equal(by_weights, right, mistakes, otherwise, atol=GRADIENT_TOLERANCE)
    constant = (
        f"the derivative by b is {by_bias:.3f} instead of {expected_bias:.3f}. Its "
        "input "
        "is always 1."
    )
    require_equal(by_bias, expected_bias, {}, constant, atol=GRADIENT_TOLERANCE)
    return f"within {max(error, 1e-6):.0e} of the differences of L."


def _require_gradient(answer: Any) -> tuple[np.ndarray, np.ndarray]:
    """The derivatives by the weights (21,) and by the bias ()."""
    try:
        by_weights, by_bias = (np.asarray(part, float) for part in answer)
    except (TypeError, ValueError):
        raise HintError(
            "return two things: the derivatives by the weights, an array (21,), and "
            "the "
            "derivative by b."
        ) from None
    require(
        by_weights.shape == (CELLS,) and by_bias.shape == (),
        f"the shapes are {by_weights.shape} and {by_bias.shape}; they must be (21,) "
        "and "
        "().",
    )
    return by_weights, by_bias


def _differences(
    inputs: np.ndarray, is_paint: np.ndarray, parameters: np.ndarray
) -> list[float]:
    """Central differences of the loss by each parameter."""
    slopes = []
    for step in STEP * np.eye(len(parameters)):
        above = _loss(inputs, is_paint, parameters + step)
        below = _loss(inputs, is_paint, parameters - step)
        slopes.append((above - below) / (2 * STEP))
    return slopes


def _loss(inputs: np.ndarray, is_paint: np.ndarray, parameters: np.ndarray) -> float:
    log_odds = inputs @ parameters
    against = np.where(is_paint, -log_odds, log_odds)
    return float(np.logaddexp(0, against).mean())
