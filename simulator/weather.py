"""Night: headlights on road and objects, retroreflective paint, street lamps, and lamps of other vehicles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.objects.scene_objects import SceneObject
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.road.ground import Ground
from simulator.road.markings import Marking

HALOGEN = np.array([1.0, 0.86, 0.62], np.float32)
SODIUM = np.array([1.0, 0.62, 0.25], np.float32)
TOWN_GLOW = np.array([0.010, 0.007, 0.005], np.float32)
# Low beam: half width, and the distance beyond which the light on the road falls steeply.
BEAM_HALF_WIDTH_RAD, BEAM_RANGE_M = 0.32, 20.0
# Lamps of vehicle bodies in their own frame: (x, y, z) of one lamp of a pair, colour times brightness.
TAIL_LIGHT, HEADLIGHT = np.array([1.0, 0.05, 0.03]) * 3.0, np.array([1.0, 0.93, 0.80]) * 25.0
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

    def beam(self, x_m: np.ndarray, y_m: np.ndarray, *, upright: bool = False) -> np.ndarray:
        """Light of the headlights at positions of any shape, on level ground or on `upright` surfaces.

        Level ground is lit at a grazing angle, so its light falls with one more power of the distance.
        """
        distance2 = (np.hypot(x_m, y_m) / BEAM_RANGE_M) ** 2
        aside = np.arctan2(y_m, np.maximum(x_m, np.float32(0.1))) / np.float32(BEAM_HALF_WIDTH_RAD)
        fall = 1 / (1 + distance2) ** (1.0 if upright else 1.5)
        return np.float32(self.headlights) * fall * np.exp(-(np.abs(aside) ** 2.5))

    def ground_light(self, ground: Ground, objects: list[SceneObject]) -> np.ndarray:
        """Light (rows, width, 3) on the ground from headlights, street lamps and sky."""
        x, y = (cv2.resize(a, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for a in (ground.x, ground.y))
        light = self.beam(x, y)[..., None] * HALOGEN + np.float32(self.ambient)
        for lamp in objects:
            if isinstance(lamp, Post) and lamp.arm_m:
                # Cosine of incidence over squared distance, 1 below the lamp.
                below = (1 + ((x - lamp.x_m) ** 2 + (y - lamp.y_m - lamp.arm_m) ** 2) / lamp.height_m**2) ** -1.5
                light += (np.float32(self.street_lamp) * below**1.5)[..., None].astype(np.float32) * SODIUM
        return cv2.resize(light.astype(np.float32), ground.x.shape[::-1], interpolation=cv2.INTER_LINEAR)

    def object_light(self, places_m: np.ndarray) -> np.ndarray:
        """Light (N, 3) on objects at positions (N, 2)."""
        return self.beam(*places_m.T, upright=True)[:, None] * HALOGEN + np.float32(self.ambient)

    def markings(self, markings: tuple[Marking, ...]) -> tuple[Marking, ...]:
        """The markings with colours multiplied by the retroreflection."""
        gain = self.retroreflection
        return tuple(replace(m, colour=(gain * m.colour[0], gain * m.colour[1], gain * m.colour[2])) for m in markings)

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
                lamps += [Lamp(p, light * facing) for p in (at if y else at[:1]) if facing > 0.05 and p[0] > 1]
    return lamps


def visible_lamps(objects: list[SceneObject], camera: Camera) -> list[Lamp]:
    """Lamps of `find_lamps` that are not hidden by a nearer vehicle."""
    lamps = find_lamps(objects)
    seen = list(zip(lamps, lamp_pixels(camera, lamps).tolist(), strict=True))
    for car in (item for item in objects if isinstance(item, Car) and item.x_m > MIN_OCCLUDER_M):
        pixels = camera.road_to_pixels(car.outline_m())
        hull = cv2.convexHull(pixels[np.isfinite(pixels).all(axis=1)].astype(np.float32))
        if hull is None:  # outside the field of view of the lens
            continue
        # Its own lamps that face the camera are nearer than its centre.
        until_m = np.linalg.norm(car.foot_m)
        seen = [
            (lamp, px) for lamp, px in seen if lamp.distance_m < until_m or cv2.pointPolygonTest(hull, px, False) <= 0
        ]
    return [lamp for lamp, _ in seen]


def lamp_pixels(camera: Camera, lamps: list[Lamp], *, mirrored: bool = False) -> np.ndarray:
    """Pixels (N, 2) of the lamps, or of their mirror images in level ground; NaN outside the view of the lens."""
    places = np.array([lamp.place_m for lamp in lamps]).reshape(-1, 3)
    return camera.road_to_pixels(places * [1, 1, -1 if mirrored else 1])


def add_lamps(light: np.ndarray, camera: Camera, lamps: list[Lamp]) -> None:
    """Add lamps and their glow to the light, in place."""
    height, width = light.shape[:2]
    glow: np.ndarray = np.zeros((height // GLOW_DOWNSAMPLING, width // GLOW_DOWNSAMPLING, 3), np.float32)
    for lamp, (u, v) in zip(lamps, lamp_pixels(camera, lamps), strict=True):
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        radius = camera.matrix[0, 0] * lamp.radius_m / lamp.distance_m
        _add_disc(light, u, v, radius, lamp.light)
        # Energy of the disc in one coarse pixel.
        glow[int(v) // GLOW_DOWNSAMPLING % len(glow), int(u) // GLOW_DOWNSAMPLING % glow.shape[1]] += (
            lamp.light * np.pi * max(radius, 0.5) ** 2 / GLOW_DOWNSAMPLING**2
        )
    scale = height / 720 / GLOW_DOWNSAMPLING
    spread: Any = sum(np.float32(share) * cv2.GaussianBlur(glow, (0, 0), size * scale) for size, share in HALOS)
    glow = cv2.resize(spread, (width, height), interpolation=cv2.INTER_LINEAR)
    light += glow


def _add_disc(light: np.ndarray, u: float, v: float, radius: float, colour: np.ndarray) -> None:
    """Add a soft disc, in place; discs smaller than a pixel are dimmed by their area."""
    sigma = max(radius / 1.5, 0.7)
    reach = int(3 * sigma) + 1
    top, left = max(int(v) - reach, 0), max(int(u) - reach, 0)
    part = light[top : int(v) + reach + 1, left : int(u) + reach + 1]
    rows, columns = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
    disc = np.exp(-((rows - v) ** 2 + (columns - u) ** 2) / (2 * sigma**2)) * min(1.0, (radius / 1.5 / sigma) ** 2)
    part += (disc[..., None] * colour).astype(np.float32)
