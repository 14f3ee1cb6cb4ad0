"""The camera pose from the road, against images whose pose is known exactly."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose
from lanes.detect.search import DETECTOR
from lanes.errors import PictureError, PoseError
from lanes.pose.estimate import (
    ASSUMED,
    DOUBTFUL,
    ESTIMATED,
    PoseEstimate,
    detect_in_drive,
    estimate_in_drive,
    estimate_pose,
)
from lanes.video.images import write_image
from tests.support.painted_roads import dashcam, paint_motorway
from tests.support.static_objects import draw_guide_lines

TRUE_POSE = CameraPose(1.35, np.radians(2.5), np.radians(-1.8), np.radians(0.9))
CAMERA = Camera.from_fov((1280, 720), 62, TRUE_POSE)
# Off the lane's middle and heading both ways; the headings average to zero as they do
# over a drive.
OFFSETS_M = (-0.4, 0.1, 0.35, -0.2, 0.5, 0.0)
HEADINGS_RAD = np.radians((0.4, -0.7, 0.2, 0.6, -0.1, -0.4))


def drive(camera: Camera, curvatures_per_m=(0.0,) * 6, **options) -> list[np.ndarray]:
    """One image for each curvature, six at most."""
    states = zip(OFFSETS_M, HEADINGS_RAD, curvatures_per_m, strict=False)
    return [
        paint_motorway(
            camera,
            offset_m=o,
            heading_rad=h,
            curvature_per_m=c,
            phase_m=2.9 * i,
            seed=i,
            **options,
        )
        for i, (o, h, c) in enumerate(states)
    ]


def paint_street(camera: Camera, *, lines: tuple[int, ...] = ()) -> np.ndarray:
    """A street of houses with four storeys on both sides: strips along the road, each
    of a grey of its own.
    """
    rng = np.random.default_rng(0)
    image = paint_motorway(camera, lines=lines, solid=lines)
    for y_m in (-7.0, 7.0):
        for begin_m in (70.0, 40.0, 24.0, 12.0):
            for floor in range(4):
                x_m = [begin_m, begin_m * 1.6, begin_m * 1.6, begin_m]
                z_m = [1.5 * floor, 1.5 * floor, 1.5 * floor + 1.2, 1.5 * floor + 1.2]
                corners = camera.road_to_pixels(np.column_stack([x_m, [y_m] * 4, z_m]))
                cv2.fillPoly(
                    image,
                    [np.round(corners).astype(np.int32)],
                    [int(rng.integers(30, 230))] * 3,
                )
    return image


def assert_near(estimate, pose, pitch_deg, yaw_deg, roll_deg, height_m):
    """The estimated pose differs from the true one by no more than these numbers."""
    largest = {"pitch_rad": pitch_deg, "yaw_rad": yaw_deg, "roll_rad": roll_deg}
    for name, degrees in largest.items():
        found, true = (getattr(p, name) for p in (estimate.pose, pose))
        assert np.degrees(found) == pytest.approx(np.degrees(true), abs=degrees), name
    assert estimate.pose.height_m == pytest.approx(pose.height_m, abs=height_m)


def posed(**changes_deg: float) -> Camera:
    """The camera with other numbers of its pose."""
    height_m = changes_deg.pop("height_m", TRUE_POSE.height_m)
    return CAMERA.with_pose(
        replace(
            TRUE_POSE,
            height_m=height_m,
            **{n: np.radians(x) for n, x in changes_deg.items()},
        )
    )


WIDE = Camera.from_fov(
    (1920, 1080),
    75,
    CameraPose(1.2, np.radians(-1.5), np.radians(1.2), np.radians(-0.5)),
)
# Camera, curvature of the road in each image, and the largest errors of pitch, yaw,
# roll (degrees) and height (m).
DRIVES = {
    "straight": (CAMERA, (0.0,) * 4, (0.1, 0.3, 0.2, 0.03)),
    "bends to one side": (
        CAMERA,
        (1 / 250, 1 / 300, 1 / 400, 1 / 500, 1 / 350, 1 / 800),
        (0.15, 0.4, 0.3, 0.03),
    ),
    "looks up": (posed(pitch_rad=-9), (0.0,) * 4, (0.2, 0.7, 0.4, 0.05)),
    "bent lens": (
        replace(WIDE, distortion=np.array([-0.25, 0.06, 0, 0, 0])),
        (0.0,) * 2,
        (0.15, 0.7, 0.3, 0.03),
    ),
    "hangs askew": (posed(roll_rad=-3), (0.0,) * 3, (0.2, 0.7, 0.5, 0.05)),
    # two lanes are not taken for one, nor half a lane for a whole one
    "lorry": (
        posed(height_m=2.6, pitch_rad=4, yaw_rad=-1, roll_rad=0),
        (0.0,) * 3,
        (0.2, 0.6, 0.4, 0.1),
    ),
    "cart": (
        posed(height_m=0.7, pitch_rad=-1, yaw_rad=-1, roll_rad=0),
        (0.0,) * 6,
        (0.2, 0.6, 0.4, 0.1),
    ),
}


@pytest.mark.slow
class TestDrive:
    @pytest.mark.parametrize("name", DRIVES)
    def test_the_pose_of_drives_with_many_cameras(self, name):
        camera, curvatures_per_m, near = DRIVES[name]
        estimate = estimate_pose(drive(camera, curvatures_per_m), camera)
        assert_near(estimate, camera.pose, *near)
        # a cart's height is rare: six images may leave it doubtful; two do not show the
        # roll surely
        assert estimate.state == ESTIMATED or name in ("cart", "bent lens")
        assert estimate.frames_used == estimate.frames_total == len(curvatures_per_m)
        assert estimate.still is None
        assert np.array_equal(estimate.camera.matrix, camera.matrix)
        # lanes are 3.66 ± 0.10 m wide
        assert estimate.height_std_m > 0.027 * estimate.pose.height_m

    def test_what_never_moves_does_not_bias_the_pose(self):
        states = np.random.default_rng(0).normal(0, (0.3, 0.007), (10, 2))
        swaying = (
            draw_guide_lines(
                paint_motorway(
                    CAMERA, offset_m=o, heading_rad=h, phase_m=2.9 * i, seed=i
                )
            )
            for i, (o, h) in enumerate(states)
        )
        estimate = estimate_pose(swaying, CAMERA)
        assert_near(
            estimate, TRUE_POSE, pitch_deg=0.2, yaw_deg=0.5, roll_deg=0.4, height_m=0.05
        )

    def test_lane_width_and_height_scale_each_other(self):
        straight = drive(CAMERA, (0.0,) * 2)
        wide = estimate_pose(straight, CAMERA, lane_width_m=3.66 * 1.1)
        assert wide.pose.height_m == pytest.approx(1.35 * 1.1, abs=0.06)
        given = estimate_pose(straight, CAMERA, height_m=1.5)
        assert given.pose.height_m == 1.5
        assert given.height_std_m == 0
        assert given.lane_width_m == pytest.approx(3.66 * 1.5 / 1.35, abs=0.12)

    def test_a_height_that_two_images_do_not_decide_is_doubtful_and_so_are_its_lanes(
        self,
    ):
        camera = CAMERA.with_pose(CameraPose(2.85, np.radians(4.0)))
        images = drive(camera, (0.0,) * 2)
        estimate = estimate_pose(images, camera)
        assert estimate.state == DOUBTFUL
        assert "pose is doubtful" in estimate.describe()
        assert abs(estimate.pose.height_m - 2.85) < 2 * estimate.height_std_m
        assert estimate.notes[0].startswith("the pictures allow a height of")
        sure = replace(estimate, confidence_shift=0.0)
        of_doubtful, of_sure = (
            detect_in_drive(images[0], estimate.camera, e)[0].lane
            for e in (estimate, sure)
        )
        assert of_doubtful.confidence < of_sure.confidence
        given = estimate_pose(images, camera, height_m=2.6)
        assert given.state == ESTIMATED
        assert given.confidence_shift == given.height_std_m == 0.0

    @pytest.fixture(scope="class")
    def errors_in_std(self) -> dict[str, list[float]]:
        """Of three cameras in any pose: errors divided by the stated deviations."""
        rng = np.random.default_rng(8)
        errors: dict[str, list[float]] = {}
        for seed in range(3):
            pose = CameraPose(
                rng.uniform(1.1, 1.7),
                *np.radians(rng.uniform([-5, -3, -1.5], [5, 3, 1.5])),
            )
            camera = Camera.from_fov((1280, 720), rng.uniform(50, 80), pose)
            images = [
                paint_motorway(camera, offset_m=rng.normal(0, 0.3), seed=seed + i)
                for i in range(2)
            ]
            estimate = estimate_pose(images, camera)
            for name in ("height_m", "pitch_rad", "yaw_rad", "roll_rad"):
                std = getattr(estimate, name.replace("_", "_std_"))
                error = getattr(estimate.pose, name) - getattr(pose, name)
                errors.setdefault(name, []).append(error / std)
        return errors

    @pytest.mark.parametrize("name", ["height_m", "pitch_rad", "yaw_rad", "roll_rad"])
    def test_errors_stay_within_three_standard_deviations(self, errors_in_std, name):
        assert np.abs(errors_in_std[name]).max() < 3

    def test_the_deviations_of_eight_images_are_as_small_as_they_should_be(self):
        """They are two thirds of these bounds."""
        camera = dashcam()
        images = [paint_motorway(camera, seed=seed) for seed in range(8)]
        estimate = estimate_pose(images, camera)
        assert estimate.height_std_m < 0.05
        assert np.degrees(estimate.pitch_std_rad) < 0.08
        assert np.degrees(estimate.yaw_std_rad) < 0.3
        assert np.degrees(estimate.roll_std_rad) < 0.7


def test_the_camera_keeps_the_deviations_of_its_pose():
    """A camera in a lorry: the height's is a share of it."""
    camera = dashcam(height_m=2.5)
    images = [paint_motorway(camera, seed=seed) for seed in range(3)]
    estimate = estimate_pose(images, camera)
    kept = estimate.camera.pose_std
    height_std_m = kept.height_share * estimate.pose.height_m
    assert height_std_m == pytest.approx(estimate.height_std_m)
    assert kept.roll_rad == estimate.roll_std_rad


