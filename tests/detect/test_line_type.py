"""The marking of a line: its cross-section, colour and gaps in one image, and its type
over the road driven.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, find_stripes, marking_response
from lanes.detect.line_type import NO_VOTES, MarkingProfile, marking_profile
from lanes.detect.search import find_lane
from tests.support.painted_roads import WHITE, YELLOW, Road, bushes, dashcam

CAMERA = dashcam(1280)
SMALL = dashcam(640)
VIEW = BirdsEyeView(CAMERA)
SMALL_VIEW = BirdsEyeView(SMALL)
# What light and air make of the image of a road: a function of its grey levels, 0 to
# 255.
LIGHTS = {
    "white": lambda image: image,
    "low sun": lambda image: image * (1.0, 0.8, 0.55),
    "sodium lamps": lambda image: image * (0.9, 0.6, 0.2),
    "blue shade": lambda image: image * (0.35, 0.42, 0.6),
}


# Beside the road: yellower than it, and bluer.
SOIL = (150, 120, 60)
SNOW_IN_SHADE = (190, 200, 230)


@lru_cache(maxsize=32)
def drawn(beside=SOIL, **look):
    """A line 1.7 m to the left, at the edge of the road."""
    road = Road(CAMERA, noise=1.0)
    return (
        road.paint(lambda x, y: y > 1.9, beside).lines(1.7, phase_m=1.0, **look).image()
    )


def paint_in(image, y=1.7, side=1, *, light="white"):
    """The profile along lateral positions y, of a line to the left (+1) or right (-1)
    of the lane.
    """
    view = VIEW if image.shape[1] == CAMERA.width else SMALL_VIEW
    image = np.clip(LIGHTS[light](image.astype(float)), 0, 255).astype(np.uint8)
    response = marking_response(view.warp(image), view, PAINT)
    line_y_m = y + np.zeros(len(view.x_m))
    stripes = find_stripes(response, view, PAINT)
    on_line = np.abs(stripes.y_m - line_y_m[stripes.row]) < 0.2
    return marking_profile(response, view, line_y_m, stripes.row[on_line], side, PAINT)


def gray(image):
    """Three equal channels of the brightness."""
    return np.dstack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)] * 3)


def tinted(*tint):
    """A function that gives each channel this share of the brightness."""
    return lambda image: np.rint(gray(image) * tint).astype(np.uint8)


def as_jpeg(image):
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])
    return cv2.imdecode(data, cv2.IMREAD_COLOR)


# What cameras and programs make of an image, which has no colours then.
WITHOUT_COLOURS = {
    "gray": gray,
    "sepia": tinted(1.0, 0.9, 0.7),
    "green night vision": tinted(0.15, 1.0, 0.2),
    "blue": tinted(0.4, 0.6, 1.0),
    "black and white, toned": lambda image: cv2.LUT(gray(image), TONING),
    "low-pressure sodium lamps": tinted(1.0, 0.7, 0.0),
}
LEVELS = np.arange(256) / 255
# Dark tones are blue, light ones yellow.
TONING = np.dstack([LEVELS**1.2, LEVELS, LEVELS**0.9]) * 255
TONING = TONING.round().astype(np.uint8)


@pytest.mark.parametrize("without", WITHOUT_COLOURS.values(), ids=WITHOUT_COLOURS)
@pytest.mark.parametrize("store", [np.copy, as_jpeg])
def test_lines_of_an_image_without_colours_have_none(without, store):
    road = Road(SMALL).lines(1.8, colour=YELLOW).lines(-1.8, dash_m=(3, 9))
    image = road.surround(bushes(SMALL)).image()
    lane = find_lane(image, SMALL)
    assert (lane.left.colour, lane.right.colour) == ("yellow", "white")

    lane = find_lane(store(without(image)), SMALL)
    assert (lane.left.colour, lane.right.colour) == (None, None)
    assert (lane.left.kind, lane.right.kind) == ("solid", "dashed")
    assert "yellow" not in lane.left.describe()


def test_the_colour_is_that_of_the_images_that_have_colours():
    """A camera that turns to infrared light in a tunnel, and back."""
    yellow = paint_in(drawn(colour=YELLOW))
    unknown = replace(yellow, yellowness=None)
    votes = NO_VOTES
    colours = []
    for profile in [yellow] * 5 + [unknown] * 8 + [yellow] * 4:
        votes = votes.add(profile)
        colours.append(votes.colour)
    assert colours[4:6] == ["yellow"] * 2
    assert colours[12] is None
    assert colours[16] == "yellow"


def kind_of(*profiles):
    votes = NO_VOTES
    for profile in profiles:
        votes = votes.add(profile)
    return votes.kind


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize(
    ("paint", "colour", "beside"),
    [(WHITE, "white", SNOW_IN_SHADE), (YELLOW, "yellow", SOIL)],
    ids=["white", "yellow"],
)
def test_colour_is_that_of_the_paint_not_of_the_light_nor_of_what_is_beside_the_road(
    paint, colour, beside, light
):
    """Light of sodium lamps has little blue for yellow paint to lack."""
    profile = paint_in(drawn(beside, colour=paint), light=light)
    assert NO_VOTES.add(profile).colour in (
        (colour, None) if light == "sodium lamps" else (colour,)
    )


def test_white_paint_on_a_road_in_a_blue_veil_is_not_yellow():
    """As towards the bright end of a tunnel: the road is bluer than the paint."""
    veiled = Road(CAMERA, asphalt=(110, 125, 180)).lines(1.7, colour=(215, 225, 235))
    profile = paint_in(veiled.image())
    assert NO_VOTES.add(profile).colour is None
    yellow = Road(CAMERA, asphalt=(110, 125, 180)).lines(1.7, colour=YELLOW)
    assert NO_VOTES.add(paint_in(yellow.image())).colour == "yellow"


def test_the_colour_is_that_of_most_images():
    """Five images in a row of a white line in yellow light do not change its colour;
    when no colour has most images there is none.
    """
    white = paint_in(drawn(colour=WHITE))
    yellow = replace(white, yellowness=0.9)
    either = replace(white, yellowness=0.4)
    votes = NO_VOTES
    for profile in [white] * 20 + [yellow] * 5:
        votes = votes.add(profile)
        assert votes.colour == "white"
    for profile in [either] * 20:
        votes = votes.add(profile)
    assert votes.colour is None


@pytest.mark.parametrize(("side", "y"), [(1, 1.6), (-1, -1.6)])
def test_of_a_double_line_the_stripe_next_to_the_lane_counts(side, y):
    paint = paint_in(
        Road(CAMERA).lines(y - 0.11, y + 0.11, colour=YELLOW, width_m=0.1).image(),
        y,
        side,
    )
    assert paint.double
    assert paint.yellowness > 0.7
    assert paint.stripe_m(side) == pytest.approx(-side * 0.11, abs=0.025)


@pytest.mark.parametrize("gap_m", [0.1, 0.12])
def test_a_white_double_line_is_told_by_its_gap(gap_m):
    """A single line of the same width is none."""
    half_m = gap_m / 2 + 0.06
    double = Road(CAMERA).lines(1.7 - half_m, 1.7 + half_m, width_m=0.12)
    wide = Road(CAMERA).lines(1.7, width_m=gap_m + 0.24)
    assert paint_in(double.image()).double
    assert not paint_in(wide.image()).double


@pytest.mark.parametrize(
    ("dash_m", "kind"),
    [(None, "solid"), ((3, 12), "dashed"), ((2, 6), "dashed"), ((3, 4.33), "dashed")],
    ids=["solid", "USA", "UK", "France"],
)
def test_gaps_show_in_one_image(dash_m, kind):
    paint = paint_in(drawn(dash_m=dash_m))
    assert kind_of(paint) == kind
    assert paint.seen_m > 8


def test_wear_shadows_cars_and_a_bonnet_are_no_gaps():
    """Holes of 0.6 m in every 5 m, deep shade, a lorry before the far half, a bonnet
    before the near one.
    """
    image = drawn()
    lorry = np.where(
        Road(CAMERA).cover(lambda x, y: (x > 14) & (y > 0.8)) > 0.5,
        np.uint8([60, 60, 70]),
        image,
    )
    shaded = Road(CAMERA).lines(1.7).shade(lambda x, y: (x > 8) & (x < 14), 0.7).image()
    bonnet = np.where(
        Road(CAMERA).cover(lambda x, y: x < 10) > 0.5, np.uint8([30, 30, 35]), image
    )
    kinds = [
        kind_of(paint_in(seen))
        for seen in (drawn(dash_m=(4.4, 5.0)), shaded, lorry, bonnet)
    ]
    assert kinds == ["solid"] * 4


@pytest.mark.parametrize(
    "dash_m", [(6.0, 18.0), (10.0, 30.0)], ids=["Germany", "longer than the view"]
)
def test_dashes_show_while_driving(dash_m):
    """An image every 10 m: from the fourth one on the line is dashed, and stays so."""
    votes = NO_VOTES
    kinds = []
    for driven_m in np.arange(0.0, 120.0, 10.0):
        paint = paint_in(
            Road(SMALL).lines(1.7, dash_m=dash_m, phase_m=5.0 - driven_m).image()
        )
        votes = votes.add(paint) if paint else votes
        kinds.append(votes.kind)
    assert set(kinds[3:]) == {"dashed"}


@pytest.mark.parametrize(
    ("visible_m", "kind"), [(17.0, None), (6.0, "solid")], ids=["dash", "hidden road"]
)
def test_one_dash_seen_again_and_again_is_no_solid_line(visible_m, kind):
    """Nothing is seen of the gaps around it: unless no more of the line is in the
    image, it may be dashed.
    """
    dash = MarkingProfile(
        width_m=0.15,
        centre_m=0.0,
        gap=1.0,
        yellowness=0.0,
        visible_m=visible_m,
        seen_m=5.0,
        painted_m=5.0,
        bare_m=0.0,
    )
    assert kind_of(*[dash] * 6) == kind


def test_what_lies_farther_back_counts_less():
    yellow = MarkingProfile(
        0.35,
        0.0,
        gap=1.0,
        yellowness=0.9,
        visible_m=16.0,
        seen_m=15.0,
        painted_m=4.0,
        bare_m=10.0,
    )
    white = replace(yellow, width_m=0.12, yellowness=0.0, painted_m=15.0, bare_m=0.0)
    votes = NO_VOTES
    assert (votes.colour, votes.kind, votes.double) == (None, None, None)
    for _ in range(20):
        votes = votes.add(yellow)
    votes = votes.add(white)
    assert (votes.colour, votes.kind, votes.double) == ("yellow", "dashed", True)
    for _ in range(6):
        votes = votes.add(white)
    assert (votes.colour, votes.kind, votes.double) == ("white", "solid", False)
