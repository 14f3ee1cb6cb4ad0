"""How long each stage of each system takes on a frame, in undistorts: the time that taking out the lens takes.

The yardstick is one `cv2.undistort` of the same frame on one OpenCV thread, run just before each measurement: the ratio
says the same on a fast and on a slow machine, and on one that is busy with other things. Times are the process's own
processor time, so that whoever else uses the machine counts little.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
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
    """Medians over frames of one system: processor time in ms and in undistorts; its stages divide the latter."""

    ms: float
    undistorts: float
    stages: dict[str, float]


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
    frames: Sequence[np.ndarray], camera: Camera, *, progress: Callable[[int, int], None] | None = None
) -> dict[str, FrameTime]:
    """Time of detecting, measuring and drawing in consecutive frames, for each system.

    Parameters
    ----------
    frames : sequence of ndarray of shape (height, width, 3), uint8
        More than `WARM_UP`; so many are not counted. In memory: a decoder's threads would be counted too.
    camera : Camera
        With its mount.

    Returns
    -------
    dict of str to FrameTime
        The metric engine while tracking and cold (knowing nothing of the frames before), and each recipe.
    """
    spent: dict[str, list[dict[str, float]]] = defaultdict(list)
    units_s: dict[str, list[float]] = defaultdict(list)
    with one_thread():
        watched = _systems(camera)
        for number, frame in enumerate(frames):
            for name, (process, stages) in watched.items():
                own = frame.copy()  # yardstick and system both find it in the processor's caches
                unit_s, seconds = _undistort_s(own, camera), _stages_s(process, stages, own)
                if number >= WARM_UP:
                    spent[name].append(seconds)
                    units_s[name].append(unit_s)
            if progress:
                progress(number + 1, len(frames))
    return {
        name: _medians(spent[name], np.array(units_s[name]), [*stages, REST]) for name, (_, stages) in watched.items()
    }


def _systems(camera: Camera) -> dict[str, tuple[Callable, dict]]:
    followed, searched = (tracker.LaneTracker(camera) for _ in range(2))
    draw_cold = track_lane(searched, camera)

    def process_cold(frame: np.ndarray) -> object:
        searched.reset()
        return draw_cold(frame)

    systems = {
        TRACKING: (track_lane(followed, camera), METRIC_STAGES),
        COLD: (process_cold, METRIC_STAGES),
    }
    for name in RECIPES:
        finder = LaneFinder(get_recipe(name, camera.size), camera)
        systems[name] = overlay.follow_lane(finder, camera), CLASSIC_STAGES
    return systems


def _undistort_s(frame: np.ndarray, camera: Camera) -> float:
    began_s = time.process_time()
    cv2.undistort(frame, camera.matrix, camera.distortion)
    return time.process_time() - began_s


def _stages_s(process: Callable, stages: dict, frame: np.ndarray) -> dict[str, float]:
    watch = Stopwatch()
    with watch.watching(stages):
        watch.timed(REST, process)(frame)
    return watch.spent_s


def _medians(spent_s: list[dict[str, float]], unit_s: np.ndarray, stages: list[str]) -> FrameTime:
    whole_s = np.array([sum(frame.values()) for frame in spent_s])
    undistorts = float(np.median(whole_s / unit_s))
    # Parts of all the time, not medians: of a stage that only some frames have the median is no part of the whole.
    parts = {stage: sum(frame.get(stage, 0.0) for frame in spent_s) / whole_s.sum() for stage in stages}
    shares = {stage: float(undistorts * part) for stage, part in parts.items()}
    return FrameTime(1e3 * float(np.median(whole_s)), undistorts, shares)
