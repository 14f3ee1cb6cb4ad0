"""Chessboard photographs with ground truth.

A printed sheet on a plastered wall is seen through the course's lens. The ray of each
pixel, distortion included, is cast onto the plane of the wall, so the corner positions
are exact. The sheet is flat: paper that looks curled is only shaded, which moves no
corner.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from lanes.camera.model import Camera, camera_to_dict
from lanes.files import translate_write_errors, write_atomically
from lanes.video.images import write_image
from simulator.light.lens import srgb
from simulator.painting import blend
from simulator.processes import run_all
from simulator.road.ground import pixel_rays
from simulator.scenes.freeway import DASHCAM

INNER_COLUMNS = 9
INNER_ROWS = 6
# 10 x 7 squares of this size leave margins of 15 and 19 mm on US Letter paper.
SQUARE_M = 0.0248
PAPER_M = (0.2794, 0.2159)
WALL_TEXEL_M = 0.0005
WALL_TEXELS = 2048
# Texture of the paper.
RIPPLE_TEXEL_M = 0.002
RIPPLE_TEXELS = 512
# Points of a pixel at which ink is counted, in both directions.
INK_SAMPLES = (-0.375, -0.125, 0.125, 0.375)


@dataclass(frozen=True)
class PaintedWall:
    """Painted wall and sheet under one light.

    Linear colours 0..1, strength of the plaster's relief, and sensor noise.
    """

    paint: tuple[float, float, float]
    paper: tuple[float, float, float]
    ink: float
    relief: float
    noise: float


# Near a window, and in a dim corridor with a high sensor gain.
CREAM_WALL = PaintedWall(
    paint=(0.68, 0.67, 0.58),
    paper=(0.84, 0.84, 0.85),
    ink=0.004,
    relief=0.6,
    noise=0.9,
)
GREY_WALL = PaintedWall(
    paint=(0.250, 0.246, 0.238),
    paper=(0.385, 0.385, 0.435),
    ink=0.010,
    relief=0.5,
    noise=1.4,
)


@dataclass(frozen=True)
class BoardView:
    """One photograph: position, size, orientation and light of the board.

    `u` and `v` are the pixel of the board's centre, `span_px` is the width of its ten
    squares without rotation. `turn_deg` > 0 brings the right side nearer, `tilt_deg` >
    0 the top, `roll_deg` > 0 rotates it clockwise in the image. `lamp` is (u, v, radius
    in pixels, strength) of the glow on the wall. `falloff` is the share of light lost
    from left to right and from top to bottom. `extra_px` adds columns and rows: the
    same camera with a larger crop.
    """

    wall: PaintedWall
    u: float
    v: float
    span_px: float
    turn_deg: float
    tilt_deg: float
    roll_deg: float
    lamp: tuple[float, float, float, float]
    falloff: tuple[float, float] = (0.0, 0.0)
    extra_px: int = 0

    @property
    def camera(self) -> Camera:
        """Camera of the photograph."""
        return replace(
            DASHCAM,
            width=DASHCAM.width + self.extra_px,
            height=DASHCAM.height + self.extra_px,
        )


BOARD_VIEWS = (
    BoardView(
        wall=CREAM_WALL,
        u=652,
        v=436,
        span_px=1165,
        turn_deg=1.5,
        tilt_deg=-2,
        roll_deg=0.4,
        lamp=(200, -100, 900, 0.10),
        falloff=(0.06, 0.05),
    ),
    BoardView(
        wall=CREAM_WALL,
        u=640,
        v=375,
        span_px=1000,
        turn_deg=-3,
        tilt_deg=31,
        roll_deg=0.6,
        lamp=(1250, 100, 700, 0.12),
        falloff=(-0.05, 0.10),
    ),
    BoardView(
        wall=CREAM_WALL,
        u=640,
        v=366,
        span_px=985,
        turn_deg=2,
        tilt_deg=-35,
        roll_deg=-0.5,
        lamp=(820, 60, 360, 0.30),
        falloff=(0.04, 0.16),
    ),
    BoardView(
        wall=CREAM_WALL,
        u=872,
        v=318,
        span_px=1040,
        turn_deg=35,
        tilt_deg=3,
        roll_deg=-1.2,
        lamp=(-60, 200, 500, 0.15),
        falloff=(-0.08, 0.06),
    ),
    BoardView(
        wall=CREAM_WALL,
        u=560,
        v=262,
        span_px=985,
        turn_deg=-33,
        tilt_deg=-4,
        roll_deg=0.8,
        lamp=(1300, 650, 600, 0.14),
        falloff=(0.10, 0.02),
    ),
    BoardView(
        wall=GREY_WALL,
        u=622,
        v=338,
        span_px=392,
        turn_deg=1,
        tilt_deg=-1,
        roll_deg=0.3,
        lamp=(1400, -200, 700, 0.25),
        falloff=(0.03, 0.10),
    ),
    BoardView(
        wall=GREY_WALL,
        u=446,
        v=352,
        span_px=398,
        turn_deg=47,
        tilt_deg=2,
        roll_deg=-0.6,
        lamp=(30, 60, 320, 0.45),
        falloff=(0.02, 0.08),
        extra_px=1,
    ),
    BoardView(
        wall=GREY_WALL,
        u=846,
        v=362,
        span_px=470,
        turn_deg=-43,
        tilt_deg=-3,
        roll_deg=1.0,
        lamp=(1380, 120, 420, 0.55),
        falloff=(-0.06, 0.10),
    ),
    BoardView(
        wall=GREY_WALL,
        u=742,
        v=300,
        span_px=436,
        turn_deg=-38,
        tilt_deg=18,
        roll_deg=17.0,
        lamp=(1330, 250, 380, 0.80),
        falloff=(0.05, 0.09),
    ),
    BoardView(
        wall=GREY_WALL,
        u=770,
        v=446,
        span_px=560,
        turn_deg=14,
        tilt_deg=-44,
        roll_deg=-3.0,
        lamp=(80, 680, 500, 0.15),
        falloff=(0.08, -0.04),
    ),
    BoardView(
        wall=GREY_WALL,
        u=204,
        v=356,
        span_px=262,
        turn_deg=22,
        tilt_deg=-6,
        roll_deg=-1.5,
        lamp=(900, -80, 600, 0.20),
        falloff=(-0.05, 0.12),
    ),
    BoardView(
        wall=GREY_WALL,
        u=872,
        v=318,
        span_px=556,
        turn_deg=33,
        tilt_deg=8,
        roll_deg=2.2,
        lamp=(-20, 260, 330, 1.30),
        falloff=(-0.02, 0.12),
    ),
    BoardView(
        wall=GREY_WALL,
        u=604,
        v=300,
        span_px=452,
        turn_deg=34,
        tilt_deg=-22,
        roll_deg=-33.0,
        lamp=(-40, 640, 300, 1.70),
        falloff=(0.03, 0.05),
    ),
    BoardView(
        wall=GREY_WALL,
        u=1096,
        v=186,
        span_px=368,
        turn_deg=-32,
        tilt_deg=-8,
        roll_deg=4.0,
        lamp=(1260, 20, 260, 0.50),
        falloff=(0.02, 0.06),
    ),
    BoardView(
        wall=GREY_WALL,
        u=1092,
        v=548,
        span_px=402,
        turn_deg=-27,
        tilt_deg=12,
        roll_deg=2.5,
        lamp=(1180, 40, 300, 0.55),
        falloff=(0.05, 0.06),
        extra_px=1,
    ),
    BoardView(
        wall=GREY_WALL,
        u=1052,
        v=246,
        span_px=398,
        turn_deg=-30,
        tilt_deg=14,
        roll_deg=3.0,
        lamp=(300, 740, 500, 0.20),
        falloff=(0.04, -0.05),
    ),
    BoardView(
        wall=GREY_WALL,
        u=666,
        v=430,
        span_px=642,
        turn_deg=-6,
        tilt_deg=-20,
        roll_deg=-1.0,
        lamp=(120, -40, 420, 0.35),
        falloff=(0.02, 0.14),
    ),
    BoardView(
        wall=GREY_WALL,
        u=690,
        v=268,
        span_px=604,
        turn_deg=8,
        tilt_deg=24,
        roll_deg=0.8,
        lamp=(640, 800, 520, 0.25),
        falloff=(-0.03, -0.08),
    ),
    BoardView(
        wall=GREY_WALL,
        u=208,
        v=158,
        span_px=384,
        turn_deg=28,
        tilt_deg=10,
        roll_deg=-3.0,
        lamp=(1100, 40, 500, 0.30),
        falloff=(-0.04, 0.10),
    ),
    BoardView(
        wall=GREY_WALL,
        u=222,
        v=566,
        span_px=396,
        turn_deg=24,
        tilt_deg=-14,
        roll_deg=2.0,
        lamp=(60, 40, 380, 0.40),
        falloff=(0.04, 0.10),
    ),
)


def write_boards(
    folder: str | Path,
    *,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> list[Path]:
    """Files written: calibration1.jpg .. calibration20.jpg and truth.json.

    The folder is created where needed. `progress` is called as progress(images done,
    number of images). `workers` is the number of processes (default: one for each
    available CPU) and does not change the files. Raises OSError if the folder cannot be
    written to.
    """
    folder = Path(folder)
    # a folder that cannot be made is reported before the images are rendered
    with translate_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    numbered = list(enumerate(BOARD_VIEWS, 1))
    images = run_all(_render_numbered, numbered, workers=workers, progress=progress)

    written = []
    boards = {}
    for (number, view), image in zip(numbered, images, strict=True):
        name = f"calibration{number}.jpg"
        written.append(write_image(folder / name, image, jpeg_quality=90))
        boards[name] = _board_truth(view)
    truth = {
        "camera": camera_to_dict(DASHCAM),
        "pattern": [INNER_COLUMNS, INNER_ROWS],
        "boards": boards,
    }
    truth_path = folder / "truth.json"
    write_atomically(truth_path, (json.dumps(truth) + "\n").encode())
    return [*written, truth_path]


def _render_numbered(numbered: tuple[int, BoardView]) -> np.ndarray:
    number, view = numbered
    return render_board(view, seed=number)


def render_board(view: BoardView, *, seed: int) -> np.ndarray:
    """Photograph of the board (height, width, 3), uint8 RGB.

    `seed` is for wall, paper and sensor noise.
    """
    rng = np.random.default_rng(seed)
    x, y = _wall_coordinates(view)
    glow = _glow(view)
    light = _illumination(view, glow)[..., None]
    scene = _wall(view, x, y, glow, rng) * light
    paper, coverage = _sheet(view, x, y, glow, rng)
    blend(scene, paper * light, coverage)
    return _expose(scene, view.wall.noise, rng)


def true_corners(view: BoardView) -> np.ndarray:
    """Pixels (54, 2) of the inner corners, row by row from the top left.

    Some may lie outside the image.
    """
    turn, shift = _board_pose(view)
    columns = np.arange(INNER_COLUMNS) - (INNER_COLUMNS - 1) / 2
    rows = np.arange(INNER_ROWS) - (INNER_ROWS - 1) / 2
    column, row = np.meshgrid(columns, rows)
    on_sheet = np.stack([column, row, np.zeros(column.shape)], axis=-1)
    pixels, _ = cv2.projectPoints(
        on_sheet.reshape(-1, 3) * SQUARE_M,
        cv2.Rodrigues(turn)[0],
        shift,
        DASHCAM.matrix,
        DASHCAM.distortion,
    )
    return pixels.reshape(-1, 2)


def _board_truth(view: BoardView) -> dict:
    corners = true_corners(view)
    width, height = view.camera.size
    in_image = (corners >= 0) & (corners <= [width - 1, height - 1])
    return {
        "width": width,
        "height": height,
        "corners_px": np.round(corners, 3).tolist(),
        "inside": in_image.all(axis=1).astype(int).tolist(),
    }


def _board_pose(view: BoardView) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) in metres from sheet to camera.

    The sheet has x right, y down, and its origin at its centre.
    """
    tilt = np.radians(view.tilt_deg)
    turn = np.radians(view.turn_deg)
    roll = np.radians(view.roll_deg)
    about_x = np.array(
        [
            [1, 0, 0],
            [0, np.cos(tilt), -np.sin(tilt)],
            [0, np.sin(tilt), np.cos(tilt)],
        ]
    )
    about_y = np.array(
        [
            [np.cos(turn), 0, np.sin(turn)],
            [0, 1, 0],
            [-np.sin(turn), 0, np.cos(turn)],
        ]
    )
    about_z = np.array(
        [
            [np.cos(roll), -np.sin(roll), 0],
            [np.sin(roll), np.cos(roll), 0],
            [0, 0, 1],
        ]
    )
    rotation = about_z @ about_y @ about_x
    width_m = (INNER_COLUMNS + 1) * SQUARE_M
    distance = DASHCAM.matrix[0, 0] * width_m / view.span_px
    ray = DASHCAM.rays(np.array([[view.u, view.v]]))[0]
    return rotation, distance * ray


