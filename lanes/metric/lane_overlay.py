"""The lane in metres, drawn on the raw picture: as far as there is evidence for it, and with its doubts in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.draw import LANE, LEFT, RIGHT, write_text
from lanes.images import PictureError, list_pictures, read_image, write_image
from lanes.metric.lane import Lane, find_lane
from lanes.metric.lanemodel import SIDES, line_points
from lanes.metric.roadview import RoadView
from lanes.metric.tracked import TrackedLane
from lanes.metric.tracker import LaneTracker
from lanes.words import describe_bend, describe_offset

# Nearer than this the own bonnet hides the road from most cameras. Drawn in even steps of 1/x, that is of picture rows.
NEAREST_M = 6.0
POINTS = 32
ALPHA = 0.3
FARTHEST_PX = 30000
# A line that is not seen itself is drawn thin: it follows from the other one.
SEEN_PX, INFERRED_PX = 160, 500


def lane_outlines(lane: Lane, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Raw pixels (N, 2) along the left and the right line, near to far, as far as the evidence for either reaches."""
    reach_m = max(lane.left.reach_m, lane.right.reach_m, 2 * NEAREST_M)
    along_m = 1 / np.linspace(1 / NEAREST_M, 1 / reach_m, POINTS)
    mount = replace(camera.mount, pitch_rad=camera.mount.pitch_rad + lane.pitch_rad)
    tilted = camera.with_mount(mount)
    points = np.vstack([line_points(lane.model, side, along_m) for side in SIDES])
    rise_m = lane.vertical_per_m * points[:, 0] ** 2 / 2
    pixels = tilted.road_to_pixels(np.column_stack([points, rise_m])).reshape(2, POINTS, 2)
    left, right = (_in_sight(line) for line in pixels)
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
    left, right = lane_outlines(tracked.lane, camera)
    drawn = image.copy()
    if len(left) > 1 and len(right) > 1:
        _tint(image, drawn, np.vstack([left, right[::-1]]))
    for points, line, colour in ((left, tracked.lane.left, LEFT), (right, tracked.lane.right, RIGHT)):
        width_px = round(camera.width / (SEEN_PX if line.seen else INFERRED_PX))
        corners = np.round(points.clip(-FARTHEST_PX, FARTHEST_PX) * 16).astype(np.int32)
        cv2.polylines(drawn, [corners], False, colour, width_px, cv2.LINE_AA, 4)
    return _write(drawn, describe_tracked(tracked))


def draw_found(image: np.ndarray, lane: Lane | None, camera: Camera) -> np.ndarray:
    """Draw a lane that was found in a single picture; see `draw_tracked`."""
    return draw_tracked(image, TrackedLane.from_still(lane), camera)


def track_lane(
    tracker: LaneTracker, camera: Camera
) -> Callable[[np.ndarray], tuple[np.ndarray, dict[str, str | float | None]]]:
    """A function for `video.annotate_video`: takes the frames in order, gives each annotated and its telemetry."""

    def process(frame: np.ndarray) -> tuple[np.ndarray, dict[str, str | float | None]]:
        tracked = tracker.update(frame)
        return draw_tracked(frame, tracked, camera), tracked.as_row()

    return process


def annotate_folder(folder: str | Path, output: str | Path, camera: Camera) -> list[Path]:
    """Find the lane in every picture of a folder, each on its own, and write the annotated pictures to `output`.

    Parameters
    ----------
    folder, output : str or Path
        Two different folders; the pictures keep their names.
    camera : Camera
        With the mount that the pictures were taken from.

    Returns
    -------
    list of Path
        The pictures written, in natural order.

    Raises
    ------
    FileNotFoundError, PictureError
        If a picture cannot be used, or `output` is the folder of the pictures itself.
    """
    if Path(output).resolve() == Path(folder).resolve():
        raise PictureError(f"{output}: is the folder of the pictures, which would be overwritten; name another one.")
    view, written = RoadView(camera), []
    for path in list_pictures(folder):
        image = read_image(path)
        camera.require_size(image, path)
        written.append(write_image(Path(output) / path.name, draw_found(image, find_lane(image, view), camera)))
    return written


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
    back = np.flatnonzero(~(np.diff(pixels[:, 1]) < 0))
    pixels = pixels[: back[0] + 1] if len(back) else pixels
    return pixels[np.isfinite(pixels).all(axis=1)]


def _tint(image: np.ndarray, drawn: np.ndarray, outline: np.ndarray) -> None:
    """Mix the lane's colour into the area inside `outline` (N, 2) of `drawn`, a copy of `image`; lines hide its rim."""
    height, width = image.shape[:2]
    corners = np.round(outline.clip(-FARTHEST_PX, FARTHEST_PX)).astype(np.int32)
    left, top = np.maximum(corners.min(axis=0), 0)
    right, bottom = np.minimum(corners.max(axis=0) + 1, [width, height])
    if left >= right or top >= bottom:
        return
    cv2.fillPoly(drawn, [corners], LANE)
    # outside the area both pictures are the same, and so is their mixture
    part = drawn[top:bottom, left:right]
    cv2.addWeighted(image[top:bottom, left:right], 1 - ALPHA, part, ALPHA, 0, dst=part)


def _write(image: np.ndarray, lines: list[str]) -> np.ndarray:
    """Write into the upper left corner, in place: only the part that the letters may take is worked on."""
    size_px = round(image.shape[0] / 24)
    part = image[: (len(lines) + 1) * 3 * size_px // 2, : 2 * image.shape[1] // 3]
    part[:] = write_text(part, lines, size_px=size_px)
    return image
