"""Robot logs of each kind are read as videos; their messages are those of the table."""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lanes.annotation import Annotation, DriveSettings
from lanes.camera.field_of_view import FieldOfView, read_log_camera
from lanes.camera.model import save_camera
from lanes.canvas import LANE_COLOUR, UNLIKELY_COLOUR
from lanes.detect.road import road_height
from lanes.detect.search import find_lane
from lanes.drive import annotate_drive, track
from lanes.drive_camera import camera_for
from lanes.errors import CameraError, VideoError
from lanes.files import read_telemetry
from lanes.ros.robot_log import index_log
from lanes.show.lane_messages import INFERRED_ALPHA, write_lane_messages
from lanes.telemetry import telemetry_row
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.sources import find_sources
from tests.support import robot_logs as logs
from tests.support.clips import FPS
from tests.support.faults import Fault
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import names
from tests.support.robot_logs import (
    TINY,
    TINY_TIMES_S,
    shades,
    stamp_images,
    stamps_at,
    write_messages,
)

# Names with signs of addresses are those of files, too; capitals do not matter.
KINDS = ("drive.bag", "what?50%25.db3", "DRIVE#2.MCAP", "folder")
FRAMES = 20
TIMES_S = np.arange(FRAMES) / FPS
DARK = {0, 1, 2, 17, 18, 19}
CAMERA_OFFSET_M = 0.4


@pytest.fixture(scope="module")
def images() -> list[np.ndarray]:
    return [BENDS.frame(time_s) for time_s in TIMES_S]


def settings_for(output: Path, **changes: Any) -> DriveSettings:
    return DriveSettings(output=output, progress=False, report=False, **changes)


# The messages of a drive.

# (time of the recording in ns, message) of each message by topic.
Received = dict[str, list[tuple[int, Any]]]


def read_back(path: Path) -> Received:
    """The messages of an MCAP file."""
    messages: Received = {}
    with logs.rosbag2.Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            message = logs.ROS2.deserialize_cdr(data, connection.msgtype)
            messages.setdefault(connection.topic, []).append((time_ns, message))
    return messages


def points_of(marker: Any) -> np.ndarray:
    """The points (N, 3) of a marker."""
    points = [(point.x, point.y, point.z) for point in marker.points]
    return np.array(points).reshape(-1, 3)


@dataclass(frozen=True)
class AnnotatedLog:
    """A log that begins and ends in the dark, without images 6 and 7.

    The camera is 0.4 m left of the middle of the car.
    """

    path: Path
    kept: list[int]
    result: Annotation
    messages: Received

    @property
    def stamps(self) -> list[int]:
        return stamps_at(TIMES_S[self.kept])


@pytest.fixture(scope="module")
def annotated(tmp_path_factory, images) -> AnnotatedLog:
    folder = tmp_path_factory.mktemp("annotated")
    kept = [number for number in range(FRAMES) if number not in (6, 7)]
    shown = []
    for number in kept:
        is_dark = number in DARK
        image = images[number]
        shown.append(np.zeros_like(image) if is_dark else image)
    path = folder / "drive.mcap"
    logs.write_log(path, shown, TIMES_S[kept], camera=SMALL)

    camera = {"camera": SMALL, "camera_offset_m": CAMERA_OFFSET_M}
    result = annotate_drive(path, settings_for(folder, **camera))
    messages = read_back(folder / "drive.lane.mcap")
    return AnnotatedLog(path, kept, result, messages)


def test_an_annotated_log_has_a_video_a_table_and_messages(annotated):
    outputs = [file.name for file in annotated.result.outputs]
    assert outputs == ["drive.mp4", "drive.csv", "drive.lane.mcap"]


def test_images_that_are_missing_in_a_log_are_missing_in_the_table(annotated):
    assert annotated.result.missing == 2
    assert annotated.result.telemetry["frame"].tolist() == annotated.kept


def test_a_log_in_the_output_folder_is_not_overwritten(annotated):
    assert inspect_video(annotated.path).frames == FRAMES - 2


