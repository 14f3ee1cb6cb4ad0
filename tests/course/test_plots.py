"""Plots of the notebook: content of the axes."""

from __future__ import annotations

import warnings
from itertools import combinations
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from course import plots
from course.sketch import SKETCHES, sketch


@pytest.fixture(autouse=True)
def close_figures():
    plt.switch_backend("agg")
    yield
    plt.close("all")


PHOTO = np.zeros((72, 128, 3), np.uint8)


def test_marks_ahead_lie_on_the_rows_of_these_distances():
    grid = SimpleNamespace(x_m=np.geomspace(80.0, 5.0, 97), y_m=np.linspace(9, -9, 181))
    figure, axes = plots.show_birdseye([np.zeros((97, 181))] * 2, ["road", "response"], grid, cmap="magma")
    assert [axis.get_title() for axis in axes] == ["road", "response"]
    labels = [label.get_text() for label in axes[0].get_yticklabels()]
    assert labels == ["5 m", "10 m", "20 m", "40 m"]
    assert axes[0].get_yticks() == pytest.approx([96, 72, 48, 24], abs=0.1)
    assert axes[0].get_xlim() == (9, -9)


@pytest.mark.parametrize(
    ("mask", "limits"),
    [(np.eye(9) > 0, (0, 1)), (np.zeros((9, 9), np.uint8), (0, 1)), (np.eye(9, dtype=np.uint8) * 100, (0, 255))],
)
def test_masks_are_gray_with_fixed_limits(mask, limits):
    """An empty mask must come out black, and a dim gray picture dim."""
    _, axes = plots.show_pictures([mask], ["mask"])
    shown = axes[0].images[0]
    assert shown.get_clim() == limits
    assert shown.cmap.name == "gray"
    for images, titles in (([], []), ([PHOTO], ["a", "b"])):
        with pytest.raises(ValueError, match=f"got {len(images)} images and {len(titles)} titles"):
            plots.show_pictures(images, titles)


def test_series_has_units_gaps_and_truth():
    times_s = np.arange(5) / 25
    values = np.array([0.1, 0.2, np.nan, 0.4, 0.5])
    series = {"offset (m)": {"measured": values, "truth": values + 0.01}, "curvature (1/m)": {"measured": values}}
    _, axes = plots.plot_series(times_s, series, title="Drive")
    labels = axes[0].get_ylabel(), axes[1].get_ylabel(), axes[1].get_xlabel()
    assert labels == ("offset (m)", "curvature (1/m)", "time (s)")
    np.testing.assert_array_equal(axes[0].lines[0].get_ydata(), values)
    assert [line.get_linestyle() for line in axes[0].lines] == ["-", "--"]
    assert axes[1].get_legend() is None
    with pytest.raises(ValueError, match="no quantity"):
        plots.plot_series(np.arange(3), {})


def test_a_curve_named_in_dots_is_dots_without_a_line():
    values = np.array([1.0, 2.0, 3.0])
    series = {"column": {"single": values, "mean": values}}
    _, axes = plots.plot_series(np.arange(3), series, dots=["single"])
    dots, line = axes[0].lines
    assert (dots.get_linestyle(), dots.get_marker()) == ("None", "o")
    assert (line.get_linestyle(), line.get_marker()) == ("-", "None")


def test_a_table_has_the_names_and_the_rounded_numbers():
    rows = {"A": {"warp": 1.26, "fit": 20.0}, "B": {"warp": 3.0, "fit": 0.04}}
    _, axis = plots.show_table(rows, title="Milliseconds")
    (table,) = axis.tables
    texts = {}
    for place, cell in table.get_celld().items():
        texts[place] = cell.get_text().get_text()
    assert axis.get_title() == "Milliseconds"
    assert [texts[0, 0], texts[0, 1]] == ["warp", "fit"]
    assert [texts[1, -1], texts[1, 0], texts[1, 1]] == ["A", "1.3", "20.0"]
    assert [texts[2, -1], texts[2, 0], texts[2, 1]] == ["B", "3.0", "0.0"]


@pytest.mark.parametrize("name", SKETCHES)
def test_sketch_texts_are_whole_and_apart(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure, axes = sketch(name)
        figure.canvas.draw()
    assert figure.bbox.width == 960
    texts = [text for axis in axes for text in axis.texts if text.get_text()]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    margin_px = 3
    low, high = figure.bbox.min + margin_px, figure.bbox.max - margin_px
    assert [text for text, box in boxes if (box.min < low).any() or (box.max > high).any()] == []
    assert [(one, other) for (one, box), (other, near) in combinations(boxes, 2) if box.overlaps(near)] == []
