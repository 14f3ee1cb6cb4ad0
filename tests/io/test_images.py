"""Picture files: the array layout, and unusable files."""

import struct
import time
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes import images
from lanes.errors import PictureError
from lanes.images import list_pictures, natural_key, read_image, write_image

RED, GREEN = (220, 30, 20), (20, 200, 40)


@pytest.fixture
def picture() -> np.ndarray:
    """Red on the left, green on the right, so that swapped channels, sides or axes are noticed."""
    image = np.zeros((40, 64, 3), np.uint8)
    image[:, :32], image[:, 32:] = RED, GREEN
    return image


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".TIFF"])
def test_round_trip_keeps_every_value(tmp_path, picture, suffix):
    assert np.array_equal(read_image(write_image(tmp_path / f"a{suffix}", picture)), picture)


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg", ".webp"])
def test_round_trip_keeps_red_red(tmp_path, picture, suffix):
    read = read_image(write_image(tmp_path / f"a{suffix}", picture))
    assert read.shape == (40, 64, 3) and read.dtype == np.uint8
    np.testing.assert_allclose(read[20, 10], RED, atol=6)
    np.testing.assert_allclose(read[20, 54], GREEN, atol=6)


def test_other_readers_see_red_as_red(tmp_path, picture):
    bgr = cv2.imread(str(write_image(tmp_path / "a.png", picture)))
    assert tuple(bgr[0, 0]) == RED[::-1]


def test_gray_file_becomes_three_equal_channels(tmp_path):
    gray = np.arange(200, dtype=np.uint8).reshape(10, 20)
    cv2.imwrite(str(tmp_path / "gray.png"), gray)
    assert np.array_equal(read_image(tmp_path / "gray.png"), np.repeat(gray[..., None], 3, axis=2))


def test_alpha_is_dropped(tmp_path, picture):
    rgba = np.dstack([picture[..., ::-1], np.full(picture.shape[:2], 7, np.uint8)])
    cv2.imwrite(str(tmp_path / "alpha.png"), rgba)
    assert np.array_equal(read_image(tmp_path / "alpha.png"), picture)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.jpg.*no such picture"):
        read_image(tmp_path / "nowhere.jpg")


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".bmp", ".tif"])
@pytest.mark.parametrize("share", [0.3, 0.9, 0.99])
def test_truncated_file_is_refused(tmp_path, picture, suffix, share):
    noisy = np.random.default_rng(3).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    whole = write_image(tmp_path / f"whole{suffix}", noisy).read_bytes()
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(PictureError, match=f"cut{suffix}.*cut off"):
        read_image(cut)


def test_png_without_its_end_chunk_is_refused(tmp_path, picture):
    path = write_image(tmp_path / "cut.png", picture)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(PictureError, match=r"cut\.png.*cut off"):
        read_image(path)


def test_truncated_jpeg_with_whole_thumbnail_is_refused(tmp_path, picture):
    """The end marker of a thumbnail in the header must not be taken for the picture's."""
    whole = write_image(tmp_path / "a.jpg", picture).read_bytes()
    thumbnail = b"\xff\xe1" + (2 + len(whole)).to_bytes(2, "big") + whole
    with_thumbnail = tmp_path / "with.jpg"
    with_thumbnail.write_bytes(whole[:2] + thumbnail + whole[2:])
    assert read_image(with_thumbnail).shape == picture.shape
    with_thumbnail.write_bytes(with_thumbnail.read_bytes()[:-4])
    with pytest.raises(PictureError, match="cut off"):
        read_image(with_thumbnail)


def test_data_after_the_end_of_a_jpeg_are_ignored(tmp_path, picture):
    path = write_image(tmp_path / "a.jpg", picture)
    path.write_bytes(path.read_bytes() + b"maker's own data\0\0")
    assert read_image(path).shape == picture.shape


def test_empty_file_is_refused(tmp_path):
    (tmp_path / "empty.jpg").touch()
    with pytest.raises(PictureError, match=r"empty\.jpg.*is empty"):
        read_image(tmp_path / "empty.jpg")


def test_text_named_jpg_is_refused(tmp_path):
    (tmp_path / "text.jpg").write_text("not a picture")
    with pytest.raises(PictureError, match=r"text\.jpg.*not a JPEG, PNG, WebP, BMP or TIFF"):
        read_image(tmp_path / "text.jpg")


