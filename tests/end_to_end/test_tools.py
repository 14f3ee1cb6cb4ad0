"""The tools: ablation, fit of the confidence, samples for the network."""

from __future__ import annotations

import importlib
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from benchmark.errors import FrameErrors, LaneTruth
from benchmark.evaluation import drive_from_video, prepare_drive
from benchmark.real_roads.scored import ScoredLane
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.markings import finer_view
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.score import score_still
from lanes.tracking.tracker import TrackerSettings
from simulator.road.truth import truth_row
from tests.benchmark.test_bootstrap import result
from tests.support.painted_drive import BENDS
from tests.support.painted_roads import Road, dashcam
from tests.support.project import ROOT
from tools import fit_confidence
from tools.ablation import (
    ALL_ON,
    MECHANISMS,
    REAL_COLUMNS,
    RENDERED_COLUMNS,
    Mechanism,
    measure,
    real_cells,
    rendered_cells,
    with_value,
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
    print_calibration,
)
from tools.marking_samples import UNKNOWN, connect_paint, label_cells, take_sample

# Tools that are commands.
COMMANDS = sorted(
    file.stem
    for file in (ROOT / "tools").glob("*.py")
    if "__main__" in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_describes_itself(name, monkeypatch, capsys):
    """Also train_marking_network, without the packages that it needs."""
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit) as end:
        importlib.import_module(f"tools.{name}").main()
    assert not end.value.code
    assert capsys.readouterr().out.startswith("usage: ")


class TestAblation:
    def measure(self, mechanism: Mechanism) -> np.ndarray:
        """The lateral errors in a hairpin."""
        video = ROOT / "test_videos" / "harder_challenge_video.mp4"
        drive = prepare_drive(drive_from_video(video))
        return measure((mechanism, drive), end_s=0.4).lateral_m

    def test_a_measurement_is_the_same_again(self):
        again = self.measure(ALL_ON)
        np.testing.assert_array_equal(self.measure(ALL_ON), again)

    def test_a_strong_mechanism_changes_the_result(self):
        (rate_steps,) = (one for one in MECHANISMS if one.name == "rate steps")
        on, off = self.measure(ALL_ON), self.measure(rate_steps)
        assert not np.array_equal(on, off, equal_nan=True)

    @pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda one: one.name)
    def test_each_mechanism_changes_its_settings(self, mechanism):
        assert mechanism.settings() != TrackerSettings()

    @pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda one: one.name)
    def test_each_mechanism_changes_no_other_setting(self, mechanism):
        default = TrackerSettings()
        settings = mechanism.settings()
        for path in mechanism.off:
            usual = attrgetter(path)(default)
            settings = with_value(settings, path.split("."), usual)
        assert settings == default


def still(share: float) -> ScoredLane:
    """A still with this share of right points; from 0.85 on the image is right."""
    rows = np.arange(400.0, 600.0, 10.0)
    columns = np.array([np.full(20, 300.0), np.full(20, 900.0)])
    label = LaneColumns("a", rows, columns, EGO_SIDES)
    wrong = np.arange(20) >= 20 * share
    found = LaneColumns("a", rows, columns + 200 * wrong, EGO_SIDES)
    return ScoredLane(score_still(label, found))


def test_cells_of_real_roads_are_without_minus_with_the_mechanism():
    """Two stills in the first way, one in the second, none in the last."""
    on = [[still(1.0), still(1.0)], [still(0.5)], []]
    off = [[still(1.0), still(0.5)], [still(0.9)], []]
    cells = real_cells(off, on)
    assert dict(zip(REAL_COLUMNS[::2], cells[::2], strict=True)) == {
        "own, points": "-25.0",
        "set, points": "+40.0",
        "clips, points": "+nan",
    }
    assert cells[1::2] == ["1 of 2", "1 of 1", "0 of 0"]


def rendered(correct: int) -> FrameErrors:
    """A drive of 25 frames, the first ones correct."""
    return result(np.arange(25) < correct).errors


