"""Samples for `tools.train_marking_network`: rendered pictures whose visible paint is known for each cell of the view.

Each picture is a random moment of a scene of the suite, or of a variant of it, taken with a random camera. It is
rendered twice, with and without its lane lines: where the two differ is visible paint. The picture is then reduced and
made darker or brighter at random, and its bird's-eye view has a small pose error. Pictures without a road are added
(`tests.support.not_roads`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError, CameraPose
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.markings import lightness, yellowness
from simulator.rendering.drive import Drive
from simulator.rendering.render import render_frame
from simulator.road.materials import MATERIALS
from simulator.road.painted_lines import Marking
from simulator.road.surface import Surface
from simulator.scenes.suite import SUITE
from simulator.scenes.variants import vary_drive
from tests.support.not_roads import KINDS, not_a_road
from tools.learned_response import NETWORK, finer_view

# Random cameras.
SIZES = ((640, 360), (640, 480), (854, 480), (960, 540))
HEIGHT_M, HFOV_DEG, ANGLE_STD_DEG = (1.1, 2.1), (50.0, 80.0), (3.0, 2.0, 0.7)
# Standard deviations of the errors of pitch, yaw and roll, and of the logarithm of the height, of the view.
POSE_ERROR_DEG, HEIGHT_ERROR = (0.6, 1.0, 0.3), 0.05
# One of this number of pictures has no road.
NO_ROAD_EVERY = 10
# Share of the pictures with Botts' dots in place of broken lines, and of those with another pavement; range of the
# factors of wear and of line width.
BOTTS_SHARE, REPAVED_SHARE, WEAR, WIDTH = 0.3, 0.3, (0.6, 1.8), (0.8, 1.3)
PAVEMENTS = tuple(name for name in MATERIALS if name not in ("dirt", "paint"))
# Lines that are painted over or ground off (darker than this) stay in the picture without lane lines.
PAINT_FROM = 0.5
# Difference of both pictures, in grey levels and relative to the largest one nearby (columns): paint has at least the
# first, everything else less than the second; what lies between is not counted.
PAINT_LEVELS, NO_PAINT_LEVELS, PAINT_SHARE, NO_PAINT_SHARE, NEARBY = 4.0, 2.0, 0.5, 0.25, 9
# Columns: the gap of a double line is labelled as paint, because the fit follows the centre of both stripes.
CLOSED = 7
# Label of cells that are not counted.
UNKNOWN = 255


@dataclass(frozen=True, eq=False)
class Sample:
    """Finer view (fine rows, columns, 3) uint8 of a picture; label (rows, columns) uint8: 1 paint, 0 none, 255 open."""

    fine_image: np.ndarray
    label: np.ndarray


def take_sample(number: int) -> Sample | None:
    """Sample number `number`; None if the random camera sees no road."""
    rng = np.random.default_rng([number, 1])
    try:
        return _without_road(number, rng) if number % NO_ROAD_EVERY == 0 else _of_scene(number, rng)
    except CameraError:
        return None


def _of_scene(number: int, rng: np.random.Generator) -> Sample:
    scene = list(SUITE.values())[number % len(SUITE)]
    camera = draw_camera(rng)
    drive = vary_drive(scene.drive(), int(rng.integers(1000, 10_000)))
    drive = replace(
        drive,
        camera=camera,
        bonnet=bool(rng.random() < 0.2),
        markings=draw_markings(drive, rng),
        surface=draw_surface(drive.surface, rng),
    )
    time_s = rng.uniform(0, scene.seconds)
    old = tuple(m for m in drive.markings if max(m.colour) < PAINT_FROM)
    with_lines, without = (render_frame(d, time_s).image for d in (drive, replace(drive, markings=old)))
    view = BirdsEyeView(with_pose_error(drive.camera_at(time_s), rng))
    fine = finer_view(view)
    label = label_cells(fine.warp(with_lines), fine.warp(without))
    label[~view.seen] = UNKNOWN
    picture, scaled = degrade(with_lines, rng)
    small = finer_view(BirdsEyeView(view.camera.scaled(scaled)))
    return Sample(small.warp(picture), label)


def _without_road(number: int, rng: np.random.Generator) -> Sample:
    image = not_a_road(sorted(KINDS)[number // NO_ROAD_EVERY % len(KINDS)], number)
    pose = draw_camera(rng).require_pose()
    picture, size = degrade(image, rng)
    view = BirdsEyeView(Camera.from_fov(size, rng.uniform(*HFOV_DEG), pose))
    return Sample(finer_view(view).warp(picture), np.where(view.seen, 0, UNKNOWN).astype(np.uint8))


def draw_camera(rng: np.random.Generator) -> Camera:
    """A random camera of a car."""
    pose = CameraPose(rng.uniform(*HEIGHT_M), *np.radians(rng.normal(0, ANGLE_STD_DEG)))
    return Camera.from_fov(SIZES[rng.integers(len(SIZES))], rng.uniform(*HFOV_DEG), pose)


def draw_markings(drive: Drive, rng: np.random.Generator) -> tuple[Marking, ...]:
    """The markings of a drive, each with another wear and width; some broken lines become Botts' dots."""
    botts = rng.random() < BOTTS_SHARE
    return tuple(
        replace(
            marking,
            wear=min(marking.wear * rng.uniform(*WEAR), 1.0),
            width_m=marking.width_m * rng.uniform(*WIDTH),
            botts=marking.botts or (botts and marking.dashed),
        )
        for marking in drive.markings
    )


