"""Overlay: the lane drawn on a raw image, as far as its evidence reaches, with its measures in words."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from lanes.camera import Camera, require_camera
from lanes.canvas import (
    FAR_LEFT_COLOUR,
    FAR_RIGHT_COLOUR,
    LANE_COLOUR,
    LEFT_COLOUR,
    PANEL_COLOUR,
    RIGHT_COLOUR,
    UNLIKELY_COLOUR,
    blend_polygon,
    draw_polyline,
    finite_points,
    put_text,
)
from lanes.describe import describe_offset
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.evidence import Evidence, find_evidence
from lanes.detect.lane import Lane, telemetry_row
from lanes.detect.paint import PAINT
from lanes.detect.road import lines_on_view
from lanes.track.tracker import LaneTracker

# The outlines begin at this distance, which is below the image, and end here if the evidence ends sooner.
NEAREST_M, SHORTEST_M = 0.5, 12.0
# Points of the outlines, at distances that grow by a factor that falls with the distance, because distant bends look
# sharpest in the image: 24 points deviate by less than 0.4 px from bends of 150 m radius over 60 m.
SHARES = np.sqrt(np.linspace(0, 1, 24))
# Line width is the image's width divided by this; a line that is not seen itself is drawn thin.
SEEN_PX, INFERRED_PX = 128, 320
# Half width of the views of the road in the mosaic.
MOSAIC_HALF_WIDTH_M = 5.0
Row = dict[str, str | float | None]
STYLES = ("lane", "lines", "mosaic")


def draw_lane(
    image: np.ndarray | str | Path,
    lane: Lane | None,
    camera: Camera,
    *,
    style: str = "lane",
    evidence: Evidence | None = None,
    onto: np.ndarray | None = None,
) -> np.ndarray:
    """A copy of a raw image with the lane and its measures; words only if there is no lane.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8, or path
        RGB.
    style : {"lane", "lines", "mosaic"}
        The filled lane, its two lines, or a mosaic with intermediate results.
    evidence : Evidence, optional
        What the lane was found in, for the mosaic; extracted again if not given.
    onto : ndarray, optional
        Drawn on instead of a copy: pass `image` itself if it is not needed any more, which saves a quarter of the time.

    Raises
    ------
    ValueError
        If there is no such style.
    PictureError
        If the image is not RGB or not of the camera's size.
    """
    if style not in STYLES:
        raise ValueError(f"there is no style {style!r}; the styles are {', '.join(STYLES)}.")
    image = require_camera(camera).require_size(image)
    outlines = lane_outlines(lane, camera) if lane else None
    # copied last, because a whole image evicts everything else from the processor's cache
    drawn = image.copy() if onto is None else onto
    if lane and outlines:
        left, right = outlines
        if style != "lines" and len(left) and len(right):
            colour = LANE_COLOUR if lane.confidence >= LIKELY_CONFIDENCE else UNLIKELY_COLOUR
            blend_polygon(drawn, np.vstack([left, right[::-1]]), colour, 0.3, edge=cv2.LINE_8)
        for points, line, colour in zip(outlines, lane.lines, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
            draw_polyline(drawn, points, colour, camera.width / (SEEN_PX if line.seen else INFERRED_PX))
        for far, colour in zip(lane.adjacent, (FAR_LEFT_COLOUR, FAR_RIGHT_COLOUR), strict=True):
            if far:
                draw_polyline(drawn, far.seen_pixels(camera), colour, camera.width / INFERRED_PX)
    put_text(drawn, describe_lane(lane))
    return _mosaic(image, drawn, lane, camera, evidence) if style == "mosaic" else drawn


def lane_outlines(lane: Lane, camera: Camera) -> list[np.ndarray]:
    """Raw pixels (N, 2) along the left and the right line, from below the image as far as the evidence of either."""
    reach_m = max(lane.left.reach_m, lane.right.reach_m, SHORTEST_M)
    return lane.outlines(camera, along_m=NEAREST_M * (reach_m / NEAREST_M) ** SHARES)


def describe_lane(lane: Lane | None) -> list[str]:
    """The result in words: bend, offset, types of the lines, state with confidence, and a warning if one is due."""
    if lane is None:
        return ["lane lost"]
    uncertain = " (uncertain)" if lane.confidence < LIKELY_CONFIDENCE else ""
    lines = [
        lane.describe_bend(),
        describe_offset(lane.offset_m, lane.offset_std_m),
        " | ".join(line.describe_type() or "unknown" for line in lane.lines),
        f"{lane.state}, confidence {lane.confidence:.2f}{uncertain}",
        lane.departure.describe() if lane.departure else None,
    ]
    return [words for words in lines if words]


def track_lane(tracker: LaneTracker, *, style: str = "lane") -> Callable[..., tuple[np.ndarray, Row]]:
    """A function for `process_video` that tracks the lane, draws on each frame and returns it with its telemetry.

    The function is called as process(frame, elapsed_s=None), with the frames in order; it draws on the frame itself.
    The telemetry has the time that the tracker took, `latency_ms`.
    """

    def process(frame: np.ndarray, elapsed_s: float | None = None) -> tuple[np.ndarray, Row]:
        began_s = time.perf_counter()
        lane = tracker.update(frame, elapsed_s=elapsed_s)
        latency_ms = round(1e3 * (time.perf_counter() - began_s), 3)
        onto = None if style == "mosaic" else frame
        drawn = draw_lane(frame, lane, tracker.camera, style=style, evidence=tracker.evidence, onto=onto)
        return drawn, telemetry_row(lane) | {"latency_ms": latency_ms}

    return process


def _mosaic(
    image: np.ndarray, drawn: np.ndarray, lane: Lane | None, camera: Camera, evidence: Evidence | None
) -> np.ndarray:
    """The annotated image, the bird's-eye view, the marking response and the fit together."""
    if evidence is None:
        view = BirdsEyeView(camera)
        evidence = find_evidence(image, view, quick=True)
    view = evidence.view
    # the tracker uses views of several widths: all are shown with the same one
    shown = np.abs(view.y_m) <= MOSAIC_HALF_WIDTH_M
    birdseye = view.blacken(evidence.view_image)
    # paint in good condition has four times the smallest strength of a stripe
    strength = cv2.convertScaleAbs(evidence.response.strength, alpha=255 / (4 * PAINT.min_strength))
    panels = {
        "bird's-eye view": birdseye[:, shown],
        "marking response": cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB)[:, shown],
        "fitted lines": _draw_fit(birdseye // 2, lane, view)[:, shown],
    }
    words = [f"{name}: {text}" for name, text in lane.summary().items()] if lane else ["no lane"]
    return _arrange_mosaic(drawn, panels, words)


