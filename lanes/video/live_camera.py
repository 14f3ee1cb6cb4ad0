"""Frames of a live camera, through OpenCV."""

from __future__ import annotations

import time
from collections.abc import Iterator

import cv2

from lanes.errors import VideoError
from lanes.video.reader import TimedFrame

# For cameras that do not report their frame rate.
DEFAULT_FPS = 30.0


class LiveCamera:
    """A camera of this computer by its index (0 is the first); use it in a `with` block.

    `size` is the (width, height) of its frames, `fps` their nominal rate. Raises VideoError if the camera does not
    exist or delivers no frame.
    """

    def __init__(self, index: int) -> None:
        # OpenCV logs a warning for every driver that it tries.
        level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            self._capture = cv2.VideoCapture(index)
            done, first = self._capture.read() if self._capture.isOpened() else (False, None)
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not done or first is None:
            self._capture.release()
            raise VideoError(
                f"camera {index}: cannot be opened or gives no frame; check that it is connected and that no "
                "other program uses it, or name a video file."
            )
        self._first = first
        self.size = first.shape[1], first.shape[0]
        self.fps = float(self._capture.get(cv2.CAP_PROP_FPS)) or DEFAULT_FPS

    def __enter__(self) -> LiveCamera:
        return self

    def __exit__(self, *_: object) -> None:
        self._capture.release()

    def frames(self) -> Iterator[TimedFrame]:
        """Yield RGB frames, with seconds since the first frame, until the camera delivers no more."""
        began_s, number, frame = time.monotonic(), 0, self._first
        while frame is not None:
            yield TimedFrame(number, time.monotonic() - began_s, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
            number += 1
            _, frame = self._capture.read()
