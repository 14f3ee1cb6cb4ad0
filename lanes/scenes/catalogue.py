"""The pictures and the video that the course uses: what each of them shows.

The stills are twins in kind of the eight that everyone in this field knows, under the same names: none is centred in
its lane, most are curved, and light, pavement and traffic differ.
"""

from __future__ import annotations

import numpy as np

from lanes.scenes.backdrop import BackdropStyle
from lanes.scenes.dashcam import DASHCAM
from lanes.scenes.lens import Lens
from lanes.scenes.light import Sun, TreeShade
from lanes.scenes.markings import WHITE, YELLOW, Marking
from lanes.scenes.objects import Car, Post, Sign, Tree
from lanes.scenes.render import Drive, Motion
from lanes.scenes.road import RoadGeometry
from lanes.scenes.roadside import Along, Placed
from lanes.scenes.surface import Patch, Seam, Surface, Zone

# Twelve feet, the lane of a US freeway; the second is what older ones have.
LANE_M = 3.66
VIDEO_SECONDS = 10.0
VIDEO_FPS = 25


def freeway_markings(
    *, lanes_left: int = 0, lanes_right: int = 3, lane_m: float = LANE_M, phase_m: float = 0.0, wear: float = 0.15
) -> tuple[Marking, ...]:
    """Lines of one carriageway around the ego lane, whose centre is the reference line: solid yellow on the far left,
    solid white on the far right, broken white between."""
    marks = [Marking((lanes_left + 0.5) * lane_m, 0.15, YELLOW, wear=wear, dots=True)]
    for number in range(lanes_left + lanes_right):
        lateral = (lanes_left - 0.5 - number) * lane_m
        # Neighbouring lines are painted in one pass, so their dashes are nearly, not exactly, abreast.
        marks.append(Marking(lateral, 0.12, WHITE, dashed=True, phase_m=phase_m + 0.35 * number, wear=wear, dots=True))
    marks.append(Marking(-(lanes_right + 0.5) * lane_m, 0.12, WHITE, wear=wear))
    return tuple(marks)


def freeway_surface(
    zones: tuple[Zone, ...],
    *,
    lanes_left: int = 0,
    lanes_right: int = 3,
    lane_m: float = LANE_M,
    left_shoulder_m: float = 2.4,
    right_shoulder_m: float = 2.8,
    patches: tuple[Patch, ...] = (),
    seams: tuple[Seam, ...] = (),
) -> Surface:
    """Pavement of the same carriageway, with the paving joint that runs beside each broken line."""
    centres = tuple((lanes_left - number) * lane_m for number in range(lanes_left + lanes_right + 1))
    joints = tuple(Seam(c - lane_m / 2 - 0.18, 0.025, 0.02, strength=0.5) for c in centres[:-1])
    return Surface(
        zones,
        right_edge_m=-(lanes_right + 0.5) * lane_m - right_shoulder_m,
        left_edge_m=(lanes_left + 0.5) * lane_m + left_shoulder_m,
        lane_centres_m=centres,
        patches=patches,
        seams=joints + seams,
    )


def bend(curvature_per_m: float, *, before_m: float = 60.0, ahead_m: float = 300.0, rate: float = 1.5e-5):
    """A road that is already bending where the car is (arc length 100) and eases out again far ahead."""
    ease = max(abs(curvature_per_m) / rate, 30.0)
    return RoadGeometry(
        [0.0, 100 - before_m, 100 + ahead_m, 100 + ahead_m + ease],
        [curvature_per_m * 0.4, curvature_per_m, curvature_per_m, 0.0],
    )


def weather(azimuth_deg: float, elevation_deg: float, **country) -> dict:
    """The sun and the backdrop that it lights; `country` as in BackdropStyle."""
    sun = Sun(float(np.radians(azimuth_deg)), float(np.radians(elevation_deg)))
    return {
        "sun": sun,
        "backdrop": BackdropStyle(sun_azimuth_rad=sun.azimuth_rad, sun_elevation_rad=sun.elevation_rad, **country),
    }


