"""Pictures of painted roads with exactly known truth, drawn through the camera for the tests of the camera pose."""

from __future__ import annotations

import cv2
import numpy as np

from lanes.camera.camera import Camera

LANE_M, STRIPE_M = 3.66, 0.12


def paint_road(
    camera: Camera,
    *,
    offset_m: float = 0.0,
    heading_rad: float = 0.0,
    curvature_per_m: float = 0.0,
    lines: tuple[int, ...] = (-1, 0, 1, 2),
    solid: tuple[int, ...] = (0,),
    phase_m: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """A gray road below a textured sky, RGB (H, W, 3) uint8.

    `lines` are numbered from left to right: 0 and 1 bound the own lane. `offset_m` > 0 puts the car left of its middle,
    `heading_rad` > 0 turns the road left of the car's axis. Lines not in `solid` are dashed, 3 m in 12 m.
    """
    rng = np.random.default_rng(seed)
    height, width = camera.height, camera.width
    picture = _backdrop(camera, rng)
    for number in lines:
        colour = (235, 190, 60) if number == 0 else (235, 235, 235)
        lateral = LANE_M * (0.5 - number)
        starts = np.arange(1.0, 90.0, 1.0) if number in solid else np.arange(1.0 + phase_m % 12, 90, 12.0)
        for start in starts:
            along = np.linspace(start, start + (1.0 if number in solid else 3.0), 4)
            left, right = (
                _beside_the_road(along, lateral + side * STRIPE_M / 2, offset_m, heading_rad, curvature_per_m)
                for side in (1, -1)
            )
            outline = camera.road_to_pixels(np.vstack([left, right[::-1]]))
            if np.isfinite(outline).all() and (np.abs(outline) < 10 * width).all():
                cv2.fillPoly(picture, [np.round(outline * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
    noisy = cv2.GaussianBlur(picture, (3, 3), 0) + 4 * rng.standard_normal((height, width, 1), np.float32)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def _beside_the_road(
    along_m: np.ndarray, lateral_m: float, offset_m: float, heading_rad: float, curvature_per_m: float
) -> np.ndarray:
    """Points (N, 2) to the left of the middle of a lane that runs along a circle: lines are truly parallel."""
    turn = curvature_per_m * along_m
    # sinc keeps the chord exact for straight roads, too.
    chord, direction = along_m * np.sinc(turn / 2 / np.pi), heading_rad + turn / 2
    normal = heading_rad + turn
    x = chord * np.cos(direction) - lateral_m * np.sin(normal)
    y = chord * np.sin(direction) + lateral_m * np.cos(normal) - offset_m
    return np.column_stack([x, y])


def _backdrop(camera: Camera, rng: np.random.Generator) -> np.ndarray:
    """Stained asphalt below the horizon, a rugged landscape above it, a darker patch and a car that are no stripes."""
    stains = cv2.resize(rng.normal(90, 12, (18, 32)).astype(np.float32), camera.size, interpolation=cv2.INTER_CUBIC)
    picture = np.repeat(np.clip(stains, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    left, right = camera.road_to_pixels(np.array([[2000.0, 300.0], [2000.0, -300.0]]))
    step = (right - left) / (right - left)[0]
    horizon = [left + step * (column - left[0]) for column in (0, camera.width)]
    land = np.array([*horizon, [camera.width, 0], [0, 0]])
    mask = cv2.fillPoly(np.zeros(picture.shape[:2], np.uint8), [land.astype(np.int32)], 1)
    coarse = rng.integers(40, 220, (camera.height // 12, camera.width // 12, 3), dtype=np.uint8)
    picture[mask > 0] = cv2.resize(coarse, camera.size, interpolation=cv2.INTER_LINEAR)[mask > 0]
    joint = camera.road_to_pixels(np.array([[4.0, 0.4], [60.0, 0.4], [60.0, -0.9], [4.0, -0.9]]))
    cv2.fillPoly(picture, [joint.astype(np.int32)], (70, 70, 72))
    car = camera.road_to_pixels(np.array([[25.0, -2.9, 0.0], [25.0, -4.7, 1.4]]))
    cv2.rectangle(picture, tuple(map(int, car[0])), tuple(map(int, car[1])), (190, 190, 200), -1)
    return picture