def estimated(camera: Camera, **changes) -> PoseEstimate:
    """The estimate of a drive in whose images many lanes were likely."""
    known = PoseEstimate(
        camera=camera,
        height_std_m=0.05,
        pitch_std_rad=0.002,
        yaw_std_rad=0.005,
        roll_std_rad=0.01,
        frames_used=20,
        frames_total=24,
        lane_width_m=3.66,
    )
    return replace(known, **changes)


def test_an_image_keeps_height_and_roll_of_its_drive():
    """The image alone would show 1.35 m or a multiple of it, and no roll."""
    drive_camera = posed(height_m=1.5, roll_rad=2.0)
    image = paint_motorway(drive_camera, offset_m=0.3)
    own = estimate_in_drive(image, drive_camera, estimated(drive_camera), DETECTOR)
    assert own.still.confidence > 0.5
    assert (own.pose.height_m, own.height_std_m) == (1.5, 0.05)
    assert own.pose.roll_rad == drive_camera.pose.roll_rad


def test_an_image_of_a_drive_shows_a_camera_that_was_knocked():
    """By 3 degrees, down and to the left."""
    drive_camera = posed(roll_rad=0.0)
    pitch_deg, yaw_deg = np.degrees([TRUE_POSE.pitch_rad, TRUE_POSE.yaw_rad]) + 3.0
    knocked = posed(pitch_rad=pitch_deg, yaw_rad=yaw_deg, roll_rad=0.0)
    image = paint_motorway(knocked)
    own = estimate_in_drive(image, drive_camera, estimated(drive_camera), DETECTOR)
    assert np.degrees(own.pose.pitch_rad) == pytest.approx(pitch_deg, abs=1.0)
    assert np.degrees(own.pose.yaw_rad) == pytest.approx(yaw_deg, abs=1.5)


