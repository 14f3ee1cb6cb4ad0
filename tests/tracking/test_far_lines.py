"""Far lines of tracked lanes: stated once two searches in a row found them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from lanes.detect.search import find_lane
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import (
    DASH_M,
    SMALL,
    PaintedDrive,
    Stripe,
    straight_road,
)

FPS = 12.5
FRAMES = 40
LANE_LINES = (Stripe(1.8), Stripe(-1.8, dash_m=DASH_M))


def drive_with(*lines: Stripe) -> PaintedDrive:
    motion = Motion(speed_mps=20.0)
    return PaintedDrive(straight_road(), LANE_LINES + lines, motion, camera=SMALL)


WITHOUT = drive_with()
WITH = drive_with(Stripe(5.4))


def far_lines(shown: Iterable[int]) -> tuple[np.ndarray, np.ndarray]:
    """Whether each frame was searched, and whether a far line on the left is stated.

    The far line is in the frames `shown`.
    """
    tracker = LaneTracker(SMALL, fps=FPS)
    searched = []
    stated = []
    for k in range(FRAMES):
        drive = WITH if k in shown else WITHOUT
        lane = tracker.update(drive.frame(k / FPS))
        left, right = lane.adjacent
        assert right is None
        searched.append(tracker.search is not None)
        stated.append(left is not None)
    return np.array(searched), np.array(stated)


@pytest.fixture(scope="module")
def always() -> tuple[np.ndarray, np.ndarray]:
    return far_lines(range(FRAMES))


@pytest.fixture(scope="module")
def searches(always) -> np.ndarray:
    """The frames that are searched; the third and those after it are a second apart."""
    return np.flatnonzero(always[0])


def test_a_far_line_is_stated_once_two_searches_found_it(always, searches):
    _, stated = always
    first = searches[1]
    assert not stated[:first].any()
    assert stated[first:].all()


def test_what_a_single_search_takes_for_a_far_line_is_not_stated(searches):
    shown = range(searches[2], searches[3])
    left, _ = find_lane(WITH.frame(shown[0] / FPS), SMALL).adjacent
    assert left is not None

    searched, stated = far_lines(shown)

    np.testing.assert_array_equal(np.flatnonzero(searched), searches)
    assert not stated.any()


def test_a_far_line_that_a_search_does_not_find_is_no_longer_stated(searches):
    _, stated = far_lines(range(searches[3]))
    assert stated[searches[2] : searches[3]].all()
    assert not stated[searches[3] :].any()
