"""Building blocks of the scenes: markings and surface of a freeway, trees, traffic, road and daylight."""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.backdrop import BackdropStyle
from simulator.light.sunlight import Sun
from simulator.objects.scene_objects import Car, PlacedObject, PlacedWall, Tree
from simulator.objects.walls import WALLS
from simulator.rendering.drive import Drive
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import WHITE, YELLOW, Marking
from simulator.road.surface import Patch, Seam, Surface, Zone
from simulator.scenes.dashcam import DASHCAM

# Twelve feet, the lane of a US freeway.
LANE_WIDTH_M = 3.66
# Lateral positions of the lines of the ego lane, whose centre is the reference line.
EGO_LINES_M = (LANE_WIDTH_M / 2, -LANE_WIDTH_M / 2)
# Opposite carriageway: a narrow shoulder, three lanes and a wide shoulder.
OPPOSITE_SHOULDER_M = 1.6
OPPOSITE_WIDTH_M = OPPOSITE_SHOULDER_M + 3 * LANE_WIDTH_M + 2.8


def freeway_drive(**fields: Any) -> Drive:
    """Drive on a freeway, seen by the course's camera, in the lane between EGO_LINES_M; `fields` are those of Drive."""
    usual: dict[str, Any] = {"camera": DASHCAM, "line_laterals_m": EGO_LINES_M}
    return Drive(**usual | fields)


def freeway_markings(
    *,
    lanes_left: int = 0,
    lanes_right: int = 3,
    phase_m: float = 0.0,
    wear: float = 0.15,
    opposite_m: float | None = None,
) -> tuple[Marking, ...]:
    """Markings of a freeway; the centre of the ego lane is the reference line.

    The leftmost line is solid yellow, the rightmost solid white, the others broken white. `lanes_left` and
    `lanes_right` count the lanes next to the ego lane, `phase_m` is the start of a dash of the leftmost broken line,
    `wear` is that of Marking. With `opposite_m`, the right edge of the opposite carriageway, its lines are added.
    """
    marks = [Marking((lanes_left + 0.5) * LANE_WIDTH_M, 0.15, YELLOW, wear=wear, dots=True)]
    for number in range(lanes_left + lanes_right):
        lateral = (lanes_left - 0.5 - number) * LANE_WIDTH_M
        # Neighbouring lines are painted in one pass, so their dashes are nearly aligned.
        marks.append(Marking(lateral, 0.12, WHITE, dashed=True, phase_m=phase_m + 0.35 * number, wear=wear, dots=True))
    marks.append(Marking(-(lanes_right + 0.5) * LANE_WIDTH_M, 0.12, WHITE, wear=wear))
    if opposite_m is not None:
        inner = opposite_m + OPPOSITE_SHOULDER_M
        marks += [Marking(inner, 0.12, YELLOW), Marking(inner + 3 * LANE_WIDTH_M, 0.12, WHITE)]
        marks += [Marking(inner + n * LANE_WIDTH_M, 0.12, WHITE, dashed=True, phase_m=phase_m + 3 * n) for n in (1, 2)]
    return tuple(marks)


def freeway_surface(
    *zones: Zone,
    lanes_left: int = 0,
    lanes_right: int = 3,
    left_shoulder_m: float = 2.4,
    right_shoulder_m: float = 2.8,
    opposite_m: float | None = None,
    patches: tuple[Patch, ...] = (),
    seams: tuple[Seam, ...] = (),
) -> Surface:
    """Surface of the same carriageway, with a paving joint next to each broken line; see `freeway_markings`."""
    centres = tuple((lanes_left - number) * LANE_WIDTH_M for number in range(lanes_left + lanes_right + 1))
    joints = tuple(Seam(c - LANE_WIDTH_M / 2 - 0.18, 0.025, 0.02, strength=0.5) for c in centres[:-1])
    return Surface(
        zones,
        right_edge_m=-(lanes_right + 0.5) * LANE_WIDTH_M - right_shoulder_m,
        left_edge_m=(lanes_left + 0.5) * LANE_WIDTH_M + left_shoulder_m,
        lane_centres_m=centres,
        opposite_m=None if opposite_m is None else (opposite_m, opposite_m + OPPOSITE_WIDTH_M),
        patches=patches,
        seams=joints + seams,
    )


def bend_road(curvature_per_m: float, *, before_m: float = 60.0, ahead_m: float = 300.0, rate: float = 1.5e-5):
    """Road with constant curvature around arc length 100, where the car of a still is, and a straight end."""
    ease = max(abs(curvature_per_m) / rate, 30.0)
    return RoadGeometry(
        [0.0, 100 - before_m, 100 + ahead_m, 100 + ahead_m + ease],
        [curvature_per_m * 0.4, curvature_per_m, curvature_per_m, 0.0],
    )


def daylight(azimuth_deg: float, elevation_deg: float, **landscape: float) -> dict:
    """Fields `sun` and `backdrop` of a Drive; `landscape` holds fields of BackdropStyle."""
    sun = Sun(float(np.radians(azimuth_deg)), float(np.radians(elevation_deg)))
    style = BackdropStyle(sun_azimuth_rad=sun.azimuth_rad, sun_elevation_rad=sun.elevation_rad, **landscape)
    return {"sun": sun, "backdrop": style}


def plant_trees(
    seed: int,
    species: str,
    *,
    s_m: tuple[float, float],
    d_m: tuple[float, float],
    height_m: tuple[float, float],
    every_m: float,
    bank: PlacedWall | None = None,
) -> tuple[PlacedObject, ...]:
    """Trees or bushes at random positions next to the road, about every `every_m` metres, on a bank where one is given.

    `species` are names in trees.SPECIES, separated by blanks, chosen at random. `s_m`, `d_m` and `height_m` are
    ranges of arc length, lateral position and height of the trees.
    """
    rng = np.random.default_rng(seed)
    outward, height = np.array(WALLS["bank"].lines).T
    trees = []
    for s in np.arange(*s_m, every_m):
        lateral = float(rng.uniform(*d_m))
        base = 0.0
        if bank is not None:
            base = float(np.interp(abs(lateral - bank.lateral_m), outward, height)) * bank.height_scale
        tree = Tree(0, 0, rng.uniform(*height_m), str(rng.choice(species.split())), int(rng.integers(6)), base)
        trees.append(PlacedObject(float(s + rng.uniform(-0.4, 0.4) * every_m), lateral, tree))
    return tuple(trees)


def oncoming_cars(
    seed: int, *, s_m: tuple[float, float], opposite_m: float, speed_mps: float = 0.0
) -> tuple[PlacedObject, ...]:
    """Oncoming cars on the opposite carriageway, whose right edge is at lateral `opposite_m`."""
    rng = np.random.default_rng(seed)
    cars = []
    for s in np.arange(*s_m, 45.0):
        paint, body = str(rng.choice(["white", "silver", "grey", "blue", "black"])), str(rng.choice(["sedan", "suv"]))
        lateral = opposite_m + OPPOSITE_SHOULDER_M + LANE_WIDTH_M * (0.5 + float(rng.integers(3)))
        cars.append(PlacedObject(float(s + rng.uniform(-15, 15)), lateral, Car(0, 0, np.pi, paint, body), -speed_mps))
    return tuple(cars)


def car(s_m: float, lane: int, paint: str, body: str = "sedan", *, speed_mps: float = 0.0) -> PlacedObject:
    """Car in the centre of a lane; `lane` is 0 for the ego lane, > 0 to the left."""
    return PlacedObject(s_m, lane * LANE_WIDTH_M, Car(0, 0, 0.0, paint, body), speed_mps)