def test_the_messages_have_the_stamps_of_the_images(annotated):
    for received in annotated.messages.values():
        assert [time_ns for time_ns, _ in received] == annotated.stamps


@pytest.mark.parametrize(
    "name",
    [
        "confidence",
        "offset_m",
        "lane_width_m",
        "left_c0_m",
        "right_c0_m",
        "curvature_per_m",
        "heading_rad",
    ],
)
def test_the_messages_have_the_numbers_of_the_table(annotated, name):
    received = annotated.messages[f"/lane/{name}"]
    found = [message.data for _, message in received]
    expected = annotated.result.telemetry[name]
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize(("number", "side"), [(0, "left"), (1, "right")])
class TestMarker:
    @pytest.fixture
    def rows(self, annotated, number) -> list[tuple[dict, int, Any]]:
        """Row of the table, stamp in ns and marker of each image."""
        table = annotated.result.telemetry
        rows = []
        for place, (stamp_ns, message) in enumerate(annotated.messages["/lane/lines"]):
            row = {name: values[place] for name, values in table.items()}
            rows.append((row, stamp_ns, message.markers[number]))
        return rows

    def test_has_the_frame_and_stamp_of_the_image(self, rows, side):
        for _, stamp_ns, marker in rows:
            stamp = marker.header.stamp
            assert (stamp.sec, stamp.nanosec) == divmod(stamp_ns, 10**9)
            assert marker.header.frame_id == "base_link"
            assert marker.type == marker.LINE_STRIP

    def test_of_a_lost_lane_deletes_the_line(self, rows, side):
        lost = [marker for row, _, marker in rows if row["state"] == "lost"]
        assert len(lost) > 0
        for marker in lost:
            assert marker.action == marker.DELETE
            assert len(marker.points) == 0

    @pytest.mark.parametrize(
        ("state", "opacity"), [("tracking", 1), ("coasting", INFERRED_ALPHA)]
    )
    def test_of_a_lane_has_the_colour_of_its_confidence(
        self, rows, side, state, opacity
    ):
        """A line that is not seen is transparent."""
        found = [row for row in rows if row[0]["state"] == state]
        assert len(found) > 0
        for row, _, marker in found:
            assert marker.action == marker.ADD
            assert_has_colour(marker, row["confidence"])
            assert marker.color.a == pytest.approx(opacity)

    def test_is_the_line_on_the_road_from_the_middle_of_the_car(
        self, rows, annotated, side
    ):
        for row, stamp_ns, marker in rows:
            if row["state"] == "lost":
                continue
            points = points_of(marker)
            start = [0, row[f"{side}_c0_m"] + CAMERA_OFFSET_M, 0]
            assert points[0] == pytest.approx(start, abs=1e-6)
            steps_m = np.diff(points[:, 0])
            assert steps_m.min() > 0
            assert points[-1, 0] >= 12
            truth = BENDS.truth((stamp_ns - annotated.stamps[0]) / 1e9)
            true_m = getattr(truth, side).c0_m
            from_camera_m = points[0, 1] - CAMERA_OFFSET_M
            assert from_camera_m == pytest.approx(true_m, abs=0.1)


def assert_has_colour(marker: Any, confidence: float) -> None:
    rgb = LANE_COLOUR if confidence >= 0.5 else UNLIKELY_COLOUR
    found = [marker.color.r, marker.color.g, marker.color.b]
    assert found == pytest.approx(np.divide(rgb, 255))


def test_the_markers_show_what_is_unlikely(tmp_path, images):
    """The camera would look two and a half degrees farther down: the first lane is
    stated, and doubtful.
    """
    path = logs.write_log(tmp_path / "drive.mcap", images[:8], TIMES_S[:8])
    pitch_rad = SMALL.pose.pitch_rad + np.radians(2.5)
    camera = SMALL.with_pose(replace(SMALL.pose, pitch_rad=pitch_rad))
    settings = settings_for(tmp_path / "out", camera=camera)
    table = annotate_drive(path, settings).telemetry
    assert table["confidence"][0] < 0.5
    assert table["state"][0] != "lost"

    received = read_back(tmp_path / "out" / "drive.lane.mcap")["/lane/lines"]
    _, message = received[0]
    assert_has_colour(message.markers[0], table["confidence"][0])