def test_cells_of_rendered_drives_are_without_minus_with_the_mechanism():
    """Two drives, of which one loses 10 of 25 frames: 20 points of all."""
    cells = rendered_cells(
        [with_nees(rendered(15)), with_nees(rendered(25))],
        [with_nees(rendered(25)), with_nees(rendered(25))],
    )
    assert dict(zip(RENDERED_COLUMNS, cells, strict=True)) == {
        "rendered": "80.0%",
        "off minus on": "-20.0 (-40.0 to +0.0)",
        "95 % error": "1.000 m",
        "NEES / 4": "1.50",
    }


def with_nees(errors: FrameErrors) -> FrameErrors:
    """The errors with a NEES / 4 of 1.5 in the frames of the own lane."""
    frames = len(errors.exists)
    return replace(
        errors,
        nees=np.full(frames, 1.5),
        lane_change=np.zeros(frames, bool),
        z=np.zeros((frames, 4)),
        lines_z=np.zeros((frames, 2, 5)),
    )


class TestFitLogistic:
    @pytest.fixture
    def drawn(self) -> tuple[np.ndarray, np.ndarray]:
        """Features and right lanes, drawn with the weights 1 and -2."""
        rng = np.random.default_rng(3)
        features = np.column_stack([np.ones(4000), rng.normal(0, 2, 4000)])
        return features, rng.random(4000) < logistic(features @ [1.0, -2.0])

    def test_the_weights_are_found(self, drawn):
        features, right = drawn
        weights = fit_logistic(features, right, np.ones(4000))
        np.testing.assert_allclose(weights, [1.0, -2.0], atol=0.2)

    def test_a_fixed_weight_stays(self, drawn):
        features, right = drawn
        _, weight = fit_logistic(features, right, np.ones(4000), {1: -4.0})
        assert weight == pytest.approx(-4.0)


def test_each_drive_says_nothing_of_itself():
    """Each of ten drives has a feature of its own that tells all: only to those who
    have seen the drive.
    """
    drive = np.repeat(np.arange(10), 200)
    own_feature = drive[:, None] == np.arange(10)
    table = Table(
        features=np.column_stack([np.ones(2000), own_feature]),
        right=drive % 2 == 0,
        weight=np.ones(2000),
        source=np.full(2000, PAINTED),
        group=drive,
    )
    assert np.abs(left_out(table) - 0.5).max() < 0.2


def test_long_drives_count_no_more_than_short_ones():
    samples = [Sample(PAINTED, "long", {"constant": 1.0}, True)] * 1000
    samples += [Sample(PAINTED, "short", {"constant": 1.0}, False)] * 24
    table = Table.of(samples)
    [constant] = fit_logistic(table.features, table.right, table.weight)
    assert constant == pytest.approx(0.0, abs=1e-6)


def test_the_calibration_is_as_counted_by_hand(capsys):
    """Two lanes of one drive, the first in the bins of 0.9 to 0.97 and to 1."""
    confidence = np.array([0.95, 0.2])
    print_calibration("real", confidence, np.array([True, False]), np.array([1, 1]))
    words = "1 lanes, mean 95.0%, 100.0% correct (100.0% to 100.0%)"
    assert capsys.readouterr().out.splitlines() == [
        "real: 2 lanes, 50.0% correct, log loss 0.137",
        "  confidence 0.10 to 0.30:     1 lanes, mean 20.0%, 0.0% correct "
        "(0.0% to 0.0%)",
        f"  confidence 0.90 to 0.97:     {words}",
        f"  confidence 0.90 to 1.00:     {words}",
        "  100.0% of the correct lanes have a confidence of 0.9 or more",
    ]


def test_the_constant_of_a_network_corrects_the_mean_confidence():
    log_odds = np.linspace(-4, 4, 4001)
    chance = np.random.default_rng(0).random(4001)
    right = chance < logistic(log_odds - 1.5)
    shift = fit_shift(log_odds, right, 1 + (log_odds > 0))
    assert shift == pytest.approx(-1.5, abs=0.1)


def test_a_network_without_a_right_lane_is_named(monkeypatch):
    monkeypatch.setattr("sys.argv", ["fit_confidence", "--markings", "model.onnx"])
    monkeypatch.setattr(fit_confidence, "load_markings", lambda path: path)
    monkeypatch.setattr(fit_confidence, "samples_of_painted_roads", lambda _: [])
    message = r"model\.onnx: no lane found with this network is right"
    with pytest.raises(SystemExit, match=message):
        fit_confidence.main()


