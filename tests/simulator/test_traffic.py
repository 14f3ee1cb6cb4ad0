"""Vehicles: lateral motion, occlusion of lines, outward faces, and the scenes of traffic and weather."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lanes.camera import CameraPose
from simulator.landscape.backdrop import BackdropStyle
from simulator.light.sunlight import Sun
from simulator.objects.scene_objects import Car, PlacedObject
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

PATH = ((0.0, -LANE_WIDTH_M), (2.0, 0.2), (3.0, 0.2), (5.0, -LANE_WIDTH_M))


def bend_drive(*objects: PlacedObject) -> Drive:
    """Off-centre car in a bend to the right, full-size pictures, no trees."""
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


def outline_mask(drive: Drive, s_m: float, lateral_m: float, body: str) -> np.ndarray:
    """Mask of the convex hull of a vehicle and its ground area, computed without the renderer."""
    angle = float(drive.road.heading(s_m))
    points = np.vstack([outline_points(body), 1.03 * footprint(body)])
    foot = drive.road.position(s_m) + lateral_m * np.array([-np.sin(angle), np.cos(angle)])
    world = foot + points[:, :1] * [np.cos(angle), np.sin(angle)] + points[:, 1:2] * [-np.sin(angle), np.cos(angle)]
    level = drive.pose(0.0).to_car(drive.road, world)
    camera = drive.camera_at(0.0)
    in_camera = (np.column_stack([level, points[:, 2] - camera.pose.height_m])) @ camera.pose.rotation.T
    pixels = cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].reshape(-1, 2)
    mask = np.zeros((camera.height, camera.width), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2).round().astype(np.int32), 1)
    return mask.astype(bool)


@pytest.mark.parametrize(
    ("body", "s_m", "lateral_m", "side"),
    [("motorcycle", 114.0, LANE_WIDTH_M / 2 - 0.45, 0), ("truck", 122.0, -2.4, 1), ("suv", 118.0, -2.2, 1)],
)
def test_vehicle_hides_exactly_the_part_of_the_line_behind_it(body, s_m, lateral_m, side):
    item = PlacedObject(s_m, lateral_m, Car(0, 0, 0.0, "red", body))
    drive = bend_drive(item)
    frame = render_frame(drive)
    columns = line_pixels(frame.truth, side, drive.camera_at(0.0))
    lost = (columns >= 0) & (visible_pixels(columns, frame.hidden) == NOT_VISIBLE)
    hull = outline_mask(drive, s_m, lateral_m, body)
    # The contact shadow also hides paint next to the hull, and the road is visible between rider and mirror.
    grown = cv2.dilate(hull.astype(np.uint8), np.ones((27, 27))).astype(bool)
    shrunk = cv2.erode(hull.astype(np.uint8), np.ones((15, 15))).astype(bool)
    at = [(v, round(float(u))) for v, u in zip(H_SAMPLES, columns, strict=True)]
    inside = np.array([u >= 0 and shrunk[v, u] for v, u in at])
    outside = np.array([u < 0 or not grown[v, u] for v, u in at])
    assert not lost[outside].any()
    if body != "motorcycle":
        assert lost[inside].all()
    assert inside.sum() >= 2 and lost[inside].sum() >= 2


def test_vehicle_changes_the_picture_but_not_the_truth():
    empty, full = (
        render_frame(bend_drive(*objects)) for objects in ((), (PlacedObject(115.0, 0.0, Car(0, 0, 0, "red")),))
    )
    assert truth_row(empty.truth, frame=0) == truth_row(full.truth, frame=0)
    assert not empty.hidden.any() and full.hidden.any()


def test_lateral_path_passes_its_knots_and_sets_the_heading():
    car = PlacedObject(20.0, 0.0, Car(0, 0), 25.0, PATH)
    np.testing.assert_allclose([car.lateral_at(t) for t, _ in PATH], [d for _, d in PATH], atol=1e-12)
    assert car.lateral_at(-1.0) == PATH[0][1] and car.lateral_at(9.0) == PATH[-1][1]
    # The slope of a smooth step at its middle is 1.5 times its mean.
    assert car.path_heading_rad(1.0) == pytest.approx(np.arctan(1.5 * (0.2 + LANE_WIDTH_M) / 2.0 / 25.0), rel=1e-3)
    assert car.path_heading_rad(2.5) == 0 and car.path_heading_rad(4.0) < 0


@pytest.mark.parametrize("body", ["truck", "motorcycle"])
def test_faces_look_outwards(body):
    """From any side, front faces are nearer than back faces."""
    faces = vehicle_faces(body, "blue")
    for direction in np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 1]]):
        depth, facing = faces.middle @ direction, faces.flat_normal @ direction
        assert depth[facing > 0.7].mean() > depth[facing < -0.7].mean() + 0.05


def test_refuses_an_unknown_vehicle():
    with pytest.raises(ValueError, match="tram"):
        vehicle_faces("tram", "red")


@pytest.mark.parametrize("scene", [*WEATHER, *TRAFFIC], ids=lambda scene: scene.name)
def test_scenes_have_a_bend_and_an_off_centre_car(scene):
    """They last three to five seconds and have finite truth throughout."""
    drive = scene.drive()
    truths = [drive.truth(t) for t in np.arange(0.0, scene.seconds, 0.25)]
    assert 3 <= scene.seconds <= 5
    assert max(abs(t.curvature_per_m) for t in truths) > 1 / 700
    assert max(abs(t.offset_m) for t in truths) > 0.08
    assert np.isfinite([t.line_y(side, np.array([5.0, 20.0])) for t in truths for side in (0, 1)]).all()
