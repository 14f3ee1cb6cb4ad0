"""Detections for others to score: the two ego lines in pixels of the raw pictures, as TuSimple's JSON lines.

One line a picture: `raw_file`, `h_samples` (rows), `lanes` (columns of the left, then the right line; -2 where there is
none), `run_time` (milliseconds); further `state`, `confidence`, `offset_m`, `curvature_per_m`, and `frame` in videos.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.io.files import write_atomically
from lanes.io.images import PICTURE_SUFFIXES, read_image
from lanes.io.video.reader import inspect_video, read_timed_frames
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.detector import find_lane
from lanes.tracking.tracked_lane import TrackedLane
from lanes.tracking.tracker import LaneTracker

NO_POINT = -2.0
Progress = Callable[[int, int], None]


def detect_files(
    files: Iterable[Path],
    camera: Camera,
    rows: np.ndarray,
    *,
    sequence: bool = False,
    fps: float = 25.0,
    progress: Progress | None = None,
) -> list[dict]:
    """Find the ego lane in stills and videos.

    Parameters
    ----------
    files : iterable of Path
    camera : Camera
        With its pose. Rescaled to files of another size and the same shape.
    rows : ndarray of shape (R,)
        Frame rows at which the lines' columns are wanted.
    sequence : bool
        The stills are consecutive frames, `fps` a second; otherwise each is looked at on its own. The frames of a video
        always are consecutive.
    fps : float
    progress : callable, optional
        Called as progress(pictures done, pictures in all).

    Returns
    -------
    list of dict
        One for each picture, in order.

    Raises
    ------
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read.
    CameraError
        If the camera has no pose or cannot be rescaled to a file.
    """
    files = [Path(file) for file in files]
    videos = {file: inspect_video(file) for file in files if not _is_still(file)}
    total = len(files) - len(videos) + sum(info.frames for info in videos.values())
    finder = Finder(camera, rows, sequence=sequence, fps=fps)
    found: list[dict] = []
    for file in files:
        if file in videos:
            tracker = Finder(camera, rows, sequence=True, fps=videos[file].fps)
            pictures: Iterator[dict] = (
                {"raw_file": f"{file}#{frame.number}", "frame": frame.number} | tracker.detect(frame.image)
                for frame in read_timed_frames(file)
            )
        else:
            pictures = iter([{"raw_file": str(file)} | finder.detect(read_image(file))])
        try:
            for detection in pictures:
                found.append(detection)
                if progress:
                    progress(len(found), total)
        except CameraError as error:
            raise CameraError(f"{file}: {error}") from error
    return found


def write_detections(path: str | Path, detections: Iterable[dict]) -> Path:
    """Write JSON lines; the file appears under its name only when it is whole."""
    write_atomically(path, "".join(json.dumps(detection) + "\n" for detection in detections).encode())
    return Path(path)


def count_gaps(detections: Iterable[dict]) -> int:
    """How many frames are left out, because they are damaged, before the last one of each video."""
    last: dict[str, int] = {}
    counted = Counter()
    for detection in detections:
        if "frame" in detection:
            video = detection["raw_file"].rpartition("#")[0]
            last[video] = detection["frame"]
            counted[video] += 1
    return sum(number + 1 - counted[video] for video, number in last.items())


class Finder:
    """Detections in pictures of one camera: with a memory (`sequence`) or without."""

    def __init__(self, camera: Camera, rows: np.ndarray, *, sequence: bool = False, fps: float = 25.0) -> None:
        self.rows, self.sequence = np.asarray(rows), sequence
        self._camera_of = cache(lambda size: camera if size == camera.size else camera.scaled(size))
        self._view_of = cache(lambda size: BirdsEyeView(self._camera_of(size)))
        self._tracker_of = cache(lambda size: LaneTracker(self._camera_of(size), fps=fps))

    def detect(self, image: np.ndarray) -> dict:
        """The part of a detection that follows from the picture."""
        size = image.shape[1], image.shape[0]
        # building the view is no part of a frame's run time
        _ = self._tracker_of(size) if self.sequence else self._view_of(size)
        start = time.perf_counter()
        found = self._look(image, size)
        run_time_ms = 1000 * (time.perf_counter() - start)
        lanes = np.full((2, len(self.rows)), NO_POINT)
        if found.lane is not None:
            lanes = found.lane.pixels(self._camera_of(size), self.rows)
        return {
            "h_samples": [int(row) for row in self.rows],
            "lanes": np.round(lanes, 1).tolist(),
            "run_time": round(run_time_ms, 2),
            "state": found.state,
            "confidence": round(found.confidence, 4),
            "offset_m": _rounded(found.offset_m, 4),
            "curvature_per_m": _rounded(found.curvature_per_m, 7),
        }

    def _look(self, image: np.ndarray, size: tuple[int, int]) -> TrackedLane:
        if self.sequence:
            return self._tracker_of(size).update(image)
        return TrackedLane.from_still(find_lane(image, self._view_of(size)))


def _is_still(file: Path) -> bool:
    return file.suffix.lower() in PICTURE_SUFFIXES


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
