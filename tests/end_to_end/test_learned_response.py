"""The learned marking response of `tools.learned_response`, and the samples that it is trained on."""

from __future__ import annotations

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraPose
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.markings import extract_evidence, marking_weight
from tests.support.painted_roads import ASPHALT, YELLOW, Road, dashcam
from tests.support.project import ROOT
from tools.learned_response import NETWORK, extract_learned_evidence, finer_view, network_inputs
from tools.marking_samples import UNKNOWN, label_cells, take_sample

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
STILL = ROOT / "test_images" / "straight_lines1.jpg"
# Both lines of a lane.
LEFT_M, RIGHT_M = 1.8, -1.7


def lane(road: Road, **look: object) -> np.ndarray:
    """Picture of a road with both lines."""
    for lateral_m in (LEFT_M, RIGHT_M):
        road.line(lambda x, y=lateral_m: y + 0 * x, **look)
    return road.image()


def stripes_of(image: np.ndarray, far_m: float = 30.0):
    stripes = extract_learned_evidence(image, VIEW).stripes
    return stripes.select(stripes.x_m < far_m)


def on_lines(stripes, within_m: float = 0.1) -> np.ndarray:
    return np.minimum(np.abs(stripes.y_m - LEFT_M), np.abs(stripes.y_m - RIGHT_M)) < within_m


def found_rows(stripes) -> float:
    """Share of the rows up to 20 m that have a candidate on the left line, weighted."""
    near = stripes.select((np.abs(stripes.y_m - LEFT_M) < 0.1) & (stripes.x_m < 20))
    weight = np.zeros(len(VIEW.x_m))
    np.maximum.at(weight, near.row, marking_weight(near))
    return weight[VIEW.x_m < 20].mean()


def test_the_finer_view_has_three_rows_at_each_row():
    fine = finer_view(VIEW)
    assert fine.shape == (NETWORK.fine_rows * VIEW.shape[0], VIEW.shape[1])
    np.testing.assert_allclose(fine.x_m[1 :: NETWORK.fine_rows], VIEW.x_m, rtol=1e-9)
    np.testing.assert_array_equal(fine.y_m, VIEW.y_m)


@pytest.mark.parametrize("look", [{}, {"colour": YELLOW}, {"width_m": 0.2}, {"dash_m": (3, 12)}])
def test_candidates_lie_on_the_lines(look):
    stripes = stripes_of(lane(Road(CAMERA), **look))
    assert found_rows(stripes) > (0.2 if "dash_m" in look else 0.9)
    weight = marking_weight(stripes)
    assert weight @ on_lines(stripes) > 0.95 * weight.sum()


def test_positions_are_as_exact_as_those_of_the_band_filter():
    stripes = stripes_of(lane(Road(CAMERA)), far_m=20)
    error_m = stripes.y_m - np.where(stripes.y_m > 0, LEFT_M, RIGHT_M)
    assert np.median(np.abs(error_m[np.abs(error_m) < 0.1])) < 0.01


def test_a_faint_line_is_seen_better_than_by_the_band_filter():
    faint = tuple(np.add(ASPHALT, 9))
    image = lane(Road(CAMERA, noise=5.0), colour=faint)
    band = extract_evidence(VIEW.warp(image), VIEW).stripes
    assert found_rows(stripes_of(image)) > 2 * found_rows(band)


def test_a_faint_streak_on_a_smooth_road_is_no_paint():
    """As clear relative to the noise as paint, but hardly brighter than the road: the third input of the network."""
    streak = lane(Road(CAMERA, noise=0.3), colour=tuple(np.add(ASPHALT, 3)))
    paint = lane(Road(CAMERA, noise=0.3))
    assert found_rows(stripes_of(streak)) < 0.3 < 0.9 < found_rows(stripes_of(paint))


@pytest.mark.parametrize("gain", [0.5, 1.15])
def test_the_exposure_hardly_matters(gain):
    image = lane(Road(CAMERA))
    exposed = np.clip(image * gain, 0, 255).astype(np.uint8)
    assert found_rows(stripes_of(exposed)) == pytest.approx(found_rows(stripes_of(image)), abs=0.1)


