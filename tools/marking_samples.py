"""Samples for `tools.train_marking_network`: rendered pictures with labelled cells.

Each picture is a random moment of a variant of a scene of the suite, taken with a
random camera. It is rendered twice, with and without its lane lines: where the first is
clearly lighter or yellower is visible paint. Cells of a line that is worn off or hidden
there are labelled as paint near visible paint of the same line, so that the network
learns to connect it; Botts' dots stand for the dashes that they replace. In a part of
the pictures the outer line of the lane is replaced by the edge of the pavement: a kerb,
gravel, grass or a barrier. Joints beside the lines and pale streaks along the road are
added, which are no paint. The picture is then reduced, exposed, blurred or sharpened,
and compressed at random, and its bird's-eye view has a small pose error. Pictures
without a road are added (`simulator.not_roads`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera.model import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView, lightness, yellowness
from lanes.detect.markings import FINE_ROWS, finer_view
from lanes.errors import CameraError
from simulator.not_roads import KINDS, not_a_road
from simulator.objects.scene_objects import PlacedWall
from simulator.rendering.drive import Drive
from simulator.rendering.render import render_frame
from simulator.road.ground import Ground, RoadAhead, cast_on_ground, pixel_rays
from simulator.road.markings import Marking
from simulator.road.surface import MATERIALS, Seam, Surface
from simulator.scenes.suite import SUITE, vary_drive

# Pictures of one variant of a scene, which share its landscape: painting it takes
# longer than a picture. Numbers of the variants: the benchmark's are smaller.
PICTURES_PER_DRIVE = 6
FIRST_VARIANT = 1000
# Random cameras; standard deviations of pitch, yaw and roll.
SIZES = ((640, 360), (640, 480), (854, 480), (960, 540))
HEIGHT_M = (1.0, 2.6)
HFOV_DEG = (45.0, 90.0)
ANGLE_STD_DEG = (3.0, 2.0, 0.7)
# Standard deviations of the errors of pitch, yaw and roll, and of the logarithm of the
# height, of the view.
POSE_ERROR_DEG = (0.6, 1.0, 0.3)
HEIGHT_ERROR = 0.05
# One of this number of pictures has no road.
NO_ROAD_EVERY = 10

# Share of the pictures with another pavement; range of the factors of wear.
REPAVED_SHARE = 0.4
WEAR = (0.6, 1.8)
PAVEMENTS = tuple(name for name in MATERIALS if name not in ("dirt", "paint"))
# Largest wear of Botts' dots. Rows and columns around visible paint whose cells of a
# line count as paint.
BOTTS_WEAR = 0.3
AROUND_PAINT = (21, 5)
# Share of the lines that are nearly worn off, and their wear; share of those with a
# stretch without paint, its length.
WORN_SHARE = 0.15
WORN = (0.5, 0.95)
GAP_SHARE = 0.15
GAP_M = (4.0, 25.0)
# Share of the pictures whose pavement ends at a line of the lane. Ranges of the
# distance of its edge from that line, of the width of the gravel and of the brightness
# of the verge. Walls at the edge; "" is none.
BORDER_SHARE = 0.4
BORDER_OUTSIDE_M = (-0.2, 0.4)
GRAVEL_M = (0.0, 1.5)
VERGE_TINT = (0.7, 1.6)
BORDER_WALLS = ("kerb", "kerb", "kerb", "", "", "", "jersey", "parapet")
# Half width of the strip that is labelled as border.
BORDER_HALF_WIDTH_M = 0.12
# Share of the pictures with a wiper across, and with a caption.
WIPER_SHARE = 0.07
CAPTION_SHARE = 0.07
# Joints of slabs beside the lines: ranges of the distance from the line, width and
# strength; width of tar seams.
JOINT_GAP_M = (0.02, 0.3)
JOINT_WIDTH_M = (0.01, 0.04)
JOINT_STRENGTH = (0.3, 0.9)
TAR_SEAM_WIDTH_M = (0.01, 0.12)
# Largest number of streaks along the road; ranges of position, width, soft edge, and
# colour relative to the pavement.
STREAKS = 4
STREAK_M = (-6.0, 6.0)
STREAK_WIDTH_M = (0.15, 0.8)
STREAK_SOFT_M = (0.02, 0.2)
STREAK_COLOUR = (0.7, 1.35)
# Share of the pictures that are blurred or sharpened, and of those that are compressed;
# standard deviation of the blur.
DEGRADED_SHARE = 0.5
BLUR_PX = (0.5, 1.0)
JPEG_QUALITY = (50, 96)
# Lines that are painted over or ground off (darker than this) stay in the picture
# without lane lines.
PAINT_FROM = 0.5
# Difference of both pictures, in grey levels and relative to the largest one nearby
# (columns): paint has at least the first, everything else less than the second; cells
# with other differences are not counted.
PAINT_LEVELS = 4.0
NO_PAINT_LEVELS = 2.0
PAINT_SHARE = 0.5
NO_PAINT_SHARE = 0.25
NEARBY = 9
# Smallest share of a pixel, of 255, that a line or a border covers.
MIN_SHARE = 20
# Columns: the gap of a double line is labelled as paint, because the fit follows the
# centre of both stripes.
CLOSED = 7
# Columns on which the blurred colour of a line, or the edge of a border, may lie.
BESIDE = 5
# Label of cells that are not counted.
UNKNOWN = 255
# The rows and columns of all samples are those of this view.
VIEW = BirdsEyeView(Camera.from_fov((640, 360), 60, CameraPose(1.4)))


@dataclass(frozen=True)
class Variety:
    """How far the pictures depart from usual roads: shares of pictures, and ranges."""

    # Pictures with Botts' dots in place of broken lines, and with joints of slabs
    # beside the lines.
    botts_share: float
    joints_share: float
    # Largest number of tar seams anywhere, so that a seam does not stand for a line.
    tar_seams: int
    # Factors of the width of lines, and of the grey levels; the larger ones of the
    # latter saturate.
    width: tuple[float, float]
    gain: tuple[float, float]


# Even sample numbers, odd ones.
VARIETIES = (
    Variety(
        botts_share=0.4,
        joints_share=0.5,
        tar_seams=0,
        width=(0.8, 1.3),
        gain=(0.7, 1.1),
    ),
    Variety(
        botts_share=0.5,
        joints_share=0.35,
        tar_seams=4,
        width=(0.8, 2.0),
        gain=(0.6, 1.5),
    ),
)


@dataclass(frozen=True, eq=False)
class Sample:
    """Finer view (fine rows, columns, 3) uint8 of a picture, and its labels.

    The labels (2, rows, columns) uint8 are those of paint and of borders: 1 yes, 0 no,
    255 open. `focal_px` is that of the picture.
    """

    fine_image: np.ndarray
    label: np.ndarray
    focal_px: float


def take_sample(number: int) -> Sample | None:
    """Sample number `number`, of a variety in turn.

    None if the random camera sees no road.
    """
    number, which = divmod(number, len(VARIETIES))
    rng = np.random.default_rng([number, 1])
    take = _sample_without_road if number % NO_ROAD_EVERY == 0 else _sample_scene
    try:
        return take(number, VARIETIES[which], rng)
    except CameraError:
        return None


def _sample_scene(number: int, variety: Variety, rng: np.random.Generator) -> Sample:
    # a random moment of a variant of a scene, with other pavement, lines and seams
    place = number // PICTURES_PER_DRIVE
    camera = draw_camera(rng)
    scene = list(SUITE.values())[place % len(SUITE)]
    drive = _draw_drive(vary_drive(scene.drive(), FIRST_VARIANT + place), camera, rng)
    markings = draw_markings(drive, variety, rng)
    seams = draw_seams(markings, drive.surface, variety, rng)
    surface = replace(drive.surface, seams=drive.surface.seams + seams)
    drive = replace(drive, surface=surface)
    time_s = rng.uniform(0, scene.seconds)

    # with and without its lane lines, in a view with a pose error
    view = BirdsEyeView(with_pose_error(drive.camera_at(time_s), rng))
    painted = with_gaps(markings, drive.motion.pose(time_s).s_m, rng)
    with_lines = render_frame(replace(drive, markings=painted), time_s).image
    dark = tuple(marking for marking in markings if not _is_painted(marking))
    without = render_frame(replace(drive, markings=dark), time_s).image

    label = _label_view(
        view, with_lines, without, _mark_ground(drive, markings, time_s)
    )
    picture, size = degrade(with_overlay(with_lines, rng), variety, rng)
    fine = finer_view(BirdsEyeView(view.camera.scaled(size)))
    return Sample(fine.warp(picture), label, fine.focal_px)


def _draw_drive(drive: Drive, camera: Camera, rng: np.random.Generator) -> Drive:
    """The drive with another camera and pavement, and perhaps a border."""
    if drive.exposure is None:
        # an exposure that adapts to the lines changes the noise, too, so that more
        # cells would be left open
        drive = replace(drive, lens=replace(drive.lens, adaptation=0.0))
    bonnet = bool(rng.random() < 0.2)
    surface = draw_surface(drive.surface, rng)
    drive = replace(drive, camera=camera, bonnet=bonnet, surface=surface)
    return with_border(drive, rng)


def _is_painted(marking: Marking) -> bool:
    return max(marking.colour) >= PAINT_FROM


def _label_view(
    view: BirdsEyeView, with_lines: np.ndarray, without: np.ndarray, marked: np.ndarray
) -> np.ndarray:
    """Labels (2, rows, columns) of paint and borders.

    `marked` is the picture of `_mark_ground`.
    """
    fine = finer_view(view)
    visible = label_cells(fine.warp(with_lines), fine.warp(without))
    shares = fine.warp(marked)
    lines = _strongest(shares[..., 0])
    borders = _strongest(shares[..., 1])

    label = np.stack([connect_paint(visible, lines), borders.astype(np.uint8)])
    label[1][_widened(borders, (1, BESIDE)) & ~borders] = UNKNOWN
    label[:, ~view.seen] = UNKNOWN
    return label


def _widened(cells: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Cells (rows, columns) bool in a window of `size` around those that are set."""
    return cv2.dilate(cells.view(np.uint8), np.ones(size, np.uint8)) > 0


