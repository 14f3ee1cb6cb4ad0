"""Fog and haze: contrast lost with distance, and airlight."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from simulator.painting.brush import Atmosphere
from simulator.road.ground import Ground

# Contrast threshold that defines the meteorological visibility (WMO: 5 %).
JUST_SEEN = 0.05


@dataclass(frozen=True)
class Fog:
    """Homogeneous fog up to `height_m`; the sky is visible through it overhead.

    5 % of an object's contrast is left at `visibility_m` (below 1000 m fog, up to 5000 m haze): Koschmieder's law of
    the contrast of distant objects. `colour` is the airlight of infinite fog, linear RGB; sunlit white paint is 1.
    """

    visibility_m: float
    colour: tuple[float, float, float] = (0.50, 0.52, 0.55)
    height_m: float = 80.0

    def transmittance(self, distance_m: np.ndarray | float) -> np.ndarray:
        """Transmittance at distances of any shape: the share of contrast that is left."""
        return np.exp(np.float32(np.log(JUST_SEEN) / self.visibility_m) * np.asarray(distance_m, np.float32))

    def atmosphere_at(self, distance_m: float) -> Atmosphere:
        """Fog in front of an object at a distance."""
        transmittance = np.full(3, self.transmittance(distance_m), np.float32)
        return Atmosphere(transmittance, np.array(self.colour, np.float32) * (1 - transmittance))

    def apply_to_ground(self, light: np.ndarray, ground: Ground) -> None:
        """Apply the fog to the light of the ground (rows, width, 3), in place."""
        self._veil(light, self.transmittance(ground.distance))

    def apply_to_sky(self, light: np.ndarray, up: np.ndarray) -> None:
        """Apply the fog to the backdrop, in place; `up` is the z component (rows, width) of the directions."""
        # Hills are treated like the sky just above the horizon.
        self._veil(light, self.transmittance(self.height_m / np.maximum(up, np.float32(1e-3))))

    def _veil(self, light: np.ndarray, transmittance: np.ndarray) -> None:
        # cv2, because numpy is slow where the innermost axis has three elements.
        # OpenCV's stubs miss scalars.
        cv2.subtract(light, (*self.colour, 0.0), dst=light)  # type: ignore[call-overload]
        cv2.multiply(light, cv2.merge([transmittance] * 3), dst=light)
        cv2.add(light, (*self.colour, 0.0), dst=light)  # type: ignore[call-overload]
