"""The tools: ablation, fit of the confidence, samples for the network, sizes."""

from __future__ import annotations

import json
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from benchmark.errors import LaneTruth
from benchmark.evaluation import drive_from_video, prepare_drive
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.markings import finer_view
from lanes.tracking.tracker import TrackerSettings
from simulator.road.truth import truth_row
from tests.support.painted_drive import BENDS
from tests.support.painted_roads import Road, dashcam
from tests.support.project import ROOT
from tools import fit_confidence
from tools.ablation import ALL_ON, MECHANISMS, measure, with_value
from tools.course_hours import (
    MINUTES_A_CELL,
    MINUTES_A_CODE_LINE,
    MINUTES_A_QUESTION,
    MINUTES_AN_EXERCISE,
    WORDS_A_MINUTE,
    Chapter,
    hours_table,
    measure_chapters,
)
from tools.fit_confidence import (
    PAINTED,
    Sample,
    Table,
    fit_logistic,
    fit_shift,
    label_lanes,
    left_out,
    logistic,
)
from tools.marking_samples import UNKNOWN, connect_paint, label_cells, take_sample
from tools.sizes import (
    CodeLine,
    Density,
    code_lines,
    count_words,
    describe_sizes,
    measure_densities,
)


@pytest.fixture(scope="module")
def measurements():
    """Without any change, and without rate steps, in a hairpin."""
    drive = prepare_drive(
        drive_from_video(ROOT / "test_videos" / "harder_challenge_video.mp4")
    )
    (rate_steps,) = (
        mechanism for mechanism in MECHANISMS if mechanism.name == "rate steps"
    )
    return [
        measure((mechanism, drive), end_s=0.4)
        for mechanism in (ALL_ON, ALL_ON, rate_steps)
    ]


def test_a_strong_mechanism_changes_the_result_and_nothing_else_does(measurements):
    on, again, off = (one.lateral_m for one in measurements)
    np.testing.assert_array_equal(on, again)
    assert not np.array_equal(on, off, equal_nan=True)


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda mechanism: mechanism.name)
def test_each_mechanism_changes_exactly_its_settings(mechanism):
    settings = mechanism.settings()
    default = TrackerSettings()
    assert settings != default
    for path in mechanism.off:
        settings = with_value(settings, path.split("."), attrgetter(path)(default))
    assert settings == default


def test_the_confidence_is_fitted_and_each_drive_says_nothing_of_itself():
    """Each of ten drives has a feature of its own that tells all: only to those who
    have seen the drive.
    """
    rng = np.random.default_rng(3)
    features = np.column_stack([np.ones(4000), rng.normal(0, 2, 4000)])
    right = rng.random(4000) < logistic(features @ [1.0, -2.0])
    np.testing.assert_allclose(
        fit_logistic(features, right, np.ones(4000)), [1.0, -2.0], atol=0.2
    )
    assert fit_logistic(features, right, np.ones(4000), {1: -4.0})[1] == pytest.approx(
        -4.0
    )
    drive = np.repeat(np.arange(10), 200)
    features = np.column_stack([np.ones(2000), drive[:, None] == np.arange(10)])
    table = Table(
        features, drive % 2 == 0, np.ones(2000), np.full(2000, PAINTED), drive
    )
    assert np.abs(left_out(table) - 0.5).max() < 0.2


def test_long_drives_count_no_more_than_short_ones():
    samples = [Sample(PAINTED, "long", {"constant": 1.0}, True)] * 1000
    samples += [Sample(PAINTED, "short", {"constant": 1.0}, False)] * 24
    table = Table.of(samples)
    assert fit_logistic(table.features, table.right, table.weight)[0] == pytest.approx(
        0.0, abs=1e-6
    )


def test_the_constant_of_a_network_corrects_the_mean_confidence_if_any_lane_is_right(
    monkeypatch,
):
    log_odds = np.linspace(-4, 4, 4001)
    chance = np.random.default_rng(0).random(4001)
    weight = 1 + (log_odds > 0)
    assert fit_shift(
        log_odds, chance < logistic(log_odds - 1.5), weight
    ) == pytest.approx(-1.5, abs=0.1)
    monkeypatch.setattr("sys.argv", ["fit_confidence", "--markings", "model.onnx"])
    monkeypatch.setattr("tools.fit_confidence.load_markings", lambda path: path)
    monkeypatch.setattr(
        "tools.fit_confidence.samples_of_painted_roads", lambda markings: []
    )
    with pytest.raises(
        SystemExit, match=r"model\.onnx: no lane found with this network is right"
    ):
        fit_confidence.main()


def test_lanes_are_judged_by_their_own_truth():
    rows = [truth_row(BENDS.truth(i / 12.5), frame=i) for i in range(5)]
    truth = LaneTruth.from_columns(
        {name: np.array([row[name] for row in rows], float) for name in rows[0]}
    )
    frames = [BENDS.frame(i / 12.5) for i in range(5)]
    followed, alone = label_lanes(frames, BENDS.camera, truth, group="bends")
    assert [len(followed), len(alone)] == [5, 2]
    assert all(one.right for one in followed + alone)
    aside = replace(truth, lines_y_m=truth.lines_y_m + 0.3)
    assert not any(
        one.right
        for some in label_lanes(frames, BENDS.camera, aside, group="")
        for one in some
    )


CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# Both lines of a lane.
LEFT_M = 1.8
RIGHT_M = -1.7


