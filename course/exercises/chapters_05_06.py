"""Exercises of chapters 5 and 6: a mask of the paint, and the search for lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import cv2
import numpy as np

from course.exercises.hints import HintError, require, require_equal, tried
from course.plots import show_pictures
from helpers import (
    LANE_COLOUR,
    LEFT_COLOUR,
    FourPointWarp,
    binary_pixels,
    birdseye_to_road,
    draw_polyline,
    find_peaks,
    lane_histogram,
    metres_per_pixel,
    road_to_pixels,
)

# Colours of the drawings below a verdict, which Jupyter shows at the end of the cell.
RIGHT = LANE_COLOUR
WRONG = LEFT_COLOUR
OTHER_LINE = (255, 150, 0)
MISSED = (255, 0, 255)
NOT_COUNTED = (150, 150, 150)
DARK = (35, 35, 35)

# 5.1

# Precision and recall as chapter 5 defines them: the range that counts, the distance
# outside the lane, half the width of a line with blur, the steps of the lines; metres.
NEAR_M, FAR_M = 5.0, 30.0
MARGIN_M = 1.0
TOLERANCE_M = 0.2
STEPS_M = np.arange(NEAR_M, FAR_M + 0.1, 0.5)
# Clearly more than hls_sobel (51 %), or its colour and magnitude without the gradient
# of L (89 %). 62 % of 375 masks reach both limits: top-hats 41 to 81 columns wide,
# openings 21 to 61 rows tall, three channels, five thresholds.
LEAST_PRECISION = 0.92
# The solid line, and more than one of the two dashes: with one of them it is 54 %, with
# both 62 %.
LEAST_RECALL = 0.55
# On the second image, whose solid line and dashes are less disturbed; a mask drawn for
# the first one has none of it.
LEAST_SECOND_PRECISION = 0.8
LEAST_SECOND_RECALL = 0.45
# A line with a lower recall than this is not found.
LEAST_LINE_RECALL = 0.8
# Length of a dash, width of a line, and a width that only other shapes have, metres.
DASH_M = 3.05
LINE_M = 0.13
WIDE_M = 0.3


@dataclass(frozen=True, eq=False)
class PaintRating:
    """A mask of a bird's-eye view compared with the true lines of the ego lane.

    The masks (height, width) are disjoint: the set pixels on a line, those beside it,
    and those that do not count for the precision.
    """

    precision: float
    left_recall: float
    right_recall: float
    on_line: np.ndarray
    beside: np.ndarray
    not_counted: np.ndarray
    missed_px: list[np.ndarray]  # pieces (2, 2) of the lines without a pixel

    @property
    def recall(self) -> float:
        """Recall of both lines together."""
        return (self.left_recall + self.right_recall) / 2

    def __str__(self) -> str:
        return f"precision {self.precision:.0%}, recall {self.recall:.0%}"


def rate_paint(
    mask: np.ndarray, warp: FourPointWarp, image_to_road: np.ndarray, truth: dict
) -> PaintRating:
    """Rate a mask (height, width), uint8 or bool, of a bird's-eye view.

    `image_to_road` is a homography of `helpers.road_homography`, `truth` an entry of
    truth.json.
    """
    pixels = binary_pixels((mask > 0).astype(np.uint8))
    x, y = birdseye_to_road(pixels, warp, image_to_road).T
    left_y = np.interp(x, truth["x_m"], truth["left_y_m"])
    right_y = np.interp(x, truth["x_m"], truth["right_y_m"])

    is_ahead = (x >= NEAR_M) & (x <= FAR_M)
    is_near_lane = (y < left_y + MARGIN_M) & (y > right_y - MARGIN_M)
    counts = is_ahead & is_near_lane

    on_left = np.abs(y - left_y) <= TOLERANCE_M
    on_right = np.abs(y - right_y) <= TOLERANCE_M
    on_any = on_left | on_right
    counted = int(np.count_nonzero(counts))
    hits = int(np.count_nonzero(counts & on_any))
    left_covered = covered_steps(x[on_left])
    right_covered = covered_steps(x[on_right])

    missed_px = []
    for key, covered in (("left_y_m", left_covered), ("right_y_m", right_covered)):
        line_y = np.interp(STEPS_M, truth["x_m"], truth[key])
        line_m = np.column_stack([STEPS_M, line_y])
        line_px = warp.points_to_birdseye(road_to_pixels(line_m, image_to_road))
        for step in np.flatnonzero(~covered):
            missed_px.append(line_px[step : step + 2])
    return PaintRating(
        precision=hits / max(counted, 1),
        left_recall=float(left_covered.mean()),
        right_recall=float(right_covered.mean()),
        on_line=mask_of(pixels[counts & on_any], mask.shape),
        beside=mask_of(pixels[counts & ~on_any], mask.shape),
        not_counted=mask_of(pixels[~counts], mask.shape),
        missed_px=missed_px,
    )


def covered_steps(x_m: np.ndarray) -> np.ndarray:
    """Whether each of the steps of a line has a point at the distances (N,), metres."""
    points, _ = np.histogram(x_m, STEPS_M)
    return points > 0


def mask_of(pixels: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A bool mask of `shape` that is set at pixels (N, 2), (column, row)."""
    mask = np.zeros(shape, bool)
    columns, rows = pixels.T
    mask[rows, columns] = True
    return mask