def _mark_ground(
    drive: Drive, markings: tuple[Marking, ...], time_s: float
) -> np.ndarray:
    """Picture (height, width, 3) uint8: share of each pixel that fresh lines cover, and
    that borders cover.
    """
    camera = drive.camera_at(time_s)
    ahead = RoadAhead(drive.road, drive.pose(time_s))
    ground = cast_on_ground(pixel_rays(drive.camera), camera, ahead)

    lines = [replace(line, botts=False) for line in markings if _is_painted(line)]
    surface = drive.surface
    edges_m = [surface.left_edge_m, surface.right_edge_m, *(surface.opposite_m or ())]
    borders = [Marking(edge_m, 2 * BORDER_HALF_WIDTH_M) for edge_m in edges_m]
    picture = np.zeros((camera.height, camera.width, 3), np.uint8)
    picture[ground.top :, :, 0] = np.rint(255 * _coverage(lines, ground))
    picture[ground.top :, :, 1] = np.rint(255 * _coverage(borders, ground))
    return picture


def _coverage(markings: Sequence[Marking], ground: Ground) -> np.ndarray:
    """Largest share (rows, width) of each pixel of the ground that a marking covers."""
    share = np.zeros(ground.d.shape, np.float32)
    for marking in markings:
        pixels, covered = marking.coverage(ground)
        np.maximum.at(share.ravel(), pixels, np.clip(covered, 0, 1))
    return share


