"""Pictures of flat roads, painted through a camera model, for tests: each line lies
exactly where the test puts it.

`Road` is a picture that is painted step by step. `paint_lane` and `paint_motorway` are
two ready-made pictures: the lane of the classic recipes, and the road with several
lanes that shows a camera's pose. Drives with many frames are in
`tests.support.painted_drive`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera.model import Camera, CameraPose
from simulator.painted_drive import DASH_M, FARTHEST_M

WHITE = (225, 225, 220)
YELLOW = (215, 165, 40)
ASPHALT = (95, 95, 98)
SUNLIT_WHITE = (235, 235, 230)
SUNLIT_YELLOW = (230, 185, 50)
SUNLIT_ASPHALT = (105, 105, 105)
SKY = (120, 150, 190)
# Samples of one pixel in each direction, as shares of the pixel.
SUBPIXELS = (-0.375, -0.125, 0.125, 0.375)

# The camera that the published recipes were tuned on: its lens bends straight lines by
# up to 20 px at the corners.
RECIPE_CAMERA = Camera(
    1280,
    720,
    np.array([[1157.0, 0, 670], [0, 1152, 386], [0, 0, 1]]),
    np.array([-0.25, 0.05, -0.0009, 0.0008, 0.0]),
    CameraPose(height_m=1.2, pitch_rad=-0.026, yaw_rad=-0.022),
)

Inside = Callable[[np.ndarray, np.ndarray], np.ndarray]


def dashcam(width: int = 640, **pose: float) -> Camera:
    """A camera with distortion, 1.3 m above the road, that looks slightly up and to the
    right.
    """
    scale = width / 1280
    matrix = np.array(
        [[1150 * scale, 0, 640 * scale], [0, 1150 * scale, 370 * scale], [0, 0, 1]]
    )
    lens = Camera(
        width, width * 9 // 16, matrix, np.array([-0.24, 0.06, 0.0005, -0.0003, 0.0])
    )
    return lens.with_pose(
        CameraPose(**{"height_m": 1.3, "pitch_rad": -0.01, "yaw_rad": -0.012, **pose})
    )


@dataclass(frozen=True)
class Arc:
    """The centre line of a lane of constant curvature, and its coordinates.

    `curvature_per_m` > 0 bends left, `offset_m` > 0 puts the car left of the centre
    line, `heading_rad` > 0 turns the road left of the car's axis.
    """

    curvature_per_m: float = 0.0
    offset_m: float = 0.0
    heading_rad: float = 0.0

    def coordinates(self, points_m: np.ndarray) -> np.ndarray:
        """Arc length and lateral position (..., 2) of points (..., 2) on the road."""
        x = points_m[..., 0]
        y = points_m[..., 1] + self.offset_m
        cos = np.cos(self.heading_rad)
        sin = np.sin(self.heading_rad)
        x, y = cos * x + sin * y, cos * y - sin * x
        if abs(self.curvature_per_m) < 1e-9:
            return np.stack([x, y], axis=-1)
        radius = 1 / abs(self.curvature_per_m)
        side = np.sign(self.curvature_per_m)
        along = radius * np.arctan2(x, radius - side * y)
        return np.stack(
            [along, side * (radius - np.hypot(x, radius - side * y))], axis=-1
        )

    def lateral_m(self, shift_m: float, x_m: np.ndarray) -> np.ndarray:
        """Lateral position (N,) in the car's frame of the parallel arc `shift_m` left;
        for a heading of 0.
        """
        if abs(self.curvature_per_m) < 1e-9:
            return np.full_like(x_m, shift_m - self.offset_m)
        radius = 1 / self.curvature_per_m - shift_m
        return (
            shift_m
            - self.offset_m
            + radius
            - np.sign(radius) * np.sqrt(radius**2 - x_m**2)
        )


@lru_cache(maxsize=8)
def _road_points(
    size: tuple, matrix: tuple, distortion: tuple, pose: CameraPose
) -> tuple[int, list[np.ndarray]]:
    """First row that shows road, and road points of all pixels from there on, for
    several heights within a pixel.
    """
    camera = Camera(*size, np.reshape(matrix, (3, 3)), np.array(distortion), pose)
    top = max(0, int(camera.road_to_pixels(np.array([[FARTHEST_M, 0.0]]))[0, 1]) - 20)
    v, u = np.mgrid[top : camera.height, : camera.width].astype(float)
    rows = (np.column_stack([u.ravel(), (v + dv).ravel()]) for dv in SUBPIXELS)
    return top, [
        camera.pixels_to_road(pixels).reshape(*u.shape, 2).astype(np.float32)
        for pixels in rows
    ]


class Road:
    """A picture of a flat road to paint on.

    The coordinates of everything painted are arc length and lateral position along
    `arc`; without it these are x and y in the car's frame.
    """

    def __init__(
        self,
        camera: Camera,
        *,
        arc: Arc | None = None,
        asphalt: tuple = ASPHALT,
        noise: float = 2.0,
        seed: int = 0,
    ) -> None:
        self.camera, self.noise, self.seed = camera, noise, seed
        lens = tuple(camera.matrix.ravel()), tuple(camera.distortion)
        self._top, found = _road_points(camera.size, *lens, camera.pose)
        # x, y and lateral metres per column of all pixels, for each height within a
        # pixel
        self._samples = []
        for points in found:
            x, y = np.moveaxis(arc.coordinates(points) if arc else points, -1, 0).copy()
            self._samples.append((x, y, np.gradient(y, axis=1)))
        self.picture = np.full((camera.height, camera.width, 3), asphalt, np.float32)

    def cover(
        self, inside: Inside, candidates: np.ndarray | slice = np.s_[:]
    ) -> np.ndarray:
        """Share (height, width, 1) of each pixel that lies where `inside(x, y)` is
        true.
        """
        share = np.zeros((self.camera.height, self.camera.width, 1), np.float32)
        road = share[self._top :, :, 0]
        with np.errstate(invalid="ignore"):
            for sample in self._samples:
                x, y, across = (values[candidates] for values in sample)
                for du in SUBPIXELS:
                    road[candidates] += inside(x, y + du * across) & (x < FARTHEST_M)
        return share / len(SUBPIXELS) ** 2

    def paint(self, inside: Inside, colour: tuple) -> Road:
        """Paint the part of the road where `inside(x, y)` is true."""
        return self._blend(self.cover(inside), colour)

    def line(
        self,
        y_of_x: Callable[[np.ndarray], np.ndarray],
        *,
        colour: tuple = WHITE,
        width_m: float = 0.12,
        dash_m: tuple[float, float] | None = None,
        phase_m: float = 0.0,
    ) -> Road:
        """Paint a line; `dash_m` is (length, period), `phase_m` the place where a dash
        begins.
        """

        def inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            on = np.abs(y - y_of_x(x)) < width_m / 2
            return on & ((x - phase_m) % dash_m[1] < dash_m[0]) if dash_m else on

        # only pixels near the line are sampled finely
        near = [
            np.abs(y - y_of_x(x)) < width_m / 2 + np.abs(across)
            for x, y, across in self._samples
        ]
        return self._blend(self.cover(inside, np.any(near, axis=0)), colour)

    def lines(self, *lateral_m: float, **look: object) -> Road:
        """Paint lines along the road at these lateral positions; `look` as for
        `line`.
        """
        for y_m in lateral_m:
            self.line(lambda x, y_m=y_m: np.full_like(x, y_m), **look)
        return self

    def shade(self, inside: Inside, share: float) -> Road:
        """Darken the part of the road where `inside(x, y)` is true to `share` of its
        light.
        """
        return self._blend((1 - share) * self.cover(inside), (0, 0, 0))

    def surround(self, landscape: np.ndarray | tuple) -> Road:
        """Replace everything above the road by a colour or a picture."""
        return self._blend(1 - self.cover(lambda x, y: x > 0), landscape)

    def _blend(self, share: np.ndarray, colour: np.ndarray | tuple) -> Road:
        """Paint a colour, or a picture (height, width, 3), over this share (height,
        width, 1) of each pixel.
        """
        painted = share[..., 0] > 0
        below = self.picture[painted]
        share = share[painted]
        above = (
            colour[painted]
            if isinstance(colour, np.ndarray)
            else np.array(colour, np.float32)
        )
        self.picture[painted] = below + share * (above - below)
        return self

    def image(self) -> np.ndarray:
        """The picture (height, width, 3) uint8 with sensor noise."""
        rng = np.random.default_rng(self.seed)
        noisy = rng.normal(0, self.noise, self.picture.shape)
        noisy += self.picture
        return cv2.convertScaleAbs(np.maximum(noisy, 0, out=noisy))


def bushes(camera: Camera) -> np.ndarray:
    """A landscape (height, width, 3) for `Road.surround`.

    Equally bright bushes have several colours, which shows that the image has colours.
    """
    least = (60, 80, 30)
    most = (110, 120, 90)
    colours = np.random.default_rng(5).uniform(least, most, (23, 40, 3))
    return cv2.resize(
        colours.astype(np.float32), camera.size, interpolation=cv2.INTER_NEAREST
    )


LANE_WIDTH_M = 3.7


@dataclass(frozen=True)
class LaneRoad(Arc):
    """One sunlit lane between two lines; None leaves a line out.

    A shadow crosses it at the distances `shadow_m`.
    """

    left: tuple[int, int, int] | None = SUNLIT_YELLOW
    right: tuple[int, int, int] | None = SUNLIT_WHITE
    right_dashed: bool = False
    shadow_m: tuple[float, float] | None = None


def paint_lane(lane: LaneRoad, camera: Camera = RECIPE_CAMERA) -> np.ndarray:
    """Picture (height, width, 3) uint8 of one lane, 3.7 m wide."""
    road = Road(camera, arc=lane, asphalt=SUNLIT_ASPHALT)
    for colour, side, dash_m in (
        (lane.left, 1, None),
        (lane.right, -1, DASH_M if lane.right_dashed else None),
    ):
        if colour:
            road.lines(
                side * LANE_WIDTH_M / 2,
                colour=colour,
                width_m=0.15,
                dash_m=dash_m,
                phase_m=4.0,
            )
    if lane.shadow_m:
        near, far = lane.shadow_m
        road.shade(lambda x, y: (x > near) & (x < far), 0.43)
    return road.surround(SKY).image()


def paint_motorway(
    camera: Camera,
    *,
    curvature_per_m: float = 0.0,
    offset_m: float = 0.0,
    heading_rad: float = 0.0,
    lines: tuple[int, ...] = (-1, 0, 1, 2),
    solid: tuple[int, ...] = (0,),
    phase_m: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """Picture (height, width, 3) uint8 of lanes 3.66 m wide, with things next to the
    lines that are no lines.

    `lines` are numbered from left to right; 0, which is yellow, and 1 bound the ego
    lane. Lines that are not in `solid` are dashed, 3 m in 12 m.
    """
    rng = np.random.default_rng(seed)
    road = Road(
        camera, arc=Arc(curvature_per_m, offset_m, heading_rad), noise=4.0, seed=seed
    )
    road.picture = _enlarge(rng.normal(90, 12, (18, 32, 1)), camera)
    road.surround(
        _enlarge(
            rng.integers(40, 220, (camera.height // 12, camera.width // 12, 3)), camera
        )
    )
    road.paint(lambda x, y: (x > 4) & (x < 60) & (y > -0.9) & (y < 0.4), (70, 70, 72))
    for number in lines:
        dash_m = None if number in solid else (3.0, 12.0)
        colour = YELLOW if number == 0 else WHITE
        road.lines(
            3.66 * (0.5 - number), colour=colour, dash_m=dash_m, phase_m=1.0 + phase_m
        )
    _paint_car(road)
    return road.image()


def _enlarge(coarse: np.ndarray, camera: Camera) -> np.ndarray:
    """Smooth picture (height, width, 3) of the camera's size."""
    smooth = cv2.resize(
        coarse.astype(np.float32), camera.size, interpolation=cv2.INTER_LINEAR
    )
    return np.broadcast_to(
        np.atleast_3d(smooth), (camera.height, camera.width, 3)
    ).copy()


def _paint_car(road: Road) -> None:
    """Paint a pale box on the lane to the right, 25 m ahead."""
    (left, bottom), (right, top) = road.camera.road_to_pixels(
        np.array([[25.0, -2.9, 0.0], [25.0, -4.7, 1.4]])
    )
    road.picture[
        max(int(top), 0) : int(bottom) + 1, max(int(left), 0) : int(right) + 1
    ] = (190, 190, 200)
