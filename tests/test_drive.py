"""Whole drives and stills: time stamps, poses, telemetry, reports, and what happens to
unusable files.
"""

from __future__ import annotations

import json
import re
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
from lanes.tracking.tracker import LaneTracker
from lanes.video.images import read_image, write_image
from lanes.video.reader import inspect_video
from lanes.video.writer import VideoWriter
from tests.support.clips import write_clip, write_drive
from tests.support.command_line import main
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


# --- videos


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A video of twelve frames with its truth, and stills of the first two frames."""
    folder = tmp_path_factory.mktemp("drive")
    write_drive(folder / "drive.mp4", BENDS, 12)
    for number in range(2):
        write_image(folder / "stills" / f"b{number}.png", BENDS.frame(number / 25))
    return folder


def pitched(drive: PaintedDrive, down_deg: float) -> PaintedDrive:
    """The same drive with a camera that looks farther down."""
    pose = SMALL.pose
    return replace(
        drive,
        camera=SMALL.with_pose(
            replace(pose, pitch_rad=pose.pitch_rad + np.radians(down_deg))
        ),
    )


def test_video_gives_telemetry_in_si_units_and_a_report(drive, tmp_path):
    """The results have what the files have, also those of stills."""
    result, stills = quietly([drive / "drive.mp4", drive / "stills"], tmp_path)
    of_video = ["drive.mp4", "drive.csv", "drive.html"]
    of_stills = {"b0.png", "b1.png", "pictures.csv"}
    assert [path.name for path in result.outputs] == of_video
    assert names(tmp_path) == {*of_video} | of_stills
    assert inspect_video(tmp_path / "drive.mp4").frames == 12
    found = read_telemetry(tmp_path / "drive.csv")
    truth = read_telemetry(drive / "drive.csv")
    np.testing.assert_array_equal(found["frame"], truth["frame"])
    np.testing.assert_allclose(found["time_s"], truth["time_s"], atol=1e-6)
    late = np.s_[5:]
    assert found["state"][late].tolist() == ["tracking"] * 7
    assert np.isnan(found["departure"]).all()
    tolerances = {
        "offset_m": 0.05,
        "heading_rad": 0.01,
        "curvature_per_m": 5e-4,
        "lane_width_m": 0.05,
    }
    for name, tolerance in tolerances.items():
        assert np.abs(found[name] - truth[name])[late].max() < tolerance, name
    lines = [
        BENDS.truth(t).line_y(side, np.zeros(1))[0]
        for t in found["time_s"][late]
        for side in (0, 1)
    ]
    measured = np.column_stack([found["left_c0_m"], found["right_c0_m"]])[late].ravel()
    np.testing.assert_allclose(measured, lines, atol=0.06)
    assert (found["latency_ms"] > 1).all()
    pose = SMALL.require_pose()
    assert found["pose_pitch_rad"][late] == pytest.approx(pose.pitch_rad), (
        "the pose that was used"
    )
    for name, table in (
        ("drive.csv", result.telemetry),
        ("pictures.csv", stills.telemetry),
    ):
        read = read_telemetry(tmp_path / name)
        assert list(read) == list(table)
        for column in read:
            assert read[column].dtype.kind == table[column].dtype.kind, column
            if table[column].dtype.kind == "f":
                np.testing.assert_allclose(
                    table[column], read[column], rtol=1e-8, err_msg=column
                )
            else:
                np.testing.assert_array_equal(
                    table[column], read[column], err_msg=column
                )
    page = (tmp_path / "drive.html").read_text()
    assert "drive.mp4: lane report" in page
    assert "m high, pitch" in page


def test_another_pose_on_the_way_is_told(drive, tmp_path, monkeypatch):
    """With the pose of the drive no lane is likely; with that of one image there is one.

    The report has both facts.
    """
    wrong = SMALL.with_pose(replace(SMALL.pose, pitch_rad=0.25))
    assumed = PoseEstimate(
        wrong, 0.0, 0.1, 0.1, 0.1, frames_used=0, frames_total=24, lane_width_m=None
    )
    assumed = replace(
        assumed, notes=("no lane decides on the pose",), confidence_shift=-2.0
    )
    heights_m = set()
    assert (
        make_tracker(25, SMALL, assumed, None).update(BENDS.frame(0)).confidence_shift
        == -2
    )
    monkeypatch.setattr(
        "lanes.drive_camera.ensure_pose", lambda *_, **__: (wrong, assumed)
    )
    still = detect_still(BENDS.frame(0), SMALL)

    def estimate(image, camera, drive, **_) -> PoseEstimate:
        heights_m.add(drive.known_height_m)
        return replace(assumed, still=still)

    monkeypatch.setattr("lanes.drive.estimate_in_drive", estimate)
    (result,) = quietly(
        drive / "drive.mp4", tmp_path, replace(SMALL, pose=None), start_s=0.12
    )
    words = rf"from ([\d.]+) s on with another pose: {re.escape(SMALL.pose.describe())}"
    (begin,) = re.findall(words, result.description)
    assert heights_m == {SMALL.pose.height_m}  # as given
    assert (
        "<li>no lane decides on the pose</li>" in (tmp_path / "drive.html").read_text()
    )
    table = result.telemetry
    assert float(begin) == pytest.approx(
        table["time_s"][table["pose_pitch_rad"] == SMALL.pose.pitch_rad][0], abs=0.051
    )


@pytest.mark.parametrize(("orientation", "degrees"), [(3, 180), (6, 90)])
def test_a_calibrated_camera_is_turned_as_the_file_says(tmp_path, orientation, degrees):
    """Boards are seen by the sensor, drives upright.

    A camera with a pose is one for upright images already.
    """
    lens = replace(SMALL, pose=None)
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(BENDS.frame(0.0)).save(tmp_path / "a.jpg", exif=exif)
    path = tmp_path / "b.mp4"
    set_rotation(make_video(tmp_path / "a.mp4", 3, size=(640, 360)), path, degrees)
    settings = DriveSettings(output=tmp_path, camera=lens)
    turned = lens.turned(orientation)
    for file in (tmp_path / "a.jpg", path):
        camera = camera_for(settings, turned.size, file)
        np.testing.assert_allclose(camera.matrix, turned.matrix)
        half = camera_for(settings, (turned.width // 2, turned.height // 2), file)
        assert half.matrix[0, 0] == pytest.approx(turned.matrix[0, 0] / 2)
    posed = replace(settings, camera=turned.with_pose(SMALL.pose))
    assert camera_for(posed, turned.size, path) is posed.camera
    with pytest.raises(CameraError, match=r"b\.mp4: .*cropped"):
        camera_for(settings, (640, 480), path)


def test_detect_and_annotate_agree_over_a_hole_in_the_video(tmp_path):
    """The car moves on while nothing is recorded: all commands must tell the tracker
    the time, and say a jump of it.
    """
    with VideoWriter(tmp_path / "drive.mp4", fps=25) as writer:
        for number in (*range(12), *range(110, 133)):
            writer.write(
                BENDS.frame(number / 25), number / 25 + (300 if number >= 130 else 0)
            )
    (result,) = quietly(tmp_path / "drive.mp4", tmp_path / "out", report=False)
    settings = DriveSettings(output=tmp_path, camera=SMALL, progress=False)
    found = list(detect_in_video(tmp_path / "drive.mp4", settings, range(240, 320, 10)))
    np.testing.assert_array_equal(
        [row["frame"] for row in found], result.telemetry["frame"]
    )
    for name, tolerance in {
        "offset_m": 1e-4,
        "curvature_per_m": 1e-7,
        "confidence": 1e-4,
    }.items():
        values = np.array([row[name] for row in found], float)
        np.testing.assert_allclose(values, result.telemetry[name], atol=tolerance)
    assert "its clock jumps by 300 s after 5.2 s" in result.description
    assert found[31]["offset_m"] == pytest.approx(
        BENDS.truth(129 / 25).offset_m, abs=0.05
    )


def test_pose_is_estimated_from_the_annotated_part_only(tmp_path):
    """The camera pitches down by two degrees half-way; each part gets the pose that it
    had.
    """
    # a car that does not sway would have solid lines that never move
    swaying = replace(
        BENDS, motion=replace(BENDS.motion, wander_m=0.25, pitch_rad=0.003)
    )
    drives = (swaying, pitched(swaying, 2))
    video = tmp_path / "drive.mp4"
    with VideoWriter(video, fps=5) as writer:
        for number in range(16):
            writer.write(drives[number // 8].frame(number % 8 / 5), number / 5)
    for part, drive in zip(({"end_s": 1.6}, {"start_s": 1.6}), drives, strict=True):
        (result,) = quietly(
            video, tmp_path / "out", SMALL.with_pose(None), report=False, **part
        )
        assert (len(result.telemetry["frame"]), result.pose.frames_total) == (8, 8)
        assert result.pose.pose.pitch_rad == pytest.approx(
            drive.camera.pose.pitch_rad, abs=np.radians(0.3)
        )
        assert result.description.startswith("height")


def test_a_moved_camera_is_reported_with_the_time_on_the_clock_of_the_video(
    tmp_path, monkeypatch
):
    """After 10 of 16 seconds the camera looks two degrees farther down; the part from 4
    s on is annotated.

    Nothing is said if the tracker went on with another pose: then the angles have two
    origins.
    """
    with VideoWriter(tmp_path / "drive.mp4", fps=5) as writer:
        for number in range(80):
            writer.write(
                (BENDS if number < 50 else pitched(BENDS, 2)).frame(number / 5),
                number / 5,
            )
    (result,) = quietly(
        tmp_path / "drive.mp4", tmp_path / "out", report=False, start_s=4
    )
    words = (
        r"seems to have moved after (9|10|11) s: .* (1\.[7-9]|2\.\d) deg farther down"
    )
    assert re.search(words, result.description)

    def other_pose(fps: float, camera: Camera, *_: Any, **options: Any) -> LaneTracker:
        pose = camera.pose
        higher = replace(pose, height_m=1.01 * pose.height_m)
        return LaneTracker(camera.with_pose(higher), fps=fps)

    monkeypatch.setattr("lanes.drive.make_tracker", other_pose)
    (result,) = quietly(
        tmp_path / "drive.mp4", tmp_path / "out", report=False, start_s=4
    )
    assert "seems to have moved" not in result.description


def test_a_part_counts_its_own_lost_frames_on_the_clock_of_the_video(tmp_path):
    """Frames 5 to 9 and the last forty are black."""
    dark = {*range(5, 10), *range(50, 90)}
    frames = [
        BLACK if number in dark else BENDS.frame(number / 25) for number in range(90)
    ]
    video = write_clip(tmp_path / "drive.mp4", frames)
    lens = CalibrationReport(0.5, {f"{number}.jpg": 0.5 for number in range(3)})
    (result,) = quietly(
        video, tmp_path / "out", replace(SMALL, report=lens), start_s=0.6, end_s=3.4
    )
    table = result.telemetry
    lost = result.telemetry["state"] == "lost"
    assert table["frame"].tolist() == list(range(15, 85))
    assert result.missing == 0
    np.testing.assert_allclose(table["time_s"], table["frame"] / 25, atol=1e-6)
    assert lost[-9:].all()
    assert "70 frames, confidence 0.9 or more in" in result.description
    assert f"lost for {lost.sum() / 25:.1f} s" in result.description
    page = (tmp_path / "out" / "drive.html").read_text()
    assert "from 0.6 s to 3.4 s" in page
    assert "calibrated on 3 boards, error 0.50 px" in page
    assert re.search(
        r"lanes explain --camera camera\.yaml --start 0\.6 --end 3\.4 \S*drive\.mp4 --at ",
        page,
    )


@pytest.mark.parametrize("command", ["annotate", "detect"])
def test_a_mirrored_drive_is_tracked_as_players_show_it_and_said(
    tmp_path, drive, capsys, command
):
    """Stored upside down, as by a camera at the ceiling; its display matrix flips it.

    A turn is no mirror.
    """
    frames = [BENDS.frame(number / 25) for number in range(12)]
    save_camera(SMALL, tmp_path / "camera.yaml")
    for name, axes, stored in (
        ("flipped", (1, 0, 0, -1), np.flipud),
        ("turned", (-1, 0, 0, -1), np.rot90),
    ):
        images = [
            stored(frame) if name == "flipped" else stored(frame, 2) for frame in frames
        ]
        write_clip(tmp_path / "stored.mp4", map(np.ascontiguousarray, images))
        video = tmp_path / f"{name}.mp4"
        set_matrix(tmp_path / "stored.mp4", video, *axes)
        output = tmp_path / ("lanes.jsonl" if command == "detect" else "out")
        assert (
            main(
                [
                    command,
                    "--camera",
                    str(tmp_path / "camera.yaml"),
                    str(video),
                    "-o",
                    str(output),
                ]
            )
            == 0
        )
        assert ("is shown mirrored" in capsys.readouterr().out) == (name == "flipped")
        if command == "annotate":
            offset_m = read_telemetry(output / f"{name}.csv")["offset_m"][-1]
        else:
            offset_m = json.loads(output.read_text().splitlines()[-1])["offset_m"]
        assert offset_m == pytest.approx(BENDS.truth(11 / 25).offset_m, abs=0.05)


def test_the_result_names_the_median_confidence(drive, tmp_path):
    """Also if it is low: "tracked in 100 %" alone says too much of a lane that is
    unlikely.
    """
    sources = [drive / "drive.mp4", drive / "stills"]
    medians = []
    for down_deg in (0, 4):
        results = quietly(
            sources,
            tmp_path / str(down_deg),
            pitched(BENDS, down_deg).camera,
            report=False,
        )
        for result, words in zip(results, ("lost for", "no lane in"), strict=True):
            known = result.telemetry["confidence"][result.telemetry["state"] != "lost"]
            line = next(
                line for line in result.description.splitlines() if words in line
            )
            medians.append(np.median(known) if len(known) else 0.0)
            assert bool(len(known)) == ("median confidence" in line)
            assert not len(known) or f", median confidence {medians[-1]:.2f};" in line
    assert min(medians[:2]) > 0.8
    assert medians[2] < 0.5
    write_image(tmp_path / "grey.png", GREY)
    (result,) = quietly(tmp_path / "grey.png", tmp_path / "grey", report=False)
    assert "no lane in 100% of them; wrote" in result.description


@pytest.fixture(scope="module")
def unlikely(tmp_path_factory, drive) -> Annotation:
    """A drive of 12 seconds whose camera looks 6 degrees farther down than it says."""
    folder = tmp_path_factory.mktemp("unlikely")
    with VideoWriter(folder / "drive.mp4", fps=5) as writer:
        for number in range(60):
            writer.write(BENDS.frame(number / 5), number / 5)
    (result,) = quietly(folder / "drive.mp4", folder / "out", pitched(BENDS, 6).camera)
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


@pytest.mark.parametrize("tracks", [1, 2])
def test_lost_sound_is_stated(tmp_path, tracks):
    """That of the first track."""
    video = tmp_path / "drive.avi"
    make_video_with_unknown_sound(video, 3, tracks, size=SMALL.size)
    (result,) = quietly(video, tmp_path / "out", report=False)
    assert len(result.telemetry["frame"]) == 3
    assert "its sound cannot be decoded" in result.description
    assert f"{tracks - 1} of {tracks} sound tracks" in result.description


# --- stills


def test_a_still_without_a_sure_lane_has_a_pose_of_its_own(tmp_path):
    """As with `each`, if it shows a lane that is more likely with it; none is refused."""
    pose = BENDS.camera.require_pose()
    turned = replace(
        BENDS,
        camera=BENDS.camera.with_pose(
            replace(pose, pitch_rad=pose.pitch_rad + np.radians(6))
        ),
    )
    for number, image in enumerate(
        (*map(BENDS.frame, range(4)), turned.frame(4), GREY)
    ):
        write_image(tmp_path / "in" / f"{number}.png", image)
    (result,) = quietly(tmp_path / "in", tmp_path / "out", SMALL.with_pose(None))
    assert result.failures == ()
    assert result.telemetry["state"].tolist() == ["found"] * 5 + ["lost"]
    assert re.search(r"4\.png: found .*; pose: height", result.description)
    assert "0.png: found" not in result.description


def test_unusable_stills_do_not_stop_the_others(tmp_path):
    folder = tmp_path / "in"
    other = np.zeros((480, 640, 3), np.uint8)
    for name, image in (
        ("b2.jpg", BENDS.frame(0)),
        ("b10.jpg", BENDS.frame(1)),
        ("a.jpg", other),
        ("c.jpg", other),
    ):
        write_image(folder / name, image)
    (folder / "c.jpg").write_bytes((folder / "c.jpg").read_bytes()[:300])
    (folder / "d.png").touch()
    with pytest.raises(PictureError) as error:
        quietly(folder, tmp_path / "out", SMALL.with_pose(None))
    words = r".*c.jpg: .*cut off.*\n.*d.png: .*empty.*\n.*a.jpg: is 640x480, the others used are 640x360;.*"
    assert re.fullmatch(words, str(error.value))
    assert names(tmp_path / "out") == {"b2.jpg", "b10.jpg", "pictures.csv"}
    table = read_telemetry(tmp_path / "out" / "pictures.csv")
    assert (table["picture"].tolist(), table["frame"].tolist()) == (
        ["b2.jpg", "b10.jpg"],
        [0, 1],
    )
    drawn = read_image(tmp_path / "out" / "b2.jpg")
    assert (
        np.abs(drawn.astype(int) - BENDS.frame(0))[220:330].max(axis=2) > 30
    ).mean() > 0.1
    with pytest.raises(PictureError, match=r"c.jpg: .*\n.*d.png"):
        quietly([folder / "c.jpg", folder / "d.png"], tmp_path / "none")
    assert names(tmp_path / "none") == set()
