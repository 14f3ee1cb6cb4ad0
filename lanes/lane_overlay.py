"""The lane in metres, drawn on the raw picture: as far as there is evidence for it, and with its doubts in words."""

from __future__ import annotations

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.draw import LANE, LEFT, RIGHT, draw_line, write_text
from lanes.lane import Lane
from lanes.lanemodel import SIDES
from lanes.measure import describe_bend
from lanes.tracker import TrackedLane

NEAREST_M = 3.0
POINTS = 40
ALPHA = 0.3
# A line that is not seen itself is drawn thin: it follows from the other one.
SEEN_PX, INFERRED_PX = 160, 500


def lane_outlines(lane: Lane, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Raw pixels (N, 2) along the left and the right line, near to far, as far as the evidence for either reaches."""
    reach_m = max(lane.left.reach_m, lane.right.reach_m, NEAREST_M)
    x_m = np.geomspace(NEAREST_M, reach_m, POINTS)
    left, right = (lane.outline(camera, side, x_m=x_m) for side in SIDES)
    return left, right


def draw_tracked(image: np.ndarray, tracked: TrackedLane, camera: Camera) -> np.ndarray:
    """Draw the lane and what is known of it.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB, as taken. Stays as it is.
    tracked : TrackedLane
    camera : Camera
        With its mount.

    Returns
    -------
    ndarray of the same shape, uint8
        When the lane is lost, only the words that say so.
    """
    camera.require_size(image)
    if tracked.lane is None:
        return write_text(image, describe_tracked(tracked))
    left, right = (_finite(points) for points in lane_outlines(tracked.lane, camera))
    drawn = image.copy()
    if len(left) > 1 and len(right) > 1:
        _tint(drawn, np.vstack([left, right[::-1]]))
    top = _top_row(left, right)
    # only the rows with the lane are copied again
    part = np.ascontiguousarray(drawn[top:])
    for points, line, colour in ((left, tracked.lane.left, LEFT), (right, tracked.lane.right, RIGHT)):
        width_px = camera.width / (SEEN_PX if line.seen else INFERRED_PX)
        part = draw_line(part, points - [0, top], colour=colour, width_px=width_px)
    drawn[top:] = part
    return _write(drawn, describe_tracked(tracked))


def describe_tracked(tracked: TrackedLane) -> list[str]:
    """The result in words, a line each."""
    lane = tracked.lane
    if lane is None:
        return ["lane lost"]
    side = "left" if lane.offset_m > 0 else "right"
    lines = [
        describe_bend(lane.curvature_per_m),
        f"{abs(lane.offset_m):.2f} ± {lane.offset_std_m:.2f} m {side} of centre",
        f"{tracked.state}, confidence {tracked.confidence:.2f}",
    ]
    warning = tracked.warning.describe() if tracked.warning else None
    return lines + [warning] if warning else lines


def _finite(points: np.ndarray) -> np.ndarray:
    return points[np.isfinite(points).all(axis=1)]


def _top_row(*lines: np.ndarray) -> int:
    rows = np.concatenate([line[:, 1] for line in lines])
    return int(max(rows.min() - 10, 0)) if len(rows) else 0


def _tint(image: np.ndarray, outline: np.ndarray) -> None:
    """Mix the lane's colour into the area inside `outline` (N, 2), in place; its rim lies under the lines."""
    height, width = image.shape[:2]
    corners = np.round(outline.clip(-4 * width, 4 * width)).astype(np.int32)
    left, top = np.maximum(corners.min(axis=0), 0)
    right, bottom = np.minimum(corners.max(axis=0) + 1, [width, height])
    if left >= right or top >= bottom:
        return
    part = image[top:bottom, left:right]
    mask = np.zeros(part.shape[:2], np.uint8)
    cv2.fillPoly(mask, [corners - np.array([left, top], np.int32)], 255)
    offset = tuple(ALPHA * c for c in LANE) + (0.0,)
    tinted = cv2.add(cv2.convertScaleAbs(part, alpha=1 - ALPHA), offset)
    cv2.copyTo(tinted, mask, part)


def _write(image: np.ndarray, lines: list[str]) -> np.ndarray:
    """Write into the upper left corner, in place but for the rows that the letters take."""
    size_px = round(image.shape[0] / 24)
    rows = (len(lines) + 1) * 2 * size_px
    image[:rows] = write_text(image[:rows], lines, size_px=size_px)
    return image
