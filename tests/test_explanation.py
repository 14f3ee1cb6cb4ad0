"""Explanations: the lane equals that of `find_lane`; each failure has a step, a reason
and advice; the figure.
"""

from __future__ import annotations

import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from lanes.camera.model import Camera
from lanes.detect.lane import Lane, LineEvidence
from lanes.detect.search import find_lane
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
from tests.support.painted_drive import BENDS, PaintedDrive
from tests.support.painted_roads import YELLOW, Road, dashcam

CAMERA = dashcam(width=1280)
AHEAD, ASIDE, LOWERED = (
    dashcam(1280, **pose)
    for pose in ({"yaw_rad": 0.0}, {"yaw_rad": -0.1}, {"pitch_rad": 0.045})
)
BEND = 1 / 350
OFFSET_M = -0.4
WORN = (115, 115, 115)
NEAR = (LineEvidence(0.9, True, 5.0), LineEvidence(0.9, True, 6.0))
UNSURE = {"fit_covariance": np.diag([0.25, 1.0, *[0.0] * 13]), "evidence": NEAR}
STEPS = ["picture", "pose", "birdseye", "markings", "stripes", "votes", "fit", "lane"]


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    plt.close("all")


def lane_road(camera: Camera = CAMERA, width_m: float = 3.6) -> Road:
    """A yellow solid and a white broken line; the car is 0.4 m right of the centre, the
    road bends left.
    """
    road = Road(camera)
    road.line(lambda x: width_m / 2 - OFFSET_M + BEND * x**2 / 2, colour=YELLOW)
    return road.line(
        lambda x: -width_m / 2 - OFFSET_M + BEND * x**2 / 2, dash_m=(3.0, 9.0)
    )


@pytest.fixture(scope="module")
def good() -> Explanation:
    return explain(lane_road().image(), CAMERA)


def grey(level: float, noise: float = 2.0) -> np.ndarray:
    values = np.random.default_rng(0).normal(
        level, noise, (CAMERA.height, CAMERA.width, 3)
    )
    return values.clip(0, 255).astype(np.uint8)


class TestGoodImage:
    def test_lane_equals_that_of_find_lane_and_all_steps_are_listed(self, good):
        lane = find_lane(good.image, CAMERA)
        assert good.lane.offset_m == lane.offset_m == pytest.approx(OFFSET_M, abs=0.03)
        assert [step.name for step in good.steps] == STEPS
        assert good.failed is None
        assert [c.chosen for c in good.candidates] == [True] + [False] * (
            len(good.candidates) - 1
        )

    def test_text_has_the_numbers(self, good):
        text = good.describe()
        odds = float(re.search(r"%, log odds (\S+) =", text)[1])
        assert 1 / (1 + np.exp(-odds)) == pytest.approx(good.lane.confidence, abs=0.003)
        assert re.search(r"\noffset     0\.(39|4)", text)
        assert "bend       bends left, R 3" in text
        assert re.search(r"votes +\d+ lanes proposed, best: 3\.\d m wide", text)
        assert "failed" not in text
        assert "-0.00" not in text
        assert re.search(
            r"fit +score 1\.\d\d, paint on [89]\d% left, 2\d% right\n", text
        )
        assert repr(good).endswith("all steps passed)")

    def test_the_weakest_evidence_is_named(self, good):
        """Also of a lane that is likely; here the dashes of the right line."""
        left, right = (min(line.support, 1) for line in good.lane.lines)
        words = f"weakest    there is paint on {left:.0%} of the left and {right:.0%} of the right line."
        assert words in good.describe()
        lane = replace(good.lane, evidence=(good.lane.evidence[0], LineEvidence()))
        one = replace(good, detection=replace(good.detection, lane=lane))
        assert (
            "weakest    the right line is not seen; its position follows from the other line"
            in one.describe()
        )

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (
                {"clear_share": 0.3},
                "other lines run between those of the lane: 30% of the stripes",
            ),
            ({"same_lane_share": 0.2}, "only 20% of the camera poses"),
            (
                {"camera_yaw_rad": 0.1},
                "the camera seems to look 5.7 deg farther to the right than its pose says.",
            ),
            (
                {"camera_yaw_rad": -0.1},
                "the camera seems to look 5.7 deg farther to the left than its pose says.",
            ),
            (
                UNSURE,
                "the worse line has a standard deviation of 0.6 m at 20 m ahead: the "
                "paint found ends after 5 m (left",
            ),
        ],
    )
    def test_each_feature_of_the_confidence_can_be_the_weakest(
        self, good, change, words
    ):
        detection = replace(good.detection, lane=replace(good.lane, **change))
        assert f"weakest    {words}" in replace(good, detection=detection).describe()
        if "fit_covariance" in change:
            doubted = explain(
                good.image, CAMERA, detection=detection, pose_doubt="few pictures."
            ).failed
            assert doubted.failure.endswith(
                " The camera pose is doubtful, too: few pictures."
            )
            assert doubted.advice.startswith("Use the video instead of a still")

    @pytest.mark.parametrize(
        ("lines_m", "dash_m", "words"),
        [
            (
                (1.8, -1.8, 3.2),
                None,
                r"ignored    a line at \+3\.[12] m .*, because the lane would be [45]\.\d m wide",
            ),
            ((1.8, -1.8, -5.4), None, None),
            (
                (3.7, 0.1, -3.5),
                (3, 9),
                r"rejected   lines at \+3\.0 and -0\.5 m: less paint near the car \(paint",
            ),
        ],
    )
    def test_what_was_not_taken_has_its_reason(self, lines_m, dash_m, words):
        """A line of the adjacent lane is none of them."""
        text = explain(
            Road(CAMERA).lines(*lines_m, dash_m=dash_m).image(), CAMERA
        ).describe()
        assert re.search(words, text) if words else "ignored" not in text


