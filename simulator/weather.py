"""Fog, night and rain.

At night: headlights on road and objects, retroreflective paint, street lamps, and lamps
of other vehicles. In rain: drops and wiper on the windscreen, falling drops, and a wet
road that reflects sky and lamps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera.model import Camera
from simulator.objects.scene_objects import SceneObject
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.painting import Atmosphere, blend, three_channels
from simulator.road.ground import Ground
from simulator.road.markings import Marking

# Contrast threshold that defines the meteorological visibility (WMO: 5 %).
JUST_SEEN = 0.05


@dataclass(frozen=True)
class Fog:
    """Homogeneous fog up to `height_m`; the sky is visible through it overhead.

    5 % of an object's contrast is left at `visibility_m` (below 1000 m fog, up to 5000
    m haze): Koschmieder's law of the contrast of distant objects. `colour` is the
    airlight of infinite fog, linear RGB; sunlit white paint is 1.
    """

    visibility_m: float
    colour: tuple[float, float, float] = (0.50, 0.52, 0.55)
    height_m: float = 80.0

    def transmittance(self, distance_m: np.ndarray | float) -> np.ndarray:
        """Share of contrast that is left at distances of any shape."""
        decay_per_m = np.float32(np.log(JUST_SEEN) / self.visibility_m)
        return np.exp(decay_per_m * np.asarray(distance_m, np.float32))

    def atmosphere_at(self, distance_m: float) -> Atmosphere:
        """Fog in front of an object at a distance."""
        transmittance = np.full(3, self.transmittance(distance_m), np.float32)
        airlight = np.array(self.colour, np.float32) * (1 - transmittance)
        return Atmosphere(transmittance, airlight)

    def apply_to_ground(self, light: np.ndarray, ground: Ground) -> None:
        """Apply the fog to the light of the ground (rows, width, 3), in place."""
        self._veil(light, self.transmittance(ground.distance))

    def apply_to_sky(
        self,
        light: np.ndarray,
        up: np.ndarray,
    ) -> None:
        """Apply the fog to the backdrop, in place.

        `up` is the z component (rows, width) of the directions.
        """
        # Hills are treated like the sky just above the horizon.
        distance_m = self.height_m / np.maximum(up, 1e-3)
        self._veil(light, self.transmittance(distance_m))

    def _veil(
        self,
        light: np.ndarray,
        transmittance: np.ndarray,
    ) -> None:
        # cv2, because numpy is slow where the innermost axis has three elements.
        # OpenCV's stubs miss scalars.
        colour = (*self.colour, 0.0)
        cv2.subtract(light, colour, dst=light)  # type: ignore[call-overload]
        cv2.multiply(light, three_channels(transmittance), dst=light)
        cv2.add(light, colour, dst=light)  # type: ignore[call-overload]


HALOGEN = np.array([1.0, 0.86, 0.62], np.float32)
SODIUM = np.array([1.0, 0.62, 0.25], np.float32)
TOWN_GLOW = np.array([0.010, 0.007, 0.005], np.float32)
# Light as a share of open daylight: of the sky and the town, of the car's low beam on
# the road just ahead, and directly below a street lamp.
AMBIENT = np.float32(0.004)
HEADLIGHTS = np.float32(0.60)
STREET_LAMP = 0.10
# Low beam: half width, and the distance beyond which the light on the road falls
# steeply.
BEAM_HALF_WIDTH_RAD = np.float32(0.32)
BEAM_RANGE_M = 20.0
# Lamps of vehicle bodies in their own frame: (x, y, z) of one lamp of a pair, colour
# times brightness.
TAIL_LIGHT = np.array([1.0, 0.05, 0.03]) * 3.0
HEADLIGHT = np.array([1.0, 0.93, 0.80]) * 25.0
LAMPS = {
    "sedan": (
        ((-2.24, 0.64, 0.84), TAIL_LIGHT),
        ((2.12, 0.62, 0.66), HEADLIGHT),
    ),
    "suv": (
        ((-2.22, 0.68, 0.98), TAIL_LIGHT),
        ((2.16, 0.66, 0.80), HEADLIGHT),
    ),
    "truck": (
        ((-6.1, 1.0, 0.95), TAIL_LIGHT),
        ((6.0, 0.9, 0.9), HEADLIGHT),
    ),
    "motorcycle": (
        ((-1.0, 0.0, 0.78), TAIL_LIGHT),
        ((0.75, 0.0, 0.95), HEADLIGHT),
    ),
}
LAMP_RADIUS_M = 0.07
STREET_LAMP_RADIUS_M = 0.15
STREET_LAMP_LIGHT = 12 * SODIUM
# A lamp that shines less than this share towards the camera is not seen.
LEAST_FACING = 0.05
# Glow of a lamp: standard deviations in pixels of an image of 720 rows, and shares of
# the light.
HALOS = ((3.0, 0.35), (14.0, 0.05), (60.0, 0.006))
GLOW_DOWNSAMPLING = 4
# Vehicles nearer than this do not hide lamps ahead; half a lorry is 6 m long.
MIN_OCCLUDER_M = 7.0


@dataclass(frozen=True)
class Night:
    """Light at night.

    `retroreflection` is the brightness of paint with glass beads in the car's own
    light, relative to plain white paint; low for paint under water.
    """

    retroreflection: float = 3.0

    def ground_light(
        self,
        ground: Ground,
        objects: list[SceneObject],
    ) -> np.ndarray:
        """Light (rows, width, 3) on the ground: headlights, street lamps and sky."""
        x = _halve(ground.x)
        y = _halve(ground.y)
        light = _beam(x, y, power=1.5)[..., None] * HALOGEN + AMBIENT
        for lamp in objects:
            if isinstance(lamp, Post) and lamp.arm_m:
                # Cosine of incidence over squared distance, 1 below the lamp.
                distance2 = (x - lamp.x_m) ** 2 + (y - lamp.y_m - lamp.arm_m) ** 2
                below = (1 + distance2 / lamp.height_m**2) ** -1.5
                share = STREET_LAMP * below**1.5
                light += share[..., None].astype(np.float32) * SODIUM
        size = ground.x.shape[::-1]
        return cv2.resize(
            light.astype(np.float32), size, interpolation=cv2.INTER_LINEAR
        )

    def object_light(self, places_m: np.ndarray) -> np.ndarray:
        """Light (N, 3) on objects at positions (N, 2)."""
        light = _beam(*places_m.T, power=1.0)
        return light[:, None] * HALOGEN + AMBIENT

    def markings(self, markings: tuple[Marking, ...]) -> tuple[Marking, ...]:
        """The markings with colours multiplied by the retroreflection."""
        brighter = []
        for marking in markings:
            red, green, blue = (self.retroreflection * c for c in marking.colour)
            brighter.append(replace(marking, colour=(red, green, blue)))
        return tuple(brighter)

    def darken_sky(
        self,
        light: np.ndarray,
        up: np.ndarray,
    ) -> None:
        """Turn a backdrop by day into one at night near a town, in place.

        `up` is z (rows, width) of the directions.
        """
        light *= AMBIENT
        glow = np.exp(-np.maximum(up, 0) / 0.2)
        light += glow[..., None] * TOWN_GLOW


def _halve(plane: np.ndarray) -> np.ndarray:
    return cv2.resize(plane, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def _beam(
    x_m: np.ndarray,
    y_m: np.ndarray,
    *,
    power: float,
) -> np.ndarray:
    """Light of the headlights at positions of any shape.

    It falls with the `power` of 1 + the squared distance: 1 on upright surfaces, 1.5 on
    level ground, which is lit at a grazing angle.
    """
    distance2 = (np.hypot(x_m, y_m) / BEAM_RANGE_M) ** 2
    angle = np.arctan2(y_m, np.maximum(x_m, np.float32(0.1)))
    aside = angle / BEAM_HALF_WIDTH_RAD
    fall = 1 / (1 + distance2) ** power
    return HEADLIGHTS * fall * np.exp(-(np.abs(aside) ** 2.5))


@dataclass(frozen=True)
class Lamp:
    """Visible lamp: position (3,) in the road frame, light (3,), radius in metres.

    The light is colour times brightness.
    """

    place_m: np.ndarray
    light: np.ndarray
    radius_m: float

    @property
    def distance_m(self) -> float:
        """Distance from the point of the road below the camera, metres."""
        return float(np.linalg.norm(self.place_m))

    def radius_px(self, camera: Camera) -> float:
        """Radius in the image."""
        return camera.matrix[0, 0] * self.radius_m / self.distance_m


def find_lamps(objects: list[SceneObject]) -> list[Lamp]:
    """Lamps of vehicles that face the camera, and street lamps ahead."""
    lamps = []
    for item in objects:
        if isinstance(item, Post) and item.arm_m and item.x_m > 1:
            head = item.foot_m + [0, item.arm_m, item.height_m - 0.1]
            lamps.append(Lamp(head, STREET_LAMP_LIGHT, STREET_LAMP_RADIUS_M))
        elif isinstance(item, Car):
            lamps += _vehicle_lamps(item)
    return lamps


def _vehicle_lamps(car: Car) -> list[Lamp]:
    """Lamps of a vehicle that face the camera."""
    lamps = []
    place = car.foot_m
    for (x, y, z), light in LAMPS[car.body]:
        axis = car.turn @ np.array([np.sign(x), 0, 0])
        facing = max(0.0, float(-axis @ place / np.linalg.norm(place))) ** 2
        if facing <= LEAST_FACING:
            continue
        for lamp_y in (y, -y) if y else (y,):
            lamp_m = place + car.turn @ np.array([x, lamp_y, z])
            if lamp_m[0] > 1:
                lamps.append(Lamp(lamp_m, light * facing, LAMP_RADIUS_M))
    return lamps


def visible_lamps(
    objects: list[SceneObject],
    camera: Camera,
) -> list[Lamp]:
    """Lamps of `find_lamps` that are not hidden by a nearer vehicle."""
    lamps = find_lamps(objects)
    pixels = lamp_pixels(camera, lamps).tolist()
    hidden = np.zeros(len(lamps), bool)
    for car in objects:
        if not isinstance(car, Car) or car.x_m <= MIN_OCCLUDER_M:
            continue
        outline = camera.road_to_pixels(car.outline_m())
        outline = outline[np.isfinite(outline).all(axis=1)]
        hull = cv2.convexHull(outline.astype(np.float32))
        if hull is None:  # outside the field of view of the lens
            continue
        # Its own lamps that face the camera are nearer than its centre.
        centre_m = np.linalg.norm(car.foot_m)
        for k, lamp in enumerate(lamps):
            behind = lamp.distance_m >= centre_m
            if behind and cv2.pointPolygonTest(hull, pixels[k], False) > 0:
                hidden[k] = True
    return [lamp for lamp, out in zip(lamps, hidden, strict=True) if not out]


def lamp_pixels(
    camera: Camera, lamps: list[Lamp], *, mirrored: bool = False
) -> np.ndarray:
    """Pixels (N, 2) of the lamps, or of their mirror images in level ground.

    NaN outside the view of the lens.
    """
    places = np.array([lamp.place_m for lamp in lamps]).reshape(-1, 3)
    up = -1 if mirrored else 1
    return camera.road_to_pixels(places * [1, 1, up])


def add_lamps(
    light: np.ndarray,
    camera: Camera,
    lamps: list[Lamp],
) -> None:
    """Add lamps and their glow to the light, in place."""
    height, width = light.shape[:2]
    coarse = GLOW_DOWNSAMPLING
    rows = height // coarse
    columns = width // coarse
    glow: np.ndarray = np.zeros((rows, columns, 3), np.float32)
    for lamp, (u, v) in zip(lamps, lamp_pixels(camera, lamps), strict=True):
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        radius = lamp.radius_px(camera)
        _add_disc(light, u, v, radius, lamp.light)
        # Energy of the disc in one coarse pixel.
        row = int(v) // coarse % rows
        column = int(u) // coarse % columns
        radius = max(radius, 0.5)
        glow[row, column] += lamp.light * np.pi * radius**2 / coarse**2

    scale = height / 720 / coarse
    spread = np.zeros_like(glow)
    for size, share in HALOS:
        spread += np.float32(share) * cv2.GaussianBlur(glow, (0, 0), size * scale)
    light += cv2.resize(spread, (width, height), interpolation=cv2.INTER_LINEAR)


def _add_disc(
    light: np.ndarray,
    u: float,
    v: float,
    radius: float,
    colour: np.ndarray,
) -> None:
    """Add a soft disc, in place; one smaller than a pixel is dimmed by its area."""
    own_sigma = radius / 1.5
    sigma = max(own_sigma, 0.7)
    part = _window(light.shape, u, v, int(3 * sigma) + 1)
    rows, columns = np.mgrid[part]
    distance2 = (rows - v) ** 2 + (columns - u) ** 2
    dimmed = min(1.0, (own_sigma / sigma) ** 2)
    disc = np.exp(-distance2 / (2 * sigma**2)) * dimmed
    light[part] += (disc[..., None] * colour).astype(np.float32)


def _window(
    shape: tuple[int, ...],
    u: float,
    v: float,
    reach: int,
) -> tuple[slice, slice]:
    """Rows and columns of an image of this shape up to `reach` from a pixel."""
    top = max(int(v) - reach, 0)
    left = max(int(u) - reach, 0)
    bottom = min(int(v) + reach + 1, shape[0])
    right = min(int(u) + reach + 1, shape[1])
    return slice(top, bottom), slice(left, right)


# The view through drops is computed on every 2nd pixel.
DROP_DOWNSAMPLING = 2
# Pivot of the wiper as shares of the image's width and height, and its range of angles.
PIVOT_U = 0.30
PIVOT_V = 1.25
SWEEP_START_RAD = -1.15
SWEEP_END_RAD = 1.05
# Length of the wiper as a share of the image's height.
BLADE_LENGTH = 1.25
# Minification of a drop, which is a strong lens: it shows nearly the whole scene upside
# down.
DROP_MINIFICATION = 9.0
STREAK_DOWNSAMPLING = 4
# Reflectance of water at normal incidence.
WATER = 0.02
# Factor of wetness on the dry reflectance of the road.
WET_DARKENING = 0.55
# Reflection of a lamp: standard deviations, vertical as a share of its depth below the
# horizon, horizontal in metres.
STREAK_LONG = 0.45
STREAK_WIDE_M = 0.16
# New drops on the visible part of the windscreen between two wipes, period of the
# wipes, and time that the blade takes to cross the image.
DROPS = 280
WIPE_EVERY_S = 1.2
WIPE_S = 0.45
# Falling drops: number of streaks, light (sunlit white paint is 1), and pixels by which
# the layer is larger than the image, to allow shifts.
FALLING_STREAKS = 260
FALLING_LIGHT = 0.10
SPARE_PX = 64
# Fractional bits of OpenCV's coordinates.
_SHIFT = 4


def add_falling_drops(light: np.ndarray, *, seed: int) -> None:
    """Add motion-blurred falling drops, in place; each seed gives another pattern."""
    height, width = light.shape[:2]
    row, column = np.random.default_rng(seed).integers(0, SPARE_PX, 2)
    streaks = _streaks(height, width)[row : row + height, column : column + width]
    cv2.scaleAdd(streaks, FALLING_LIGHT, light, dst=light)


class _DropLayer:
    """What drops and wiper show instead of the scene, on every 2nd pixel.

    `cover` (rows, columns) is their coverage, `map_u` and `map_v` the pixels that they
    show.
    """

    def __init__(self, rows: int, columns: int) -> None:
        u = np.arange(columns, dtype=np.float32)
        v = np.arange(rows, dtype=np.float32)
        self.map_u, self.map_v = np.meshgrid(u, v)
        self.cover = np.zeros((rows, columns), np.float32)

    def lay_drop(
        self,
        at_u: float,
        at_v: float,
        radius: float,
    ) -> None:
        """Add the coverage and the refracted view of a drop."""
        rows, columns = self.cover.shape
        part = _window((rows, columns), at_u, at_v, int(1.6 * radius) + 2)
        v = np.arange(rows, dtype=np.float32)[part[0], None]
        u = np.arange(columns, dtype=np.float32)[part[1]]
        du = u - np.float32(at_u)
        dv = v - np.float32(at_v)

        # The edge of the drop is wide, because the camera is focused on the road.
        distance = np.hypot(du, dv * 0.85) / np.float32(radius)
        inside = np.clip(1.25 - distance, 0, 0.75) / 0.75
        better = inside > self.cover[part]
        seen_u = at_u - DROP_MINIFICATION * du
        seen_v = at_v - DROP_MINIFICATION * dv
        self.map_u[part] = np.where(better, seen_u, self.map_u[part])
        self.map_v[part] = np.where(better, seen_v, self.map_v[part])
        cover = inside * 0.9
        self.cover[part] = np.maximum(self.cover[part], cover)

    def lay_blade(self, time_s: float) -> None:
        """Add the moving wiper blade.

        It is a blurred bar with the colour of the bottom of the image.
        """
        share = (time_s % WIPE_EVERY_S) / WIPE_S
        if share >= 1:
            return
        height, width = self.cover.shape
        angle = SWEEP_START_RAD + share * (SWEEP_END_RAD - SWEEP_START_RAD)
        pivot = np.array([PIVOT_U * width, PIVOT_V * height])
        direction = np.array([np.sin(angle), -np.cos(angle)])
        tip = pivot + BLADE_LENGTH * height * direction

        bar = np.zeros_like(self.cover)
        start, end = np.rint([pivot, tip]).astype(int).tolist()
        thickness = max(1, round(0.02 * height))
        cv2.line(bar, start, end, (0.95,), thickness, cv2.LINE_AA)
        blade = cv2.GaussianBlur(bar, (0, 0), 0.006 * height)
        over = blade > self.cover
        self.map_u[over] = width / 2
        self.map_v[over] = height - 2
        np.maximum(self.cover, blade, out=self.cover)


def add_windscreen_drops(
    light: np.ndarray,
    time_s: float,
    *,
    seed: int,
) -> None:
    """Put a wet windscreen with drops and wiper in front of the light, in place.

    `light` is (height, width, 3).
    """
    height, width = light.shape[:2]
    rows = height // DROP_DOWNSAMPLING
    columns = width // DROP_DOWNSAMPLING
    small = cv2.resize(light, (columns, rows), interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(small, (0, 0), 0.012 * height / DROP_DOWNSAMPLING)

    layer = _DropLayer(rows, columns)
    cycle = int(np.floor(time_s / WIPE_EVERY_S))
    for number in (cycle - 1, cycle):
        drops = _drops_of_cycle(number, time_s, seed)
        for drop in drops * [width, height, height] / DROP_DOWNSAMPLING:
            layer.lay_drop(*drop)
    layer.lay_blade(time_s)

    seen = cv2.remap(
        blurred,
        layer.map_u,
        layer.map_v,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT,
    )
    size = (width, height)
    seen = cv2.resize(seen, size, interpolation=cv2.INTER_LINEAR)
    cover = cv2.resize(layer.cover, size, interpolation=cv2.INTER_LINEAR)
    blend(light, seen, cover)


def _drops_of_cycle(
    number: int,
    time_s: float,
    seed: int,
) -> np.ndarray:
    """Drops (N, 3) that fell between two wipes and are not wiped off yet.

    The wipes are `number` and `number + 1`. u is a share of the width, v and radius are
    shares of the height.
    """
    rng = np.random.default_rng([seed, 91, number + 1000])
    u, v = rng.uniform(0, 1, (2, DROPS))
    radius = 0.005 + 0.021 * rng.uniform(0, 1, DROPS) ** 3
    born = (number + rng.uniform(0, 1, DROPS)) * WIPE_EVERY_S

    # Share of the sweep at which the blade meets the drop.
    angle = np.arctan2(u - PIVOT_U, (PIVOT_V - v) * 9 / 16)
    share = (angle - SWEEP_START_RAD) / (SWEEP_END_RAD - SWEEP_START_RAD)
    wiped = number * WIPE_EVERY_S + np.clip(share, 0, 1) * WIPE_S
    wiped = np.where(wiped <= born, wiped + WIPE_EVERY_S, wiped)
    present = (born <= time_s) & (time_s < wiped)
    return np.column_stack([u, v, radius])[present]


@lru_cache(maxsize=2)
def _streaks(height: int, width: int) -> np.ndarray:
    """Short, nearly vertical, blurred streaks in grey RGB, larger than the image."""
    rng = np.random.default_rng(92)
    rows = height + SPARE_PX
    columns = width + SPARE_PX
    layer = np.zeros((rows, columns), np.float32)
    for _ in range(FALLING_STREAKS):
        u = rng.uniform(0, columns)
        v = rng.uniform(0, rows)
        # Drops move away from the focus of expansion.
        direction = np.array([(u / columns - 0.5) * 0.5, 1.0])
        fall = direction * height * rng.uniform(0.02, 0.07)
        begin = np.array([u, v])
        ends = np.stack([begin, begin + fall]) * (1 << _SHIFT)
        start, end = np.rint(ends).astype(int).tolist()
        brightness = float(rng.uniform(0.2, 1.0))
        cv2.line(layer, start, end, (brightness,), 1, cv2.LINE_AA, _SHIFT)
    return three_channels(cv2.GaussianBlur(layer, (0, 0), 0.8))


@dataclass(frozen=True)
class Wet:
    """Wetness: `film` is the share of the surface under water."""

    film: float = 0.32

    def mirror_share(
        self,
        ground: Ground,
        height_m: float,
        *,
        seed: int,
    ) -> np.ndarray:
        """Specular reflectance (rows, width) of the road.

        Schlick's approximation times the coverage by puddles, which varies by noise, as
        ruts hold more water.
        """
        distance2 = ground.distance * ground.distance + np.float32(height_m**2)
        cosine = np.float32(height_m) / np.sqrt(distance2)
        fresnel = WATER + np.float32(1 - WATER) * (1 - cosine) ** 5
        noise = ground.noise(seed + 81, (5.0, 0.45), octaves=3, fading_m=12.0)
        puddles = np.float32(self.film) * (1 + 0.22 * noise)
        return fresnel * np.clip(puddles, 0, 0.95)


def add_lamp_reflections(
    light: np.ndarray,
    camera: Camera,
    lamps: list[Lamp],
    share: np.ndarray,
    open_to: np.ndarray,
) -> None:
    """Add the reflections of lamps in the road to the light, in place.

    `light` is (height, width, 3). `share` (rows, width) is the reflectance of
    `Wet.mirror_share` for the lowest rows of the image, `open_to` (height, width) the
    mask of the visible road.
    """
    height, width = light.shape[:2]
    coarse = STREAK_DOWNSAMPLING
    layer = np.zeros((height // coarse, width // coarse, 3), np.float32)
    rows, columns = np.mgrid[: height // coarse, : width // coarse].astype(np.float32)
    rows *= coarse
    columns *= coarse
    far_away = np.array([[3000.0, 0.0]])
    horizon = float(camera.road_to_pixels(far_away)[0, 1])

    mirrored = lamp_pixels(camera, lamps, mirrored=True)
    for lamp, (u, v) in zip(lamps, mirrored, strict=True):
        if not (-50 < u < width + 50 and v < 2 * height):
            continue
        wide = max(camera.matrix[0, 0] * STREAK_WIDE_M / lamp.distance_m, 2.0)
        long = max(STREAK_LONG * (v - horizon), 4.0)
        # The lamp's energy is spread over the streak.
        energy = lamp.radius_px(camera) ** 2 / (2 * wide * long)

        # Columns of the streak.
        first = max(int((u - 3 * wide) / coarse), 0)
        last = max(int((u + 3 * wide) / coarse), -2)
        at = slice(first, last + 2)
        across = (columns[:, at] - u) ** 2 / (2 * wide**2)
        down = (rows[:, at] - v) ** 2 / (2 * long**2)
        streak = (np.float32(energy) * np.exp(-across - down))[..., None]
        layer[:, at] += streak * lamp.light.astype(np.float32)

    top = height - len(share)
    layer = cv2.resize(layer, (width, height), interpolation=cv2.INTER_LINEAR)[top:]
    layer *= three_channels(share * open_to[top:])
    light[top:] += layer
