"""Exercises of chapters 5 to 8: a mask of the paint, the search for lines, their fit, drawing and tracking a lane."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from course.exercises.hints import HintError, require, require_equal, require_shape, tried
from course.measures import STEPS_M, compare_markings
from course.plots import plot_series, show_pictures
from helpers import (
    FourPointWarp,
    binary_pixels,
    birdseye_to_road,
    find_peaks,
    lane_histogram,
    metres_per_pixel,
    ransac_line,
)
from lanes.camera.model import Camera
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, draw_polyline

# Colours of the drawings below a verdict, which Jupyter shows at the end of the cell.
RIGHT, WRONG, OTHER_LINE = LANE_COLOUR, LEFT_COLOUR, (255, 150, 0)
MISSED, NOT_COUNTED, DARK = (255, 0, 255), (150, 150, 150), (35, 35, 35)

# 5.1: clearly more than hls_sobel (51 %), or its colour and magnitude without the gradient of L (89 %). 62 % of 375
# masks reach both limits: top-hats 41 to 81 columns wide, openings 21 to 61 rows tall, three channels, five thresholds.
LEAST_PRECISION = 0.92
# The solid line, and more than one of the two dashes: with one of them it is 54 %, with both 62 %.
LEAST_RECALL = 0.55
# On the second image, whose solid line and dashes are less disturbed; a mask drawn for the first one has none of it.
LEAST_SECOND = 0.8, 0.45
# Length of a dash, width of a line, and a width that only other shapes have, metres.
DASH_M, LINE_M, WIDE_M = 3.05, 0.13, 0.3


@dataclass(frozen=True, eq=False)
class PaintRating:
    """Precision, recall, recall of each line, masks (height, width) of the set pixels, missed pieces (2, 2) of lines.

    The masks are disjoint: pixels on a line, beside it, and those that do not count for the precision.
    """

    precision: float
    recall: float
    each_recall: np.ndarray
    on_line: np.ndarray
    beside: np.ndarray
    not_counted: np.ndarray
    missed_px: list[np.ndarray]

    def __str__(self) -> str:
        return f"precision {self.precision:.0%}, recall {self.recall:.0%}"


def rate_paint(mask: np.ndarray, warp: FourPointWarp, camera: Camera, truth: dict) -> PaintRating:
    """The rating of a mask (height, width), uint8 or bool, of a bird's-eye view."""
    pixels = binary_pixels((mask > 0).astype(np.uint8))
    counted, on_lines, covered = compare_markings(birdseye_to_road(pixels, warp, camera), truth)
    close: np.ndarray = np.logical_or(*on_lines)
    masks = np.zeros((3, *mask.shape), bool)
    for drawn, chosen in zip(masks, (counted & close, counted & ~close, ~counted), strict=True):
        drawn[pixels[chosen, 1], pixels[chosen, 0]] = True
    missed_px = []
    for key, steps in zip(("left_y_m", "right_y_m"), covered, strict=True):
        line_m = np.column_stack([STEPS_M, np.interp(STEPS_M, truth["x_m"], truth[key])])
        line_px = warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(line_m)))
        missed_px += [line_px[k : k + 2] for k in np.flatnonzero(~steps)]
    precision = float(close[counted].mean()) if counted.any() else 0.0
    on_line, beside, not_counted = masks
    each_recall = covered.mean(axis=1)
    return PaintRating(precision, each_recall.mean(), each_recall, on_line, beside, not_counted, missed_px)


