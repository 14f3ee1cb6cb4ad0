"""Building blocks of the scenes: the camera, markings and surface of a freeway, trees, traffic, road and daylight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lanes.camera import Camera, CameraPose
from simulator.backdrop import BackdropStyle
from simulator.light.sunlight import Sun
from simulator.objects.scene_objects import PlacedObject, PlacedWall
from simulator.objects.standing import Tree
from simulator.objects.vehicles import Car
from simulator.objects.walls import WALLS
from simulator.rendering.drive import Drive
from simulator.road.geometry import RoadGeometry
from simulator.road.markings import WHITE, YELLOW, Marking
from simulator.road.surface import Patch, Seam, Surface, Zone

# Camera of all committed images, the ground truth for calibration.
# A typical dashcam: 63 degrees wide, barrel distortion, principal point off the centre, and small yaw and roll. The
# distortion polynomial is monotonic over the whole image (Camera.largest_ray is beyond the corners), so that pixels
# and rays correspond one to one. Pitch and yaw put the vanishing point near column 640, row 422, for which the warps of
# the classic recipes were made.
DASHCAM = Camera(
    width=1280,
    height=720,
    matrix=np.array([[1157.8, 0.0, 667.4], [0.0, 1153.2, 386.1], [0.0, 0.0, 1.0]]),
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
# Opposite carriageway: a narrow shoulder, three lanes and a wide shoulder.
OPPOSITE_SHOULDER_M = 1.6
OPPOSITE_WIDTH_M = OPPOSITE_SHOULDER_M + 3 * LANE_WIDTH_M + 2.8


@dataclass(frozen=True)
class Freeway:
    """Carriageway of a freeway; the centre of the ego lane is the reference line.

    It is paved with the material `pavement`, and from the starts of `zones` on with others. `lanes_left` and
    `lanes_right` count the lanes next to the ego lane. The leftmost line is solid yellow, the rightmost solid white,
    the others broken white with a paving joint next to each; `phase_m` is the start of a dash of the leftmost of them,
    `wear` is that of Marking. `opposite_m` is the right edge of the opposite carriageway, if there is one. `patches`
    and `seams` are additional flaws of the pavement.
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

    def markings(self) -> tuple[Marking, ...]:
        """Lines from left to right, then those of the opposite carriageway."""
        phase_m, wear = self.phase_m, self.wear
        marks = [
            Marking(
                (self.lanes_left + 0.5) * LANE_WIDTH_M,
                0.15,
                YELLOW,
                wear=wear,
                dots=True,
            )
        ]
        for n in range(self.lanes_left + self.lanes_right):
            lateral = (self.lanes_left - 0.5 - n) * LANE_WIDTH_M
            # Neighbouring lines are painted in one pass, so their dashes are nearly aligned.
            marks.append(
                Marking(
                    lateral,
                    0.12,
                    WHITE,
                    dashed=True,
                    phase_m=phase_m + 0.35 * n,
                    wear=wear,
                    dots=True,
                )
            )
        marks.append(
            Marking(-(self.lanes_right + 0.5) * LANE_WIDTH_M, 0.12, WHITE, wear=wear)
        )
        if self.opposite_m is not None:
            opposite = [
                self.opposite_m + OPPOSITE_SHOULDER_M + n * LANE_WIDTH_M
                for n in range(4)
            ]
            marks += [
                Marking(opposite[0], 0.12, YELLOW),
                Marking(opposite[3], 0.12, WHITE),
            ]
            marks += [
                Marking(opposite[n], 0.12, WHITE, dashed=True, phase_m=phase_m + 3 * n)
                for n in (1, 2)
            ]
        return tuple(marks)

    def surface(self) -> Surface:
        """Pavement and verges."""
        centres = tuple(
            n * LANE_WIDTH_M for n in range(self.lanes_left, -self.lanes_right - 1, -1)
        )
        joints = tuple(
            Seam(c - LANE_WIDTH_M / 2 - 0.18, 0.025, 0.02, strength=0.5)
            for c in centres[:-1]
        )
        return Surface(
            (Zone(-100.0, self.pavement), *self.zones),
            right_edge_m=-(self.lanes_right + 0.5) * LANE_WIDTH_M
            - self.right_shoulder_m,
            left_edge_m=(self.lanes_left + 0.5) * LANE_WIDTH_M + self.left_shoulder_m,
            lane_centres_m=centres,
            opposite_m=None
            if self.opposite_m is None
            else (self.opposite_m, self.opposite_m + OPPOSITE_WIDTH_M),
            patches=self.patches,
            seams=joints + self.seams,
        )


