"""Drives along painted roads, with the truth of every frame: quick to make, for fits and tests over time.

A road is a clothoid line (`simulator.road.geometry`), and the car moves as in the
rendered drives (`Motion`). Stripes are polygons, which takes a few milliseconds a
frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera import Camera, CameraPose
from simulator.rendering.drive import Motion
from simulator.road.geometry import RoadGeometry, offset_point
from simulator.road.truth import Truth, lane_truth

# Length and period of the dashes of an American motorway.
DASH_M = (3.05, 12.2)
# Nothing is painted farther away.
FARTHEST_M = 150.0
WORN_WHITE, WORN_YELLOW, GREY, TAR = (
    (215, 215, 210),
    (205, 160, 45),
    (98, 98, 98),
    (60, 60, 62),
)
SPARE_PX = 64
AHEAD_M = np.concatenate(
    [np.arange(1.0, 25, 0.5), np.arange(25.0, 60, 1.0), np.arange(60.0, 161, 4)]
)
CAMERA = Camera(
    1280,
    720,
    np.array([[1150.0, 0, 640], [0, 1150, 370], [0, 0, 1]]),
    np.array([-0.24, 0.02, 0.0005, -0.0003, 0.0]),
    CameraPose(height_m=1.3, pitch_rad=-0.012, yaw_rad=-0.012, roll_rad=0.004),
)


@dataclass(frozen=True)
class Stripe:
    """A line, a seam or a shadow along the road, `lateral_m` left of the reference line.

    `dash_m` is (length, period), `phase_m` the arc length at which a dash begins. The
    stripe is painted between the arc lengths `along_m`, but not at the times `gone_s`
    (from, to).
    """

    lateral_m: float
    width_m: float = 0.13
    colour: tuple[int, int, int] = WORN_WHITE
    dash_m: tuple[float, float] | None = None
    phase_m: float = 0.0
    gone_s: tuple[float, float] = (np.inf, np.inf)
    along_m: tuple[float, float] = (-np.inf, np.inf)

    def pieces(self, station_m: float) -> list[tuple[float, float]]:
        """(from, to) of each visible piece, metres ahead of a car at the arc length `station_m`."""
        low, high = (
            max(1.0, self.along_m[0] - station_m),
            min(FARTHEST_M, self.along_m[1] - station_m),
        )
        if not self.dash_m:
            return [(low, high)] if high > low else []
        length, period = self.dash_m
        first = np.floor((low + station_m - self.phase_m) / period)
        starts = (
            self.phase_m
            + period * np.arange(first, first + (high - low) / period + 2)
            - station_m
        )
        pieces = [(max(a, low), min(a + length, high)) for a in starts]
        return [(a, b) for a, b in pieces if b > a + 0.05]


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
    contrast: float = 1.0
    black_s: tuple[float, float] = (np.inf, np.inf)
    seed: int = 0

    def camera_at(self, time_s: float) -> Camera:
        """Camera with the pitch at a time."""
        pose = self.camera.require_pose()
        return self.camera.with_pose(
            replace(pose, pitch_rad=pose.pitch_rad + self.motion.pitch(time_s))
        )

    def truth(self, time_s: float, lane_m: tuple[float, float] | None = None) -> Truth:
        """Ground truth of the frame at `time_s`."""
        pose, pitch_rad = (
            self.motion.pose(time_s),
            self.camera_at(time_s).require_pose().pitch_rad,
        )
        return lane_truth(
            self.road, pose, lane_m or self.lane_m, time_s=time_s, pitch_rad=pitch_rad
        )

    def frame(self, time_s: float) -> np.ndarray:
        """The frame (height, width, 3) uint8 at `time_s`; the sky is as grey as the road."""
        height, width = self.camera.height, self.camera.width
        if self.black_s[0] <= time_s < self.black_s[1]:
            return np.zeros((height, width, 3), np.uint8)
        pose, camera = self.motion.pose(time_s), self.camera_at(time_s)
        # the reference line and its normal in the car's frame; all stripes are offsets
        # along that normal
        base, left_1_m = (
            pose.to_car(self.road, offset_point(self.road, pose.s_m + AHEAD_M, d))
            for d in (0.0, 1.0)
        )
        image = np.full((height, width, 3), GREY[0], np.uint8)
        for stripe in (*self.ground, *self.lines):
            if not stripe.gone_s[0] <= time_s < stripe.gone_s[1]:
                for corners in self._outlines(
                    stripe, pose.s_m, camera, base, left_1_m - base
                ):
                    cv2.fillPoly(
                        image, [corners], tuple(self._colour(stripe)), cv2.LINE_AA, 4
                    )
        for shade in self.shades:
            mask = np.zeros((height, width), np.uint8)
            cv2.fillPoly(
                mask,
                list(self._outlines(shade, pose.s_m, camera, base, left_1_m - base)),
                255,
                8,
                4,
            )
            cv2.copyTo(cv2.convertScaleAbs(image, alpha=0.45), mask, image)
        rng = np.random.default_rng(self.seed * 10007 + round(time_s * 1000))
        top, left = rng.integers(0, SPARE_PX, 2)
        grain = _grain(height, width, self.noise)[
            top : top + height, left : left + width
        ]
        return cv2.add(image, grain, dtype=cv2.CV_8U)

    def _colour(self, stripe: Stripe) -> list[float]:
        return [
            a + self.contrast * (c - a)
            for c, a in zip(stripe.colour, GREY, strict=True)
        ]

    def _outlines(
        self,
        stripe: Stripe,
        station_m: float,
        camera: Camera,
        base: np.ndarray,
        normal: np.ndarray,
    ) -> Iterator[np.ndarray]:
        """Corners (N, 2) int32 of each painted piece of a stripe, in sixteenths of a pixel."""
        borders = []
        for low, high in stripe.pieces(station_m):
            ahead = np.unique(np.clip(AHEAD_M, low, high))
            sides = [
                base + (stripe.lateral_m + half * stripe.width_m) * normal
                for half in (0.5, -0.5)
            ]
            left, right = (
                np.stack([np.interp(ahead, AHEAD_M, xy) for xy in side.T], axis=1)
                for side in sides
            )
            borders.append(np.vstack([left, right[::-1]]))
        if borders:
            pixels = np.round(
                camera.road_to_pixels(np.vstack(borders)).clip(-4000, 5000) * 16
            )
            for corners in np.split(
                pixels, np.cumsum([len(border) for border in borders])[:-1]
            ):
                corners = corners[np.isfinite(corners).all(axis=1)]
                if len(corners) > 2:
                    yield corners.astype(np.int32)


@lru_cache(maxsize=4)
def _grain(height: int, width: int, std: float) -> np.ndarray:
    """Noise (height, width, 3), cached: drawing the numbers for each frame costs 50 ms."""
    return np.round(
        np.random.default_rng(1).normal(
            0, std, (height + SPARE_PX, width + SPARE_PX, 3)
        )
    ).astype(np.int16)
