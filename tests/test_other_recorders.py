"""Robot logs as other programs record them: what is in them is used, or refused by its name, before any work."""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
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
from lanes.video.reader import inspect_video, read_timed_frames
from lanes.video.sources import find_sources
from tests.support import robot_logs as logs
from tests.support.clips import encode
from tests.support.painted_drive import BENDS, SMALL
from tests.support.robot_logs import TINY, TINY_TIMES_S, shades, stamp_images, stamps_at, write_messages

STAMPS = stamps_at(TINY_TIMES_S)
SHADES = [0, 20, 40, 60, 80, 100]
DRIVE_TIMES_S = np.arange(12) / 25


@pytest.fixture(scope="module")
def drive() -> list[np.ndarray]:
    return [BENDS.frame(time_s) for time_s in DRIVE_TIMES_S]


@pytest.fixture
def annotate(tmp_path, run):
    """A function that annotates a log in `tmp_path` with the camera of BENDS; returns stdout and the table."""
    save_camera(SMALL, tmp_path / "camera.yaml")

    def annotate(path: Path) -> tuple[str, dict[str, np.ndarray]]:
        status, out, err = run("annotate", "--camera", tmp_path / "camera.yaml", path, "-o", tmp_path / "out")
        assert status == 0, err
        return out, read_telemetry(tmp_path / "out" / "drive.csv")

    return annotate


# MCAP files of Foxglove's writers.


@pytest.fixture(scope="module")
def recorders():
    return pytest.importorskip("tests.support.recorders", reason="mcap and protobuf are not installed")


def ros_topic(kind: str, *, ros1: bool = False) -> tuple:
    made = stamp_images(TINY, STAMPS, ".png", (logs.ROS1 if ros1 else logs.ROS2).types)
    serialize = logs.ROS1.serialize_ros1 if ros1 else logs.ROS2.serialize_cdr
    return kind, "ros1" if ros1 else "cdr", [(stamp, bytes(serialize(m, m.__msgtype__))) for stamp, m in made]


@pytest.mark.parametrize(
    ("profile", "compression", "options"),
    [
        ("", "ZSTD", {}),
        ("ros1", "NONE", {"use_chunking": False}),
        ("x-my-robot", "LZ4", {"use_statistics": False, "chunk_size": 99}),
        ("", "ZSTD", {"repeat_channels": False, "repeat_schemas": False}),
    ],
)
def test_an_mcap_file_is_read_by_schema_and_encoding_not_by_its_profile(
    tmp_path, recorders, profile, compression, options
):
    """In any layout, and beside messages that are no images."""
    kind = f"sensor_msgs/{'msg/' if profile else ''}CompressedImage"
    topics = {"/camera": ros_topic(kind, ros1=profile == "ros1")}
    topics["/chatter"] = ("std_msgs/msg/String", "cdr", [(stamp, b"\0\1\0\0") for stamp in STAMPS])
    options = {"profile": profile, "compression": compression, **options}
    path = recorders.write_mcap(tmp_path / "drive.mcap", topics, **options)
    assert inspect_video(path).frames == 6 and shades(path) == SHADES
    assert shades(path, start_s=0.25) == [60, 80, 100]


RAW_TINY = [{"width": 12, "height": 8, "encoding": "rgb8", "step": 36, "data": image.tobytes()} for image in TINY]
JPEG_TINY = [{"data": cv2.imencode(".jpg", image)[1].tobytes(), "format": "jpeg"} for image in TINY]


