"""Explanations: the lane equals that of `find_lane`; each failure has a step, a reason
and advice; the figure.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType

import matplotlib.pyplot as plt
import numpy as np
import pytest

from lanes.camera.model import Camera
from lanes.detect.fit import FitSettings
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.road import RoadPrior
from lanes.detect.search import (
    DetectorSettings,
    StillDetection,
    VoteSettings,
    detect_still,
    find_lane,
)
from lanes.show.explanation import (
    OTHER_PICTURES,
    RE_ESTIMATE_POSE,
    Explanation,
    explain,
    explain_tracked,
)
from lanes.show.figures import show_explanation
from lanes.tracking.tracker import LaneTracker
from lanes.video.reader import TimedFrame
from tests.support.painted_drive import BENDS, SMALL, PaintedDrive
from tests.support.painted_roads import YELLOW, Arc, Road, dashcam
from tests.support.shapes import straight_car

CAMERA = dashcam(width=1280)
AHEAD = dashcam(1280, yaw_rad=0.0)
ASIDE = dashcam(1280, yaw_rad=-0.1)
LOWERED = dashcam(1280, pitch_rad=0.045)
BEND = 1 / 350
OFFSET_M = -0.4
WORN = (115, 115, 115)
STEPS = ["picture", "pose", "birdseye", "markings", "stripes", "votes", "fit", "lane"]


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


def lane_road(camera: Camera = CAMERA, width_m: float = 3.6) -> Road:
    """A yellow solid and a white broken line; the car is 0.4 m right of the centre, the
    road bends left.
    """

    def left(x: np.ndarray) -> np.ndarray:
        return width_m / 2 - OFFSET_M + BEND * x**2 / 2

    def right(x: np.ndarray) -> np.ndarray:
        return left(x) - width_m

    road = Road(camera)
    road.line(left, colour=YELLOW)
    return road.line(right, dash_m=(3.0, 9.0))


@pytest.fixture(scope="module")
def good() -> Explanation:
    return explain(lane_road().image(), CAMERA)


def grey(level: float, noise: float = 2.0) -> np.ndarray:
    shape = (CAMERA.height, CAMERA.width, 3)
    values = np.random.default_rng(0).normal(level, noise, shape)
    return values.clip(0, 255).astype(np.uint8)


class TestGoodImage:
    def test_the_lane_is_that_of_find_lane(self, good):
        lane = find_lane(good.image, CAMERA)
        assert good.lane.offset_m == lane.offset_m
        assert lane.offset_m == pytest.approx(OFFSET_M, abs=0.03)

    def test_all_steps_are_listed_and_none_failed(self, good):
        assert [step.name for step in good.steps] == STEPS
        assert good.failed is None
        assert "failed" not in good.describe()
        assert repr(good).endswith("all steps passed)")

    def test_the_best_candidate_is_chosen(self, good):
        best, *others = [candidate.chosen for candidate in good.candidates]
        assert best
        assert not any(others)

    def test_the_log_odds_are_those_of_the_confidence(self, good):
        odds = float(re.search(r"%, log odds (\S+) =", good.describe())[1])
        confidence = 1 / (1 + np.exp(-odds))
        assert confidence == pytest.approx(good.lane.confidence, abs=0.003)

    @pytest.mark.parametrize(
        "words",
        [
            r"\noffset     0\.(39|4)",
            "bend       bends left, R 3",
            r"votes +\d+ lanes proposed, best: 3\.\d m wide",
            r"fit +score 1\.\d\d, paint on [89]\d% left, 2\d% right\n",
        ],
    )
    def test_the_text_has_the_numbers(self, good, words):
        assert re.search(words, good.describe())

    def test_no_term_is_a_negative_zero(self, good):
        assert "-0.00" not in good.describe()


def with_lane(explanation: Explanation, **changes: object) -> Explanation:
    """The explanation of a lane with other values."""
    lane = replace(explanation.lane, **changes)
    return replace(explanation, detection=replace(explanation.detection, lane=lane))


NEAR = (LineEvidence(0.9, True, 5.0), LineEvidence(0.9, True, 6.0))
UNSURE = MappingProxyType(
    {"fit_covariance": np.diag([0.25, 1.0, *[0.0] * 13]), "evidence": NEAR}
)


class TestWeakestEvidence:
    def test_is_named_for_a_likely_lane(self, good):
        """Here the dashes of the right line."""
        left, right = (min(line.support, 1) for line in good.lane.lines)
        paint = f"paint on {left:.0%} of the left and {right:.0%} of the right line."
        assert f"weakest    there is {paint}" in good.describe()

    def test_is_a_line_that_is_not_seen(self, good):
        one = with_lane(good, evidence=(good.lane.evidence[0], LineEvidence()))
        words = "the right line is not seen; its position follows from the other line"
        assert f"weakest    {words}" in one.describe()

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                {"clear_share": 0.3},
                "other lines run between those of the lane: 30% of the stripes",
            ),
            (
                {"single_image_pose": True, "same_lane_share": 0.2},
                "only 20% of the camera poses",
            ),
            (
                {"car": straight_car(0.1)},
                "the camera seems to look 5.7 deg farther to the right than its pose "
                "says.",
            ),
            (
                {"car": straight_car(-0.1)},
                "the camera seems to look 5.7 deg farther to the left than its pose "
                "says.",
            ),
            (
                UNSURE,
                "the worse line has a standard deviation of 0.6 m at 20 m ahead: the "
                "paint found ends after 5 m (left",
            ),
        ],
        ids=["clutter", "other lanes", "yaw right", "yaw left", "uncertain"],
    )
    def test_can_be_each_feature_of_the_confidence(self, good, change, words):
        changed = with_lane(good, **change)
        assert f"weakest    {words}" in changed.describe()

    def test_of_a_lane_that_is_not_stated_says_nothing_about_the_camera(self, good):
        changes = {"car": straight_car(0.3), "confidence_shift": -9.0}
        detection = with_lane(good, **changes).detection
        explanation = explain(good.image, CAMERA, detection=detection)
        text = explanation.describe()

        assert "camera seems" not in text
        assert "state      lost\nnot stated lines at +2." in text
        assert "offset " not in text
        assert explanation.failed.failure.endswith("Below 15% no lane is stated.")

    def test_is_the_failure_beside_a_doubtful_pose(self, good):
        detection = with_lane(good, **UNSURE).detection
        doubted = explain(
            good.image, CAMERA, detection=detection, pose_doubt="few pictures."
        ).failed
        doubt = " The camera pose is doubtful, too: few pictures."
        assert doubted.failure.endswith(doubt)
        assert doubted.advice.startswith("Use the video instead of a still")


class TestWhatWasNotTaken:
    def explained(self, *lines_m: float, dash_m=None) -> str:
        road = Road(CAMERA).lines(*lines_m, dash_m=dash_m)
        return explain(road.image(), CAMERA).describe()

    def test_a_line_beside_the_lane_has_its_reason(self):
        text = self.explained(1.8, -1.8, 3.2)
        reason = r"because the lane would be [45]\.\d m wide"
        place = r"a line at \+3\.2 m, 1\.4 m left of the left line, .*"
        assert re.search(rf"ignored    {place}, {reason}", text)

    def test_a_line_close_to_the_one_of_the_lane_is_named(self):
        """As a line in the shade of a guard rail, beside a brighter strip."""
        text = self.explained(2.5, 1.8, -1.8)
        chosen = re.search(r"left line +(\d\.\d)\d ", text)[1]
        other = (
            r"\+2\.5 m, 0\.7 m left" if chosen == "1.8" else r"\+1\.8 m, 0\.7 m right"
        )
        assert re.search(rf"ignored    a line at {other} of the left line", text)

    def test_a_double_line_is_one_line(self):
        assert "ignored" not in self.explained(2.05, 1.8, -1.8)

    def test_a_line_of_the_adjacent_lane_is_not_ignored(self):
        assert "ignored" not in self.explained(1.8, -1.8, -5.4)

    def test_a_line_in_a_hairpin_has_a_place(self):
        """The lane turns back before some of the stripes."""
        road = Road(CAMERA, arc=Arc(1 / 15)).lines(1.75, -1.75, 5.25)
        text = explain(road.image(), CAMERA).describe()
        assert "ignored    a line at" in text
        assert "nan" not in text

    def test_a_lane_with_less_paint_has_its_reason(self):
        text = self.explained(3.7, 0.1, -3.5, dash_m=(3, 9))
        reason = r"less paint near the car \(paint"
        assert re.search(rf"rejected   lines at \+3\.0 and -0\.5 m: {reason}", text)


def spots_image() -> np.ndarray:
    """A road with scattered white spots instead of lines."""
    spots = np.random.default_rng(5).uniform([6, -8], [20, 8], (6, 2))

    def in_a_spot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.any([np.hypot(x - a, y - b) < 0.12 for a, b in spots], 0)

    return Road(CAMERA).paint(in_a_spot, (225,) * 3).image()


def far_paint_image() -> np.ndarray:
    """A line that begins 35 m ahead."""
    road = Road(CAMERA, noise=4.0)
    return road.line(lambda x: np.where(x > 35, 1.8, 99)).image()


def tracks_image() -> np.ndarray:
    """A worn lane with a white line in its middle."""
    return Road(CAMERA).lines(0).lines(1.8, -1.8, colour=WORN).image()


@dataclass(frozen=True)
class Failure:
    """What makes the image, the step that fails there, and words of the reason."""

    make: Callable[[], np.ndarray]
    step: str
    reason: str
    camera: Camera = CAMERA


FAILURES = {
    "black": Failure(lambda: grey(17, 1.0), "birdseye", "almost black"),
    "glare": Failure(lambda: grey(243, 1.0), "birdseye", "glaring white"),
    "fog": Failure(lambda: grey(128, 0.6), "birdseye", "no contrast"),
    "sky": Failure(
        lambda: grey(100),
        "birdseye",
        "sees no road",
        dashcam(width=1280, pitch_rad=-0.9),
    ),
    "no lines": Failure(
        lambda: grey(100, 6.0), "markings", "no paint is found with a probability"
    ),
    "far paint": Failure(far_paint_image, "stripes", r"nearer than \d\d m"),
    "spots": Failure(spots_image, "fit", "do not line up"),
    "one line": Failure(
        lambda: Road(CAMERA).lines(1.8).image(), "lane", "right line is not seen"
    ),
    "pitch motion": Failure(
        lambda: lane_road(LOWERED).image(), "lane", r"look [23]\.\d deg farther down"
    ),
    "wrong yaw": Failure(
        lambda: lane_road(ASIDE).image(),
        "lane",
        r"points [56]\.\d deg away from the car's direction",
        AHEAD,
    ),
    "tracks": Failure(tracks_image, "lane", "other lines run between"),
    "narrow": Failure(
        lambda: lane_road(width_m=2.6).image(),
        "lane",
        r"width of 2\.6 m is implausible",
    ),
}


@lru_cache
def explain_failure(name: str) -> Explanation:
    failure = FAILURES[name]
    return explain(failure.make(), failure.camera)


class TestFailures:
    @pytest.mark.parametrize("name", FAILURES)
    def test_each_has_step_reason_and_advice(self, name):
        explanation = explain_failure(name)
        assert explanation.failed.name == FAILURES[name].step
        assert re.search(FAILURES[name].reason, explanation.failed.failure)
        assert explanation.failed.advice.endswith(".")
        assert f"failed at  {FAILURES[name].step}: " in explanation.describe()

    @pytest.mark.parametrize("name", FAILURES)
    def test_the_failed_step_is_the_last_one(self, name):
        last = STEPS.index(FAILURES[name].step)
        steps = [step.name for step in explain_failure(name).steps]
        assert steps == STEPS[: last + 1]

    @pytest.mark.parametrize("name", ["no lines", "sky", "one line"])
    def test_a_given_pose_is_to_be_estimated(self, name):
        assert explain_failure(name).failed.advice.endswith(RE_ESTIMATE_POSE)

    @pytest.mark.parametrize("name", ["no lines", "sky", "one line"])
    def test_a_pose_from_the_same_files_is_not_to_be_estimated_again(self, name):
        given = explain_failure(name)
        explanation = explain(
            given.image, given.camera, detection=given.detection, pose_doubt=""
        )
        assert explanation.failed.advice.endswith(OTHER_PICTURES)

    @pytest.mark.parametrize("name", ["sky", "spots"])
    def test_the_failed_panel_of_the_figure_is_red(self, name):
        _, axes = show_explanation(explain_failure(name))
        red = [axis for axis in axes if axis.title.get_color() == "firebrick"]
        assert red == [axes[STEPS.index(FAILURES[name].step)]]

    @pytest.mark.parametrize("name", ["sky", "spots"])
    def test_the_figure_says_failure_and_advice(self, name):
        explanation = explain_failure(name)
        figure, axes = show_explanation(explanation)
        figure.canvas.draw()
        said = " ".join(axes[8].texts[0].get_text().split())
        assert explanation.failed.failure in said
        assert explanation.failed.advice in said


class TestDoubtfulPose:
    DOUBT = "no parallel lines were seen."

    def test_is_the_failed_step_where_no_lane_is_found(self):
        blank = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
        explanation = explain(blank, CAMERA, pose_doubt=self.DOUBT)
        assert explanation.failed.name == "pose"
        assert explanation.failed.failure == self.DOUBT
        assert "--hfov" in explanation.failed.advice
        show_explanation(explanation)

    def test_does_not_matter_where_a_lane_is_found(self):
        explanation = explain(lane_road().image(), CAMERA, pose_doubt=self.DOUBT)
        assert explanation.failed is None


class TestSettings:
    """Limits in the text and the figure are those that the lane was detected with."""

    def explained(self, image: np.ndarray, settings: DetectorSettings) -> Explanation:
        detection = detect_still(image, CAMERA, settings)
        return explain(image, CAMERA, detection=detection)

    def test_the_search_starts_where_the_fit_does(self):
        settings = DetectorSettings(fit=FitSettings(start=((16, 6), (18, 4))))
        explanation = self.explained(far_paint_image(), settings)
        assert "nearer than 18 m" in explanation.failed.failure

    def test_least_paint_of_a_lane(self):
        settings = DetectorSettings(fit=FitSettings(min_support=0.5))
        explanation = self.explained(spots_image(), settings)
        assert "paint on less than 50% of the rows" in explanation.failed.failure

    def test_pitch_motion_that_is_usual(self):
        prior = RoadPrior(pitch_rad=(0.0, 0.03, 0.06))
        settings = DetectorSettings(fit=FitSettings(prior=prior))
        explanation = self.explained(lane_road(LOWERED).image(), settings)
        assert explanation.lane.pitch_rad > 0.03
        assert "farther down" not in explanation.describe()

    def test_range_of_the_votes(self, good):
        settings = DetectorSettings(votes=VoteSettings(bins=60))
        _, axes = show_explanation(self.explained(good.image, settings))
        half_m = 30 * settings.votes.bin_m
        assert axes[5].get_xlim() == pytest.approx((half_m, -half_m))


# The lane is black from 0.8 s on.
DARK = replace(BENDS, black_s=(0.8, np.inf))


def tracked(
    drive: PaintedDrive, until_s: float, **options: float
) -> tuple[Explanation, Lane | None]:
    """The explanation of the frame at a time, and the lane of another tracker there."""
    frames = []
    for number, time_s in enumerate(np.arange(0.0, until_s + 1e-6, 0.08)):
        elapsed_s = 0.08 if number else None
        frames.append(TimedFrame(number, time_s, drive.frame(time_s), elapsed_s))
    tracker = LaneTracker(drive.camera, fps=12.5, **options)
    for frame in frames:
        lane = tracker.update(frame.image, elapsed_s=frame.elapsed_s)
    other = LaneTracker(drive.camera, fps=12.5, **options)
    return explain_tracked(frames, other), lane


@pytest.fixture(scope="module")
def seen() -> tuple[Explanation, Lane]:
    return tracked(DARK, 0.72)


class TestTrackedFrame:
    def test_the_lane_is_that_of_the_tracker(self, seen):
        explanation, lane = seen
        np.testing.assert_array_equal(explanation.lane.model, lane.model)
        assert explanation.lane.state == "tracking"
        assert explanation.lane.confidence == lane.confidence

    def test_the_prediction_takes_the_place_of_the_votes(self, seen):
        explanation, _ = seen
        steps = [step.name for step in explanation.steps]
        assert steps == [*STEPS[:5], "prediction", *STEPS[6:]]
        assert explanation.detection.search is None
        assert not explanation.candidates
        assert explanation.failed is None

    def test_the_prediction_is_near_the_lane(self, seen):
        explanation, lane = seen
        assert np.abs(explanation.prediction - lane.centres)[:2].max() < 0.1

    def test_the_text_says_since_when_the_lane_is_known(self, seen):
        explanation, _ = seen
        known = "lane known for 0.72 s and last seen 0.08 s ago"
        assert f"prediction tracking, {known}" in explanation.describe()

    def test_the_text_says_since_when_the_lane_is_tracked(self, seen):
        explanation, _ = seen
        assert re.search(r"lane since 0\.00 s$", explanation.describe(), re.MULTILINE)

    def test_a_lane_of_a_single_image_has_no_history(self, good):
        assert "since" not in good.describe()

    def test_a_low_confidence_of_one_frame_needs_no_action(self):
        explanation, _ = tracked(DARK, 0.72, confidence_shift=-9.0)
        advice = explanation.failed.advice
        assert advice == "No action is needed if the next frames are better."

    def test_a_lane_that_is_not_seen_is_predicted(self):
        explanation, _ = tracked(DARK, 1.2)
        known = "lane known for 1.20 s and last seen 0.48 s ago"
        failure = explanation.failed.failure
        assert explanation.lane.state == "coasting"
        assert f"coasting, {known}" in explanation.describe()
        assert failure.startswith("neither line is seen; the lane is predicted")

    def test_a_lost_lane_says_since_when_and_why(self):
        explanation, lane = tracked(DARK, 2.4)
        assert lane is None
        assert explanation.lane is None
        assert explanation.failed.name == "birdseye"
        lost = r"the track was lost at (1\.\d\d) s"
        unseen = r"(\d\.\d\d) s after the lane was last seen\.$"
        why = re.search(f"almost black.*{lost}, {unseen}", explanation.failed.failure)
        lost_s, unseen_s = map(float, why.groups())
        assert unseen_s == pytest.approx(lost_s - 0.72, abs=0.011)
        show_explanation(explanation)


# Lanes 3 m wide, seen by the camera after it was knocked.
KNOCKED = replace(
    BENDS,
    camera=SMALL.with_pose(replace(SMALL.require_pose(), pitch_rad=0.12)),
    lines=tuple(
        replace(line, lateral_m=line.lateral_m * 3.0 / 3.6) for line in BENDS.lines
    ),
)


def test_the_text_says_since_when_a_lane_and_its_pose_differ_from_those_before():
    frames = []
    for number, time_s in enumerate(np.arange(0.0, 4.0, 0.08)):
        drive = BENDS if time_s < 1.0 else KNOCKED
        frames.append(TimedFrame(number, time_s, drive.frame(time_s), 0.08))

    def find_pose(image: np.ndarray) -> StillDetection:
        return detect_still(image, KNOCKED.camera)

    tracker = LaneTracker(SMALL, fps=12.5, find_pose=find_pose)
    text = explain_tracked(frames, tracker).describe()

    since = re.search(
        r"lane since (\d\.\d\d) s; before that, likely lanes were (.*) m wide", text
    )
    pose = re.search(r"pose since (\d\.\d\d) s, from that picture; at first (.*)", text)
    assert 1.0 <= float(pose[1]) <= float(since[1]) < 4.0
    assert pose[2] == SMALL.require_pose().describe()
    assert float(since[2]) == pytest.approx(3.6, abs=0.1)


class TestFigureOfATrackedFrame:
    @pytest.fixture
    def axes(self, seen) -> np.ndarray:
        explanation, _ = seen
        _, axes = show_explanation(explanation)
        return axes

    def test_the_panels_are_numbered(self, axes):
        numbers = [axis.get_title().split()[0] for axis in axes]
        assert numbers == list("123456789")

    def test_the_titles_have_the_numbers_of_the_steps(self, axes, seen):
        explanation, _ = seen
        for axis, step in zip(axes[2:5], explanation.steps[2:5], strict=True):
            assert step.summary in axis.get_title()

    def test_there_are_no_votes(self, axes):
        assert axes[5].get_title() == "6 Votes: no search in this frame"

    def test_the_text_has_the_lane(self, axes):
        assert "\noffset     0.3" in axes[8].texts[0].get_text()

    def test_the_prediction_is_plotted(self, axes):
        labels = [text.get_text() for text in axes[6].get_legend().get_texts()]
        assert "predicted" in labels

    @pytest.mark.parametrize("side", [0, 1])
    def test_the_stripes_of_a_line_lie_on_it(self, axes, seen, side):
        line = seen[1].lines[side]
        _, left, right = axes[4].collections
        y_m, x_m = (left, right)[side].get_offsets().T
        near = x_m < 10.0
        np.testing.assert_allclose(y_m[near], line.y(x_m[near]), atol=0.3)

    @pytest.mark.parametrize("side", [0, 1])
    def test_the_band_of_a_line_is_two_standard_deviations(self, axes, seen, side):
        line = seen[1].lines[side]
        _, left, right = axes[6].collections
        band = (left, right)[side]
        y_m, x_m = band.get_paths()[0].vertices.T
        width_m = np.ptp(y_m[x_m == 20.0])
        assert width_m == pytest.approx(4 * line.std_m(20.0))
