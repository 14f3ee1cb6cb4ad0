"""Exercises of chapters 7 and 8: fit, draw and track a lane; four points on a road."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from course.exercises.hints import (
    HintError,
    require,
    require_equal,
    require_shape,
    tried,
)
from course.plots import plot_series, show_pictures
from helpers import (
    LANE_COLOUR,
    LEFT_COLOUR,
    LaneFinder,
    LaneResult,
    Lens,
    distort_points,
    draw_lane,
    draw_polyline,
    get_recipe,
    open_video,
    ransac_line,
    read_image,
    road_to_pixels,
    undistort_points,
)

Line = Sequence[float] | np.ndarray

# 7.1: outliers of the streaked line, required probability of a sample without outliers,
# and limit on the trials
OUTLIER_SHARE = 0.4
REQUIRED_PROBABILITY = 0.999
MAX_TRIALS = 40


def check_ransac_choice(
    choice: Sequence[int], *, pixels: np.ndarray, line: Line
) -> str:
    """7.1: pixels a trial and number of trials of RANSAC.

    `line` is the true (A, B, C) of `pixels` (N, 2).
    """
    is_whole = np.shape(choice) == (2,) and all(
        int(number) == number >= 1 for number in choice
    )
    require(is_whole, "give two whole numbers: pixels a trial, and trials.")
    samples, trials = (int(number) for number in choice)
    few = f"{samples} pixels do not determine a parabola, which has three coefficients."
    require(samples >= 3, few)
    require(
        trials <= MAX_TRIALS or samples > 3,
        f"{trials} trials are more than needed. A sample is clean if all its pixels "
        "are *inliers*: the probability is 0.6 to the power of 3, not 0.4 to the power "
        f"of 3, and at most {MAX_TRIALS} trials are allowed.",
    )

    clean = (1 - OUTLIER_SHARE) ** samples
    probability = 1 - (1 - clean) ** trials
    more = ""
    if samples > 3:
        more = " Three pixels determine a parabola; more make a clean sample rarer."
    require(
        probability >= REQUIRED_PROBABILITY and trials <= MAX_TRIALS,
        f"a sample of {samples} pixels is clean with the probability {clean:.1%}, at "
        f"least one of {trials} samples with {probability:.2%}. Required are "
        f"{REQUIRED_PROBABILITY:.2%} in at most {MAX_TRIALS} trials.{more}",
    )
    with_one_less = 1 - (1 - clean) ** (trials - 1)
    require(
        with_one_less < REQUIRED_PROBABILITY,
        f"{trials} is not the smallest number of trials that is enough.",
    )

    fit = ransac_line(pixels, trials=trials, samples=samples)
    if fit is None:
        raise HintError(
            f"RANSAC finds no line with {trials} trials of {samples} pixels."
        )
    rows = np.arange(720)
    error_px = np.abs(np.polyval(fit, rows) - np.polyval(line, rows)).max()
    return (
        f"{probability:.2%} with {trials} trials of {samples} pixels; the line is off "
        f"by {error_px:.1f} columns."
    )


# 8.1: distance of the bar, and how far its ends may be off
BAR_AT_M = 7.0
BAR_TOLERANCE_PX = 2.0


def check_bar(
    bar_px: np.ndarray,
    *,
    left: Line,
    right: Line,
    lens: Lens,
    image_to_road: np.ndarray,
    image: np.ndarray,
) -> str:
    """8.1: raw pixels (2, 2) of the ends of a bar across the lane, drawn on `image`.

    Lines are (c2 / 2, c1, c0) in metres.
    """
    form = "give two points (column, row), an array of shape (2, 2)"
    drawn_px = require_shape(bar_px, (2, 2), form)
    left_m = (BAR_AT_M, np.polyval(left, BAR_AT_M))
    right_m = (BAR_AT_M, np.polyval(right, BAR_AT_M))
    ends_m = np.array([left_m, right_m])
    flat_px = road_to_pixels(ends_m, image_to_road)
    mirrored_px = road_to_pixels(ends_m * [1, -1], image_to_road)
    true_px = distort_points(flat_px, lens)
    draw_bar(image, drawn_px, true_px)

    off_px = np.linalg.norm(drawn_px - true_px, axis=1)
    sentences = []
    for side, side_off_px in zip(("left", "right"), off_px, strict=True):
        if side_off_px > BAR_TOLERANCE_PX:
            sentences.append(f"the {side} end is {side_off_px:.0f} px off")
    way = "The way: metres, view, undistorted image, through the lens."
    mistakes = {
        "the points are (row, column). OpenCV's order is (column, row).": true_px[
            :, ::-1
        ],
        "you forgot the lens on the way back: these are undistorted pixels.": flat_px,
        "you went through the lens backwards: undistorted to raw is needed.": (
            undistort_points(flat_px, lens)
        ),
        "left and right are exchanged. y is positive to the left.": true_px[::-1],
        "the sign of y is wrong: it is positive to the left of the car.": (
            distort_points(mirrored_px, lens)
        ),
    }
    require_equal(
        drawn_px,
        true_px,
        mistakes,
        f"{' and '.join(sentences)}. {way}",
        atol=BAR_TOLERANCE_PX,
    )
    return f"both ends are within {max(off_px.max(), 0.1):.1f} px."


def draw_bar(image: np.ndarray, bar_px: np.ndarray, true_px: np.ndarray) -> None:
    """8.1: a bar (2, 2) on a raw image, and the true one."""
    picture = image.copy()
    draw_polyline(picture, true_px, LANE_COLOUR, 9)
    draw_polyline(picture, bar_px, LEFT_COLOUR, 4)
    show_pictures([picture], ["Your bar: red. True bar: green."], columns=1, width_in=9)


# 8.2: seconds of the video, from a moment at which a car is alongside; frames a second
BEGIN_S = 4.68
END_S = 7.2
FPS = 25
# Largest offset error (0.8 m without a check, 0.2 m with the solution), and share of
# the frames that must have a lane (95 % with the solution)
OFFSET_TOLERANCE_M = 0.4
LEAST_FOUND = 0.7
IsPlausible = Callable[[Line, Line], object]


def check_sanity(
    is_plausible: IsPlausible,
    *,
    follow: Callable[[IsPlausible, float, float], np.ndarray],
    lane: tuple[Line, Line],
    truth: Mapping[str, np.ndarray] | None,
) -> str:
    """8.2: the sanity check of a memory, on pairs of lines (A, B, C) and on a drive.

    `follow` gives the offset of each frame between two times, for a memory with a
    sanity check. The drive begins beside a car.
    """
    left, right = (np.asarray(line, float) for line in lane)
    require(
        tried(is_plausible(left, right)),
        "it refuses the lane of chapter 7. The width of a lane is about 3.7 m, give or "
        "take half a metre.",
    )
    spread = left + (0, 0.35, -0.35 * 719)
    width = np.array([0, 0, np.polyval(left - right, 719)])
    sharp = right + (4.5e-3, -2 * 4.5e-3 * 719, 4.5e-3 * 719**2)
    exchanged = "it accepts a lane whose left line is on the right. "
    not_parallel = "it accepts lines 3.6 m apart near the car and 4.4 m apart 25 m "
    no_lanes = {
        "it accepts the same line twice. Which width has a lane?": (left, left),
        exchanged + "Which sign has the width?": (right, left),
        not_parallel + "ahead: they are not parallel.": (spread, right),
        "it accepts a bend of 50 m radius. Which curvature can a motorway have?": (
            sharp + width,
            sharp,
        ),
    }
    for sentence, (no_left, no_right) in no_lanes.items():
        require(not is_plausible(no_left, no_right), sentence)

    def believe_all(left: Line, right: Line) -> bool:
        return True

    before_m = follow(believe_all, BEGIN_S, END_S)
    after_m = follow(is_plausible, BEGIN_S, END_S)
    return judge_drive(before_m, after_m, truth)


def judge_drive(
    before_m: np.ndarray, after_m: np.ndarray, truth: Mapping[str, np.ndarray] | None
) -> str:
    """Offsets (N,) without and with the sanity check against the truth; drawn."""
    times_s = BEGIN_S + np.arange(len(after_m)) / FPS
    curves = {"before": before_m, "with your check": after_m}
    if truth is not None:
        first = round(BEGIN_S * FPS)
        true_m = truth["offset_m"][first : first + len(after_m)]
        curves["truth"] = true_m
    title = "The memory that begins beside the car"
    plot_series(times_s, {"offset (m)": curves}, title=title)

    found = np.mean(np.isfinite(after_m))
    strict = f"only {found:.0%} of the frames have a lane: the check is too strict."
    require(found >= LEAST_FOUND, strict)
    share = f"{found:.0%} of the frames have a lane"
    if truth is None:
        return f"{share} (no truth known for this video)."
    worst_before_m = np.nanmax(np.abs(before_m - true_m))
    worst_m = np.nanmax(np.abs(after_m - true_m))
    require(
        worst_m <= OFFSET_TOLERANCE_M,
        f"the offset is still wrong by {worst_m:.1f} m. Which pair does it believe "
        "there?",
    )
    return (
        f"the offset was wrong by up to {worst_before_m:.1f} m, now by {worst_m:.1f} "
        f"m; {share}."
    )


# 8.3: frames of a video that are looked at, share of them that must have a lane, and by
# what factor the lane may be wider or narrower at the far end of the view
OWN_FRAMES = 8
LEAST_OWN_FOUND = 0.5
MOST_UNEVEN = 1.2


def check_own_road(points_px: ArrayLike, *, path: str | Path | None) -> str:
    """8.3: four points (4, 2) on a straight part of the reader's own road.

    `path` is a photo or a video. There is no truth: the lane is searched with
    hls_sobel, must be found, and must be as wide far ahead as near the car. It is
    drawn.
    """
    if path is None:
        raise HintError("there is no photo yet: give the path of one, or of a video.")
    require(Path(path).is_file(), f"there is no file {path}; is the path right?")
    form = "give four points (column, row), an array of shape (4, 2)"
    points = require_shape(points_px, (4, 2), form)
    images = list(own_images(Path(path)))
    require(images, f"{path} has no image that can be read; convert it to mp4 or jpg.")
    height, width = images[0].shape[:2]
    require_own_points(points, (width, height))

    finder = own_finder(points, (width, height))
    results = [finder.find(image) for image in images]
    found = [result for result in results if result.state == "found"]
    draw_own_lanes(images, results)

    count = f"a lane in {len(found)} of {len(images)} images"
    require(
        len(found) >= LEAST_OWN_FOUND * len(images),
        f"{count}. Do the four points lie on both lines of your lane, in the order far "
        "left, far right, near right, near left? Or is the paint too faint for "
        "hls_sobel?",
    )
    factor = float(np.median([far_to_near(result) for result in found]))
    times = f"{factor:.2f} times as wide as near the car"
    where = "apart" if factor > 1 else "together"
    require(
        1 / MOST_UNEVEN < factor < MOST_UNEVEN,
        f"{count}, but far ahead it is {times}. Move the far points {where}: the edges "
        "of the four points must be parallel on the road.",
    )
    offset = float(np.median([lane_offset(result) for result in found]))
    side = "left" if offset > 0 else "right"
    return (
        f"{count}; far ahead it is {times}. The camera is {abs(offset):.2f} lane "
        f"widths {side} of its centre, if it looks straight ahead."
    )


def draw_own_lanes(images: list[np.ndarray], results: list[LaneResult]) -> None:
    """8.3: the lanes that were found in the images."""
    drawn = []
    titles = []
    for number, result in enumerate(results):
        left_px, right_px = result.lines_px
        drawn.append(draw_lane(images[number], left_px, right_px))
        titles.append(f"image {number + 1}")
    show_pictures(drawn, titles)


def own_images(path: Path) -> Iterator[np.ndarray]:
    """The photo, or some frames of the video."""
    if path.suffix.lower() in (".jpg", ".jpeg", ".png", ".bmp", ".webp"):
        yield read_image(path)
        return
    with open_video(path) as capture:
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        chosen = np.linspace(0, count - 1, OWN_FRAMES).astype(int)
        for number in range(count):
            if not capture.grab():
                break
            if number in chosen:
                _, bgr = capture.retrieve()
                yield cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def require_own_points(points: np.ndarray, size: tuple[int, int]) -> None:
    """A `HintError` for points that are in another order."""
    far_left, far_right, near_right, near_left = points
    order = "far left, far right, near right, near left"
    require(
        (far_left[1] < near_left[1]) and (far_right[1] < near_right[1]),
        "the far points must be higher in the image, with smaller rows. Order: "
        f"{order}; a point is (column, row).",
    )
    require(
        (far_left[0] < far_right[0]) and (near_left[0] < near_right[0]),
        f"left and right are exchanged. Order: {order}; a point is (column, row).",
    )
    bottom = points[:, 1].max()
    require(
        bottom < size[1],
        f"row {bottom:.0f} is outside of your image of {size[0]}x{size[1]} pixels.",
    )


def own_finder(points: np.ndarray, size: tuple[int, int]) -> LaneFinder:
    """hls_sobel with these four points, for images without a calibrated lens."""
    recipe = replace(get_recipe("hls_sobel", size), source_px=points.tolist())
    # nothing is measured in metres, and the lens only has to leave the image as it is
    matrix = np.array([[size[0], 0, size[0] / 2], [0, size[0], size[1] / 2], [0, 0, 1]])
    lens = Lens(matrix, np.zeros(5), size)
    return LaneFinder(recipe, lens, metres_per_px=(1.0, 1.0))


def lane_offset(result: LaneResult) -> float:
    """Offset of the image centre from the lane centre, in lane widths, > 0: left."""
    width, _ = result.warp.size
    near_row = result.warp.source_px[:, 1].max()
    centre_px = [((width - 1) / 2, near_row)]
    column, row = result.warp.points_to_birdseye(centre_px)[0]
    left_px = np.polyval(np.asarray(result.left), row)
    right_px = np.polyval(np.asarray(result.right), row)
    lane_centre_px = (left_px + right_px) / 2
    return float((lane_centre_px - column) / (right_px - left_px))


def far_to_near(result: LaneResult) -> float:
    """Width of a lane at the upper end of the view divided by that at the lower."""
    difference = np.asarray(result.right) - np.asarray(result.left)
    last_row = result.warp.size[1] - 1
    return float(np.polyval(difference, 0) / np.polyval(difference, last_row))
