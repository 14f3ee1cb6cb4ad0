"""How long each stage of each system takes on a frame, in undistorts: the time that taking out the lens takes.

The yardstick is one `cv2.undistort` of the same frame on one OpenCV thread, run just before each measurement: the ratio
says the same on a fast and on a slow machine. Times are the process's own processor time, and each frame is measured in
several rounds of which the fastest counts, for yardstick and system alike: what others do at the same time, and what
they drive from the processor's caches, only ever adds to a time.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from unittest.mock import patch

import cv2
import numpy as np

from benchmark.systems import TRACKER
from lanes.camera.camera import Camera
from lanes.classic import finder as recipes
from lanes.classic import overlay
from lanes.classic.channel import Channel
from lanes.classic.finder import RECIPES, LaneFinder, get_recipe
from lanes.classic.warp import FourPointWarp
from lanes.drives import overlay_styles as styles
from lanes.drives.overlay_styles import track_lane
from lanes.io.frames import Frame, YuvFrame
from lanes.io.threads import one_thread
from lanes.tracking import lane, tracker
from lanes.tracking.birdseye import BirdsEyeView

# A tracker needs some frames to be sure of its lane; before that it searches in each.
WARM_UP = 10
TRACKING, COLD = f"{TRACKER}, tracking", f"{TRACKER}, cold"
REST = "the rest"
# The functions whose time makes up a stage, where they are called from.
TRACKER_STAGES = {
    "road from above": [(BirdsEyeView, "warp")],
    "paint": [(lane, "marking_response")],
    "stripes": [(lane, "find_stripes")],
    "follow": [(tracker, "update_lane"), (tracker, "observe_lines")],
    "search": [(tracker, "search_lane"), (tracker, "describe_lane")],
    "draw": [(styles, "draw_tracked")],
}
CLASSIC_STAGES = {
    "undistort": [(recipes, "undistort")],
    "from above": [(FourPointWarp, "warp")],
    "thresholds": [(type(recipe.thresholds), "masks") for recipe in RECIPES.values()],
    "find lines": [(Channel, "line_from_windows"), (recipes, "nearest_line")],
    "measure": [(recipes, "road_line")],
    "draw": [(overlay, "annotate")],
}


@dataclass(frozen=True)
class FrameTime:
    """Processor time of one system for a frame, in undistorts but for `ms`.

    Attributes
    ----------
    ms, undistorts : float
        Of the frame in the middle: a tracker's rare searches do not count.
    mean : float
        Over all frames.
    stages : dict of str to float
        What the mean consists of.
    """

    ms: float
    undistorts: float
    mean: float
    stages: dict[str, float]


@dataclass(frozen=True)
class System:
    """What is measured: how to begin a drive with a function of its frames, the functions that are its stages.

    `as_stored`: the frames are as videos store them, which is how `annotate` looks at them.
    """

    begin: Callable[[], Callable[[Frame], object]]
    stages: dict[str, list[tuple[object, str]]]
    as_stored: bool = False

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the stages, and of what belongs to none."""
        return *self.stages, REST


class Stopwatch:
    """Processor time spent in named functions; a function's time is without that of named ones that it calls."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = defaultdict(float)
        self._inside_s = [0.0]

    def timed(self, name: str, function: Callable) -> Callable:
        """The function, with its time counted under `name`."""

        def run(*arguments: object, **options: object) -> object:
            self._inside_s.append(0.0)
            began_s = time.process_time()
            try:
                return function(*arguments, **options)
            finally:
                whole_s = time.process_time() - began_s
                self.spent_s[name] += whole_s - self._inside_s.pop()
                self._inside_s[-1] += whole_s

        return run

    @contextmanager
    def watching(self, stages: dict[str, list[tuple[object, str]]]) -> Iterator[None]:
        """Count these functions in the `with` block, wherever they are called from."""
        with ExitStack() as stack:
            for name, functions in stages.items():
                for owner, function in functions:
                    stack.enter_context(patch.object(owner, function, self.timed(name, getattr(owner, function))))
            yield


def time_frames(
    frames: Sequence[np.ndarray],
    camera: Camera,
    *,
    rounds: int = 3,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, FrameTime]:
    """Time of detecting, measuring and drawing in consecutive frames, for each system.

    Parameters
    ----------
    frames : sequence of ndarray of shape (height, width, 3), uint8
        More than `WARM_UP`; so many are not counted. In memory: a decoder's threads would be counted too.
    camera : Camera
        With its pose.
    rounds : int
        Each system goes so often through all frames; the systems take turns.

    Returns
    -------
    dict of str to FrameTime
        The tracker while tracking and cold (knowing nothing of the frames before), and each recipe.
    """
    systems = _systems(camera)
    seconds: dict[str, list[np.ndarray]] = {name: [] for name in systems}
    turns = [(name, system) for _ in range(rounds) for name, system in systems.items()]
    with one_thread():
        for number, (name, system) in enumerate(turns):
            seconds[name].append(_time_round(system, frames, camera))
            if progress:
                progress(number + 1, len(turns))
    return {name: _fastest(np.array(seconds[name]), system.parts) for name, system in systems.items()}


def _systems(camera: Camera) -> dict[str, System]:
    def begin_cold() -> Callable[[Frame], object]:
        searched = tracker.LaneTracker(camera)
        draw = track_lane(searched, camera)
        return lambda frame: (searched.reset(), draw(frame))

    systems = {
        TRACKING: System(lambda: track_lane(tracker.LaneTracker(camera), camera), TRACKER_STAGES, as_stored=True),
        COLD: System(begin_cold, TRACKER_STAGES),
    }
    for name in RECIPES:
        systems[name] = System(partial(_begin_recipe, name, camera), CLASSIC_STAGES)
    return systems


def _begin_recipe(name: str, camera: Camera) -> Callable[[np.ndarray], object]:
    return overlay.follow_lane(LaneFinder(get_recipe(name, camera.size), camera), camera)


def _undistort_s(frame: np.ndarray, camera: Camera) -> float:
    began_s = time.process_time()
    cv2.undistort(frame, camera.matrix, camera.distortion)
    return time.process_time() - began_s


def _stages_s(process: Callable, stages: dict, frame: Frame) -> dict[str, float]:
    watch = Stopwatch()
    with watch.watching(stages):
        watch.timed(REST, process)(frame)
    return watch.spent_s


def _time_round(system: System, frames: Sequence[np.ndarray], camera: Camera) -> np.ndarray:
    """(frames, 1 + parts) seconds: of the undistort, then of each part of the system."""
    process, seconds = system.begin(), []
    for frame in frames:
        unit_s = _undistort_s(frame.copy(), camera)
        own = YuvFrame.from_rgb(frame) if system.as_stored else frame.copy()
        spent_s = _stages_s(process, system.stages, own)
        seconds.append([unit_s, *(spent_s[part] for part in system.parts)])
    return np.array(seconds)


def _fastest(seconds: np.ndarray, parts: Sequence[str]) -> FrameTime:
    """What counts of times (rounds, frames, 1 + parts): of each frame the fastest round."""
    units_s, parts_s = seconds[:, WARM_UP:, 0].min(axis=0), seconds[:, WARM_UP:, 1:]
    fastest = parts_s.sum(axis=2).argmin(axis=0)
    parts_s = parts_s[fastest, np.arange(len(fastest))]
    middle_s = float(np.median(parts_s.sum(axis=1)))
    shares = dict(zip(parts, (parts_s.mean(axis=0) / units_s.mean()).tolist(), strict=True))
    return FrameTime(1e3 * middle_s, middle_s / float(np.median(units_s)), sum(shares.values()), shares)
