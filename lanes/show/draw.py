"""Overlay: the lane drawn on a raw image, as far as its evidence reaches, with its
measures in words.

The confidence decides what is drawn. A likely lane is filled; a ribbon lies on the
paint of each line that is seen, and a line that is inferred is thin. The lines of an
uncertain lane are dotted, and nothing else is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from lanes import canvas
from lanes.camera.model import Camera, require_camera
from lanes.describe import describe_offset
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.evidence import PAINT, Evidence, PaintSettings, find_evidence
from lanes.detect.lane import Lane, project_lines, stated, visible_part
from lanes.detect.road import SIDES, lines_on_view
from lanes.telemetry import telemetry_row
from lanes.tracking.tracker import LaneTracker

Row = dict[str, str | float | None]
Palette = Mapping[str, canvas.Colour]
# What each style draws.
PARTS = ("area", "lines", "far lines", "words", "inset")
STYLES: Mapping[str, Collection[str]] = {
    "lane": ("area", "lines", "far lines", "words"),
    "lines": ("lines", "far lines", "words"),
    "inset": PARTS,
    "mosaic": ("area", "lines", "far lines", "words"),
}
COLOURS: Palette = {
    "area": canvas.LANE_COLOUR,
    "left": canvas.LEFT_COLOUR,
    "right": canvas.RIGHT_COLOUR,
    "far left": (255, 170, 160),
    "far right": (150, 195, 255),
    "uncertain": canvas.UNLIKELY_COLOUR,
}
# A line that is seen up to the border of the image is drawn from this distance on,
# which is below it. The border has this share of the image's shorter side. Otherwise
# the bonnet hides the road before the nearest marking.
NEAREST_M = 0.5
BORDER_SHARE = 0.02
# Seen from the side of the car, the bonnet hides one line farther than the other, by
# this distance at most.
BONNET_M = 3.0
# Points of the outlines, at distances that grow by a factor that falls with the
# distance, because distant bends look sharpest in the image: 24 points deviate by less
# than 0.4 px from bends of 150 m radius over 60 m.
SHARES = np.sqrt(np.linspace(0, 1, 24))
# Width of a ribbon: that of narrow paint, so that the edges of most lines stay visible
# beside it.
RIBBON_M = 0.1
# The root of the image's area divided by the width of a dot and of a thin line, and by
# the distance of two dots.
ROOT_PER_DOT = 220
ROOT_PER_DOT_STEP = 70
# Half width of the views of the road in the inset and in the mosaic.
SHOWN_HALF_WIDTH_M = 4.5
# Width and height of the inset, shares of the image.
INSET_WIDTH_SHARE = 0.2
INSET_HEIGHT_SHARE = 0.42
NO_POINTS = np.empty((0, 2))


class LaneOutline(NamedTuple):
    """Raw pixels (N, 2) of the drawn parts of a lane; empty for parts that are not
    drawn.

    `area` is the polygon between the lines, `ribbons` are those along the left and the
    right line, `thin` are these lines if they have no ribbon: inferred ones, and both
    of an uncertain lane, which are dotted.
    """

    area: np.ndarray = NO_POINTS
    ribbons: Sequence[np.ndarray] = (NO_POINTS, NO_POINTS)
    thin: Sequence[np.ndarray] = (NO_POINTS, NO_POINTS)


@dataclass(frozen=True)
class _Pen:
    """What is drawn, and how; see `draw_lane`."""

    parts: Collection[str]
    colours: Palette
    thickness: float
    opacity: float

    def __post_init__(self) -> None:
        _require_known("part", self.parts, PARTS)
        _require_known("colour", self.colours, COLOURS)
        if not (0 < self.thickness < np.inf and 0 <= self.opacity <= 1):
            raise ValueError(
                "give a thickness above 0 and an opacity from 0 to 1, not "
                f"{self.thickness:g} and {self.opacity:g}."
            )


def draw_lane(  # noqa: PLR0913 (options, called by name)
    image: np.ndarray | str | Path,
    lane: Lane | None,
    camera: Camera | None = None,
    *,
    style: str = "lane",
    parts: Collection[str] | None = None,
    colours: Palette | None = None,
    thickness: float = 1.0,
    opacity: float = 0.3,
    evidence: Evidence | None = None,
    onto: np.ndarray | None = None,
) -> np.ndarray:
    """A copy of a raw image with the lane and its measures.

    A line that is inferred is thin. An uncertain lane, with a confidence below 0.5, is
    dotted and not filled. One below 0.15 is no lane, and not drawn.

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
    pen = _Pen(
        parts=STYLES[style] if parts is None else parts,
        colours={**COLOURS, **(colours or {})},
        thickness=thickness,
        opacity=opacity,
    )
    if not camera:
        camera = lane.camera if lane else None
    camera = require_camera(camera)
    image = camera.require_size(image)
    lane = stated(lane)
    outline = lane_outline(lane, camera, thickness=thickness) if lane else None
    inset = None
    if "inset" in pen.parts:
        inset = _draw_inset(image, lane, camera, evidence)

    # copied last, because a whole image evicts everything else from the processor's
    # cache
    drawn = image.copy() if onto is None else onto
    if lane and outline:
        _draw_parts(drawn, lane, camera, outline, pen)
    if inset is not None:
        height, width = inset.shape[:2]
        drawn[:height, -width:] = inset
    if "words" in pen.parts:
        canvas.put_text(drawn, describe_lane(lane))
    if style == "mosaic":
        return _mosaic(image, drawn, lane, camera, evidence)
    return drawn


