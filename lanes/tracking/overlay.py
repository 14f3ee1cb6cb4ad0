"""The lane in metres, drawn on the raw picture: as far as there is evidence for it, and with its doubts in words."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.drawing.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, blend_polygon, draw_polyline, put_text
from lanes.io.describe import describe_bend, describe_offset
from lanes.io.frames import Frame
from lanes.tracking.lane import Lane
from lanes.tracking.model import SIDES, line_points
from lanes.tracking.tracked_lane import TrackedLane

# Nearer than this the own bonnet hides the road from most cameras.
NEAREST_M = 6.0
# Corners of the outlines, each as many times farther than the one before: pictures of bends bend most far away. So 20
# stray by less than 0.4 px from bends of 150 m radius over 60 m, half as much as 32 in even picture rows.
SHARES = np.linspace(0, 1, 20)
ALPHA = 0.3
# A line that is not seen itself is drawn thin: it follows from the other one.
SEEN_PX, INFERRED_PX = 128, 320


def lane_outlines(lane: Lane, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Raw pixels (N, 2) along the left and the right line, near to far, as far as the evidence for either reaches."""
    reach_m = max(lane.left.reach_m, lane.right.reach_m, 2 * NEAREST_M)
    along_m = NEAREST_M * (reach_m / NEAREST_M) ** SHARES
    points = np.empty((len(SIDES), len(along_m), 3))
    points[..., :2] = line_points(lane.model, SIDES, along_m)
    points[..., 2] = lane.height_m_at(points[..., 0])
    tilted = camera.with_pose(replace(camera.pose, pitch_rad=camera.pose.pitch_rad + lane.pitch_rad))
    left, right = tilted.road_to_pixels(points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
    return _in_sight(left), _in_sight(right)


def draw_tracked(image: Frame, tracked: TrackedLane, camera: Camera, *, onto: Frame | None = None) -> Frame:
    """Draw the lane and what is known of it.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8, or YuvFrame
        RGB, or as its video stores it; as taken. Stays as it is.
    tracked : TrackedLane
    camera : Camera
        With its pose.
    onto : the same kind of picture, optional
        What to draw on instead of on a copy: `image` itself where it is needed no more, which saves a quarter of the
        time.

    Returns
    -------
    the same kind of picture
        When the lane is lost, only the words that say so.
    """
    camera.require_size(image)
    words, lane = describe_tracked(tracked), tracked.lane
    left, right = lane_outlines(lane, camera) if lane else ((), ())
    # after all that is to be worked out: a whole picture drives everything else from the processor's cache
    drawn = image.copy() if onto is None else onto
    if len(left) > 1 and len(right) > 1:
        blend_polygon(drawn, np.vstack([left, right[::-1]]), LANE_COLOUR, ALPHA, edge=cv2.LINE_8)
    for points, line, colour in ((left, tracked.left, LEFT_COLOUR), (right, tracked.right, RIGHT_COLOUR)):
        if len(points) > 1:
            draw_polyline(drawn, points, colour, camera.width / (SEEN_PX if line.seen else INFERRED_PX))
    put_text(drawn, words)
    return drawn


def draw_found(image: np.ndarray, lane: Lane | None, camera: Camera) -> np.ndarray:
    """Draw a lane that was found in a single picture; see `draw_tracked`."""
    return draw_tracked(image, TrackedLane.from_still(lane), camera)


def describe_tracked(tracked: TrackedLane) -> list[str]:
    """The result in words, a line each."""
    lane = tracked.lane
    if lane is None:
        return ["lane lost"]
    lines = [
        describe_bend(lane.curvature_per_m),
        describe_offset(lane.offset_m, lane.offset_std_m),
        f"{tracked.state}, confidence {tracked.confidence:.2f}",
    ]
    warning = tracked.warning.describe() if tracked.warning else None
    return lines + [warning] if warning else lines


def _in_sight(pixels: np.ndarray) -> np.ndarray:
    """The points (N, 2), nearest first, until the line turns back or dips behind a crest or out of the lens."""
    rises = pixels[1:, 1] < pixels[:-1, 1]
    end = len(pixels) if rises.all() else int(rises.argmin()) + 1
    # a point that is out of the lens (NaN) does not rise, so that only the first may be one: then nothing is left
    return pixels[: end if end > 1 else 0]
