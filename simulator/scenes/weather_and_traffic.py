"""Scenes of the suite on a plain motorway and a country road.

Weather, light and traffic hide the lines.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

import numpy as np

from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import Glare, TreeShade, WoodShade
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.objects.walls import Overpass
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import Marking
from simulator.road.surface import Seam, Zone
from simulator.scenes.freeway import (
    LANE_WIDTH_M,
    Daylight,
    Freeway,
    car,
    daylight,
    freeway_drive,
    oncoming_car,
    oncoming_cars,
    plant_trees,
)
from simulator.scenes.mountain import country_road_drive
from simulator.weather import Fog, Night, Wet

OPPOSITE_EDGE_M = 17.0
# Centre of the lane right of the ego lane.
RIGHT_LANE_M = -LANE_WIDTH_M


PLAIN = Freeway(phase_m=3.0, wear=0.25, opposite_m=OPPOSITE_EDGE_M)
DAY = daylight(75, 50, tree_density=0.4)
OVERCAST = daylight(75, 50, overcast=True, tree_density=0.4, cloud_cover=1.0)
OVERCAST_LENS = Lens(exposure=0.5)


def plain_motorway(
    seed: int,
    freeway: Freeway = PLAIN,
    *,
    light: Daylight = DAY,
    **changes: Any,
) -> Drive:
    """Motorway that bends left, then right; the car is in the leftmost lane.

    `changes` are fields of Drive.
    """
    road = RoadGeometry(
        [0.0, 55.0, 120.0, 300.0, 360.0],
        [1 / 520, 1 / 520, -1 / 430, -1 / 430, 0.0],
    )
    motion = Motion(
        offset_m=0.12,
        wander_m=0.2,
        wander_period_s=6.0,
        pitch_rad=radians(0.2),
    )
    objects = (
        car(38.0, -1, "silver", speed_mps=27.0),
        car(64.0, -2, "white", "suv", speed_mps=26.0),
        car(105.0, -1, "black", "suv", speed_mps=28.0),
        car(120.0, 0, "grey", speed_mps=28.5),
        PlacedWall(4.4, "jersey", seed=seed),
        *oncoming_cars(
            seed + 1,
            s_m=(60, 620),
            opposite_m=OPPOSITE_EDGE_M,
            speed_mps=26.0,
        ),
        *plant_trees(
            seed + 2,
            "oak plane",
            s_m=(10, 560),
            d_m=(-40, -21),
            height_m=(4, 10),
            every_m=15,
        ),
        *plant_trees(
            seed + 3,
            "plane oak",
            s_m=(30, 560),
            d_m=(34, 50),
            height_m=(6, 11),
            every_m=20,
        ),
    )
    drive = freeway_drive(
        freeway, road, light, motion=motion, objects=objects, seed=seed
    )
    return replace(drive, **changes)


def _pale_concrete() -> Drive:
    freeway = replace(
        PLAIN,
        pavement="concrete",
        seams=(
            Seam(0.4, 0.02, wander_m=0.10, start_m=20.0, end_m=90.0),
            Seam(-0.9, 0.03, wander_m=0.08, start_m=60.0, end_m=150.0),
        ),
        wear=0.55,
    )
    drive = plain_motorway(301, freeway, lens=Lens(exposure=0.3))
    return replace(drive, motion=replace(drive.motion, speed_mps=33.0))


def _dapple() -> Drive:
    rng = np.random.default_rng(311)
    starts = np.arange(0.0, 230.0, 11.0)
    shades = []
    for start in (starts + rng.uniform(-2, 2, len(starts))).tolist():
        shade = TreeShade(
            start_m=start,
            end_m=start + rng.uniform(7, 15),
            low_m=-rng.uniform(1, 7),
            high_m=rng.uniform(3, 9),
            density=rng.uniform(0.85, 0.97),
        )
        shades.append(shade)
    return plain_motorway(
        311,
        replace(PLAIN, pavement="old asphalt"),
        shades=tuple(shades),
        exposure=AutoExposure(0.7, 0.6),
        lens=Lens(exposure=0.6),
    )


def _underpass() -> Drive:
    bridge = Overpass(48.0, 78.0, -18.5, 11.5, skew=0.15)
    drive = plain_motorway(
        321,
        shades=(bridge.shade(),),
        exposure=AutoExposure(0.7, 0.85),
        lens=Lens(exposure=0.6),
    )
    return replace(drive, objects=(*drive.objects, bridge))


def _low_sun() -> Drive:
    return plain_motorway(
        331,
        light=daylight(4, 12, tree_density=0.4, haze_per_km=0.12),
        glare=Glare(veil=1.1, sheen=1.8),
        shades=(TreeShade(50.0, 64.0, -4.0, 8.0, 0.9),),
        lens=Lens(noise=0.005),
    )


def _dirty_glass() -> Drive:
    return country_road_drive(
        341,
        light=daylight(-28, 22, tree_density=0.9),
        glare=Glare(veil=1.2, dashboard=1.6),
        exposure=AutoExposure(0.8, 0.6),
    )


def _white_out() -> Drive:
    concrete = Zone(44.0, "concrete", 0.2)
    return plain_motorway(
        351,
        replace(PLAIN, pavement="fresh asphalt", zones=(concrete,)),
        shades=(WoodShade(-60.0, 41.0, 0.05),),
        exposure=AutoExposure(1.5, 0.6),
        lens=Lens(exposure=1.2),
    )


def _deep_shade() -> Drive:
    return country_road_drive(
        361,
        shades=(WoodShade(-60.0, 400.0, 0.035),),
        exposure=AutoExposure(0.8, 0.55),
    )


def _fog() -> Drive:
    return plain_motorway(371, light=OVERCAST, lens=OVERCAST_LENS, fog=Fog(85.0))


def _haze() -> Drive:
    return plain_motorway(
        381,
        light=daylight(20, 35, tree_density=0.4),
        fog=Fog(420.0, (0.62, 0.62, 0.60)),
    )


def _wet_night() -> Drive:
    lamp = Post(9.0, 0.18, arm_m=2.4)
    drive = plain_motorway(
        391,
        night=Night(),
        wet=Wet(film=0.4),
        objects=(
            car(30.0, -1, "silver", speed_mps=21.0),
            car(62.0, 0, "black", "suv", speed_mps=23.0),
            car(90.0, -2, "grey", speed_mps=20.0),
            oncoming_car(70.0, 3.55, "white", speed_mps=19.0),
            oncoming_car(128.0, 3.55, "blue", speed_mps=19.0),
            oncoming_car(190.0, 3.55, "red", speed_mps=19.0),
            *(PlacedObject(12.0 + 42.0 * i, -15.2, lamp) for i in range(9)),
        ),
        lens=Lens(noise=0.028, exposure=0.9),
    )
    # A two-way road: oncoming cars are left of the lane's left line.
    lines = Freeway(phase_m=3.0, wear=0.3).markings()
    edge_m = LANE_WIDTH_M * 1.5
    return replace(
        drive,
        markings=(*lines, Marking(edge_m)),
        surface=replace(drive.surface, left_edge_m=edge_m + 1.5, opposite_m=None),
        motion=replace(drive.motion, speed_mps=22.0),
    )


def _rain() -> Drive:
    return plain_motorway(
        401,
        light=OVERCAST,
        lens=OVERCAST_LENS,
        rain=True,
        wet=Wet(),
        fog=Fog(700.0, (0.40, 0.42, 0.45)),
    )


def _with_traffic(drive: Drive, *others: PlacedObject) -> Drive:
    """The drive with other vehicles instead of those on the car's carriageway."""
    kept = []
    for item in drive.objects:
        if not (isinstance(item, PlacedObject) and item.speed_mps > 0):
            kept.append(item)
    return replace(drive, objects=(*kept, *others))