def test_cells_are_labelled_where_pictures_with_and_without_lines_differ():
    """Cells with paint are 1 within the width of the line, and 0 elsewhere; noise in
    both pictures is no paint.
    """
    fine = finer_view(VIEW)
    road = Road(CAMERA, noise=6.0)
    bare = road.image()
    for lateral_m in (LEFT_M, RIGHT_M):
        road.line(lambda x, y=lateral_m: y + 0 * x)
    label = label_cells(fine.warp(road.image()), fine.warp(bare))
    assert label.shape == VIEW.shape
    rows = VIEW.x_m < 20
    beside_m = np.minimum(np.abs(VIEW.y_m - LEFT_M), np.abs(VIEW.y_m - RIGHT_M))
    seen = VIEW.seen[rows]
    assert np.all(label[rows][:, beside_m < 0.03][seen[:, beside_m < 0.03]] == 1)
    assert np.all(label[rows][:, beside_m > 0.4][seen[:, beside_m > 0.4]] == 0)


@pytest.mark.slow
def test_samples_are_the_same_in_each_run_and_have_the_edges_of_their_road():
    first, again = (take_sample(14) for _ in range(2))
    np.testing.assert_array_equal(first.fine_image, again.fine_image)
    np.testing.assert_array_equal(first.label, again.label)
    assert len(first.label) == 2
    assert set(np.unique(first.label)) == {0, 1, UNKNOWN}
    assert 0.003 < (first.label == 1).mean() < 0.1
    assert (first.label[1] == 1).any()
    without_road = take_sample(20).label
    assert set(np.unique(without_road)) <= {0, UNKNOWN}
    assert 0 in without_road


def test_worn_and_hidden_paint_is_connected_to_visible_paint_of_its_line():
    """Cells of the line near visible paint are paint; those far from any are left open,
    as is a blurred colour.
    """
    visible = np.zeros((60, 30), np.uint8)
    lines = np.zeros((60, 30), bool)
    lines[5:50, 14:17] = True
    visible[[6, 12], 15] = 1
    visible[8, 22] = 1
    connected = connect_paint(visible, lines)
    assert np.all(connected[5:23, 14:17] == 1)
    assert np.all(connected[23:50, 14:17] == UNKNOWN)
    assert connected[8, 22] == UNKNOWN
    assert not connected[:, :13].any()
    assert not connected[50:].any()


SOURCE = '''"""Module."""

import os  # a comment


class A:
    """Docstring
    of two lines."""

    text = f"{os.name} and {1 + 2}"
'''


def test_tokens_of_code_are_counted_without_docstrings_and_comments():
    """2 of the import, 3 of the class, 3 of the assignment: a text with fields is one
    token in every Python.
    """
    assert [line.tokens for line in code_lines(SOURCE)] == [2, 3, 3]


def test_wide_lines_and_the_line_that_nine_of_ten_do_not_exceed():
    narrow = CodeLine(tokens=2, columns=88)
    wide = CodeLine(tokens=12, columns=89)
    density = Density.of([narrow] * 9 + [wide])
    assert density == Density(
        lines=10, tokens=30, mean=3.0, nine_of_ten=12, wide_share=0.1
    )
    assert Density.of([narrow] * 10 + [wide]).nine_of_ten == 2


def test_packages_and_the_cells_of_the_notebook_are_counted():
    cells = [
        {"cell_type": "markdown", "source": ["two ", "words"]},
        {"cell_type": "code", "source": "%magic\na = b"},
    ]
    files = {
        "lanes/a.py": "a = 1\n",
        "lanes/b/c.py": "b\n",
        "tools/t.py": "import os\n",
        "setup.py": "c\n",
        "docs/a.md": "# One\ntwo three",
        "project.ipynb": json.dumps({"cells": cells}),
    }
    densities = measure_densities(files, ["lanes", "tools"])
    tokens = {name: density.tokens for name, density in densities.items()}
    assert tokens == {"lanes": 4, "tools": 2, "project.ipynb": 3, "everything": 7}
    assert count_words(files) == {
        "files of lanes": 2,
        "words of pages": 4,
        "words of project.ipynb": 2,
    }


def test_what_is_above_its_ceiling_is_named():
    densities = {
        "lanes": Density.of([CodeLine(7, 20)]),
        "tools": Density.of([CodeLine(7, 20)]),
    }
    table, above = describe_sizes(
        densities, {"words of pages": 5}, {"lanes": 6, "tools": 7, "words of pages": 4}
    )
    assert above == ["lanes", "words of pages"]
    assert [row.endswith("ABOVE") for row in table[1:]] == [True, False, True]


def test_the_hours_of_a_chapter_count_what_there_is_to_do():
    text = "## 3. Warp\n\n" + "word " * 117 + "**Question.** Why?"
    cells = [
        {"id": "ch03-01", "cell_type": "markdown", "source": [text]},
        {"id": "ch03-02", "cell_type": "code", "source": ["a = 1\n", "\n", "b = 2"]},
        {
            "id": "ch03-03",
            "cell_type": "code",
            "source": 'course.check_exercise("3.1", a)',
        },
    ]
    (chapter,) = measure_chapters({"cells": cells})
    assert chapter == Chapter(
        "3. Warp", words=122, code_cells=2, code_lines=3, questions=1, exercises=1
    )
    minutes = (
        122 / WORDS_A_MINUTE
        + 3 * MINUTES_A_CODE_LINE
        + 2 * MINUTES_A_CELL
        + MINUTES_A_QUESTION
    )
    assert 60 * chapter.hours == pytest.approx(minutes + MINUTES_AN_EXERCISE)
    assert (
        hours_table([chapter, chapter]).splitlines()[-1]
        == f"| **all** | 244 | 4 | 6 | 2 | 2 | {2 * chapter.hours:.1f} |"
    )