def row_of_trees(
    seed: int,
    *,
    start_m: float,
    end_m: float,
    lateral_m: tuple[float, float],
    every_m: float,
    height_m: tuple[float, float],
    species: tuple[str, ...],
    base_m: float = 0.0,
) -> tuple[Placed, ...]:
    """Trees or bushes strewn along the road between two lateral distances."""
    rng = np.random.default_rng(seed)
    trees = []
    for s in np.arange(start_m, end_m, every_m):
        tree = Tree(0, 0, rng.uniform(*height_m), str(rng.choice(species)), int(rng.integers(6)), base_m)
        trees.append(Placed(float(s + rng.uniform(-0.4, 0.4) * every_m), float(rng.uniform(*lateral_m)), tree))
    return tuple(trees)


def oncoming(
    seed: int, *, start_m: float, end_m: float, lateral_m: float, speed_mps: float = 0.0
) -> tuple[Placed, ...]:
    """Some cars on the other carriageway."""
    rng = np.random.default_rng(seed)
    cars = []
    for s in np.arange(start_m, end_m, 38.0):
        paint, body = str(rng.choice(["white", "silver", "grey", "blue", "black"])), str(rng.choice(["sedan", "suv"]))
        lateral = lateral_m + LANE_M * float(rng.integers(3))
        cars.append(Placed(float(s + rng.uniform(-15, 15)), lateral, Car(0, 0, np.pi, paint, body), -speed_mps))
    return tuple(cars)


def car(
    s_m: float, lane: int, paint: str, body: str = "sedan", *, speed_mps: float = 0.0, lane_m: float = LANE_M
) -> Placed:
    """A car in the middle of a lane, counted from the ego lane to the left."""
    return Placed(s_m, lane * lane_m, Car(0, 0, 0.0, paint, body), speed_mps)


def _straight_lines1() -> Drive:
    """Straight, solid yellow left, broken white right, fresh asphalt, open country; car left of the centre."""
    return Drive(
        camera=DASHCAM,
        road=RoadGeometry([0.0, 2000.0], [0.0, 0.0]),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=102.2),
        surface=freeway_surface((Zone(0.0, "fresh asphalt"),)),
        things=(
            Along(-17.5, "bank", 100.0, 900.0, 0.9, seed=3),
            Along(9.5, "jersey", -100.0, 900.0, 0.7),
            Placed(190.0, -16.6, Sign(0, 0, "green", 3.2, 1.6, 2.6)),
            Placed(155.0, -16.4, Sign(0, 0, "speed", 0.9, 1.2, 2.1)),
            Placed(142.0, 7.6, Tree(0, 0, 3.6, "bush", 2)),
            Placed(147.0, 7.4, Tree(0, 0, 3.9, "bush", 4)),
            Placed(152.0, 7.8, Tree(0, 0, 3.4, "bush", 1)),
            car(245.0, 0, "white"),
            car(268.0, -1, "black", "suv"),
            *oncoming(1, start_m=160.0, end_m=300.0, lateral_m=13.0),
            *row_of_trees(
                5,
                start_m=150,
                end_m=420,
                lateral_m=(-34, -27),
                every_m=11,
                height_m=(3, 9),
                species=("oak", "bush"),
                base_m=5.0,
            ),
            *row_of_trees(
                6,
                start_m=112,
                end_m=260,
                lateral_m=(-25, -20),
                every_m=7,
                height_m=(0.8, 1.8),
                species=("scrub", "bush"),
                base_m=1.5,
            ),
        ),
        **weather(70, 55),
        motion=Motion(100.0, offset_m=0.14, heading_rad=0.003),
        seed=11,
    )


def _straight_lines2() -> Drive:
    """Straight, right-hand lane: broken white left, solid white right; traffic in the lanes to the left."""
    side = {"lanes_left": 3, "lanes_right": 0}
    return Drive(
        camera=DASHCAM,
        road=RoadGeometry([0.0, 2000.0], [0.0, 0.0]),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(**side, phase_m=105.1),
        surface=freeway_surface((Zone(0.0, "fresh asphalt"),), **side, right_shoulder_m=3.4),
        things=(
            Along(-6.2, "bank", -100.0, 900.0, 0.45, seed=7),
            Along(15.5, "jersey"),
            car(123.0, 3, "red", "suv"),
            car(152.0, 2, "black", "suv"),
            car(176.0, 2, "red"),
            car(163.0, 1, "white"),
            car(210.0, 1, "grey", "suv"),
            car(232.0, 0, "silver"),
            *oncoming(2, start_m=150.0, end_m=300.0, lateral_m=20.0),
            *(Placed(120.0 + 32 * i, -9.0, Post(0, 0, 9.0, 0.28)) for i in range(3)),
            *row_of_trees(
                7,
                start_m=112,
                end_m=330,
                lateral_m=(-26, -17),
                every_m=9,
                height_m=(9, 17),
                species=("eucalyptus", "oak"),
                base_m=2.5,
            ),
            *row_of_trees(
                8, start_m=118, end_m=190, lateral_m=(30, 36), every_m=6, height_m=(8, 13), species=("cypress",)
            ),
        ),
        **weather(-40, 48),
        motion=Motion(100.0, offset_m=-0.11, heading_rad=-0.002),
        seed=22,
    )


