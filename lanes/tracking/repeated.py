"""Whether an image repeats the last one: a copied frame, or a camera that hangs.

A codec changes the pixels of a copy a little. In a copy the edges stay where they are,
while they move between the images of a drive. A car that brakes comes to rest over
several images, so that its first still image follows slow ones and is no copy.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np

# Every eighth row tells images apart, and costs little.
ROW_STEP = 8
# Grey levels from a pixel to the next one at an edge.
EDGE_LEVELS = 15
# Difference at the edges relative to their height, about the pixels by which they
# moved: at most of a copy, and at least of a drive. On two real clips that a program
# had filled up with copies, of which a codec made others, copies have up to 0.04, all
# other images from 0.29 on.
COPY_PX = 0.06
DRIVE_PX = 0.25
# Number of images whose median is that of the drive.
IMAGES = 5
# Of a slower camera a car may come to rest from one image to the next.
MAX_STEP_S = 0.1


class RepeatedImages:
    """Compares each image with the last one that was no copy."""

    def __init__(self) -> None:
        self._last: np.ndarray | None = None
        self._moved_px: deque[float] = deque(maxlen=IMAGES)

    def repeats(self, image: np.ndarray, elapsed_s: float) -> bool:
        """Whether an image (height, width, 3) repeats the one before it, `elapsed_s`
        earlier.
        """
        rows = image[::ROW_STEP]
        if self._last is not None:
            if np.array_equal(rows, self._last):
                return True
            moved_px = _edge_motion_px(self._last, rows)
            if self._is_copy(moved_px, elapsed_s):
                return True
            self._moved_px.append(moved_px)
        # a copy: cameras may write the next image into the same array
        self._last = rows.copy()
        return False

    def _is_copy(self, moved_px: float, elapsed_s: float) -> bool:
        """Whether the edges stand still, although they moved in the images before."""
        if len(self._moved_px) < IMAGES or not elapsed_s <= MAX_STEP_S:
            return False
        return moved_px < COPY_PX and float(np.median(self._moved_px)) >= DRIVE_PX


def _edge_motion_px(before: np.ndarray, now: np.ndarray) -> float:
    """Mean difference of two images (rows, columns, 3) at the edges of the first one,
    relative to that from there to the next column; infinite without edges.
    """
    green = np.ascontiguousarray(before[..., 1])
    height = cv2.absdiff(green[:, 1:], green[:, :-1])
    difference = cv2.absdiff(green, np.ascontiguousarray(now[..., 1]))[:, :-1]
    is_edge = height >= EDGE_LEVELS
    if not is_edge.any():
        return float("inf")
    return float(difference[is_edge].mean() / height[is_edge].mean())
