"""Images that repeat the last one: copied frames, and a camera that hangs; also if a
codec has changed the copies.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
import pytest

import lanes
from lanes.detect.lane import FROZEN, TRACKING, Lane
from lanes.tracking.repeated import RepeatedImages
from lanes.tracking.tracker import LaneTracker
from tests.support.clips import encode
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import ROOT

# The last image before the camera hangs, and how often it is repeated.
LAST = 25
REPEATED = 75
FPS = 25.0


def test_a_frame_rate_doubled_by_copies_gives_the_lane_of_the_original():
    original = LaneTracker(SMALL, fps=25)
    copied = LaneTracker(SMALL, fps=50)
    for number in range(30):
        image = BENDS.frame(number / 25)
        lane = original.update(image)
        copied.update(image)
        of_copy = copied.update(image.copy())
        np.testing.assert_allclose(of_copy.model, lane.model, rtol=0, atol=1e-9)
        np.testing.assert_allclose(of_copy.fit_covariance, lane.fit_covariance)


@pytest.fixture(scope="module")
def hanging() -> list[Lane | None]:
    """The lane before the camera hangs, and in each repeated image."""
    tracker = LaneTracker(SMALL, fps=FPS)
    for number in range(LAST + 1):
        lane = tracker.update(BENDS.frame(number / FPS))
    image = BENDS.frame(LAST / FPS)
    return [lane, *(tracker.update(image) for _ in range(REPEATED))]


def test_a_copy_does_not_change_the_lane_for_half_a_second(hanging):
    assert all(lane is hanging[0] for lane in hanging[: round(0.5 * FPS)])


def test_a_picture_that_stands_still_is_no_measurement(hanging):
    frozen = [lane for lane in hanging if lane and lane.state == FROZEN]
    stds_m = [lane.offset_std_m for lane in (hanging[0], *frozen)]
    assert (np.diff(stds_m) > 0).all()
    assert frozen[0].confidence < 0.9
    assert not any(line.seen for line in frozen[0].lines)


def test_a_picture_that_stands_still_ends_without_a_lane(hanging):
    assert hanging[-1] is None


def test_the_lane_is_tracked_again_when_the_picture_moves():
    tracker = LaneTracker(SMALL, fps=FPS)
    for number in range(LAST):
        tracker.update(BENDS.frame(number / FPS))
    for _ in range(round(0.6 * FPS)):
        lane = tracker.update(BENDS.frame((LAST - 1) / FPS))
    assert lane.state == FROZEN
    # the camera goes on with the images of now
    for number in range(5):
        lane = tracker.update(BENDS.frame(LAST / FPS + 0.6 + number / FPS))
    assert lane.state == TRACKING


def test_images_in_the_same_array_are_no_repeated_image():
    tracker = LaneTracker(SMALL, fps=FPS)
    buffer = np.empty_like(BENDS.frame(0.0))
    for number in range(25):
        buffer[:] = BENDS.frame(number / FPS)
        lane = tracker.update(buffer)
    assert lane.state == TRACKING
    assert all(line.seen for line in lane.lines)


# Copies that a codec has changed.


def landscape(zoom: float, seed: int, *, noise_std: float = 2.0) -> np.ndarray:
    """What a camera sees after it came nearer by a factor, with noise of its own."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.normal(128, 400, (360, 640)), (0, 0), 2)
    centre = (320, 180)
    to_image = cv2.getRotationMatrix2D(centre, 0, zoom)
    image = cv2.warpAffine(texture, to_image, (640, 360), borderMode=cv2.BORDER_WRAP)
    noise = np.random.default_rng(seed).normal(0, noise_std, image.shape)
    return np.dstack([np.clip(image + noise, 0, 255).astype(np.uint8)] * 3)


def are_repeated(images: Iterable[np.ndarray], step_s: float = 1 / FPS) -> list[bool]:
    """Which of the images are taken for copies."""
    repeated = RepeatedImages()
    return [repeated.repeats(image, step_s) for image in images]


def test_every_sixth_frame_is_a_copy_of_25_frames_shown_as_30(tmp_path):
    """Of the first six frames five show how fast the drive is."""
    numbers = np.arange(36)
    shown = numbers - numbers // 6
    images = [landscape(1.02**number, seed=number) for number in shown.tolist()]
    video = encode(tmp_path / "copies.mp4", images, fps=30)
    is_copy = np.diff(shown, prepend=-1) == 0
    assert are_repeated(lanes.read_video(video)) == is_copy.tolist()


def test_a_car_that_brakes_to_a_stop_repeats_no_image():
    """With 8 m/s^2 from 25 m/s; what it sees is 20 m away, and it stands at the end."""
    speeds_mps = np.maximum(25.0 - 8.0 * np.arange(0.0, 4.2, 1 / FPS), 0.0)
    driven_m = np.cumsum(speeds_mps / FPS)
    zooms = np.exp(driven_m / 20.0)
    images = [landscape(zoom % 4, seed) for seed, zoom in enumerate(zooms)]
    assert not any(are_repeated(images))


def test_a_slow_camera_may_stop_from_one_image_to_the_next():
    zooms = 1.02 ** np.minimum(np.arange(12), 8)
    images = [landscape(zoom, seed, noise_std=0.4) for seed, zoom in enumerate(zooms)]
    assert not any(are_repeated(images, step_s=0.2))
    assert any(are_repeated(images))


def test_a_coded_picture_that_stands_still_ends_without_a_lane(tmp_path):
    """As a camera that hangs is recorded: 3 s of one image of a drive."""
    source = ROOT / "test_videos" / "project_video.mp4"
    images = list(lanes.read_video(source, end_s=0.6))
    count = len(images)
    images += [images[-1]] * round(3.0 * FPS)
    video = encode(tmp_path / "hanging.mp4", images, fps=FPS)

    camera = lanes.load_camera(source.with_suffix(".yaml"))
    found = [lane.state if lane else None for _, lane in lanes.track(video, camera)]
    assert found[count - 1] == TRACKING
    assert TRACKING not in found[count + round(0.6 * FPS) :]
    assert found[-1] is None
