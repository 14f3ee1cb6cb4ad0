"""What never moves in a drive is no marking of the road: places in samples; guide lines and bonnets."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import pytest

from lanes.detect.lane import TRACKING
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.motorway import FPS, Motorway
from tests.support.painted_drive import CAMERA, PaintedDrive, Stripe, straight_road
from tests.support.static_objects import draw_guide_lines, draw_striped_bonnet

SMALL = CAMERA.scaled((640, 360))
# Time to collect samples, to lose the false lane and to confirm the true one; and the time that is followed.
LEARNT_S, SECONDS = 6.0, 9.0


@pytest.fixture(scope="module")
def motorway() -> Motorway:
    return Motorway(SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize("draw", [partial(draw_guide_lines, spread=0.5), draw_striped_bonnet])
def test_the_lane_is_right_once_it_is_known_what_never_moves(motorway, draw):
    said, errors = motorway.follow((draw(frame), None, number) for number, frame in enumerate(motorway.frames))
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
