"""Samples for `tools.train_marking_network`: rendered pictures whose lines and borders are known in each cell.

Each picture is a random moment of a variant of a scene of the suite, taken with a random camera. It is rendered twice,
with and without its lane lines: where the first is clearly lighter or yellower is visible paint. Cells of a line that
is worn off or hidden there are labelled as paint near visible paint of the same line, so that the network learns to
connect it; Botts' dots stand for the dashes that they replace. In a part of the pictures the outer line of the lane is
replaced by the edge of the pavement: a kerb, gravel, grass or a barrier. Joints beside the lines and pale streaks along
the road are added, which are no paint. The picture is then reduced, exposed, blurred or sharpened, and compressed at
random, and its bird's-eye view has a small pose error. Pictures without a road are added (`simulator.not_roads`).
"""

from __future__ import annotations

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

# Pictures of one variant of a scene, which share its landscape: painting it takes longer than a picture. Numbers of the
# variants: the benchmark's are smaller.
PICTURES_PER_DRIVE, FIRST_VARIANT = 6, 1000
# Random cameras.
SIZES = ((640, 360), (640, 480), (854, 480), (960, 540))
HEIGHT_M, HFOV_DEG, ANGLE_STD_DEG = (1.0, 2.6), (45.0, 90.0), (3.0, 2.0, 0.7)
# Standard deviations of the errors of pitch, yaw and roll, and of the logarithm of the height, of the view.
POSE_ERROR_DEG, HEIGHT_ERROR = (0.6, 1.0, 0.3), 0.05
# One of this number of pictures has no road.
NO_ROAD_EVERY = 10

