"""The marking of a line: its cross-section, colour and gaps in one image, and its type over the road driven."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.line_type import MarkingProfile, TypeVotes, marking_profile
from lanes.detect.paint import find_stripes, marking_response
from tests.support.painted_roads import ASPHALT, WHITE, YELLOW, Road, dashcam

CAMERA, SMALL = dashcam(1280), dashcam(640)
VIEW = BirdsEyeView(CAMERA)
CONCRETE = (168, 163, 155)
# What light and air make of the image of a road: a function of its grey levels, 0 to 255.
LIGHTS = {
    "white": lambda image: image,
    "low sun": lambda image: image * (1.0, 0.8, 0.55),
    "sodium lamps": lambda image: image * (0.9, 0.6, 0.2),
    "blue shade": lambda image: image * (0.35, 0.42, 0.6),
    "night": lambda image: 0.2 * image,
    "glare": lambda image: 120 + 0.4 * image,
}


def paint_at(road, y, side=1, *, light=LIGHTS["white"], view=VIEW):
    """The profile along lateral positions y, of a line to the left (+1) or right (-1) of the lane."""
    image = np.clip(light(road.image().astype(float)), 0, 255).astype(np.uint8)
    response = marking_response(view.warp(image), view)
    line_y_m, stripes = y + np.zeros(len(view.x_m)), find_stripes(response, view)
    on_line = np.abs(stripes.y_m - line_y_m[stripes.row]) < 0.2
    return marking_profile(response, view, line_y_m, stripes.row[on_line], side)


def kind_of(*profiles):
    votes = TypeVotes()
    for profile in profiles:
        votes = votes.add(profile)
    return votes.kind


@pytest.mark.parametrize("off", [-0.06, 0.0, 0.08])
def test_single_stripe(off):
    paint = paint_at(Road(CAMERA).lines(-1.7 + off, width_m=0.12), -1.7)
    assert not paint.double
    assert paint.width_m == pytest.approx(0.12, abs=0.04)
    assert paint.centre_m == pytest.approx(off, abs=0.015)


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("asphalt", [ASPHALT, CONCRETE], ids=["asphalt", "concrete"])
@pytest.mark.parametrize(("paint", "colour"), [(WHITE, "white"), (YELLOW, "yellow")], ids=["white", "yellow"])
def test_colour_is_that_of_the_paint_not_of_the_light(paint, colour, asphalt, light):
    """Beside the road is soil, which is yellower than the road. Sodium lamps have little blue for paint to lack."""
    road = Road(CAMERA, asphalt=asphalt, noise=1.0).paint(lambda x, y: y > 1.9, (150, 120, 60)).lines(1.7, colour=paint)
    profile = paint_at(road, 1.7, light=light)
    assert TypeVotes().add(profile).colour in ((colour, None) if light is LIGHTS["sodium lamps"] else (colour,))


@pytest.mark.parametrize(("side", "y"), [(1, 1.6), (-1, -1.6)])
def test_of_a_double_line_the_stripe_next_to_the_lane_counts(side, y):
    paint = paint_at(Road(CAMERA).lines(y - 0.11, y + 0.11, colour=YELLOW, width_m=0.1), y, side)
    assert paint.double and paint.yellowness > 0.7
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
    assert paint.yellowness > 0.7 and paint.double == (width_m > 0.2)


@pytest.mark.parametrize("light", ["white", "night", "glare"])
@pytest.mark.parametrize("camera", [CAMERA, SMALL], ids=["1280 px", "640 px"])
@pytest.mark.parametrize(
    ("look", "kind"),
    [({}, "solid"), ({"dash_m": (3, 12)}, "dashed"), ({"dash_m": (2, 6)}, "dashed"), ({"dash_m": (3, 6)}, "dashed")],
    ids=["solid", "USA", "UK", "equal"],
)
def test_gaps_show_in_one_image(look, kind, camera, light):
    road = Road(camera, noise=1.0).lines(1.7, phase_m=1.0, **look)
    view = BirdsEyeView(camera)
    paint = paint_at(road, 1.7, light=LIGHTS[light], view=view)
    assert kind_of(paint) == kind
    assert paint.seen_m > 10


def test_wear_shadows_and_cars_are_no_gaps():
    """A solid line with holes of 1.2 m, half of it in deep shade, and with the side of a lorry over its far half."""
    worn = Road(CAMERA).lines(1.7, dash_m=(4.8, 6.0))
    shaded = Road(CAMERA).lines(1.7).shade(lambda x, y: (x > 8) & (x < 14), 0.7)
    rng = np.random.default_rng(4)
    panels = cv2.resize(rng.integers(0, 255, (60, 100, 3)).astype(np.uint8), CAMERA.size)
    lorry = Road(CAMERA).lines(1.7)
    lorry = lorry._blend(lorry.cover(lambda x, y: (x > 13) & (y > 0.8)), panels.astype(np.float32))
    for road in (worn, shaded, lorry):
        assert kind_of(paint_at(road, 1.7)) in ("solid", None)
    assert kind_of(paint_at(shaded, 1.7)) == "solid"


def test_a_short_piece_of_a_line_has_no_kind():
    assert kind_of(paint_at(Road(CAMERA).paint(lambda x, y: (np.abs(y) < 0.06) & (x < 10), WHITE), 0.0)) != "solid"
    assert paint_at(Road(CAMERA), 0.0) is None


@pytest.mark.parametrize("dash_m", [(6.0, 18.0), (10.0, 30.0)])
def test_dashes_longer_than_the_view_show_while_driving(dash_m):
    """One image in ten, 10 m apart: the kind is right from the third one on, and never flickers."""
    votes, kinds = TypeVotes(), []
    for driven_m in np.arange(0.0, 120.0, 10.0):
        paint = paint_at(Road(CAMERA).lines(1.7, dash_m=dash_m, phase_m=5.0 - driven_m), 1.7)
        votes = votes.add(paint) if paint else votes
        kinds.append(votes.kind)
    assert set(kinds[3:]) == {"dashed"}


def test_what_lies_farther_back_counts_less():
    yellow = MarkingProfile(0.35, 0.0, yellowness=0.9, seen_m=15.0, painted_m=4.0, bare_m=10.0)
    white = replace(yellow, width_m=0.12, yellowness=0.0, painted_m=15.0, bare_m=0.0)
    votes = TypeVotes()
    assert (votes.colour, votes.kind, votes.double) == (None, None, None)
    for _ in range(20):
        votes = votes.add(yellow)
    votes = votes.add(white)
    assert (votes.colour, votes.kind, votes.double) == ("yellow", "dashed", True)
    seen = []
    for _ in range(20):
        votes = votes.add(white)
        seen.append((votes.colour, votes.kind, votes.double))
    assert seen[-1] == ("white", "solid", False)
    # between the two the kind is unknown
    assert [kind for _, kind, _ in seen].count(None) >= 1
