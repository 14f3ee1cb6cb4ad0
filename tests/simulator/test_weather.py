"""Light and weather: exposure, shadows, fog, retroreflection and rain."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from simulator.light.lens import AutoExposure, road_luminance
from simulator.objects.scene_objects import shadow_polygons
from simulator.objects.standing import Post
from simulator.objects.vehicles import Car
from simulator.objects.walls import Overpass
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import Frame, render_frame
from simulator.road.surface import Zone
from simulator.road.truth import truth_row
from simulator.scenes.freeway import Freeway
from simulator.weather import Fog, Night, find_lamps
from tests.simulator.small_drive import largest_difference, small_drive

BRIDGE = Overpass(110.0, 126.0, -20.0, 12.0, skew=0.1)
YELLOW_LINE = Freeway().markings()[0]
WIDE_LINE = (replace(YELLOW_LINE, wear=0.0, width_m=1.2, dots=False),)
# Lateral positions on the wide line and beside it.
ON_LINE_M = 1.83
BESIDE_LINE_M = 0.6


def asphalt_drive(
    curvature: float = 1 / 250,
    **changes: Any,
) -> Drive:
    """`small_drive` on used asphalt at 20 m/s."""
    drive = small_drive(
        curvature,
        surface=Freeway().surface(),
        motion=Motion(60.0, 20.0, offset_m=0.3, heading_rad=0.01),
    )
    return replace(drive, **changes)


def straight_drive(**changes: Any) -> Drive:
    return asphalt_drive(0.0, motion=Motion(100.0), **changes)


def test_exposure_covers_63_percent_of_a_step_within_the_time_constant():
    concrete_m = 1000.0
    speed_mps = 400.0
    time_constant_s = 0.8
    freeway = Freeway("fresh asphalt", (Zone(concrete_m, "concrete"),))
    motion = Motion(0.0, speed_mps)
    exposure = AutoExposure(time_constant_s)
    surface = freeway.surface()
    luminance = partial(road_luminance, surface=surface, shades=(), seed=5)

    def adapted_stops(time_s: float) -> float:
        light = exposure.adapted_light(lambda t: motion.pose(t).s_m, luminance, time_s)
        return np.log2(light)

    before = adapted_stops(1.5)
    after = adapted_stops(12.0)
    # The metering area from 5 to 25 m ahead is passed in 0.05 s.
    step_s = (concrete_m - 15.0) / speed_mps
    shares = []
    for constants in (0.0, 1.0, 2.0):
        stops = adapted_stops(step_s + constants * time_constant_s)
        shares.append((stops - before) / (after - before))
    expected = [0.0, 1 - np.exp(-1), 1 - np.exp(-2)]
    np.testing.assert_allclose(shares, expected, atol=0.04)


def test_shadows_fall_away_from_the_sun():
    """The sun is on the right: 0.75 m farther left for each metre of height."""
    sun_direction = np.array([0.0, -0.6, 0.8])
    (post,) = shadow_polygons([Post(4.0, x_m=10.0)], sun_direction)
    left = post[:, 1]
    assert left.max() == pytest.approx(3.0, abs=0.1)
    assert left.min() > -0.2


@pytest.fixture
def ground_levels(monkeypatch):
    """Function of drive, distances (N,) and lateral position.

    It returns the linear green light of the ground before development.
    """
    lights = []

    def develop(light, *arguments, **options):
        lights.append(light)
        return light

    monkeypatch.setattr("simulator.rendering.render.develop", develop)

    def levels(
        drive: Drive,
        x_m: np.ndarray,
        y_m: float,
    ) -> np.ndarray:
        points = np.column_stack([x_m, np.full_like(x_m, y_m)])
        pixels = drive.camera_at(0.0).road_to_pixels(points)
        columns, rows = pixels.round().astype(int).T
        render_frame(drive)
        return lights[-1][rows, columns, 1]

    return levels


def test_contrast_in_fog_obeys_koschmieders_law(ground_levels):
    """5 % of it is left at the visibility, and its square at twice the visibility."""
    visibility_m = 20.0
    x_m = np.array([10.0, 20.0, 40.0])
    clear = straight_drive(
        markings=WIDE_LINE,
        surface=replace(Freeway("concrete").surface(), seams=()),
    )
    foggy = replace(clear, fog=Fog(visibility_m))

    def contrast(drive: Drive) -> np.ndarray:
        paint = ground_levels(drive, x_m, ON_LINE_M)
        pavement = ground_levels(drive, x_m, 3.3)
        return paint - pavement

    left = contrast(foggy) / contrast(clear)
    np.testing.assert_allclose(left, 0.05 ** (x_m / visibility_m), rtol=0.05)


@pytest.mark.parametrize(
    ("y_m", "expected"),
    [
        pytest.param(ON_LINE_M, 4.0, id="paint"),
        pytest.param(BESIDE_LINE_M, 1.0, id="asphalt"),
    ],
)
def test_only_paint_is_retroreflective(ground_levels, y_m, expected):
    x_m = np.array([10.0, 20.0, 35.0])
    beads = straight_drive(night=Night(retroreflection=4.0), markings=WIDE_LINE)
    plain = replace(beads, night=Night(retroreflection=1.0))
    ratio = ground_levels(beads, x_m, y_m) / ground_levels(plain, x_m, y_m)
    np.testing.assert_allclose(ratio, expected, rtol=0.05)


def render_below_bridge(*, rain: bool) -> Frame:
    return render_frame(asphalt_drive(rain=rain, objects=(BRIDGE,)), 0.9)


@pytest.fixture(scope="module")
def clear() -> Frame:
    return render_below_bridge(rain=False)


@pytest.fixture(scope="module")
def rainy() -> Frame:
    return render_below_bridge(rain=True)


def test_rain_is_the_same_each_time(rainy):
    again = render_below_bridge(rain=True)
    np.testing.assert_array_equal(rainy.image, again.image)


def test_rain_changes_a_part_of_the_picture(clear, rainy):
    changed = largest_difference(rainy.image, clear.image) > 8
    assert 0.02 < changed.mean() < 0.6


def test_rain_hides_no_object(clear, rainy):
    np.testing.assert_array_equal(rainy.hidden, clear.hidden)


def test_rain_does_not_change_the_truth(clear, rainy):
    assert truth_row(rainy.truth, frame=0) == truth_row(clear.truth, frame=0)


@pytest.mark.parametrize("body", ["sedan", "suv", "truck"])
class TestLampsAtNight:
    """Of a vehicle 30 m ahead: two lamps; (red, green, blue) of their light."""

    def lights_of(self, body: str, heading_rad: float) -> np.ndarray:
        car = Car(x_m=30.0, y_m=2.0, body=body, heading_rad=heading_rad)
        lamps = find_lamps([car])
        assert len(lamps) == 2
        return np.array([lamp.light for lamp in lamps])

    def test_a_vehicle_that_drives_ahead_shows_red_lamps(self, body):
        red, green, blue = self.lights_of(body, 0.0).T
        assert (red > 10 * np.maximum(green, blue)).all()

    def test_an_oncoming_vehicle_shows_brighter_white_lamps(self, body):
        ahead = self.lights_of(body, 0.0)
        oncoming = self.lights_of(body, np.pi)
        assert (oncoming.min(axis=1) > 2 * ahead.max(axis=1)).all()
