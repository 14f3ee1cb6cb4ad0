"""Result of one frame of a drive."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from lanes.io.describe import html_table
from lanes.tracking.car import CarMotion
from lanes.tracking.confidence import rate_lane
from lanes.tracking.departure import DepartureWarning, watch_departure
from lanes.tracking.lane import Lane
from lanes.tracking.marking_type import MarkingType

SEARCHING, TRACKING, COASTING, LOST = "searching", "tracking", "coasting", "lost"
# State of a lane detected in a single picture.
FOUND = "found"


@dataclass(frozen=True, eq=False)
class TrackedLane:
    """The lane in one frame of a drive.

    Attributes
    ----------
    state : str
        "tracking": seen in this frame and before; "searching": seen, not yet confirmed; "coasting": not seen now,
        predicted from before; "lost": unknown, `lane` is None; "found": detected in a single picture.
    lane : Lane or None
        In metres, with standard deviations.
    motion : CarMotion or None
        Speed, path and course of the car; the speed is given, or estimated from the motion of the lane. None if lost,
        and in a single picture.
    marking_types : (MarkingType, MarkingType)
        Colour, pattern, double: left and right.
    """

    state: str
    lane: Lane | None = None
    motion: CarMotion | None = None
    marking_types: tuple[MarkingType, MarkingType] = (MarkingType(), MarkingType())

    @classmethod
    def from_still(cls, lane: Lane | None) -> TrackedLane:
        """A lane detected in a single picture; lost where none was found."""
        return cls(LOST) if lane is None else cls(FOUND, lane)

    @cached_property
    def confidence(self) -> float:
        """Probability that both lines are correct within 0.2 m over 5 to 30 m ahead; 0 if lost."""
        return 0.0 if self.lane is None else rate_lane(self.lane, tracked=self.state != FOUND)

    @cached_property
    def warning(self) -> DepartureWarning | None:
        """Time to line crossing; None if lost, and in a single picture."""
        return None if self.motion is None else watch_departure(self.lane, self.motion)

    def summary(self) -> dict[str, str]:
        """State, confidence, lane, speed and warning in words, by name."""
        words = {"state": self.state}
        if self.lane is None:
            return words
        words |= {"confidence": f"{self.confidence:.0%}"} | self.lane.summary()
        if self.motion is not None:
            words["speed"] = f"{3.6 * self.motion.speed_mps:.0f} km/h"
        if self.warning and self.warning.due:
            words["warning"] = self.warning.describe()
        return words

    def __repr__(self) -> str:
        return f"TrackedLane({self.state}, confidence {self.confidence:.2f}, {self.lane})"

    def _repr_html_(self) -> str:
        return html_table("Lane in this frame", self.summary())

    def as_row(self) -> dict[str, str | float | None]:
        """Telemetry of the frame, by column name; None where the lane is lost."""
        row, lane = {"state": self.state, "confidence": self.confidence}, self.lane
        names = ("offset_m", "offset_std_m", "heading_rad", "curvature_per_m", "curvature_std_per_m")
        row |= {name: lane and getattr(lane, name) for name in names}
        row |= {"lane_width_m": lane and lane.width_m, "pitch_rad": lane and lane.pitch_rad}
        for side in ("left", "right"):
            line = lane and getattr(lane, side)
            row |= {f"{side}_{name}": line and getattr(line, name) for name in ("c0_m", "c1", "c2_per_m", "c3_per_m2")}
        return row
