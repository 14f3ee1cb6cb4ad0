"""Mountain scenes of the suite: hairpins and bends, crests and dips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simulator.light.sunlight import TreeShade
from simulator.objects.roadside import Along, Placed
from simulator.objects.solids import Car, Post
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry
from simulator.road.painted_lines import WHITE, YELLOW, Marking
from simulator.road.profile import HeightProfile
from simulator.road.surface import Seam, Surface, Zone
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import grove, weather
from simulator.scenes.scene import SuiteScene

# Ten and a half feet, the lane of a mountain road.
LANE_M = 3.2
# Four inches: a stripe, and the gap between the two of a double line.
STRIPE_M = 0.10
# The camera is about as far before the rear axle.
REAR_AXLE_M = 1.6
# Leaves and needles on bare soil.
WOOD_FLOOR = (0.62, 0.50, 0.48)
MARKER_ORANGE = (0.62, 0.13, 0.03)


def bends(*turns: tuple[float, float], straight_m: float = 14.0, ease_m: float = 12.0) -> RoadGeometry:
    """A road of arcs (radius in metres, > 0 left; degrees turned) with straights and clothoids between.

    A clothoid turns by half of what an arc of its length would, so that radius and angle come out as asked for.
    """
    stations, curvatures = [0.0, straight_m], [0.0, 0.0]
    for radius, degrees in turns:
        arc_m = max(np.radians(degrees) * abs(radius) - ease_m, 1.0)
        for length, curvature in ((ease_m, 1 / radius), (arc_m, 1 / radius), (ease_m, 0.0), (straight_m, 0.0)):
            stations.append(stations[-1] + length)
            curvatures.append(curvature)
    return RoadGeometry(stations, curvatures)


def mountain(road: RoadGeometry, motion: Motion, *, rock: bool = False, **parts) -> Drive:
    """A two-lane road through woods: double yellow, white edges, a guard rail on the right, `rock` on the left or not.

    `parts` are fields of Drive that are to differ.
    """
    half, end = LANE_M / 2, float(road.stations_m[-1]) + 80.0
    drive = Drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=(half, -half),
        markings=(
            # what bounds the lane is the stripe beside it, as in labels by hand
            Marking(half + STRIPE_M, STRIPE_M, YELLOW, double_gap_m=STRIPE_M, wear=0.35),
            Marking(-half, STRIPE_M, WHITE, wear=0.25),
            Marking(3 * half, STRIPE_M, WHITE, wear=0.3),
        ),
        surface=Surface(
            (Zone(-100.0, "fresh asphalt"),),
            right_edge_m=-half - 0.35,
            left_edge_m=3 * half + 0.3,
            lane_centres_m=(0.0, LANE_M),
            gravel_m=0.9,
            verge_tint=WOOD_FLOOR,
            seams=(Seam(half - 0.25, 0.02, 0.03, strength=0.5),),
        ),
        things=(
            *woods(end, rock=rock),
            Along(-half - 1.3, "rail", start_m=28.0, end_m=75.0, seed=3),
            *(Placed(s, -half - 0.9, Post(0, 0, 1.0, 0.1, colour=MARKER_ORANGE)) for s in np.arange(6.0, end, 26.0)),
        ),
        motion=replace(motion, rear_axle_m=REAR_AXLE_M),
        seed=151,
        **weather(50, 50, tree_density=0.3, greenness=0.8, ridge_height_rad=0.30, hill_height_rad=0.22),
    )
    return replace(drive, **parts)


def woods(end_m: float, *, right_m: float = 7.5, left_m: float = 9.5, rock: bool = False) -> tuple[Placed | Along, ...]:
    """Woods on both sides from the lateral places on, with trees before their edge; `rock`: a cutting on the left."""
    return (
        Along(left_m, "rock" if rock else "wood", -60.0, end_m, seed=7),
        Along(-right_m - 1.5, "wood", -60.0, end_m, height_scale=0.9, seed=8),
        *grove(61, "redwood oak bush", along=(-10, end_m), aside=(-right_m - 1, -right_m + 2), tall=(2, 9), every_m=11),
        # Single crowns on the edge itself hide that it is a sheet.
        *grove(63, "redwood oak", along=(-5, end_m), aside=(-right_m - 1.6, -right_m - 1), tall=(9, 14), every_m=14),
        *grove(64, "redwood oak", along=(-5, end_m), aside=(left_m - 0.4, left_m), tall=(8, 14), every_m=16),
        *grove(62, "scrub bush", along=(-10, end_m), aside=(left_m - 1.5, left_m - 0.6), tall=(0.5, 1.6), every_m=12),
    )  # fmt: skip


def _hairpin_left() -> Drive:
    """One hairpin to the left, R 22 m, at 8 m/s."""
    return mountain(
        bends((22.0, 170.0)),
        Motion(2.0, 8.0, offset_m=-0.1, wander_m=0.15, wander_period_s=5.0, pitch_rad=float(np.radians(0.3))),
        things=(*mountain(bends((22.0, 170.0)), Motion()).things, Placed(75.0, LANE_M, Car(0, 0, np.pi, "blue"), -8.0)),
    )


def _hairpin_right() -> Drive:
    """One hairpin to the right, R 15 m, at 6 m/s: the inner line bends round the bonnet."""
    return mountain(
        bends((-15.0, 160.0)),
        Motion(4.0, 6.0, offset_m=0.15, wander_m=0.1, wander_period_s=5.0, pitch_rad=float(np.radians(0.3))),
        seed=152,
        **weather(-120, 50, tree_density=0.3, greenness=0.8, ridge_height_rad=0.30, hill_height_rad=0.22),
    )


def _switchback() -> Drive:
    """Left R 26 m and right R 20 m one after the other, in broken shade."""
    road = bends((26.0, 110.0), (-20.0, 120.0), straight_m=6.0)
    shades = tuple(TreeShade(s, s + 9.0, -5.0, 8.0, 0.9) for s in np.arange(14.0, 140.0, 21.0))
    return mountain(road, Motion(18.0, 9.0, offset_m=0.1, wander_m=0.2, wander_period_s=4.0), shades=shades, seed=153)


def _mountain_bends() -> Drive:
    """Bends of R 45 to 70 m at 13 m/s."""
    return mountain(
        bends((60.0, 45.0), (-45.0, 50.0), (70.0, 40.0)),
        Motion(0.0, 13.0, offset_m=-0.15, wander_m=0.15, pitch_rad=float(np.radians(0.3))),
        rock=True,
        seed=154,
    )


def _crests() -> Drive:
    """Up over a crest (vertical radius 260 m), down through a dip, in gentle bends."""
    profile = HeightProfile([0.0, 16.0, 52.0, 66.0, 96.0, 150.0], [0.08, 0.08, -0.06, -0.06, 0.05, 0.05])
    road = replace(bends((180.0, 25.0), (-150.0, 25.0)), profile=profile)
    return mountain(road, Motion(0.0, 15.0, offset_m=0.2, wander_m=0.15, wander_period_s=4.0), seed=155)


def _dips() -> Drive:
    """A straight and a bend of R 90 m in short waves, 0.9 m high: the ground rises before the bonnet and falls away."""
    stations = np.arange(0.0, 260.0, 4.0)
    profile = HeightProfile(stations, 0.055 * np.sin(2 * np.pi * stations / 52.0))
    road = replace(bends((90.0, 60.0), (-110.0, 50.0)), profile=profile)
    drive = mountain(road, Motion(4.0, 15.0, offset_m=-0.2, wander_m=0.1, wander_period_s=4.0), seed=156)
    # the usual height would stand up like a wall in this country
    return replace(drive, backdrop=replace(drive.backdrop, ridge_height_rad=0.12))


SCENES = (
    SuiteScene("mountain-bends", "medium", 5.0, "Woods, double yellow, bends of R 45 to 70 m.", _mountain_bends),
    SuiteScene("hairpin-left", "hard", 5.0, "A hairpin of R 22 m to the left with a car in it.", _hairpin_left),
    SuiteScene("hairpin-right", "hard", 5.0, "A hairpin of R 15 m to the right.", _hairpin_right),
    SuiteScene("switchback", "hard", 5.0, "A left and a right hairpin in broken shade.", _switchback),
    SuiteScene("crests", "hard", 5.0, "Over a steep crest and through a dip.", _crests),
    SuiteScene("dips", "hard", 5.0, "Short waves of the road in a bend of R 90 m.", _dips),
)  # fmt: skip
