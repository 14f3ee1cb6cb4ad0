"""A short drive with small images, shared by the tests of the renderer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lanes.camera.model import CameraPose
from simulator.backdrop import BackdropStyle
from simulator.light.lens import Lens
from simulator.light.sunlight import Sun
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry
from simulator.scenes.freeway import DASHCAM, EGO_LINES_M, Freeway

POSE = CameraPose(
    height_m=1.3,
    pitch_rad=np.radians(2.0),
    yaw_rad=np.radians(-1.0),
    roll_rad=np.radians(0.6),
)
TINY = replace(DASHCAM.scaled((320, 180)), pose=POSE)
SMALL = replace(DASHCAM.scaled((640, 360)), pose=POSE)
FULL = replace(DASHCAM, pose=POSE)
PLAIN_LENS = Lens(
    noise=0.0,
    sharpening=0.0,
    blur_px=0.0,
    vignette=0.0,
    adaptation=0.0,
)


def small_drive(
    curvature: float = 1 / 250,
    **changes: Any,
) -> Drive:
    """Off-centre car in a bend, small images without noise.

    `changes` are fields of Drive.
    """
    lines = Freeway().markings()
    drive = Drive(
        camera=SMALL,
        road=RoadGeometry(
            [0.0, 40.0, 300.0, 340.0],
            [0.0, curvature, curvature, 0.0],
        ),
        line_laterals_m=EGO_LINES_M,
        markings=tuple(replace(line, wear=0.0, dots=False) for line in lines),
        surface=Freeway("fresh asphalt").surface(),
        sun=Sun(1.0, 0.9),
        motion=Motion(60.0, offset_m=0.3, heading_rad=0.01),
        lens=PLAIN_LENS,
        # Painting woods takes seconds.
        backdrop=BackdropStyle(tree_density=0.0),
        bonnet=False,
        seed=5,
    )
    return replace(drive, **changes)


def weighted_column(weight: np.ndarray, columns: np.ndarray) -> float:
    """Mean of columns (N,), weighted by the positive weights (N,)."""
    weight = np.clip(weight, 0, None)
    return (weight * columns).sum() / weight.sum()


def largest_difference(image: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Largest difference (H, W) of the channels of two images (H, W, 3)."""
    return np.abs(image.astype(int) - other).max(axis=2)
