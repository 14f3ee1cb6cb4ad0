"""Far lines of the adjacent lanes: stated once searches find them for a while.

The views of most frames do not contain far lines: searches find them. A single search
may take a shadow, a wall or a guard rail for one. A rail that looks like a line for
longer cannot be told from one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from lanes.detect.lane import FarEvidence, LineEvidence

# A far line is stated if all searches over this time found it, at least two. That is
# less than the period of searches while the lane is not sure, and several frames where
# each is searched.
LASTING_S = 0.15
# Far lines are not stated when they end nearer than this, where they leave the image.
LEAST_REACH_M = 12.0


@dataclass(frozen=True)
class FarLine:
    """The far line of one adjacent lane, which the last search found."""

    # What that search saw; it ends nearer by the distance driven since.
    evidence: LineEvidence
    # Time since the first of all searches in a row that found it.
    found_s: float = 0.0
    # Whether the last search found it after `LASTING_S` or more.
    lasts: bool = False

    @property
    def stated(self) -> LineEvidence | None:
        """What is seen of the line; None of one that is not stated."""
        is_far = self.evidence.reach_m >= LEAST_REACH_M
        return self.evidence if self.lasts and is_far else None

    def moved(self, moved_m: float, elapsed_s: float) -> FarLine:
        """The line after a distance driven."""
        reach_m = self.evidence.reach_m - moved_m
        nearer = replace(self.evidence, reach_m=reach_m)
        return FarLine(nearer, self.found_s + elapsed_s, self.lasts)


@dataclass(frozen=True)
class FarLines:
    """The far lines of the lanes to the left and right; None for those that the last
    search did not find.
    """

    left: FarLine | None = None
    right: FarLine | None = None

    @property
    def stated(self) -> FarEvidence:
        """What is seen of the lines that were found for a while."""
        left = self.left.stated if self.left else None
        right = self.right.stated if self.right else None
        return left, right

    def moved(self, moved_m: float, elapsed_s: float) -> FarLines:
        """The lines after a distance driven."""
        left = self.left and self.left.moved(moved_m, elapsed_s)
        right = self.right and self.right.moved(moved_m, elapsed_s)
        return FarLines(left, right)

    def searched(self, found: FarEvidence) -> FarLines:
        """The lines after a search found some of them."""
        left, right = found
        return FarLines(_found(self.left, left), _found(self.right, right))


def _found(known: FarLine | None, found: LineEvidence | None) -> FarLine | None:
    """A far line after a search found it or not."""
    if found is None:
        return None
    found_s = known.found_s if known else 0.0
    return FarLine(found, found_s, lasts=found_s >= LASTING_S)
