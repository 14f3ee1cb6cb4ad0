"""The camera that every committed picture is rendered with: its numbers are the truth that calibration has to find."""

from __future__ import annotations

import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose

# A dashcam in kind: 63 degrees wide, barrel distortion, a principal point that is not in the middle of the
# picture, and a pose that is a little crooked, as every real one is. The distortion polynomial grows over the whole
# picture (Camera.largest_ray is beyond the widest corner), so that every pixel has one ray and back. Pitch and yaw put
# the vanishing point near column 640, row 422, where it is in the drives that the classic recipes' warps were made for.
DASHCAM = Camera(
    width=1280,
    height=720,
    matrix=np.array([[1157.8, 0.0, 667.4], [0.0, 1153.2, 386.1], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.2442, -0.0208, -0.0011, 0.0003, -0.0121]),
    pose=CameraPose(height_m=1.32, pitch_rad=np.radians(-1.80), yaw_rad=np.radians(-1.36), roll_rad=np.radians(0.4)),
)
