"""Fog, night and rain.

At night: headlights on road and objects, retroreflective paint, street lamps, and lamps of other vehicles. In rain:
drops and wiper on the windscreen, falling drops, and a wet road that reflects sky and lamps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.objects.scene_objects import SceneObject
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.painting import Atmosphere, blend
from simulator.road.ground import Ground
from simulator.road.markings import Marking

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
        return np.exp(
            np.float32(np.log(JUST_SEEN) / self.visibility_m)
            * np.asarray(distance_m, np.float32)
        )

    def atmosphere_at(self, distance_m: float) -> Atmosphere:
        """Fog in front of an object at a distance."""
        transmittance = np.full(3, self.transmittance(distance_m), np.float32)
        return Atmosphere(
            transmittance, np.array(self.colour, np.float32) * (1 - transmittance)
        )

    def apply_to_ground(self, light: np.ndarray, ground: Ground) -> None:
        """Apply the fog to the light of the ground (rows, width, 3), in place."""
        self._veil(light, self.transmittance(ground.distance))

    def apply_to_sky(self, light: np.ndarray, up: np.ndarray) -> None:
        """Apply the fog to the backdrop, in place; `up` is the z component (rows, width) of the directions."""
        # Hills are treated like the sky just above the horizon.
        self._veil(
            light, self.transmittance(self.height_m / np.maximum(up, np.float32(1e-3)))
        )

    def _veil(self, light: np.ndarray, transmittance: np.ndarray) -> None:
        # cv2, because numpy is slow where the innermost axis has three elements.
        # OpenCV's stubs miss scalars.
        cv2.subtract(light, (*self.colour, 0.0), dst=light)  # type: ignore[call-overload]
        cv2.multiply(light, cv2.merge([transmittance] * 3), dst=light)
        cv2.add(light, (*self.colour, 0.0), dst=light)  # type: ignore[call-overload]


HALOGEN = np.array([1.0, 0.86, 0.62], np.float32)
SODIUM = np.array([1.0, 0.62, 0.25], np.float32)
TOWN_GLOW = np.array([0.010, 0.007, 0.005], np.float32)
# Low beam: half width, and the distance beyond which the light on the road falls steeply.
BEAM_HALF_WIDTH_RAD, BEAM_RANGE_M = 0.32, 20.0
# Lamps of vehicle bodies in their own frame: (x, y, z) of one lamp of a pair, colour times brightness.
TAIL_LIGHT, HEADLIGHT = (
    np.array([1.0, 0.05, 0.03]) * 3.0,
    np.array([1.0, 0.93, 0.80]) * 25.0,
)
LAMPS = {
    "sedan": (((-2.24, 0.64, 0.84), TAIL_LIGHT), ((2.12, 0.62, 0.66), HEADLIGHT)),
    "suv": (((-2.22, 0.68, 0.98), TAIL_LIGHT), ((2.16, 0.66, 0.80), HEADLIGHT)),
    "truck": (((-6.1, 1.0, 0.95), TAIL_LIGHT), ((6.0, 0.9, 0.9), HEADLIGHT)),
    "motorcycle": (((-1.0, 0.0, 0.78), TAIL_LIGHT), ((0.75, 0.0, 0.95), HEADLIGHT)),
}
# Glow of a lamp: standard deviations in pixels of an image of 720 rows, and shares of the light.
HALOS = ((3.0, 0.35), (14.0, 0.05), (60.0, 0.006))
GLOW_DOWNSAMPLING = 4
# Vehicles nearer than this do not hide lamps ahead; half a lorry is 6 m long.
MIN_OCCLUDER_M = 7.0


@dataclass(frozen=True)
class Night:
    """Light at night.

    `ambient` is the light of the sky and the town as a share of open daylight. In the same unit, `headlights` is the
    light of the car's low beam on the road just ahead, and `street_lamp` that directly below a street lamp.
    `retroreflection` is the brightness of paint with glass beads in the car's own light, relative to plain white paint;
    low for paint under water.
    """

    ambient: float = 0.004
    headlights: float = 0.60
    retroreflection: float = 3.0
    street_lamp: float = 0.10

    def beam(
        self, x_m: np.ndarray, y_m: np.ndarray, *, upright: bool = False
    ) -> np.ndarray:
        """Light of the headlights at positions of any shape, on level ground or on `upright` surfaces.

        Level ground is lit at a grazing angle, so its light falls with one more power of the distance.
        """
        distance2 = (np.hypot(x_m, y_m) / BEAM_RANGE_M) ** 2
        aside = np.arctan2(y_m, np.maximum(x_m, np.float32(0.1))) / np.float32(
            BEAM_HALF_WIDTH_RAD
        )
        fall = 1 / (1 + distance2) ** (1.0 if upright else 1.5)
        return np.float32(self.headlights) * fall * np.exp(-(np.abs(aside) ** 2.5))

    def ground_light(self, ground: Ground, objects: list[SceneObject]) -> np.ndarray:
        """Light (rows, width, 3) on the ground from headlights, street lamps and sky."""
        x, y = (
            cv2.resize(a, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            for a in (ground.x, ground.y)
        )
        light = self.beam(x, y)[..., None] * HALOGEN + np.float32(self.ambient)
        for lamp in objects:
            if isinstance(lamp, Post) and lamp.arm_m:
                # Cosine of incidence over squared distance, 1 below the lamp.
                below = (
                    1
                    + ((x - lamp.x_m) ** 2 + (y - lamp.y_m - lamp.arm_m) ** 2)
                    / lamp.height_m**2
                ) ** -1.5
                light += (np.float32(self.street_lamp) * below**1.5)[..., None].astype(
                    np.float32
                ) * SODIUM
        return cv2.resize(
            light.astype(np.float32),
            ground.x.shape[::-1],
            interpolation=cv2.INTER_LINEAR,
        )

    def object_light(self, places_m: np.ndarray) -> np.ndarray:
        """Light (N, 3) on objects at positions (N, 2)."""
        return self.beam(*places_m.T, upright=True)[:, None] * HALOGEN + np.float32(
            self.ambient
        )

    def markings(self, markings: tuple[Marking, ...]) -> tuple[Marking, ...]:
        """The markings with colours multiplied by the retroreflection."""
        gain = self.retroreflection
        return tuple(
            replace(
                m, colour=(gain * m.colour[0], gain * m.colour[1], gain * m.colour[2])
            )
            for m in markings
        )

    def darken_sky(self, light: np.ndarray, up: np.ndarray) -> None:
        """Turn a backdrop by day into one at night near a town, in place; `up` is z (rows, width) of the directions."""
        light *= np.float32(self.ambient)
        light += np.exp(-np.maximum(up, 0) / np.float32(0.2))[..., None] * TOWN_GLOW


@dataclass(frozen=True)
class Lamp:
    """Visible lamp: position (3,) in the road frame, colour times brightness (3,), radius in metres."""

    place_m: np.ndarray
    light: np.ndarray
    radius_m: float = 0.07

    @property
    def distance_m(self) -> float:
        """Distance from the point of the road below the camera, metres."""
        return float(np.linalg.norm(self.place_m))


def find_lamps(objects: list[SceneObject]) -> list[Lamp]:
    """Lamps of vehicles that face the camera, and street lamps ahead."""
    lamps = []
    for item in objects:
        if isinstance(item, Post) and item.arm_m and item.x_m > 1:
            head = item.foot_m + [0, item.arm_m, item.height_m - 0.1]
            lamps.append(Lamp(head, 12 * SODIUM, 0.15))
        elif isinstance(item, Car):
            turn, place = item.turn, item.foot_m
            for (x, y, z), light in LAMPS[item.body]:
                axis = turn @ np.array([np.sign(x), 0, 0])
                facing = max(0.0, float(-axis @ place / np.linalg.norm(place))) ** 2
                at = [place + turn @ np.array([x, side * y, z]) for side in (1, -1)]
                lamps += [
                    Lamp(p, light * facing)
                    for p in (at if y else at[:1])
                    if facing > 0.05 and p[0] > 1
                ]
    return lamps


def visible_lamps(objects: list[SceneObject], camera: Camera) -> list[Lamp]:
    """Lamps of `find_lamps` that are not hidden by a nearer vehicle."""
    lamps = find_lamps(objects)
    seen = list(zip(lamps, lamp_pixels(camera, lamps).tolist(), strict=True))
    for car in (
        item for item in objects if isinstance(item, Car) and item.x_m > MIN_OCCLUDER_M
    ):
        pixels = camera.road_to_pixels(car.outline_m())
        hull = cv2.convexHull(
            pixels[np.isfinite(pixels).all(axis=1)].astype(np.float32)
        )
        if hull is None:  # outside the field of view of the lens
            continue
        # Its own lamps that face the camera are nearer than its centre.
        until_m = np.linalg.norm(car.foot_m)
        seen = [
            (lamp, px)
            for lamp, px in seen
            if lamp.distance_m < until_m or cv2.pointPolygonTest(hull, px, False) <= 0
        ]
    return [lamp for lamp, _ in seen]


def lamp_pixels(
    camera: Camera, lamps: list[Lamp], *, mirrored: bool = False
) -> np.ndarray:
    """Pixels (N, 2) of the lamps, or of their mirror images in level ground; NaN outside the view of the lens."""
    places = np.array([lamp.place_m for lamp in lamps]).reshape(-1, 3)
    return camera.road_to_pixels(places * [1, 1, -1 if mirrored else 1])


def add_lamps(light: np.ndarray, camera: Camera, lamps: list[Lamp]) -> None:
    """Add lamps and their glow to the light, in place."""
    height, width = light.shape[:2]
    glow: np.ndarray = np.zeros(
        (height // GLOW_DOWNSAMPLING, width // GLOW_DOWNSAMPLING, 3), np.float32
    )
    for lamp, (u, v) in zip(lamps, lamp_pixels(camera, lamps), strict=True):
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        radius = camera.matrix[0, 0] * lamp.radius_m / lamp.distance_m
        _add_disc(light, u, v, radius, lamp.light)
        # Energy of the disc in one coarse pixel.
        glow[
            int(v) // GLOW_DOWNSAMPLING % len(glow),
            int(u) // GLOW_DOWNSAMPLING % glow.shape[1],
        ] += lamp.light * np.pi * max(radius, 0.5) ** 2 / GLOW_DOWNSAMPLING**2
    scale = height / 720 / GLOW_DOWNSAMPLING
    spread: Any = sum(
        np.float32(share) * cv2.GaussianBlur(glow, (0, 0), size * scale)
        for size, share in HALOS
    )
    glow = cv2.resize(spread, (width, height), interpolation=cv2.INTER_LINEAR)
    light += glow


def _add_disc(
    light: np.ndarray, u: float, v: float, radius: float, colour: np.ndarray
) -> None:
    """Add a soft disc, in place; discs smaller than a pixel are dimmed by their area."""
    sigma = max(radius / 1.5, 0.7)
    reach = int(3 * sigma) + 1
    top, left = max(int(v) - reach, 0), max(int(u) - reach, 0)
    part = light[top : int(v) + reach + 1, left : int(u) + reach + 1]
    rows, columns = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
    disc = np.exp(-((rows - v) ** 2 + (columns - u) ** 2) / (2 * sigma**2)) * min(
        1.0, (radius / 1.5 / sigma) ** 2
    )
    part += (disc[..., None] * colour).astype(np.float32)


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
# New drops on the visible part of the windscreen between two wipes, period of the wipes, time that the blade takes to
# cross the image, and light of the falling drops (sunlit white paint is 1).
DROPS, WIPE_EVERY_S, WIPE_S, FALLING_LIGHT = 280, 1.2, 0.45, 0.10


def add_falling_drops(light: np.ndarray, *, seed: int) -> None:
    """Add motion-blurred falling drops, in place; each seed gives another pattern."""
    height, width = light.shape[:2]
    row, column = np.random.default_rng(seed).integers(0, 64, 2)
    streaks = _streaks(height, width)[row : row + height, column : column + width]
    cv2.scaleAdd(streaks, FALLING_LIGHT, light, dst=light)


def add_windscreen_drops(light: np.ndarray, time_s: float, *, seed: int) -> None:
    """Change the light (height, width, 3) to that behind a wet windscreen with drops and wiper, in place."""
    height, width = light.shape[:2]
    small = cv2.resize(
        light,
        (width // DROP_DOWNSAMPLING, height // DROP_DOWNSAMPLING),
        interpolation=cv2.INTER_AREA,
    )
    blurred = cv2.GaussianBlur(small, (0, 0), 0.012 * height / DROP_DOWNSAMPLING)
    cover = np.zeros(small.shape[:2], np.float32)
    map_u, map_v = np.meshgrid(
        *(np.arange(n, dtype=np.float32) for n in small.shape[1::-1])
    )
    cycle = int(np.floor(time_s / WIPE_EVERY_S))
    drops = np.concatenate(
        [_drops_of_cycle(number, time_s, seed) for number in (cycle - 1, cycle)]
    )
    for at_u, at_v, radius in drops * [width, height, height] / DROP_DOWNSAMPLING:
        _lay_drop(cover, map_u, map_v, at_u, at_v, radius)
    _lay_blade(cover, map_u, map_v, time_s)
    seen = cv2.remap(
        blurred, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    seen, cover = (
        cv2.resize(a, (width, height), interpolation=cv2.INTER_LINEAR)
        for a in (seen, cover)
    )
    blend(light, seen, cover)


def _drops_of_cycle(number: int, time_s: float, seed: int) -> np.ndarray:
    """Drops (N, 3) that fell between wipes `number` and `number + 1` and are not wiped off yet.

    u as a share of the width, v and radius as shares of the height.
    """
    rng = np.random.default_rng([seed, 91, number + 1000])
    u, v = rng.uniform(0, 1, (2, DROPS))
    radius = 0.005 + 0.021 * rng.uniform(0, 1, DROPS) ** 3
    born = (number + rng.uniform(0, 1, DROPS)) * WIPE_EVERY_S
    # Share of the sweep at which the blade meets the drop.
    angle = np.arctan2(u - PIVOT[0], (PIVOT[1] - v) * 9 / 16)
    share = np.clip((angle - SWEEP_RAD[0]) / (SWEEP_RAD[1] - SWEEP_RAD[0]), 0, 1)
    wiped = number * WIPE_EVERY_S + share * WIPE_S
    wiped = np.where(wiped <= born, wiped + WIPE_EVERY_S, wiped)
    there = (born <= time_s) & (time_s < wiped)
    return np.column_stack([u, v, radius])[there]


def _lay_drop(cover, map_u, map_v, at_u: float, at_v: float, radius: float) -> None:
    """Add the coverage and the refracted view of a drop, in place."""
    reach = int(1.6 * radius) + 2
    part = np.s_[
        max(int(at_v) - reach, 0) : int(at_v) + reach + 1,
        max(int(at_u) - reach, 0) : int(at_u) + reach + 1,
    ]
    rows, columns = (
        np.arange(size, dtype=np.float32)[cut]
        for size, cut in zip(cover.shape, part, strict=True)
    )
    du, dv = columns - np.float32(at_u), rows[:, None] - np.float32(at_v)
    # The edge of the drop is wide, because the camera is focused on the road.
    inside = np.clip(
        1.25 - np.hypot(du, dv * np.float32(0.85)) / np.float32(radius), 0, 0.75
    ) / np.float32(0.75)
    better = inside > cover[part]
    map_u[part] = np.where(better, at_u - DROP_MINIFICATION * du, map_u[part])
    map_v[part] = np.where(better, at_v - DROP_MINIFICATION * dv, map_v[part])
    cover[part] = np.maximum(cover[part], inside * np.float32(0.9))


def _lay_blade(
    cover: np.ndarray, map_u: np.ndarray, map_v: np.ndarray, time_s: float
) -> None:
    """Add the moving wiper blade, in place: a blurred bar with the colour of the bottom of the image."""
    height, width = cover.shape
    share = (time_s % WIPE_EVERY_S) / WIPE_S
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
        toward = (
            np.array([(u / layer.shape[1] - 0.5) * 0.5, 1.0])
            * height
            * rng.uniform(0.02, 0.07)
        )
        start, end = (
            np.rint(np.array(p) * 16).astype(int).tolist()
            for p in ((u, v), (u + toward[0], v + toward[1]))
        )
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
        upright = np.float32(height_m) / np.sqrt(
            ground.distance * ground.distance + np.float32(height_m**2)
        )
        mirrored = np.float32(WATER) + np.float32(1 - WATER) * (1 - upright) ** 5
        puddles = ground.noise(seed + 81, (5.0, 0.45), octaves=3, fading_m=12.0)
        return mirrored * np.clip(
            np.float32(self.film) * (1 + np.float32(0.22) * puddles), 0, 0.95
        )


def add_lamp_reflections(
    light: np.ndarray,
    camera: Camera,
    lamps: list[Lamp],
    share: np.ndarray,
    open_to: np.ndarray,
) -> None:
    """Add the reflections of lamps in the road to the light (height, width, 3), in place.

    `share` (rows, width) is the reflectance of `Wet.mirror_share` for the lowest rows of the image, `open_to`
    (height, width) the mask of the visible road.
    """
    height, width = light.shape[:2]
    layer = np.zeros(
        (height // STREAK_DOWNSAMPLING, width // STREAK_DOWNSAMPLING, 3), np.float32
    )
    rows, columns = (
        np.mgrid[: len(layer), : layer.shape[1]].astype(np.float32)
        * STREAK_DOWNSAMPLING
    )
    horizon = float(camera.road_to_pixels(np.array([[3000.0, 0.0]]))[0, 1])
    for lamp, (u, v) in zip(
        lamps, lamp_pixels(camera, lamps, mirrored=True), strict=True
    ):
        if not (-50 < u < width + 50 and v < 2 * height):
            continue
        wide = max(camera.matrix[0, 0] * STREAK_WIDE_M / lamp.distance_m, 2.0)
        long = max(STREAK_LONG * (v - horizon), 4.0)
        # The lamp's energy is spread over the streak.
        energy = (camera.matrix[0, 0] * lamp.radius_m / lamp.distance_m) ** 2 / (
            2 * wide * long
        )
        first, last = (
            max(int((u + reach) / STREAK_DOWNSAMPLING), -2)
            for reach in (-3 * wide, 3 * wide)
        )
        at = slice(max(first, 0), last + 2)
        streak = np.exp(
            -((columns[:, at] - u) ** 2) / (2 * wide**2)
            - (rows[:, at] - v) ** 2 / (2 * long**2)
        )
        layer[:, at] += (np.float32(energy) * streak)[..., None] * lamp.light.astype(
            np.float32
        )
    layer = cv2.resize(layer, (width, height), interpolation=cv2.INTER_LINEAR)[
        height - len(share) :
    ]
    layer *= cv2.merge([share * open_to[height - len(share) :]] * 3)
    light[height - len(share) :] += layer
