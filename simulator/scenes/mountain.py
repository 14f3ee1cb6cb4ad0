"""Mountain scenes of the suite (bends, hairpins, crests and dips), and a country road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simulator.light.lens import AutoExposure, Lens
from simulator.light.sunlight import Glare, TreeShade, WoodShade
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.road.geometry import HeightProfile, RoadGeometry
from simulator.road.markings import WHITE, YELLOW, Marking
from simulator.road.surface import Seam, Surface, Zone
from simulator.scenes.freeway import DASHCAM, daylight, plant_trees
from simulator.weather import Fog

# Lane width of a mountain road, ten and a half feet.
MOUNTAIN_LANE_WIDTH_M = 3.2
# Width of a stripe, and of the gap in a double line: four inches.
STRIPE_M = 0.10
# Distance from the rear axle to the camera.
REAR_AXLE_M = 1.6
# Tint of leaves and needles on bare soil.
WOOD_FLOOR = (0.62, 0.50, 0.48)
MARKER_ORANGE = (0.62, 0.13, 0.03)


def winding_road(
    *turns: tuple[float, float], straight_m: float = 14.0, ease_m: float = 12.0
) -> RoadGeometry:
    """Road of arcs (radius in metres, > 0 left; angle in degrees) with clothoids and straights between.

    The arcs are shortened by the angle of their clothoids, so that the total angles are as given.
    """
    stations, curvatures = [0.0, straight_m], [0.0, 0.0]
    for radius, degrees in turns:
        arc_m = max(np.radians(degrees) * abs(radius) - ease_m, 1.0)
        for length, curvature in (
            (ease_m, 1 / radius),
            (arc_m, 1 / radius),
            (ease_m, 0.0),
            (straight_m, 0.0),
        ):
            stations.append(stations[-1] + length)
            curvatures.append(curvature)
    return RoadGeometry(stations, curvatures)


def mountain_drive(
    road: RoadGeometry, motion: Motion, *, rock: bool = False, **changes
) -> Drive:
    """Two-lane road through woods: double yellow, white edges, a guard rail on the right, optional `rock` on the left.

    `changes` are fields of Drive.
    """
    half, end = MOUNTAIN_LANE_WIDTH_M / 2, float(road.stations_m[-1]) + 80.0
    drive = Drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=(half, -half),
        markings=(
            # The inner stripe of the double line bounds the lane, as in manual labels.
            Marking(
                half + STRIPE_M, STRIPE_M, YELLOW, double_gap_m=STRIPE_M, wear=0.35
            ),
            Marking(-half, STRIPE_M, WHITE, wear=0.25),
            Marking(3 * half, STRIPE_M, WHITE, wear=0.3),
        ),
        surface=Surface(
            (Zone(-100.0, "fresh asphalt"),),
            right_edge_m=-half - 0.35,
            left_edge_m=3 * half + 0.3,
            lane_centres_m=(0.0, MOUNTAIN_LANE_WIDTH_M),
            gravel_m=0.9,
            verge_tint=WOOD_FLOOR,
            seams=(Seam(half - 0.25, 0.02, 0.03, strength=0.5),),
        ),
        objects=(
            *wood_edges(end, rock=rock),
            PlacedWall(-half - 1.3, "rail", start_m=28.0, end_m=75.0, seed=3),
            *(
                PlacedObject(s, -half - 0.9, Post(1.0, 0.1, colour=MARKER_ORANGE))
                for s in np.arange(6.0, end, 26.0)
            ),
        ),
        motion=replace(motion, rear_axle_m=REAR_AXLE_M),
        seed=151,
        **daylight(
            50,
            50,
            tree_density=0.3,
            greenness=0.8,
            ridge_height_rad=0.30,
            hill_height_rad=0.22,
        ),
    )
    return replace(drive, **changes)


def country_road_drive(seed: int, **changes) -> Drive:
    """Two-lane road through a wood, R 170 m left, then 140 m right; `changes` are fields of Drive."""
    middle, edge = 1.75, -1.75
    trees = tuple(
        item
        for number, d_m in enumerate(((-16.0, -5.5), (8.5, 19.0)))
        for item in plant_trees(
            seed + number,
            "oak redwood eucalyptus",
            s_m=(4, 240),
            d_m=d_m,
            height_m=(9, 17),
            every_m=5,
        )
    )
    return Drive(
        camera=DASHCAM,
        road=RoadGeometry(
            [0.0, 35.0, 75.0, 130.0, 160.0], [1 / 170, 1 / 170, -1 / 140, -1 / 140, 0.0]
        ),
        # The inner stripe of the double line bounds the lane, as in manual labels.
        line_laterals_m=(middle - 0.10, edge),
        markings=(
            Marking(middle, 0.10, YELLOW, double_gap_m=0.10, wear=0.2),
            Marking(edge, 0.10, WHITE, wear=0.2),
            Marking(middle + 3.5, 0.10, WHITE, wear=0.2),
        ),
        surface=Surface(
            (Zone(-100.0, "fresh asphalt"),), -2.3, 5.8, (0.0, 3.5), gravel_m=0.8
        ),
        motion=Motion(
            0.0,
            15.0,
            offset_m=-0.1,
            wander_m=0.15,
            wander_period_s=5.0,
            pitch_rad=float(np.radians(0.25)),
        ),
        seed=seed,
        **(
            {"objects": (PlacedWall(-2.9, "rail", 20.0, 90.0), *trees)}
            | daylight(60, 48, tree_density=0.9)
            | changes
        ),
    )


def wood_edges(
    end_m: float, *, rock: bool = False
) -> tuple[PlacedObject | PlacedWall, ...]:
    """Edges of woods on both sides, with trees in front; `rock`: a cutting on the left."""
    return (
        PlacedWall(9.5, "rock" if rock else "wood", -60.0, end_m, seed=7),
        PlacedWall(-9.0, "wood", -60.0, end_m, height_scale=0.9, seed=8),
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


def _hairpin_left() -> Drive:
    return mountain_drive(
        winding_road((22.0, 170.0)),
        Motion(
            2.0,
            8.0,
            offset_m=-0.1,
            wander_m=0.15,
            wander_period_s=5.0,
            pitch_rad=float(np.radians(0.3)),
        ),
        objects=(
            *mountain_drive(winding_road((22.0, 170.0)), Motion()).objects,
            PlacedObject(
                75.0, MOUNTAIN_LANE_WIDTH_M, Car("blue", heading_rad=np.pi), -8.0
            ),
        ),
    )


def _hairpin_right() -> Drive:
    return mountain_drive(
        winding_road((-15.0, 160.0)),
        Motion(
            4.0,
            6.0,
            offset_m=0.15,
            wander_m=0.1,
            wander_period_s=5.0,
            pitch_rad=float(np.radians(0.3)),
        ),
        seed=152,
        **daylight(
            -120,
            50,
            tree_density=0.3,
            greenness=0.8,
            ridge_height_rad=0.30,
            hill_height_rad=0.22,
        ),
    )


def _switchback() -> Drive:
    road = winding_road((26.0, 110.0), (-20.0, 120.0), straight_m=6.0)
    shades = tuple(
        TreeShade(s, s + 9.0, -5.0, 8.0, 0.9) for s in np.arange(14.0, 140.0, 21.0)
    )
    motion = Motion(18.0, 9.0, offset_m=0.1, wander_m=0.2, wander_period_s=4.0)
    return mountain_drive(road, motion, shades=shades, seed=153)


def _mountain_bends() -> Drive:
    return mountain_drive(
        winding_road((60.0, 45.0), (-45.0, 50.0), (70.0, 40.0)),
        Motion(
            0.0, 13.0, offset_m=-0.15, wander_m=0.15, pitch_rad=float(np.radians(0.3))
        ),
        rock=True,
        seed=154,
    )


def _crests() -> Drive:
    profile = HeightProfile(
        [0.0, 16.0, 52.0, 66.0, 96.0, 150.0], [0.08, 0.08, -0.06, -0.06, 0.05, 0.05]
    )
    road = replace(winding_road((180.0, 25.0), (-150.0, 25.0)), profile=profile)
    return mountain_drive(
        road,
        Motion(0.0, 15.0, offset_m=0.2, wander_m=0.15, wander_period_s=4.0),
        seed=155,
    )


def _dips() -> Drive:
    stations = np.arange(0.0, 260.0, 4.0)
    profile = HeightProfile(stations, 0.055 * np.sin(2 * np.pi * stations / 52.0))
    road = replace(winding_road((90.0, 60.0), (-110.0, 50.0)), profile=profile)
    drive = mountain_drive(
        road,
        Motion(4.0, 15.0, offset_m=-0.2, wander_m=0.1, wander_period_s=4.0),
        seed=156,
    )
    # A higher ridge would fill the image here.
    return replace(drive, backdrop=replace(drive.backdrop, ridge_height_rad=0.12))


def harder_challenge_video() -> Drive:
    """Ten seconds at 8 to 11 m/s: hairpins left (R 21 m) and right (R 17 m) in a wood, with a low sun in haze.

    Deep shade with sun flecks before the first one, glare in it, an oncoming car after it, dappled shade in the second.
    """
    road = winding_road((21.0, 115.0), (-17.0, 125.0), straight_m=7.0, ease_m=10.0)
    base = mountain_drive(road, Motion())
    return mountain_drive(
        road,
        Motion(
            1.0,
            11.0,
            offset_m=-0.05,
            wander_m=0.2,
            wander_period_s=4.5,
            pitch_rad=float(np.radians(0.3)),
            later_speeds=((1.5, 8.5), (5.0, 8.5), (6.0, 9.5), (7.5, 8.0)),
        ),
        markings=tuple(
            replace(m, wear=wear)
            for m, wear in zip(base.markings, (0.55, 0.4, 0.45), strict=True)
        ),
        objects=(
            *base.objects,
            PlacedObject(
                96.0, MOUNTAIN_LANE_WIDTH_M, Car("blue", heading_rad=np.pi), -8.0
            ),
        ),
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
        seed=172,
        **daylight(
            45,
            28,
            tree_density=0.3,
            greenness=0.8,
            ridge_height_rad=0.30,
            hill_height_rad=0.22,
        ),
    )


SCENES = (
    SuiteScene("harder-challenge", "hard", 10.0, "Hairpins in a wood: shade, glare, haze.", harder_challenge_video),
    SuiteScene("mountain-bends", "medium", 5.0, "Bends of R 45 to 70 m in woods, double yellow line.", _mountain_bends),
    SuiteScene("hairpin-left", "hard", 5.0, "A hairpin of R 22 m to the left with an oncoming car.", _hairpin_left),
    SuiteScene("hairpin-right", "hard", 5.0, "A hairpin of R 15 m to the right.", _hairpin_right),
    SuiteScene("switchback", "hard", 5.0, "A left and a right hairpin in dappled shade.", _switchback),
    SuiteScene("crests", "hard", 5.0, "Over a steep crest and through a dip.", _crests),
    SuiteScene("dips", "hard", 5.0, "Short waves of the road in bends of R 90 m.", _dips),
)  # fmt: skip