def test_a_dark_seam_and_the_edge_of_a_shadow_are_no_paint():
    road = Road(CAMERA).line(lambda x: 0.3 + 0 * x, colour=(45, 45, 45), width_m=0.1)
    image = road.shade(lambda x, y: (y > LEFT_M) & (y < 6), 0.35).image()
    assert marking_weight(stripes_of(image)).sum() < 2


def test_the_mirrored_picture_has_the_mirrored_response():
    matrix = CAMERA.matrix.copy()
    matrix[0, 2] = CAMERA.width - 1 - matrix[0, 2]
    pose = CAMERA.pose
    other = Camera(
        *CAMERA.size,
        matrix,
        CAMERA.distortion * [1, 1, 1, -1, 1],
        CameraPose(pose.height_m, pose.pitch_rad, -pose.yaw_rad),
    )
    image = lane(Road(CAMERA), dash_m=(3, 12))
    seen = extract_learned_evidence(image, VIEW).response.strength
    mirror = extract_learned_evidence(np.ascontiguousarray(image[:, ::-1]), BirdsEyeView(other)).response.strength
    weight, mirrored = (s**2 / (s**2 + 44) for s in (seen, mirror[:, ::-1]))
    # the remap rounds to 1/32 pixel, which is not symmetric
    assert np.abs(weight - mirrored).mean() < 0.002


def test_the_inputs_of_a_uniform_picture_are_zero():
    inputs = network_inputs(np.full((30, 101, 3), 90, np.uint8), 0.05)
    assert inputs.shape == (3, 30, 101) and inputs.dtype == np.float32
    assert not inputs.any()


def test_nothing_is_found_outside_the_picture():
    strength = extract_learned_evidence(lane(Road(CAMERA)), VIEW).response.strength
    assert strength.shape == VIEW.shape
    assert not strength[~VIEW.seen].any()


def test_cells_are_labelled_where_pictures_with_and_without_lines_differ():
    """Cells with paint are 1 within the width of the line, and 0 elsewhere; a brighter exposure changes nothing."""
    fine, bare = finer_view(VIEW), Road(CAMERA, noise=0.0).image()
    painted = cv2.convertScaleAbs(lane(Road(CAMERA, noise=0.0)), alpha=1.05)
    label = label_cells(fine.warp(painted), fine.warp(bare))
    assert label.shape == VIEW.shape
    rows = VIEW.x_m < 20
    beside_m = np.minimum(np.abs(VIEW.y_m - LEFT_M), np.abs(VIEW.y_m - RIGHT_M))
    seen = VIEW.seen[rows]
    assert np.all(label[rows][:, beside_m < 0.03][seen[:, beside_m < 0.03]] == 1)
    assert np.all(label[rows][:, beside_m > 0.4][seen[:, beside_m > 0.4]] == 0)


@pytest.mark.slow
def test_samples_are_the_same_in_each_run():
    first, again = (take_sample(9) for _ in range(2))
    np.testing.assert_array_equal(first.fine_image, again.fine_image)
    np.testing.assert_array_equal(first.label, again.label)
    assert set(np.unique(first.label)) == {0, 1, UNKNOWN}
    assert 0.003 < (first.label == 1).mean() < 0.1


def test_samples_without_a_road_have_no_paint():
    sample = take_sample(10)
    assert set(np.unique(sample.label)) <= {0, UNKNOWN} and 0 in sample.label


@pytest.mark.slow
def test_a_command_runs_with_the_learned_response(tmp_path):
    """On a clear road `detect` finds the lane of the band filter, a little elsewhere."""
    columns = []
    for program in (("tools.learned_response", "lanes"), ("lanes",)):
        output = tmp_path / f"{program[0]}.jsonl"
        command = [sys.executable, "-m", *program, "detect", "--each", str(STILL), "-o", str(output)]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        columns.append(np.array(json.loads(output.read_text(encoding="utf-8"))["lanes"]))
    learned, band = columns
    both = (learned >= 0) & (band >= 0)
    assert both.mean() > 0.5
    assert 0 < np.abs(learned - band)[both].max() < 15
