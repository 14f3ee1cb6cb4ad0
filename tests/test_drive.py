"""Whole drives and stills: time stamps, poses, telemetry, reports, and what happens to
unusable files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from lanes.annotation import Annotation, DriveSettings
from lanes.camera.model import CalibrationReport, Camera, save_camera
from lanes.detect.search import detect_still
from lanes.drive import annotate, make_tracker
from lanes.drive_camera import camera_for
from lanes.errors import CameraError, PictureError
from lanes.files import read_telemetry
from lanes.labels import detect_in_video
from lanes.pose.estimate import PoseEstimate
from lanes.telemetry import Telemetry
from lanes.tracking.tracker import LaneTracker
from lanes.video.images import read_image, write_image
from lanes.video.reader import inspect_video
from lanes.video.writer import VideoWriter
from tests.support.clips import write_clip, write_drive
from tests.support.painted_drive import BENDS, SMALL, PaintedDrive
from tests.support.project import names
from tests.video.sample_videos import (
    make_video,
    make_video_with_unknown_sound,
    set_matrix,
    set_rotation,
)

GREY = np.full((360, 640, 3), 128, np.uint8)
BLACK = np.zeros_like(GREY)


def quietly(
    sources: object, output: Path, camera: Camera | None = SMALL, **options: object
) -> list[Annotation]:
    return annotate(sources, output, camera, progress=False, **options)


@pytest.mark.parametrize(
    "name", ["photo.jpe", "PHOTO.JFIF", "photo.avif", "photo.TIFF"]
)
def test_a_still_is_written_under_its_name(tmp_path, name):
    kind = {"avif": "AVIF", "tiff": "TIFF"}.get(name.lower().rpartition(".")[2], "JPEG")
    Image.fromarray(BENDS.frame(0)).save(tmp_path / name, kind)
    (result,) = quietly(tmp_path / name, tmp_path / "out")
    assert result.outputs[0] == tmp_path / "out" / name
    with Image.open(tmp_path / "out" / name) as written:
        assert written.format == kind
    assert read_image(tmp_path / "out" / name).shape == (360, 640, 3)


# Videos.


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A video of twelve frames with its truth, and stills of the first two frames."""
    folder = tmp_path_factory.mktemp("drive")
    write_drive(folder / "drive.mp4", BENDS, 12)
    for number in range(2):
        write_image(folder / "stills" / f"b{number}.png", BENDS.frame(number / 25))
    return folder


def test_a_part_behind_a_change_of_size_is_annotated(tmp_path):
    """Half a second of smaller images, then one of ours; with a camera of one field of
    view for both.
    """
    frames = [BENDS.frame(number / 25) for number in range(25)]
    small = write_clip(tmp_path / "a.ts", [frame[::2, ::2] for frame in frames[:13]])
    large = write_clip(tmp_path / "b.ts", frames)
    video = tmp_path / "both.ts"
    video.write_bytes(small.read_bytes() + large.read_bytes())
    (result,) = quietly(video, tmp_path / "out", start_s=0.6)
    assert inspect_video(result.outputs[0]).height == 360
    assert result.telemetry["state"][-1] == "tracking"


def pitched(drive: PaintedDrive, down_deg: float) -> PaintedDrive:
    """The same drive with a camera that looks farther down."""
    pose = SMALL.require_pose()
    lower = replace(pose, pitch_rad=pose.pitch_rad + np.radians(down_deg))
    return replace(drive, camera=SMALL.with_pose(lower))


def record(
    path: Path, frames: Iterable[np.ndarray], times_s: Iterable[float], *, fps: float
) -> Path:
    with VideoWriter(path, fps=fps) as writer:
        for frame, time_s in zip(frames, times_s, strict=True):
            writer.write(frame, time_s)
    return path


def columns_of(table: Telemetry, *names: str) -> np.ndarray:
    return np.column_stack([table[name] for name in names])


