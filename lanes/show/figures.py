"""Matplotlib figures in one style; the only module that imports pyplot, on first use.

The functions plot given values and return the figure and its axes (an array if there
can be several); they neither compute nor show.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lanes.camera.model import Camera, undistort
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR, Colour
from lanes.describe import describe_std
from lanes.detect.evidence import Stripes
from lanes.detect.lane import Lane, Line, stated
from lanes.detect.road import CENTRE, CURVATURE, SIDES, WIDTH, lines_on_view
from lanes.detect.search import StillDetection
from lanes.files import write_atomically
from lanes.show.draw import draw_lane
from lanes.show.explanation import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# At 80 dots per inch a JPEG figure of two photographs takes about 70 kB, a tenth of the
# default PNG.
STYLE: dict[Any, Any] = {
    "figure.dpi": 80,
    "figure.constrained_layout.use": True,
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.grid": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.8,
}
# Distances ahead that are marked on images of a road grid, metres.
_MARKED_M = (5, 10, 20, 40)


def draw_on_road_grid(
    axis: Axes, image: np.ndarray, x_m: np.ndarray, y_m: np.ndarray, **look: Any
) -> None:
    """Show an image of the road; the distances x of its rows may grow, so the marks
    ahead are not even.

    `x_m` (rows,) are farthest first, `y_m` (columns,) left first.
    """
    rows = len(x_m)
    borders = (y_m[0], y_m[-1], rows - 0.5, -0.5)
    axis.imshow(image, extent=borders, aspect="auto", **look)
    marked_m = [mark_m for mark_m in _MARKED_M if x_m[-1] <= mark_m <= x_m[0]]
    marked_rows = np.interp(marked_m, x_m[::-1], np.arange(rows)[::-1])
    axis.set_yticks(marked_rows, [f"{mark_m} m" for mark_m in marked_m])
    axis.set(xlabel="left (m)", ylabel="ahead")


def new_figure(
    rows: int, columns: int, size_in: tuple[float, float], **options: Any
) -> tuple[Figure, np.ndarray]:
    """A figure in the course's style, and its axes as a flat array."""
    # Imported here: programs without figures start half a second sooner.
    import matplotlib.pyplot as plt

    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            rows, columns, figsize=size_in, squeeze=False, **options
        )
    return figure, axes.ravel()