@pytest.mark.parametrize("name", ["photo.heic", "renamed.jpg"])
def test_heic_is_refused_with_the_way_to_convert_it(tmp_path, name):
    (tmp_path / name).write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(99))
    with pytest.raises(PictureError, match=rf"{name}: is a HEIC picture.*convert it to JPEG"):
        read_image(tmp_path / name)


def huge_png(width: int, height: int) -> bytes:
    """A PNG of a few bytes with any size in its header."""
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(b"")),
        (b"IEND", b""),
    ]
    parts = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def huge_jpeg(picture: np.ndarray, width: int, height: int) -> bytes:
    """A JPEG with a wrong size in its frame header."""
    data = bytearray(cv2.imencode(".jpg", picture)[1].tobytes())
    struct.pack_into(">HH", data, data.index(b"\xff\xc0") + 5, height, width)
    return bytes(data)


@pytest.mark.parametrize("kind", ["png", "jpg"])
@pytest.mark.parametrize("size", [(65535, 65535), (20000, 20000), (1, 65535 * 4)])
def test_claims_of_a_header_are_refused_at_once(tmp_path, picture, kind, size, monkeypatch):
    if max(size) > 65535 and kind == "jpg":
        pytest.skip("a JPEG cannot claim more")
    monkeypatch.setattr(images, "MAX_PIXELS", 200_000)
    path = tmp_path / f"bomb.{kind}"
    path.write_bytes(huge_png(*size) if kind == "png" else huge_jpeg(picture, *size))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("would be decoded"))
    began_s = time.perf_counter()
    with pytest.raises(PictureError, match=rf"bomb\.{kind}: claims {size[0]}x{size[1]} pixels"):
        read_image(path)
    assert time.perf_counter() - began_s < 0.1


def test_a_thumbnail_is_not_taken_for_the_picture(tmp_path, picture):
    """A thumbnail with its own frame header lies before the picture's frame header."""
    data = huge_jpeg(picture, 64, 40)
    thumbnail = huge_jpeg(picture, 60000, 60000)
    path = tmp_path / "a.jpg"
    path.write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail + data[2:])
    assert read_image(path).shape == picture.shape


def test_markers_without_content_are_refused(tmp_path):
    (tmp_path / "hollow.jpg").write_bytes(b"\xff\xd8\xff\xda\xff\xd9")
    with pytest.raises(PictureError, match=r"hollow\.jpg.*cannot be decoded"):
        read_image(tmp_path / "hollow.jpg")


@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((4, 4), np.uint8),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros((4, 4, 3), np.float32),
        [[0, 0, 0]],
        None,
    ],
    ids=["gray", "rgba", "float", "list", "none"],
)
def test_only_rgb_is_written(tmp_path, wrong):
    with pytest.raises(PictureError, match="expected an RGB image"):
        write_image(tmp_path / "a.png", wrong)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.gif", "a.heic", "a"])
def test_other_formats_are_refused(tmp_path, picture, name):
    with pytest.raises(PictureError, match=r"end the name in \.jpg or \.png"):
        write_image(tmp_path / name, picture)


def test_unwritable_folder_is_named(tmp_path, picture):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match=r"file.a\.png.*cannot be written.*choose another folder"):
        write_image(tmp_path / "file" / "a.png", picture)


def test_pictures_are_listed_in_natural_order_without_partial_files(tmp_path, picture):
    for name in ("board10.png", "board2.PNG", "board1.jpeg", "notes.txt", "._board1.png"):
        (tmp_path / name).touch()
    (tmp_path / "board3.partial.0123456789ab.png").touch()
    (tmp_path / "folder.jpg").mkdir()
    assert [p.name for p in list_pictures(tmp_path)] == ["board1.jpeg", "board2.PNG", "board10.png"]


def test_names_with_other_digits_can_be_sorted():
    names = [Path("m²"), Path("m10"), Path("m9"), Path("7")]
    assert [p.name for p in sorted(names, key=natural_key)] == ["7", "m9", "m10", "m²"]


def test_empty_and_missing_folders_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="holds no picture"):
        list_pictures(tmp_path)
    with pytest.raises(FileNotFoundError, match="nowhere: there is no such folder"):
        list_pictures(tmp_path / "nowhere")
