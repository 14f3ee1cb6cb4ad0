"""Samples for `tools.train_marking_network`: rendered pictures whose visible paint is known for each cell of the view.

Each picture is a random moment of a variant of a scene of the suite, taken with a random camera. It is rendered twice,
with and without its lane lines: where the first is clearly lighter or yellower is visible paint. Botts' dots are
labelled like the dashes that they stand for, so that the network learns to connect them. Joints beside the lines and
pale streaks along the road are added, which are no paint. The picture is then reduced, exposed, blurred or sharpened,
and compressed at random, and its bird's-eye view has a small pose error. Pictures without a road are added
(`tests.support.not_roads`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.network import NETWORK, finer_view
from lanes.detect.paint import lightness, yellowness
from lanes.errors import CameraError
from simulator.rendering.drive import Drive
from simulator.rendering.render import render_frame
from simulator.road.markings import Marking
from simulator.road.surface import MATERIALS, Seam, Surface
from simulator.scenes.suite import SUITE
from simulator.scenes.variants import vary_drive
from tests.support.not_roads import KINDS, not_a_road

# Random cameras.
SIZES = ((640, 360), (640, 480), (854, 480), (960, 540))
HEIGHT_M, HFOV_DEG, ANGLE_STD_DEG = (1.1, 2.1), (50.0, 80.0), (3.0, 2.0, 0.7)
# Standard deviations of the errors of pitch, yaw and roll, and of the logarithm of the height, of the view.
POSE_ERROR_DEG, HEIGHT_ERROR = (0.6, 1.0, 0.3), 0.05
# One of this number of pictures has no road.
NO_ROAD_EVERY = 10

# Share of the pictures with another pavement; range of the factors of wear.
REPAVED_SHARE, WEAR = 0.4, (0.6, 1.8)
PAVEMENTS = tuple(name for name in MATERIALS if name not in ("dirt", "paint"))
# Largest wear of Botts' dots; of the dashes that they are labelled as; and the rows and columns around a visible dot
# whose cells of a dash count as visible.
BOTTS_WEAR, LABEL_WEAR, AROUND_DOT = 0.3, 0.05, (9, 5)
# Joints of slabs beside the lines: ranges of the distance from the line, width and strength; width of tar seams.
JOINT_GAP_M, JOINT_WIDTH_M, JOINT_STRENGTH, TAR_SEAM_WIDTH_M = (0.02, 0.3), (0.01, 0.04), (0.3, 0.9), (0.01, 0.12)
# Largest number of streaks along the road; ranges of position, width, soft edge, and colour relative to the pavement.
STREAKS, STREAK_M, STREAK_WIDTH_M, STREAK_SOFT_M, STREAK_COLOUR = 4, (-6.0, 6.0), (0.15, 0.8), (0.02, 0.2), (0.7, 1.35)
# Share of the pictures that are blurred or sharpened, and of those that are compressed; standard deviation of the blur.
DEGRADED_SHARE, BLUR_PX, JPEG_QUALITY = 0.5, (0.5, 1.0), (50, 96)
# Lines that are painted over or ground off (darker than this) stay in the picture without lane lines.
PAINT_FROM = 0.5
# Difference of both pictures, in grey levels and relative to the largest one nearby (columns): paint has at least the
# first, everything else less than the second; what lies between is not counted.
PAINT_LEVELS, NO_PAINT_LEVELS, PAINT_SHARE, NO_PAINT_SHARE, NEARBY = 4.0, 2.0, 0.5, 0.25, 9
# Columns: the gap of a double line is labelled as paint, because the fit follows the centre of both stripes.
CLOSED = 7
# Label of cells that are not counted.
UNKNOWN = 255


@dataclass(frozen=True)
class Variety:
    """How far the pictures depart from usual roads: shares of the pictures, and ranges."""

    # Pictures with Botts' dots in place of broken lines, and with joints of slabs beside the lines.
    botts_share: float
    joints_share: float
    # Largest number of tar seams anywhere, so that a seam does not stand for a line.
    tar_seams: int
    # Factors of the width of lines, and of the grey levels; the larger ones of the latter saturate.
    width: tuple[float, float]
    gain: tuple[float, float]


# Even sample numbers, odd ones.
VARIETIES = (
    Variety(botts_share=0.4, joints_share=0.5, tar_seams=0, width=(0.8, 1.3), gain=(0.7, 1.1)),
    Variety(botts_share=0.5, joints_share=0.35, tar_seams=4, width=(0.8, 2.0), gain=(0.6, 1.5)),
)


@dataclass(frozen=True, eq=False)
class Sample:
    """Finer view (fine rows, columns, 3) uint8 of a picture; label (rows, columns) uint8: 1 paint, 0 none, 255 open.

    `focal_px` is that of the picture.
    """

    fine_image: np.ndarray
    label: np.ndarray
    focal_px: float


def take_sample(number: int) -> Sample | None:
    """Sample number `number`, of a variety in turn; None if the random camera sees no road."""
    number, which = divmod(number, len(VARIETIES))
    rng = np.random.default_rng([number, 1])
    try:
        take = _without_road if number % NO_ROAD_EVERY == 0 else _of_scene
        return take(number, VARIETIES[which], rng)
    except CameraError:
        return None


def _of_scene(number: int, variety: Variety, rng: np.random.Generator) -> Sample:
    scene = list(SUITE.values())[number % len(SUITE)]
    camera = draw_camera(rng)
    drive = vary_drive(scene.drive(), int(rng.integers(1000, 10_000)))
    markings, surface = draw_markings(drive, variety, rng), draw_surface(drive.surface, rng)
    surface = replace(surface, seams=surface.seams + draw_seams(markings, surface, variety, rng))
    if drive.exposure is None:
        # an exposure that adapts to the lines changes the noise, too, so that more cells would be left open
        drive = replace(drive, lens=replace(drive.lens, adaptation=0.0))
    drive = replace(drive, camera=camera, bonnet=bool(rng.random() < 0.2), markings=markings, surface=surface)
    time_s = rng.uniform(0, scene.seconds)
    view = BirdsEyeView(with_pose_error(drive.camera_at(time_s), rng))
    fine = finer_view(view)

    def picture_of(markings: tuple[Marking, ...]) -> np.ndarray:
        return render_frame(replace(drive, markings=markings), time_s).image

    with_lines, bare = picture_of(markings), fine.warp(picture_of(without_paint(markings)))
    label = label_cells(fine.warp(with_lines), bare)
    if any(m.botts for m in markings):
        label = connect_dots(label, label_cells(fine.warp(picture_of(as_dashes(markings))), bare))
    label[~view.seen] = UNKNOWN
    picture, scaled = degrade(with_lines, variety, rng)
    small = finer_view(BirdsEyeView(view.camera.scaled(scaled)))
    return Sample(small.warp(picture), label, small.focal_px)


def _without_road(number: int, variety: Variety, rng: np.random.Generator) -> Sample:
    image = not_a_road(sorted(KINDS)[number // NO_ROAD_EVERY % len(KINDS)], number)
    pose = draw_camera(rng).require_pose()
    picture, size = degrade(image, variety, rng)
    view = BirdsEyeView(Camera.from_fov(size, rng.uniform(*HFOV_DEG), pose))
    label = np.where(view.seen, 0, UNKNOWN).astype(np.uint8)
    return Sample(finer_view(view).warp(picture), label, view.focal_px)


def draw_camera(rng: np.random.Generator) -> Camera:
    """A random camera of a car."""
    pose = CameraPose(rng.uniform(*HEIGHT_M), *np.radians(rng.normal(0, ANGLE_STD_DEG)))
    return Camera.from_fov(SIZES[rng.integers(len(SIZES))], rng.uniform(*HFOV_DEG), pose)


def draw_markings(drive: Drive, variety: Variety, rng: np.random.Generator) -> tuple[Marking, ...]:
    """The markings of a drive, each with another wear and width; some broken lines become Botts' dots."""
    some_botts = rng.random() < variety.botts_share
    markings = []
    for marking in drive.markings:
        botts = marking.botts or (some_botts and marking.dashed)
        wear = min(marking.wear * rng.uniform(*WEAR), BOTTS_WEAR if botts else 1.0)
        width_m = marking.width_m * rng.uniform(*variety.width)
        markings.append(replace(marking, wear=wear, width_m=width_m, botts=botts))
    return tuple(markings)


