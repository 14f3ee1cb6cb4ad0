"""Formats of camera files: YAML as written here, and those of ROS, OpenCV's FileStorage and Kalibr, as one layout.

The layout is that of ROS `camera_info` files. The lens models have many names; the number of coefficients, in OpenCV's
order, tells ours apart.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import yaml

from lanes.files import parse_yaml
from lanes.lens import LENS_MODELS


class _Dumper(yaml.SafeDumper):
    """Lists on one line: cv2.FileStorage does not read those that begin in the column of their key."""


def _represent_list(dumper: Any, values: list) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(list, _represent_list)


def parse_camera_yaml(text: str) -> Any:
    """The content of YAML, also of OpenCV's, with a first line and a tag of its own. Raises yaml.YAMLError."""
    if text.lstrip().startswith("<?xml"):
        raise yaml.YAMLError("it is XML; write it as YAML, as cv2.FileStorage does for a name that ends in .yaml")
    text = re.sub(r"\A%YAML[:\s]\s*1\.\d\s*\n(---\s*\n)?", "", text)
    return parse_yaml(re.sub(r"!!opencv-matrix\b", "", text))


def dump_yaml(content: dict) -> str:
    """YAML that PyYAML, yaml-cpp (ROS) and cv2.FileStorage read."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def as_ros_layout(content: Any) -> Any:
    """The content of a camera file of Kalibr, of OpenCV or of ROS in the layout of ROS.

    Raises KeyError, TypeError or ValueError if an entry is missing or not valid, or a model is not known.
    """
    if not isinstance(content, dict):
        return content
    if cameras := [name for name in content if re.fullmatch(r"cam\d+", str(name))]:
        return _of_kalibr(content, cameras)
    # names of OpenCV's samples, old and new, with those of ROS
    names = {"Camera_Matrix": "camera_matrix", "cameraMatrix": "camera_matrix", "K": "camera_matrix"}
    names |= dict.fromkeys(("Distortion_Coefficients", "distCoeffs", "D"), "distortion_coefficients")
    names |= {"image_Width": "image_width", "image_Height": "image_height"}
    content = {names.get(name, name): value for name, value in content.items()}
    if content.get("fisheye_model"):  # of OpenCV's sample
        content["distortion_model"] = "equidistant"
    return content


def _of_kalibr(content: dict, cameras: list[str]) -> dict:
    """The only camera of Kalibr's camchain in the layout of ROS."""
    if len(cameras) > 1:
        raise ValueError(f"it holds {len(cameras)} cameras, {', '.join(cameras)}; save the one to use in a file alone")
    camera = content[cameras[0]]
    if camera["camera_model"] != "pinhole":
        raise ValueError(f"camera model {camera['camera_model']!r:.40} of Kalibr is not supported, only 'pinhole'")
    (fu, fv, pu, pv), (width, height) = camera["intrinsics"], camera["resolution"]
    return {
        "image_width": width,
        "image_height": height,
        "camera_matrix": {"data": [fu, 0, pu, 0, fv, pv, 0, 0, 1]},
        "distortion_model": camera["distortion_model"],
        "distortion_coefficients": {"data": camera["distortion_coeffs"]},
    }


def parse_distortion(model: object, coefficients: Any) -> np.ndarray:
    """The coefficients (4,), (5,) or (8,) of a lens from the name of its model, or without one from their number.

    Raises ValueError if the model is not known, or has other coefficients.
    """
    data = np.array(coefficients, float).ravel()
    data = data if data.size else np.zeros(4)  # so does ROS write a lens without distortion
    counts = {name: count for count, lens in LENS_MODELS.items() for name in (lens.name, *lens.other_names)}
    name = str(model or (LENS_MODELS[8].name if len(data) == 8 else "")).lower()
    if name not in counts:
        known = ", ".join(sorted(filter(None, counts)))
        raise ValueError(f"distortion model {name!r:.40} is not supported, only {known}")
    count = counts[name]
    if count == 5 and data[5:8].any():  # of the longer model, whose name some programs leave out
        count = 8
    if count == 8 and data[8:].any():
        raise ValueError("its thin prism or tilt coefficients (the ninth to fourteenth) are not supported unless zero")
    # the last coefficients may be left out, or be followed by those of a longer model, if they are zero
    if len(data) < 4 or np.any(data[count:]):
        raise ValueError(f"{LENS_MODELS[count].name} has {count} distortion coefficients, not {data.size}")
    return np.pad(data[:count], (0, max(0, count - len(data))))
