"""`tools.ablation` switches a mechanism off by settings and compares the same frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.evaluation import prepare_drive
from benchmark.scored_drive import drive_from_video
from lanes.track.tracker import TrackerSettings
from tests.support.project import ROOT
from tools.ablation import ALL_ON, MECHANISMS, measure, table_row, with_value


@pytest.fixture(scope="module")
def measurements():
    """Without any change, and without rate steps, in a hairpin."""
    drive = prepare_drive(drive_from_video(ROOT / "test_videos" / "harder_challenge_video.mp4"))
    (rate_steps,) = (mechanism for mechanism in MECHANISMS if mechanism.name == "rate steps")
    return [measure((mechanism, drive), end_s=0.4) for mechanism in (ALL_ON, ALL_ON, rate_steps)]


def test_a_strong_mechanism_changes_the_result_and_nothing_else_does(measurements):
    on, again, off = (one.errors.lateral_m for one in measurements)
    np.testing.assert_array_equal(on, again)
    assert not np.array_equal(on, off, equal_nan=True)


def test_a_row_shows_what_is_lost(measurements):
    on = measurements[0]
    off, right = (
        replace(on, errors=replace(on.errors, near_rms_m=np.where(np.arange(10) < wrong, 1.0, 0.0))) for wrong in (4, 0)
    )
    cells = [cell.strip() for cell in table_row(MECHANISMS[0], [off], [right]).split("|")[1:-1]]
    assert cells[0] == MECHANISMS[0].name and cells[2] == "60.0%"
    assert cells[3].startswith("-40.0 (")


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda mechanism: mechanism.name)
def test_each_mechanism_changes_exactly_its_settings(mechanism):
    settings, default = mechanism.settings(), TrackerSettings()
    assert settings != default
    for path in mechanism.off:
        value = default
        for name in path.split("."):
            value = getattr(value, name)
        settings = with_value(settings, path.split("."), value)
    assert settings == default
