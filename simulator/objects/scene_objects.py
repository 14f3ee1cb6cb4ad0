"""Objects on and beside the road: vehicles, trees, signs and posts.

Positions are in the car's road frame: x forward, y left, z up, metres; the camera is above the origin.
`ground_height_m` is the height of the road at the object above the plane under the car.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.objects.overpass import BridgeSlice
from simulator.objects.walls import Wall


@dataclass(frozen=True)
class Car:
    """Vehicle with its centre at (x_m, y_m); heading 0 is the car's own direction, pi is oncoming.

    `body` is "sedan", "suv", "truck" or "motorcycle".
    """

    x_m: float
    y_m: float
    heading_rad: float = 0.0
    paint: str = "white"
    body: str = "sedan"
    ground_height_m: float = 0.0


@dataclass(frozen=True)
class Tree:
    """Tree or bush; `species` is a name in `foliage.SPECIES`."""

    x_m: float
    y_m: float
    height_m: float = 10.0
    species: str = "oak"
    seed: int = 0
    base_m: float = 0.0
    ground_height_m: float = 0.0


@dataclass(frozen=True)
class Sign:
    """Sign on one or two posts, facing the traffic: kind "green", "speed", "warning" or "blue"."""

    x_m: float
    y_m: float
    kind: str = "green"
    width_m: float = 1.8
    height_m: float = 1.2
    bottom_m: float = 2.1
    ground_height_m: float = 0.0


@dataclass(frozen=True)
class Post:
    """Vertical pole: a delineator (1 m), a utility pole or, with an arm of length `arm_m`, a street lamp."""

    x_m: float
    y_m: float
    height_m: float = 1.0
    width_m: float = 0.1
    arm_m: float = 0.0
    colour: tuple[float, float, float] = (0.55, 0.55, 0.53)
    ground_height_m: float = 0.0


SceneObject = Car | Wall | BridgeSlice | Tree | Sign | Post


def yaw_rotation(heading_rad: float) -> np.ndarray:
    """Rotation matrix (3, 3) about z by a heading, > 0 turns left."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def vertical_rectangle(x: float, y: float, left: float, right: float, bottom: float, top: float) -> np.ndarray:
    """Corners (4, 3) of a vertical rectangle across the road: lower right, upper right, upper left, lower left."""
    return np.array([[x, y - right, bottom], [x, y - right, top], [x, y + left, top], [x, y + left, bottom]])
