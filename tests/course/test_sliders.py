"""Sliders of the notebook: the image follows them; a message without ipywidgets."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from course.sliders import make_slider, tune_threshold
from helpers import colour_channel
from tests.support.painted_roads import YELLOW, Road, dashcam

PICTURE = Road(dashcam()).line(lambda x: 1.7 + 0 * x, colour=YELLOW).image()


def saturation_mask(image, saturation, lightness=(0, 255)):
    """Pixels whose saturation and lightness (HLS) are in two ranges."""
    saturation_channel = colour_channel(image, "HLS S")
    lightness_channel = colour_channel(image, "HLS L")
    saturated = cv2.inRange(saturation_channel, saturation[0], saturation[1])
    not_dark = cv2.inRange(lightness_channel, lightness[0], lightness[1])
    return saturated & not_dark


def share_shown(box) -> float:
    """Share of the right half of the picture in the box that is white."""
    png = np.frombuffer(box.children[-1].value, np.uint8)
    picture = cv2.imdecode(png, cv2.IMREAD_COLOR)
    made = picture[:, picture.shape[1] // 2 :]
    return (made > 128).mean()


def test_the_mask_follows_the_slider():
    pytest.importorskip("ipywidgets", reason="the sliders are optional")
    box = tune_threshold(
        PICTURE,
        saturation_mask,
        saturation=(0, 255, (100, 255)),
        lightness=(0, 255, (30, 255)),
    )
    saturation, lightness, _ = box.children
    assert saturation.description == "saturation"
    assert saturation.value == (100, 255)
    assert lightness.value == (30, 255)

    share = share_shown(box)
    assert 0 < share < 0.1
    saturation.value = (0, 255)
    assert share_shown(box) > 0.5
    saturation.value = (100, 255)
    assert share_shown(box) == share


@pytest.mark.parametrize(
    ("start", "kind"),
    [
        (5, "IntSlider"),
        ((2, 5), "IntRangeSlider"),
        (0.5, "FloatSlider"),
        ((0.5, 2.0), "FloatRangeSlider"),
    ],
)
def test_a_slider_has_the_type_of_its_start(start, kind):
    pytest.importorskip("ipywidgets", reason="the sliders are optional")
    slider = make_slider("level", 0, 10, start)
    assert type(slider).__name__ == kind
    assert slider.value == start


def test_without_ipywidgets_a_message_says_how_to_install_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    sliders = {"saturation": (0, 255, (100, 255))}
    assert tune_threshold(PICTURE, saturation_mask, **sliders) is None
    assert capsys.readouterr().out == (
        "The sliders need ipywidgets: run `pip install ipywidgets` and start the "
        "notebook again.\n"
    )
