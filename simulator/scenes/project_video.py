"""The course's project video."""

from __future__ import annotations

import numpy as np

from simulator.light.lens import Lens
from simulator.light.sunlight import TreeShade
from simulator.objects.placement import PlacedObject, PlacedWall
from simulator.objects.scene_objects import Sign
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry
from simulator.road.surface import Patch, Seam, Zone
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import (
    EGO_LINES_M,
    car,
    daylight,
    freeway_markings,
    freeway_surface,
    oncoming_cars,
    plant_trees,
)


def project_video() -> Drive:
    """Ten seconds at 27 m/s: straight, an S-bend left (R 520 m) and right (R 400 m), tree shadows, light concrete."""
    bank = PlacedWall(-18.0, "bank", seed=16)
    return Drive(
        camera=DASHCAM,
        road=RoadGeometry(
            [0.0, 75.0, 125.0, 175.0, 255.0, 330.0, 420.0, 600.0],
            [0.0, 0.0, 1 / 520, 1 / 520, -1 / 400, -1 / 400, 0.0, 0.0],
        ),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=4.0, wear=0.25, opposite_m=17.0),
        surface=freeway_surface(
            Zone(-100.0, "fresh asphalt"),
            Zone(190.0, "concrete", 0.3),
            Zone(245.0, "asphalt", 0.2),
            opposite_m=17.0,
            patches=(Patch(70.0, 78.0, -1.6, 0.1, "asphalt"),),
            seams=(Seam(0.5, 0.03, 0.08, 95.0, 130.0),),
        ),
        shades=(
            TreeShade(142.0, 158.0, -5.0, 8.0, 0.95),
            TreeShade(163.0, 172.0, -1.0, 8.0, 0.9),
            TreeShade(238.0, 254.0, -4.0, 9.0, 0.95),
        ),
        objects=(
            PlacedWall(4.4, "jersey", seed=15),
            bank,
            car(14.0, -1, "white", speed_mps=25.3),
            car(46.0, -2, "black", "suv", speed_mps=27.5),
            car(95.0, -1, "silver", speed_mps=29.0),
            car(130.0, 0, "grey", speed_mps=28.5),
            PlacedObject(120.0, -16.7, Sign(0, 0, "green", 3.2, 1.6, 2.6)),
            PlacedObject(205.0, -16.5, Sign(0, 0, "speed", 0.9, 1.2, 2.1)),
            *oncoming_cars(7, s_m=(60, 640), opposite_m=17.0, speed_mps=26.0),
            *plant_trees(21, "oak bush", s_m=(10, 620), d_m=(-40, -31), height_m=(4, 9), every_m=14, bank=bank),
            *plant_trees(22, "scrub bush", s_m=(10, 620), d_m=(-30, -21), height_m=(0.8, 2.0), every_m=13, bank=bank),
            *plant_trees(23, "eucalyptus oak", s_m=(140, 176), d_m=(11, 13), height_m=(11, 14), every_m=9),
            *plant_trees(24, "eucalyptus plane", s_m=(238, 262), d_m=(11, 13), height_m=(11, 14), every_m=9),
            *plant_trees(25, "plane oak", s_m=(60, 620), d_m=(34, 50), height_m=(6, 11), every_m=22),
        ),
        motion=Motion(0.0, 27.0, offset_m=0.05, wander_m=0.22, wander_period_s=6.5, pitch_rad=float(np.radians(0.22))),
        lens=Lens(noise=0.005),
        seed=99,
        **daylight(75, 50, tree_density=0.7),
    )