@pytest.mark.parametrize(
    ("kind", "encoding", "rows"),
    [("CompressedImage", "protobuf", JPEG_TINY), ("RawImage", "json", RAW_TINY), ("RawImage", "cdr", RAW_TINY)],
)
def test_images_and_calibrations_of_foxglove_are_read(tmp_path, recorders, kind, encoding, rows):
    lens = {"width": 640, "height": 360, "distortion_model": "plumb_bob", "D": SMALL.distortion.tolist()}
    lens |= {"K": SMALL.matrix.ravel().tolist()}
    lens |= {"R": [0.0] * 9, "P": [0.0] * 12} if encoding == "cdr" else {}  # which has all fields
    topics = {
        "/front/image": recorders.foxglove_topic(kind, encoding, STAMPS, rows),
        "/front/camera_info": recorders.foxglove_topic("CameraCalibration", encoding, STAMPS[:1], [lens]),
    }
    path = recorders.write_mcap(tmp_path / "drive.mcap", topics)
    assert shades(path) == pytest.approx(SHADES, abs=1)
    assert [frame.time_s for frame in read_timed_frames(path)] == pytest.approx(TINY_TIMES_S)
    camera = read_log_camera(path)
    np.testing.assert_array_equal(camera.matrix, SMALL.matrix)
    np.testing.assert_array_equal(camera.distortion, SMALL.distortion)


@pytest.mark.parametrize(
    ("codec", "format_", "encoding"), [("libx264", "h264", "protobuf"), ("libx265", "h265", "json")]
)
def test_a_video_of_foxglove_is_read_from_any_frame_on(tmp_path, recorders, codec, format_, encoding):
    """Without B frames, with a key frame every five."""
    images = [np.full((96, 128, 3), 20 + 10 * number, np.uint8) for number in range(15)]
    options = {"tune": "zerolatency", "crf": "10", "preset": "ultrafast", "g": "5", "bf": "0"}
    with av.open(str(encode(tmp_path / f"drive.{format_}", images, codec, options=options))) as video:
        rows = [{"data": bytes(packet), "format": format_} for packet in video.demux() if packet.size]
    topic = recorders.foxglove_topic("CompressedVideo", encoding, stamps_at(np.arange(15) / 25), rows)
    path = recorders.write_mcap(tmp_path / "drive.mcap", {"/front": topic})
    info = inspect_video(path)
    assert (info.frames, info.fps, info.missing, info.width, info.height) == (15, 25, 0, 128, 96)
    assert shades(path) == pytest.approx([20 + 10 * number for number in range(15)], abs=3)
    frames = list(read_timed_frames(path, start_s=0.28, end_s=0.48))
    assert [frame.number for frame in frames] == [7, 8, 9, 10, 11]
    assert [frame.image.mean() for frame in frames] == pytest.approx([90, 100, 110, 120, 130], abs=3)


# Recordings of rosbag2.