class TestMarkersOfOneLane:
    """In this image the far line on the right is seen, that on the left is not."""

    @pytest.fixture
    def lane(self, images):
        return find_lane(images[0], SMALL)

    @pytest.fixture
    def markers(self, tmp_path, images, lane) -> list[np.ndarray]:
        """The points (N, 3) of each."""
        path = logs.write_log(tmp_path / "a.mcap", images[:2], [0, 0.04])
        tracker = SimpleNamespace(lane=lane)
        with write_lane_messages(tmp_path / "a.csv", tracker, index_log(path)) as table:
            table.write({"frame": 0, **telemetry_row(lane)})
        ((_, message),) = read_back(tmp_path / "a.lane.mcap")["/lane/lines"]
        return [points_of(marker) for marker in message.markers]

    def test_go_over_hills_to_the_ends_of_both_lines(self, lane, markers):
        for points, end_m in zip(markers[:2], lane.ends_m, strict=True):
            x_m, _, z_m = points[-1]
            assert x_m == pytest.approx(end_m)
            assert z_m == pytest.approx(road_height(lane.model, end_m))
            assert z_m != 0

    def test_are_those_of_the_far_lines_that_are_seen(self, markers):
        far_left, far_right = markers[2:]
        assert len(far_left) == 0
        assert far_right[0, 1] == pytest.approx(-5.4, abs=0.5)


def test_a_failed_drive_leaves_no_messages(tmp_path, images):
    path = tmp_path / "drive.mcap"
    logs.write_log(path, images[3:7], np.arange(4) / 25, camera=SMALL)
    full_disk = Fault(tmp_path / "calls", "full disk")
    settings = settings_for(tmp_path / "failed", camera=SMALL, markings=full_disk)
    with pytest.raises(OSError, match="No space left"):
        annotate_drive(path, settings)
    assert names(tmp_path / "failed") == set()


def test_messages_need_no_space_in_the_temporary_folder(
    tmp_path, images, monkeypatch, run
):
    """What a killed run has left is replaced, and nothing else stays."""
    path = tmp_path / "drive.mcap"
    logs.write_log(path, images[3:7], np.arange(4) / 25, camera=SMALL)
    camera = save_camera(SMALL, tmp_path / "camera.yaml")
    output = tmp_path / "out"
    left = output / "drive.lane.partial.spool" / "lane"
    left.mkdir(parents=True)
    (left / "lane.mcap").write_bytes(b"half")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nothing"))
    status, _, err = run("annotate", "--camera", camera, path, "-o", output)
    assert status == 0, err
    expected = {"drive.mp4", "drive.csv", "drive.html", "drive.lane.mcap"}
    assert names(output) == expected


# Reading.


@pytest.mark.parametrize("kind", KINDS)
class TestLog:
    TIMES_S = (0.0, 0.1, 0.2, 0.5, 0.6, 0.7)

    @pytest.fixture
    def path(self, tmp_path, kind) -> Path:
        path = tmp_path / kind
        return logs.file_of(logs.write_log(path, TINY, self.TIMES_S, camera=SMALL))

    def test_is_a_source_with_a_camera(self, path):
        assert find_sources([str(path)]).videos == (path,)
        assert read_log_camera(path).with_pose(SMALL.pose) == SMALL

    def test_is_described_as_a_video(self, path):
        info = inspect_video(path)
        assert (info.width, info.height, info.fps) == (12, 8, 10)
        assert (info.frames, info.missing) == (6, 2)
        assert info.duration_s == pytest.approx(0.8)
        assert info.topic == "/camera/image_raw"

    def test_has_its_images_at_the_times_of_the_headers(self, path):
        frames = list(read_timed_frames(path))
        np.testing.assert_array_equal([frame.image for frame in frames], TINY)
        assert [frame.time_s for frame in frames] == pytest.approx(self.TIMES_S)
        elapsed_s = [frame.elapsed_s for frame in frames[1:]]
        assert elapsed_s == pytest.approx(np.diff(self.TIMES_S))

    def test_has_gaps_that_skip_numbers(self, path):
        numbers = [frame.number for frame in read_timed_frames(path)]
        assert numbers == [0, 1, 2, 5, 6, 7]

    def test_is_read_in_parts(self, path):
        part = read_timed_frames(path, start_s=0.2, end_s=0.6)
        assert [frame.number for frame in part] == [2, 5]
        with pytest.raises(VideoError, match=r"no frame at or after 0\.8 s"):
            next(read_timed_frames(path, start_s=0.8))


