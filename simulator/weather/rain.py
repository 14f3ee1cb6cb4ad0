"""Rain: drops and wiper on the windscreen, falling drops, and a wet road that reflects sky and lamps."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.painting.noise import band_noise_tile, fade, sample_noise
from simulator.road.ground import Ground
from simulator.weather.night import Lamp, lamp_pixels

# The view through drops is computed on every 2nd pixel.
DROP_DOWNSAMPLING = 2
# Pivot of the wiper as shares of the image's width and height, and its range of angles.
PIVOT, SWEEP_RAD = (0.30, 1.25), (-1.15, 1.05)
# Minification of a drop, which is a strong lens: it shows nearly the whole scene upside down.
DROP_MINIFICATION = 9.0
STREAK_DOWNSAMPLING = 4
# Reflectance of water at normal incidence.
WATER = 0.02
# Reflection of a lamp: standard deviations, vertical as a share of its depth below the horizon, horizontal in metres.
STREAK_LONG, STREAK_WIDE_M = 0.45, 0.16


@dataclass(frozen=True)
class Rain:
    """Strength of the rain: new drops on the visible part of the windscreen between two wipes, and falling drops.

    A wipe begins every `wipe_every_s`; the blade takes `wipe_s` to cross the image. `streaks` is the light of the
    falling drops; sunlit white paint is 1.
    """

    drops: int = 280
    wipe_every_s: float = 1.2
    wipe_s: float = 0.45
    streaks: float = 0.10


def add_falling_drops(light: np.ndarray, rain: Rain, *, seed: int) -> None:
    """Add motion-blurred falling drops, in place; each seed gives another pattern."""
    height, width = light.shape[:2]
    row, column = np.random.default_rng(seed).integers(0, 64, 2)
    streaks = _streaks(height, width)[row : row + height, column : column + width]
    cv2.scaleAdd(streaks, rain.streaks, light, dst=light)


def add_windscreen_drops(light: np.ndarray, rain: Rain, time_s: float, *, seed: int) -> np.ndarray:
    """The light (height, width, 3) float32 through the wet windscreen; the time gives drops and wiper."""
    height, width = light.shape[:2]
    small = cv2.resize(light, (width // DROP_DOWNSAMPLING, height // DROP_DOWNSAMPLING), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(small, (0, 0), 0.012 * height / DROP_DOWNSAMPLING)
    cover = np.zeros(small.shape[:2], np.float32)
    map_u, map_v = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in small.shape[1::-1]))
    for at_u, at_v, radius in windscreen_drops(rain, time_s, seed=seed) * [width, height, height] / DROP_DOWNSAMPLING:
        _lay_drop(cover, map_u, map_v, at_u, at_v, radius)
    _lay_blade(cover, map_u, map_v, rain, time_s)
    seen = cv2.remap(blurred, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    seen, cover = (cv2.resize(a, (width, height), interpolation=cv2.INTER_LINEAR) for a in (seen, cover))
    seen -= light
    share: np.ndarray = cv2.merge([cover] * 3)
    seen *= share
    seen += light
    return seen


def windscreen_drops(rain: Rain, time_s: float, *, seed: int) -> np.ndarray:
    """Drops (N, 3) at a time: u as a share of the width, v and radius as shares of the height."""
    cycle = int(np.floor(time_s / rain.wipe_every_s))
    kept = [_drops_of_cycle(rain, number, time_s, seed) for number in (cycle - 1, cycle)]
    return np.concatenate(kept)


def _drops_of_cycle(rain: Rain, number: int, time_s: float, seed: int) -> np.ndarray:
    """Drops that fell between wipes `number` and `number + 1` and are not wiped off yet."""
    rng = np.random.default_rng([seed, 91, number + 1000])
    u, v = rng.uniform(0, 1, (2, rain.drops))
    radius = 0.005 + 0.021 * rng.uniform(0, 1, rain.drops) ** 3
    born = (number + rng.uniform(0, 1, rain.drops)) * rain.wipe_every_s
    # Share of the sweep at which the blade meets the drop.
    angle = np.arctan2(u - PIVOT[0], (PIVOT[1] - v) * 9 / 16)
    share = np.clip((angle - SWEEP_RAD[0]) / (SWEEP_RAD[1] - SWEEP_RAD[0]), 0, 1)
    wiped = number * rain.wipe_every_s + share * rain.wipe_s
    wiped = np.where(wiped <= born, wiped + rain.wipe_every_s, wiped)
    there = (born <= time_s) & (time_s < wiped)
    return np.column_stack([u, v, radius])[there]


def _lay_drop(cover, map_u, map_v, at_u: float, at_v: float, radius: float) -> None:
    """Add the coverage and the refracted view of a drop, in place."""
    reach = int(1.6 * radius) + 2
    part = np.s_[max(int(at_v) - reach, 0) : int(at_v) + reach + 1, max(int(at_u) - reach, 0) : int(at_u) + reach + 1]
    rows, columns = (np.arange(size, dtype=np.float32)[cut] for size, cut in zip(cover.shape, part, strict=True))
    du, dv = columns - np.float32(at_u), rows[:, None] - np.float32(at_v)
    # The edge of the drop is wide, because the camera is focused on the road.
    inside = np.clip(1.25 - np.hypot(du, dv * np.float32(0.85)) / np.float32(radius), 0, 0.75) / np.float32(0.75)
    better = inside > cover[part]
    map_u[part] = np.where(better, at_u - DROP_MINIFICATION * du, map_u[part])
    map_v[part] = np.where(better, at_v - DROP_MINIFICATION * dv, map_v[part])
    cover[part] = np.maximum(cover[part], inside * np.float32(0.9))


def _lay_blade(cover: np.ndarray, map_u: np.ndarray, map_v: np.ndarray, rain: Rain, time_s: float) -> None:
    """Add the moving wiper blade, in place: a blurred bar with the colour of the bottom of the image."""
    height, width = cover.shape
    share = (time_s % rain.wipe_every_s) / rain.wipe_s
    if share >= 1:
        return
    angle = SWEEP_RAD[0] + share * (SWEEP_RAD[1] - SWEEP_RAD[0])
    pivot = np.array([PIVOT[0] * width, PIVOT[1] * height])
    tip = pivot + 1.25 * height * np.array([np.sin(angle), -np.cos(angle)])
    blade = np.zeros_like(cover)
    start, end = (np.rint(p).astype(int).tolist() for p in (pivot, tip))
    cv2.line(blade, start, end, (0.95,), max(1, round(0.02 * height)), cv2.LINE_AA)
    blade = cv2.GaussianBlur(blade, (0, 0), 0.006 * height)
    over = blade > cover
    map_u[over], map_v[over] = width / 2, height - 2
    np.maximum(cover, blade, out=cover)


@lru_cache(maxsize=2)
def _streaks(height: int, width: int) -> np.ndarray:
    """Short, nearly vertical, blurred streaks in grey RGB; 64 pixels larger than the image to allow shifts."""
    rng = np.random.default_rng(92)
    layer = np.zeros((height + 64, width + 64), np.float32)
    for _ in range(260):
        u, v = rng.uniform(0, layer.shape[1]), rng.uniform(0, layer.shape[0])
        # Drops move away from the focus of expansion.
        toward = np.array([(u / layer.shape[1] - 0.5) * 0.5, 1.0]) * height * rng.uniform(0.02, 0.07)
        start, end = (np.rint(np.array(p) * 16).astype(int).tolist() for p in ((u, v), (u + toward[0], v + toward[1])))
        cv2.line(layer, start, end, (float(rng.uniform(0.2, 1.0)),), 1, cv2.LINE_AA, 4)
    return cv2.merge([cv2.GaussianBlur(layer, (0, 0), 0.8)] * 3)


@dataclass(frozen=True)
class Wet:
    """Wetness: `film` is the share of the surface under water, `darkening` the factor on the dry reflectance."""

    film: float = 0.32
    darkening: float = 0.55

    def mirror_share(self, ground: Ground, height_m: float, *, seed: int) -> np.ndarray:
        """Specular reflectance (rows, width) of the road: Schlick's approximation times the coverage by puddles.

        The coverage varies by noise, as ruts hold more water.
        """
        upright = np.float32(height_m) / np.sqrt(ground.distance * ground.distance + np.float32(height_m**2))
        mirrored = np.float32(WATER) + np.float32(1 - WATER) * (1 - upright) ** 5
        tile = band_noise_tile(seed + 81, octaves=3)
        puddles = sample_noise(tile, ground.along, ground.d, wave_s_m=5.0, wave_d_m=0.45) * fade(
            ground.footprint_s, 12.0
        )
        return mirrored * np.clip(np.float32(self.film) * (1 + np.float32(0.22) * puddles), 0, 0.95)


def add_lamp_reflections(
    light: np.ndarray, camera: Camera, lamps: list[Lamp], share: np.ndarray, open_to: np.ndarray
) -> None:
    """Add the reflections of lamps in the road to the light (height, width, 3), in place.

    `share` (rows, width) is the reflectance of `Wet.mirror_share` for the lowest rows of the image, `open_to`
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
