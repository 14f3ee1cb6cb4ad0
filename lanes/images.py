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

import cv2
import numpy as np

from lanes.errors import PictureError
from lanes.files import list_files, require_file, write_atomically

_READABLE = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")
# Files that are taken for stills, not for videos. `read_image` refuses HEIC and says how to convert it.
PICTURE_SUFFIXES = (*_READABLE, ".heic", ".heif")
_QUALITY_OPTIONS = {".webp": cv2.IMWRITE_WEBP_QUALITY} | dict.fromkeys((".jpg", ".jpeg"), cv2.IMWRITE_JPEG_QUALITY)
# First box of a HEIC file (ISO 23008-12, 10.2).
_HEIC_BOXES = {b"ftypheic", b"ftypheix", b"ftyphevc", b"ftypmif1", b"ftypmsf1"}
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


def read_image(path: str | Path) -> np.ndarray:
    """The RGB image (height, width, 3), uint8, of a JPEG, PNG, WebP, BMP or TIFF file.

    Gray images are repeated over three channels; an alpha channel is dropped. Raises FileNotFoundError, or PictureError
    if the file is empty, truncated, damaged, too large, or of another format.
    """
    path = require_file(path, "picture", error=PictureError, max_bytes=MAX_PICTURE_BYTES)
    data = path.read_bytes()
    _require_complete(path, data)
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        bgr = None
    if bgr is None:
        raise PictureError(f"{path}: cannot be decoded as a picture; save it again as JPEG or PNG.")
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def write_image(path: str | Path, image: np.ndarray, *, jpeg_quality: int = 92) -> Path:
    """Write an RGB image (height, width, 3), uint8, atomically in the format of its suffix; returns the path.

    The folder is created where needed. `jpeg_quality`, 1 to 100, is also that of WebP; 92 keeps edges clean at about a
    fifth of the size of PNG. Raises PictureError if `image` is not RGB or the suffix is none that `read_image` reads,
    OSError if the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _READABLE:
        kind = path.suffix or "a name without suffix"
        raise PictureError(f"{path}: cannot write {kind}; end the name in .jpg or .png.")
    image = require_rgb(image, path)
    options = [_QUALITY_OPTIONS[suffix], jpeg_quality] if suffix in _QUALITY_OPTIONS else []
    done, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise PictureError(f"{path}: the image of shape {image.shape} could not be encoded as {path.suffix}.")
    write_atomically(path, data.tobytes())
    return path


def list_pictures(folder: str | Path) -> list[Path]:
    """The picture files of a folder in natural order (board2 before board10); FileNotFoundError if there are none."""
    found = list_files(folder, PICTURE_SUFFIXES)
    if not found:
        raise FileNotFoundError(
            f"{folder}: holds no picture ({', '.join(_READABLE)}); add some or name another folder."
        )
    return sorted(found, key=natural_key)


def natural_key(path: Path) -> list:
    """Sort key for natural order: runs of digits compare as numbers."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


def _require_complete(path: Path, data: bytes) -> None:
    """Refuse files of other formats, too large, cut off or damaged; OpenCV would fill missing rows with gray.

    Pillow decodes at an eighth of a JPEG's size: a third of the time of the full size. `PIL.Image.open` would refuse
    large pictures without their size.
    """
    # Imported here: commands that read videos only start sooner.
    from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin, TiffImagePlugin, WebPImagePlugin

    openers = {
        b"\xff\xd8": JpegImagePlugin.JpegImageFile,
        b"\x89PNG\r\n\x1a\n": PngImagePlugin.PngImageFile,
        b"RIFF": WebPImagePlugin.WebPImageFile,
        b"BM": BmpImagePlugin.BmpImageFile,
        b"II*\0": TiffImagePlugin.TiffImageFile,
        b"MM\0*": TiffImagePlugin.TiffImageFile,
    }
    if data[4:12] in _HEIC_BOXES:
        raise PictureError(
            f"{path}: is a HEIC picture, which cannot be read; convert it to JPEG, for instance with ImageMagick "
            f"(magick {path.name} {path.stem}.jpg) or by exporting it from the photo app."
        )
    opener = next((opener for magic, opener in openers.items() if data.startswith(magic)), None)
    if opener is None:
        raise PictureError(f"{path}: this is not a JPEG, PNG, WebP, BMP or TIFF picture; save it again as JPEG or PNG.")
    try:
        with warnings.catch_warnings(action="ignore"):  # about entries of no importance here, such as EXIF
            # Pillow decodes a PNG that lacks only its end; `verify` refuses it, but makes the object unusable.
            opener(BytesIO(data)).verify()
            picture = opener(BytesIO(data))
            too_large = math.prod(picture.size) > MAX_PIXELS
            if not too_large:
                picture.draft("L", (1, 1))
                picture.load()
    except Exception as error:  # a damaged file makes Pillow raise many types
        raise PictureError(
            f"{path}: cannot be decoded as a picture, it is cut off or damaged ({error}); copy it again from its "
            "source, or save it again as JPEG or PNG."
        ) from error
    if too_large:
        raise PictureError(
            f"{path}: claims {picture.width}x{picture.height} pixels, more than the maximum of "
            f"{MAX_PIXELS / 1e6:.0f} million; make it smaller."
        )


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
