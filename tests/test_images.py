"""Images: files in and out, unusable files, and arrays as people have them."""

from __future__ import annotations

from pathlib import Path

import av
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
from tests.support.clips import encode
from tests.support.painted_drive import SMALL, tracked_bends

RED = (220, 30, 20)
GREEN = (20, 200, 40)


@pytest.fixture
def picture() -> np.ndarray:
    """Red on the left, green on the right, so that swapped channels, sides or axes are
    noticed.
    """
    image = np.zeros((40, 64, 3), np.uint8)
    image[:, :32] = RED
    image[:, 32:] = GREEN
    return image


def noise(seed: int, height: int = 40, width: int = 64) -> np.ndarray:
    values = np.random.default_rng(seed).integers(0, 256, (height, width, 3))
    return values.astype(np.uint8)


LOSSLESS = [".png", ".bmp", ".tif", ".TIFF"]
LOSSY = [".jpg", ".jpeg", ".webp"]


@pytest.mark.parametrize("suffix", [*LOSSLESS, *LOSSY])
def test_red_stays_red(tmp_path, picture, suffix):
    path = write_image(tmp_path / f"a{suffix}", picture)
    read = read_image(path)
    assert read.shape == (40, 64, 3)
    assert read.dtype == np.uint8
    middles = read[::20, 10::44].astype(int)
    tolerance = 6 if suffix in LOSSY else 0
    np.testing.assert_allclose(middles, picture[::20, 10::44], atol=tolerance)


@pytest.mark.parametrize("suffix", LOSSLESS)
def test_every_value_stays_in_formats_without_loss(tmp_path, suffix):
    path = write_image(tmp_path / f"a{suffix}", noise(2))
    np.testing.assert_array_equal(read_image(path), noise(2))


@pytest.mark.parametrize("suffix", LOSSY)
def test_the_quality_of_formats_with_loss_can_be_chosen(tmp_path, suffix):
    low = write_image(tmp_path / f"low{suffix}", noise(2), jpeg_quality=40)
    high = write_image(tmp_path / f"high{suffix}", noise(2), jpeg_quality=92)
    assert low.stat().st_size < 0.8 * high.stat().st_size


@pytest.mark.parametrize("suffix", ["jpg", "tif"])
def test_a_photo_is_turned_once_as_its_exif_says(tmp_path, picture, suffix):
    path = tmp_path / f"a.{suffix}"
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(picture).save(path, exif=exif, quality=100, subsampling=0)
    np.testing.assert_allclose(read_image(path), np.rot90(picture, -1), atol=8)


def test_other_programs_read_our_files(tmp_path, picture):
    path = write_image(tmp_path / "a.png", picture)
    blue_green_red = cv2.imread(str(path))[0, 0]
    assert tuple(blue_green_red) == RED[::-1]


GRAY = np.arange(200, dtype=np.uint8).reshape(10, 20)


@pytest.mark.parametrize("read", [to_rgb, None], ids=["array", "file"])
def test_gray_becomes_three_equal_channels(tmp_path, read):
    if read is None:
        path = tmp_path / "a.png"
        cv2.imwrite(str(path), GRAY)
        image = read_image(path)
    else:
        image = read(GRAY)
    np.testing.assert_array_equal(image, np.dstack([GRAY] * 3))


