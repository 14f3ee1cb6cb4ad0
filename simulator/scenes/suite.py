"""All scenes by name.

Videos of the suite are rendered on demand into a cache; stills and videos of the course
are committed.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path

import simulator
from lanes.camera import model
from lanes.camera.model import Camera
from lanes.files import hash_sources
from lanes.video.images import write_image
from simulator.processes import run_all
from simulator.rendering.drive import Drive, Motion, SuiteScene
from simulator.rendering.render import (
    VIDEO_CRF,
    VIDEO_SECONDS,
    Progress,
    render_frame,
    write_video,
)
from simulator.road.geometry import RoadGeometry
from simulator.road.truth import truth_entry, write_truth_json
from simulator.scenes.freeway import DASHCAM
from simulator.scenes.motorway import NO_LANE, challenge_video, project_video
from simulator.scenes.motorway import SCENES as MOTORWAY
from simulator.scenes.mountain import SCENES as MOUNTAIN
from simulator.scenes.mountain import harder_challenge_video
from simulator.scenes.stills import still_scenes
from simulator.scenes.weather_and_traffic import SCENES as WEATHER_AND_TRAFFIC

SUITE: dict[str, SuiteScene] = {
    scene.name: scene
    for scene in (*MOTORWAY, *MOUNTAIN, *WEATHER_AND_TRAFFIC, *NO_LANE)
}
# Cached videos are 2.5 times as large as committed ones. Encoding takes a tenth of the
# time, and the quality is 0.5 to 0.9 dB better (measured on two scenes).
CACHE_CRF = 20
CACHE_PRESET = "ultrafast"
# Committed videos by name: drive, length in seconds, and constant rate factor of x264.
# Concrete and leaves need many bits: with a higher factor each file is below 3.5 MB.
VIDEOS = {
    "project_video": (project_video, VIDEO_SECONDS, VIDEO_CRF),
    "challenge_video": (challenge_video, 9.0, 25),
    "harder_challenge_video": (harder_challenge_video, 10.0, 27),
}


def cache_folder() -> Path:
    """Folder of rendered scenes: LANES_CACHE if set, else a cache folder of this user.

    Raises RuntimeError if the user has no home folder.
    """
    if folder := os.environ.get("LANES_CACHE"):
        return Path(folder)
    caches = user_cache_path("advanced-lane-finding", appauthor=False, opinion=False)
    return caches / "scenes"


def scene_path(
    name: str,
    folder: str | Path | None = None,
    *,
    seed: int = 0,
) -> Path:
    """Path of the video of a scene, or of its variant number `seed`, rendered or not.

    It contains a hash of the renderer, so that no video is outdated. Raises ValueError
    without such a scene.
    """
    if name not in SUITE:
        names = ", ".join(SUITE)
        raise ValueError(f"no scene {name!r} in the suite; choose one of {names}.")
    variant = f"{name}-{seed}" if seed else name
    return Path(folder or cache_folder()) / f"{variant}-{_renderer_hash()}.mp4"


def render_scene(
    name: str,
    folder: str | Path | None = None,
    *,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int | None = None,
) -> Path:
    """Path of a scene's video, which is rendered if it does not exist yet.

    Its ground truth (.csv, a row for each frame) and camera (.yaml) have the same stem.
    `name`, `folder`, `seed` and the ValueError are those of `scene_path`; `progress`,
    `workers` and the OSError are those of `write_video`.
    """
    path = scene_path(name, folder, seed=seed)
    # The camera file is written last, so it exists only with the other two.
    if not path.with_suffix(".yaml").is_file():
        scene = SUITE[name]
        write_video(
            path,
            drive=vary_drive(scene.drive(), seed),
            seconds=scene.seconds,
            crf=CACHE_CRF,
            preset=CACHE_PRESET,
            progress=progress,
            workers=workers,
        )
    return path


@lru_cache(maxsize=1)
def _renderer_hash() -> str:
    """Hash of the sources of all modules that affect the images."""
    return hash_sources(Path(model.__file__), Path(simulator.__file__).parent)


def write_stills(
    folder: str | Path,
    *,
    progress: Progress | None = None,
) -> list[Path]:
    """Files written: the eight stills and their truth.json.

    The folder is created where needed. `progress` is that of `write_video`. Raises
    OSError if the folder cannot be written to.
    """
    folder = Path(folder)
    scenes = still_scenes()
    drives = list(scenes.values())
    frames = run_all(render_frame, drives, progress=progress)

    written = []
    entries = []
    for (name, drive), frame in zip(scenes.items(), frames, strict=True):
        path = write_image(folder / f"{name}.jpg", frame.image)
        written.append(path)
        entry = truth_entry(
            frame.truth,
            raw_file=f"{folder.name}/{path.name}",
            camera=drive.camera_at(0.0),
            hidden=frame.hidden,
        )
        entries.append(entry)
    truth_path = folder / "truth.json"
    write_truth_json(truth_path, DASHCAM, entries)
    return [*written, truth_path]


def write_course_video(
    folder: str | Path,
    name: str,
    *,
    seconds: float = VIDEO_SECONDS,
    progress: Progress | None = None,
) -> list[Path]:
    """Write a video of VIDEOS with its truth and camera into a folder.

    It lasts `seconds` at most; see `write_video`.
    """
    drive, length_s, crf = VIDEOS[name]
    return write_video(
        Path(folder) / f"{name}.mp4",
        drive=drive(),
        seconds=min(seconds, length_s),
        crf=crf,
        progress=progress,
    )


# Variants: the same scene on another road, seen by another camera, driven differently,
# with other noise. The variants of a seed that nothing was fitted on show how well a
# system generalises.
# Ranges (low, high) of the factors that a variant draws. The first is the size of the
# road's plan: all radii, transition curves and straights.
ROAD_SCALE = (0.9, 1.25)
CAMERA_HEIGHT = (0.92, 1.12)
NOISE = (0.6, 1.8)
WEAR = (0.7, 1.3)
SPEED = (0.9, 1.1)
PERIOD = (0.75, 1.35)
PITCH_AMPLITUDE = (0.5, 1.5)
# Standard deviations of differences; the largest addition to the amplitude of the
# lateral oscillation.
START_STD_M = 1.5
OFFSET_STD_M = 0.15
CAMERA_ANGLE_STD_RAD = 0.008
EXPOSURE_STD_STOPS = 0.15
WANDER_M = 0.1
# Distance of the noise seeds of two variants.
SEED_STEP = 10_000


def vary_drive(drive: Drive, seed: int) -> Drive:
    """Variant number `seed` of a drive; 0 is the drive itself."""
    if not seed:
        return drive
    # One generator for all differences, so their order matters.
    rng = np.random.default_rng([drive.seed, seed])
    camera = _vary_camera(drive.camera, rng)
    road = _vary_road(drive.road, rng)
    motion = _vary_motion(drive.motion, rng)
    lens = replace(
        drive.lens,
        exposure=drive.lens.exposure + rng.normal(0, EXPOSURE_STD_STOPS),
        noise=drive.lens.noise * rng.uniform(*NOISE),
    )
    markings = [replace(m, wear=m.wear * rng.uniform(*WEAR)) for m in drive.markings]
    return replace(
        drive,
        camera=camera,
        road=road,
        motion=motion,
        lens=lens,
        markings=tuple(markings),
        seed=drive.seed + SEED_STEP * seed,
    )


def _vary_camera(camera: Camera, rng: np.random.Generator) -> Camera:
    pose = camera.require_pose()
    height_m = pose.height_m * rng.uniform(*CAMERA_HEIGHT)
    pitch_rad, yaw_rad = rng.normal(0, CAMERA_ANGLE_STD_RAD, 2)
    varied = replace(
        pose,
        height_m=height_m,
        pitch_rad=pose.pitch_rad + pitch_rad,
        yaw_rad=pose.yaw_rad + yaw_rad,
    )
    return camera.with_pose(varied)


def _vary_road(road: RoadGeometry, rng: np.random.Generator) -> RoadGeometry:
    # A road of another size has the same slopes.
    scale = rng.uniform(*ROAD_SCALE)
    profile = replace(road.profile, stations_m=road.profile.stations_m * scale)
    return RoadGeometry(road.stations_m * scale, road.values / scale, profile)


def _vary_motion(motion: Motion, rng: np.random.Generator) -> Motion:
    speed = rng.uniform(*SPEED)
    later_speeds = [(time_s, mps * speed) for time_s, mps in motion.later_speeds]
    return replace(
        motion,
        start_m=motion.start_m + rng.normal(0, START_STD_M),
        speed_mps=motion.speed_mps * speed,
        later_speeds=tuple(later_speeds),
        offset_m=motion.offset_m + rng.normal(0, OFFSET_STD_M),
        wander_m=motion.wander_m + rng.uniform(0, WANDER_M),
        wander_period_s=motion.wander_period_s * rng.uniform(*PERIOD),
        pitch_rad=motion.pitch_rad * rng.uniform(*PITCH_AMPLITUDE),
        pitch_period_s=motion.pitch_period_s * rng.uniform(*PERIOD),
    )
