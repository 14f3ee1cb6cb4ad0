"""Pictures that the checks of exercises draw below their verdict. Jupyter shows them at the end of the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from course.exercises.paint import PaintRating
from course.plots import LEGEND_ABOVE, TRUTH_LOOK, show_pictures
from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, RIGHT_COLOUR, draw_polyline
from lanes.figures import new_figure, rgb

RIGHT, WRONG, OTHER_LINE = LANE_COLOUR, LEFT_COLOUR, (255, 150, 0)
MISSED, NOT_COUNTED, DARK = (255, 0, 255), (150, 150, 150), (35, 35, 35)


def draw_paint(above: np.ndarray, rating: PaintRating) -> None:
    """5.1: the rated pixels and the missed pieces of the lines on a view from above."""
    picture = cv2.cvtColor(cv2.cvtColor(above, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB) // 2 + 25
    for mask, colour in ((rating.on_line, RIGHT), (rating.beside, WRONG), (rating.not_counted, NOT_COUNTED)):
        picture[mask] = colour
    for piece_px in rating.missed_px:
        draw_polyline(picture, piece_px, MISSED, 7.4)
    title = (
        "Your mask: green on a line, red beside it, gray not counted (far, or outside the lane).\n"
        "Magenta: pieces of the lines without a pixel; the gaps between the dashes count, too."
    )
    show_pictures([picture], [title], columns=1)


def draw_caught(panels: Mapping[str, tuple[np.ndarray, ...]]) -> None:
    """6.2: by title three masks (height, width): of a line, of everything that is set, and of what was caught."""
    pictures = []
    for line, every, caught in panels.values():
        picture = np.full((*line.shape, 3), DARK, np.uint8)
        for mask, colour in ((every, NOT_COUNTED), (line, WRONG), (caught, OTHER_LINE), (caught & line, RIGHT)):
            picture[mask] = colour
        pictures.append(picture)
    figure, _ = show_pictures(pictures, list(panels), width_in=6.0 * len(pictures))
    figure.suptitle("Green: caught. Red: missed. Orange: caught from the other line (gray).", fontsize=11)


def draw_bar(image: np.ndarray, bar_px: np.ndarray, true_px: np.ndarray) -> None:
    """8.1: a bar (2, 2) on a raw image, and the true one."""
    picture = image.copy()
    draw_polyline(picture, true_px, RIGHT, 9)
    draw_polyline(picture, np.clip(bar_px, -1e4, 1e4), WRONG, 4)
    show_pictures([picture], ["Your bar: red. True bar: green."], columns=1, width_in=9.0)


@dataclass(frozen=True, eq=False)
class FilteredDrive:
    """A drive of N frames: true, measured and filtered offset, its standard deviation, and what was accepted."""

    times_s: np.ndarray
    true_m: np.ndarray
    measured_m: np.ndarray
    accepted: np.ndarray
    offset_m: np.ndarray
    std_m: np.ndarray


def draw_filtered_drive(drive: FilteredDrive) -> None:
    """12.2: the offset over time, all of it and enlarged."""
    figure, axes = new_figure(2, 1, (12, 6), sharex=True)
    # a filter that diverges leaves the axes, whose limits are fixed
    offset_m, band_m = np.clip(drive.offset_m, -99, 99), np.minimum(2 * drive.std_m, 99)
    for axis, limit_m in zip(axes, (4.6, 0.8), strict=True):
        axis.fill_between(
            drive.times_s, offset_m - band_m, offset_m + band_m, color=rgb(RIGHT_COLOUR), alpha=0.25, lw=0
        )
        axis.plot(drive.times_s, offset_m, color=rgb(RIGHT_COLOUR), label="your filter, ± 2 standard deviations")
        axis.plot(drive.times_s, drive.true_m, label="truth", **TRUTH_LOOK)
        for used, look, colour, label in ((True, ".", RIGHT, "accepted"), (False, "x", WRONG, "rejected")):
            chosen = drive.accepted == used
            axis.plot(drive.times_s[chosen], drive.measured_m[chosen], look, color=rgb(colour), ms=7, label=label)
        axis.set(ylabel="offset (m)", ylim=(-limit_m, limit_m))
        axis.grid(alpha=0.3)
    axes[0].set_title("10 % of the measurements are of the neighbouring lane", loc="left")
    axes[0].legend(ncols=4, **LEGEND_ABOVE)
    axes[1].set_title("Enlarged", loc="left")
    axes[1].set_xlabel("time (s)")


def draw_occlusion(image: np.ndarray, moved_m: np.ndarray, first_row: int) -> None:
    """13.1: a map (rows, columns) of squares, metres, on an image (height, width, 3) from row `first_row` down."""
    height, width = image.shape[:2]
    figure, (axis,) = new_figure(1, 1, (12, 6.2))
    axis.imshow(image)
    largest_m = max(float(moved_m.max()), 0.01)
    place = (-0.5, width - 0.5, height - 0.5, first_row - 0.5)
    shown = {"cmap": "autumn_r", "vmin": 0.0, "vmax": largest_m, "extent": place}
    heat = axis.imshow(moved_m, alpha=0.75 * np.clip(moved_m / largest_m, 0, 1) ** 0.5, **shown)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    axis.set_title("Your map: how far the lane moves if a square is covered")
    axis.set_axis_off()
    figure.colorbar(heat, ax=axis, label="moved, 20 m ahead (m)", fraction=0.025)