class TestAnnotatedDrive:
    """Of the frames from the sixth on, the lane is known."""

    @pytest.fixture(scope="class")
    @classmethod
    def output(cls, drive, tmp_path_factory) -> Path:
        return tmp_path_factory.mktemp("annotated")

    @pytest.fixture(scope="class")
    @classmethod
    def results(cls, drive, output) -> list[Annotation]:
        """Those of the video and of the stills."""
        return quietly([drive / "drive.mp4", drive / "stills"], output)

    @pytest.fixture
    def found(self, results, output) -> Telemetry:
        return read_telemetry(output / "drive.csv")

    @pytest.fixture
    def truth(self, drive) -> Telemetry:
        return read_telemetry(drive / "drive.csv")

    def test_the_written_files_are_those_that_the_results_name(self, results, output):
        video, stills = results
        of_video = ["drive.mp4", "drive.csv", "drive.html"]
        of_stills = ["b0.png", "b1.png", "pictures.csv"]
        assert [path.name for path in video.outputs] == of_video
        assert [path.name for path in stills.outputs] == of_stills
        assert names(output) == {*of_video, *of_stills}

    def test_the_video_has_all_frames(self, results, output):
        assert inspect_video(output / "drive.mp4").frames == 12

    def test_the_report_has_title_and_pose(self, results, output):
        page = (output / "drive.html").read_text()
        assert "drive.mp4: lane report" in page
        assert "m high, pitch" in page

    def test_frames_have_their_numbers_and_times(self, found, truth):
        np.testing.assert_array_equal(found["frame"], truth["frame"])
        np.testing.assert_allclose(found["time_s"], truth["time_s"], atol=1e-6)

    @pytest.mark.parametrize(
        ("name", "tolerance"),
        [
            ("offset_m", 0.05),
            ("heading_rad", 0.01),
            ("curvature_per_m", 5e-4),
            ("lane_width_m", 0.05),
        ],
    )
    def test_numbers_of_the_lane_are_true(self, found, truth, name, tolerance):
        np.testing.assert_allclose(found[name][5:], truth[name][5:], atol=tolerance)

    def test_positions_of_the_lines_are_true(self, found):
        true_m = []
        for time_s in found["time_s"][5:]:
            truth = BENDS.truth(time_s)
            true_m.append([truth.line_y(side, np.zeros(1))[0] for side in (0, 1)])
        found_m = columns_of(found, "left_c0_m", "right_c0_m")[5:]
        np.testing.assert_allclose(found_m, true_m, atol=0.06)

    def test_the_lane_is_tracked_without_a_departure(self, found):
        assert found["state"][5:].tolist() == ["tracking"] * 7
        assert np.isnan(found["departure"]).all()

    def test_the_pose_is_the_one_that_was_used(self, found):
        pose = SMALL.require_pose()
        assert found["pose_pitch_rad"][5:] == pytest.approx(pose.pitch_rad)

    def test_the_latency_is_measured(self, found):
        assert (found["latency_ms"] > 1).all()

    @pytest.mark.parametrize(
        ("number", "name"), [(0, "drive.csv"), (1, "pictures.csv")]
    )
    def test_the_table_of_a_result_is_that_of_its_file(
        self, results, output, number, name
    ):
        table = results[number].telemetry
        read = read_telemetry(output / name)
        assert list(read) == list(table)
        for column, values in table.items():
            assert read[column].dtype.kind == values.dtype.kind, column
            if values.dtype.kind == "f":
                np.testing.assert_allclose(values, read[column], 1e-8, err_msg=column)
            else:
                np.testing.assert_array_equal(values, read[column], err_msg=column)