def _wall_coordinates(view: BoardView) -> tuple[np.ndarray, np.ndarray]:
    """Points of the wall seen by each pixel.

    They are x and y (height, width) in metres from the centre of the sheet.
    """
    turn, shift = _board_pose(view)
    rays = pixel_rays(view.camera, np.float64)
    normal = turn[:, 2]
    # A ray nearly parallel to the wall is given a far intersection, where there is only
    # paint.
    slope = np.maximum(rays @ normal, 1e-2)
    distance = normal @ shift / slope
    hit = rays * distance[..., None] - shift
    return hit @ turn[:, 0], hit @ turn[:, 1]


def _illumination(view: BoardView, glow: np.ndarray) -> np.ndarray:
    """Brightness (height, width): fall-off, glow of the lamp, and vignetting."""
    width, height = view.camera.size
    u = np.linspace(-1, 1, width)
    v = np.linspace(-1, 1, height)[:, None]
    to_right, to_bottom = view.falloff
    falloff = 1 - (to_right * u + to_bottom * v)
    vignette = 1 - 0.07 * (u**2 + v**2)
    return falloff * vignette + 0.25 * glow


def _glow(view: BoardView) -> np.ndarray:
    """Reflection of the lamp (height, width), with the wide tails of satin paint."""
    lamp_u, lamp_v, radius, strength = view.lamp
    width, height = view.camera.size
    u = np.arange(width)
    v = np.arange(height)[:, None]
    distance2 = (u - lamp_u) ** 2 + (1.3 * (v - lamp_v)) ** 2
    return strength / (1 + distance2 / radius**2) ** 2


