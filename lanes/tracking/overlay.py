"""Overlay: the lane drawn on the raw picture, as far as its evidence reaches, with its measures in words."""

from __future__ import annotations

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.drawing.canvas import (
    LANE_COLOUR,
    LEFT_COLOUR,
    RIGHT_COLOUR,
    UNLIKELY_COLOUR,
    blend_polygon,
    draw_polyline,
    put_text,
)
from lanes.io.describe import describe_bend, describe_offset
from lanes.io.frames import Frame, as_rgb
from lanes.tracking.confidence import LIKELY_CONFIDENCE
from lanes.tracking.lane import Lane
from lanes.tracking.tracker import TrackedLane

# Nearer than this the car's own bonnet hides the road from most cameras.
NEAREST_M = 6.0
# Points of the outlines, at distances that form a geometric series, because distant bends look sharpest in the picture:
# 20 points deviate by less than 0.4 px from bends of 150 m radius over 60 m, half as much as 32 in even picture rows.
SHARES = np.linspace(0, 1, 20)
ALPHA = 0.3
# Line width is the picture's width divided by this; a line that is not seen itself is drawn thin.
SEEN_PX, INFERRED_PX = 128, 320


def lane_outlines(lane: Lane, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Raw pixels (N, 2) along the left and the right line, near to far, as far as the evidence for either reaches."""
    reach_m = max(lane.left.reach_m, lane.right.reach_m, 2 * NEAREST_M)
    return lane.outlines(camera, along_m=NEAREST_M * (reach_m / NEAREST_M) ** SHARES)


def draw_tracked(image: Frame, tracked: TrackedLane, camera: Camera, *, onto: Frame | None = None) -> Frame:
    """A copy of a raw picture, RGB or YUV, with the lane and its measures; words only if the lane is lost.

    Parameters
    ----------
    onto : Frame, optional
        Drawn on instead of a copy: pass `image` itself if it is not needed any more, which saves a quarter of the time.
    """
    camera.require_size(image)
    words, lane = describe_tracked(tracked), tracked.lane
    outlines = lane_outlines(lane, camera) if lane else None
    # copied last, because a whole picture evicts everything else from the processor's cache
    drawn = image.copy() if onto is None else onto
    if lane and outlines:
        left, right = outlines
        if len(left) and len(right):
            colour = UNLIKELY_COLOUR if is_unlikely(tracked) else LANE_COLOUR
            blend_polygon(drawn, np.vstack([left, right[::-1]]), colour, ALPHA, edge=cv2.LINE_8)
        draw_lines(drawn, lane, outlines, camera)
    put_text(drawn, words)
    return drawn


def is_unlikely(tracked: TrackedLane) -> bool:
    """Whether the confidence of a lane is below `LIKELY_CONFIDENCE`; its area is then orange instead of green."""
    return tracked.confidence < LIKELY_CONFIDENCE


def draw_lines(image: Frame, lane: Lane, outlines: tuple[np.ndarray, np.ndarray], camera: Camera) -> None:
    """Draw the two lines of a lane along their outlines, in place; a line that is not seen itself is thin."""
    for points, line, colour in zip(outlines, lane.lines, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
        if len(points):
            draw_polyline(image, points, colour, camera.width / (SEEN_PX if line.seen else INFERRED_PX))


def draw_found(image: np.ndarray, lane: Lane | None, camera: Camera) -> np.ndarray:
    """Draw a lane that was detected in a single picture, as `draw_tracked`."""
    return as_rgb(draw_tracked(image, TrackedLane.from_still(lane), camera))


def describe_tracked(tracked: TrackedLane) -> list[str]:
    """The result in words: bend, offset, state with confidence, and a warning if one is due."""
    lane = tracked.lane
    if lane is None:
        return ["lane lost"]
    lines = [
        describe_bend(lane.curvature_per_m),
        describe_offset(lane.offset_m, lane.offset_std_m),
        f"{tracked.state}, confidence {tracked.confidence:.2f}" + (" (unlikely)" if is_unlikely(tracked) else ""),
    ]
    warning = tracked.warning.describe() if tracked.warning else None
    return lines + [warning] if warning else lines
