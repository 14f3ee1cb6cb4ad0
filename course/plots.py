"""Figures of the notebook: images, bird's-eye views, bars, tables, telemetry over time.

The functions plot given values and return the figure and its axes (an array if there
can be several); they do not show it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from course.dataset import Dataset
from helpers import (
    FourPointWarp,
    Lens,
    birdseye_to_road,
    distort_points,
    draw_lane,
    finite_points,
    homogeneous,
    undistort,
    undistort_points,
)
from lanes.canvas import WINDOW_COLOUR, draw_polyline
from lanes.detect.birdseye import BirdsEyeView
from lanes.labels import LaneColumns
from lanes.show.figures import draw_on_road_grid, new_figure, rgb
from lanes.video.images import read_image

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Distances that are marked in a view with even rows, metres.
MARKED_M = (10, 20, 30, 40)
# Rows of the raw image in which `show_progress` measures: from the car to 40 m ahead.
MEASURED_ROWS = (480, 680)
# The part of the image that `show_progress` shows, as shares of its height and width.
ROAD_ROWS = (0.55, 0.96)
ROAD_COLUMNS = (0.14, 0.91)

TRUTH_LOOK: dict[str, Any] = {
    "color": "0.15",
    "linestyle": "--",
    "linewidth": 1.3,
    "zorder": 3,
}
DOTS_LOOK: dict[str, Any] = {
    "color": "0.72",
    "linestyle": "",
    "marker": "o",
    "markersize": 5,
    "zorder": 1,
}
# Above the axes, where a legend hides no curve.
LEGEND_ABOVE: dict[str, Any] = {
    "loc": "lower right",
    "bbox_to_anchor": (1, 1),
    "frameon": False,
    "borderaxespad": 0,
}


class RoadAxes(NamedTuple):
    """Axes of a view, metres: distance ahead of each row, lateral position of each
    column.
    """

    x_m: np.ndarray  # (height,)
    y_m: np.ndarray  # (width,)


def road_axes(warp: FourPointWarp, image_to_road: np.ndarray) -> RoadAxes:
    """Axes in metres of the view of a four-point warp, for `show_birdseye`.

    They are exact if the four points are a rectangle on the road, parallel to the car's
    axis. Otherwise they hold for the centre column and the bottom row. `image_to_road`
    is a homography of `helpers.road_homography`.
    """
    width, height = warp.size
    rows = np.arange(height)
    columns = np.arange(width)
    centre_column = np.column_stack([np.full(height, (width - 1) / 2), rows])
    bottom_row = np.column_stack([columns, np.full(width, height - 1)])
    ahead_m = birdseye_to_road(centre_column, warp, image_to_road)
    across_m = birdseye_to_road(bottom_row, warp, image_to_road)
    return RoadAxes(ahead_m[:, 0], across_m[:, 1])


def show_pictures(
    images: Sequence[np.ndarray],
    titles: Sequence[str],
    *,
    columns: int = 2,
    width_in: float = 12.0,
    guides_px: Sequence[float] = (),
) -> tuple[Figure, np.ndarray]:
    """Plot images side by side, in rows of `columns`.

    Raises ValueError if the numbers of titles and images differ or are 0.

    Parameters
    ----------
    images : sequence of ndarray
        RGB (height, width, 3), or masks and gray images (height, width). The gray scale
        is 0..1 for bool and for 0..1 masks, 0..255 for other uint8, and the range of
        values for other types.
    titles : sequence of str
        One for each image.
    width_in : float
        Width of the figure in inches; its height follows from the images.
    guides_px : sequence of float
        Columns at which a dashed vertical line is drawn, to see what leans.
    """
    if not len(images) or len(images) != len(titles):
        raise ValueError(
            f"one title for each image is needed; got {len(images)} images and "
            f"{len(titles)} titles."
        )
    aspect = max(image.shape[0] / image.shape[1] for image in images)
    figure, axes = _panels(titles, columns, width_in, aspect, 0.35)
    for axis, image in zip(axes, images, strict=True):
        axis.imshow(image, cmap="gray", **_gray_limits(image))
        axis.set_axis_off()
        for column in guides_px:
            axis.axvline(column, color="yellow", linestyle="--", linewidth=1.3)
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
        Distances of the rows, farthest first, and lateral positions of the columns,
        left first; metres.
    **look
        Options of matplotlib's `imshow`, for example cmap, vmin and vmax.
    """
    figure, axes = _panels(titles, columns, width_in, 0.6, 0.6)
    for axis, image in zip(axes, images, strict=True):
        draw_on_road_grid(axis, image, grid.x_m, grid.y_m, **look)
        if isinstance(grid, RoadAxes):
            _mark_distances(axis, grid.x_m)
    return figure, axes