def test_an_image_of_a_drive_without_lanes_has_a_height_of_its_own():
    drive_camera = posed(height_m=2.0)
    assumed = estimated(drive_camera, frames_used=0, lane_width_m=None)
    own = estimate_in_drive(paint_motorway(CAMERA), drive_camera, assumed, DETECTOR)
    assert own.pose.height_m == pytest.approx(1.35, abs=0.1)


@pytest.mark.slow
def test_a_camera_that_looks_far_down_and_aside_is_found_by_wider_votes():
    camera = posed(pitch_rad=19, yaw_rad=18, roll_rad=0)
    estimate = estimate_pose(drive(camera, (0.0,) * 3), camera)
    assert estimate.state == ESTIMATED
    assert_near(
        estimate, camera.pose, pitch_deg=0.5, yaw_deg=1.0, roll_deg=1.5, height_m=0.2
    )


@pytest.mark.slow
class TestOneImage:
    def test_the_pose_is_that_of_the_lane_which_is_kept_with_it(self):
        image = paint_motorway(CAMERA, offset_m=0.3, curvature_per_m=1 / 600)
        estimate = estimate_pose(image, CAMERA)
        assert_near(
            estimate, TRUE_POSE, pitch_deg=0.4, yaw_deg=0.8, roll_deg=1.0, height_m=0.1
        )
        assert any("heading" in note for note in estimate.notes)
        assert estimate.yaw_std_rad > np.radians(0.5)
        assert estimate.still.camera is estimate.camera
        assert estimate.still.lane.single_image_pose
        assert estimate.still.lane.same_lane_share == 1.0
        assert estimate.still.lane.offset_m == pytest.approx(0.3, abs=0.1)

    def test_a_pose_from_edges_says_so_and_that_the_height_is_assumed(self):
        camera = Camera.from_fov((1920, 1280), 62, CameraPose(1.5, np.radians(3.0)))
        estimate = estimate_pose([paint_street(camera, lines=(0,))], camera)
        assert np.degrees(estimate.pose.pitch_rad) == pytest.approx(3.0, abs=1.0)
        assert estimate.pose.roll_rad == 0.0
        assert abs(estimate.pose.height_m - 1.5) < 2 * estimate.height_std_m
        assert "(assumed)" in estimate.describe()
        assert "height and roll are assumed" in estimate.notes[0]
        assert "25% (the height is assumed)" in estimate.describe_accuracy()
        assert (
            estimate_pose(paint_street(camera), camera, height_m=1.6).pose.height_m
            == 1.6
        )


