"""Wet road: darker, with reflections of sky and lamps in a film of water."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.painting.texture import band_noise_tile, fade, sample_noise
from simulator.road.ground import Ground
from simulator.weather.night import Lamp, lamp_pixels

STREAK_DOWNSAMPLING = 4
# Reflectance of water at normal incidence.
WATER = 0.02
# Reflection of a lamp: standard deviations, vertical as a share of its depth below the horizon, horizontal in metres.
STREAK_LONG, STREAK_WIDE_M = 0.45, 0.16


@dataclass(frozen=True)
class Wet:
    """Wetness: `film` is the share of the surface under water, `darkening` the factor on the dry reflectance."""

    film: float = 0.32
    darkening: float = 0.55

    def mirror_share(self, ground: Ground, height_m: float, *, station_m: float, seed: int) -> np.ndarray:
        """Specular reflectance (rows, width) of the road: Schlick's approximation times the coverage by puddles.

        The coverage varies by noise, as ruts hold more water.
        """
        upright = np.float32(height_m) / np.sqrt(ground.distance * ground.distance + np.float32(height_m**2))
        mirrored = np.float32(WATER) + np.float32(1 - WATER) * (1 - upright) ** 5
        tile, s = band_noise_tile(seed + 81, octaves=3), ground.s + np.float32(station_m)
        puddles = sample_noise(tile, s, ground.d, wave_s_m=5.0, wave_d_m=0.45) * fade(ground.footprint_s, 12.0)
        return mirrored * np.clip(np.float32(self.film) * (1 + np.float32(0.22) * puddles), 0, 0.95)


def add_lamp_reflections(
    light: np.ndarray, camera: Camera, lamps: list[Lamp], share: np.ndarray, open_to: np.ndarray
) -> None:
    """Add the reflections of lamps in the road to the light (height, width, 3), in place.

    `share` (rows, width) is the reflectance of `Wet.mirror_share` for the lowest rows of the picture, `open_to`
    (height, width) the mask of the visible road.
    """
    height, width = light.shape[:2]
    layer = np.zeros((height // STREAK_DOWNSAMPLING, width // STREAK_DOWNSAMPLING, 3), np.float32)
    rows, columns = np.mgrid[: len(layer), : layer.shape[1]].astype(np.float32) * STREAK_DOWNSAMPLING
    horizon = float(camera.road_to_pixels(np.array([[3000.0, 0.0]]))[0, 1])
    for lamp, (u, v) in zip(lamps, lamp_pixels(camera, lamps, mirrored=True), strict=True):
        if not (-50 < u < width + 50 and v < 2 * height):
            continue
        wide = max(camera.matrix[0, 0] * STREAK_WIDE_M / lamp.distance_m, 2.0)
        long = max(STREAK_LONG * (v - horizon), 4.0)
        # The lamp's energy is spread over the streak.
        energy = (camera.matrix[0, 0] * lamp.radius_m / lamp.distance_m) ** 2 / (2 * wide * long)
        at = slice(
            max(int((u - 3 * wide) / STREAK_DOWNSAMPLING), 0), max(int((u + 3 * wide) / STREAK_DOWNSAMPLING) + 2, 0)
        )
        streak = np.exp(-((columns[:, at] - u) ** 2) / (2 * wide**2) - (rows[:, at] - v) ** 2 / (2 * long**2))
        layer[:, at] += (np.float32(energy) * streak)[..., None] * lamp.light.astype(np.float32)
    layer = cv2.resize(layer, (width, height), interpolation=cv2.INTER_LINEAR)[height - len(share) :]
    layer *= cv2.merge([share * open_to[height - len(share) :]] * 3)
    light[height - len(share) :] += layer
