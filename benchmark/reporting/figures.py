"""The reliability diagram of the tracker."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.reporting.reliability import AvailableLanes, Reliability
from benchmark.scores import Result
from benchmark.systems import TRACKER
from lanes.figures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUTH_LOOK: dict[str, Any] = {"color": "0.15", "linestyle": "--", "linewidth": 1.3, "zorder": 3}


def save_reliability_figure(path: str | Path, results: Sequence[Result]) -> Path | None:
    """Draw the tracker's reliability diagram; None if the tracker has no lane."""
    of_tracker = [result for result in results if result.system == TRACKER]
    if not any(result.errors.available.any() for result in of_tracker):
        return None
    scenes = len({result.scene for result in results})
    title = f"Is the tracker's confidence calibrated? ({scenes} scene{'s' * (scenes > 1)})"
    figure, _ = plot_reliability(AvailableLanes.from_results(of_tracker).reliability(), title=title)
    return save_figure(figure, path)


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
