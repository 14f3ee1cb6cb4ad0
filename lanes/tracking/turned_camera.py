"""Whether somebody turned the camera in a drive: a yaw that lasts.

The filter estimates where the axis of the car is, seen from the camera. With the pose
of the drive it is straight ahead. After a knock it is elsewhere, in all frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

# A smaller yaw is that of a car that drifts or a road that slopes, or an error of the
# estimated pose. A more uncertain one is not known yet.
LEAST_TURN_RAD = np.radians(1.5)
MAX_STD_RAD = np.radians(0.6)
# Yaws agree within this angle, and must do so for this time: bends pass sooner. For as
# long the yaw must have been that of the pose before: else the pose is wrong from the
# beginning, which `lanes.pose.change` reports.
AGREES_RAD = np.radians(0.5)
LASTS_S = 2.0


@dataclass(frozen=True)
class TurnedCamera:
    """The yaw of the car's axis that the last frames agree on, and for how long.

    `settled_s` is for how long it was that of the pose.
    """

    yaw_rad: float = 0.0
    seconds: float = 0.0
    settled_s: float = 0.0

    @property
    def lasts(self) -> bool:
        """Whether enough frames agree on a yaw that is not that of the pose."""
        return min(self.seconds, self.settled_s) >= LASTS_S

    def after(self, yaw_rad: float, std_rad: float, elapsed_s: float) -> TurnedCamera:
        """The same after another frame with an estimate of the yaw."""
        if std_rad > MAX_STD_RAD:
            return replace(self, seconds=0.0)
        if abs(yaw_rad) < LEAST_TURN_RAD:
            return TurnedCamera(settled_s=self.settled_s + elapsed_s)
        if abs(yaw_rad - self.yaw_rad) > AGREES_RAD:
            return replace(self, yaw_rad=yaw_rad, seconds=0.0)
        return replace(self, seconds=self.seconds + elapsed_s)
