"""The car as a track sees it: its motion, and its departure from the lane.

These are data. `lanes.tracking` estimates them and adds them to a lane.
"""

from __future__ import annotations

from dataclasses import dataclass

# A speed with a larger standard deviation is not stated. It is a third of the speed
# where the lane does not show it.
MAX_SPEED_STD_SHARE = 0.15


@dataclass(frozen=True)
class CarMotion:
    """Motion of the car: speed, curvature of the path (positive left), and course
    relative to the camera pose.
    """

    speed_mps: float
    path_per_m: float
    course_rad: float
    # Standard deviations of the lane's curvature relative to the path, and of its
    # heading relative to the course.
    turning_std_per_m: float
    course_std_rad: float
    speed_std_mps: float

    @property
    def is_known(self) -> bool:
        """Whether the speed is certain enough to be stated."""
        return self.speed_std_mps <= MAX_SPEED_STD_SHARE * self.speed_mps


@dataclass(frozen=True)
class Departure:
    """Distance and time of the car to the lines."""

    # Distance from the tyres to the centre of the left and of the right line, beside
    # the car; < 0 beyond it.
    left_m: float
    right_m: float
    # Lateral speed, positive left.
    drift_mps: float
    # The line that the car approaches: "left", "right" or None.
    side: str | None
    # Time until the tyres are on that line if car and road continue as now; 0 while
    # they cross it. Infinite in lane keeping, or if it is more than 20 s.
    time_to_crossing_s: float
    # Whether to warn: a crossing is near with certainty, or happening; never for an
    # uncertain lane.
    due: bool

    def describe(self) -> str | None:
        """Words for the image; None if no warning is due."""
        if not self.due:
            return None
        if self.time_to_crossing_s == 0:
            return f"lane departure: crossing the {self.side} line"
        return (
            f"lane departure: {self.time_to_crossing_s:.1f} s to the {self.side} line"
        )


@dataclass(frozen=True)
class TrackedCar:
    """The car in one frame of a track.

    Attributes
    ----------
    camera_yaw_rad : float
        Direction of the car's axis, seen from the camera as its pose says, positive
        left. It is large if the yaw of the pose is wrong.
    motion : CarMotion
        Speed, path and course; the speed is given, or estimated from the motion of the
        lane.
    departure : Departure
        Time to line crossing.
    """

    camera_yaw_rad: float
    motion: CarMotion
    departure: Departure

    def summary(self) -> dict[str, str]:
        """Speed and warning in words, by name; those that are known."""
        words = {}
        if self.motion.is_known:
            words["speed"] = f"{3.6 * self.motion.speed_mps:.0f} km/h"
        warning = self.departure.describe()
        if warning:
            words["warning"] = warning
        return words
