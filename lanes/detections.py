"""Detections of the two ego lane lines in pixels of the raw pictures, as TuSimple JSON lines.

One JSON object per picture, with the keys of TuSimple: `raw_file`, `h_samples` (rows), `lanes` (columns of the left,
then of the right line; -2 for no point) and `run_time` (milliseconds). Additional keys: `state`, `confidence`,
`offset_m`, `curvature_per_m`, and `frame` for videos.
"""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from lanes.camera import Camera
from lanes.errors import CameraError
from lanes.files import write_atomically
from lanes.images import PICTURE_SUFFIXES, read_image
from lanes.stills import find_lane
from lanes.track.tracker import LaneTracker, TrackedLane
from lanes.video.reader import inspect_video, read_timed_frames

NO_POINT = -2.0


def detect_files(
    files: Iterable[Path],
    camera: Camera,
    rows: np.ndarray,
    *,
    sequence: bool = False,
    fps: float = 25.0,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict]:
    """Find the ego lane in stills and videos.

    Parameters
    ----------
    camera : Camera
        With its pose. Rescaled to files of another size with the same aspect ratio.
    rows : ndarray of shape (R,)
        Picture rows at which the columns of the lines are written.
    sequence : bool
        True: the stills are consecutive frames, `fps` per second. False: each still is processed independently. The
        frames of a video are always consecutive.
    progress : callable, optional
        Called as progress(pictures done, pictures in total).

    Returns
    -------
    list of dict
        One detection per picture, in order.

    Raises
    ------
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read.
    CameraError
        If the camera has no pose or cannot be rescaled to a file.
    """
    # a file that is named twice counts once
    files = list(dict.fromkeys(map(Path, files)))
    videos = {file: inspect_video(file) for file in files if file.suffix.lower() not in PICTURE_SUFFIXES}
    total = len(files) - len(videos) + sum(info.frames for info in videos.values())
    detector = LaneDetector(camera, rows, sequence=sequence, fps=fps)
    found: list[dict] = []
    for file in files:
        if file in videos:
            tracker = LaneDetector(camera, rows, sequence=True, fps=videos[file].fps)
            pictures: Iterator[dict] = (
                {"raw_file": f"{file}#{frame.number}", "frame": frame.number} | tracker.detect(frame.image)
                for frame in read_timed_frames(file)
            )
        else:
            # not evaluated here, but below, where errors get the file's name
            pictures = ({"raw_file": str(still)} | detector.detect(read_image(still)) for still in [file])
        try:
            for detection in pictures:
                found.append(detection)
                if progress:
                    progress(len(found), total)
        except CameraError as error:
            raise CameraError(f"{file}: {error}") from error
    return found


def write_detections(path: str | Path, detections: Iterable[dict]) -> Path:
    """Write JSON lines atomically; returns the path.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_atomically(path, "".join(json.dumps(detection) + "\n" for detection in detections).encode())
    return Path(path)


def count_missing_frames(detections: Iterable[dict]) -> int:
    """Number of video frames without a detection, because they are damaged, before the last frame of each video."""
    frames = defaultdict(list)
    for detection in detections:
        if "frame" in detection:
            frames[detection["raw_file"].rpartition("#")[0]].append(detection["frame"])
    return sum(numbers[-1] + 1 - len(numbers) for numbers in frames.values())


class LaneDetector:
    """Detects the lane in pictures of one camera, tracked from picture to picture (`sequence`) or independently.

    Parameters as in `detect_files`.
    """

    def __init__(self, camera: Camera, rows: np.ndarray, *, sequence: bool = False, fps: float = 25.0) -> None:
        self._camera, self._rows, self._sequence, self._fps = camera, np.asarray(rows), sequence, fps
        # Scaled camera and lane finder for each picture size so far.
        self._finders: dict[tuple[int, int], tuple[Camera, Callable[[np.ndarray], TrackedLane]]] = {}

    def detect(self, image: np.ndarray) -> dict:
        """The detection in a picture of shape (height, width, 3), uint8, RGB, without the file's name.

        Raises
        ------
        PictureError
            If the picture is not RGB.
        CameraError
            If the camera has no pose or another aspect ratio.
        """
        size = image.shape[1], image.shape[0]
        # Made before the clock starts: the bird's-eye view is not part of the run time of a frame.
        if size not in self._finders:
            self._finders[size] = self._make_finder(size)
        camera, find = self._finders[size]
        start_s = time.perf_counter()
        found = find(image)
        return as_detection(found, camera, self._rows, time.perf_counter() - start_s)

    def _make_finder(self, size: tuple[int, int]) -> tuple[Camera, Callable[[np.ndarray], TrackedLane]]:
        """The camera for pictures of `size` (width, height), and a function that finds the lane in one of them."""
        camera = self._camera if size == self._camera.size else self._camera.scaled(size)
        if self._sequence:
            return camera, LaneTracker(camera, fps=self._fps).update
        return camera, lambda image: TrackedLane.from_still(find_lane(image, camera))


def as_detection(found: TrackedLane, camera: Camera, rows: np.ndarray | range, run_time_s: float) -> dict:
    """The detection in one image, without the file's name."""
    rows, lane = np.asarray(rows), found.lane
    lanes = np.full((2, len(rows)), NO_POINT) if lane is None else lane.pixels(camera, rows)
    return {
        "h_samples": rows.tolist(),
        "lanes": np.round(lanes, 1).tolist(),
        "run_time": round(1000 * run_time_s, 2),
        "state": found.state,
        "confidence": round(found.confidence, 4),
        "offset_m": lane and round(lane.offset_m, 4),
        "curvature_per_m": lane and round(lane.curvature_per_m, 7),
    }