def draw_surface(surface: Surface, rng: np.random.Generator) -> Surface:
    """The surface of a drive, or the same with one other pavement."""
    if rng.random() > REPAVED_SHARE or surface.zones[0].material == "dirt":
        return surface
    material = PAVEMENTS[rng.integers(len(PAVEMENTS))]
    return replace(surface, zones=tuple(replace(zone, material=material) for zone in surface.zones))


def with_pose_error(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera with the error of an estimated pose."""
    pose = camera.require_pose()
    pitch, yaw, roll = np.radians(rng.normal(0, POSE_ERROR_DEG))
    return camera.with_pose(
        CameraPose(
            pose.height_m * float(np.exp(rng.normal(0, HEIGHT_ERROR))),
            pose.pitch_rad + pitch,
            pose.yaw_rad + yaw,
            pose.roll_rad + roll,
        )
    )


def label_cells(with_lines: np.ndarray, without: np.ndarray) -> np.ndarray:
    """Labels (rows, columns) uint8 of the view, from finer views (fine rows, columns, 3) with and without lines."""
    light, bare = lightness(with_lines).astype(np.float32), lightness(without).astype(np.float32)
    # the exposure adapts to the road without its lines
    light *= np.median(bare + 1) / np.median(light + 1)
    yellow = yellowness(with_lines).astype(np.float32) - yellowness(without)
    brighter = np.maximum(light - bare, yellow)
    rows, columns = len(brighter) // NETWORK.fine_rows, brighter.shape[1]
    brighter = brighter.reshape(rows, NETWORK.fine_rows, columns).max(axis=1)
    nearby = cv2.dilate(brighter, np.ones((1, NEARBY), np.uint8))
    label = np.full(brighter.shape, UNKNOWN, np.uint8)
    label[(brighter < NO_PAINT_LEVELS) | (brighter < NO_PAINT_SHARE * nearby)] = 0
    paint = ((brighter >= PAINT_LEVELS) & (brighter >= PAINT_SHARE * nearby)).astype(np.uint8)
    label[cv2.morphologyEx(paint, cv2.MORPH_CLOSE, np.ones((1, CLOSED), np.uint8)) > 0] = 1
    return label


def degrade(image: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, tuple[int, int]]:
    """The picture smaller, darker or brighter, and its size."""
    height, width = image.shape[:2]
    scale = rng.uniform(480 / width, 1) if rng.random() < 0.5 else 1.0
    size = round(width * scale), round(height * scale)
    levels = 255 * (np.arange(256) / 255) ** rng.uniform(0.8, 1.25) * rng.uniform(0.7, 1.1)
    image = cv2.LUT(image, np.clip(levels, 0, 255).astype(np.uint8))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA), size
