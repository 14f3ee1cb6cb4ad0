"""Pictures in and out of files: the only place besides video.py that talks to an image codec.

Everywhere else an image is an ndarray of shape (height, width, 3), dtype uint8, channels in RGB order.
"""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path

import cv2
import numpy as np

from lanes.io.files import list_files, require_file, write_atomically
from lanes.io.frames import PictureError, require_rgb

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png")
# Four times an 8K video's, and above the 102 million of the largest cameras; a file may claim 4,000 million.
MAX_PIXELS = 128_000_000
# A PNG of so many pixels that cannot be compressed.
MAX_PICTURE_BYTES = 3 * MAX_PIXELS


def read_image(path: str | Path) -> np.ndarray:
    """Read a picture file as RGB.

    Gray pictures are repeated over three channels and a fourth (alpha) channel is dropped, so that every
    caller gets the one layout this project uses.

    Parameters
    ----------
    path : str or Path
        A JPEG or PNG file.

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        Channels in RGB order.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    PictureError
        If the file is empty, truncated or not a picture.
    """
    path = require_file(path, "picture", error=PictureError, max_bytes=MAX_PICTURE_BYTES)
    data = path.read_bytes()
    _require_whole(path, data)
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        bgr = None
    if bgr is None:
        raise PictureError(f"{path}: this file cannot be decoded as a picture; save it again as JPEG or PNG.")
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def write_image(path: str | Path, image: np.ndarray, *, jpeg_quality: int = 92) -> Path:
    """Write an RGB picture so that the file appears under its name only when it is whole.

    Parameters
    ----------
    path : str or Path
        Ends in .jpg, .jpeg or .png; the folder is created where needed.
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    jpeg_quality : int, in range 1..100
        Ignored for PNG. The default 92 keeps edges clean at about a fifth of the size of PNG.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    PictureError
        If `image` is no RGB picture or the suffix is not one of `PICTURE_SUFFIXES`.
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
    """Frame files of a folder in natural order (board2 before board10).

    Raises
    ------
    FileNotFoundError
        If the folder does not exist or holds no picture.
    """
    found = list_files(folder, PICTURE_SUFFIXES)
    if not found:
        raise FileNotFoundError(
            f"{folder}: holds no picture ({', '.join(PICTURE_SUFFIXES)}); put some there or name another folder."
        )
    return sorted(found, key=natural_key)


def natural_key(path: Path) -> list:
    """Sort key that compares digit runs as numbers."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", path.name)]


def _require_whole(path: Path, data: bytes) -> None:
    """Refuse truncated files, which OpenCV would decode with a gray remainder and a warning on stderr."""
    # A JPEG's last scan (FFDA) ends with FFD9 (ITU-T T.81, B.1.1), after which some cameras append data of their own;
    # a thumbnail's FFD9 comes before that scan. A PNG ends with IEND.
    if data[:2] == b"\xff\xd8":
        whole, size = data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda"), _jpeg_size(data)
    elif data[:8] == b"\x89PNG\r\n\x1a\n":
        whole, size = b"IEND" in data, struct.unpack(">II", data[16:24].ljust(8, b"\0"))
    else:
        raise PictureError(
            f"{path}: this is neither a JPEG nor a PNG picture, whatever its name says; save it again as JPEG or PNG."
        )
    if not whole:
        raise PictureError(
            f"{path}: the picture is cut off (its end marker is missing); copy it again from its source."
        )
    if not size[0] * size[1]:
        raise PictureError(f"{path}: this file cannot be decoded as a picture; save it again as JPEG or PNG.")
    if size[0] * size[1] > MAX_PIXELS:
        raise PictureError(
            f"{path}: claims {size[0]}x{size[1]} pixels, more than this program takes ({MAX_PIXELS / 1e6:.0f} "
            "million); make it smaller."
        )


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """(width, height) that a JPEG claims before its first scan, (0, 0) if none; of several the largest."""
    at, size = 2, (0, 0)
    while at + 9 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        # T.81, B.2.2: a frame header is any of FFC0 to FFCF but for tables (C4), extensions (C8) and conditioning (CC)
        if 0xC0 <= data[at + 1] <= 0xCF and data[at + 1] not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            size = max(size, (width, height), key=math.prod)
        # a marker may be preceded by any number of FF (B.1.1.2)
        at += 1 if data[at + 1] == 0xFF else 2 + struct.unpack_from(">H", data, at + 2)[0]
    return size
