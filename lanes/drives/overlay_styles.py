"""Follow the lane through a drive and draw it: filled, its two lines, or a mosaic that shows how it was found."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.drawing.canvas import LEFT_COLOUR, PANEL_COLOUR, RIGHT_COLOUR, draw_polyline, put_text
from lanes.drawing.pictures import draw_line, write_text
from lanes.io.frames import Frame, as_rgb
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.markings import LEAST_STRENGTH, extract_evidence
from lanes.tracking.model import lines_on_view
from lanes.tracking.overlay import INFERRED_PX, SEEN_PX, describe_tracked, draw_tracked, lane_outlines
from lanes.tracking.tracked_lane import TrackedLane
from lanes.tracking.tracker import LaneTracker

# Takes a picture, which it may write on, and what was found in it; returns the annotated one.
Painter = Callable[[Frame, TrackedLane], Frame]
Row = dict[str, str | float | None]

# Strength that is drawn white, so many times what is kept: good paint reaches it.
WHITE_STRENGTH = 4 * LEAST_STRENGTH


def paint_lane(camera: Camera) -> Painter:
    """The filled lane with its measures."""
    return lambda image, tracked: draw_tracked(image, tracked, camera, onto=image)


def paint_lines(camera: Camera) -> Painter:
    """The two lines and the measures; the road between them stays as it is."""

    def paint(image: Frame, tracked: TrackedLane) -> Frame:
        if tracked.lane is not None:
            outlines, lines = lane_outlines(tracked.lane, camera), (tracked.left, tracked.right)
            for points, line, colour in zip(outlines, lines, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
                draw_polyline(image, points, colour, camera.width / (SEEN_PX if line.seen else INFERRED_PX))
        put_text(image, describe_tracked(tracked))
        return image

    return paint


def paint_mosaic(camera: Camera) -> Painter:
    """The annotated picture with, beside it, the road from above, the evidence for paint and the fitted lines."""
    view = BirdsEyeView(camera)

    def paint(image: Frame, tracked: TrackedLane) -> np.ndarray:
        image = as_rgb(image)
        evidence = extract_evidence(image, view)
        road = view.blacken(evidence.view_image)
        strength = cv2.convertScaleAbs(evidence.evidence.strength, alpha=255 / WHITE_STRENGTH)
        evidence = cv2.cvtColor(strength, cv2.COLOR_GRAY2RGB)
        height, width = image.shape[:2]
        mosaic = np.full_like(image, PANEL_COLOUR)
        split, third = 2 * width // 3, height // 3
        main = cv2.resize(draw_tracked(image, tracked, camera), (split, 2 * third), interpolation=cv2.INTER_AREA)
        mosaic[: 2 * third, :split] = main
        panels = {
            "road from above": road,
            "evidence for paint": evidence,
            "fitted lines": _draw_fit(road // 2, tracked, view),
        }
        for number, (title, picture) in enumerate(panels.items()):
            panel = cv2.resize(picture, (width - split - 2, third - 2), interpolation=cv2.INTER_LINEAR)
            mosaic[number * third : (number + 1) * third - 2, split + 2 :] = write_text(
                panel, title, size_px=third // 14
            )
        text = mosaic[2 * third :, :split]
        text[:] = write_text(text, _numbers(tracked), size_px=third // 10, panel_alpha=0)
        return mosaic

    return paint


STYLES: dict[str, Callable[[Camera], Painter]] = {"lane": paint_lane, "lines": paint_lines, "mosaic": paint_mosaic}


def track_lane(tracker: LaneTracker, camera: Camera, *, style: str = "lane") -> Callable[..., tuple[np.ndarray, Row]]:
    """A function for `annotate_video`: takes the frames in order, writes on them, gives each and its telemetry.

    It takes RGB as well as what videos store, `YuvFrame`.

    Parameters
    ----------
    tracker : LaneTracker
        What the function returned goes on from; told a frame alone, it takes 1 / fps as the time since the one before,
        `elapsed_s` says otherwise.
    camera : Camera
        With its pose.
    style : str
        One of `STYLES`.
    """
    paint = STYLES[style](camera)

    def process(frame: Frame, elapsed_s: float | None = None) -> tuple[Frame, Row]:
        tracked = tracker.update(frame, elapsed_s=elapsed_s)
        warning = tracked.warning
        departure = warning.side if warning and warning.due else None
        return paint(frame, tracked), {**tracked.as_row(), "departure": departure}

    return process


def _draw_fit(picture: np.ndarray, tracked: TrackedLane, view: BirdsEyeView) -> np.ndarray:
    """The tracked lines on the view from above, as far as there is evidence for them."""
    if tracked.lane is None:
        return picture
    places = lines_on_view(tracked.lane.model[None], view.x_m, view.height_m)[0]
    for line, place, colour in zip((tracked.left, tracked.right), places, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
        rows = np.flatnonzero(view.x_m <= max(line.reach_m, view.near_m))
        columns = (view.y_m[0] - place[rows]) / view.cell_m
        picture = draw_line(picture, np.column_stack([columns, rows]), colour=colour, width_px=3)
    return picture


def _numbers(tracked: TrackedLane) -> list[str]:
    """What is known beyond the words on the picture."""
    lane = tracked.lane
    if lane is None:
        return ["no lane"]
    lines = [
        f"{name} line: {'seen' if line.seen else 'inferred'}, paint on {line.support:.0%} up to {line.reach_m:.0f} m"
        for name, line in (("left", lane.left), ("right", lane.right))
    ]
    return [
        f"lane {lane.width_m:.2f} ± {lane.width_std_m:.2f} m wide, heading {np.degrees(lane.heading_rad):+.2f}°",
        f"curvature {1000 * lane.curvature_per_m:+.2f} ± {1000 * lane.curvature_std_per_m:.2f} per km",
        f"camera nods {np.degrees(lane.pitch_rad):+.2f}°, road bends up {1000 * lane.vertical_per_m:+.2f} per km",
        *lines,
        f"speed {tracked.speed_mps:.0f} m/s, read off the lane" if tracked.speed_mps else "speed unknown",
    ]