def test_a_log_that_is_replaced_under_its_name_is_read_again(tmp_path):
    """Also by a copy that keeps the time of the change."""
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S)
    assert inspect_video(path).frames == 6
    brighter = [image + 100 for image in TINY[:4]]
    other = logs.write_log(tmp_path / "other.mcap", brighter, np.arange(4) / 10)
    os.utime(other, ns=(0, path.stat().st_mtime_ns))
    other.replace(path)
    assert inspect_video(path).frames == 4
    assert shades(path) == [100, 120, 140, 160]


RESTARTED = stamps_at([5.0, 5.1, 5.2, 1.0, 1.1, 1.2])


@pytest.mark.parametrize(
    "stamps_ns",
    [[0] * 6, [10**18] * 6, RESTARTED],
    ids=["none", "constant", "restarted"],
)
def test_without_usable_stamps_the_times_are_those_of_the_recording(
    tmp_path, stamps_ns
):
    recorded_ns = stamps_at(np.arange(6) / 5)
    path = tmp_path / "drive.mcap"
    logs.write_log(path, TINY, stamps_ns=stamps_ns, recorded_ns=recorded_ns)
    times_s = [frame.time_s for frame in read_timed_frames(path)]
    assert times_s == pytest.approx(np.arange(6) / 5)


# The camera.


class TestCameraOfLog:
    PROJECTION = np.array(
        [
            [600.0, 0, 300, 0],
            [0, 610, 170, 0],
            [0, 0, 1, 0],
        ]
    )

    def read(self, folder: Path, topic: str, **changes: Any):
        path = folder / "a.mcap"
        images, times_s = TINY[:2], [0, 0.1]
        logs.write_log(path, images, times_s, camera=SMALL, topic=topic, **changes)
        return read_log_camera(path)

    @pytest.fixture
    def fisheye(self) -> dict[str, object]:
        return {
            "p": self.PROJECTION.ravel(),
            "distortion_model": "equidistant",
            "d": np.array([0.1, 0.02, 0, 0]),
        }

    def test_is_that_of_its_images(self, tmp_path, fisheye):
        assert self.read(tmp_path, "/camera/image_raw", **fisheye).is_fisheye

    def test_is_the_projection_matrix_of_rectified_images(self, tmp_path, fisheye):
        camera = self.read(tmp_path, "/camera/image_rect_color", **fisheye)
        assert camera.matrix == pytest.approx(self.PROJECTION[:, :3])
        assert not camera.distortion.any()
        assert not camera.is_fisheye

    @pytest.mark.parametrize(
        "name", ["image_rect", "image_rectified", "left_rect_raw", "rect"]
    )
    def test_words_of_a_topic_say_that_its_images_are_rectified(
        self, tmp_path, fisheye, name
    ):
        camera = self.read(tmp_path, f"/camera/{name}", **fisheye)
        assert camera.matrix == pytest.approx(self.PROJECTION[:, :3])

    @pytest.mark.parametrize(
        "name",
        ["image_unrectified", "image_corrected", "image_not_rectified", "image_direct"],
    )
    def test_words_that_contain_rect_do_not(self, tmp_path, fisheye, name):
        assert self.read(tmp_path, f"/camera/{name}", **fisheye).is_fisheye

    def test_of_rectified_images_needs_no_other_matrix(self, tmp_path, fisheye):
        changes = fisheye | {"k": np.zeros(9)}
        camera = self.read(tmp_path, "/camera/image_rect", **changes)
        assert camera.matrix == pytest.approx(self.PROJECTION[:, :3])

    @pytest.mark.parametrize(
        "first",
        [
            {"k": np.zeros(9), "p": np.zeros(12), "width": 0, "height": 0},
            {"width": 0, "height": 0},
            None,
        ],
        ids=["empty", "without a size", "damaged"],
    )
    def test_is_that_of_the_first_message_with_a_calibration(self, tmp_path, first):
        path = self.with_calibrations(tmp_path / "a.mcap", [first, first, {}])
        assert read_log_camera(path).with_pose(SMALL.pose) == SMALL

    def test_is_refused_if_no_message_can_be_read(self, tmp_path):
        path = self.with_calibrations(tmp_path / "a.mcap", [None, None])
        words = r"no message on /camera/camera_info can be read; give --camera"
        with pytest.raises(CameraError, match=words):
            read_log_camera(path)

    def with_calibrations(self, path: Path, changes: list[dict | None]) -> Path:
        """A log whose messages about the camera have these changes; None: damaged."""
        stamps = stamps_at(np.arange(len(changes)) / 10)
        infos = []
        for stamp_ns, fields in zip(stamps, changes, strict=True):
            info = logs.Damaged(b"\0\1\0\0 cut")
            if fields is not None:
                info = logs.make_camera_info(SMALL, stamp_ns, **fields)
            infos.append((stamp_ns, info))
        images = stamp_images(TINY, stamps_at(TINY_TIMES_S))
        topics = {"/camera/image_raw": images, "/camera/camera_info": infos}
        return logs.write_messages(path, topics)

    def test_is_none_without_calibration(self, tmp_path):
        assert self.read(tmp_path, "/camera/image_raw", k=np.zeros(9)) is None

    def test_is_none_on_another_topic(self, tmp_path):
        assert self.read(tmp_path, "/rear/image_raw") is None


