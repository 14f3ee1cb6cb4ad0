"""Sketch of the sign conventions: the road from above, the camera from the side and from behind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lanes.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Point = tuple[float, float]

ROAD, ARROW, ANGLE, GUIDE = "0.25", "tab:red", "tab:blue", "0.6"
# Slope of the sketched lane at the car: the tangent of its heading.
SLOPE = 0.2


def sketch_conventions() -> tuple[Figure, np.ndarray]:
    """Plot the axes of the road frame and the positive direction of offset, curvature, heading, yaw, pitch and roll."""
    figure, axes = new_figure(1, 3, (12, 4.2), gridspec_kw={"width_ratios": [1.5, 1, 1]})
    _sketch_from_above(axes[0])
    _sketch_from_the_side(axes[1])
    _sketch_from_behind(axes[2])
    for axis in axes:
        axis.set_axis_off()
        axis.set_aspect("equal")
    return figure, axes


def _sketch_from_above(axis: Axes) -> None:
    """A bend to the left; the car is left of the centre. Plotted with y to the left, so the columns are -y."""
    x = np.linspace(0, 7.5, 50)
    for c0, style in ((1.0, "-"), (-2.6, "-"), (-0.8, ":")):
        axis.plot(-(c0 + SLOPE * x + 0.03 * x**2), x, style, color=ROAD if style == "-" else GUIDE)
    axis.fill([-0.45, 0.45, 0.45, -0.45], [-1.3, -1.3, 0.7, 0.7], color="0.85", ec=ROAD)
    _arrow(axis, (0, 0), (0, 2.6), "x forward", (0.2, 2.7))
    _arrow(axis, (0, 0), (-2.3, 0), "y left", (-2.9, 0.15))
    axis.plot([0, 0], [2.6, 7], "--", color=GUIDE, lw=1)
    _arc(axis, (0, 0), 4.2, 90, 112, "yaw > 0:\ncamera looks left", (2.0, 3.9))
    axis.plot([0, -2.1], [0, 5.2], color=ANGLE, lw=1)
    _arrow(axis, (0.8, -0.3), (0, -0.3), "offset > 0: car left\nof the lane centre (dotted)", (2.8, -0.6), ANGLE)
    axis.plot([0.8, 0.8], [0, 2.4], "--", color=GUIDE, lw=1)
    axis.plot([0.8, 0.8 - 2.4 * SLOPE], [0, 2.4], color=ANGLE, lw=1)
    _arc(axis, (0.8, 0), 2.1, 90, 90 + np.degrees(np.arctan(SLOPE)), "heading > 0: road\npoints left of x", (2.9, 1.3))
    axis.text(0.6, 6.9, "curvature > 0: road bends left", color=ANGLE)
    axis.set(xlim=(-3.8, 7.2), ylim=(-1.8, 7.8), title="From above")


def _sketch_from_the_side(axis: Axes) -> None:
    axis.plot([-1, 6], [0, 0], color=ROAD)
    axis.plot([0, 0], [0, 2], ":", color=GUIDE)
    axis.text(0.1, 0.85, "height")
    axis.plot([0, 5.5], [2, 2], "--", color=GUIDE, lw=1)
    axis.plot([0, 5], [2, 0.75], color=ANGLE)
    _arc(axis, (0, 2), 3.4, -14, 0, "pitch > 0:\ncamera looks down", (2.6, 2.3))
    _camera(axis, (0, 2))
    _arrow(axis, (0, 0), (1.8, 0), "x", (1.8, -0.5))
    _arrow(axis, (0, 0), (0, 0.8), "z up", (-0.95, 0.5))
    axis.set(xlim=(-1.2, 6), ylim=(-0.9, 4), title="From the side")


def _sketch_from_behind(axis: Axes) -> None:
    axis.plot([-3, 3], [0, 0], color=ROAD)
    angle = np.radians(-12)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    frame = np.array([[-2, -1.1], [2, -1.1], [2, 1.1], [-2, 1.1], [-2, -1.1]]) @ turn.T + [0, 2]
    axis.plot(*frame.T, color=ANGLE)
    axis.plot([0, 2.7], [2, 2], "--", color=GUIDE, lw=1)
    axis.plot([0, 2.6], [2, 2 + 2.6 * np.tan(angle)], color=ANGLE, lw=1)
    _arc(axis, (0, 2), 2.4, -12, 0, "roll > 0:\nright side down", (0.6, 3.4))
    _arrow(axis, (0, 0), (-1.8, 0), "y left", (-2.6, -0.6))
    _arrow(axis, (0, 0), (0, 0.8), "z", (0.15, 0.4))
    axis.set(xlim=(-3.2, 3.2), ylim=(-0.9, 4.3), title="From behind")


def _camera(axis: Axes, at: Point) -> None:
    axis.plot(*at, "s", color=ROAD, markersize=9)


def _arrow(axis: Axes, start: Point, end: Point, text: str, text_at: Point, colour: str = ARROW) -> None:
    axis.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8})
    axis.text(*text_at, text, color=colour)


def _arc(axis: Axes, centre: Point, radius: float, start_deg: float, end_deg: float, text: str, text_at: Point) -> None:
    """An arc of an angle with its label."""
    angles = np.radians(np.linspace(start_deg, end_deg, 20))
    axis.plot(centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles), color=ANGLE)
    axis.text(*text_at, text, color=ANGLE)
