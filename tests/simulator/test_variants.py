"""Variants of the scenes: other roads, cameras and drivers, with a truth of their own."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.scenes.suite import SUITE
from simulator.scenes.variants import VARIANT, vary_drive

HAIRPIN = SUITE["hairpin-right"]


def test_variant_zero_is_the_drive_itself():
    drive = HAIRPIN.drive()
    assert vary_drive(drive, 0) is drive


def test_a_variant_is_the_same_each_time_and_differs_from_the_others():
    first, again, other = (vary_drive(HAIRPIN.drive(), seed) for seed in (1, 1, 2))
    assert first.motion == again.motion and first.camera.pose == again.camera.pose and first.lens == again.lens
    assert first.motion != other.motion and first.camera.pose != other.camera.pose
    assert len({HAIRPIN.drive().seed, first.seed, other.seed}) == 3


def test_the_road_is_scaled_in_plan_and_keeps_its_slopes():
    drive = SUITE["crests"].drive()
    varied = vary_drive(drive, 3)
    scale = varied.road.stations_m[-1] / drive.road.stations_m[-1]
    low, high = VARIANT.road_scale
    assert low <= scale <= high and scale != 1
    np.testing.assert_allclose(varied.road.curvatures_per_m * scale, drive.road.curvatures_per_m)
    np.testing.assert_allclose(varied.road.profile.slopes, drive.road.profile.slopes)
    # the same bend, enlarged: the angle does not change
    assert varied.road.heading(60.0 * scale) == pytest.approx(float(drive.road.heading(60.0)))


def test_paint_noise_and_exposure_vary_within_their_ranges():
    drive = SUITE["fog"].drive()
    variants = [vary_drive(drive, seed) for seed in (1, 2, 3)]
    wear = [[m.wear / known.wear for m, known in zip(v.markings, drive.markings, strict=True)] for v in variants]
    noise = [v.lens.noise / drive.lens.noise for v in variants]
    for factors, (low, high) in ((wear, VARIANT.wear), (noise, VARIANT.noise)):
        assert low <= np.min(factors) and np.max(factors) <= high
        # each stripe of each variant has a factor of its own
        assert len(np.unique(factors)) == np.size(factors)
    assert len({drive.lens.exposure, *(v.lens.exposure for v in variants)}) == 4


@pytest.mark.parametrize("name", [name for name, scene in SUITE.items() if scene.difficulty != "no lane"])
def test_the_car_stays_on_its_lane_as_in_the_scene(name):
    """The truth of a variant at the beginning and the end: both lines exist, and the car is between them or crosses."""
    scene = SUITE[name]
    for seed in (1, 2, 3):
        varied = vary_drive(scene.drive(), seed)
        for time_s in (0.0, scene.seconds):
            truth = varied.truth(time_s)
            assert truth.left.c0_m > truth.right.c0_m, (seed, time_s)
            assert abs(truth.offset_m) < truth.lane_width_m / 2 + 0.5, (seed, time_s)
