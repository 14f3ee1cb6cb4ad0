"""CPU time of each stage of each system on a frame, in units of one undistortion.

The unit is one `cv2.undistort` of the same frame on one OpenCV thread, measured just before: the ratio is comparable
between machines. Times are CPU times of the process. Each frame is measured in several rounds, and the fastest one
counts, for the unit and the system alike: other processes, and cache misses because of them, only ever add to a time.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np

from benchmark.systems import TRACKER
from classic import finder as recipes
from classic import overlay
from classic.finder import Channel, LaneFinder
from classic.recipe import RECIPES, get_recipe
from classic.warp import FourPointWarp
from lanes import draw as styles
from lanes.camera import Camera
from lanes.detect import paint as markings
from lanes.detect.birdseye import BirdsEyeView
from lanes.draw import track_lane
from lanes.images import opencv_threads
from lanes.track import filter as update
from lanes.track import tracker

# Frames that are not measured: the tracker searches in each frame until its lane is confirmed.
WARM_UP = 10
TRACKING, COLD = f"{TRACKER}, tracking", f"{TRACKER}, cold"
REST, UNIT = "other", "undistortion"
Stages = dict[str, list[tuple[object, str]]]
# The functions of each stage, as (module or class that the caller looks them up in, name).
TRACKER_STAGES: Stages = {
    "bird's-eye view": [(BirdsEyeView, "warp")],
    "marking response": [(markings, "marking_response")],
    "stripes": [(markings, "find_stripes")],
    "update": [(update, "update_lane"), (update, "observe_lines")],
    "search": [(tracker, "search_lane")],
    "draw": [(styles, "draw_tracked")],
}
CLASSIC_STAGES: Stages = {
    "undistort": [(recipes, "undistort")],
    "bird's-eye view": [(FourPointWarp, "image_to_birdseye")],
    "thresholds": [(type(recipe.thresholds), "masks") for recipe in RECIPES.values()],
    "find lines": [(Channel, "line_from_windows"), (recipes, "nearest_line")],
    "measure": [(recipes, "road_line")],
    "draw": [(overlay, "annotate")],
}


@dataclass(frozen=True)
class FrameTime:
    """CPU time of one system for a frame, in undistortions except for `ms`.

    `ms` and `undistorts` are those of the median frame, so that the tracker's rare searches do not count. `mean` is
    over all frames, `stages` are its parts.
    """

    ms: float
    undistorts: float
    mean: float
    stages: dict[str, float]


@dataclass(frozen=True)
class System:
    """A system to be measured: `start` starts a drive and returns the function that processes its frames."""

    start: Callable[[], Callable[[Any], object]]
    stages: Stages

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the stages, and REST for all other time."""
        return *self.stages, REST


class Stopwatch:
    """CPU time spent in named functions, not counting the named functions that they call."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = defaultdict(float)
        self._inside_s = [0.0]

    def timed(self, name: str, function: Callable) -> Callable:
        """The function, with its time counted under `name`."""

        def run(*arguments: object, **options: object) -> object:
            self._inside_s.append(0.0)
            start_s = time.process_time()
            try:
                return function(*arguments, **options)
            finally:
                total_s = time.process_time() - start_s
                self.spent_s[name] += total_s - self._inside_s.pop()
                self._inside_s[-1] += total_s

        return run

    @contextmanager
    def watching(self, stages: dict[str, list[tuple[object, str]]]) -> Iterator[None]:
        """Time the functions of the stages in the `with` block."""
        with ExitStack() as restore:
            for name, functions in stages.items():
                for owner, function in functions:
                    original = getattr(owner, function)
                    restore.callback(setattr, owner, function, original)
                    setattr(owner, function, self.timed(name, original))
            yield


def time_frames(
    frames: Sequence[np.ndarray],
    camera: Camera,
    *,
    rounds: int = 3,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, FrameTime]:
    """CPU time of each system to detect, measure and draw in consecutive frames.

    The systems are the tracker while tracking and cold (reset before each frame), and each recipe. They take turns in
    `rounds` rounds over all frames (height, width, 3) uint8, more than `WARM_UP`; that number is not counted. The
    frames are in memory, because the threads of a decoder would count.
    """
    systems = _systems(camera)
    seconds: dict[str, list[np.ndarray]] = {name: [] for name in systems}
    turns = [(name, system) for _ in range(rounds) for name, system in systems.items()]
    with opencv_threads(1):
        for number, (name, system) in enumerate(turns):
            seconds[name].append(_time_round(system, frames, camera))
            if progress:
                progress(number + 1, len(turns))
    return {name: _fastest(np.array(seconds[name]), system.parts) for name, system in systems.items()}


def _systems(camera: Camera) -> dict[str, System]:
    def start_cold() -> Callable[[np.ndarray], object]:
        cold = tracker.LaneTracker(camera)
        draw = track_lane(cold, camera)

        def forget_and_draw(frame: np.ndarray) -> object:
            cold.reset()
            return draw(frame)

        return forget_and_draw

    def start_recipe(name: str) -> Callable[[Any], object]:
        return overlay.follow_lane(LaneFinder(get_recipe(name, camera.size), camera), camera)

    systems = {
        TRACKING: System(lambda: track_lane(tracker.LaneTracker(camera), camera), TRACKER_STAGES),
        COLD: System(start_cold, TRACKER_STAGES),
    }
    return systems | {name: System(partial(start_recipe, name), CLASSIC_STAGES) for name in RECIPES}


def _time_round(system: System, frames: Sequence[np.ndarray], camera: Camera) -> np.ndarray:
    """Seconds (frames, 1 + parts): of cv2.undistort, then of each part of the system."""
    process, seconds = system.start(), []
    for frame in frames:
        watch = Stopwatch()
        watch.timed(UNIT, cv2.undistort)(frame.copy(), camera.matrix, camera.distortion)
        copy = frame.copy()
        with watch.watching(system.stages):
            watch.timed(REST, process)(copy)
        seconds.append([watch.spent_s[part] for part in (UNIT, *system.parts)])
    return np.array(seconds)


def _fastest(seconds: np.ndarray, parts: Sequence[str]) -> FrameTime:
    """From seconds (rounds, frames, 1 + parts): the fastest round counts for each frame."""
    units_s, parts_s = seconds[:, WARM_UP:, 0].min(axis=0), seconds[:, WARM_UP:, 1:]
    fastest = parts_s.sum(axis=2).argmin(axis=0)
    parts_s = parts_s[fastest, np.arange(len(fastest))]
    median_s = float(np.median(parts_s.sum(axis=1)))
    shares = dict(zip(parts, (parts_s.mean(axis=0) / units_s.mean()).tolist(), strict=True))
    return FrameTime(1e3 * median_s, median_s / float(np.median(units_s)), sum(shares.values()), shares)
