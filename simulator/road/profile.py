"""Up and down: the height of a road along its length, made of straight grades and the parabolas between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class HeightProfile:
    """Height over arc length, whose slope is piecewise linear.

    Parameters
    ----------
    stations_m : ndarray of shape (K,)
        Increasing arc lengths.
    slopes : ndarray of shape (K,)
        Rise per metre there, > 0 uphill; linear in between, constant before the first and after the last.

    References
    ----------
    Roads are built so: constant grades joined by parabolic vertical curves.
    """

    stations_m: np.ndarray
    slopes: np.ndarray

    def __post_init__(self) -> None:
        stations, slopes = np.array(self.stations_m, float), np.array(self.slopes, float)
        if stations.ndim != 1 or not len(stations) or stations.shape != slopes.shape or (np.diff(stations) <= 0).any():
            raise ValueError("a height profile needs increasing stations and as many slopes.")
        object.__setattr__(self, "stations_m", stations)
        object.__setattr__(self, "slopes", slopes)

    @property
    def level(self) -> bool:
        """Whether the road is one plane, so that a car on it has level ground before it."""
        return bool((self.slopes == self.slopes[0]).all())

    def slope(self, s_m: np.ndarray | float) -> np.ndarray:
        """Rise per metre at arc lengths `s_m`."""
        return np.interp(s_m, self.stations_m, self.slopes)

    def height(self, s_m: np.ndarray | float) -> np.ndarray:
        """Metres above the height at the first station, exactly."""
        s = np.asarray(s_m, float)
        steps = np.diff(self.stations_m) * (self.slopes[1:] + self.slopes[:-1]) / 2
        at_knots = np.concatenate([[0.0], np.cumsum(steps)])
        knot = np.clip(np.searchsorted(self.stations_m, s, side="right") - 1, 0, len(self.stations_m) - 1)
        # The slope is linear from the knot to here, so its mean is that of its two ends.
        return at_knots[knot] + (self.slopes[knot] + self.slope(s)) / 2 * (s - self.stations_m[knot])

    def height_above_plane(self, s_m: np.ndarray | float, from_m: float) -> np.ndarray:
        """Height above the plane that touches the road at `from_m`: what a car there takes for level ground.

        Turning the world into that plane is done by a shear, not by a rotation: distances keep their horizontal length,
        and at a grade of 8 % the two differ by 0.3 %.
        """
        ahead = np.asarray(s_m, float) - from_m
        return self.height(s_m) - self.height(from_m) - self.slope(from_m) * ahead


FLAT = HeightProfile([0.0], [0.0])
