"""Files that names stand for, outputs that would overwrite files, and images sampled
from stills and videos.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lanes.errors import PictureError, VideoError
from lanes.video.images import read_image, write_image
from lanes.video.reader import read_video
from lanes.video.sources import find_sources, sample_images
from lanes.video.writer import VideoWriter
from tests.support.clips import encode


def test_the_name_decides_what_a_file_is(tmp_path):
    """What is neither a picture nor a video is skipped in a folder, and named; a video
    that is named itself is read.
    """
    gray = Image.new("L", (64, 36), 90)
    for name in ("a.jfif", "b.jpe", "c.avif", "d.png"):  # the last one is a JPEG
        gray.save(tmp_path / name, format="AVIF" if name == "c.avif" else "JPEG")
    videos = {
        "e.m2ts": "mpegts",
        "f.h264": "h264",
        "g.3gp": "mp4",
        "h.wmv": "asf",
        "i.flv": "flv",
        "j.mxf": "mxf",
    }
    for name, container in (videos | {"k.gif": "gif", "l": "matroska"}).items():
        codec = {"asf": "wmv2", "mxf": "mpeg2video", "gif": "gif"}.get(
            container, "libx264"
        )
        pixels = "rgb8" if container == "gif" else "yuv420p"
        images = [np.full((64, 64, 3), 40 * number, np.uint8) for number in range(5)]
        encode(tmp_path / name, images, codec, pixels, container=container)
    (tmp_path / "notes.txt").write_text("notes")
    (tmp_path / ".hidden.mp4").touch()
    (tmp_path / "d.partial.7.mp4").touch()
    (tmp_path / "empty").mkdir()
    for missing, words in {
        "no.mp4": "no such file or",
        "*.webm": "no such file",
        "empty": "holds neither",
    }.items():
        with pytest.raises(FileNotFoundError, match=words):
            find_sources([f"{tmp_path}/{missing}"])
    for name in ("camera.yaml", "metadata.yaml"):  # a recording of ROS has another one
        (tmp_path / name).write_text("image_width: 640")
    found = find_sources([str(tmp_path)])
    assert [path.name for path in found.stills] == [
        "a.jfif",
        "b.jpe",
        "c.avif",
        "d.png",
    ]
    assert [path.name for path in found.videos] == [*videos, "k.gif"]
    assert [path.name for path in found.skipped] == [
        "camera.yaml",
        "l",
        "metadata.yaml",
        "notes.txt",
    ]
    assert [path.name for path in find_sources([f"{tmp_path}/**/*.3gp"]).videos] == [
        "g.3gp"
    ]
    for still in found.stills:
        assert np.abs(read_image(still).astype(int) - 90).max() < 4
    named = find_sources([str(tmp_path / "l")])
    for video in found.videos + named.videos:
        assert len(list(read_video(video))) == 5


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """Two stills and a video of six frames, 2 a second; each image has a brightness of
    its own.
    """
    folder = tmp_path_factory.mktemp("drive")
    for number in range(2):
        write_image(
            folder / f"still{number}.png",
            np.full((36, 64, 3), 200 + 20 * number, np.uint8),
        )
    with VideoWriter(folder / "drive.mp4", fps=2) as video:
        for number in range(6):
            video.write(np.full((36, 64, 3), 20 + 25 * number, np.uint8), number / 2)
    return folder


def brightness(images) -> list[int]:
    return [round(float(image.mean())) for image in images]


def test_images_are_spread_over_stills_and_video(drive):
    files = [drive / "still0.png", drive / "drive.mp4", drive / "still1.png"]
    assert brightness(sample_images(files, 40)) == pytest.approx(
        [200, 20, 45, 70, 95, 120, 145, 220], abs=2
    )
    # Four samples of the video are 0.75 s apart. At 0.75 s and 1.5 s it shows its third
    # and fourth frame.
    assert brightness(sample_images(files, 4)) == pytest.approx(
        [200, 70, 95, 220], abs=2
    )


def test_images_that_are_not_wanted_are_refused_with_their_file(drive):
    def refuse(image: np.ndarray, file: Path) -> None:
        if image.mean() > 60:
            raise PictureError(f"{file.name}: is too bright")

    files = [drive / "drive.mp4", drive / "still0.png"]
    with pytest.raises(PictureError, match=r"drive\.mp4: is too bright"):
        list(sample_images(files, 40, require=refuse))
    with pytest.raises(PictureError, match=r"still0\.png: is too bright"):
        list(sample_images(files[1:], 40, require=refuse))
    with pytest.raises(
        VideoError, match=r"drive\.mp4: lasts 3 s; begin before that, not at 3\.5 s"
    ):
        list(sample_images(files, 40, start_s=3.5))


def test_no_image_is_from_behind_the_part(tmp_path):
    """Nothing was recorded from second 1 to 3."""
    with VideoWriter(tmp_path / "hole.mp4", fps=10) as video:
        for number in range(20):
            video.write(
                np.full((36, 64, 3), 10 * number, np.uint8),
                number / 10 + (2 if number >= 10 else 0),
            )
    sampled = brightness(
        sample_images([tmp_path / "hole.mp4"], 40, start_s=0.5, end_s=2.5)
    )
    assert sampled == pytest.approx([50, 70, 90], abs=2)
    with pytest.raises(
        VideoError, match="has no frame at or after 1.5 s and before 2.5 s"
    ):
        list(sample_images([tmp_path / "hole.mp4"], 40, start_s=1.5, end_s=2.5))
