"""The tracker is as accurate as its reference, on parts of the committed videos."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmark.scored_drive import COMMITTED, list_drives
from tests.end_to_end.reference import MEASURES, REFERENCE, measure, worse_than
from tests.end_to_end.test_honesty import PROMISED

REFERENCES = json.loads(REFERENCE.read_text(encoding="utf-8"))
FIRST = next(iter(REFERENCES))


measured = cache(measure)


@pytest.mark.parametrize("scene", REFERENCES)
def test_the_tracker_is_not_worse_than_the_reference(scene):
    assert worse_than(REFERENCES[scene], measured(scene)) == []


def test_the_tracker_is_confident_and_wrong_as_rarely_as_promised_on_new_frames():
    wrong = [measured(scene).confident_and_wrong for scene in REFERENCES]
    assert np.concatenate(wrong).mean() <= PROMISED["lane"]


def test_every_committed_video_is_held_to_every_measure():
    assert list(REFERENCES) == [name for name in COMMITTED if name in list_drives() and list_drives()[name].video]
    assert all(tuple(reference) == MEASURES for reference in REFERENCES.values())
    numbers = [number for reference in REFERENCES.values() for known in reference.values() for number in known.values()]
    assert np.isfinite(numbers).all()


class TestTheComparison:
    """The test fails for worse results."""

    def test_a_lane_shifted_by_a_centimetre_is_noticed(self):
        errors = measured(FIRST)
        shifted = replace(errors, lateral_m=errors.lateral_m + 0.01, near_rms_m=errors.near_rms_m + 0.01)
        assert any("lateral_5_20m_p95_m" in line for line in worse_than(REFERENCES[FIRST], shifted))

    def test_frames_that_are_lost_are_noticed(self):
        errors = measured(FIRST)
        lost = np.isin(np.arange(len(errors.available)), (10, 11, 12))
        some = replace(errors, available=errors.available & ~lost, confident=errors.confident & ~lost)
        worse = worse_than(REFERENCES[FIRST], some)
        assert [line.split(":")[0] for line in worse] == ["available_share", "accuracy", "recovery_longest_frames"]

    def test_measures_that_are_missing_are_noticed(self):
        errors = measured(FIRST)
        missing = replace(errors, offset_m=np.full_like(errors.offset_m, np.nan))
        assert any("offset_p95_m: nan" in line for line in worse_than(REFERENCES[FIRST], missing))