# Share of the pictures with another pavement; range of the factors of wear.
REPAVED_SHARE, WEAR = 0.4, (0.6, 1.8)
PAVEMENTS = tuple(name for name in MATERIALS if name not in ("dirt", "paint"))
# Largest wear of Botts' dots. Rows and columns around visible paint whose cells of a line count as paint.
BOTTS_WEAR, AROUND_PAINT = 0.3, (21, 5)
# Share of the lines that are nearly worn off, and their wear; share of those with a stretch without paint, its length.
WORN_SHARE, WORN, GAP_SHARE, GAP_M = 0.15, (0.5, 0.95), 0.15, (4.0, 25.0)
# Share of the pictures whose pavement ends at a line of the lane. Ranges of the distance of its edge from that line, of
# the width of the gravel and of the brightness of the verge. Walls at the edge; "" is none.
BORDER_SHARE, BORDER_OUTSIDE_M, GRAVEL_M, VERGE_TINT = 0.4, (-0.2, 0.4), (0.0, 1.5), (0.7, 1.6)
BORDER_WALLS = ("kerb", "kerb", "kerb", "", "", "", "jersey", "parapet")
# Half width of the strip that is labelled as border.
BORDER_HALF_WIDTH_M = 0.12
# Share of the pictures with a wiper across, and with a caption.
WIPER_SHARE, CAPTION_SHARE = 0.07, 0.07
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
# Smallest share of a pixel, of 255, that a line or a border covers.
MIN_SHARE = 20
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
    """Finer view (fine rows, columns, 3) uint8 of a picture; labels (2, rows, columns) uint8: 1 yes, 0 no, 255 open.

    The labels are those of paint and of borders. `focal_px` is that of the picture.
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
    place, camera = number // PICTURES_PER_DRIVE, draw_camera(rng)
    scene = list(SUITE.values())[place % len(SUITE)]
    drive = vary_drive(scene.drive(), FIRST_VARIANT + place)
    if drive.exposure is None:
        # an exposure that adapts to the lines changes the noise, too, so that more cells would be left open
        drive = replace(drive, lens=replace(drive.lens, adaptation=0.0))
    drive = replace(drive, camera=camera, bonnet=bool(rng.random() < 0.2), surface=draw_surface(drive.surface, rng))
    drive = with_border(drive, rng)
    markings = draw_markings(drive, variety, rng)
    seams = drive.surface.seams + draw_seams(markings, drive.surface, variety, rng)
    drive = replace(drive, surface=replace(drive.surface, seams=seams))
    time_s = rng.uniform(0, scene.seconds)
    view = BirdsEyeView(with_pose_error(drive.camera_at(time_s), rng))
    fine = finer_view(view)

    def picture_of(markings: tuple[Marking, ...]) -> np.ndarray:
        return render_frame(replace(drive, markings=markings), time_s).image

    with_lines = picture_of(with_gaps(markings, drive.motion.pose(time_s).s_m, rng))
    bare = picture_of(tuple(marking for marking in markings if max(marking.colour) < PAINT_FROM))
    visible = label_cells(fine.warp(with_lines), fine.warp(bare))
    where = fine.warp(_mark_ground(drive, markings, time_s))
    lines, borders = (_strongest(where[..., k]) for k in (0, 1))
    labels = np.stack([connect_paint(visible, lines), borders.astype(np.uint8)])
    labels[1][~borders & (cv2.dilate(borders.view(np.uint8), np.ones((1, 5), np.uint8)) > 0)] = UNKNOWN
    labels[:, ~view.seen] = UNKNOWN
    picture, scaled = degrade(with_overlay(with_lines, rng), variety, rng)
    small = finer_view(BirdsEyeView(view.camera.scaled(scaled)))
    return Sample(small.warp(picture), labels, small.focal_px)


def _mark_ground(drive: Drive, markings: tuple[Marking, ...], time_s: float) -> np.ndarray:
    """Picture (height, width, 3) uint8: share of each pixel that fresh lines cover, and that borders cover."""
    camera = drive.camera_at(time_s)
    ground = cast_on_ground(pixel_rays(drive.camera), camera, RoadAhead(drive.road, drive.pose(time_s)))
    edges = drive.surface.left_edge_m, drive.surface.right_edge_m, *(drive.surface.opposite_m or ())
    borders = tuple(Marking(edge_m, 2 * BORDER_HALF_WIDTH_M) for edge_m in edges)
    lines = tuple(replace(m, botts=False) for m in markings if max(m.colour) >= PAINT_FROM)
    shares = [_coverage(some, ground) for some in (lines, borders)]
    picture = np.zeros((camera.height, camera.width, 3), np.uint8)
    picture[ground.top :, :, :2] = np.rint(255 * np.stack(shares, axis=-1))
    return picture


def _coverage(markings: tuple[Marking, ...], ground: Ground) -> np.ndarray:
    """Largest share (rows, width) of each pixel of the ground that one of the markings covers."""
    share = np.zeros(ground.d.shape, np.float32)
    for marking in markings:
        pixels, covered = marking.coverage(ground)
        np.maximum.at(share.ravel(), pixels, np.clip(covered, 0, 1))
    return share


def _strongest(share: np.ndarray) -> np.ndarray:
    """(rows, columns) bool: cells in the middle of a strip, from its share (fine rows, columns) uint8."""
    share = share.reshape(-1, FINE_ROWS, share.shape[1]).max(axis=1).astype(np.float32)
    nearby = cv2.dilate(share, np.ones((1, NEARBY), np.uint8))
    return (share >= PAINT_SHARE * nearby) & (share > MIN_SHARE)


def _without_road(number: int, variety: Variety, rng: np.random.Generator) -> Sample:
    image = not_a_road(sorted(KINDS)[number // NO_ROAD_EVERY % len(KINDS)], number)
    pose = draw_camera(rng).require_pose()
    picture, size = degrade(image, variety, rng)
    view = BirdsEyeView(Camera.from_fov(size, rng.uniform(*HFOV_DEG), pose))
    label = np.where(view.seen, 0, UNKNOWN).astype(np.uint8)
    return Sample(finer_view(view).warp(picture), np.stack([label, label]), view.focal_px)


def with_border(drive: Drive, rng: np.random.Generator) -> Drive:
    """The drive, or one in which the pavement ends at a line of the lane instead of being painted there."""
    if rng.random() > BORDER_SHARE or not drive.line_laterals_m:
        return drive
    side = rng.choice([-1, -1, 1])
    line_m = drive.line_laterals_m[0 if side > 0 else -1]
    edge_m = float(line_m + side * rng.uniform(*BORDER_OUTSIDE_M))

    def is_inside(lateral_m: float, margin_m: float = 0.0) -> bool:
        return side * (edge_m - lateral_m) > margin_m

    markings = tuple(m for m in drive.markings if is_inside(m.lateral_m, 1.0))
    objects = drive.objects
    kept = tuple(o for o in objects if not isinstance(o, PlacedWall) or is_inside(o.lateral_m) or o.kind == "bank")
    wall = BORDER_WALLS[rng.integers(len(BORDER_WALLS))]
    walls = (PlacedWall(edge_m, wall, seed=int(rng.integers(100))),) if wall else ()
    edge = {"left_edge_m": edge_m, "opposite_m": None} if side > 0 else {"right_edge_m": edge_m}
    tint = tuple((rng.uniform(*VERGE_TINT) * rng.uniform(0.9, 1.1, 3)).tolist())
    surface = replace(drive.surface, gravel_m=rng.uniform(*GRAVEL_M), verge_tint=tint, **edge)
    return replace(drive, markings=markings, surface=surface, objects=kept + walls)


def with_gaps(markings: tuple[Marking, ...], station_m: float, rng: np.random.Generator) -> tuple[Marking, ...]:
    """The markings; some of them have a stretch without paint ahead of the car at arc length `station_m`."""
    parts: list[Marking] = []
    for marking in markings:
        if rng.random() > GAP_SHARE or marking.slope:
            parts.append(marking)
            continue
        start_m = station_m + rng.uniform(3, 30)
        end_m = start_m + rng.uniform(*GAP_M)
        parts.append(replace(marking, end_m=min(marking.end_m, start_m)))
        parts.append(replace(marking, start_m=max(marking.start_m, end_m)))
    return tuple(m for m in parts if m.start_m < m.end_m)


def with_overlay(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The picture, sometimes with a dark wiper across or a bright caption."""
    height, width = image.shape[:2]
    image = image.copy()
    if rng.random() < WIPER_SHARE:
        ends = rng.integers([-width // 2, height, 0, height // 4], [width, height + 200, 2 * width, height])
        cv2.line(image, ends[:2].tolist(), ends[2:].tolist(), (12, 12, 14), int(rng.integers(6, 30)), cv2.LINE_AA)
    if rng.random() < CAPTION_SHARE:
        place = rng.integers([0, height // 2], [width // 2, height])
        words, colour = "".join(rng.choice(list("ABC DEF 0123"), 8)), rng.integers(120, 256, 3).tolist()
        cv2.putText(image, words, place.tolist(), cv2.FONT_HERSHEY_SIMPLEX, rng.uniform(0.5, 2), colour, 2, cv2.LINE_AA)
    return image


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
        wear = rng.uniform(*WORN) if rng.random() < WORN_SHARE else marking.wear * rng.uniform(*WEAR)
        wear = min(wear, BOTTS_WEAR if botts else 1.0)
        width_m = marking.width_m * rng.uniform(*variety.width)
        markings.append(replace(marking, wear=wear, width_m=width_m, botts=botts))
    return tuple(markings)


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
    rows, columns = len(brighter) // FINE_ROWS, brighter.shape[1]
    brighter = brighter.reshape(rows, FINE_ROWS, columns).max(axis=1)
    nearby = cv2.dilate(brighter, np.ones((1, NEARBY), np.uint8))
    label = np.full(brighter.shape, UNKNOWN, np.uint8)
    label[(brighter < NO_PAINT_LEVELS) | (brighter < NO_PAINT_SHARE * nearby)] = 0
    paint = ((brighter >= PAINT_LEVELS) & (brighter >= PAINT_SHARE * nearby)).astype(np.uint8)
    label[cv2.morphologyEx(paint, cv2.MORPH_CLOSE, np.ones((1, CLOSED), np.uint8)) > 0] = 1
    return label


def connect_paint(visible: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """The label (rows, columns) of visible paint, with the cells of `lines` near it; unknown in their other cells."""
    near = cv2.dilate((visible == 1).view(np.uint8), np.ones(AROUND_PAINT, np.uint8)) > 0
    connected = visible.copy()
    # the colour of a line is blurred more widely than the line
    beside = cv2.dilate(lines.view(np.uint8), np.ones((1, 5), np.uint8)) == 0
    connected[((visible != 1) & lines) | ((visible == 1) & beside)] = UNKNOWN
    connected[near & lines] = 1
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