def _test1() -> Drive:
    """Light concrete, gentle bend to the right, two cars on the right."""
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 900),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=107.0, wear=0.35),
        surface=freeway_surface(
            (Zone(0.0, "concrete"), Zone(176.0, "fresh asphalt", 0.2)),
            seams=(Seam(0.4, 0.02, 0.15, 104.0, 113.0),),
            patches=(Patch(108.0, 112.5, -1.3, -0.4, "old asphalt"),),
        ),
        things=(
            Along(4.35, "parapet", seed=2),
            car(121.0, -1, "black"),
            car(115.0, -3, "white"),
            car(196.0, -1, "silver"),
            car(214.0, -2, "grey", "suv"),
            *oncoming(3, start_m=125.0, end_m=300.0, lateral_m=9.0),
            Along(-16.4, "rail", seed=5),
            *row_of_trees(
                9, start_m=135, end_m=340, lateral_m=(23, 40), every_m=16, height_m=(6, 13), species=("plane", "oak")
            ),
            *row_of_trees(
                10,
                start_m=150,
                end_m=380,
                lateral_m=(-34, -21),
                every_m=13,
                height_m=(8, 17),
                species=("eucalyptus", "oak"),
            ),
        ),
        **weather(100, 60, tree_density=0.9),
        motion=Motion(100.0, offset_m=0.22, heading_rad=0.004),
        seed=33,
    )


def _test2() -> Drive:
    """Bends left, R about 480 m, barrier on the left, empty road."""
    return Drive(
        camera=DASHCAM,
        road=bend(1 / 480),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=108.3),
        surface=freeway_surface((Zone(0.0, "fresh asphalt"),), seams=(Seam(-0.1, 0.05, 0.03, strength=0.25),)),
        things=(
            Along(4.35, "jersey", seed=4),
            Along(-18.0, "bank", -100.0, 900.0, 1.0, seed=8),
            Placed(121.0, 5.6, Sign(0, 0, "warning", 1.1, 1.1, 2.0)),
            Placed(158.0, -16.6, Sign(0, 0, "blue", 1.2, 0.6, 2.0)),
            car(232.0, -1, "blue"),
            *oncoming(4, start_m=140.0, end_m=300.0, lateral_m=9.5),
            *row_of_trees(
                11,
                start_m=120,
                end_m=400,
                lateral_m=(-40, -31),
                every_m=10,
                height_m=(3, 9),
                species=("oak", "bush"),
                base_m=7.0,
            ),
            *row_of_trees(
                12,
                start_m=112,
                end_m=300,
                lateral_m=(-27, -22),
                every_m=6,
                height_m=(0.7, 1.8),
                species=("scrub", "bush"),
                base_m=2.0,
            ),
        ),
        **weather(35, 52),
        motion=Motion(100.0, offset_m=0.33, heading_rad=-0.004),
        seed=44,
    )


def _test3() -> Drive:
    """Bends right, R about 620 m, older asphalt, wooded ridge, one car ahead on the right."""
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 620),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=104.6),
        surface=freeway_surface(
            (Zone(0.0, "asphalt"),), left_shoulder_m=3.0, seams=(Seam(0.9, 0.03, 0.08, 103.0, 160.0, 0.5),)
        ),
        things=(
            Along(5.0, "jersey", seed=6),
            car(130.0, -2, "white"),
            car(197.0, -1, "blue", "suv"),
            Along(-17.0, "bank", 122.0, 900.0, 1.25, seed=9),
            Placed(205.0, -16.8, Sign(0, 0, "warning", 1.1, 1.1, 2.0)),
            *row_of_trees(
                13, start_m=112, end_m=330, lateral_m=(12, 24), every_m=10, height_m=(3, 7), species=("plane", "oak")
            ),
            *row_of_trees(
                14,
                start_m=200,
                end_m=330,
                lateral_m=(-34, -24),
                every_m=12,
                height_m=(6, 9),
                species=("oak",),
                base_m=3.0,
            ),
        ),
        **weather(60, 50, ridge_height_rad=0.11, tree_density=0.9),
        motion=Motion(100.0, offset_m=-0.18, heading_rad=0.006),
        seed=55,
    )


