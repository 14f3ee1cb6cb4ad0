"""Exercises of chapter 4, look at the road from above."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from classic.warp import FourPointWarp, birdseye_to_road, metres_per_pixel
from course.exercises.verdict import NOT_TRIED, Checks, Verdict, correct, hint
from course.measures import lane_widths_px
from lanes.camera import Camera

# Distances at which exercise 4.1 measures the lane, metres, and the largest error.
MEASURED_AT_M = (7.0, 15.0, 30.0)
WIDTH_TOLERANCE_M = 0.05
# Points of the bird's-eye view at which exercise 4.2 is checked, as shares of its width and height.
CHECKED_AT = np.array([[0.5, 1.0], [0.5, 0.5], [0.2, 0.9], [0.8, 0.6], [0.35, 0.3]])
ROAD_TOLERANCE_M = 0.05
# Two points of the road, the second one farther ahead, metres.
AHEAD_M = np.array([[10.0, 0.0], [20.0, 0.0]])


def check_four_points(
    source_px: np.ndarray, *, destination_px: np.ndarray, camera: Camera, lines_m: Sequence[Sequence[float]]
) -> Verdict:
    """4.1: four points such that a straight lane is equally wide at all distances.

    Parameters
    ----------
    lines_m : array_like of shape (2, 2)
        Lateral position at the car, metres, and heading, of the left and the right line of the lane.
    """
    points = np.asarray(source_px, float)
    if points.shape != (4, 2):
        return hint(f"four points (column, row) are needed, an array (4, 2); yours has the shape {points.shape}.")
    if (points[:, 1] >= camera.height).any():
        return hint("a point lies below the image. Is the order (column, row)?")
    try:
        warp = FourPointWarp(points, destination_px, camera.size)
    except ValueError:
        return hint("the edges cross. Give the points in the order of destination_px, around the quadrangle.")
    widths = lane_widths_px(warp, camera, lines_m, MEASURED_AT_M) * metres_per_pixel(warp, camera)[0]
    if not (np.isfinite(widths).all() and (widths > 0).all() and _far_is_up(warp, camera)):
        return hint(
            "the view is mirrored or upside down. Give the points in the order of destination_px: far left first."
        )
    true_m = lines_m[0][0] - lines_m[1][0]
    text = ", ".join(f"{width:.2f}" for width in widths)
    if np.abs(widths - true_m).max() <= WIDTH_TOLERANCE_M:
        return correct(f"the lane is {text} m wide at 7, 15 and 30 m (true {true_m:.2f} m).")
    if np.ptp(widths) > WIDTH_TOLERANCE_M:
        trend = "narrower" if widths[-1] < widths[0] else "wider"
        return hint(
            f"the lane is {text} m wide at 7, 15 and 30 m: it becomes {trend} with the distance. The left and right "
            "edges of your quadrangle must be parallel on the road; the lines of the lane are."
        )
    return hint(f"the lane is {text} m wide, the true one {true_m:.2f} m. Is the lower edge parallel to the axle?")


def check_metres(
    to_metres: Callable[[float, float], tuple[float, float]], *, warp: FourPointWarp, camera: Camera
) -> Verdict:
    """4.2: the position on the road of a pixel of the bird's-eye view, metres."""
    pixels = CHECKED_AT * warp.size
    answers = [to_metres(u, v) for u, v in pixels]
    if any(answer is None for answer in answers):
        return NOT_TRIED
    got, true = np.array(answers, float), birdseye_to_road(pixels, warp, camera)
    if got.shape != true.shape:
        return hint("return two numbers, x forward and y to the left.")
    worst = float(np.abs(got - true).max())
    if worst <= ROAD_TOLERANCE_M:
        return correct(f"at most {worst:.2f} m off at {len(pixels)} pixels.")
    (u, v), (x, y) = pixels[2], got[2]
    said = (
        f"pixel ({u:.0f}, {v:.0f}): yours is x = {x:.2f}, y = {y:.2f} m, "
        f"true x = {true[2, 0]:.2f}, y = {true[2, 1]:.2f} m."
    )
    for fixed, reason in (
        (got * [1, -1], "y is positive to the left, columns count to the right."),
        (got[:, ::-1], "Return x (forward) first, then y (left)."),
        (got + [true[0, 0] - got[0, 0], 0], "The bottom row is not below the camera: it is farther ahead."),
    ):
        if np.abs(fixed - true).max() <= ROAD_TOLERANCE_M:
            return hint(f"{said} {reason}")
    if np.corrcoef(got[:, 0], true[:, 0])[0, 1] < 0:
        return hint(f"{said} Row 0 is the far end: x falls as the row grows.")
    return hint(f"{said} Which metres belong to the corners? See rectangle_m and destination_px.")


def _far_is_up(warp: FourPointWarp, camera: Camera) -> bool:
    """Whether a point farther ahead lies higher in the bird's-eye view."""
    near, far = warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(AHEAD_M)))
    return bool(far[1] < near[1])


CHECKS: Checks = {"4.1": check_four_points, "4.2": check_metres}
