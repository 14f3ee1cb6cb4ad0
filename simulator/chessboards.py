"""Chessboard photographs with ground truth: a printed sheet on a plastered wall, seen through the course's lens.

The ray of each pixel, distortion included, is cast onto the plane of the wall, so the
corner positions are exact. The sheet is flat: paper that looks curled is only shaded,
which moves no corner.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import cv2
import numpy as np

from lanes.camera import Camera, camera_to_dict
from lanes.files import translate_write_errors, write_atomically
from lanes.images import write_image
from simulator.light.lens import srgb
from simulator.painting import blend
from simulator.processes import run_all
from simulator.road.ground import pixel_rays
from simulator.scenes.freeway import DASHCAM

INNER_COLUMNS, INNER_ROWS = 9, 6
# 10 x 7 squares of this size leave margins of 15 and 19 mm on US Letter paper.
SQUARE_M = 0.0248
PAPER_M = (0.2794, 0.2159)
WALL_TEXEL_M = 0.0005
WALL_TEXELS = 2048


@dataclass(frozen=True)
class PaintedWall:
    """Painted wall and sheet under one light: linear colours 0..1, strength of the plaster, sensor noise."""

    paint: tuple[float, float, float]
    paper: tuple[float, float, float]
    ink: float
    relief: float
    noise: float


# Near a window, and in a dim corridor with a high sensor gain.
CREAM_WALL = PaintedWall(
    paint=(0.68, 0.67, 0.58), paper=(0.84, 0.84, 0.85), ink=0.004, relief=0.6, noise=0.9
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
        CREAM_WALL, 652, 436, 1165, 1.5, -2, 0.4, (200, -100, 900, 0.10), (0.06, 0.05)
    ),
    BoardView(
        CREAM_WALL, 640, 375, 1000, -3, 31, 0.6, (1250, 100, 700, 0.12), (-0.05, 0.10)
    ),
    BoardView(
        CREAM_WALL, 640, 366, 985, 2, -35, -0.5, (820, 60, 360, 0.30), (0.04, 0.16)
    ),
    BoardView(
        CREAM_WALL, 872, 318, 1040, 35, 3, -1.2, (-60, 200, 500, 0.15), (-0.08, 0.06)
    ),
    BoardView(
        CREAM_WALL, 560, 262, 985, -33, -4, 0.8, (1300, 650, 600, 0.14), (0.10, 0.02)
    ),
    BoardView(
        GREY_WALL, 622, 338, 392, 1, -1, 0.3, (1400, -200, 700, 0.25), (0.03, 0.10)
    ),
    BoardView(
        GREY_WALL, 446, 352, 398, 47, 2, -0.6, (30, 60, 320, 0.45), (0.02, 0.08), 1
    ),
    BoardView(
        GREY_WALL, 846, 362, 470, -43, -3, 1.0, (1380, 120, 420, 0.55), (-0.06, 0.10)
    ),
    BoardView(
        GREY_WALL, 742, 300, 436, -38, 18, 17.0, (1330, 250, 380, 0.80), (0.05, 0.09)
    ),
    BoardView(
        GREY_WALL, 770, 446, 560, 14, -44, -3.0, (80, 680, 500, 0.15), (0.08, -0.04)
    ),
    BoardView(
        GREY_WALL, 204, 356, 262, 22, -6, -1.5, (900, -80, 600, 0.20), (-0.05, 0.12)
    ),
    BoardView(
        GREY_WALL, 872, 318, 556, 33, 8, 2.2, (-20, 260, 330, 1.30), (-0.02, 0.12)
    ),
    BoardView(
        GREY_WALL, 604, 300, 452, 34, -22, -33.0, (-40, 640, 300, 1.70), (0.03, 0.05)
    ),
    BoardView(
        GREY_WALL, 1096, 186, 368, -32, -8, 4.0, (1260, 20, 260, 0.50), (0.02, 0.06)
    ),
    BoardView(
        GREY_WALL, 1092, 548, 402, -27, 12, 2.5, (1180, 40, 300, 0.55), (0.05, 0.06), 1
    ),
    BoardView(
        GREY_WALL, 1052, 246, 398, -30, 14, 3.0, (300, 740, 500, 0.20), (0.04, -0.05)
    ),
    BoardView(
        GREY_WALL, 666, 430, 642, -6, -20, -1.0, (120, -40, 420, 0.35), (0.02, 0.14)
    ),
    BoardView(
        GREY_WALL, 690, 268, 604, 8, 24, 0.8, (640, 800, 520, 0.25), (-0.03, -0.08)
    ),
    BoardView(
        GREY_WALL, 208, 158, 384, 28, 10, -3.0, (1100, 40, 500, 0.30), (-0.04, 0.10)
    ),
    BoardView(
        GREY_WALL, 222, 566, 396, 24, -14, 2.0, (60, 40, 380, 0.40), (0.04, 0.10)
    ),
)


def write_boards(
    folder: str | Path,
    *,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> list[Path]:
    """Files written: calibration1.jpg .. calibration20.jpg and truth.json, in a folder that is created where needed.

    `progress` is called as progress(images done, number of images). `workers` is the
    number of processes (default: one for each available CPU) and does not change the
    files. Raises OSError if the folder cannot be written to.
    """
    folder = Path(folder)
    # a folder that cannot be made is reported before the images are rendered
    with translate_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    boards = run_all(
        _seeded_board,
        list(enumerate(BOARD_VIEWS, 1)),
        workers=workers,
        progress=progress,
    )
    written = []
    truth: dict = {
        "camera": camera_to_dict(DASHCAM),
        "pattern": [INNER_COLUMNS, INNER_ROWS],
        "boards": {},
    }
    for number, (view, board) in enumerate(zip(BOARD_VIEWS, boards, strict=True), 1):
        name = f"calibration{number}.jpg"
        written.append(write_image(folder / name, board, jpeg_quality=90))
        truth["boards"][name] = _board_truth(view)
    write_atomically(folder / "truth.json", (json.dumps(truth) + "\n").encode())
    return [*written, folder / "truth.json"]


def _seeded_board(seed_and_view: tuple[int, BoardView]) -> np.ndarray:
    return render_board(seed_and_view[1], seed=seed_and_view[0])


def render_board(view: BoardView, *, seed: int = 0) -> np.ndarray:
    """Photograph of the board (height, width, 3), uint8 RGB; `seed` is for wall, paper and sensor noise."""
    rng = np.random.default_rng(seed)
    x, y = _wall_coordinates(view)
    glow = _glow(view)
    light = _illumination(view, glow)[..., None]
    scene = _wall(view, x, y, glow, rng) * light
    paper, coverage = _sheet(view, x, y, glow, rng)
    blend(scene, paper * light, coverage)
    return _expose(scene, view.wall.noise, rng)


def true_corners(view: BoardView) -> np.ndarray:
    """Pixels (54, 2) of the inner corners, row by row from the top left; some may lie outside the image."""
    turn, shift = _board_pose(view)
    column, row = np.meshgrid(
        *(np.arange(count) - (count - 1) / 2 for count in (INNER_COLUMNS, INNER_ROWS))
    )
    points = (
        np.column_stack([column.ravel(), row.ravel(), np.zeros(column.size)]) * SQUARE_M
    )
    pixels, _ = cv2.projectPoints(
        points, cv2.Rodrigues(turn)[0], shift, DASHCAM.matrix, DASHCAM.distortion
    )
    return pixels.reshape(-1, 2)


def _board_truth(view: BoardView) -> dict:
    corners, size = true_corners(view), view.camera.size
    inside = ((corners >= 0) & (corners <= np.subtract(size, 1))).all(axis=1)
    known = {
        "corners_px": np.round(corners, 3).tolist(),
        "inside": inside.astype(int).tolist(),
    }
    return {"width": size[0], "height": size[1]} | known


def _board_pose(view: BoardView) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) in metres from sheet (x right, y down, origin at its centre) to camera."""
    turn, tilt, roll = np.radians([view.turn_deg, view.tilt_deg, view.roll_deg])
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
    )
    about_y = np.array(
        [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    )
    about_z = np.array(
        [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    )
    distance = DASHCAM.matrix[0, 0] * (INNER_COLUMNS + 1) * SQUARE_M / view.span_px
    return about_z @ about_y @ about_x, distance * DASHCAM.rays(
        np.array([[view.u, view.v]])
    )[0]


def _wall_coordinates(view: BoardView) -> tuple[np.ndarray, np.ndarray]:
    """Points of the wall seen by each pixel: x and y (height, width) in metres from the centre of the sheet."""
    (turn, shift), rays = _board_pose(view), pixel_rays(view.camera, np.float64)
    normal = turn[:, 2]
    # A ray nearly parallel to the wall is given a far intersection, where there is only
    # paint.
    slope = np.maximum(rays @ normal, 1e-2)
    hit = rays * (normal @ shift / slope)[..., None] - shift
    return hit @ turn[:, 0], hit @ turn[:, 1]


def _illumination(view: BoardView, glow: np.ndarray) -> np.ndarray:
    """Brightness (height, width): fall-off, glow of the lamp, and vignetting."""
    u, v = np.meshgrid(*(np.linspace(-1, 1, side) for side in view.camera.size))
    falloff = 1 - (view.falloff[0] * u + view.falloff[1] * v)
    vignette = 1 - 0.07 * (u**2 + v**2)
    return falloff * vignette + 0.25 * glow


def _glow(view: BoardView) -> np.ndarray:
    """Reflection of the lamp (height, width), with the wide tails of satin paint."""
    lamp_u, lamp_v, reach, strength = view.lamp
    u, v = np.meshgrid(*map(np.arange, view.camera.size))
    squared = ((u - lamp_u) ** 2 + (1.3 * (v - lamp_v)) ** 2) / reach**2
    return strength / (1 + squared) ** 2


def _wall(
    view: BoardView,
    x: np.ndarray,
    y: np.ndarray,
    glow: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Colour (height, width, 3) of the painted wall, with relief of the plaster and soft shadow of the sheet."""
    start = rng.uniform(0, WALL_TEXELS, 2)
    footprint = (
        float(np.median(np.hypot(np.gradient(x, axis=1), np.gradient(y, axis=1))))
        / WALL_TEXEL_M
    )
    plaster = _blur_to_footprint(_plaster(), footprint)
    relief = np.clip(
        _sample(plaster, x / WALL_TEXEL_M + start[0], y / WALL_TEXEL_M + start[1]),
        -4,
        4,
    )
    # Satin paint reflects the lamp in the lamp's colour, on slopes that face it.
    shade = 1 + view.wall.relief * 0.055 * relief * (1 + 4 * glow)
    # The sheet is a few millimetres off the wall, more at its lower edge.
    distance = _outside(x - 0.0015, y - 0.0025)
    shade *= 1 - 0.34 * np.exp(-np.maximum(distance, 0) / 0.0022)
    reflection = (glow * shade**2)[..., None] * np.array([0.30, 0.30, 0.34])
    return np.clip(shade, 0.2, 2.0)[..., None] * np.array(view.wall.paint) + reflection


def _sheet(
    view: BoardView,
    x: np.ndarray,
    y: np.ndarray,
    glow: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Colour (height, width, 3) of the printed sheet, and its coverage (height, width) of each pixel."""
    start = rng.uniform(0, WALL_TEXELS, 2)
    ripple = _sample(_ripples(), x / 0.002 + start[0], y / 0.002 + start[1])
    edge = _outside(x, y) + 0.00035 * ripple
    pixel = np.hypot(np.gradient(x, axis=1), np.gradient(y, axis=1)) + 1e-9
    coverage = np.clip(0.5 - edge / pixel, 0, 1)
    # Paper is not quite flat: shading varies by 1 to 2 %, more at the border, which
    # lifts off the wall.
    shade = 1 + 0.012 * ripple + 0.05 * ripple * np.exp(np.minimum(edge, 0) / 0.006)
    ink = _ink(x, y)[..., None]
    sheen = 0.02 * glow[..., None]
    return shade[..., None] * (
        np.array(view.wall.paper) * (1 - ink) + (view.wall.ink + sheen) * ink
    ), coverage


def _ink(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Black share (height, width) of each pixel's footprint on the sheet, from 4 x 4 points."""
    across, down = (
        x / SQUARE_M + (INNER_COLUMNS + 1) / 2,
        y / SQUARE_M + (INNER_ROWS + 1) / 2,
    )
    near = (np.abs(x) < (INNER_COLUMNS / 2 + 1) * SQUARE_M) & (
        np.abs(y) < (INNER_ROWS / 2 + 1) * SQUARE_M
    )
    a, a_u, a_v, b, b_u, b_v = (
        f[near] for field in (across, down) for f in (field, *np.gradient(field)[::-1])
    )
    ink, black = np.zeros_like(x), np.zeros_like(a)
    for dv, du in product((-0.375, -0.125, 0.125, 0.375), repeat=2):
        column, row = (
            np.floor(a + du * a_u + dv * a_v),
            np.floor(b + du * b_u + dv * b_v),
        )
        printed = (
            (column >= 0) & (column <= INNER_COLUMNS) & (row >= 0) & (row <= INNER_ROWS)
        )
        black += printed & ((column + row) % 2 == 0)
    ink[near] = black / 16
    return ink


def _outside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Signed distance in metres from the outline of the sheet, negative inside."""
    dx, dy = np.abs(x) - PAPER_M[0] / 2, np.abs(y) - PAPER_M[1] / 2
    return np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) + np.minimum(
        np.maximum(dx, dy), 0
    )


def _sample(tile: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Sample a tile that is periodic in both directions."""
    side = tile.shape[0]
    wrapped = cv2.copyMakeBorder(tile, 0, 1, 0, 1, cv2.BORDER_WRAP)
    return cv2.remap(
        wrapped,
        (u % side).astype(np.float32),
        (v % side).astype(np.float32),
        cv2.INTER_LINEAR,
    )


@lru_cache(maxsize=1)
def _plaster() -> np.ndarray:
    """Slope towards the light of a knock-down plaster, unit variance: flat splashes with steep rims."""
    rng = np.random.default_rng(20)
    fine, coarse, where = (_smooth_noise(rng, sigma) for sigma in (3.0, 9.0, 60.0))
    splash = 1 / (1 + np.exp(-7 * (coarse + 0.35 * fine + 0.5 * where - 1.35)))
    height = splash + 0.05 * coarse + 0.012 * fine
    slope = height - np.roll(height, (2, 1), axis=(0, 1))
    return (slope / slope.std()).astype(np.float32)


def _blur_to_footprint(tile: np.ndarray, texels_per_pixel: float) -> np.ndarray:
    """Periodic tile blurred by the pixel footprint, which prevents aliasing."""
    if texels_per_pixel <= 1:
        return tile
    margin = 64
    wide = cv2.copyMakeBorder(tile, margin, margin, margin, margin, cv2.BORDER_WRAP)
    return cv2.GaussianBlur(wide, (0, 0), texels_per_pixel / 2)[
        margin:-margin, margin:-margin
    ]


@lru_cache(maxsize=1)
def _ripples() -> np.ndarray:
    """Undulation of the paper, unit variance, 2 mm a texel."""
    return _smooth_noise(np.random.default_rng(21), 9.0, 512)


def _smooth_noise(
    rng: np.random.Generator, sigma: float, side: int = WALL_TEXELS
) -> np.ndarray:
    """Periodic white noise blurred by a Gaussian of `sigma` texels, unit variance."""
    frequency_v, frequency_u = (
        np.fft.fftfreq(side)[:, None],
        np.fft.rfftfreq(side)[None, :],
    )
    gain = np.exp(-2 * (np.pi * sigma) ** 2 * (frequency_u**2 + frequency_v**2))
    noise = np.fft.irfft2(
        np.fft.rfft2(rng.standard_normal((side, side))) * gain, (side, side)
    )
    return (noise / noise.std()).astype(np.float32)


def _expose(
    scene: np.ndarray, noise_levels: float, rng: np.random.Generator
) -> np.ndarray:
    """Camera image, uint8 RGB: lens blur, veiling glare, tone curve, sharpening and noise."""
    scene = cv2.GaussianBlur(scene.astype(np.float32), (0, 0), 0.75)
    small = cv2.resize(scene, None, fx=1 / 16, fy=1 / 16, interpolation=cv2.INTER_AREA)
    veil = cv2.resize(
        cv2.GaussianBlur(small, (0, 0), 8),
        scene.shape[1::-1],
        interpolation=cv2.INTER_LINEAR,
    )
    scene = 0.993 * scene + 0.007 * veil
    # A soft shoulder, which compresses highlights.
    levels = 255 * srgb(
        np.where(scene > 0.7, 0.7 + 0.3 * np.tanh((scene - 0.7) / 0.3), scene)
    )
    levels += 0.5 * (levels - cv2.GaussianBlur(levels, (0, 0), 1.3))
    grain = (
        cv2.GaussianBlur(
            rng.standard_normal(levels.shape[:2]).astype(np.float32), (0, 0), 0.6
        )
        * 2.2
    )
    colour = (
        cv2.GaussianBlur(
            rng.standard_normal(levels.shape).astype(np.float32), (0, 0), 2.0
        )
        * 4.0
    )
    levels += noise_levels * (grain[..., None] + 0.5 * colour)
    return np.clip(np.round(levels), 0, 255).astype(np.uint8)
