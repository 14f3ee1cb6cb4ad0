"""Images: read and written, checked, and OpenCV's number of threads.

An image is an RGB array (height, width, 3), uint8. Every function that takes one passes it through `require_rgb`, and
so accepts views such as ``bgr[..., ::-1]`` and ``rgba[..., :3]`` and read-only arrays.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from lanes.errors import PictureError
from lanes.files import require_file, write_atomically

_WRITABLE = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")
_QUALITY_OPTIONS = {".webp": cv2.IMWRITE_WEBP_QUALITY} | dict.fromkeys((".jpg", ".jpeg"), cv2.IMWRITE_JPEG_QUALITY)
# First bytes of picture formats, and Pillow's module for each. HEIC is refused with a sentence, AVIF where Pillow lacks
# it.
_PICTURE_FORMATS = {
    rb"\xff\xd8": "Jpeg",
    rb"\x89PNG\r\n\x1a\n": "Png",
    rb"RIFF....WEBP": "WebP",
    rb"BM": "Bmp",
    rb"II\*\0|MM\0\*": "Tiff",
    rb"....ftypavi[fs]": "Avif",
    # ISO 23008-12, 10.2
    rb"....ftyp(hei[cx]|hevc|mif1|msf1)": "Heic",
}
# First bytes of videos: mp4 and mov, Matroska, avi, flv, Ogg, asf, MPEG streams, transport streams (also with times
# before the packets), mxf, gif, yuv4mpeg, nut.
_VIDEO_FORMATS = (
    rb"....(ftyp(?!M4[AB])|moov|mdat|wide|free|skip)|\x1aE\xdf\xa3|RIFF....AVI |FLV|OggS|\x30\x26\xb2\x75|\0\0\0?\x01"
    rb"|\x47.{187}\x47|.{4}\x47.{191}\x47|\x06\x0e\x2b\x34|GIF8|YUV4MPEG2|nut/multimedia"
)
# A name decides only where the content does not: empty and damaged files, and MJPEG, which begins like a JPEG.
_PICTURE_SUFFIXES = (*_WRITABLE, ".jfif", ".jpe", ".avif", ".heic", ".heif")
_VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".ts", ".mts", ".mpg", ".mpeg", ".mjpeg", ".mjpg")
LOG_SUFFIXES = (".bag", ".db3", ".mcap")
# EXIF orientations (TIFF 6.0): the axes of the upright image, right and down, in those of the stored one.
_UPRIGHT_AXES = {
    1: ((1, 0), (0, 1)),
    2: ((-1, 0), (0, 1)),
    3: ((-1, 0), (0, -1)),
    4: ((1, 0), (0, -1)),
    5: ((0, 1), (1, 0)),
    6: ((0, -1), (1, 0)),
    7: ((0, -1), (-1, 0)),
    8: ((0, 1), (-1, 0)),
}
# Four times an 8K video's, and above the 102 million of the largest cameras. A header can claim 4,000 million.
MAX_PIXELS = 128_000_000
# Size of an incompressible PNG with MAX_PIXELS.
MAX_PICTURE_BYTES = 3 * MAX_PIXELS


def require_rgb(image: np.ndarray, name: object = "image") -> np.ndarray:
    """The image, contiguous in memory as OpenCV and FFmpeg need it: a copy only of a view with other strides.

    Raises PictureError if it is not an array (height, width, 3), uint8, with at least one pixel.
    """
    if not isinstance(image, np.ndarray) or image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        got = f"shape {image.shape}, dtype {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
        raise PictureError(
            f"{name}: expected an RGB image of shape (height, width, 3) and dtype uint8, got {got}; "
            "read it with read_image."
        )
    if not image.size:
        raise PictureError(f"{name}: holds no pixels (shape {image.shape}); check how it was cropped.")
    return np.ascontiguousarray(image)


def kind_of_file(path: str | Path) -> Literal["picture", "video"] | None:
    """What a file is by its first bytes, or where these do not say, by its name; None if neither says."""
    path = Path(path)
    try:
        with path.open("rb") if path.is_file() else BytesIO() as file:
            head = file.read(200)
    except OSError:
        head = b""  # reading the file will say why it cannot be read
    suffix = path.suffix.lower()
    if (picture := _picture_format(head)) and not (picture == "Jpeg" and suffix in (".mjpeg", ".mjpg")):
        return "picture"
    if re.match(_VIDEO_FORMATS, head, re.DOTALL) or suffix in (*_VIDEO_SUFFIXES, *LOG_SUFFIXES):
        return "video"
    return "picture" if suffix in _PICTURE_SUFFIXES else None


def read_image(path: str | Path, *, upright: bool = True) -> np.ndarray:
    """The RGB image (height, width, 3), uint8, of a JPEG, PNG, WebP, BMP, TIFF or AVIF file.

    It is turned as its EXIF orientation says; with `upright=False` it is as the sensor saw it. Gray images are repeated
    over three channels; an alpha channel is dropped. Raises FileNotFoundError, or PictureError if the file is empty,
    truncated, damaged, too large, of another format, or holds several images.
    """
    path = require_file(path, "picture", error=PictureError, max_bytes=MAX_PICTURE_BYTES)
    data = path.read_bytes()
    picture = _open_complete(path, data)
    try:
        if picture.format == "AVIF":  # few builds of OpenCV read it
            image = np.array(picture.convert("RGB"))
        else:
            options = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
            # some cameras omit the end marker of a JPEG
            bgr = cv2.imdecode(np.frombuffer(data + b"\xff\xd9", np.uint8), options)
            image = cv2.cvtColor(np.asarray(bgr, np.uint8), cv2.COLOR_BGR2RGB)
    except (cv2.error, OSError, TypeError) as error:
        raise PictureError(f"{path}: cannot be decoded as a picture; save it again as JPEG or PNG.") from error
    if not upright:
        return image
    (right_x, right_y), (down_x, down_y) = upright_axes(orientation_of(picture))
    image = image if right_x else image.swapaxes(0, 1)
    return np.ascontiguousarray(image[:: down_x + down_y, :: right_x + right_y])


def upright_axes(orientation: int) -> np.ndarray:
    """Matrix (2, 2) from the axes (right, down) of a stored image to those of the upright one, by EXIF orientation."""
    return np.array(_UPRIGHT_AXES.get(orientation, _UPRIGHT_AXES[1]))


def read_orientation(path: str | Path) -> int:
    """The EXIF orientation of a picture, 1 to 8; 1, which is upright, if it has none or cannot be read."""
    from PIL import Image

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as picture:
            return orientation_of(picture)
    except Exception:  # damaged files make Pillow raise many types, and are refused where they are decoded
        return 1


def orientation_of(picture: Any) -> int:
    """The EXIF orientation of a picture that Pillow has opened, 1 to 8; 1 if it has none."""
    # OpenCV and Pillow turn a TIFF themselves.
    orientation = 1 if picture.format == "TIFF" else picture.getexif().get(0x0112, 1)
    return orientation if orientation in _UPRIGHT_AXES else 1


def write_image(path: str | Path, image: np.ndarray, *, jpeg_quality: int = 92) -> Path:
    """Write an RGB image (height, width, 3), uint8, atomically in the format of its suffix; returns the path.

    The folder is created where needed. `jpeg_quality`, 1 to 100, is also that of WebP; 92 keeps edges clean at about a
    fifth of the size of PNG. Raises PictureError if `image` is not RGB or the suffix is that of no format written,
    OSError if the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _WRITABLE:
        kind = path.suffix or "a name without suffix"
        raise PictureError(f"{path}: cannot write {kind}; end the name in .jpg or .png.")
    image = require_rgb(image, path)
    options = [_QUALITY_OPTIONS[suffix], jpeg_quality] if suffix in _QUALITY_OPTIONS else []
    done, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise PictureError(f"{path}: the image of shape {image.shape} could not be encoded as {path.suffix}.")
    write_atomically(path, data.tobytes())
    return path


