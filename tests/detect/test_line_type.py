"""The marking of a line: its cross-section in one picture, and the votes on its type."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.line_type import MarkingProfile, TypeVotes, looks_dashed, marking_profile
from lanes.detect.paint import marking_response
from tests.support.painted_roads import WHITE, YELLOW, Road, dashcam

SOLID = np.arange(5, 30, 0.3)
WORN = SOLID[(SOLID < 12) | (SOLID > 14)]
DASHES = np.concatenate([np.arange(6, 9, 0.2), np.arange(18.2, 21.2, 0.4)])


@pytest.mark.parametrize(
    ("painted_m", "dashed"),
    [(SOLID, False), (WORN, False), (DASHES, True), (DASHES[::-1], True), (SOLID[:4], None)],
    ids=["solid", "worn", "dashes", "dashes from far to near", "too little"],
)
def test_gaps_tell_dashes(painted_m, dashed):
    assert looks_dashed(painted_m) is dashed


def test_the_majority_decides_and_old_votes_fade():
    wide, thin = MarkingProfile(0.35, 0.0, True, 5.0), MarkingProfile(0.12, 0.0, False, 5.0)
    votes = TypeVotes()
    assert (votes.colour, votes.kind, votes.double) == (None, None, None)
    for _ in range(5):
        votes = votes.add_profile(wide).add_gaps(DASHES)
    votes = votes.add_profile(thin).add_gaps(SOLID)
    assert (votes.colour, votes.kind, votes.double) == ("yellow", "dashed", True)
    for _ in range(12):
        votes = votes.add_profile(thin).add_gaps(SOLID)
    assert (votes.colour, votes.kind, votes.double) == ("white", "solid", False)
    assert votes.add_profile(None).add_gaps(SOLID[:2]) == votes
    for _ in range(200):
        votes = votes.add_profile(thin)
    for _ in range(15):
        votes = votes.add_profile(wide)
    assert votes.colour == "yellow"


CAMERA = dashcam(1280)
VIEW = BirdsEyeView(CAMERA)


def paint_at(road, y):
    return marking_profile(marking_response(VIEW.warp(road.image()), VIEW), VIEW, y + np.zeros(len(VIEW.x_m)))


@pytest.mark.parametrize(("colour", "yellow"), [(WHITE, False), (YELLOW, True)])
@pytest.mark.parametrize("off", [-0.06, 0.0, 0.08])
def test_single_stripe(colour, yellow, off):
    paint = paint_at(Road(CAMERA).lines(-1.7 + off, colour=colour, width_m=0.12), -1.7)
    assert paint.yellow is yellow and not paint.double
    assert paint.width_m == pytest.approx(0.12, abs=0.04)
    assert paint.centre_m == pytest.approx(off, abs=0.015)
    assert paint.contrast > 20


@pytest.mark.parametrize(("side", "y"), [(1, 1.6), (-1, -1.6)])
def test_of_a_double_line_the_stripe_next_to_the_lane_counts(side, y):
    paint = paint_at(Road(CAMERA).lines(y - 0.11, y + 0.11, colour=YELLOW, width_m=0.1), y)
    assert paint.double and paint.yellow
    assert paint.stripe_m(side) == pytest.approx(-side * 0.11, abs=0.025)


def test_a_wide_white_line_is_not_double():
    """The edge line of a motorway is 0.3 m wide, as wide as two stripes with their gap; its centre counts."""
    wide = paint_at(Road(CAMERA).lines(-1.7, colour=WHITE, width_m=0.3), -1.7)
    assert wide.width_m == pytest.approx(0.3, abs=0.04)
    assert not wide.double and wide.stripe_m(-1) == pytest.approx(0.0, abs=0.015)
    two = paint_at(Road(CAMERA).lines(-1.81, -1.59, colour=WHITE, width_m=0.1), -1.7)
    assert two.double and two.gap < 0.6 < wide.gap


@pytest.mark.parametrize(("width_m", "degrees"), [(0.3, -40), (0.3, 40), (0.12, -20), (0.12, 20)])
def test_a_line_that_runs_across_is_no_wider(width_m, degrees):
    """Rows cut it aslant, where 0.3 m are 0.39 m; its cross-section is measured at right angles."""
    slope, cos = np.tan(np.radians(degrees)), np.cos(np.radians(degrees))
    road = Road(CAMERA).paint(lambda x, y: np.abs(y - slope * (x - 9.0)) * cos < width_m / 2, YELLOW)
    paint = paint_at(road, slope * (VIEW.x_m - 9.0))
    assert paint.width_m == pytest.approx(width_m, abs=0.04)
    assert paint.centre_m == pytest.approx(0.0, abs=0.03)
    assert paint.yellow and paint.double == (width_m > 0.2)