def _test4() -> Drive:
    """Fresh asphalt ends and concrete begins 11 m ahead; tree shadow on the near part; bends right; two cars."""
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 780),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=111.2, wear=0.25),
        surface=freeway_surface((Zone(0.0, "fresh asphalt"), Zone(111.5, "concrete", 0.35), Zone(150.0, "asphalt"))),
        shades=(TreeShade(103.0, 109.5, -3.2, 4.5, 0.95),),
        things=(
            Along(4.35, "parapet", seed=11),
            car(119.5, -1, "black"),
            car(117.0, -3, "white"),
            car(190.0, -1, "silver"),
            car(228.0, -2, "grey"),
            *oncoming(5, start_m=130.0, end_m=300.0, lateral_m=9.0),
            Along(-16.4, "rail", seed=5),
            *row_of_trees(
                15, start_m=140, end_m=340, lateral_m=(22, 36), every_m=18, height_m=(7, 12), species=("plane", "oak")
            ),
            *row_of_trees(
                16,
                start_m=150,
                end_m=380,
                lateral_m=(-34, -22),
                every_m=12,
                height_m=(8, 17),
                species=("eucalyptus", "oak"),
            ),
        ),
        **weather(80, 50, tree_density=0.9),
        motion=Motion(100.0, offset_m=0.16, heading_rad=-0.003),
        seed=66,
    )


def _test5() -> Drive:
    """Concrete ends in the deep shade of trees 14 m ahead; bends right, R about 560 m; two cars."""
    return Drive(
        camera=DASHCAM,
        road=bend(-1 / 560),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=103.0, wear=0.3),
        surface=freeway_surface((Zone(0.0, "concrete"), Zone(118.0, "asphalt", -0.3))),
        shades=(TreeShade(114.0, 131.0, -6.0, 9.0, 0.97), TreeShade(133.0, 150.0, -3.0, 9.0, 0.95)),
        things=(
            Along(4.35, "jersey", seed=12),
            car(121.0, -1, "black"),
            car(114.5, -3, "white"),
            car(186.0, -1, "white"),
            Placed(116.0, 10.0, Tree(0, 0, 15.0, "eucalyptus", 3)),
            Placed(124.0, 13.0, Tree(0, 0, 14.0, "plane", 1)),
            Placed(133.0, 11.0, Tree(0, 0, 15.0, "eucalyptus", 5)),
            Placed(141.0, 14.0, Tree(0, 0, 13.0, "oak", 2)),
            *row_of_trees(
                17, start_m=160, end_m=340, lateral_m=(16, 30), every_m=14, height_m=(7, 12), species=("oak", "plane")
            ),
            *row_of_trees(
                18,
                start_m=128,
                end_m=300,
                lateral_m=(-27, -19),
                every_m=8,
                height_m=(11, 18),
                species=("eucalyptus", "redwood"),
            ),
        ),
        **weather(75, 50, tree_density=1.0),
        motion=Motion(100.0, offset_m=-0.26, heading_rad=0.005),
        seed=77,
    )


def _test6() -> Drive:
    """Bends left, R about 380 m, old asphalt with patches and a stretch of fresh, a car alongside."""
    return Drive(
        camera=DASHCAM,
        road=bend(1 / 380),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=106.4, wear=0.45),
        surface=freeway_surface(
            (Zone(0.0, "old asphalt"), Zone(124.0, "fresh asphalt", 0.1), Zone(163.0, "old asphalt")),
            patches=(Patch(109.0, 114.0, -1.9, 0.2, "fresh asphalt"),),
            seams=(Seam(0.75, 0.04, 0.12, 100.0, 124.0), Seam(-0.9, 0.03, 0.1, 106.0, 124.0)),
        ),
        things=(
            Along(4.6, "jersey", seed=13),
            car(116.0, -1, "silver", "suv"),
            car(150.0, -2, "red"),
            car(196.0, 0, "grey"),
            *oncoming(6, start_m=130.0, end_m=300.0, lateral_m=9.5),
            Along(-18.5, "bank", 118.0, 900.0, 0.8, seed=14),
            *row_of_trees(
                19, start_m=125, end_m=300, lateral_m=(23, 34), every_m=15, height_m=(7, 12), species=("plane",)
            ),
            *row_of_trees(
                20,
                start_m=130,
                end_m=400,
                lateral_m=(-36, -29),
                every_m=10,
                height_m=(4, 10),
                species=("oak", "bush"),
                base_m=5.0,
            ),
        ),
        **weather(-70, 45, tree_density=0.6),
        motion=Motion(100.0, offset_m=0.2, heading_rad=0.002),
        seed=88,
    )


