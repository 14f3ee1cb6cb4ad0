"""Figure of an explanation: one panel per step.

Every panel can also be drawn for an explanation that failed at an earlier step.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from lanes.camera.camera import Camera, undistort
from lanes.drawing.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, WINDOW_COLOUR, Colour
from lanes.drawing.figures import new_figure, rgb
from lanes.explain.explanation import Explanation, stripes_on_lines
from lanes.tracking.model import CENTRE, SIDES, WIDTH, lateral_std_m, line_y, lines_on_view
from lanes.tracking.overlay import draw_found
from lanes.tracking.voting import VOTING, hypotheses

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Distances marked on the road, and half the width of the marks, metres.
DISTANCES_M, MARK_HALF_WIDTH_M = (5, 10, 20, 40), 4.0
# Upper limit of the colour scale of the marking response, in units of the noise.
MAX_STRENGTH = 12.0
MAGENTA: Colour = (255, 60, 255)
TEXT_COLUMNS, LINE_POINTS = 72, 12
FAILED_COLOUR = "firebrick"


def plot_frame(axis: Axes, explanation: Explanation) -> None:
    """Plot the raw picture."""
    _show(axis, explanation.image, f"1 Frame: {_step_summary(explanation, 'picture')}")


def plot_pose(axis: Axes, explanation: Explanation) -> None:
    """Plot the undistorted picture with the horizon, the point straight ahead and distances on the road."""
    camera = explanation.undistorted_camera
    height, width = explanation.image.shape[:2]
    _show(axis, undistort(explanation.image, explanation.camera), f"2 Camera pose: {camera.pose.describe()}")
    ends = _directions_to_pixels(camera, np.array([[1.0, 0.6, 0], [1, 0, 0], [1, -0.6, 0]]))
    axis.plot(*ends.T, color=rgb(MAGENTA), lw=1.2, label="horizon of the camera pose")
    axis.plot(*ends[1], "+", color=rgb(MAGENTA), ms=14, mew=2, label="straight ahead of the car")
    for x_m in DISTANCES_M:
        mark = camera.road_to_pixels(np.array([[x_m, MARK_HALF_WIDTH_M], [x_m, -MARK_HALF_WIDTH_M]]))
        axis.plot(*mark.T, color=rgb(WINDOW_COLOUR), lw=1)
        if mark[0, 1] < height:
            axis.annotate(f"{x_m} m ", mark[0], color=rgb(WINDOW_COLOUR), fontsize=8, ha="right", va="center")
    if explanation.lane is not None:
        lane = explanation.lane
        ahead = np.array([[np.cos(lane.heading_rad), np.sin(lane.heading_rad), lane.pitch_rad]])
        pixel = _directions_to_pixels(camera, ahead)[0]
        axis.plot(*pixel, "x", color=rgb(LANE_COLOUR), ms=9, mew=2, label="direction of the lane")
    axis.set(xlim=(0, width), ylim=(height, 0))
    axis.legend(loc="lower right", fontsize=7)


def plot_birdseye(axis: Axes, explanation: Explanation) -> None:
    """Plot the bird's-eye view."""
    title = f"3 Bird's-eye view: {_step_summary(explanation, 'birdseye')}"
    if explanation.evidence is None:
        _show_message(axis, title, "the camera pose shows no road in this picture")
        return
    _show_view(axis, explanation, explanation.view.blacken(explanation.evidence.view_image), title)


def plot_markings(axis: Axes, explanation: Explanation) -> None:
    """Plot the marking response."""
    title = f"4 Marking response: {_step_summary(explanation, 'markings')}"
    if explanation.evidence is None:
        _show_message(axis, title, "not reached")
        return
    strength = explanation.evidence.response.strength
    _show_view(axis, explanation, strength, title, cmap="magma", vmin=0, vmax=MAX_STRENGTH)


