"""Robot logs of each kind are read as videos, and their messages say what the table says."""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lanes.annotation import DriveSettings
from lanes.camera.field_of_view import FieldOfView, read_log_camera
from lanes.camera.model import save_camera
from lanes.canvas import LANE_COLOUR, UNLIKELY_COLOUR
from lanes.detect.lane import telemetry_row
from lanes.detect.road import road_height
from lanes.detect.search import find_lane
from lanes.drive import annotate_drive, track
from lanes.drive_camera import camera_for
from lanes.errors import VideoError
from lanes.files import read_telemetry
from lanes.ros.lane_messages import INFERRED_ALPHA, write_lane_messages
from lanes.ros.robot_log import index_log
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.sources import find_sources
from tests.support import robot_logs as logs
from tests.support.clips import FPS
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import names
from tests.support.robot_logs import TINY, TINY_TIMES_S, shades, stamp_images, stamps_at, write_messages

# Names with signs of addresses are those of files, too; capitals do not matter.
KINDS = ("drive.bag", "what?50%25.db3", "DRIVE#2.MCAP", "folder")
FRAMES = 20
TIMES_S = np.arange(FRAMES) / FPS
DARK = {0, 1, 2, 17, 18, 19}
CAMERA_OFFSET_M = 0.4


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return [BENDS.frame(time_s) for time_s in TIMES_S]


def settings_for(output: Path, **changes) -> DriveSettings:
    return DriveSettings(output=output, progress=False, report=False, **changes)


# The messages of a drive.


def read_back(path: Path) -> dict[str, list]:
    """The messages of an MCAP file as (time of the recording, message) by topic."""
    messages: dict[str, list] = {}
    with logs.rosbag2.Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            message = logs.ROS2.deserialize_cdr(data, connection.msgtype)
            messages.setdefault(connection.topic, []).append((time_ns, message))
    return messages


@pytest.fixture(scope="module")
def annotated(tmp_path_factory, images) -> tuple[dict[str, np.ndarray], dict[str, list], list[int]]:
    """Table, messages and stamps of a log that begins and ends in the dark, without images 6 and 7.

    The camera is 0.4 m left of the middle of the car.
    """
    folder = tmp_path_factory.mktemp("annotated")
    kept = [number for number in range(FRAMES) if number not in (6, 7)]
    shown = [np.zeros_like(images[n]) if n in DARK else images[n] for n in kept]
    path = logs.write_log(folder / "drive.mcap", shown, TIMES_S[kept], camera=SMALL)
    result = annotate_drive(path, settings_for(folder, camera=SMALL, camera_offset_m=CAMERA_OFFSET_M))
    assert result.missing == 2 and result.telemetry["frame"].tolist() == kept
    assert [file.name for file in result.outputs] == ["drive.mp4", "drive.csv", "drive.lane.mcap"]
    assert inspect_video(path).frames == FRAMES - 2  # a log in the output folder is not overwritten
    return result.telemetry, read_back(folder / "drive.lane.mcap"), stamps_at(TIMES_S[kept])


def test_the_messages_have_the_stamps_of_the_images_and_the_numbers_of_the_table(annotated):
    table, messages, stamps = annotated
    assert all([time_ns for time_ns, _ in received] == stamps for received in messages.values())
    for name in ("confidence", "offset_m", "lane_width_m", "left_c0_m", "right_c0_m", "curvature_per_m", "heading_rad"):
        values = [message.data for _, message in messages[f"/lane/{name}"]]
        assert values == pytest.approx(table[name], rel=1e-7, abs=1e-9, nan_ok=True)