def without_paint(markings: tuple[Marking, ...]) -> tuple[Marking, ...]:
    """The markings that are painted over or ground off."""
    return tuple(marking for marking in markings if max(marking.colour) < PAINT_FROM)


def as_dashes(markings: tuple[Marking, ...]) -> tuple[Marking, ...]:
    """The markings, with fresh dashes in place of Botts' dots."""
    return tuple(replace(m, botts=False, wear=min(m.wear, LABEL_WEAR)) if m.botts else m for m in markings)


def draw_seams(
    markings: tuple[Marking, ...], surface: Surface, variety: Variety, rng: np.random.Generator
) -> tuple[Seam, ...]:
    """Joints of slabs beside the lines, tar seams anywhere, and pale and dark streaks along the road."""
    seams = []
    if rng.random() < variety.joints_share:
        gap_m, width_m, strength = (rng.uniform(*r) for r in (JOINT_GAP_M, JOINT_WIDTH_M, JOINT_STRENGTH))
        side = rng.choice([-1, 1])
        for marking in markings:
            lateral_m = marking.lateral_m + side * (marking.width_m / 2 + gap_m)
            seams.append(Seam(float(lateral_m), width_m, strength=strength))
    for _ in range(rng.integers(variety.tar_seams + 1)):
        lateral_m, width_m, strength = (rng.uniform(*r) for r in (STREAK_M, TAR_SEAM_WIDTH_M, JOINT_STRENGTH))
        seams.append(Seam(lateral_m, width_m, strength=strength))
    pavement = np.array(MATERIALS[surface.zones[0].material].colour)
    for _ in range(rng.integers(STREAKS + 1)):
        colour = np.minimum(pavement * rng.uniform(*STREAK_COLOUR), 0.75).tolist()
        lateral_m, width_m, soft_m = (rng.uniform(*r) for r in (STREAK_M, STREAK_WIDTH_M, STREAK_SOFT_M))
        seams.append(Seam(lateral_m, width_m, 0.05, strength=0.7, colour=tuple(colour), soft_m=soft_m))
    return tuple(seams)


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
    height_m = pose.height_m * float(np.exp(rng.normal(0, HEIGHT_ERROR)))
    return camera.with_pose(CameraPose(height_m, pose.pitch_rad + pitch, pose.yaw_rad + yaw, pose.roll_rad + roll))


