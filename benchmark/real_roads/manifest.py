"""Where each still of the benchmark comes from, and how it is recognised."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from lanes.files import read_json_lines

# Of stills, labels and method, as in CITATION.cff.
VERSION = "1.0"
HERE = Path(__file__).parent
MANIFEST = HERE / "manifest.jsonl"
OFFICIAL_LABELS = "official"
# Mean difference of `look`, grey levels, up to which an image is close to the labelled
# one. Other conversions of the same frames to RGB gave up to 3.8 (BT.601 and BT.709,
# swscale and OpenCV), mirrored stills 7.9 and more, other sets 15 and more. A
# neighbouring frame can be as close: commit and number of the frame exclude it.
MAX_LOOK_DIFFERENCE = 5.0
_LOOK_CELLS = (8, 8)

EXACT = "exact"
CLOSE = "close"
OTHER = "other"


@dataclass(frozen=True)
class Source:
    """Where a still comes from.

    Attributes
    ----------
    file : str
        Its name in the folder of the benchmark.
    repo, commit, path : str
        Repository ("owner/name" on GitHub), commit, and file in it.
    width, height : int
        Size of the still, pixels.
    labels : str
        Who labelled it: "by hand" (we), "official" (its data set), or which line by
        whom.
    pixels, look : str
        `pixels_hash` and `look_hash` of the labelled image.
    frame : int or None
        Number of the frame from 0, in the order of presentation, if `path` is a video.
    clip : str or None
        Name of that video in the folder of the benchmark.
    """

    file: str
    repo: str
    commit: str
    path: str
    width: int
    height: int
    labels: str
    pixels: str
    look: str
    frame: int | None = None
    clip: str | None = None

    def compare(self, image: np.ndarray) -> str:
        """Whether an RGB image is EXACT the labelled one, CLOSE to it, or an OTHER."""
        if pixels_hash(image) == self.pixels:
            return EXACT
        if image.shape != (self.height, self.width, 3):
            return OTHER
        look = np.frombuffer(bytes.fromhex(look_hash(image)), np.uint8)
        labelled = np.frombuffer(bytes.fromhex(self.look), np.uint8)
        difference = float(np.abs(look.astype(float) - labelled).mean())
        return CLOSE if difference <= MAX_LOOK_DIFFERENCE else OTHER


def read_manifest(path: Path = MANIFEST) -> list[Source]:
    """The sources of all stills; ValueError names a line that is none."""
    sources = []
    for number, entry in read_json_lines(path, "source of a still"):
        try:
            sources.append(Source(**entry))
        except TypeError as error:
            raise ValueError(
                f"{path}: line {number} is not the source of a still ({error}); "
                "restore the file."
            ) from error
    return sources


def pixels_hash(image: np.ndarray) -> str:
    """32 hexadecimal digits that change with any pixel of an RGB image, uint8."""
    digest = hashlib.sha256(str(image.shape).encode())
    digest.update(image.tobytes())
    return digest.hexdigest()[:32]


def look_hash(image: np.ndarray) -> str:
    """The mean grey levels of 8 x 8 cells, 128 hexadecimal digits, which other decoders
    hardly change.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    cells = cv2.resize(grey, _LOOK_CELLS, interpolation=cv2.INTER_AREA)
    return cells.tobytes().hex()
