"""Plots of the notebook: content of the axes."""

from __future__ import annotations

import json
import warnings
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from course import plots
from course.dataset import open_dataset
from course.sketch import SKETCHES, sketch
from helpers import (
    FourPointWarp,
    Lens,
    distort_points,
    road_homography,
    road_to_pixels,
    undistort_points,
)
from lanes.video.images import write_image

PHOTO = np.zeros((72, 128, 3), np.uint8)
LENS = Lens(
    matrix=np.array([[1150.0, 0, 640], [0, 1150, 360], [0, 0, 1]]),
    distortion=np.array([-0.25, 0, 0, 0, 0]),
    size=(1280, 720),
)


def test_marks_ahead_lie_on_the_rows_of_these_distances():
    x_m = np.geomspace(80.0, 5.0, 97)
    y_m = np.linspace(9, -9, 181)
    grid = SimpleNamespace(x_m=x_m, y_m=y_m)
    views = [np.zeros((97, 181)), np.zeros((97, 181))]
    _, axes = plots.show_birdseye(views, ["road", "response"], grid, cmap="magma")
    assert [axis.get_title() for axis in axes] == ["road", "response"]
    labels = [label.get_text() for label in axes[0].get_yticklabels()]
    assert labels == ["5 m", "10 m", "20 m", "40 m"]
    assert axes[0].get_yticks() == pytest.approx([96, 72, 48, 24], abs=0.1)
    assert axes[0].get_xlim() == (9, -9)


def test_the_view_of_a_warp_is_marked_every_ten_metres():
    image_to_road = road_homography(LENS, height_m=1.3, pitch_rad=0.0)
    rectangle_m = [(42, 2), (42, -2), (7, -2), (7, 2)]
    warp = FourPointWarp(
        source_px=road_to_pixels(rectangle_m, image_to_road),
        destination_px=[
            (200, 0),
            (1080, 0),
            (1080, 720),
            (200, 720),
        ],
        size=(1280, 720),
    )
    axes_m = plots.road_axes(warp, image_to_road)
    x_m = 42 - np.arange(720) * 35 / 720
    y_m = 2 - (np.arange(1280) - 200) * 4 / 880
    np.testing.assert_allclose(axes_m.x_m, x_m, atol=1e-3)
    np.testing.assert_allclose(axes_m.y_m, y_m, atol=1e-3)

    view = np.zeros((720, 1280), np.uint8)
    _, (axis,) = plots.show_birdseye([view], ["view"], axes_m)
    labels = [label.get_text() for label in axis.get_yticklabels()]
    assert labels == ["10 m", "20 m", "30 m", "40 m"]
    expected_rows = 720 * (42 - np.array([10, 20, 30, 40])) / 35
    assert axis.get_yticks() == pytest.approx(expected_rows, abs=1)


@pytest.mark.parametrize(
    ("mask", "limits"),
    [
        (np.eye(9) > 0, (0, 1)),
        (np.zeros((9, 9), np.uint8), (0, 1)),
        (np.eye(9, dtype=np.uint8) * 100, (0, 255)),
    ],
)
def test_masks_are_gray_with_fixed_limits(mask, limits):
    """An empty mask must come out black, and a dim gray picture dim."""
    _, axes = plots.show_pictures([mask], ["mask"])
    shown = axes[0].images[0]
    assert shown.get_clim() == limits
    assert shown.cmap.name == "gray"


@pytest.mark.parametrize(
    ("images", "titles", "counts"),
    [
        ([], [], "got 0 images and 0 titles"),
        ([PHOTO], ["a", "b"], "got 1 images and 2 titles"),
    ],
)
def test_each_picture_needs_one_title(images, titles, counts):
    with pytest.raises(ValueError, match=counts):
        plots.show_pictures(images, titles)


def test_guides_are_vertical_lines_in_every_picture():
    _, axes = plots.show_pictures([PHOTO, PHOTO], ["a", "b"], guides_px=(20, 60))
    for axis in axes:
        columns = [line.get_xdata()[0] for line in axis.lines]
        assert columns == [20, 60]


ROWS = np.arange(440, 720, 10)
LEFT_COLUMN = 300
RIGHT_COLUMN = 900


@pytest.fixture
def dataset(tmp_path):
    """Two images; truth of vertical lines in the first one."""
    (tmp_path / "camera_cal").mkdir()
    images = tmp_path / "test_images"
    images.mkdir()
    for name in ("test1.jpg", "test2.jpg"):
        write_image(images / name, np.full((720, 1280, 3), 90, np.uint8))
    columns = [[LEFT_COLUMN] * len(ROWS), [RIGHT_COLUMN] * len(ROWS)]
    frame = {
        "raw_file": "test_images/test1.jpg",
        "h_samples": ROWS.tolist(),
        "lanes": columns,
    }
    (images / "truth.json").write_text(json.dumps({"frames": [frame]}))
    return open_dataset(tmp_path)