def explain_wrong(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """What kind of shapes the pixels beside the lines are."""
    across_m, _ = metres_per_pixel(warp, camera)
    beside = rating.beside.astype(np.uint8)
    wide = cv2.morphologyEx(beside, cv2.MORPH_OPEN, np.ones((1, round(WIDE_M / across_m)), np.uint8))
    if 2 * wide.sum() > beside.sum():
        columns = round(LINE_M / across_m, -1)
        return f"Most of the red shapes are wider than a line, which has about {columns:.0f} columns."
    return "Most of the red shapes are as narrow as a line. But are they as long as a dash?"


def explain_missing(rating: PaintRating, warp: FourPointWarp, camera: Camera) -> str:
    """Which line is missing, and why that happens."""
    across_m, along_m = metres_per_pixel(warp, camera)
    yellow, white = rating.each_recall
    if yellow < 0.8:
        columns = round(LINE_M / across_m, -1)
        return f"Of the solid yellow line it finds only {yellow:.0%}. A line has about {columns:.0f} columns."
    return (
        f"Of the white dashes it finds too little ({white:.0%} of their line). Is a threshold too high? Or an opening "
        f"too long? A dash has {DASH_M / along_m:.0f} rows, but it leans, so that each of its columns is shorter."
    )


def draw_paint(above: np.ndarray, rating: PaintRating) -> None:
    """5.1: the rated pixels and the missed pieces of the lines on a view from above."""
    picture = cv2.cvtColor(cv2.cvtColor(above, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB) // 2 + 25
    for mask, colour in ((rating.on_line, RIGHT), (rating.beside, WRONG), (rating.not_counted, NOT_COUNTED)):
        picture[mask] = colour
    for piece_px in rating.missed_px:
        draw_polyline(picture, piece_px, MISSED, 7.4)
    title = (
        "Your mask: green on a line, red beside it, gray not counted (far, or outside the lane).\n"
        "Magenta: pieces of the lines without a pixel; the gaps between the dashes count, too."
    )
    show_pictures([picture], [title], columns=1)


MakeMask = Callable[[np.ndarray], Any]


def check_paint_mask(
    make_mask: MakeMask,
    *,
    above: np.ndarray,
    warp: FourPointWarp,
    camera: Camera,
    truth: dict | None,
    second: np.ndarray,
    second_truth: dict | None,
) -> str:
    """5.1: a mask of a bird's-eye view (height, width, 3) better than hls_sobel's, also on a second one."""
    mask = tried(make_mask(above.copy()))
    _require_mask(mask, above.shape[:2])
    if truth is None:
        raise HintError(f"the mask covers {np.mean(mask > 0):.1%} of the view; no truth is known for this picture.")
    rating = rate_paint(mask, warp, camera, truth)
    draw_paint(above, rating)
    require(
        rating.precision >= LEAST_PRECISION,
        f"precision {rating.precision:.1%} (at least {LEAST_PRECISION:.0%}), recall {rating.recall:.0%}. "
        f"{explain_wrong(rating, warp, camera)}",
    )
    missing = f"{rating} (at least {LEAST_RECALL:.0%}). {explain_missing(rating, warp, camera)}"
    require(rating.recall >= LEAST_RECALL, missing)
    other = make_mask(second.copy())
    _require_mask(other, second.shape[:2], f"{rating} on this image. On the second one your function fails: ")
    if second_truth is None:
        return f"{rating}."
    rated = rate_paint(other, warp, camera, second_truth)
    if rated.precision < LEAST_SECOND[0] or rated.recall < LEAST_SECOND[1]:
        draw_paint(second, rated)
        least = " and ".join(f"{share:.0%}" for share in LEAST_SECOND)
        raise HintError(
            f"{rating} on this image, but {rated} on a second one (at least {least}): the mask knows where the lines "
            "of this image are, not what paint looks like."
        )
    return f"{rating}; on a second image {rated}."


def _require_mask(mask: Any, shape: tuple[int, int], said: str = "") -> None:
    form = f"{mask.shape} {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
    require(
        form in (f"{shape} uint8", f"{shape} bool"),
        f"{said}your function returned {form}; a mask has the shape {shape} and the type uint8, 0 or 255.",
    )
    require(np.any(mask), f"{said}the mask is empty: no pixel passes the threshold.")


# 6.1: columns of the drawn lines, as shares of the width: a lane of 2.8 m, left of the centre. Lines in the upper half
# of its rows, which are longer: they do not count.
DRAWN_LINES, DRAWN_ABOVE = (0.2, 0.65), (0.3, 0.85)
# 6.1 and 6.2: width of the drawn lines.
LINE_WIDTH_PX = 25


def check_lane_width(
    lane_width: Callable[[np.ndarray], float | None],
    *,
    binary: np.ndarray,
    warp: FourPointWarp,
    camera: Camera,
    truth: dict | None,
) -> str:
    """6.1: the width of the lane in metres, from the two histogram peaks of a binary of a bird's-eye view."""
    drawn = np.zeros_like(binary)
    half, columns = len(binary) // 2, binary.shape[1]
    for rows, shares in ((slice(half), DRAWN_ABOVE), (slice(half, -half // 5), DRAWN_LINES)):
        for share in shares:
            drawn[rows, round(share * columns) :][:, :LINE_WIDTH_PX] = 255
    answers = tried(lane_width(binary.copy())), lane_width(drawn.copy())
    width_m, drawn_m = (np.nan if answer is None or np.ndim(answer) else float(answer) for answer in answers)
    numbers = "return one number for each binary, the width in metres; NaN is none."
    require(np.isfinite([width_m, drawn_m]).all(), numbers)
    same = f"{width_m:.2f} m, and the same for a narrower lane. Compute it from the argument `binary`."
    require(abs(width_m - drawn_m) >= 0.005, same)
    across_m = metres_per_pixel(warp, camera)[0]
    _require_width(width_m, lane_histogram(binary), across_m, f"{width_m:.2f} m for this lane. ")
    _require_width(drawn_m, lane_histogram(drawn), across_m, f"{drawn_m:.2f} m for a drawn, narrower lane. ")
    truth_text = f" (truth {truth['lane_width_m']:.2f} m)" if truth else ""
    return f"{width_m:.2f} m{truth_text}, and {drawn_m:.2f} m for a drawn, narrower lane."


def _require_width(width_m: float, histogram: np.ndarray, across_m: float, said: str) -> None:
    """Several columns of a line can be equally high: each of them is accepted."""
    left, right = find_peaks(histogram)
    if left is None or right is None:
        raise HintError(f"{said}The histogram has no peak on one side; take another picture.")
    middle, columns = len(histogram) // 2, float(right - left)
    of_left = np.flatnonzero(histogram[:middle] == histogram[left])
    of_right = middle + np.flatnonzero(histogram[middle:] == histogram[right])
    of_any = across_m * np.array([columns, *(pick(of_right) - pick(of_left) for pick in (np.min, np.mean, np.max))])
    mistakes = {
        "This is the distance in columns. Multiply by the metres per column of chapter 4.": columns,
        "The sign is wrong: columns grow to the right, so take right minus left.": -columns * across_m,
        "You used 3.7 m / 700 columns, which belongs to another warp (chapter 4).": columns * 3.7 / 700,
    }
    otherwise = f"In its lower half of rows the peaks are {columns:.0f} columns apart; how many metres is one?"
    nearest_m = of_any[np.abs(of_any - width_m).argmin()]
    require_equal(width_m, nearest_m, mistakes, otherwise, said=said, atol=0.02)


# 6.2: size of the view, and rows of the dashes (two windows of paint, two of gap).
VIEW_SHAPE, DASH_ROWS = (720, 1280), ((560, 720), (240, 400), (0, 80))
# Columns that the line moves from one window to the next; three windows are more than the margin of 80.
STEP_PX = 40
# Middle row of the lowest window, and the distance of a second line that must not be caught, on the side to which the
# lines lean: within a wider margin, and never within that of windows that go straight up in a gap.
FIRST_CENTRE_ROW, SECOND_LINE_PX = 680, 150
LEAST_CAUGHT = 0.98


def check_coasting(climb: Callable[[np.ndarray, float], np.ndarray | None]) -> str:
    """6.2: windows that move on by their last step, tried on two slanted lines with gaps of two windows."""
    panels: dict[str, tuple[np.ndarray, ...]] = {}
    for lean in ("left", "right"):
        line, binary, start = _slanted_line(lean)
        caught = _caught(tried(climb(binary.copy(), float(start))), binary)
        share = np.count_nonzero(caught & line) / np.count_nonzero(line)
        reached = f"{share:.0%} of the pixels of a dashed line that leans {lean}"
        panel = {f"Leans {lean}: {share:.0%} caught": (line, binary > 0, caught)}
        if (caught & ~line).any() or share < LEAST_CAUGHT:
            draw_caught(panel)
            other = "the windows have also caught pixels of another line; keep their margin of 80 columns."
            step = f"{reached}. In a gap, add the last step, with its sign, to the column."
            raise HintError(other if (caught & ~line).any() else step)
        panels |= panel
    draw_caught(panels)
    return f"{reached}."


def draw_caught(panels: Mapping[str, tuple[np.ndarray, ...]]) -> None:
    """6.2: by title three masks (height, width): of a line, of everything that is set, and of what was caught."""
    pictures = []
    for line, every, caught in panels.values():
        picture = np.full((*line.shape, 3), DARK, np.uint8)
        for mask, colour in ((every, NOT_COUNTED), (line, WRONG), (caught, OTHER_LINE), (caught & line, RIGHT)):
            picture[mask] = colour
        pictures.append(picture)
    figure, _ = show_pictures(pictures, list(panels), width_in=6.0 * len(pictures))
    figure.suptitle("Green: caught. Red: missed. Orange: caught from the other line (gray).", fontsize=11)


def _caught(pixels: np.ndarray, binary: np.ndarray) -> np.ndarray:
    """A mask of set pixels (N, 2), (column, row)."""
    form = "the function returns the set pixels of the line, an array (N, 2) of (column, row)."
    require(np.ndim(pixels) == 2 and np.shape(pixels)[1] == 2, form)
    columns, rows = np.asarray(pixels).astype(int).T
    inside = (columns >= 0) & (columns < binary.shape[1]) & (rows >= 0) & (rows < binary.shape[0])
    require(inside.all() and binary[rows, columns].all(), form)
    caught = np.zeros(binary.shape, bool)
    caught[rows, columns] = True
    return caught


def _slanted_line(lean: str) -> tuple[np.ndarray, np.ndarray, int]:
    """A mask of a dashed line, a binary of it and a second line, and its column in the lowest window."""
    height, width = VIEW_SHAPE
    sign, start = (-1, 420) if lean == "left" else (1, 220)
    rows = np.arange(height)[:, None]
    from_line_px = np.arange(width) - (start + sign * STEP_PX * (FIRST_CENTRE_ROW - rows) / 80)
    dashes = np.any([(rows >= first) & (rows < end) for first, end in DASH_ROWS], axis=0)
    line = (np.abs(from_line_px) <= LINE_WIDTH_PX / 2) & dashes
    other = np.abs(from_line_px - sign * SECOND_LINE_PX) <= LINE_WIDTH_PX / 2
    return line, np.where(line | other, 255, 0).astype(np.uint8), start


# 7.1: outliers of the streaked line, required probability of a sample without outliers, and limit on the trials.
OUTLIER_SHARE, REQUIRED_PROBABILITY, MAX_TRIALS = 0.4, 0.999, 40


def check_ransac_choice(choice: Sequence[int], *, pixels: np.ndarray, line: Sequence[float]) -> str:
    """7.1: pixels a trial and number of trials of RANSAC; `line` is the true (A, B, C) of `pixels` (N, 2)."""
    whole = np.shape(choice) == (2,) and all(int(number) == number >= 1 for number in choice)
    require(whole, "give two whole numbers: pixels a trial, and trials.")
    samples, trials = map(int, choice)
    require(samples >= 3, f"{samples} pixels do not determine a parabola, which has three coefficients.")
    require(
        trials <= MAX_TRIALS or samples > 3,
        f"{trials} trials are more than needed. A sample is clean if all its pixels are *inliers*: the probability is "
        f"0.6 to the power of 3, not 0.4 to the power of 3, and at most {MAX_TRIALS} trials are allowed.",
    )
    clean = (1 - OUTLIER_SHARE) ** samples
    # of at least one clean sample, with one trial less and with all of them
    before, probability = (1 - (1 - clean) ** count for count in (trials - 1, trials))
    more = " Three pixels determine a parabola; more make a clean sample rarer." if samples > 3 else ""
    require(
        probability >= REQUIRED_PROBABILITY and trials <= MAX_TRIALS,
        f"a sample of {samples} pixels is clean with the probability {clean:.1%}, at least one of {trials} samples "
        f"with {probability:.2%}. Required are {REQUIRED_PROBABILITY:.2%} in at most {MAX_TRIALS} trials.{more}",
    )
    require(before < REQUIRED_PROBABILITY, f"{trials} is not the smallest number of trials that is enough.")
    fit = ransac_line(pixels, trials=trials, samples=samples)
    if fit is None:
        raise HintError(f"RANSAC finds no line with {trials} trials of {samples} pixels.")
    rows = np.arange(720)
    error_px = np.abs(fit.columns(rows) - np.polyval(line, rows)).max()
    return f"{probability:.2%} with {trials} trials of {samples} pixels; the line is off by {error_px:.1f} columns."


# 8.1: distance of the bar, and how far its ends may be off.
BAR_AT_M, BAR_TOLERANCE_PX = 7.0, 2.0
Line = Sequence[float] | np.ndarray


def check_bar(bar_px: np.ndarray, *, left: Line, right: Line, camera: Camera, image: np.ndarray) -> str:
    """8.1: raw pixels (2, 2) of the ends of a bar across the lane; lines are (c2 / 2, c1, c0) in metres.

    The bar is drawn on `image`.
    """
    drawn_px = require_shape(bar_px, (2, 2), "give two points (column, row), an array of shape (2, 2)")
    ends_m = np.array([(BAR_AT_M, np.polyval(line, BAR_AT_M)) for line in (left, right)])
    true_px = camera.road_to_pixels(ends_m)
    mistakes = {
        "the points are (row, column). OpenCV's order is (column, row).": true_px[:, ::-1],
        "you forgot the lens on the way back: these are undistorted pixels.": camera.undistort_points(true_px),
        "left and right are exchanged. y is positive to the left.": true_px[::-1],
        "the sign of y is wrong: it is positive to the left of the car.": camera.road_to_pixels(ends_m * [1, -1]),
    }
    draw_bar(image, drawn_px, true_px)
    off_px = dict(zip(("left", "right"), np.linalg.norm(drawn_px - true_px, axis=1), strict=True))
    which = [f"the {side} end is {off:.0f} px off" for side, off in off_px.items() if off > BAR_TOLERANCE_PX]
    otherwise = f"{' and '.join(which)}. The way: metres, view, undistorted image, through the lens."
    require_equal(drawn_px, true_px, mistakes, otherwise, atol=BAR_TOLERANCE_PX)
    return f"both ends are within {max(*off_px.values(), 0.1):.1f} px."


def draw_bar(image: np.ndarray, bar_px: np.ndarray, true_px: np.ndarray) -> None:
    """8.1: a bar (2, 2) on a raw image, and the true one."""
    picture = image.copy()
    draw_polyline(picture, true_px, RIGHT, 9)
    draw_polyline(picture, np.clip(bar_px, -1e4, 1e4), WRONG, 4)
    show_pictures([picture], ["Your bar: red. True bar: green."], columns=1, width_in=9.0)


# 8.2: seconds of the video, from a moment at which a car is alongside; frames a second. Largest offset error (1.06 m
# without a check, 0.19 m with that of the solution); share of the frames that must have a lane.
ALONGSIDE_S, FPS = (4.68, 7.2), 25
OFFSET_TOLERANCE_M, LEAST_FOUND = 0.4, 0.6
IsPlausible = Callable[[Line, Line], object]


def check_sanity(
    is_plausible: IsPlausible,
    *,
    follow: Callable[[IsPlausible, float, float], np.ndarray],
    lane: tuple[Line, Line],
    truth: Mapping[str, np.ndarray] | None,
) -> str:
    """8.2: the sanity check of a memory, tried on pairs of lines (A, B, C) and on a drive that begins beside a car.

    `follow` gives the offset of each frame between two times, for a memory with a sanity check.
    """
    left, right = lane
    refused = "it refuses the lane of chapter 7. The width of a lane is about 3.7 m, give or take half a metre."
    require(tried(is_plausible(left, right)), refused)
    spread = np.add(left, (0, 0.35, -0.35 * 719))
    bend = np.array([4.5e-3, -2 * 4.5e-3 * 719, 4.5e-3 * 719**2])
    width = np.array([0, 0, np.polyval(np.subtract(left, right), 719)])
    # pairs of lines that are no lane
    wrong = {
        "it accepts the same line twice. Which width has a lane?": (left, left),
        "it accepts a lane whose left line is on the right. Which sign has the width?": (right, left),
        "it accepts lines 3.6 m apart near the car and 4.4 m apart 25 m ahead: they are not parallel.": (spread, right),
        "it accepts a bend of 50 m radius. Which curvature can a motorway have?": (right + bend + width, right + bend),
    }
    for sentence, pair in wrong.items():
        require(not is_plausible(*pair), sentence)
    before, after = (follow(check, *ALONGSIDE_S) for check in (lambda left, right: True, is_plausible))
    return _judge_drive(before, after, truth)


def _judge_drive(before: np.ndarray, after: np.ndarray, truth: Mapping[str, np.ndarray] | None) -> str:
    """Offsets (N,) without and with the sanity check against the truth, and a plot of them."""
    times_s = ALONGSIDE_S[0] + np.arange(len(after)) / FPS
    curves = {"before": before, "with your check": after}
    found = np.mean(np.isfinite(after))
    if truth is not None:
        first = round(ALONGSIDE_S[0] * FPS)
        curves["truth"] = truth["offset_m"][first : first + len(after)]
    plot_series(times_s, {"offset (m)": curves}, title="The memory that begins beside the car")
    require(found >= LEAST_FOUND, f"only {found:.0%} of the frames have a lane: the check is too strict.")
    if truth is None:
        return f"{found:.0%} of the frames have a lane (no truth known for this video)."
    worst_before, worst = (float(np.nanmax(np.abs(offset_m - curves["truth"]))) for offset_m in (before, after))
    wrong = f"the offset is still wrong by {worst:.1f} m. Which pair does it believe there?"
    require(worst <= OFFSET_TOLERANCE_M, wrong)
    return (
        f"the offset was wrong by up to {worst_before:.1f} m, now by {worst:.1f} m; {found:.0%} of the frames have a "
        "lane."
    )