def freeway_drive(freeway: Freeway, **fields: Any) -> Drive:
    """Drive on a freeway, seen by the course's camera, in the lane between EGO_LINES_M; `fields` are those of Drive."""
    paint, pavement = freeway.markings(), freeway.surface()
    usual: dict[str, Any] = {
        "camera": DASHCAM,
        "line_laterals_m": EGO_LINES_M,
        "markings": paint,
        "surface": pavement,
    }
    return Drive(**usual | fields)


def bend_road(curvature_per_m: float) -> RoadGeometry:
    """Road with constant curvature around arc length 100, where the car of a still is, and a straight end."""
    ease = max(abs(curvature_per_m) / 1.5e-5, 30.0)
    return RoadGeometry(
        [0.0, 40.0, 400.0, 400 + ease],
        [curvature_per_m * 0.4, curvature_per_m, curvature_per_m, 0.0],
    )


def daylight(azimuth_deg: float, elevation_deg: float, **landscape: float) -> dict:
    """Fields `sun` and `backdrop` of a Drive; `landscape` holds fields of BackdropStyle."""
    sun = Sun(float(np.radians(azimuth_deg)), float(np.radians(elevation_deg)))
    style = BackdropStyle(
        sun_azimuth_rad=sun.azimuth_rad,
        sun_elevation_rad=sun.elevation_rad,
        **landscape,
    )
    return {"sun": sun, "backdrop": style}


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
    """Trees or bushes at random positions next to the road, about every `every_m` metres, on a bank where one is given.

    `species` are names in trees.SPECIES, separated by blanks, chosen at random. `s_m`, `d_m` and `height_m` are
    ranges of arc length, lateral position and height of the trees.
    """
    rng = np.random.default_rng(seed)
    outward, height = np.array(WALLS["bank"].lines).T
    trees = []
    for s in np.arange(*s_m, every_m):
        lateral = float(rng.uniform(*d_m))
        base = 0.0
        if bank is not None:
            base = (
                float(np.interp(abs(lateral - bank.lateral_m), outward, height))
                * bank.height_scale
            )
        tree = Tree(
            rng.uniform(*height_m),
            str(rng.choice(species.split())),
            int(rng.integers(6)),
            base,
        )
        trees.append(
            PlacedObject(float(s + rng.uniform(-0.4, 0.4) * every_m), lateral, tree)
        )
    return tuple(trees)


def oncoming_cars(
    seed: int, *, s_m: tuple[float, float], opposite_m: float, speed_mps: float = 0.0
) -> tuple[PlacedObject, ...]:
    """Oncoming cars on the opposite carriageway, whose right edge is at lateral `opposite_m`."""
    rng = np.random.default_rng(seed)
    cars = []
    for s in np.arange(*s_m, 45.0):
        paint, body = (
            str(rng.choice(["white", "silver", "grey", "blue", "black"])),
            str(rng.choice(["sedan", "suv"])),
        )
        lateral = (
            opposite_m
            + OPPOSITE_SHOULDER_M
            + LANE_WIDTH_M * (0.5 + float(rng.integers(3)))
        )
        place_m = float(s + rng.uniform(-15, 15))
        cars.append(
            PlacedObject(
                place_m, lateral, Car(paint, body, heading_rad=np.pi), -speed_mps
            )
        )
    return tuple(cars)


def car(
    s_m: float, lane: int, paint: str, body: str = "sedan", *, speed_mps: float = 0.0
) -> PlacedObject:
    """Car in the centre of a lane; `lane` is 0 for the ego lane, > 0 to the left."""
    return PlacedObject(s_m, lane * LANE_WIDTH_M, Car(paint, body), speed_mps)
