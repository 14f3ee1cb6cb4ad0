"""The benchmark's figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmark.reporting.reliability import AvailableLanes, Reliability
from benchmark.scores import Result, Row
from benchmark.systems import TRACKER
from helpers import POSE_SUFFIX
from lanes.figures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ERROR = "lateral error 5-20 m ahead, median to 95 % (m)"
AVAILABLE, WRONG = "frames with an available lane (%)", "confident and wrong frames (%)"
TRUTH_LOOK: dict[str, Any] = {"color": "0.15", "linestyle": "--", "linewidth": 1.3, "zorder": 3}
# Of the recipes and the tracker.
MARKERS = "os^Dv"
LIMITS = {ERROR: (0.003, 20.0), AVAILABLE: (0.0, 100.0), WRONG: (0.0, 100.0)}


def save_scores_figure(path: str | Path, rows: Sequence[Row]) -> Path:
    """Draw errors, availability, and confident and wrong frames of each scene, systems next to each other."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    systems = list(dict.fromkeys(row["system"] for row in rows))
    cells = {(row["scene"], row["system"]): row for row in rows}

    def values(key: str, system: str) -> np.ndarray:
        return np.array([cells.get((scene, system), {}).get(key, np.nan) for scene in scenes], float)

    panels = {
        ERROR: {s: (values("lateral_5_20m_median_m", s), values("lateral_5_20m_p95_m", s)) for s in systems},
        AVAILABLE: {s: (100 * values("available_share", s),) * 2 for s in systems},
        WRONG: {s: (100 * values("confident_and_wrong_share", s),) * 2 for s in systems},
    }
    figure, _ = plot_ranges(scenes, panels, limits=LIMITS, title="Every system on every scene")
    return save_figure(figure, path)


def save_reliability_figure(path: str | Path, results: Sequence[Result]) -> Path | None:
    """Draw the tracker's reliability diagram; None if the tracker has no lane."""
    of_tracker = [result for result in results if result.system == TRACKER]
    if not any(result.errors.available.any() for result in of_tracker):
        return None
    scenes = len({result.scene for result in results})
    title = f"Is the tracker's confidence calibrated? ({scenes} scene{'s' * (scenes > 1)})"
    figure, _ = plot_reliability(AvailableLanes.from_results(of_tracker).reliability(), title=title)
    return save_figure(figure, path)


def marker_looks(systems: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Colour and marker of each system.

    Both variants of a recipe have the same ones, but markers of points from the pose are hollow.
    """
    numbers: dict[str, int] = {}
    looks = {}
    for system in systems:
        number = numbers.setdefault(system.removesuffix(POSE_SUFFIX), len(numbers))
        colour, marker = f"C{number}", MARKERS[number % len(MARKERS)]
        fill = "none" if system.endswith(POSE_SUFFIX) else colour
        looks[system] = {"color": colour, "marker": marker, "markerfacecolor": fill, "linestyle": "none"}
    return looks


def plot_ranges(
    names: Sequence[str],
    panels: Mapping[str, Mapping[str, tuple[np.ndarray, np.ndarray]]],
    *,
    limits: Mapping[str, tuple[float, float]],
    title: str = "",
) -> tuple[Figure, np.ndarray]:
    """Plot ranges of several systems: a row for each of the N names, from the top, a panel and axes for each quantity.

    `panels` maps the axis label with its unit, then the system, to both ends of the ranges, each (N,), such as median
    and 95th percentile. The second end gets a marker. NaN is left out; values beyond the limits are drawn at the edge.
    `limits` are the ends of the axis of each label, which is logarithmic if the first end is above zero.
    """
    systems = list(next(iter(panels.values())))
    looks = marker_looks(systems)
    figure, axes = new_figure(1, len(panels), (13, 1.5 + 0.1 * (len(systems) + 1) * len(names)), sharey=True)
    for axis, (label, ranges) in zip(axes, panels.items(), strict=True):
        low, high = limits[label]
        axis.set(xlabel=label, xscale="log" if low > 0 else "linear", xlim=(low, high))
        axis.grid(axis="x", alpha=0.3)
        for at, (system, ends) in enumerate(ranges.items()):
            rows = np.arange(len(names)) + (at - (len(systems) - 1) / 2) / (len(systems) + 1)
            first, last = (np.clip(end, low, high) for end in ends)
            axis.hlines(rows, first, last, color=looks[system]["color"], linewidth=2.5, alpha=0.5)
            axis.plot(last, rows, **looks[system], markersize=4.5, label=system, clip_on=False)
        axis.hlines(np.arange(1, len(names)) - 0.5, low, high, color="0.85", linewidth=0.8)
    axes[0].set_yticks(np.arange(len(names)), names)
    axes[0].set_ylim(len(names) - 0.5, -0.5)
    axes[0].set_title(title, loc="left")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(systems), frameon=False)
    return figure, axes


def plot_reliability(bins: Reliability, *, title: str = "") -> tuple[Figure, Axes]:
    """Plot a reliability diagram: accuracy against confidence, with the number of lanes above each point."""
    confidence, accuracy, low, high, count = bins
    figure, (axes,) = new_figure(1, 1, (8, 6))
    axes.plot([0, 1], [0, 1], **TRUTH_LOOK)
    axes.errorbar(
        confidence, accuracy, [accuracy - low, high - accuracy], fmt="o", color="0.2", ecolor="0.5", capsize=3
    )
    # above the axes and turned, because the points at the right are as close together as a line of text is high
    above = {"transform": axes.get_xaxis_transform(), "rotation": 90, "ha": "center", "va": "bottom"}
    for x, lanes in zip(confidence, count, strict=True):
        axes.text(x, 1.02, f"{lanes}", **above)
    axes.set(
        xlabel="confidence (numbers above: lanes)", ylabel="share of correct lanes", xlim=(0, 1.02), ylim=(0, 1.02)
    )
    axes.set_title(title, loc="left", pad=40)
    axes.grid(alpha=0.3)
    return figure, axes