def _require_known(what: str, names: Collection[str], known: Collection[str]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(
                f"there is no {what} {name!r}; the {what}s are {', '.join(known)}."
            )


def _draw_parts(
    drawn: np.ndarray, lane: Lane, camera: Camera, outline: LaneOutline, pen: _Pen
) -> None:
    """Draw area, lines and far lines, as far as they are asked for."""
    if "area" in pen.parts and len(outline.area):
        colour = pen.colours["area"]
        canvas.blend_polygon(drawn, outline.area, colour, pen.opacity, edge=cv2.LINE_8)
    root_px = float(np.sqrt(camera.width * camera.height))
    if "lines" in pen.parts:
        _draw_lines(drawn, lane, outline, pen, root_px)
    if "far lines" in pen.parts:
        width_px = pen.thickness * root_px / ROOT_PER_DOT
        for name, far in zip(("far left", "far right"), lane.adjacent, strict=True):
            if far:
                points_px = far.seen_pixels(camera)
                canvas.draw_polyline(drawn, points_px, pen.colours[name], width_px)


def _draw_lines(
    drawn: np.ndarray, lane: Lane, outline: LaneOutline, pen: _Pen, root_px: float
) -> None:
    """Draw the ribbons, thin lines and dots of both lines of a lane.

    `root_px` is the square root of the image's area.
    """
    width_px = max(pen.thickness * root_px / ROOT_PER_DOT, 1.0)
    step_px = root_px / ROOT_PER_DOT_STEP
    likely = lane.confidence >= LIKELY_CONFIDENCE
    for k, name in enumerate(("left", "right")):
        thin = outline.thin[k]
        if likely:
            canvas.fill_polygon(drawn, outline.ribbons[k], pen.colours[name])
            canvas.draw_polyline(drawn, thin, pen.colours[name], width_px)
        else:
            canvas.draw_dots(drawn, thin, pen.colours["uncertain"], width_px, step_px)


def lane_outline(lane: Lane, camera: Camera, *, thickness: float = 1.0) -> LaneOutline:
    """The drawn parts of a lane.

    Each line is drawn from its nearest to its farthest marking, the area up to the
    nearer end of both. A line without markings begins and ends with the other one. See
    `draw_lane`.
    """
    starts_m = _starts_m(lane)
    ends_m = np.maximum(lane.ends_m, starts_m)
    farthest_m = ends_m.max()
    if farthest_m <= starts_m.min():
        return LaneOutline()
    along_m = NEAREST_M * (farthest_m / NEAREST_M) ** SHARES
    along_m = np.minimum(along_m, farthest_m)
    # in ascending order
    along_m = np.unique(np.concatenate([along_m, starts_m, ends_m]))

    # the outer edge of each ribbon, or the thin line, and the inner edges
    likely = lane.confidence >= LIKELY_CONFIDENCE
    seen = [likely and line.seen for line in lane.lines]
    half_m = thickness * RIBBON_M / 2
    outer_m = np.where(seen, -half_m, 0.0)
    inner_m = np.full(2, half_m)
    inwards_m = np.array([outer_m, inner_m])
    sides = SIDES * (1 - 2 * inwards_m / lane.width_m)
    pixels = project_lines(lane.model, sides.ravel(), camera, along_m)
    outer, inner = pixels.reshape(2, 2, -1, 2)

    # each line from its start to its end
    ribbons = [NO_POINTS, NO_POINTS]
    thin = [NO_POINTS, NO_POINTS]
    starts = np.searchsorted(along_m, starts_m).tolist()
    ends = np.searchsorted(along_m, ends_m, side="right").tolist()
    for k in range(2):
        if _is_at_border(outer[k, starts[k]], camera):
            starts[k] = 0
        part = slice(starts[k], ends[k])
        if seen[k]:
            ribbons[k] = _polygon_between(outer[k, part], inner[k, part])
        else:
            thin[k] = visible_part(outer[k, part])
    area = NO_POINTS
    if likely:
        left, right = inner
        end = min(ends)
        area = _polygon_between(left[starts[0] : end], right[starts[1] : end])
    return LaneOutline(area, ribbons, thin)


def _polygon_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The polygon between the visible parts of two lines (N, 2); none if one of them
    has no visible part.
    """
    one = visible_part(one)
    other = visible_part(other)
    if not len(one) or not len(other):
        return NO_POINTS
    return np.concatenate([one, other[::-1]])


def _starts_m(lane: Lane) -> np.ndarray:
    """Distances (2,) at which the left and the right line begin: at the nearest marking
    seen, where the bonnet ends.

    Both begin at the nearer one in a single image, which may show a gap between dashes
    there, and while the dashes of one line are all far away.
    """
    marked_m = [line.start_m for line in lane.lines if line.start_m]
    nearest_m = min(marked_m, default=NEAREST_M)
    starts_m = np.array([line.start_m for line in lane.lines])
    is_beside = np.abs(starts_m - nearest_m) <= BONNET_M
    return np.where(is_beside & lane.tracked, starts_m, nearest_m)


def _is_at_border(pixel: np.ndarray, camera: Camera) -> bool:
    """Whether a pixel (u, v) is outside of the image or near its border."""
    margin_px = BORDER_SHARE * min(camera.size)
    inside = (pixel > margin_px) & (pixel < np.array(camera.size) - margin_px)
    return not inside.all()


def describe_lane(lane: Lane | None) -> list[str]:
    """The result in words: bend, offset, types of the lines, state with confidence, and
    a warning if one is due.
    """
    lane = stated(lane)
    if lane is None:
        return ["no lane"]
    uncertain = " (uncertain)" if lane.confidence < LIKELY_CONFIDENCE else ""
    confidence = f"confidence {lane.confidence:.2f}{lane.describe_reach()}"
    lines = [
        lane.describe_bend(),
        describe_offset(lane.offset_m, lane.offset_std_m),
        " | ".join(line.describe_type() or "unknown" for line in lane.lines),
        f"{lane.state}, {confidence}{uncertain}",
        lane.departure.describe() if lane.departure else None,
    ]
    return [words for words in lines if words]


def track_lane(
    tracker: LaneTracker, *, style: str = "lane"
) -> Callable[..., tuple[np.ndarray, Row]]:
    """A function for `process_video` that tracks the lane, draws on each frame and
    returns it with its telemetry.

    The function is called as process(frame, elapsed_s=None), with the frames in order;
    it draws on the frame itself, or if OpenCV cannot, on a copy. The telemetry has the
    time that the tracker took, `latency_ms`.
    """

    def process(
        frame: np.ndarray, elapsed_s: float | None = None
    ) -> tuple[np.ndarray, Row]:
        began_s = time.perf_counter()
        lane = tracker.update(frame, elapsed_s=elapsed_s)
        took_s = time.perf_counter() - began_s
        # of moviepy, frames are read-only; of others, views of BGR; the mosaic needs
        # the image itself
        can_draw = frame.flags.writeable and frame.flags.c_contiguous
        in_place = can_draw and style != "mosaic"
        drawn = draw_lane(
            frame,
            lane,
            tracker.camera,
            style=style,
            evidence=tracker.evidence,
            onto=frame if in_place else None,
        )
        row = telemetry_row(lane)
        row["latency_ms"] = round(1e3 * took_s, 3)
        return drawn, row

    return process


def _view_panel(
    view_image: np.ndarray, lane: Lane | None, view: BirdsEyeView
) -> np.ndarray:
    """The bird's-eye view, darkened, with the lines up to their reach; dotted if the
    lane is uncertain.
    """
    panel = view.blacken(view_image) // 2
    if lane:
        _draw_lines_on_view(panel, lane, view)
    return panel[:, _shown(view)]


def _draw_lines_on_view(panel: np.ndarray, lane: Lane, view: BirdsEyeView) -> None:
    likely = lane.confidence >= LIKELY_CONFIDENCE
    for k, name in enumerate(("left", "right")):
        line = lane.lines[k]
        y_m = lines_on_view(line.model[None], view.x_m, view.height_m)[0, k]
        rows = np.flatnonzero(view.x_m <= max(line.reach_m, view.near_m))
        columns = (view.y_m[0] - y_m[rows]) / view.cell_m
        # without the rows that a line does not pass
        points_px = canvas.finite_points(np.column_stack([columns, rows]))
        if likely:
            canvas.draw_polyline(panel, points_px, COLOURS[name], 3)
        else:
            canvas.draw_dots(panel, points_px, COLOURS["uncertain"], 3, 9)


def _shown(view: BirdsEyeView) -> np.ndarray:
    # the tracker uses views of several widths: all are shown with the narrowest one
    return np.abs(view.y_m) <= SHOWN_HALF_WIDTH_M


def _draw_inset(
    image: np.ndarray, lane: Lane | None, camera: Camera, evidence: Evidence | None
) -> np.ndarray:
    """The bird's-eye view with the lines, of the size of the inset."""
    if evidence:
        view = evidence.view
        view_image = evidence.view_image
    else:
        view = BirdsEyeView(camera)
        view_image = view.warp(image)
    panel = _view_panel(view_image, lane, view)
    width = round(INSET_WIDTH_SHARE * camera.width)
    height = round(INSET_HEIGHT_SHARE * camera.height)
    return cv2.resize(panel, (width, height), interpolation=cv2.INTER_AREA)


def _mosaic(
    image: np.ndarray,
    drawn: np.ndarray,
    lane: Lane | None,
    camera: Camera,
    evidence: Evidence | None,
    settings: PaintSettings = PAINT,
) -> np.ndarray:
    """The annotated image, the bird's-eye view, the marking response and the fit
    together.

    `settings` are those of evidence that is not given.
    """
    if evidence is None:
        evidence = find_evidence(image, BirdsEyeView(camera), settings, quick=True)
    view = evidence.view
    view_image = evidence.view_image
    # paint in good condition has four times the smallest strength of a stripe
    brightest = 4 * evidence.settings.min_strength
    strength = cv2.convertScaleAbs(evidence.response.strength, alpha=255 / brightest)
    shown = _shown(view)
    panels = {
        "bird's-eye view": view.blacken(view_image)[:, shown],
        "marking response": cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB)[:, shown],
        "fitted lines": _view_panel(view_image, lane, view),
    }
    words = ["no lane"]
    if lane:
        words = [f"{name}: {text}" for name, text in lane.summary().items()]
    return _arrange_mosaic(drawn, panels, words)


def _arrange_mosaic(
    main: np.ndarray, panels: Mapping[str, np.ndarray], lines: Sequence[str]
) -> np.ndarray:
    """An image of the size of `main`: main at 2/3 scale, three panels with titles on
    its right, text below it.
    """
    height, width = main.shape[:2]
    split = 2 * width // 3
    third = height // 3
    below = 2 * third
    mosaic = np.full_like(main, canvas.PANEL_COLOUR)
    mosaic[:below, :split] = cv2.resize(
        main, (split, below), interpolation=cv2.INTER_AREA
    )
    canvas.put_text(mosaic[below:, :split], lines, size_px=third // 10, panel_alpha=0)

    size = (width - split - 2, third - 2)
    for number, (title, picture) in enumerate(panels.items()):
        panel = cv2.resize(picture, size, interpolation=cv2.INTER_LINEAR)
        canvas.put_text(panel, title, size_px=third // 14)
        top = number * third
        mosaic[top : top + third - 2, split + 2 :] = panel
    return mosaic