def test_the_markers_are_the_lines_on_the_road_from_the_middle_of_the_car(annotated):
    """A line that is not seen is transparent, one that is not known is deleted."""
    table, messages, stamps = annotated
    assert {"lost", "tracking", "coasting"} <= set(table["state"])
    for row, (stamp_ns, message) in enumerate(messages["/lane/lines"]):
        truth = BENDS.truth((stamp_ns - stamps[0]) / 1e9)
        for side, marker, line in zip(("left", "right"), message.markers, (truth.left, truth.right), strict=False):
            assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == divmod(stamp_ns, 10**9)
            assert (marker.header.frame_id, marker.type) == ("base_link", marker.LINE_STRIP)
            points = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)
            if table["state"][row] == "lost":
                assert marker.action == marker.DELETE and not len(points)
                continue
            assert marker.action == marker.ADD
            assert_has_colour(marker, table["confidence"][row])
            assert marker.color.a == (pytest.approx(INFERRED_ALPHA) if table["state"][row] == "coasting" else 1)
            assert points[0] == pytest.approx([0, table[f"{side}_c0_m"][row] + CAMERA_OFFSET_M, 0], abs=1e-6)
            assert points[-1, 0] >= 12 and (np.diff(points[:, 0]) > 0).all()
            assert points[0, 1] - CAMERA_OFFSET_M == pytest.approx(line.c0_m, abs=0.1)


def assert_has_colour(marker: object, confidence: float) -> None:
    expected = np.divide(LANE_COLOUR if confidence >= 0.5 else UNLIKELY_COLOUR, 255)
    assert [marker.color.r, marker.color.g, marker.color.b] == pytest.approx(expected)


def test_the_markers_show_what_is_unlikely(tmp_path, images):
    """The camera would look four degrees farther down."""
    path = logs.write_log(tmp_path / "drive.mcap", images[:8], TIMES_S[:8])
    camera = SMALL.with_pose(replace(SMALL.pose, pitch_rad=SMALL.pose.pitch_rad + np.radians(4)))
    table = annotate_drive(path, settings_for(tmp_path / "out", camera=camera)).telemetry
    assert table["confidence"][-1] < 0.5 and table["state"][-1] != "lost"
    _, message = read_back(tmp_path / "out" / "drive.lane.mcap")["/lane/lines"][-1]
    assert_has_colour(message.markers[0], table["confidence"][-1])


def test_the_markers_go_over_hills_to_the_ends_of_all_lines(tmp_path, images):
    """In this image the far line on the right is seen."""
    lane, log = find_lane(images[0], SMALL), index_log(logs.write_log(tmp_path / "a.mcap", images[:2], [0, 0.04]))
    with write_lane_messages(tmp_path / "a.csv", SimpleNamespace(lane=lane), log) as table:
        table.write({"frame": 0, **telemetry_row(lane)})
    ((_, message),) = read_back(tmp_path / "a.lane.mcap")["/lane/lines"]
    *lines, far_left, far_right = [np.array([(p.x, p.y, p.z) for p in m.points]) for m in message.markers]
    assert not len(far_left) and far_right[0, 1] == pytest.approx(-5.4, abs=0.5)
    for (x_m, _, z_m), end_m in zip((line[-1] for line in lines), lane.ends_m, strict=True):
        assert (x_m, z_m) == pytest.approx((end_m, road_height(lane.model, end_m))) and z_m != 0


def test_messages_need_no_space_in_the_temporary_folder(tmp_path, images, monkeypatch, run):
    """It may be in memory. What a killed run has left is replaced, and nothing else stays."""
    out = tmp_path / "out"
    log = logs.write_log(tmp_path / "drive.mcap", images[3:7], np.arange(4) / 25, camera=SMALL)
    save_camera(SMALL, tmp_path / "camera.yaml")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nothing"))
    (out / "drive.lane.partial.spool" / "lane").mkdir(parents=True)
    (out / "drive.lane.partial.spool" / "lane" / "lane.mcap").write_bytes(b"half")
    assert run("annotate", "--camera", tmp_path / "camera.yaml", log, "-o", out)[0] == 0
    assert names(out) == {"drive.mp4", "drive.csv", "drive.html", "drive.lane.mcap"}

    def fail(*_: object) -> None:
        raise OSError("no space")

    monkeypatch.setattr("lanes.ros.lane_messages.LaneMessageWriter.write", fail)
    with pytest.raises(OSError, match="no space"):
        annotate_drive(log, settings_for(tmp_path / "failed", camera=SMALL))
    assert names(tmp_path / "failed") == set()


