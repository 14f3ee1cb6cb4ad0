"""What never moves in the images of a drive: captions, the bonnet, reflections."""

from __future__ import annotations

from math import exp

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Stripes

# A place of the image is static if it is occupied in this share of the samples. Six
# samples are needed, by their weights.
MIN_SHARE = 0.7
MIN_SAMPLES = 4.4
# Smallest share of occupied places that the previous sample did not have. While driving
# it is 0.4 to 1; if the car stands, everything is static, and the sample is left out.
MIN_MOVED = 0.3
# Width of a column, metres: stripes within 1 to 2 columns are at the same place.
COLUMN_M = 0.02
# After this number of samples the weight of one has fallen to 1 / e. A reflection that
# comes later in a drive is static after ten samples.
MEMORY_SAMPLES = 8


class StaticPattern:
    """Counts how often stripes lie at each place of a view, over samples of a drive.

    The samples are `period_s` apart. The pattern is what stays at the same place of the
    image while the car drives: guide lines and captions that the camera draws, stripes
    on the bonnet, reflections in the windscreen. Markings of the road move: cars sway
    in their lane and pitch, so that even a solid line on a straight road seldom stays
    within 3 cm for some seconds. On nine rendered drives and four of other cameras, at
    most 0.4 % of the stripes of the detected lines are called static.

    Places are the rows of the view, which is the widest one, and columns of `COLUMN_M`.
    A place also counts as occupied if one of its neighbours in the same row is.
    """

    def __init__(self, view: BirdsEyeView, period_s: float) -> None:
        self._view = view
        self._left_m = view.y_m[0]
        self._period_s = period_s
        self._since_sample_s = period_s
        columns = int(self._columns(view.y_m)[-1]) + 1
        shape = (len(view.x_m), columns)
        self._counts = np.zeros(shape, np.float32)
        # samples that saw a place
        self._samples = np.zeros(shape)
        self._previous = np.zeros(shape, bool)
        self._previous_seen = slice(0, 0)

    def update(
        self, stripes: Stripes, view: BirdsEyeView, elapsed_s: float
    ) -> tuple[np.ndarray, bool]:
        """Which stripes (N,) lie at places that are occupied in most samples.

        And whether the stripes are a sample now.
        """
        row = stripes.row
        column = self._columns(stripes.y_m)
        samples = self._samples[row, column]
        is_often = self._counts[row, column] >= MIN_SHARE * samples
        is_static = (samples >= MIN_SAMPLES) & is_often

        self._since_sample_s += elapsed_s
        is_sample = self._since_sample_s >= self._period_s
        if is_sample:
            first, last = self._columns(view.y_m[[0, -1]])
            self._add(row, column, slice(first, last + 1))
            self._since_sample_s = 0.0
        return is_static, is_sample

    def _columns(self, y_m: np.ndarray) -> np.ndarray:
        """Columns at lateral positions."""
        return np.round((self._left_m - y_m) / COLUMN_M).astype(int)

    def _add(self, row: np.ndarray, column: np.ndarray, seen: slice) -> None:
        """Count a sample with occupied places (N,), which sees the columns `seen`.

        It does not count if it shows nearly the same places as the sample before.
        """
        occupied = np.zeros(self._counts.shape, bool)
        last_column = occupied.shape[1] - 1
        for shift in (-1, 0, 1):
            occupied[row, np.clip(column + shift, 0, last_column)] = True

        # share of the places that the previous sample saw, but not as occupied
        comparable = np.zeros(occupied.shape[1], bool)
        comparable[self._previous_seen] = True
        is_new = ~self._previous[row, column]
        moved = is_new[comparable[column]]
        self._previous = occupied
        self._previous_seen = seen
        if not len(moved) or moved.mean() < MIN_MOVED:
            return

        kept = exp(-1 / MEMORY_SAMPLES)
        self._counts[:, seen] *= kept
        self._counts[:, seen] += occupied[:, seen]
        self._samples[:, seen] *= kept
        self._samples[:, seen] += 1

    def seen_in(self, view: BirdsEyeView) -> StaticPattern:
        """The same pattern of the image in a view with another camera pose.

        Places that the old view does not contain are unknown.
        """
        # the image of each place of the new view, and its place in the old one
        pattern = StaticPattern(view, self._period_s)
        rows, columns = pattern._counts.shape
        y_m = pattern._left_m - COLUMN_M * np.arange(columns)
        points_m = np.stack(np.meshgrid(view.x_m, y_m, indexing="ij"), axis=-1)
        pixels = view.camera.road_to_pixels(points_m.reshape(-1, 2))
        x_m, y_m = self._view.camera.pixels_to_road(pixels).T
        is_seen = np.isfinite(x_m) & np.isfinite(y_m)

        # rows are ordered from far to near
        edges_m = np.sqrt(self._view.x_m[1:] * self._view.x_m[:-1])
        row = np.searchsorted(-edges_m, -np.where(is_seen, x_m, 0.0))
        column = self._columns(np.where(is_seen, y_m, 0.0))
        is_seen &= (x_m <= self._view.x_m[0]) & (x_m >= self._view.x_m[-1])
        is_seen &= (column >= 0) & (column < self._counts.shape[1])
        row = row[is_seen]
        column = column[is_seen]
        pattern._counts.reshape(-1)[is_seen] = self._counts[row, column]
        pattern._samples.reshape(-1)[is_seen] = self._samples[row, column]
        return pattern