_STILLS = {
    "straight_lines1": _straight_lines1,
    "straight_lines2": _straight_lines2,
    "test1": _test1,
    "test2": _test2,
    "test3": _test3,
    "test4": _test4,
    "test5": _test5,
    "test6": _test6,
}


def still_scenes() -> dict[str, Drive]:
    """The eight stills by file name without suffix."""
    return {name: build() for name, build in _STILLS.items()}


def project_video() -> Drive:
    """Ten seconds at 27 m/s: straight, an S-bend left (R 520 m) and right (R 400 m), tree shadows, light concrete."""
    road = RoadGeometry(
        [0.0, 75.0, 125.0, 175.0, 255.0, 330.0, 420.0, 600.0],
        [0.0, 0.0, 1 / 520, 1 / 520, -1 / 400, -1 / 400, 0.0, 0.0],
    )
    return Drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=4.0, wear=0.25),
        surface=freeway_surface(
            (Zone(-100.0, "fresh asphalt"), Zone(190.0, "concrete", 0.3), Zone(245.0, "asphalt", 0.2)),
            patches=(Patch(70.0, 78.0, -1.6, 0.1, "asphalt"),),
            seams=(Seam(0.5, 0.03, 0.12, 95.0, 130.0),),
        ),
        shades=(TreeShade(142.0, 158.0, -5.0, 8.0, 0.95), TreeShade(163.0, 172.0, -1.0, 8.0, 0.9))
        + (TreeShade(238.0, 254.0, -4.0, 9.0, 0.95),),
        things=(
            Along(4.4, "jersey", -100.0, 1500.0, seed=15),
            Along(-18.0, "bank", -100.0, 170.0, 0.9, seed=16),
            Along(-18.0, "bank", 290.0, 1500.0, 1.0, seed=17),
            car(14.0, -1, "white", speed_mps=25.3),
            car(46.0, -2, "black", "suv", speed_mps=27.5),
            car(95.0, -1, "silver", speed_mps=29.0),
            car(130.0, 0, "grey", speed_mps=28.5),
            *oncoming(7, start_m=60.0, end_m=640.0, lateral_m=9.0, speed_mps=26.0),
            *row_of_trees(
                21,
                start_m=10,
                end_m=170,
                lateral_m=(-38, -30),
                every_m=11,
                height_m=(4, 9),
                species=("oak", "bush"),
                base_m=5.5,
            ),
            *row_of_trees(
                22,
                start_m=140,
                end_m=176,
                lateral_m=(11, 14),
                every_m=8,
                height_m=(11, 15),
                species=("eucalyptus", "oak"),
            ),
            *row_of_trees(
                23,
                start_m=238,
                end_m=262,
                lateral_m=(11, 14),
                every_m=8,
                height_m=(11, 15),
                species=("eucalyptus", "plane"),
            ),
            *row_of_trees(
                24,
                start_m=180,
                end_m=300,
                lateral_m=(-34, -22),
                every_m=10,
                height_m=(8, 16),
                species=("eucalyptus", "oak"),
            ),
            *row_of_trees(
                25,
                start_m=300,
                end_m=620,
                lateral_m=(-40, -30),
                every_m=13,
                height_m=(4, 9),
                species=("oak", "bush"),
                base_m=6.0,
            ),
            Placed(120.0, -16.7, Sign(0, 0, "green", 3.2, 1.6, 2.6)),
            Placed(205.0, -16.5, Sign(0, 0, "speed", 0.9, 1.2, 2.1)),
        ),
        **weather(75, 50, tree_density=0.7),
        motion=Motion(0.0, 27.0, offset_m=0.05, wander_m=0.22, wander_period_s=6.5, pitch_rad=np.radians(0.22)),
        lens=Lens(noise=0.005),
        seed=99,
    )
