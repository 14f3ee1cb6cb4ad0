"""Ground truth of a rendered frame, and its files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lanes.camera.model import Camera, camera_to_dict
from lanes.files import write_atomically
from simulator.road.geometry import (
    MAX_TURN_RAD,
    LinePolynomial,
    RoadGeometry,
    VehiclePose,
    line_lateral,
    line_polynomial,
    surface_points,
)

# Image rows of the line columns in the truth files, as in TuSimple's benchmark; -2
# where there is no line.
H_SAMPLES = np.arange(420, 701, 10)
NOT_VISIBLE = -2.0
# Decimals of the fields of Truth and of its lines in the truth files, in the order of
# the columns.
SCALAR_DIGITS = {
    "offset_m": 6,
    "heading_rad": 8,
    "curvature_per_m": 10,
    "curvature_rate_per_m2": 12,
    "lane_width_m": 6,
    "pitch_rad": 8,
}
LINE_DIGITS = {"c0_m": 6, "c1": 8, "c2_per_m": 10, "c3_per_m2": 12}
METRE_DIGITS = 6
NO_LINE = LinePolynomial(np.nan, np.nan, np.nan, np.nan)
# Distances ahead of the lateral line positions in the truth files.
STILL_X_M = np.arange(5.0, 61.0, 5.0)
VIDEO_X_M = np.array([5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0])


@dataclass(frozen=True)
class Truth:
    """Ground truth of one frame in the car's road frame (x forward, y left, metres).

    On a road with a vertical profile, the plane of the frame touches the road below the
    car, and x is horizontal. Without a lane, everything except time and pitch is NaN.

    Attributes
    ----------
    offset_m : float
        Position of the car's origin relative to the lane centre, > 0 is left of it.
    heading_rad : float
        Direction of the lane relative to the car, > 0 if the lane leads left; atan of
        the lines' c1.
    curvature_per_m, curvature_rate_per_m2 : float
        Curvature of the lane's centre line at the car, > 0 bends left, and its change
        per metre.
    lane_width_m : float
        Distance between the centres of the two lines, perpendicular to the road.
    pitch_rad : float
        Pitch of the camera at this moment, > 0 looks down.
    left, right : LinePolynomial
        Taylor coefficients of the lines at x = 0; exact. `line_y` computes exact points
        from the other fields.
    """

    time_s: float
    offset_m: float
    heading_rad: float
    curvature_per_m: float
    curvature_rate_per_m2: float
    lane_width_m: float
    pitch_rad: float
    left: LinePolynomial
    right: LinePolynomial
    road: RoadGeometry
    pose: VehiclePose
    laterals_m: tuple[float, float]

    @property
    def has_lane(self) -> bool:
        """False on unmarked roads, dirt tracks and in car parks."""
        return not np.isnan(self.lane_width_m)

    def line_y(
        self,
        side: int,
        x_m: np.ndarray,
    ) -> np.ndarray:
        """Lateral position in metres of the left (0) or right (1) line at `x_m`.

        NaN where `line_lateral` has none.
        """
        if not self.has_lane:
            return np.full(np.shape(x_m), np.nan)
        return line_lateral(self.road, self.pose, self.laterals_m[side], x_m)


def lane_truth(
    road: RoadGeometry,
    pose: VehiclePose,
    lines_m: Sequence[float],
    *,
    time_s: float,
    pitch_rad: float,
) -> Truth:
    """Ground truth of the lane that contains the car.

    `lines_m` are the lateral positions of the line centres from left to right; empty:
    there is no lane. The ego lane contains the car's origin, so it switches when the
    middle of the car crosses a line.
    """
    heading_rad = np.nan
    left_m = right_m = np.nan
    left = right = NO_LINE
    if len(lines_m):
        heading_rad = -pose.heading_rad
        left_m, right_m = _ego_lines(lines_m, pose.lateral_m)
        left = line_polynomial(road, pose, left_m)
        right = line_polynomial(road, pose, right_m)

    centre_m = (left_m + right_m) / 2
    curvature = float(road.curvature(pose.s_m))
    stretch = 1 - curvature * centre_m
    return Truth(
        time_s=time_s,
        offset_m=pose.lateral_m - centre_m,
        heading_rad=heading_rad,
        curvature_per_m=curvature / stretch,
        curvature_rate_per_m2=float(road.curvature_rate(pose.s_m)) / stretch**3,
        lane_width_m=left_m - right_m,
        pitch_rad=pitch_rad,
        left=left,
        right=right,
        road=road,
        pose=pose,
        laterals_m=(left_m, right_m),
    )


def _ego_lines(
    lines_m: Sequence[float],
    lateral_m: float,
) -> tuple[float, float]:
    """Lines next to `lateral_m`.

    Those of the outermost lane for a position outside all lanes.
    """
    # The first line to the right, or the last one.
    to_the_right = np.append(np.asarray(lines_m) <= lateral_m, True)
    right = int(np.argmax(to_the_right))
    right = min(max(right, 1), len(lines_m) - 1)
    return lines_m[right - 1], lines_m[right]


def line_pixels(
    truth: Truth,
    side: int,
    camera: Camera,
) -> np.ndarray:
    """Columns (len(H_SAMPLES),) of the centre of a line in the raw image.

    `side` is 0 for the left line, 1 for the right one. The columns are -2 above the
    line's end and outside the image. The line ends where it has turned by 80 degrees,
    because it is nearly parallel to the rows from there on. `camera` has the pose of
    this moment.
    """
    # Points of the line: equal steps in 1/x are equal steps in image rows.
    ahead = 1 / np.linspace(1 / 2.0, 1 / 600.0, 6000)
    s = truth.pose.s_m + ahead
    turned = np.abs(truth.pose.turn_to(truth.road, s)) > MAX_TURN_RAD
    if turned.any():
        s = s[: int(np.argmax(turned))]
    points = surface_points(truth.road, truth.pose, s, truth.laterals_m[side])
    pixels = camera.road_to_pixels(points)
    pixels = pixels[~np.isnan(pixels).any(axis=1)]
    if not len(pixels):
        return np.full(len(H_SAMPLES), NOT_VISIBLE)

    # Only points above all nearer ones are kept: parts hidden by a crest are lower in
    # the image than the crest.
    u, v = pixels.T
    rising = np.maximum.accumulate(-v) <= -v
    v = v[rising]
    u = np.interp(-H_SAMPLES, -v, u[rising], left=np.nan, right=np.nan)
    outside = np.isnan(u) | (u < 0) | (u > camera.width - 1)
    outside |= camera.height <= H_SAMPLES
    return np.where(outside, NOT_VISIBLE, u)


def visible_pixels(
    columns: np.ndarray,
    hidden: np.ndarray,
) -> np.ndarray:
    """`columns` of `line_pixels`, with -2 also where an object is in front.

    The mask `hidden` (height, width) marks objects.
    """
    columns = columns.copy()
    for i, (row, u) in enumerate(zip(H_SAMPLES, columns, strict=True)):
        if u >= 0 and hidden[row, round(float(u))]:
            columns[i] = NOT_VISIBLE
    return columns


def truth_row(
    truth: Truth,
    *,
    frame: int,
) -> dict[str, float | None]:
    """Row of the truth CSV of a video, by column name.

    None (an empty field) where there is no value.
    """
    row = {"frame": frame, "time_s": round(truth.time_s, 6), **_scalars(truth)}
    for side, name in enumerate(("left", "right")):
        y_m = _rounded_list(truth.line_y(side, VIDEO_X_M))
        for x, y in zip(VIDEO_X_M, y_m, strict=True):
            row[f"{name}_y{round(x):02d}_m"] = y
    return row


def truth_entry(
    truth: Truth,
    *,
    raw_file: str,
    camera: Camera,
    hidden: np.ndarray,
) -> dict:
    """Entry of a still in truth.json; None (null in JSON) where there is no value."""
    lanes = []
    for side in (0, 1):
        columns = visible_pixels(line_pixels(truth, side, camera), hidden)
        lanes.append([round(u, 2) for u in columns.tolist()])
    return {
        "raw_file": raw_file,
        **_scalars(truth),
        "x_m": STILL_X_M.tolist(),
        "left_y_m": _rounded_list(truth.line_y(0, STILL_X_M)),
        "right_y_m": _rounded_list(truth.line_y(1, STILL_X_M)),
        "h_samples": H_SAMPLES.tolist(),
        "lanes": lanes,
    }


def write_truth_json(
    path: Path,
    camera: Camera,
    frames: list[dict],
) -> None:
    """Write truth.json: the camera and one entry for each still.

    Each entry has a line of its own, so that diffs are readable.
    """
    header = json.dumps(camera_to_dict(camera))
    lines = ",\n".join(json.dumps(entry) for entry in frames)
    text = f'{{"camera": {header},\n"frames": [\n{lines}\n]}}\n'
    write_atomically(path, text.encode())


def write_truth_csv(path: Path, rows: list[dict]) -> None:
    """Write the truth CSV of a video, a row for each frame."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomically(path, text.getvalue().encode())


def _scalars(truth: Truth) -> dict[str, float | None]:
    row = {}
    for name, digits in SCALAR_DIGITS.items():
        row[name] = _rounded(getattr(truth, name), digits)
    for side in ("left", "right"):
        line = getattr(truth, side)
        for name, digits in LINE_DIGITS.items():
            row[f"{side}_{name}"] = _rounded(getattr(line, name), digits)
    return row


def _rounded_list(metres: np.ndarray) -> list[float | None]:
    return [_rounded(value, METRE_DIGITS) for value in metres]


def _rounded(value: float, digits: int) -> float | None:
    return None if np.isnan(value) else round(float(value), digits)