def spots_image() -> np.ndarray:
    """A road with scattered white spots instead of lines."""
    spots = np.random.default_rng(5).uniform([6, -8], [20, 8], (6, 2))
    road = Road(CAMERA)
    return road.paint(
        lambda x, y: np.any([np.hypot(x - a, y - b) < 0.12 for a, b in spots], 0),
        (225,) * 3,
    ).image()


# image, the step that fails, words of the reason, and the camera if it is another one
FAILURES = {
    "black": (lambda: grey(17, 1.0), "birdseye", "almost black"),
    "glare": (lambda: grey(243, 1.0), "birdseye", "glaring white"),
    "fog": (lambda: grey(128, 0.6), "birdseye", "no contrast"),
    "no lines": (
        lambda: grey(100, 6.0),
        "markings",
        "no paint is found with a probability",
    ),
    "spots": (spots_image, "fit", "do not line up"),
    "sky": (
        lambda: grey(100),
        "birdseye",
        "sees no road",
        dashcam(width=1280, pitch_rad=-0.9),
    ),
    "far paint": (
        lambda: (
            Road(CAMERA, noise=4.0).line(lambda x: np.where(x > 35, 1.8, 99)).image()
        ),
        "stripes",
        r"nearer than \d\d m",
    ),
    "one line": (
        lambda: Road(CAMERA).lines(1.8).image(),
        "lane",
        "right line is not seen",
    ),
    "pitch motion": (
        lambda: lane_road(LOWERED).image(),
        "lane",
        r"look [23]\.\d deg farther down",
    ),
    "wrong yaw": (
        lambda: lane_road(ASIDE).image(),
        "lane",
        r"points [56]\.\d deg away from the car's direction",
        AHEAD,
    ),
    "tracks": (
        lambda: Road(CAMERA).lines(0).lines(1.8, -1.8, colour=WORN).image(),
        "lane",
        "other lines run between",
    ),
    "narrow": (
        lambda: lane_road(width_m=2.6).image(),
        "lane",
        r"width of 2\.6 m is implausible",
    ),
}


class TestFailures:
    @pytest.mark.parametrize("name", FAILURES)
    def test_each_has_step_reason_and_advice(self, name):
        make, step, reason, camera = (*FAILURES[name], CAMERA)[:4]
        image = make()
        explanation = explain(image, camera)
        assert explanation.failed.name == step
        assert re.search(reason, explanation.failed.failure)
        assert explanation.failed.advice.endswith(".")
        # the failed step is the last one
        assert [s.name for s in explanation.steps] == STEPS[: STEPS.index(step) + 1]
        assert f"failed at  {step}: " in explanation.describe()
        if name in (
            "no lines",
            "sky",
            "one line",
        ):  # a pose from the same files is not to be estimated again
            estimated = explain(
                image, camera, detection=explanation.detection, pose_doubt=""
            ).failed
            assert explanation.failed.advice.endswith(RE_ESTIMATE_POSE)
            assert estimated.advice.endswith(OTHER_PICTURES)
        if name in ("sky", "spots"):
            figure, axes = show_explanation(explanation)
            figure.canvas.draw()
            red = [
                n
                for n, axis in enumerate(axes)
                if axis.title.get_color() == "firebrick"
            ]
            said = " ".join(axes[8].texts[0].get_text().split())
            assert red == [STEPS.index(step)]
            assert explanation.failed.failure in said
            assert explanation.failed.advice in said

    def test_a_doubtful_pose_is_the_failed_step_where_no_lane_is_found(self):
        doubt = {"pose_doubt": "no parallel lines were seen."}
        explanation = explain(
            np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8), CAMERA, **doubt
        )
        assert (explanation.failed.name, explanation.failed.failure) == (
            "pose",
            "no parallel lines were seen.",
        )
        assert "--hfov" in explanation.failed.advice
        show_explanation(explanation)
        assert explain(lane_road().image(), CAMERA, **doubt).failed is None


