"""Plots of the notebook: images, bird's-eye views, bars, and telemetry over time.

The functions plot given values and return the figure and its axes (an array if there can be several); they neither
compute nor show.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from helpers import FourPointWarp, birdseye_to_road
from lanes.canvas import WINDOW_COLOUR
from lanes.detect.birdseye import BirdsEyeView
from lanes.figures import draw_on_road_grid, new_figure, rgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRUTH_LOOK: dict[str, Any] = {"color": "0.15", "linestyle": "--", "linewidth": 1.3, "zorder": 3}
DOTS_LOOK: dict[str, Any] = {
    "color": "0.72",
    "linestyle": "",
    "marker": "o",
    "markersize": 5,
    "zorder": 1,
}
# Above the axes, where a legend hides no curve.
LEGEND_ABOVE = {"loc": "lower right", "bbox_to_anchor": (1, 1), "frameon": False, "borderaxespad": 0}


class RoadAxes(NamedTuple):
    """Distance ahead (height,) of each row and lateral position (width,) of each column of a view, metres."""

    x_m: np.ndarray
    y_m: np.ndarray


def road_axes(warp: FourPointWarp, image_to_road: np.ndarray) -> RoadAxes:
    """Axes in metres of the view of a four-point warp, for `show_birdseye`.

    They are exact if the four points are a rectangle on the road, parallel to the car's
    axis. Otherwise they hold for the centre column and the bottom row. `image_to_road` is
    a homography of `helpers.road_homography`.
    """
    width, height = warp.size
    rows, columns = np.arange(height), np.arange(width)
    centre_column = np.column_stack([np.full(height, (width - 1) / 2), rows])
    bottom_row = np.column_stack([columns, np.full(width, height - 1)])
    ahead_m = birdseye_to_road(centre_column, warp, image_to_road)
    across_m = birdseye_to_road(bottom_row, warp, image_to_road)
    return RoadAxes(ahead_m[:, 0], across_m[:, 1])


def show_pictures(
    images: Sequence[np.ndarray], titles: Sequence[str], *, columns: int = 2, width_in: float = 12.0
) -> tuple[Figure, np.ndarray]:
    """Plot images side by side, in rows of `columns`.

    Raises ValueError if the numbers of titles and images differ or are 0.

    Parameters
    ----------
    images : sequence of ndarray
        RGB (height, width, 3), or masks and gray images (height, width). The gray scale is 0..1 for bool and for 0..1
        masks, 0..255 for other uint8, and the range of values for other types.
    titles : sequence of str
        One for each image.
    width_in : float
        Width of the figure in inches; its height follows from the images.
    """
    if not len(images) or len(images) != len(titles):
        raise ValueError(f"one title for each image is needed; got {len(images)} images and {len(titles)} titles.")
    figure, axes = _panels(titles, columns, width_in, max(len(image) / image.shape[1] for image in images), 0.35)
    for axis, image in zip(axes, images, strict=True):
        axis.imshow(image, cmap="gray", **_gray_limits(image))
        axis.set_axis_off()
    return figure, axes


def show_birdseye(
    images: Sequence[np.ndarray],
    titles: Sequence[str],
    grid: RoadAxes | BirdsEyeView,
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
    grid : RoadAxes or BirdsEyeView
        Distances of the rows, farthest first, and lateral positions of the columns, left first; metres.
    **look
        Options of matplotlib's `imshow`, for example cmap, vmin and vmax.
    """
    figure, axes = _panels(titles, columns, width_in, 0.6, 0.6)
    for axis, image in zip(axes, images, strict=True):
        draw_on_road_grid(axis, image, grid.x_m, grid.y_m, **look)
    return figure, axes


def _panels(
    titles: Sequence[str], columns: int, width_in: float, aspect: float, extra_in: float
) -> tuple[Figure, np.ndarray]:
    """Axes with titles in rows of `columns`; a row is `aspect` times as high as wide, and the text above and below."""
    columns = min(columns, len(titles))
    rows = -(-len(titles) // columns)
    figure, axes = new_figure(rows, columns, (width_in, rows * (aspect * width_in / columns + extra_in)))
    for axis in axes[len(titles) :]:
        axis.remove()
    for axis, title in zip(axes, titles, strict=False):
        axis.set_title(title)
    return figure, axes[: len(titles)]


def plot_bars(values: Mapping[str, float], *, label: str, title: str = "") -> tuple[Figure, Axes]:
    """Plot named values as bars; `label` is their name with the unit."""
    figure, (axis,) = new_figure(1, 1, (10, 3))
    axis.bar(list(values), list(values.values()), color=rgb(WINDOW_COLOUR))
    axis.tick_params(axis="x", rotation=90)
    axis.set(ylabel=label, title=title)
    return figure, axis


def plot_series(
    times_s: np.ndarray,
    series: Mapping[str, Mapping[str, np.ndarray]],
    *,
    title: str = "",
    dots: Collection[str] = (),
) -> tuple[Figure, np.ndarray]:
    """Plot telemetry over time, one panel per quantity.

    Raises ValueError if `series` is empty.

    Parameters
    ----------
    series : mapping of str to (mapping of str to ndarray of shape (N,))
        Axis label with unit ("offset (m)") to the curves of that panel, name to values. A
        curve named "truth" is a dark dashed line above the others. NaN leaves a gap.
    dots : collection of str
        Names of curves that are drawn as gray dots, behind the others.
    """
    if not series:
        raise ValueError(
            "no quantity to plot; give at least one axis label with its curves."
        )
    size_in = (10, 0.6 + 2.2 * len(series))
    figure, axes = new_figure(len(series), 1, size_in, sharex=True)
    for axis, (label, curves) in zip(axes, series.items(), strict=True):
        for name, values in curves.items():
            look: dict[str, Any] = {}
            if name == "truth":
                look = TRUTH_LOOK
            elif name in dots:
                look = DOTS_LOOK
            axis.plot(times_s, values, label=name, **look)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if len(curves) > 1:
            axis.legend(ncols=len(curves), **LEGEND_ABOVE)
    axes[-1].set_xlabel("time (s)")
    axes[0].set_title(title, loc="left")
    return figure, axes


def show_table(
    rows: Mapping[str, Mapping[str, float]], *, title: str = "", digits: int = 1
) -> tuple[Figure, Axes]:
    """Draw a table of numbers as a figure, for numbers that differ in each run.

    `rows` has the numbers of each row by the name of their column; all rows have the same
    columns. They are rounded to `digits` decimals.
    """
    columns = list(next(iter(rows.values())))
    texts = []
    for numbers in rows.values():
        texts.append([f"{numbers[column]:.{digits}f}" for column in columns])
    figure, (axis,) = new_figure(1, 1, (10, 0.8 + 0.35 * len(rows)))
    axis.set_axis_off()
    axis.set_title(title)
    table = axis.table(texts, rowLabels=list(rows), colLabels=columns, loc="center")
    table.scale(1, 1.5)
    return figure, axis


def _gray_limits(image: np.ndarray) -> dict[str, int]:
    """Limits of the gray scale, for matplotlib; it ignores them for RGB and derives missing ones from the values."""
    if image.dtype == bool or image.max() <= 1:
        return {"vmin": 0, "vmax": 1}
    return {"vmin": 0, "vmax": 255} if image.dtype == np.uint8 else {}