def _arrange_mosaic(main: np.ndarray, panels: Mapping[str, np.ndarray], lines: Sequence[str]) -> np.ndarray:
    """A picture of the size of `main`: main at 2/3 scale, three panels with titles on its right, text below it."""
    height, width = main.shape[:2]
    split, third = 2 * width // 3, height // 3
    mosaic = np.full_like(main, PANEL_COLOUR)
    mosaic[: 2 * third, :split] = cv2.resize(main, (split, 2 * third), interpolation=cv2.INTER_AREA)
    for number, (title, picture) in enumerate(panels.items()):
        panel = cv2.resize(picture, (width - split - 2, third - 2), interpolation=cv2.INTER_LINEAR)
        put_text(panel, title, size_px=third // 14)
        mosaic[number * third : (number + 1) * third - 2, split + 2 :] = panel
    put_text(mosaic[2 * third :, :split], lines, size_px=third // 10, panel_alpha=0)
    return mosaic


def _draw_fit(image: np.ndarray, lane: Lane | None, view: BirdsEyeView) -> np.ndarray:
    """The bird's-eye view, on which the lines are drawn, each up to its reach."""
    if lane is None:
        return image
    lines_y_m = lines_on_view(lane.model[None], view.x_m, view.height_m)[0]
    for line, y_m, colour in zip(lane.lines, lines_y_m, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
        rows = np.flatnonzero(view.x_m <= max(line.reach_m, view.near_m))
        columns = (view.y_m[0] - y_m[rows]) / view.cell_m
        # without the rows that a line does not pass
        draw_polyline(image, finite_points(np.column_stack([columns, rows])), colour, 3)
    return image
