"""The course's eight stills.

They correspond in kind and name to the well-known test images of this task. The car is
off-centre in all of them, most roads are curved, and light, pavement and traffic
differ.
"""

from __future__ import annotations

from dataclasses import replace

from simulator.light.sunlight import TreeShade
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post, Tree
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry
from simulator.road.surface import DUST, Patch, Seam, Zone
from simulator.scenes.freeway import (
    Freeway,
    bend_road,
    car,
    daylight,
    freeway_drive,
    oncoming_cars,
    plant_trees,
)

STRAIGHT = RoadGeometry([0.0, 2000.0], [0.0, 0.0])
# Freeways of several stills: on fresh asphalt, and on concrete with a narrow median.
FRESH = Freeway("fresh asphalt")
CONCRETE = Freeway("concrete", opposite_m=5.4)
# A stripe of dust on the pavement.
DUSTY = Seam(
    lateral_m=0.0,
    width_m=0.14,
    wander_m=0.015,
    strength=0.16,
    colour=DUST,
    soft_m=0.12,
)


def still_scenes() -> dict[str, Drive]:
    """Drives of the eight stills, by file name without suffix."""
    return {
        "straight_lines1": _straight_lines1(),
        "straight_lines2": _straight_lines2(),
        "test1": _test1(),
        "test2": _test2(),
        "test3": _test3(),
        "test4": _test4(),
        "test5": _test5(),
        "test6": _test6(),
    }


def _car_at_100_m(offset_m: float, heading_rad: float) -> Motion:
    return Motion(100.0, offset_m=offset_m, heading_rad=heading_rad)


def _straight_lines1() -> Drive:
    """Straight; solid yellow left, broken white right; fresh asphalt, dry hills.

    The car is left of the centre.
    """
    bank = PlacedWall(-17.5, "bank", height_scale=0.9, seed=3)
    freeway = replace(
        FRESH,
        phase_m=102.2,
        opposite_m=14.0,
        seams=(
            replace(DUSTY, lateral_m=-0.75),
            replace(
                DUSTY,
                lateral_m=1.65,
                width_m=0.2,
                wander_m=0.02,
                strength=0.14,
                soft_m=0.2,
            ),
        ),
    )
    return freeway_drive(
        freeway,
        STRAIGHT,
        daylight(70, 55),
        objects=(
            bank,
            PlacedWall(12.6, "jersey"),
            PlacedObject(142.0, 8.4, Tree(3.4, "bush", 0)),
            PlacedObject(147.0, 8.4, Tree(3.4 + 0.3, "bush", 2)),
            PlacedObject(152.0, 8.4, Tree(3.4 + 0.6, "bush", 4)),
            car(245.0, 0, "white"),
            car(268.0, -1, "black", "suv"),
            *oncoming_cars(1, s_m=(160, 300), opposite_m=14.0),
            *plant_trees(
                5,
                "oak bush",
                s_m=(150, 420),
                d_m=(-36, -30),
                height_m=(3, 9),
                every_m=11,
                bank=bank,
            ),
            *plant_trees(
                6,
                "scrub bush",
                s_m=(112, 260),
                d_m=(-27, -20),
                height_m=(0.8, 1.8),
                every_m=7,
                bank=bank,
            ),
        ),
        motion=_car_at_100_m(offset_m=0.14, heading_rad=0.003),
        seed=11,
    )


def _straight_lines2() -> Drive:
    """Straight, rightmost lane: broken white left, solid white right.

    There is traffic in the lanes to the left.
    """
    bank = PlacedWall(-6.2, "bank", height_scale=0.45, seed=7)
    freeway = replace(
        FRESH,
        lanes_left=3,
        lanes_right=0,
        phase_m=105.1,
        right_shoulder_m=3.4,
        opposite_m=17.0,
    )
    return freeway_drive(
        freeway,
        STRAIGHT,
        daylight(-40, 48),
        objects=(
            bank,
            PlacedWall(15.6, "jersey"),
            car(123.0, 3, "red", "suv"),
            car(152.0, 2, "black", "suv"),
            car(176.0, 2, "red"),
            car(163.0, 1, "white"),
            car(210.0, 1, "grey", "suv"),
            car(232.0, 0, "silver"),
            *oncoming_cars(2, s_m=(150, 300), opposite_m=17.0),
            PlacedObject(128.0, -9.5, Post(9.0, 0.28)),
            PlacedObject(168.0, -9.5, Post(9.0, 0.28)),
            PlacedObject(208.0, -9.5, Post(9.0, 0.28)),
            *plant_trees(
                7,
                "eucalyptus oak",
                s_m=(112, 330),
                d_m=(-29, -17),
                height_m=(9, 17),
                every_m=9,
                bank=bank,
            ),
            *plant_trees(
                8,
                "cypress",
                s_m=(140, 260),
                d_m=(34, 37),
                height_m=(8, 13),
                every_m=6,
            ),
        ),
        motion=_car_at_100_m(offset_m=-0.11, heading_rad=-0.002),
        seed=22,
    )


