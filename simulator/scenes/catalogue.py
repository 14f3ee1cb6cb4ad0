"""The pictures and the video that the course uses: what each of them shows.

The stills are twins in kind of the eight that everyone in this field knows, under the same names: none is centred in
its lane, most are curved, and light, pavement and traffic differ.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simulator.light.lens import Lens
from simulator.light.sunlight import TreeShade
from simulator.objects.roadside import Along, Placed
from simulator.objects.solids import Post, Sign, Tree
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry
from simulator.road.surface import Patch, Seam, Zone
from simulator.road.verge import DUST
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import LANE_M, bend, car, freeway_markings, freeway_surface, grove, oncoming, weather

EGO_LINES_M = (LANE_M / 2, -LANE_M / 2)
STRAIGHT = RoadGeometry([0.0, 2000.0], [0.0, 0.0])


def still_scenes() -> dict[str, Drive]:
    """The eight stills by file name without suffix."""
    return {name: build() for name, build in _STILLS.items()}


def _straight_lines1() -> Drive:
    """Straight; solid yellow left, broken white right; fresh asphalt, dry hills; car left of the centre."""
    bank = Along(-17.5, "bank", height_scale=0.9, seed=3)
    return Drive(
        camera=DASHCAM,
        road=STRAIGHT,
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=102.2, opposite_m=14.0),
        surface=freeway_surface(
            Zone(0.0, "fresh asphalt"),
            opposite_m=14.0,
            seams=(
                Seam(-0.75, 0.14, 0.015, strength=0.16, colour=DUST, soft_m=0.12),
                Seam(1.65, 0.2, 0.02, strength=0.14, colour=DUST, soft_m=0.2),
            ),
        ),
        things=(
            bank,
            Along(12.6, "jersey"),
            Placed(200.0, -16.6, Sign(0, 0, "green", 3.2, 1.6, 2.6)),
            Placed(155.0, -16.4, Sign(0, 0, "speed", 0.9, 1.2, 2.1)),
            *(Placed(142.0 + 5 * i, 8.4, Tree(0, 0, 3.4 + 0.3 * i, "bush", 2 * i)) for i in range(3)),
            car(245.0, 0, "white"),
            car(268.0, -1, "black", "suv"),
            *oncoming(1, along=(160, 300), opposite_m=14.0),
            *grove(5, "oak bush", along=(150, 420), aside=(-36, -30), tall=(3, 9), every_m=11, bank=bank),
            *grove(6, "scrub bush", along=(112, 260), aside=(-27, -20), tall=(0.8, 1.8), every_m=7, bank=bank),
        ),
        motion=Motion(100.0, offset_m=0.14, heading_rad=0.003),
        seed=11,
        **weather(70, 55),
    )


def _straight_lines2() -> Drive:
    """Straight, in the right-hand lane: broken white left, solid white right; traffic in the lanes to the left."""
    bank = Along(-6.2, "bank", height_scale=0.45, seed=7)
    side = {"lanes_left": 3, "lanes_right": 0}
    return Drive(
        camera=DASHCAM,
        road=STRAIGHT,
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(**side, phase_m=105.1, opposite_m=17.0),
        surface=freeway_surface(Zone(0.0, "fresh asphalt"), **side, right_shoulder_m=3.4, opposite_m=17.0),
        things=(
            bank,
            Along(15.6, "jersey"),
            car(123.0, 3, "red", "suv"),
            car(152.0, 2, "black", "suv"),
            car(176.0, 2, "red"),
            car(163.0, 1, "white"),
            car(210.0, 1, "grey", "suv"),
            car(232.0, 0, "silver"),
            *oncoming(2, along=(150, 300), opposite_m=17.0),
            *(Placed(128.0 + 40 * i, -9.5, Post(0, 0, 9.0, 0.28)) for i in range(3)),
            *grove(7, "eucalyptus oak", along=(112, 330), aside=(-29, -17), tall=(9, 17), every_m=9, bank=bank),
            *grove(8, "cypress", along=(140, 260), aside=(34, 37), tall=(8, 13), every_m=6),
        ),
        motion=Motion(100.0, offset_m=-0.11, heading_rad=-0.002),
        seed=22,
        **weather(-40, 48),
    )


def _test1() -> Drive:
    """Light concrete with a repair and a crack, gentle bend to the right, two cars on the right."""
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 900),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=107.0, wear=0.35, opposite_m=5.4),
        surface=freeway_surface(
            Zone(0.0, "concrete"),
            Zone(176.0, "fresh asphalt", 0.2),
            opposite_m=5.4,
            seams=(Seam(0.4, 0.02, 0.10, 104.0, 113.0),),
            patches=(Patch(108.0, 112.5, -1.3, -0.4, "old asphalt"),),
        ),
        things=(
            Along(4.35, "parapet", seed=2),
            Along(-16.4, "rail", seed=5),
            car(121.0, -1, "black"),
            car(119.0, -2, "white"),
            car(196.0, -1, "silver"),
            car(214.0, -2, "grey", "suv"),
            *oncoming(3, along=(125, 300), opposite_m=5.4),
            *grove(9, "plane oak", along=(135, 340), aside=(23, 40), tall=(6, 13), every_m=16),
            *grove(10, "eucalyptus oak", along=(150, 380), aside=(-34, -21), tall=(8, 17), every_m=13),
        ),
        motion=Motion(100.0, offset_m=0.22, heading_rad=0.004),
        seed=33,
        **weather(100, 60, tree_density=0.9),
    )


def _test2() -> Drive:
    """Bends left, R 480 m, behind a median barrier; nearly empty road."""
    bank = Along(-18.0, "bank", seed=8)
    return Drive(
        camera=DASHCAM,
        road=bend(1 / 480),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=108.3, opposite_m=5.4),
        surface=freeway_surface(
            Zone(0.0, "fresh asphalt"),
            opposite_m=5.4,
            seams=(Seam(-0.3, 0.14, 0.015, strength=0.16, colour=DUST, soft_m=0.12),),
        ),
        things=(
            Along(4.35, "jersey", seed=4),
            bank,
            Placed(121.0, 5.1, Sign(0, 0, "warning", 1.1, 1.1, 2.0)),
            Placed(158.0, -16.6, Sign(0, 0, "blue", 1.2, 0.6, 2.0)),
            car(232.0, -1, "blue"),
            *oncoming(4, along=(140, 300), opposite_m=5.4),
            *grove(11, "oak bush", along=(120, 400), aside=(-42, -33), tall=(3, 9), every_m=10, bank=bank),
            *grove(12, "scrub bush", along=(112, 300), aside=(-29, -22), tall=(0.7, 1.8), every_m=6, bank=bank),
        ),
        motion=Motion(100.0, offset_m=0.33, heading_rad=-0.004),
        seed=44,
        **weather(35, 52),
    )


def _test3() -> Drive:
    """Bends right, R 620 m, older asphalt with a tar seam, wooded ridge, one car ahead on the right."""
    bank = Along(-17.0, "bank", height_scale=1.25, seed=9)
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 620),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=104.6),
        surface=freeway_surface(
            Zone(0.0, "asphalt"), left_shoulder_m=3.0, seams=(Seam(0.9, 0.03, 0.08, 103.0, 160.0, 0.5),)
        ),
        things=(
            Along(5.0, "jersey", seed=6),
            bank,
            car(130.0, -2, "white"),
            car(197.0, -1, "blue", "suv"),
            Placed(215.0, -16.5, Sign(0, 0, "warning", 1.1, 1.1, 2.0)),
            *grove(13, "plane oak", along=(112, 330), aside=(12, 24), tall=(3, 7), every_m=10),
            *grove(14, "oak", along=(180, 330), aside=(-34, -24), tall=(4, 8), every_m=12, bank=bank),
        ),
        motion=Motion(100.0, offset_m=-0.18, heading_rad=0.006),
        seed=55,
        **weather(60, 50, ridge_height_rad=0.11, tree_density=0.9),
    )


def _test4() -> Drive:
    """Fresh asphalt ends and concrete begins 11 m ahead; tree shadow on the near part; bends right; two cars."""
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 780),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=111.2, wear=0.25, opposite_m=5.4),
        surface=freeway_surface(
            Zone(0.0, "fresh asphalt"), Zone(111.5, "concrete", 0.35), Zone(150.0, "asphalt"), opposite_m=5.4
        ),
        shades=(TreeShade(102.5, 108.5, -2.6, 4.4, 0.95),),
        things=(
            Along(4.35, "parapet", seed=11),
            Along(-16.4, "rail", seed=5),
            car(119.5, -1, "black"),
            car(121.0, -2, "white"),
            car(190.0, -1, "silver"),
            car(228.0, -2, "grey"),
            *oncoming(5, along=(130, 300), opposite_m=5.4),
            *grove(15, "plane oak", along=(140, 340), aside=(22, 36), tall=(7, 12), every_m=18),
            *grove(16, "eucalyptus oak", along=(150, 380), aside=(-34, -22), tall=(8, 17), every_m=12),
        ),
        motion=Motion(100.0, offset_m=0.16, heading_rad=-0.003),
        seed=66,
        **weather(80, 50, tree_density=0.9),
    )


def _test5() -> Drive:
    """Concrete ends in the deep shade of trees 14 m ahead; bends right, R 560 m; two cars."""
    trunks = ((116.0, 10.0, 15.0, "eucalyptus"), (124.0, 12.5, 14.0, "plane"), (133.0, 11.0, 15.0, "eucalyptus"))
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 560),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=103.0, wear=0.3, opposite_m=17.0),
        surface=freeway_surface(Zone(0.0, "concrete"), Zone(118.0, "asphalt", -0.3), opposite_m=17.0),
        shades=(TreeShade(114.0, 131.0, -6.0, 9.0, 0.97), TreeShade(133.0, 150.0, -3.0, 9.0, 0.95)),
        things=(
            Along(4.35, "jersey", seed=12),
            car(121.0, -1, "black"),
            car(118.0, -2, "white"),
            car(186.0, -1, "white"),
            *(Placed(s, d, Tree(0, 0, tall, kind, i + 1)) for i, (s, d, tall, kind) in enumerate(trunks)),
            *oncoming(8, along=(130, 300), opposite_m=17.0),
            *grove(17, "oak plane", along=(160, 340), aside=(33, 45), tall=(7, 12), every_m=12),
            *grove(18, "eucalyptus redwood", along=(128, 300), aside=(-27, -19), tall=(11, 18), every_m=8),
        ),
        motion=Motion(100.0, offset_m=-0.26, heading_rad=0.005),
        seed=77,
        **weather(75, 50, tree_density=1.0),
    )


def _test6() -> Drive:
    """Bends left, R 380 m; old asphalt with a patch, tar and a stretch of fresh; a car alongside."""
    bank = Along(-18.5, "bank", height_scale=0.8, seed=14)
    return Drive(
        camera=DASHCAM,
        road=bend(1 / 380),
        line_laterals_m=EGO_LINES_M,
        markings=freeway_markings(phase_m=106.4, wear=0.45, opposite_m=5.6),
        surface=freeway_surface(
            Zone(0.0, "old asphalt"),
            Zone(124.0, "fresh asphalt", 0.1),
            Zone(163.0, "old asphalt"),
            opposite_m=5.6,
            patches=(Patch(109.0, 114.0, -1.9, 0.2, "fresh asphalt"),),
            seams=(Seam(0.75, 0.04, 0.09, 100.0, 124.0), Seam(-0.9, 0.03, 0.07, 106.0, 124.0)),
        ),
        things=(
            Along(4.6, "jersey", seed=13),
            bank,
            car(114.0, -1, "silver", "suv"),
            car(150.0, -2, "red"),
            car(196.0, 0, "grey"),
            *oncoming(6, along=(130, 300), opposite_m=5.6),
            *grove(19, "plane", along=(125, 300), aside=(23, 34), tall=(7, 12), every_m=15),
            *grove(20, "oak bush", along=(130, 400), aside=(-38, -31), tall=(4, 10), every_m=10, bank=bank),
        ),
        motion=Motion(100.0, offset_m=0.2, heading_rad=0.002),
        seed=88,
        **weather(-70, 45, tree_density=0.6),
    )


_STILLS: dict[str, Callable[[], Drive]] = {
    "straight_lines1": _straight_lines1,
    "straight_lines2": _straight_lines2,
    "test1": _test1,
    "test2": _test2,
    "test3": _test3,
    "test4": _test4,
    "test5": _test5,
    "test6": _test6,
}


def project_video() -> Drive:
    """Ten seconds at 27 m/s: straight, an S-bend left (R 520 m) and right (R 400 m), tree shadows, light concrete."""
    bank = Along(-18.0, "bank", seed=16)
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
        things=(
            Along(4.4, "jersey", seed=15),
            bank,
            car(14.0, -1, "white", speed_mps=25.3),
            car(46.0, -2, "black", "suv", speed_mps=27.5),
            car(95.0, -1, "silver", speed_mps=29.0),
            car(130.0, 0, "grey", speed_mps=28.5),
            Placed(120.0, -16.7, Sign(0, 0, "green", 3.2, 1.6, 2.6)),
            Placed(205.0, -16.5, Sign(0, 0, "speed", 0.9, 1.2, 2.1)),
            *oncoming(7, along=(60, 640), opposite_m=17.0, speed_mps=26.0),
            *grove(21, "oak bush", along=(10, 620), aside=(-40, -31), tall=(4, 9), every_m=14, bank=bank),
            *grove(22, "scrub bush", along=(10, 620), aside=(-30, -21), tall=(0.8, 2.0), every_m=13, bank=bank),
            *grove(23, "eucalyptus oak", along=(140, 176), aside=(11, 13), tall=(11, 14), every_m=9),
            *grove(24, "eucalyptus plane", along=(238, 262), aside=(11, 13), tall=(11, 14), every_m=9),
            *grove(25, "plane oak", along=(60, 620), aside=(34, 50), tall=(6, 11), every_m=22),
        ),
        motion=Motion(0.0, 27.0, offset_m=0.05, wander_m=0.22, wander_period_s=6.5, pitch_rad=float(np.radians(0.22))),
        lens=Lens(noise=0.005),
        seed=99,
        **weather(75, 50, tree_density=0.7),
    )