class TestAnotherPoseOnTheWay:
    """With the pose of the drive no lane is likely; with that of one image there is
    one.
    """

    @pytest.fixture
    def assumed(self) -> PoseEstimate:
        wrong = replace(SMALL.require_pose(), pitch_rad=0.25)
        return PoseEstimate(
            SMALL.with_pose(wrong),
            height_std_m=0.0,
            pitch_std_rad=0.1,
            yaw_std_rad=0.1,
            roll_std_rad=0.1,
            frames_used=0,
            frames_total=24,
            lane_width_m=None,
            notes=("no lane decides on the pose",),
            confidence_shift=-2.0,
        )

    @pytest.fixture
    def asked_m(self) -> list[float | None]:
        """The heights that the poses of single images were looked for with."""
        return []

    @pytest.fixture
    def result(self, drive, tmp_path, monkeypatch, assumed, asked_m) -> Annotation:
        still = detect_still(BENDS.frame(0), SMALL)

        def estimate(image, camera, drive, settings, **_) -> PoseEstimate:
            asked_m.append(drive.known_height_m)
            return replace(assumed, still=still)

        ensured = (assumed.camera, assumed)
        monkeypatch.setattr("lanes.drive_camera.ensure_pose", lambda *_, **__: ensured)
        monkeypatch.setattr("lanes.drive.estimate_in_drive", estimate)
        lens = replace(SMALL, pose=None)
        (result,) = quietly(drive / "drive.mp4", tmp_path, lens, start_s=0.12)
        return result

    def test_is_told_with_its_time(self, result):
        pose = SMALL.require_pose()
        words = (
            r"from ([\d.]+) s on with another pose \(the camera moved, or another one "
            rf"begins\): {re.escape(pose.describe())}"
        )
        (begin_s,) = map(float, re.findall(words, result.description))
        table = result.telemetry
        first_s = table["time_s"][table["pose_pitch_rad"] == pose.pitch_rad][0]
        assert begin_s == pytest.approx(first_s, abs=0.051)

    def test_is_in_the_report(self, result, tmp_path):
        pose = re.escape(SMALL.require_pose().describe())
        page = (tmp_path / "drive.html").read_text()
        assert re.search(rf'"poses":\[\[\d,"{pose}"\]\]', page)

    def test_is_looked_for_at_the_given_height(self, result, asked_m):
        assert set(asked_m) == {SMALL.require_pose().height_m}

    def test_leaves_the_doubts_of_the_first_in_the_report(self, result, tmp_path):
        page = (tmp_path / "drive.html").read_text()
        assert "<li>no lane decides on the pose</li>" in page

    def test_of_the_drive_makes_lanes_less_sure(self, assumed):
        lane = make_tracker(25, SMALL, assumed, None).update(BENDS.frame(0))
        assert lane.confidence_shift == -2


