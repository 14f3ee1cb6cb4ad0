"""Votes on what kind a line is."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.tracking.lane import MarkingProfile
from lanes.tracking.marking_type import MarkingType, MarkingVotes, looks_dashed

DASHES = np.concatenate([np.arange(6, 9, 0.2), np.arange(18.2, 21.2, 0.4)])


@pytest.mark.parametrize(
    ("painted_m", "dashed"),
    [(np.arange(5, 40, 0.3), False), (DASHES, True), (DASHES[::-1], True), (np.arange(5, 6, 0.3), None)],
)
def test_gaps_tell_dashes(painted_m, dashed):
    assert looks_dashed(painted_m) is dashed


def test_short_holes_are_no_gaps():
    places = np.arange(5, 30, 0.3)
    assert looks_dashed(places[(places < 12) | (places > 14)]) is False


def test_the_majority_decides():
    votes = MarkingVotes()
    assert votes.marking_type == MarkingType(None, None, None)
    assert votes.marking_type.describe() == "unknown"
    for _ in range(5):
        votes = votes.add_profile(MarkingProfile(0.35, 0.0, True, 5.0)).add_gaps(DASHES)
    votes = votes.add_profile(MarkingProfile(0.12, 0.0, False, 5.0)).add_gaps(np.arange(5, 30, 0.3))
    assert votes.marking_type == MarkingType("yellow", "dashed", True)
    assert votes.marking_type.describe() == "yellow double dashed"
    for _ in range(12):
        votes = votes.add_profile(MarkingProfile(0.12, 0.0, False, 5.0)).add_gaps(np.arange(5, 30, 0.3))
    assert votes.marking_type == MarkingType("white", "solid", False)
