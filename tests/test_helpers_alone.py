"""helpers.py can be taken along: a copy beside board images does the whole project."""

import ast
import json
import subprocess
import sys
from shutil import copy, copytree

import numpy as np
import pytest
from pytest import approx

from lanes.files import read_telemetry
from lanes.video.reader import inspect_video
from tests.support.project import ROOT, names

LIBRARIES = {"cv2", "numpy", "moviepy"}
SECONDS = 2.0

# A student's notebook in one file. Its last line tells what it measured.
NOTEBOOK = """
import json
import sys

sys.path.insert(0, ".")
import helpers

for package in ("lanes", "course", "benchmark", "simulator"):
    try:
        __import__(package)
        raise SystemExit(f"{package} can be imported")
    except ModuleNotFoundError:
        pass

lens = helpers.calibrate("camera_cal")
image_to_road = helpers.road_homography(
    lens, height_m=1.32, pitch_rad=-0.0314, yaw_rad=-0.0237, roll_rad=0.007
)
recipe = helpers.get_recipe("equalized_hsv", lens.size)
recipe = helpers.recipe_from_pose(recipe, image_to_road)

# step by step on a still
image = helpers.read_image("still.jpg")
flat = helpers.undistort(image, lens)
mask = recipe.thresholds.masks(flat)["combined"]
warp = recipe.four_point_warp()
view = warp.image_to_birdseye(mask)
search = helpers.sliding_windows(view, margin_px=recipe.margin_px)
fits = [helpers.fit_line(pixels) for pixels in search.pixels]


def to_road(points_px):
    return helpers.birdseye_to_road(points_px, warp, image_to_road)


lines = [helpers.road_line(fit, to_road, 720) for fit in fits]
still_offset_m = -(lines[0].c0_m + lines[1].c0_m) / 2
drawn = helpers.draw_windows(view, search.windows[0])
helpers.write_image("output_images/windows.png", drawn)

# and the video, with memory
finder = helpers.LaneFinder(recipe, lens, image_to_road)
frames = helpers.process_video(
    "project_video.mp4",
    "output_images/project_video.mp4",
    helpers.follow_lane(finder),
    end_s=%s,
    telemetry="output_images/project_video.csv",
)
print(json.dumps({"frames": frames, "still_offset_m": still_offset_m}))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with nothing of ours but helpers.py, after the notebook has run."""
    folder = tmp_path_factory.mktemp("alone")
    copy(ROOT / "helpers.py", folder)
    copytree(ROOT / "camera_cal", folder / "camera_cal")
    copy(ROOT / "test_images" / "test2.jpg", folder / "still.jpg")
    copy(ROOT / "test_videos" / "project_video.mp4", folder)
    (folder / "notebook.py").write_text(NOTEBOOK % SECONDS)
    # -I: without PYTHONPATH, the folder of this project and the user's packages
    command = [sys.executable, "-I", "notebook.py"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, ""), run.stdout + run.stderr
    (folder / "told.json").write_text(run.stdout.splitlines()[-1])
    return folder


def told(folder):
    return json.loads((folder / "told.json").read_text())


def test_the_project_video_has_all_frames_and_nothing_is_left_over(folder):
    info = inspect_video(folder / "output_images" / "project_video.mp4")
    assert told(folder)["frames"] == info.frames == 50
    assert (info.width, info.height, info.fps) == (1280, 720, 25)
    written = {"project_video.csv", "project_video.mp4", "windows.png"}
    assert names(folder / "output_images") == written


def test_the_offsets_of_the_video_are_those_of_the_truth(folder):
    truth = read_telemetry(ROOT / "test_videos" / "project_video.csv")
    measured = read_telemetry(folder / "output_images" / "project_video.csv")
    assert (measured["frame"] == truth["frame"][:50]).all()
    errors_m = np.abs(measured["offset_m"] - truth["offset_m"][:50])
    assert np.isfinite(errors_m).all()
    assert np.median(errors_m) < 0.1
    assert errors_m.max() < 0.3


def test_the_offset_of_the_still_is_that_of_the_truth(folder):
    truth = json.loads((ROOT / "test_images" / "truth.json").read_text())
    frames = {frame["raw_file"]: frame for frame in truth["frames"]}
    offset_m = frames["test_images/test2.jpg"]["offset_m"]
    assert told(folder)["still_offset_m"] == approx(offset_m, abs=0.1)


def imported_packages():
    tree = ast.parse((ROOT / "helpers.py").read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                yield name.name.partition(".")[0]
        if isinstance(node, ast.ImportFrom):
            yield str(node.module).partition(".")[0]


def test_helpers_imports_its_three_libraries_and_the_standard_library_only():
    assert set(imported_packages()) - set(sys.stdlib_module_names) == LIBRARIES
