"""Mountain scenes of the suite, and a country road.

The mountain scenes have bends, hairpins, crests and dips.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

import numpy as np

from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import Glare, TreeShade, WoodShade
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import HeightProfile, RoadGeometry
from simulator.road.markings import YELLOW, Marking
from simulator.road.surface import Seam, Surface, Zone
from simulator.scenes.freeway import (
    DASHCAM,
    PAVED_FROM_M,
    Daylight,
    daylight,
    oncoming_car,
    plant_trees,
)
from simulator.weather import Fog

# Lane width of a mountain road, ten and a half feet.
MOUNTAIN_LANE_WIDTH_M = 3.2
# Width of a stripe, and of the gap in a double line: four inches.
STRIPE_M = 0.10
# Distance from the rear axle to the camera.
REAR_AXLE_M = 1.6
# Tint of leaves and needles on bare soil.
WOOD_FLOOR = (0.62, 0.50, 0.48)
MARKER = Post(1.0, colour=(0.62, 0.13, 0.03))


def mountain_light(azimuth_deg: float, elevation_deg: float) -> Daylight:
    """Daylight in woods below high ridges."""
    return daylight(
        azimuth_deg,
        elevation_deg,
        tree_density=0.3,
        greenness=0.8,
        ridge_height_rad=0.30,
        hill_height_rad=0.22,
    )


def winding_road(
    *turns: tuple[float, float],
    straight_m: float = 14.0,
    ease_m: float = 12.0,
) -> RoadGeometry:
    """Road of arcs with clothoids and straights between.

    A turn is (radius in metres, > 0 left; angle in degrees). The arcs are shortened by
    the angle of their clothoids, so that the total angles are as given.
    """
    stations = [0.0, straight_m]
    curvatures = [0.0, 0.0]
    for radius, degrees in turns:
        arc_m = max(np.radians(degrees) * abs(radius) - ease_m, 1.0)
        for length_m in (ease_m, arc_m, ease_m, straight_m):
            stations.append(stations[-1] + length_m)
        curvatures += [1 / radius, 1 / radius, 0.0, 0.0]
    return RoadGeometry(stations, curvatures)


def mountain_drive(
    seed: int,
    road: RoadGeometry,
    motion: Motion,
    *,
    light: Daylight | None = None,
    rock: bool = False,
    **changes: Any,
) -> Drive:
    """Two-lane road through woods: double yellow, white edges.

    There is a guard rail on the right, and optional `rock` on the left. `changes` are
    fields of Drive.
    """
    half = MOUNTAIN_LANE_WIDTH_M / 2
    light = light or mountain_light(50, 50)
    markings = (
        # The inner stripe of the double line bounds the lane, as in manual labels.
        Marking(half + STRIPE_M, STRIPE_M, YELLOW, double_gap_m=STRIPE_M, wear=0.35),
        Marking(-half, STRIPE_M, wear=0.25),
        Marking(3 * half, STRIPE_M, wear=0.3),
    )
    surface = Surface(
        (Zone(PAVED_FROM_M, "fresh asphalt"),),
        right_edge_m=-half - 0.35,
        left_edge_m=3 * half + 0.3,
        lane_centres_m=(0.0, MOUNTAIN_LANE_WIDTH_M),
        gravel_m=0.9,
        verge_tint=WOOD_FLOOR,
        seams=(Seam(half - 0.25, 0.02, wander_m=0.03, strength=0.5),),
    )
    end_m = float(road.stations_m[-1]) + 80.0
    markers = [
        PlacedObject(s, -half - 0.9, MARKER) for s in np.arange(6.0, end_m, 26.0)
    ]
    drive = Drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=(half, -half),
        markings=markings,
        surface=surface,
        sun=light.sun,
        backdrop=light.backdrop,
        objects=(
            *wood_edges(end_m, rock=rock),
            PlacedWall(-half - 1.3, "rail", start_m=28.0, end_m=75.0, seed=3),
            *markers,
        ),
        motion=replace(motion, rear_axle_m=REAR_AXLE_M),
        seed=seed,
    )
    return replace(drive, **changes)


COUNTRY_LIGHT = daylight(60, 48, tree_density=0.9)


def country_road_drive(
    seed: int, *, light: Daylight = COUNTRY_LIGHT, **changes: Any
) -> Drive:
    """Two-lane road through a wood, R 170 m left, then 140 m right.

    `changes` are fields of Drive.
    """
    middle = 1.75
    edge = -1.75
    markings = (
        # The inner stripe of the double line bounds the lane, as in manual labels.
        Marking(middle, STRIPE_M, YELLOW, double_gap_m=STRIPE_M, wear=0.2),
        Marking(edge, STRIPE_M, wear=0.2),
        Marking(middle + 3.5, STRIPE_M, wear=0.2),
    )
    surface = Surface(
        (Zone(PAVED_FROM_M, "fresh asphalt"),),
        right_edge_m=-2.3,
        left_edge_m=5.8,
        lane_centres_m=(0.0, 3.5),
        gravel_m=0.8,
    )
    drive = Drive(
        camera=DASHCAM,
        road=RoadGeometry(
            [0.0, 35.0, 75.0, 130.0, 160.0],
            [1 / 170, 1 / 170, -1 / 140, -1 / 140, 0.0],
        ),
        line_laterals_m=(middle - STRIPE_M, edge),
        markings=markings,
        surface=surface,
        sun=light.sun,
        backdrop=light.backdrop,
        objects=(
            PlacedWall(-2.9, "rail", start_m=20.0, end_m=90.0),
            *_country_trees(seed, (-16.0, -5.5)),
            *_country_trees(seed + 1, (8.5, 19.0)),
        ),
        motion=Motion(
            speed_mps=15.0,
            offset_m=-0.1,
            wander_m=0.15,
            wander_period_s=5.0,
            pitch_rad=radians(0.25),
        ),
        seed=seed,
    )
    return replace(drive, **changes)


def _country_trees(
    seed: int,
    d_m: tuple[float, float],
) -> tuple[PlacedObject, ...]:
    return plant_trees(
        seed,
        "oak redwood eucalyptus",
        s_m=(4, 240),
        d_m=d_m,
        height_m=(9, 17),
        every_m=5,
    )


def wood_edges(
    end_m: float,
    *,
    rock: bool,
) -> tuple[PlacedObject | PlacedWall, ...]:
    """Edges of woods on both sides, with trees in front; `rock`: a cutting left."""
    left = "rock" if rock else "wood"
    return (
        PlacedWall(9.5, left, start_m=-60.0, end_m=end_m, seed=7),
        PlacedWall(
            -9.0,
            "wood",
            start_m=-60.0,
            end_m=end_m,
            height_scale=0.9,
            seed=8,
        ),
        *plant_trees(
            61,
            "redwood oak bush",
            s_m=(-10, end_m),
            d_m=(-8.5, -5.5),
            height_m=(2, 9),
            every_m=11,
        ),
        # Single trees at the edge hide that it is flat.
        *plant_trees(
            63,
            "redwood oak",
            s_m=(-5, end_m),
            d_m=(-9.1, -8.5),
            height_m=(9, 14),
            every_m=14,
        ),
        *plant_trees(
            64,
            "redwood oak",
            s_m=(-5, end_m),
            d_m=(9.1, 9.5),
            height_m=(8, 14),
            every_m=16,
        ),
        *plant_trees(
            62,
            "scrub bush",
            s_m=(-10, end_m),
            d_m=(8.0, 8.9),
            height_m=(0.5, 1.6),
            every_m=12,
        ),
    )


def _with_oncoming_car(drive: Drive, s_m: float) -> Drive:
    blue = oncoming_car(s_m, MOUNTAIN_LANE_WIDTH_M, "blue", speed_mps=8.0)
    return replace(drive, objects=(*drive.objects, blue))


def _hairpin_left() -> Drive:
    drive = mountain_drive(
        151,
        winding_road((22.0, 170.0)),
        Motion(
            2.0,
            8.0,
            offset_m=-0.1,
            wander_m=0.15,
            wander_period_s=5.0,
            pitch_rad=radians(0.3),
        ),
    )
    return _with_oncoming_car(drive, 75.0)


def _hairpin_right() -> Drive:
    return mountain_drive(
        152,
        winding_road((-15.0, 160.0)),
        Motion(
            4.0,
            6.0,
            offset_m=0.15,
            wander_m=0.1,
            wander_period_s=5.0,
            pitch_rad=radians(0.3),
        ),
        light=mountain_light(-120, 50),
    )


def _switchback() -> Drive:
    starts = np.arange(14.0, 140.0, 21.0)
    return mountain_drive(
        153,
        winding_road((26.0, 110.0), (-20.0, 120.0), straight_m=6.0),
        Motion(18.0, 9.0, offset_m=0.1, wander_m=0.2, wander_period_s=4.0),
        shades=tuple(TreeShade(s, s + 9.0, -5.0, 8.0, 0.9) for s in starts),
    )


def _mountain_bends() -> Drive:
    return mountain_drive(
        154,
        winding_road((60.0, 45.0), (-45.0, 50.0), (70.0, 40.0)),
        Motion(0.0, 13.0, offset_m=-0.15, wander_m=0.15, pitch_rad=radians(0.3)),
        rock=True,
    )


def _crests() -> Drive:
    profile = HeightProfile(
        [0.0, 16.0, 52.0, 66.0, 96.0, 150.0],
        [0.08, 0.08, -0.06, -0.06, 0.05, 0.05],
    )
    road = winding_road((180.0, 25.0), (-150.0, 25.0))
    return mountain_drive(
        155,
        replace(road, profile=profile),
        Motion(0.0, 15.0, offset_m=0.2, wander_m=0.15, wander_period_s=4.0),
    )


def _dips() -> Drive:
    stations = np.arange(0.0, 260.0, 4.0)
    slopes = 0.055 * np.sin(2 * np.pi * stations / 52.0)
    road = winding_road((90.0, 60.0), (-110.0, 50.0))
    drive = mountain_drive(
        156,
        replace(road, profile=HeightProfile(stations, slopes)),
        Motion(4.0, 15.0, offset_m=-0.2, wander_m=0.1, wander_period_s=4.0),
    )
    # A higher ridge would fill the image here.
    return replace(drive, backdrop=replace(drive.backdrop, ridge_height_rad=0.12))


def harder_challenge_video() -> Drive:
    """Ten seconds at 8 to 11 m/s: hairpins left (R 21 m) and right (R 17 m) in a wood.

    A low sun shines in haze. There are deep shade with sun flecks before the first
    hairpin, glare in it, an oncoming car after it, dappled shade in the second.
    """
    drive = mountain_drive(
        172,
        winding_road((21.0, 115.0), (-17.0, 125.0), straight_m=7.0, ease_m=10.0),
        Motion(
            1.0,
            11.0,
            offset_m=-0.05,
            wander_m=0.2,
            wander_period_s=4.5,
            pitch_rad=radians(0.3),
            later_speeds=(
                (1.5, 8.5),
                (5.0, 8.5),
                (6.0, 9.5),
                (7.5, 8.0),
            ),
        ),
        light=mountain_light(45, 28),
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
    )
    double, right, left = drive.markings
    worn = (
        replace(double, wear=0.55),
        replace(right, wear=0.4),
        replace(left, wear=0.45),
    )
    return _with_oncoming_car(replace(drive, markings=worn), 96.0)


SCENES = (
    SuiteScene(
        "harder-challenge",
        "hard",
        10.0,
        "Hairpins in a wood: shade, glare, haze.",
        harder_challenge_video,
    ),
    SuiteScene(
        "mountain-bends",
        "medium",
        5.0,
        "Bends of R 45 to 70 m in woods, double yellow line.",
        _mountain_bends,
    ),
    SuiteScene(
        "hairpin-left",
        "hard",
        5.0,
        "A hairpin of R 22 m to the left with an oncoming car.",
        _hairpin_left,
    ),
    SuiteScene(
        "hairpin-right",
        "hard",
        5.0,
        "A hairpin of R 15 m to the right.",
        _hairpin_right,
    ),
    SuiteScene(
        "switchback",
        "hard",
        5.0,
        "A left and a right hairpin in dappled shade.",
        _switchback,
    ),
    SuiteScene(
        "crests",
        "hard",
        5.0,
        "Over a steep crest and through a dip.",
        _crests,
    ),
    SuiteScene(
        "dips",
        "hard",
        5.0,
        "Short waves of the road in bends of R 90 m.",
        _dips,
    ),
)
