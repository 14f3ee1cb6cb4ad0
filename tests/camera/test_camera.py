"""The camera: signs of the pose, projections between pixels and road, sizes, undistortion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lanes.camera import Camera, CameraPose, undistort
from lanes.errors import CameraError, PictureError
from simulator.scenes.dashcam import DASHCAM

CENTRE = np.array([[667.4, 386.1]])
picture_points = st.tuples(st.floats(0, 1279), st.floats(0, 719))
poses = st.builds(
    CameraPose,
    height_m=st.floats(0.8, 3),
    pitch_rad=st.floats(-0.1, 0.3),
    yaw_rad=st.floats(-0.3, 0.3),
    roll_rad=st.floats(-0.2, 0.2),
)


def see(pose: CameraPose, point_m: tuple[float, float, float]) -> np.ndarray:
    """Where a camera without distortion, centre (639.5, 359.5), sees a point of the road frame."""
    return Camera.from_fov((1280, 720), 60, pose).road_to_pixels(np.array([point_m]))[0]


# --- signs -----------------------------------------------------------------------------------------------------------


def test_level_camera_sees_the_point_ahead_at_its_height_in_the_middle():
    np.testing.assert_allclose(see(CameraPose(1.5), (20, 0, 1.5)), (639.5, 359.5), atol=1e-9)


def test_left_is_left_and_the_road_is_below_the_horizon():
    u, v = see(CameraPose(1.5), (20, 2, 0))
    assert u < 639.5 and v > 359.5


def test_positive_pitch_looks_down_so_the_horizon_rises():
    _, v = see(CameraPose(1.5, pitch_rad=0.05), (20, 0, 1.5))
    focal_px = 640 / np.tan(np.radians(30))
    np.testing.assert_allclose(v, 359.5 - focal_px * np.tan(0.05), atol=1e-9)


def test_positive_yaw_looks_left_so_what_is_ahead_moves_right():
    u, _ = see(CameraPose(1.5, yaw_rad=0.05), (20, 0, 1.5))
    focal_px = 640 / np.tan(np.radians(30))
    np.testing.assert_allclose(u, 639.5 + focal_px * np.tan(0.05), atol=1e-9)


def test_positive_roll_has_the_right_side_down_so_the_horizon_falls_to_the_left():
    left, right = (see(CameraPose(1.5, roll_rad=0.05), (20, y, 1.5)) for y in (5, -5))
    assert left[0] < right[0]
    np.testing.assert_allclose((left[1] - right[1]) / (right[0] - left[0]), np.tan(0.05), atol=1e-9)


@given(poses)
def test_rotation_is_orthonormal(pose):
    rotation = pose.rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0


@pytest.mark.parametrize("bad", [{"height_m": 0.0}, {"height_m": -1.0}, {"height_m": 1.3, "pitch_rad": np.nan}])
def test_impossible_pose_is_refused(bad):
    with pytest.raises(CameraError, match="height must be positive"):
        CameraPose(**bad)


# --- projections -----------------------------------------------------------------------------------------------------


@given(picture_points)
def test_distort_undoes_undistort(point):
    there = DASHCAM.undistort_points(np.array([point]))
    np.testing.assert_allclose(DASHCAM.distort_points(there)[0], point, atol=1e-5)


def test_undistort_points_moves_corners_outward_for_a_barrel_lens():
    corner = np.array([[0.0, 0.0]])
    assert np.linalg.norm(DASHCAM.undistort_points(corner) - CENTRE) > np.linalg.norm(corner - CENTRE) + 20
    np.testing.assert_allclose(DASHCAM.undistort_points(CENTRE), CENTRE, atol=1e-9)


def test_distortion_follows_brown_and_conrady():
    """The polynomial written out by hand for one ray."""
    k1, k2, p1, p2, k3 = DASHCAM.distortion
    x, y = 0.4, -0.2
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    seen = (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )
    pixel = DASHCAM.matrix[:2, :2] @ seen + DASHCAM.matrix[:2, 2]
    np.testing.assert_allclose(DASHCAM.rays(pixel[None])[0], (x, y, 1), atol=1e-8)


@given(poses, st.floats(4, 60), st.floats(-6, 6))
def test_road_to_pixels_and_back(pose, x_m, y_m):
    camera = DASHCAM.with_pose(pose)
    pixel = camera.road_to_pixels(np.array([[x_m, y_m]]))
    if np.isnan(pixel).any() or not ((pixel >= 0) & (pixel <= [1279, 719])).all():
        return
    np.testing.assert_allclose(camera.pixels_to_road(pixel)[0], (x_m, y_m), rtol=1e-4, atol=1e-4)


def test_sky_and_points_behind_the_camera_give_nan():
    assert np.isnan(DASHCAM.pixels_to_road(np.array([[640.0, 20.0]]))).all()
    assert np.isnan(DASHCAM.road_to_pixels(np.array([[-5.0, 0.0]]))).all()


def test_rays_beyond_the_monotonic_range_of_the_distortion_give_nan():
    folding = Camera(1280, 720, DASHCAM.matrix, np.array([-0.3, 0, 0, 0, 0]), CameraPose(1.3))
    assert folding.largest_ray == pytest.approx(np.sqrt(1 / 0.9))
    assert np.isnan(folding.road_to_pixels(np.array([[2.0, 8.0]]))).all()
    assert Camera.from_fov((640, 480), 60).largest_ray == np.inf


def test_a_camera_without_pose_is_refused():
    with pytest.raises(CameraError, match="no pose"):
        Camera.from_fov((640, 480), 60).pixels_to_road(np.zeros((1, 2)))


# --- sizes -----------------------------------------------------------------------------------------------------------


def test_scaled_camera_has_the_same_ray_at_the_same_share_of_the_picture():
    half = DASHCAM.scaled((640, 360))
    pixels = np.array([[100.0, 50.0], [1200.0, 700.0]])
    np.testing.assert_allclose(half.rays((pixels + 0.5) / 2 - 0.5), DASHCAM.rays(pixels), atol=1e-9)


def test_another_aspect_ratio_cannot_be_rescaled():
    with pytest.raises(CameraError, match="640x480 picture has another aspect ratio than the calibrated 1280x720"):
        DASHCAM.scaled((640, 480))


@pytest.mark.parametrize("fov", [0, 5, 180])
def test_impossible_field_of_view_is_refused(fov):
    with pytest.raises(CameraError, match=f"{fov} degrees"):
        Camera.from_fov((640, 480), fov)


def test_undistort_makes_a_bent_line_straight():
    """A straight line of the world at v = 80 of the ideal picture, painted where the lens shows it."""
    ideal = np.column_stack([np.arange(-100, 1400, 0.25), np.full(6000, 80.0)])
    seen = np.round(DASHCAM.distort_points(ideal)).astype(int)
    inside = ((seen >= [0, 2]) & (seen < [1280, 718])).all(axis=1)
    image = np.zeros((720, 1280, 3), np.uint8)
    for dv in (-2, -1, 0, 1, 2):
        image[seen[inside, 1] + dv, seen[inside, 0]] = 255
    rows = np.arange(720)[:, None]

    def centre(picture: np.ndarray) -> np.ndarray:
        weight = picture[:, 100:1180, 0].astype(float)
        return (weight * rows).sum(axis=0) / weight.sum(axis=0)

    assert np.ptp(centre(image)) > 20
    straight = undistort(image, DASHCAM)
    assert straight.shape == image.shape and straight.dtype == np.uint8
    np.testing.assert_allclose(centre(straight), 80, atol=0.6)


def test_undistort_refuses_another_size_unless_asked_to_rescale():
    small = np.full((360, 640, 3), 90, np.uint8)
    with pytest.raises(
        PictureError, match="640x360 pixels, .* for 1280x720; .*rescale=True in undistort.*camera.scaled"
    ):
        undistort(small, DASHCAM)
    assert undistort(small, DASHCAM, rescale=True).shape == (360, 640, 3)
    with pytest.raises(CameraError, match="another aspect ratio"):
        undistort(np.zeros((480, 640, 3), np.uint8), DASHCAM, rescale=True)
