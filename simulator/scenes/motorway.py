"""Motorway scenes, and scenes without a lane, where no lane may be found.

The project video, seams, barriers, worn and missing paint, dots, lane changes, road
works.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians
from typing import Any

import numpy as np

from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import TreeShade
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.objects.walls import Overpass
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import YELLOW, Marking, Symbol
from simulator.road.surface import Patch, Seam, Surface, Zone
from simulator.scenes.freeway import (
    LANE_WIDTH_M,
    PAVED_FROM_M,
    Daylight,
    Freeway,
    car,
    daylight,
    freeway_drive,
    oncoming_cars,
    plant_trees,
)

# Half a lane: lateral position of its left line, with the lane's centre at 0.
HALF_LANE_M = LANE_WIDTH_M / 2
# Removed markings: ground-off lines are rough and pale, painted-over lines are black
# and smooth.
GROUND_OFF = (0.30, 0.285, 0.27)
BLACKENED = (0.020, 0.020, 0.022)
# Width of thin lines, four inches.
THIN_M = 0.10
# Lateral positions of the joint between dark strip and pale lanes, and of the barrier.
# The lanes were moved later.
JOINT_M = -0.03
JOINT_BARRIER_M = HALF_LANE_M + 0.85
# Bleached yellow. Together with the two pavements and the lens of `joint_drive` it
# gives the levels of the real challenge drive: strip 112, lanes 155, stripe (195, 160,
# 100) with its colour spread over 20 px.
FADED_YELLOW = (0.50, 0.30, 0.055)
# Temporary yellow or orange of road works.
WORKS_YELLOW = (1.0, 0.45, 0.03)
# Right edge of the opposite carriageway.
OPPOSITE_M = 17.0
MOTORWAY = Freeway(phase_m=4.0, wear=0.3, opposite_m=OPPOSITE_M)
# The same with the ego lane in the middle.
MIDDLE_LANE = replace(MOTORWAY, lanes_left=1, lanes_right=2, phase_m=2.0)


def project_video() -> Drive:
    """Ten seconds at 27 m/s: straight, then an S-bend left and right.

    The radii are 520 m and 400 m. There are tree shadows and light concrete.
    """
    bank = PlacedWall(-18.0, "bank", seed=16)
    freeway = replace(
        MOTORWAY,
        pavement="fresh asphalt",
        zones=(Zone(190.0, "concrete", 0.3), Zone(245.0, "asphalt", 0.2)),
        wear=0.25,
        patches=(Patch(70.0, 78.0, -1.6, 0.1, "asphalt"),),
        seams=(Seam(0.5, wander_m=0.08, start_m=95.0, end_m=130.0),),
    )
    road = RoadGeometry(
        [0.0, 75.0, 125.0, 175.0, 255.0, 330.0, 420.0, 600.0],
        [0.0, 0.0, 1 / 520, 1 / 520, -1 / 400, -1 / 400, 0.0, 0.0],
    )
    return freeway_drive(
        freeway,
        road,
        daylight(75, 50, tree_density=0.7),
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
            *oncoming_cars(7, s_m=(60, 640), opposite_m=OPPOSITE_M, speed_mps=26.0),
            *plant_trees(
                21,
                "oak bush",
                s_m=(10, 620),
                d_m=(-40, -31),
                height_m=(4, 9),
                every_m=14,
                bank=bank,
            ),
            *plant_trees(
                22,
                "scrub bush",
                s_m=(10, 620),
                d_m=(-30, -21),
                height_m=(0.8, 2.0),
                every_m=13,
                bank=bank,
            ),
            *plant_trees(
                23,
                "eucalyptus oak",
                s_m=(140, 176),
                d_m=(11, 13),
                height_m=(11, 14),
                every_m=9,
            ),
            *plant_trees(
                24,
                "eucalyptus plane",
                s_m=(238, 262),
                d_m=(11, 13),
                height_m=(11, 14),
                every_m=9,
            ),
            *plant_trees(
                25,
                "plane oak",
                s_m=(60, 620),
                d_m=(34, 50),
                height_m=(6, 11),
                every_m=22,
            ),
        ),
        motion=Motion(
            offset_m=0.05,
            wander_m=0.22,
            wander_period_s=6.5,
            pitch_rad=radians(0.22),
        ),
        lens=Lens(noise=0.005),
        seed=99,
    )


# Motion, light, barrier, bank and cars of `motorway_drive`.
MOTION = Motion(
    speed_mps=25.0,
    offset_m=0.15,
    wander_m=0.2,
    wander_period_s=5.0,
    pitch_rad=radians(0.22),
)
DAY = daylight(60, 48, cloud_cover=0.3, tree_density=0.7)
BARRIER = PlacedWall(4.4, "jersey", seed=25)
BANK = PlacedWall(-18.0, "bank", seed=26)
# Barriers farther away, and close beside a joint of the pavement; see `joint_drive`.
FAR_BARRIER = replace(BARRIER, lateral_m=8.1)
JOINT_BARRIER = replace(BARRIER, lateral_m=JOINT_BARRIER_M, height_scale=1.25)
CARS = (
    car(22.0, -1, "silver", "suv", speed_mps=26.0),
    car(70.0, -2, "white", speed_mps=25.0),
)


def roadside(
    *items: PlacedObject | PlacedWall | Overpass, barrier: PlacedWall = BARRIER
) -> tuple:
    """Objects of a motorway: a barrier, the bank, `items`, oncoming cars and trees."""
    return (
        barrier,
        BANK,
        *items,
        *oncoming_cars(31, s_m=(40, 420), opposite_m=OPPOSITE_M, speed_mps=26.0),
        *plant_trees(
            32,
            "oak bush",
            s_m=(10, 420),
            d_m=(-40, -31),
            height_m=(4, 9),
            every_m=14,
            bank=BANK,
        ),
        *plant_trees(
            33,
            "plane oak",
            s_m=(30, 420),
            d_m=(34, 50),
            height_m=(6, 11),
            every_m=20,
        ),
    )


def motorway_drive(
    seed: int,
    freeway: Freeway = MOTORWAY,
    *,
    light: Daylight = DAY,
    offset_m: float = MOTION.offset_m,
    **changes: Any,
) -> Drive:
    """Motorway that bends left (R 560 m) and right (R 480 m).

    The car is in the leftmost of four lanes, between solid yellow and broken white, at
    `offset_m`. A barrier and the opposite carriageway are to the left; there are some
    traffic and a grassy bank. `changes` are fields of Drive.
    """
    road = RoadGeometry(
        [0.0, 30.0, 60.0, 90.0, 130.0, 200.0, 300.0],
        [0.0, 1 / 560, 1 / 560, 0.0, -1 / 480, -1 / 480, 0.0],
    )
    drive = freeway_drive(
        freeway,
        road,
        light,
        objects=roadside(*CARS),
        motion=replace(MOTION, offset_m=offset_m),
        seed=seed,
    )
    return replace(drive, **changes)


def joint_drive(
    seed: int,
    seams: tuple[Seam, ...],
    patches: tuple[Patch, ...] = (),
    *,
    stops: float,
    **changes: Any,
) -> Drive:
    """Pale lanes next to a dark strip, whose joint is in the middle of the ego lane.

    As in the real challenge drive, the yellow line is thin and faded, on the dark side,
    next to the shadow of the barrier. The car keeps its lateral position to some
    centimetres. `stops` are the exposure of the lens, `changes` are those of
    `motorway_drive`.
    """
    freeway = replace(
        MOTORWAY,
        pavement="grey concrete",
        wear=0.35,
        left_shoulder_m=JOINT_BARRIER_M - HALF_LANE_M + 0.05,
        patches=(Patch(-200.0, 800.0, JOINT_M, 4.4, "grey asphalt"), *patches),
        seams=(Seam(JOINT_M, 0.02, wander_m=0.01, strength=0.35), *seams),
    )
    yellow, *white = freeway.markings()
    faded = replace(yellow, width_m=THIN_M, colour=FADED_YELLOW, wear=0.1)
    return motorway_drive(
        seed,
        freeway,
        markings=(faded, *white),
        motion=replace(MOTION, offset_m=0.12, wander_m=0.05),
        lens=Lens(exposure=stops, blur_px=1.2, chroma_blur_px=4.0),
        **changes,
    )


def _joint_and_seam() -> Drive:
    road = RoadGeometry(
        [0.0, 30.0, 160.0, 300.0],
        [-1 / 700, -1 / 620, -1 / 620, 0.0],
    )
    return joint_drive(
        132,
        seams=(Seam(-0.95, wander_m=0.03, start_m=40.0, end_m=600.0),),
        light=daylight(78, 58, cloud_cover=0.6, tree_density=0.7),
        stops=0.72,
        road=road,
        objects=roadside(*CARS, barrier=JOINT_BARRIER),
    )


def _barrier() -> Drive:
    freeway = replace(MOTORWAY, pavement="old asphalt", left_shoulder_m=0.65, wear=0.45)
    barrier = PlacedWall(HALF_LANE_M + 0.6, "jersey", height_scale=1.1, seed=27)
    return motorway_drive(
        133,
        freeway,
        light=daylight(75, 42, cloud_cover=0.2, tree_density=0.7),
        objects=roadside(*CARS, barrier=barrier),
        offset_m=-0.2,
    )


def _worn_paint() -> Drive:
    freeway = Freeway(
        "old asphalt",
        wear=0.8,
        opposite_m=OPPOSITE_M,
        patches=(
            Patch(34.0, 41.0, -1.7, 0.1, "asphalt"),
            Patch(66.0, 78.0, -0.3, 1.6, "fresh asphalt"),
        ),
        seams=(
            Seam(0.5, wander_m=0.09, start_m=10.0, end_m=60.0),
            Seam(-0.7, wander_m=0.1, start_m=40.0, end_m=140.0),
        ),
    )
    return motorway_drive(134, freeway)


def _missing_paint() -> Drive:
    markings = replace(MOTORWAY, wear=0.5).markings()
    thin = [replace(m, width_m=min(m.width_m, THIN_M)) for m in markings]
    yellow, broken, *others = thin
    yellow = replace(yellow, dots=False)
    broken = replace(broken, dots=False)
    with_gaps = (
        replace(yellow, end_m=78.0),
        replace(yellow, start_m=118.0),
        replace(broken, end_m=24.0),
        replace(broken, start_m=84.0),
    )
    return motorway_drive(135, markings=(*with_gaps, *others))


def _dashes_only() -> Drive:
    freeway = replace(MIDDLE_LANE, pavement="old concrete", wear=0.4)
    left_car = car(30.0, 1, "grey", speed_mps=24.0)
    return motorway_drive(
        136,
        freeway,
        markings=_change_broken(freeway, width_m=THIN_M),
        objects=roadside(left_car, *CARS, barrier=FAR_BARRIER),
        offset_m=0.35,
    )


def _botts_dots() -> Drive:
    return motorway_drive(
        137,
        MIDDLE_LANE,
        markings=_change_broken(MIDDLE_LANE, botts=True, width_m=THIN_M, wear=0.1),
        objects=roadside(*CARS, barrier=FAR_BARRIER),
        offset_m=-0.25,
    )


def _change_broken(
    freeway: Freeway,
    **changes: Any,
) -> tuple[Marking, ...]:
    """Markings of a freeway with changes of its broken lines."""
    return tuple(
        replace(marking, **changes) if marking.dashed else marking
        for marking in freeway.markings()
    )


def _lane_change() -> Drive:
    motion = replace(
        MOTION,
        wander_m=0.0,
        shift_m=-LANE_WIDTH_M,
        shift_start_s=0.6,
        shift_seconds=3.6,
    )
    return motorway_drive(
        138,
        line_laterals_m=tuple(HALF_LANE_M - n * LANE_WIDTH_M for n in range(5)),
        motion=motion,
        objects=roadside(car(60.0, 0, "red", speed_mps=22.0)),
    )


def _symbols() -> Drive:
    symbols = (
        Symbol(16.0, 0.0, "diamond", 3.7, 1.0),
        Symbol(34.0, 0.0, "CAR", 2.6, 2.2),
        Symbol(40.0, 0.0, "POOL", 2.6, 2.4),
        Symbol(58.0, 0.1, "arrow", 4.2, 1.1),
        Symbol(58.0, -LANE_WIDTH_M, "arrow", 4.2, 1.1),
        Symbol(82.0, 0.0, "diamond", 3.7, 1.0, wear=0.5),
        Symbol(100.0, -0.1, "left arrow", 3.8, 1.9),
        Symbol(118.0, 0.0, "SLOW", 2.6, 2.4),
        Symbol(134.0, 0.0, "arrow", 4.2, 1.1),
    )
    return motorway_drive(139, symbols=symbols, offset_m=-0.3)


def _construction() -> Drive:
    freeway = replace(
        MOTORWAY,
        pavement="old asphalt",
        lanes_right=1,
        patches=(Patch(48.0, 300.0, -2.6, -0.6, "asphalt"),),
    )
    ground_off = Marking(
        2.9,
        0.15,
        GROUND_OFF,
        slope=-0.020,
        start_m=-40.0,
        end_m=150.0,
        wear=0.1,
    )
    old = (
        ground_off,
        replace(ground_off, lateral_m=-0.9, width_m=0.14, dashed=True),
        Marking(
            1.0,
            0.16,
            BLACKENED,
            slope=-0.022,
            start_m=30.0,
            end_m=220.0,
            wear=0.2,
        ),
    )
    new = (
        Marking(HALF_LANE_M, colour=WORKS_YELLOW, wear=0.1, dots=True),
        Marking(-HALF_LANE_M),
        Marking(-LANE_WIDTH_M * 1.5, wear=0.3),
    )
    left = PlacedWall(HALF_LANE_M + 1.0, "jersey", seed=28)
    right = PlacedWall(-7.4, "jersey", seed=29)
    return motorway_drive(
        140,
        freeway,
        markings=(*old, *new),
        objects=roadside(right, *CARS, barrier=left),
        motion=replace(MOTION, speed_mps=20.0),
    )


def _two_lane() -> Drive:
    half = 1.75
    road = RoadGeometry(
        [0.0, 40.0, 80.0, 100.0, 150.0, 200.0],
        [1 / 400, 1 / 140, 1 / 140, -1 / 160, -1 / 160, 0.0],
    )
    surface = replace(
        Freeway(lanes_right=0, right_shoulder_m=0.5).surface(),
        left_edge_m=3 * half + 0.6,
        lane_centres_m=(0.0, 2 * half),
    )
    return motorway_drive(
        141,
        road=road,
        line_laterals_m=(half, -half),
        markings=(
            Marking(half, colour=YELLOW, dashed=True, wear=0.3),
            Marking(-half, wear=0.3),
            Marking(3 * half, wear=0.3),
        ),
        surface=surface,
        objects=(
            car(170.0, 1, "blue", speed_mps=-18.0),
            *plant_trees(
                41,
                "oak plane bush",
                s_m=(10, 300),
                d_m=(-22, -8),
                height_m=(3, 10),
                every_m=9,
            ),
            *plant_trees(
                42,
                "oak eucalyptus bush",
                s_m=(10, 300),
                d_m=(13, 30),
                height_m=(3, 12),
                every_m=9,
            ),
        ),
        motion=Motion(
            speed_mps=18.0,
            offset_m=-0.2,
            wander_m=0.15,
            pitch_rad=radians(0.25),
        ),
    )


def challenge_video() -> Drive:
    """Nine seconds at 25 m/s: pale lanes, a dark strip at the yellow line, a bridge.

    The joint between dark and pale pavement is in the middle of the lane for the whole
    drive. There are a barrier, one tar seam before the bridge and one after it.
    """
    road = RoadGeometry(
        [0.0, 40.0, 90.0, 140.0, 180.0, 260.0, 330.0, 420.0],
        [-1 / 900, -1 / 620, -1 / 620, 0.0, 1 / 1600, 1 / 1200, 0.0, 0.0],
    )
    bridge = Overpass(112.0, 128.0, -20.0, 15.5, skew=0.12)
    objects = roadside(
        bridge,
        car(26.0, -1, "black", "suv", speed_mps=26.5),
        car(64.0, -2, "white", speed_mps=25.0),
        car(-12.0, -1, "silver", speed_mps=29.0),
        car(90.0, 0, "grey", speed_mps=26.5),
        barrier=JOINT_BARRIER,
    )
    return joint_drive(
        171,
        seams=(
            Seam(-0.95, 0.025, 0.03, start_m=150.0, end_m=190.0, strength=0.6),
            Seam(-0.55, 0.03, 0.05, start_m=20.0, end_m=70.0, strength=0.6),
        ),
        patches=(Patch(60.0, 84.0, -7.0, -3.9, "asphalt"),),
        light=daylight(70, 56, cloud_cover=0.45, tree_density=0.7),
        stops=1.75,
        road=road,
        objects=tuple(item for item in objects if not _is_at_bridge(item)),
        symbols=(
            Symbol(72.0, 0.0, "diamond", 3.7, 1.0, wear=0.4),
            Symbol(190.0, 0.0, "diamond", 3.7, 1.0, wear=0.4),
        ),
        shades=(bridge.shade(),),
        exposure=AutoExposure(strength=0.6),
    )


def _is_at_bridge(item: PlacedObject | PlacedWall | Overpass) -> bool:
    """Whether a tree or a car is where the bridge of the challenge video is."""
    return isinstance(item, PlacedObject) and 104 < item.s_m < 136


# Length and width of a stall of the car park, and width of its lines.
BAY_M = 5.0
STALL_M = 2.6
LINE_M = 0.10
# Inner ends of the stalls on both sides of its aisle.
RIGHT_STALLS_M = -3.4
LEFT_STALLS_M = 3.1


def _unmarked_road() -> Drive:
    road = RoadGeometry(
        [0.0, 30.0, 60.0, 90.0, 140.0],
        [0.0, 1 / 90, 1 / 90, -1 / 120, 0.0],
    )
    surface = Surface(
        (Zone(PAVED_FROM_M, "old asphalt"),),
        right_edge_m=-2.4,
        left_edge_m=2.9,
        lane_centres_m=(0.2,),
        gravel_m=0.6,
        seams=(
            Seam(0.25, wander_m=0.06, strength=0.6),
            Seam(-1.2, wander_m=0.12, start_m=20.0, end_m=60.0),
        ),
        patches=(Patch(30.0, 36.0, -1.9, -0.4, "asphalt"),),
    )
    return motorway_drive(
        161,
        road=road,
        line_laterals_m=(),
        markings=(),
        surface=surface,
        objects=(
            *plant_trees(
                71,
                "oak plane bush",
                s_m=(5, 220),
                d_m=(-12, -4.5),
                height_m=(2, 9),
                every_m=6,
            ),
            *plant_trees(
                72,
                "oak bush",
                s_m=(5, 220),
                d_m=(5.5, 14),
                height_m=(2, 9),
                every_m=6,
            ),
        ),
        motion=Motion(
            speed_mps=11.0,
            offset_m=-0.3,
            wander_m=0.2,
            pitch_rad=radians(0.3),
        ),
    )


def _car_park() -> Drive:
    surface = Surface(
        (Zone(PAVED_FROM_M, "asphalt"),),
        right_edge_m=-9.5,
        left_edge_m=9.0,
        lane_centres_m=(-1.2, 1.2),
        patches=(
            *_stall_lines(RIGHT_STALLS_M - BAY_M, RIGHT_STALLS_M),
            *_stall_lines(LEFT_STALLS_M, LEFT_STALLS_M + BAY_M),
        ),
        seams=(Seam(0.4, wander_m=0.06, strength=0.5),),
    )
    lamp = Post(7.0, 0.16, arm_m=-1.2)
    return motorway_drive(
        162,
        road=RoadGeometry([0.0, 100.0], [1 / 300, 1 / 300]),
        line_laterals_m=(),
        markings=(),
        surface=surface,
        objects=(
            *_parked_cars(),
            PlacedWall(-9.9, "kerb", seed=4),
            PlacedWall(9.3, "kerb", seed=6),
            PlacedObject(20.0, 9.9, lamp),
            PlacedObject(50.0, 9.9, lamp),
            *plant_trees(
                73,
                "plane oak",
                s_m=(5, 130),
                d_m=(-18, -12),
                height_m=(5, 9),
                every_m=9,
            ),
            *plant_trees(
                74,
                "plane oak",
                s_m=(5, 130),
                d_m=(12, 18),
                height_m=(5, 9),
                every_m=9,
            ),
        ),
        motion=Motion(
            speed_mps=5.0,
            offset_m=0.2,
            wander_m=0.3,
            pitch_rad=radians(0.1),
        ),
    )


def _stall_lines(low_m: float, high_m: float) -> list[Patch]:
    """Lines between the stalls on one side of the car park."""
    starts = np.arange(-8.0, 90.0, STALL_M)
    return [Patch(s, s + LINE_M, low_m, high_m, "paint") for s in starts]


def _parked_cars() -> list[PlacedObject]:
    """Cars in half of the stalls of the car park."""
    paints = ("white", "silver", "grey", "blue", "red", "black", "beige")
    taken = np.random.default_rng(7).choice(36, 17, replace=False)
    cars = []
    for k, stall in enumerate(taken):
        body = "suv" if k % 3 == 0 else "sedan"
        if k % 2 == 0:
            lateral = RIGHT_STALLS_M - BAY_M / 2
            heading = pi / 2
        else:
            lateral = LEFT_STALLS_M + BAY_M / 2
            heading = -pi / 2
        parked = Car(paints[k % 7], body, heading)
        cars.append(PlacedObject(-6.7 + STALL_M * (stall + 1), lateral, parked))
    return cars


def _dirt_track() -> Drive:
    road = RoadGeometry(
        [0.0, 25.0, 50.0, 75.0, 120.0],
        [0.0, -1 / 60, -1 / 60, 1 / 80, 0.0],
    )
    return motorway_drive(
        163,
        road=road,
        line_laterals_m=(),
        markings=(),
        surface=Surface(
            (Zone(PAVED_FROM_M, "dirt"),),
            right_edge_m=-1.5,
            left_edge_m=1.6,
            gravel_m=0.2,
        ),
        objects=(
            *plant_trees(
                75,
                "oak bush scrub",
                s_m=(5, 200),
                d_m=(-30, -4),
                height_m=(0.6, 5),
                every_m=4,
            ),
            *plant_trees(
                76,
                "oak bush scrub",
                s_m=(5, 200),
                d_m=(4, 30),
                height_m=(0.6, 6),
                every_m=4,
            ),
        ),
        motion=Motion(
            speed_mps=7.0,
            offset_m=0.1,
            wander_m=0.2,
            pitch_rad=radians(0.8),
            pitch_period_s=0.8,
        ),
    )


NO_LANE = (
    SuiteScene(
        "unmarked-road",
        "no lane",
        4.0,
        "A narrow road without paint.",
        _unmarked_road,
    ),
    SuiteScene(
        "car-park",
        "no lane",
        4.0,
        "The aisle between rows of stalls.",
        _car_park,
    ),
    SuiteScene(
        "dirt-track",
        "no lane",
        4.0,
        "Two wheel tracks through dry grass.",
        _dirt_track,
    ),
)


SCENES = (
    SuiteScene(
        "motorway",
        "clean",
        10.0,
        "Bends both ways, tree shadows and light concrete by day.",
        project_video,
    ),
    SuiteScene(
        "two-lane",
        "clean",
        4.0,
        "A country road in bends of R 140 m, broken yellow on the left.",
        _two_lane,
    ),
    SuiteScene(
        "dashes-only",
        "medium",
        4.0,
        "A middle lane between broken lines on pale concrete.",
        _dashes_only,
    ),
    SuiteScene(
        "lane-change",
        "medium",
        5.0,
        "Across the broken line to the next lane.",
        _lane_change,
    ),
    SuiteScene(
        "symbols",
        "medium",
        5.0,
        "Arrows, diamonds and words painted in the lane.",
        _symbols,
    ),
    SuiteScene(
        "joint-and-seam",
        "hard",
        4.0,
        "An asphalt joint and a tar seam inside the lane.",
        _joint_and_seam,
    ),
    SuiteScene(
        "barrier",
        "hard",
        4.0,
        "A concrete barrier and its shadow close beside the line.",
        _barrier,
    ),
    SuiteScene(
        "worn-paint",
        "hard",
        4.0,
        "Hardly any paint left on old, patched asphalt.",
        _worn_paint,
    ),
    SuiteScene(
        "missing-paint",
        "hard",
        5.0,
        "First the right line is missing, then the left one.",
        _missing_paint,
    ),
    SuiteScene(
        "botts-dots",
        "hard",
        4.0,
        "Four ceramic dots in each 12 m in place of paint.",
        _botts_dots,
    ),
    SuiteScene(
        "construction",
        "hard",
        4.0,
        "Old lines cross the new ones at a small angle.",
        _construction,
    ),
    SuiteScene(
        "challenge",
        "hard",
        9.0,
        "Dark joint and seam in the lane, a bridge, pale concrete.",
        challenge_video,
    ),
)
