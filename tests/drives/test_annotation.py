"""Whole drives: sources, settings, overlay styles, stills and videos."""

from __future__ import annotations

import pickle
import re
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest

from lanes.annotate import DriveSettings, StillsResult, annotate_drive, annotate_folder, annotate_stills
from lanes.camera import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import extract_evidence
from lanes.draw import STYLES, track_lane
from lanes.errors import CameraError, PictureError, PoseError
from lanes.field_of_view import FieldOfView
from lanes.files import read_telemetry
from lanes.images import read_image, write_image
from lanes.pose import PoseEstimate
from lanes.sources import find_sources, require_distinct_outputs
from lanes.track.tracker import LOST, LaneTracker, TrackedLane
from lanes.video.writer import VideoWriter
from tests.io.video.sample_videos import make_video_with_unknown_sound
from tests.support.clips import write_drive
from tests.support.command_line import main
from tests.support.painted_drive import BENDS, CAMERA, SMALL, tracked_bends
from tests.support.painted_roads import paint_motorway

GREY = np.full((360, 640, 3), 128, np.uint8)


def test_names_are_sorted_by_kind(tmp_path, monkeypatch):
    for name in (
        "d10.mp4",
        "d2.MOV",
        "b.jpg",
        "c.WebP",
        "d.tif",
        "e.HEIC",
        "notes.txt",
        ".hidden.mp4",
        "d.partial.7.mp4",
        "more/x.mkv",
        "[1].avi",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    found = find_sources([".", "more/*", "d2.MOV", "[1].avi"])
    assert [path.name for path in found.videos] == ["[1].avi", "d2.MOV", "d10.mp4", "x.mkv"]
    assert [path.name for path in found.stills] == ["b.jpg", "c.WebP", "d.tif", "e.HEIC"]
    for missing, words in (("nowhere.mp4", "no such file or folder"), ("*.webm", "no such file"), ("", "no such file")):
        with pytest.raises(FileNotFoundError, match=words):
            find_sources([missing])
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="empty: holds neither"):
        find_sources(["empty"])


def test_outputs_that_overwrite_an_input_or_another_output_are_rejected(tmp_path):
    a, b = tmp_path / "a.mp4", tmp_path / "b" / "a.mp4"
    require_distinct_outputs([a, b], [tmp_path / "out" / "a.mp4", tmp_path / "out" / "b.mp4"])
    with pytest.raises(ValueError, match="one of the inputs"):
        require_distinct_outputs([a, b], [tmp_path / "out" / "a.mp4", tmp_path / "b" / ".." / "a.mp4"])
    with pytest.raises(ValueError, match="from .*a.mp4 and from .*a.mp4"):
        require_distinct_outputs([a, b], [tmp_path / "out" / "a.mp4"] * 2)


def test_settings_can_be_pickled_and_scale_the_camera(tmp_path):
    settings = pickle.loads(pickle.dumps(DriveSettings(output=tmp_path, camera=CAMERA, style="lines")))
    np.testing.assert_allclose(settings.camera_for((640, 360)).matrix, SMALL.matrix)
    assert settings.camera_for(CAMERA.size) is settings.camera
    assert settings.camera_for((640, 360)).pose == CAMERA.pose
    with pytest.raises(CameraError, match="cropped"):
        settings.camera_for((640, 480))
    wide = DriveSettings(output=tmp_path, field=FieldOfView(90.0, "as given")).camera_for((640, 480))
    assert (wide.matrix[0, 0], wide.pose) == (pytest.approx(320), None)
    with pytest.raises(CameraError, match="no lens"):
        DriveSettings(output=tmp_path).camera_for((640, 480))


@pytest.mark.parametrize("style", STYLES)
def test_styles_keep_the_picture_size_and_show_the_lost_state(style):
    image, result = tracked_bends()
    paint = STYLES[style](SMALL)
    drawn, lost = paint(image.copy(), result), paint(image.copy(), TrackedLane(LOST))
    assert (lost != image).any()
    assert drawn.shape == lost.shape == image.shape and drawn.dtype == np.uint8
    assert (drawn != lost).any(axis=2).mean() > 0.005