class TestLabelledLanes:
    """Of five frames of BENDS: tracked, and of every fourth frame alone."""

    def label(self, shift_m: float) -> tuple[list[Sample], list[Sample]]:
        """With the true lane, shifted."""
        rows = [truth_row(BENDS.truth(frame / 12.5), frame=frame) for frame in range(5)]
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        truth = LaneTruth.from_columns(columns)
        truth = replace(truth, lines_y_m=truth.lines_y_m + shift_m)
        images = [BENDS.frame(frame / 12.5) for frame in range(5)]
        return label_lanes(images, BENDS.camera, truth, group="bends")

    def test_lanes_on_the_true_lane_are_right(self):
        tracked, alone = self.label(0.0)
        assert [one.right for one in tracked] == [True] * 5
        assert [one.right for one in alone] == [True] * 2

    def test_lanes_beside_the_true_lane_are_not(self):
        tracked, alone = self.label(0.3)
        assert not any(one.right for one in tracked + alone)


CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# Both lines of a lane.
LEFT_M = 1.8
RIGHT_M = -1.7


class TestCells:
    """Of pictures with and without lines up to 20 m; noise in both is no paint."""

    @pytest.fixture
    def label(self) -> np.ndarray:
        fine = finer_view(VIEW)
        road = Road(CAMERA, noise=6.0)
        bare = fine.warp(road.image())
        road.line(lambda x_m: np.full_like(x_m, LEFT_M))
        road.line(lambda x_m: np.full_like(x_m, RIGHT_M))
        label = label_cells(fine.warp(road.image()), bare)
        assert label.shape == VIEW.shape
        return label

    def labels_at(self, label: np.ndarray, beside: np.ndarray) -> set[int]:
        """The labels of the visible cells in some columns, (columns,) bool."""
        near = VIEW.x_m[:, None] < 20
        return set(label[near & VIEW.seen & beside].tolist())

    def distance_m(self) -> np.ndarray:
        """(columns,) distance from the nearest line."""
        left_m = np.abs(VIEW.y_m - LEFT_M)
        return np.minimum(left_m, np.abs(VIEW.y_m - RIGHT_M))

    def test_cells_of_a_line_are_paint(self, label):
        assert self.labels_at(label, self.distance_m() < 0.03) == {1}

    def test_cells_elsewhere_are_no_paint(self, label):
        assert self.labels_at(label, self.distance_m() > 0.4) == {0}


@pytest.mark.slow
class TestSamples:
    def test_a_sample_is_the_same_again(self):
        first, again = take_sample(14), take_sample(14)
        np.testing.assert_array_equal(first.fine_image, again.fine_image)
        np.testing.assert_array_equal(first.label, again.label)

    def test_a_sample_has_paint_and_the_edges_of_its_road(self):
        paint, borders = take_sample(14).label
        assert set(np.unique([paint, borders])) == {0, 1, UNKNOWN}
        assert 0.003 < np.mean([paint == 1, borders == 1]) < 0.1
        assert (borders == 1).any()

    def test_a_sample_without_a_road_has_neither(self):
        label = take_sample(20).label
        assert set(np.unique(label)) <= {0, UNKNOWN}
        assert 0 in label


class TestConnectedPaint:
    """Of a line in rows 5 to 50 that is visible in rows 6 and 12."""

    @pytest.fixture
    def connected(self) -> np.ndarray:
        visible = np.zeros((60, 30), np.uint8)
        visible[[6, 12], 15] = 1
        visible[8, 22] = 1
        lines = np.zeros((60, 30), bool)
        lines[5:50, 14:17] = True
        return connect_paint(visible, lines)

    def test_cells_of_the_line_near_visible_paint_are_paint(self, connected):
        assert set(connected[5:23, 14:17].ravel()) == {1}

    def test_cells_of_the_line_far_from_visible_paint_are_open(self, connected):
        assert set(connected[23:50, 14:17].ravel()) == {UNKNOWN}

    def test_a_blurred_colour_beside_the_line_is_open(self, connected):
        assert connected[8, 22] == UNKNOWN

    def test_other_cells_are_no_paint(self, connected):
        assert not connected[:, :13].any()
        assert not connected[50:].any()
