"""Pictures of the suite taken with random cameras, and which lanes are right in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.camera import Camera, CameraPose
from lanes.detect.lane import Lane, columns_at
from lanes.errors import PoseError
from lanes.field_of_view import DEFAULT_HFOV_DEG
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.pose import estimate_pose
from lanes.score import score_still
from simulator.rendering.render import Frame, render_frame
from simulator.road.geometry import FLAT
from simulator.scenes.suite import SUITE

SIZES = ((640, 360), (960, 540), (640, 480), (854, 480))


def flat_scenes() -> list[str]:
    """Scenes on a flat road, with or without a lane: the label of a photo is right for no other."""
    return [name for name, scene in SUITE.items() if scene.drive().road.profile == FLAT]


def take_photo(scene: str, rng: np.random.Generator) -> tuple[np.ndarray, LaneColumns]:
    """A picture of a random moment of a scene, taken with a random camera, and its lines for a width of 1280 px."""
    pose = CameraPose(rng.uniform(1.1, 2.1), *np.radians(rng.normal(0, [3.0, 2.0, 0.7])))
    camera = Camera.from_fov(SIZES[rng.integers(len(SIZES))], rng.uniform(50, 80), pose)
    drive = replace(SUITE[scene].drive(), camera=camera, bonnet=False)
    frame = render_frame(drive, rng.uniform(0, SUITE[scene].seconds))
    return frame.image, true_lines(scene, frame, enlarged(drive.camera_at_pitch(frame.truth.pitch_rad)))


def enlarged(camera: Camera) -> Camera:
    """The camera for pictures 1280 px wide: the tolerance of the labels is for this width."""
    return camera.scaled((1280, round(camera.height * 1280 / camera.width)))


def true_lines(scene: str, frame: Frame, camera: Camera) -> LaneColumns:
    """Columns of both lines in each fifth picture row from a little below the horizon on; -2 without a lane."""
    horizon = camera.road_to_pixels(np.array([[1e5, 0.0]]))[0, 1]
    rows = np.arange(np.ceil(horizon + 0.06 * camera.height), camera.height, 5)
    x = np.geomspace(3, 80, 400)
    pixels = (camera.road_to_pixels(np.column_stack([x, frame.truth.line_y(side, x)])) for side in (0, 1))
    outlines = [line[np.isfinite(line[:, 0])] for line in pixels]
    return LaneColumns(scene, rows, columns_at(rows, outlines, camera), EGO_SIDES)


def right_in_picture(lane: Lane, camera: Camera, label: LaneColumns) -> bool:
    """Whether both lines of a lane are right in a picture, as for hand-made labels; `camera` is the estimated one."""
    found = LaneColumns("found", label.rows, lane.columns(enlarged(camera), label.rows), EGO_SIDES)
    return bool(score_still(label, found).right)


def find_with_own_pose(image: np.ndarray, hfov_deg: float = DEFAULT_HFOV_DEG) -> tuple[Camera | None, Lane | None]:
    """The camera with the pose that is estimated from this picture, and the lane; None where there is none."""
    lens = Camera.from_fov((image.shape[1], image.shape[0]), hfov_deg)
    try:
        estimate = estimate_pose(image, lens)
    except PoseError:
        return None, None
    return estimate.camera, estimate.still.lane
