"""The first seconds of the committed motorway in half its size, followed by the tracker and compared with the truth."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from benchmark.errors import FrameErrors, LaneTruth, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.evaluation import list_drives, read_truth
from benchmark.systems import lane_estimate
from lanes.camera import Camera, load_camera
from lanes.detect.lane import Lane
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import read_video

FPS = 25.0
# A step of a drive: its picture, seconds since the step before as the tracker is told, and which frame is shown.
Step = tuple[np.ndarray, float | None, int]


class Motorway:
    """Frames, camera and truth of so many seconds."""

    def __init__(self, seconds: float) -> None:
        drive = list_drives()["motorway"]
        camera = load_camera(drive.video.with_suffix(".yaml"))
        self.camera: Camera = camera.scaled((camera.width // 2, camera.height // 2))
        frames = read_video(drive.video, end_s=seconds)
        self.frames = [cv2.resize(frame, self.camera.size, interpolation=cv2.INTER_AREA) for frame in frames]
        self.truth: LaneTruth = read_truth(drive)

    def tracker(self) -> LaneTracker:
        return LaneTracker(self.camera, fps=FPS)

    def follow(self, steps: Iterable[Step]) -> tuple[list[Lane | None], FrameErrors]:
        """What the tracker says of each step, and how wrong that is of what is shown."""
        tracker, said, shown = self.tracker(), [], []
        for image, elapsed_s, frame in steps:
            said.append(tracker.update(image, elapsed_s=elapsed_s))
            shown.append(frame)
        estimates = DriveEstimates.from_frames([lane_estimate(lane) for lane in said], [0.0] * len(said))
        return said, frame_errors(estimates, self.truth.select(np.array(shown)))
