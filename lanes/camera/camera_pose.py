"""Camera pose (extrinsics): height above the road and three angles.

Signs: pitch > 0 looks down, yaw > 0 looks left, roll > 0 has the right side down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


class CameraError(ValueError):
    """A camera, camera file or calibration cannot be used; the message says which, why and what to do."""


@dataclass(frozen=True)
class CameraPose:
    """Position and orientation of the camera relative to the road.

    Attributes
    ----------
    height_m, pitch_rad, yaw_rad, roll_rad : float
        The angles have the signs of the module docstring.
    same_lane_share : float or None
        If the pose was estimated from a single picture: the share of the poses tried that show the same lane there, 0
        to 1. Confidences depend on it. None of all other poses.

    Raises
    ------
    CameraError
        If the height is not positive, a number is not finite, or `same_lane_share` is not a share.
    """

    height_m: float
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    roll_rad: float = 0.0
    same_lane_share: float | None = None

    def __post_init__(self) -> None:
        angles = self.pitch_rad, self.yaw_rad, self.roll_rad
        if not (np.isfinite([self.height_m, *angles]).all() and self.height_m > 0):
            raise CameraError(f"{self} is not a camera pose: the height must be positive and every angle finite.")
        if self.same_lane_share is not None and not 0 <= self.same_lane_share <= 1:
            raise CameraError(f"{self} is not a camera pose: same_lane_share must be from 0 to 1.")

    def describe(self) -> str:
        """Text such as "1.32 m high, pitch -1.80, yaw -1.36, roll 0.40 deg"."""
        pitch, yaw, roll = np.degrees([self.pitch_rad, self.yaw_rad, self.roll_rad])
        return f"{self.height_m:.2f} m high, pitch {pitch:.2f}, yaw {yaw:.2f}, roll {roll:.2f} deg"

    @cached_property
    def rotation(self) -> np.ndarray:
        """Rotation matrix (3, 3) from the road frame to camera axes; read-only."""
        cy, sy = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        cp, sp = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        cr, sr = np.cos(self.roll_rad), np.sin(self.roll_rad)
        yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        body_to_camera = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
        rotation = body_to_camera @ (yaw @ pitch @ roll).T
        rotation.setflags(write=False)
        return rotation
