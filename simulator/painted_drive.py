"""Drives along painted roads, with the truth of every frame.

They are quick to make, for fits and tests over time. A road is a clothoid line
(`simulator.road.geometry`), and the car moves as in the rendered drives (`Motion`).
Stripes are polygons, which takes a few milliseconds a frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera.model import Camera, CameraPose
from simulator.rendering.drive import Motion
from simulator.road.geometry import RoadGeometry, VehiclePose
from simulator.road.truth import Truth, lane_truth

# Length and period of the dashes of an American motorway.
DASH_M = (3.05, 12.2)
# Nothing is painted farther away.
FARTHEST_M = 150.0
WORN_WHITE = (215, 215, 210)
WORN_YELLOW = (205, 160, 45)
GREY = (98, 98, 98)
TAR = (60, 60, 62)
# The grain is larger than the image, to allow shifts.
SPARE_PX = 64
# Pieces of stripes shorter than this are left out.
SHORTEST_M = 0.05
# Limits of pixel coordinates, outside any image, and their fractional bits.
MIN_PX = -4000
MAX_PX = 5000
_SHIFT = 4
AHEAD_M = np.concatenate(
    [
        np.arange(1.0, 25, 0.5),
        np.arange(25.0, 60, 1.0),
        np.arange(60.0, 161, 4),
    ]
)
CAMERA = Camera(
    1280,
    720,
    np.array(
        [
            [1150.0, 0, 640],
            [0, 1150, 370],
            [0, 0, 1],
        ]
    ),
    np.array([-0.24, 0.02, 0.0005, -0.0003, 0.0]),
    CameraPose(height_m=1.3, pitch_rad=-0.012, yaw_rad=-0.012, roll_rad=0.004),
)


@dataclass(frozen=True)
class Stripe:
    """A line, a seam or a shadow along the road.

    It is `lateral_m` left of the reference line. `dash_m` is (length, period),
    `phase_m` the arc length at which a dash begins. The stripe is painted between the
    arc lengths `along_m`, but not at the times `gone_s` (from, to).
    """

    lateral_m: float
    width_m: float = 0.13
    colour: tuple[int, int, int] = WORN_WHITE
    dash_m: tuple[float, float] | None = None
    phase_m: float = 0.0
    gone_s: tuple[float, float] = (np.inf, np.inf)
    along_m: tuple[float, float] = (-np.inf, np.inf)

    def pieces(self, station_m: float) -> list[tuple[float, float]]:
        """(from, to) of each visible piece, metres ahead of a car.

        The car is at the arc length `station_m`.
        """
        low = max(1.0, self.along_m[0] - station_m)
        high = min(FARTHEST_M, self.along_m[1] - station_m)
        if not self.dash_m:
            return [(low, high)] if high > low else []

        length, period = self.dash_m
        first = np.floor((low + station_m - self.phase_m) / period)
        numbers = np.arange(first, first + (high - low) / period + 2)
        pieces = []
        for start in self.phase_m + period * numbers - station_m:
            piece_low = max(start, low)
            piece_high = min(start + length, high)
            if piece_high > piece_low + SHORTEST_M:
                pieces.append((piece_low, piece_high))
        return pieces


@dataclass(frozen=True, eq=False)
class PaintedDrive:
    """A road with stripes on it, and the car's motion along it.

    `lane_m` are the lateral positions of the ego lane's lines at the start. Between the
    times `black_s` (from, to) all frames are black.
    """

    road: RoadGeometry
    lines: tuple[Stripe, ...]
    motion: Motion = Motion(speed_mps=25.0)
    lane_m: tuple[float, float] = (1.8, -1.8)
    ground: tuple[Stripe, ...] = ()
    shades: tuple[Stripe, ...] = ()
    camera: Camera = CAMERA
    noise: float = 2.5
    black_s: tuple[float, float] = (np.inf, np.inf)
    seed: int = 0

    def camera_at(self, time_s: float) -> Camera:
        """Camera with the pitch and the roll at a time."""
        return self.motion.moved(self.camera, time_s)

    def truth(
        self,
        time_s: float,
        lane_m: tuple[float, float] | None = None,
    ) -> Truth:
        """Ground truth of the frame at `time_s`."""
        return lane_truth(
            self.road,
            self.motion.pose(time_s),
            lane_m or self.lane_m,
            time_s=time_s,
            pitch_rad=self.camera_at(time_s).require_pose().pitch_rad,
        )

    def frame(self, time_s: float) -> np.ndarray:
        """The frame (height, width, 3) uint8 at `time_s`.

        The sky is as grey as the road.
        """
        height = self.camera.height
        width = self.camera.width
        if self.black_s[0] <= time_s < self.black_s[1]:
            return np.zeros((height, width, 3), np.uint8)

        image = np.full((height, width, 3), GREY[0], np.uint8)
        for stripe in (*self.ground, *self.lines):
            if not stripe.gone_s[0] <= time_s < stripe.gone_s[1]:
                for corners in self._outlines(stripe, time_s):
                    cv2.fillPoly(image, [corners], stripe.colour, cv2.LINE_AA, _SHIFT)

        for shade in self.shades:
            mask = np.zeros((height, width), np.uint8)
            outlines = self._outlines(shade, time_s)
            cv2.fillPoly(mask, outlines, 255, cv2.LINE_8, _SHIFT)
            cv2.copyTo(cv2.convertScaleAbs(image, alpha=0.45), mask, image)

        rng = np.random.default_rng(self.seed * 10007 + round(time_s * 1000))
        top, left = rng.integers(0, SPARE_PX, 2)
        grain = _grain(height, width, self.noise)
        part = grain[top : top + height, left : left + width]
        return cv2.add(image, part, dtype=cv2.CV_8U)

    def _outlines(
        self,
        stripe: Stripe,
        time_s: float,
    ) -> list[np.ndarray]:
        """Corners (N, 2) int32 of each painted piece, in sixteenths of a pixel."""
        pose = self.motion.pose(time_s)
        base, normal = _reference_line(self.road, pose)
        left_m = stripe.lateral_m + 0.5 * stripe.width_m
        right_m = stripe.lateral_m - 0.5 * stripe.width_m
        borders = []
        for low, high in stripe.pieces(pose.s_m):
            ahead = np.unique(np.clip(AHEAD_M, low, high))
            left = _interpolate(base + left_m * normal, ahead)
            right = _interpolate(base + right_m * normal, ahead)
            borders.append(np.vstack([left, right[::-1]]))
        if not borders:
            return []

        # One projection for all pieces; pieces outside the view of the lens are left
        # out.
        pixels = self.camera_at(time_s).road_to_pixels(np.vstack(borders))
        corners = np.round(pixels.clip(MIN_PX, MAX_PX) * (1 << _SHIFT))
        ends = np.cumsum([len(border) for border in borders])
        outlines = []
        for outline in np.split(corners, ends[:-1]):
            outline = outline[np.isfinite(outline).all(axis=1)]
            if len(outline) > 2:
                outlines.append(outline.astype(np.int32))
        return outlines


@lru_cache(maxsize=4)
def _reference_line(
    road: RoadGeometry, pose: VehiclePose
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) of the reference line at AHEAD_M, and normals, in the car's frame.

    All stripes are offsets along the normals.
    """
    s = pose.s_m + AHEAD_M
    base = pose.line_to_car(road, s, 0.0)
    return base, pose.line_to_car(road, s, 1.0) - base


def _interpolate(
    line_m: np.ndarray,
    ahead_m: np.ndarray,
) -> np.ndarray:
    """Points (M, 2) of a line (N, 2), which is given at AHEAD_M."""
    x, y = line_m.T
    x = np.interp(ahead_m, AHEAD_M, x)
    y = np.interp(ahead_m, AHEAD_M, y)
    return np.stack([x, y], axis=1)


@lru_cache(maxsize=4)
def _grain(
    height: int,
    width: int,
    std: float,
) -> np.ndarray:
    """Noise (height, width, 3), cached: drawing it for each frame costs 50 ms."""
    shape = (height + SPARE_PX, width + SPARE_PX, 3)
    noise = np.random.default_rng(1).normal(0, std, shape)
    return np.round(noise).astype(np.int16)
