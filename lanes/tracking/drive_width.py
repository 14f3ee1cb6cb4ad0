"""The lane width of a drive: a slowly learnt mean with its spread.

Lanes of one road are equally wide: on twelve labelled drives the standard deviation of
the tracked widths is 0.05 to 0.13 m. A kerb, a shadow or the line of another lane is
seldom as far away. The width counts for the choice of a lane and for its confidence. A
width that lasts is that of another road: it is learnt, too, more slowly while the lane
is less likely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.detect.confidence import ROAD_WIDTH
from lanes.detect.road import UsualWidth

# The width of roads counts as if it had been seen for so long. It is the usual one
# until that of the drive was seen for as long.
ROAD_S = 5.0
# The width with an estimated pose is that of many images; its standard deviation.
POSED_S = 20.0
POSED_STD_M = 0.2
# After this time the weight of a width has fallen to 1 / e.
MEMORY_S = 30.0
# Widths of the lanes of a road differ at least by this standard deviation.
MIN_STD_M = 0.15


@dataclass(frozen=True)
class DriveWidth:
    """Mean and variance of the widths of a drive, and for how long they were seen."""

    mean_m: float = ROAD_WIDTH.mean_m
    variance_m2: float = ROAD_WIDTH.std_m**2
    seen_s: float = ROAD_S

    @classmethod
    def of_pose(cls, width_m: float) -> DriveWidth:
        """The width that lanes have with an estimated camera pose."""
        return cls(width_m, POSED_STD_M**2, POSED_S)

    @property
    def usual(self) -> UsualWidth:
        """Mean and standard deviation of the width of the next lane."""
        return self.learnt or ROAD_WIDTH

    @property
    def learnt(self) -> UsualWidth | None:
        """The same; None if only the width of roads is known."""
        if self.seen_s < 2 * ROAD_S:
            return None
        return UsualWidth(self.mean_m, max(float(np.sqrt(self.variance_m2)), MIN_STD_M))

    def after(self, width_m: float, weight_s: float) -> DriveWidth:
        """The width after a lane was seen for a time, weighted by its confidence."""
        seen_s = min(self.seen_s + weight_s, MEMORY_S)
        share = weight_s / seen_s
        from_mean_m = width_m - self.mean_m
        mean_m = self.mean_m + share * from_mean_m
        kept_m2 = (1 - share) * self.variance_m2
        return DriveWidth(mean_m, kept_m2 + share * from_mean_m**2, seen_s)
