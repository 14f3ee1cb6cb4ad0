"""Matplotlib figures in one style; the only module that imports pyplot, on first use.

The functions plot given values and return the figure and its axes (an array if there
can be several); they neither compute nor show.
"""

from __future__ import annotations

import textwrap
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lanes.camera.model import undistort
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR, Colour
from lanes.describe import describe_std
from lanes.detect.fit import Fit
from lanes.detect.road import CENTRE, CURVATURE, SIDES, WIDTH, lines_on_view
from lanes.detect.search import VOTES, Search, StillDetection
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
    axis.imshow(
        image, extent=(y_m[0], y_m[-1], len(x_m) - 0.5, -0.5), aspect="auto", **look
    )
    marked_m = [mark_m for mark_m in _MARKED_M if x_m[-1] <= mark_m <= x_m[0]]
    marks = np.interp(marked_m, x_m[::-1], np.arange(len(x_m))[::-1])
    axis.set_yticks(marks, [f"{mark_m} m" for mark_m in marked_m])
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
    """The format, "jpeg" or "png", by the suffix; raises ValueError for another suffix."""
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


def show_explanation(explanation: Explanation) -> tuple[Figure, np.ndarray]:
    """Plot every step of an explanation with its numbers; the title of a failed step is
    red.

    The nine axes are image, camera pose, bird's-eye view, marking response, stripes,
    votes, fit, overlay and text.
    """
    said = (
        {"votes": "no search in this frame"}
        if explanation.prediction is not None
        else {}
    )
    said = defaultdict(
        lambda: "not reached",
        said | {step.name: step.summary for step in explanation.steps},
    )
    detection = explanation.detection
    lane = explanation.lane
    failed = explanation.failed
    search = detection.search if detection else None
    result = (
        f"Result: {lane.state}, confidence {lane.confidence:.0%}"
        if lane
        else "Result: no lane"
    )
    # title, function that plots the panel, and what it needs
    panels: dict[str, tuple[str, Callable[[Axes, Explanation, Any], None], object]] = {
        "picture": (f"Image: {said['picture']}", _plot_image, explanation.image),
        "pose": (
            f"Camera pose: {explanation.camera.require_pose().describe()}",
            _plot_pose,
            explanation,
        ),
        "birdseye": (f"Bird's-eye view: {said['birdseye']}", _plot_birdseye, detection),
        "markings": (
            f"Marking response: {said['markings']}",
            _plot_markings,
            detection,
        ),
        "stripes": (f"Stripes: {said['stripes']}", _plot_stripes, detection),
        "votes": (f"Votes: {said['votes']}", _plot_votes, search),
        "fit": (f"Fit: {said['fit']}", _plot_fit, explanation.fit),
        "lane": (
            result,
            _plot_image,
            draw_lane(explanation.image, lane, explanation.camera),
        ),
        "text": ("In words", _plot_text, explanation),
    }
    figure, axes = new_figure(3, 3, (18, 11.5), height_ratios=(1, 1, 1.2))
    for number, (axis, (step, (title, plot, needed))) in enumerate(
        zip(axes, panels.items(), strict=True), 1
    ):
        if needed is None:
            axis.text(
                0.5, 0.5, said[step], ha="center", va="center", transform=axis.transAxes
            )
            axis.set_axis_off()
        else:
            plot(axis, explanation, needed)
        axis.set_title(f"{number} {title}", fontsize=10)
        if failed and failed.name == step:
            axis.title.set_color(_FAILED_COLOUR)
    return figure, axes


def _plot_image(axis: Axes, _: Explanation, image: np.ndarray) -> None:
    axis.imshow(image)
    axis.set_axis_off()


