"""The horizontal field of view of a camera that was never calibrated: from its pictures' EXIF, from broken lines of
known period, or assumed.

What depends on it was measured (docs/own_camera.md): offset, lane width and camera height do not, because they rest on
the width of lanes; distances ahead grow in proportion to the focal length, and curvatures fall with its square.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lanes.io.files import require_file

# What is assumed where nothing is known: phones filming have 55 to 70 degrees, dashcams 60 to 140.
USUAL_HFOV_DEG = 60.0
# A diagonal of 35 mm film, 36 x 24 mm, which the equivalent focal length refers to.
FILM_DIAGONAL_MM = float(np.hypot(36, 24))
# EXIF 2.32: the block of the camera's settings, and in it these entries.
EXIF_BLOCK, FOCAL_MM, FOCAL_35MM, FOCAL_PLANE_RESOLUTION, FOCAL_PLANE_UNIT, STORED_WIDTH = (
    0x8769,
    0x920A,
    0xA405,
    0xA20E,
    0xA210,
    0xA002,
)
UNIT_MM = {2: 25.4, 3: 10.0}


@dataclass(frozen=True)
class FieldOfView:
    """A horizontal field of view, where it comes from, and whether that is a mere assumption."""

    hfov_deg: float
    source: str
    assumed: bool = False

    def describe(self) -> str:
        """A sentence or two for people."""
        words = f"field of view {self.hfov_deg:.1f} deg, {self.source}"
        if not self.assumed:
            return words
        return (
            f"{words}. Offset and lane width do not depend on it, but distances and bends do: if it is 50 (70) deg in "
            "truth, bends come out 1.5 times too strong (too gentle). Give --hfov, --dash-period or --boards if known."
        )


def read_hfov(picture: str | Path) -> float | None:
    """Horizontal field of view of a still in degrees by its EXIF entries, or None where they do not tell it.

    The focal length in terms of 35 mm film is one for the diagonal (CIPA DCG-001); else the focal length in
    millimetres and the number of pixels in a millimetre of the sensor do.
    """
    # Imported here: only pictures without any other word on their lens are asked.
    from PIL import Image

    try:
        require_file(picture, "picture")
        with warnings.catch_warnings(action="ignore"), Image.open(picture) as image:
            entries, (width, height) = image.getexif().get_ifd(EXIF_BLOCK), image.size
    except Exception:  # EXIF is a mere hint, and whoever writes nonsense there makes Pillow raise anything
        return None
    focal_px = _focal_px({key: _number(value) for key, value in entries.items()}, width, height)
    if focal_px is None:
        return None
    hfov_deg = float(np.degrees(2 * np.arctan(width / 2 / focal_px)))
    return hfov_deg if 10 <= hfov_deg <= 150 else None


def _focal_px(entries: dict[int, float], width: int, height: int) -> float | None:
    if entries.get(FOCAL_35MM, 0) > 0:
        return entries[FOCAL_35MM] / FILM_DIAGONAL_MM * float(np.hypot(width, height))
    focal_mm, resolution = entries.get(FOCAL_MM, 0), entries.get(FOCAL_PLANE_RESOLUTION, 0)
    unit_mm = UNIT_MM.get(round(entries.get(FOCAL_PLANE_UNIT, 2)))
    if not (focal_mm > 0 and resolution > 0 and unit_mm):
        return None
    # The resolution is that of the picture as stored at first, which may have been resized since.
    resized = width / (entries.get(STORED_WIDTH, 0) or width)
    return focal_mm * resolution / unit_mm * resized


def _number(value: object) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return number if np.isfinite(number) else 0.0