@pytest.mark.slow
def test_files_folders_patterns_and_images_give_the_same_pose(tmp_path):
    images = drive(CAMERA, (0.0,) * 2)
    files = [
        write_image(tmp_path / f"{number}.png", image)
        for number, image in enumerate(images)
    ]
    expected = estimate_pose(images, CAMERA).pose
    for source in (str(tmp_path / "*.png"), map(str, files)):
        assert estimate_pose(source, CAMERA).pose == expected
    assert estimate_pose(files, CAMERA, max_pictures=1).frames_total == 1


# Without lanes the pose is that of the edges and of the usual camera, and the notes say
# why.


@pytest.mark.slow
@pytest.mark.parametrize("lines", [(), None], ids=["unmarked", "black"])
def test_images_without_lanes(lines):
    image = (
        np.zeros((720, 1280, 3), np.uint8)
        if lines is None
        else paint_motorway(CAMERA, lines=lines)
    )
    estimate = estimate_pose([image] * 3, CAMERA)
    assert estimate.lane_width_m is None
    assert estimate.height_std_m > 0.2
    assert estimate.notes[0].startswith("only 0 of 3 pictures show a likely lane")


@pytest.mark.slow
def test_edges_far_from_ahead_are_not_believed_without_lanes():
    """The spread then is that of any camera, and covers the truth."""
    camera = Camera.from_fov(
        (1280, 720), 62, CameraPose(1.5, *np.radians([-8.0, -10.0]))
    )
    estimate = estimate_pose([paint_street(camera)] * 2, camera)
    assert estimate.state == ASSUMED
    assert "0 of 2 used, the pose is assumed" in estimate.describe()
    assert np.degrees([estimate.pitch_std_rad, estimate.yaw_std_rad]) == pytest.approx(
        [6, 10]
    )
    assert estimate.pose.pitch_rad == estimate.pose.yaw_rad == 0


REFUSED = {
    "no picture was given": (PoseError, [], {}),
    "picture 2: is 640x360": (
        PictureError,
        [np.zeros((n, n * 16 // 9, 3), np.uint8) for n in (720, 360)],
        {},
    ),
    "lane 12 m wide": (PoseError, [], {"lane_width_m": 12}),
    "camera 0.1 m above": (PoseError, [], {"height_m": 0.1}),
    "32x18 pixels are too small": (
        PoseError,
        np.zeros((18, 32, 3), np.uint8),
        {"camera": CAMERA.scaled((32, 18))},
    ),
    "there is no such file": (FileNotFoundError, "nothing.mp4", {}),
}


@pytest.mark.parametrize("named", REFUSED)
def test_bad_input_is_named(named):
    error, source, options = REFUSED[named]
    with pytest.raises(error, match=named):
        estimate_pose(source, **{"camera": CAMERA, **options})


def test_description_words_the_signs_and_gives_standard_deviations():
    camera = CAMERA.with_pose(CameraPose(1.32, np.radians(1.8), np.radians(-1.36), 0.0))
    estimate = PoseEstimate(
        camera, 0.04, 0.001, 0.002, 0.0175, 12, 40, 3.66, ("roll <unknown>",)
    )
    assert estimate.describe().splitlines() == [
        "height   1.32 ± 0.04 m (lane 3.66 m wide)",
        "pitch    1.80 ± 0.06 deg (looks down)",
        "yaw      -1.36 ± 0.11 deg (looks right)",
        "roll     0.00 ± 1.00 deg",
        "pictures 12 of 40 used",
        "note: roll <unknown>",
    ]
    assert repr(estimate).startswith(
        "PoseEstimate(height 1.32 ± 0.04 m (lane 3.66 m wide), pitch 1.80 ± 0.06 deg "
    )