def rgb(colour: Colour) -> tuple[float, float, float]:
    """An RGB colour 0..255 in matplotlib's range 0..1."""
    red, green, blue = colour
    return red / 255, green / 255, blue / 255


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure atomically as .jpg or .png; the folder is created where needed.

    Returns the path. Raises ValueError if the name has another suffix, or OSError if
    the folder cannot be written to.
    """
    path = Path(path)
    write_atomically(path, encode_figure(figure, figure_kind(path)))
    return path


def encode_figure(figure: Figure, kind: str, *, jpeg_quality: int = 85) -> bytes:
    """The figure as a file of that `kind`, "jpeg" or "png"."""
    data = BytesIO()
    if kind == "jpeg":
        figure.savefig(data, format=kind, pil_kwargs={"quality": jpeg_quality})
    else:
        # Without the name of the software, which contains matplotlib's version.
        figure.savefig(data, format=kind, metadata={"Software": None})
    return data.getvalue()


def figure_kind(path: Path) -> str:
    """The format, "jpeg" or "png", by the suffix; raises ValueError for others."""
    kind = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png"}.get(path.suffix.lower())
    if kind is None:
        raise ValueError(
            f"{path}: cannot write this kind of figure; end the name in .jpg or .png."
        )
    return kind


# Figure of an explanation: one panel per step.

# Width of the plots of the road to either side: that of the bird's-eye view.
_ROAD_HALF_WIDTH_M = 9.0
_HORIZON_COLOUR = rgb((255, 60, 255))
_FAILED_COLOUR = "firebrick"
_ON_NO_LINE_COLOUR = (150, 150, 150)


def show_explanation(explanation: Explanation) -> tuple[Figure, np.ndarray]:
    """Plot every step of an explanation with its numbers; the title of a failed step is
    red.

    The nine axes are image, camera pose, bird's-eye view, marking response, stripes,
    votes, fit, overlay and text.
    """
    summaries = _summaries(explanation)
    without_result = _steps_without_result(explanation)
    failed = explanation.failed
    figure, axes = new_figure(3, 3, (18, 11.5), height_ratios=(1, 1, 1.2))
    for axis, (step, (title, plot)) in zip(axes, _PANELS.items(), strict=True):
        summary = summaries.get(step, "not reached")
        if step in without_result:
            _write_in_the_middle(axis, summary)
        else:
            plot(axis, explanation)
        axis.set_title(title.format(summary), fontsize=10)
        if failed and failed.name == step:
            axis.title.set_color(_FAILED_COLOUR)
    return figure, axes


def _summaries(explanation: Explanation) -> dict[str, str]:
    """The numbers of each step that was reached, and the result."""
    summaries = {}
    if explanation.prediction is not None:
        summaries["votes"] = "no search in this frame"
    for step in explanation.steps:
        summaries[step.name] = step.summary
    lane = stated(explanation.lane)
    summaries["lane"] = "no lane"
    if lane:
        summaries["lane"] = f"{lane.state}, confidence {lane.confidence:.0%}"
    return summaries


def _steps_without_result(explanation: Explanation) -> set[str]:
    steps = set()
    if explanation.detection is None:
        steps |= {"birdseye", "markings", "stripes", "votes"}
    elif explanation.detection.search is None:
        steps.add("votes")
    if explanation.fit is None:
        steps.add("fit")
    return steps


def _write_in_the_middle(axis: Axes, text: str) -> None:
    axis.text(0.5, 0.5, text, ha="center", va="center", transform=axis.transAxes)
    axis.set_axis_off()


def _detection(explanation: Explanation) -> StillDetection:
    """The detection, of an explanation that has one."""
    assert explanation.detection is not None
    return explanation.detection


def _plot_image(axis: Axes, explanation: Explanation) -> None:
    axis.imshow(explanation.image)
    axis.set_axis_off()


def _plot_lane(axis: Axes, explanation: Explanation) -> None:
    drawn = draw_lane(explanation.image, explanation.lane, explanation.camera)
    axis.imshow(drawn)
    axis.set_axis_off()


def _plot_pose(axis: Axes, explanation: Explanation) -> None:
    """Undistorted image with the horizon, the point straight ahead and distances on the
    road, 4 m to either side.
    """
    camera = replace(explanation.camera, distortion=np.zeros(5))
    axis.imshow(undistort(explanation.image, explanation.camera))

    # The rays to the left, ahead and to the right meet the horizon.
    rays = 1e7 * np.array([[1.0, 0.6, 0.0], [1.0, 0.0, 0.0], [1.0, -0.6, 0.0]])
    horizon_px = camera.road_to_pixels(rays)
    axis.plot(
        *horizon_px.T,
        color=_HORIZON_COLOUR,
        lw=1.2,
        label="horizon of the camera pose",
    )
    axis.plot(
        *horizon_px[1],
        "+",
        color=_HORIZON_COLOUR,
        ms=14,
        mew=2,
        label="straight ahead of the car",
    )
    for x_m in _MARKED_M:
        _mark_distance(axis, camera, x_m)
    if explanation.lane is not None:
        _mark_direction(axis, camera, explanation.lane)

    axis.set(xlim=(0, camera.width), ylim=(camera.height, 0))
    axis.set_axis_off()
    axis.legend(loc="lower right", fontsize=8)


def _mark_distance(axis: Axes, camera: Camera, x_m: float) -> None:
    """A line across the road, with its distance if its left end is in the image."""
    colour = rgb(WINDOW_COLOUR)
    mark_px = camera.road_to_pixels(np.array([[x_m, 4.0], [x_m, -4.0]]))
    axis.plot(*mark_px.T, color=colour, lw=1)
    if mark_px[0, 1] < camera.height:
        axis.annotate(
            f"{x_m} m ", mark_px[0], color=colour, fontsize=8, ha="right", va="center"
        )


def _mark_direction(axis: Axes, camera: Camera, lane: Lane) -> None:
    heading_rad = lane.heading_rad
    ahead = np.array([[np.cos(heading_rad), np.sin(heading_rad), lane.pitch_rad]])
    pixel = camera.road_to_pixels(1e7 * ahead)[0]
    axis.plot(
        *pixel, "x", color=rgb(LANE_COLOUR), ms=9, mew=2, label="direction of the lane"
    )


def _plot_birdseye(axis: Axes, explanation: Explanation) -> None:
    evidence = _detection(explanation).evidence
    view = evidence.view
    image = view.blacken(evidence.view_image)
    draw_on_road_grid(axis, image, view.x_m, view.y_m)


def _plot_markings(axis: Axes, explanation: Explanation) -> None:
    evidence = _detection(explanation).evidence
    view = evidence.view
    look = {"cmap": "magma", "vmin": 0, "vmax": 12}
    draw_on_road_grid(axis, evidence.response.strength, view.x_m, view.y_m, **look)


def _plot_stripes(axis: Axes, explanation: Explanation) -> None:
    """Stripe candidates on the road in metres, those of the lane in the colours of its
    lines.
    """
    _set_road_axes(axis)
    stripes = _detection(explanation).evidence.stripes
    side = np.zeros(len(stripes))
    if explanation.lane is not None and explanation.fit is not None:
        side = SIDES @ explanation.fit.members[0]
    _scatter_stripes(axis, stripes.select(side == 0), _ON_NO_LINE_COLOUR, "on no line")
    _scatter_stripes(axis, stripes.select(side == 1), LEFT_COLOUR, "left line")
    _scatter_stripes(axis, stripes.select(side == -1), RIGHT_COLOUR, "right line")


def _scatter_stripes(axis: Axes, stripes: Stripes, colour: Colour, name: str) -> None:
    """Dots that grow with the weights of the stripes."""
    if not len(stripes):
        return
    axis.scatter(
        stripes.y_m,
        stripes.x_m,
        s=3 + 27 * stripes.weight,
        color=rgb(colour),
        lw=0,
        label=f"{len(stripes)} {name}",
    )
    axis.legend(loc="upper right", fontsize=8)


def _plot_votes(axis: Axes, explanation: Explanation) -> None:
    """Vote table: for each curvature and lateral position the votes of the best
    heading.
    """
    detection = _detection(explanation)
    assert detection.search is not None
    settings = detection.settings.votes
    _, curvature, _ = settings.hypotheses.T
    bends = np.unique(curvature)
    rows = np.arange(len(bends))
    votes = detection.search.votes
    best = [votes[curvature == bend].max(axis=0) for bend in bends]
    # The search uses square roots of votes. They keep a dashed line visible next to a
    # solid one.
    table = np.sqrt(best)[:, ::-1]
    half_m = settings.bins / 2 * settings.bin_m
    borders = (half_m, -half_m, len(bends) - 0.5, -0.5)
    axis.imshow(table, extent=borders, aspect="auto", cmap="magma")
    shown = rows[1::3]
    axis.set_yticks(shown, [f"{1000 * bends[n]:.0f}" for n in shown], fontsize=8)
    axis.set(xlabel="left (m)", ylabel="curvature (per km)")

    for candidate in explanation.candidates:
        lane = candidate.model
        row = np.interp(lane[CURVATURE], bends, rows)
        lines_y_m = lane[CENTRE] + SIDES * lane[WIDTH] / 2
        colour = rgb(LANE_COLOUR if candidate.chosen else WINDOW_COLOUR)
        axis.plot(lines_y_m, [row, row], "o", color=colour, mfc="none", ms=9)


def _plot_fit(axis: Axes, explanation: Explanation) -> None:
    """Lanes on the road in metres: the chosen one with its uncertainty, rejected ones
    dashed, the predicted dash-dotted.
    """
    fit = explanation.fit
    assert fit is not None
    _set_road_axes(axis)
    view = fit.view
    axis.scatter(fit.stripes.y_m, fit.stripes.x_m, s=3, color="0.75", lw=0)
    if explanation.prediction is not None:
        lines = lines_on_view(explanation.prediction[None], view.x_m, view.height_m)[0]
        labels = ["predicted", None]
        axis.plot(lines.T, view.x_m, color="0.2", lw=1, ls="-.", label=labels)
    for candidate in explanation.candidates:
        if not candidate.chosen:
            lines = lines_on_view(candidate.model[None], view.x_m, view.height_m)[0]
            axis.plot(lines.T, view.x_m, color="0.5", lw=1, ls="--")

    lane = explanation.lane
    if lane is None:
        return
    _plot_line(axis, lane.left, "left", rgb(LEFT_COLOUR))
    _plot_line(axis, lane.right, "right", rgb(RIGHT_COLOUR))
    # room for the legend above the lines
    axis.set_ylim(top=66)
    title = "bands: two standard deviations"
    axis.legend(loc="upper right", fontsize=8, title=title, title_fontsize=8)


def _plot_line(
    axis: Axes, line: Line, name: str, colour: tuple[float, float, float]
) -> None:
    """A line of the lane with a band of two standard deviations to either side."""
    x_m = np.linspace(0, 50, 101)
    y_m = line.y(x_m)
    std_m = line.std_m(x_m)
    std_m[~(np.abs(y_m) <= _ROAD_HALF_WIDTH_M)] = np.nan

    label = f"{name}: inferred"
    if line.seen:
        label = f"{name}: paint on {min(line.support, 1):.0%}"
    shown = np.flatnonzero((x_m <= 20) & np.isfinite(std_m))
    if len(shown):
        farthest = shown[-1]
        label += f", ± {describe_std(std_m[farthest])} m at {x_m[farthest]:.0f} m"

    left_m = y_m - 2 * std_m
    right_m = y_m + 2 * std_m
    axis.fill_betweenx(x_m, left_m, right_m, color=colour, alpha=0.25, lw=0)
    axis.plot(y_m, x_m, color=colour, label=label)


def _plot_text(axis: Axes, explanation: Explanation) -> None:
    """Failure and advice, then the lane in words."""
    lines = []
    failed = explanation.failed
    if failed:
        lines.append(f"Step “{failed.name}”: {failed.failure}")
        lines.append(f"What to do: {failed.advice}")
        lines.append("")
    for step in explanation.steps:
        if step.name == "prediction":
            lines.append(f"prediction {step.summary}")
    lines += explanation.describe_result()

    wrapped = [textwrap.fill(line, 84, subsequent_indent=" " * 11) for line in lines]
    axis.text(
        0,
        1,
        "\n".join(wrapped),
        va="top",
        fontsize=8,
        family="monospace",
        in_layout=False,
        transform=axis.transAxes,
    )
    axis.set_axis_off()


def _set_road_axes(axis: Axes) -> None:
    half_m = _ROAD_HALF_WIDTH_M
    axis.set(xlim=(half_m, -half_m), ylim=(0, 52))
    axis.set(xlabel="left (m)", ylabel="ahead (m)")
    axis.grid(alpha=0.3)


# What plots each step, and its title.
_PANELS: dict[str, tuple[str, Callable[[Axes, Explanation], None]]] = {
    "picture": ("1 Image: {}", _plot_image),
    "pose": ("2 Camera pose: {}", _plot_pose),
    "birdseye": ("3 Bird's-eye view: {}", _plot_birdseye),
    "markings": ("4 Marking response: {}", _plot_markings),
    "stripes": ("5 Stripes: {}", _plot_stripes),
    "votes": ("6 Votes: {}", _plot_votes),
    "fit": ("7 Fit: {}", _plot_fit),
    "lane": ("8 Result: {}", _plot_lane),
    "text": ("9 In words", _plot_text),
}


# Figure of a scored still: labels and predictions in the image.

_LABEL_COLOUR = "#00b7ff"
_PREDICTION_COLOUR = "#ff7a00"
# Instead of an image that is missing.
_NO_IMAGE_COLOUR = "#30343a"
_DOTS_PER_INCH = 100
# Widths of the lines, points; those of the ego lane are thicker.
_LINE_WIDTH = 1.5
_LABEL_EGO_WIDTH = 4.5
_PREDICTION_EGO_WIDTH = 2.5
_DASHES = (0, (4, 2.5))


@dataclass(frozen=True, eq=False)
class ShownLine:
    """A line in an image.

    Attributes
    ----------
    points_px : ndarray (N, 2)
        Column and row of each point, from the top down; NaN makes a gap.
    ego : bool
        Whether it is a line of the ego lane.
    """

    points_px: np.ndarray
    ego: bool


def show_scored_still(
    image: np.ndarray | None,
    *,
    shown_size: tuple[int, int],
    size: tuple[int, int],
    label: Sequence[ShownLine],
    prediction: Sequence[ShownLine],
) -> tuple[Figure, Axes]:
    """Draw the lines of a label and of a prediction into a still, None if it is
    missing.

    The figure has `shown_size` (width, height), the lines are in a still of `size`.
    """
    # Without pyplot, which would keep each of many figures.
    from matplotlib.figure import Figure

    shown_width, shown_height = shown_size
    figure = Figure(
        figsize=(shown_width / _DOTS_PER_INCH, shown_height / _DOTS_PER_INCH),
        dpi=_DOTS_PER_INCH,
        facecolor=_NO_IMAGE_COLOUR,
    )
    axis = figure.add_axes((0, 0, 1, 1))
    width, height = size
    borders = (-0.5, width - 0.5, height - 0.5, -0.5)
    if image is not None:
        axis.imshow(image, extent=borders, aspect="auto")

    for line in label:
        axis.plot(
            *line.points_px.T,
            color=_LABEL_COLOUR,
            lw=_LABEL_EGO_WIDTH if line.ego else _LINE_WIDTH,
            solid_capstyle="butt",
        )
    for line in prediction:
        axis.plot(
            *line.points_px.T,
            color=_PREDICTION_COLOUR,
            lw=_PREDICTION_EGO_WIDTH if line.ego else _LINE_WIDTH,
            ls=_DASHES,
        )

    left, right, bottom, top = borders
    axis.set(xlim=(left, right), ylim=(bottom, top))
    axis.set_axis_off()
    return figure, axis