def plot_stripes(axis: Axes, explanation: Explanation) -> None:
    """Plot the stripe candidates on the road in metres, those of the lane in the colours of its lines."""
    _axes_of_road(axis, explanation, f"5 Stripes: {_step_summary(explanation, 'stripes')}")
    if explanation.evidence is None:
        return
    stripes, side = explanation.evidence.stripes, stripes_on_lines(explanation)
    lines = ((0, (150, 150, 150), "on no line"), (1, LEFT_COLOUR, "left line"), (-1, RIGHT_COLOUR, "right line"))
    for which, colour, label in lines:
        mine = stripes.select(side == which)
        if len(mine):
            size = np.clip(mine.strength, 3, 30)
            axis.scatter(mine.y_m, mine.x_m, s=size, color=rgb(colour), lw=0, label=f"{len(mine)} {label}")
            axis.legend(loc="upper right", fontsize=7)


def plot_votes(axis: Axes, explanation: Explanation) -> None:
    """Plot the vote table: for each curvature and lateral position the votes of the best heading."""
    title = f"6 Votes: {_step_summary(explanation, 'votes')}"
    if explanation.votes is None:
        _show_message(axis, title, "not reached")
        return
    curvature = hypotheses()[:, 1]
    bends = np.unique(curvature)
    # The search uses square roots of votes. They keep a dashed line visible next to a solid one.
    table = np.sqrt([explanation.votes[curvature == bend].max(axis=0) for bend in bends])
    half_m = VOTING.bins / 2 * VOTING.bin_m
    axis.imshow(table[:, ::-1], extent=(half_m, -half_m, len(bends) - 0.5, -0.5), aspect="auto", cmap="magma")
    shown = np.arange(1, len(bends), 3)
    axis.set_yticks(shown, [f"{_radius(bends[n])}" for n in shown], fontsize=8)
    axis.set(xlabel="left (m)", ylabel="bend")
    axis.set_title(title)
    for candidate in explanation.candidates:
        row = np.interp(candidate.model[3], bends, np.arange(len(bends)))
        lines_y_m = candidate.model[CENTRE] + SIDES * candidate.model[WIDTH] / 2
        colour = rgb(LANE_COLOUR if candidate.chosen else WINDOW_COLOUR)
        axis.plot(lines_y_m, [row, row], "o", color=colour, mfc="none", ms=9)


def plot_fit(axis: Axes, explanation: Explanation) -> None:
    """Plot the fitted lanes on the road in metres: the chosen one with its uncertainty, the rejected ones dashed."""
    _axes_of_road(axis, explanation, f"7 Fit: {_step_summary(explanation, 'fit')}")
    if explanation.evidence is not None:
        stripes = explanation.evidence.stripes
        axis.scatter(stripes.y_m, stripes.x_m, s=3, color="0.75", lw=0)
    for candidate in explanation.candidates:
        if not candidate.chosen:
            for line in lines_on_view(candidate.model[None], explanation.view.x_m, explanation.view.height_m)[0]:
                axis.plot(line, explanation.view.x_m, color="0.5", lw=1, ls="--")
    if explanation.lane is None:
        return
    x_m = np.linspace(0, 50, 60)
    stds = lateral_std_m(explanation.lane.covariance, x_m)
    for side, std, colour, name in zip(SIDES, stds, (LEFT_COLOUR, RIGHT_COLOUR), ("left", "right"), strict=True):
        y_m = line_y(x_m, explanation.lane.model, side)
        line = getattr(explanation.lane, name)
        axis.fill_betweenx(x_m, y_m - 2 * std, y_m + 2 * std, color=rgb(colour), alpha=0.25, lw=0)
        label = f"{name}: {'paint on ' + format(min(line.support, 1), '.0%') if line.seen else 'inferred'}"
        axis.plot(y_m, x_m, color=rgb(colour), label=f"{label}, ± {np.interp(20, x_m, std):.2f} m at 20 m")
    axis.legend(loc="upper right", fontsize=7, title="bands: two standard deviations", title_fontsize=7)


def plot_result(axis: Axes, explanation: Explanation) -> None:
    """Plot the picture with the lane overlay."""
    tracked = explanation.tracked
    title = f"8 Result: {tracked.state}" + (f", confidence {tracked.confidence:.0%}" if tracked.lane else "")
    _show(axis, draw_found(explanation.image, explanation.lane, explanation.camera), title)


