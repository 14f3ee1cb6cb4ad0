"""Plots of the notebook: content of the axes."""

from __future__ import annotations

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from course import plots
from course.sketch import sketch_conventions


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
    # distances outside the view are not marked
    grid = SimpleNamespace(x_m=np.linspace(31.0, 7.0, 97), y_m=np.linspace(3, -3, 61))
    _, axes = plots.show_birdseye([np.zeros((97, 61))], ["road"], grid)
    assert [label.get_text() for label in axes[0].get_yticklabels()] == ["10 m", "20 m"]


def test_one_axis_for_each_picture_with_its_title():
    figure, axes = plots.show_pictures([PHOTO] * 3, ["raw", "undistorted", "view"], columns=2)
    assert [axis.get_title() for axis in axes] == ["raw", "undistorted", "view"]
    assert len(figure.axes) == 3
    assert [axis.get_subplotspec().rowspan.start for axis in axes] == [0, 0, 1]


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


def test_histogram():
    counts = np.zeros(160)
    counts[[40, 120]] = 30
    _, axis = plots.plot_histogram(counts, left_px=40, right_px=120)
    assert [line.get_xdata()[0] for line in axis.lines] == [40, 120]
    assert axis.get_xlabel() == "column (pixels)"
    words = [text.get_text() for text in axis.get_legend().get_texts()]
    assert words == ["left start, column 40", "right start, column 120"]


def test_series_has_units_gaps_and_truth():
    times_s = np.arange(5) / 25
    values = np.array([0.1, 0.2, np.nan, 0.4, 0.5])
    series = {"offset (m)": {"measured": values, "truth": values + 0.01}, "curvature (1/m)": {"measured": values}}
    _, axes = plots.plot_series(times_s, series, title="Drive")
    assert [axis.get_ylabel() for axis in axes] == ["offset (m)", "curvature (1/m)"]
    assert axes[-1].get_xlabel() == "time (s)"
    assert axes[0].get_title(loc="left") == "Drive"
    np.testing.assert_array_equal(axes[0].lines[0].get_ydata(), values)
    assert [line.get_linestyle() for line in axes[0].lines] == ["-", "--"]
    assert axes[1].get_legend() is None
    with pytest.raises(ValueError, match="no quantity"):
        plots.plot_series(np.arange(3), {})


def test_bars_have_their_values_and_names():
    _, axis = plots.plot_bars({"calibration1.jpg": 0.5, "calibration2.jpg": 0.25}, label="error (px)", title="boards")
    assert [bar.get_height() for bar in axis.patches] == [0.5, 0.25]
    assert [text.get_text() for text in axis.get_xticklabels()] == ["calibration1.jpg", "calibration2.jpg"]
    assert axis.get_ylabel() == "error (px)"


def telemetry(count: int = 50) -> dict[str, np.ndarray]:
    times_s = np.arange(count) / 25
    state = np.array(["tracking"] * 30 + ["coasting"] * 8 + ["lost"] * 2 + ["tracking"] * 10)
    rows = {"time_s": times_s, "state": state, "confidence": np.where(state == "lost", 0, 0.9)}
    for name, std in (("offset_m", 0.02), ("curvature_per_m", 1e-4)):
        quantity, unit = name.split("_", 1)
        rows[name] = np.where(state == "lost", np.nan, 10 * std * np.sin(times_s))
        rows[f"{quantity}_std_{unit}"] = std * (1 + times_s)
    return rows


def test_telemetry_shows_bands_truth_and_states():
    rows = telemetry()
    figure, axes = plots.plot_telemetry(rows, truth={k: rows[k] for k in ("time_s", "offset_m", "curvature_per_m")})
    assert [axis.get_ylabel().split(" (")[0] for axis in axes] == ["offset", "curvature", "confidence"]
    band = axes[0].collections[0].get_paths()[0].vertices
    # one standard deviation to either side: twice 0.02 m at the first frame
    assert np.ptp(band[np.isclose(band[:, 0], 0), 1]) == pytest.approx(0.04)
    assert [line.get_label() for line in axes[1].lines] == ["measured, ± one standard deviation", "truth"]
    assert [text.get_text() for text in axes[2].get_legend().get_texts()] == ["tracking", "coasting", "lost"]
    tracking, coasting, _lost = axes[0].collections[1:]
    assert len(tracking.get_paths()) == 2
    assert coasting.get_paths()[0].get_extents().x0 == pytest.approx(30 / 25)
    assert coasting.get_paths()[0].get_extents().width == pytest.approx(8 / 25)
    figure.canvas.draw()


def test_a_path_keeps_its_shape():
    turn = np.linspace(0, np.pi, 50)
    path = 100 * np.column_stack([np.sin(turn), 1 - np.cos(turn)])
    figure, axis = plots.plot_path({"measured": path, "truth": path + [0, 1]})
    figure.canvas.draw()
    assert axis.get_aspect() == 1
    np.testing.assert_array_equal(axis.lines[0].get_xydata(), path)
    assert axis.lines[1].get_linestyle() == "--"


def test_three_views_name_every_quantity():
    _, axes = sketch_conventions()
    assert [axis.get_title() for axis in axes] == ["From above", "From the side", "From behind"]
    text = " ".join(note.get_text() for axis in axes for note in axis.texts)
    for quantity in ("x forward", "y left", "z up", "offset > 0", "heading > 0", "curvature > 0"):
        assert quantity in text
    for angle in ("yaw > 0", "pitch > 0", "roll > 0"):
        assert angle in text
