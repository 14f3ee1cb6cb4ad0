"""Figure of an explanation: one panel per step.

Every panel can also be drawn for an explanation that failed at an earlier step.
"""

from __future__ import annotations

import textwrap
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from lanes.camera.camera import Camera, undistort
from lanes.drawing.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR
from lanes.drawing.figures import MARKED_M, draw_on_road_grid, new_figure, rgb
from lanes.explain.explanation import Explanation, stripes_on_lines
from lanes.io.describe import describe_std
from lanes.io.frames import as_rgb
from lanes.tracking.model import CENTRE, CURVATURE, SIDES, WIDTH, lines_on_view
from lanes.tracking.overlay import draw_tracked
from lanes.tracking.voting import HYPOTHESES, VOTING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Half the width of the marks on the road, metres.
MARK_HALF_WIDTH_M = 4.0
# Upper limit of the colour scale of the marking response.
MAX_STRENGTH = 12.0
# Upper end of the plot of the fit, metres ahead: the legend lies above the lines.
FIT_TOP_M = 66.0
TEXT_COLUMNS, LINE_POINTS = 72, 12
HORIZON_COLOUR, FAILED_COLOUR = rgb((255, 60, 255)), "firebrick"


def show_explanation(explanation: Explanation) -> tuple[Figure, np.ndarray]:
    """Plot every step of an explanation with its numbers; the title of a failed step is red.

    Returns
    -------
    figure, axes : Figure, ndarray of Axes of shape (9,)
        Frame, camera pose, bird's-eye view, marking response, stripes, votes, fit, overlay and text.
    """
    said = defaultdict(lambda: "not reached", {step.name: step.summary for step in explanation.steps})
    tracked, failed = explanation.tracked, explanation.failed
    result = f"Result: {tracked.state}" + (f", confidence {tracked.confidence:.0%}" if tracked.lane else "")
    panels = {
        "picture": (f"Frame: {said['picture']}", _plot_frame),
        "pose": (f"Camera pose: {explanation.camera.require_pose().describe()}", _plot_pose),
        "birdseye": (f"Bird's-eye view: {said['birdseye']}", _plot_birdseye),
        "markings": (f"Marking response: {said['markings']}", _plot_markings),
        "stripes": (f"Stripes: {said['stripes']}", _plot_stripes),
        "votes": (f"Votes: {said['votes']}", _plot_votes),
        "fit": (f"Fit: {said['fit']}", _plot_fit),
        "lane": (result, _plot_result),
        "text": ("In words", _plot_text),
    }
    figure, axes = new_figure(3, 3, (18, 11.5), height_ratios=(1, 1, 1.2))
    for number, (axis, (step, (title, plot))) in enumerate(zip(axes, panels.items(), strict=True), 1):
        plot(axis, explanation)
        axis.set_title(f"{number} {title}", fontsize=10)
        if failed and failed.name == step:
            axis.title.set_color(FAILED_COLOUR)
    return figure, axes


def _plot_frame(axis: Axes, explanation: Explanation) -> None:
    axis.imshow(explanation.image)
    axis.set_axis_off()


