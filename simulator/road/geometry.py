"""Geometry of the road: a reference line of clothoids, its height, a vehicle's pose.

Road coordinates are (s, d): arc length along the reference line, and lateral distance
from it, d > 0 to the left.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

# Beyond either end the road continues with its last curvature for this length, so that
# a camera at the end sees a road.
EXTENSION_M = 1500.0
# Gauss-Legendre of order 5 over 1 m is exact to rounding for every radius above 10 m.
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(5)
# Largest angle between a line and the car's heading at which the line is still
# described as y(x).
MAX_TURN_RAD = np.radians(80)


@dataclass(frozen=True, eq=False)
class PiecewiseLinear:
    """Function of arc length, linear between increasing stations, and its integral.

    It is constant outside the stations. Raises ValueError if the stations do not
    increase, or there is not one value for each.
    """

    stations_m: Any  # array_like; arrays after the checks
    values: Any

    def __post_init__(self) -> None:
        stations = np.array(self.stations_m, float)
        values = np.array(self.values, float)
        paired = stations.ndim == 1 and stations.shape == values.shape
        if not paired or not len(stations) or (np.diff(stations) <= 0).any():
            message = "a road needs increasing stations and one value for each."
            raise ValueError(message)
        object.__setattr__(self, "stations_m", stations)
        object.__setattr__(self, "values", values)

    def value(self, s_m: np.ndarray | float) -> np.ndarray:
        """Values at arc lengths `s_m`."""
        return np.interp(s_m, self.stations_m, self.values)

    def rate(self, s_m: np.ndarray | float) -> np.ndarray:
        """Change per metre at arc lengths `s_m`."""
        piece = np.searchsorted(self.stations_m, s_m, side="right")
        return self._rates[piece]

    def integral(self, s_m: np.ndarray | float) -> np.ndarray:
        """Exact integral from the first station to arc lengths `s_m`."""
        s = np.asarray(s_m, float)
        knot = np.searchsorted(self.stations_m, s, side="right") - 1
        knot = np.clip(knot, 0, len(self.stations_m) - 1)
        ahead = s - self.stations_m[knot]
        rate = np.where(s < self.stations_m[0], 0.0, self.rate(s))
        linear = self._integrals[knot] + self.values[knot] * ahead
        return linear + rate * ahead**2 / 2

    # Cached, because a frame reads them often.
    @cached_property
    def _integrals(self) -> np.ndarray:
        """Integrals at the stations."""
        lengths = np.diff(self.stations_m)
        steps = lengths * (self.values[1:] + self.values[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def _rates(self) -> np.ndarray:
        """Rates before, between and after the stations."""
        rates = np.diff(self.values) / np.diff(self.stations_m)
        return np.concatenate([[0.0], rates, [0.0]])


class HeightProfile(PiecewiseLinear):
    """Slope of the road (> 0 uphill).

    Constant grades are joined by parabolic vertical curves, as roads are designed.
    """

    @property
    def level(self) -> bool:
        """Whether the road is one plane."""
        return bool((self.values == self.values[0]).all())

    def height_above_plane(
        self,
        s_m: np.ndarray | float,
        from_m: float,
    ) -> np.ndarray:
        """Height in metres above the plane that touches the road at `from_m`.

        It is the ground plane of a car there. The world is sheared into that plane, not
        rotated, so distances stay horizontal. The two differ by 0.3 % at a grade of
        8 %.
        """
        ahead = np.asarray(s_m, float) - from_m
        rise = self.integral(s_m) - self.integral(from_m)
        return rise - self.value(from_m) * ahead


FLAT = HeightProfile([0.0], [0.0])


@dataclass(frozen=True, eq=False)
class RoadGeometry(PiecewiseLinear):
    """Reference line with piecewise linear curvature.

    It has straights, arcs, and clothoids (Euler spirals) between them. The values are
    curvatures in 1/m, > 0 bends left. Heading is the integral of curvature, position
    the integral of (cos, sin) of heading. The line starts at the origin of the world,
    heading along its x axis, at arc length `stations_m[0]`. The road has no cross
    slope, so its height, the `profile`, depends on arc length alone.
    """

    profile: HeightProfile = FLAT

    # At arc lengths in metres: 1/m, 1/m^2, and radians relative to the start.
    curvature = PiecewiseLinear.value
    curvature_rate = PiecewiseLinear.rate
    heading = PiecewiseLinear.integral

    def position(self, s_m: np.ndarray | float) -> np.ndarray:
        """World points (..., 2) in metres at arc lengths `s_m`, exact to rounding."""
        s = np.asarray(s_m, float)
        nodes, points = self._table
        index = np.searchsorted(nodes, s, side="right") - 1
        index = np.clip(index, 0, len(nodes) - 1)
        return points[index] + self._displacement(nodes[index], s)

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray]:
        """Arc lengths at most 1 m apart, with all stations, and the positions there."""
        start = self.stations_m[0] - EXTENSION_M
        end = self.stations_m[-1] + EXTENSION_M
        nodes = np.union1d(np.arange(start, end + 1), self.stations_m)
        steps = self._displacement(nodes[:-1], nodes[1:])
        points = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
        origin = points[np.searchsorted(nodes, self.stations_m[0])]
        return nodes, points - origin

    def _displacement(
        self,
        start_m: np.ndarray,
        end_m: np.ndarray,
    ) -> np.ndarray:
        """Vectors (..., 2) between arc lengths with no station in between.

        Gauss-Legendre quadrature of the directions.
        """
        half = (end_m - start_m)[..., None] / 2
        middle = (start_m + end_m)[..., None] / 2
        headings = self.heading(middle + half * GAUSS_NODES)
        directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
        return np.einsum("...gk,g->...k", directions, GAUSS_WEIGHTS) * half


@dataclass(frozen=True)
class VehiclePose:
    """Position of the car's origin in road coordinates, and heading.

    The heading is relative to the road, radians, > 0 points left.
    """

    s_m: float
    lateral_m: float = 0.0
    heading_rad: float = 0.0

    def to_car(
        self,
        road: RoadGeometry,
        world_m: np.ndarray,
    ) -> np.ndarray:
        """Transform world points (..., 2) to the car's frame: x forward, y left."""
        angle = self.absolute_heading(road)
        cosine = np.cos(angle)
        sine = np.sin(angle)
        origin = offset_point(road, self.s_m, self.lateral_m)
        return (world_m - origin) @ np.array([[cosine, -sine], [sine, cosine]])

    def absolute_heading(self, road: RoadGeometry) -> float:
        """Heading of the car in the world, radians."""
        return float(road.heading(self.s_m)) + self.heading_rad

    def turn_to(
        self,
        road: RoadGeometry,
        s_m: np.ndarray | float,
    ) -> np.ndarray:
        """Heading of the road at arc lengths `s_m` relative to the car's, radians."""
        return road.heading(s_m) - self.absolute_heading(road)

    def line_to_car(
        self,
        road: RoadGeometry,
        s_m: np.ndarray,
        lateral_m: np.ndarray | float,
    ) -> np.ndarray:
        """Transform road coordinates (s, d) to the car's road frame (..., 2)."""
        return self.to_car(road, offset_point(road, s_m, lateral_m))


