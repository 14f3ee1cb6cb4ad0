"""Images: files in and out, unusable files, and arrays as people have them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from lanes.camera.chessboard import Board, draw_board, find_board
from lanes.camera.model import undistort
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.search import find_lane
from lanes.errors import PictureError
from lanes.show.draw import draw_lane
from lanes.show.explanation import explain
from lanes.tracking.tracker import LaneTracker
from lanes.video.images import read_image, require_rgb, to_rgb, write_image
from lanes.video.reader import read_video
from lanes.video.writer import VideoWriter
from tests.support.bad_files import jpeg_claiming
from tests.support.painted_drive import SMALL, tracked_bends

RED = (220, 30, 20)
GREEN = (20, 200, 40)


@pytest.fixture
def picture() -> np.ndarray:
    """Red on the left, green on the right, so that swapped channels, sides or axes are
    noticed.
    """
    image = np.zeros((40, 64, 3), np.uint8)
    image[:, :32], image[:, 32:] = RED, GREEN
    return image


@pytest.mark.parametrize(
    "suffix", [".png", ".bmp", ".tif", ".TIFF", ".jpg", ".jpeg", ".webp"]
)
def test_round_trip(tmp_path, picture, suffix):
    """Every value stays in formats without loss, and red is red in the others, whose
    quality can be chosen.
    """
    path = tmp_path / f"a{suffix}"
    lossy = suffix in (".jpg", ".jpeg", ".webp")
    read = read_image(write_image(path, picture))
    assert read.shape == (40, 64, 3)
    assert read.dtype == np.uint8
    np.testing.assert_allclose(
        read[::20, 10::44].astype(int), picture[::20, 10::44], atol=6 if lossy else 0
    )
    noise = np.random.default_rng(2).integers(0, 256, (40, 64, 3)).astype(np.uint8)
    sizes = [
        write_image(path, noise, jpeg_quality=quality).stat().st_size
        for quality in (40, 92)
    ]
    assert (
        sizes[0] < 0.8 * sizes[1] if lossy else np.array_equal(read_image(path), noise)
    )


@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_a_photo_is_turned_once_as_its_exif_says(tmp_path, picture, suffix):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(picture).save(
        tmp_path / f"a.{suffix}", exif=exif, quality=100, subsampling=0
    )
    np.testing.assert_allclose(
        read_image(tmp_path / f"a.{suffix}"), np.rot90(picture, -1), atol=8
    )


def test_files_of_other_programs_are_read_and_ours_by_them(tmp_path, picture):
    """Red is red; gray becomes three equal channels; alpha is dropped."""
    path = tmp_path / "a.png"
    assert tuple(cv2.imread(str(write_image(path, picture)))[0, 0]) == RED[::-1]
    gray = np.arange(200, dtype=np.uint8).reshape(10, 20)
    cv2.imwrite(str(path), gray)
    three = np.repeat(gray[..., None], 3, axis=2)
    assert np.array_equal(read_image(path), three)
    assert np.array_equal(to_rgb(gray), three)
    cv2.imwrite(
        str(path),
        np.dstack([picture[..., ::-1], np.full(picture.shape[:2], 7, np.uint8)]),
    )
    assert np.array_equal(read_image(path), picture)
    photo = Image.fromarray(picture)
    preview = Image.new("RGB", (8, 5))
    photo.save(
        tmp_path / "a.jpg",
        "MPO",
        save_all=True,
        append_images=[preview],
        quality=100,
        subsampling=0,
    )
    np.testing.assert_allclose(
        read_image(tmp_path / "a.jpg"), picture, atol=8
    )  # of phones: no second image


@pytest.mark.parametrize("share", [0.3, 0.99])
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".bmp", ".tif"])
def test_truncated_file_is_refused(tmp_path, suffix, share):
    noisy = np.random.default_rng(3).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    path = write_image(tmp_path / f"cut{suffix}", noisy)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(PictureError, match=f"cut{suffix}.*cut off"):
        read_image(path)


@pytest.mark.parametrize("claimed_px", [64, 60000])
def test_a_thumbnail_is_not_taken_for_the_picture(tmp_path, picture, claimed_px):
    """Neither the size in its header, which comes before the picture's, nor its end
    marker.
    """
    path = write_image(tmp_path / "a.jpg", picture)
    thumbnail = tmp_path / "thumbnail.jpg"
    whole = path.read_bytes()
    jpeg_claiming(claimed_px, claimed_px)(thumbnail, whole)
    segment = b"\xff\xe1" + (2 + len(whole)).to_bytes(2, "big") + thumbnail.read_bytes()
    path.write_bytes(whole[:2] + segment + whole[2:])
    assert read_image(path).shape == picture.shape
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(PictureError, match="cut off"):
        read_image(path)


def write_pages(path: Path) -> None:
    pages = [Image.new("RGB", (32, 24), (80 * n, 0, 0)) for n in range(3)]
    pages[0].save(path, save_all=True, append_images=pages[1:])


HEIC = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(99)
PAGES = "holds 3 images; save the one to use alone, or convert all"


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        *((f"a.{suffix}", write_pages, PAGES) for suffix in ("webp", "png", "tif")),
        (
            "a.heic",
            lambda path: path.write_bytes(HEIC),
            "cannot be .*not a JPEG, .*convert it to JPEG",
        ),
        (
            "a.png",
            lambda path: Image.new("I;16", (6, 4), 40_000).save(path),
            "has more than 8 bits a pixel",
        ),
    ],
)
def test_other_files_are_refused_with_a_remedy(tmp_path, name, write, words):
    write(tmp_path / name)
    with pytest.raises(PictureError, match=f"{name}: {words}"):
        read_image(tmp_path / name)


def written(image: np.ndarray, folder: Path) -> np.ndarray:
    return read_image(write_image(folder / "a.png", image))


def encoded(image: np.ndarray, folder: Path) -> np.ndarray:
    with VideoWriter(folder / "a.mp4", fps=25) as writer:
        writer.write(image)
    return next(read_video(folder / "a.mp4"))


def tracked(image: np.ndarray, _: Path) -> np.ndarray:
    tracker = LaneTracker(SMALL)
    for _ in range(4):
        found = tracker.update(image)
    return draw_lane(image, found, SMALL)


# Functions that take an image of the camera's size and a folder.
TAKE_IMAGES = {
    "require_rgb": lambda image, _: require_rgb(image),
    "write_image": written,
    "VideoWriter": encoded,
    "undistort": lambda image, _: undistort(image, SMALL),
    "find_board": lambda image, _: np.array(find_board(image) is None),
    "draw_board": lambda image, _: draw_board(
        image, Board(np.zeros((20, 2), np.float32), 5, 4, SMALL.size)
    ),
    "bird's-eye view": lambda image, _: BirdsEyeView(SMALL).warp(image),
    "find_lane": lambda image, _: find_lane(image, SMALL).model,
    "LaneTracker and draw_lane": tracked,
    "explain": lambda image, _: explain(image, SMALL).image,
}
AS_PEOPLE_HAVE_THEM = {
    "read-only": np.copy,
    "BGR reversed": lambda image: np.ascontiguousarray(image[..., ::-1])[..., ::-1],
    "transposed": lambda image: np.ascontiguousarray(
        image.transpose(1, 0, 2)
    ).transpose(1, 0, 2),
}


@pytest.mark.parametrize("view", AS_PEOPLE_HAVE_THEM.values(), ids=AS_PEOPLE_HAVE_THEM)
@pytest.mark.parametrize("function", TAKE_IMAGES.values(), ids=TAKE_IMAGES)
def test_views_and_read_only_arrays_give_the_same(function, view, tmp_path):
    image = tracked_bends()[0]
    viewed = view(image)
    viewed.flags.writeable = False
    np.testing.assert_array_equal(function(viewed, tmp_path), function(image, tmp_path))
    np.testing.assert_array_equal(viewed, image)


@pytest.mark.parametrize("function", TAKE_IMAGES.values(), ids=TAKE_IMAGES)
@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (
            np.zeros((360, 640), np.uint8),
            r"expected an RGB image .* got shape \(360, 640\), dtype uint8",
        ),
        (
            np.zeros((360, 640, 4), np.uint8),
            r"expected an RGB image .* got shape \(360, 640, 4\)",
        ),
        (np.zeros((360, 640, 3)), "expected an RGB image .* dtype float64"),
        (np.zeros((0, 640, 3), np.uint8), r"holds no pixels \(shape \(0, 640, 3\)\)"),
        ([[0, 0, 0]], "expected an RGB image .* got list"),
        (None, "expected an RGB image .* got NoneType"),
    ],
    ids=["gray", "rgba", "float", "empty", "list", "none"],
)
def test_other_arrays_are_refused(function, wrong, sentence, tmp_path):
    with pytest.raises(PictureError, match=sentence):
        function(wrong, tmp_path)
    assert not any(tmp_path.iterdir())
