"""What never moves in a drive is no marking of the road: places in samples; guide lines and bonnets."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import pytest

from benchmark.errors import FrameErrors
from lanes.detect.lane import TRACKING, Lane
from lanes.tracking.static_pattern import StaticPattern
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.motorway import FPS, Motorway
from tests.support.painted_drive import CAMERA, PaintedDrive, Stripe, straight_road
from tests.support.static_objects import draw_guide_lines, draw_striped_bonnet

SMALL = CAMERA.scaled((640, 360))
# Time to collect samples, to lose the false lane and to confirm the true one; and the time that is followed.
LEARNT_S, SECONDS = 6.0, 9.0


ROWS, COLUMNS = 60, 400
# Places that are the same in every sample: a line down the picture.
ROW = np.arange(ROWS)
STAYS = ROW, 100 + ROW // 3


def drive(samples: int, *, line_stays: bool = True, pattern: StaticPattern | None = None) -> StaticPattern:
    """Samples of the line that stays, of a line of the road that sways, and of other stripes."""
    rng, pattern = np.random.default_rng(samples), pattern or StaticPattern(ROWS, COLUMNS)
    for _ in range(samples):
        road = np.full(ROWS, round(250 + rng.normal(0, 4)))
        stays = STAYS if line_stays else ([], [])
        row, column = np.hstack([stays, (ROW, road), rng.integers(0, ((ROWS,), (COLUMNS,)), (2, 60))]).astype(int)
        pattern.add(row, column)
    return pattern


def test_what_stays_is_static_up_to_one_column_aside():
    for shift, static in ((-1, True), (0, True), (1, True), (-3, False), (3, False)):
        assert drive(20).is_static(ROW, STAYS[1] + shift).all() == static


def test_what_was_static_and_is_gone_is_forgotten():
    assert not drive(60, line_stays=False, pattern=drive(300)).is_static(*STAYS).any()


def test_nothing_becomes_static_while_the_car_stands():
    rng, pattern = np.random.default_rng(1), StaticPattern(ROWS, COLUMNS)
    for _ in range(100):
        # noise hides some stripes
        shown = rng.random(ROWS) < 0.9
        pattern.add(ROW[shown], STAYS[1][shown])
    assert not pattern.is_static(*STAYS).any()


@pytest.fixture(scope="module")
def motorway() -> Motorway:
    return Motorway(SECONDS)


def follow(motorway: Motorway, draw: Callable[[np.ndarray], np.ndarray]) -> tuple[list[Lane | None], FrameErrors]:
    return motorway.follow((draw(frame), None, number) for number, frame in enumerate(motorway.frames))


@pytest.mark.slow
@pytest.mark.parametrize(
    "draw", [partial(draw_guide_lines, spread=0.2), partial(draw_guide_lines, spread=0.5), draw_striped_bonnet]
)
def test_the_lane_is_right_once_it_is_known_what_never_moves(motorway, draw):
    said, errors = follow(motorway, draw)
    learnt = round(LEARNT_S * FPS)
    assert errors.correct[learnt:].mean() >= 0.98
    assert not errors.confident_and_wrong[learnt:].any()
    assert said[-1].state == TRACKING and said[-1].confidence >= 0.9


@pytest.mark.slow
def test_solid_lines_of_a_road_on_which_nothing_sways_are_kept():
    """As in some simulators: straight ahead in the middle of the lane, without pitch motion."""
    drive = PaintedDrive(straight_road(), (Stripe(1.8), Stripe(-1.8)), motion=Motion(speed_mps=25.0), camera=SMALL)
    tracker = LaneTracker(SMALL, fps=FPS)
    said = [tracker.update(drive.frame(number / FPS)) for number in range(round(2 * LEARNT_S * FPS))]
    assert all(lane.state == TRACKING for lane in said[3:])
    assert said[-1].left.seen and said[-1].right.seen


@pytest.mark.slow
def test_the_lane_is_kept_while_the_car_stands(motorway):
    frames, tracker, rng = motorway.frames, motorway.tracker(), np.random.default_rng(0)
    moving = [tracker.update(frame) for frame in frames[:50]]
    for _ in range(round(10 * FPS)):
        noise = rng.normal(0, 2, frames[49].shape).astype(np.int16)
        standing = tracker.update(cv2.add(frames[49], noise, dtype=cv2.CV_8U))
    assert standing.state == TRACKING
    assert abs(standing.offset_m - moving[-1].offset_m) < 0.05
    assert all(tracker.update(frame).state == TRACKING for frame in frames[50:])


@pytest.mark.slow
def test_what_never_moves_is_forgotten_between_two_drives(motorway):
    tracker, fresh = motorway.tracker(), motorway.tracker()
    for frame in motorway.frames[:150]:
        tracker.update(draw_guide_lines(frame))
    tracker.reset()
    for frame in motorway.frames[:20]:
        again, first = tracker.update(draw_guide_lines(frame)), fresh.update(draw_guide_lines(frame))
        assert again.state == first.state and again.confidence == first.confidence
