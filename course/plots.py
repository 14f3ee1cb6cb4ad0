"""Plots of the notebook: images, bird's-eye views, a histogram, bars, telemetry over time, and the driven path.

The functions plot given values and return the figure and its axes (an array if there can be several); they neither
compute nor show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from benchmark.reporting.figures import TRUTH_LOOK
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR
from lanes.figures import draw_on_road_grid, new_figure, rgb
from lanes.report.moments import runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Above the axes, where a legend hides no curve.
LEGEND_ABOVE = {"loc": "lower right", "bbox_to_anchor": (1, 1), "frameon": False, "borderaxespad": 0}
# Colours of the tracker states, from certain to lost.
STATE_COLOURS = {
    "tracking": LANE_COLOUR,
    "found": LANE_COLOUR,
    "searching": WINDOW_COLOUR,
    "coasting": (255, 140, 0),
    "lost": LEFT_COLOUR,
}


class RoadGrid(Protocol):
    """Distance ahead of each row, farthest first, and lateral position of each column, left first; metres."""

    @property
    def x_m(self) -> np.ndarray: ...

    @property
    def y_m(self) -> np.ndarray: ...


def show_pictures(
    images: Sequence[np.ndarray], titles: Sequence[str], *, columns: int = 2, width_in: float = 12.0
) -> tuple[Figure, np.ndarray]:
    """Plot images side by side, in rows of `columns`.

    Parameters
    ----------
    images : sequence of ndarray
        RGB (height, width, 3), or masks and gray images (height, width). The gray scale is 0..1 for bool and for 0..1
        masks, 0..255 for other uint8, and the range of values for other types.
    titles : sequence of str
        One for each image.
    width_in : float
        Width of the figure in inches; its height follows from the images.

    Raises
    ------
    ValueError
        If the numbers of titles and images differ or are 0.
    """
    if not len(images) or len(images) != len(titles):
        raise ValueError(f"one title for each image is needed; got {len(images)} images and {len(titles)} titles.")
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    row_in = max(image.shape[0] / image.shape[1] for image in images) * width_in / columns + 0.35
    figure, axes = new_figure(rows, columns, (width_in, rows * row_in))
    for axis in axes[len(images) :]:
        axis.remove()
    for axis, image, title in zip(axes, images, titles, strict=False):
        axis.imshow(image, cmap="gray", **_gray_limits(image))
        axis.set_title(title)
        axis.set_axis_off()
    return figure, axes[: len(images)]


def show_birdseye(
    images: Sequence[np.ndarray],
    titles: Sequence[str],
    grid: RoadGrid,
    *,
    columns: int = 2,
    width_in: float = 12.0,
    **look: object,
) -> tuple[Figure, np.ndarray]:
    """Plot images of a road grid side by side, with axes in metres.

    Parameters
    ----------
    images : sequence of ndarray
        RGB (rows, columns, 3), or values (rows, columns), of the grid.
    titles : sequence of str
        One for each image.
    grid : RoadGrid
        For example a `BirdsEyeView`.
    **look
        Options of matplotlib's `imshow`, for example cmap, vmin and vmax.
    """
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    figure, axes = new_figure(rows, columns, (width_in, rows * (0.6 * width_in / columns + 0.6)))
    for axis, image, title in zip(axes, images, titles, strict=True):
        draw_on_road_grid(axis, image, grid.x_m, grid.y_m, **look)
        axis.set_title(title)
    return figure, axes


def plot_histogram(
    counts: np.ndarray, *, left_px: float | None = None, right_px: float | None = None
) -> tuple[Figure, Axes]:
    """Plot the column histogram (width,) of a binary view, with the two start columns of the search."""
    figure, (axis,) = new_figure(1, 1, (10, 3))
    axis.fill_between(np.arange(len(counts)), counts, color=rgb(WINDOW_COLOUR), alpha=0.6, linewidth=0)
    for column, colour, name in ((left_px, LEFT_COLOUR, "left"), (right_px, RIGHT_COLOUR, "right")):
        if column is not None:
            axis.axvline(column, color=rgb(colour), label=f"{name} start, column {column:.0f}")
            axis.legend(ncols=2, **LEGEND_ABOVE)
    axis.set_title("Where the paint is", loc="left")
    axis.set(xlabel="column (pixels)", ylabel="paint pixels in the column", xlim=(0, len(counts) - 1))
    axis.set_ylim(bottom=0)
    return figure, axis


def plot_bars(values: Mapping[str, float], *, label: str, title: str = "") -> tuple[Figure, Axes]:
    """Plot named values as bars; `label` is their name with the unit."""
    figure, (axis,) = new_figure(1, 1, (10, 3))
    axis.bar(list(values), list(values.values()), color=rgb(WINDOW_COLOUR))
    axis.tick_params(axis="x", rotation=90)
    axis.set(ylabel=label, title=title)
    return figure, axis


def plot_series(
    times_s: np.ndarray, series: Mapping[str, Mapping[str, np.ndarray]], *, title: str = ""
) -> tuple[Figure, np.ndarray]:
    """Plot telemetry over time, one panel per quantity.

    Parameters
    ----------
    series : mapping of str to (mapping of str to ndarray of shape (N,))
        Axis label with unit ("offset (m)") to the curves of that panel, name to values. A curve named "truth" is a dark
        dashed line above the others. NaN leaves a gap.

    Raises
    ------
    ValueError
        If `series` is empty.
    """
    if not series:
        raise ValueError("no quantity to plot; give at least one axis label with its curves.")
    figure, axes = new_figure(len(series), 1, (10, 0.6 + 2.2 * len(series)), sharex=True)
    for axis, (label, curves) in zip(axes, series.items(), strict=True):
        for name, values in curves.items():
            axis.plot(times_s, values, label=name, **(TRUTH_LOOK if name == "truth" else {}))
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if len(curves) > 1:
            axis.legend(ncols=len(curves), **LEGEND_ABOVE)
    axes[-1].set_xlabel("time (s)")
    axes[0].set_title(title, loc="left")
    return figure, axes


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


def _gray_limits(image: np.ndarray) -> dict[str, int]:
    """Limits of the gray scale, for matplotlib; it ignores them for RGB and derives missing ones from the values."""
    if image.dtype == bool or image.max() <= 1:
        return {"vmin": 0, "vmax": 1}
    return {"vmin": 0, "vmax": 255} if image.dtype == np.uint8 else {}


def _colour_states(axis: Axes, times_s: np.ndarray, states: np.ndarray) -> None:
    """Draw a strip along the bottom of the panel in the colours of the states."""
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1.0
    spans: dict[str, list[tuple[float, float]]] = {}
    for state, first, end in runs(states):
        spans.setdefault(state, []).append((times_s[first], times_s[end - 1] - times_s[first] + step_s))
    for state, bars in spans.items():
        look: dict[str, Any] = {"transform": axis.get_xaxis_transform(), "color": rgb(STATE_COLOURS[state]), "lw": 0}
        axis.broken_barh(bars, (0, 0.05), label=state, **look)