@pytest.mark.parametrize(("mode", "mcap"), [("MESSAGE", False), ("MESSAGE", True), ("FILE", False)])
def test_a_compressed_recording_is_read_from_its_folder_and_from_its_file(tmp_path, mode, mcap):
    topics = {"/camera/image": stamp_images(TINY, STAMPS)}
    folder = write_messages(tmp_path / "drive", topics, compression=mode, mcap=mcap)
    (found,) = find_sources([str(folder)]).videos
    assert found == folder and shades(folder) == SHADES
    assert fingerprint(folder, DriveSettings(output=tmp_path))["source"] == str(folder)
    (file,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    assert find_sources([str(file)]).videos == (file,) and shades(file) == shades(folder)


def write_split(folder: Path, images: list[np.ndarray], stamps: list[int], half: int) -> Path:
    """A recording in two files, with `half` of the images in the first, whose names sort the other way around."""
    names, made = ["z_first.db3", "a_second.db3"], stamp_images(images, stamps)
    for name, part in zip(names, (made[:half], made[half:]), strict=True):
        written = write_messages(folder.with_name(Path(name).stem), {"/camera/image": part})
        folder.mkdir(exist_ok=True)
        shutil.move(written / f"{written.name}.db3", folder / name)
    described = yaml.safe_load((written / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml.safe_dump(described))
    return folder


def test_a_split_recording_is_one_drive_in_the_order_of_its_metadata(tmp_path):
    folder = write_split(tmp_path / "drive", TINY, STAMPS, 4)
    assert shades(folder) == SHADES and shades(folder, start_s=0.25, end_s=0.45) == [60, 80]
    assert [frame.time_s for frame in read_timed_frames(folder)] == pytest.approx(TINY_TIMES_S)
    folder = folder.rename(tmp_path / "moved")
    (folder / "a_second.db3").unlink()
    with pytest.raises(VideoError, match=r"a_second\.db3, which metadata\.yaml names, is missing"):
        inspect_video(folder)


def test_a_database_whose_recorder_was_killed_is_read_with_its_log(tmp_path):
    whole = logs.write_log(tmp_path / "whole.db3", TINY, TINY_TIMES_S)
    path = logs.write_log(tmp_path / "killed.db3", TINY[:4], TINY_TIMES_S[:4])
    with closing(sqlite3.connect(path)) as database:
        database.executescript("PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0")
        database.execute("ATTACH ? AS whole", [str(whole)])
        database.execute("INSERT INTO messages SELECT * FROM whole.messages ORDER BY timestamp LIMIT 4, 2")
        database.commit()
        killed = tmp_path / "copy" / "killed.db3"
        killed.parent.mkdir()
        for suffix in ("", "-wal"):  # as they are while the recorder runs
            shutil.copyfile(f"{path}{suffix}", f"{killed}{suffix}")
    assert os.path.getsize(f"{killed}-wal")
    assert shades(killed) == SHADES


def test_the_own_messages_are_no_source(tmp_path, drive, run):
    """Neither in a folder, nor by a pattern, nor by their names, as a shell gives them."""
    path = logs.write_log(tmp_path / "drive.mcap", drive[:4], DRIVE_TIMES_S[:4], camera=SMALL)
    save_camera(SMALL, tmp_path / "camera.yaml")
    common = "annotate", "--camera", tmp_path / "camera.yaml", "--no-report", "-o", tmp_path
    assert run(*common, path)[0] == 0 and (tmp_path / "drive.lane.mcap").is_file()
    for names in ([tmp_path / "*.mcap"], [path, tmp_path / "drive.lane.mcap"]):
        status, out, err = run(*common, *names)
        assert status == 0 and "note: skipped, written by annotate" in err and "drive.lane.mcap" in err
        assert out.count("frames, confidence 0.9 or more") == 1
    status, _, err = run(*common, tmp_path / "drive.lane.mcap")
    assert status == 2 and "was written by annotate; give the log" in err


# Pixels.

# An image that is smooth, so that planes of colour of half the size show it.
ROWS, COLUMNS = np.mgrid[:48, :64]
SMOOTH = np.dstack([40 + 2 * COLUMNS, 200 - 2 * ROWS, 60 + COLUMNS + ROWS]).astype(np.uint8)
GRAY = cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2GRAY)


def raw(values: np.ndarray, encoding: str, pad: int = 0, **more: object) -> dict:
    """Fields of a raw message of an image of the size of SMOOTH, with `pad` bytes behind each row."""
    rows = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=77)
    return {"encoding": encoding, "height": 48, "width": 64, "step": rows.shape[1], "data": rows, **more}


def compressed(image: np.ndarray, format_: str, suffix: str) -> dict:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 100] if suffix == ".jpg" else []
    return {"format": format_, "data": cv2.imencode(suffix, image, quality)[1]}


def write_fields(path: Path, fields: list[dict]) -> Path:
    """A log of raw or compressed images, whose messages have these fields."""
    made = stamp_images(TINY, STAMPS[: len(fields)], *([".png"] if "format" in fields[0] else []))
    for (_, message), some in zip(made, fields, strict=True):
        for name, value in some.items():
            setattr(message, name, value.ravel() if name == "data" else value)
    return write_messages(path, {"/camera": made})


def nv12(image: np.ndarray) -> np.ndarray:
    planes = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420)
    height, width = image.shape[:2]
    u, v = planes[height:].reshape(2, -1)
    return np.vstack([planes[:height], np.dstack([u, v]).reshape(-1, width)])


