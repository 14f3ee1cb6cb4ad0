"""Camera of all committed images: the ground truth for calibration."""

from __future__ import annotations

import numpy as np

from lanes.camera import Camera, CameraPose

# A typical dashcam: 63 degrees wide, barrel distortion, principal point off the centre, and small yaw and roll. The
# distortion polynomial is monotonic over the whole image (Camera.largest_ray is beyond the corners), so that pixels
# and rays correspond one to one. Pitch and yaw put the vanishing point near column 640, row 422, for which the warps of
# the classic recipes were made.
DASHCAM = Camera(
    width=1280,
    height=720,
    matrix=np.array([[1157.8, 0.0, 667.4], [0.0, 1153.2, 386.1], [0.0, 0.0, 1.0]]),
    distortion=np.array([-0.2442, -0.0208, -0.0011, 0.0003, -0.0121]),
    pose=CameraPose(height_m=1.32, pitch_rad=np.radians(-1.80), yaw_rad=np.radians(-1.36), roll_rad=np.radians(0.4)),
)
