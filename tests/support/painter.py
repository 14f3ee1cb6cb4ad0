"""Roads painted through the camera model, for tests: every line lies exactly where the test says."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose

ASPHALT = (95, 95, 98)
WHITE, YELLOW = (225, 225, 220), (215, 165, 40)
SUBPIXELS = (-0.375, -0.125, 0.125, 0.375)
VOTING_FAR_M = 150.0


def dashcam(width: int = 640, **pose: float) -> Camera:
    """A distorted lens, mounted as in a car: 1.3 m above the road, looking slightly up and to the right."""
    scale = width / 1280
    matrix = np.array([[1150 * scale, 0, 640 * scale], [0, 1150 * scale, 370 * scale], [0, 0, 1]])
    lens = Camera(width, width * 9 // 16, matrix, np.array([-0.24, 0.06, 0.0005, -0.0003, 0.0]))
    return lens.with_pose(CameraPose(**{"height_m": 1.3, "pitch_rad": -0.01, "yaw_rad": -0.012, **pose}))


@lru_cache(maxsize=8)
def _road_points(size: tuple, matrix: tuple, distortion: tuple, pose: CameraPose) -> list[tuple]:
    """Where pixels look on the road, for several heights within a pixel: (first row, points, metres a column)."""
    camera = Camera(*size, np.reshape(matrix, (3, 3)), np.array(distortion), pose)
    _, horizon = camera.road_to_pixels(np.array([[VOTING_FAR_M, 0.0]]))[0]
    top = max(0, int(horizon) - 20)
    v, u = np.mgrid[top : camera.height, : camera.width].astype(float)
    found = []
    for dv in SUBPIXELS:
        points = camera.pixels_to_road(np.column_stack([u.ravel(), (v + dv).ravel()])).reshape(*u.shape, 2)
        found.append((top, points, np.gradient(points[..., 1], axis=1)))
    return found


class Road:
    """A picture of a flat road that stripes can be painted on."""

    def __init__(self, camera: Camera, *, asphalt: tuple = ASPHALT, noise: float = 2.0, seed: int = 0) -> None:
        self.camera, self.noise, self.seed = camera, noise, seed
        self.points = _road_points(camera.size, tuple(camera.matrix.ravel()), tuple(camera.distortion), camera.pose)
        self.picture = np.ones((camera.height, camera.width, 3)) * asphalt

    def cover(self, inside: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
        """Share of each pixel for which `inside(x, y)` holds."""
        share = np.zeros((self.camera.height, self.camera.width, 1))
        with np.errstate(invalid="ignore"):
            for top, points, across in self.points:
                for du in SUBPIXELS:
                    hit = inside(points[..., 0], points[..., 1] + du * across) & (points[..., 0] < VOTING_FAR_M)
                    share[top:, :, 0] += hit
        return share / len(self.points) / len(SUBPIXELS)

    def paint(self, inside: Callable[[np.ndarray, np.ndarray], np.ndarray], colour: tuple) -> Road:
        """Paint the part of the road where `inside(x, y)` holds."""
        share = self.cover(inside)
        self.picture = self.picture * (1 - share) + np.array(colour, float) * share
        return self

    def line(
        self,
        y_of_x: Callable[[np.ndarray], np.ndarray],
        *,
        colour: tuple = WHITE,
        width_m: float = 0.12,
        dash_m: tuple[float, float] | None = None,
    ) -> Road:
        """Paint a line; `dash_m` is (length, period)."""

        def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            on = np.abs(y - y_of_x(x)) < width_m / 2
            return on & ((x % dash_m[1]) < dash_m[0]) if dash_m else on

        return self.paint(inside, colour)

    def shade(self, inside: Callable[[np.ndarray, np.ndarray], np.ndarray], share: float) -> Road:
        """Darken part of the road to `share` of its light."""
        self.picture = self.picture * (1 - self.cover(inside) * (1 - share))
        return self

    def image(self) -> np.ndarray:
        """The picture as the camera delivers it: uint8 with sensor noise."""
        rng = np.random.default_rng(self.seed)
        noisy = self.picture + rng.normal(0, self.noise, self.picture.shape)
        return np.clip(np.round(noisy), 0, 255).astype(np.uint8)