def mosaic(image: np.ndarray, pattern: str) -> np.ndarray:
    """The values of a sensor with colour filters."""
    tiles = [["rgb".index(letter) for letter in pattern[:2]], ["rgb".index(letter) for letter in pattern[2:]]]
    channel = np.tile(tiles, (image.shape[0] // 2, image.shape[1] // 2))
    return np.take_along_axis(image, channel[..., None], axis=2)[..., 0]


# Fields of messages, and the tolerance of the image away from its edges.
ENCODINGS = [
    (raw(SMOOTH, "rgb8", pad=5), 0),
    (raw(SMOOTH[..., ::-1], "bgr8"), 0),
    (raw(cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2BGRA), "bgra8", pad=5), 0),
    (raw(cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2RGBA), "rgba8"), 0),
    (raw(SMOOTH[..., ::-1], "8UC3"), 0),
    (raw(cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_UYVY), "yuv422"), 5),
    (raw(cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_YUY2), "yuv422_yuy2"), 5),
    (raw(nv12(SMOOTH), "nv12"), 5),
    (raw(np.vstack([nv12(SMOOTH)[:48], nv12(SMOOTH)[48:].reshape(-1, 2)[:, ::-1].reshape(-1, 64)]), "nv21"), 5),
    (raw(cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_I420), "i420"), 5),
    (raw(SMOOTH[..., ::-1].astype(np.uint16) << 8, "bgr16"), 0),
    (raw(mosaic(SMOOTH.astype(np.uint16) << 4, "bggr"), "bayer_bggr12"), 6),
    (raw(mosaic(SMOOTH, "gbrg"), "bayer_gbrg8"), 6),
    (compressed(SMOOTH[..., ::-1], "rgb8; png compressed bgr8", ".png"), 0),
    (compressed(mosaic(SMOOTH, "gbrg"), "bayer_gbrg8; png compressed ", ".png"), 6),
    (compressed(mosaic(SMOOTH.astype(np.uint16) << 4, "rggb"), "bayer_rggb16; png compressed ", ".png"), 6),  # 12 bits
    (compressed(SMOOTH[..., ::-1].astype(np.uint16) << 8, "rgb16; png compressed ", ".png"), 0),
    (compressed(SMOOTH[..., ::-1], "bayer_rggb8; jpeg compressed bgr8", ".jpg"), 12),
    (compressed(mosaic(SMOOTH, "gbrg"), "bayer_gbrg8; jpeg compressed ", ".jpg"), 12),
]
ENCODINGS = [(*row, SMOOTH) for row in ENCODINGS] + [
    (raw(GRAY, "mono8", pad=5), 0, np.dstack([GRAY] * 3)),
    (compressed(GRAY, "bayer_gbrg8; jpeg compressed mono8", ".jpg"), 4, np.dstack([GRAY] * 3)),
]


@pytest.mark.parametrize(("fields", "tolerance", "expected"), ENCODINGS)
def test_encodings_of_drivers_give_the_same_picture(tmp_path, fields, tolerance, expected):
    image = next(read_timed_frames(write_fields(tmp_path / "drive.mcap", [fields] * 3))).image
    assert np.abs(image[2:-2, 2:-2].astype(int) - expected[2:-2, 2:-2]).max() <= tolerance
    image[:] = 0  # may be written to


@pytest.mark.parametrize(("bits", "big_endian"), [(10, False), (12, True), (16, True)])
def test_the_bits_of_a_camera_are_those_of_its_brightest_images(tmp_path, bits, big_endian):
    """12 bits come in words of 16. The first image is dark, as in a garage, and stays dark."""
    gray = SMOOTH[..., 0].astype(np.uint16)
    dark, bright = gray << bits - 8 >> 4, gray * 255 // int(gray.max()) << bits - 8
    order = ">u2" if big_endian else "<u2"
    fields = [raw(i.astype(order), "mono16", is_bigendian=int(big_endian)) for i in (dark, bright, bright)]
    images = [frame.image for frame in read_timed_frames(write_fields(tmp_path / "drive.db3", fields))]
    assert np.abs(images[0][..., 0].astype(int) - (gray >> 4)).max() <= 1
    assert np.abs(images[1][..., 0].astype(int) - (bright >> bits - 8)).max() <= 1


# The camera.