def explain_wrong(
    rating: PaintRating, warp: FourPointWarp, image_to_road: np.ndarray
) -> str:
    """What kind of shapes the pixels beside the lines are."""
    across_m, _ = metres_per_pixel(warp, image_to_road)
    beside = rating.beside.astype(np.uint8)
    wide_kernel = np.ones((1, round(WIDE_M / across_m)), np.uint8)
    wide = cv2.morphologyEx(beside, cv2.MORPH_OPEN, wide_kernel)
    if 2 * wide.sum() > beside.sum():
        columns = round(LINE_M / across_m, -1)
        return (
            "Most of the red shapes are wider than a line, which has about "
            f"{columns:.0f} columns."
        )
    return (
        "Most of the red shapes are as narrow as a line. But are they as long as a "
        "dash?"
    )


def explain_missing(
    rating: PaintRating, warp: FourPointWarp, image_to_road: np.ndarray
) -> str:
    """Which line is missing, and why that happens."""
    across_m, along_m = metres_per_pixel(warp, image_to_road)
    if rating.left_recall < LEAST_LINE_RECALL:
        columns = round(LINE_M / across_m, -1)
        return (
            f"Of the solid yellow line it finds only {rating.left_recall:.0%}. A line "
            f"has about {columns:.0f} columns."
        )
    return (
        f"Of the white dashes it finds too little ({rating.right_recall:.0%} of their "
        "line). Is a threshold too high? Or an opening too long? A dash has "
        f"{DASH_M / along_m:.0f} rows, but it leans, so that each of its columns is "
        "shorter."
    )


def draw_paint(above: np.ndarray, rating: PaintRating) -> None:
    """5.1: the rated pixels and the missed pieces of the lines on a view from above."""
    gray = cv2.cvtColor(above, cv2.COLOR_RGB2GRAY)
    picture = cv2.cvtColor(gray, cv2.COLOR_GRAY2RGB) // 2 + 25
    picture[rating.on_line] = RIGHT
    picture[rating.beside] = WRONG
    picture[rating.not_counted] = NOT_COUNTED
    for piece_px in rating.missed_px:
        draw_polyline(picture, piece_px, MISSED, 7.4)
    title = (
        "Your mask: green on a line, red beside it, gray not counted (far, or outside "
        "the lane).\nMagenta: pieces of the lines without a pixel; the gaps between "
        "the dashes count, too."
    )
    show_pictures([picture], [title], columns=1)


MakeMask = Callable[[np.ndarray], Any]


def check_paint_mask(
    make_mask: MakeMask,
    *,
    above: np.ndarray,
    warp: FourPointWarp,
    image_to_road: np.ndarray,
    truth: dict | None,
    second: np.ndarray,
    second_truth: dict | None,
) -> str:
    """5.1: a mask of a bird's-eye view (height, width, 3) better than hls_sobel's.

    It is tried on a second view, too.
    """
    mask = tried(make_mask(above.copy()))
    require_mask(mask, above.shape[:2])
    if truth is None:
        raise HintError(
            f"the mask covers {np.mean(mask > 0):.1%} of the view; no truth is known "
            "for this picture."
        )
    rating = rate_paint(mask, warp, image_to_road, truth)
    draw_paint(above, rating)
    require(
        rating.precision >= LEAST_PRECISION,
        f"precision {rating.precision:.1%} (at least {LEAST_PRECISION:.0%}), recall "
        f"{rating.recall:.0%}. {explain_wrong(rating, warp, image_to_road)}",
    )
    require(
        rating.recall >= LEAST_RECALL,
        f"{rating} (at least {LEAST_RECALL:.0%}). "
        f"{explain_missing(rating, warp, image_to_road)}",
    )

    other = make_mask(second.copy())
    fails = f"{rating} on this image. On the second one your function fails: "
    require_mask(other, second.shape[:2], fails)
    if second_truth is None:
        return f"{rating}."
    rated = rate_paint(other, warp, image_to_road, second_truth)
    is_precise = rated.precision >= LEAST_SECOND_PRECISION
    if not is_precise or rated.recall < LEAST_SECOND_RECALL:
        draw_paint(second, rated)
        raise HintError(
            f"{rating} on this image, but {rated} on a second one (at least "
            f"{LEAST_SECOND_PRECISION:.0%} and {LEAST_SECOND_RECALL:.0%}): the mask "
            "knows where the lines of this image are, not what paint looks like."
        )
    return f"{rating}; on a second image {rated}."


