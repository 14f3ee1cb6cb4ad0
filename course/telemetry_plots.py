"""Figures of a drive: telemetry over time, and the driven path on a map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR
from lanes.detect.lane import COASTING, FOUND, LOST, SEARCHING, TRACKING
from lanes.figures import LEGEND_ABOVE, TRUTH_LOOK, new_figure, rgb
from lanes.report.moments import runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of the tracker states, from certain to lost.
STATE_COLOURS = {
    TRACKING: LANE_COLOUR,
    FOUND: LANE_COLOUR,
    SEARCHING: WINDOW_COLOUR,
    COASTING: (255, 140, 0),
    LOST: LEFT_COLOUR,
}


def plot_telemetry(
    rows: Mapping[str, np.ndarray], *, truth: Mapping[str, np.ndarray] | None = None, title: str = ""
) -> tuple[Figure, np.ndarray]:
    """Plot offset and curvature with bands of one standard deviation, the confidence, and the states of a drive.

    Parameters
    ----------
    rows : mapping of str to ndarray of shape (N,)
        Telemetry as returned by `read_telemetry`: time_s, state, confidence, offset_m, offset_std_m, curvature_per_m,
        curvature_std_per_m. NaN leaves a gap.
    truth : mapping of str to ndarray of shape (M,), optional
        Ground truth: time_s, offset_m, curvature_per_m.

    Returns
    -------
    figure, axes : Figure, ndarray of Axes of shape (3,)
        Offset, curvature, confidence; the states colour the time axis of each.
    """
    figure, axes = new_figure(3, 1, (10, 7), sharex=True, height_ratios=(2, 2, 1.2))
    labels = {"offset_m": "offset (m), left > 0", "curvature_per_m": "curvature (1/m), left > 0"}
    for axis, (name, label) in zip(axes, labels.items(), strict=False):
        quantity, unit = name.split("_", 1)
        std = rows[f"{quantity}_std_{unit}"]
        axis.fill_between(rows["time_s"], rows[name] - std, rows[name] + std, color=rgb(RIGHT_COLOUR), alpha=0.25, lw=0)
        axis.plot(rows["time_s"], rows[name], color=rgb(RIGHT_COLOUR), label="measured, ± one standard deviation")
        if truth is not None:
            axis.plot(truth["time_s"], truth[name], label="truth", **TRUTH_LOOK)
        axis.set_ylabel(label)
    axes[2].plot(rows["time_s"], rows["confidence"], color="0.25")
    axes[2].set(xlabel="time (s)", ylabel="confidence", ylim=(0, 1.02))
    for axis in axes:
        axis.grid(alpha=0.3)
        # Leaves room for the strip of states below the curves.
        axis.margins(y=0.12)
        _colour_states(axis, rows["time_s"], rows["state"])
    curves = axes[0].get_legend_handles_labels()[0][: len(axes[0].lines)]
    axes[0].legend(handles=curves, ncols=2, **LEGEND_ABOVE)
    axes[2].legend(loc="lower left", ncols=4, frameon=False)
    axes[0].set_title(title, loc="left")
    return figure, axes


def plot_path(paths_m: Mapping[str, np.ndarray]) -> tuple[Figure, Axes]:
    """Plot driven paths (N, 2) in metres by name, from `integrate_path`, on a map; the path named "truth" is dashed."""
    figure, (axis,) = new_figure(1, 1, (10, 5))
    for name, path in paths_m.items():
        axis.plot(*np.transpose(path), label=name, **(TRUTH_LOOK if name == "truth" else {}))
    axis.plot(0, 0, "o", color="0.15", markersize=5)
    axis.annotate("start", (0, 0), xytext=(6, 6), textcoords="offset points")
    # With equal scales a straight road would give a very narrow axis.
    axis.set(xlabel="ahead of the start (m)", ylabel="to its left (m)", aspect="equal", adjustable="datalim")
    axis.set_title("Driven path", loc="left")
    axis.grid(alpha=0.3)
    if len(paths_m) > 1:
        axis.legend(frameon=False)
    return figure, axis


def _colour_states(axis: Axes, times_s: np.ndarray, states: np.ndarray) -> None:
    """Draw a strip along the bottom of the panel in the colours of the states."""
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    spans: dict[str, list[tuple[float, float]]] = {}
    for state, first, end in runs(states):
        spans.setdefault(state, []).append((times_s[first], times_s[end - 1] - times_s[first] + step_s))
    for state, bars in spans.items():
        look: dict[str, Any] = {"transform": axis.get_xaxis_transform(), "color": rgb(STATE_COLOURS[state]), "lw": 0}
        axis.broken_barh(bars, (0, 0.05), label=state, **look)