def of_part(size: tuple[int, int], **changes: object) -> Callable[[Path], Path]:
    """A function that writes a log of images of that size, and the `camera_info` of SMALL with these changes."""
    images = [np.zeros((size[1], size[0], 3), np.uint8)] * 2
    return lambda path: logs.write_log(path, images, TINY_TIMES_S[:2], camera=SMALL, **changes)


# Left, top, height and width of a region of interest.
PART = logs.ROS2.types["sensor_msgs/msg/RegionOfInterest"](120, 100, 200, 400, False)


@pytest.mark.parametrize(
    ("size", "changes", "scale", "origin"),
    [
        ((320, 180), {"binning_x": 2, "binning_y": 2}, 0.5, (0, 0)),
        ((400, 200), {"roi": PART}, 1, (120, 100)),
        ((200, 100), {"roi": PART, "binning_x": 2, "binning_y": 2}, 0.5, (120, 100)),
        ((800, 400), {"roi": PART}, 2, (120, 100)),  # resized afterwards
        ((640, 360), {"binning_x": 2, "binning_y": 2}, 1, (0, 0)),  # stated, but not done
        ((320, 180), {}, 0.5, (0, 0)),
    ],
)
def test_the_camera_is_that_of_the_part_that_was_recorded(tmp_path, size, changes, scale, origin):
    """A point of the whole sensor is in the part where it was cut out, and in the binned image at its place there."""
    path = of_part(size, **changes)(tmp_path / "drive.mcap")
    camera = camera_for(DriveSettings(output=tmp_path), size, path)
    pixels = np.array([[origin[0] + 50.0, origin[1] + 40.0], [origin[0] + 250.0, origin[1] + 90.0]])
    part = (pixels - origin + 0.5) * scale - 0.5
    assert camera.size == size
    np.testing.assert_allclose(camera.rays(part), SMALL.rays(pixels), atol=1e-9)


# Times.


def test_images_recorded_out_of_order_are_sorted_by_their_stamps(tmp_path):
    order, stamps = [0, 2, 1, 3, 4, 6, 7, 5, 8, 9, 11, 10], stamps_at(DRIVE_TIMES_S)
    images, recorded = [np.full((8, 12, 3), n, np.uint8) for n in order], logs.BEGIN_NS + 10**7 * np.arange(12)
    path = tmp_path / "a.mcap"
    logs.write_log(path, images, stamps_ns=[stamps[n] for n in order], recorded_ns=recorded.tolist())
    frames = list(read_timed_frames(path))
    assert [frame.image[0, 0, 0] for frame in frames] == [frame.number for frame in frames] == list(range(12))
    assert [frame.time_s for frame in frames] == pytest.approx(DRIVE_TIMES_S) and inspect_video(path).missing == 0
    assert [frame.number for frame in read_timed_frames(path, start_s=0.2, end_s=0.32)] == [5, 6, 7]


@pytest.mark.parametrize("wrong_s", [-1.7e9 - 0.25, -5.0])
def test_outliers_of_the_stamps_are_replaced_and_said(tmp_path, drive, annotate, wrong_s):
    """A stamp of 1970, and one that is a little too early."""
    stamps = stamps_at(DRIVE_TIMES_S)
    stamps[7] += int(wrong_s * 1e9)
    path = tmp_path / "drive.mcap"
    out, table = annotate(logs.write_log(path, drive, stamps_ns=stamps, recorded_ns=range(1, 13)))
    assert "1 time stamps far from those of the images around them are replaced" in out
    assert table["time_s"] == pytest.approx(DRIVE_TIMES_S, abs=1e-6)


@pytest.mark.parametrize("jump_s", [7200.0, 1.7e9])
def test_a_jump_of_the_clock_is_a_gap_after_which_the_tracker_starts_again(tmp_path, drive, annotate, jump_s):
    """Two recordings on one clock, and a clock that was set while recording."""
    stamps = [1_000_000_000 + round(1e9 * (t + jump_s * (n >= 8))) for n, t in enumerate(DRIVE_TIMES_S)]
    path = tmp_path / "drive.mcap"
    out, table = annotate(logs.write_log(path, drive, stamps_ns=stamps, recorded_ns=stamps))
    assert f"1 jumps of its clock, of up to {jump_s:.0f} s, are shortened to 5 s" in out and "missing" not in out
    assert table["frame"].tolist() == list(range(12)) and np.diff(table["time_s"])[7] == pytest.approx(5)
    assert inspect_video(tmp_path / "out" / "drive.mp4").frames == 12


