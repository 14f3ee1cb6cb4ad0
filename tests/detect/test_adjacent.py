"""The far lines of the adjacent lanes: where the truth has them, absent without
evidence, and no farther than it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.lane import COASTING, ROAD_EDGE, LineEvidence
from lanes.detect.road import SIDES
from lanes.detect.search import find_lane
from lanes.tracking.tracker import LaneTracker
from lanes.video.images import read_image
from simulator.rendering.drive import Motion
from simulator.road.geometry import line_lateral
from simulator.scenes.freeway import DASHCAM as COURSE_CAMERA
from simulator.scenes.stills import still_scenes
from tests.support.painted_drive import (
    CAMERA,
    WORN_YELLOW,
    PaintedDrive,
    Stripe,
    straight_road,
)
from tests.support.painted_roads import DASH_M, WHITE, YELLOW, Road, dashcam
from tests.support.project import ROOT
from tests.support.shapes import a_lane, found_lane

DASHCAM = dashcam()
STD = a_lane(width=0.03, centre=0.02, heading=1e-3, curvature=1e-5, adjacent=0.05)
WITH_FAR_LINES = found_lane(
    a_lane(), STD, score=1.4, far_evidence=(LineEvidence(0.2, True, 30.0),) * 2
)


def test_the_far_lines_of_the_stills_lie_on_their_markings():
    """0.1 m RMS, up to where they are said to be seen.

    Four stills show enough dashes to be sure of them.
    """
    sides = {"straight_lines1": -1, "straight_lines2": 1, "test2": -1, "test3": -1}
    for name, drive in still_scenes().items():
        lane = find_lane(read_image(ROOT / "test_images" / f"{name}.jpg"), drive.camera)
        painted = [
            far if far and far.kind != ROAD_EDGE else None for far in lane.adjacent
        ]
        assert [far is not None for far in painted] == [
            side == sides.get(name) for side in SIDES
        ], name
        for side, far in zip(SIDES, painted, strict=True):
            if far:
                truth = drive.truth()
                x_m = np.linspace(8.0, min(far.reach_m, 60.0), 20)
                beyond = max(side * lateral_m for lateral_m in truth.laterals_m) + 0.5
                far_m = min(
                    (
                        m.lateral_m
                        for m in drive.markings
                        if side * m.lateral_m > beyond
                    ),
                    key=abs,
                )
                error_m = far.y(x_m) - line_lateral(drive.road, truth.pose, far_m, x_m)
                assert np.sqrt(np.mean(error_m**2)) < 0.1, name
                assert far.colour in ("white", "yellow")
                assert far.support < 0.2


def country_road() -> Road:
    return Road(DASHCAM).lines(2.0, colour=YELLOW, dash_m=(3.0, 12.0)).lines(-1.5)


@pytest.mark.parametrize(
    "dash_m", [(4.0, 200.0), (1.0, 28.0)], ids=["one dash", "short dashes"]
)
def test_little_paint_is_no_line(dash_m):
    lane = find_lane(
        country_road().line(lambda x: 5.5 + 0 * x, dash_m=dash_m, phase_m=14.0).image(),
        DASHCAM,
    )
    assert lane.confidence > LIKELY_CONFIDENCE
    assert lane.adjacent == (None, None)


def test_a_far_line_ends_with_its_paint():
    road = country_road().paint(lambda x, y: (np.abs(y - 5.6) < 0.06) & (x < 28), WHITE)
    far, none = find_lane(road.image(), DASHCAM).adjacent
    assert none is None
    assert 24 < far.reach_m < 29
    np.testing.assert_allclose(far.y(np.array([10.0, 20.0, 27.0])), 5.6, atol=0.05)
    assert far.std_m(10.0) < 0.2
    assert far.kind == "solid"
    top = DASHCAM.road_to_pixels(np.array([[29.0, 5.6]]))[0, 1]
    assert far.seen_pixels(DASHCAM)[:, 1].min() > top > far.pixels(DASHCAM)[:, 1].min()


@pytest.mark.parametrize("pitch_deg", [-3.5, -1.8, 0.0])
def test_the_border_of_a_lens_does_not_end_a_far_line(pitch_deg):
    """There the image of a line that approaches from the side goes down before it
    rises.
    """
    pose = replace(COURSE_CAMERA.require_pose(), pitch_rad=np.radians(pitch_deg))
    camera = COURSE_CAMERA.with_pose(pose)
    for far in WITH_FAR_LINES.adjacent:
        pixels, (u, v) = (
            far.pixels(camera),
            camera.road_to_pixels(np.array([[20.0, far.offset_m]]))[0],
        )
        assert np.interp(-v, -pixels[:, 1], pixels[:, 0]) == pytest.approx(u, abs=1.0)


def test_an_uncertain_or_coasting_lane_states_none():
    assert None not in WITH_FAR_LINES.adjacent
    assert replace(WITH_FAR_LINES, state=COASTING).adjacent == (None, None)
    doubtful = replace(WITH_FAR_LINES, clear_share=0.01)
    assert doubtful.confidence < LIKELY_CONFIDENCE
    assert doubtful.adjacent == (None, None)


LINES_M = (5.4, 1.8, -1.8, -5.4, -9.0)
FPS = 12.5


def test_tracked_far_lines_are_those_of_the_lane_that_the_car_is_in():
    """Four lanes; the car changes to the next one on the right from 2.4 to 4.9 s, and
    from 7.6 s on all is black.
    """
    edges = {5.4: {"colour": WORN_YELLOW}, -9.0: {}}
    lines = tuple(
        Stripe(y_m, **edges.get(y_m, {"dash_m": DASH_M, "phase_m": -y_m}))
        for y_m in LINES_M
    )
    motion = Motion(speed_mps=20.0, shift_m=-3.6, shift_start_s=2.4, shift_seconds=2.5)
    drive = PaintedDrive(
        straight_road(),
        lines,
        motion,
        camera=CAMERA.scaled((640, 360)),
        black_s=(7.6, np.inf),
    )
    tracker = LaneTracker(drive.camera, fps=FPS)
    stated = []
    before = (None, None)
    for time_s in np.arange(round(8.1 * FPS)) / FPS:
        tracker.update(drive.frame(time_s))
        lane = tracker.tracked_lane
        lateral_m = motion.pose(time_s).lateral_m
        assert time_s < 7.6 or lane.state == COASTING
        for side, far in zip(SIDES, lane.adjacent, strict=True):
            stated.append((time_s, far is not None))
            if far:
                nearest = min(
                    LINES_M, key=lambda y_m: abs(y_m - lateral_m - far.offset_m)
                )
                assert far.offset_m == pytest.approx(nearest - lateral_m, abs=0.25), (
                    time_s
                )
                assert 2.5 < side * far.offset_m < 8.0, time_s
        # between two searches their ends come nearer
        for far, last in zip(lane.adjacent, before, strict=True):
            if far and last and not tracker.search:
                assert far.reach_m == pytest.approx(
                    last.reach_m - lane.motion.speed_mps / FPS, abs=0.1
                )
        before = lane.adjacent
    for begin_s, end_s in ((1.2, 2.4), (6.6, 7.6)):
        assert (
            np.mean([some for time_s, some in stated if begin_s <= time_s < end_s])
            > 0.5
        )
    assert not any(some for time_s, some in stated if time_s >= 7.6)
