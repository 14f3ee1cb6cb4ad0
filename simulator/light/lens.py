"""The camera, from linear light to 8-bit images, and automatic exposure with delay.

It has a lens, a sensor and a tone curve. The exposure of a camera depends on earlier
frames. There is no state between frames here: the light along the road already driven
is integrated again for each frame. Frames can therefore be rendered in any order and in
parallel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from simulator.light.sunlight import Shade, light_along
from simulator.painting import split_channels, three_channels
from simulator.road.surface import MATERIALS, Surface

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
# Entries of the tone curve's table: neighbouring entries differ by one level at most.
TONE_STEPS = 4096
MAX_LIGHT = 4.0
# Toe of the tone curve: light of this value is halved. Above the knee is the shoulder.
TOE = 0.012
KNEE = 0.55
# Road luminance at which the automatic exposure is neutral: used asphalt.
REFERENCE_LUMINANCE = 0.055
# Luminances of the road below which the gain no longer rises: of the automatic
# exposure, and of a lens without it.
DARKEST = 0.006
DARKEST_ROAD = 0.002
# The noise tile is larger than the image, to allow shifts.
SPARE_PX = 64
# Metering area on the road: metres ahead, lateral positions, and sampling step along
# the road.
METERED_M = (5.0, 25.0)
METERED_LATERALS_M = (-1.5, 0.0, 1.5)
SAMPLE_STEP_M = 1.0
# Time step of the integral, and its length in time constants (e^-6 = 0.2 % is left).
SAMPLE_STEP_S = 0.04
MEMORY_TIME_CONSTANTS = 6.0


@dataclass(frozen=True)
class Lens:
    """Parameters of the camera's imaging.

    `blur_px` and `chroma_blur_px` are standard deviations of the optical blur, and of
    that of the chroma channels, which cameras store at half resolution. `vignette` is
    the share of light lost in the corners. `noise` is the standard deviation of the
    sensor noise at white, as a share of white; proportional to the square root of
    light. `sharpening` is the strength of the unsharp mask, `exposure` the exposure
    compensation in stops. An `adaptation` of 0 is a fixed exposure; 1 renders every
    road equally bright.
    """

    blur_px: float = 0.6
    vignette: float = 0.16
    noise: float = 0.007
    sharpening: float = 0.55
    exposure: float = 0.0
    adaptation: float = 0.10
    chroma_blur_px: float = 0.0


def develop(
    light: np.ndarray,
    lens: Lens,
    *,
    road_light: float,
    seed: int,
) -> np.ndarray:
    """Image (height, width, 3) uint8 that the camera stores of linear light.

    The light is RGB float32, 1.0 = sunlit white paint. `road_light` is the mean
    luminance of the visible road, which the exposure adapts to. `seed` is that of the
    noise, different for each frame.
    """
    height, width = light.shape[:2]
    relative = REFERENCE_LUMINANCE / max(road_light, DARKEST_ROAD)
    gain = np.float32(2.0**lens.exposure * relative**lens.adaptation)
    if lens.blur_px:
        light = cv2.GaussianBlur(light, (0, 0), lens.blur_px)

    # The square root of light has photon noise of constant variance. In place, because
    # the image is large.
    root = light * three_channels(gain * _vignette(height, width, lens.vignette))
    np.clip(root, 0, MAX_LIGHT, out=root)
    np.sqrt(root, out=root)
    root += np.float32(lens.noise / 2) * _noise(height, width, seed)

    root *= np.float32((TONE_STEPS - 1) / np.sqrt(MAX_LIGHT))
    np.clip(root, 0, TONE_STEPS - 1, out=root)
    image = cv2.LUT(root.astype(np.uint16), _tone_curve())
    if lens.sharpening:
        smooth = cv2.GaussianBlur(image, (0, 0), 1.1)
        image = cv2.addWeighted(image, 1 + lens.sharpening, smooth, -lens.sharpening, 0)
    return _blur_chroma(image, lens.chroma_blur_px) if lens.chroma_blur_px else image


def _blur_chroma(image: np.ndarray, blur_px: float) -> np.ndarray:
    luma, *chroma = split_channels(cv2.cvtColor(image, cv2.COLOR_RGB2YCrCb))
    planes = [luma]
    for plane in chroma:
        half = cv2.GaussianBlur(cv2.pyrDown(plane), (0, 0), blur_px / 2)
        planes.append(cv2.resize(half, luma.shape[::-1]))
    return cv2.cvtColor(cv2.merge(planes), cv2.COLOR_YCrCb2RGB)


@lru_cache(maxsize=4)
def _vignette(
    height: int,
    width: int,
    strength: float,
) -> np.ndarray:
    v, u = np.mgrid[:height, :width].astype(np.float32)
    distance2 = (u - width / 2) ** 2 + (v - height / 2) ** 2
    corner2 = (width**2 + height**2) / 4
    return 1 - np.float32(strength) * (distance2 / corner2)


@lru_cache(maxsize=2)
def _noise_tile(height: int, width: int) -> np.ndarray:
    """Normal noise with the correlation of demosaicing, larger than the image."""
    rng = np.random.default_rng(0)
    shape = (height + SPARE_PX, width + SPARE_PX, 3)
    white = rng.standard_normal(shape).astype(np.float32)
    noise = cv2.GaussianBlur(white, (0, 0), 0.6)
    return noise / noise.std()


def _noise(
    height: int,
    width: int,
    seed: int,
) -> np.ndarray:
    """The noise tile, randomly shifted and flipped.

    That is much faster than new noise for each frame.
    """
    rng = np.random.default_rng(seed)
    row, column = rng.integers(0, SPARE_PX, 2)
    down = rng.choice([-1, 1])
    right = rng.choice([-1, 1])
    tile = _noise_tile(height, width)
    shifted = tile[row : row + height, column : column + width]
    return shifted[::down, ::right]


@lru_cache(maxsize=1)
def _tone_curve() -> np.ndarray:
    """sRGB after a toe, and a shoulder that keeps white paint from clipping."""
    light = np.linspace(0, np.sqrt(MAX_LIGHT), TONE_STEPS) ** 2
    light = light**2 / (light + TOE)

    over = np.maximum(light - KNEE, 0)
    shoulder = 1 - np.exp(-over / (1 - KNEE) * 1.35)
    light = np.minimum(light, KNEE) + (1 - KNEE) * shoulder * 1.02

    levels = np.rint(255 * srgb(np.clip(light, 0, 1))).astype(np.uint8)
    # cv2.LUT needs an entry for every 16-bit value.
    return np.pad(levels, (0, 65536 - TONE_STEPS), mode="edge")


def srgb(light: np.ndarray) -> np.ndarray:
    """sRGB values of linear light, both >= 0 and 1 at white (IEC 61966-2-1)."""
    power = 1.055 * light ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, power)


@dataclass(frozen=True)
class AutoExposure:
    """Parameters of the automatic exposure.

    After `time_constant_s` the exposure (in stops) has followed 63 % of a sudden change
    of light. A `strength` of 0 is a fixed exposure; 1 finally renders every road
    equally bright.
    """

    time_constant_s: float = 0.7
    strength: float = 0.8

    def adapted_light(
        self,
        station_m: Callable[[float], float],
        luminance: Callable[[np.ndarray], np.ndarray],
        time_s: float,
    ) -> float:
        """Luminance of the road to which the exposure has adapted at `time_s`.

        `station_m` is a function from time in seconds to arc length of the car in
        metres, `luminance` one from arc lengths (N,) to luminance (N,) of the road.
        """
        memory_s = MEMORY_TIME_CONSTANTS * self.time_constant_s
        age_s = np.arange(0.0, memory_s, SAMPLE_STEP_S)
        stations = np.array([station_m(time_s - age) for age in age_s.tolist()])
        stops = np.log2(np.maximum(_metered(stations, luminance), DARKEST))
        weight = np.exp(-age_s / self.time_constant_s)
        return float(2.0 ** ((weight * stops).sum() / weight.sum()))

    def lens(self, lens: Lens, adapted_light: float) -> Lens:
        """The lens with this strength of adaptation.

        It has the photon noise that the gain amplifies.
        """
        gain = (REFERENCE_LUMINANCE / adapted_light) ** self.strength
        noise = lens.noise * float(np.sqrt(max(gain, 1.0)))
        return replace(lens, adaptation=self.strength, noise=noise)


def _metered(
    stations_m: np.ndarray,
    luminance: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Mean luminance (N,) of the metering area for the car at stations (N,)."""
    near_m, far_m = METERED_M
    first = stations_m.min() + near_m
    last = stations_m.max() + far_m + 2 * SAMPLE_STEP_M
    s = np.arange(first, last, SAMPLE_STEP_M)

    # Integral at any arc length; each sample is valid for one step.
    integral = np.concatenate([[0.0], np.cumsum(luminance(s)) * SAMPLE_STEP_M])
    before = s[0] - SAMPLE_STEP_M / 2
    knots = np.concatenate([[before], s + SAMPLE_STEP_M / 2])
    near = np.interp(stations_m + near_m, knots, integral)
    far = np.interp(stations_m + far_m, knots, integral)
    return (far - near) / (far_m - near_m)


def road_luminance(
    s_m: np.ndarray,
    surface: Surface,
    shades: tuple[Shade, ...],
    *,
    seed: int,
) -> np.ndarray:
    """Luminance (N,) of the pavement at arc lengths (N,), without texture.

    It is averaged over the lane.
    """
    lights = []
    for lateral_m in METERED_LATERALS_M:
        d_m = np.full_like(s_m, lateral_m)
        lights.append(light_along(shades, s_m, d_m, seed=seed))
    light = np.mean(lights, axis=0)

    zones = sorted(surface.zones, key=lambda zone: zone.start_m)
    starts = [zone.start_m for zone in zones[1:]]
    zone_number = np.searchsorted(starts, s_m, side="right")
    colours = np.array([MATERIALS[zone.material].colour for zone in zones], np.float32)
    return (light * colours[zone_number]) @ LUMINANCE