def natural_key(path: Path) -> list:
    """Sort key for natural order: runs of digits compare as numbers."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


def _picture_format(head: bytes) -> str | None:
    """The name of the picture format that these first bytes belong to, as in `_PICTURE_FORMATS`, or None."""
    return next((name for start, name in _PICTURE_FORMATS.items() if re.match(start, head, re.DOTALL)), None)


def _open_complete(path: Path, data: bytes) -> Any:
    """Pillow's image of a complete file; refuses files of other formats, too large, cut off, damaged or with several
    images. OpenCV would fill missing rows with gray and read the first image only.

    Pillow decodes at an eighth of a JPEG's size: a third of the time of the full size. `PIL.Image.open` would refuse
    large pictures without their size.
    """
    kind = _picture_format(data)
    if kind is None:
        raise PictureError(f"{path}: this is not a JPEG, PNG, WebP, BMP, TIFF or AVIF picture; save it again as JPEG.")
    if (opener := _pillow_opener(kind)) is None:
        raise PictureError(
            f"{path}: is a {kind.upper()} picture, which cannot be read; convert it to JPEG, for instance with "
            f"ImageMagick (magick {path.name} {path.stem}.jpg) or by exporting it from the photo app."
        )
    try:
        with warnings.catch_warnings(action="ignore"):  # about entries of no importance here, such as EXIF
            # Pillow decodes a PNG that lacks only its end; `verify` refuses it, but makes the object unusable.
            opener(BytesIO(data)).verify()
            picture = opener(BytesIO(data))
            images = getattr(picture, "n_frames", 1)
            too_large = math.prod(picture.size) > MAX_PIXELS
            if not too_large and images == 1:
                picture.draft("L", (1, 1))
                try:
                    picture.load()
                except OSError:
                    if kind != "Jpeg" or _lacks_rows(opener, data):
                        raise
    except Exception as error:  # a damaged file makes Pillow raise many types
        raise PictureError(
            f"{path}: cannot be decoded as a picture, it is cut off, damaged or of a rare kind ({error}); copy it "
            "again from its source, or save it again as JPEG or PNG."
        ) from error
    if images > 1:
        raise PictureError(f"{path}: holds {images} images; save the one to use alone, or convert all to an mp4 video.")
    if too_large:
        raise PictureError(
            f"{path}: claims {picture.width}x{picture.height} pixels, more than the maximum of "
            f"{MAX_PIXELS / 1e6:.0f} million; make it smaller."
        )
    return picture


def _pillow_opener(kind: str) -> Any:
    """Pillow's class for a format; None if this Pillow does not read it."""
    # Imported here: commands that read videos only start sooner.
    from importlib import import_module

    from PIL import features

    if kind == "Heic" or (kind == "Avif" and not features.check("avif")):
        return None
    return getattr(import_module(f"PIL.{kind}ImagePlugin"), f"{kind}ImageFile")


def _lacks_rows(opener: Any, data: bytes) -> bool:
    """Whether a JPEG without an end marker, which some cameras omit, lacks more: then bytes added change the image."""
    first, second = (np.array(opener(BytesIO(data + filler + b"\xff\xd9"))) for filler in (b"", b"\x55" * 1000))
    return not np.array_equal(first, second)


@contextmanager
def opencv_threads(count: int) -> Iterator[None]:
    """Run OpenCV on `count` threads in the `with` block; -1 is its default number.

    Use one thread for reproducible results (with more threads the order of summation varies), for timing, and if other
    threads use the processor already: OpenCV's threads would then mostly wait, and waiting takes processor time. Use
    the default number if other processes wait for the result.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