class TestCameraOfTheSensor:
    """Boards are seen by the sensor, drives upright: the file says how it was turned."""

    @pytest.fixture(params=[(3, 180), (6, 90)], ids=["180 degrees", "90 degrees"])
    def turn(self, request) -> tuple[int, int]:
        """As an EXIF orientation, and in degrees."""
        return request.param

    @pytest.fixture
    def upright(self, turn) -> Camera:
        return replace(SMALL, pose=None).turned(turn[0])

    @pytest.fixture(params=["still", "video"])
    def file(self, request, tmp_path, turn) -> Path:
        orientation, degrees = turn
        if request.param == "still":
            exif = Image.Exif()
            exif[0x0112] = orientation
            Image.fromarray(BENDS.frame(0.0)).save(tmp_path / "a.jpg", exif=exif)
            return tmp_path / "a.jpg"
        stored = make_video(tmp_path / "a.mp4", 3, size=(640, 360))
        set_rotation(stored, tmp_path / "b.mp4", degrees)
        return tmp_path / "b.mp4"

    @pytest.fixture
    def settings(self, tmp_path) -> DriveSettings:
        return DriveSettings(output=tmp_path, camera=replace(SMALL, pose=None))

    def test_is_turned(self, settings, upright, file):
        camera = camera_for(settings, upright.size, file)
        np.testing.assert_allclose(camera.matrix, upright.matrix)

    def test_is_turned_and_scaled(self, settings, upright, file):
        width, height = upright.size
        half = camera_for(settings, (width // 2, height // 2), file)
        assert half.matrix[0, 0] == pytest.approx(upright.matrix[0, 0] / 2)

    def test_stays_as_it_is_with_a_pose(self, settings, upright, file):
        posed = replace(settings, camera=upright.with_pose(SMALL.pose))
        assert camera_for(posed, upright.size, file) is posed.camera

    def test_is_refused_for_a_cropped_image(self, settings, file):
        with pytest.raises(CameraError, match=rf"{file.name}: .*cropped"):
            camera_for(settings, (640, 480), file)


class TestHoleInTheVideo:
    """The car moves on while nothing is recorded, and the clock jumps after that."""

    @pytest.fixture(scope="class")
    @classmethod
    def video(cls, tmp_path_factory) -> Path:
        path = tmp_path_factory.mktemp("hole") / "drive.mp4"
        numbers = [*range(12), *range(110, 133)]
        times_s = [n / 25 + (300 if n >= 130 else 0) for n in numbers]
        return record(path, [BENDS.frame(n / 25) for n in numbers], times_s, fps=25)

    @pytest.fixture(scope="class")
    @classmethod
    def annotated(cls, video) -> Annotation:
        (result,) = quietly(video, video.parent / "out", report=False)
        return result

    @pytest.fixture(scope="class")
    @classmethod
    def detected(cls, video) -> list[dict]:
        settings = DriveSettings(output=video.parent, camera=SMALL, progress=False)
        return list(detect_in_video(video, settings, range(240, 320, 10)))

    @pytest.mark.parametrize(
        ("name", "tolerance"),
        [
            ("frame", 0),
            ("offset_m", 1e-4),
            ("curvature_per_m", 1e-7),
            ("confidence", 1e-4),
        ],
    )
    def test_detect_and_annotate_agree(self, annotated, detected, name, tolerance):
        values = np.array([row[name] for row in detected], float)
        expected = annotated.telemetry[name]
        np.testing.assert_allclose(values, expected, atol=tolerance)

    def test_the_lane_is_true_behind_it(self, detected):
        offset_m = BENDS.truth(129 / 25).offset_m
        assert detected[31]["offset_m"] == pytest.approx(offset_m, abs=0.05)

    def test_the_jump_of_the_clock_is_said(self, annotated):
        assert "its clock jumps by 300 s after 5.2 s" in annotated.description


# A car that does not sway would have solid lines that never move.
SWAYS = replace(BENDS, motion=replace(BENDS.motion, wander_m=0.25, pitch_rad=0.003))


@pytest.mark.parametrize(
    ("part", "down_deg"), [({"end_s": 1.6}, 0), ({"start_s": 1.6}, 2)], ids=["1", "2"]
)
def test_pose_is_estimated_from_the_annotated_part_only(tmp_path, part, down_deg):
    """The camera pitches down by two degrees half-way."""
    drives = (SWAYS, pitched(SWAYS, 2))
    frames = [drive.frame(n / 5) for drive in drives for n in range(8)]
    video = record(tmp_path / "drive.mp4", frames, np.arange(16) / 5, fps=5)

    lens = replace(SMALL, pose=None)
    (result,) = quietly(video, tmp_path / "out", lens, report=False, **part)

    true_rad = pitched(SWAYS, down_deg).camera.require_pose().pitch_rad
    assert (len(result.telemetry["frame"]), result.pose.frames_total) == (8, 8)
    assert result.pose.pose.pitch_rad == pytest.approx(true_rad, abs=np.radians(0.3))
    assert result.description.startswith("height")


class TestMovedCamera:
    """After 10 of 16 seconds it looks two degrees farther down."""

    @pytest.fixture(scope="class")
    @classmethod
    def video(cls, tmp_path_factory) -> Path:
        lower = pitched(BENDS, 2)
        frames = [(BENDS if n < 50 else lower).frame(n / 5) for n in range(80)]
        path = tmp_path_factory.mktemp("moved") / "drive.mp4"
        return record(path, frames, np.arange(80) / 5, fps=5)

    def test_is_reported_with_the_time_on_the_clock_of_the_video(self, video, tmp_path):
        (result,) = quietly(video, tmp_path, report=False, start_s=4)
        words = r"moved after (9|10|11) s: .* (1\.[7-9]|2\.\d) deg farther down"
        assert re.search(f"seems to have {words}", result.description)

    def test_is_not_reported_if_the_tracker_went_on_with_another_pose(
        self, video, tmp_path, monkeypatch
    ):
        """Then the angles have two origins."""

        def other_pose(
            fps: float, camera: Camera, *_: Any, **options: Any
        ) -> LaneTracker:
            pose = camera.require_pose()
            higher = replace(pose, height_m=1.01 * pose.height_m)
            return LaneTracker(camera.with_pose(higher), fps=fps)

        monkeypatch.setattr("lanes.drive.make_tracker", other_pose)
        (result,) = quietly(video, tmp_path, report=False, start_s=4)
        assert "seems to have moved" not in result.description


class TestPartOfADrive:
    """From 0.6 to 3.4 s; frames 5 to 9 and the last forty are black."""

    @pytest.fixture(scope="class")
    @classmethod
    def output(cls, tmp_path_factory) -> Path:
        return tmp_path_factory.mktemp("part")

    @pytest.fixture(scope="class")
    @classmethod
    def result(cls, output) -> Annotation:
        dark = {*range(5, 10), *range(50, 90)}
        frames = [BLACK if n in dark else BENDS.frame(n / 25) for n in range(90)]
        video = write_clip(output / "drive.mp4", frames)
        boards = {f"{number}.jpg": 0.5 for number in range(3)}
        camera = replace(SMALL, report=CalibrationReport(0.5, boards))
        (result,) = quietly(video, output / "out", camera, start_s=0.6, end_s=3.4)
        return result

    def test_has_its_frames_on_the_clock_of_the_video(self, result):
        table = result.telemetry
        assert table["frame"].tolist() == list(range(15, 85))
        np.testing.assert_allclose(table["time_s"], table["frame"] / 25, atol=1e-6)
        assert result.missing == 0

    def test_counts_its_own_lost_frames(self, result):
        lost = result.telemetry["state"] == "lost"
        assert lost[-9:].all()
        assert f"lost for {lost.sum() / 25:.1f} s" in result.description
        assert "70 frames, confidence 0.9 or more in" in result.description

    @pytest.mark.parametrize(
        "words",
        [
            r"from 0\.6 s to 3\.4 s",
            r"calibrated on 3 boards, error 0\.50 px",
            r"lanes explain --camera camera\.yaml --start 0\.6 --end 3\.4 \S*drive\.mp4 --at ",
        ],
    )
    def test_has_a_report_with_part_and_lens(self, result, output, words):
        assert re.search(words, (output / "out" / "drive.html").read_text())


# What the display matrix does, and how the frames are stored for it.
DISPLAYED = {
    "mirrored": ((1, 0, 0, -1), np.flipud),
    "turned": ((-1, 0, 0, -1), lambda frame: np.rot90(frame, 2)),
}


@pytest.mark.parametrize("command", ["annotate", "detect"])
@pytest.mark.parametrize("name", DISPLAYED)
def test_a_mirrored_drive_is_tracked_as_players_show_it_and_said(
    tmp_path, run, command, name
):
    """Stored upside down, as by a camera at the ceiling. A turn is no mirror."""
    matrix, stored = DISPLAYED[name]
    frames = [stored(BENDS.frame(number / 25)) for number in range(12)]
    write_clip(tmp_path / "stored.mp4", map(np.ascontiguousarray, frames))
    video = tmp_path / "drive.mp4"
    set_matrix(tmp_path / "stored.mp4", video, *matrix)
    camera = save_camera(SMALL, tmp_path / "camera.yaml")
    output = tmp_path / "out"

    status, said, _ = run(command, "--camera", camera, video, "-o", output)

    assert status == 0
    assert ("is shown mirrored" in said) == (name == "mirrored")
    if command == "annotate":
        offset_m = read_telemetry(output / "drive.csv")["offset_m"][-1]
    else:
        offset_m = json.loads(output.read_text().splitlines()[-1])["offset_m"]
    assert offset_m == pytest.approx(BENDS.truth(11 / 25).offset_m, abs=0.05)


@pytest.mark.parametrize("down_deg", [0, 4], ids=["likely", "unlikely"])
@pytest.mark.parametrize(
    ("source", "words"), [("drive.mp4", "lost for"), ("stills", "no lane in")]
)
def test_the_result_names_the_median_confidence(
    drive, tmp_path, source, words, down_deg
):
    """Also if it is low: "tracked in 100 %" alone says too much of a lane that is
    unlikely.
    """
    camera = pitched(BENDS, down_deg).camera
    (result,) = quietly(drive / source, tmp_path, camera, report=False)

    table = result.telemetry
    known = table["confidence"][table["state"] != "lost"]
    lines = result.description.splitlines()
    (line,) = (line for line in lines if words in line)
    if len(known):
        median = np.median(known)
        assert f", median confidence {median:.2f};" in line
        assert median > 0.8 if down_deg == 0 else median < 0.5
    else:
        assert down_deg == 4
        assert "median confidence" not in line


def test_a_result_without_any_lane_names_no_confidence(tmp_path):
    write_image(tmp_path / "grey.png", GREY)
    (result,) = quietly(tmp_path / "grey.png", tmp_path / "grey", report=False)
    assert "no lane in 100% of them; wrote" in result.description


@pytest.fixture(scope="module")
def unlikely(tmp_path_factory) -> Annotation:
    """A drive of 12 seconds whose camera looks 6 degrees farther down than it says."""
    folder = tmp_path_factory.mktemp("unlikely")
    frames = [BENDS.frame(number / 5) for number in range(60)]
    video = record(folder / "drive.mp4", frames, np.arange(60) / 5, fps=5)
    (result,) = quietly(video, folder / "out", pitched(BENDS, 6).camera)
    return result


def test_no_lane_has_no_numbers_in_the_table_and_no_advice(unlikely):
    table = unlikely.telemetry
    is_none = table["confidence"] < 0.15
    assert is_none.mean() > 0.9
    assert set(table["state"][is_none]) == {"lost"}
    for name in ("offset_m", "curvature_per_m", "lane_width_m", "left_c0_m"):
        assert np.isnan(table[name][is_none]).all()
    assert "the camera seems" not in unlikely.description


def test_frames_without_a_lane_are_counted_as_lost(unlikely):
    lost_s = 0.2 * (unlikely.telemetry["confidence"] < 0.15).sum()
    assert f"lost for {lost_s:.1f} s" in unlikely.description


def test_a_picture_that_stands_still_is_stated(tmp_path):
    numbers = [min(number, 9) for number in range(40)]
    frames = (BENDS.frame(number / 25) for number in numbers)
    path = record(tmp_path / "hanging.mp4", frames, np.arange(40) / 25, fps=25)
    (result,) = quietly(path, tmp_path / "out", report=False)
    assert "frozen" in result.telemetry["state"]
    assert "the picture stands still at 0.9 s" in result.description


@pytest.mark.parametrize("tracks", [1, 2])
def test_lost_sound_is_stated(tmp_path, tracks):
    """That of the first track."""
    video = tmp_path / "drive.avi"
    make_video_with_unknown_sound(video, 3, tracks, size=SMALL.size)
    (result,) = quietly(video, tmp_path / "out", report=False)
    assert len(result.telemetry["frame"]) == 3
    assert "its sound cannot be decoded" in result.description
    assert f"{tracks - 1} of {tracks} sound tracks" in result.description


# Stills.


def test_a_still_without_a_sure_lane_has_a_pose_of_its_own(tmp_path):
    """As with `each`, if it shows a lane that is more likely with it; none is refused."""
    frames = [BENDS.frame(number) for number in range(4)]
    frames += [pitched(BENDS, 6).frame(4), GREY]
    for number, image in enumerate(frames):
        write_image(tmp_path / "in" / f"{number}.png", image)
    lens = replace(SMALL, pose=None)
    (result,) = quietly(tmp_path / "in", tmp_path / "out", lens)
    assert result.failures == ()
    assert result.telemetry["state"].tolist() == ["found"] * 5 + ["lost"]
    assert re.search(r"4\.png: found .*; pose: height", result.description)
    assert "0.png: found" not in result.description


class TestUnusableStills:
    """Beside two usable ones: of another size, cut off, and empty."""

    @pytest.fixture
    def folder(self, tmp_path) -> Path:
        folder = tmp_path / "in"
        other = np.zeros((480, 640, 3), np.uint8)
        write_image(folder / "b2.jpg", BENDS.frame(0))
        write_image(folder / "b10.jpg", BENDS.frame(1))
        write_image(folder / "a.jpg", other)
        cut = write_image(folder / "c.jpg", other)
        cut.write_bytes(cut.read_bytes()[:300])
        (folder / "d.png").touch()
        return folder

    @pytest.fixture
    def said(self, folder, tmp_path) -> str:
        lens = replace(SMALL, pose=None)
        with pytest.raises(PictureError) as error:
            quietly(folder, tmp_path / "out", lens)
        return str(error.value)

    def test_are_named_with_what_is_wrong(self, said):
        words = r".*c.jpg: .*cut off.*\n.*d.png: .*empty.*\n.*a.jpg: is 640x480, the others used are 640x360;.*"
        assert re.fullmatch(words, said)

    def test_do_not_stop_the_others(self, said, tmp_path):
        assert names(tmp_path / "out") == {"b2.jpg", "b10.jpg", "pictures.csv"}
        table = read_telemetry(tmp_path / "out" / "pictures.csv")
        assert table["picture"].tolist() == ["b2.jpg", "b10.jpg"]
        assert table["frame"].tolist() == [0, 1]
        drawn = read_image(tmp_path / "out" / "b2.jpg").astype(int)
        changes = np.abs(drawn - BENDS.frame(0))[220:330].max(axis=2)
        assert (changes > 30).mean() > 0.1

    def test_are_refused_if_there_are_no_others(self, folder, tmp_path):
        with pytest.raises(PictureError, match=r"c.jpg: .*\n.*d.png"):
            quietly([folder / "c.jpg", folder / "d.png"], tmp_path / "none")
        assert names(tmp_path / "none") == set()
