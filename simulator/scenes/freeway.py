"""Building blocks of the scenes.

The camera, markings and surface of a freeway, trees, traffic, road and daylight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians
from typing import Any

import numpy as np

from lanes.camera.model import Camera, CameraPose
from simulator.backdrop import BackdropStyle
from simulator.light.sunlight import Sun
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Tree
from simulator.objects.vehicles import Car
from simulator.objects.walls import WALLS
from simulator.rendering.drive import Drive
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import YELLOW, Marking
from simulator.road.surface import Patch, Seam, Surface, Zone

# Camera of all committed images, the ground truth for calibration.
# A typical dashcam: 63 degrees wide, barrel distortion, principal point off the centre,
# and small yaw and roll. The distortion polynomial is monotonic over the whole image
# (Camera.largest_ray is beyond the corners), so that pixels and rays correspond one to
# one. Pitch and yaw put the vanishing point near column 640, row 422, for which the
# warps of the classic recipes were made.
DASHCAM = Camera(
    width=1280,
    height=720,
    matrix=np.array(
        [
            [1157.8, 0.0, 667.4],
            [0.0, 1153.2, 386.1],
            [0.0, 0.0, 1.0],
        ]
    ),
    distortion=np.array([-0.2442, -0.0208, -0.0011, 0.0003, -0.0121]),
    pose=CameraPose(
        height_m=1.32,
        pitch_rad=np.radians(-1.80),
        yaw_rad=np.radians(-1.36),
        roll_rad=np.radians(0.4),
    ),
)


# Twelve feet, the lane of a US freeway.
LANE_WIDTH_M = 3.66
# Lateral positions of the lines of the ego lane, whose centre is the reference line.
EGO_LINES_M = (LANE_WIDTH_M / 2, -LANE_WIDTH_M / 2)
# Width of the leftmost line; all others have that of Marking.
YELLOW_WIDTH_M = 0.15
# Neighbouring lines are painted in one pass, so their dashes are nearly aligned.
DASH_SHIFT_M = 0.35
OPPOSITE_DASH_SHIFT_M = 3
# Opposite carriageway: a narrow shoulder, three lanes and a wide shoulder.
OPPOSITE_LANES = 3
OPPOSITE_SHOULDER_M = 1.6
OPPOSITE_WIDTH_M = OPPOSITE_SHOULDER_M + OPPOSITE_LANES * LANE_WIDTH_M + 2.8
# All pavement begins here.
PAVED_FROM_M = -100.0


@dataclass(frozen=True)
class Freeway:
    """Carriageway of a freeway; the centre of the ego lane is the reference line.

    It is paved with the material `pavement`, and from the starts of `zones` on with
    others. `lanes_left` and `lanes_right` count the lanes next to the ego lane. The
    leftmost line is solid yellow, the rightmost solid white, the others broken white
    with a paving joint next to each; `phase_m` is the start of a dash of the leftmost
    of them, `wear` is that of Marking. `opposite_m` is the right edge of the opposite
    carriageway, if there is one. `patches` and `seams` are additional flaws of the
    pavement.
    """

    pavement: str = "asphalt"
    zones: tuple[Zone, ...] = ()
    lanes_left: int = 0
    lanes_right: int = 3
    phase_m: float = 0.0
    wear: float = 0.15
    opposite_m: float | None = None
    left_shoulder_m: float = 2.4
    right_shoulder_m: float = 2.8
    patches: tuple[Patch, ...] = ()
    seams: tuple[Seam, ...] = ()

    @property
    def left_line_m(self) -> float:
        """Lateral position of the leftmost line."""
        return (self.lanes_left + 0.5) * LANE_WIDTH_M

    @property
    def right_line_m(self) -> float:
        """Lateral position of the rightmost line."""
        return -(self.lanes_right + 0.5) * LANE_WIDTH_M

    def markings(self) -> tuple[Marking, ...]:
        """Lines from left to right, then those of the opposite carriageway."""
        white = Marking(0.0, wear=self.wear)
        broken = replace(white, dashed=True, dots=True)
        yellow = replace(white, width_m=YELLOW_WIDTH_M, colour=YELLOW, dots=True)

        marks = [replace(yellow, lateral_m=self.left_line_m)]
        for n in range(self.lanes_left + self.lanes_right):
            lateral_m = (self.lanes_left - 0.5 - n) * LANE_WIDTH_M
            phase_m = self.phase_m + DASH_SHIFT_M * n
            marks.append(replace(broken, lateral_m=lateral_m, phase_m=phase_m))
        marks.append(replace(white, lateral_m=self.right_line_m))

        if self.opposite_m is not None:
            marks += self._opposite_markings(self.opposite_m + OPPOSITE_SHOULDER_M)
        return tuple(marks)

    def _opposite_markings(self, first_m: float) -> list[Marking]:
        """Lines of the opposite carriageway, solid ones before broken ones."""
        last_m = first_m + OPPOSITE_LANES * LANE_WIDTH_M
        marks = [Marking(first_m, colour=YELLOW), Marking(last_m)]
        for n in range(1, OPPOSITE_LANES):
            lateral_m = first_m + n * LANE_WIDTH_M
            phase_m = self.phase_m + OPPOSITE_DASH_SHIFT_M * n
            marks.append(Marking(lateral_m, dashed=True, phase_m=phase_m))
        return marks

    def surface(self) -> Surface:
        """Pavement and verges."""
        numbers = range(self.lanes_left, -self.lanes_right - 1, -1)
        centres = tuple(n * LANE_WIDTH_M for n in numbers)
        joints = []
        for centre in centres[:-1]:
            joint_m = centre - LANE_WIDTH_M / 2 - 0.18
            joints.append(Seam(joint_m, width_m=0.025, strength=0.5))
        opposite = None
        if self.opposite_m is not None:
            opposite = (self.opposite_m, self.opposite_m + OPPOSITE_WIDTH_M)
        return Surface(
            zones=(Zone(PAVED_FROM_M, self.pavement), *self.zones),
            right_edge_m=self.right_line_m - self.right_shoulder_m,
            left_edge_m=self.left_line_m + self.left_shoulder_m,
            lane_centres_m=centres,
            opposite_m=opposite,
            patches=self.patches,
            seams=(*joints, *self.seams),
        )


@dataclass(frozen=True)
class Daylight:
    """The sun, and sky and landscape."""

    sun: Sun
    backdrop: BackdropStyle


def daylight(
    azimuth_deg: float,
    elevation_deg: float,
    *,
    overcast: bool = False,
    **landscape: float,
) -> Daylight:
    """Daylight of a sun at a place; `landscape` holds fields of BackdropStyle."""
    sun = Sun(radians(azimuth_deg), radians(elevation_deg), overcast)
    backdrop = BackdropStyle(
        sun_azimuth_rad=sun.azimuth_rad,
        sun_elevation_rad=sun.elevation_rad,
        **landscape,
    )
    return Daylight(sun, backdrop)


def freeway_drive(
    freeway: Freeway, road: RoadGeometry, light: Daylight, **changes: Any
) -> Drive:
    """Drive on a freeway, seen by the course's camera, in the lane of EGO_LINES_M.

    `changes` are fields of Drive.
    """
    drive = Drive(
        camera=DASHCAM,
        road=road,
        line_laterals_m=EGO_LINES_M,
        markings=freeway.markings(),
        surface=freeway.surface(),
        sun=light.sun,
        backdrop=light.backdrop,
    )
    return replace(drive, **changes)


def bend_road(curvature_per_m: float) -> RoadGeometry:
    """Road with constant curvature where the car of a still is, and a straight end.

    The car is at arc length 100.
    """
    ease_m = max(abs(curvature_per_m) / 1.5e-5, 30.0)
    return RoadGeometry(
        [0.0, 40.0, 400.0, 400 + ease_m],
        [curvature_per_m * 0.4, curvature_per_m, curvature_per_m, 0.0],
    )


def plant_trees(
    seed: int,
    species: str,
    *,
    s_m: tuple[float, float],
    d_m: tuple[float, float],
    height_m: tuple[float, float],
    every_m: float,
    bank: PlacedWall | None = None,
) -> tuple[PlacedObject, ...]:
    """Trees or bushes at random positions next to the road, on a bank if one is given.

    There is one about every `every_m` metres. `species` are names in standing.SPECIES,
    separated by blanks, chosen at random. `s_m`, `d_m` and `height_m` are ranges of arc
    length, lateral position and height of the trees.
    """
    rng = np.random.default_rng(seed)
    outward, bank_height = np.array(WALLS["bank"].lines).T
    trees = []
    for s in np.arange(*s_m, every_m):
        lateral = float(rng.uniform(*d_m))
        base = 0.0
        if bank is not None:
            up_bank = abs(lateral - bank.lateral_m)
            height = float(np.interp(up_bank, outward, bank_height))
            base = height * bank.height_scale
        tree = Tree(
            height_m=rng.uniform(*height_m),
            species=str(rng.choice(species.split())),
            seed=int(rng.integers(6)),
            base_m=base,
        )
        place = float(s + rng.uniform(-0.4, 0.4) * every_m)
        trees.append(PlacedObject(place, lateral, tree))
    return tuple(trees)


def oncoming_cars(
    seed: int,
    *,
    s_m: tuple[float, float],
    opposite_m: float,
    speed_mps: float = 0.0,
) -> tuple[PlacedObject, ...]:
    """Oncoming cars on the opposite carriageway.

    Its right edge is at lateral `opposite_m`.
    """
    rng = np.random.default_rng(seed)
    cars = []
    for s in np.arange(*s_m, 45.0):
        paint = str(rng.choice(["white", "silver", "grey", "blue", "black"]))
        body = str(rng.choice(["sedan", "suv"]))
        lane = 0.5 + float(rng.integers(OPPOSITE_LANES))
        lateral = opposite_m + OPPOSITE_SHOULDER_M + LANE_WIDTH_M * lane
        place = float(s + rng.uniform(-15, 15))
        cars.append(oncoming_car(place, lateral, paint, body, speed_mps=speed_mps))
    return tuple(cars)


def oncoming_car(
    s_m: float,
    lateral_m: float,
    paint: str,
    body: str = "sedan",
    *,
    speed_mps: float,
) -> PlacedObject:
    """Car that comes towards the camera."""
    return PlacedObject(s_m, lateral_m, Car(paint, body, heading_rad=pi), -speed_mps)


def car(
    s_m: float,
    lane: int,
    paint: str,
    body: str = "sedan",
    *,
    speed_mps: float = 0.0,
) -> PlacedObject:
    """Car in the centre of a lane; `lane` is 0 for the ego lane, > 0 to the left."""
    return PlacedObject(s_m, lane * LANE_WIDTH_M, Car(paint, body), speed_mps)
