"""Files that names stand for, and images sampled from stills and videos."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import lanes
from lanes.errors import PictureError, VideoError
from lanes.video.images import read_image, write_image
from lanes.video.reader import read_video
from lanes.video.sources import find_sources, sample_images
from lanes.video.writer import VideoWriter
from tests.support.clips import encode
from tests.support.painted_drive import SMALL


def plain(level: int, width: int = 64, height: int = 36) -> np.ndarray:
    return np.full((height, width, 3), level, np.uint8)


STILLS = {"a.jfif": "JPEG", "b.jpe": "JPEG", "c.avif": "AVIF", "d.png": "JPEG"}
# Container, codec and format of the pixels; the last one has no suffix.
VIDEOS = {
    "e.m2ts": ("mpegts", "libx264", "yuv420p"),
    "f.h264": ("h264", "libx264", "yuv420p"),
    "g.3gp": ("mp4", "libx264", "yuv420p"),
    "h.wmv": ("asf", "wmv2", "yuv420p"),
    "i.flv": ("flv", "libx264", "yuv420p"),
    "j.mxf": ("mxf", "mpeg2video", "yuv420p"),
    "k.gif": ("gif", "gif", "rgb8"),
    "l": ("matroska", "libx264", "yuv420p"),
}
VIDEO_NAMES = [*VIDEOS][:-1]
# A recording of ROS has another metadata.yaml.
OTHERS = ["camera.yaml", "l", "metadata.yaml", "notes.txt"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Stills of one brightness, videos of five frames, and other files."""
    folder = tmp_path_factory.mktemp("folder")
    for name, form in STILLS.items():
        Image.new("L", (64, 36), 90).save(folder / name, format=form)
    for name, (container, codec, pixels) in VIDEOS.items():
        images = [plain(40 * number, height=64) for number in range(5)]
        encode(folder / name, images, codec, pixels, container=container)
    for name in ("camera.yaml", "metadata.yaml", "notes.txt"):
        (folder / name).write_text("image_width: 640")
    for name in (".hidden.mp4", "d.partial.7.mp4"):
        (folder / name).touch()
    (folder / "empty").mkdir()
    return folder


def names(paths: Sequence[Path]) -> list[str]:
    return [path.name for path in paths]


class TestFindSources:
    def test_the_name_decides_what_a_file_of_a_folder_is(self, folder):
        found = find_sources([str(folder)])
        assert names(found.stills) == [*STILLS]
        assert names(found.videos) == VIDEO_NAMES

    def test_other_files_of_a_folder_are_skipped_and_named(self, folder):
        assert names(find_sources([str(folder)]).skipped) == OTHERS

    def test_a_pattern_names_its_files_only(self, folder):
        found = find_sources([f"{folder}/**/*.3gp"])
        assert names(found.videos) == ["g.3gp"]

    @pytest.mark.parametrize(
        ("name", "words"),
        [
            ("no.mp4", "no such file or"),
            ("*.webm", "no such file"),
            ("empty", "holds neither"),
        ],
    )
    def test_a_name_without_a_file_is_refused(self, folder, name, words):
        with pytest.raises(FileNotFoundError, match=words):
            find_sources([f"{folder}/{name}"])

    @pytest.mark.parametrize("name", STILLS)
    def test_the_content_decides_how_a_still_is_read(self, folder, name):
        image = read_image(folder / name).astype(int)
        assert np.abs(image - 90).max() < 4

    @pytest.mark.parametrize("name", VIDEOS)
    def test_a_video_that_is_named_is_read_whatever_its_suffix(self, folder, name):
        (video,) = find_sources([str(folder / name)]).videos
        assert len(list(read_video(video))) == 5


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> Path:
    """Two recordings of ROS beside a video, and a folder of stills."""
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("bag1", "bag2"):
        (folder / name).mkdir()
        (folder / name / "metadata.yaml").write_text("rosbag2_bagfile_information:")
        (folder / name / f"{name}_0.db3").touch()
        (folder / name / "bag.lane.mcap").touch()
    (folder / "drive.mp4").touch()
    (folder / "stills").mkdir()
    (folder / "stills" / "a.png").touch()
    return folder