def offset_point(
    road: RoadGeometry,
    s_m: np.ndarray | float,
    lateral_m: np.ndarray | float,
) -> np.ndarray:
    """World points (..., 2) at road coordinates (s, d)."""
    angle = road.heading(s_m)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    return road.position(s_m) + np.asarray(lateral_m)[..., None] * normal


@dataclass(frozen=True)
class LinePolynomial:
    """Lane line near the car, metres, y to the left.

    y(x) = c0 + c1 x + c2 x^2 / 2 + c3 x^3 / 6.
    """

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float


def line_polynomial(
    road: RoadGeometry, pose: VehiclePose, lateral_m: float
) -> LinePolynomial:
    """Taylor coefficients, at x = 0 in the car's frame, of the line at `lateral_m`.

    They are exact. A parallel line at distance d has curvature k / (1 - k d), whose
    derivative along that line is k' / (1 - k d)^3. y', y'' and y''' follow from
    dy/dx = tan(heading).
    """
    s = _station_at_x(road, pose, lateral_m, np.array([0.0]))
    y = pose.line_to_car(road, s, lateral_m)[0, 1]
    angle = float(pose.turn_to(road, s)[0])

    reference = float(road.curvature(s)[0])
    stretch = 1 - reference * lateral_m
    curvature = reference / stretch
    rate = float(road.curvature_rate(s)[0]) / stretch**3

    slope = np.tan(angle)
    secant = 1 / np.cos(angle)
    return LinePolynomial(
        c0_m=float(y),
        c1=float(slope),
        c2_per_m=float(curvature * secant**3),
        c3_per_m2=float(secant**4 * (rate + 3 * curvature**2 * slope)),
    )