def require_mask(mask: Any, shape: tuple[int, int], said: str = "") -> None:
    """Raise a `HintError` unless this is a mask of this shape with a set pixel."""
    form = type(mask).__name__
    if isinstance(mask, np.ndarray):
        form = f"{mask.shape} {mask.dtype}"
    require(
        form in (f"{shape} uint8", f"{shape} bool"),
        f"{said}your function returned {form}; a mask has the shape {shape} and the "
        "type uint8, 0 or 255.",
    )
    require(np.any(mask), f"{said}the mask is empty: no pixel passes the threshold.")


# 6.1

# Columns of the drawn lines, as shares of the width: a lane of 2.8 m, left of the
# centre. Lines in the upper half of the rows, which are longer: they do not count.
DRAWN_LINES = (0.2, 0.65)
DRAWN_ABOVE = (0.3, 0.85)
# 6.1 and 6.2: width of the drawn lines.
LINE_WIDTH_PX = 25


def check_lane_width(
    lane_width: Callable[[np.ndarray], float | None],
    *,
    binary: np.ndarray,
    warp: FourPointWarp,
    image_to_road: np.ndarray,
    truth: dict | None,
) -> str:
    """6.1: the width of the lane in metres, from the two peaks of a binary."""
    drawn = draw_narrow_lane(binary)
    width_m = require_number(tried(lane_width(binary.copy())))
    drawn_m = require_number(lane_width(drawn.copy()))
    require(
        abs(width_m - drawn_m) >= 0.005,
        f"{width_m:.2f} m, and the same for a narrower lane. Compute it from the "
        "argument `binary`.",
    )
    across_m, _ = metres_per_pixel(warp, image_to_road)
    said = f"{width_m:.2f} m for this lane. "
    require_width(width_m, lane_histogram(binary), across_m, said)
    said = f"{drawn_m:.2f} m for a drawn, narrower lane. "
    require_width(drawn_m, lane_histogram(drawn), across_m, said)

    truth_text = ""
    if truth is not None:
        truth_text = f" (truth {truth['lane_width_m']:.2f} m)"
    return (
        f"{width_m:.2f} m{truth_text}, and {drawn_m:.2f} m for a drawn, narrower lane."
    )


