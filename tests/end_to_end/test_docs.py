"""Files, pictures, commands and options that README and docs name exist."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import course
import helpers
import lanes
from benchmark.consistency import consistency_table
from benchmark.real_roads.published import confidence_table, points_table
from benchmark.tables import read_scores
from lanes.__main__ import COMMANDS
from tests.support.painted_roads import LaneRoad, paint_lane
from tests.support.project import ROOT
from tools.course_hours import hours_table, measure_chapters

# Commands that are modules, imported when needed; those of `lanes` are classes.
MODULES = {
    "benchmark": "benchmark.__main__",
    "benchmark.real_roads": "benchmark.real_roads.__main__",
    "benchmark.rivals": "benchmark.rivals",
    "course.grading": "course.grading.__main__",
    "simulator": "simulator.__main__",
    "tools.ablation": "tools.ablation",
    "tools.train_marking_network": "tools.train_marking_network",
}
KNOWN = {*COMMANDS, *MODULES}
# Options of git, pip, Dask, labelme, nbconvert, nbval, YOLOP, Docker and unshare.
OF_OTHERS = {
    "--cap-drop",
    "--cpus",
    "--depth",
    "--env",
    "--execute",
    "--inplace",
    "--lifetime",
    "--lifetime-stagger",
    "--map-root-user",
    "--memory",
    "--nbval",
    "--net",
    "--network",
    "--nthreads",
    "--nworkers",
    "--pids-limit",
    "--read-only",
    "--require-hashes",
    "--rm",
    "--security-opt",
    "--tmpfs",
    "--to",
    "--user",
    "--validate-label",
    "--version",
    "--volume",
    "--width",
    "--workdir",
}
# Modules of other projects that README and docs start.
MODULES_OF_OTHERS = {"pip", "pytest", "venv", "build"}
BENCHMARK = ROOT / "docs" / "benchmark"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


each_page = pytest.mark.parametrize("page", PAGES, ids=name_of)


@cache
def options_of(command: str) -> set[str]:
    source = COMMANDS.get(command) or import_module(MODULES[command])
    options = set()
    # a program of several commands, or one
    for one in getattr(source, "COMMANDS", {"": source}).values():
        parser = argparse.ArgumentParser()
        one.add_arguments(parser)
        for action in parser._actions:
            options.update(action.option_strings)
    return options


@each_page
def test_the_targets_of_links_exist(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", read(page)):
        path, _, _ = target.partition("#")
        is_file = not path.startswith(("http:", "https:"))
        assert not is_file or (page.parent / path).exists(), target


@each_page
def test_the_modules_that_are_named_exist(page):
    packages = "lanes|simulator|benchmark|course|tests|tools"
    for path in re.findall(rf"`((?:{packages})/[\w/]*(?:\.py)?/?)`", read(page)):
        assert (ROOT / path).exists(), path


@each_page
@pytest.mark.parametrize("module", [helpers, course], ids=["helpers", "course"])
def test_the_functions_that_are_named_exist(page, module):
    without_commands = re.sub(r"python -m \S+", "", read(page))
    pattern = rf"(?<![\w/]){module.__name__}\.([a-z_]+)"
    for name in re.findall(pattern, without_commands):
        assert name == "py" or hasattr(module, name), name


def commands_of(page: Path) -> Iterator[tuple[str, str]]:
    """Our commands on a page, each with the rest of its line."""
    pattern = r"python -m (?:lanes )?([a-z]+(?:\.[a-z_]+)?)\b([^`\n]*)"
    for command, rest in re.findall(pattern, read(page)):
        if command not in {"lanes"} | MODULES_OF_OTHERS:
            yield command, rest


@each_page
def test_the_commands_exist(page):
    for command, _ in commands_of(page):
        tool = ROOT / f"{command.replace('.', '/')}.py"
        is_tool = command.startswith("tools.") and tool.exists()
        assert is_tool or command in KNOWN, command


@each_page
def test_the_commands_have_the_options_that_are_given(page):
    for command, rest in commands_of(page):
        if command in KNOWN:
            words, _, _ = rest.partition("#")
            given = set(re.findall(r"(?<!\S)--?[a-z][a-z-]*", words))
            assert given <= options_of(command), command


@each_page
def test_the_options_that_are_named_exist(page):
    known = OF_OTHERS.union(*map(options_of, KNOWN))
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", read(page))) <= known


def test_names_of_lanes_exist():
    """In the Python of the pages, and where the text calls or names them.

    Paths of modules are left out.
    """
    text = "\n".join(map(read, PAGES))
    named = set(re.findall(r"(?<![\w./])lanes\.([A-Za-z_]+)(?=\(|`)", text))
    assert named >= {"find_lane", "LaneTracker", "LaneError"}
    assert named <= set(lanes.__all__)


class TestOwnFinder:
    """The finder of docs/own_finder.md."""

    @pytest.fixture
    def camera(self) -> lanes.Camera:
        return lanes.load_camera(ROOT / "test_videos" / "project_video.yaml")

    @pytest.fixture
    def find(self, camera) -> Callable:
        """The function of an image by the camera."""
        text = read(ROOT / "docs" / "own_finder.md")
        code = re.search(r"```python\n(# my_finder.py.*?)```", text, re.DOTALL)[1]
        names: dict[str, Any] = {}
        exec(code, names)
        return lambda image: names["my_finder"](image, camera)

    def test_the_lane_of_a_straight_road_has_its_width(self, find):
        image = helpers.read_image(ROOT / "test_images" / "straight_lines1.jpg")
        left_m, right_m = (np.polyval(line, 10.0) for line in find(image))
        assert 2.5 < left_m - right_m < 4.5

    @pytest.mark.parametrize("curvature_per_m", [1 / 500, -1 / 500])
    def test_the_lines_of_a_bend_have_its_curvature(
        self, find, camera, curvature_per_m
    ):
        road = LaneRoad(curvature_per_m=curvature_per_m, offset_m=0.3)
        for line in find(paint_lane(road, camera)):
            assert line[0] == pytest.approx(curvature_per_m / 2, rel=0.2)

    @pytest.mark.parametrize("heading_rad", [0.02, -0.02])
    def test_the_lines_of_a_bend_are_those_of_the_road(self, find, camera, heading_rad):
        """The lane is 3.7 m wide, and the car 0.3 m left of its centre."""
        road = LaneRoad(curvature_per_m=1 / 500, offset_m=0.3, heading_rad=heading_rad)
        x_m = np.array([0.0, 10.0, 20.0])
        centre_m = -0.3 + heading_rad * x_m + x_m**2 / 1000
        left, right = find(paint_lane(road, camera))
        np.testing.assert_allclose(np.polyval(left, x_m), centre_m + 1.85, atol=0.06)
        np.testing.assert_allclose(np.polyval(right, x_m), centre_m - 1.85, atol=0.06)

    def test_a_black_image_has_no_lane(self, find):
        assert find(np.zeros((720, 1280, 3), np.uint8)) is None


def test_each_kind_of_robustness_names_a_test_that_exists():
    """In every table of the page whose last column is the test."""
    lines = read(ROOT / "docs" / "robustness.md").splitlines()
    rows: list[list[str]] = []
    for number, line in enumerate(lines):
        if line.startswith("|") and cells_of(line)[-1] == "test":
            rows += map(cells_of, takewhile(is_row, lines[number + 2 :]))
    assert len(rows) >= 20
    for kind, *_, test in rows:
        named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", test)
        assert named, f"{kind}: names no test"
        for path, function in named:
            assert f"def {function}(" in read(ROOT / path), test


def is_row(line: str) -> bool:
    return line.startswith("|")


def cells_of(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def table_of(page: Path, *headings: str) -> list[list[str]]:
    """The first table of a page whose first columns have these headings.

    Its header and its rows.
    """
    lines = read(page).splitlines()
    other = takewhile(
        lambda line: cells_of(line)[: len(headings)] != [*headings], lines
    )
    table = takewhile(is_row, lines[len(list(other)) :])
    header, _, *rows = map(cells_of, table)
    return [header, *rows]


@pytest.fixture(params=[ROOT / "README.md", BENCHMARK / "README.md"], ids=name_of)
def page(request) -> Path:
    return request.param


@pytest.fixture
def scores() -> dict[tuple[str, str], dict[str, str]]:
    """The cells of the benchmark by scene and difficulty, each by its heading."""
    table = course.results_table(BENCHMARK / "benchmark.csv").splitlines()
    header, _, *rows = map(cells_of, table)
    return {(row[0], row[1]): dict(zip(header, row, strict=True)) for row in rows}


def test_the_tables_of_scores_have_all_sums(page, scores):
    """And some of the scenes and of the systems."""
    columns, *rows = table_of(page, "scene", "difficulty")
    totals = {key for key in scores if key[0].startswith("all ")}
    assert {(row[0], row[1]) for row in rows} >= totals
    assert len(rows) >= 10
    assert len(columns) >= 6


def test_the_tables_of_scores_are_those_of_the_benchmark(page, scores):
    columns, *rows = table_of(page, "scene", "difficulty")
    for row in rows:
        cells = scores[row[0], row[1]]
        assert row == [cells[column] for column in columns]


def test_the_table_of_uncertainties_is_that_of_the_benchmark():
    rows = read_scores(BENCHMARK / "consistency.csv", "nees_mean")
    table = consistency_table(rows).splitlines()
    assert set(table) <= set(read(BENCHMARK / "README.md").splitlines())


@pytest.mark.parametrize("table", [points_table, confidence_table])
def test_the_tables_of_found_roads_are_those_of_the_published_lanes(table):
    """`python -m benchmark.real_roads.published` prints them."""
    assert table() in read(ROOT / "docs" / "found_roads.md")


def test_the_table_of_hours_is_that_of_the_notebook():
    """`python -m tools.course_hours` prints it."""
    notebook = json.loads(read(ROOT / "project.ipynb"))
    assert hours_table(measure_chapters(notebook)) in read(
        ROOT / "docs" / "teaching.md"
    )
