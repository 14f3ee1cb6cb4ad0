"""A finder of one's own: how it is named, loaded and scored."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest

from benchmark.estimates import ALONG_M
from benchmark.evaluation import score_video
from benchmark.own_finder import estimate_from_lines, load_finder
from benchmark.scored_drive import PROJECT_ROOT
from benchmark.systems import column_detector, source_files
from lanes.camera import Camera, CameraPose
from lanes.files import read_telemetry
from tests.benchmark.test_systems import estimator

CAMERA = Camera.from_fov((1280, 720), 60, CameraPose(1.4, pitch_rad=0.0))
VIDEO = PROJECT_ROOT / "test_videos" / "project_video.mp4"
IMAGE = np.zeros((720, 1280, 3), np.uint8)
STRAIGHT = "def find(image, camera):\n    return (0.0, 1.9), (0.0, -1.7)\n"
# Its lane is one metre farther to the left in each further frame.
COUNTING = """
frames = []

def find(image, camera):
    frames.append(image)
    return (0.0, len(frames) + 1.8), (0.0, len(frames) - 1.8)
"""


def test_polynomials_become_an_estimate():
    estimate = estimate_from_lines([(0.001, 0.02, 1.6), (0.001, 0.02, -2.0)])
    assert estimate.lines_m[:, ALONG_M == 10].ravel() == pytest.approx([10.0, 1.9, 10.0, -1.7])
    assert estimate.offset_m == pytest.approx(0.2)
    assert estimate.heading_rad == pytest.approx(0.02, rel=1e-3)
    assert estimate.curvature_per_m == pytest.approx(0.002, rel=1e-3)
    assert estimate_from_lines(None).lines_m is None
    with pytest.raises(ValueError, match="two lines or None, but this one returned 1"):
        estimate_from_lines([(0.0, 1.0)])


def test_a_finder_in_a_file_is_a_system(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(STRAIGHT)
    system = f"{file}:find"
    assert estimator(system, CAMERA)(IMAGE).offset_m == pytest.approx(-0.1)
    left, right = column_detector(system, CAMERA)(IMAGE, np.array([300, 600]))
    assert (left[0], right[0]) == (-2, -2)
    u, v = CAMERA.road_to_pixels([[10.0, 1.9]])[0]
    assert column_detector(system, CAMERA)(IMAGE, np.array([v]))[0] == pytest.approx(u, abs=0.5)
    assert file in source_files(system)


def test_each_drive_starts_with_the_file_as_it_is_now_and_no_memory(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(COUNTING)
    for _ in range(2):
        assert estimator(f"{file}:find", CAMERA)(IMAGE).offset_m == pytest.approx(-1.0)
    file.write_text(STRAIGHT)
    assert estimator(f"{file}:find", CAMERA)(IMAGE).offset_m == pytest.approx(-0.1)


@pytest.mark.parametrize(
    ("content", "name", "message"),
    [
        (None, "find", "no such file"),
        ("1 / 0", "find", "ZeroDivisionError"),
        ("find = 3", "find", "no function 'find'"),
    ],
)
def test_a_wrong_file_is_named(tmp_path, content, name, message):
    file = tmp_path / "wrong.py"
    if content:
        file.write_text(content)
    with pytest.raises(ValueError, match=message):
        load_finder(f"{file}:{name}")


def test_the_score_of_the_truth_is_full_and_of_a_shifted_lane_is_none():
    truth = read_telemetry(VIDEO.with_suffix(".csv"))

    def finder(shift_m: float):
        frames = count(step=5)

        def find(image, camera):
            k, x_m = next(frames), (5, 10, 15, 20)
            lines_m = ([truth[f"{side}_y{x:02d}_m"][k] + shift_m for x in x_m] for side in ("left", "right"))
            return [np.polyfit(x_m, line_m, 3) for line_m in lines_m]

        return find

    row = score_video(VIDEO, finder(0.0), end_s=2, every=5, name="truth")
    assert (row["system"], row["frames"], row["accuracy"]) == ("truth", 10, 1.0)
    assert score_video(VIDEO, finder(0.4), end_s=2, every=5, name="shifted")["accuracy"] == 0