def _plot_pose(axis: Axes, explanation: Explanation) -> None:
    """Undistorted picture with the horizon, the point straight ahead and distances on the road."""
    camera = explanation.undistorted_camera
    height, width = explanation.image.shape[:2]
    axis.imshow(undistort(explanation.image, explanation.camera))
    ends = _directions_to_pixels(camera, np.array([[1.0, 0.6, 0], [1, 0, 0], [1, -0.6, 0]]))
    axis.plot(*ends.T, color=HORIZON_COLOUR, lw=1.2, label="horizon of the camera pose")
    axis.plot(*ends[1], "+", color=HORIZON_COLOUR, ms=14, mew=2, label="straight ahead of the car")
    for x_m in MARKED_M:
        mark = camera.road_to_pixels(np.array([[x_m, MARK_HALF_WIDTH_M], [x_m, -MARK_HALF_WIDTH_M]]))
        axis.plot(*mark.T, color=rgb(WINDOW_COLOUR), lw=1)
        if mark[0, 1] < height:
            axis.annotate(f"{x_m} m ", mark[0], color=rgb(WINDOW_COLOUR), fontsize=8, ha="right", va="center")
    if (lane := explanation.lane) is not None:
        ahead = np.array([[np.cos(lane.heading_rad), np.sin(lane.heading_rad), lane.pitch_rad]])
        pixel = _directions_to_pixels(camera, ahead)[0]
        axis.plot(*pixel, "x", color=rgb(LANE_COLOUR), ms=9, mew=2, label="direction of the lane")
    axis.set(xlim=(0, width), ylim=(height, 0))
    axis.set_axis_off()
    axis.legend(loc="lower right", fontsize=8)


def _plot_birdseye(axis: Axes, explanation: Explanation) -> None:
    if explanation.evidence is None:
        _show_message(axis, "the camera pose shows no road in this picture")
    else:
        draw_on_road_grid(axis, explanation.view.blacken(explanation.evidence.view_image), explanation.view)


def _plot_markings(axis: Axes, explanation: Explanation) -> None:
    if explanation.evidence is None:
        _show_message(axis, "not reached")
    else:
        strength = explanation.evidence.response.strength
        draw_on_road_grid(axis, strength, explanation.view, cmap="magma", vmin=0, vmax=MAX_STRENGTH)


def _plot_stripes(axis: Axes, explanation: Explanation) -> None:
    """Stripe candidates on the road in metres, those of the lane in the colours of its lines."""
    _axes_of_road(axis, explanation)
    if explanation.evidence is None:
        return
    stripes, side = explanation.evidence.stripes, stripes_on_lines(explanation)
    lines = ((0, (150, 150, 150), "on no line"), (1, LEFT_COLOUR, "left line"), (-1, RIGHT_COLOUR, "right line"))
    for which, colour, label in lines:
        mine = stripes.select(side == which)
        if len(mine):
            size = np.clip(mine.strength, 3, 30)
            axis.scatter(mine.y_m, mine.x_m, s=size, color=rgb(colour), lw=0, label=f"{len(mine)} {label}")
            axis.legend(loc="upper right", fontsize=8)


def _plot_votes(axis: Axes, explanation: Explanation) -> None:
    """Vote table: for each curvature and lateral position the votes of the best heading."""
    if explanation.votes is None:
        _show_message(axis, "not reached")
        return
    curvature = HYPOTHESES[:, 1]  # columns: heading, curvature, pitch
    bends = np.unique(curvature)
    # The search uses square roots of votes. They keep a dashed line visible next to a solid one.
    table = np.sqrt([explanation.votes[curvature == bend].max(axis=0) for bend in bends])
    half_m = VOTING.bins / 2 * VOTING.bin_m
    axis.imshow(table[:, ::-1], extent=(half_m, -half_m, len(bends) - 0.5, -0.5), aspect="auto", cmap="magma")
    shown = np.arange(1, len(bends), 3)
    axis.set_yticks(shown, [_radius(bends[n]) for n in shown], fontsize=8)
    axis.set(xlabel="left (m)", ylabel="bend")
    for candidate in explanation.candidates:
        row = np.interp(candidate.model[CURVATURE], bends, np.arange(len(bends)))
        lines_y_m = candidate.model[CENTRE] + SIDES * candidate.model[WIDTH] / 2
        colour = rgb(LANE_COLOUR if candidate.chosen else WINDOW_COLOUR)
        axis.plot(lines_y_m, [row, row], "o", color=colour, mfc="none", ms=9)


