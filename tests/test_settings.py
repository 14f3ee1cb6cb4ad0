"""Settings are passed in: each one, changed, changes a result, and no function takes a
module's default in the place of what it was given.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lanes
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PaintSettings, find_evidence
from lanes.detect.road import PARAMETERS
from lanes.detect.search import DetectorSettings, detect_still, search_lane
from lanes.tracking.filter import (
    FilterSettings,
    State,
    car_motion,
    initial_state,
    predict,
    update,
    without_wrong_yaw,
)
from lanes.tracking.tracker import LaneTracker, SearchSchedule, TrackerSettings
from simulator.rendering.drive import Motion
from tests.support.painted_drive import BENDS
from tests.support.painted_roads import ASPHALT, YELLOW, Road, dashcam
from tests.support.shapes import a_lane
from tests.support.static_objects import draw_guide_lines
from tools.ablation import with_value

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
INFINITE = float("inf")


def names_of(settings: Any, *, leave: Collection[str] = ()) -> Iterator[str]:
    """The names of all settings, those of parts after the name of the part."""
    for entry in fields(settings):
        value = getattr(settings, entry.name, None)
        names = [entry.name] if entry.init else []
        if is_dataclass(value):
            names = [f"{entry.name}.{name}" for name in names_of(value)]
        yield from (name for name in names if name not in leave)


def changed(settings: Any, changes: dict[str, Any]) -> Any:
    for name, value in changes.items():
        settings = with_value(settings, name.split("."), value)
    return settings


# Other values of settings of which half the value changes nothing in these scenes.
OTHERS = {
    "paint.gap_m": 0.15,
    "paint.stripes_per_row": 3,
    "votes.prior_weight": 0.5,
    "fit.max_unexplained": 1.0,
    "fit.undulation_gain": INFINITE,
    "fit.min_support": 0.6,
    "max_vertical_per_m": 1e-4,
    "min_score": 2.5,
    "start_period_s": 0.5,
    "pose_period_s": 0.1,
    "slowest": 1.0,
}


def with_other(settings: Any, name: str) -> Any:
    """The settings with another value of one of them."""
    half = half_of(attrgetter(name)(settings))
    return changed(settings, {name: OTHERS.get(name, half)})


def half_of(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(half_of, value))
    return max(value // 2, 1) if isinstance(value, int) else value / 2


def is_same(first: list[np.ndarray], second: list[np.ndarray]) -> bool:
    return len(first) == len(second) and all(map(np.array_equal, first, second))


# A search in one image.


@cache
def bend() -> np.ndarray:
    """An image of a bend with dashed and double lines, and a line as faint as noise."""
    road = Road(CAMERA, noise=4.0)
    curvature_per_m = 1 / 120

    def line_at(y_m: float, **look: Any) -> None:
        road.line(lambda x: y_m + curvature_per_m * x**2 / 2, **look)

    line_at(1.75, colour=YELLOW, dash_m=(6, 4))
    line_at(-1.75, width_m=0.1)
    line_at(-2.05, width_m=0.1)
    line_at(5.15)
    line_at(-0.6, colour=tuple(np.add(ASPHALT, 14)))
    return road.image()


def search(settings: DetectorSettings) -> list[np.ndarray]:
    """What a search finds in the bend: stripes, votes, starts, and the lane."""
    evidence = find_evidence(bend(), VIEW, settings.paint, quick=True)
    found = search_lane(evidence, settings)
    results = [*vars(evidence.stripes).values()]
    if found.search:
        results += [found.search.votes, found.search.starts.lanes]
    if found.lane:
        supports = [line.support for line in found.lane.lines]
        seen = [line.seen for line in found.lane.lines]
        results += [found.lane.model, found.lane.fit_covariance]
        results += [np.array(supports), np.array(seen)]
    return results


# Every fit is also made on a road that undulates, and taken.
UNDULATES = {"fit.max_unexplained": 0.0, "fit.undulation_gain": -INFINITE}
SEARCH = changed(DetectorSettings(), UNDULATES)
# Of other steps, or of the tracker, with tests below.
NOT_OF_SEARCH = {
    "near_m",
    "half_width_m",
    "paint.edge_weight",
    "fit.variance_inflation",
}


@pytest.fixture(scope="module")
def usual_search() -> list[np.ndarray]:
    return search(SEARCH)


@pytest.mark.parametrize("name", [*names_of(SEARCH, leave=NOT_OF_SEARCH)])
def test_each_setting_of_a_search_changes_what_it_finds(usual_search, name):
    assert not is_same(search(with_other(SEARCH, name)), usual_search)


@pytest.mark.parametrize("change", [{"near_m": 8.0}, {"half_width_m": 4.0}])
def test_the_extent_of_the_view_of_a_still_is_a_setting(change):
    view = detect_still(bend(), CAMERA, DetectorSettings(**change)).evidence.view
    assert {name: getattr(view, name) for name in change} == change


def test_a_line_without_paint_stays_an_edge_if_edges_have_less_weight():
    grass = Road(CAMERA).lines(1.8).paint(lambda x, y: y < -1.7, (96, 120, 60))
    paint = PaintSettings(edge_weight=0.05)
    found = detect_still(grass.image(), CAMERA, DetectorSettings(paint=paint))
    assert found.lane.right.edge
    assert found.evidence.stripes.full_weight.min() == 0.05


# The filter.

BENDS_UP_AND_LEFT = a_lane(
    centre=0.3,
    width=3.6,
    heading=0.03,
    curvature=1e-2,
    rate=1e-4,
    pitch=0.01,
    vertical=1e-3,
    rate_steps=1e-4,
)
LANE_STD = np.full(PARAMETERS, 1e-3)


def estimates(settings: FilterSettings) -> list[np.ndarray]:
    """What the filter estimates in a bend, with and without a given speed."""
    lane = BENDS_UP_AND_LEFT
    covariance = np.diag(LANE_STD**2)
    straight = np.where(np.arange(PARAMETERS) < 3, lane, 0.0)
    standing = initial_state(straight, covariance, 5.0, settings)
    states = [without_wrong_yaw(standing, settings)]
    for speed_mps in (None, 15.0):
        begun = initial_state(lane, covariance, speed_mps, settings)
        later = predict(begun, 0.1, settings, speed_mps=speed_mps)
        fast = State(later.mean + 99.0 * (later.mean > 10), later.covariance)
        states += [begun, later, update(fast, lane, covariance, settings)]
    course_rad = [car_motion(state, settings).course_rad for state in states]
    results = [np.array(course_rad)]
    for state in states:
        results += [state.mean, state.covariance]
    return results


@pytest.mark.parametrize("name", [*names_of(FilterSettings())])
def test_each_setting_of_the_filter_changes_an_estimate(name):
    settings = with_other(FilterSettings(), name)
    assert not is_same(estimates(settings), estimates(FilterSettings()))


# The tracker.


@cache
def frames() -> list[np.ndarray]:
    """Five a second: a lane, three black images, and the lane again."""
    shown = [BENDS.frame(number / 5) for number in range(10)]
    shown[5:8] = [np.zeros_like(shown[0])] * 3
    return shown


def follow(settings: TrackerSettings) -> list[np.ndarray]:
    """What the tracker finds in each frame: width of the view, stripes, and lane."""
    tracker = LaneTracker(BENDS.camera, fps=5.0, settings=settings)
    results = []
    for image in frames():
        tracker.update(image)
        lane = tracker.tracked_lane
        results += [tracker.evidence.view.y_m, tracker.evidence.stripes.y_m]
        if lane:
            results += [np.array([lane.state]), lane.model, lane.fit_covariance]
    return results


OF_SCHEDULE = {"pose_period_s", "slowest"}
# With tests below.
NOT_OF_TRACK = {"challenger_margin", "static_period_s", *OF_SCHEDULE}
OF_TRACK = ["detector.fit.variance_inflation"]
for name in names_of(TrackerSettings(), leave=NOT_OF_TRACK):
    if not name.startswith(("detector.", "filter.")):
        OF_TRACK.append(name)


@pytest.fixture(scope="module")
def usual_track() -> list[np.ndarray]:
    return follow(TrackerSettings())


@pytest.mark.slow
@pytest.mark.parametrize("name", OF_TRACK)
def test_each_setting_of_the_tracker_changes_a_track(usual_track, name):
    assert not is_same(follow(with_other(TrackerSettings(), name)), usual_track)


@pytest.mark.parametrize(("margin", "is_taken"), [(0.1, True), (9.0, False)])
def test_a_better_lane_is_taken_if_its_score_is_larger_by_the_margin(margin, is_taken):
    """Beside the dashed lines that are tracked, solid ones appear."""
    road = Road(CAMERA).lines(0.6, -2.9, dash_m=(3, 9))
    dashed = road.image()
    road = road.lines(1.8, -1.8)
    settings = TrackerSettings(challenger_margin=margin)
    tracker = LaneTracker(CAMERA, fps=1.0, speed_mps=0.0, settings=settings)
    tracker.update(dashed)
    for seed in range(3):
        # other noise: an image that is repeated is no measurement
        road.seed = seed
        lane = tracker.update(road.image())
    assert (lane is not None and abs(lane.offset_m) < 0.1) == is_taken


def due_times(settings: TrackerSettings) -> list[np.ndarray]:
    """Frames, ten a second and without a lane, with a search, and with a pose."""
    schedule = SearchSchedule(settings, fps=10.0)
    searched = []
    posed = []
    for number in range(300):
        schedule.advance(0.1)
        if schedule.is_search_due(sure=False):
            schedule.searched()
            searched.append(number)
        schedule.end_frame(0.1, likely=False)
        if schedule.is_pose_due():
            schedule.pose_tried()
            posed.append(number)
    return [np.array(searched), np.array(posed)]


@pytest.mark.parametrize("name", sorted(OF_SCHEDULE))
def test_each_setting_of_the_schedule_changes_when_something_is_due(name):
    settings = with_other(TrackerSettings(), name)
    assert not is_same(due_times(settings), due_times(TrackerSettings()))


@pytest.mark.slow
def test_what_never_moves_is_known_after_six_periods():
    sways = Motion(60.0, 25.0, offset_m=0.3, wander_m=0.4, pitch_rad=0.01)
    drive = replace(BENDS, motion=sways)
    stripes = {}
    for period_s in (0.5, 0.1):
        settings = TrackerSettings(static_period_s=period_s)
        tracker = LaneTracker(BENDS.camera, fps=10.0, settings=settings)
        for number in range(11):
            tracker.update(draw_guide_lines(drive.frame(number / 10)))
        stripes[period_s] = len(tracker.evidence.stripes)
    assert stripes[0.1] < stripes[0.5] - 30


# No default in the place of what is passed in.

MODULES = sorted(Path(lanes.__file__).parent.rglob("*.py"))


def is_default(node: ast.AST, names: set[str]) -> bool:
    """Whether a node is the default of a module, or makes settings of no arguments."""
    if isinstance(node, ast.Name):
        return node.id in names
    if not isinstance(node, ast.Call) or node.args or node.keywords:
        return False
    return isinstance(node.func, ast.Name) and node.func.id.endswith("Settings")


@cache
def defaults_of_modules() -> set[str]:
    """Names such as `PAINT` in ``PAINT = PaintSettings()`` at the level of a module."""
    names: set[str] = set()
    for module in MODULES:
        for statement in ast.parse(module.read_text()).body:
            if isinstance(statement, ast.Assign) and is_default(statement.value, set()):
                names |= {target.id for target in statement.targets}
    return names


def steps_of(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """What a function does, but what it does if it was given None."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "settings is None":
            continue
        yield node
        waiting += ast.iter_child_nodes(node)


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.stem)
def test_no_function_takes_the_default_of_a_module(module):
    names = defaults_of_modules()
    functions = ast.walk(ast.parse(module.read_text()))
    taken = []
    for function in functions:
        if isinstance(function, ast.FunctionDef):
            for step in steps_of(function):
                if is_default(step, names):
                    taken.append(f"{function.name}: {ast.unparse(step)}")
    assert taken == []
