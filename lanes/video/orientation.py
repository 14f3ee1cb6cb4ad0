"""Orientation of a video's frames: how its display matrix turns and mirrors the stored images, as in EXIF 1 to 8."""

from __future__ import annotations

from typing import Any

import av
import numpy as np
from av.sidedata.sidedata import Type as SideDataType

from lanes.images import upright_axes

# EXIF orientations that mirror the stored image; players show it so.
MIRRORED = (2, 4, 5, 7)
MIRRORED_WORDS = (
    "is shown mirrored, as its display matrix says: if the road is mirrored, too, left and right are exchanged; remove "
    "the flip then (ffmpeg -display_rotation 0 -i VIDEO -c copy NEW)"
)


def frame_orientation(frame: av.VideoFrame) -> int:
    """The EXIF orientation of a frame by its display matrix, to the nearest quarter turn; 1 without one."""
    side_data: Any = frame.side_data  # PyAV's types know its numbers only
    matrix = side_data.get(SideDataType.DISPLAYMATRIX)
    if matrix is None:
        return 1
    # of a row vector (column, row) in the stored image to one on the screen (libavutil/display.h)
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5].tolist()
    axes = np.sign([(a, 0), (0, d)] if abs(a) >= abs(c) else [(0, c), (b, 0)])
    return next((n for n in range(1, 9) if (upright_axes(n) == axes).all()), 1)


def is_transposed(orientation: int) -> bool:
    """Whether the rows of the stored image are columns of the upright one."""
    return orientation >= 5


def make_upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """The upright image (rows, columns, ...), contiguous, of a stored one."""
    (right, down) = upright_axes(orientation).sum(axis=1)
    turned = np.swapaxes(image, 0, 1) if is_transposed(orientation) else image
    return np.ascontiguousarray(turned[::down, ::right])


def as_stored(image: np.ndarray, orientation: int) -> np.ndarray:
    """The stored image, contiguous, of an upright one: the inverse of `make_upright`."""
    (right, down) = upright_axes(orientation).sum(axis=1)
    turned = image[::down, ::right]
    return np.ascontiguousarray(np.swapaxes(turned, 0, 1) if is_transposed(orientation) else turned)
