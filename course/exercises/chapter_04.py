"""Exercise of chapter 4, look at the road from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from course.exercises.verdict import Checks, Verdict, correct, hint
from course.measures import lane_widths_px
from helpers import FourPointWarp, metres_per_pixel
from lanes.camera import Camera

# Distances at which exercise 4.1 measures the lane, metres, and the largest error.
MEASURED_AT_M = (7.0, 15.0, 30.0)
WIDTH_TOLERANCE_M = 0.05
# Fewest rows of the image that the quadrangle must span: those from 7 to 30 m ahead are more than 100.
LEAST_ROWS = 100
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
    if np.ptp(points[:, 1]) < LEAST_ROWS:
        return hint(
            f"your quadrangle has only {np.ptp(points[:, 1]):.0f} rows of the image, so the view shows a strip of the "
            "road. Choose a far and a near edge."
        )
    try:
        warp = FourPointWarp(points, destination_px, camera.size)
    except ValueError:
        return hint("the edges cross. Give the points in the order of destination_px, around the quadrangle.")
    widths = lane_widths_px(warp, camera, lines_m, MEASURED_AT_M) * metres_per_pixel(warp, camera)[0]
    if not (np.isfinite(widths).all() and (widths > 1).all() and _far_is_up(warp, camera)):
        return hint(
            "the view is mirrored, turned or upside down. The order is that of destination_px: far left, far right, "
            "near right, near left."
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


def _far_is_up(warp: FourPointWarp, camera: Camera) -> bool:
    """Whether a point farther ahead lies higher in the bird's-eye view."""
    near, far = warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(AHEAD_M)))
    return bool(far[1] < near[1])


CHECKS: Checks = {"4.1": check_four_points}
