"""Files, pictures, commands and options that README and docs name exist."""

from __future__ import annotations

import argparse
import json
import re
from importlib import import_module
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest

import course
import helpers
import lanes
from benchmark.consistency import consistency_table
from benchmark.tables import read_scores
from lanes.__main__ import COMMANDS
from tests.support.project import ROOT
from tools.course_hours import hours_table, measure_chapters

# Commands that are modules, imported when they are needed; those of `lanes` are
# classes.
MODULES = {"benchmark": "benchmark.__main__", "simulator": "simulator.__main__"}
MODULES |= {name: name for name in ("benchmark.real_roads", "tools.ablation")}
MODULES["course.grading"] = "course.grading.__main__"
KNOWN = {*COMMANDS, *MODULES}
# Options of git, pip, Dask, nbconvert, nbval, YOLOP, Docker and unshare.
OF_OTHERS = {
    "--require-hashes",
    "--depth",
    "--version",
    "--nworkers",
    "--nthreads",
    "--lifetime",
    "--lifetime-stagger",
}
OF_OTHERS |= {
    "--to",
    "--execute",
    "--inplace",
    "--width",
    "--validate-label",
    "--nbval",
    "--map-root-user",
    "--net",
}
OF_OTHERS |= {
    "--rm",
    "--network",
    "--memory",
    "--cpus",
    "--pids-limit",
    "--cap-drop",
    "--security-opt",
}
OF_OTHERS |= {"--user", "--env", "--tmpfs", "--read-only", "--volume", "--workdir"}
# Modules of other projects that README and docs start.
MODULES_OF_OTHERS = {"pip", "pytest", "venv", "build"}
BENCHMARK = ROOT / "docs" / "benchmark"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
each_page = pytest.mark.parametrize(
    "page", PAGES, ids=lambda page: str(page.relative_to(ROOT))
)


def options_of(command: str) -> set[str]:
    parser = argparse.ArgumentParser()
    (COMMANDS.get(command) or import_module(MODULES[command])).add_arguments(parser)
    return {option for action in parser._actions for option in action.option_strings}


@each_page
def test_the_links_modules_and_helpers_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    targets = [target.split("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", text)]
    assert not [
        at
        for at in targets
        if not at.startswith(("http:", "https:")) and not (page.parent / at).exists()
    ]
    packages = "lanes|simulator|benchmark|course|tests|tools"
    paths = re.findall(rf"`((?:{packages})/[\w/]*(?:\.py)?/?)`", text)
    assert not [path for path in paths if not (ROOT / path).exists()]
    without_commands = re.sub(r"python -m \S+", "", text)
    for module in (helpers, course):
        named = set(
            re.findall(rf"(?<![\w/]){module.__name__}\.([a-z_]+)", without_commands)
        ) - {"py"}
        assert not [name for name in named if not hasattr(module, name)]


@each_page
def test_commands_and_their_options_exist(page):
    text = page.read_text(encoding="utf-8")
    for command, rest in re.findall(
        r"python -m (?:lanes )?([a-z]+(?:\.[a-z_]+)?)\b([^`\n]*)", text
    ):
        if command in {"lanes"} | MODULES_OF_OTHERS:
            continue
        if command.startswith("tools.") and command not in KNOWN:
            assert (ROOT / f"{command.replace('.', '/')}.py").exists(), command
            continue
        assert command in KNOWN, command
        options = set(re.findall(r"(?<!\S)--?[a-z][a-z-]*", rest.split("#")[0]))
        assert options <= options_of(command), command
    known = set().union(*map(options_of, KNOWN)) | OF_OTHERS
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) <= known


def test_names_of_lanes_exist():
    """In the Python of the pages, and where the text calls or names them; not the paths
    of modules.
    """
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    named = set(re.findall(r"(?<![\w./])lanes\.([A-Za-z_]+)(?=\(|`)", text))
    assert {"find_lane", "LaneTracker", "LaneError"} <= named <= set(lanes.__all__)


def test_the_finder_of_the_guide_finds_a_lane():
    text = (ROOT / "docs" / "own_finder.md").read_text("utf-8")
    names = {}
    exec(re.search(r"```python\n(# my_finder.py.*?)```", text, re.DOTALL)[1], names)
    camera = lanes.load_camera(ROOT / "test_videos" / "project_video.yaml")
    image = helpers.read_image(ROOT / "test_images" / "straight_lines1.jpg")
    left, right = (np.polyval(line, 10.0) for line in names["my_finder"](image, camera))
    assert 2.5 < left - right < 4.5
    assert names["my_finder"](np.zeros_like(image), camera) is None


def test_each_kind_of_robustness_names_a_test_that_exists():
    """In every table of the page whose last column is the test."""
    lines = (ROOT / "docs" / "robustness.md").read_text(encoding="utf-8").splitlines()
    rows: list[list[str]] = []
    for n, line in enumerate(lines):
        if line.startswith("|") and cells_of(line)[-1] == "test":
            rows += map(
                cells_of, takewhile(lambda row: row.startswith("|"), lines[n + 2 :])
            )
    assert len(rows) >= 20
    for kind, *_, test in rows:
        named = re.fullmatch(r"`(tests/[\w/]+\.py)::(\w+)`", test)
        assert named, f"{kind}: names no test"
        assert f"def {named[2]}(" in (ROOT / named[1]).read_text(encoding="utf-8"), test


def cells_of(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def table_of(page: Path, *headings: str) -> list[list[str]]:
    """The first table of a page whose first columns have these headings: its header and
    its rows.
    """
    lines = page.read_text(encoding="utf-8").splitlines()
    start = next(
        n
        for n, line in enumerate(lines)
        if cells_of(line)[: len(headings)] == list(headings)
    )
    header, _, *rows = map(
        cells_of, takewhile(lambda line: line.startswith("|"), lines[start:])
    )
    return [header, *rows]


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", BENCHMARK / "README.md"], ids=["short", "long"]
)
def test_the_tables_of_scores_are_those_of_the_benchmark(page):
    """They have some of the scenes and of the systems, and all sums."""
    header, _, *lines = map(
        cells_of, course.results_table(BENCHMARK / "benchmark.csv").splitlines()
    )
    known = {tuple(line[:2]): dict(zip(header, line, strict=True)) for line in lines}
    columns, *rows = table_of(page, *header[:2])
    assert {tuple(row[:2]) for row in rows} >= {
        key for key in known if key[0].startswith("all ")
    }
    assert len(rows) >= 10
    assert len(columns) >= 6
    for row in rows:
        assert row == [known[tuple(row[:2])][column] for column in columns]


def test_the_table_of_uncertainties_is_that_of_the_benchmark():
    page = (BENCHMARK / "README.md").read_text(encoding="utf-8").splitlines()
    assert set(
        consistency_table(
            read_scores(BENCHMARK / "consistency.csv", "nees_mean")
        ).splitlines()
    ) <= set(page)


def test_the_table_of_hours_is_that_of_the_notebook():
    """`python -m tools.course_hours` prints it."""
    page = (ROOT / "docs" / "teaching.md").read_text(encoding="utf-8")
    notebook = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))
    assert hours_table(measure_chapters(notebook)) in page
