"""Images: read and written, checked, and OpenCV's number of threads.

An image is an RGB array (height, width, 3), uint8. Every function that takes one passes
it through `require_rgb`, and so accepts views such as ``bgr[..., ::-1]`` and
``rgba[..., :3]`` and read-only arrays.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from lanes.errors import PictureError
from lanes.files import require_file, write_atomically
from lanes.recording import MAX_PIXELS, to_8_bits

# Names of JPEG; OpenCV does not know all of them.
_JPEG = (".jpg", ".jpeg", ".jpe", ".jfif")
_WRITABLE = (*_JPEG, ".png", ".webp", ".bmp", ".tif", ".tiff", ".avif")
_QUALITY_OPTIONS = dict.fromkeys(_JPEG, cv2.IMWRITE_JPEG_QUALITY)
_QUALITY_OPTIONS |= {
    ".webp": cv2.IMWRITE_WEBP_QUALITY,
    ".avif": cv2.IMWRITE_AVIF_QUALITY,
}
# Formats that are read, with Pillow's names, and the ends of the names of images and
# videos.
_READ_FORMATS = ("JPEG", "PNG", "WEBP", "BMP", "TIFF", "AVIF")
_IMAGE_NAMES = r"\.(jpe?g|jpe|jfif|png|webp|bmp|tiff?|avif|hei[cf])$"
_VIDEO_NAMES = (
    r"\.(mp4|m4v|mov|3gp|avi|mkv|webm|m?ts|m2ts|mpe?g|vob|flv|wmv|asf|ogv|mxf|nut|gif"
    r"|y4m|mjpe?g|h?26[45]|hevc"
    r"|(bag|db3|mcap)(\.zstd?)?)$"
)
# EXIF orientations (TIFF 6.0): the axes of the upright image, right and down, in those
# of the stored one.
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


def is_rgb(image: object) -> bool:
    """Whether this is an array (height, width, 3), uint8; it may have no pixels."""
    if not isinstance(image, np.ndarray):
        return False
    return image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8


def require_rgb(image: np.ndarray | str | Path, name: object = "image") -> np.ndarray:
    """The image, contiguous in memory as OpenCV and FFmpeg need it: a copy only of a
    view with other strides.

    The path of a still stands for its image. Raises PictureError if it is not an array
    (height, width, 3), uint8, with at least one pixel, and what `read_image` raises.
    """
    if isinstance(image, str | Path):
        return read_image(image)

    if not is_rgb(image):
        got = type(image).__name__
        if isinstance(image, np.ndarray):
            got = f"shape {image.shape}, dtype {image.dtype}"
        raise PictureError(
            f"{name}: expected an RGB image of shape (height, width, 3) and dtype "
            f"uint8, got {got}; read it with read_image."
        )
    if not image.size:
        raise PictureError(
            f"{name}: holds no pixels (shape {image.shape}); check how it was cropped."
        )

    return np.ascontiguousarray(image)


def to_rgb(image: np.ndarray) -> np.ndarray:
    """A new RGB image from RGB, gray (height, width) uint8, or a mask of bool or of 0
    and 1.
    """
    image = np.asarray(image)
    if image.ndim == 2:
        is_mask = image.dtype == bool or (image.size and image.max() <= 1)
        if is_mask:
            image = (image > 0).astype(np.uint8) * 255
        image = np.repeat(image[:, :, None], 3, axis=2)
    return require_rgb(image).copy()


def kind_of_file(path: str | Path) -> Literal["image", "video"] | None:
    """The kind of a file by the suffix of its name; None if it is neither."""
    name = str(path)
    if re.search(_IMAGE_NAMES, name, re.IGNORECASE):
        return "image"
    if re.search(_VIDEO_NAMES, name, re.IGNORECASE):
        return "video"
    return None


def read_image(path: str | Path, *, upright: bool = True) -> np.ndarray:
    """The RGB image (height, width, 3), uint8, of a JPEG, PNG, WebP, BMP, TIFF or AVIF
    file.

    It is turned as its EXIF orientation says; with `upright=False` it is as the sensor
    saw it. Gray images are repeated over three channels; an alpha channel is dropped.
    Of images with 10 to 16 bits the brightest value shows the bits.
    Raises FileNotFoundError, or PictureError if the file is empty, truncated, damaged,
    too large, of another format, or holds several images.
    """
    # Imported here: commands that read videos only start sooner.
    from PIL import Image

    # an incompressible PNG of MAX_PIXELS is as large
    path = require_file(path, "image", error=PictureError, max_bytes=3 * MAX_PIXELS)

    try:
        # warnings about entries of no importance here, such as EXIF
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(path, formats=_READ_FORMATS) as opened,
        ):
            # MPO is a JPEG with previews behind the image
            images = 1
            if opened.format != "MPO":
                images = getattr(opened, "n_frames", 1)
            mode = opened.mode
            # Pillow keeps the upper 8 of 16 bits, which are dark if the camera has 12
            is_deep = ";16" in str(opened.tile)
            image = np.array(opened.convert("RGB"))
            if is_deep and images == 1:
                image = _read_16_bits(path)
            if upright:
                image = make_upright(image, orientation_of(opened))
    except Exception as error:  # a damaged file makes Pillow raise many types
        raise PictureError(
            f"{path}: cannot be decoded as an image ({error}): it is cut off, damaged, "
            "too large, or not a JPEG, PNG, WebP, BMP, TIFF or AVIF; copy it again "
            "from its source, or convert it to JPEG with the photo app."
        ) from error

    if images > 1:
        raise PictureError(
            f"{path}: holds {images} images; save the one to use alone, or convert all "
            "to an mp4 video."
        )
    # Pillow's modes of integers and floating-point numbers
    if mode[0] in "IF" and not is_deep:
        raise PictureError(
            f"{path}: has neither 8 nor 16 bits a value; save it again as JPEG."
        )
    return image


def _read_16_bits(path: Path) -> np.ndarray:
    """The RGB image, uint8, of a file whose values have two bytes, as it is stored."""
    data = np.frombuffer(path.read_bytes(), np.uint8)
    stored = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if stored is None:
        raise ValueError("its values of 16 bits cannot be read")
    if stored.ndim == 2:
        return cv2.cvtColor(to_8_bits(stored), cv2.COLOR_GRAY2RGB)
    without_alpha = to_8_bits(stored[..., :3])
    return cv2.cvtColor(without_alpha, cv2.COLOR_BGR2RGB)


def upright_axes(orientation: int) -> np.ndarray:
    """Matrix (2, 2) from the axes (right, down) of a stored image to those of the
    upright one, by EXIF orientation.
    """
    axes = _UPRIGHT_AXES.get(orientation, _UPRIGHT_AXES[1])
    return np.array(axes)


def is_transposed(orientation: int) -> bool:
    """Whether the rows of the stored image are columns of the upright one."""
    return orientation >= 5


def make_upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """The upright image (rows, columns, ...), contiguous, of a stored one."""
    right, down = upright_axes(orientation).sum(axis=1)
    if is_transposed(orientation):
        image = np.swapaxes(image, 0, 1)
    return np.ascontiguousarray(image[::down, ::right])


def as_stored(image: np.ndarray, orientation: int) -> np.ndarray:
    """The stored image, contiguous, of an upright one: inverse of `make_upright`."""
    # only the quarter turns are not their own inverses
    inverse = {6: 8, 8: 6}.get(orientation, orientation)
    return make_upright(image, inverse)


def read_orientation(path: str | Path) -> int:
    """The EXIF orientation of a still, 1 to 8; 1, which is upright, if it has none or
    cannot be read.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as opened:
            return orientation_of(opened)
    # damaged files make Pillow raise many types, and are refused where they are decoded
    except Exception:
        return 1


