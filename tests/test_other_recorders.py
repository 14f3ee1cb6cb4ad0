"""Robot logs as other programs record them.

What is in them is used, or refused by its name, before any work.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import yaml

from lanes.annotation import DriveSettings
from lanes.camera.field_of_view import read_log_camera
from lanes.camera.model import save_camera
from lanes.drive_camera import camera_for
from lanes.errors import VideoError
from lanes.files import read_telemetry
from lanes.many import fingerprint
from lanes.show.report import line_types
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.sources import find_sources
from tests.support import robot_logs as logs
from tests.support.clips import encode
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

STAMPS = stamps_at(TINY_TIMES_S)
SHADES = [0, 20, 40, 60, 80, 100]
DRIVE_TIMES_S = np.arange(12) / 25


@pytest.fixture(scope="module")
def drive() -> list[np.ndarray]:
    return [BENDS.frame(time_s) for time_s in DRIVE_TIMES_S]


@dataclass(frozen=True)
class Annotated:
    stdout: str
    table: dict[str, np.ndarray]


@pytest.fixture
def annotate(tmp_path, run) -> Callable[[Path], Annotated]:
    """A function that annotates a log into "out" with the camera of BENDS."""
    camera = save_camera(SMALL, tmp_path / "camera.yaml")
    output = tmp_path / "out"

    def annotate(path: Path) -> Annotated:
        status, out, err = run("annotate", path, "--camera", camera, "-o", output)
        assert status == 0, err
        return Annotated(out, read_telemetry(output / f"{path.stem}.csv"))

    return annotate


# MCAP files of Foxglove's writers.


@pytest.fixture(scope="module")
def recorders():
    return pytest.importorskip(
        "tests.support.recorders",
        reason="mcap, mcap-protobuf-support or foxglove-schemas-protobuf is missing",
    )


LAYOUTS = {
    "no profile": {},
    "no chunks": {"profile": "ros1", "compression": "NONE", "use_chunking": False},
    "small chunks": {
        "profile": "x-my-robot",
        "compression": "LZ4",
        "use_statistics": False,
        "chunk_size": 99,
    },
    "short index": {"repeat_channels": False, "repeat_schemas": False},
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_an_mcap_file_is_read_by_schema_and_encoding_not_by_its_profile(
    tmp_path, recorders, layout
):
    """In any layout, and beside messages that are no images."""
    is_ros1 = layout.get("profile") == "ros1"
    store = logs.ROS1 if is_ros1 else logs.ROS2
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    messages = []
    for _, message in stamp_images(TINY, STAMPS, ".png", store.types):
        messages.append(bytes(serialize(message, message.__msgtype__)))
    package = "sensor_msgs/msg" if "profile" in layout else "sensor_msgs"
    images = recorders.RecordedTopic(
        type_name=f"{package}/CompressedImage",
        encoding="ros1" if is_ros1 else "cdr",
        recorded_ns=STAMPS,
        messages=messages,
    )
    text = b"\0\1\0\0"
    chatter = recorders.RecordedTopic(
        "std_msgs/msg/String", "cdr", STAMPS, [text] * len(STAMPS)
    )

    topics = {"/camera": images, "/chatter": chatter}
    path = recorders.write_mcap(tmp_path / "drive.mcap", topics, **layout)
    assert inspect_video(path).frames == 6
    assert shades(path) == SHADES
    assert shades(path, start_s=0.25) == [60, 80, 100]


RAW_TINY, JPEG_TINY = [], []
for tiny in TINY:
    raw_tiny = {"width": 12, "height": 8, "encoding": "rgb8", "step": 36}
    RAW_TINY.append(raw_tiny | {"data": tiny.tobytes()})
    _, jpeg = cv2.imencode(".jpg", tiny)
    JPEG_TINY.append({"data": jpeg.tobytes(), "format": "jpeg"})


FOXGLOVE = [
    ("CompressedImage", "protobuf", JPEG_TINY),
    ("RawImage", "protobuf", RAW_TINY),
    ("RawImage", "json", RAW_TINY),
    ("RawImage", "cdr", RAW_TINY),
]


@pytest.mark.parametrize(("kind", "encoding", "rows"), FOXGLOVE)
class TestFoxglove:
    @pytest.fixture
    def path(self, tmp_path, recorders, kind, encoding, rows) -> Path:
        lens = {
            "width": 640,
            "height": 360,
            "distortion_model": "plumb_bob",
            "D": SMALL.distortion.tolist(),
            "K": SMALL.matrix.ravel().tolist(),
        }
        if encoding == "cdr":  # which has all fields
            lens |= {"R": [0.0] * 9, "P": [0.0] * 12}
        make = recorders.foxglove_topic
        topics = {
            "/front/image": make(kind, encoding, STAMPS, rows),
            "/front/camera_info": make(
                "CameraCalibration", encoding, STAMPS[:1], [lens]
            ),
        }
        return recorders.write_mcap(tmp_path / "drive.mcap", topics)

    def test_images_have_the_times_of_their_stamps(self, path):
        frames = list(read_timed_frames(path))
        assert [frame.time_s for frame in frames] == pytest.approx(TINY_TIMES_S)
        greys = [frame.image.mean() for frame in frames]
        assert greys == pytest.approx(SHADES, abs=1)

    def test_the_camera_is_that_of_the_calibration(self, path):
        camera = read_log_camera(path)
        np.testing.assert_array_equal(camera.matrix, SMALL.matrix)
        np.testing.assert_array_equal(camera.distortion, SMALL.distortion)


def test_messages_in_protobuf_without_a_definition_are_named(tmp_path, recorders):
    kind = "foxglove.CompressedImage"
    topic = recorders.RecordedTopic(kind, "protobuf", STAMPS, [b""] * 6, b"\xff")
    path = recorders.write_mcap(tmp_path / "a.mcap", {"/front": topic})
    with pytest.raises(
        VideoError, match=r"a\.mcap: is cut off, damaged.*DescriptorSet"
    ):
        inspect_video(path)


# Types of ROS in JSON, and other names of types.

IDL_NAMES = [
    "sensor_msgs::msg::CompressedImage",
    "sensor_msgs::msg::dds_::CompressedImage_",
]


@pytest.mark.parametrize("type_name", IDL_NAMES)
def test_types_are_known_by_their_names_in_omg_idl(tmp_path, recorders, type_name):
    messages = []
    for _, message in stamp_images(TINY, STAMPS, ".png"):
        messages.append(bytes(logs.ROS2.serialize_cdr(message, message.__msgtype__)))
    topic = recorders.RecordedTopic(type_name, "cdr", STAMPS, messages)
    path = recorders.write_mcap(tmp_path / "a.mcap", {"/camera": topic})
    assert shades(path) == SHADES


@pytest.mark.parametrize("ros1", [False, True], ids=["ROS 2", "ROS 1"])
@pytest.mark.parametrize("as_numbers", [False, True], ids=["base64", "numbers"])
def test_types_of_ros_are_read_in_json(tmp_path, recorders, ros1, as_numbers):
    """With the names of fields of ROS 1 or 2, and bytes as in a bridge or a list."""
    seconds, fraction = ("secs", "nsecs") if ros1 else ("sec", "nanosec")
    matrix, lens = ("K", "D") if ros1 else ("k", "d")
    headers = []
    for stamp_ns in STAMPS:
        whole, rest = divmod(stamp_ns, 10**9)
        headers.append({"stamp": {seconds: whole, fraction: rest}})
    images = []
    for header, row in zip(headers, RAW_TINY, strict=True):
        data = (
            list(row["data"]) if as_numbers else base64.b64encode(row["data"]).decode()
        )
        images.append(json.dumps(row | {"header": header, "data": data}).encode())
    info = {
        "header": headers[0],
        "width": 640,
        "height": 360,
        "distortion_model": "plumb_bob",
        lens: SMALL.distortion.tolist(),
        matrix: SMALL.matrix.ravel().tolist(),
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0},
    }
    record = recorders.RecordedTopic
    recorded = [stamp_ns + 5_000_000 for stamp_ns in STAMPS]
    path = recorders.write_mcap(
        tmp_path / "a.mcap",
        {
            "/front/image": record("sensor_msgs/Image", "json", recorded, images),
            "/front/camera_info": record(
                "sensor_msgs/CameraInfo",
                "json",
                recorded[:1],
                [json.dumps(info).encode()],
            ),
        },
    )
    assert shades(path) == SHADES
    times_s = [frame.time_s for frame in read_timed_frames(path)]
    assert times_s == pytest.approx(TINY_TIMES_S)
    np.testing.assert_array_equal(read_log_camera(path).matrix, SMALL.matrix)


def test_damaged_messages_of_images_are_left_out(tmp_path, recorders):
    messages = []
    for _, message in stamp_images(TINY, STAMPS):
        messages.append(bytes(logs.ROS2.serialize_cdr(message, message.__msgtype__)))
    messages[2] = messages[2][:30]
    kind = "sensor_msgs/msg/Image"
    topic = recorders.RecordedTopic(kind, "cdr", STAMPS, messages)
    path = recorders.write_mcap(tmp_path / "a.mcap", {"/camera": topic})
    assert shades(path) == [0, 20, 60, 80, 100]
    assert inspect_video(path).missing == 1


X264 = {"tune": "zerolatency", "crf": "10", "g": "5", "bf": "0"}
# Encoder and options of a video without B frames, with a key frame every five.
ENCODERS = {
    "h264": ("libx264", X264),
    "h265": ("libx265", X264),
    "av1": ("libsvtav1", {"crf": "10", "g": "5", "svtav1-params": "pred-struct=1"}),
    "vp9": ("libvpx-vp9", {"crf": "10", "g": "5", "lag-in-frames": "0"}),
}


@pytest.fixture(
    params=[
        ("h264", "protobuf"),
        ("h265", "json"),
        ("av1", "protobuf"),
        ("vp9", "json"),
    ],
    ids="-".join,
)
def video_log(request, tmp_path, recorders) -> Path:
    """A video of 15 frames, each brighter than the one before."""
    codec, encoding = request.param
    images = []
    for number in range(15):
        images.append(np.full((96, 128, 3), 20 + 10 * number, np.uint8))
    encoder, options = ENCODERS[codec]
    suffix = codec if codec.startswith("h") else "ivf"
    video = encode(tmp_path / f"drive.{suffix}", images, encoder, options=options)
    with av.open(str(video)) as opened:
        frames = [bytes(packet) for packet in opened.demux() if packet.size]
    rows = [{"data": frame, "format": codec} for frame in frames]
    stamps = stamps_at(np.arange(15) / 25)
    topic = recorders.foxglove_topic("CompressedVideo", encoding, stamps, rows)
    return recorders.write_mcap(tmp_path / "drive.mcap", {"/front": topic})


def test_a_video_of_foxglove_is_read_from_its_first_frame_on(video_log):
    info = inspect_video(video_log)
    assert (info.frames, info.fps, info.missing) == (15, 25, 0)
    assert (info.width, info.height) == (128, 96)
    expected = [20 + 10 * number for number in range(15)]
    assert shades(video_log) == pytest.approx(expected, abs=3)


def test_a_video_of_foxglove_is_read_from_any_frame_on(video_log):
    frames = list(read_timed_frames(video_log, start_s=0.28, end_s=0.48))
    assert [frame.number for frame in frames] == [7, 8, 9, 10, 11]
    grays = [frame.image.mean() for frame in frames]
    assert grays == pytest.approx([90, 100, 110, 120, 130], abs=3)


# Recordings of rosbag2.


@pytest.mark.parametrize(
    ("mode", "mcap"),
    [
        ("MESSAGE", False),
        ("MESSAGE", True),
        ("FILE", False),
    ],
)
class TestCompressedRecording:
    @pytest.fixture
    def folder(self, tmp_path, mode, mcap) -> Path:
        topics = {"/camera/image": stamp_images(TINY, STAMPS)}
        folder = tmp_path / "drive"
        return write_messages(folder, topics, compression=mode, mcap=mcap)

    def test_is_read_from_its_folder(self, folder):
        assert find_sources([str(folder)]).videos == (folder,)
        assert shades(folder) == SHADES

    def test_is_read_from_its_file(self, folder):
        (file,) = [path for path in folder.iterdir() if path.suffix != ".yaml"]
        assert find_sources([str(file)]).videos == (file,)
        assert shades(file) == SHADES

    def test_has_the_fingerprint_of_its_folder(self, folder, tmp_path):
        found = fingerprint(folder, DriveSettings(output=tmp_path))
        assert found["source"] == str(folder)


@pytest.fixture
def split(tmp_path) -> Path:
    """A recording in two files, whose names sort the other way around."""
    made = stamp_images(TINY, STAMPS)
    folder = tmp_path / "drive"
    folder.mkdir()
    parts = {"z_first.db3": made[:4], "a_second.db3": made[4:]}
    for name, part in parts.items():
        written = write_messages(tmp_path / Path(name).stem, {"/image": part})
        shutil.move(written / f"{written.name}.db3", folder / name)
    described = yaml.safe_load((written / "metadata.yaml").read_text())
    recording = described["rosbag2_bagfile_information"]
    recording["relative_file_paths"] = list(parts)
    (folder / "metadata.yaml").write_text(yaml.safe_dump(described))
    return folder


def test_a_split_recording_is_one_drive_in_the_order_of_its_metadata(split):
    assert shades(split) == SHADES
    assert shades(split, start_s=0.25, end_s=0.45) == [60, 80]
    times_s = [frame.time_s for frame in read_timed_frames(split)]
    assert times_s == pytest.approx(TINY_TIMES_S)


def test_a_split_recording_with_a_missing_file_is_refused(split):
    (split / "a_second.db3").unlink()
    words = r"a_second\.db3, which metadata\.yaml names, is missing"
    with pytest.raises(VideoError, match=words):
        inspect_video(split)


def test_a_database_whose_recorder_was_killed_is_read_with_its_log(tmp_path):
    whole = logs.write_log(tmp_path / "whole.db3", TINY, TINY_TIMES_S)
    path = logs.write_log(tmp_path / "killed.db3", TINY[:4], TINY_TIMES_S[:4])
    killed = tmp_path / "copy" / "killed.db3"
    killed.parent.mkdir()
    with closing(sqlite3.connect(path)) as database:
        database.executescript("PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0")
        database.execute("ATTACH ? AS whole", [str(whole)])
        database.execute(
            "INSERT INTO messages "
            "SELECT * FROM whole.messages ORDER BY timestamp LIMIT 4, 2"
        )
        database.commit()
        for suffix in ("", "-wal"):  # as they are while the recorder runs
            shutil.copyfile(f"{path}{suffix}", f"{killed}{suffix}")

    assert os.path.getsize(f"{killed}-wal") > 0
    assert shades(killed) == SHADES


@pytest.mark.parametrize("name", ["killed.db3", "a?b %41#.db3"])
def test_a_database_whose_recorder_was_killed_while_it_wrote_is_read(tmp_path, name):
    """Without a write-ahead log, SQLite keeps the old pages in a journal; the recording
    stays as it is.
    """
    path = logs.write_log(tmp_path / name, TINY, TINY_TIMES_S)
    killed = tmp_path / "copy" / name
    killed.parent.mkdir()
    with closing(sqlite3.connect(path)) as database:
        database.executescript("PRAGMA journal_mode=DELETE; PRAGMA cache_size=1")
        database.execute("DELETE FROM messages")
        rows = [(number, 1, number, bytes(300)) for number in range(1000)]
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
        for suffix in ("", "-journal"):  # as they are while the recorder runs
            shutil.copyfile(f"{path}{suffix}", f"{killed}{suffix}")
    before = killed.read_bytes()
    assert os.path.getsize(f"{killed}-journal") > 0

    assert shades(killed) == SHADES
    assert killed.read_bytes() == before
    assert names(killed.parent) == {name, f"{name}-journal"}


@pytest.fixture
def own_messages(tmp_path, drive, run) -> tuple:
    """The options of a command that has written messages beside a log."""
    path = tmp_path / "drive.mcap"
    logs.write_log(path, drive[:4], DRIVE_TIMES_S[:4], camera=SMALL)
    camera = save_camera(SMALL, tmp_path / "camera.yaml")
    options = ("--camera", camera, "--no-report", "-o", tmp_path)
    assert run("annotate", path, *options)[0] == 0
    assert (tmp_path / "drive.lane.mcap").is_file()
    return options


@pytest.mark.parametrize("names", [["*.mcap"], ["drive.mcap", "drive.lane.mcap"]])
def test_the_own_messages_are_no_source(tmp_path, run, own_messages, names):
    """Neither by a pattern, nor by their names, as a shell gives them."""
    paths = [tmp_path / name for name in names]
    status, out, err = run("annotate", *paths, *own_messages)
    assert status == 0
    assert re.search("note: skipped, written by annotate.*drive.lane.mcap", err)
    assert out.count("frames, confidence 0.9 or more") == 1


def test_the_own_messages_alone_are_refused(tmp_path, run, own_messages):
    status, _, err = run("annotate", tmp_path / "drive.lane.mcap", *own_messages)
    assert status == 2
    assert "was written by annotate; give the log" in err


# Pixels.

# An image that is smooth, so that planes of colour of half the size show it.
ROWS, COLUMNS = np.mgrid[:48, :64]
SMOOTH = np.dstack([40 + 2 * COLUMNS, 200 - 2 * ROWS, 60 + COLUMNS + ROWS])
SMOOTH = SMOOTH.astype(np.uint8)
SMOOTH_BGR = SMOOTH[..., ::-1]
GRAY = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2GRAY)
GRAY_AS_RGB = np.dstack([GRAY] * 3)


def raw(values: np.ndarray, encoding: str, pad: int = 0, **more: object) -> dict:
    """Fields of a raw message of the size of SMOOTH, with `pad` bytes behind rows."""
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=77)
    fields = {"encoding": encoding, "height": 48, "width": 64, **more}
    return fields | {"step": rows.shape[1], "data": rows.ravel()}


def compressed(image: np.ndarray, format_: str, suffix: str = ".png") -> dict:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 100] if suffix == ".jpg" else []
    _, data = cv2.imencode(suffix, image, quality)
    return {"format": format_, "data": data.ravel()}


def write_fields(path: Path, fields: list[dict]) -> Path:
    """A log of raw or compressed images, whose messages have these fields."""
    options = [".png"] if "format" in fields[0] else []
    made = stamp_images(TINY, STAMPS[: len(fields)], *options)
    for (_, message), changes in zip(made, fields, strict=True):
        for name, value in changes.items():
            setattr(message, name, value)
    return write_messages(path, {"/camera": made})


def planes_of(image: np.ndarray, order: str) -> np.ndarray:
    """Brightness, and below it pairs of colours in the order "uv" or "vu"."""
    planes = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420)
    height, width = image.shape[:2]
    u, v = planes[height:].reshape(2, -1)
    pairs = np.dstack([u, v] if order == "uv" else [v, u])
    return np.vstack([planes[:height], pairs.reshape(-1, width)])


def mosaic(image: np.ndarray, pattern: str) -> np.ndarray:
    """The values of a sensor with colour filters."""
    channels = ["rgb".index(letter) for letter in pattern]
    tile = np.reshape(channels, (2, 2))
    repeats = image.shape[0] // 2, image.shape[1] // 2
    channel = np.tile(tile, repeats)
    return np.take_along_axis(image, channel[..., None], axis=2)[..., 0]


BGRA = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2BGRA)
RGBA = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2RGBA)
UYVY = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_UYVY)
YUY2 = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_YUY2)
I420 = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_I420)
BGR16 = SMOOTH_BGR.astype(np.uint16) << 8
# 12 bits
SMOOTH12 = SMOOTH.astype(np.uint16) << 4
GBRG = mosaic(SMOOTH, "gbrg")

# Fields of a message, and the tolerance of the image away from its edges.
IN_COLOUR = [
    (raw(SMOOTH, "rgb8", pad=5), 0),
    (raw(SMOOTH_BGR, "bgr8"), 0),
    (raw(BGRA, "bgra8", pad=5), 0),
    (raw(RGBA, "rgba8"), 0),
    (raw(SMOOTH_BGR, "8UC3"), 0),
    (raw(UYVY, "yuv422"), 5),
    (raw(YUY2, "yuv422_yuy2"), 5),
    (raw(planes_of(SMOOTH, "uv"), "nv12"), 5),
    (raw(planes_of(SMOOTH, "uv"), "nv12", pad=6), 5),
    (raw(planes_of(SMOOTH, "vu"), "nv21"), 5),
    (raw(I420, "i420"), 5),
    (raw(BGR16, "bgr16"), 0),
    (raw(mosaic(SMOOTH12, "bggr"), "bayer_bggr12"), 6),
    (raw(GBRG, "bayer_gbrg8"), 6),
    (compressed(SMOOTH_BGR, "rgb8; png compressed bgr8"), 0),
    (compressed(GBRG, "bayer_gbrg8; png compressed "), 6),
    (compressed(mosaic(SMOOTH12, "rggb"), "bayer_rggb16; png compressed "), 6),
    (compressed(BGR16, "rgb16; png compressed "), 0),
    (compressed(SMOOTH_BGR, "bayer_rggb8; jpeg compressed bgr8", ".jpg"), 12),
    (compressed(GBRG, "bayer_gbrg8; jpeg compressed ", ".jpg"), 12),
]
IN_GRAY = [
    (raw(GRAY, "mono8", pad=5), 0),
    (compressed(GRAY, "bayer_gbrg8; jpeg compressed mono8", ".jpg"), 4),
]


def encodings() -> list:
    rows = [(*row, SMOOTH) for row in IN_COLOUR]
    rows += [(*row, GRAY_AS_RGB) for row in IN_GRAY]
    names = [fields.get("encoding") or fields["format"] for fields, *_ in rows]
    return [pytest.param(*row, id=name) for row, name in zip(rows, names, strict=True)]


@pytest.mark.parametrize(("fields", "tolerance", "expected"), encodings())
def test_encodings_of_drivers_give_the_same_picture(
    tmp_path, fields, tolerance, expected
):
    path = write_fields(tmp_path / "drive.mcap", [fields] * 3)
    image = next(read_timed_frames(path)).image
    error = image.astype(int) - expected
    assert np.abs(error[2:-2, 2:-2]).max() <= tolerance
    image[:] = 0  # may be written to


@pytest.mark.parametrize(
    ("bits", "big_endian"),
    [
        (10, False),
        (12, True),
        (16, True),
    ],
)
def test_the_bits_of_a_camera_are_those_of_its_brightest_images(
    tmp_path, bits, big_endian
):
    """12 bits come in words of 16. The first image, as in a garage, stays dark."""
    gray = SMOOTH[..., 0].astype(np.uint16)
    dark = gray << bits - 8 >> 4
    bright = gray * 255 // int(gray.max()) << bits - 8
    order = ">u2" if big_endian else "<u2"
    fields = []
    for image in (dark, bright, bright):
        stored = image.astype(order)
        fields.append(raw(stored, "mono16", is_bigendian=int(big_endian)))

    path = write_fields(tmp_path / "drive.db3", fields)
    found = [frame.image[..., 0].astype(int) for frame in read_timed_frames(path)]
    expected = gray >> 4
    assert np.abs(found[0] - expected).max() <= 1
    expected = bright >> bits - 8
    assert np.abs(found[1] - expected).max() <= 1


def test_a_log_in_gray_has_no_colours_of_lines(tmp_path, drive, annotate):
    """The left line is yellow; the table, and a report of it, have its kind only."""
    made = stamp_images(drive, stamps_at(DRIVE_TIMES_S))
    for _, message in made:
        pixels = message.data.reshape(message.height, message.width, 3)
        gray = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
        message.encoding = "mono8"
        message.step = message.width
        message.data = gray.ravel()
    path = write_messages(tmp_path / "drive.mcap", {"/camera": made})

    table = annotate(path).table
    for side in ("left", "right"):
        assert np.isnan(table[f"{side}_colour"]).all()
    assert set(line_types(table, "left")) == {"solid"}


# The camera.


def of_part(size: tuple[int, int], **changes: object) -> Callable[[Path], Path]:
    """A function that writes a log with images of a size and a changed camera_info."""
    images = [np.zeros((size[1], size[0], 3), np.uint8)] * 2

    def write(path: Path) -> Path:
        return logs.write_log(path, images, TINY_TIMES_S[:2], camera=SMALL, **changes)

    return write


# Left, top, height and width of a region of interest.
PART = logs.ROS2.types["sensor_msgs/msg/RegionOfInterest"](120, 100, 200, 400, False)
BINNED = {"binning_x": 2, "binning_y": 2}

PARTS = {
    "binned": ((320, 180), BINNED, 0.5, (0, 0)),
    "binned across": ((320, 360), {"binning_x": 2}, (0.5, 1), (0, 0)),
    "binned down, resized": ((320, 90), {"binning_y": 2}, (0.5, 0.25), (0, 0)),
    "cut out": ((400, 200), {"roi": PART}, 1, (120, 100)),
    "cut out and binned": ((200, 100), {"roi": PART, **BINNED}, 0.5, (120, 100)),
    "resized afterwards": ((800, 400), {"roi": PART}, 2, (120, 100)),
    "stated, but not done": ((640, 360), BINNED, 1, (0, 0)),
    "resized": ((320, 180), {}, 0.5, (0, 0)),
}


@pytest.mark.parametrize(
    ("size", "changes", "scale", "origin"), PARTS.values(), ids=PARTS
)
def test_the_camera_is_that_of_the_part_that_was_recorded(
    tmp_path, size, changes, scale, origin
):
    """A point of the sensor is where the part has it."""
    path = of_part(size, **changes)(tmp_path / "drive.mcap")
    camera = camera_for(DriveSettings(output=tmp_path), size, path)
    assert camera.size == size
    pixels = np.array([[50.0, 40.0], [250.0, 90.0]]) + origin
    in_part = (pixels - origin + 0.5) * scale - 0.5
    rays = camera.rays(in_part)
    np.testing.assert_allclose(rays, SMALL.rays(pixels), atol=1e-9)


# Times.


def test_images_recorded_out_of_order_are_sorted_by_their_stamps(tmp_path):
    order = [0, 2, 1, 3, 4, 6, 7, 5, 8, 9, 11, 10]
    stamps = stamps_at(DRIVE_TIMES_S)
    path = logs.write_log(
        tmp_path / "a.mcap",
        [np.full((8, 12, 3), number, np.uint8) for number in order],
        stamps_ns=[stamps[number] for number in order],
        recorded_ns=[logs.BEGIN_NS + 10**7 * place for place in range(12)],
    )
    frames = list(read_timed_frames(path))
    assert [frame.image[0, 0, 0] for frame in frames] == list(range(12))
    assert [frame.number for frame in frames] == list(range(12))
    assert [frame.time_s for frame in frames] == pytest.approx(DRIVE_TIMES_S)
    assert inspect_video(path).missing == 0
    part = read_timed_frames(path, start_s=0.2, end_s=0.32)
    assert [frame.number for frame in part] == [5, 6, 7]


@pytest.mark.parametrize("wrong_s", [-1.7e9 - 0.25, -5.0], ids=["1970", "early"])
def test_outliers_of_the_stamps_are_replaced_and_said(
    tmp_path, drive, annotate, wrong_s
):
    stamps = stamps_at(DRIVE_TIMES_S)
    stamps[7] += int(wrong_s * 1e9)
    recorded = range(1, 13)
    path = tmp_path / "drive.mcap"
    logs.write_log(path, drive, stamps_ns=stamps, recorded_ns=recorded)

    found = annotate(path)
    words = "1 time stamps far from those of the images around them are replaced"
    assert words in found.stdout
    assert found.table["time_s"] == pytest.approx(DRIVE_TIMES_S, abs=1e-6)


@pytest.mark.parametrize("jump_s", [7200.0, 1.7e9], ids=["second recording", "set"])
def test_a_jump_of_the_clock_is_a_gap_after_which_the_tracker_starts_again(
    tmp_path, drive, annotate, jump_s
):
    """Two recordings on one clock, and a clock that was set while recording."""
    times_s = DRIVE_TIMES_S + np.where(np.arange(12) >= 8, jump_s, 0.0)
    stamps = [1_000_000_000 + round(1e9 * time_s) for time_s in times_s]
    path = tmp_path / "drive.mcap"
    logs.write_log(path, drive, stamps_ns=stamps, recorded_ns=stamps)

    found = annotate(path)
    words = f"1 jumps of its clock, of up to {jump_s:.0f} s, are shortened to 5 s"
    assert words in found.stdout
    assert "missing" not in found.stdout
    assert found.table["frame"].tolist() == list(range(12))
    assert np.diff(found.table["time_s"])[7] == pytest.approx(5)
    assert inspect_video(tmp_path / "out" / "drive.mp4").frames == 12


# What cannot be used is named before a field of view is assumed; nothing is written.


def cut_at(share: float) -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        logs.write_log(path, TINY * 40, np.arange(240) / 10)
        file = logs.file_of(path)
        data = file.read_bytes()
        file.write_bytes(data[: int(share * len(data))])
        return file

    return write


def write_encrypted(path: Path) -> Path:
    """The header of a bag is padded to 4096 bytes: a field takes some of that."""
    logs.write_log(path, TINY, TINY_TIMES_S)
    version, data = path.read_bytes().split(b"\n", 1)
    field = b"\x20\0\0\0encryptor=rosbag/AesCbcEncryptor"
    header_end = 4 + int.from_bytes(data[:4], "little")
    padding_end = header_end + 4
    padding = int.from_bytes(data[header_end:padding_end], "little")

    changed = version + b"\n"
    changed += (header_end - 4 + len(field)).to_bytes(4, "little")
    changed += data[4:header_end] + field
    changed += (padding - len(field)).to_bytes(4, "little")
    changed += data[padding_end + len(field) :]
    path.write_bytes(changed)
    return path


def write_unknown(path: Path) -> Path:
    recorders = pytest.importorskip("tests.support.recorders")
    kind = "foxglove.CompressedVideo"
    topic = recorders.RecordedTopic(kind, "cbor", STAMPS, [b"\0" * 40] * 6)
    return recorders.write_mcap(path, {"/front": topic})


def of_message(message: object) -> Callable[[Path], Path]:
    return lambda path: write_messages(path, {"/a": [(1, message)]})


def of_format(format_: str) -> Callable[[Path], Path]:
    return lambda path: write_fields(path, [compressed(GRAY, format_)] * 3)


FLOATS = logs.make_image(TINY[0], 1, "32FC1")
TEXT = logs.ROS2.types["std_msgs/msg/String"]("hello")
SINGLE = logs.make_image(TINY[0], logs.BEGIN_NS)

UNUSABLE = [
    ("drive.bag", cut_at(0.95), "cut off"),
    ("drive.db3", cut_at(0.3), "cut off"),
    ("drive.mcap", cut_at(0.95), "cut off.*, or repair it with `mcap recover`"),
    ("folder", cut_at(0.001), "cut off"),
    ("encrypted.bag", write_encrypted, "is cut off, damaged, encrypted.*AesCbcEncryp"),
    ("a.mcap", of_message(FLOATS), "encoding '32FC1'; record one of rgb8"),
    ("a.mcap", of_message(TEXT), "no topic; name another log"),
    ("a.mcap", of_message(SINGLE), "has 1 images"),
    ("a.mcap", of_format("16UC1; compressedDepth png"), "has depths"),
    ("a.mcap", of_format("h264"), "is a video in h264"),
    ("a.mcap", of_format("bayer_rgbw8; png compressed "), "an unknown mosaic"),
    (
        "a.mcap",
        write_unknown,
        r"has foxglove.CompressedVideo \(cbor\) on /front, which is not read",
    ),
    (
        "a.mcap",
        of_part((300, 300), roi=PART),
        "that of 400x200 pixels, but the images have 300x300",
    ),
    (
        "a.mcap",
        of_part((640, 360), width=0, height=0),
        "camera_info is not usable .it states a size of 0x0 pixels.; give --camera",
    ),
    (
        "a.mcap",
        of_part((300, 300)),
        "300x300 image has another aspect ratio than the calibrated 640x360",
    ),
    (
        "a.mcap",
        of_part((640, 360), distortion_model="ftheta"),
        "distortion model 'ftheta' is not supported",
    ),
]


@pytest.mark.parametrize(("name", "write", "words"), UNUSABLE)
def test_what_cannot_be_used_is_named(tmp_path, run, name, write, words):
    path = write(tmp_path / name)
    status, out, err = run("annotate", path, "-o", tmp_path / "out")
    assert (status, out) == (2, "")
    assert re.search(f"{name}.*{words}", err)
    assert "assumed" not in err
    assert ("damaged" in err) == ("cut off" in words)
    assert not (tmp_path / "out").exists()
