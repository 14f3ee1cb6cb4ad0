"""Variants of a drive: the same scene on another road, seen by another camera, driven differently, with other noise.

A benchmark on the variants of a seed that nothing was fitted on shows how well a system generalises.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.camera import CameraPose
from simulator.light.lens import Lens
from simulator.rendering.drive import Drive, Motion
from simulator.road.geometry import RoadGeometry


@dataclass(frozen=True)
class VariantParameters:
    """Ranges (low, high) of factors, and standard deviations of differences, that a variant draws."""

    # Size of the road's plan: all radii, transition curves and straights.
    road_scale: tuple[float, float] = (0.9, 1.25)
    speed: tuple[float, float] = (0.9, 1.1)
    period: tuple[float, float] = (0.75, 1.35)
    pitch_amplitude: tuple[float, float] = (0.5, 1.5)
    camera_height: tuple[float, float] = (0.92, 1.12)
    noise: tuple[float, float] = (0.6, 1.8)
    wear: tuple[float, float] = (0.7, 1.3)
    offset_std_m: float = 0.15
    # Added to the amplitude of the lateral oscillation, at most.
    wander_m: float = 0.1
    start_std_m: float = 1.5
    camera_angle_std_rad: float = 0.008
    exposure_std_stops: float = 0.15


VARIANT = VariantParameters()


def vary_drive(drive: Drive, seed: int) -> Drive:
    """Variant number `seed` of a drive; 0 is the drive itself."""
    if not seed:
        return drive
    rng = np.random.default_rng([drive.seed, seed])
    pose = _vary_pose(drive.camera.require_pose(), rng)
    return replace(
        drive,
        road=_scale_road(drive.road, rng.uniform(*VARIANT.road_scale)),
        motion=_vary_motion(drive.motion, rng),
        camera=drive.camera.with_pose(pose),
        lens=_vary_lens(drive.lens, rng),
        markings=tuple(replace(m, wear=m.wear * rng.uniform(*VARIANT.wear)) for m in drive.markings),
        seed=drive.seed + 10_000 * seed,
    )


def _scale_road(road: RoadGeometry, scale: float) -> RoadGeometry:
    """The road enlarged by `scale`, with the same slopes."""
    profile = replace(road.profile, stations_m=road.profile.stations_m * scale)
    return RoadGeometry(road.stations_m * scale, road.curvatures_per_m / scale, profile)


def _vary_motion(motion: Motion, rng: np.random.Generator) -> Motion:
    speed = rng.uniform(*VARIANT.speed)
    return replace(
        motion,
        start_m=motion.start_m + rng.normal(0, VARIANT.start_std_m),
        speed_mps=motion.speed_mps * speed,
        later_speeds=tuple((time_s, later * speed) for time_s, later in motion.later_speeds),
        offset_m=motion.offset_m + rng.normal(0, VARIANT.offset_std_m),
        wander_m=motion.wander_m + rng.uniform(0, VARIANT.wander_m),
        wander_period_s=motion.wander_period_s * rng.uniform(*VARIANT.period),
        pitch_rad=motion.pitch_rad * rng.uniform(*VARIANT.pitch_amplitude),
        pitch_period_s=motion.pitch_period_s * rng.uniform(*VARIANT.period),
    )


def _vary_pose(pose: CameraPose, rng: np.random.Generator) -> CameraPose:
    return replace(
        pose,
        height_m=pose.height_m * rng.uniform(*VARIANT.camera_height),
        pitch_rad=pose.pitch_rad + rng.normal(0, VARIANT.camera_angle_std_rad),
        yaw_rad=pose.yaw_rad + rng.normal(0, VARIANT.camera_angle_std_rad),
    )


def _vary_lens(lens: Lens, rng: np.random.Generator) -> Lens:
    exposure = lens.exposure + rng.normal(0, VARIANT.exposure_std_stops)
    return replace(lens, noise=lens.noise * rng.uniform(*VARIANT.noise), exposure=exposure)