def label_cells(with_lines: np.ndarray, without: np.ndarray) -> np.ndarray:
    """Labels (rows, columns) uint8 of the view, from finer views (fine rows, columns, 3) with and without lines."""
    light = lightness(with_lines).astype(np.float32) - lightness(without)
    yellow = yellowness(with_lines).astype(np.float32) - yellowness(without)
    brighter = np.maximum(light, yellow)
    rows, columns = len(brighter) // NETWORK.fine_rows, brighter.shape[1]
    brighter = brighter.reshape(rows, NETWORK.fine_rows, columns).max(axis=1)
    nearby = cv2.dilate(brighter, np.ones((1, NEARBY), np.uint8))
    label = np.full(brighter.shape, UNKNOWN, np.uint8)
    label[(brighter < NO_PAINT_LEVELS) | (brighter < NO_PAINT_SHARE * nearby)] = 0
    paint = ((brighter >= PAINT_LEVELS) & (brighter >= PAINT_SHARE * nearby)).astype(np.uint8)
    label[cv2.morphologyEx(paint, cv2.MORPH_CLOSE, np.ones((1, CLOSED), np.uint8)) > 0] = 1
    return label


def connect_dots(label: np.ndarray, dashes: np.ndarray) -> np.ndarray:
    """The label (rows, columns) with the paint of the label `dashes` near visible dots, unknown elsewhere."""
    visible = cv2.dilate((label == 1).view(np.uint8), np.ones(AROUND_DOT, np.uint8)) > 0
    connected = label.copy()
    connected[(label != 1) & (dashes != 0)] = UNKNOWN
    connected[visible & (dashes == 1)] = 1
    return connected


def degrade(image: np.ndarray, variety: Variety, rng: np.random.Generator) -> tuple[np.ndarray, tuple[int, int]]:
    """The picture smaller, darker or brighter, blurred or sharpened, and compressed; and its size."""
    height, width = image.shape[:2]
    scale = rng.uniform(480 / width, 1) if rng.random() < 0.5 else 1.0
    size = round(width * scale), round(height * scale)
    levels = 255 * (np.arange(256) / 255) ** rng.uniform(0.8, 1.25) * rng.uniform(*variety.gain)
    image = cv2.LUT(image, np.clip(levels, 0, 255).astype(np.uint8))
    image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(image, (0, 0), rng.uniform(*BLUR_PX))
    # 1 blurs, -1 sharpens
    share = rng.uniform(-1, 1) if rng.random() < DEGRADED_SHARE else 0.0
    image = cv2.addWeighted(image, 1 - share, blurred, share, 0)
    if rng.random() < DEGRADED_SHARE:
        _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(*JPEG_QUALITY))])
        image = cv2.imdecode(code, cv2.IMREAD_COLOR)
    return image, size
