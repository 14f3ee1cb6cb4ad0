"""Overlay: the lane drawn on the raw picture, as far as its evidence reaches, with its measures in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.canvas import (
    LANE_COLOUR,
    LEFT_COLOUR,
    PANEL_COLOUR,
    RIGHT_COLOUR,
    UNLIKELY_COLOUR,
    blend_polygon,
    draw_line,
    draw_polyline,
    put_text,
    write_text,
)
from lanes.describe import describe_bend, describe_offset, describe_std
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.lane import Lane
from lanes.detect.paint import MARKINGS, FrameEvidence, extract_evidence
from lanes.detect.road import lines_on_view
from lanes.track.tracker import LaneTracker, TrackedLane

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


def draw_tracked(
    image: np.ndarray, tracked: TrackedLane, camera: Camera, *, onto: np.ndarray | None = None
) -> np.ndarray:
    """A copy of a raw picture with the lane and its measures; words only if the lane is lost.

    Parameters
    ----------
    onto : ndarray, optional
        Drawn on instead of a copy: pass `image` itself if it is not needed any more, which saves a quarter of the time.
    """
    image = camera.require_size(image)
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


def draw_lines(image: np.ndarray, lane: Lane, outlines: tuple[np.ndarray, np.ndarray], camera: Camera) -> None:
    """Draw the two lines of a lane along their outlines, in place; a line that is not seen itself is thin."""
    for points, line, colour in zip(outlines, lane.lines, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
        if len(points):
            draw_polyline(image, points, colour, camera.width / (SEEN_PX if line.seen else INFERRED_PX))


def draw_found(image: np.ndarray, lane: Lane | None, camera: Camera) -> np.ndarray:
    """Draw a lane that was detected in a single picture, as `draw_tracked`."""
    return draw_tracked(image, TrackedLane.from_still(lane), camera)


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


# Overlay styles for an annotated drive: the filled lane, its two lines, or a mosaic with intermediate results.


class DrawOverlay(Protocol):
    """A function that draws the lane in a picture, which it may modify, and returns the annotated picture."""

    def __call__(self, image: np.ndarray, tracked: TrackedLane, evidence: FrameEvidence | None = None) -> np.ndarray:
        """`evidence` is that of a still; without it the mosaic shows that of the band filter, as the tracker uses."""


TelemetryRow = dict[str, str | float | None]

# Marking response that is drawn white. Paint in good condition reaches it.
WHITE_STRENGTH = 4 * MARKINGS.min_strength


def lane_overlay(camera: Camera) -> DrawOverlay:
    """A function that draws the filled lane and its measures."""
    return lambda image, tracked, evidence=None: draw_tracked(image, tracked, camera, onto=image)


def lines_overlay(camera: Camera) -> DrawOverlay:
    """A function that draws the two lane lines and the measures, and leaves the road between the lines unchanged."""

    def draw(image: np.ndarray, tracked: TrackedLane, evidence: FrameEvidence | None = None) -> np.ndarray:
        if tracked.lane is not None:
            draw_lines(image, tracked.lane, lane_outlines(tracked.lane, camera), camera)
        put_text(image, describe_tracked(tracked))
        return image

    return draw


def mosaic_overlay(camera: Camera) -> DrawOverlay:
    """A function that puts the annotated picture, the bird's-eye view, the marking response and the fit together."""
    view = BirdsEyeView(camera)

    def draw(image: np.ndarray, tracked: TrackedLane, evidence: FrameEvidence | None = None) -> np.ndarray:
        evidence = evidence or extract_evidence(view.warp(image), view)
        birdseye = view.blacken(evidence.view_image)
        strength = cv2.convertScaleAbs(evidence.response.strength, alpha=255 / WHITE_STRENGTH)
        panels = {
            "bird's-eye view": birdseye,
            "marking response": cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB),
            "fitted lines": _draw_fit(birdseye // 2, tracked, view),
        }
        return _arrange_mosaic(draw_tracked(image, tracked, camera), panels, _describe_numbers(tracked))

    return draw


