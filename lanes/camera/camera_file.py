"""Camera files: YAML in the layout of ROS camera_info plus `pose:` and `calibration:` blocks."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import yaml

from lanes.camera.camera import CalibrationReport, Camera
from lanes.camera.camera_pose import CameraError, CameraPose
from lanes.io.files import read_text, write_atomically
from lanes.io.images import MAX_PIXELS

# A file with a thousand boards has 50 kB.
MAX_CAMERA_FILE_BYTES = 1_000_000
# Smallest and largest focal length in picture widths: fields of view from 157 degrees to 1 degree.
FOCAL_LENGTH_RANGE = 0.1, 60.0
# Lenses of long focal length have coefficients of several hundred; beyond this limit the polynomial overflows.
MAX_DISTORTION = 1e6
# Higher than the camera of any lorry.
MAX_HEIGHT_M = 20.0


class _PlainLoader(yaml.SafeLoader):
    """YAML without aliases, because a few lines with aliases can expand to any number of entries."""

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError(f"line {self.peek_event().start_mark.line + 1} has an alias, which is not allowed")
        return super().compose_node(parent, index)


def save_camera(camera: Camera, path: str | Path) -> Path:
    """Write camera.yaml, which `load_camera` reads; returns the path.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    path = Path(path)
    write_atomically(path, yaml.safe_dump(camera_to_dict(camera), sort_keys=False, allow_unicode=True).encode())
    return path


def camera_to_dict(camera: Camera) -> dict:
    """The content of camera.yaml, and of the `camera` part of a truth file; `camera_from_dict` reads it back."""
    content: dict = {
        "image_width": int(camera.width),
        "image_height": int(camera.height),
        "camera_name": "dashcam",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [float(x) for x in np.ravel(camera.matrix)]},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": [float(x) for x in np.ravel(camera.distortion)]},
    }
    if camera.pose:
        content["pose"] = {name: float(value) for name, value in asdict(camera.pose).items() if value is not None}
    if camera.report:
        report = camera.report
        content["calibration"] = {
            "rms_px": round(float(report.rms_px), 4),
            "boards_used": len(report.board_rms_px),
            "board_rms_px": {name: round(float(error), 4) for name, error in report.board_rms_px.items()},
            "rejected": dict(report.rejected),
            "date": report.date,
        }
    return content


def load_camera(path: str | Path) -> Camera:
    """Read camera.yaml.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    CameraError
        If it is not a camera file, lacks an entry, or has values that no camera can have.
    """
    text = read_text(path, "camera", error=CameraError, max_bytes=MAX_CAMERA_FILE_BYTES)
    try:
        return camera_from_dict(yaml.load(text, _PlainLoader))
    except RecursionError as error:
        raise CameraError(f"{path}: is not a usable camera file (it is nested too deep); make it again.") from error
    except (yaml.YAMLError, AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        reason = f"entry {error} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise CameraError(f"{path}: is not a usable camera file ({reason}); make it again by calibrating.") from error


def camera_from_dict(content: dict) -> Camera:
    """The camera of a parsed camera.yaml or of the `camera` part of a truth file.

    Raises
    ------
    KeyError
        If an entry is missing.
    ValueError, TypeError, AttributeError, OverflowError
        If an entry is not valid.
    """
    if not isinstance(content, dict):
        raise ValueError("it has no entries")
    if content["distortion_model"] != "plumb_bob":
        raise ValueError(f"distortion model {content['distortion_model']!r:.40} is not supported, only plumb_bob")
    matrix = np.array(content["camera_matrix"]["data"], float).reshape(3, 3)
    distortion = np.array(content["distortion_coefficients"]["data"], float).reshape(5)
    size = int(content["image_width"]), int(content["image_height"])
    _require_valid_intrinsics(matrix, distortion, size)
    # The first version wrote this block as `mount`.
    block = "pose" if "pose" in content else "mount"
    pose = _parse_pose(content[block]) if block in content else None
    report = _parse_report(content["calibration"]) if "calibration" in content else None
    return Camera(*size, matrix, distortion, pose, report)


def _require_valid_intrinsics(matrix: np.ndarray, distortion: np.ndarray, size: tuple[int, int]) -> None:
    if not (np.isfinite(matrix).all() and np.isfinite(distortion).all()):
        raise ValueError("its intrinsics are not finite")
    if np.abs(distortion).max() > MAX_DISTORTION:
        raise ValueError(f"a distortion coefficient is not between -{MAX_DISTORTION:g} and {MAX_DISTORTION:g}")
    if not (min(size) > 0 and size[0] * size[1] <= MAX_PIXELS):
        raise ValueError(f"{size[0]} x {size[1]} is not a valid picture size")
    shortest, longest = (widths * size[0] for widths in FOCAL_LENGTH_RANGE)
    if not all(shortest <= focal_px <= longest for focal_px in (matrix[0, 0], matrix[1, 1])):
        raise ValueError(f"a focal length is not between {shortest:g} and {longest:g} pixels")
    centre_inside = 0 < matrix[0, 2] < size[0] and 0 < matrix[1, 2] < size[1]
    if not centre_inside or matrix[0, 1] or matrix[1, 0] or (matrix[2] != [0, 0, 1]).any():
        raise ValueError("its camera matrix is not valid")


def _parse_pose(content: dict) -> CameraPose:
    pose = CameraPose(**{name: float(value) for name, value in content.items()})
    if pose.height_m > MAX_HEIGHT_M or max(map(abs, (pose.pitch_rad, pose.yaw_rad, pose.roll_rad))) > np.pi / 2:
        raise ValueError(f"a camera {pose.describe()} does not see the road")
    return pose


def _parse_report(content: dict) -> CalibrationReport:
    errors = {str(name): float(error) for name, error in content["board_rms_px"].items()}
    rejected = {str(name): str(reason) for name, reason in content.get("rejected", {}).items()}
    return CalibrationReport(float(content["rms_px"]), errors, rejected, str(content["date"]))
