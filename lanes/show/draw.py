"""Overlay: the lane drawn on a raw image, as far as its evidence reaches, with its
measures in words.

The confidence decides what is drawn. A likely lane is filled; a ribbon lies on the
paint of each line that is seen. Lines that are inferred, and those of an uncertain
lane, are dotted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from lanes import canvas
from lanes.camera.model import Camera, require_camera
from lanes.describe import describe_offset
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LEAST_CONFIDENCE, LIKELY_CONFIDENCE
from lanes.detect.evidence import Evidence, find_evidence
from lanes.detect.lane import Lane, project_lines, telemetry_row, visible_part
from lanes.detect.road import SIDES, lines_on_view
from lanes.tracking.tracker import LaneTracker

Row = dict[str, str | float | None]
# What each style draws.
PARTS = ("area", "lines", "far lines", "words", "inset")
STYLES: Mapping[str, Collection[str]] = {
    "lane": ("area", "lines", "far lines", "words"),
    "lines": ("lines", "far lines", "words"),
    "inset": PARTS,
    "mosaic": ("area", "lines", "far lines", "words"),
}
COLOURS: Mapping[str, canvas.Colour] = {
    "area": canvas.LANE_COLOUR,
    "left": canvas.LEFT_COLOUR,
    "right": canvas.RIGHT_COLOUR,
    "far left": (255, 170, 160),
    "far right": (150, 195, 255),
    "uncertain": canvas.UNLIKELY_COLOUR,
}
# A line that is seen up to the border of the image is drawn from this distance on,
# which is below it. The border has this share of the image's shorter side. Otherwise
# the bonnet or a car hides the road before the nearest marking.
NEAREST_M, BORDER_SHARE = 0.5, 0.02
# Points of the outlines, at distances that grow by a factor that falls with the
# distance, because distant bends look sharpest in the image: 24 points deviate by less
# than 0.4 px from bends of 150 m radius over 60 m.
SHARES = np.sqrt(np.linspace(0, 1, 24))
# Width of a ribbon: that of narrow paint, so that the edges of most lines stay visible
# beside it.
RIBBON_M = 0.1
# Width of dots and their distance; those of a hint: the root of the image's area
# divided by this.
DOT_SHARES, HINT_SHARES = (220, 70), (480, 35)
# Half width of the views of the road in the inset and in the mosaic; the share of the
# image that the inset takes.
SHOWN_HALF_WIDTH_M, INSET_SHARE = 4.5, (0.2, 0.42)
NO_POINTS = np.empty((0, 2))


class LaneOutline(NamedTuple):
    """Raw pixels (N, 2) of the drawn parts of a lane; empty for parts that are not
    drawn.

    `area` is the polygon between the lines, `ribbons` are those along the left and the
    right line, `dotted` are these lines where they are inferred or the lane is
    uncertain.
    """

    area: np.ndarray = NO_POINTS
    ribbons: Sequence[np.ndarray] = (NO_POINTS, NO_POINTS)
    dotted: Sequence[np.ndarray] = (NO_POINTS, NO_POINTS)


def draw_lane(
    image: np.ndarray | str | Path,
    lane: Lane | None,
    camera: Camera | None = None,
    *,
    style: str = "lane",
    parts: Collection[str] | None = None,
    colours: Mapping[str, canvas.Colour] | None = None,
    thickness: float = 1.0,
    opacity: float = 0.3,
    evidence: Evidence | None = None,
    onto: np.ndarray | None = None,
) -> np.ndarray:
    """A copy of a raw image with the lane and its measures.

    An uncertain lane, with a confidence below 0.5, is dotted and not filled. One below
    0.15 is a thin dotted hint; the words are "no lane", as without a lane.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8, or path
        RGB.
    camera : Camera, optional
        By default the one that the lane was found with.
    style : {"lane", "lines", "inset", "mosaic"}
        The filled lane, its two lines, the lane with a bird's-eye view, or a mosaic
        with intermediate results.
    parts : collection of str, optional
        What to draw, of `lanes.show.draw.PARTS`; by default the parts of the style.
    colours : mapping of str to RGB colour, optional
        Other colours than those of `lanes.show.draw.COLOURS`, by the same names.
    thickness : float
        Width of lines and dots, relative to the usual one.
    opacity : float
        Opacity of the area, 0 to 1.
    evidence : Evidence, optional
        The evidence of the lane, for the inset and the mosaic; extracted again if not
        given.
    onto : ndarray, optional
        Drawn on instead of a copy: pass `image` itself if it is not needed any more,
        which saves a quarter of the time.

    Raises
    ------
    ValueError
        If there is no such style, part or colour, or a number is out of range.
    PictureError
        If the image is not RGB or not of the camera's size.
    """
    _require_known("style", [style], STYLES)
    parts = STYLES[style] if parts is None else parts
    _require_known("part", parts, PARTS)
    _require_known("colour", colours or (), COLOURS)
    if not (0 < thickness < np.inf and 0 <= opacity <= 1):
        raise ValueError(f"give a thickness above 0 and an opacity from 0 to 1, not {thickness:g} and {opacity:g}.")
    camera = require_camera(camera or (lane.camera if lane else None))
    image = camera.require_size(image)
    outline = lane_outline(lane, camera, thickness=thickness) if lane else None
    inset = _draw_inset(image, lane, camera, evidence) if "inset" in parts else None
    # copied last, because a whole image evicts everything else from the processor's
    # cache
    drawn = image.copy() if onto is None else onto
    if lane and outline:
        used = {**COLOURS, **(colours or {})}
        if "area" in parts and len(outline.area):
            canvas.blend_polygon(drawn, outline.area, used["area"], opacity, edge=cv2.LINE_8)
        root_px = float(np.sqrt(camera.width * camera.height))
        likely, stated = lane.confidence >= LIKELY_CONFIDENCE, lane.confidence >= LEAST_CONFIDENCE
        width_share, step_share = DOT_SHARES if stated else HINT_SHARES
        dot_px, step_px = max(thickness * root_px / width_share, 1.0), root_px / step_share
        for name, ribbon, dotted in zip(("left", "right"), outline.ribbons, outline.dotted, strict=True):
            if "lines" in parts:
                canvas.fill_polygon(drawn, ribbon, used[name])
                canvas.draw_dots(drawn, dotted, used[name if likely else "uncertain"], dot_px, step_px)
        for name, far in zip(("far left", "far right"), lane.adjacent, strict=True):
            if far and "far lines" in parts:
                far_px = thickness * root_px / DOT_SHARES[0]
                canvas.draw_polyline(drawn, far.seen_pixels(camera), used[name], far_px)
    if inset is not None:
        drawn[: inset.shape[0], -inset.shape[1] :] = inset
    if "words" in parts:
        canvas.put_text(drawn, describe_lane(lane))
    return _mosaic(image, drawn, lane, camera, evidence) if style == "mosaic" else drawn


def _require_known(what: str, names: Collection[str], known: Collection[str]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"there is no {what} {name!r}; the {what}s are {', '.join(known)}.")


def lane_outline(lane: Lane, camera: Camera, *, thickness: float = 1.0) -> LaneOutline:
    """The drawn parts of a lane: each line up to its farthest marking, the area up to
    the nearer end of both.

    A line without markings ends with the other one. See `draw_lane`.
    """
    likely, start_m = lane.confidence >= LIKELY_CONFIDENCE, _start_m(lane, camera)
    ends_m = [max(end_m, start_m) for end_m in lane.ends_m]
    farthest_m = max(ends_m)
    if farthest_m <= start_m:
        return LaneOutline()
    along_m = np.minimum(start_m * (farthest_m / start_m) ** SHARES, farthest_m)
    along_m = np.sort(np.append(along_m, min(ends_m)))
    # the outer edge of each ribbon, or the line that is dotted, and the inner edges
    seen = [likely and line.seen for line in lane.lines]
    half_m = thickness * RIBBON_M / 2
    outer_m = np.where(seen, -half_m, 0.0)
    inner_m = np.full(2, half_m)
    inwards_m = np.array([outer_m, inner_m])
    sides = SIDES * (1 - 2 * inwards_m / lane.width_m)
    pixels = project_lines(lane.model, sides.ravel(), camera, along_m).reshape(2, 2, -1, 2)

    counts = np.searchsorted(along_m, ends_m, side="right").tolist()

    def polygon(lines: np.ndarray, count: int) -> np.ndarray:
        first, second = (visible_part(line[:count]) for line in lines)
        return np.concatenate([first, second[::-1]])

    ribbons = [polygon(pixels[:, k], count) if seen[k] else NO_POINTS for k, count in enumerate(counts)]
    dotted = [NO_POINTS if seen[k] else visible_part(pixels[0, k, :count]) for k, count in enumerate(counts)]
    return LaneOutline(polygon(pixels[1], min(counts)) if likely else NO_POINTS, ribbons, dotted)


def _start_m(lane: Lane, camera: Camera) -> float:
    """Where the drawing begins: at the nearest marking seen, or below the image if that
    is at the image's border.
    """
    nearest = min((line for line in lane.lines if line.start_m), key=lambda line: line.start_m, default=None)
    if nearest is None:
        return NEAREST_M
    pixel = nearest.pixels(camera, along_m=nearest.start_m * np.array([1.0, 1.1]))[:1]
    margin_px = BORDER_SHARE * min(camera.size)
    inside = (pixel > margin_px) & (pixel < np.array(camera.size) - margin_px)
    return nearest.start_m if inside.all() else NEAREST_M


def describe_lane(lane: Lane | None) -> list[str]:
    """The result in words: bend, offset, types of the lines, state with confidence, and
    a warning if one is due.
    """
    if lane is None or lane.confidence < LEAST_CONFIDENCE:
        return ["no lane"]
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
    """A function for `process_video` that tracks the lane, draws on each frame and
    returns it with its telemetry.

    The function is called as process(frame, elapsed_s=None), with the frames in order;
    it draws on the frame itself. The telemetry has the time that the tracker took,
    `latency_ms`.
    """

    def process(frame: np.ndarray, elapsed_s: float | None = None) -> tuple[np.ndarray, Row]:
        began_s = time.perf_counter()
        lane = tracker.update(frame, elapsed_s=elapsed_s)
        latency_ms = round(1e3 * (time.perf_counter() - began_s), 3)
        onto = None if style == "mosaic" else frame
        drawn = draw_lane(frame, lane, tracker.camera, style=style, evidence=tracker.evidence, onto=onto)
        return drawn, telemetry_row(lane) | {"latency_ms": latency_ms}

    return process


def _view_panel(view_image: np.ndarray, lane: Lane | None, view: BirdsEyeView) -> np.ndarray:
    """The bird's-eye view, darkened, with the lines up to their reach; dotted if the
    lane is uncertain.
    """
    panel = view.blacken(view_image) // 2
    for k, line in enumerate(lane.lines if lane else ()):
        y_m = lines_on_view(line.model[None], view.x_m, view.height_m)[0, k]
        rows = np.flatnonzero(view.x_m <= max(line.reach_m, view.near_m))
        columns = (view.y_m[0] - y_m[rows]) / view.cell_m
        # without the rows that a line does not pass
        points_px = canvas.finite_points(np.column_stack([columns, rows]))
        if lane and lane.confidence >= LIKELY_CONFIDENCE:
            canvas.draw_polyline(panel, points_px, COLOURS[("left", "right")[k]], 3)
        else:
            canvas.draw_dots(panel, points_px, COLOURS["uncertain"], 3, 9)
    return panel[:, _shown(view)]


def _shown(view: BirdsEyeView) -> np.ndarray:
    # the tracker uses views of several widths: all are shown with the narrowest one
    return np.abs(view.y_m) <= SHOWN_HALF_WIDTH_M


def _draw_inset(image: np.ndarray, lane: Lane | None, camera: Camera, evidence: Evidence | None) -> np.ndarray:
    """The bird's-eye view with the lines, of the size of the inset."""
    view = evidence.view if evidence else BirdsEyeView(camera)
    panel = _view_panel(evidence.view_image if evidence else view.warp(image), lane, view)
    size = round(INSET_SHARE[0] * camera.width), round(INSET_SHARE[1] * camera.height)
    return cv2.resize(panel, size, interpolation=cv2.INTER_AREA)