# What cannot be used is named by the command before a field of view is assumed, and nothing is written.


def write_cut(path: Path, share: float) -> Path:
    path = logs.file_of(logs.write_log(path, TINY * 40, np.arange(240) / 10))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    return path


def write_encrypted(path: Path) -> Path:
    logs.write_log(path, TINY, TINY_TIMES_S)
    version, data = path.read_bytes().split(b"\n", 1)
    field = b"\x20\0\0\0encryptor=rosbag/AesCbcEncryptor"
    # the header of the bag is padded to 4096 bytes: a field is added, and as much of the padding is removed
    end = 4 + int.from_bytes(data[:4], "little")
    header = (end - 4 + len(field)).to_bytes(4, "little") + data[4:end] + field
    padding = (int.from_bytes(data[end : end + 4], "little") - len(field)).to_bytes(4, "little")
    path.write_bytes(version + b"\n" + header + padding + data[end + 4 + len(field) :])
    return path


def write_unknown(path: Path) -> Path:
    recorders = pytest.importorskip("tests.support.recorders", reason="mcap and protobuf are not installed")
    topic = "foxglove.CompressedVideo", "cbor", [(stamp, b"\0" * 40) for stamp in STAMPS]
    return recorders.write_mcap(path, {"/front": topic})


def of_message(message: object) -> Callable[[Path], Path]:
    return lambda path: write_messages(path, {"/a": [(1, message)]})


def of_format(format_: str) -> Callable[[Path], Path]:
    return lambda path: write_fields(path, [compressed(GRAY, format_, ".png")] * 3)


UNUSABLE = [
    ("drive.bag", lambda path: write_cut(path, 0.95), "cut off"),
    ("drive.db3", lambda path: write_cut(path, 0.3), "cut off"),
    ("drive.mcap", lambda path: write_cut(path, 0.95), "cut off"),
    ("folder", lambda path: write_cut(path, 0.001), "cut off"),
    ("encrypted.bag", write_encrypted, "is cut off, damaged, encrypted.*AesCbcEncryptor.*; copy it"),
    ("a.mcap", of_message(logs.make_image(TINY[0], 1, "32FC1")), "encoding '32FC1'; record one of rgb8"),
    ("a.mcap", of_message(logs.ROS2.types["std_msgs/msg/String"]("hello")), "no topic; name another log"),
    ("a.mcap", of_message(logs.make_image(TINY[0], logs.BEGIN_NS)), "has 1 images"),
    ("a.mcap", of_format("16UC1; compressedDepth png"), "has depths"),
    ("a.mcap", of_format("h264"), "is a video in h264"),
    ("a.mcap", of_format("bayer_rgbw8; png compressed "), "an unknown mosaic"),
    ("a.mcap", write_unknown, r"has foxglove.CompressedVideo \(cbor\) on /front, which is not read"),
    ("a.mcap", of_part((300, 300), roi=PART), "that of 400x200 pixels, but the images have 300x300"),
    ("a.mcap", of_part((300, 300)), "300x300 image has another aspect ratio than the calibrated 640x360"),
    ("a.mcap", of_part((640, 360), distortion_model="ftheta"), "distortion model 'ftheta' is not supported"),
]


@pytest.mark.parametrize(("name", "write", "words"), UNUSABLE)
def test_what_cannot_be_used_is_named(tmp_path, run, name, write, words):
    path = write(tmp_path / name)
    status, out, err = run("annotate", path, "-o", tmp_path / "out")
    assert (status, out) == (2, "") and re.search(f"{name}.*{words}", err) and "assumed" not in err
    assert ("damaged" in err) == ("cut off" in words)
    assert not (tmp_path / "out").exists()
