"""The lens without a camera file: calibrated in a robot log, or a field of view from EXIF or assumed.

The effect of an error was measured (docs/own_camera.md). Offset, lane width and camera height do not depend on the
field of view, because the lane width determines them. Distances ahead are proportional to the focal length, and
curvatures to its inverse square.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lanes.camera.model import HFOV_RANGE_DEG, LENSES, WIDE_HFOV_DEG, Camera, camera_from_dict
from lanes.errors import CameraError, LaneError
from lanes.files import require_file
from lanes.ros.log_files import is_robot_log, open_log
from lanes.ros.robot_log import index_log
from lanes.video.images import kind_of_file, orientation_of, upright_axes

# Assumed if there is no information: phones that film have 55 to 70 degrees, dashcams 60 to 140.
DEFAULT_HFOV_DEG = 60.0
GIVEN = "as given"


@dataclass(frozen=True)
class FieldOfView:
    """A horizontal field of view, and its source as text.

    If it is `assumed`, which is a default and not a measurement, it is that of the longer side of the image. `lens` is
    as for `Camera.from_fov`; None for a narrow view, and for one that a calibration gives.
    """

    hfov_deg: float
    source: str
    assumed: bool = False
    lens: str | None = None

    @property
    def words(self) -> str:
        """Text such as "field of view 62.6 deg, as a.jpg says (EXIF)"."""
        lens = f", {self.lens} lens" if self.lens else ""
        return f"field of view {self.hfov_deg:.1f} deg, {'assumed' if self.assumed else self.source}{lens}"

    @property
    def doubtful(self) -> bool:
        """Whether the numbers that depend on it may be very wrong: it is assumed, or wide and not calibrated."""
        return self.assumed or bool(self.lens and self.hfov_deg > WIDE_HFOV_DEG)

    def across(self, size: tuple[int, int]) -> float:
        """Horizontal field of view in degrees of images of `size` (width, height)."""
        width, height = size
        return _other_side(self.hfov_deg, height, width) if self.assumed and width < height else self.hfov_deg

    def camera(self, size: tuple[int, int]) -> Camera:
        """The uncalibrated camera of images of `size` (width, height)."""
        return Camera.from_fov(size, self.across(size), lens=self.lens)

    def doubt_about(self, size: tuple[int, int]) -> str:
        """Why portrait images of `size` (width, height) hardly have the given angle, and the remedy; or nothing."""
        (width, height), deg = size, self.hfov_deg
        longer_deg = _other_side(deg, width, height)
        # main cameras of phones have up to 79 degrees: 23 mm (35 mm equivalent) at 16:9
        if self.source != GIVEN or self.lens or width >= height or longer_deg <= 80:
            return ""
        return (
            f"the images are in portrait, and --hfov {deg:g} across their narrow side is {longer_deg:.0f} deg across "
            f"the longer one, where phones have 55 to 70; if {deg:g} deg is the angle of the longer side, give --hfov "
            f"{_other_side(deg, height, width):.0f}; if you do not know it, omit --hfov"
        )

    def warn(self) -> FieldOfView:
        """The same; if it is doubtful, a warning says so, which Python shows once in a process."""
        if self.doubtful:
            warnings.warn(self.describe("Give a camera."), stacklevel=1)
        return self

    def describe(self, remedy: str = "Give --hfov or --boards.") -> str:
        """One sentence with value and source; if it is doubtful also the effect of an error, and the remedy."""
        if not self.doubtful:
            return self.words
        if self.assumed:
            return (
                f"{self.words}{self.source and f', {self.source}'}: offset and width do not depend on it, but if it is "
                f"50 (70) deg, the curvature is 1.5 times too strong (too weak). {remedy}"
            )
        half_rad = np.radians(self.hfov_deg) / 2
        ratio = float(np.tan(half_rad) / half_rad)  # of the focal lengths in the middle of the image
        other, longer, stronger = LENSES[1], "longer", "weaker"
        remedy = "if straight edges are bent, as in images of action cameras, give --hfov and --lens equidistant"
        if self.lens == LENSES[1]:
            other, longer, stronger = LENSES[0], "shorter", "stronger"
            remedy = "if straight edges are straight up to the image border, give --lens pinhole"
        return (
            f"{self.words}. The angle does not say how the lens maps such a wide view: of the other kind ({other}) the "
            f"focal length is {ratio:.1f} times {longer}, and the curvature {ratio**2:.1f} times {stronger}; {remedy}. "
            "Offset and lane width do not depend on it. Give --boards for all numbers."
        )


def _other_side(angle_deg: float, side_px: int, other_px: int) -> float:
    """Angle of view in degrees across the other side of an image from that across one side, by their lengths."""
    return float(np.degrees(2 * np.arctan(np.tan(np.radians(angle_deg) / 2) * other_px / side_px)))


def given_field_of_view(hfov_deg: float, lens: str | None = None) -> FieldOfView:
    """A field of view from the command; a wide one is that of an equidistant lens, unless the lens is given."""
    return FieldOfView(hfov_deg, GIVEN, lens=lens or (LENSES[1] if hfov_deg > WIDE_HFOV_DEG else None))


def read_log_camera(file: Path, topic: str | None = None) -> Camera | None:
    """The camera of the images on a topic of a robot log; None if the file is no log, or has no calibration of them.

    It is on the topic `camera_info` next to theirs; with "rect" in its name theirs is rectified. Raises LaneError.
    """
    if not is_robot_log(file):
        return None
    log = index_log(file, topic)
    space, _, images = log.topic.removesuffix("/compressed").rpartition("/")
    with open_log(file) as reader:
        known = (reader.topics.get(f"{space}/{name}") for name in ("camera_info", "calibration"))
        info = next((t for t in known if t and t.count and t.kind in ("CameraInfo", "CameraCalibration")), None)
        if not info:
            return None
        _, message = next(reader.messages(info.name))
    entries = {name.lower(): value for name, value in vars(message).items()}  # some are upper case in ROS 1
    if not np.any(entries["k"]):  # not calibrated
        return None
    try:
        return _camera_of(entries, log.size, rectified="rect" in images)
    except (CameraError, TypeError, ValueError, OverflowError) as error:
        raise CameraError(f"{file}: its camera_info is not usable ({error}); give --camera or --hfov.") from error


def _camera_of(entries: dict[str, Any], size: tuple[int, int], *, rectified: bool) -> Camera:
    """The camera of images of `size` by the entries of a `camera_info`, whose matrices are those of the whole sensor.

    The images are a part of it, the region of interest, in which `binning` pixels are one (REP 104); or all of it.
    """
    matrix, width, height = np.reshape(entries["k"], (3, 3)), int(entries["width"]), int(entries["height"])
    lens = {"distortion_model": entries.get("distortion_model"), "distortion_coefficients": {"data": entries["d"]}}
    if rectified:
        matrix = np.reshape(entries["p"], (3, 4))[:, :3]
        lens = {"distortion_coefficients": {"data": []}}
    content = {"image_width": width, "image_height": height, "camera_matrix": {"data": matrix.ravel()}, **lens}
    camera = camera_from_dict(content)
    roi, binning = entries.get("roi"), [max(1, int(entries.get(name, 0))) for name in ("binning_x", "binning_y")]
    left, top = (int(getattr(roi, name, 0)) for name in ("x_offset", "y_offset"))
    part = int(getattr(roi, "width", 0)) or width, int(getattr(roi, "height", 0)) or height
    recorded = part[0] // binning[0], part[1] // binning[1]
    # some drivers state binning, but matrices and size of the binned image
    if size == camera.size or (part == camera.size and binning == [1, 1]):
        return camera
    matrix = camera.matrix - [[0, 0, left], [0, 0, top], [0, 0, 0]]
    cropped = replace(camera, width=recorded[0] * binning[0], height=recorded[1] * binning[1], matrix=matrix)
    if not cropped.has_aspect_of(size):
        sizes = f"that of {recorded[0]}x{recorded[1]} pixels, but the images have {size[0]}x{size[1]}"
        raise ValueError(f"it is {sizes}: they were cropped")
    return cropped.scaled(size)


def find_camera(size: tuple[int, int], files: Sequence[Path] = (), topic: str | None = None) -> Camera:
    """The camera of images of `size` in files without a given camera; warns if its field of view is doubtful."""
    camera = read_log_camera(files[0], topic) if files else None
    return camera.scaled(size) if camera else find_field_of_view(files, topic).warn().camera(size)


def find_field_of_view(files: Iterable[Path], topic: str | None = None) -> FieldOfView:
    """Horizontal field of view of the first file with EXIF entries or a calibration, otherwise `DEFAULT_HFOV_DEG`.

    Raises LaneError or OSError if all files are robot logs that cannot be used.
    """
    failures: list[OSError | LaneError] = []
    reason = ""
    files = list(files)
    for file in files:
        if kind_of_file(file) == "image":
            hfov_deg, why_not = _read_exif(file)
            if hfov_deg:  # it refers to a lens without distortion
                lens = LENSES[0] if hfov_deg > WIDE_HFOV_DEG else None
                return FieldOfView(hfov_deg, f"as {file.name} says (EXIF)", lens=lens)
            reason = f"because {file.name} {why_not}" if why_not else reason
        try:
            if camera := read_log_camera(file, topic):
                return FieldOfView(camera.hfov_deg, f"as {file.name} says (camera_info)")
        except (OSError, LaneError) as error:  # raised again when the log is read
            failures.append(error)
    if failures and len(failures) == len(files):
        raise type(failures[0])("\n".join(map(str, failures)))
    return FieldOfView(DEFAULT_HFOV_DEG, reason, assumed=True)


def _read_exif(still: str | Path) -> tuple[float | None, str]:
    """Horizontal field of view of a still in degrees from its EXIF entries, or None, and why they do not determine it.

    They have the focal length of the same view on 35 mm film, which refers to the diagonal (CIPA DCG-001) of the image
    that the camera took. That of a part of it is less.
    """
    # imported here, because it is needed only for stills without other information about the lens
    from PIL import ExifTags, Image

    try:
        require_file(still, "image")
        with warnings.catch_warnings(action="ignore"), Image.open(still) as image:
            entries, size = image.getexif().get_ifd(ExifTags.IFD.Exif), image.size
            focal_mm = float(entries[ExifTags.Base.FocalLengthIn35mmFilm])
            names = ExifTags.Base.ExifImageWidth, ExifTags.Base.ExifImageHeight
            taken = int(entries.get(names[0]) or size[0]), int(entries.get(names[1]) or size[1])
            if taken == size[::-1]:  # turned by a program
                taken = size
            width = (np.abs(upright_axes(orientation_of(image))) @ size)[0]
        diagonal_px = float(np.hypot(*taken))
        film_diagonal_mm = float(np.hypot(36, 24))
        hfov_deg = float(np.degrees(2 * np.arctan(width / diagonal_px * film_diagonal_mm / 2 / focal_mm)))
    except Exception:  # EXIF is optional information; invalid and missing entries raise many types of error
        return None, ""
    # only a part with one side of the whole image was surely cut out and not resized
    cut_out = (taken[0] == size[0] and taken[1] > size[1]) or (taken[1] == size[1] and taken[0] > size[0])
    if taken != size and not cut_out:
        of = f"{size[0]}x{size[1]} pixels, but its EXIF entries are those of {taken[0]}x{taken[1]}"
        return None, f"has {of}: it was cropped or resized, which they do not say"
    low_deg, high_deg = HFOV_RANGE_DEG
    return hfov_deg if low_deg <= hfov_deg <= high_deg else None, ""