def _mosaic(
    image: np.ndarray, drawn: np.ndarray, lane: Lane | None, camera: Camera, evidence: Evidence | None
) -> np.ndarray:
    """The annotated image, the bird's-eye view, the marking response and the fit
    together.
    """
    if evidence is None:
        view = BirdsEyeView(camera)
        evidence = find_evidence(image, view, quick=True)
    view = evidence.view
    # paint in good condition has four times the smallest strength of a stripe
    strength = cv2.convertScaleAbs(evidence.response.strength, alpha=255 / (4 * evidence.settings.min_strength))
    panels = {
        "bird's-eye view": view.blacken(evidence.view_image)[:, _shown(view)],
        "marking response": cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB)[:, _shown(view)],
        "fitted lines": _view_panel(evidence.view_image, lane, view),
    }
    words = [f"{name}: {text}" for name, text in lane.summary().items()] if lane else ["no lane"]
    return _arrange_mosaic(drawn, panels, words)


def _arrange_mosaic(main: np.ndarray, panels: Mapping[str, np.ndarray], lines: Sequence[str]) -> np.ndarray:
    """An image of the size of `main`: main at 2/3 scale, three panels with titles on
    its right, text below it.
    """
    height, width = main.shape[:2]
    split, third = 2 * width // 3, height // 3
    mosaic = np.full_like(main, canvas.PANEL_COLOUR)
    mosaic[: 2 * third, :split] = cv2.resize(main, (split, 2 * third), interpolation=cv2.INTER_AREA)
    for number, (title, picture) in enumerate(panels.items()):
        panel = cv2.resize(picture, (width - split - 2, third - 2), interpolation=cv2.INTER_LINEAR)
        canvas.put_text(panel, title, size_px=third // 14)
        mosaic[number * third : (number + 1) * third - 2, split + 2 :] = panel
    canvas.put_text(mosaic[2 * third :, :split], lines, size_px=third // 10, panel_alpha=0)
    return mosaic
