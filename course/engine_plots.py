"""Figures of chapters 9 to 16: votes, Gaussians, filtered quantities, accuracy of the
benchmark.

Each function draws given values on given axes, or makes a figure; it does not compute
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmark.scores import Row, total_name
from benchmark.tables import read_scores
from lanes.show.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The groups of scenes in the benchmark's table.
DIFFICULTIES = ("clean", "medium", "hard", "no lane")


def plot_votes(
    votes: np.ndarray,
    *,
    edges_m: np.ndarray,
    headings: np.ndarray,
    curvatures_per_m: np.ndarray,
    winner: int,
    peaks_m: Sequence[float],
) -> Figure:
    """Plot the part of a vote table with the heading of the best pair, and its row.

    Parameters
    ----------
    votes : ndarray of shape (H, B)
        Votes of each hypothesis in each bin.
    edges_m : ndarray of shape (B + 1,)
        Edges of the bins, lateral positions in metres.
    headings, curvatures_per_m : ndarray of shape (H,)
        The hypotheses.
    winner : int
        Index of the best hypothesis.
    peaks_m : sequence of float
        Lateral positions of the two lines, metres.
    """
    figure, (table, row) = new_figure(2, 1, (10, 5.5), sharex=True)

    same_heading = headings == headings[winner]
    curvatures_per_km = 1000 * curvatures_per_m[same_heading]
    half_step = (curvatures_per_km[1] - curvatures_per_km[0]) / 2
    highest = curvatures_per_km[-1] + half_step
    lowest = curvatures_per_km[0] - half_step
    # the leftmost bin first, as in a view
    shown = np.sqrt(votes[same_heading, ::-1])
    extent = (edges_m[-1], edges_m[0], highest, lowest)
    table.imshow(shown, extent=extent, aspect="auto", cmap="magma")
    at_winner = [1000 * curvatures_per_m[winner]] * 2
    table.plot(peaks_m, at_winner, "co", markerfacecolor="none", markersize=14)
    table.set(ylabel="curvature (1/km)", title="Root of the votes; circles: best pair")

    centres_m = (edges_m[:-1] + edges_m[1:]) / 2
    row.step(centres_m, votes[winner], where="mid")
    row.set(xlabel="left (m)", ylabel="votes", title="The row of the best pair")
    return figure


def plot_gaussian(axis: Axes, mean: float, std: float, name: str) -> None:
    """Plot a Gaussian density up to five standard deviations from its mean."""
    values = np.linspace(mean - 5 * std, mean + 5 * std, 400)
    distance = (values - mean) / std
    density = np.exp(-(distance**2) / 2) / (std * np.sqrt(2 * np.pi))
    axis.plot(values, density, label=name)


def plot_ellipse(
    axis: Axes, mean: np.ndarray, covariance: np.ndarray, name: str
) -> None:
    """Plot the ellipse of two standard deviations of a Gaussian of two numbers."""
    angles = np.linspace(0, 2 * np.pi, 100)
    circle = np.array([np.cos(angles), np.sin(angles)])
    ellipse = mean[:, None] + 2 * np.linalg.cholesky(covariance) @ circle
    axis.plot(ellipse[0], ellipse[1], label=name)


def plot_filtered(
    times_s: np.ndarray,
    measured: np.ndarray,
    filtered: np.ndarray,
    std: np.ndarray,
    *,
    truth: Mapping[str, np.ndarray] | None,
    first_frame: int,
) -> Figure:
    """Plot offset and curvature of a filter over time, with a band of two std.

    Parameters
    ----------
    times_s : ndarray of shape (N,)
    measured, filtered, std : ndarray of shape (N, 3)
        Offset (m), heading (rad) and curvature (1/m) of single frames and of the
        filter, and the standard deviations of the filter.
    truth : mapping of str to ndarray, optional
        The columns of the drive's truth.
    first_frame : int
        Number of the first frame in `truth`.
    """
    figure, axes = new_figure(2, 1, (10, 5), sharex=True)
    frames = slice(first_frame, first_frame + len(times_s))
    panels = ((0, "offset_m", "offset (m)"), (2, "curvature_per_m", "curvature (1/m)"))
    for axis, (k, column, label) in zip(axes, panels, strict=True):
        low = filtered[:, k] - 2 * std[:, k]
        high = filtered[:, k] + 2 * std[:, k]
        axis.plot(times_s, measured[:, k], ".", color="0.6", label="one frame")
        axis.fill_between(times_s, low, high, alpha=0.3, linewidth=0)
        axis.plot(times_s, filtered[:, k], label="filter, band: 2 standard deviations")
        if truth:
            true_values = truth[column][frames]
            axis.plot(times_s, true_values, "k--", linewidth=1, label="truth")
        axis.set_ylabel(label)
    axes[-1].set_xlabel("time (s)")
    axes[0].legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    return figure


def plot_accuracy(scores: str | Path) -> Figure:
    """Plot the accuracy of each system in the groups of scenes of a benchmark.csv.

    The bars of the scenes without a lane are the shares of frames with a false lane.
    Raises ValueError if the file is no table of the benchmark, OSError if it cannot be
    read.
    """
    rows = read_scores(scores)
    systems = list(dict.fromkeys(str(row["system"]) for row in rows))
    places = np.arange(len(systems))

    figure, (axis,) = new_figure(1, 1, (10, 3.6))
    for k, difficulty in enumerate(DIFFICULTIES):
        totals = _totals(rows, difficulty)
        percents = [100 * totals.get(system, np.nan) for system in systems]
        axis.bar(places + 0.2 * k, percents, width=0.18, label=difficulty)

    names = [system.replace("_", "\n") for system in systems]
    axis.set_xticks(places + 0.3, names)
    axis.set_ylabel("accuracy (%); no lane: false (%)")
    axis.legend(ncols=4, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    return figure


def _totals(rows: Sequence[Row], difficulty: str) -> Mapping[str, float]:
    """Accuracy of each system over all scenes of a difficulty; without lanes the share
    of false ones.
    """
    totals = {}
    for row in rows:
        if row["scene"] == total_name(difficulty):
            accuracy = float(row["accuracy"])
            false = float(row["confident_and_wrong_share"])
            totals[str(row["system"])] = false if np.isnan(accuracy) else accuracy
    return totals