def _motorcycle() -> Drive:
    path = (
        (0.0, -2.0),
        (0.8, -1.7),
        (2.0, 1.6),
        (2.8, 1.7),
        (4.0, -0.4),
    )
    rider = PlacedObject(13.0, 0.0, Car("red", "motorcycle"), 15.6, path)
    return _with_traffic(country_road_drive(411), rider)


def _cut_in() -> Drive:
    path = (
        (0.0, RIGHT_LANE_M),
        (0.5, RIGHT_LANE_M),
        (2.0, -0.2),
        (2.7, -0.2),
        (4.2, RIGHT_LANE_M),
    )
    return _with_traffic(
        plain_motorway(421),
        PlacedObject(16.0, 0.0, Car("white", "suv"), 27.6, path),
        car(70.0, -1, "black", speed_mps=28.0),
        car(95.0, 0, "silver", speed_mps=29.0),
    )


def _lorry() -> Drive:
    path = (
        (0.0, RIGHT_LANE_M),
        (0.8, RIGHT_LANE_M),
        (1.8, -2.6),
        (3.3, -2.6),
        (4.5, RIGHT_LANE_M),
    )
    return _with_traffic(
        plain_motorway(431),
        PlacedObject(17.0, 0.0, Car("blue", "truck"), 26.4, path),
        car(80.0, 0, "red", speed_mps=29.0),
    )


SCENES = (
    SuiteScene(
        "pale-concrete",
        "medium",
        4.0,
        "Worn paint on light, cracked concrete at 120 km/h.",
        _pale_concrete,
    ),
    SuiteScene(
        "dapple",
        "medium",
        5.0,
        "Dappled shadows of tree crowns all along the road.",
        _dapple,
    ),
    SuiteScene(
        "underpass",
        "hard",
        4.0,
        "Bright, dark, bright: below a wide bridge, delayed exposure.",
        _underpass,
    ),
    SuiteScene(
        "low-sun",
        "hard",
        4.0,
        "A low sun ahead: veiling glare, a shining road.",
        _low_sun,
    ),
    SuiteScene(
        "dirty-glass",
        "hard",
        4.0,
        "Sun on a dirty windscreen that reflects the dashboard.",
        _dirty_glass,
    ),
    SuiteScene(
        "white-out",
        "hard",
        4.0,
        "From a dark wood onto sunny concrete: overexposed for a second.",
        _white_out,
    ),
    SuiteScene(
        "deep-shade",
        "medium",
        4.0,
        "A winding road in the blue shade of a wood, sun flecks.",
        _deep_shade,
    ),
    SuiteScene(
        "fog",
        "hard",
        4.0,
        "Dense fog: 5 % of the contrast is left at 85 m.",
        _fog,
    ),
    SuiteScene(
        "haze",
        "medium",
        4.0,
        "Far lines fade in bright haze.",
        _haze,
    ),
    SuiteScene(
        "wet-night",
        "hard",
        5.0,
        "Headlights on a wet road with reflections of lamps.",
        _wet_night,
    ),
    SuiteScene(
        "rain",
        "hard",
        5.0,
        "Drops on the windscreen between wipes, a road that reflects the clouds.",
        _rain,
    ),
    SuiteScene(
        "motorcycle",
        "medium",
        4.0,
        "A motorcycle weaves across the lane and both of its lines.",
        _motorcycle,
    ),
    SuiteScene(
        "cut-in",
        "medium",
        4.5,
        "A car crosses the line into the ego lane, and leaves it again.",
        _cut_in,
    ),
    SuiteScene(
        "lorry",
        "hard",
        4.5,
        "A lorry hides the broken line for two seconds, driving on it.",
        _lorry,
    ),
)
