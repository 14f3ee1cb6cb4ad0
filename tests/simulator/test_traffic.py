"""Vehicles: lateral motion, occlusion of lines, outward faces, and the scenes of traffic and weather."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from simulator.objects.scene_objects import Car, PlacedObject
from simulator.objects.vehicles import footprint, outline_points
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.road.surface import Zone
from simulator.road.truth import H_SAMPLES, NOT_VISIBLE, line_pixels, truth_entry, truth_row
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import LANE_WIDTH_M, freeway_surface
from tests.simulator.small_drive import POSE, small_drive

PATH = ((0.0, -LANE_WIDTH_M), (2.0, 0.2), (3.0, 0.2), (5.0, -LANE_WIDTH_M))


def bend_drive(*objects: PlacedObject) -> Drive:
    """Off-centre car in a bend to the right, full-size images."""
    camera, surface = replace(DASHCAM, pose=POSE), freeway_surface(Zone(0.0, "asphalt"))
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
    drive = bend_drive(PlacedObject(s_m, lateral_m, Car(0, 0, 0.0, "red", body)))
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


def test_lateral_path_passes_its_knots_and_sets_the_heading():
    car = PlacedObject(20.0, 0.0, Car(0, 0), 25.0, PATH)
    np.testing.assert_allclose([car.lateral_at(t) for t, _ in PATH], [d for _, d in PATH], atol=1e-12)
    assert car.lateral_at(-1.0) == PATH[0][1] and car.lateral_at(9.0) == PATH[-1][1]
    # The slope of a smooth step at its middle is 1.5 times its mean.
    assert car.path_heading_rad(1.0) == pytest.approx(np.arctan(1.5 * (0.2 + LANE_WIDTH_M) / 2.0 / 25.0), rel=1e-3)
    assert car.path_heading_rad(2.5) == 0 and car.path_heading_rad(4.0) < 0
