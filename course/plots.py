"""Plots of the notebook: images, bird's-eye views, bars, and telemetry over time.

The functions plot given values and return the figure and its axes (an array if there can be several); they neither
compute nor show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from benchmark.reporting.figures import TRUTH_LOOK
from helpers import FourPointWarp, birdseye_to_road
from lanes.camera import Camera
from lanes.canvas import WINDOW_COLOUR
from lanes.figures import draw_on_road_grid, new_figure, rgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Above the axes, where a legend hides no curve.
LEGEND_ABOVE = {"loc": "lower right", "bbox_to_anchor": (1, 1), "frameon": False, "borderaxespad": 0}


class RoadAxes(NamedTuple):
    """Distance ahead (height,) of each row and lateral position (width,) of each column of a view, metres."""

    x_m: np.ndarray
    y_m: np.ndarray


def road_axes(warp: FourPointWarp, camera: Camera) -> RoadAxes:
    """Axes in metres of the view of a four-point warp, for `show_birdseye`.

    They are exact if the four points are a rectangle on the road, parallel to the car's axis. Otherwise they hold for
    the centre column and the bottom row. Raises CameraError if the camera has no pose.
    """
    width, height = warp.size
    rows, columns = np.arange(height), np.arange(width)
    centre_column = np.column_stack([np.full(height, (width - 1) / 2), rows])
    bottom_row = np.column_stack([columns, np.full(width, height - 1)])
    x_m, y_m = (birdseye_to_road(points, warp, camera) for points in (centre_column, bottom_row))
    return RoadAxes(x_m[:, 0], y_m[:, 1])


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


def _gray_limits(image: np.ndarray) -> dict[str, int]:
    """Limits of the gray scale, for matplotlib; it ignores them for RGB and derives missing ones from the values."""
    if image.dtype == bool or image.max() <= 1:
        return {"vmin": 0, "vmax": 1}
    return {"vmin": 0, "vmax": 255} if image.dtype == np.uint8 else {}
