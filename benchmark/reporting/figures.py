"""The benchmark's figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmark.reporting.reliability import StatedLanes
from benchmark.scores import Result, Row
from benchmark.systems import TRACKER
from lanes.drawing.figures import TRUTH_LOOK, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERROR, GIVEN, WRONG = "error over 5-20 m, median to 95 % (m)", "frames with a lane given (%)", "surely wrong frames (%)"
# Share of the height of a panel that a small label takes.
LABEL_ROOM = 0.06
LIMITS = {ERROR: (0.003, 10.0), GIVEN: (0.0, 100.0), WRONG: (0.0, 100.0)}


def save_scores_figure(path: str | Path, rows: Sequence[Row]) -> Path:
    """Draw error, availability and surely wrong frames of each scene, systems side by side."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    systems = list(dict.fromkeys(row["system"] for row in rows))
    cells = {(row["scene"], row["system"]): row for row in rows}

    def values(key: str, system: str) -> np.ndarray:
        return np.array([cells.get((scene, system), {}).get(key, np.nan) for scene in scenes], float)

    panels = {
        ERROR: {s: (values("lateral_5_20m_median_m", s), values("lateral_5_20m_p95_m", s)) for s in systems},
        GIVEN: {s: (100 * values("available_share", s),) * 2 for s in systems},
        WRONG: {s: (100 * values("confidently_wrong_share", s),) * 2 for s in systems},
    }
    figure, _ = plot_ranges(scenes, panels, limits=LIMITS, title="Every system on every scene")
    return save_figure(figure, path)


def save_reliability_figure(path: str | Path, results: Sequence[Result]) -> Path | None:
    """Draw how the tracker's confidence keeps its word, and precision at coverage; None if it gave no lane."""
    groups = {system: [r.errors for r in results if r.system == system] for system in {r.system: 0 for r in results}}
    stated = {system: StatedLanes.of(errors) for system, errors in groups.items()}
    if TRACKER not in stated or not len(stated[TRACKER].confidence):
        return None
    bins = stated[TRACKER].reliability()
    precisions = {}
    for system, lanes in stated.items():
        if len(lanes.confidence):
            curve = lanes.precision()
            precisions[system] = curve.coverage, curve.precision
    scenes = len({result.scene for result in results})
    title = f"Does the confidence keep its word? ({scenes} scene{'s' * (scenes > 1)})"
    figure, _ = plot_reliability((bins.stated, bins.right, bins.low, bins.high, bins.count), precisions, title=title)
    return save_figure(figure, path)


def plot_ranges(
    names: Sequence[str],
    panels: Mapping[str, Mapping[str, tuple[np.ndarray, np.ndarray]]],
    *,
    limits: Mapping[str, tuple[float, float]],
    title: str = "",
) -> tuple[Figure, np.ndarray]:
    """Plot ranges for many named things, systems side by side: a row for each thing, a panel for each quantity.

    Parameters
    ----------
    names : sequence of str, N of them
        From the top.
    panels : mapping of str to (mapping of str to (ndarray of shape (N,), ndarray of shape (N,)))
        Axis label with unit to the systems' ranges, such as median and 95th percentile; the second end gets the mark.
        NaN is left out; what lies beyond the limits is marked at the edge.
    limits : mapping of str to (float, float)
        For each label the ends of its axis; logarithmic where the first is above zero.
    title : str

    Returns
    -------
    figure, axes : Figure, ndarray of Axes of shape (len(panels),)
    """
    systems = list(next(iter(panels.values())))
    figure, axes = new_figure(1, len(panels), (13, 1.5 + 0.12 * (len(systems) + 1) * len(names)), sharey=True)
    for axis, (label, ranges) in zip(axes, panels.items(), strict=True):
        low, high = limits[label]
        axis.set(xlabel=label, xscale="log" if low > 0 else "linear", xlim=(low, high))
        axis.grid(axis="x", alpha=0.3)
        for at, ends in enumerate(ranges.values()):
            place = np.arange(len(names)) + (at - (len(systems) - 1) / 2) / (len(systems) + 1)
            first, last = (np.clip(end, low, high) for end in ends)
            axis.hlines(place, first, last, color=f"C{at}", linewidth=2.5, alpha=0.5)
            axis.plot(last, place, "o", color=f"C{at}", markersize=4.5, label=systems[at], clip_on=False)
        axis.hlines(np.arange(1, len(names)) - 0.5, low, high, color="0.85", linewidth=0.8)
    axes[0].set_yticks(np.arange(len(names)), names)
    axes[0].set_ylim(len(names) - 0.5, -0.5)
    axes[0].set_title(title, loc="left")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(systems), frameon=False)
    return figure, axes


def plot_reliability(
    bins: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    precisions: Mapping[str, tuple[np.ndarray, np.ndarray]],
    *,
    title: str = "",
) -> tuple[Figure, np.ndarray]:
    """Plot how far a confidence is to be trusted, and what share of the lanes is right when only sure ones are taken.

    Parameters
    ----------
    bins : tuple of five ndarray of shape (B,)
        Stated confidence, share that is right, lower and upper limit of that share, number of lanes.
    precisions : mapping of str to (ndarray of shape (K,), ndarray of shape (K,))
        For each system coverage and precision; a system with a single pair is a point.
    title : str

    Returns
    -------
    figure, axes : Figure, ndarray of Axes of shape (2,)
    """
    stated, right, low, high, count = bins
    figure, axes = new_figure(1, 2, (12, 5))
    axes[0].plot([0, 1], [0, 1], **TRUTH_LOOK)
    axes[0].errorbar(stated, right, [right - low, high - right], fmt="o", color="0.2", ecolor="0.5", capsize=3)
    for x, bottom, top, lanes in zip(stated, low, high, count, strict=True):
        # below its bar, or above it where the axis is in the way
        place, aside, anchor = (bottom, -4, "top") if bottom > LABEL_ROOM else (top, 4, "bottom")
        look = {"ha": "center", "va": anchor, "fontsize": 8, "bbox": {"fc": "white", "ec": "none", "pad": 0.5}}
        axes[0].annotate(f"{lanes}", (x, place), (0, aside), textcoords="offset points", **look)
    axes[0].set(xlabel="stated confidence", ylabel="share of lanes that are right", xlim=(0, 1.02), ylim=(0, 1.02))
    axes[0].set_title(title, loc="left")
    for name, (coverage, precision) in precisions.items():
        axes[1].plot(coverage, precision, "-" if len(coverage) > 1 else "o", label=name)
    axes[1].set(xlabel="share of frames with a lane given", ylabel="share of given lanes that are right")
    axes[1].set(xlim=(0, 1.02), ylim=(0, 1.02))
    axes[1].legend(loc="lower left", frameon=False)
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes
