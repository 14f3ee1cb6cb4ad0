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
from lanes.scenes.render import Drive, Motion
from lanes.scenes.road import RoadGeometry
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


def _still(name: str) -> Drive:
    """One still by name; see the module docstring."""
    return _STILLS[name]()


def _straight_lines1() -> Drive:
    """Straight, solid yellow left, broken white right, fresh asphalt, open country; car left of the centre."""
    return Drive(
        camera=DASHCAM,
        road=RoadGeometry([0.0, 2000.0], [0.0, 0.0]),
        line_laterals_m=(LANE_M / 2, -LANE_M / 2),
        markings=freeway_markings(phase_m=102.2),
        surface=freeway_surface((Zone(0.0, "fresh asphalt"),)),
        sun=Sun(np.radians(70), np.radians(55)),
        motion=Motion(100.0, offset_m=0.14, heading_rad=0.003),
        backdrop=BackdropStyle(sun_azimuth_rad=np.radians(70), sun_elevation_rad=np.radians(55)),
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
        sun=Sun(np.radians(-40), np.radians(48)),
        motion=Motion(100.0, offset_m=-0.11, heading_rad=-0.002),
        backdrop=BackdropStyle(sun_azimuth_rad=np.radians(-40), sun_elevation_rad=np.radians(48)),
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
        sun=Sun(np.radians(100), np.radians(60)),
        motion=Motion(100.0, offset_m=0.22, heading_rad=0.004),
        backdrop=BackdropStyle(tree_density=0.9, sun_azimuth_rad=np.radians(100), sun_elevation_rad=np.radians(60)),
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
        sun=Sun(np.radians(35), np.radians(52)),
        motion=Motion(100.0, offset_m=0.33, heading_rad=-0.004),
        backdrop=BackdropStyle(sun_azimuth_rad=np.radians(35), sun_elevation_rad=np.radians(52)),
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
        sun=Sun(np.radians(60), np.radians(50)),
        motion=Motion(100.0, offset_m=-0.18, heading_rad=0.006),
        backdrop=BackdropStyle(
            ridge_height_rad=0.11, tree_density=0.9, sun_azimuth_rad=np.radians(60), sun_elevation_rad=np.radians(50)
        ),
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
        sun=Sun(np.radians(80), np.radians(50)),
        motion=Motion(100.0, offset_m=0.16, heading_rad=-0.003),
        backdrop=BackdropStyle(tree_density=0.9, sun_azimuth_rad=np.radians(80), sun_elevation_rad=np.radians(50)),
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
        sun=Sun(np.radians(75), np.radians(50)),
        motion=Motion(100.0, offset_m=-0.26, heading_rad=0.005),
        backdrop=BackdropStyle(tree_density=1.0, sun_azimuth_rad=np.radians(75), sun_elevation_rad=np.radians(50)),
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
        sun=Sun(np.radians(-70), np.radians(45)),
        motion=Motion(100.0, offset_m=0.2, heading_rad=0.002),
        backdrop=BackdropStyle(tree_density=0.6, sun_azimuth_rad=np.radians(-70), sun_elevation_rad=np.radians(45)),
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
        sun=Sun(np.radians(75), np.radians(50)),
        motion=Motion(0.0, 27.0, offset_m=0.05, wander_m=0.22, wander_period_s=6.5, pitch_rad=np.radians(0.22)),
        backdrop=BackdropStyle(tree_density=0.7, sun_azimuth_rad=np.radians(75), sun_elevation_rad=np.radians(50)),
        lens=Lens(noise=0.005),
        seed=99,
    )