def test_alpha_is_dropped(tmp_path, picture):
    path = tmp_path / "a.png"
    alpha = np.full(picture.shape[:2], 7, np.uint8)
    cv2.imwrite(str(path), np.dstack([picture[..., ::-1], alpha]))
    np.testing.assert_array_equal(read_image(path), picture)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("bits", [10, 12, 16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_the_brightest_value_of_a_still_shows_its_bits(
    tmp_path, picture, suffix, bits, channels
):
    """Cameras with 12 bits store them in words of 16."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    expected = picture
    stored = bgr
    if channels == 1:
        stored = bgr[..., 2]
        expected = np.dstack([stored] * 3)
    stored = stored.astype(np.uint16) << bits - 8
    if channels == 4:
        opaque = np.full(stored.shape[:2], 65535, np.uint16)
        stored = np.dstack([stored, opaque])
    path = tmp_path / f"a{suffix}"
    assert cv2.imwrite(str(path), stored)
    np.testing.assert_array_equal(read_image(path), expected)


def test_a_truncated_still_of_16_bits_is_refused(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), noise(3).astype(np.uint16) << 4)
    path.write_bytes(path.read_bytes()[:-600])
    with pytest.raises(PictureError, match=r"a\.png: cannot be decoded.*cut off"):
        read_image(path)


@pytest.mark.parametrize("pixels", ["rgb48le", "gray16le"])
@pytest.mark.parametrize("bits", [12, 16])
def test_the_bits_of_a_video_are_those_of_a_still(tmp_path, picture, pixels, bits):
    values = picture if pixels == "rgb48le" else picture[..., 1]
    stored = values.astype(np.uint16) << bits - 8
    frame = av.VideoFrame.from_ndarray(stored, format=pixels)
    path = encode(tmp_path / "a.mkv", [frame] * 3, "ffv1", pixels)
    image = next(read_video(path)).astype(int)
    difference = image - (values if values.ndim == 3 else values[..., None])
    assert np.abs(difference).max() <= 1


def test_the_preview_of_a_phone_is_no_second_image(tmp_path, picture):
    path = tmp_path / "a.jpg"
    Image.fromarray(picture).save(
        path,
        "MPO",
        save_all=True,
        append_images=[Image.new("RGB", (8, 5))],
        quality=100,
        subsampling=0,
    )
    np.testing.assert_allclose(read_image(path), picture, atol=8)


@pytest.mark.parametrize("share", [0.3, 0.99])
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".bmp", ".tif"])
def test_truncated_file_is_refused(tmp_path, suffix, share):
    path = write_image(tmp_path / f"cut{suffix}", noise(3, 60, 80))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(PictureError, match=f"cut{suffix}.*cut off"):
        read_image(path)


@pytest.fixture(params=[64, 60000])
def with_thumbnail(request, tmp_path, picture) -> Path:
    """A JPEG with a thumbnail that claims to have so many pixels to a side."""
    path = write_image(tmp_path / "a.jpg", picture)
    whole = path.read_bytes()
    thumbnail = tmp_path / "thumbnail.jpg"
    jpeg_claiming(request.param, request.param)(thumbnail, whole)
    length = (2 + len(whole)).to_bytes(2, "big")
    segment = b"\xff\xe1" + length + thumbnail.read_bytes()
    path.write_bytes(whole[:2] + segment + whole[2:])
    return path


def test_the_size_of_a_thumbnail_is_not_that_of_the_picture(with_thumbnail, picture):
    """It stands in the file before that of the picture."""
    assert read_image(with_thumbnail).shape == picture.shape


def test_the_end_of_a_thumbnail_is_not_that_of_the_picture(with_thumbnail):
    with_thumbnail.write_bytes(with_thumbnail.read_bytes()[:-4])
    with pytest.raises(PictureError, match="cut off"):
        read_image(with_thumbnail)


def write_pages(path: Path) -> None:
    pages = [Image.new("RGB", (32, 24), (80 * n, 0, 0)) for n in range(3)]
    pages[0].save(path, save_all=True, append_images=pages[1:])


def write_heic(path: Path) -> None:
    path.write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(99))


def write_32_bits(path: Path) -> None:
    Image.new("F", (6, 4), 40_000).save(path)


PAGES = "holds 3 images; save the one to use alone, or convert all"


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("a.webp", write_pages, PAGES),
        ("a.png", write_pages, PAGES),
        ("a.tif", write_pages, PAGES),
        ("a.heic", write_heic, "cannot be .*not a JPEG, .*convert it to JPEG"),
        ("a.tif", write_32_bits, "has neither 8 nor 16 bits a value"),
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


def boards_drawn(image: np.ndarray, _: Path) -> np.ndarray:
    board = Board(np.zeros((20, 2), np.float32), 5, 4, SMALL.size)
    return draw_board(image, board)


# Functions that take an image of the camera's size and a folder.
TAKE_IMAGES = {
    "require_rgb": lambda image, _: require_rgb(image),
    "write_image": written,
    "VideoWriter": encoded,
    "undistort": lambda image, _: undistort(image, SMALL),
    "find_board": lambda image, _: np.array(find_board(image) is None),
    "draw_board": boards_drawn,
    "bird's-eye view": lambda image, _: BirdsEyeView(SMALL).warp(image),
    "find_lane": lambda image, _: find_lane(image, SMALL).model,
    "LaneTracker and draw_lane": tracked,
    "explain": lambda image, _: explain(image, SMALL).image,
}


def bgr_reversed(image: np.ndarray) -> np.ndarray:
    bgr = np.ascontiguousarray(image[..., ::-1])
    return bgr[..., ::-1]


def transposed(image: np.ndarray) -> np.ndarray:
    columns = np.ascontiguousarray(image.transpose(1, 0, 2))
    return columns.transpose(1, 0, 2)


@pytest.mark.parametrize("view", [np.copy, bgr_reversed, transposed])
@pytest.mark.parametrize("function", TAKE_IMAGES.values(), ids=TAKE_IMAGES)
def test_views_and_read_only_arrays_give_the_same(function, view, tmp_path):
    image = tracked_bends()[0]
    viewed = view(image)
    viewed.flags.writeable = False
    of_view = function(viewed, tmp_path)
    np.testing.assert_array_equal(of_view, function(image, tmp_path))
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