def test_a_given_field_of_view_comes_before_the_camera_of_the_log(tmp_path):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S, camera=SMALL)
    given = settings_for(tmp_path, field=FieldOfView(90.0, "as given"))
    camera = camera_for(given, SMALL.size, path)
    assert camera.hfov_deg == pytest.approx(90, abs=0.1)


def test_the_camera_of_the_log_comes_before_a_field_of_view_of_a_photo(tmp_path):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S, camera=SMALL)
    of_photo = settings_for(tmp_path, field=FieldOfView(90.0, "as photo.jpg"))
    camera = camera_for(of_photo, SMALL.size, path)
    assert camera.matrix == pytest.approx(SMALL.matrix)


# Several topics.


@pytest.mark.parametrize("kind", KINDS[:3])
class TestTwoCameras:
    @pytest.fixture
    def path(self, tmp_path, kind) -> Path:
        types = (logs.ROS1 if kind.endswith(".bag") else logs.ROS2).types
        stamps = stamps_at(TINY_TIMES_S)
        brighter = [image + 100 for image in TINY]
        topics = {
            "/front/image_raw": stamp_images(TINY, stamps, "rgb8", types),
            "/rear/image_raw": stamp_images(brighter, stamps, "rgb8", types),
        }
        return write_messages(tmp_path / kind, topics)

    def test_one_is_chosen_by_its_topic(self, path):
        frame = next(read_timed_frames(path, start_s=0.2, topic="/rear/image_raw"))
        assert frame.number == 2
        np.testing.assert_array_equal(frame.image, TINY[2] + 100)

    def test_without_a_topic_they_are_named(self, path):
        words = "/front/image_raw, /rear/image_raw; choose one of them with --topic"
        with pytest.raises(VideoError, match=words):
            inspect_video(path)

    def test_another_topic_is_refused(self, path):
        words = "/front/image_raw, /rear/image_raw, not on /left; choose"
        with pytest.raises(VideoError, match=words):
            inspect_video(path, topic="/left")


def test_compressed_copies_of_the_images_are_no_second_camera(tmp_path):
    stamps = stamps_at([0, 0.1])
    topics = {
        "/image/compressed": stamp_images(TINY, stamps, ".jpg"),
        "/image": stamp_images(TINY, stamps),
    }
    path = write_messages(tmp_path / "drive.mcap", topics)
    assert inspect_video(path).topic == "/image"


