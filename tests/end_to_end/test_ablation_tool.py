"""`tools.ablation` switches a mechanism off in all modules that use it, and on again."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.evaluation import prepare_drive
from benchmark.scored_drive import drive_from_video
from lanes.detect import fit as fitting
from lanes.track import filter as update
from tests.support.project import ROOT
from tools.ablation import ALL_ON, SWITCHES, importers, measure, switched_off, table_row

BY_NAME = {switch.name: switch for switch in SWITCHES}
# Ten frames.
SECONDS = 0.4


@pytest.fixture(scope="module")
def drives():
    return [prepare_drive(drive_from_video(ROOT / "test_videos" / "harder_challenge_video.mp4"))]


@pytest.fixture(scope="module")
def all_on(drives):
    return measure(ALL_ON, drives, end_s=SECONDS)


def lateral_errors(measurement):
    return measurement.drives[0].lateral_m


@pytest.mark.parametrize("name", ["rate steps", "bend ahead"])
def test_a_strong_mechanism_changes_the_result(name, drives, all_on):
    without = measure(BY_NAME[name], drives, end_s=SECONDS)
    assert not np.array_equal(lateral_errors(without), lateral_errors(all_on), equal_nan=True)
    assert table_row(BY_NAME[name], without, all_on).startswith(f"| {name} |")


def test_all_on_changes_nothing(drives, all_on):
    again = measure(ALL_ON, drives, end_s=SECONDS)
    np.testing.assert_array_equal(lateral_errors(again), lateral_errors(all_on))


@pytest.mark.parametrize("switch", SWITCHES, ids=lambda switch: switch.name)
def test_each_switch_replaces_objects_of_the_engine_and_restores_them(switch):
    for old, new in switch.replacements:
        places = importers(old)
        assert places
        with switched_off(switch):
            assert not importers(old)
            assert set(places) <= set(importers(new))
        assert importers(old) == places


def test_every_importer_of_a_parameter_instance_is_patched():
    original = fitting.FIT
    with switched_off(BY_NAME["variance inflation"]):
        assert fitting.FIT.variance_inflation == update.FIT.variance_inflation == 1.0
    assert fitting.FIT is update.FIT is original
