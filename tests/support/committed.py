"""Committed videos in half their size, followed by the tracker and compared with their
truth.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from benchmark.errors import FrameErrors, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.evaluation import list_drives, read_truth
from benchmark.systems import lane_estimate
from lanes.camera.model import load_camera
from lanes.detect.lane import Lane
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import read_timed_frames

FPS = 25.0
# A step of a drive: its picture, seconds since the step before as the tracker is told, and which frame is shown.
Step = tuple[np.ndarray, float | None, int]


class CommittedDrive:
    """Frames, camera and truth of a part of a committed video."""

    def __init__(self, scene: str, *, start_s: float = 0.0, end_s: float) -> None:
        drive = list_drives()[scene]
        self.camera = load_camera(drive.video.with_suffix(".yaml")).scaled((640, 360))
        timed = list(read_timed_frames(drive.video, start_s=start_s, end_s=end_s))
        self.frames = [
            cv2.resize(frame.image, self.camera.size, interpolation=cv2.INTER_AREA)
            for frame in timed
        ]
        self.truth = read_truth(drive).select(
            np.array([frame.number for frame in timed])
        )

    def tracker(self) -> LaneTracker:
        return LaneTracker(self.camera, fps=FPS)

    def follow(self, steps: Iterable[Step]) -> tuple[list[Lane | None], FrameErrors]:
        """What the tracker says of each step, and how wrong that is of what is
        shown.
        """
        tracker, said, shown = self.tracker(), [], []
        for image, elapsed_s, frame in steps:
            said.append(tracker.update(image, elapsed_s=elapsed_s))
            shown.append(frame)
        estimates = DriveEstimates.from_frames(
            [lane_estimate(lane) for lane in said], [0.0] * len(said)
        )
        return said, frame_errors(estimates, self.truth.select(np.array(shown)))
