"""Motorway scenes, and scenes without a lane, where no lane may be found.

The project video, seams, barriers, worn and missing paint, dots, lane changes, road works.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import TreeShade
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.objects.walls import Overpass
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import WHITE, YELLOW, Marking, Symbol
from simulator.road.surface import Patch, Seam, Surface, Zone
from simulator.scenes.freeway import (
    LANE_WIDTH_M,
    Freeway,
    car,
    daylight,
    freeway_drive,
    oncoming_cars,
    plant_trees,
)

# Removed markings: ground-off lines are rough and pale, painted-over lines are black and smooth.
GROUND_OFF, BLACKENED = (0.30, 0.285, 0.27), (0.020, 0.020, 0.022)
# Lateral positions of the joint between dark strip and pale lanes, and of the barrier. The lanes were moved later.
JOINT_M, JOINT_BARRIER_M = -0.03, LANE_WIDTH_M / 2 + 0.85
# Bleached yellow. Together with the two pavements and the lens of `joint_fields` it gives the levels of the real
# challenge drive: strip 112, lanes 155, stripe (195, 160, 100) with its colour spread over 20 px.
FADED_YELLOW = (0.50, 0.30, 0.055)
# Temporary yellow or orange of road works.
WORKS_YELLOW = (1.0, 0.45, 0.03)
MOTORWAY = Freeway(phase_m=4.0, wear=0.3, opposite_m=17.0)
# The same with the ego lane in the middle.
MIDDLE_LANE = replace(MOTORWAY, lanes_left=1, lanes_right=2, phase_m=2.0)


def project_video() -> Drive:
    """Ten seconds at 27 m/s: straight, an S-bend left (R 520 m) and right (R 400 m), tree shadows, light concrete."""
    bank = PlacedWall(-18.0, "bank", seed=16)
    return freeway_drive(
        replace(
            MOTORWAY,
            pavement="fresh asphalt",
            zones=(Zone(190.0, "concrete", 0.3), Zone(245.0, "asphalt", 0.2)),
            wear=0.25,
            patches=(Patch(70.0, 78.0, -1.6, 0.1, "asphalt"),),
            seams=(Seam(0.5, 0.03, 0.08, 95.0, 130.0),),
        ),
        road=RoadGeometry(
            [0.0, 75.0, 125.0, 175.0, 255.0, 330.0, 420.0, 600.0],
            [0.0, 0.0, 1 / 520, 1 / 520, -1 / 400, -1 / 400, 0.0, 0.0],
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
            *oncoming_cars(7, s_m=(60, 640), opposite_m=17.0, speed_mps=26.0),
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
            0.0,
            27.0,
            offset_m=0.05,
            wander_m=0.22,
            wander_period_s=6.5,
            pitch_rad=float(np.radians(0.22)),
        ),
        lens=Lens(noise=0.005),
        seed=99,
        **daylight(75, 50, tree_density=0.7),
    )


# Motion, barrier, bank and cars of `motorway_drive`.
MOTION = Motion(
    0.0,
    25.0,
    offset_m=0.15,
    wander_m=0.2,
    wander_period_s=5.0,
    pitch_rad=float(np.radians(0.22)),
)
BARRIER, BANK = PlacedWall(4.4, "jersey", seed=25), PlacedWall(-18.0, "bank", seed=26)
# Barriers farther away, and close beside a joint of the pavement; see `joint_fields`.
FAR_BARRIER = replace(BARRIER, lateral_m=8.1)
JOINT_BARRIER = replace(BARRIER, lateral_m=JOINT_BARRIER_M, height_scale=1.25)
CARS = (
    car(22.0, -1, "silver", "suv", speed_mps=26.0),
    car(70.0, -2, "white", speed_mps=25.0),
)


def roadside(
    barrier: PlacedWall = BARRIER, *more: PlacedObject | PlacedWall | Overpass
) -> tuple:
    """Objects of a motorway: a barrier, the bank, and `more` (default: CARS), then oncoming cars and trees."""
    return (
        barrier,
        BANK,
        *(more or CARS),
        *oncoming_cars(31, s_m=(40, 420), opposite_m=17.0, speed_mps=26.0),
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
            33, "plane oak", s_m=(30, 420), d_m=(34, 50), height_m=(6, 11), every_m=20
        ),
    )


def motorway_drive(
    freeway: Freeway = MOTORWAY, *, offset_m: float = MOTION.offset_m, **changes
) -> Drive:
    """Motorway that bends left (R 560 m) and right (R 480 m); `changes` are fields of Drive.

    The car is in the leftmost of four lanes, between solid yellow and broken white, at `offset_m`. A barrier and the
    opposite carriageway are to the left; there are some traffic and a grassy bank.
    """
    usual = {
        "road": RoadGeometry(
            [0.0, 30.0, 60.0, 90.0, 130.0, 200.0, 300.0],
            [0.0, 1 / 560, 1 / 560, 0.0, -1 / 480, -1 / 480, 0.0],
        ),
        "objects": roadside(),
        "motion": replace(MOTION, offset_m=offset_m),
        "seed": 131,
    }
    return freeway_drive(
        freeway, **usual | daylight(60, 48, cloud_cover=0.3, tree_density=0.7) | changes
    )


def joint_fields(*seams: Seam, patches: tuple[Patch, ...] = ()) -> dict:
    """Fields of a Drive: pale lanes next to a dark strip, whose joint runs along the middle of the ego lane.

    As in the real challenge drive, the yellow line is thin and faded, on the dark side, next to the shadow of the
    barrier. The car keeps its lateral position to some centimetres.
    """
    freeway = replace(
        MOTORWAY,
        pavement="grey concrete",
        wear=0.35,
        left_shoulder_m=JOINT_BARRIER_M - LANE_WIDTH_M / 2 + 0.05,
        patches=(Patch(-200.0, 800.0, JOINT_M, 4.4, "grey asphalt"), *patches),
        seams=(Seam(JOINT_M, 0.02, 0.01, strength=0.35), *seams),
    )
    yellow, *white = freeway.markings()
    return {
        "surface": freeway.surface(),
        "markings": (
            replace(yellow, width_m=0.10, colour=FADED_YELLOW, wear=0.1),
            *white,
        ),
        "motion": replace(MOTION, offset_m=0.12, wander_m=0.05),
        "lens": Lens(exposure=0.72, blur_px=1.2, chroma_blur_px=4.0),
    }


def _joint_and_seam() -> Drive:
    return motorway_drive(
        road=RoadGeometry(
            [0.0, 30.0, 160.0, 300.0], [-1 / 700, -1 / 620, -1 / 620, 0.0]
        ),
        objects=roadside(JOINT_BARRIER),
        seed=132,
        **joint_fields(Seam(-0.95, 0.03, 0.03, 40.0, 600.0, 0.7)),
        **daylight(78, 58, cloud_cover=0.6, tree_density=0.7),
    )


def _barrier() -> Drive:
    return motorway_drive(
        replace(MOTORWAY, pavement="old asphalt", left_shoulder_m=0.65, wear=0.45),
        objects=roadside(
            PlacedWall(LANE_WIDTH_M / 2 + 0.6, "jersey", height_scale=1.1, seed=27)
        ),
        offset_m=-0.2,
        seed=133,
        **daylight(75, 42, cloud_cover=0.2, tree_density=0.7),
    )


def _worn_paint() -> Drive:
    freeway = Freeway(
        "old asphalt",
        wear=0.8,
        opposite_m=17.0,
        patches=(
            Patch(34.0, 41.0, -1.7, 0.1, "asphalt"),
            Patch(66.0, 78.0, -0.3, 1.6, "fresh asphalt"),
        ),
        seams=(Seam(0.5, 0.03, 0.09, 10.0, 60.0), Seam(-0.7, 0.03, 0.1, 40.0, 140.0)),
    )
    return motorway_drive(freeway, seed=134)


def _missing_paint() -> Drive:
    whole = replace(MOTORWAY, wear=0.5).markings()
    yellow, broken, *others = (replace(m, width_m=min(m.width_m, 0.10)) for m in whole)
    markings = (
        replace(yellow, end_m=78.0, dots=False),
        replace(yellow, start_m=118.0, dots=False),
        replace(broken, end_m=24.0, dots=False),
        replace(broken, start_m=84.0, dots=False),
    )
    return motorway_drive(markings=(*markings, *others), seed=135)


def _dashes_only() -> Drive:
    freeway = replace(MIDDLE_LANE, pavement="old concrete", wear=0.4)
    return motorway_drive(
        freeway,
        markings=tuple(
            replace(m, width_m=0.10) if m.dashed else m for m in freeway.markings()
        ),
        objects=roadside(FAR_BARRIER, car(30.0, 1, "grey", speed_mps=24.0), *CARS),
        offset_m=0.35,
        seed=136,
    )


def _botts_dots() -> Drive:
    paint = MIDDLE_LANE.markings()
    return motorway_drive(
        MIDDLE_LANE,
        markings=tuple(
            replace(m, botts=True, width_m=0.10, wear=0.1) if m.dashed else m
            for m in paint
        ),
        objects=roadside(FAR_BARRIER),
        offset_m=-0.25,
        seed=137,
    )


def _lane_change() -> Drive:
    return motorway_drive(
        line_laterals_m=tuple(LANE_WIDTH_M / 2 - n * LANE_WIDTH_M for n in range(5)),
        motion=replace(
            MOTION,
            wander_m=0.0,
            shift_m=-LANE_WIDTH_M,
            shift_start_s=0.6,
            shift_seconds=3.6,
        ),
        objects=roadside(BARRIER, car(60.0, 0, "red", speed_mps=22.0)),
        seed=138,
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
    return motorway_drive(symbols=symbols, offset_m=-0.3, seed=139)


def _construction() -> Drive:
    old = (
        Marking(
            2.9, 0.15, GROUND_OFF, slope=-0.020, start_m=-40.0, end_m=150.0, wear=0.1
        ),
        Marking(
            -0.9,
            0.14,
            GROUND_OFF,
            dashed=True,
            slope=-0.020,
            start_m=-40.0,
            end_m=150.0,
            wear=0.1,
        ),
        Marking(
            1.0, 0.16, BLACKENED, slope=-0.022, start_m=30.0, end_m=220.0, wear=0.2
        ),
    )
    new = (
        Marking(LANE_WIDTH_M / 2, 0.12, WORKS_YELLOW, wear=0.1, dots=True),
        Marking(-LANE_WIDTH_M / 2, 0.12, WHITE, wear=0.15),
        Marking(-LANE_WIDTH_M * 1.5, 0.12, WHITE, wear=0.3),
    )
    return motorway_drive(
        replace(
            MOTORWAY,
            pavement="old asphalt",
            lanes_right=1,
            patches=(Patch(48.0, 300.0, -2.6, -0.6, "asphalt"),),
        ),
        markings=(*old, *new),
        objects=roadside(
            PlacedWall(LANE_WIDTH_M / 2 + 1.0, "jersey", seed=28),
            PlacedWall(-7.4, "jersey", seed=29),
            *CARS,
        ),
        motion=replace(MOTION, speed_mps=20.0),
        seed=140,
    )


def _two_lane() -> Drive:
    half = 1.75
    return motorway_drive(
        road=RoadGeometry(
            [0.0, 40.0, 80.0, 100.0, 150.0, 200.0],
            [1 / 400, 1 / 140, 1 / 140, -1 / 160, -1 / 160, 0.0],
        ),
        line_laterals_m=(half, -half),
        markings=(
            Marking(half, 0.12, YELLOW, dashed=True, wear=0.3),
            Marking(-half, 0.12, WHITE, wear=0.3),
            Marking(3 * half, 0.12, WHITE, wear=0.3),
        ),
        surface=replace(
            Freeway(lanes_right=0, right_shoulder_m=0.5).surface(),
            left_edge_m=3 * half + 0.6,
            lane_centres_m=(0.0, 2 * half),
        ),
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
            0.0, 18.0, offset_m=-0.2, wander_m=0.15, pitch_rad=float(np.radians(0.25))
        ),
        seed=141,
    )


def challenge_video() -> Drive:
    """Nine seconds at 25 m/s: pale lanes, a dark strip at the yellow line, tar seams, a barrier, a bridge.

    The joint between dark and pale pavement is in the middle of the lane for the whole drive. There is one seam before
    the bridge and one after it.
    """
    bridge = Overpass(112.0, 128.0, -20.0, 15.5, skew=0.12)
    seams = (
        Seam(-0.95, 0.025, 0.03, 150.0, 190.0, 0.6),
        Seam(-0.55, 0.03, 0.05, 20.0, 70.0, 0.6),
    )
    joint = joint_fields(*seams, patches=(Patch(60.0, 84.0, -7.0, -3.9, "asphalt"),))
    return motorway_drive(
        road=RoadGeometry(
            [0.0, 40.0, 90.0, 140.0, 180.0, 260.0, 330.0, 420.0],
            [-1 / 900, -1 / 620, -1 / 620, 0.0, 1 / 1600, 1 / 1200, 0.0, 0.0],
        ),
        # No objects where the bridge is.
        objects=tuple(
            item
            for item in roadside(
                JOINT_BARRIER,
                bridge,
                car(26.0, -1, "black", "suv", speed_mps=26.5),
                car(64.0, -2, "white", speed_mps=25.0),
                car(-12.0, -1, "silver", speed_mps=29.0),
                car(90.0, 0, "grey", speed_mps=26.5),
            )
            if isinstance(item, PlacedWall | Overpass) or not 104 < item.s_m < 136
        ),
        symbols=(
            Symbol(72.0, 0.0, "diamond", 3.7, 1.0, wear=0.4),
            Symbol(190.0, 0.0, "diamond", 3.7, 1.0, wear=0.4),
        ),
        shades=(bridge.shade(),),
        exposure=AutoExposure(strength=0.6),
        seed=171,
        **joint | {"lens": replace(joint["lens"], exposure=1.75)},
        **daylight(70, 56, cloud_cover=0.45, tree_density=0.7),
    )


# Length and width of a stall of the car park, and width of its lines.
BAY_M, STALL_M, LINE_M = 5.0, 2.6, 0.10


def _unmarked_road() -> Drive:
    return motorway_drive(
        road=RoadGeometry(
            [0.0, 30.0, 60.0, 90.0, 140.0], [0.0, 1 / 90, 1 / 90, -1 / 120, 0.0]
        ),
        line_laterals_m=(),
        markings=(),
        surface=Surface(
            (Zone(-100.0, "old asphalt"),),
            right_edge_m=-2.4,
            left_edge_m=2.9,
            lane_centres_m=(0.2,),
            gravel_m=0.6,
            seams=(
                Seam(0.25, 0.03, 0.06, strength=0.6),
                Seam(-1.2, 0.03, 0.12, 20.0, 60.0),
            ),
            patches=(Patch(30.0, 36.0, -1.9, -0.4, "asphalt"),),
        ),
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
                72, "oak bush", s_m=(5, 220), d_m=(5.5, 14), height_m=(2, 9), every_m=6
            ),
        ),
        motion=Motion(
            0.0, 11.0, offset_m=-0.3, wander_m=0.2, pitch_rad=float(np.radians(0.3))
        ),
        seed=161,
    )


def _car_park() -> Drive:
    ends = []
    for low, high in ((-3.4 - BAY_M, -3.4), (3.1, 3.1 + BAY_M)):
        ends += [
            Patch(s, s + LINE_M, low, high, "paint")
            for s in np.arange(-8.0, 90.0, STALL_M)
        ]
    taken = np.random.default_rng(7).choice(36, 17, replace=False)
    paints = ("white", "silver", "grey", "blue", "red", "black", "beige")
    cars = tuple(
        PlacedObject(
            -6.7 + STALL_M * (n + 1),
            (-3.4 - BAY_M / 2, 3.1 + BAY_M / 2)[k % 2],
            Car(
                paints[k % 7],
                ("sedan", "suv")[k % 3 == 0],
                (np.pi / 2, -np.pi / 2)[k % 2],
            ),
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
            *plant_trees(
                73,
                "plane oak",
                s_m=(5, 130),
                d_m=(-18, -12),
                height_m=(5, 9),
                every_m=9,
            ),
            *plant_trees(
                74, "plane oak", s_m=(5, 130), d_m=(12, 18), height_m=(5, 9), every_m=9
            ),
        ),
        motion=Motion(
            0.0, 5.0, offset_m=0.2, wander_m=0.3, pitch_rad=float(np.radians(0.1))
        ),
        seed=162,
    )


def _dirt_track() -> Drive:
    return motorway_drive(
        road=RoadGeometry(
            [0.0, 25.0, 50.0, 75.0, 120.0], [0.0, -1 / 60, -1 / 60, 1 / 80, 0.0]
        ),
        line_laterals_m=(),
        markings=(),
        surface=Surface(
            (Zone(-100.0, "dirt"),), right_edge_m=-1.5, left_edge_m=1.6, gravel_m=0.2
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
            0.0,
            7.0,
            offset_m=0.1,
            wander_m=0.2,
            pitch_rad=float(np.radians(0.8)),
            pitch_period_s=0.8,
        ),
        seed=163,
    )


NO_LANE = (
    SuiteScene("unmarked-road", "no lane", 4.0, "A narrow road without paint.", _unmarked_road),
    SuiteScene("car-park", "no lane", 4.0, "The aisle between rows of stalls.", _car_park),
    SuiteScene("dirt-track", "no lane", 4.0, "Two wheel tracks through dry grass.", _dirt_track),
)  # fmt: skip


SCENES = (
    SuiteScene("motorway", "clean", 10.0, "Bends both ways, tree shadows and light concrete by day.", project_video),
    SuiteScene("two-lane", "clean", 4.0, "A country road in bends of R 140 m, broken yellow on the left.", _two_lane),
    SuiteScene("dashes-only", "medium", 4.0, "A middle lane between broken lines on pale concrete.", _dashes_only),
    SuiteScene("lane-change", "medium", 5.0, "Across the broken line to the next lane.", _lane_change),
    SuiteScene("symbols", "medium", 5.0, "Arrows, diamonds and words painted in the lane.", _symbols),
    SuiteScene("joint-and-seam", "hard", 4.0, "An asphalt joint and a tar seam inside the lane.", _joint_and_seam),
    SuiteScene("barrier", "hard", 4.0, "A concrete barrier and its shadow close beside the line.", _barrier),
    SuiteScene("worn-paint", "hard", 4.0, "Hardly any paint left on old, patched asphalt.", _worn_paint),
    SuiteScene("missing-paint", "hard", 5.0, "First the right line is missing, then the left one.", _missing_paint),
    SuiteScene("botts-dots", "hard", 4.0, "Four ceramic dots in each 12 m in place of paint.", _botts_dots),
    SuiteScene("construction", "hard", 4.0, "Old lines cross the new ones at a small angle.", _construction),
    SuiteScene("challenge", "hard", 9.0, "Dark joint and seam in the lane, a bridge, pale concrete.", challenge_video),
)  # fmt: skip
