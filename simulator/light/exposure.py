"""Automatic exposure that follows the light of the road with delay, as a pure function of the drive and the moment.

A camera's exposure at a moment depends on what it saw before. Instead of a state that is carried from frame to frame,
the light along the way already driven is integrated again for each frame, on a handful of points: so frames can be
rendered in any order, and in several processes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from simulator.light.lens import LUMINANCE, REFERENCE_LUMINANCE, Lens
from simulator.light.sunlight import Shade, light_along
from simulator.road.surface import MATERIALS, Surface

# Where on the road the camera meters, metres ahead and to the left, and how finely the way there is sampled.
METERED_M = (5.0, 25.0)
METERED_LATERALS_M = (-1.5, 0.0, 1.5)
SAMPLE_STEP_M = 1.0
# Steps of the integral over the past; after so many time constants the past no longer counts (e^-6 = 0.2 %).
SAMPLE_STEP_S = 0.04
MEMORY_TIME_CONSTANTS = 6.0


@dataclass(frozen=True)
class AutoExposure:
    """How the exposure follows the road.

    Parameters
    ----------
    time_constant_s : float
        After a sudden change of light the exposure (in stops) has done 63 % of its way.
    strength : float
        0: fixed exposure; 1: the road always comes out equally bright in the end.
    darkest : float
        Luminance of a road below which the gain grows no more.
    """

    time_constant_s: float = 0.7
    strength: float = 0.8
    darkest: float = 0.006

    def __post_init__(self) -> None:
        if self.time_constant_s <= 0:
            raise ValueError(f"time_constant_s must be positive, not {self.time_constant_s}.")

    def adapted_light(self, station_m: Callable[[float], float], road_light: RoadLight, time_s: float) -> float:
        """Luminance of the road to which the exposure has adapted at `time_s`.

        Parameters
        ----------
        station_m : callable
            Arc length of the car at a moment, seconds to metres.
        road_light : RoadLight
        time_s : float
        """
        age_s = np.arange(0.0, MEMORY_TIME_CONSTANTS * self.time_constant_s, SAMPLE_STEP_S)
        stations = np.array([station_m(time_s - float(t)) for t in age_s])
        weight = np.exp(-age_s / self.time_constant_s)
        stops = np.log2(np.maximum(road_light.metered(stations), self.darkest))
        return float(2.0 ** ((weight * stops).sum() / weight.sum()))

    def lens(self, lens: Lens, adapted_light: float) -> Lens:
        """The lens with this exposure's strength, and the noise that its gain brings: photons are fewer."""
        gain = (REFERENCE_LUMINANCE / adapted_light) ** self.strength
        return replace(lens, adaptation=self.strength, noise=lens.noise * float(np.sqrt(max(gain, 1.0))))


@dataclass(frozen=True)
class RoadLight:
    """What the pavement sends to the camera along the road, without its texture."""

    surface: Surface
    shades: tuple[Shade, ...]
    seed: int

    def metered(self, stations_m: np.ndarray) -> np.ndarray:
        """Mean luminance (N,) of the road before the car at each of its stations (N,)."""
        first, last = stations_m.min() + METERED_M[0], stations_m.max() + METERED_M[1] + SAMPLE_STEP_M
        s = np.arange(first, last + SAMPLE_STEP_M, SAMPLE_STEP_M)
        until = np.concatenate([[0.0], np.cumsum(self.luminance(s)) * SAMPLE_STEP_M])
        # The integral at any place, from its values between the samples, each of which stands for one step.
        at = np.concatenate([[s[0] - SAMPLE_STEP_M / 2], s + SAMPLE_STEP_M / 2])
        near, far = (np.interp(stations_m + m, at, until) for m in METERED_M)
        return (far - near) / (METERED_M[1] - METERED_M[0])

    def luminance(self, s_m: np.ndarray) -> np.ndarray:
        """Luminance (N,) of the road at places (N,) along it: the mean over the lane."""
        light = np.mean(
            [light_along(self.shades, s_m, 0 * s_m + d, seed=self.seed) for d in METERED_LATERALS_M], axis=0
        )
        zones = sorted(self.surface.zones, key=lambda zone: zone.start_m)
        which = np.searchsorted([zone.start_m for zone in zones[1:]], s_m, side="right")
        colours = np.array([MATERIALS[zone.material].colour for zone in zones], np.float32)
        return (light * colours[which]) @ LUMINANCE
