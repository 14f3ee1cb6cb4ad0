"""Overlay styles for an annotated drive: the filled lane, its two lines, or a mosaic with intermediate results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.drawing.canvas import LEFT_COLOUR, PANEL_COLOUR, RIGHT_COLOUR, put_text
from lanes.drawing.pictures import draw_line, write_text
from lanes.io.describe import describe_std
from lanes.io.frames import Frame, as_rgb
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.markings import MARKINGS, FrameEvidence, extract_evidence
from lanes.tracking.model import lines_on_view
from lanes.tracking.overlay import describe_tracked, draw_lines, draw_tracked, lane_outlines
from lanes.tracking.tracker import LaneTracker, TrackedLane


class DrawOverlay(Protocol):
    """A function that draws the lane in a picture, which it may modify, and returns the annotated picture."""

    def __call__(self, image: Frame, tracked: TrackedLane, evidence: FrameEvidence | None = None) -> Frame:
        """`evidence` is that of a still; without it the mosaic shows that of the band filter, as the tracker uses."""


TelemetryRow = dict[str, str | float | None]

# Marking response that is drawn white. Paint in good condition reaches it.
WHITE_STRENGTH = 4 * MARKINGS.min_strength


def lane_overlay(camera: Camera) -> DrawOverlay:
    """A function that draws the filled lane and its measures."""
    return lambda image, tracked, evidence=None: draw_tracked(image, tracked, camera, onto=image)


def lines_overlay(camera: Camera) -> DrawOverlay:
    """A function that draws the two lane lines and the measures, and leaves the road between the lines unchanged."""

    def draw(image: Frame, tracked: TrackedLane, evidence: FrameEvidence | None = None) -> Frame:
        if tracked.lane is not None:
            draw_lines(image, tracked.lane, lane_outlines(tracked.lane, camera), camera)
        put_text(image, describe_tracked(tracked))
        return image

    return draw


def mosaic_overlay(camera: Camera) -> DrawOverlay:
    """A function that puts the annotated picture, the bird's-eye view, the marking response and the fit together."""
    view = BirdsEyeView(camera)

    def draw(image: Frame, tracked: TrackedLane, evidence: FrameEvidence | None = None) -> np.ndarray:
        image = as_rgb(image)
        evidence = evidence or extract_evidence(view.warp(image), view)
        birdseye = view.blacken(evidence.view_image)
        strength = cv2.convertScaleAbs(evidence.response.strength, alpha=255 / WHITE_STRENGTH)
        panels = {
            "bird's-eye view": birdseye,
            "marking response": cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB),
            "fitted lines": _draw_fit(birdseye // 2, tracked, view),
        }
        return _arrange_mosaic(as_rgb(draw_tracked(image, tracked, camera)), panels, _describe_numbers(tracked))

    return draw


STYLES: dict[str, Callable[[Camera], DrawOverlay]] = {
    "lane": lane_overlay,
    "lines": lines_overlay,
    "mosaic": mosaic_overlay,
}


def track_lane(
    tracker: LaneTracker, camera: Camera, *, style: str = "lane"
) -> Callable[..., tuple[Frame, TelemetryRow]]:
    """A function for `annotate_video` that tracks the lane, draws on each frame and returns it with its telemetry.

    The function is called as process(frame, elapsed_s=None), with the frames in order, RGB or `YuvFrame`. `elapsed_s`
    is the time since the previous frame; None means 1 / fps. `style` is one of `STYLES`.
    """
    draw = STYLES[style](camera)

    def process(frame: Frame, elapsed_s: float | None = None) -> tuple[Frame, TelemetryRow]:
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