def _plot_fit(axis: Axes, explanation: Explanation) -> None:
    """Fitted lanes on the road in metres: the chosen one with its uncertainty, the rejected ones dashed."""
    _axes_of_road(axis, explanation)
    if explanation.evidence is not None:
        stripes = explanation.evidence.stripes
        axis.scatter(stripes.y_m, stripes.x_m, s=3, color="0.75", lw=0)
    for candidate in explanation.candidates:
        if not candidate.chosen:
            for line in lines_on_view(candidate.model[None], explanation.view.x_m, explanation.view.height_m)[0]:
                axis.plot(line, explanation.view.x_m, color="0.5", lw=1, ls="--")
    if explanation.lane is None:
        return
    lane, x_m = explanation.lane, np.linspace(0, 50, 101)
    lines = zip(lane.lines, lane.lateral_m(x_m), lane.lateral_std_m(x_m), ("left", "right"), strict=True)
    for (line, y_m, std_m, name), colour in zip(lines, (LEFT_COLOUR, RIGHT_COLOUR), strict=True):
        label = f"{name}: {'paint on ' + format(min(line.support, 1), '.0%') if line.seen else 'inferred'}"
        std_m[~(np.abs(y_m) <= explanation.view.half_width_m)] = np.nan
        shown = np.flatnonzero((x_m <= 20) & np.isfinite(std_m))
        if len(shown):
            label += f", ± {describe_std(std_m[shown[-1]])} m at {x_m[shown[-1]]:.0f} m"
        axis.fill_betweenx(x_m, y_m - 2 * std_m, y_m + 2 * std_m, color=rgb(colour), alpha=0.25, lw=0)
        axis.plot(y_m, x_m, color=rgb(colour), label=label)
    axis.set_ylim(top=FIT_TOP_M)
    axis.legend(loc="upper right", fontsize=8, title="bands: two standard deviations", title_fontsize=8)


def _plot_result(axis: Axes, explanation: Explanation) -> None:
    axis.imshow(as_rgb(draw_tracked(explanation.image, explanation.tracked, explanation.camera)))
    axis.set_axis_off()


def _plot_text(axis: Axes, explanation: Explanation) -> None:
    """Failure and advice, numbers of the lane, terms of the confidence, rejected lanes."""
    results = [f"{name}: {words}" for name, words in explanation.tracked.summary().items()]
    results += explanation.confidence_summary()
    results += [f"rejected: {c.reason}" for c in explanation.candidates if not c.chosen]
    failed = explanation.failed
    verdict = [f"Step “{failed.name}”: {failed.failure}", f"What to do: {failed.advice}"] if failed else []
    look: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "va": "top", "fontsize": 9}
    below = 0
    for lines, colour in ((verdict, FAILED_COLOUR), (results, "0.1")):
        for line in lines:
            for part in textwrap.wrap(line, TEXT_COLUMNS, subsequent_indent="    "):
                axis.annotate(part, (0, 1), (0, -below), family="monospace", color=colour, **look)
                below += LINE_POINTS
        below += LINE_POINTS // 2
    axis.set_axis_off()


def _show_message(axis: Axes, words: str) -> None:
    axis.text(0.5, 0.5, words, ha="center", va="center", transform=axis.transAxes)
    axis.set_axis_off()


def _axes_of_road(axis: Axes, explanation: Explanation) -> None:
    half_m = explanation.view.half_width_m
    axis.set(xlim=(half_m, -half_m), ylim=(0, 52), xlabel="left (m)", ylabel="ahead (m)")
    axis.grid(alpha=0.3)


def _directions_to_pixels(camera: Camera, directions: np.ndarray) -> np.ndarray:
    """Undistorted pixels (N, 2) of points at infinity in directions (N, 3) of the road frame."""
    x, y, z = (directions @ camera.require_pose().rotation.T).T
    return np.column_stack([x / z, y / z, np.ones_like(z)]) @ camera.matrix[:2].T


def _radius(curvature_per_m: float) -> str:
    if abs(curvature_per_m) < 1e-6:
        return "straight"
    return f"{'left' if curvature_per_m > 0 else 'right'} {1 / abs(curvature_per_m):.0f} m"
