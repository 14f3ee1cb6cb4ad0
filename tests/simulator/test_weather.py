"""Light and weather: exposure, shadows, fog, retroreflection and rain."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from simulator.light.lens import AutoExposure, road_luminance
from simulator.objects.scene_objects import shadow_polygons
from simulator.objects.standing import Post
from simulator.objects.walls import Overpass
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.road.surface import Zone
from simulator.road.truth import truth_row
from simulator.scenes.freeway import Freeway
from simulator.weather import Fog, Night
from tests.simulator.small_drive import small_drive

BRIDGE = Overpass(110.0, 126.0, -20.0, 12.0, skew=0.1)
WIDE_LINE = (replace(Freeway().markings()[0], wear=0.0, width_m=1.2, dots=False),)


def asphalt_drive(curvature: float = 1 / 250, **changes) -> Drive:
    """`small_drive` on used asphalt at 20 m/s."""
    motion = Motion(60.0, 20.0, offset_m=0.3, heading_rad=0.01)
    return small_drive(
        curvature, **{"surface": Freeway().surface(), "motion": motion} | changes
    )


def straight_drive(**changes) -> Drive:
    return asphalt_drive(0.0, motion=Motion(100.0), **changes)


def test_exposure_covers_63_percent_of_a_step_within_the_time_constant():
    drive = asphalt_drive(
        surface=Freeway("fresh asphalt", (Zone(1000.0, "concrete"),)).surface(),
        motion=Motion(0.0, 400.0),
        exposure=AutoExposure(0.8),
    )
    light = partial(
        road_luminance, surface=drive.surface, shades=drive.shades, seed=drive.seed
    )

    def adapted(time_s: float) -> float:
        return np.log2(
            drive.exposure.adapted_light(
                lambda t: drive.motion.pose(t).s_m, light, time_s
            )
        )

    before, after = adapted(1.5), adapted(12.0)
    # The metering area from 5 to 25 m ahead is passed in 0.05 s.
    step_s = (1000.0 - 15.0) / 400.0
    shares = [
        (adapted(step_s + k * 0.8) - before) / (after - before) for k in (0.0, 1.0, 2.0)
    ]
    np.testing.assert_allclose(shares, [0.0, 1 - np.exp(-1), 1 - np.exp(-2)], atol=0.04)


def test_shadows_fall_away_from_the_sun():
    """The sun is on the right: 0.75 m farther left for each metre of height."""
    post = shadow_polygons([Post(4.0, x_m=10.0)], np.array([0.0, -0.6, 0.8]))[0]
    assert post[:, 1].max() == pytest.approx(3.0, abs=0.1) and post[:, 1].min() > -0.2


def linear_light(drive: Drive, monkeypatch) -> np.ndarray:
    """Light (height, width, 3) of the first frame before development."""
    lights = []
    monkeypatch.setattr(
        "simulator.rendering.render.develop",
        lambda light, *a, **k: lights.append(light) or light,
    )
    render_frame(drive)
    return lights[0]


def ground_levels(drive: Drive, x_m: np.ndarray, y_m: float, monkeypatch) -> np.ndarray:
    """Linear green light of the ground at distances `x_m` (N,)."""
    points = np.column_stack([x_m, np.full_like(x_m, y_m)])
    columns, rows = drive.camera_at(0.0).road_to_pixels(points).round().astype(int).T
    return linear_light(drive, monkeypatch)[rows, columns, 1]


def test_contrast_in_fog_obeys_koschmieders_law(monkeypatch):
    """Contrast of paint and pavement: 5 % is left at the visibility, and its square at twice the visibility."""
    x = np.array([10.0, 20.0, 40.0])
    surface = replace(Freeway("concrete").surface(), seams=())
    drive = straight_drive(markings=WIDE_LINE, surface=surface)
    contrast = {}
    for fog in (None, Fog(20.0)):
        paint, beside = (
            ground_levels(replace(drive, fog=fog), x, y, monkeypatch)
            for y in (1.83, 3.3)
        )
        contrast[fog] = paint - beside
    np.testing.assert_allclose(
        contrast[Fog(20.0)] / contrast[None],
        0.05 ** (np.array([10, 20, 40]) / 20),
        rtol=0.05,
    )


def test_paint_is_retroreflective_and_asphalt_is_not(monkeypatch):
    x = np.array([10.0, 20.0, 35.0])
    drives = [
        straight_drive(night=Night(retroreflection=r), markings=WIDE_LINE)
        for r in (4.0, 1.0)
    ]
    for y, expected in ((1.83, 4.0), (0.6, 1.0)):
        lit, plain = (ground_levels(drive, x, y, monkeypatch) for drive in drives)
        np.testing.assert_allclose(lit / plain, expected, rtol=0.05)


def test_rain_changes_the_picture_but_neither_truth_nor_hidden_mask():
    clear, rainy = (
        render_frame(asphalt_drive(rain=rain, objects=(BRIDGE,)), 0.9)
        for rain in (False, True)
    )
    again = render_frame(asphalt_drive(rain=True, objects=(BRIDGE,)), 0.9)
    np.testing.assert_array_equal(rainy.image, again.image)
    np.testing.assert_array_equal(rainy.hidden, clear.hidden)
    assert truth_row(rainy.truth, frame=0) == truth_row(clear.truth, frame=0)
    assert (
        0.02
        < (np.abs(rainy.image.astype(int) - clear.image).max(axis=2) > 8).mean()
        < 0.6
    )
