"""Geometry sketches of the course: the pictures docs/pictures/sketch_*.png."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from lanes.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Point = tuple[float, float]
INK = "0.2"
GUIDE = "0.55"
RED = "tab:red"
BLUE = "tab:blue"
ROAD = "0.87"
GROUND = "#f1f4ea"
SKY = "#e9f3fb"
PALE_RED = "#f2b8b8"
PALE_BLUE = "#d3e4f3"
TEXT_PT = 16
FORMULA_PT = 23
# Arrow heads of a length; others have one head.
LENGTH = "<|-|>"


def sketch(name: str) -> tuple[Figure, np.ndarray]:
    """Plot one of `SKETCHES`; returns its figure and the axes of its panels.

    It is 12 inches wide at 80 dots per inch.
    """
    plot, widths, height_in = SKETCHES[name]
    place = {
        "width_ratios": widths,
        "left": 0,
        "right": 1,
        "bottom": 0,
        "top": 1,
        "wspace": 0,
    }
    look = {"aspect": "equal", "frame_on": False, "xticks": [], "yticks": []}
    figure, axes = new_figure(
        1,
        len(widths),
        (12, height_in),
        layout="none",
        gridspec_kw=place,
        subplot_kw=look,
    )
    plot(*axes)
    return figure, axes


def _sketch_pinhole(axis: Axes) -> None:
    """Camera axes from above: X to the right, Z up."""
    axis.fill(
        [0, 0, 4.68],
        [0, 5.2, 5.2],
        fc=PALE_BLUE,
        ec=BLUE,
        lw=2,
    )
    axis.fill(
        [0, 0, 1.8],
        [0, 2, 2],
        fc=PALE_RED,
        ec=RED,
        lw=2,
    )
    axis.plot(
        [-3.2, 4.6],
        [2, 2],
        color=INK,
        lw=3,
    )
    axis.plot(
        [0, 0],
        [5.2, 5.7],
        "--",
        color=GUIDE,
    )
    _draw_camera(axis, (0, 0), 90)
    _arrow(axis, (0, 5.2), (4.68, 5.2), BLUE, LENGTH)
    _say(axis, (2.3, 4.8), "$X$", BLUE)
    _arrow(
        axis,
        (-3.6, 0),
        (-3.6, 5.2),
        BLUE,
        LENGTH,
    )
    _say(axis, (-5.2, 3), "distance $Z$", BLUE)
    _arrow(
        axis,
        (-0.4, 0),
        (-0.4, 2),
        RED,
        LENGTH,
    )
    _say(axis, (-1.95, 1), "focal length $f$", RED)
    _arrow(axis, (0, 2), (1.8, 2), RED, LENGTH)
    _say(axis, (0.95, 2.4), "$u - c_x$", RED)
    _dot(axis, (4.68, 5.2), BLUE)
    _dot(axis, (1.8, 2), RED)
    _say(axis, (0, 6.1), "optical axis")
    _say(axis, (5, 5.2), "point at $(X, Z)$", BLUE, "left")
    _say(axis, (-0.15, 2.4), "column $c_x$", align="right")
    _say(axis, (2.05, 1.6), "column $u$ of its pixel", RED, "left")
    _say(axis, (4.8, 2), "image", align="left")
    _say(axis, (0.5, -0.35), "camera, from above", align="left")
    _say(axis, (8.5, 4), "red and blue triangle\nhave the same shape:")
    _say(axis, (8.5, 2.7), r"$u - c_x = f\,\dfrac{X}{Z}$", size=FORMULA_PT)
    axis.set(
        xlim=(-6.8, 10.9),
        ylim=(-1.05, 6.6),
    )


def _sketch_distortion(radial: Axes, tangential: Axes) -> None:
    """A square grid through two lenses; the distortion is exaggerated."""
    _draw_lens(radial, k1=-0.13, p1=0, p2=0)
    _draw_lens(tangential, k1=0, p1=0.03, p2=0.05)
    _say(radial, (0, -1.27), r"Radial, $k_1 < 0$: all sides alike")
    _say(radial, (0, 1.27), "centred lens: points move along the radius", RED)
    _say(tangential, (0, -1.27), "Tangential, $p_1$, $p_2$: opposite sides differ")
    _say(tangential, (0, 1.27), "tilted lens or sensor", RED)
    for axis in (radial, tangential):
        axis.set(
            xlim=(-1.85, 1.85),
            ylim=(1.45, -1.45),
        )


def _draw_lens(axis: Axes, k1: float, p1: float, p2: float) -> None:
    """A grid as it is (gray), and as a lens shows it, with arrows at the corners."""
    steps = np.linspace(-1, 1, 9)
    x, y = np.meshgrid(steps, steps)
    r2 = x**2 + y**2
    x_d = x * (1 + k1 * r2) + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    y_d = y * (1 + k1 * r2) + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    axis.plot(
        x,
        y,
        x.T,
        y.T,
        color=GUIDE,
        lw=0.8,
        ls="--",
    )
    axis.plot(
        x_d,
        y_d,
        x_d.T,
        y_d.T,
        color=BLUE,
        lw=1.5,
    )
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        start = (x[row, column], y[row, column])
        end = (x_d[row, column], y_d[row, column])
        _arrow(axis, start, end, RED)


def _sketch_homography(side: Axes, image: Axes) -> None:
    """Depths of a near and a far point, and the road in the image, true to them."""
    side.plot(
        [-2.2, 16.8],
        [0, 0],
        color=INK,
        lw=3,
    )
    image.fill(
        [-1.7, 1.7, 1.7, -1.7],
        [-0.42, -0.42, 1.75, 1.75],
        fc=SKY,
        ec=INK,
        lw=3,
    )
    image.fill(
        [-1.25, 0, 1.25],
        [1.75, 0, 1.75],
        fc=ROAD,
        ec=INK,
        lw=2,
    )
    _draw_camera(side, (0, 3.2), 0)
    for name, depth, top, colour in (("near", 5, 4.8, RED), ("far", 15, 6.9, BLUE)):
        side.plot(
            [0, 0, depth, depth],
            [3.2, top, top, 0],
            ":",
            color=GUIDE,
        )
        side.plot([0, depth], [3.2, 0], color=colour)
        _arrow(side, (0, top), (depth, top), colour, LENGTH)
        _say(side, (depth / 2, top + 0.7), rf"depth $\lambda$: {depth} m", colour)
        _say(side, (depth, -1), f"{name} point", colour)
        _say(
            image,
            (5 / depth + 0.12, 7 / depth),
            f"{depth} m",
            colour,
            "left",
        )
        for axis, at in (
            (side, (depth, 0)),
            (image, (-5 / depth, 7 / depth)),
            (image, (5 / depth, 7 / depth)),
        ):
            _dot(axis, at, colour)
    _say(image, (0, -0.17), "vanishing point")
    _say(image, (0, 1.94), "depth × 3: size ÷ 3")
    _say(side, (7.3, 9), "Road point $(x, y)$: append 1, multiply by $H$")
    _say(image, (0, -0.6), r"Image: divide by the depth $\lambda$")
    multiply = r"$(a,\ b,\ \lambda)^\top = H\,(x,\ y,\ 1)^\top$"
    divide = r"$(u,\ v) = (a/\lambda,\ b/\lambda)$"
    _say(
        side,
        (14.6, -3.15),
        rf"{multiply} $\qquad\qquad\quad$ {divide}",
        size=FORMULA_PT,
    )
    side.set(
        xlim=(-2.7, 17.3),
        ylim=(-4.2, 9.7),
    )
    image.set(
        xlim=(-1.8, 1.8),
        ylim=(2.6, -0.79),
    )


def _sketch_vanishing(angles: Axes, height: Axes) -> None:
    """An image with the vanishing point right of and below the principal point."""
    for axis in (angles, height):
        axis.fill(
            [0, 16, 16, 0],
            [0, 0, 9, 9],
            fc=SKY,
            ec=INK,
            lw=3,
        )
        axis.fill(
            [0.7, 9.6, 15.2],
            [9, 4.4, 9],
            fc=ROAD,
            ec=INK,
            lw=2,
        )
        _dot(axis, (9.6, 4.4), RED)
        axis.set(
            xlim=(-0.6, 16.6),
            ylim=(11.3, -1.6),
        )

    _say(angles, (8, -0.85), "Vanishing point: pitch and yaw")
    angles.plot(
        [8, 8, 9.6],
        [2.6, 4.4, 4.4],
        ":",
        color=GUIDE,
    )
    angles.plot(
        [8, 9.6, 9.6],
        [2.6, 2.6, 4.4],
        ":",
        color=GUIDE,
    )
    _dot(angles, (8, 2.6), BLUE)
    _say(angles, (7.7, 1.9), "$(c_x, c_y)$", BLUE, "right")
    _say(angles, (10, 4.2), "$(u_0, v_0)$", RED, "left")
    _arrow(angles, (8, 2.6), (9.6, 2.6))
    _say(angles, (11.2, 1.9), "$u_0 - c_x$: yaw", RED)
    _arrow(angles, (8, 2.6), (8, 4.4))
    _say(angles, (6.1, 3.9), "$c_y - v_0$:\npitch", RED)
    yaw = r"$\tan\,\mathrm{yaw} = (u_0 - c_x)\,/\,f_x$"
    _say(angles, (8, 10.2), yaw, size=FORMULA_PT)

    _say(height, (8, -0.85), "Slopes: height")
    height.plot(
        [0, 16],
        [4.4, 4.4],
        "--",
        color=GUIDE,
    )
    _say(height, (0.4, 3.8), "horizon", align="left")
    _arrow(height, (14.6, 4.4), (14.6, 7.4), BLUE, LENGTH)
    _say(height, (15.2, 5.6), "$d$", BLUE)
    _arrow(height, (3.8, 7.4), (13.25, 7.4), RED, LENGTH)
    _say(height, (8.6, 8.1), "width of the lane", RED)
    _say(height, (4.4, 5.2), r"slope $s_\mathrm{left}$", align="right")
    _say(height, (11.6, 5.2), r"$s_\mathrm{right}$", align="left")
    width = r"width $= (s_\mathrm{right} - s_\mathrm{left})\; d$"
    _say(height, (8, 10.2), width, size=FORMULA_PT)


def _sketch_ray(axis: Axes) -> None:
    """A ray 19 degrees below the horizon.

    The pitch of 7 degrees and its error of 5 degrees are exaggerated.
    """
    meets = 3.6 / np.tan(np.radians(19))
    wrong = 3.6 / np.tan(np.radians(24))
    axis.plot(
        [-1.5, 15],
        [0, 0],
        [1.7, 1.9],
        [2.6, 4.2],
        color=INK,
        lw=3,
    )
    axis.plot(
        [0, 12.5],
        [3.6, 3.6],
        [0, 11.5],
        [3.6, 3.6 - 11.5 * np.tan(np.radians(7))],
        color=GUIDE,
        ls="--",
    )
    axis.plot([0, meets], [3.6, 0], color=BLUE)
    axis.plot(
        [0, wrong],
        [3.6, 0],
        "--",
        color=RED,
    )
    _draw_camera(axis, (0, 3.6), -7)
    _arc(axis, (0, 3.6), 9, (-7, 0), INK)
    _say(axis, (9.9, 3.1), "pitch")
    _arc(axis, (0, 3.6), 4.5, (-19, 0))
    _say(axis, (5, 2.6), r"$\alpha$", BLUE)
    _arc(
        axis,
        (0, 3.6),
        6,
        (-24, -19),
        RED,
    )
    _say(axis, (6.15, 1.2), r"$\varepsilon$", RED)
    _arrow(axis, (0, 0), (0, 3.4), INK, LENGTH)
    _say(axis, (-1.4, 1.8), "height $h$")
    _arrow(
        axis,
        (0, -0.55),
        (meets, -0.55),
        BLUE,
        LENGTH,
    )
    _say(axis, (meets / 2, -1.05), "distance $x$", BLUE)
    _arrow(axis, (meets, 0), (wrong + 0.15, 0))
    _say(axis, (13.3, 0.95), "a small pitch error $\\varepsilon$\nmoves the point", RED)
    for at, colour in (((meets, 0), BLUE), ((1.77, 2.99), BLUE), ((wrong, 0), RED)):
        _dot(axis, at, colour)
    _say(axis, (12.7, 3.6), "horizon", align="left")
    _say(axis, (11.7, 2.2), "optical axis", align="left")
    _say(axis, (1.9, 4.55), "image")
    _say(axis, (2.2, 3.95), "ray of a pixel", BLUE, "left")
    _say(axis, (14.4, -0.4), "road")
    _say(axis, (8.2, 4.9), r"$\alpha$: angle below the horizon", BLUE, "left")
    _say(axis, (6.4, 4.9), r"$x = \dfrac{h}{\tan\,\alpha}$", size=FORMULA_PT)
    axis.set(
        xlim=(-2.9, 15.8),
        ylim=(-1.5, 5.67),
    )


def _sketch_grid(road: Axes, image: Axes) -> None:
    """A road 9.6 m wide, and its image.

    The camera is 1.3 m high, has the focal length 1150 px and looks along the road.
    """
    road.fill(
        [-4.8, 4.8, 4.8, -4.8],
        [-3, -3, 21.3, 21.3],
        color=ROAD,
    )
    road.fill(
        [-0.9, 0.9, 0.9, -0.9],
        [-3, -3, 1.5, 1.5],
        color=INK,
    )
    image.fill(
        [0, 1280, 1280, 0],
        [0, 0, 360, 360],
        color=SKY,
        lw=0,
    )
    image.fill(
        [0, 1280, 1280, 0],
        [360, 360, 720, 720],
        color=GROUND,
        lw=0,
    )
    image.fill(
        [0, 0, 640, 1280, 1280],
        [720, 533, 360, 533, 720],
        color=ROAD,
        lw=0,
    )
    image.fill(
        [0, 1280, 1280, 0],
        [0, 0, 720, 720],
        fc="none",
        ec=INK,
        lw=3,
    )
    _draw_grid(road, lambda x, y: (-y, x), "$(x, y)$")
    _draw_grid(
        image, lambda x, y: (640 - 1150 * y / x, 360 + 1150 * 1.3 / x), "$(u, v)$"
    )
    look = {
        "arrowstyle": "-|>",
        "color": RED,
        "lw": 2.5,
        "mutation_scale": 22,
        "connectionstyle": "arc3,rad=-0.3",
    }
    image.annotate(
        "",
        (458, 517),
        (-1.5, 9.5),
        "data",
        road.transData,
        arrowprops=look | {"shrinkB": 6},
    )
    _say(road, (0, -0.8), "car", "white")
    _say(road, (7.5, 18), "for each cell:\nwhich pixel?", RED)
    _say(road, (0, 22.2), "Grid on the road, in metres")
    _say(image, (640, -60), "The same grid in the image")
    _say(
        image, (193, 787), r"$(u,\ v) = \mathrm{project}\,(x,\ y,\ 0)$", size=FORMULA_PT
    )
    road.set(
        xlim=(-5.6, 9.9),
        ylim=(-7.2, 24),
        aspect="auto",
    )
    image.set(
        xlim=(-30, 1310),
        ylim=(850, -118),
    )


def _draw_grid(
    axis: Axes, place: Callable[[Any, Any], tuple[Any, Any]], label: str
) -> None:
    """A grid 5 to 20 m ahead with a marked cell.

    `place` maps x, y on the road to the axes.
    """
    across, along = place(*np.meshgrid(np.arange(5, 21, 3), np.arange(-2, 3)))
    axis.fill(
        across[[3, 4, 4, 3], [1, 1, 2, 2]],
        along[[3, 4, 4, 3], [1, 1, 2, 2]],
        color=PALE_RED,
    )
    axis.plot(across, along, across.T, along.T, color=BLUE)
    _dot(axis, place(9.5, 1.5), RED)
    _say(axis, place(9.5, 2.4), label, RED, "right")
    for distance in (5, 20):
        _say(axis, place(distance, -2.3), f"{distance} m", align="left")


def _sketch_conventions(camera: Axes, lane: Axes, tilt: Axes) -> None:
    """Camera and lane from above, camera from the side and from behind.

    y is to the left, so the columns of the panels are -y.
    """
    _arrow(camera, (0, 0), (0, 3))
    _say(camera, (1.5, 2.2), "$x$ forward", RED)
    _arrow(camera, (0, 0), (-2.2, 0))
    _say(camera, (-1.75, 0.5), "$y$ left", RED)
    camera.plot(
        [0, 0],
        [3, 5.6],
        "--",
        color=GUIDE,
    )
    camera.plot([0, -1.9], [0, 5.4], color=BLUE)
    _arc(camera, (0, 0), 4.7, (90, 109.4))
    _say(camera, (0, 6.5), "yaw > 0:\ncamera looks left", BLUE)
    x = np.linspace(0, 5.6, 50)
    for start, style in ((-1, "-"), (2.8, "-"), (0.9, ":")):
        lane.plot(
            start - 0.2 * x - 0.04 * x**2,
            x,
            style,
            color=INK,
        )
    lane.plot(
        [0.9, 0.9],
        [0, 4],
        "--",
        color=GUIDE,
    )
    lane.plot([0.9, 0.1], [0, 4], color=BLUE)
    _arrow(lane, (0.9, -0.3), (0, -0.3), BLUE)
    _say(lane, (3, -1.2), "offset > 0: car left\nof the lane centre", BLUE)
    _arc(lane, (0.9, 0), 3.6, (90, 101.3))
    _say(lane, (3.7, 3.6), "heading > 0:\nlane points left", BLUE)
    _say(lane, (0.3, 6.5), "curvature $\\kappa = 1/R > 0$:\nroad bends left", BLUE)
    for axis, title, across in (
        (camera, "Camera from above", (-3, 3)),
        (lane, "Lane from above", (-3.6, 5.4)),
    ):
        axis.fill(
            [-0.5, 0.5, 0.5, -0.5],
            [-1.5, -1.5, 0.7, 0.7],
            fc=ROAD,
            ec=INK,
        )
        _say(axis, (0, 7.8), title)
        axis.set(xlim=across, ylim=(-2.2, 8.2))
    _sketch_tilt(tilt)


def _sketch_tilt(axis: Axes) -> None:
    axis.plot(
        [-1.2, 5.6],
        [3.8, 3.8],
        [-1.2, 5.6],
        [-1.2, -1.2],
        color=INK,
        lw=3,
    )
    axis.plot(
        [0, 5.5],
        [6.2, 6.2],
        [1, 3.6],
        [1.2, 1.2],
        color=GUIDE,
        ls="--",
    )
    corners = np.array([-1.7 - 0.8j, 1.7 - 0.8j, 1.7 + 0.8j, -1.7 + 0.8j])
    frame = corners * np.exp(-0.2j) + 1 + 1.2j
    axis.fill(frame.real, frame.imag, fc=SKY, ec=BLUE)
    axis.plot(
        [0, 5.3],
        [6.2, 4.6],
        [1, 3.5],
        [1.2, 0.69],
        color=BLUE,
    )
    _draw_camera(axis, (0, 6.2), -16.8)
    _arc(axis, (0, 6.2), 4, (-16.8, 0))
    _say(axis, (3.1, 7), "pitch > 0: camera looks down", BLUE)
    _arc(axis, (1, 1.2), 2.3, (-11.5, 0))
    _say(axis, (5.2, 0.2), "roll > 0:\nright side down", BLUE)
    _arrow(axis, (0, 3.8), (2.2, 3.8))
    _say(axis, (2.5, 3.4), "$x$", RED)
    _arrow(axis, (0, 3.8), (0, 5.4))
    _say(axis, (0.7, 4.9), "$z$ up", RED)
    _arrow(axis, (1, -1.2), (-1.2, -1.2))
    _say(axis, (-0.6, -1.7), "$y$ left", RED)
    _arrow(axis, (1, -1.2), (1, 0))
    _say(axis, (1.4, -0.5), "$z$", RED)
    _say(axis, (3.1, 7.8), "From the side")
    _say(axis, (1, 2.7), "From behind")
    axis.set(
        xlim=(-1.6, 7.4),
        ylim=(-2.2, 8.2),
    )


def _say(
    axis: Axes,
    at: Point,
    text: str,
    colour: str = INK,
    align: str = "center",
    size: float = TEXT_PT,
) -> None:
    axis.text(
        *at,
        text,
        color=colour,
        fontsize=size,
        ha=align,
        va="center",
    )


def _dot(axis: Axes, at: Point, colour: str) -> None:
    axis.plot(*at, "o", color=colour, markersize=10, zorder=3)


def _arrow(
    axis: Axes, start: Point, end: Point, colour: str = RED, heads: str = "-|>"
) -> None:
    look = {
        "arrowstyle": heads,
        "color": colour,
        "lw": 2.5,
        "mutation_scale": 22,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axis.annotate("", end, start, arrowprops=look)


def _arc(axis: Axes, at: Point, radius: float, ends: Point, colour: str = BLUE) -> None:
    """An arc of an angle, from end to end in degrees."""
    angles = np.radians(np.linspace(*ends, 20))
    across = at[0] + radius * np.cos(angles)
    along = at[1] + radius * np.sin(angles)
    axis.plot(across, along, color=colour)


def _draw_camera(axis: Axes, at: Point, angle_deg: float) -> None:
    """A camera whose lens ends `at`, turned from the x axis.

    It has the same size in every sketch.
    """
    outline = np.array(
        [3j, -3 + 1j, -3 + 3j, -11 + 3j, -11 - 3j, -3 - 3j, -3 - 1j, -3j]
    )
    outline *= np.exp(1j * np.radians(angle_deg))
    axis.plot(
        *at,
        marker=np.column_stack([outline.real, outline.imag]),
        color=INK,
        markersize=70,
        zorder=3,
    )


# Function that plots the panels, their widths, height of the figure in inches.
SKETCHES: dict[str, tuple[Callable[..., None], list[float], float]] = {
    "pinhole": (_sketch_pinhole, [1], 5.2),
    "distortion": (_sketch_distortion, [1, 1], 4.6),
    "vanishing": (_sketch_vanishing, [1, 1], 4.6),
    "homography": (_sketch_homography, [1.35, 1], 4.8),
    "ray": (_sketch_ray, [1], 4.6),
    "grid": (_sketch_grid, [2, 3], 5.2),
    "conventions": (_sketch_conventions, [6, 9, 9], 5.2),
}
