"""What never moves in a drive is no marking of the road: places in samples; guide lines, bonnets and captions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest

from benchmark.errors import FrameErrors, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.evaluation import read_truth
from benchmark.scored_drive import list_drives
from benchmark.systems import lane_estimate
from lanes.camera import Camera, load_camera
from lanes.detect.lane import TRACKING, Lane
from lanes.track import static_pattern
from lanes.track.static_pattern import StaticPattern
from lanes.track.tracker import LaneTracker
from lanes.video.reader import read_video
from simulator.rendering.drive import Motion
from tests.support.painted_drive import CAMERA, PaintedDrive, Stripe, straight_road
from tests.support.static_objects import draw_caption, draw_guide_lines, draw_striped_bonnet

FPS = 25.0
SMALL = CAMERA.scaled((640, 360))
# Time to collect samples, to lose the false lane and to confirm the true one; and the time that is followed.
LEARNT_S, SECONDS = 6.0, 9.0


ROWS, COLUMNS = 60, 400
# Places that are the same in every sample: a line down the picture.
ROW = np.arange(ROWS)
STAYS = ROW, 100 + ROW // 3


def sample(rng: np.random.Generator, *, sway: float = 0.0, others: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """The static line, a solid line of the road that sways by a standard deviation in columns, and other stripes."""
    road = np.full(ROWS, 250 + rng.normal(0, sway)).round().astype(int)
    return (
        np.concatenate([ROW, ROW, rng.integers(0, ROWS, others)]),
        np.concatenate([STAYS[1], road, rng.integers(0, COLUMNS, others)]),
    )


def drive(samples: int, **options) -> StaticPattern:
    rng, pattern = np.random.default_rng(0), StaticPattern(ROWS, COLUMNS)
    for _ in range(samples):
        pattern.add(*sample(rng, **options))
    return pattern


def test_places_beside_are_static_up_to_one_column():
    pattern = drive(20, sway=4)
    for shift, static in ((-1, True), (1, True), (-3, False), (3, False)):
        assert pattern.is_static(ROW, STAYS[1] + shift).all() == static


def test_what_was_static_and_is_gone_is_forgotten():
    rng, pattern = np.random.default_rng(2), drive(30, sway=4)
    for _ in range(60):
        row, column = sample(rng, sway=4)
        pattern.add(row[ROWS:], column[ROWS:])
    assert not pattern.is_static(*STAYS).any()


def test_pictures_without_stripes_and_places_at_the_border_are_accepted():
    pattern = StaticPattern(ROWS, COLUMNS)
    for _ in range(3):
        pattern.add(np.empty(0, int), np.empty(0, int))
        pattern.add(ROW, np.full(ROWS, COLUMNS - 1))
        pattern.add(ROW, np.zeros(ROWS, int))
    assert not pattern.is_static(ROW, np.zeros(ROWS, int)).any()


@pytest.fixture(scope="module")
def motorway() -> tuple[Camera, list[np.ndarray]]:
    """The committed motorway in half its size."""
    video = list_drives()["motorway"].video
    camera = load_camera(video.with_suffix(".yaml"))
    camera = camera.scaled((camera.width // 2, camera.height // 2))
    return camera, [
        cv2.resize(frame, camera.size, interpolation=cv2.INTER_AREA) for frame in read_video(video, end_s=SECONDS)
    ]


def follow(motorway, draw: Callable[[np.ndarray], np.ndarray]) -> tuple[list[Lane | None], FrameErrors]:
    camera, frames = motorway
    tracker = LaneTracker(camera, fps=FPS)
    said = [tracker.update(draw(frame)) for frame in frames]
    estimates = DriveEstimates.from_frames([lane_estimate(lane) for lane in said], [0.0] * len(said))
    return said, frame_errors(estimates, read_truth(list_drives()["motorway"]).select(np.arange(len(said))))


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
def test_without_the_static_pattern_the_guide_lines_are_the_lane(motorway, monkeypatch):
    """The drawn lines mislead: otherwise the test before would show nothing."""
    monkeypatch.setattr(static_pattern, "STATIC", replace(static_pattern.STATIC, min_samples=np.inf))
    _, errors = follow(motorway, partial(draw_guide_lines, spread=0.2))
    assert errors.correct[round(LEARNT_S * FPS) :].mean() < 0.7


@pytest.mark.slow
def test_a_caption_does_not_matter(motorway):
    _, errors = follow(motorway, lambda frame: draw_caption(frame, second=7))
    assert errors.correct.all()


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
    camera, frames = motorway
    tracker, rng = LaneTracker(camera, fps=FPS), np.random.default_rng(0)
    moving = [tracker.update(frame) for frame in frames[:50]]
    for _ in range(round(10 * FPS)):
        noise = rng.normal(0, 2, frames[49].shape).astype(np.int16)
        standing = tracker.update(cv2.add(frames[49], noise, dtype=cv2.CV_8U))
    assert standing.state == TRACKING
    assert abs(standing.offset_m - moving[-1].offset_m) < 0.05
    assert all(tracker.update(frame).state == TRACKING for frame in frames[50:])


@pytest.mark.slow
def test_what_never_moves_is_forgotten_between_two_drives(motorway):
    camera, frames = motorway
    tracker = LaneTracker(camera, fps=FPS)
    for frame in frames[:150]:
        tracker.update(draw_guide_lines(frame))
    tracker.reset()
    fresh = LaneTracker(camera, fps=FPS)
    for frame in frames[:20]:
        again, first = tracker.update(draw_guide_lines(frame)), fresh.update(draw_guide_lines(frame))
        assert again.state == first.state and again.confidence == first.confidence