# Reading.


@pytest.mark.parametrize("kind", KINDS)
def test_a_log_of_each_kind_has_the_times_of_the_headers_its_camera_and_gaps_that_skip_numbers(tmp_path, kind):
    times_s = np.array([0, 1, 2, 5, 6, 7]) / 10
    path = logs.file_of(logs.write_log(tmp_path / kind, TINY, times_s, camera=SMALL))
    assert find_sources([str(path)]).videos == (path,) and read_log_camera(path).with_pose(SMALL.pose) == SMALL
    info, frames = inspect_video(path), list(read_timed_frames(path))
    assert (info.width, info.height, info.fps, info.frames, info.missing) == (12, 8, 10, 6, 2)
    assert info.duration_s == pytest.approx(0.8) and info.topic == "/camera/image_raw"
    assert [frame.number for frame in frames] == [0, 1, 2, 5, 6, 7]
    assert [frame.time_s for frame in frames] == pytest.approx(times_s)
    assert [frame.elapsed_s for frame in frames[1:]] == pytest.approx(np.diff(times_s))
    assert all((frame.image == image).all() for frame, image in zip(frames, TINY, strict=True))
    assert [frame.number for frame in read_timed_frames(path, start_s=0.2, end_s=0.6)] == [2, 5]
    with pytest.raises(VideoError, match=r"no frame at or after 0\.8 s"):
        next(read_timed_frames(path, start_s=0.8))


def test_a_log_that_is_replaced_under_its_name_is_read_again(tmp_path):
    """Also by a copy that keeps the time of the change."""
    path, other = (tmp_path / name for name in ("drive.mcap", "other.mcap"))
    logs.write_log(path, TINY, TINY_TIMES_S)
    assert inspect_video(path).frames == 6
    logs.write_log(other, [image + 100 for image in TINY[:4]], np.arange(4) / 10)
    os.utime(other, ns=(0, path.stat().st_mtime_ns))
    other.replace(path)
    assert inspect_video(path).frames == 4 and shades(path) == [100, 120, 140, 160]


RESTARTED = [*stamps_at([5.0, 5.1, 5.2]), *stamps_at([1.0, 1.1, 1.2])]


@pytest.mark.parametrize("stamps_ns", [[0] * 6, [10**18] * 6, RESTARTED])
def test_without_usable_stamps_the_times_are_those_of_the_recording(tmp_path, stamps_ns):
    recorded = stamps_at(np.arange(6) / 5)
    path = logs.write_log(tmp_path / "drive.mcap", TINY, stamps_ns=stamps_ns, recorded_ns=recorded)
    assert [frame.time_s for frame in read_timed_frames(path)] == pytest.approx(np.arange(6) / 5)


# The camera.


def test_the_camera_of_a_log_is_that_of_its_images(tmp_path):
    """Of rectified ones the projection matrix; none if it is not calibrated, or of another topic."""
    projection = np.array([[600.0, 0, 300, 0], [0, 610, 170, 0], [0, 0, 1, 0]])
    changes = {"p": projection.ravel(), "distortion_model": "equidistant", "d": np.array([0.1, 0.02, 0, 0])}
    cameras = []
    for topic, more in (
        ("/camera/image_rect_color", changes),
        ("/camera/image_raw", changes),
        ("/camera/image_raw", {"k": np.zeros(9)}),
        ("/rear/image_raw", {}),
    ):
        path = tmp_path / f"{len(cameras)}.mcap"
        logs.write_log(path, TINY[:2], [0, 0.1], camera=SMALL, topic=topic, **more)
        cameras.append(read_log_camera(path))
    camera = cameras[0]
    assert camera.matrix == pytest.approx(projection[:, :3]) and not camera.distortion.any() and not camera.is_fisheye
    assert cameras[1].is_fisheye and cameras[2:] == [None, None]


