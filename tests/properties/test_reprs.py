"""Results in a notebook: a short `repr` in words, and an HTML table of the same content."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lanes.stills import find_lane
from lanes.track.tracker import LaneTracker, TrackedLane
from tests.support.painted_roads import YELLOW, Road, dashcam

CAMERA = dashcam(width=1280)
# The car is 0.35 m right of the centre of a lane 3.6 m wide that bends left with a radius of 400 m.
OFFSET_M, BEND = -0.35, 1 / 400


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    road = Road(CAMERA)
    for side, colour in ((1, YELLOW), (-1, (225, 225, 220))):
        road.line(lambda x, s=side: s * 1.8 - OFFSET_M + BEND * x**2 / 2, colour=colour)
    return road.image()


def rows_of(html: str) -> dict[str, str]:
    return dict(re.findall(r"<tr><th>(.*?)</th><td>(.*?)</td></tr>", html))


def test_a_lane_gives_the_offset_and_the_bend(picture):
    lane = find_lane(picture, CAMERA)
    assert re.fullmatch(
        r"Lane\(0\.3[3-7] ± 0\.\d\d m right of centre, bends left, R (39|40|41)0 m, 3\.\d\d ± 0\.\d\d m wide\)",
        repr(lane),
    )
    rows = rows_of(lane._repr_html_())
    assert list(rows) == ["offset", "bend", "heading", "width", "left line", "right line"]
    assert re.fullmatch(r"2\.1\d ± 0\.\d\d m left, paint on \d+% of its rows, up to \d+ m", rows["left line"])
    assert re.fullmatch(r"1\.4\d ± 0\.\d\d m right, paint .*", rows["right line"])


def test_an_invisible_line_is_marked_as_inferred():
    only_left = Road(CAMERA).line(lambda x: 1.8 + 0 * x).image()
    lane = find_lane(only_left, CAMERA)
    assert lane.summary()["right line"].endswith("inferred from other lines")


def test_a_lost_lane_has_no_numbers():
    assert repr(TrackedLane("lost")) == "TrackedLane(lost, confidence 0.00, None)"
    assert rows_of(TrackedLane("lost")._repr_html_()) == {"state": "lost"}


def test_a_tracker_gives_its_state_and_speed(picture):
    tracker = LaneTracker(CAMERA, fps=20, speed_mps=25.0)
    assert repr(tracker) == "LaneTracker(1280x720 px, 20 pictures a second, lost)"
    for _ in range(4):
        tracked = tracker.update(picture)
    assert repr(tracker) == "LaneTracker(1280x720 px, 20 pictures a second, tracking)"
    rows = rows_of(tracker._repr_html_())
    assert rows["speed"] == "90 km/h"
    assert rows["state"] == "tracking"
    assert rows["offset"] == tracked.summary()["offset"] in repr(tracked)
    assert tracked.confidence > 0.5
    assert f"confidence {tracked.confidence:.2f}" in repr(tracked)