# The lane is black from 0.8 s on.
DARK = replace(BENDS, black_s=(0.8, np.inf))


def tracked(
    drive: PaintedDrive, until_s: float, **options: float
) -> tuple[Explanation, Lane | None]:
    """The explanation of the frame at a time, and the lane of another tracker there."""
    times_s = np.arange(0.0, until_s + 1e-6, 0.08)
    frames = [
        TimedFrame(n, t, drive.frame(t), 0.08 if n else None)
        for n, t in enumerate(times_s)
    ]
    tracker, other = (LaneTracker(drive.camera, fps=12.5, **options) for _ in range(2))
    lanes = [tracker.update(frame.image, elapsed_s=frame.elapsed_s) for frame in frames]
    return explain_tracked(frames, other), lanes[-1]


class TestTrackedFrame:
    def test_it_is_explained_as_it_was_tracked(self):
        explanation, lane = tracked(DARK, 0.72)
        np.testing.assert_array_equal(explanation.lane.model, lane.model)
        assert (explanation.lane.state, explanation.lane.confidence) == (
            "tracking",
            lane.confidence,
        )
        assert [step.name for step in explanation.steps] == [
            *STEPS[:5],
            "prediction",
            *STEPS[6:],
        ]
        assert re.search(
            "prediction tracking, lane known for 0.72 s and last seen 0.08 s ago",
            explanation.describe(),
        )
        assert explanation.failed is None
        assert not explanation.candidates
        assert explanation.detection.search is None
        assert np.abs(explanation.prediction - lane.centres)[:2].max() < 0.1
        advice = tracked(DARK, 0.72, confidence_shift=-9.0)[0].failed.advice
        assert advice == "No action is needed if the next frames are better."
        _, axes = show_explanation(explanation)
        titles = [axis.get_title() for axis in axes]
        assert [title.split()[0] for title in titles] == list("123456789")
        assert titles[5] == "6 Votes: no search in this frame"
        assert all(
            any(step.summary in title for title in titles)
            for step in explanation.steps[2:5]
        )
        assert "\noffset     0.3" in axes[8].texts[0].get_text()
        assert "predicted" in [
            text.get_text() for text in axes[6].get_legend().get_texts()
        ]
        for line, stripes, band in zip(
            lane.lines, axes[4].collections[1:], axes[6].collections[1:], strict=True
        ):
            y_m, x_m = stripes.get_offsets()[stripes.get_offsets()[:, 1] < 10.0].T
            np.testing.assert_allclose(y_m, line.y(x_m), atol=0.3)
            y_m, x_m = band.get_paths()[0].vertices.T
            assert np.ptp(y_m[x_m == 20.0]) == pytest.approx(4 * line.std_m(20.0))

    def test_a_lane_that_is_not_seen_is_predicted(self):
        explanation, _ = tracked(DARK, 1.2)
        assert explanation.lane.state == "coasting"
        assert (
            "coasting, lane known for 1.20 s and last seen 0.48 s ago"
            in explanation.describe()
        )
        assert explanation.failed.failure.startswith(
            "neither line is seen; the lane is predicted"
        )

    def test_a_lost_lane_says_since_when_and_why(self):
        explanation, lane = tracked(DARK, 2.4)
        assert lane is explanation.lane is None
        assert explanation.failed.name == "birdseye"
        why = r"almost black.*the track was lost at (1\.\d\d) s, (\d\.\d\d) s after the lane was last seen\.$"
        lost_s, unseen_s = map(
            float, re.search(why, explanation.failed.failure).groups()
        )
        assert unseen_s == pytest.approx(lost_s - 0.72, abs=0.011)
        show_explanation(explanation)