def test_a_given_field_of_view_comes_before_the_camera_of_the_log(tmp_path):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S, camera=SMALL)
    given, other = FieldOfView(90.0, "as given"), FieldOfView(90.0, "as photo.jpg says (EXIF)")
    assert camera_for(settings_for(tmp_path, field=given), SMALL.size, path).hfov_deg == pytest.approx(90, abs=0.1)
    assert camera_for(settings_for(tmp_path, field=other), SMALL.size, path).matrix == pytest.approx(SMALL.matrix)


# Several topics.


@pytest.mark.parametrize("kind", KINDS[:3])
def test_one_of_two_cameras_is_chosen_by_its_topic(tmp_path, kind):
    stamps, types = stamps_at(TINY_TIMES_S), (logs.ROS1 if kind.endswith(".bag") else logs.ROS2).types
    topics = {"/front/image_raw": TINY, "/rear/image_raw": [image + 100 for image in TINY]}
    made = {name: stamp_images(some, stamps, "rgb8", types) for name, some in topics.items()}
    path = write_messages(tmp_path / kind, made)
    with pytest.raises(VideoError, match="/front/image_raw, /rear/image_raw; choose one of them with --topic"):
        inspect_video(path)
    with pytest.raises(VideoError, match="/front/image_raw, /rear/image_raw, not on /left; choose"):
        inspect_video(path, topic="/left")
    frame = next(read_timed_frames(path, start_s=0.2, topic="/rear/image_raw"))
    assert frame.number == 2 and (frame.image == TINY[2] + 100).all()


def test_compressed_copies_of_the_images_are_no_second_camera(tmp_path):
    stamps = stamps_at([0, 0.1])
    topics = {"/image/compressed": stamp_images(TINY, stamps, ".jpg"), "/image": stamp_images(TINY, stamps)}
    assert inspect_video(write_messages(tmp_path / "drive.mcap", topics)).topic == "/image"


def test_all_commands_take_the_topic_and_a_part(tmp_path, images, run):
    stamps, sky = stamps_at(TIMES_S), [np.full_like(images[0], 200)] * FRAMES
    topics = {"/front": stamp_images(images, stamps, ".png"), "/up": stamp_images(sky, stamps, ".png")}
    path = write_messages(tmp_path / "drive.mcap", topics)
    save_camera(SMALL, tmp_path / "camera.yaml")
    status, _, err = run("annotate", path, "-o", tmp_path / "none")
    assert status == 2 and "choose one of them with --topic" in err and not (tmp_path / "none").exists()
    outputs = {"annotate": "out", "detect": "lanes.jsonl", "explain": "a.png", "label": "labels", "pose": "pose.yaml"}
    for command, output in outputs.items():
        more = ["--stills", 2] if command == "label" else []
        # a camera without a pose: it is that of the images on the topic
        more += ["--hfov", SMALL.hfov_deg] if command == "explain" else ["--camera", tmp_path / "camera.yaml"]
        part = "--topic", "/front", "--start", 0.2, "--end", 0.4
        status, out, _ = run(command, *more, path, "-o", tmp_path / output, *part)
        assert status == 0 and ("5 of 5 used" in out) == (command in ("explain", "pose"))
    table = read_telemetry(tmp_path / "out" / "drive.csv")
    assert table["frame"].tolist() == [5, 6, 7, 8, 9] and (table["state"] == "tracking").any()
    assert "--topic /front --start 0.2" in (tmp_path / "out" / "drive.html").read_text()
    assert next(track(path, SMALL, start_s=0.2, topic="/front"))[0].number == 5
    assert names(tmp_path / "out") == {f"drive{suffix}" for suffix in (".csv", ".html", ".lane.mcap", ".mp4")}
    stills = [read_image(still) for still in sorted((tmp_path / "labels").glob("*.png"))]
    assert [np.array_equal(*pair) for pair in zip(stills, (images[5], images[8]), strict=True)] == [True, True]


def test_without_rosbags_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(VideoError, match=r"drive\.mcap: .*pip install rosbags"):
        inspect_video(path)
