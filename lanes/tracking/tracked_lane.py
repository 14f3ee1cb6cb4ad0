"""What is known of the lane in one frame of a drive."""

from __future__ import annotations

from dataclasses import dataclass

from lanes.io.describe import html_table
from lanes.tracking.confidence import rate_lane
from lanes.tracking.departure import DepartureWarning
from lanes.tracking.lane import Lane, LaneLine
from lanes.tracking.marking_type import MarkingType

SEARCHING, TRACKING, COASTING, LOST = "searching", "tracking", "coasting", "lost"
# The state of a lane found in a single picture, which has no before.
FOUND = "found"


@dataclass(frozen=True, eq=False)
class TrackedLane:
    """The lane in one frame of a drive.

    Attributes
    ----------
    state : str
        "tracking": seen in this frame and before; "searching": seen, not yet confirmed; "coasting": not seen now,
        predicted from before; "lost": not known, `lane` is None.
    confidence : float
        Probability that both lines are right within 0.2 m over 5 to 30 m ahead; see `lanes.tracking.confidence`.
    lane : Lane or None
        Where it is, in metres, with standard deviations.
    speed_mps : float or None
        Given, or estimated from how the lane moves.
    warning : DepartureWarning or None
        Time to line crossing; None when lost.
    kinds : (MarkingType, MarkingType)
        Colour, solid or dashed, double: left and right.
    """

    state: str
    confidence: float = 0.0
    lane: Lane | None = None
    speed_mps: float | None = None
    warning: DepartureWarning | None = None
    marking_types: tuple[MarkingType, MarkingType] = (MarkingType(), MarkingType())

    @classmethod
    def from_still(cls, lane: Lane | None) -> TrackedLane:
        """A lane found in a single picture, with its confidence; lost where none was found."""
        return cls(LOST) if lane is None else cls(FOUND, rate_lane(lane), lane)

    def summary(self) -> dict[str, str]:
        """State and confidence, and what is known of the lane, by name."""
        words = {"state": self.state}
        if self.lane is None:
            return words
        words |= {"confidence": f"{self.confidence:.0%}"} | self.lane.summary()
        if self.speed_mps is not None:
            words["speed"] = f"{3.6 * self.speed_mps:.0f} km/h"
        if self.warning and self.warning.due:
            words["warning"] = self.warning.describe()
        return words

    def __repr__(self) -> str:
        return f"TrackedLane({self.state}, confidence {self.confidence:.2f}, {self.lane})"

    def _repr_html_(self) -> str:
        return html_table("Lane in this frame", self.summary())

    @property
    def offset_m(self) -> float | None:
        """How far the car stands left of the lane's middle; None when lost, as all the following."""
        return self.lane and self.lane.offset_m

    @property
    def offset_std_m(self) -> float | None:
        """Standard deviation of the offset."""
        return self.lane and self.lane.offset_std_m

    @property
    def heading_rad(self) -> float | None:
        """Direction of the road seen from the car, > 0 to the left."""
        return self.lane and self.lane.heading_rad

    @property
    def curvature_per_m(self) -> float | None:
        """Curvature of the lane beside the car, > 0 bends left."""
        return self.lane and self.lane.curvature_per_m

    @property
    def curvature_std_per_m(self) -> float | None:
        """Standard deviation of the curvature."""
        return self.lane and self.lane.curvature_std_per_m

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the two lines."""
        return self.lane and self.lane.width_m

    @property
    def pitch_rad(self) -> float | None:
        """How much farther down than its pose says the camera looks."""
        return self.lane and self.lane.pitch_rad

    @property
    def left(self) -> LaneLine | None:
        """The left line: coefficients, reach, support, paint."""
        return self.lane and self.lane.left

    @property
    def right(self) -> LaneLine | None:
        """The right line."""
        return self.lane and self.lane.right

    @property
    def time_to_crossing_s(self) -> float | None:
        """Until the tyres are on a line; infinite when the car keeps to its lane."""
        return self.warning and self.warning.time_to_crossing_s

    def as_row(self) -> dict[str, str | float | None]:
        """The frame's telemetry, by column name; what is not known is None."""
        row = {"state": self.state, "confidence": self.confidence}
        names = ("offset_m", "offset_std_m", "heading_rad", "curvature_per_m", "curvature_std_per_m")
        row |= {name: getattr(self, name) for name in (*names, "lane_width_m", "pitch_rad")}
        for side, line in (("left", self.left), ("right", self.right)):
            row |= {f"{side}_{name}": line and getattr(line, name) for name in ("c0_m", "c1", "c2_per_m", "c3_per_m2")}
        return row
