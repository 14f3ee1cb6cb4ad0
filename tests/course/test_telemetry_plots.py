"""Figures of a drive: telemetry with its bands and states, and the driven path."""

from __future__ import annotations

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

from course.telemetry_plots import plot_path, plot_telemetry  # noqa: E402


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


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
    figure, axes = plot_telemetry(rows, truth={k: rows[k] for k in ("time_s", "offset_m", "curvature_per_m")})
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
    figure, axis = plot_path({"measured": path, "truth": path + [0, 1]})
    figure.canvas.draw()
    assert axis.get_aspect() == 1
    np.testing.assert_array_equal(axis.lines[0].get_xydata(), path)
    assert axis.lines[1].get_linestyle() == "--"
