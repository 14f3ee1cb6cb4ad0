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

from lanes.benchmark.systems import METRIC
from lanes.camera import Camera
from lanes.classic import overlay, recipes
from lanes.classic.channel import Channel
from lanes.classic.recipes import RECIPES, LaneFinder, get_recipe
from lanes.classic.view import FourPointWarp
from lanes.drives import styles
from lanes.drives.styles import track_lane
from lanes.metric import lane, tracker
from lanes.metric.roadview import RoadView
from lanes.threads import one_thread
from lanes.yuv import Picture, YuvPicture

# A tracker needs some frames to be sure of its lane; before that it searches in each.
WARM_UP = 10
TRACKING, COLD = f"{METRIC}, tracking", f"{METRIC}, cold"
REST = "the rest"
# The functions whose time makes up a stage, where they are called from.
METRIC_STAGES = {
    "road from above": [(RoadView, "warp")],
    "paint": [(lane, "measure_paint")],
    "stripes": [(lane, "find_stripes")],
    "follow": [(tracker, "correct_lane"), (tracker, "see_lines")],
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

    begin: Callable[[], Callable[[Picture], object]]
    stages: dict[str, list[tuple[object, str]]]
    as_stored: bool = False


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
        With its mount.
    rounds : int
        Each system goes so often through all frames; the systems take turns.

    Returns
    -------
    dict of str to FrameTime
        The metric engine while tracking and cold (knowing nothing of the frames before), and each recipe.
    """
    systems = _systems(camera)
    units_s = {name: np.empty((rounds, len(frames))) for name in systems}
    spent = {
        name: {stage: np.empty((rounds, len(frames))) for stage in (*systems[name].stages, REST)} for name in systems
    }
    with one_thread():
        for number in range(rounds):
            for name, system in systems.items():
                process = system.begin()
                for at, frame in enumerate(frames):
                    units_s[name][number, at] = _undistort_s(frame.copy(), camera)
                    own = YuvPicture.from_rgb(frame) if system.as_stored else frame.copy()
                    seconds = _stages_s(process, system.stages, own)
                    for stage, values in spent[name].items():
                        values[number, at] = seconds[stage]
                if progress:
                    progress(number * len(systems) + list(systems).index(name) + 1, rounds * len(systems))
    return {name: _fastest(spent[name], units_s[name]) for name in systems}


def _systems(camera: Camera) -> dict[str, System]:
    def begin_cold() -> Callable[[Picture], object]:
        searched = tracker.LaneTracker(camera)
        draw = track_lane(searched, camera)
        return lambda frame: (searched.reset(), draw(frame))

    systems = {
        TRACKING: System(lambda: track_lane(tracker.LaneTracker(camera), camera), METRIC_STAGES, as_stored=True),
        COLD: System(begin_cold, METRIC_STAGES),
    }
    for name in RECIPES:
        begin = partial(_begin_recipe, name, camera)
        systems[name] = System(begin, CLASSIC_STAGES)
    return systems


def _begin_recipe(name: str, camera: Camera) -> Callable[[np.ndarray], object]:
    return overlay.follow_lane(LaneFinder(get_recipe(name, camera.size), camera), camera)


def _undistort_s(frame: np.ndarray, camera: Camera) -> float:
    began_s = time.process_time()
    cv2.undistort(frame, camera.matrix, camera.distortion)
    return time.process_time() - began_s


def _stages_s(process: Callable, stages: dict, frame: Picture) -> dict[str, float]:
    watch = Stopwatch()
    with watch.watching(stages):
        watch.timed(REST, process)(frame)
    return watch.spent_s


def _fastest(spent_s: dict[str, np.ndarray], units_s: np.ndarray) -> FrameTime:
    """What counts of times (rounds, frames): of each frame the fastest round."""
    rounds_s = sum(spent_s.values())
    fastest, at = rounds_s.argmin(axis=0), np.arange(units_s.shape[1])
    frames_s, frame_units_s = rounds_s.min(axis=0)[WARM_UP:], units_s.min(axis=0)[WARM_UP:]
    middle_s, unit_s = float(np.median(frames_s)), float(np.median(frame_units_s))
    means_s = {stage: float(values[fastest, at][WARM_UP:].mean()) for stage, values in spent_s.items()}
    shares = {stage: mean_s / float(frame_units_s.mean()) for stage, mean_s in means_s.items()}
    return FrameTime(1e3 * middle_s, middle_s / unit_s, sum(shares.values()), shares)
