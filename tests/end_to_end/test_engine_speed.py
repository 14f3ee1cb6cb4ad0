"""Speed of the tracker, relative to one cv2.undistort of a 1280x720 picture on one thread.

The two take turns, so that a slow machine slows both. Processor time is measured, because other jobs may be running.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from benchmark.speed import time_frames
from lanes.detect.lane import TRACKING
from lanes.detect.search import find_lane
from lanes.show.draw import draw_lane
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

FPS, FRAMES, ROUNDS = 25.0, 40, 5
DRIVE = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3))
PICTURES = [DRIVE.frame(frame / FPS) for frame in range(FRAMES)]


def undistorts(begin: Callable[[], Callable[[np.ndarray], object]], pictures: Sequence[np.ndarray]) -> float:
    """Mean time over the pictures in units of one cv2.undistort; `begin` returns the function for one round."""
    return time_frames(pictures, CAMERA, {"": begin}, rounds=ROUNDS)[""].mean


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