def _wall(
    view: BoardView,
    x: np.ndarray,
    y: np.ndarray,
    glow: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Colour (height, width, 3) of the painted wall.

    It has the relief of the plaster and a soft shadow of the sheet.
    """
    start_u, start_v = rng.uniform(0, WALL_TEXELS, 2)
    footprint = float(np.median(_pixel_size(x, y))) / WALL_TEXEL_M
    plaster = _blur_to_footprint(_plaster(), footprint)
    u = x / WALL_TEXEL_M + start_u
    v = y / WALL_TEXEL_M + start_v
    relief = np.clip(_sample_tile(plaster, u, v), -4, 4)
    # Satin paint reflects the lamp in the lamp's colour, on slopes that face it.
    shade = 1 + view.wall.relief * 0.055 * relief * (1 + 4 * glow)

    # The sheet is a few millimetres off the wall, more at its lower edge.
    distance = _outside(x - 0.0015, y - 0.0025)
    shade *= 1 - 0.34 * np.exp(-np.maximum(distance, 0) / 0.0022)
    reflection = (glow * shade**2)[..., None] * np.array([0.30, 0.30, 0.34])
    paint = np.array(view.wall.paint)
    return np.clip(shade, 0.2, 2.0)[..., None] * paint + reflection


def _pixel_size(
    x: np.ndarray,
    y: np.ndarray,
) -> np.ndarray:
    """Width (height, width) of each pixel on the wall, metres."""
    return np.hypot(np.gradient(x, axis=1), np.gradient(y, axis=1))


def _sheet(
    view: BoardView,
    x: np.ndarray,
    y: np.ndarray,
    glow: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (height, width, 3) of the printed sheet, and its share of each pixel."""
    start_u, start_v = rng.uniform(0, WALL_TEXELS, 2)
    u = x / RIPPLE_TEXEL_M + start_u
    v = y / RIPPLE_TEXEL_M + start_v
    ripple = _sample_tile(_ripples(), u, v)
    edge = _outside(x, y) + 0.00035 * ripple
    coverage = np.clip(0.5 - edge / (_pixel_size(x, y) + 1e-9), 0, 1)

    # Paper is not quite flat: shading varies by 1 to 2 %, more at the border, which
    # lifts off the wall.
    at_border = np.exp(np.minimum(edge, 0) / 0.006)
    shade = 1 + 0.012 * ripple + 0.05 * ripple * at_border
    ink = _ink(x, y)[..., None]
    black = view.wall.ink + 0.02 * glow[..., None]
    paper = np.array(view.wall.paper)
    return shade[..., None] * (paper * (1 - ink) + black * ink), coverage


def _ink(
    x: np.ndarray,
    y: np.ndarray,
) -> np.ndarray:
    """Black share (height, width) of each pixel's footprint on the sheet.

    It is counted at 4 x 4 points.
    """
    # Squares from the upper left corner, and their change per pixel.
    column = x / SQUARE_M + (INNER_COLUMNS + 1) / 2
    row = y / SQUARE_M + (INNER_ROWS + 1) / 2
    near = np.abs(x) < (INNER_COLUMNS / 2 + 1) * SQUARE_M
    near &= np.abs(y) < (INNER_ROWS / 2 + 1) * SQUARE_M
    column_v = np.gradient(column, axis=0)[near]
    column_u = np.gradient(column, axis=1)[near]
    row_v = np.gradient(row, axis=0)[near]
    row_u = np.gradient(row, axis=1)[near]
    column = column[near]
    row = row[near]

    black = np.zeros_like(column)
    for dv in INK_SAMPLES:
        for du in INK_SAMPLES:
            i = np.floor(column + du * column_u + dv * column_v)
            j = np.floor(row + du * row_u + dv * row_v)
            printed = (i >= 0) & (i <= INNER_COLUMNS) & (j >= 0) & (j <= INNER_ROWS)
            black += printed & ((i + j) % 2 == 0)
    ink = np.zeros_like(x)
    ink[near] = black / len(INK_SAMPLES) ** 2
    return ink


def _outside(
    x: np.ndarray,
    y: np.ndarray,
) -> np.ndarray:
    """Signed distance in metres from the outline of the sheet, negative inside."""
    width_m, height_m = PAPER_M
    dx = np.abs(x) - width_m / 2
    dy = np.abs(y) - height_m / 2
    beyond = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
    return beyond + np.minimum(np.maximum(dx, dy), 0)


def _sample_tile(
    tile: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> np.ndarray:
    """Sample a tile that is periodic in both directions."""
    side = tile.shape[0]
    wrapped = cv2.copyMakeBorder(tile, 0, 1, 0, 1, cv2.BORDER_WRAP)
    tile_u = (u % side).astype(np.float32)
    tile_v = (v % side).astype(np.float32)
    return cv2.remap(wrapped, tile_u, tile_v, cv2.INTER_LINEAR)


@lru_cache(maxsize=1)
def _plaster() -> np.ndarray:
    """Slope towards the light of a knock-down plaster, unit variance.

    Flat splashes with steep rims.
    """
    rng = np.random.default_rng(20)
    fine = _smooth_noise(rng, 3.0)
    coarse = _smooth_noise(rng, 9.0)
    where = _smooth_noise(rng, 60.0)
    level = coarse + 0.35 * fine + 0.5 * where - 1.35
    splash = 1 / (1 + np.exp(-7 * level))
    height = splash + 0.05 * coarse + 0.012 * fine
    slope = height - np.roll(height, (2, 1), axis=(0, 1))
    return (slope / slope.std()).astype(np.float32)


def _blur_to_footprint(tile: np.ndarray, texels_per_pixel: float) -> np.ndarray:
    """Periodic tile blurred by the pixel footprint, which prevents aliasing."""
    if texels_per_pixel <= 1:
        return tile
    margin = 64
    wide = cv2.copyMakeBorder(tile, margin, margin, margin, margin, cv2.BORDER_WRAP)
    blurred = cv2.GaussianBlur(wide, (0, 0), texels_per_pixel / 2)
    return blurred[margin:-margin, margin:-margin]


@lru_cache(maxsize=1)
def _ripples() -> np.ndarray:
    """Undulation of the paper, unit variance, 2 mm a texel."""
    return _smooth_noise(np.random.default_rng(21), 9.0, RIPPLE_TEXELS)


def _smooth_noise(
    rng: np.random.Generator, sigma: float, side: int = WALL_TEXELS
) -> np.ndarray:
    """Periodic white noise blurred by a Gaussian of `sigma` texels, unit variance."""
    down = np.fft.fftfreq(side)[:, None]
    across = np.fft.rfftfreq(side)[None, :]
    frequency2 = across**2 + down**2
    gain = np.exp(-2 * (np.pi * sigma) ** 2 * frequency2)
    waves = np.fft.rfft2(rng.standard_normal((side, side)))
    noise = np.fft.irfft2(waves * gain, (side, side))
    return (noise / noise.std()).astype(np.float32)


def _expose(
    scene: np.ndarray, noise_levels: float, rng: np.random.Generator
) -> np.ndarray:
    """Camera image, uint8 RGB, of the light of the scene."""
    # Blur of the lens, and veiling glare.
    scene = _blur(scene.astype(np.float32), 0.75)
    height, width = scene.shape[:2]
    coarse = cv2.resize(scene, None, fx=1 / 16, fy=1 / 16, interpolation=cv2.INTER_AREA)
    veil = cv2.resize(_blur(coarse, 8), (width, height), interpolation=cv2.INTER_LINEAR)
    scene = 0.993 * scene + 0.007 * veil

    # Tone curve: a soft shoulder, which compresses highlights. Then sharpening.
    shoulder = 0.7 + 0.3 * np.tanh((scene - 0.7) / 0.3)
    levels = 255 * srgb(np.where(scene > 0.7, shoulder, scene))
    levels += 0.5 * (levels - _blur(levels, 1.3))

    # Noise of brightness and of colour.
    white = rng.standard_normal((height, width)).astype(np.float32)
    grain = _blur(white, 0.6) * 2.2
    white = rng.standard_normal((height, width, 3)).astype(np.float32)
    colour = _blur(white, 2.0) * 4.0
    levels += noise_levels * (grain[..., None] + 0.5 * colour)
    return np.clip(np.round(levels), 0, 255).astype(np.uint8)


def _blur(image: np.ndarray, sigma_px: float) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), sigma_px)
