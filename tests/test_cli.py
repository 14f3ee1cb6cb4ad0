"""The commands: what they print and write.

They run in this process; tests/end_to_end/test_commands.py starts them as processes.
Wrong usage is in tests/test_misuse.py.
"""

from __future__ import annotations

import re
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose, load_camera, save_camera
from lanes.files import read_telemetry
from lanes.video.images import read_image, write_image
from lanes.video.reader import inspect_video
from lanes.video.writer import VideoWriter
from tests.support.clips import write_drive
from tests.support.command_line import main
from tests.support.painted_drive import BENDS, SMALL
from tests.support.painted_roads import paint_motorway
from tests.support.project import names


class Ran(NamedTuple):
    """A command that was run: its exit status, what it printed, and its outputs."""

    status: int
    out: str
    err: str
    folder: Path


def run_into(folder: Path, *arguments: object) -> Ran:
    """Run a command that writes into a folder."""
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        status = main([str(argument) for argument in arguments])
    return Ran(status, out.getvalue(), err.getvalue(), folder)


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A folder with a drive and its camera, three of its frames as stills, and invalid
    files.
    """
    folder = tmp_path_factory.mktemp("a drive")
    write_drive(folder / "drive.mp4", BENDS, 20)
    for number in range(3):
        write_image(folder / "stills" / f"still{number}.png", BENDS.frame(number / 2))
    write_image(folder / "half.png", cv2.resize(BENDS.frame(0.0), (320, 180)))
    sky = write_image(folder / "sky.png", np.full((360, 640, 3), 200, np.uint8))
    (folder / "cut.png").write_bytes(sky.read_bytes()[: sky.stat().st_size // 2])
    (folder / "text.mp4").write_text("no video at all")
    return folder


@pytest.fixture(scope="module")
def part(drive, tmp_path_factory) -> Ran:
    folder = tmp_path_factory.mktemp("annotated")
    half_width = SMALL.width / 2 / SMALL.matrix[0, 0]
    hfov_deg = 2 * np.degrees(np.arctan(half_width))
    lens = ["--hfov", hfov_deg]
    part = ["--start", 0.4, "--end", 0.72]
    look = ["--style", "mosaic", "--no-report"]
    source = drive / "drive.mp4"
    arguments = [*lens, *part, *look, source, "-o", folder]
    return run_into(folder, "annotate", *arguments)


class TestAnnotate:
    """A part of a video whose camera is not calibrated."""

    def test_succeeds_without_a_warning(self, part):
        assert (part.status, part.err) == (0, "")

    def test_counts_the_frames_by_their_confidence(self, part):
        shares = (
            r"confidence 0\.9 or more in \d+%, 0\.5 to 0\.9 in \d+%, "
            r"below 0\.5 in 0%, no lane in 0% of them"
        )
        lost = r"lost for 0\.0 s, median confidence [01]\.\d\d;"
        assert re.search(rf"drive\.mp4: 8 frames, {shares}; {lost}", part.out)

    def test_writes_video_and_telemetry_only(self, part):
        assert names(part.folder) == {"drive.mp4", "drive.csv"}

    def test_numbers_the_frames_of_the_whole_video(self, part):
        frame = read_telemetry(part.folder / "drive.csv")["frame"]
        np.testing.assert_array_equal(frame, np.arange(10, 18))

    def test_prints_the_estimated_pose_with_its_standard_deviations(self, part):
        height = re.search(r"height +([\d.]+) ± [\d.]+ m", part.out)[1]
        assert float(height) == pytest.approx(SMALL.pose.height_m, abs=0.15)


@pytest.fixture(scope="module")
def after_failure(drive, tmp_path_factory) -> Ran:
    folder = tmp_path_factory.mktemp("annotated")
    for name in ("drive.mp4", "text.mp4"):
        (folder / name).write_text("earlier")
    sources = ["text.mp4", "d*.mp4", "stills", "cut.png"]
    paths = [f"{drive}/{name}" for name in sources]
    camera = ["--camera", drive / "drive.yaml"]
    look = ["--style", "lines", "--quiet", "--end", 0.2]
    arguments = [*camera, *look, *paths, "-o", folder]
    return run_into(folder, "annotate", *arguments)


class TestAnnotateAfterAFailure:
    """A text file and a still that is cut off, between good sources."""

    def test_the_errors_are_all_that_is_printed(self, after_failure):
        text = r"error: .*text\.mp4: cannot be read as a video.*\n"
        cut = r"error: .*cut\.png: .* is cut off.*\n"
        assert (after_failure.status, after_failure.out) == (1, "")
        assert re.fullmatch(text + cut, after_failure.err)

    def test_the_other_sources_are_written(self, after_failure):
        of_drive = {"drive.mp4", "drive.csv", "drive.html"}
        of_stills = {"still0.png", "still1.png", "still2.png", "pictures.csv"}
        assert names(after_failure.folder) == of_drive | of_stills | {"text.mp4"}
        assert inspect_video(after_failure.folder / "drive.mp4").frames == 5

    def test_the_stills_are_drawn_on(self, after_failure, drive):
        drawn = read_image(after_failure.folder / "still0.png")
        assert (drawn != read_image(drive / "stills" / "still0.png")).any()

    def test_an_earlier_result_of_the_failed_source_is_kept(self, after_failure):
        assert (after_failure.folder / "text.mp4").read_text() == "earlier"


@pytest.fixture(scope="module")
def motorway(tmp_path_factory) -> Path:
    """Two stills and a video of six frames, 2 a second, of a camera that looks down,
    left, and is rolled.
    """
    folder = tmp_path_factory.mktemp("motorway")
    angles_rad = np.radians([3.0, 1.5, -0.6])
    camera = Camera.from_fov((960, 540), 66, CameraPose(1.3, *angles_rad))
    save_camera(replace(camera, pose=None), folder / "lens.yaml")
    for i in range(2):
        still = paint_motorway(camera, offset_m=0.3 * i, phase_m=5 * i, seed=i)
        write_image(folder / f"still{i}.jpg", still)
    with VideoWriter(folder / "drive.mp4", fps=2) as video:
        for i in range(6):
            frame = paint_motorway(camera, offset_m=0.1 * i, phase_m=3 * i, seed=i)
            video.write(frame, i / 2)
    return folder


WIDTH_M = 3.2


@pytest.fixture(scope="module")
def pose_of_stills(motorway, tmp_path_factory) -> Ran:
    folder = tmp_path_factory.mktemp("pose")
    camera = ["--camera", motorway / "lens.yaml"]
    width = ["--lane-width", WIDTH_M]
    stills = motorway.glob("*.jpg")
    output = folder / "camera.yaml"
    return run_into(folder, "pose", *camera, *width, *stills, "-o", output)


class TestPoseFromStills:
    """With a calibrated lens and a lane width."""

    @pytest.fixture
    def found(self, pose_of_stills) -> Camera:
        return load_camera(pose_of_stills.folder / "camera.yaml")

    def test_keeps_the_lens(self, found, motorway):
        lens = load_camera(motorway / "lens.yaml")
        np.testing.assert_array_equal(found.matrix, lens.matrix)

    def test_finds_the_angles(self, found):
        assert np.degrees(found.pose.pitch_rad) == pytest.approx(3.0, abs=0.2)
        assert np.degrees(found.pose.yaw_rad) == pytest.approx(1.5, abs=0.4)

    def test_finds_a_height_in_proportion_to_the_lane_width(self, found):
        height_m = 1.3 * WIDTH_M / 3.66
        assert found.pose.height_m == pytest.approx(height_m, abs=0.05)

    def test_prints_the_pose_its_accuracy_and_the_file(self, pose_of_stills):
        assert pose_of_stills.status == 0
        assert "pictures 2 of 2 used" in pose_of_stills.out
        assert "looks left" in pose_of_stills.out
        assert "camera.yaml" in pose_of_stills.out
        accuracy = (
            r"the camera adds ± 0\.\d\d m and \d+% .* which the ± of the results contain.*"
            "curvature twice as much"
        )
        assert re.search(accuracy, pose_of_stills.out)


def test_pose_from_a_part_of_a_video_with_a_measured_height(motorway, tmp_path, run):
    lens = ["--hfov", 66, "--height", 1.4]
    part = ["--start", 1, "--end", 2.5]
    output = tmp_path / "camera.yaml"
    status, out, _ = run("pose", *lens, *part, motorway / "drive.mp4", "-o", output)
    assert status == 0
    assert "pictures 3 of 3 used" in out
    found = load_camera(output)
    assert (found.size, found.pose.height_m) == ((960, 540), 1.4)
    assert np.degrees(found.pose.pitch_rad) == pytest.approx(3.0, abs=0.2)


def test_explain_a_picture_of_half_the_size(drive, tmp_path, run):
    figure = tmp_path / "new" / "explained.png"
    camera = ["--camera", drive / "drive.yaml"]
    status, out, err = run("explain", drive / "half.png", *camera, "-o", figure)
    assert (status, err) == (0, "")
    assert "offset     0.2" in out
    assert "failed at" not in out
    assert out.endswith(f"wrote {figure}\n")
    assert read_image(figure).shape[1] > 1200


def test_explain_names_the_failed_step(drive, tmp_path, run):
    figure = tmp_path / "why.png"
    status, out, _ = run("explain", drive / "sky.png", "--hfov", 60, "-o", figure)
    assert status == 0
    assert figure.is_file()
    _, _, failure = out.partition("failed at  pose:")
    assert "height and roll are assumed" in failure
    advice = (
        "what to do The pose was estimated from these files: give the field of view "
        "(--hfov 45, --hfov 90)"
    )
    assert advice in failure


class TestExplainAFrame:
    """A frame of a video, with the state that the tracker has there."""

    @pytest.fixture
    def source(self, drive) -> list[Path | str]:
        return ["--camera", drive / "drive.yaml", drive / "drive.mp4"]

    @pytest.mark.slow
    def test_is_what_annotate_finds_with_a_pose_from_the_same_part(
        self, drive, tmp_path, run
    ):
        part = ["--hfov", 58, drive / "drive.mp4", "--start", 0.2]
        run("annotate", *part, "--no-report", "-o", tmp_path)
        rows = read_telemetry(tmp_path / "drive.csv")
        (row,) = np.flatnonzero(np.isclose(rows["time_s"], 0.6))

        _, out, _ = run("explain", *part, "--at", 0.6, "-o", tmp_path / "why.png")

        assert "note: pose and track are those of annotate --start 0.2, not" in out
        assert f"pose       {rows['pose_height_m'][row]:.2f} m high" in out
        assert f"confidence {rows['confidence'][row]:.0%}" in out

    def test_is_what_annotate_finds(self, source, tmp_path, run):
        part = [*source, "--start", 0.2]
        run("annotate", *part, "--no-report", "-o", tmp_path)
        rows = read_telemetry(tmp_path / "drive.csv")
        (row,) = np.flatnonzero(np.isclose(rows["time_s"], 0.6))

        status, out, _ = run("explain", *part, "--at", 0.6, "-o", tmp_path / "why.png")

        assert status == 0
        assert (tmp_path / "why.png").is_file()
        before = "lane known for 0.40 s and last seen 0.04 s ago"
        assert f"prediction {rows['state'][row - 1]}, {before}" in out
        assert f"offset     {abs(rows['offset_m'][row]):.2f} ± " in out
        assert f"confidence {rows['confidence'][row]:.0%}" in out

    def test_is_the_first_one_by_default(self, source, tmp_path, run):
        status, out, _ = run("explain", *source, "-o", tmp_path / "why.png")
        assert status == 0
        assert re.search("state      (searching|tracking)", out)
        assert "prediction" not in out