def _strongest(share: np.ndarray) -> np.ndarray:
    """(rows, columns) bool: cells in the middle of a strip.

    `share` (fine rows, columns) uint8 is what it covers.
    """
    share = _reduce_rows(share).astype(np.float32)
    nearby = cv2.dilate(share, np.ones((1, NEARBY), np.uint8))
    return (share >= PAINT_SHARE * nearby) & (share > MIN_SHARE)


def _reduce_rows(fine: np.ndarray) -> np.ndarray:
    """Largest value (rows, columns) of the fine rows (fine rows, columns) of a row."""
    return fine.reshape(-1, FINE_ROWS, fine.shape[1]).max(axis=1)


def _sample_without_road(
    number: int, variety: Variety, rng: np.random.Generator
) -> Sample:
    kinds = sorted(KINDS)
    kind = kinds[number // NO_ROAD_EVERY % len(kinds)]
    pose = draw_camera(rng).require_pose()
    picture, size = degrade(not_a_road(kind, number), variety, rng)
    view = BirdsEyeView(Camera.from_fov(size, rng.uniform(*HFOV_DEG), pose))
    label = np.where(view.seen, 0, UNKNOWN).astype(np.uint8)
    fine_image = finer_view(view).warp(picture)
    return Sample(fine_image, np.stack([label, label]), view.focal_px)


def with_border(drive: Drive, rng: np.random.Generator) -> Drive:
    """The drive, or one whose pavement ends at a line of the lane, without paint."""
    if rng.random() > BORDER_SHARE or not drive.line_laterals_m:
        return drive
    side = rng.choice([-1, -1, 1])
    line_m = drive.line_laterals_m[0 if side > 0 else -1]
    edge_m = float(line_m + side * rng.uniform(*BORDER_OUTSIDE_M))

    def is_inside(lateral_m: float, margin_m: float = 0.0) -> bool:
        return side * (edge_m - lateral_m) > margin_m

    markings = [line for line in drive.markings if is_inside(line.lateral_m, 1.0)]
    objects = []
    for thing in drive.objects:
        is_wall = isinstance(thing, PlacedWall) and thing.kind != "bank"
        if not is_wall or is_inside(thing.lateral_m):
            objects.append(thing)
    wall = BORDER_WALLS[rng.integers(len(BORDER_WALLS))]
    if wall:
        objects.append(PlacedWall(edge_m, wall, seed=int(rng.integers(100))))

    brightness = rng.uniform(*VERGE_TINT)
    tint = brightness * rng.uniform(0.9, 1.1, 3)
    surface = replace(
        drive.surface,
        gravel_m=rng.uniform(*GRAVEL_M),
        verge_tint=tuple(tint.tolist()),
    )
    if side > 0:
        surface = replace(surface, left_edge_m=edge_m, opposite_m=None)
    else:
        surface = replace(surface, right_edge_m=edge_m)
    return replace(
        drive, markings=tuple(markings), surface=surface, objects=tuple(objects)
    )


def with_gaps(
    markings: tuple[Marking, ...], station_m: float, rng: np.random.Generator
) -> tuple[Marking, ...]:
    """The markings; some have a stretch without paint ahead of the car.

    `station_m` is the car's arc length.
    """
    parts: list[Marking] = []
    for marking in markings:
        if rng.random() > GAP_SHARE or marking.slope:
            parts.append(marking)
            continue
        start_m = station_m + rng.uniform(3, 30)
        end_m = start_m + rng.uniform(*GAP_M)
        parts.append(replace(marking, end_m=min(marking.end_m, start_m)))
        parts.append(replace(marking, start_m=max(marking.start_m, end_m)))
    return tuple(part for part in parts if part.start_m < part.end_m)


def with_overlay(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The picture, sometimes with a dark wiper across or a bright caption."""
    height, width = image.shape[:2]
    image = image.copy()
    if rng.random() < WIPER_SHARE:
        low = [-width // 2, height, 0, height // 4]
        high = [width, height + 200, 2 * width, height]
        *start, u, v = rng.integers(low, high).tolist()
        thickness_px = int(rng.integers(6, 30))
        cv2.line(image, start, (u, v), (12, 12, 14), thickness_px, cv2.LINE_AA)
    if rng.random() < CAPTION_SHARE:
        place = rng.integers([0, height // 2], [width // 2, height]).tolist()
        words = "".join(rng.choice(list("ABC DEF 0123"), 8))
        colour = rng.integers(120, 256, 3).tolist()
        scale = rng.uniform(0.5, 2)
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(image, words, place, font, scale, colour, 2, cv2.LINE_AA)
    return image


def draw_camera(rng: np.random.Generator) -> Camera:
    """A random camera of a car."""
    height_m = rng.uniform(*HEIGHT_M)
    angles_rad = np.radians(rng.normal(0, ANGLE_STD_DEG))
    size = SIZES[rng.integers(len(SIZES))]
    hfov_deg = rng.uniform(*HFOV_DEG)
    return Camera.from_fov(size, hfov_deg, CameraPose(height_m, *angles_rad))


def draw_markings(
    drive: Drive, variety: Variety, rng: np.random.Generator
) -> tuple[Marking, ...]:
    """The markings of a drive, each with another wear and width.

    Some broken lines become Botts' dots.
    """
    some_botts = rng.random() < variety.botts_share
    markings = []
    for marking in drive.markings:
        botts = marking.botts or (some_botts and marking.dashed)
        if rng.random() < WORN_SHARE:
            wear = rng.uniform(*WORN)
        else:
            wear = marking.wear * rng.uniform(*WEAR)
        most = BOTTS_WEAR if botts else 1.0
        width_m = marking.width_m * rng.uniform(*variety.width)
        drawn = replace(marking, wear=min(wear, most), width_m=width_m, botts=botts)
        markings.append(drawn)
    return tuple(markings)


def draw_seams(
    markings: tuple[Marking, ...],
    surface: Surface,
    variety: Variety,
    rng: np.random.Generator,
) -> tuple[Seam, ...]:
    """Joints of slabs beside the lines, tar seams anywhere, and streaks along the road.

    The streaks are paler or darker than the pavement.
    """
    seams = []
    if rng.random() < variety.joints_share:
        gap_m = rng.uniform(*JOINT_GAP_M)
        width_m = rng.uniform(*JOINT_WIDTH_M)
        strength = rng.uniform(*JOINT_STRENGTH)
        side = rng.choice([-1, 1])
        for marking in markings:
            lateral_m = marking.lateral_m + side * (marking.width_m / 2 + gap_m)
            seams.append(Seam(float(lateral_m), width_m, strength=strength))

    for _ in range(rng.integers(variety.tar_seams + 1)):
        lateral_m = rng.uniform(*STREAK_M)
        width_m = rng.uniform(*TAR_SEAM_WIDTH_M)
        strength = rng.uniform(*JOINT_STRENGTH)
        seams.append(Seam(lateral_m, width_m, strength=strength))

    pavement = np.array(MATERIALS[surface.zones[0].material].colour)
    for _ in range(rng.integers(STREAKS + 1)):
        colour = np.minimum(pavement * rng.uniform(*STREAK_COLOUR), 0.75)
        streak = Seam(
            rng.uniform(*STREAK_M),
            rng.uniform(*STREAK_WIDTH_M),
            0.05,
            soft_m=rng.uniform(*STREAK_SOFT_M),
            strength=0.7,
            colour=tuple(colour.tolist()),
        )
        seams.append(streak)
    return tuple(seams)


def draw_surface(surface: Surface, rng: np.random.Generator) -> Surface:
    """The surface of a drive, or the same with one other pavement."""
    if rng.random() > REPAVED_SHARE or surface.zones[0].material == "dirt":
        return surface
    material = PAVEMENTS[rng.integers(len(PAVEMENTS))]
    zones = [replace(zone, material=material) for zone in surface.zones]
    return replace(surface, zones=tuple(zones))


def with_pose_error(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera with the error of an estimated pose."""
    pose = camera.require_pose()
    pitch, yaw, roll = np.radians(rng.normal(0, POSE_ERROR_DEG))
    factor = float(np.exp(rng.normal(0, HEIGHT_ERROR)))
    inexact_pose = CameraPose(
        pose.height_m * factor,
        pitch_rad=pose.pitch_rad + pitch,
        yaw_rad=pose.yaw_rad + yaw,
        roll_rad=pose.roll_rad + roll,
    )
    return camera.with_pose(inexact_pose)


def label_cells(with_lines: np.ndarray, without: np.ndarray) -> np.ndarray:
    """Labels (rows, columns) uint8 of the view.

    The finer views (fine rows, columns, 3) are with and without lines.
    """
    light = lightness(with_lines).astype(np.float32) - lightness(without)
    yellow = yellowness(with_lines).astype(np.float32) - yellowness(without)
    brighter = _reduce_rows(np.maximum(light, yellow))
    nearby = cv2.dilate(brighter, np.ones((1, NEARBY), np.uint8))
    share = PAINT_SHARE * nearby
    paint = (brighter >= PAINT_LEVELS) & (brighter >= share)
    closing = np.ones((1, CLOSED), np.uint8)
    closed = cv2.morphologyEx(paint.view(np.uint8), cv2.MORPH_CLOSE, closing)

    label = np.full(brighter.shape, UNKNOWN, np.uint8)
    label[(brighter < NO_PAINT_LEVELS) | (brighter < NO_PAINT_SHARE * nearby)] = 0
    label[closed > 0] = 1
    return label


def connect_paint(visible: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """The label (rows, columns) of visible paint, with the cells of `lines` near it.

    Unknown in their other cells.
    """
    paint = visible == 1
    near = _widened(paint, AROUND_PAINT)
    # the colour of a line is blurred more widely than the line
    beside = ~_widened(lines, (1, BESIDE))
    connected = visible.copy()
    connected[(lines & ~paint) | (paint & beside)] = UNKNOWN
    connected[near & lines] = 1
    return connected


def degrade(
    image: np.ndarray, variety: Variety, rng: np.random.Generator
) -> tuple[np.ndarray, tuple[int, int]]:
    """The picture reduced, exposed, blurred or sharpened, and compressed; its size."""
    height, width = image.shape[:2]
    smallest = min(480 / width, 1.0)
    scale = rng.uniform(smallest, 1) if rng.random() < 0.5 else 1.0
    size = (round(width * scale), round(height * scale))

    gamma = rng.uniform(0.8, 1.25)
    gain = rng.uniform(*variety.gain)
    levels = 255 * (np.arange(256) / 255) ** gamma * gain
    image = cv2.LUT(image, np.clip(levels, 0, 255).astype(np.uint8))
    image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)

    # a share of 1 blurs, -1 sharpens
    blurred = cv2.GaussianBlur(image, (0, 0), rng.uniform(*BLUR_PX))
    share = rng.uniform(-1, 1) if rng.random() < DEGRADED_SHARE else 0.0
    image = cv2.addWeighted(image, 1 - share, blurred, share, 0)
    if rng.random() < DEGRADED_SHARE:
        quality = int(rng.integers(*JPEG_QUALITY))
        _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        image = cv2.imdecode(code, cv2.IMREAD_COLOR)
    return image, size
