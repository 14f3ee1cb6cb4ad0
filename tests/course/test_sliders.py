"""Sliders of the notebook: the image follows them; without ipywidgets a message says how to install it."""

from __future__ import annotations

import sys

import cv2
import numpy as np
import pytest

from course.sliders import tune_threshold
from helpers import colour_channel
from tests.support.painted_roads import YELLOW, Road, dashcam

PICTURE = Road(dashcam()).line(lambda x: 1.7 + 0 * x, colour=YELLOW).image()


def saturation_mask(image, saturation, lightness=(0, 255)):
    """Pixels whose saturation and lightness (HLS) are in two ranges."""
    ranges = {"HLS S": saturation, "HLS L": lightness}
    return np.bitwise_and.reduce([cv2.inRange(colour_channel(image, name), *ends) for name, ends in ranges.items()])


def right_half(box) -> np.ndarray:
    """The right half of the picture in the box, RGB."""
    picture = cv2.imdecode(np.frombuffer(box.children[-1].value, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    return picture[:, picture.shape[1] // 2 :].astype(int)


def test_the_mask_follows_the_slider():
    pytest.importorskip("ipywidgets", reason="the sliders are optional")
    box = tune_threshold(PICTURE, saturation_mask, saturation=(0, 255, (100, 255)), lightness=(0, 255, (30, 255)))
    saturation, lightness, _ = box.children
    assert (saturation.description, saturation.value, lightness.value) == ("saturation", (100, 255), (30, 255))
    some = right_half(box)
    assert 0 < (some > 128).mean() < 0.1
    saturation.value = (0, 255)
    assert (right_half(box) > 128).mean() > 0.5
    saturation.value = (100, 255)
    np.testing.assert_array_equal(right_half(box), some)


def test_without_ipywidgets_a_message_says_how_to_install_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    assert tune_threshold(PICTURE, saturation_mask, saturation=(0, 255, (100, 255))) is None
    assert capsys.readouterr().out == (
        "The sliders need ipywidgets: run `pip install ipywidgets` and start the notebook again.\n"
    )