def _test1() -> Drive:
    """Light concrete with a patch and a crack, gentle bend right, two cars right."""
    freeway = replace(
        CONCRETE,
        zones=(Zone(176.0, "fresh asphalt", 0.2),),
        phase_m=107.0,
        wear=0.35,
        seams=(Seam(0.4, 0.02, wander_m=0.10, start_m=104.0, end_m=113.0),),
        patches=(Patch(108.0, 112.5, -1.3, -0.4, "old asphalt"),),
    )
    return freeway_drive(
        freeway,
        bend_road(-1 / 900),
        daylight(100, 60, tree_density=0.9),
        objects=(
            PlacedWall(4.35, "parapet", seed=2),
            PlacedWall(-16.4, "rail", seed=5),
            car(121.0, -1, "black"),
            car(119.0, -2, "white"),
            car(196.0, -1, "silver"),
            car(214.0, -2, "grey", "suv"),
            *oncoming_cars(3, s_m=(125, 300), opposite_m=5.4),
            *plant_trees(
                9,
                "plane oak",
                s_m=(135, 340),
                d_m=(23, 40),
                height_m=(6, 13),
                every_m=16,
            ),
            *plant_trees(
                10,
                "eucalyptus oak",
                s_m=(150, 380),
                d_m=(-34, -21),
                height_m=(8, 17),
                every_m=13,
            ),
        ),
        motion=_car_at_100_m(offset_m=0.22, heading_rad=0.004),
        seed=33,
    )


def _test2() -> Drive:
    """Bends left, R 480 m, behind a median barrier; nearly empty road."""
    bank = PlacedWall(-18.0, "bank", seed=8)
    freeway = replace(
        FRESH,
        phase_m=108.3,
        opposite_m=5.4,
        seams=(replace(DUSTY, lateral_m=-0.3),),
    )
    return freeway_drive(
        freeway,
        bend_road(1 / 480),
        daylight(35, 52),
        objects=(
            PlacedWall(4.35, "jersey", seed=4),
            bank,
            car(232.0, -1, "blue"),
            *oncoming_cars(4, s_m=(140, 300), opposite_m=5.4),
            *plant_trees(
                11,
                "oak bush",
                s_m=(120, 400),
                d_m=(-42, -33),
                height_m=(3, 9),
                every_m=10,
                bank=bank,
            ),
            *plant_trees(
                12,
                "scrub bush",
                s_m=(112, 300),
                d_m=(-29, -22),
                height_m=(0.7, 1.8),
                every_m=6,
                bank=bank,
            ),
        ),
        motion=_car_at_100_m(offset_m=0.33, heading_rad=-0.004),
        seed=44,
    )


def _test3() -> Drive:
    """Bends right, R 620 m, older asphalt with a tar seam, wooded ridge.

    There is one car ahead on the right.
    """
    bank = PlacedWall(-17.0, "bank", height_scale=1.25, seed=9)
    seam = Seam(0.9, wander_m=0.08, start_m=103.0, end_m=160.0, strength=0.5)
    return freeway_drive(
        Freeway(phase_m=104.6, left_shoulder_m=3.0, seams=(seam,)),
        bend_road(-1 / 620),
        daylight(60, 50, ridge_height_rad=0.11, tree_density=0.9),
        objects=(
            PlacedWall(5.0, "jersey", seed=6),
            bank,
            car(130.0, -2, "white"),
            car(197.0, -1, "blue", "suv"),
            *plant_trees(
                13,
                "plane oak",
                s_m=(112, 330),
                d_m=(12, 24),
                height_m=(3, 7),
                every_m=10,
            ),
            *plant_trees(
                14,
                "oak",
                s_m=(180, 330),
                d_m=(-34, -24),
                height_m=(4, 8),
                every_m=12,
                bank=bank,
            ),
        ),
        motion=_car_at_100_m(offset_m=-0.18, heading_rad=0.006),
        seed=55,
    )


