"""Damaged, truncated and hostile files, made from good ones."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import yaml

# Unusual names of files that are valid.
ODD_NAMES = (
    "two words",
    "дорога 道路",
    "-rf",
    "a[1]*?",
    "concat:a|b",
    "%03d",
    "$(touch owned)`;&",
    "<img src=x>",
    "line\nfeed",
    os.fsdecode(b"caf\xe9"),
)

Spoil = Callable[[Path, bytes], None]


def cut(share: float) -> Spoil:
    """Truncate the file to this share of its bytes."""

    def spoil(path: Path, data: bytes) -> None:
        path.write_bytes(data[: int(share * len(data))])

    return spoil


def holds(content: bytes | str) -> Spoil:
    """Replace the content of the file."""
    new = content.encode() if isinstance(content, str) else content

    def spoil(path: Path, _: bytes) -> None:
        path.write_bytes(new)

    return spoil


def unreadable(path: Path, data: bytes) -> None:
    """Remove the right to read the file; for root, who may read it anyway, the test
    fakes the answer of `os.access`.
    """
    path.write_bytes(data)
    path.chmod(0)


# Faults of a file of any kind: a function that makes it, and a pattern of the error
# message.
ANY: dict[str, tuple[Spoil, str]] = {
    "missing": (lambda path, _: None, "there is no such"),
    "empty": (holds(b""), "is empty"),
    "folder": (lambda path, _: path.mkdir(), "folder|neither"),
    "pipe": (lambda path, _: os.mkfifo(path), "is a pipe"),
    "device": (lambda path, _: path.symlink_to("/dev/zero"), "is a device"),
    "circular link": (lambda path, _: path.symlink_to(path.name), "there is no such"),
    "no right to read": (unreadable, "permission denied"),
    "zeros": (holds(bytes(9999)), ""),
    "text": (holds("this is no such file\n" * 99), ""),
    "not UTF-8": (holds(b"\xff\xfe\xfd" * 999), ""),
    "cut at 10 %": (cut(0.1), ""),
    "cut at 50 %": (cut(0.5), ""),
    "cut at 90 %": (cut(0.9), ""),
}


def png_claiming(width: int, height: int) -> bytes:
    """A PNG of a hundred bytes that claims to be of any size."""
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n"
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(99))), (b"IEND", b"")]
    for kind, content in chunks:
        data += struct.pack(">I", len(content))
        data += kind + content
        data += struct.pack(">I", zlib.crc32(kind + content))
    return data


def jpeg_claiming(width: int, height: int) -> Spoil:
    """Write another size into the header of a JPEG."""

    def spoil(path: Path, data: bytes) -> None:
        patched = bytearray(data)
        size_at = data.index(b"\xff\xc0") + 5
        struct.pack_into(">HH", patched, size_at, height, width)
        path.write_bytes(patched)

    return spoil


def damage_the_middle(path: Path, data: bytes) -> None:
    path.write_bytes(data[:60] + bytes(99) + data[159:])


PNG = {
    "claims 65535x65535": (
        holds(png_claiming(65535, 65535)),
        "4294836225 pixels. exceeds limit",
    ),
    "claims 0x0": (holds(png_claiming(0, 0)), "cannot be decoded"),
    "claims 4 GB": (
        holds(png_claiming(2**31 - 1, 1)),
        "2147483647 pixels. exceeds limit",
    ),
    "the header of a JPEG": (holds(b"\xff\xd8\xff\xe0"), "cut off"),
    "a damaged middle": (damage_the_middle, "cannot be decoded"),
}
JPEG = {
    "claims 65500x65500": (
        jpeg_claiming(65500, 65500),
        "4290250000 pixels. exceeds limit",
    ),
    "claims 0x0": (jpeg_claiming(0, 0), "cannot be decoded"),
    "markers only": (holds(b"\xff\xd8\xff\xda\xff\xd9"), "cannot be decoded"),
}
VIDEO = {
    "ffconcat": (
        holds("ffconcat version 1.0\nfile drive.mp4\n"),
        "cannot be read as a video",
    ),
    "playlist": (
        holds("#EXTM3U\n#EXTINF:1,\ndrive.mp4\n#EXT-X-ENDLIST\n"),
        "cannot be read as a video",
    ),
    "a picture": (holds(png_claiming(640, 360)), "cannot be read as a video"),
}


def camera(**changes: object) -> Spoil:
    """Change entries of a camera file; None removes one."""

    def spoil(path: Path, data: bytes) -> None:
        content = yaml.safe_load(data) | changes
        for name, value in changes.items():
            if value is None:
                del content[name]
        path.write_text(yaml.safe_dump(content))

    return spoil


def matrix(focal_px: float) -> dict:
    """The camera_matrix entry for a focal length."""
    return {"data": [focal_px, 0, 320, 0, focal_px, 180, 0, 0, 1]}


BOMB = "a: &a [1, 1]\n"
for _before, _name in pairwise("abcdefghij"):
    BOMB += f"{_name}: &{_name} [*{_before}, *{_before}, *{_before}]\n"
UNFIT = "is not a usable camera file"
CAMERA = {
    "Python tag": (holds('!!python/object/apply:os.system ["touch owned"]'), UNFIT),
    "alias bomb": (holds(BOMB + "camera_matrix: {data: *j}"), "has an alias"),
    "nested deep": (holds("[" * 99_999), UNFIT),
    "2 MB": (holds("a: 1\n" * 400_000), "MB large"),
    "a list": (holds("- 1\n- 2\n"), UNFIT),
    "no matrix": (camera(camera_matrix=None), "camera_matrix' is missing"),
    "focal length 0": (camera(camera_matrix=matrix(0.0)), UNFIT),
    "focal length NaN": (camera(camera_matrix=matrix(float("nan"))), UNFIT),
    "focal length 1e300": (camera(camera_matrix=matrix(1e300)), UNFIT),
    "width 0": (camera(image_width=0), UNFIT),
    "width 4e9": (camera(image_width=4_000_000_000), UNFIT),
    "distortion inf": (
        camera(distortion_coefficients={"data": [float("inf")] * 5}),
        UNFIT,
    ),
    "pose at height 0": (camera(pose={"height_m": 0.0}), UNFIT),
    "pose at NaN": (camera(pose={"height_m": 1.3, "pitch_rad": float("nan")}), UNFIT),
    "pose of words": (camera(pose="on the roof"), UNFIT),
    "another shape": (
        camera(image_width=480),
        "another aspect ratio|pixels, but the camera",
    ),
}


def line(text: str) -> Spoil:
    """Replace the third line of a file of JSON lines."""

    def spoil(path: Path, data: bytes) -> None:
        lines = data.split(b"\n")
        lines[2:3] = [text.encode()]
        path.write_bytes(b"\n".join(lines))

    return spoil


def label(h_samples: str = "[1]", lanes: str = "[]", raw_file: str = "a") -> Spoil:
    """Replace the third line by a label with these parts, as JSON."""
    return line(
        f'{{"raw_file": "{raw_file}", "h_samples": {h_samples}, "lanes": {lanes}}}'
    )


THIRD = "line 3 is not a "
LABELS = {
    "nonsense in line 3": (line("nonsense"), THIRD),
    "a number in line 3": (line("7"), THIRD),
    "no picture in line 3": (line('{"h_samples": [1], "lanes": []}'), THIRD),
    "columns short in line 3": (label("[1, 2]", "[[1]]"), THIRD),
    "NaN in line 3": (label(lanes="[[NaN]]"), THIRD),
    "1e999 in line 3": (label("[1e999]"), THIRD),
    "nested deep in line 3": (line("[" * 99_999), THIRD),
    "9999 digits in line 3": (label(f"[{'9' * 9999}]"), THIRD),
}
OUTSIDE = {
    "absolute name": (label(raw_file="/etc/passwd"), "lies outside"),
    "name above": (label(raw_file="../x.png"), "lies outside"),
}


def replaces(old: str, new: str) -> Spoil:
    """Replace a text in the file."""

    def spoil(path: Path, data: bytes) -> None:
        assert old.encode() in data
        path.write_bytes(data.replace(old.encode(), new.encode()))

    return spoil


LABELME = {
    "renamed line": (
        replaces('"left"', '"lefft"'),
        "'lefft' .perhaps 'left'. is none of",
    ),
    "absolute image": (replaces('"a.png"', '"/etc/passwd"'), "lies outside"),
    "image above": (replaces('"a.png"', '"../a.png"'), "lies outside"),
    "no image": (
        replaces('"imagePath"', '"imagepath"'),
        "entry 'imagePath' is missing",
    ),
    "words for points": (replaces("200", '"x"'), "is not a file of labelme"),
    "NaN for points": (replaces("200", "NaN"), "far outside"),
    "a billion pixels": (replaces("640", "9" * 9), "an image of 999999999x360"),
}
TRUTH = {
    "no columns": (holds("frame\n0\n1\n2\n"), "lacks the column"),
    "words for numbers": (replaces("0.", "x."), "is not a truth file"),
    "rows of other lengths": (
        holds("frame,offset_m\n0,1\n1\n"),
        "is not a telemetry table",
    ),
    "a field of 1 MB": (
        holds("frame,offset_m\n0," + "9" * 1_000_000),
        "is not a telemetry table",
    ),
}
