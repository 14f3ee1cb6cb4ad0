from dataclasses import replace

import numpy as np
import pytest

from classic.finder import Channel, nearest_line
from classic.fit import LineFit
from classic.memory import LineMemory
from classic.recipe import get_recipe
from tests.support.painted_roads import paint_view

A, C = get_recipe("hls_sobel"), get_recipe("best_channel")
UPRIGHT = LineFit((0.0, 0.0, 300.0), 1, (0, 719))


def upright(column, **options):
    return paint_view((1280, 720), [lambda y: column + 0 * y], **options)


def channel(binary, recipe=A, name="combined"):
    return Channel(name, binary, replace(recipe, warp_first=True), recipe.warp())


def test_windows_then_band_give_the_line_and_its_windows():
    found = channel(upright(300) | upright(1000)).line_from_windows(1)
    assert found.fit.columns(100) == pytest.approx(1000)
    assert len(found.windows) == 9
    assert found.channel == "combined"


def test_the_band_brings_in_what_the_windows_missed():
    """A dash far above a gap in a bend: the windows went straight on, the band follows the fit."""
    seen = channel(upright(300, rows=(400, 720)) | upright(370, rows=(200, 230), thickness_px=41))
    assert len(seen.line_near(UPRIGHT, 80).pixels) > len(seen.line_near(UPRIGHT, 60).pixels)


def test_a_binary_of_the_picture_is_warped():
    picture_binary = np.full((720, 1280), 255, np.uint8)
    picture_binary[:, 640:] = 0
    seen = Channel("combined", picture_binary, C, C.warp())
    np.testing.assert_array_equal(seen.binary, C.warp().warp(picture_binary))


def test_a_short_stub_and_an_empty_binary_are_no_line():
    assert channel(upright(300, rows=(600, 720))).line_from_windows(0).fit is None
    nothing = channel(np.zeros((720, 1280), np.uint8)).line_from_windows(0)
    assert nothing.fit is None
    assert nothing.windows == ()


def test_a_flooded_band_is_no_line_for_ransac():
    flood = upright(300, thickness_px=121)
    assert channel(flood, C).line_near(UPRIGHT, 75).fit is None
    assert channel(upright(300, thickness_px=61), C).line_near(UPRIGHT, 75).fit is not None


def test_of_several_channels_the_nearest_line_is_taken():
    channels = [channel(upright(c), name=str(c)) for c in (280, 310, 350)]
    memory = LineMemory(length=5).update(UPRIGHT)
    assert nearest_line(channels, memory, 0).channel == "310"
    # After a miss the windows look again, and may find a line far from the old one.
    lost = channel(upright(500), name="far")
    assert nearest_line([lost], memory.update(None), 0).fit.columns(0) == pytest.approx(500)
    assert nearest_line([lost], memory, 0).fit is None