def vertical_line(column):
    rows = np.arange(400.0, 720.0)
    return np.column_stack([np.full(len(rows), column), rows])


def test_progress_says_how_far_the_lines_are_off(dataset):
    left_px = vertical_line(LEFT_COLUMN + 4)
    right_px = vertical_line(RIGHT_COLUMN - 8)
    lines_px = [left_px, right_px]
    found = {"test1": lines_px, "test2": lines_px}
    _, axes = plots.show_progress(found, dataset)
    titles = [axis.get_title() for axis in axes]
    assert titles == ["test1: 6 px off", "test2"]  # no truth of test2
    shown = axes[0].images[0].get_array()
    assert (shown != 90).any()


def test_progress_without_a_lane_says_so(dataset):
    _, (axis,) = plots.show_progress({"test1": None}, dataset)
    assert axis.get_title() == "test1: no lane"


def test_progress_with_a_lens_compares_undistorted_points(dataset):
    true_px = vertical_line(LEFT_COLUMN)
    other_px = vertical_line(RIGHT_COLUMN)
    flat = [
        undistort_points(true_px, LENS),
        undistort_points(other_px, LENS),
    ]
    _, (with_lens,) = plots.show_progress({"test1": flat}, dataset, LENS)
    _, (without,) = plots.show_progress({"test1": flat}, dataset)
    assert with_lens.get_title() == "test1: 0 px off"
    assert without.get_title() != "test1: 0 px off"


def test_directions_are_curves_through_the_lens():
    image = np.zeros((720, 1280, 3), np.uint8)
    drawn = plots.draw_directions(image, LENS)
    assert not image.any()
    ten_degrees = np.tan(np.radians(10))
    on_axis = [[640 + 1150 * ten_degrees, 360]]
    ((column, row),) = distort_points(on_axis, LENS).round().astype(int)
    assert drawn[row - 20, column].any()
    assert not drawn[row - 20, column + 30].any()


def test_series_has_units_gaps_and_truth():
    times_s = np.arange(5) / 25
    values = np.array([0.1, 0.2, np.nan, 0.4, 0.5])
    series = {
        "offset (m)": {"measured": values, "truth": values + 0.01},
        "curvature (1/m)": {"measured": values},
    }
    _, (upper, lower) = plots.plot_series(times_s, series, title="Drive")
    assert upper.get_ylabel() == "offset (m)"
    assert lower.get_ylabel() == "curvature (1/m)"
    assert lower.get_xlabel() == "time (s)"
    np.testing.assert_array_equal(upper.lines[0].get_ydata(), values)
    assert [line.get_linestyle() for line in upper.lines] == ["-", "--"]
    assert lower.get_legend() is None


def test_a_series_without_a_quantity_is_refused():
    with pytest.raises(ValueError, match="no quantity"):
        plots.plot_series(np.arange(3), {})


def test_a_curve_named_in_dots_is_dots_without_a_line():
    values = np.array([1.0, 2.0, 3.0])
    series = {"column": {"single": values, "mean": values}}
    _, (axis,) = plots.plot_series(
        np.arange(3), series, dots=["single"], x_label="frame"
    )
    dots, line = axis.lines
    assert dots.get_linestyle() == "None"
    assert dots.get_marker() == "o"
    assert line.get_linestyle() == "-"
    assert line.get_marker() == "None"
    assert axis.get_xlabel() == "frame"


def test_a_table_has_the_names_and_the_rounded_numbers():
    rows = {
        "A": {"warp": 1.26, "fit": 20.0},
        "B": {"warp": 3.0, "fit": 0.04},
    }
    _, axis = plots.show_table(rows, title="Milliseconds")
    (table,) = axis.tables
    texts = {}
    for place, cell in table.get_celld().items():
        texts[place] = cell.get_text().get_text()
    assert axis.get_title() == "Milliseconds"
    names = -1  # column of the names of rows
    assert texts[0, 0] == "warp"
    assert texts[0, 1] == "fit"
    assert texts[1, names] == "A"
    assert texts[1, 0] == "1.3"
    assert texts[1, 1] == "20.0"
    assert texts[2, names] == "B"
    assert texts[2, 0] == "3.0"
    assert texts[2, 1] == "0.0"


@pytest.mark.parametrize("name", SKETCHES)
def test_sketch_texts_are_whole_and_apart(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure, axes = sketch(name)
        figure.canvas.draw()
    assert figure.bbox.width == 960

    margin_px = 3
    low = figure.bbox.min + margin_px
    high = figure.bbox.max - margin_px
    boxes = {}
    for axis in axes:
        for text in axis.texts:
            if text.get_text():
                boxes[text] = text.get_window_extent()
    for text, box in boxes.items():
        assert (box.min >= low).all(), text
        assert (box.max <= high).all(), text
    for one, other in combinations(boxes, 2):
        assert not boxes[one].overlaps(boxes[other]), (one, other)
