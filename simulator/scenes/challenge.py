"""The two harder committed drives: a patched motorway with a bridge, and hairpins in a wood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simulator.light.glare import Glare
from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import TreeShade, WoodShade
from simulator.objects.overpass import Overpass
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.vehicles import Car
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import Symbol
from simulator.road.surface import Patch, Seam
from simulator.scenes.freeway import car, daylight
from simulator.scenes.motorway import JOINT_BARRIER_M, joint_fields, motorway_drive
from simulator.scenes.mountain import MOUNTAIN_LANE_WIDTH_M, mountain_drive, winding_road
from simulator.weather.fog import Fog

# Higher than for the project video, so that each file is below 3.5 MB: concrete and leaves need many bits.
CHALLENGE_CRF, HARDER_CRF = 25, 27


def challenge_video() -> Drive:
    """Nine seconds at 25 m/s: pale lanes, a dark strip at the yellow line, tar seams, a barrier, a bridge.

    The joint between dark and pale pavement is in the middle of the lane for the whole drive. There is one seam before
    the bridge and one after it.
    """
    bridge = Overpass(112.0, 128.0, -20.0, 15.5, skew=0.12)
    joint = joint_fields(
        Seam(-0.95, 0.025, 0.03, 150.0, 190.0, 0.6),
        Seam(-0.55, 0.03, 0.05, 20.0, 70.0, 0.6),
        patches=(Patch(60.0, 84.0, -7.0, -3.9, "asphalt"),),
    )
    return motorway_drive(
        road=RoadGeometry(
            [0.0, 40.0, 90.0, 140.0, 180.0, 260.0, 330.0, 420.0],
            [-1 / 900, -1 / 620, -1 / 620, 0.0, 1 / 1600, 1 / 1200, 0.0, 0.0],
        ),
        objects=(
            PlacedWall(JOINT_BARRIER_M, "jersey", height_scale=1.25, seed=25),
            motorway_drive().objects[1],
            bridge,
            car(26.0, -1, "black", "suv", speed_mps=26.5),
            car(64.0, -2, "white", speed_mps=25.0),
            car(-12.0, -1, "silver", speed_mps=29.0),
            car(90.0, 0, "grey", speed_mps=26.5),
            # No objects where the bridge is.
            *(t for t in motorway_drive().objects[4:] if isinstance(t, PlacedWall | Overpass) or not 104 < t.s_m < 136),
        ),
        symbols=(Symbol(72.0, 0.0, "diamond", 3.7, 1.0, wear=0.4), Symbol(190.0, 0.0, "diamond", 3.7, 1.0, wear=0.4)),
        shades=(bridge.shade(),),
        exposure=AutoExposure(strength=0.6),
        seed=171,
        **joint | {"lens": replace(joint["lens"], exposure=1.75)},
        **daylight(70, 56, cloud_cover=0.45, tree_density=0.7),
    )


def harder_challenge_video() -> Drive:
    """Ten seconds at 8 to 11 m/s: hairpins left (R 21 m) and right (R 17 m) in a wood, with a low sun in haze.

    Deep shade with sun flecks before the first one, glare in it, an oncoming car after it, dappled shade in the second.
    """
    road = winding_road((21.0, 115.0), (-17.0, 125.0), straight_m=7.0, ease_m=10.0)
    base = mountain_drive(road, Motion())
    return mountain_drive(
        road,
        Motion(
            1.0,
            11.0,
            offset_m=-0.05,
            wander_m=0.2,
            wander_period_s=4.5,
            pitch_rad=float(np.radians(0.3)),
            later_speeds=((1.5, 8.5), (5.0, 8.5), (6.0, 9.5), (7.5, 8.0)),
        ),
        markings=tuple(replace(m, wear=wear) for m, wear in zip(base.markings, (0.55, 0.4, 0.45), strict=True)),
        objects=(*base.objects, PlacedObject(96.0, MOUNTAIN_LANE_WIDTH_M, Car("blue", heading_rad=np.pi), -8.0)),
        shades=(
            WoodShade(-20.0, 24.0, flecks=0.10),
            TreeShade(58.0, 70.0, -5.0, 7.0, 0.95),
            TreeShade(72.0, 84.0, -3.0, 8.0, 0.9),
            TreeShade(88.0, 108.0, -6.0, 8.0, 0.97),
        ),
        exposure=AutoExposure(strength=0.6),
        fog=Fog(2500.0, height_m=200.0),
        glare=Glare(veil=0.6, sheen=0.8, dashboard=0.3),
        lens=Lens(noise=0.004, exposure=0.3),
        seed=172,
        **daylight(45, 28, tree_density=0.3, greenness=0.8, ridge_height_rad=0.30, hill_height_rad=0.22),
    )


SCENES = (
    SuiteScene("challenge", "hard", 9.0, "Dark joint and seam in the lane, a bridge, pale concrete.", challenge_video),
    SuiteScene("harder-challenge", "hard", 10.0, "Hairpins in a wood: shade, glare, haze.", harder_challenge_video),
)  # fmt: skip
