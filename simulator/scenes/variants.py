"""Variants of a drive: the same scene on another road, seen by another camera, driven differently, with other noise.

A benchmark on the variants of a seed that nothing was fitted on shows how well a system generalises.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lanes.camera import CameraPose
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry

# Ranges (low, high) of the factors that a variant draws. The first is the size of the road's plan: all radii,
# transition curves and straights.
ROAD_SCALE, CAMERA_HEIGHT, NOISE, WEAR = (0.9, 1.25), (0.92, 1.12), (0.6, 1.8), (0.7, 1.3)
SPEED, PERIOD, PITCH_AMPLITUDE = (0.9, 1.1), (0.75, 1.35), (0.5, 1.5)
# Standard deviations of differences; the largest addition to the amplitude of the lateral oscillation.
START_STD_M, OFFSET_STD_M, CAMERA_ANGLE_STD_RAD, EXPOSURE_STD_STOPS = 1.5, 0.15, 0.008, 0.15
WANDER_M = 0.1


def vary_drive(drive: Drive, seed: int) -> Drive:
    """Variant number `seed` of a drive; 0 is the drive itself."""
    if not seed:
        return drive
    rng = np.random.default_rng([drive.seed, seed])
    camera = drive.camera.with_pose(_vary_pose(drive.camera.require_pose(), rng))
    road = _scale_road(drive.road, rng.uniform(*ROAD_SCALE))
    motion, exposure = _vary_motion(drive.motion, rng), drive.lens.exposure + rng.normal(0, EXPOSURE_STD_STOPS)
    lens = replace(drive.lens, exposure=exposure, noise=drive.lens.noise * rng.uniform(*NOISE))
    markings = tuple(replace(m, wear=m.wear * rng.uniform(*WEAR)) for m in drive.markings)
    seed = drive.seed + 10_000 * seed
    return replace(drive, road=road, motion=motion, camera=camera, lens=lens, markings=markings, seed=seed)


def _scale_road(road: RoadGeometry, scale: float) -> RoadGeometry:
    """The road enlarged by `scale`, with the same slopes."""
    profile = replace(road.profile, stations_m=road.profile.stations_m * scale)
    return RoadGeometry(road.stations_m * scale, road.values / scale, profile)


def _vary_motion(motion: Motion, rng: np.random.Generator) -> Motion:
    speed = rng.uniform(*SPEED)
    return replace(
        motion,
        start_m=motion.start_m + rng.normal(0, START_STD_M),
        speed_mps=motion.speed_mps * speed,
        later_speeds=tuple((time_s, later * speed) for time_s, later in motion.later_speeds),
        offset_m=motion.offset_m + rng.normal(0, OFFSET_STD_M),
        wander_m=motion.wander_m + rng.uniform(0, WANDER_M),
        wander_period_s=motion.wander_period_s * rng.uniform(*PERIOD),
        pitch_rad=motion.pitch_rad * rng.uniform(*PITCH_AMPLITUDE),
        pitch_period_s=motion.pitch_period_s * rng.uniform(*PERIOD),
    )


def _vary_pose(pose: CameraPose, rng: np.random.Generator) -> CameraPose:
    height_m = pose.height_m * rng.uniform(*CAMERA_HEIGHT)
    pitch_rad, yaw_rad = np.array([pose.pitch_rad, pose.yaw_rad]) + rng.normal(0, CAMERA_ANGLE_STD_RAD, 2)
    return replace(pose, height_m=height_m, pitch_rad=pitch_rad, yaw_rad=yaw_rad)
