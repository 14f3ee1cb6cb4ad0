"""Exercises of chapters 13 to 16: explain a result, measure the errors, a finder of one's own, learn the filter."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmark.evaluation import COMMITTED, PROJECT_ROOT
from benchmark.systems import OwnFinder
from course.exercises.hints import HintError, require, require_equal, require_shape, tried
from course.measures import score_finders
from lanes.camera import Camera, load_camera
from lanes.detect.lane import Lane
from lanes.detect.search import find_lane
from lanes.draw import draw_lane
from lanes.figures import new_figure
from lanes.video.reader import read_video

# 13.1, after M. D. Zeiler and R. Fergus, "Visualizing and understanding convolutional networks", European Conference on
# Computer Vision, 2014.
# Rows and columns of squares, their size and distance in pixels, the first row of the image, and their gray level.
SHAPE, SQUARE_PX, STEP_PX, FIRST_ROW, GRAY = (4, 15), 160, 80, 320, 128
# Distances at which lanes are compared: that of the exercise, and one that a reader may take instead, metres.
AHEAD_M = np.array([20.0, 10.0])
LARGEST_M, CLOSE_M = 1.0, 0.002
# A map is compared at the squares on the lines at these distances (metres), at two above the road, and where its own
# values are largest. Wrong covers are only tried where it is wrong.
ON_LINES_M = np.array([6.5, 8.0, 11.0, 15.0, 22.0])
ABOVE_ROAD, LARGEST_COUNT, COMPARED_COUNT = ([0, 0], [0, 14]), 5, 5

Cover = Callable[[np.ndarray, int, int], np.ndarray]


def choose_squares(moved_m: np.ndarray, lane: Lane, camera: Camera) -> np.ndarray:
    """The squares (N, 2), as (row, column), at which a map is compared with the right one."""
    lines_m = [np.column_stack([ON_LINES_M, y_m]) for y_m in lane.lateral_m(ON_LINES_M)]
    columns_px, rows_px = camera.road_to_pixels(np.vstack(lines_m)).T
    on_lines = np.column_stack([rows_px - FIRST_ROW, columns_px]) // STEP_PX
    inside = ((on_lines >= 0) & (on_lines < SHAPE)).all(axis=1)
    largest = np.unravel_index(np.argsort(moved_m.ravel())[-LARGEST_COUNT:], SHAPE)
    return np.unique(np.vstack([ABOVE_ROAD, on_lines[inside], np.column_stack(largest)]).astype(int), axis=0)


def cover_square(image: np.ndarray, row: int, column: int, *, level: int = GRAY) -> np.ndarray:
    """A copy of an image with one square covered."""
    covered = image.copy()
    top = FIRST_ROW + STEP_PX * row
    left = STEP_PX * column
    covered[top : top + SQUARE_PX, left : left + SQUARE_PX] = level
    return covered


def require_occlusion(moved_m: np.ndarray, image: np.ndarray, lane: Lane, camera: Camera) -> None:
    """Raise a `HintError` if a map is wrong at some of its squares; the uncovered image has this lane."""
    squares = choose_squares(moved_m, lane, camera)
    mine, signed = moved_m[tuple(squares.T)], _moves(image, lane, camera, squares, cover_square)
    size = np.minimum(np.abs(signed), LARGEST_M)
    expected = size[:, :, 0].max(axis=1)
    if np.allclose(mine, expected, rtol=0, atol=CLOSE_M):
        return
    same = "every value is 0. Cover parts of the road, and compare with the lane of the uncovered image."
    require(moved_m.any(), same)
    mistakes = {
        "this is the left line alone. Take the larger of both.": size[:, 0, 0],
        "this is the right line alone. Take the larger of both.": size[:, 1, 0],
        "moves to one side are missing. Take the absolute difference.": np.clip(
            signed[:, :, 0].max(axis=1), 0, LARGEST_M
        ),
        "this is 10 m ahead. Compare the lines 20 m ahead.": size[:, :, 1].max(axis=1),
    }
    wrong = np.argsort(-np.abs(expected - mine))[:COMPARED_COUNT]
    for sentence, cover in WRONG_COVERS.items():
        mistakes[sentence] = mine.copy()
        moved = np.abs(_moves(image, lane, camera, squares[wrong], cover)[:, :, 0])
        mistakes[sentence][wrong] = np.minimum(moved.max(axis=1), LARGEST_M)
    place, got_m, right_m = squares[wrong[0]].tolist(), mine[wrong[0]], expected[wrong[0]]
    otherwise = f"at {place} it has {got_m:.3f} m instead of {right_m:.3f} m. Is a square of 160 x 160 pixels gray, 128?"
    require_equal(mine, expected, mistakes, otherwise, atol=CLOSE_M)


def draw_occlusion(image: np.ndarray, moved_m: np.ndarray) -> None:
    """13.1: a map (rows, columns) of squares, metres, on an image (height, width, 3) from FIRST_ROW down."""
    height, width = image.shape[:2]
    figure, (axis,) = new_figure(1, 1, (12, 6.2))
    axis.imshow(image)
    largest_m = max(float(moved_m.max()), 0.01)
    place = (-0.5, width - 0.5, height - 0.5, FIRST_ROW - 0.5)
    shown = {"cmap": "autumn_r", "vmin": 0.0, "vmax": largest_m, "extent": place}
    mean_m = _mean_of_squares(moved_m)
    heat = axis.imshow(mean_m, alpha=0.75 * np.clip(mean_m / largest_m, 0, 1) ** 0.5, **shown)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    axis.set_title("Your map: how far the lane moves if a square is covered")
    axis.set_axis_off()
    figure.colorbar(heat, ax=axis, label="moved, 20 m ahead (m)", fraction=0.025)


def _mean_of_squares(moved_m: np.ndarray) -> np.ndarray:
    """The map (rows + 1, columns + 1) of cells of STEP_PX: the mean over the squares that cover each cell."""
    total = np.zeros((SHAPE[0] + 1, SHAPE[1] + 1))
    count = np.zeros_like(total)
    for row, column in np.ndindex(SHAPE):
        total[row : row + 2, column : column + 2] += moved_m[row, column]
        count[row : row + 2, column : column + 2] += 1
    return total / count


def _moves(image: np.ndarray, lane: Lane, camera: Camera, squares: np.ndarray, cover: Cover) -> np.ndarray:
    """By how much both lines move to the left (squares, 2, distances), metres; `LARGEST_M` if no lane is found."""
    before_m, moves = lane.lateral_m(AHEAD_M), []
    for row, column in squares.tolist():
        found = find_lane(cover(image, row, column), camera)
        moves.append(np.full_like(before_m, LARGEST_M) if found is None else found.lateral_m(AHEAD_M) - before_m)
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
    occlusion_map: Callable[[np.ndarray, Camera], Any], *, image: np.ndarray, camera: Camera
) -> str:
    """13.1: by how many metres the lane moves if a square of the image is covered, an array (4, 15)."""
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
    draw_occlusion(draw_lane(image, lane, camera, style="lines"), moved_m)
    same = "you cover the image itself, so the squares add up. Begin with image.copy() for each square."
    require(np.array_equal(given, image), same)
    require_occlusion(moved_m, image, lane, camera)
    row, column = np.unravel_index(moved_m.argmax(), SHAPE)
    return (
        f"the lane moves most, by {moved_m.max():.2f} m, without the square [{row}, {column}], whose upper left corner "
        f"is at row {FIRST_ROW + STEP_PX * row}, column {STEP_PX * column}."
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
        parts = "Build your finder from your own parts: joint_finder and your mask."
        raise HintError(f"{min(used)} is the engine. {parts}")
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
