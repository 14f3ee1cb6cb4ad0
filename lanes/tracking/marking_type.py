"""What kind a line is, over time: white or yellow, solid or dashed, single or double.

One picture may show a solid line under a tree's shadow in pieces, or a single dash as long as the view. So each
picture votes, old votes fade, and the majority holds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.tracking.lane import MarkingProfile

# Gaps between dashes are 3 m (UK, slow roads) to 12 m (Germany); holes that wear and shadows leave are mostly shorter.
DASH_GAP_M = 2.7
# Farther than this a gap is too few rows of the view to be sure of.
VOTING_FAR_M = 32.0
LEAST_ROWS = 6
# A vote loses this share of its weight with every further one: 14 halve it.
FADING = 0.95
LEAST_VOTES = 0.5


@dataclass(frozen=True)
class MarkingType:
    """What a line looks like; None where it has not been seen well enough to say."""

    colour: str | None = None
    pattern: str | None = None
    double: bool | None = None

    def describe(self) -> str:
        """Words: "yellow double solid"."""
        return " ".join(filter(None, [self.colour, "double" if self.double else None, self.pattern])) or "unknown"


@dataclass(frozen=True)
class MarkingVotes:
    """Votes of the pictures so far, each > 0 for yellow, dashed, double and < 0 for white, solid, single."""

    yellow: float = 0.0
    dashed: float = 0.0
    double: float = 0.0

    def add_profile(self, paint: MarkingProfile) -> MarkingVotes:
        """Count a look at the line's cross-section."""
        yellow, double = (1 if yes else -1 for yes in (paint.yellow, paint.double))
        return replace(self, yellow=FADING * self.yellow + yellow, double=FADING * self.double + double)

    def add_gaps(self, painted_m: np.ndarray) -> MarkingVotes:
        """Count a picture with paint at these distances ahead (N,), sorted or not."""
        dashed = looks_dashed(painted_m)
        return self if dashed is None else replace(self, dashed=FADING * self.dashed + (1 if dashed else -1))

    @property
    def kind(self) -> MarkingType:
        """The majority's opinion."""
        return MarkingType(
            _decide(self.yellow, "yellow", "white"),
            _decide(self.dashed, "dashed", "solid"),
            _decide(self.double, True, False),
        )


def looks_dashed(painted_m: np.ndarray) -> bool | None:
    """Whether paint at these distances (N,) has gaps like a dashed line's; None if there is too little of it."""
    painted_m = np.sort(painted_m[painted_m < VOTING_FAR_M])
    gaps = painted_m[1:] - painted_m[:-1]
    # the same place twice is one place
    if np.count_nonzero(gaps) < LEAST_ROWS - 1:
        return None
    return bool(gaps.max() > DASH_GAP_M)


def _decide(vote: float, positive: object, negative: object):
    return None if abs(vote) < LEAST_VOTES else positive if vote > 0 else negative
