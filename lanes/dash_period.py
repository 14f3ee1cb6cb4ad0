"""Period of broken lines on the road (one dash and one gap), and the field of view that follows from it.

The dash period is the only known length along the road. The lane width determines all lateral lengths and the camera
height, but distances ahead are proportional to the focal length. The ratio of the painted period to the measured one
therefore gives the focal length.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lanes.camera import Camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import extract_evidence
from lanes.detect.residuals import intersect_ground
from lanes.detect.road import WIDTH, lines_on_view
from lanes.detect.search import search_lane
from lanes.errors import CameraError, PoseError
from lanes.field_of_view import FieldOfView
from lanes.pose import POSE_PICTURES, estimate_pose
from lanes.sources import pick_pictures

# Fields of view to try: if the period is outside 4 to 30 m with the first, it is inside with the second.
TRIED_HFOV_DEG = (60.0, 100.0)
# Sampling of a line along the road: nearest and farthest distance, and step.
NEAR_M, FAR_M, STEP_M = 6.0, 50.0, 0.1
# Periods of the spectrum, geometric.
PERIODS_M = np.geomspace(4.0, 30.0, 400)
# A stripe belongs to a line if it is this close to it and this parallel.
MAX_DISTANCE_M, MAX_ANGLE_RAD = 0.12, 0.1
# Share of the samples of a broken line that are painted.
MIN_PAINTED_SHARE, MAX_PAINTED_SHARE = 0.08, 0.75
# Fewer lines can have a common period by chance.
MIN_LINES = 6
# Smallest peak of the spectrum (power at the period over the power of the whole signal, times the number of samples).
# Motorway drives have 33 to 62, a mountain road without broken lines 2.
MIN_CLARITY = 15.0
# The double of the period is chosen if it has this share of the power: short dashes have a strong second harmonic.
HARMONIC_RATIO = 0.4


@dataclass(frozen=True)
class DashPeriod:
    """Period of broken lines, the peak of its spectrum (0 to about 60), and the number of lines in all pictures."""

    period_m: float
    clarity: float
    lines: int


def field_of_view_from_dashes(
    files: Sequence[Path], dash_period_m: float, *, start_s: float = 0.0, end_s: float | None = None
) -> FieldOfView:
    """Horizontal field of view of the camera of stills and videos, from broken lines of known period.

    `start_s` and `end_s` are the part of each video to use, seconds since the first frame.

    Raises
    ------
    CameraError
        If there is no file, or no broken line with a clear period.
    """
    if not files:
        raise CameraError(
            "a live camera's broken lines are not measured, nor those of several cameras; give --hfov, or an earlier "
            "drive's --camera."
        )
    images = list(pick_pictures(list(files), POSE_PICTURES, start_s=start_s, end_s=end_s))
    size = images[0].shape[1], images[0].shape[0]
    for hfov_deg in TRIED_HFOV_DEG:
        camera = Camera.from_fov(size, hfov_deg)
        try:
            camera = estimate_pose(images, camera).camera
        except PoseError:
            continue
        measured = measure_dash_period(images, camera)
        if measured is not None:
            focal_px = camera.matrix[0, 0] * dash_period_m / measured.period_m
            hfov_deg = float(np.degrees(2 * np.arctan(size[0] / 2 / focal_px)))
            return FieldOfView(hfov_deg, f"from {measured.lines} broken lines of {dash_period_m:g} m, to about 10 %")
    raise CameraError(
        f"{files[0]}: shows no broken line with a clear period, so the field of view cannot be measured; "
        "give --hfov, or pictures of a motorway."
    )


def measure_dash_period(images: Iterable[np.ndarray], camera: Camera) -> DashPeriod | None:
    """Period of the broken lines in raw RGB pictures of a camera with a pose; None without a clear period."""
    view = BirdsEyeView(camera)
    signals = [signal for image in images for signal in _broken_lines(image, view)]
    if len(signals) < MIN_LINES:
        return None
    power = np.mean([_power_spectrum(signal) for signal in signals], axis=0)
    ratio = PERIODS_M[1] / PERIODS_M[0]
    peak = int(power.argmax())
    double = peak + round(np.log(2) / np.log(ratio))
    around = power[double - 2 : double + 3]
    if len(around) == 5 and around.max() > HARMONIC_RATIO * power[peak]:
        peak = double - 2 + int(around.argmax())
    if power[peak] < MIN_CLARITY or peak in (0, len(power) - 1):
        return None
    # Vertex of the parabola through the peak and its neighbours.
    before, at_peak, after = power[peak - 1 : peak + 2]
    shift = 0.5 * (before - after) / (before - 2 * at_peak + after)
    return DashPeriod(float(PERIODS_M[peak] * ratio**shift), float(power[peak]), len(signals))


def _broken_lines(image: np.ndarray, view: BirdsEyeView) -> list[np.ndarray]:
    """Samples along the broken lines of a picture, 1 where painted: those of the ego lane and one on each side."""
    evidence = extract_evidence(view.warp(image), view)
    lane = search_lane(evidence)
    if lane is None:
        return []
    stripes = evidence.stripes
    x_m = intersect_ground(view.x_m, lane.model, view.height_m).x_m
    # The outer lines of the adjacent lanes are those of a lane three times as wide.
    three_lanes = lane.model.copy()
    three_lanes[WIDTH] *= 3
    models = np.array([lane.model, three_lanes])
    signals = []
    for line in lines_on_view(models, view.x_m, view.height_m).reshape(-1, len(view.x_m)):
        angle = stripes.angle - np.arctan(np.gradient(line, view.x_m))[stripes.row]
        on_line = (np.abs(stripes.y_m - line[stripes.row]) < MAX_DISTANCE_M) & (np.abs(angle) < MAX_ANGLE_RAD)
        painted = np.zeros(len(view.x_m))
        painted[stripes.row[on_line]] = 1
        signal = np.interp(np.arange(NEAR_M, FAR_M, STEP_M), x_m[::-1], painted[::-1])
        if MIN_PAINTED_SHARE < signal.mean() < MAX_PAINTED_SHARE:
            signals.append(signal)
    return signals


def _power_spectrum(signal: np.ndarray) -> np.ndarray:
    """Normalized power at `PERIODS_M`: Fourier sums with a Hann window."""
    distances_m = NEAR_M + STEP_M * np.arange(len(signal))
    window = np.hanning(len(signal))
    centred = signal - signal.mean()
    waves = np.exp(2j * np.pi * distances_m[:, None] / PERIODS_M)
    return np.abs((centred * window) @ waves) ** 2 / (centred**2 * window).sum()