def _plot_pose(axis: Axes, explanation: Explanation, _: object) -> None:
    """Undistorted image with the horizon, the point straight ahead and distances on the
    road, 4 m to either side.
    """
    camera = replace(explanation.camera, distortion=np.zeros(5))
    height, width = explanation.image.shape[:2]
    axis.imshow(undistort(explanation.image, explanation.camera))
    # as far as the horizon
    ends = camera.road_to_pixels(
        1e7 * np.array([[1.0, 0.6, 0], [1, 0, 0], [1, -0.6, 0]])
    )
    axis.plot(
        *ends.T, color=_HORIZON_COLOUR, lw=1.2, label="horizon of the camera pose"
    )
    axis.plot(
        *ends[1],
        "+",
        color=_HORIZON_COLOUR,
        ms=14,
        mew=2,
        label="straight ahead of the car",
    )
    for x_m in _MARKED_M:
        mark = camera.road_to_pixels(np.array([[x_m, 4.0], [x_m, -4.0]]))
        axis.plot(*mark.T, color=rgb(WINDOW_COLOUR), lw=1)
        if mark[0, 1] < height:
            axis.annotate(
                f"{x_m} m ",
                mark[0],
                color=rgb(WINDOW_COLOUR),
                fontsize=8,
                ha="right",
                va="center",
            )
    if (lane := explanation.lane) is not None:
        ahead = np.array(
            [[np.cos(lane.heading_rad), np.sin(lane.heading_rad), lane.pitch_rad]]
        )
        pixel = camera.road_to_pixels(1e7 * ahead)[0]
        axis.plot(
            *pixel,
            "x",
            color=rgb(LANE_COLOUR),
            ms=9,
            mew=2,
            label="direction of the lane",
        )
    axis.set(xlim=(0, width), ylim=(height, 0))
    axis.set_axis_off()
    axis.legend(loc="lower right", fontsize=8)


def _plot_birdseye(axis: Axes, _: Explanation, detection: StillDetection) -> None:
    view = detection.evidence.view
    draw_on_road_grid(
        axis, view.blacken(detection.evidence.view_image), view.x_m, view.y_m
    )


def _plot_markings(axis: Axes, _: Explanation, detection: StillDetection) -> None:
    strength = detection.evidence.response.strength
    view = detection.evidence.view
    draw_on_road_grid(axis, strength, view.x_m, view.y_m, cmap="magma", vmin=0, vmax=12)


def _plot_stripes(
    axis: Axes, explanation: Explanation, detection: StillDetection
) -> None:
    """Stripe candidates on the road in metres, those of the lane in the colours of its
    lines.
    """
    _set_road_axes(axis)
    stripes = detection.evidence.stripes
    side = np.zeros(len(detection.evidence.stripes))
    if detection.lane is not None and explanation.fit is not None:
        side = SIDES @ explanation.fit.members[0]
    lines = (
        (0, (150, 150, 150), "on no line"),
        (1, LEFT_COLOUR, "left line"),
        (-1, RIGHT_COLOUR, "right line"),
    )
    for which, colour, label in lines:
        mine = stripes.select(side == which)
        if len(mine):
            size = 3 + 27 * mine.weight
            axis.scatter(
                mine.y_m,
                mine.x_m,
                s=size,
                color=rgb(colour),
                lw=0,
                label=f"{len(mine)} {label}",
            )
            axis.legend(loc="upper right", fontsize=8)


def _plot_votes(axis: Axes, explanation: Explanation, search: Search) -> None:
    """Vote table: for each curvature and lateral position the votes of the best
    heading.
    """
    curvature = VOTES.hypotheses[:, 1]  # columns: heading, curvature, pitch
    bends = np.unique(curvature)
    # The search uses square roots of votes. They keep a dashed line visible next to a
    # solid one.
    table = np.sqrt([search.votes[curvature == bend].max(axis=0) for bend in bends])
    half_m = VOTES.bins / 2 * VOTES.bin_m
    axis.imshow(
        table[:, ::-1],
        extent=(half_m, -half_m, len(bends) - 0.5, -0.5),
        aspect="auto",
        cmap="magma",
    )
    shown = np.arange(1, len(bends), 3)
    axis.set_yticks(shown, [f"{1000 * bends[n]:.0f}" for n in shown], fontsize=8)
    axis.set(xlabel="left (m)", ylabel="curvature (per km)")
    for candidate in explanation.candidates:
        row = np.interp(candidate.model[CURVATURE], bends, np.arange(len(bends)))
        lines_y_m = candidate.model[CENTRE] + SIDES * candidate.model[WIDTH] / 2
        colour = rgb(LANE_COLOUR if candidate.chosen else WINDOW_COLOUR)
        axis.plot(lines_y_m, [row, row], "o", color=colour, mfc="none", ms=9)


