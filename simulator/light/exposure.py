"""Automatic exposure with delay, as a pure function of drive and time.

The exposure of a camera depends on earlier frames. There is no state between frames here: the light along the road
already driven is integrated again for each frame. Frames can therefore be rendered in any order and in parallel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from simulator.light.lens import LUMINANCE, REFERENCE_LUMINANCE, Lens
from simulator.light.sunlight import Shade, light_along
from simulator.road.materials import MATERIALS
from simulator.road.surface import Surface

# Metering area on the road: metres ahead, lateral positions, and sampling step along the road.
METERED_M = (5.0, 25.0)
METERED_LATERALS_M = (-1.5, 0.0, 1.5)
SAMPLE_STEP_M = 1.0
# Time step of the integral, and its length in time constants (e^-6 = 0.2 % is left).
SAMPLE_STEP_S = 0.04
MEMORY_TIME_CONSTANTS = 6.0


@dataclass(frozen=True)
class AutoExposure:
    """Parameters of the automatic exposure.

    After `time_constant_s` the exposure (in stops) has followed 63 % of a sudden change of light. A `strength` of 0 is
    a fixed exposure; 1 finally renders every road equally bright. `darkest` is the luminance of the road below which
    the gain no longer rises.

    Raises
    ------
    ValueError
        If the time constant is not positive.
    """

    time_constant_s: float = 0.7
    strength: float = 0.8
    darkest: float = 0.006

    def __post_init__(self) -> None:
        if self.time_constant_s <= 0:
            raise ValueError(f"time_constant_s must be positive, not {self.time_constant_s}.")

    def adapted_light(self, station_m: Callable[[float], float], road_light: RoadLight, time_s: float) -> float:
        """Luminance of the road to which the exposure has adapted at `time_s`.

        `station_m` is a function from time in seconds to arc length of the car in metres.
        """
        age_s = np.arange(0.0, MEMORY_TIME_CONSTANTS * self.time_constant_s, SAMPLE_STEP_S)
        stations = np.array([station_m(time_s - float(t)) for t in age_s])
        weight = np.exp(-age_s / self.time_constant_s)
        stops = np.log2(np.maximum(road_light.metered(stations), self.darkest))
        return float(2.0 ** ((weight * stops).sum() / weight.sum()))

    def lens(self, lens: Lens, adapted_light: float) -> Lens:
        """The lens with this strength of adaptation, and with the photon noise that the gain amplifies."""
        gain = (REFERENCE_LUMINANCE / adapted_light) ** self.strength
        return replace(lens, adaptation=self.strength, noise=lens.noise * float(np.sqrt(max(gain, 1.0))))


@dataclass(frozen=True)
class RoadLight:
    """Luminance of the pavement along the road, without texture."""

    surface: Surface
    shades: tuple[Shade, ...]
    seed: int

    def metered(self, stations_m: np.ndarray) -> np.ndarray:
        """Mean luminance (N,) of the metering area for the car at stations (N,)."""
        first, last = stations_m.min() + METERED_M[0], stations_m.max() + METERED_M[1] + SAMPLE_STEP_M
        s = np.arange(first, last + SAMPLE_STEP_M, SAMPLE_STEP_M)
        until = np.concatenate([[0.0], np.cumsum(self.luminance(s)) * SAMPLE_STEP_M])
        # Integral at any arc length; each sample is valid for one step.
        at = np.concatenate([[s[0] - SAMPLE_STEP_M / 2], s + SAMPLE_STEP_M / 2])
        near, far = (np.interp(stations_m + m, at, until) for m in METERED_M)
        return (far - near) / (METERED_M[1] - METERED_M[0])

    def luminance(self, s_m: np.ndarray) -> np.ndarray:
        """Luminance (N,) of the road at arc lengths (N,), averaged over the lane."""
        light = np.mean(
            [light_along(self.shades, s_m, 0 * s_m + d, seed=self.seed) for d in METERED_LATERALS_M], axis=0
        )
        zones = sorted(self.surface.zones, key=lambda zone: zone.start_m)
        which = np.searchsorted([zone.start_m for zone in zones[1:]], s_m, side="right")
        colours = np.array([MATERIALS[zone.material].colour for zone in zones], np.float32)
        return (light * colours[which]) @ LUMINANCE
