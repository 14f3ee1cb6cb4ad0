"""The suite: hard roads by name, and their videos, rendered on demand into a cache outside the project.

Each theme has a module with its scenes; here they come together.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import simulator
from lanes.camera import camera
from lanes.io.disk_cache import cache_folder
from simulator.rendering.video import Progress, write_video
from simulator.scenes.bad_weather import SCENES as WEATHER
from simulator.scenes.challenge import SCENES as FAMOUS
from simulator.scenes.motorway import SCENES as MOTORWAY
from simulator.scenes.mountain import SCENES as MOUNTAIN
from simulator.scenes.no_lane import SCENES as NO_LANE
from simulator.scenes.scene import SuiteScene
from simulator.scenes.traffic import SCENES as TRAFFIC

__all__ = ["SUITE", "SuiteScene", "cache_folder", "render_scene", "scene_path"]

_THEMES = (MOTORWAY, FAMOUS, MOUNTAIN, WEATHER, TRAFFIC, NO_LANE)
# Scenes are a cache and may be larger than what is committed (2.5 times): encoding takes a tenth of the time, and the
# quality is not worse (0.5 to 0.9 dB better, measured on two scenes).
CACHE_CRF, CACHE_PRESET = 20, "ultrafast"
SUITE: dict[str, SuiteScene] = {scene.name: scene for scenes in _THEMES for scene in scenes}


def scene_path(name: str, folder: str | Path | None = None) -> Path:
    """The video of a scene, rendered or not yet; its name changes when the renderer does, so none is ever stale.

    Raises
    ------
    ValueError
        If there is no such scene.
    """
    if name not in SUITE:
        raise ValueError(f"there is no scene {name!r} in the suite; there are {', '.join(SUITE)}.")
    return Path(folder or cache_folder()) / f"{name}-{_renderer_hash()}.mp4"


def render_scene(
    name: str, folder: str | Path | None = None, *, progress: Progress | None = None, workers: int | None = None
) -> Path:
    """Render a scene of the suite, unless it is there already.

    Parameters
    ----------
    name : str
        In SUITE.
    folder : str or Path, optional
        Instead of `cache_folder()`.
    progress : callable, optional
        Called as progress(frames done, frames in all); not at all when there is nothing to render.
    workers : int, optional
        Processes that render; the files do not depend on it. Default: as many as CPUs may be used.

    Returns
    -------
    Path
        The video; beside it are its truth (.csv, a row a frame) and its camera (.yaml).

    Raises
    ------
    ValueError
        If there is no such scene.
    OSError
        If the folder cannot be written to.
    """
    path = scene_path(name, folder)
    # The camera is written last: where it is, all is.
    if not path.with_suffix(".yaml").is_file():
        scene = SUITE[name]
        encoder = {"crf": CACHE_CRF, "preset": CACHE_PRESET}
        write_video(path, drive=scene.drive(), seconds=scene.seconds, **encoder, progress=progress, workers=workers)
    return path


@lru_cache(maxsize=1)
def _renderer_hash() -> str:
    """Eight digits that change with the source of any module that a picture is made by."""
    folder = Path(simulator.__file__).parent
    digest = hashlib.sha256()
    for source in (Path(camera.__file__), *sorted(folder.rglob("*.py"))):
        digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:8]
