"""Type of a line's marking over time: white or yellow, solid or dashed, single or double.

A single picture may show a solid line in pieces (shadows), or one dash as long as the view. Each frame therefore votes,
old votes decay, and the majority decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lanes.tracking.lane import MarkingProfile


@dataclass(frozen=True)
class MarkingTypeParameters:
    """Votes on the type of a marking; tuned on the rendered suite where no source is given."""

    # Gaps between dashes are 3 m (UK, slow roads) to 12 m (Germany); holes from wear and shadows are mostly shorter.
    min_dash_gap_m: float = 2.7
    # Beyond this distance a gap has too few rows of the view.
    far_m: float = 32.0
    min_rows: int = 6
    # Share of its weight that a vote keeps with each further vote: it is halved after 14 votes.
    decay: float = 0.95
    # Smallest sum of votes that decides.
    min_votes: float = 0.5


MARKING_TYPE = MarkingTypeParameters()
NO_STRIPES = (np.empty(0), np.empty(0))


@dataclass(frozen=True)
class MarkingType:
    """Type of a marking; None where it was not seen well enough.

    Attributes
    ----------
    colour : {"yellow", "white", None}
    pattern : {"dashed", "solid", None}
    double : bool or None
    """

    colour: str | None = None
    pattern: str | None = None
    double: bool | None = None

    def describe(self) -> str:
        """Words: "yellow double solid"."""
        return " ".join(filter(None, [self.colour, "double" if self.double else None, self.pattern])) or "unknown"


@dataclass(frozen=True)
class MarkingVotes:
    """Sums of the votes so far, each positive for yellow, dashed, double and negative for white, solid, single."""

    yellow: float = 0.0
    dashed: float = 0.0
    double: float = 0.0

    def add_profile(self, profile: MarkingProfile | None) -> MarkingVotes:
        """Add a vote on colour and double from a cross-section, if there is one."""
        if profile is None:
            return self
        yellow, double = (1 if yes else -1 for yes in (profile.yellow, profile.double))
        return replace(
            self, yellow=MARKING_TYPE.decay * self.yellow + yellow, double=MARKING_TYPE.decay * self.double + double
        )

    def add_gaps(self, marked_m: np.ndarray) -> MarkingVotes:
        """Add a vote on the pattern from a frame with stripes at these distances ahead (N,), sorted or not."""
        dashed = looks_dashed(marked_m)
        if dashed is None:
            return self
        return replace(self, dashed=MARKING_TYPE.decay * self.dashed + (1 if dashed else -1))

    @property
    def marking_type(self) -> MarkingType:
        """The majority of the votes."""
        return MarkingType(
            _decide(self.yellow, "yellow", "white"),
            _decide(self.dashed, "dashed", "solid"),
            _decide(self.double, True, False),
        )


Votes = tuple[MarkingVotes, MarkingVotes]


def add_votes(
    votes: Votes, profiles: Sequence[MarkingProfile | None], marked_m: Sequence[np.ndarray] = NO_STRIPES
) -> Votes:
    """The votes on the left and the right line after a frame with these profiles and distances of stripes."""
    left, right = (
        line.add_gaps(x_m).add_profile(profile) for line, profile, x_m in zip(votes, profiles, marked_m, strict=True)
    )
    return left, right


def looks_dashed(marked_m: np.ndarray) -> bool | None:
    """Whether stripes at these distances (N,) have gaps like a dashed line's; None if there are too few."""
    marked_m = np.sort(marked_m[marked_m < MARKING_TYPE.far_m])
    gaps = marked_m[1:] - marked_m[:-1]
    # stripes at the same distance count once
    if np.count_nonzero(gaps) < MARKING_TYPE.min_rows - 1:
        return None
    return bool(gaps.max() > MARKING_TYPE.min_dash_gap_m)


def _decide(votes: float, positive: object, negative: object):
    return None if abs(votes) < MARKING_TYPE.min_votes else positive if votes > 0 else negative
