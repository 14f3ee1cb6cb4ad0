"""Robot logs of each kind are read as videos, and their messages say what the table says."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lanes.camera import save_camera
from lanes.canvas import LANE_COLOUR, UNLIKELY_COLOUR
from lanes.drive import DriveSettings, annotate_drive
from lanes.errors import VideoError
from lanes.field_of_view import FieldOfView, read_log_camera
from lanes.files import read_telemetry
from lanes.lane_messages import INFERRED_ALPHA
from lanes.sources import find_sources
from lanes.video.reader import inspect_video, read_timed_frames
from tests.support.clips import FPS
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import names

logs = pytest.importorskip("tests.support.robot_logs", reason="rosbags is not installed: pip install rosbags")
from tests.support.robot_logs import TINY, TINY_TIMES_S, shades, stamp_images, stamps_at, write_messages  # noqa: E402

KINDS = ("drive.bag", "drive.db3", "drive.mcap", "folder")
FRAMES = 16
TIMES_S = np.arange(FRAMES) / FPS
# Columns of the telemetry in metres.
METRES = ("offset_m", "lane_width_m", "left_c0_m", "right_c0_m")


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return [BENDS.frame(time_s) for time_s in TIMES_S]


def settings_for(output: Path, **changes) -> DriveSettings:
    return DriveSettings(output=output, progress=False, report=False, **changes)


def file_of(path: Path) -> Path:
    """The file of a log, which is in a folder if it has no suffix."""
    return path if path.suffix else path / f"{path.name}.db3"


def read_back(path: Path) -> dict[str, list]:
    """The messages of an MCAP file as (time of the recording, message) by topic."""
    messages: dict[str, list] = {}
    with logs.rosbag2.Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            messages.setdefault(connection.topic, []).append(
                (time_ns, logs.ROS2.deserialize_cdr(data, connection.msgtype))
            )
    return messages


@pytest.fixture(scope="module")
def annotated(tmp_path_factory, images) -> tuple[Path, list[int]]:
    """A log whose images 4 and 5 were not recorded, annotated; the folder, and the stamps of its images."""
    folder = tmp_path_factory.mktemp("annotated")
    kept = [number for number in range(FRAMES) if number not in (4, 5)]
    path = logs.write_log(folder / "drive.mcap", [images[n] for n in kept], TIMES_S[kept], camera=SMALL)
    assert annotate_drive(path, settings_for(folder, camera=SMALL)).missing == 2
    return folder, stamps_at(TIMES_S[kept])


def test_the_messages_have_the_stamps_of_the_images_and_the_numbers_of_the_table(annotated):
    folder, stamps = annotated
    table, messages = read_telemetry(folder / "drive.csv"), read_back(folder / "drive.lane.mcap")
    assert table["frame"].tolist() == [n for n in range(FRAMES) if n not in (4, 5)]
    assert inspect_video(folder / "drive.mcap").frames == FRAMES - 2  # a log in the output folder is not overwritten
    for topic, received in messages.items():
        assert [time_ns for time_ns, _ in received] == stamps, topic
    for name in ("confidence", *METRES, "curvature_per_m", "heading_rad"):
        values = [message.data for _, message in messages[f"/lane/{name}"]]
        assert values == pytest.approx(table[name], rel=1e-7, abs=1e-9, nan_ok=True)


def test_the_lines_of_the_messages_are_those_of_the_table_and_of_the_road(annotated):
    folder, stamps = annotated
    table, lines = read_telemetry(folder / "drive.csv"), read_back(folder / "drive.lane.mcap")["/lane/lines"]
    for row, (stamp_ns, message) in enumerate(lines):
        truth = BENDS.truth((stamp_ns - stamps[0]) / 1e9)
        for side, marker, line in zip(("left", "right"), message.markers, (truth.left, truth.right), strict=False):
            assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == divmod(stamp_ns, 10**9)
            assert (marker.header.frame_id, marker.type) == ("base_link", marker.LINE_STRIP)
            points = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)
            if table["state"][row] == "lost":
                assert marker.action == marker.DELETE and not len(points)
                continue
            assert marker.action == marker.ADD and marker.color.g > 0.6
            assert points[0] == pytest.approx([0, table[f"{side}_c0_m"][row], 0], abs=1e-6)
            assert points[-1, 0] >= 12 and (np.diff(points[:, 0]) > 0).all()
            assert points[0, 1] == pytest.approx(line.c0_m, abs=0.1)
    assert table["state"][-1] == "tracking"


def test_the_markers_show_what_is_not_seen_and_what_is_unlikely(tmp_path, images):
    """The last frames are black; with the second pose the camera would look four degrees farther down."""
    path = logs.write_log(tmp_path / "drive.mcap", [*images[:8], *[np.zeros_like(images[0])] * 3], TIMES_S[:11])
    shown = set()
    for turn_deg in (0, 4):
        pose = replace(SMALL.pose, pitch_rad=SMALL.pose.pitch_rad + np.radians(turn_deg))
        table = annotate_drive(path, settings_for(tmp_path / "out", camera=SMALL.with_pose(pose))).telemetry
        for row, (_, message) in enumerate(read_back(tmp_path / "out" / "drive.lane.mcap")["/lane/lines"]):
            likely, seen = table["confidence"][row] >= 0.5, table["state"][row] != "coasting"
            for marker in message.markers[:2]:
                if marker.action == marker.ADD:
                    colour = [marker.color.r, marker.color.g, marker.color.b]
                    assert colour == pytest.approx(np.divide(LANE_COLOUR if likely else UNLIKELY_COLOUR, 255))
                    assert seen or marker.color.a == pytest.approx(INFERRED_ALPHA)
                    shown.add((bool(likely), bool(seen)))
    assert {likely for likely, _ in shown} == {seen for _, seen in shown} == {True, False}


def test_the_frame_of_the_messages_is_at_the_middle_of_the_car(tmp_path, images):
    """The table has the lines as the camera sees them, 0.4 m left of the middle."""
    path = logs.write_log(tmp_path / "drive.mcap", images, TIMES_S)
    table = annotate_drive(path, settings_for(tmp_path, camera=SMALL, camera_offset_m=0.4)).telemetry
    seen_m = np.array([table["left_c0_m"][-1], table["right_c0_m"][-1]])
    _, message = read_back(tmp_path / "drive.lane.mcap")["/lane/lines"][-1]
    assert [marker.points[0].y for marker in message.markers[:2]] == pytest.approx(seen_m + 0.4, abs=1e-6)
    assert table["offset_m"][-1] == pytest.approx(-seen_m.mean() - 0.4, abs=0.01)


def test_a_line_that_is_not_known_is_deleted_and_only_its_confidence_is_a_number(tmp_path, images):
    black = [np.zeros_like(images[0])] * 3
    path = logs.write_log(tmp_path / "night.bag", black, TIMES_S[:3])
    annotate_drive(path, settings_for(tmp_path, camera=SMALL))
    messages = read_back(tmp_path / "night.lane.mcap")
    assert all(marker.action == marker.DELETE for _, each in messages["/lane/lines"] for marker in each.markers)
    assert np.isnan([message.data for _, message in messages["/lane/offset_m"]]).all()
    assert [message.data for _, message in messages["/lane/confidence"]] == [0, 0, 0]


# Reading.


@pytest.mark.parametrize("kind", KINDS)
def test_a_log_of_each_kind_has_the_times_of_the_headers_its_camera_and_gaps_that_skip_numbers(tmp_path, kind):
    times_s = np.array([0, 1, 2, 5, 6, 7]) / 10
    path = file_of(logs.write_log(tmp_path / kind, TINY, times_s, delay_ns=90_000_000, camera=SMALL))
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
    made = (message for _, message in stamp_images(TINY, stamps_ns))
    path = write_messages(tmp_path / "drive.mcap", {"/image": list(zip(recorded, made, strict=True))})
    assert [frame.time_s for frame in read_timed_frames(path)] == pytest.approx(np.arange(6) / 5)


# The camera.


def write_with_info(path: Path, topic: str, **changes) -> Path:
    stamps = stamps_at([0, 0.1])
    made = stamp_images(TINY, stamps)
    info = logs.make_camera_info(SMALL, stamps[0], **changes)
    return write_messages(path, {topic: made, "/front/camera_info": [(stamps[0], info)]})


def test_rectified_images_have_the_projection_matrix_and_no_distortion(tmp_path):
    projection = np.array([[600.0, 0, 300, 0], [0, 610, 170, 0], [0, 0, 1, 0]])
    changes = {"p": projection.ravel(), "distortion_model": "equidistant", "d": np.array([0.1, 0.02, 0, 0])}
    path = write_with_info(tmp_path / "drive.mcap", "/front/image_rect_color", **changes)
    camera = read_log_camera(path)
    assert camera.matrix == pytest.approx(projection[:, :3]) and not camera.distortion.any() and not camera.is_fisheye
    assert read_log_camera(write_with_info(tmp_path / "raw.mcap", "/front/image_raw", **changes)).is_fisheye


def test_a_camera_that_is_not_calibrated_or_of_another_topic_is_none(tmp_path):
    assert read_log_camera(write_with_info(tmp_path / "a.mcap", "/front/image_raw", k=np.zeros(9))) is None
    assert read_log_camera(write_with_info(tmp_path / "b.mcap", "/rear/image_raw")) is None


def test_a_given_field_of_view_comes_before_the_camera_of_the_log(tmp_path):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S, camera=SMALL)
    given, other = FieldOfView(90.0, "as given"), FieldOfView(90.0, "as photo.jpg says (EXIF)")
    assert settings_for(tmp_path, field=given).camera_for(SMALL.size, path).hfov_deg == pytest.approx(90, abs=0.1)
    assert settings_for(tmp_path, field=other).camera_for(SMALL.size, path).matrix == pytest.approx(SMALL.matrix)


# What cannot be used.


def write_two_cameras(path: Path) -> Path:
    stamps, types = stamps_at(TINY_TIMES_S), (logs.ROS1 if path.suffix == ".bag" else logs.ROS2).types
    rear = [image + 100 for image in TINY]
    topics = {"/front/image_raw": TINY, "/rear/image_raw": rear}
    return write_messages(path, {name: stamp_images(some, stamps, "rgb8", types) for name, some in topics.items()})


@pytest.mark.parametrize("kind", KINDS[:3])
def test_one_of_two_cameras_is_chosen_by_its_topic(tmp_path, kind):
    path = file_of(write_two_cameras(tmp_path / kind))
    with pytest.raises(VideoError, match="/front/image_raw, /rear/image_raw; choose one of them with --topic"):
        inspect_video(path)
    with pytest.raises(VideoError, match="/front/image_raw, /rear/image_raw, not on /left; choose"):
        inspect_video(path, topic="/left")
    frame = next(read_timed_frames(path, start_s=0.2, topic="/rear/image_raw"))
    assert frame.number == 2 and (frame.image == TINY[2] + 100).all()


def test_compressed_copies_of_the_images_are_no_second_camera(tmp_path):
    stamps = stamps_at([0, 0.1])
    topics = {"/image/compressed": stamp_images(TINY, stamps, ".jpg"), "/image": stamp_images(TINY, stamps)}
    path = write_messages(tmp_path / "drive.mcap", topics)
    assert inspect_video(path).topic == "/image"


def test_the_command_takes_the_topic(tmp_path, images, run):
    stamps, sky = stamps_at(TIMES_S), [np.full_like(images[0], 200)] * FRAMES
    topics = {"/front": stamp_images(images, stamps, ".png"), "/up": stamp_images(sky, stamps, ".png")}
    path = write_messages(tmp_path / "drive.mcap", topics)
    save_camera(SMALL, tmp_path / "camera.yaml")
    common = "--camera", tmp_path / "camera.yaml", path, "-o"
    status, _, err = run("annotate", *common, tmp_path / "none")
    assert status == 2 and "choose one of them with --topic" in err and not (tmp_path / "none").exists()
    for command, output in (("annotate", "out"), ("detect", "lanes.jsonl"), ("explain", "explained.png")):
        part = ["--end", 0.3] if command != "explain" else []
        assert run(command, *common, tmp_path / output, *part, "--topic", "/front")[0] == 0
    assert (read_telemetry(tmp_path / "out" / "drive.csv")["state"] == "tracking").any()
    assert names(tmp_path / "out") == {f"drive{suffix}" for suffix in (".csv", ".html", ".lane.mcap", ".mp4")}


@pytest.mark.parametrize(("kind", "share"), [*zip(KINDS, (0.95, 0.3, 0.95, 0.001), strict=True)])
def test_a_log_that_was_cut_off_ends_with_a_sentence(tmp_path, kind, share):
    path = file_of(logs.write_log(tmp_path / kind, TINY * 40, np.arange(240) / 10))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(VideoError, match=r"(cut off, damaged, encrypted or no robot log|the file is empty)"):
        inspect_video(path)


def test_an_encrypted_log_ends_with_a_sentence(tmp_path):
    path = logs.write_log(tmp_path / "drive.bag", TINY, TINY_TIMES_S)
    version, data = path.read_bytes().split(b"\n", 1)
    field = b"\x20\0\0\0encryptor=rosbag/AesCbcEncryptor"
    # the header of the bag is padded to 4096 bytes: a field is added, and as much of the padding is removed
    end = 4 + int.from_bytes(data[:4], "little")
    header = (end - 4 + len(field)).to_bytes(4, "little") + data[4:end] + field
    padding = (int.from_bytes(data[end : end + 4], "little") - len(field)).to_bytes(4, "little")
    path.write_bytes(version + b"\n" + header + padding + data[end + 4 + len(field) :])
    with pytest.raises(VideoError, match=r"drive\.bag: is cut off, damaged, encrypted.*AesCbcEncryptor.*; copy it"):
        inspect_video(path)


@pytest.mark.parametrize(
    ("topics", "sentence"),
    [
        ({"/a": [(1, logs.make_image(TINY[0], 1, "32FC1"))]}, "/a has the encoding '32FC1'; record one of rgb8"),
        ({"/a": [(1, logs.ROS2.types["std_msgs/msg/String"]("hello"))]}, "has images on no topic; name another log"),
        ({"/a": stamp_images(TINY, [logs.BEGIN_NS])}, "has 1 images"),
    ],
)
def test_images_that_are_not_read_end_with_a_sentence(tmp_path, topics, sentence):
    with pytest.raises(VideoError, match=rf"drive\.mcap: {sentence}"):
        inspect_video(write_messages(tmp_path / "drive.mcap", topics))


def test_without_rosbags_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(VideoError, match=r"drive\.mcap: .*pip install rosbags"):
        inspect_video(path)