def test_lines_style_draws_on_the_paint_only():
    image, result = tracked_bends()
    drawn = STYLES["lines"](SMALL)(image.copy(), result)
    x = np.array([9.0, 14.0])
    truth = BENDS.truth(3 / 25)
    for side, channel in ((0, 0), (1, 2)):
        u, v = np.round(SMALL.road_to_pixels(np.column_stack([x, truth.line_y(side, x)]))).astype(int).T
        assert (drawn[v, u, channel] > drawn[v, u, 1] + 60).all()
    u, v = np.round(SMALL.road_to_pixels(np.array([[10.0, 0.0]]))[0]).astype(int)
    np.testing.assert_array_equal(drawn[v, u], image[v, u])


def test_mosaic_shows_fit_and_marking_response():
    image, result = tracked_bends()
    mosaic = STYLES["mosaic"](SMALL)(image, result)
    height, width = image.shape[:2]
    panels = [mosaic[i * height // 3 : (i + 1) * height // 3, 2 * width // 3 + 4 :].astype(int) for i in range(3)]
    response, fit = panels[1][30:-8], panels[2]
    # The panel is 18 m wide: the lines of a lane of 3.7 m, seen 0.3 m from its middle, near the car.
    rows, columns = fit[-20:], (9 + np.array([0.3 - 1.85, 0.3 + 1.85])) / 18 * fit.shape[1]
    red = np.flatnonzero((rows[:, :, 0] - rows[:, :, 1] > 80).any(axis=0))
    blue = np.flatnonzero((rows[:, :, 2] - rows[:, :, 0] > 80).any(axis=0))
    assert np.median(red) == pytest.approx(columns[0], abs=6) and np.median(blue) == pytest.approx(columns[1], abs=6)
    assert (np.ptp(response, axis=2) == 0).all() and response.max() > 200


def test_mosaic_shows_the_evidence_of_a_still():
    image, result = tracked_bends()
    view = BirdsEyeView(SMALL)
    evidence = extract_evidence(view.warp(image), view)
    unpainted = replace(evidence, response=replace(evidence.response, strength=0 * evidence.response.strength))
    height, width = image.shape[:2]
    response = np.s_[height // 3 + 30 : 2 * height // 3 - 8, 2 * width // 3 + 4 :]
    assert STYLES["mosaic"](SMALL)(image, result, evidence)[response].max() > 200
    assert STYLES["mosaic"](SMALL)(image, result, unpainted)[response].max() == 0


def test_track_lane_returns_picture_and_telemetry():
    process = track_lane(LaneTracker(SMALL), SMALL)
    drawn, row = process(BENDS.frame(0.0))
    assert (drawn != BENDS.frame(0.0)).any()
    assert (row["state"], row["departure"]) == ("searching", None)
    assert row["offset_m"] == pytest.approx(BENDS.truth(0.0).offset_m, abs=0.05)
    assert row["left_c0_m"] - row["right_c0_m"] == pytest.approx(row["lane_width_m"], abs=0.05)
    _, row = track_lane(LaneTracker(SMALL), SMALL)(np.zeros_like(drawn))
    assert (row["state"], row["confidence"], row["offset_m"], row["left_c3_per_m2"]) == ("lost", 0.0, None, None)


def test_stills_with_estimated_pose(tmp_path):
    for i in range(3):
        write_image(tmp_path / f"{i}.png", BENDS.frame(i))
    pictures = sorted(tmp_path.glob("*.png"))
    result = annotate_stills(pictures, DriveSettings(output=tmp_path / "out", camera=SMALL.with_pose(None)))
    assert result.found == 3 and result.pose.frames_total == 3
    assert result.describe().startswith("height") and "lane found in 3" in result.describe()
    table = read_telemetry(result.telemetry)
    assert table["picture"].tolist() == ["0.png", "1.png", "2.png"]
    assert table["offset_m"][0] == pytest.approx(BENDS.truth(0).offset_m, abs=0.1)
    assert (read_image(tmp_path / "out" / "0.png") != read_image(pictures[0])).any()
    with pytest.raises(ValueError, match="one of the inputs"):
        annotate_stills(pictures, DriveSettings(output=tmp_path, camera=SMALL))


def test_stills_of_all_formats_keep_their_format(tmp_path):
    for suffix in ("bmp", "tif", "webp"):
        write_image(tmp_path / f"still.{suffix}", BENDS.frame(0))
    result = annotate_folder(tmp_path, tmp_path / "out", SMALL)
    assert [path.name for path in result.pictures] == ["still.bmp", "still.tif", "still.webp"]
    assert result.found == 3 and (read_image(result.pictures[0]) != BENDS.frame(0)).any()


def test_stills_of_different_cameras_have_a_pose_each(tmp_path, capsys):
    camera = Camera.from_fov((960, 540), 60, CameraPose(1.3, np.radians(3.0)))
    for name, image in (("a.png", BENDS.frame(0)), ("b.png", paint_motorway(camera)), ("c.png", GREY)):
        write_image(tmp_path / "in" / name, image)
    assert main(["annotate", "--each", str(tmp_path / "in"), "-o", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr()
    assert re.search(r"a.png: found .*; pose from lane lines: height .*\n.*b.png: found .*pitch 3.0\d ±", printed.out)
    assert "2 pictures, lane found in 2" in printed.out
    assert re.search(r"error: .*c.png: .*so no road is recognised", printed.err)
    assert read_telemetry(tmp_path / "out" / "pictures.csv")["picture"].tolist() == ["a.png", "b.png"]
    assert main(["annotate", "--each", str(tmp_path / "in" / "c.png"), "-o", str(tmp_path / "none")]) == 1
    assert not (tmp_path / "none").exists()


def test_pictures_that_disagree_name_the_option_for_several_cameras(tmp_path):
    pictures = [write_image(tmp_path / f"{name}.png", GREY) for name in "ab"]
    lens = SMALL.with_pose(None)
    with pytest.raises(PoseError, match="several cameras, annotate them with --each"):
        annotate_stills(pictures, DriveSettings(output=tmp_path / "out", camera=lens))
    few = PoseEstimate(Camera.from_fov((640, 360), 60, CameraPose(1.3)), 0.1, 0.01, 0.01, 0.01, 5, 20, 3.66)
    assert "--each" in StillsResult((), tmp_path / "t.csv", 0, few).describe()
    assert "--each" not in StillsResult((), tmp_path / "t.csv", 0, replace(few, frames_used=15)).describe()
    with pytest.raises(PictureError, match="is 640x360 pixels, but the camera is that of pictures of 480x270"):
        Camera.from_fov((480, 270), 60).require_size(GREY)


def test_lost_sound_is_stated(tmp_path):
    drive = make_video_with_unknown_sound(tmp_path / "drive.avi", 3, size=SMALL.size)
    result = annotate_drive(drive, DriveSettings(output=tmp_path / "out", camera=SMALL, report=False))
    assert result.frames == 3 and "sound track cannot be decoded" in result.describe()


def test_unusable_stills_do_not_stop_the_others(tmp_path):
    folder, other = tmp_path / "in", np.zeros((480, 640, 3), np.uint8)
    for name, image in (("b2.jpg", BENDS.frame(0)), ("b10.jpg", BENDS.frame(1)), ("a.jpg", other), ("c.jpg", other)):
        write_image(folder / name, image)
    (folder / "c.jpg").write_bytes((folder / "c.jpg").read_bytes()[:300])
    (folder / "d.png").touch()
    with pytest.raises(PictureError) as error:
        annotate_folder(folder, tmp_path / "out", SMALL.with_pose(None))
    assert re.fullmatch(
        r".*c.jpg: .*cut off.*\n.*d.png: .*empty.*\n.*a.jpg: is 640x480, the others used are 640x360;.*",
        str(error.value),
    )
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"b2.jpg", "b10.jpg", "pictures.csv"}
    drawn = read_image(tmp_path / "out" / "b2.jpg")
    assert (np.abs(drawn.astype(int) - BENDS.frame(0))[220:330].max(axis=2) > 30).mean() > 0.1
    with pytest.raises(PictureError, match=r"c.jpg: .*\n.*d.png"):
        annotate_stills([folder / "c.jpg", folder / "d.png"], DriveSettings(output=tmp_path / "none", camera=SMALL))
    assert not (tmp_path / "none").exists()


def test_folder_of_pictures_is_annotated(tmp_path):
    for name in ("b2.jpg", "b10.jpg"):
        write_image(tmp_path / "in" / name, BENDS.frame(0))
    result = annotate_folder(tmp_path / "in", tmp_path / "out", SMALL)
    assert [path.name for path in result.pictures] == ["b2.jpg", "b10.jpg"]
    assert (result.found, result.failures, result.pose) == (2, (), None)


def test_time_stamps_of_a_variable_frame_rate_are_used(tmp_path):
    """The tracker coasts for one second: one frame later it coasts, 1.5 s later the lane is lost."""
    with VideoWriter(tmp_path / "drive.mp4", fps=25) as writer:
        for number in range(12):
            writer.write(BENDS.frame(number / 25), number / 25)
        writer.write(np.zeros_like(BENDS.frame(0)), 12 / 25)
        writer.write(np.zeros_like(BENDS.frame(0)), 12 / 25 + 1.5)
    settings = DriveSettings(output=tmp_path / "out", camera=SMALL, report=False, progress=False)
    states = read_telemetry(annotate_drive(tmp_path / "drive.mp4", settings).telemetry)["state"]
    assert states[-3:].tolist() == ["tracking", "coasting", "lost"]


def test_pose_is_estimated_from_the_annotated_part_only(tmp_path):
    """The camera pitches down by two degrees half-way; each part gets the pose that it had."""
    pose = SMALL.pose
    # a car that does not sway would have solid lines that never move
    swaying = replace(BENDS, motion=replace(BENDS.motion, wander_m=0.25, pitch_rad=0.003))
    pitched = replace(swaying, camera=SMALL.with_pose(replace(pose, pitch_rad=pose.pitch_rad + np.radians(2))))
    frames = [drive.frame(number / 5) for drive in (swaying, pitched) for number in range(12)]
    with VideoWriter(tmp_path / "drive.mp4", fps=5) as writer:
        for number, frame in enumerate(frames):
            writer.write(frame, number / 5)
    settings = {"output": tmp_path / "out", "camera": SMALL.with_pose(None), "report": False, "progress": False}
    for piece, drive in (({"end_s": 2.4}, BENDS), ({"start_s": 2.4}, pitched)):
        result = annotate_drive(tmp_path / "drive.mp4", DriveSettings(**settings, **piece))
        assert (result.frames, result.pose.frames_total) == (12, 12)
        assert result.pose.pose.pitch_rad == pytest.approx(drive.camera.pose.pitch_rad, abs=np.radians(0.3))


def test_annotation_in_another_process(tmp_path):
    video = write_drive(tmp_path / "drive.mp4", BENDS, 6)
    settings = DriveSettings(output=tmp_path / "out", camera=SMALL, progress=False)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        result = pool.submit(annotate_drive, video, settings).result(timeout=60)
    assert result.frames == 6 and result.pose is None and result.report.is_file()
    assert result.tracked_share == pytest.approx(4 / 6)
    assert read_telemetry(result.telemetry)["offset_m"][-1] == pytest.approx(BENDS.truth(0.2).offset_m, abs=0.05)
