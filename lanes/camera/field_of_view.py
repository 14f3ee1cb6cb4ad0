"""The lens without a camera file: calibrated in a robot log, or a field of view from
EXIF or assumed.

The effect of an error was measured (docs/own_camera.md). Offset, lane width and camera
height depend on the field of view by centimetres, because the lane width determines
them, by decimetres where a very narrow or wide lens looks down and aside. Distances
ahead are proportional to the focal length, and curvatures to its inverse square.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lanes.camera.model import (
    HFOV_RANGE_DEG,
    LENSES,
    WIDE_HFOV_DEG,
    Camera,
    camera_from_dict,
)
from lanes.errors import CameraError, LaneError
from lanes.files import require_file
from lanes.ros.log_files import is_robot_log, open_log
from lanes.ros.robot_log import index_log
from lanes.video.images import kind_of_file, orientation_of, upright_axes

# Assumed if there is no information: phones that film have 55 to 70 degrees, dashcams
# 60 to 140.
DEFAULT_HFOV_DEG = 60.0
# Standard deviation of offset and lane width by an assumed lens, metres: 68th
# percentile of the offset errors of lenses of 30 to 120 degrees (docs/own_camera.md).
ASSUMED_LENS_STD_M = 0.045
# What to try where no lane is found with the assumed view: a narrow and a wide lens.
OTHER_VIEWS = "--hfov 45, --hfov 90"
GIVEN = "as given"
PINHOLE, EQUIDISTANT = LENSES
# Names of topics with rectified images: image_rect_color, but not image_unrectified.
_RECTIFIED = r"(?<![a-z])(?<!non_)(?<!not_)rect(ified)?(?![a-z])"

# (width, height) in pixels.
Size = tuple[int, int]


@dataclass(frozen=True)
class FieldOfView:
    """A horizontal field of view, and its source as text.

    If it is `assumed`, which is a default and not a measurement, it is that of the
    longer side of the image. `lens` is as for `Camera.from_fov`; None for a narrow
    view, and for one that a calibration gives.
    """

    hfov_deg: float
    source: str
    assumed: bool = False
    lens: str | None = None

    @property
    def words(self) -> str:
        """Text such as "field of view 62.6 deg, as a.jpg says (EXIF)"."""
        source = "assumed" if self.assumed else self.source
        lens = f", {self.lens} lens" if self.lens else ""
        return f"field of view {self.hfov_deg:.1f} deg, {source}{lens}"

    @property
    def doubtful(self) -> bool:
        """Whether the numbers that depend on it may be very wrong: it is assumed, or
        wide and not calibrated.
        """
        is_wide = bool(self.lens) and self.hfov_deg > WIDE_HFOV_DEG
        return self.assumed or is_wide

    def across(self, size: Size) -> float:
        """Horizontal field of view in degrees of images of `size` (width, height)."""
        width, height = size
        if self.assumed and width < height:
            return _other_side(self.hfov_deg, height, width)
        return self.hfov_deg

    def camera(self, size: Size) -> Camera:
        """The uncalibrated camera of images of `size` (width, height)."""
        camera = Camera.from_fov(size, self.across(size), lens=self.lens)
        if self.assumed:
            camera = replace(camera, lens_std_m=ASSUMED_LENS_STD_M)
        return camera

    def doubt_about(self, size: Size) -> str:
        """Why portrait images of `size` (width, height) hardly have the given angle,
        and the remedy; or nothing.
        """
        width, height = size
        deg = self.hfov_deg
        longer_deg = _other_side(deg, width, height)
        is_portrait = width < height
        # main cameras of phones have up to 79 degrees: 23 mm (35 mm equivalent) at 16:9
        is_wide = longer_deg > 80
        if self.source != GIVEN or self.lens or not (is_portrait and is_wide):
            return ""
        narrow_deg = _other_side(deg, height, width)
        return (
            f"the images are in portrait, and --hfov {deg:g} across their narrow side "
            f"is {longer_deg:.0f} deg across the longer one, where phones have 55 to "
            f"70; if {deg:g} deg is the angle of the longer side, give --hfov "
            f"{narrow_deg:.0f}; if you do not know it, omit --hfov"
        )

    def warn(self) -> FieldOfView:
        """The same; if it is doubtful, a warning says so, which Python shows once in a
        process.
        """
        if self.doubtful:
            warnings.warn(self.describe("Give a camera."), stacklevel=1)
        return self

    def describe(self, remedy: str = "Give --hfov or --boards.") -> str:
        """One sentence with value and source; if it is doubtful also the effect of an
        error, and the remedy.
        """
        if not self.doubtful:
            return self.words
        if self.assumed:
            reason = f", {self.source}" if self.source else ""
            return (
                f"{self.words}{reason}: if it is 50 (70) deg, the curvature is 1.5 "
                "times too strong (too weak). Offset and width change by up to 5 cm if "
                "it is 40 to 90 deg, by up to 0.4 m beyond, where the lane may be "
                f"missed, too. {remedy}"
            )
        return self._describe_wide()

    def _describe_wide(self) -> str:
        """The effect of the wrong one of two lenses on a wide view, and the remedy."""
        half_rad = np.radians(self.hfov_deg) / 2
        # of the focal lengths in the middle of the image
        ratio = float(np.tan(half_rad) / half_rad)
        if self.lens == EQUIDISTANT:
            other = PINHOLE
            focal = f"{ratio:.1f} times shorter"
            curvature = f"{ratio**2:.1f} times stronger"
            remedy = (
                "if straight edges are straight up to the image border, give "
                "--lens pinhole"
            )
        else:
            other = EQUIDISTANT
            focal = f"{ratio:.1f} times longer"
            curvature = f"{ratio**2:.1f} times weaker"
            remedy = (
                "if straight edges are bent, as in images of action cameras, give "
                "--hfov and --lens equidistant"
            )
        return (
            f"{self.words}. The angle does not say how the lens maps such a wide view: "
            f"of the other kind ({other}) the focal length is {focal}, and the "
            f"curvature {curvature}; {remedy}. "
            "Offset and lane width depend on it by centimetres. Give --boards for all "
            "numbers."
        )


def _other_side(angle_deg: float, side_px: int, other_px: int) -> float:
    """Angle of view in degrees across the other side of an image from that across one
    side, by their lengths.
    """
    half = np.tan(np.radians(angle_deg) / 2)
    other_half = half * other_px / side_px
    return float(np.degrees(2 * np.arctan(other_half)))


def given_field_of_view(hfov_deg: float, lens: str | None = None) -> FieldOfView:
    """A field of view from the command; a wide one is that of an equidistant lens,
    unless the lens is given.
    """
    if not lens and hfov_deg > WIDE_HFOV_DEG:
        lens = EQUIDISTANT
    return FieldOfView(hfov_deg, GIVEN, lens=lens)


def read_log_camera(file: Path, topic: str | None = None) -> Camera | None:
    """The camera of the images on a topic of a robot log; None if the file is no log,
    or has no calibration of them.

    It is on the topic `camera_info` next to theirs; with "rect" as a word in its name
    theirs is rectified. Raises LaneError.
    """
    if not is_robot_log(file):
        return None
    log = index_log(file, topic)
    space, _, images = log.topic.removesuffix("/compressed").rpartition("/")
    rectified = bool(re.search(_RECTIFIED, images))
    entries = _read_camera_info(file, space, rectified=rectified)
    if not entries:  # not calibrated
        return None
    try:
        return _camera_of(entries, log.size, rectified=rectified)
    except (CameraError, TypeError, ValueError, OverflowError) as error:
        raise CameraError(
            f"{file}: its camera_info is not usable ({error}); give --camera or --hfov."
        ) from error


def _read_camera_info(file: Path, space: str, *, rectified: bool) -> dict[str, Any]:
    """Entries of the first calibration among the messages about the camera in a
    namespace of a robot log; none without one.

    Drivers send empty messages before they know the camera. Raises CameraError if no
    message can be read.
    """
    known: dict[str, Any] = {}
    with open_log(file) as reader:
        for name in ("camera_info", "calibration"):
            topic = reader.topics.get(f"{space}/{name}")
            if not topic or topic.kind not in ("CameraInfo", "CameraCalibration"):
                continue
            decoded = 0
            for _, message in reader.messages(topic.name):
                decoded += 1
                # some are upper case in ROS 1
                entries = {key.lower(): value for key, value in vars(message).items()}
                if _is_calibrated(entries, rectified=rectified):
                    known = known or entries
                    if entries["width"] and entries["height"]:
                        return entries
            if topic.count and not decoded:
                raise CameraError(
                    f"{file}: no message on {topic.name} can be read; give --camera or "
                    "--hfov."
                )
    return known


def _is_calibrated(entries: dict[str, Any], *, rectified: bool) -> bool:
    """Whether a `camera_info` has the matrix of its images."""
    return bool(np.any(entries["k"]) or (rectified and np.any(entries["p"])))


def _camera_of(entries: dict[str, Any], size: Size, *, rectified: bool) -> Camera:
    """The camera of images of `size` by the entries of a `camera_info`, whose matrices
    are those of the whole sensor.

    The images are a part of it, the region of interest, in which `binning` pixels are
    one (REP 104); or all of it.
    """
    camera = _camera_of_sensor(entries, rectified=rectified)
    roi = entries.get("roi")
    part_width = int(getattr(roi, "width", 0)) or camera.width
    part_height = int(getattr(roi, "height", 0)) or camera.height
    binning_x = max(1, int(entries.get("binning_x", 0)))
    binning_y = max(1, int(entries.get("binning_y", 0)))
    left = int(getattr(roi, "x_offset", 0))
    top = int(getattr(roi, "y_offset", 0))
    # some drivers state binning, but matrices and size of the binned image
    is_whole = (part_width, part_height) == camera.size and binning_x == binning_y == 1
    if size == camera.size or is_whole:
        return camera

    columns = part_width // binning_x
    rows = part_height // binning_y
    # from the corner of the first pixel, half a pixel before its centre
    to_corner = np.array([[1, 0, 0.5 - left], [0, 1, 0.5 - top], [0, 0, 1]])
    to_centre = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    shrink = np.diag([1 / binning_x, 1 / binning_y, 1.0])
    matrix = to_centre @ shrink @ to_corner @ camera.matrix
    cropped = replace(camera, width=columns, height=rows, matrix=matrix)
    if not cropped.has_aspect_of(size):
        width, height = size
        raise ValueError(
            f"it is that of {columns}x{rows} pixels, but the images have "
            f"{width}x{height}: they were cropped"
        )
    return cropped.scaled(size)


def _camera_of_sensor(entries: dict[str, Any], *, rectified: bool) -> Camera:
    """The camera of images of the whole sensor, by the entries of a `camera_info`."""
    width = int(entries["width"])
    height = int(entries["height"])
    if not (width and height):
        raise ValueError(f"it states a size of {width}x{height} pixels")
    content: dict[str, Any] = {"image_width": width, "image_height": height}
    if rectified and not np.any(entries["p"]):
        raise ValueError("its projection matrix is zero")

    if rectified:
        matrix = np.reshape(entries["p"], (3, 4))[:, :3]
        content["distortion_coefficients"] = {"data": []}
    else:
        matrix = np.reshape(entries["k"], (3, 3))
        content["distortion_model"] = entries.get("distortion_model")
        content["distortion_coefficients"] = {"data": entries["d"]}
    content["camera_matrix"] = {"data": matrix.ravel()}
    return camera_from_dict(content)


def find_camera(
    size: Size, files: Sequence[Path] = (), topic: str | None = None
) -> Camera:
    """The camera of images of `size` in files without a given camera; warns if its
    field of view is doubtful.
    """
    camera = read_log_camera(files[0], topic) if files else None
    if camera:
        return camera.scaled(size)
    return find_field_of_view(files, topic).warn().camera(size)


def find_field_of_view(files: Iterable[Path], topic: str | None = None) -> FieldOfView:
    """Horizontal field of view of the first file with EXIF entries or a calibration,
    otherwise `DEFAULT_HFOV_DEG`.

    Raises LaneError or OSError if all files are robot logs that cannot be used.
    """
    failures: list[OSError | LaneError] = []
    reason = ""
    files = list(files)
    for file in files:
        if kind_of_file(file) == "image":
            hfov_deg, why_not = _read_exif(file)
            if hfov_deg:
                # it refers to a lens without distortion
                lens = PINHOLE if hfov_deg > WIDE_HFOV_DEG else None
                return FieldOfView(hfov_deg, f"as {file.name} says (EXIF)", lens=lens)
            if why_not:
                reason = f"because {file.name} {why_not}"
        try:
            camera = read_log_camera(file, topic)
        except (OSError, LaneError) as error:  # raised again when the log is read
            failures.append(error)
            continue
        if camera:
            return FieldOfView(camera.hfov_deg, f"as {file.name} says (camera_info)")
    if failures and len(failures) == len(files):
        raise type(failures[0])("\n".join(map(str, failures)))
    return FieldOfView(DEFAULT_HFOV_DEG, reason, assumed=True)


def _read_exif(still: str | Path) -> tuple[float | None, str]:
    """Horizontal field of view of a still in degrees from its EXIF entries, or None,
    and why they do not determine it.

    They have the focal length of the same view on 35 mm film, which refers to the
    diagonal (CIPA DCG-001) of the image that the camera took. That of a part of it is
    less.
    """
    # imported here, because it is needed only for stills without other information
    # about the lens
    from PIL import ExifTags, Image

    tags = ExifTags.Base
    try:
        require_file(still, "image")
        with warnings.catch_warnings(action="ignore"), Image.open(still) as image:
            width, height = image.size
            entries = image.getexif().get_ifd(ExifTags.IFD.Exif)
            focal_mm = float(entries[tags.FocalLengthIn35mmFilm])
            if focal_mm <= 0:  # 0 stands for unknown
                return None, ""
            taken_width = int(entries.get(tags.ExifImageWidth) or width)
            taken_height = int(entries.get(tags.ExifImageHeight) or height)
            axes = upright_axes(orientation_of(image))
        upright_width, _ = np.abs(axes) @ (width, height)
        diagonal_px = float(np.hypot(taken_width, taken_height))
        film_diagonal_mm = float(np.hypot(36, 24))
        film_width_mm = upright_width / diagonal_px * film_diagonal_mm
        hfov_deg = float(np.degrees(2 * np.arctan(film_width_mm / 2 / focal_mm)))
    except Exception:
        # EXIF is optional information; invalid and missing entries raise many types of
        # error
        return None, ""

    if (taken_width, taken_height) == (height, width):  # turned by a program
        taken_width, taken_height = width, height
    # only a part with one side of the whole image was surely cut out and not resized
    has_whole_side = taken_width == width or taken_height == height
    is_part = taken_width >= width and taken_height >= height
    if not (has_whole_side and is_part):
        return None, (
            f"has {width}x{height} pixels, but its EXIF entries are those of "
            f"{taken_width}x{taken_height}: it was cropped or resized, which they do "
            "not say"
        )
    least_deg, most_deg = HFOV_RANGE_DEG
    is_plausible = least_deg <= hfov_deg <= most_deg
    return hfov_deg if is_plausible else None, ""