def draw_narrow_lane(binary: np.ndarray) -> np.ndarray:
    """A binary of this shape with a narrow lane, and longer lines in the upper half."""
    drawn = np.zeros_like(binary)
    height, width = binary.shape
    half = height // 2
    for share in DRAWN_ABOVE:
        left = round(share * width)
        drawn[:half, left : left + LINE_WIDTH_PX] = 255
    for share in DRAWN_LINES:
        left = round(share * width)
        drawn[half : height - height // 10, left : left + LINE_WIDTH_PX] = 255
    return drawn


def require_number(answer: object) -> float:
    """The answer as a number of metres; a `HintError` if it is none."""
    number = np.nan
    if isinstance(answer, np.ndarray) and answer.ndim == 0:
        answer = answer.item()
    if isinstance(answer, Real) and not isinstance(answer, bool):
        number = float(answer)
    require(
        np.isfinite(number),
        "return one number for each binary, the width in metres; NaN is none.",
    )
    return number


def require_width(
    width_m: float, histogram: np.ndarray, across_m: float, said: str
) -> None:
    """Several columns of a line can be equally high: each of them is accepted."""
    left, right = find_peaks(histogram)
    if left is None or right is None:
        raise HintError(
            f"{said}The histogram has no peak on one side; take another picture."
        )
    middle = len(histogram) // 2
    highest_left = np.flatnonzero(histogram[:middle] == histogram[left])
    highest_right = middle + np.flatnonzero(histogram[middle:] == histogram[right])
    columns = float(right - left)
    accepted_px = [columns]
    for choose in (np.min, np.mean, np.max):
        accepted_px.append(float(choose(highest_right) - choose(highest_left)))
    accepted_m = across_m * np.array(accepted_px)
    nearest_m = accepted_m[np.abs(accepted_m - width_m).argmin()]

    mistakes = {
        "This is the distance in columns. Multiply by the metres per column of chapter "
        "4.": columns,
        "The sign is wrong: columns grow to the right, so take right minus left.": (
            -columns * across_m
        ),
        "You used 3.7 m / 700 columns, which belongs to another warp (chapter 4).": (
            columns * 3.7 / 700
        ),
    }
    otherwise = (
        f"In its lower half of rows the peaks are {columns:.0f} columns apart; how "
        "many metres is one?"
    )
    require_equal(width_m, nearest_m, mistakes, otherwise, said=said, atol=0.02)


# 6.2

# Size of the view, and rows of the dashes (two windows of paint, two of gap).
VIEW_HEIGHT, VIEW_WIDTH = 720, 1280
DASH_ROWS = ((560, 720), (240, 400), (0, 80))
# Columns that the line moves from one window to the next; three windows are more than
# the margin of 80.
WINDOW_ROWS = 80
STEP_PX = 40
# Column of the line in the middle row of the lowest window.
START_PX = {"left": 420, "right": 220}
FIRST_CENTRE_ROW = 680
# Distance of a second line that must not be caught, on the side to which the lines
# lean: within a wider margin, and never within that of windows that go straight up in a
# gap.
SECOND_LINE_PX = 150
LEAST_CAUGHT = 0.98


@dataclass(frozen=True, eq=False)
class SlantedLine:
    """A dashed line that leans to one side, next to a second line; bool masks."""

    line: np.ndarray
    every_line: np.ndarray
    start_px: int


def check_coasting(climb: Callable[[np.ndarray, float], np.ndarray | None]) -> str:
    """6.2: windows that move on by their last step, on two slanted lines with gaps."""
    panels: dict[str, np.ndarray] = {}
    for lean in ("left", "right"):
        drawn = draw_slanted_line(lean)
        binary = np.where(drawn.every_line, 255, 0).astype(np.uint8)
        pixels = tried(climb(binary.copy(), float(drawn.start_px)))
        caught = require_pixels(pixels, binary)
        share = np.count_nonzero(caught & drawn.line) / np.count_nonzero(drawn.line)
        panel = draw_caught(drawn, caught)
        title = f"Leans {lean}: {share:.0%} caught"
        reached = f"{share:.0%} of the pixels of a dashed line that leans {lean}"

        has_caught_other = (caught & ~drawn.line).any()
        if has_caught_other or share < LEAST_CAUGHT:
            show_caught({title: panel})
        require(
            not has_caught_other,
            "the windows have also caught pixels of another line; keep their margin of "
            "80 columns.",
        )
        require(
            share >= LEAST_CAUGHT,
            f"{reached}. In a gap, add the last step, with its sign, to the column.",
        )
        panels[title] = panel
    show_caught(panels)
    return f"{reached}."


def draw_slanted_line(lean: str) -> SlantedLine:
    """The dashed line that leans to this side."""
    sign = -1 if lean == "left" else 1
    rows = np.arange(VIEW_HEIGHT)[:, None]
    columns = np.arange(VIEW_WIDTH)
    windows_up = (FIRST_CENTRE_ROW - rows) / WINDOW_ROWS
    line_px = START_PX[lean] + sign * STEP_PX * windows_up
    other_px = line_px + sign * SECOND_LINE_PX

    is_dash = np.zeros((VIEW_HEIGHT, 1), bool)
    for first, end in DASH_ROWS:
        is_dash[first:end] = True
    line = (np.abs(columns - line_px) <= LINE_WIDTH_PX / 2) & is_dash
    other = np.abs(columns - other_px) <= LINE_WIDTH_PX / 2
    return SlantedLine(line, line | other, START_PX[lean])


def require_pixels(pixels: Any, binary: np.ndarray) -> np.ndarray:
    """A bool mask of pixels (N, 2), (column, row); they must be set in the binary."""
    form = (
        "the function returns the set pixels of the line, an array (N, 2) of (column, "
        "row)."
    )
    require(np.ndim(pixels) == 2 and np.shape(pixels)[1] == 2, form)
    places = np.asarray(pixels).astype(int)
    height, width = binary.shape
    is_inside = (places >= 0) & (places < (width, height))
    require(is_inside.all(), form)
    caught = mask_of(places, binary.shape)
    require(binary[caught].all(), form)
    return caught


def draw_caught(drawn: SlantedLine, caught: np.ndarray) -> np.ndarray:
    """The pixels that were caught and missed, RGB (height, width, 3)."""
    picture = np.full((*caught.shape, 3), DARK, np.uint8)
    picture[drawn.every_line] = NOT_COUNTED
    picture[drawn.line] = WRONG
    picture[caught] = OTHER_LINE
    picture[caught & drawn.line] = RIGHT
    return picture


def show_caught(panels: Mapping[str, np.ndarray]) -> None:
    """6.2: the panels by title, with what their colours mean."""
    width_in = 6.0 * len(panels)
    figure, _ = show_pictures(list(panels.values()), list(panels), width_in=width_in)
    meaning = "Green: caught. Red: missed. Orange: caught from the other line (gray)."
    figure.suptitle(meaning, fontsize=11)