def orientation_of(opened: Any) -> int:
    """The EXIF orientation of an image that Pillow has opened, 1 to 8; 1 if it has
    none.
    """
    # OpenCV and Pillow turn a TIFF themselves.
    if opened.format == "TIFF":
        return 1
    orientation = opened.getexif().get(0x0112, 1)
    return orientation if orientation in _UPRIGHT_AXES else 1


def write_image(path: str | Path, image: np.ndarray, *, jpeg_quality: int = 92) -> Path:
    """Write an RGB image (height, width, 3), uint8, atomically in the format of its
    suffix; returns the path.

    The folder is created where needed. `jpeg_quality`, 1 to 100, is also that of WebP;
    92 keeps edges clean at about a fifth of the size of PNG. Raises PictureError if
    `image` is not RGB or the suffix is not supported, OSError if the file cannot be
    written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _WRITABLE:
        kind = path.suffix or "a name without suffix"
        raise PictureError(
            f"{path}: cannot write {kind}; end the name in .jpg or .png."
        )

    image = require_rgb(image, path)
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    options = []
    if suffix in _QUALITY_OPTIONS:
        options = [_QUALITY_OPTIONS[suffix], jpeg_quality]
    written_as = ".jpg" if suffix in _JPEG else path.suffix
    done, data = cv2.imencode(written_as, bgr, options)
    if not done:
        raise PictureError(
            f"{path}: the image of shape {image.shape} could not be encoded as "
            f"{path.suffix}."
        )

    write_atomically(path, data.tobytes())
    return path


def natural_key(path: Path) -> list:
    """Sort key for natural order: runs of digits compare as numbers."""
    parts = re.split(r"(\d+)", path.name)
    return [int(part) if part.isdecimal() else part for part in parts]


@contextmanager
def opencv_threads(count: int) -> Iterator[None]:
    """Run OpenCV on `count` threads in the `with` block; -1 is its default number.

    Use one thread for reproducible results (with more threads the order of summation
    varies), for timing, and if other threads use the processor already: OpenCV's
    threads would then mostly wait, and waiting takes processor time. Use the default
    number if other processes wait for the result.
    """
    threads = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
