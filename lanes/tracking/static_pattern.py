"""What stays at the same place of the picture while the car drives: guide lines and captions that the camera draws,
stripes on the bonnet, reflections in the windscreen.

Markings of the road move: cars sway in their lane and pitch, so that even a solid line on a straight road seldom stays
within 3 cm for some seconds. On nine rendered drives and four of other cameras, at most 0.4 % of the stripes of the
detected lines are called static.
"""

from __future__ import annotations

from math import exp

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Stripes

# A place of the picture is static if it is occupied in this share of the samples, of which this number is needed.
MIN_SHARE, MIN_SAMPLES = 0.7, 6.0
# Smallest share of occupied places that the previous sample did not have. While driving it is 0.4 to 1; if the car
# stands, everything is static, and the sample is left out.
MIN_MOVED = 0.3
# Samples after which the weight of a sample has fallen to 1 / e.
MEMORY = 30.0


class StaticPattern:
    """Counts how often stripes lie at each place of a view, over samples of a drive, `period_s` apart.

    Places are the rows of the view, which is the widest one, and columns of a width of `column_m`. A place also counts
    as occupied if one of its neighbours in the same row is.
    """

    def __init__(self, view: BirdsEyeView, column_m: float, period_s: float) -> None:
        self._left_m, self._column_m = view.y_m[0], column_m
        self._period_s = self._since_sample_s = period_s
        shape = len(view.x_m), int(self._columns(view.y_m)[-1]) + 1
        self._counts = np.zeros(shape, np.float32)
        # samples that saw a column
        self._samples = np.zeros(shape[1])
        self._previous, self._previous_seen = np.zeros(shape, bool), slice(0, 0)

    def update(self, stripes: Stripes, view: BirdsEyeView, elapsed_s: float) -> tuple[np.ndarray, bool]:
        """Which stripes (N,) lie at places that are occupied in most samples, and whether they are a sample now."""
        row, column = stripes.row, self._columns(stripes.y_m)
        samples = self._samples[column]
        static = (samples >= MIN_SAMPLES) & (self._counts[row, column] >= MIN_SHARE * samples)
        self._since_sample_s += elapsed_s
        sampled = self._since_sample_s >= self._period_s
        if sampled:
            first, last = self._columns(view.y_m[[0, -1]])
            self._add(row, column, slice(first, last + 1))
            self._since_sample_s = 0.0
        return static, sampled

    def _columns(self, y_m: np.ndarray) -> np.ndarray:
        """Columns at lateral positions."""
        return np.round((self._left_m - y_m) / self._column_m).astype(int)

    def _add(self, row: np.ndarray, column: np.ndarray, seen: slice) -> None:
        """Count a sample with occupied places (N,), which sees the columns `seen`.

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