def _test4() -> Drive:
    """Fresh asphalt ends and concrete begins 11 m ahead; bends right; two cars.

    There is a tree shadow on the near part.
    """
    freeway = replace(
        FRESH,
        zones=(Zone(111.5, "concrete", 0.35), Zone(150.0, "asphalt")),
        phase_m=111.2,
        wear=0.25,
        opposite_m=5.4,
    )
    return freeway_drive(
        freeway,
        bend_road(-1 / 780),
        daylight(80, 50, tree_density=0.9),
        shades=(TreeShade(102.5, 108.5, -2.6, 4.4, 0.95),),
        objects=(
            PlacedWall(4.35, "parapet", seed=11),
            PlacedWall(-16.4, "rail", seed=5),
            car(119.5, -1, "black"),
            car(121.0, -2, "white"),
            car(190.0, -1, "silver"),
            car(228.0, -2, "grey"),
            *oncoming_cars(5, s_m=(130, 300), opposite_m=5.4),
            *plant_trees(
                15,
                "plane oak",
                s_m=(140, 340),
                d_m=(22, 36),
                height_m=(7, 12),
                every_m=18,
            ),
            *plant_trees(
                16,
                "eucalyptus oak",
                s_m=(150, 380),
                d_m=(-34, -22),
                height_m=(8, 17),
                every_m=12,
            ),
        ),
        motion=_car_at_100_m(offset_m=0.16, heading_rad=-0.003),
        seed=66,
    )


def _test5() -> Drive:
    """Concrete ends in the deep shade of trees 14 m ahead; bends right, R 560 m.

    There are two cars.
    """
    freeway = replace(
        CONCRETE,
        zones=(Zone(118.0, "asphalt", -0.3),),
        phase_m=103.0,
        wear=0.3,
        opposite_m=17.0,
    )
    return freeway_drive(
        freeway,
        bend_road(-1 / 560),
        daylight(75, 50, tree_density=1.0),
        shades=(
            TreeShade(114.0, 131.0, -6.0, 9.0, 0.97),
            TreeShade(133.0, 150.0, -3.0, 9.0, 0.95),
        ),
        objects=(
            PlacedWall(4.35, "jersey", seed=12),
            car(121.0, -1, "black"),
            car(118.0, -2, "white"),
            car(186.0, -1, "white"),
            PlacedObject(116.0, 10.0, Tree(15.0, "eucalyptus", 1)),
            PlacedObject(124.0, 12.5, Tree(14.0, "plane", 2)),
            PlacedObject(133.0, 11.0, Tree(15.0, "eucalyptus", 3)),
            *oncoming_cars(8, s_m=(130, 300), opposite_m=17.0),
            *plant_trees(
                17,
                "oak plane",
                s_m=(160, 340),
                d_m=(33, 45),
                height_m=(7, 12),
                every_m=12,
            ),
            *plant_trees(
                18,
                "eucalyptus redwood",
                s_m=(128, 300),
                d_m=(-27, -19),
                height_m=(11, 18),
                every_m=8,
            ),
        ),
        motion=_car_at_100_m(offset_m=-0.26, heading_rad=0.005),
        seed=77,
    )


def _test6() -> Drive:
    """Bends left, R 380 m; old asphalt with a patch, tar and a fresh section.

    There is a car on the right.
    """
    bank = PlacedWall(-18.5, "bank", height_scale=0.8, seed=14)
    freeway = Freeway(
        "old asphalt",
        zones=(Zone(124.0, "fresh asphalt", 0.1), Zone(163.0, "old asphalt")),
        phase_m=106.4,
        wear=0.45,
        opposite_m=5.6,
        patches=(Patch(109.0, 114.0, -1.9, 0.2, "fresh asphalt"),),
        seams=(
            Seam(0.75, 0.04, wander_m=0.09, start_m=100.0, end_m=124.0),
            Seam(-0.9, 0.03, wander_m=0.07, start_m=106.0, end_m=124.0),
        ),
    )
    return freeway_drive(
        freeway,
        bend_road(1 / 380),
        daylight(-70, 45, tree_density=0.6),
        objects=(
            PlacedWall(4.6, "jersey", seed=13),
            bank,
            car(114.0, -1, "silver", "suv"),
            car(150.0, -2, "red"),
            car(196.0, 0, "grey"),
            *oncoming_cars(6, s_m=(130, 300), opposite_m=5.6),
            *plant_trees(
                19,
                "plane",
                s_m=(125, 300),
                d_m=(23, 34),
                height_m=(7, 12),
                every_m=15,
            ),
            *plant_trees(
                20,
                "oak bush",
                s_m=(130, 400),
                d_m=(-38, -31),
                height_m=(4, 10),
                every_m=10,
                bank=bank,
            ),
        ),
        motion=_car_at_100_m(offset_m=0.2, heading_rad=0.002),
        seed=88,
    )
