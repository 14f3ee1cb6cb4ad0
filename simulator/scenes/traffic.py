"""Traffic scenes of the suite: vehicles that cross the ego lane or hide its lines."""

from __future__ import annotations

from dataclasses import replace

from simulator.objects.scene_objects import Car, PlacedObject
from simulator.rendering.drive import Drive, SuiteScene
from simulator.scenes.bad_weather import country_road_drive, plain_motorway
from simulator.scenes.freeway import LANE_WIDTH_M


def _with(drive: Drive, *others: PlacedObject) -> Drive:
    """The drive with other vehicles instead of those on the car's carriageway."""
    kept = tuple(
        p for p in drive.objects if not (isinstance(p, PlacedObject) and isinstance(p.item, Car) and p.speed_mps > 0)
    )
    return replace(drive, objects=(*kept, *others))


def _motorcycle() -> Drive:
    """A motorcycle that crosses the lane from the right line to beyond the left one, and back."""
    path = ((0.0, -2.0), (0.8, -1.7), (2.0, 1.6), (2.8, 1.7), (4.0, -0.4))
    rider = PlacedObject(13.0, 0.0, Car(0, 0, 0.0, "red", "motorcycle"), 15.6, path)
    return _with(country_road_drive(411), rider)


def _cut_in() -> Drive:
    """A car that cuts in from the right lane, 11 m ahead, and leaves again."""
    path = ((0.0, -LANE_WIDTH_M), (0.5, -LANE_WIDTH_M), (2.0, -0.2), (2.7, -0.2), (4.2, -LANE_WIDTH_M))
    others = (
        PlacedObject(16.0, 0.0, Car(0, 0, 0.0, "white", "suv"), 27.6, path),
        PlacedObject(70.0, -LANE_WIDTH_M, Car(0, 0, 0.0, "black"), 28.0),
        PlacedObject(95.0, 0.0, Car(0, 0, 0.0, "silver"), 29.0),
    )
    return _with(plain_motorway(421), *others)


def _lorry() -> Drive:
    """A lorry that drives on the broken line for two seconds, half in the ego lane."""
    path = ((0.0, -LANE_WIDTH_M), (0.8, -LANE_WIDTH_M), (1.8, -2.6), (3.3, -2.6), (4.5, -LANE_WIDTH_M))
    others = (
        PlacedObject(17.0, 0.0, Car(0, 0, 0.0, "blue", "truck"), 26.4, path),
        PlacedObject(80.0, 0.0, Car(0, 0, 0.0, "red"), 29.0),
    )
    return _with(plain_motorway(431), *others)


SCENES = (
    SuiteScene("motorcycle", "medium", 4.0, "A motorcycle weaves across the lane and both of its lines.", _motorcycle),
    SuiteScene(
        "cut-in", "medium", 4.5, "A car crosses the line into the ego lane just ahead, and leaves it again.", _cut_in
    ),
    SuiteScene("lorry", "hard", 4.5, "A lorry hides the broken line for two seconds, driving on it.", _lorry),
)
