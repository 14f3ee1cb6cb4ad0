"""Settings are passed in: each one, changed, changes a result, and no function takes a
module's default in the place of what it was given.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
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


def names_of(settings: Any, before: str = "") -> Iterator[str]:
    """The names of all settings, those of parts after the name of the part."""
    for entry in fields(settings):
        value = getattr(settings, entry.name, None)
        if is_dataclass(value):
            yield from names_of(value, f"{before}{entry.name}.")
        elif entry.init:
            yield f"{before}{entry.name}"


def changed(settings: Any, changes: dict[str, Any]) -> Any:
    for name, value in changes.items():
        settings = with_value(settings, name.split("."), value)
    return settings


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
# Another value of each setting of a search.
OF_SEARCH = {
    "paint.single_m": 0.25,
    "paint.double_m": 0.55,
    "paint.gap_m": 0.15,
    "paint.noise_window": (1.0, 3),
    "paint.noise_floor": 3.0,
    "paint.min_strength": 5.0,
    "paint.stripes_per_row": 3,
    "paint.coarse_columns": 1,
    "paint.half_weight_strength": 9.0,
    "paint.angle_std_rad": 0.2,
    "paint.position_std_m": 0.1,
    "votes.far_m": 15.0,
    "votes.headings": (3, 0.05, 0.2),
    "votes.curvatures": (4, 0.002, 0.3),
    "votes.bin_m": 0.2,
    "votes.bins": 50,
    "votes.prior_weight": 0.5,
    "votes.lanes": 1,
    "fit.prior.centre_m": (0.5, 0.1, 3.0),
    "fit.prior.heading_rad": (0.0, 0.01, 0.7),
    "fit.prior.width_m": (3.0, 0.1, 6.0),
    "fit.prior.adjacent_m": (0.3, 0.01, 0.5),
    "fit.prior.curvature_per_m": (0.0, 1e-3, 0.12),
    "fit.prior.rate_per_m2": (0.0, 1e-6, 0.01),
    "fit.prior.rate_step_per_m2": (0.0, 1e-2, 0.01),
    "fit.prior.pitch_rad": (0.0, 1e-4, 0.06),
    "fit.prior.vertical_per_m": (0.0, 1e-2, 0.015),
    "fit.prior.curvature_share": 0.0,
    "fit.prior.transition_m": 100.0,
    "fit.prior.rate_step_share": 0.0,
    "fit.prior.vertical_bend_share": 0.0,
    "fit.prior.vertical_share": 0.0,
    "fit.start": ((12, 6), (18, 4)),
    "fit.extend": ((30, 3), (50, 1)),
    "fit.outwards": ((20, 3), (50, 1)),
    "fit.nearby": (0.0, 0.0, 0.0),
    "fit.max_unexplained": 1.0,
    "fit.undulation_gain": INFINITE,
    "fit.support_far_m": 20.0,
    "fit.min_support": 0.6,
}


@pytest.fixture(scope="module")
def usual_search() -> list[np.ndarray]:
    return search(changed(DetectorSettings(), UNDULATES))


@pytest.mark.parametrize("name", OF_SEARCH)
def test_each_setting_of_a_search_changes_what_it_finds(usual_search, name):
    settings = changed(DetectorSettings(), UNDULATES | {name: OF_SEARCH[name]})
    assert not is_same(search(settings), usual_search)


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


# Another value of each setting of the filter.
OF_FILTER = {
    "usual_speed_mps": (20.0, 5.0),
    "given_speed_std_mps": 1.0,
    "lateral_mps2": (2.0, 4.0),
    "lever_m": 0.5,
    "tangent_mps": 40.0,
    "pose_std_rad": 0.01,
    "standing": (0.0, 0.02, 5e-3),
    "vertical_decay_m": 50.0,
    "centre_m_per_s": 0.1,
    "heading_rad_per_s": 0.1,
    "pitch_rad_per_s": 0.1,
    "rest_pitch_rad_per_s": 0.1,
    "speed_mps_per_s": 9.0,
    "path_per_m_per_s": (0.1, 0.3),
    "camera_yaw_rad_per_s": 0.1,
    "width_m_per_m": 0.1,
    "curvature_per_m_per_m": 1e-4,
    "rate_per_m2_per_m": (1e-4, 1.0),
    "rate_step_per_m2_per_m": (1e-4, 0.2),
    "max_rate_step_per_m2_per_m": 1e-6,
    "vertical_per_m": (1e-3, 0.03),
    "vertical_share": 0.5,
    "max_vertical_per_m": 1e-4,
}


@pytest.mark.parametrize("name", OF_FILTER)
def test_each_setting_of_the_filter_changes_an_estimate(name):
    settings = FilterSettings(**{name: OF_FILTER[name]})
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


# Another value of each setting of the tracker.
OF_TRACKER = {
    "detector.fit.variance_inflation": 1.0,
    "min_score": 2.5,
    "confirmations": 1,
    "max_coast_s": 0.3,
    "max_std_m": 0.01,
    "search_period_s": 0.1,
    "start_period_s": 0.5,
    "half_widths_m": (4.5, 5.0),
}


@pytest.fixture(scope="module")
def usual_track() -> list[np.ndarray]:
    return follow(TrackerSettings())


@pytest.mark.slow
@pytest.mark.parametrize("name", OF_TRACKER)
def test_each_setting_of_the_tracker_changes_a_track(usual_track, name):
    settings = changed(TrackerSettings(), {name: OF_TRACKER[name]})
    assert not is_same(follow(settings), usual_track)


@pytest.mark.parametrize(("margin", "is_taken"), [(0.1, True), (9.0, False)])
def test_a_better_lane_is_taken_if_its_score_is_larger_by_the_margin(margin, is_taken):
    """Beside the dashed lines that are tracked, solid ones appear."""
    road = Road(CAMERA).lines(0.6, -2.9, dash_m=(3, 9))
    dashed = road.image()
    both = road.lines(1.8, -1.8).image()
    settings = TrackerSettings(challenger_margin=margin)
    tracker = LaneTracker(CAMERA, fps=1.0, speed_mps=0.0, settings=settings)
    for image in [dashed, both, both, both, both]:
        lane = tracker.update(image)
    assert (lane is not None and abs(lane.offset_m) < 0.1) == is_taken


# Another value of each setting of when to look for a pose, and when without a lane.
OF_SCHEDULE = {"pose_period_s": 0.1, "slowest": 1.0}


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


@pytest.mark.parametrize("name", OF_SCHEDULE)
def test_each_setting_of_the_schedule_changes_when_something_is_due(name):
    settings = TrackerSettings(**{name: OF_SCHEDULE[name]})
    assert not is_same(due_times(settings), due_times(TrackerSettings()))


@pytest.mark.slow
def test_what_never_moves_is_known_after_six_periods():
    sways = Motion(60.0, 25.0, offset_m=0.3, wander_m=0.4, pitch_rad=0.01)
    drive = replace(BENDS, motion=sways)
    stripes = {}
    for period_s in (0.5, 0.1):
        settings = TrackerSettings(static_period_s=period_s)
        tracker = LaneTracker(BENDS.camera, fps=10.0, settings=settings)
        for number in range(10):
            tracker.update(draw_guide_lines(drive.frame(number / 10)))
        stripes[period_s] = len(tracker.evidence.stripes)
    assert stripes[0.1] < stripes[0.5] - 30


def test_every_setting_has_a_test():
    elsewhere = {"challenger_margin", "static_period_s"}
    elsewhere |= {"detector.near_m", "detector.half_width_m"}
    elsewhere.add("detector.paint.edge_weight")
    tested = {f"detector.{name}" for name in OF_SEARCH}
    tested |= {f"filter.{name}" for name in OF_FILTER}
    tested |= OF_TRACKER.keys() | OF_SCHEDULE.keys() | elsewhere
    assert set(names_of(TrackerSettings())) == tested


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
