"""Scenes of the suite without a lane, where no lane may be found."""

from __future__ import annotations

import numpy as np

from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import RoadGeometry
from simulator.road.surface import Patch, Seam, Surface, Zone
from simulator.scenes.freeway import plant_trees
from simulator.scenes.motorway import motorway_drive

BAY_M, STALL_M, LINE_M = 5.0, 2.6, 0.10


def _unmarked_road() -> Drive:
    return motorway_drive(
        road=RoadGeometry([0.0, 30.0, 60.0, 90.0, 140.0], [0.0, 1 / 90, 1 / 90, -1 / 120, 0.0]),
        line_laterals_m=(),
        markings=(),
        surface=Surface(
            (Zone(-100.0, "old asphalt"),),
            right_edge_m=-2.4,
            left_edge_m=2.9,
            lane_centres_m=(0.2,),
            gravel_m=0.6,
            seams=(Seam(0.25, 0.03, 0.06, strength=0.6), Seam(-1.2, 0.03, 0.12, 20.0, 60.0)),
            patches=(Patch(30.0, 36.0, -1.9, -0.4, "asphalt"),),
        ),
        objects=(
            *plant_trees(71, "oak plane bush", s_m=(5, 220), d_m=(-12, -4.5), height_m=(2, 9), every_m=6),
            *plant_trees(72, "oak bush", s_m=(5, 220), d_m=(5.5, 14), height_m=(2, 9), every_m=6),
        ),
        motion=Motion(0.0, 11.0, offset_m=-0.3, wander_m=0.2, pitch_rad=float(np.radians(0.3))),
        seed=161,
    )


def _car_park() -> Drive:
    ends = []
    for low, high in ((-3.4 - BAY_M, -3.4), (3.1, 3.1 + BAY_M)):
        ends += [Patch(s, s + LINE_M, low, high, "paint") for s in np.arange(-8.0, 90.0, STALL_M)]
    taken = np.random.default_rng(7).choice(36, 17, replace=False)
    paints = ("white", "silver", "grey", "blue", "red", "black", "beige")
    cars = tuple(
        PlacedObject(
            -6.7 + STALL_M * (n + 1),
            (-3.4 - BAY_M / 2, 3.1 + BAY_M / 2)[k % 2],
            Car(paints[k % 7], ("sedan", "suv")[k % 3 == 0], (np.pi / 2, -np.pi / 2)[k % 2]),
        )
        for k, n in enumerate(taken)
    )
    return motorway_drive(
        road=RoadGeometry([0.0, 100.0], [1 / 300, 1 / 300]),
        line_laterals_m=(),
        markings=(),
        surface=Surface(
            (Zone(-100.0, "asphalt"),),
            right_edge_m=-9.5,
            left_edge_m=9.0,
            lane_centres_m=(-1.2, 1.2),
            patches=tuple(ends),
            seams=(Seam(0.4, 0.03, 0.06, strength=0.5),),
        ),
        objects=(
            *cars,
            PlacedWall(-9.9, "kerb", seed=4),
            PlacedWall(9.3, "kerb", seed=6),
            *(PlacedObject(s, 9.9, Post(7.0, 0.16, arm_m=-1.2)) for s in (20.0, 50.0)),
            *plant_trees(73, "plane oak", s_m=(5, 130), d_m=(-18, -12), height_m=(5, 9), every_m=9),
            *plant_trees(74, "plane oak", s_m=(5, 130), d_m=(12, 18), height_m=(5, 9), every_m=9),
        ),
        motion=Motion(0.0, 5.0, offset_m=0.2, wander_m=0.3, pitch_rad=float(np.radians(0.1))),
        seed=162,
    )


def _dirt_track() -> Drive:
    return motorway_drive(
        road=RoadGeometry([0.0, 25.0, 50.0, 75.0, 120.0], [0.0, -1 / 60, -1 / 60, 1 / 80, 0.0]),
        line_laterals_m=(),
        markings=(),
        surface=Surface((Zone(-100.0, "dirt"),), right_edge_m=-1.5, left_edge_m=1.6, gravel_m=0.2),
        objects=(
            *plant_trees(75, "oak bush scrub", s_m=(5, 200), d_m=(-30, -4), height_m=(0.6, 5), every_m=4),
            *plant_trees(76, "oak bush scrub", s_m=(5, 200), d_m=(4, 30), height_m=(0.6, 6), every_m=4),
        ),
        motion=Motion(0.0, 7.0, offset_m=0.1, wander_m=0.2, pitch_rad=float(np.radians(0.8)), pitch_period_s=0.8),
        seed=163,
    )


SCENES = (
    SuiteScene("unmarked-road", "no lane", 4.0, "A narrow road without paint.", _unmarked_road),
    SuiteScene("car-park", "no lane", 4.0, "The aisle between rows of stalls.", _car_park),
    SuiteScene("dirt-track", "no lane", 4.0, "Two wheel tracks through dry grass.", _dirt_track),
)  # fmt: skip