def line_lateral(
    road: RoadGeometry, pose: VehiclePose, lateral_m: float, x_m: np.ndarray
) -> np.ndarray:
    """Lateral position y in metres, in the car's frame, of a line at `x_m`; exact.

    The line is at lateral distance `lateral_m` from the reference line. x is the
    horizontal distance ahead, also on slopes. NaN where the line turns by more than 80
    degrees from the car's heading before it reaches x, as in a hairpin.
    """
    x_m = np.asarray(x_m, float)
    farthest = _farthest_x(road, pose, lateral_m, float(x_m.max(initial=0.0)))
    reached = x_m <= farthest
    s = _station_at_x(road, pose, lateral_m, x_m[reached])
    y = np.full(x_m.shape, np.nan)
    y[reached] = pose.line_to_car(road, s, lateral_m)[:, 1]
    return y


def surface_points(
    road: RoadGeometry,
    pose: VehiclePose,
    s_m: np.ndarray,
    lateral_m: np.ndarray | float,
) -> np.ndarray:
    """Points (..., 3) of the road surface at road coordinates (s, d).

    In the car's frame: x forward, y left, z up.
    """
    level = pose.line_to_car(road, s_m, lateral_m)
    height = np.asarray(road.profile.height_above_plane(s_m, pose.s_m))
    return np.concatenate([level, height[..., None]], axis=-1)


def _farthest_x(
    road: RoadGeometry, pose: VehiclePose, lateral_m: float, until_m: float
) -> float:
    """Largest x that a line reaches before it has turned by MAX_TURN_RAD.

    It is at most `until_m`.
    """
    s = pose.s_m + np.arange(0.0, 2 * until_m + 20.0, 0.25)
    turned = np.abs(pose.turn_to(road, s)) > MAX_TURN_RAD
    if not turned.any():
        return until_m
    s = s[: int(np.argmax(turned))]
    x = pose.line_to_car(road, s, lateral_m)[:, 0]
    return min(until_m, float(x.max(initial=-np.inf)))


def _station_at_x(
    road: RoadGeometry, pose: VehiclePose, lateral_m: float, x_m: np.ndarray
) -> np.ndarray:
    """Arc lengths at which a line reaches `x_m` in the car's frame: Newton's method."""
    s = pose.s_m + x_m
    for _ in range(30):
        x = pose.line_to_car(road, s, lateral_m)[:, 0]
        stretch = 1 - road.curvature(s) * lateral_m
        slope = np.cos(pose.turn_to(road, s)) * stretch
        step = (x_m - x) / np.maximum(slope, 0.1)
        s = s + step
        if np.abs(step).max(initial=0.0) < 1e-10:
            break
    return s
