"""Camera files: YAML in the layout of ROS camera_info plus `pose:` and `calibration:` blocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from lanes.camera.camera import CalibrationReport, Camera
from lanes.camera.camera_pose import CameraError, CameraPose
from lanes.io.files import read_text, write_atomically
from lanes.io.images import MAX_PIXELS

# One with a thousand boards has 50 kB.
MAX_CAMERA_FILE_BYTES = 1_000_000
# Focal lengths in widths of the picture: fields of view from 1 degree to 157.
FOCAL_LENGTHS = 0.1, 60.0
# Lenses of long focal lengths have coefficients of hundreds; whatever is beyond this overflows in their polynomial.
MOST_DISTORTION = 1e6
# A camera higher above the road than any lorry's, or one that looks at the sky or the bonnet, sees no lane.
HIGHEST_M = 20.0


class _PlainLoader(yaml.SafeLoader):
    """Numbers, words, lists and entries; no aliases, with which a few lines stand for any number of entries."""

    def compose_node(self, parent: yaml.Node | None, index: object) -> yaml.Node:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError(f"line {self.peek_event().start_mark.line + 1} has an alias, which is not allowed")
        return super().compose_node(parent, index)


def save_camera(camera: Camera, path: str | Path) -> Path:
    """Write camera.yaml in the layout of ROS camera_info plus `pose:` and `calibration:` blocks; see `load_camera`."""
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
        content["pose"] = {name: float(getattr(camera.pose, name)) for name in CameraPose.__dataclass_fields__}
    if camera.report:
        r = camera.report
        content["calibration"] = {
            "rms_px": round(float(r.rms_px), 4),
            "boards_used": len(r.board_rms_px),
            "board_rms_px": {name: round(float(e), 4) for name, e in r.board_rms_px.items()},
            "rejected": dict(r.rejected),
            "date": r.date,
        }
    return content


def load_camera(path: str | Path) -> Camera:
    """Read camera.yaml.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    CameraError
        If it is no camera file, lacks an entry or holds numbers that are no camera's.
    """
    text = read_text(path, "camera", error=CameraError, max_bytes=MAX_CAMERA_FILE_BYTES)
    try:
        return camera_from_dict(yaml.load(text, _PlainLoader))
    except RecursionError as error:
        raise CameraError(f"{path}: is no usable camera file (it is nested too deep); make it again.") from error
    except (yaml.YAMLError, AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        reason = f"entry {error} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise CameraError(f"{path}: is no usable camera file ({reason}); make it again by calibrating.") from error


def camera_from_dict(content: dict) -> Camera:
    """The camera in a parsed camera.yaml or in the `camera` part of a truth file; KeyError or ValueError if unfit."""
    if not isinstance(content, dict):
        raise ValueError("it holds no entries")
    if content["distortion_model"] != "plumb_bob":
        raise ValueError(f"distortion model {content['distortion_model']!r:.40} is not supported, only plumb_bob")
    matrix = np.array(content["camera_matrix"]["data"], float).reshape(3, 3)
    distortion = np.array(content["distortion_coefficients"]["data"], float).reshape(5)
    size = int(content["image_width"]), int(content["image_height"])
    _require_lens(matrix, distortion, size)
    # Files written by the first version call this block `mount`.
    name = "pose" if "pose" in content else "mount"
    pose = _pose(content[name]) if name in content else None
    report = _report(content["calibration"]) if "calibration" in content else None
    return Camera(*size, matrix, distortion, pose, report)


def _require_lens(matrix: np.ndarray, distortion: np.ndarray, size: tuple[int, int]) -> None:
    if not (np.isfinite(matrix).all() and np.isfinite(distortion).all()):
        raise ValueError("its numbers are not finite")
    if np.abs(distortion).max() > MOST_DISTORTION:
        raise ValueError(f"a distortion coefficient is not between -{MOST_DISTORTION:g} and {MOST_DISTORTION:g}")
    if not (min(size) > 0 and size[0] * size[1] <= MAX_PIXELS):
        raise ValueError(f"{size[0]} x {size[1]} is no size of a picture")
    least, most = (share * size[0] for share in FOCAL_LENGTHS)
    if not all(least <= focal_px <= most for focal_px in (matrix[0, 0], matrix[1, 1])):
        raise ValueError(f"a focal length is not between {least:g} and {most:g} pixels")
    centred = 0 < matrix[0, 2] < size[0] and 0 < matrix[1, 2] < size[1]
    if not centred or matrix[0, 1] or matrix[1, 0] or (matrix[2] != [0, 0, 1]).any():
        raise ValueError("its matrix is no camera's")


def _pose(content: dict) -> CameraPose:
    pose = CameraPose(**{name: float(value) for name, value in content.items()})
    if pose.height_m > HIGHEST_M or max(map(abs, (pose.pitch_rad, pose.yaw_rad, pose.roll_rad))) > np.pi / 2:
        raise ValueError(f"a camera {pose.describe()} sees no road")
    return pose


def _report(content: dict) -> CalibrationReport:
    errors = {str(name): float(error) for name, error in content["board_rms_px"].items()}
    rejected = {str(name): str(reason) for name, reason in content.get("rejected", {}).items()}
    return CalibrationReport(float(content["rms_px"]), errors, rejected, str(content["date"]))