class TestRecordingsInFolders:
    @pytest.mark.parametrize(
        ("pattern", "videos", "folders"),
        [
            ("", ["bag1", "bag2", "drive.mp4"], ["stills"]),
            ("*", ["bag1", "bag2", "drive.mp4"], ["stills"]),
            ("**/*", ["bag1", "bag2", "drive.mp4"], []),
            ("*/*", ["bag1", "bag2"], []),
            ("*/*.yaml", ["bag1", "bag2"], []),
            ("*/*.db3", ["bag1_0.db3", "bag2_0.db3"], []),
            ("bag*", ["bag1", "bag2"], []),
        ],
    )
    def test_are_one_video_each(self, recordings, pattern, videos, folders):
        found = find_sources([f"{recordings}/{pattern}"])
        assert sorted(names(found.videos)) == videos
        assert names(found.skipped_folders) == folders

    def test_need_no_video_beside_them(self, recordings, tmp_path):
        shutil.copytree(recordings / "bag1", tmp_path / "all" / "bag1")
        found = find_sources([str(tmp_path / "all")])
        assert names(found.videos) == ["bag1"]

    def test_in_another_folder_are_named_where_nothing_else_is(self, recordings):
        parent = recordings.parent / "parent"
        shutil.copytree(recordings, parent / "recordings")
        with pytest.raises(FileNotFoundError, match="such as .*parent/recordings"):
            find_sources([str(parent)])


def test_a_pattern_of_folders_only_says_what_to_name(recordings):
    words = r"stands for folders only, such as .*/stills; name them .*sti\*/\*"
    with pytest.raises(FileNotFoundError, match=words):
        find_sources([f"{recordings}/sti*"])


def test_all_that_is_skipped_is_in_the_notes(recordings, folder):
    found = find_sources([str(recordings), str(folder)])
    others = ", ".join(str(folder / name) for name in OTHERS)
    inner = f"{recordings}/stills, {folder}/empty"
    assert found.notes() == [
        f"skipped, neither a video nor an image: {others}",
        f"skipped, folders, which have to be named themselves: {inner}",
    ]


def test_skipped_files_are_a_warning_in_python(recordings, tmp_path):
    with (
        pytest.warns(UserWarning, match="skipped, folders.*stills"),
        pytest.raises(lanes.LaneError),  # its video is empty
    ):
        lanes.annotate(recordings, tmp_path, SMALL)


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """Two stills and a video of six frames, 2 a second; each image has a brightness of
    its own.
    """
    folder = tmp_path_factory.mktemp("drive")
    for number in range(2):
        write_image(folder / f"still{number}.png", plain(200 + 20 * number))
    with VideoWriter(folder / "drive.mp4", fps=2) as video:
        for number in range(6):
            video.write(plain(20 + 25 * number), number / 2)
    return folder


@pytest.fixture(scope="module")
def hole(tmp_path_factory) -> Path:
    """A video of 20 frames, 10 a second; nothing was recorded from second 1 to 3."""
    path = tmp_path_factory.mktemp("hole") / "hole.mp4"
    with VideoWriter(path, fps=10) as video:
        for number in range(20):
            pause_s = 2 if number >= 10 else 0
            video.write(plain(10 * number), number / 10 + pause_s)
    return path


def brightness(images: Iterable[np.ndarray]) -> list[int]:
    return [round(float(image.mean())) for image in images]


class TestSampleImages:
    @pytest.mark.parametrize(
        ("most", "expected"),
        [
            (40, [200, 20, 45, 70, 95, 120, 145, 220]),
            # Four samples of the video are 0.75 s apart. At 0.75 s and 1.5 s it shows
            # its third and fourth frame.
            (4, [200, 70, 95, 220]),
        ],
    )
    def test_are_spread_over_stills_and_video(self, drive, most, expected):
        files = [drive / "still0.png", drive / "drive.mp4", drive / "still1.png"]
        sampled = brightness(sample_images(files, most))
        assert sampled == pytest.approx(expected, abs=2)

    @pytest.mark.parametrize("name", ["drive.mp4", "still0.png"])
    def test_refused_images_are_named_by_their_file(self, drive, name):
        def refuse(image: np.ndarray, file: Path) -> None:
            if image.mean() > 60:
                raise PictureError(f"{file.name}: is too bright")

        sampled = sample_images([drive / name], 40, require=refuse)
        with pytest.raises(PictureError, match=f"{name}: is too bright"):
            list(sampled)

    def test_the_first_file_that_cannot_be_used_is_named(self, drive):
        files = [drive / "drive.mp4", drive / "still0.png"]
        words = r"drive\.mp4: lasts 3 s; begin before that, not at 3\.5 s"
        with pytest.raises(VideoError, match=words):
            list(sample_images(files, 40, start_s=3.5))

    def test_are_not_from_behind_the_part(self, hole):
        sampled = brightness(sample_images([hole], 40, start_s=0.5, end_s=2.5))
        assert sampled == pytest.approx([50, 60, 70, 80, 90], abs=2)

    def test_a_part_without_a_frame_is_refused(self, hole):
        words = "has no frame at or after 1.5 s and before 2.5 s"
        with pytest.raises(VideoError, match=words):
            list(sample_images([hole], 40, start_s=1.5, end_s=2.5))
