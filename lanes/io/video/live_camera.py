"""Frames from a live camera, through OpenCV."""

from __future__ import annotations

import time
from collections.abc import Iterator

import cv2

from lanes.io.video.container import VideoError
from lanes.io.video.reader import TimedFrame

# For cameras that do not say how many frames they give in a second.
USUAL_FPS = 30.0


class LiveCamera:
    """A camera of this computer, by its number (0 is the first); use it in a `with` block.

    Attributes
    ----------
    size : tuple of int
        (width, height) of its frames.
    fps : float
        Frames a second that it promises.

    Raises
    ------
    VideoError
        If there is no such camera, or it gives no frame.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        # OpenCV tells about each driver that it tries; one sentence is enough.
        level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            self._capture = cv2.VideoCapture(index)
            done, self._first = self._capture.read() if self._capture.isOpened() else (False, None)
        finally:
            cv2.utils.logging.setLogLevel(level)
        if not done:
            self._capture.release()
            raise VideoError(
                f"camera {index}: cannot be opened or gives no frame; see that it is connected and that no other "
                "program uses it, or name a video file."
            )
        self.size = self._first.shape[1], self._first.shape[0]
        self.fps = float(self._capture.get(cv2.CAP_PROP_FPS)) or USUAL_FPS

    def __enter__(self) -> LiveCamera:
        return self

    def __exit__(self, *_: object) -> None:
        self._capture.release()

    def frames(self) -> Iterator[TimedFrame]:
        """Frames as RGB, with the seconds since the first of them, until the camera gives no more."""
        began_s, number, frame = time.monotonic(), 0, self._first
        while frame is not None:
            yield TimedFrame(number, time.monotonic() - began_s, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
            number += 1
            _, frame = self._capture.read()
