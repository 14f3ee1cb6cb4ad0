"""What stays at the same place of the picture while the car drives: guide lines and captions that the camera draws,
stripes on the bonnet, reflections in the windscreen.

Markings of the road move: cars sway in their lane and pitch, so that even a solid line on a straight road seldom stays
within 3 cm for some seconds. On nine rendered drives and four of other cameras, at most 0.4 % of the stripes of the
detected lines are called static.
"""

from __future__ import annotations

from math import exp

import numpy as np

# A place of the picture is static if it is occupied in this share of the samples, of which this number is needed.
MIN_SHARE, MIN_SAMPLES = 0.7, 6.0
# Smallest share of occupied places that the previous sample did not have. While driving it is 0.4 to 1; if the car
# stands, everything is static, and the sample is left out.
MIN_MOVED = 0.3
# Samples after which the weight of a sample has fallen to 1 / e.
MEMORY = 30.0


class StaticPattern:
    """Counts how often each place of a grid (rows, columns) is occupied, over samples of a drive.

    A place also counts as occupied if one of its neighbours in the same row is.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self._counts = np.zeros((rows, columns), np.float32)
        # samples that saw a column
        self._samples = np.zeros(columns)
        self._previous, self._previous_seen = np.zeros((rows, columns), bool), slice(0, 0)

    def add(self, row: np.ndarray, column: np.ndarray, *, seen: slice = slice(None)) -> None:
        """Count a sample with occupied places (N,), which sees the columns `seen` of the grid.

        It does not count if it shows nearly the same places as the sample before.
        """
        occupied = np.zeros(self._counts.shape, bool)
        for shift in (-1, 0, 1):
            occupied[row, np.clip(column + shift, 0, occupied.shape[1] - 1)] = True
        comparable = np.zeros(occupied.shape[1], bool)
        comparable[self._previous_seen] = True
        compared = comparable[column]
        moved = ~self._previous[row, column][compared]
        self._previous, self._previous_seen = occupied, seen
        if not len(moved) or moved.mean() < MIN_MOVED:
            return
        kept = exp(-1 / MEMORY)
        self._counts[:, seen] *= kept
        self._counts[:, seen] += occupied[:, seen]
        self._samples[seen] *= kept
        self._samples[seen] += 1

    def is_static(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """(N,) bool: the places are occupied in most samples."""
        samples = self._samples[column]
        return (samples >= MIN_SAMPLES) & (self._counts[row, column] >= MIN_SHARE * samples)
