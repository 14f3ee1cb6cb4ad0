"""JPEG and PNG files in and out; outside this module a picture is an RGB array (height, width, 3), uint8."""

from __future__ import annotations

import math
import re
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from lanes.io.files import list_files, require_file, write_atomically
from lanes.io.frames import PictureError, require_rgb

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png")
# Four times an 8K video's, and above the 102 million of the largest cameras. A header can claim 4,000 million.
MAX_PIXELS = 128_000_000
# Size of an incompressible PNG with MAX_PIXELS.
MAX_PICTURE_BYTES = 3 * MAX_PIXELS


def read_image(path: str | Path) -> np.ndarray:
    """The RGB picture (height, width, 3), uint8, of a JPEG or PNG file.

    Gray pictures are repeated over three channels; an alpha channel is dropped.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    PictureError
        If the file is empty, truncated, damaged, too large, or neither JPEG nor PNG.
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
    """Write an RGB picture (height, width, 3), uint8, atomically as .jpg, .jpeg or .png; returns the path.

    The folder is created where needed. `jpeg_quality` is 1 to 100; 92 keeps edges clean at about a fifth of the size of
    PNG.

    Raises
    ------
    PictureError
        If `image` is not an RGB picture or the suffix is not one of `PICTURE_SUFFIXES`.
    OSError
        If the folder cannot be written to.
    """
    path = Path(path)
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise PictureError(
            f"{path}: cannot write {path.suffix or 'a name without suffix'}; end the name in .jpg or .png."
        )
    require_rgb(image, path)
    options = [] if path.suffix.lower() == ".png" else [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
    done, data = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise PictureError(f"{path}: the picture of shape {image.shape} could not be encoded as {path.suffix}.")
    write_atomically(path, data.tobytes())
    return path


def list_pictures(folder: str | Path) -> list[Path]:
    """The JPEG and PNG files of a folder in natural order (board2 before board10).

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    """
    found = list_files(folder, PICTURE_SUFFIXES)
    if not found:
        raise FileNotFoundError(
            f"{folder}: holds no picture ({', '.join(PICTURE_SUFFIXES)}); add some or name another folder."
        )
    return sorted(found, key=natural_key)


def natural_key(path: Path) -> list:
    """Sort key for natural order: runs of digits compare as numbers."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


def _require_complete(path: Path, data: bytes) -> None:
    """Refuse files that are not JPEG or PNG, too large, cut off or damaged; OpenCV would fill missing rows with gray.

    Pillow decodes at an eighth of a JPEG's size: a third of the time of the full size.
    """
    # Imported here: commands that read videos only start sooner.
    from PIL.JpegImagePlugin import JpegImageFile
    from PIL.PngImagePlugin import PngImageFile

    # Not `PIL.Image.open`, which refuses large pictures without naming their size.
    if data.startswith(b"\xff\xd8"):
        opener = JpegImageFile
    elif data.startswith(b"\x89PNG\r\n\x1a\n"):
        opener = PngImageFile
    else:
        raise PictureError(f"{path}: this is neither a JPEG nor a PNG picture; save it again as JPEG or PNG.")
    try:
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
