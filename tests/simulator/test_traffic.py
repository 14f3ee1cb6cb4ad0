"""Vehicles in the way: where they swerve to, what they hide, and how they look in the suite's scenes."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lanes.camera.camera_pose import CameraPose
from simulator.landscape.sky import BackdropStyle
from simulator.light.sunlight import Sun
from simulator.objects.placement import PlacedObject
from simulator.objects.scene_objects import Car
from simulator.objects.vehicles import footprint, outline_points, vehicle_faces
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import RoadGeometry
from simulator.road.surface import Zone
from simulator.road.truth import H_SAMPLES, NOT_VISIBLE, line_pixels, truth_row, visible_pixels
from simulator.scenes.bad_weather import SCENES as WEATHER
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import LANE_WIDTH_M, freeway_markings, freeway_surface
from simulator.scenes.traffic import SCENES as TRAFFIC

SWERVE = ((0.0, -LANE_WIDTH_M), (2.0, 0.2), (3.0, 0.2), (5.0, -LANE_WIDTH_M))


def bend_drive(*objects: PlacedObject) -> Drive:
    """Off-centre in a bend to the right, at the size of the committed pictures, a bare country."""
    return Drive(
        camera=replace(DASHCAM, pose=CameraPose(1.3, np.radians(-1.5), np.radians(-1.0), np.radians(0.5))),
        road=RoadGeometry([0.0, 400.0], [-1 / 300, -1 / 300]),
        line_laterals_m=(LANE_WIDTH_M / 2, -LANE_WIDTH_M / 2),
        markings=freeway_markings(),
        surface=freeway_surface(Zone(0.0, "asphalt")),
        sun=Sun(1.2, 0.9),
        motion=Motion(100.0, 25.0, offset_m=0.3),
        objects=objects,
        backdrop=BackdropStyle(tree_density=0.0),
        bonnet=False,
        seed=5,
    )


def seen_outline(drive: Drive, s_m: float, lateral_m: float, body: str) -> np.ndarray:
    """Mask of the hull of a vehicle and of the ground that it covers, by a way of its own: no painter, no clipping."""
    angle = float(drive.road.heading(s_m))
    points = np.vstack([outline_points(body), 1.03 * footprint(body)])
    foot = drive.road.position(s_m) + lateral_m * np.array([-np.sin(angle), np.cos(angle)])
    world = foot + points[:, :1] * [np.cos(angle), np.sin(angle)] + points[:, 1:2] * [-np.sin(angle), np.cos(angle)]
    level = drive.pose(0.0).to_car(drive.road, world)
    camera = drive.camera_at(0.0)
    in_camera = (np.column_stack([level, points[:, 2] - camera.pose.height_m])) @ camera.pose.rotation().T
    pixels = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].reshape(-1, 2)
    mask = np.zeros((camera.height, camera.width), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2).round().astype(np.int32), 1)
    return mask.astype(bool)


@pytest.mark.parametrize(
    ("body", "s_m", "lateral_m", "side"),
    [("motorcycle", 114.0, LANE_WIDTH_M / 2 - 0.45, 0), ("truck", 122.0, -2.4, 1), ("suv", 118.0, -2.2, 1)],
)
def test_a_vehicle_hides_the_line_where_it_covers_it_and_nowhere_else(body, s_m, lateral_m, side):
    item = PlacedObject(s_m, lateral_m, Car(0, 0, 0.0, "red", body))
    drive = bend_drive(item)
    frame = render_frame(drive)
    columns = line_pixels(frame.truth, side, drive.camera_at(0.0))
    lost = (columns >= 0) & (visible_pixels(columns, frame.hidden) == NOT_VISIBLE)
    hull = seen_outline(drive, s_m, lateral_m, body)
    # The soft contact shadow hides paint beside the hull too; between rider and mirror the road is seen.
    grown = cv2.dilate(hull.astype(np.uint8), np.ones((27, 27))).astype(bool)
    shrunk = cv2.erode(hull.astype(np.uint8), np.ones((15, 15))).astype(bool)
    at = [(v, round(float(u))) for v, u in zip(H_SAMPLES, columns, strict=True)]
    inside = np.array([u >= 0 and shrunk[v, u] for v, u in at])
    outside = np.array([u < 0 or not grown[v, u] for v, u in at])
    assert not lost[outside].any()
    if body != "motorcycle":
        assert lost[inside].all()
    assert inside.sum() >= 2 and lost[inside].sum() >= 2


def test_a_vehicle_changes_the_picture_but_not_the_truth():
    empty, full = (
        render_frame(bend_drive(*objects)) for objects in ((), (PlacedObject(115.0, 0.0, Car(0, 0, 0, "red")),))
    )
    assert truth_row(empty.truth, frame=0) == truth_row(full.truth, frame=0)
    assert not empty.hidden.any() and full.hidden.any()


def test_swerving_passes_its_knots_and_points_where_it_goes():
    swerving = PlacedObject(20.0, 0.0, Car(0, 0), 25.0, SWERVE)
    np.testing.assert_allclose([swerving.lateral_at(t) for t, _ in SWERVE], [d for _, d in SWERVE], atol=1e-12)
    assert swerving.lateral_at(-1.0) == SWERVE[0][1] and swerving.lateral_at(9.0) == SWERVE[-1][1]
    # Half way through, a smooth step is half as fast again as its mean.
    assert swerving.path_heading_rad(1.0) == pytest.approx(np.arctan(1.5 * (0.2 + LANE_WIDTH_M) / 2.0 / 25.0), rel=1e-3)
    assert swerving.path_heading_rad(2.5) == 0 and swerving.path_heading_rad(4.0) < 0


@pytest.mark.parametrize("body", ["truck", "motorcycle"])
def test_faces_look_outwards(body):
    """Seen from afar on any side, the faces that look at us are in front of those that look away."""
    faces = vehicle_faces(body, "blue")
    for direction in np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 1]]):
        depth, facing = faces.middle @ direction, faces.flat_normal @ direction
        assert depth[facing > 0.7].mean() > depth[facing < -0.7].mean() + 0.05


def test_refuses_an_unknown_vehicle():
    with pytest.raises(ValueError, match="tram"):
        vehicle_faces("tram", "red")


@pytest.mark.parametrize("scene", [*WEATHER, *TRAFFIC], ids=lambda scene: scene.name)
def test_no_scene_is_trivial(scene):
    """Three to five seconds, in a bend somewhere, off the lane's centre, with finite truth throughout."""
    drive = scene.drive()
    truths = [drive.truth(t) for t in np.arange(0.0, scene.seconds, 0.25)]
    assert 3 <= scene.seconds <= 5
    assert max(abs(t.curvature_per_m) for t in truths) > 1 / 700
    assert max(abs(t.offset_m) for t in truths) > 0.08
    assert np.isfinite([t.line_y(side, np.array([5.0, 20.0])) for t in truths for side in (0, 1)]).all()