class TestTopicOption:
    """A log with a camera to the front and one to the sky."""

    PART = ("--topic", "/front", "--start", 0.2, "--end", 0.4)

    @pytest.fixture(scope="class")
    @classmethod
    def path(cls, tmp_path_factory, images) -> Path:
        folder = tmp_path_factory.mktemp("topics")
        save_camera(SMALL, folder / "camera.yaml")
        stamps = stamps_at(TIMES_S)
        sky = [np.full_like(images[0], 200)] * FRAMES
        topics = {
            "/front": stamp_images(images, stamps, ".png"),
            "/up": stamp_images(sky, stamps, ".png"),
        }
        return write_messages(folder / "drive.mcap", topics)

    @pytest.fixture
    def camera(self, path) -> tuple:
        return ("--camera", path.with_name("camera.yaml"))

    def test_is_demanded(self, path, tmp_path, run):
        status, _, err = run("annotate", path, "-o", tmp_path / "none")
        assert status == 2
        assert "choose one of them with --topic" in err
        assert not (tmp_path / "none").exists()

    def test_of_annotate(self, path, camera, tmp_path, run):
        options = (*camera, "-o", tmp_path, *self.PART)
        assert run("annotate", path, *options)[0] == 0
        suffixes = (".csv", ".html", ".lane.mcap", ".mp4")
        assert names(tmp_path) == {f"drive{suffix}" for suffix in suffixes}
        table = read_telemetry(tmp_path / "drive.csv")
        assert table["frame"].tolist() == [5, 6, 7, 8, 9]
        assert "tracking" in table["state"]
        report = (tmp_path / "drive.html").read_text()
        assert "--topic /front --start 0.2" in report

    def test_of_detect(self, path, camera, tmp_path, run):
        options = (*camera, "-o", tmp_path / "lanes.jsonl", *self.PART)
        status, out, _ = run("detect", path, *options)
        assert status == 0
        assert "5 pictures" in out

    def test_of_pose(self, path, camera, tmp_path, run):
        options = (*camera, "-o", tmp_path / "pose.yaml", *self.PART)
        status, out, _ = run("pose", path, *options)
        assert status == 0
        assert "5 of 5 used" in out

    def test_of_explain(self, path, tmp_path, run):
        """A camera without a pose: it is that of the images on the topic."""
        lens = ("--hfov", SMALL.hfov_deg)
        options = (*lens, "-o", tmp_path / "a.png", *self.PART)
        status, out, _ = run("explain", path, *options)
        assert status == 0
        assert "5 of 5 used" in out

    def test_of_label(self, path, camera, images, tmp_path, run):
        options = (*camera, "--stills", 2, "-o", tmp_path / "labels", *self.PART)
        assert run("label", path, *options)[0] == 0
        stills = sorted((tmp_path / "labels").glob("*.png"))
        for still, image in zip(stills, (images[5], images[8]), strict=True):
            np.testing.assert_array_equal(read_image(still), image)

    def test_of_track(self, path):
        frame, _ = next(track(path, SMALL, start_s=0.2, topic="/front"))
        assert frame.number == 5


def test_without_rosbags_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    path = logs.write_log(tmp_path / "drive.mcap", TINY, TINY_TIMES_S)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(VideoError, match=r"drive\.mcap: .*pip install rosbags"):
        inspect_video(path)


def test_without_a_decoder_of_protobuf_a_sentence_says_what_to_install(
    tmp_path, monkeypatch
):
    recorders = pytest.importorskip("tests.support.recorders")
    row = {"data": b"", "format": "jpeg"}
    topic = recorders.foxglove_topic(
        "CompressedImage", "protobuf", stamps_at([0]), [row]
    )
    path = recorders.write_mcap(tmp_path / "drive.mcap", {"/front": topic})
    monkeypatch.setitem(sys.modules, "mcap_protobuf.decoder", None)
    with pytest.raises(VideoError, match=r"drive\.mcap: .*mcap-protobuf-support"):
        inspect_video(path)