STYLES: dict[str, Callable[[Camera], DrawOverlay]] = {
    "lane": lane_overlay,
    "lines": lines_overlay,
    "mosaic": mosaic_overlay,
}


def track_lane(
    tracker: LaneTracker, camera: Camera, *, style: str = "lane"
) -> Callable[..., tuple[np.ndarray, TelemetryRow]]:
    """A function for `process_video` that tracks the lane, draws on each frame and returns it with its telemetry.

    The function is called as process(frame, elapsed_s=None), with the RGB frames in order. `elapsed_s`
    is the time since the previous frame; None means 1 / fps. `style` is one of `STYLES`.
    """
    draw = STYLES[style](camera)

    def process(frame: np.ndarray, elapsed_s: float | None = None) -> tuple[np.ndarray, TelemetryRow]:
        tracked = tracker.update(frame, elapsed_s=elapsed_s)
        warning = tracked.warning
        departure = warning.side if warning and warning.due else None
        return draw(frame, tracked), {**tracked.as_row(), "departure": departure}

    return process


def _arrange_mosaic(main: np.ndarray, panels: Mapping[str, np.ndarray], lines: Sequence[str]) -> np.ndarray:
    """A picture of the size of `main`: main at 2/3 scale, three panels with titles on its right, text below it."""
    height, width = main.shape[:2]
    split, third = 2 * width // 3, height // 3
    mosaic = np.full_like(main, PANEL_COLOUR)
    mosaic[: 2 * third, :split] = cv2.resize(main, (split, 2 * third), interpolation=cv2.INTER_AREA)
    for number, (title, picture) in enumerate(panels.items()):
        panel = cv2.resize(picture, (width - split - 2, third - 2), interpolation=cv2.INTER_LINEAR)
        panel = write_text(panel, title, size_px=third // 14)
        mosaic[number * third : (number + 1) * third - 2, split + 2 :] = panel
    text = mosaic[2 * third :, :split]
    text[:] = write_text(text, lines, size_px=third // 10, panel_alpha=0)
    return mosaic


def _draw_fit(picture: np.ndarray, tracked: TrackedLane, view: BirdsEyeView) -> np.ndarray:
    """The bird's-eye view with the tracked lines, each drawn up to its reach."""
    if tracked.lane is None:
        return picture
    lines_y_m = lines_on_view(tracked.lane.model[None], view.x_m, view.height_m)[0]
    for line, y_m, colour in zip(tracked.lane.lines, lines_y_m, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
        rows = np.flatnonzero(view.x_m <= max(line.reach_m, view.near_m))
        columns = (view.y_m[0] - y_m[rows]) / view.cell_m
        picture = draw_line(picture, np.column_stack([columns, rows]), colour=colour, width_px=3)
    return picture


def _describe_numbers(tracked: TrackedLane) -> list[str]:
    """Lines of text with the numbers that the overlay does not show."""
    lane = tracked.lane
    if lane is None:
        return ["no lane"]
    lines = [
        f"{name} line: {'seen' if line.seen else 'inferred'}, paint on {line.support:.0%} up to {line.reach_m:.0f} m"
        for name, line in (("left", lane.left), ("right", lane.right))
    ]
    return [
        f"lane {lane.width_m:.2f} ± {describe_std(lane.width_std_m)} m wide, "
        f"heading {np.degrees(lane.heading_rad):+.2f}°",
        f"curvature {1000 * lane.curvature_per_m:+.2f} ± {1000 * lane.curvature_std_per_m:.2f} per km",
        f"pitch motion {np.degrees(lane.pitch_rad):+.2f}°, vertical curvature {1000 * lane.vertical_per_m:+.2f} per km",
        *lines,
        f"speed {tracked.motion.speed_mps:.0f} m/s, estimated from the lane" if tracked.motion else "speed unknown",
    ]
