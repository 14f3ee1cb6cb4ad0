"""Speed of the tracker, relative to one cv2.undistort of a 1280x720 picture on one thread.

The two take turns, so that a slow machine slows both. Processor time is measured, because other jobs may be running.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import cv2
import numpy as np
import pytest

from lanes.detect.lane import TRACKING
from lanes.detect.search import find_lane
from lanes.draw import draw_lane
from lanes.images import opencv_threads
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

FPS, FRAMES, WARM_UP, ROUNDS = 25.0, 40, 8, 5
DRIVE = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3))
PICTURES = [DRIVE.frame(frame / FPS) for frame in range(FRAMES)]


@pytest.fixture(autouse=True)
def on_one_thread() -> Iterator[None]:
    with opencv_threads(1):
        yield


def undistorts(begin: Callable[[], Callable[[np.ndarray], object]], pictures: Sequence[np.ndarray]) -> float:
    """Mean time of `begin()(picture)` over the pictures after WARM_UP, in units of one cv2.undistort.

    `begin` returns the function for one round, which may draw on the pictures. The fastest of the rounds of each
    picture counts, for both.
    """
    seconds = np.empty((ROUNDS, 2, len(pictures)))
    for number in range(ROUNDS):
        work = begin()
        for at, (image, picture) in enumerate(zip(PICTURES, pictures, strict=False)):
            own = picture.copy()
            start = time.thread_time()
            cv2.undistort(image, CAMERA.matrix, CAMERA.distortion)
            half = time.thread_time()
            work(own)
            seconds[number, :, at] = half - start, time.thread_time() - half
    unit_s, work_s = seconds.min(axis=0)[:, WARM_UP:].mean(axis=1)
    return float(work_s / unit_s)


def test_a_tracked_frame_costs_less_than_undistorting_it():
    """In a bend of 450 m: 0.54 to 0.55, and up to 0.83 on a machine that others use as well."""
    states = []

    def work(picture: np.ndarray, tracker: LaneTracker) -> None:
        found = tracker.update(picture)
        draw_lane(picture, found, CAMERA, onto=picture)
        states.append(found and found.state)

    assert undistorts(lambda: partial(work, tracker=LaneTracker(CAMERA, fps=FPS)), PICTURES) < 1
    assert states.count(TRACKING) > 0.9 * len(states)


def test_a_still_costs_about_six_undistortions():
    """5.7 on a machine that others use as well; most of it is the network."""

    def work(image: np.ndarray) -> None:
        draw_lane(image, find_lane(image, CAMERA), CAMERA, onto=image)

    assert undistorts(lambda: work, PICTURES[: FRAMES // 2]) < 9.0
