"""Objects: projection, occlusion, shadows, walls, kerbs, bonnet; vehicles on a road, which hide its lines."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from simulator.objects.scene_objects import PlacedObject
from simulator.objects.shadows import shadow_polygons
from simulator.objects.standing import Post
from simulator.objects.trees import Tree
from simulator.objects.vehicles import Car, footprint, outline_points
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.road.truth import H_SAMPLES, NOT_VISIBLE, line_pixels, truth_entry, truth_row
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import LANE_WIDTH_M, Freeway
from tests.simulator.small_drive import POSE, small_drive


def test_shadows_fall_away_from_the_sun():
    polygon = shadow_polygons([Car(x_m=20.0, y_m=-2.0)], np.array([0.0, -0.6, 0.8]))[0]
    assert polygon.dtype == np.float32 and polygon.shape[1] == 2
    # The shadow of the roof is 0.75 m farther left for each metre of height.
    assert polygon[:, 1].max() == pytest.approx(-2.0 + 0.75 * 1.41 + 0.57, abs=0.15)
    assert polygon[:, 1].min() > -2.0 - 0.95
    tree = np.vstack(shadow_polygons([Tree(10.0, "oak", 1, x_m=30.0, y_m=5.0)], np.array([0.6, 0.0, 0.8])))
    assert tree[:, 0].min() < 30 - 5 and tree[:, 0].mean() < 28
    post = shadow_polygons([Post(4.0, x_m=10.0)], np.array([0.0, 0.6, 0.8]))[0]
    assert post[:, 1].min() == pytest.approx(-3.0, abs=0.1)


def bend_drive(*objects: PlacedObject) -> Drive:
    """Off-centre car in a bend to the right, full-size images."""
    camera, surface = replace(DASHCAM, pose=POSE), Freeway().surface()
    return small_drive(-1 / 300, camera=camera, surface=surface, motion=Motion(100.0, 25.0, 0.3), objects=objects)


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
    drive = bend_drive(PlacedObject(s_m, lateral_m, Car("red", body)))
    frame, camera = render_frame(drive), drive.camera_at(0.0)
    assert truth_row(frame.truth, frame=0) == truth_row(bend_drive().truth(0.0), frame=0)
    columns = line_pixels(frame.truth, side, camera)
    label = truth_entry(frame.truth, raw_file="x.jpg", camera=camera, hidden=frame.hidden)
    lost = (columns >= 0) & (np.array(label["lanes"][side]) == NOT_VISIBLE)
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
