"""The engine against the yardstick of this project: one cv2.undistort of a whole 1280x720 picture, on one thread.

Yardstick and frame take turns, so that a slow machine slows both. Processor time is what counts: others may be at work.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from drives import CAMERA, PaintedDrive, lane_lines, s_bend

from lanes.metric.lane import find_lane
from lanes.metric.lane_overlay import draw_found, draw_tracked
from lanes.metric.roadview import RoadView
from lanes.metric.tracked import TRACKING
from lanes.metric.tracker import LaneTracker
from lanes.scenes.render import Motion
from lanes.threads import one_thread

FPS, FRAMES, WARM_UP = 25.0, 40, 8
DRIVE = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3))
PICTURES = [DRIVE.frame(frame / FPS) for frame in range(FRAMES)]


@pytest.fixture(autouse=True)
def on_one_thread() -> Iterator[None]:
    with one_thread():
        yield


def undistorts(work: Callable[[np.ndarray], object]) -> float:
    """How many yardsticks `work` costs for a picture: the median over pairs, after a few to warm up."""
    ratios = []
    for image in PICTURES:
        start = time.thread_time()
        cv2.undistort(image, CAMERA.matrix, CAMERA.distortion)
        half = time.thread_time()
        work(image)
        ratios.append((time.thread_time() - half) / (half - start))
    return float(np.median(ratios[WARM_UP:]))


def test_a_followed_frame_costs_less_than_undistorting_it():
    tracker = LaneTracker(CAMERA, fps=FPS)
    assert undistorts(lambda image: draw_tracked(image, tracker.update(image), CAMERA)) < 0.85
    assert tracker.update(PICTURES[-1]).state == TRACKING


def test_a_picture_of_which_nothing_is_known_costs_little_more():
    view = RoadView(CAMERA)
    assert undistorts(lambda image: draw_found(image, find_lane(image, view), CAMERA)) < 1.85