def _mark_distances(axis: Axes, x_m: np.ndarray) -> None:
    """Ticks every 10 m at the rows of a view; `x_m` (rows,) has the farthest first."""
    marks_m = [mark_m for mark_m in MARKED_M if x_m[-1] <= mark_m <= x_m[0]]
    rows = np.arange(len(x_m))
    mark_rows = np.interp(marks_m, x_m[::-1], rows[::-1])
    axis.set_yticks(mark_rows, [f"{mark_m} m" for mark_m in marks_m])


def _panels(
    titles: Sequence[str],
    columns: int,
    width_in: float,
    aspect: float,
    extra_in: float,
) -> tuple[Figure, np.ndarray]:
    """Axes with titles in rows of `columns`.

    A row is `aspect` times as high as wide, plus `extra_in` for text above and below.
    """
    columns = min(columns, len(titles))
    rows = -(-len(titles) // columns)
    row_in = aspect * width_in / columns + extra_in
    figure, axes = new_figure(rows, columns, (width_in, rows * row_in))
    for axis in axes[len(titles) :]:
        axis.remove()
    for axis, title in zip(axes, titles, strict=False):
        axis.set_title(title)
    return figure, axes[: len(titles)]


def show_progress(
    found: Mapping[str, Sequence[np.ndarray] | None],
    data: Dataset,
    lens: Lens | None = None,
) -> tuple[Figure, np.ndarray]:
    """Draw the lanes found in test images; the titles have the errors.

    The error is the mean distance, along the row, between the drawn lines and the true
    or hand-labelled ones, in the rows that are 5 to 40 m ahead.

    Parameters
    ----------
    found : mapping of str to (sequence of ndarray) or None
        By the name of the test image its left and right line, points (N, 2), pixels,
        from far to near; None without a lane.
    lens : Lens, optional
        Given if the points are those of the undistorted image, which is shown then.
    """
    images = []
    titles = []
    for name, lines_px in found.items():
        path = data.still(name)
        image = read_image(path)
        truth = data.line_columns(path)
        if lens is not None:
            image = undistort(image, lens)
        if lines_px is None:
            images.append(crop_to_road(image))
            titles.append(f"{name}: no lane")
            continue

        left_px, right_px = lines_px
        drawn = draw_lane(image, left_px, right_px)
        images.append(crop_to_road(drawn))
        title = name
        error_px = None
        if truth is not None:
            error_px = mean_error_px(lines_px, truth, lens)
        if error_px is not None:
            title = f"{name}: {error_px:.0f} px off"
        titles.append(title)
    return show_pictures(images, titles, columns=3, width_in=15)


def crop_to_road(image: np.ndarray) -> np.ndarray:
    """The part of an image (height, width, 3) without sky and bonnet."""
    height, width = image.shape[:2]
    top, bottom = (round(share * height) for share in ROAD_ROWS)
    left, right = (round(share * width) for share in ROAD_COLUMNS)
    return image[top:bottom, left:right]


def draw_directions(image: np.ndarray, lens: Lens) -> np.ndarray:
    """A raw image with curves of equal direction: 10 degrees across, 5 degrees down.

    Across means planes that contain the camera's vertical axis, down those that contain
    its horizontal axis.
    """
    across = np.tan(np.radians(np.arange(-30, 31, 10)))
    down = np.tan(np.radians(np.arange(-20, 21, 5)))
    wide = np.linspace(across[0], across[-1], 100)
    high = np.linspace(down[0], down[-1], 100)
    curves = [np.column_stack([np.full(100, x), high]) for x in across]
    curves += [np.column_stack([wide, np.full(100, y)]) for y in down]

    drawn = image.copy()
    for directions in curves:
        pixels = homogeneous(directions) @ lens.matrix[:2].T
        raw_px = distort_points(pixels, lens)
        seen_px = finite_points(raw_px)
        draw_polyline(drawn, seen_px, WINDOW_COLOUR, width_px=3)
    return drawn


def mean_error_px(
    lines_px: Sequence[np.ndarray], truth: LaneColumns, lens: Lens | None = None
) -> float | None:
    """Mean distance along the row of two lines (N, 2) from their true columns, pixels.

    None if no true point lies in the measured rows.
    The lines are those of the undistorted image if a `lens` is given, else of the raw
    one.
    """
    first_row, last_row = MEASURED_ROWS
    is_near = (truth.rows >= first_row) & (truth.rows <= last_row)
    distances_px = []
    for line_px, true_columns in zip(lines_px, truth.columns, strict=True):
        measured = is_near & (true_columns >= 0)
        true_px = np.column_stack([true_columns[measured], truth.rows[measured]])
        if lens is not None:
            true_px = undistort_points(true_px, lens)
        columns, rows = np.transpose(line_px)
        by_row = np.argsort(rows)
        true_rows = true_px[:, 1]
        found_columns = np.interp(true_rows, rows[by_row], columns[by_row])
        distances_px.append(np.abs(found_columns - true_px[:, 0]))
    all_px = np.concatenate(distances_px)
    if not len(all_px):
        return None
    return float(all_px.mean())


def plot_bars(
    values: Mapping[str, float], *, label: str, title: str = ""
) -> tuple[Figure, Axes]:
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
    x_label: str = "time (s)",
) -> tuple[Figure, np.ndarray]:
    """Plot telemetry over time, one panel per quantity.

    Raises ValueError if `series` is empty.

    Parameters
    ----------
    series : mapping of str to (mapping of str to ndarray of shape (N,))
        Axis label with unit ("offset (m)") to the curves of that panel, name to values.
        A curve named "truth" is a dark dashed line above the others. NaN leaves a gap.
    dots : collection of str
        Names of curves that are drawn as gray dots, behind the others.
    x_label : str
        What `times_s` are, if they are no times.
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
    axes[-1].set_xlabel(x_label)
    axes[0].set_title(title, loc="left")
    return figure, axes


def show_table(
    rows: Mapping[str, Mapping[str, float]], *, title: str = ""
) -> tuple[Figure, Axes]:
    """Draw a table of numbers as a figure, for numbers that differ in each run.

    `rows` has the numbers of each row by the name of their column; all rows have the
    same columns. They have one decimal.
    """
    columns = list(next(iter(rows.values())))
    texts = []
    for numbers in rows.values():
        texts.append([f"{numbers[column]:.1f}" for column in columns])
    figure, (axis,) = new_figure(1, 1, (10, 0.8 + 0.35 * len(rows)))
    axis.set_axis_off()
    axis.set_title(title)
    table = axis.table(texts, rowLabels=list(rows), colLabels=columns, loc="center")
    table.scale(1, 1.5)
    return figure, axis


def _gray_limits(image: np.ndarray) -> dict[str, int]:
    """Limits of the gray scale, for matplotlib.

    It ignores them for RGB, and derives missing ones from the values.
    """
    if image.dtype == bool or image.max() <= 1:
        return {"vmin": 0, "vmax": 1}
    if image.dtype == np.uint8:
        return {"vmin": 0, "vmax": 255}
    return {}
