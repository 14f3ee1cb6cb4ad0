"""The camera pose from the road, against images whose pose is known exactly."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from lanes.camera import Camera, CameraPose, camera_from_dict
from lanes.errors import PictureError, PoseError
from lanes.images import read_image, write_image
from lanes.pose import ASSUMED, DOUBTFUL, ESTIMATED, PoseEstimate, detect_in_drive, ensure_pose, estimate_pose
from lanes.pose_votes import LOG_HEIGHTS, rival_std, vote_heights
from simulator.not_roads import not_a_road
from tests.support.painted_roads import paint_motorway
from tests.support.project import ROOT
from tests.support.static_objects import draw_guide_lines, draw_striped_bonnet

TRUE_POSE = CameraPose(1.35, np.radians(2.5), np.radians(-1.8), np.radians(0.9))
CAMERA = Camera.from_fov((1280, 720), 62, TRUE_POSE)
# Off the lane's middle and heading both ways; the headings average to zero as they do over a drive.
OFFSETS_M = (-0.4, 0.1, 0.35, -0.2, 0.5, 0.0)
HEADINGS_RAD = np.radians((0.4, -0.7, 0.2, 0.6, -0.1, -0.4))


def drive(camera: Camera, curvatures_per_m=(0.0,) * 6, **options) -> list[np.ndarray]:
    """One image for each curvature, six at most."""
    states = zip(OFFSETS_M, HEADINGS_RAD, curvatures_per_m, strict=False)
    return [
        paint_motorway(camera, offset_m=o, heading_rad=h, curvature_per_m=c, phase_m=2.9 * i, seed=i, **options)
        for i, (o, h, c) in enumerate(states)
    ]


def paint_street(camera: Camera, *, lines: tuple[int, ...] = ()) -> np.ndarray:
    """A street of houses with four storeys on both sides: strips along the road, each of a grey of its own."""
    rng = np.random.default_rng(0)
    image = paint_motorway(camera, lines=lines, solid=lines)
    for y_m in (-7.0, 7.0):
        for begin_m in (70.0, 40.0, 24.0, 12.0):
            for floor in range(4):
                x_m = [begin_m, begin_m * 1.6, begin_m * 1.6, begin_m]
                z_m = [1.5 * floor, 1.5 * floor, 1.5 * floor + 1.2, 1.5 * floor + 1.2]
                corners = camera.road_to_pixels(np.column_stack([x_m, [y_m] * 4, z_m]))
                cv2.fillPoly(image, [np.round(corners).astype(np.int32)], [int(rng.integers(30, 230))] * 3)
    return image


@pytest.fixture(scope="module")
def straight() -> list[np.ndarray]:
    return drive(CAMERA)


def assert_near(estimate, pose, *, pitch_deg, yaw_deg, roll_deg, height_m):
    found = estimate.pose
    assert np.degrees(found.pitch_rad) == pytest.approx(np.degrees(pose.pitch_rad), abs=pitch_deg)
    assert np.degrees(found.yaw_rad) == pytest.approx(np.degrees(pose.yaw_rad), abs=yaw_deg)
    assert np.degrees(found.roll_rad) == pytest.approx(np.degrees(pose.roll_rad), abs=roll_deg)
    assert found.height_m == pytest.approx(pose.height_m, abs=height_m)


WIDE = Camera.from_fov((1920, 1080), 75, CameraPose(1.2, np.radians(-1.5), np.radians(1.2), np.radians(-0.5)))
# Camera, curvature of the road in each image, and the largest errors of pitch, yaw, roll (degrees) and height (m).
DRIVES = {
    "bends to one side": (CAMERA, (1 / 250, 1 / 300, 1 / 400, 1 / 500, 1 / 350, 1 / 800), (0.15, 0.4, 0.3, 0.03)),
    "tight bends": (CAMERA, (1 / 80, 1 / 100, 1 / 90, 1 / 70), (0.1, 0.7, 0.3, 0.03)),
    "looks up": (CAMERA.with_pose(replace(TRUE_POSE, pitch_rad=np.radians(-9))), (0.0,) * 4, (0.2, 0.7, 0.4, 0.05)),
    "looks down": (CAMERA.with_pose(replace(TRUE_POSE, pitch_rad=np.radians(9))), (0.0,) * 4, (0.2, 0.7, 0.4, 0.05)),
    "bent lens": (replace(WIDE, distortion=np.array([-0.25, 0.06, 0, 0, 0])), (0.0,) * 2, (0.15, 0.7, 0.3, 0.03)),
}


@pytest.mark.slow
class TestDrive:
    def test_straight_drive_gives_all_four_numbers(self, straight):
        estimate = estimate_pose(straight, CAMERA)
        assert_near(estimate, TRUE_POSE, pitch_deg=0.1, yaw_deg=0.3, roll_deg=0.2, height_m=0.03)
        assert estimate.frames_used == estimate.frames_total == 6
        assert estimate.notes == () and estimate.still is None
        assert estimate.camera.size == CAMERA.size and np.array_equal(estimate.camera.matrix, CAMERA.matrix)

    @pytest.mark.parametrize("name", DRIVES)
    def test_drives_of_other_cameras_and_roads(self, name):
        camera, curvatures_per_m, (pitch_deg, yaw_deg, roll_deg, height_m) = DRIVES[name]
        near = dict(pitch_deg=pitch_deg, yaw_deg=yaw_deg, roll_deg=roll_deg, height_m=height_m)
        assert_near(estimate_pose(drive(camera, curvatures_per_m), camera), camera.pose, **near)

    def test_the_pose_does_not_depend_on_the_order_of_images(self, straight):
        empty = [np.full((720, 1280, 3), 120, np.uint8)] * len(straight)
        interleaved = [image for pair in zip(empty, straight, strict=True) for image in pair]
        for images in (interleaved, empty + straight):
            estimate = estimate_pose(images, CAMERA)
            assert_near(estimate, TRUE_POSE, pitch_deg=0.1, yaw_deg=0.3, roll_deg=0.3, height_m=0.03)

    @pytest.mark.parametrize("draw", [draw_guide_lines, draw_striped_bonnet])
    def test_what_never_moves_does_not_bias_the_pose(self, draw):
        states = np.random.default_rng(0).normal(0, (0.3, 0.007), (10, 2))
        swaying = (
            draw(paint_motorway(CAMERA, offset_m=o, heading_rad=h, phase_m=2.9 * i, seed=i))
            for i, (o, h) in enumerate(states)
        )
        estimate = estimate_pose(swaying, CAMERA)
        assert_near(estimate, TRUE_POSE, pitch_deg=0.2, yaw_deg=0.5, roll_deg=0.4, height_m=0.05)

    def test_roll_is_taken_to_be_level_where_only_the_ego_lane_is_marked(self):
        estimate = estimate_pose(drive(CAMERA, (0.0,) * 3, lines=(0, 1), solid=(0, 1)), CAMERA)
        assert estimate.pose.roll_rad == 0
        assert "roll" in estimate.notes[0]
        assert np.degrees(estimate.pose.pitch_rad) == pytest.approx(2.5, abs=0.2)

    def test_lane_width_and_height_scale_each_other(self, straight):
        wide = estimate_pose(straight[:2], CAMERA, lane_width_m=3.66 * 1.1)
        assert wide.pose.height_m == pytest.approx(1.35 * 1.1, abs=0.06)
        given = estimate_pose(straight[:2], CAMERA, height_m=1.5)
        assert given.pose.height_m == 1.5
        assert given.height_std_m == 0
        assert given.lane_width_m == pytest.approx(3.66 * 1.5 / 1.35, abs=0.12)

    @pytest.mark.parametrize(
        ("height_m", "pitch_deg", "images"), [(2.6, 4.0, 3), (0.7, -1.0, 6)], ids=["lorry", "cart"]
    )
    def test_two_lanes_are_not_taken_for_one_nor_half_a_lane_for_a_whole_one(self, height_m, pitch_deg, images):
        camera = CAMERA.with_pose(CameraPose(height_m, np.radians(pitch_deg), np.radians(-1.0)))
        estimate = estimate_pose(drive(camera, (0.0,) * images), camera)
        assert_near(estimate, camera.pose, pitch_deg=0.2, yaw_deg=0.6, roll_deg=0.4, height_m=0.1)
        # a cart's height is rare: six images may leave it doubtful
        assert estimate.state == ESTIMATED or height_m < 1

    def test_a_height_that_two_images_do_not_decide_is_doubtful_and_so_are_its_lanes(self):
        camera = CAMERA.with_pose(CameraPose(2.6, np.radians(4.0)))
        images = drive(camera, (0.0,) * 2)
        estimate = estimate_pose(images, camera)
        assert estimate.state == DOUBTFUL and "pose is doubtful" in estimate.describe()
        assert abs(estimate.pose.height_m - 2.6) < 2 * estimate.height_std_m
        assert estimate.notes[0].startswith("the pictures allow a height of")
        sure = replace(estimate, confidence_shift=0.0)
        of_doubtful, of_sure = (detect_in_drive(images[0], estimate.camera, e)[0].lane for e in (estimate, sure))
        assert of_doubtful.confidence < of_sure.confidence
        given = estimate_pose(images, camera, height_m=2.6)
        assert given.state == ESTIMATED and given.confidence_shift == 0.0

    def test_a_camera_that_hangs_askew(self):
        camera = CAMERA.with_pose(replace(TRUE_POSE, roll_rad=np.radians(-3.0)))
        estimate = estimate_pose(drive(camera, (0.0,) * 3), camera)
        assert_near(estimate, camera.pose, pitch_deg=0.2, yaw_deg=0.7, roll_deg=0.5, height_m=0.05)

    def test_errors_stay_within_three_standard_deviations(self):
        rng = np.random.default_rng(8)
        for seed in range(3):
            pose = CameraPose(rng.uniform(1.1, 1.7), *np.radians(rng.uniform([-5, -3, -1.5], [5, 3, 1.5])))
            camera = Camera.from_fov((1280, 720), rng.uniform(50, 80), pose)
            images = [paint_motorway(camera, offset_m=rng.normal(0, 0.3), seed=seed + i) for i in range(2)]
            e = estimate_pose(images, camera)
            for name in ("height_m", "pitch_rad", "yaw_rad", "roll_rad"):
                std = getattr(e, name.replace("_", "_std_"))
                assert abs(getattr(e.pose, name) - getattr(pose, name)) < 3 * std, (seed, name)

    def test_the_embedded_stills_give_their_true_pose(self):
        truth = json.loads((ROOT / "test_images" / "truth.json").read_text())
        camera = camera_from_dict(truth["camera"])
        images = [read_image(ROOT / frame["raw_file"]) for frame in truth["frames"]]
        estimate = estimate_pose(images, camera)
        assert_near(estimate, camera.pose, pitch_deg=0.1, yaw_deg=0.4, roll_deg=0.4, height_m=0.05)


@pytest.mark.slow
class TestOneImage:
    def test_the_pose_is_that_of_the_lane_which_is_kept_with_it(self):
        image = paint_motorway(CAMERA, offset_m=0.3, curvature_per_m=1 / 600)
        estimate = estimate_pose(image, CAMERA)
        assert_near(estimate, TRUE_POSE, pitch_deg=0.4, yaw_deg=0.8, roll_deg=1.0, height_m=0.1)
        assert any("heading" in note for note in estimate.notes)
        assert estimate.yaw_std_rad > np.radians(0.5)
        assert estimate.still.camera is estimate.camera
        assert estimate.still.lane.same_lane_share == 1.0
        assert estimate.still.lane.offset_m == pytest.approx(0.3, abs=0.1)

    @pytest.mark.parametrize(("pitch_deg", "yaw_deg"), [(2.5, -1.8), (-4.0, 5.0), (6.0, 0.0)])
    def test_a_street_without_lane_lines_shows_pitch_and_yaw_by_its_edges(self, pitch_deg, yaw_deg):
        camera = Camera.from_fov((1280, 720), 62, CameraPose(1.5, *np.radians([pitch_deg, yaw_deg])))
        pose = estimate_pose(paint_street(camera), camera).pose
        assert np.degrees(pose.pitch_rad) == pytest.approx(pitch_deg, abs=0.6)
        assert np.degrees(pose.yaw_rad) == pytest.approx(yaw_deg, abs=1.0)

    def test_a_pose_from_edges_says_so_and_that_the_height_is_assumed(self):
        camera = Camera.from_fov((1920, 1280), 62, CameraPose(1.5, np.radians(3.0)))
        estimate = estimate_pose([paint_street(camera, lines=(0,))], camera)
        assert np.degrees(estimate.pose.pitch_rad) == pytest.approx(3.0, abs=1.0)
        assert estimate.pose.roll_rad == 0.0
        assert abs(estimate.pose.height_m - 1.5) < 2 * estimate.height_std_m
        assert "(assumed)" in estimate.describe() and "height and roll are assumed" in estimate.notes[0]
        assert "25% (the height is assumed)" in estimate.describe_accuracy()
        assert estimate_pose(paint_street(camera), camera, height_m=1.6).pose.height_m == 1.6

    @pytest.mark.parametrize("kind", ["blinds", "bricks", "circles", "clouds", "map", "wall"])
    def test_an_image_without_a_road_shows_no_lane(self, kind):
        """It is not refused; the confidence says that no lane is seen."""
        estimate = estimate_pose(not_a_road(kind, seed=0), Camera.from_fov((1280, 720), 60))
        assert estimate.still.lane is None or estimate.still.lane.confidence < 0.5

    def test_streets_that_each_show_one_line_give_pitch_and_yaw(self):
        camera = Camera.from_fov((1280, 720), 62, CameraPose(1.5, *np.radians([2.0, 1.5])))
        estimate = estimate_pose([paint_street(camera, lines=(0,))] * 3, camera)
        assert np.degrees([estimate.pose.pitch_rad, estimate.pose.yaw_rad]) == pytest.approx([2.0, 1.5], abs=1.0)


@pytest.mark.slow
class TestSources:
    def test_files_folders_patterns_and_images_give_the_same_pose(self, straight, tmp_path):
        images = straight[:2]
        for number, image in enumerate(images):
            write_image(tmp_path / f"{number}.png", image)
        expected = estimate_pose(images, CAMERA).pose
        bgr = [np.ascontiguousarray(image[..., ::-1])[..., ::-1] for image in images]
        files = [tmp_path / f"{number}.png" for number in range(2)]
        for source in (tmp_path, str(tmp_path / "*.png"), files, map(str, files), iter(images), bgr):
            assert estimate_pose(source, CAMERA).pose == expected
        assert estimate_pose(files, CAMERA, max_pictures=1).frames_total == 1

    def test_two_runs_agree_and_progress_counts(self, straight):
        seen = []
        first = estimate_pose(straight[:2], CAMERA, progress=lambda done, total: seen.append((done, total)))
        assert seen == [(done, 6) for done in range(1, 7)]
        assert estimate_pose(straight[:2], CAMERA).describe() == first.describe()

    def test_a_known_pose_is_kept(self, straight):
        assert ensure_pose(CAMERA, straight[:2]) == (CAMERA, None)
        camera, estimate = ensure_pose(replace(CAMERA, pose=None), straight[:2])
        assert camera is estimate.camera

    def test_errors_name_the_file(self, straight, tmp_path):
        write_image(tmp_path / "first.png", straight[0])
        write_image(tmp_path / "second.png", np.zeros((721, 1281, 3), np.uint8))
        with pytest.raises(PictureError, match=r"second\.png: is 1281x721"):
            estimate_pose(tmp_path, CAMERA)
        for name in ("first.png", "second.png"):
            write_image(tmp_path / name, np.zeros((18, 32, 3), np.uint8))
        with pytest.raises(PoseError, match=r"first\.png: pictures of 32x18 pixels are too small"):
            estimate_pose(tmp_path, CAMERA.scaled((32, 18)))


class TestNoLanes:
    """The pose is then that of the edges and of the usual camera, and the notes say why."""

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "image",
        [paint_motorway(CAMERA, lines=()), not_a_road("text", seed=0), np.zeros((720, 1280, 3), np.uint8)],
        ids=["unmarked", "text", "black"],
    )
    def test_images_without_lanes(self, image):
        estimate = estimate_pose([image] * 3, CAMERA)
        assert estimate.lane_width_m is None and estimate.height_std_m > 0.2
        assert estimate.notes[0].startswith("only 0 of 3 pictures show a likely lane")

    @pytest.mark.slow
    def test_one_line_alone(self):
        """Another border of the lane is a dark edge of the pavement, or none."""
        estimate = estimate_pose([paint_motorway(CAMERA, lines=(0,))] * 2, CAMERA)
        assert estimate.height_std_m > 0.2

    @pytest.mark.slow
    def test_edges_far_from_ahead_are_not_believed_without_lanes(self):
        """The spread then is that of any camera, and covers the truth."""
        camera = Camera.from_fov((1280, 720), 62, CameraPose(1.5, *np.radians([-8.0, -10.0])))
        estimate = estimate_pose([paint_street(camera)] * 2, camera)
        assert estimate.state == ASSUMED and "0 of 2 used, the pose is assumed" in estimate.describe()
        assert np.degrees([estimate.pitch_std_rad, estimate.yaw_std_rad]) == pytest.approx([6, 10])
        assert estimate.pose.pitch_rad == estimate.pose.yaw_rad == 0


class TestVotes:
    """Of the heights for which the lanes in images vote."""

    @staticmethod
    def _mode(odds, heights_m) -> tuple[float, float]:
        density = vote_heights(np.array(odds, float), np.log(np.array(heights_m, float)))
        mode = float(LOG_HEIGHTS[density.argmax()])
        return float(np.exp(mode)), rival_std(LOG_HEIGHTS, density, mode, 0.35)

    def test_without_lanes_the_height_is_that_of_a_car_and_uncertain(self):
        height_m, std = self._mode([[0.0, 0.0]], [[np.nan, np.nan]])
        assert height_m == pytest.approx(1.35, abs=0.02) and std > 0.2

    @pytest.mark.parametrize(("images", "height_m"), [(1, 1.3), (6, 2.6)])
    def test_several_images_outvote_the_usual_height_and_one_does_not(self, images, height_m):
        found, std = self._mode([[9.0, 45.0]] * images, [[1.3, 2.6]] * images)
        assert found == pytest.approx(height_m, abs=0.05)
        assert (std > 0.2) == (images == 1)


class TestRefused:
    def test_bad_input_is_named(self):
        empty = np.zeros((720, 1280, 3), np.uint8)
        with pytest.raises(PoseError, match="no picture was given"):
            estimate_pose([], CAMERA)
        with pytest.raises(PictureError, match="picture 2: is 640x360"):
            estimate_pose([empty, empty[:360, :640]], CAMERA)
        with pytest.raises(PoseError, match="lane 12 m wide"):
            estimate_pose(empty, CAMERA, lane_width_m=12)
        with pytest.raises(PoseError, match="camera 0.1 m above"):
            estimate_pose(empty, CAMERA, height_m=0.1)
        with pytest.raises(PoseError, match="32x18 pixels are too small"):
            estimate_pose(empty[:18, :32], CAMERA.scaled((32, 18)))
        with pytest.raises(FileNotFoundError, match="there is no such file"):
            estimate_pose("nothing.mp4", CAMERA)

    def test_a_failed_estimate_is_work_undone_not_bad_input(self):
        """Commands exit with this status; the ValueError of a bad argument gives 2."""
        assert PoseError("").exit_status == 1 and issubclass(PoseError, ValueError)


def test_description_words_the_signs_and_gives_standard_deviations():
    camera = CAMERA.with_pose(CameraPose(1.32, np.radians(1.8), np.radians(-1.36), 0.0))
    estimate = PoseEstimate(camera, 0.04, 0.001, 0.002, 0.0175, 12, 40, 3.66, ("roll <unknown>",))
    assert estimate.describe().splitlines() == [
        "height   1.32 ± 0.04 m (lane 3.66 m wide)",
        "pitch    1.80 ± 0.06 deg (looks down)",
        "yaw      -1.36 ± 0.11 deg (looks right)",
        "roll     0.00 ± 1.00 deg",
        "pictures 12 of 40 used",
        "note: roll <unknown>",
    ]
    assert repr(estimate).startswith("PoseEstimate(height 1.32 ± 0.04 m (lane 3.66 m wide), pitch 1.80 ± 0.06 deg ")


@pytest.mark.parametrize(("roll_std_rad", "good_to"), [(0.0005, "3 cm"), (0.0175, "13 cm")])
def test_the_stated_accuracy_contains_the_roll(roll_std_rad, good_to):
    camera = CAMERA.with_pose(CameraPose(1.32))
    estimate = PoseEstimate(camera, 0.04, 0.001, 0.002, roll_std_rad, 12, 40, 3.66)
    assert f"offset and lane width to be good to {good_to} and 3% (lanes may be wider" in estimate.describe_accuracy()
