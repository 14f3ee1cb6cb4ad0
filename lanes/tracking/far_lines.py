"""Far lines of the adjacent lanes: stated once two searches in a row found them.

The views of most frames do not contain far lines: searches find them. A single search
may take a shadow, a wall or a guard rail for one. A rail that looks like a line for
longer cannot be told from one: on eight clips a longer time took more true lines than
false ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from lanes.detect.lane import FarEvidence, LineEvidence

# Far lines are not stated when they end nearer than this, where they leave the image.
LEAST_REACH_M = 12.0


@dataclass(frozen=True)
class FarLine:
    """The far line of one adjacent lane, which the last search found."""

    # What that search saw; it ends nearer by the distance driven since.
    evidence: LineEvidence
    # Whether the search before found it, too.
    lasts: bool = False

    @property
    def stated(self) -> LineEvidence | None:
        """What is seen of the line; None of one that is not stated."""
        is_far = self.evidence.reach_m >= LEAST_REACH_M
        return self.evidence if self.lasts and is_far else None

    def moved(self, moved_m: float) -> FarLine:
        """The line after a distance driven."""
        reach_m = self.evidence.reach_m - moved_m
        nearer = replace(self.evidence, reach_m=reach_m)
        return replace(self, evidence=nearer)


@dataclass(frozen=True)
class FarLines:
    """The far lines of the lanes to the left and right; None for those that the last
    search did not find.
    """

    left: FarLine | None = None
    right: FarLine | None = None

    @property
    def stated(self) -> FarEvidence:
        """What is seen of the lines that two searches in a row found."""
        left = self.left.stated if self.left else None
        right = self.right.stated if self.right else None
        return left, right

    def moved(self, moved_m: float) -> FarLines:
        """The lines after a distance driven."""
        left = self.left and self.left.moved(moved_m)
        right = self.right and self.right.moved(moved_m)
        return FarLines(left, right)

    def searched(self, found: FarEvidence) -> FarLines:
        """The lines after a search found some of them."""
        left, right = found
        return FarLines(_found(self.left, left), _found(self.right, right))


def _found(known: FarLine | None, found: LineEvidence | None) -> FarLine | None:
    """A far line after a search found it or not."""
    if found is None:
        return None
    return FarLine(found, lasts=known is not None)
