"""The camera pose from the road, against pictures whose pose is known exactly."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose, camera_from_dict
from lanes.errors import PictureError, PoseError
from lanes.images import read_image, write_image
from lanes.pose import estimate_pose
from tests.support.painted_roads import paint_motorway
from tests.support.project import REAL_DATA, ROOT
from tests.support.static_objects import draw_guide_lines, draw_striped_bonnet

pytestmark = pytest.mark.slow

TRUE_POSE = CameraPose(1.35, np.radians(2.5), np.radians(-1.8), np.radians(0.9))
CAMERA = Camera.from_fov((1280, 720), 62, TRUE_POSE)
# Off the lane's middle and heading both ways; the headings average to zero as they do over a drive.
OFFSETS_M = (-0.4, 0.1, 0.35, -0.2, 0.5, 0.0)
HEADINGS_RAD = np.radians((0.4, -0.7, 0.2, 0.6, -0.1, -0.4))


def drive(camera: Camera, curvatures_per_m=(0.0,) * 6, **options) -> list[np.ndarray]:
    """One picture for each curvature, six at most."""
    states = zip(OFFSETS_M, HEADINGS_RAD, curvatures_per_m, strict=False)
    return [
        paint_motorway(camera, offset_m=o, heading_rad=h, curvature_per_m=c, phase_m=2.9 * i, seed=i, **options)
        for i, (o, h, c) in enumerate(states)
    ]


@pytest.fixture(scope="module")
def straight() -> list[np.ndarray]:
    return drive(CAMERA)


def assert_near(estimate, pose, *, pitch_deg, yaw_deg, roll_deg, height_m):
    found = estimate.pose
    assert np.degrees(found.pitch_rad) == pytest.approx(np.degrees(pose.pitch_rad), abs=pitch_deg)
    assert np.degrees(found.yaw_rad) == pytest.approx(np.degrees(pose.yaw_rad), abs=yaw_deg)
    assert np.degrees(found.roll_rad) == pytest.approx(np.degrees(pose.roll_rad), abs=roll_deg)
    assert found.height_m == pytest.approx(pose.height_m, abs=height_m)


def test_straight_drive_gives_all_four_numbers(straight):
    estimate = estimate_pose(straight, CAMERA)
    assert_near(estimate, TRUE_POSE, pitch_deg=0.1, yaw_deg=0.3, roll_deg=0.2, height_m=0.03)
    assert estimate.frames_used == estimate.frames_total == 6
    assert estimate.notes == ()
    assert estimate.still is None and estimate.camera.pose is estimate.pose


def test_bends_to_one_side_do_not_bias_the_angles():
    bends = drive(CAMERA, (1 / 250, 1 / 300, 1 / 400, 1 / 500, 1 / 350, 1 / 800))
    assert_near(estimate_pose(bends, CAMERA), TRUE_POSE, pitch_deg=0.15, yaw_deg=0.4, roll_deg=0.3, height_m=0.03)


def test_the_pose_does_not_depend_on_the_order_of_stills(straight):
    empty = [np.full((720, 1280, 3), 120, np.uint8)] * len(straight)
    interleaved = [image for pair in zip(empty, straight, strict=True) for image in pair]
    poses = [estimate_pose(images, CAMERA).pose for images in (interleaved, straight + empty, empty + straight)]
    assert poses[0] == poses[1] == poses[2]


@pytest.mark.parametrize("pitch_deg", [-9, 9])
def test_the_horizon_may_be_far_from_the_middle(pitch_deg):
    pose = replace(TRUE_POSE, pitch_rad=np.radians(pitch_deg))
    estimate = estimate_pose(drive(CAMERA.with_pose(pose), (0.0,) * 4), CAMERA)
    assert_near(estimate, pose, pitch_deg=0.2, yaw_deg=0.7, roll_deg=0.4, height_m=0.05)


@pytest.fixture(scope="module")
def swaying() -> list[np.ndarray]:
    states = np.random.default_rng(0).normal(0, (0.3, 0.007), (16, 2))
    return [
        paint_motorway(CAMERA, offset_m=o, heading_rad=h, phase_m=2.9 * i, seed=i) for i, (o, h) in enumerate(states)
    ]


@pytest.mark.parametrize("draw", [draw_guide_lines, draw_striped_bonnet])
def test_what_never_moves_does_not_bias_the_pose(swaying, draw):
    estimate = estimate_pose(map(draw, swaying), CAMERA)
    assert_near(estimate, TRUE_POSE, pitch_deg=0.2, yaw_deg=0.5, roll_deg=0.4, height_m=0.05)


def test_a_lens_with_distortion_and_a_larger_picture():
    lens = Camera.from_fov((1920, 1080), 75, CameraPose(1.2, np.radians(-1.5), np.radians(1.2), np.radians(-0.5)))
    lens = replace(lens, distortion=np.array([-0.25, 0.06, 0.0, 0.0, 0.0]))
    estimate = estimate_pose(drive(lens, (0.0,) * 2), lens)
    assert_near(estimate, lens.pose, pitch_deg=0.15, yaw_deg=0.7, roll_deg=0.3, height_m=0.03)


def test_one_still_is_enough_and_says_what_it_cannot_tell():
    still = paint_motorway(CAMERA, offset_m=0.3, curvature_per_m=1 / 600)
    estimate = estimate_pose([still], CAMERA)
    assert_near(estimate, TRUE_POSE, pitch_deg=0.4, yaw_deg=0.8, roll_deg=1.0, height_m=0.1)
    assert any("heading" in note for note in estimate.notes)
    assert estimate.still.lane.same_lane_share == 1.0 and estimate.still.camera is estimate.camera
    assert estimate.yaw_std_rad > np.radians(0.5)


def test_dashes_only():
    estimate = estimate_pose(drive(CAMERA, solid=()), CAMERA)
    assert_near(estimate, TRUE_POSE, pitch_deg=0.2, yaw_deg=0.4, roll_deg=0.4, height_m=0.04)


def test_roll_is_taken_to_be_level_where_only_the_ego_lane_is_marked():
    estimate = estimate_pose(drive(CAMERA, (0.0,) * 3, lines=(0, 1), solid=(0, 1)), CAMERA)
    assert estimate.pose.roll_rad == 0
    assert "roll" in estimate.notes[0]
    assert np.degrees(estimate.pose.pitch_rad) == pytest.approx(2.5, abs=0.2)


def test_lane_width_and_height_scale_each_other(straight):
    wide = estimate_pose(straight[:2], CAMERA, lane_width_m=3.66 * 1.1)
    assert wide.pose.height_m == pytest.approx(1.35 * 1.1, abs=0.06)
    given = estimate_pose(straight[:2], CAMERA, height_m=1.5)
    assert given.pose.height_m == 1.5
    assert given.height_std_m == 0
    assert given.lane_width_m == pytest.approx(3.66 * 1.5 / 1.35, abs=0.12)


def test_errors_stay_within_three_standard_deviations():
    rng = np.random.default_rng(8)
    for seed in range(3):
        pose = CameraPose(rng.uniform(1.1, 1.7), *np.radians(rng.uniform([-5, -3, -1.5], [5, 3, 1.5])))
        camera = Camera.from_fov((1280, 720), rng.uniform(50, 80), pose)
        images = [paint_motorway(camera, offset_m=rng.normal(0, 0.3), seed=seed + i) for i in range(2)]
        e = estimate_pose(images, camera)
        for name in ("height_m", "pitch_rad", "yaw_rad", "roll_rad"):
            std = getattr(e, name.replace("_", "_std_"))
            assert abs(getattr(e.pose, name) - getattr(pose, name)) < 3 * std, (seed, name)


def test_two_runs_agree_and_progress_counts(straight):
    images, seen = straight[:2], []
    first = estimate_pose(images, CAMERA, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]
    assert estimate_pose(iter(images), CAMERA).describe() == first.describe()


def test_description_words_the_signs(straight):
    text = estimate_pose(straight[:2], CAMERA).describe()
    assert "looks down" in text and "looks right" in text and "right side down" in text
    assert "from 2 of 2 pictures" in text


def test_repr_names_each_number_with_its_standard_deviation(straight):
    estimate = estimate_pose(straight[:2], CAMERA)
    assert repr(estimate).startswith(f"PoseEstimate(height {estimate.pose.height_m:.2f} ± ")
    assert repr(estimate).endswith("pictures 2 of 2 used)")


def unmarked():
    return paint_motorway(CAMERA, lines=())


def speckled():
    return np.random.default_rng(2).integers(0, 255, (720, 1280, 3), dtype=np.uint8)


@pytest.mark.parametrize("image", [unmarked(), speckled(), np.zeros((720, 1280, 3), np.uint8)])
def test_pictures_without_lanes_are_refused(image):
    with pytest.raises(PoseError, match="only 0 of 3 pictures show two or more parallel lane lines"):
        estimate_pose([image] * 3, CAMERA)


def test_one_line_alone_is_refused():
    with pytest.raises(PoseError, match="parallel lane lines|a lane apart"):
        estimate_pose([paint_motorway(CAMERA, lines=(0,))] * 2, CAMERA)


def test_lines_that_bound_no_lane_are_refused():
    with pytest.raises(PoseError, match="a lane apart"):
        estimate_pose(drive(CAMERA, (0.0,) * 3, lines=(0, 2), solid=(0, 2)), CAMERA, lane_width_m=2.2, height_m=1.35)


def test_bad_input_is_named():
    with pytest.raises(PoseError, match="no picture was given"):
        estimate_pose([], CAMERA)
    with pytest.raises(PictureError, match="picture 2: is 640x360"):
        estimate_pose([unmarked(), np.zeros((360, 640, 3), np.uint8)], CAMERA)
    with pytest.raises(PoseError, match="lane 12 m wide"):
        estimate_pose([unmarked()], CAMERA, lane_width_m=12)
    with pytest.raises(PoseError, match="camera 0.1 m above"):
        estimate_pose([unmarked()], CAMERA, height_m=0.1)


def test_a_failed_estimate_is_work_undone_not_bad_input():
    """Commands exit with this status; the ValueError of a bad argument gives 2."""
    assert PoseError("").exit_status == 1 and issubclass(PoseError, ValueError)


def test_a_picture_of_another_size_is_named_by_its_file(tmp_path):
    write_image(tmp_path / "first.png", unmarked())
    write_image(tmp_path / "second.png", np.zeros((721, 1281, 3), np.uint8))
    with pytest.raises(PictureError, match=r"second\.png: is 1281x721"):
        estimate_pose(tmp_path, CAMERA)


STILLS = ROOT / "test_images"


def test_the_embedded_stills_give_their_true_pose():
    truth = json.loads((STILLS / "truth.json").read_text())
    camera = camera_from_dict(truth["camera"])
    images = [read_image(STILLS.parent / frame["raw_file"]) for frame in truth["frames"]]
    estimate = estimate_pose(images, camera)
    assert_near(estimate, camera.pose, pitch_deg=0.1, yaw_deg=0.4, roll_deg=0.4, height_m=0.05)


@pytest.mark.skipif(
    not (REAL_DATA / "labels.jsonl").is_file(),
    reason=f"no labelled real stills in {REAL_DATA.name}; name their folder LANES_DATA",
)
def test_real_stills_meet_where_their_labels_meet():
    """With a guessed lens, the labelled lines of the straight stills meet within 0.3 degrees of straight ahead."""
    labels = map(json.loads, (REAL_DATA / "labels.jsonl").read_text().splitlines())
    stills = [label for label in labels if "test_images" in label["raw_file"]]
    camera = Camera.from_fov((1280, 720), 60)
    pose = estimate_pose([read_image(REAL_DATA / still["raw_file"]) for still in stills], camera).pose
    far_ahead = camera.with_pose(pose).road_to_pixels(np.array([[1e6, 0.0]]))[0]
    meetings = [meeting_point(still) for still in stills if "straight" in still["raw_file"]]
    assert len(meetings) == 2
    np.testing.assert_allclose(far_ahead, np.mean(meetings, axis=0), atol=camera.matrix[0, 0] * np.radians(0.3))


def meeting_point(label: dict) -> tuple[float, float]:
    """Where straight lines through the two labelled lines cross, in pixels (u, v)."""
    rows = np.array(label["h_samples"])
    (a, b), (c, d) = (np.polyfit(rows[np.array(u) > 0], np.array(u)[np.array(u) > 0], 1) for u in label["lanes"])
    row = (d - b) / (a - c)
    return a * row + b, row