def plot_text(axis: Axes, explanation: Explanation) -> None:
    """Plot the text: failure and advice, numbers of the lane, terms of the confidence, rejected lanes."""
    results = [f"{name}: {words}" for name, words in explanation.tracked.summary().items()]
    results += explanation.confidence_summary()
    results += [f"rejected: {c.reason}" for c in explanation.candidates if not c.chosen]
    failed = explanation.failed
    verdict = [f"Step “{failed.name}”: {failed.failure}", f"What to do: {failed.advice}"] if failed else []
    below = 0
    for lines, colour in ((verdict, FAILED_COLOUR), (results, "0.1")):
        for line in lines:
            for part in textwrap.wrap(line, TEXT_COLUMNS, subsequent_indent="    "):
                place = {"xy": (0, 1), "xycoords": "axes fraction", "textcoords": "offset points"}
                axis.annotate(part, xytext=(0, -below), va="top", fontsize=9, family="monospace", color=colour, **place)
                below += LINE_POINTS
        below += LINE_POINTS // 2
    axis.set_axis_off()
    axis.set_title("9 In words")


# The panels in order, by the name of their step.
PANELS = {
    "picture": plot_frame,
    "pose": plot_pose,
    "birdseye": plot_birdseye,
    "markings": plot_markings,
    "stripes": plot_stripes,
    "votes": plot_votes,
    "fit": plot_fit,
    "lane": plot_result,
    "text": plot_text,
}


def show_explanation(explanation: Explanation) -> tuple[Figure, np.ndarray]:
    """Plot every step of an explanation with its numbers; the title of a failed step is red.

    Returns
    -------
    figure, axes : Figure, ndarray of Axes of shape (9,)
        Frame, camera pose, bird's-eye view, marking response, stripes, votes, fit, overlay and text.
    """
    figure, axes = new_figure(3, 3, (18, 11.5), height_ratios=(1, 1, 1.2))
    for axis, (name, plot) in zip(axes, PANELS.items(), strict=True):
        plot(axis, explanation)
        axis.title.set_fontsize(10)
        if explanation.failed and explanation.failed.name == name:
            axis.title.set_color(FAILED_COLOUR)
    return figure, axes


def _step_summary(explanation: Explanation, name: str) -> str:
    return next((step.summary for step in explanation.steps if step.name == name), "not reached")


def _show(axis: Axes, image: np.ndarray, title: str) -> None:
    axis.imshow(image)
    axis.set_title(title)
    axis.set_axis_off()


def _show_message(axis: Axes, title: str, words: str) -> None:
    axis.text(0.5, 0.5, words, ha="center", va="center", transform=axis.transAxes)
    axis.set_title(title)
    axis.set_axis_off()


def _show_view(axis: Axes, explanation: Explanation, values: np.ndarray, title: str, **look: object) -> None:
    """Show values of the bird's-eye view on its own grid, whose row distances grow geometrically."""
    view = explanation.view
    axis.imshow(values, extent=(view.y_m[0], view.y_m[-1], len(view.x_m) - 0.5, -0.5), aspect="auto", **look)
    rows = np.interp(DISTANCES_M, view.x_m[::-1], np.arange(len(view.x_m))[::-1])
    axis.set_yticks(rows, [f"{x_m} m" for x_m in DISTANCES_M])
    axis.set_xlabel("left (m)")
    axis.set_title(title)


def _axes_of_road(axis: Axes, explanation: Explanation, title: str) -> None:
    half_m = explanation.view.half_width_m
    axis.set(xlim=(half_m, -half_m), ylim=(0, 52), xlabel="left (m)", ylabel="ahead (m)")
    axis.grid(alpha=0.3)
    axis.set_title(title)


def _directions_to_pixels(camera: Camera, directions: np.ndarray) -> np.ndarray:
    """Undistorted pixels (N, 2) of points at infinity in directions (N, 3) of the road frame."""
    x, y, z = (directions @ camera.pose.rotation.T).T
    return np.column_stack([x / z, y / z, np.ones_like(z)]) @ camera.matrix[:2].T


def _radius(curvature_per_m: float) -> str:
    if abs(curvature_per_m) < 1e-6:
        return "straight"
    return f"{'left' if curvature_per_m > 0 else 'right'} {1 / abs(curvature_per_m):.0f} m"
