"""The measures that chapters 5 and 7 define in cells, against lanes made by hand."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from tests.support.project import ROOT

X = np.arange(0.0, 45, 5)
TRUTH = {
    "x_m": X.tolist(),
    "left_y_m": (1.65 + 0.02 * X).tolist(),
    "right_y_m": (-2.0 + 0.02 * X).tolist(),
}


@pytest.fixture(scope="module")
def functions() -> dict[str, Callable]:
    """All functions that cells of the notebook define, by name."""
    notebook = json.loads((ROOT / "project.ipynb").read_text(encoding="utf-8"))
    names = {"np": np}
    wanted = ("largest_error_m", "split_points", "marking_precision", "marking_recall")
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code" and any(f"def {n}(" in source for n in wanted):
            defined = [
                statement
                for statement in ast.parse(source).body
                if isinstance(statement, ast.FunctionDef)
            ]
            exec(compile(ast.Module(defined, []), cell["id"], "exec"), names)
    return names


def lanes_with(left_per_m: float, right_per_m: float) -> SimpleNamespace:
    """Lines that depart from the true ones by so much for each metre ahead."""

    def lateral_m(x_m: np.ndarray) -> np.ndarray:
        true_m = np.array([TRUTH["left_y_m"], TRUTH["right_y_m"]])
        return true_m + np.outer([left_per_m, right_per_m], x_m)

    return SimpleNamespace(lateral_m=lateral_m)


@pytest.mark.parametrize("slopes", [(0.0, -0.01), (-0.01, 0.0), (0.01, 0.005)])
def test_the_largest_error_is_that_of_both_lines_up_to_30_m(functions, slopes):
    """0.3 m at 30 m; points farther ahead do not count."""
    error_m = functions["largest_error_m"](lanes_with(*slopes), TRUTH)
    assert error_m == pytest.approx(0.3)


@pytest.mark.parametrize("lost", [None, SimpleNamespace(lateral_m=lambda x_m: None)])
def test_the_error_of_a_lost_lane_is_infinite(functions, lost):
    assert functions["largest_error_m"](lost, TRUTH) == np.inf


def road_points(shift_m: float) -> np.ndarray:
    """Points (N, 2) of two stripes 0.3 m wide, `shift_m` left of the true lines."""
    ahead = np.arange(3.0, 40, 0.1)
    points = []
    for key in ("left_y_m", "right_y_m"):
        for across_m in np.linspace(-0.15, 0.15, 7):
            y = np.interp(ahead, X, TRUTH[key]) + shift_m + across_m
            points.append(np.column_stack([ahead, y]))
    return np.vstack(points)


def test_points_on_the_lines_have_precision_1_and_recall_1(functions):
    """Other lanes, the near and the far road do not count."""
    elsewhere = np.array([[20.0, 8.0], [20.0, -8.0], [3.0, 0.0], [35.0, 0.0]])
    points = np.vstack([road_points(0.0), elsewhere])
    assert functions["marking_precision"](points, TRUTH) == 1
    assert functions["marking_recall"](points, TRUTH) == 1


def test_points_next_to_the_lines_have_precision_0_and_recall_0(functions):
    assert functions["marking_precision"](road_points(0.6), TRUTH) == 0
    assert functions["marking_recall"](road_points(0.6), TRUTH) == 0


def test_the_recall_of_a_dash_is_its_length_of_one_line(functions):
    ahead = np.arange(10.0, 20.0, 0.1)
    dash = np.column_stack([ahead, np.interp(ahead, X, TRUTH["right_y_m"]) + 0.1])
    # 10 of the 25 m of one of two lines
    assert functions["marking_recall"](dash, TRUTH) == pytest.approx(0.2, abs=0.01)


def test_without_a_point_precision_and_recall_are_0(functions):
    nothing = np.empty((0, 2))
    assert functions["marking_precision"](nothing, TRUTH) == 0
    assert functions["marking_recall"](nothing, TRUTH) == 0