def _plot_fit(axis: Axes, explanation: Explanation, fit: Fit) -> None:
    """Lanes on the road in metres: the chosen one with its uncertainty, rejected ones
    dashed, the predicted dotted.
    """
    _set_road_axes(axis)
    view = fit.view
    stripes = fit.stripes
    axis.scatter(stripes.y_m, stripes.x_m, s=3, color="0.75", lw=0)
    if explanation.prediction is not None:
        lines = lines_on_view(explanation.prediction[None], view.x_m, view.height_m)[0]
        axis.plot(
            lines.T, view.x_m, color="0.2", lw=1, ls=":", label=["predicted", None]
        )
    for candidate in explanation.candidates:
        if not candidate.chosen:
            for line in lines_on_view(candidate.model[None], view.x_m, view.height_m)[
                0
            ]:
                axis.plot(line, view.x_m, color="0.5", lw=1, ls="--")
    if explanation.lane is None:
        return
    x_m = np.linspace(0, 50, 101)
    for line, name, colour in zip(
        explanation.lane.lines,
        ("left", "right"),
        (LEFT_COLOUR, RIGHT_COLOUR),
        strict=True,
    ):
        y_m = line.y(x_m)
        std_m = line.std_m(x_m)
        label = f"{name}: {f'paint on {min(line.support, 1):.0%}' if line.seen else 'inferred'}"
        std_m[~(np.abs(y_m) <= _ROAD_HALF_WIDTH_M)] = np.nan
        shown = np.flatnonzero((x_m <= 20) & np.isfinite(std_m))
        if len(shown):
            label += f", ± {describe_std(std_m[shown[-1]])} m at {x_m[shown[-1]]:.0f} m"
        axis.fill_betweenx(
            x_m, y_m - 2 * std_m, y_m + 2 * std_m, color=rgb(colour), alpha=0.25, lw=0
        )
        axis.plot(y_m, x_m, color=rgb(colour), label=label)
    # room for the legend above the lines
    axis.set_ylim(top=66)
    axis.legend(
        loc="upper right",
        fontsize=8,
        title="bands: two standard deviations",
        title_fontsize=8,
    )


def _plot_text(axis: Axes, explanation: Explanation, _: object) -> None:
    """Failure and advice, then the lane in words."""
    lines = explanation.describe_result()
    failed = explanation.failed
    lines = [
        f"prediction {step.summary}"
        for step in explanation.steps
        if step.name == "prediction"
    ] + lines
    if failed:
        lines = [
            f"Step “{failed.name}”: {failed.failure}",
            f"What to do: {failed.advice}",
            "",
            *lines,
        ]
    text = "\n".join(
        textwrap.fill(line, 84, subsequent_indent=" " * 11) for line in lines
    )
    axis.text(
        0,
        1,
        text,
        va="top",
        fontsize=8,
        family="monospace",
        in_layout=False,
        transform=axis.transAxes,
    )
    axis.set_axis_off()


def _set_road_axes(axis: Axes) -> None:
    axis.set(
        xlim=(_ROAD_HALF_WIDTH_M, -_ROAD_HALF_WIDTH_M),
        ylim=(0, 52),
        xlabel="left (m)",
        ylabel="ahead (m)",
    )
    axis.grid(alpha=0.3)


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
