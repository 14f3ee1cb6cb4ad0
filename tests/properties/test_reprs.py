"""Results in a notebook: a short `repr` in words."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lanes.stills import find_lane
from lanes.tracking.tracker import LaneTracker
from tests.support.painted_roads import YELLOW, Road, dashcam

CAMERA = dashcam(width=1280)
# The car is 0.35 m right of the centre of a lane 3.6 m wide that bends left with a radius of 400 m.
OFFSET_M, BEND = -0.35, 1 / 400


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    road = Road(CAMERA)
    for side, colour in ((1, YELLOW), (-1, (225, 225, 220))):
        road.line(lambda x, s=side: s * 1.8 - OFFSET_M + BEND * x**2 / 2, colour=colour)
    return road.image()


def test_a_lane_gives_confidence_offset_bend_and_lines(image):
    lane = find_lane(image, CAMERA)
    numbers = r"0\.3[3-7] ± 0\.\d\d m right of centre, bends left, R (39|40|41)0 m, 3\.\d\d ± 0\.\d\d m wide"
    assert re.fullmatch(rf"Lane\(found, confidence 0\.\d\d, {numbers}\)", repr(lane))
    rows = lane.summary()
    assert re.fullmatch(
        r"2\.1\d ± 0\.\d\d m left, yellow solid, paint on \d+% of its rows, up to \d+ m", rows["left line"]
    )
    assert re.fullmatch(r"1\.4\d ± 0\.\d\d m right, white solid, paint .*", rows["right line"])


def test_a_tracker_gives_its_state(image):
    tracker = LaneTracker(CAMERA, fps=20, speed_mps=25.0)
    assert re.fullmatch(r"LaneTracker\(1280x720 px, 20 \w+ a second, lost\)", repr(tracker))
    for _ in range(4):
        lane = tracker.update(image)
    assert repr(tracker).endswith("tracking)")
    assert lane.summary()["speed"] == "90 km/h"
    assert lane.summary()["offset"] in repr(lane)
