"""How long a dash and its gap are, as seen on the road: the one length along the road that is known beforehand.

A lane's width gives all lengths across the road, and the height of the camera, but along the road a wrong focal length
stretches everything by its own factor. So the period at which the broken lines repeat, compared with the one that they
are painted with, tells the focal length.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lanes.camera.camera import Camera
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.detector import search_lane
from lanes.tracking.markings import extract_evidence
from lanes.tracking.model import WIDTH, lines_on_view
from lanes.tracking.residuals import intersect_ground

# Between these distances paint is looked for, every so many metres, and for these periods (metres, geometric).
NEAR_M, VOTING_FAR_M, STEP_M = 6.0, 50.0, 0.1
PERIODS_M = np.geomspace(4.0, 30.0, 400)
# Paint so near to a line that runs along it is its own.
ON_LINE_M, ALONG_LINE_RAD = 0.12, 0.1
# A broken line has paint on at least and at most these shares of its rows.
LEAST_SHARE, MOST_SHARE = 0.08, 0.75
# Fewer lines than this may repeat by chance; and so clear a period (power of the wave over that of all the paint, as
# many samples as it has) is one: drives on motorways have 33 to 62, a mountain road without broken lines 2.
FEWEST_LINES, CLEAR = 6, 15.0
# A period is the overtone of its double if that has this share of its power.
OVERTONE = 0.4


@dataclass(frozen=True)
class DashPeriod:
    """The period of broken lines in metres, how clear it is (0 to about 60), and the number of lines it rests on."""

    period_m: float
    clarity: float
    lines: int


def measure_dash_period(images: Iterable[np.ndarray], camera: Camera) -> DashPeriod | None:
    """Measure how often broken lines repeat, along the road as this camera sees it.

    Parameters
    ----------
    images : iterable of ndarray of shape (height, width, 3), uint8
        RGB, raw.
    camera : Camera
        With its pose.

    Returns
    -------
    DashPeriod or None
        None if no period is clear.
    """
    view = BirdsEyeView(camera)
    waves = [wave for image in images for wave in _waves(image, view)]
    if len(waves) < FEWEST_LINES:
        return None
    power = np.mean([_power(wave) for wave in waves], axis=0)
    best = int(power.argmax())
    # Dashes much shorter than their gaps also repeat, more weakly, at half their period.
    twice = best + round(np.log(2) / np.log(PERIODS_M[1] / PERIODS_M[0]))
    if twice < len(power) - 2 and power[twice - 2 : twice + 3].max() > OVERTONE * power[best]:
        best = twice - 2 + int(power[twice - 2 : twice + 3].argmax())
    if power[best] < CLEAR or best in (0, len(power) - 1):
        return None
    left, middle, right = power[best - 1 : best + 2]
    shift = 0.5 * (left - right) / (left - 2 * middle + right)
    ratio = PERIODS_M[1] / PERIODS_M[0]
    return DashPeriod(float(PERIODS_M[best] * ratio**shift), float(power[best]), len(waves))


def _waves(image: np.ndarray, view: BirdsEyeView) -> list[np.ndarray]:
    """Paint (1) or none (0) along the broken lines of a picture: the own lane's, and one more on each side."""
    evidence = extract_evidence(image, view)
    lane = search_lane(evidence, view)
    if lane is None:
        return []
    stripes = evidence.stripes
    x_m = intersect_ground(view.x_m, lane.model, view.height_m).x_m
    # The lines beyond are those of a lane three times as wide.
    wider = lane.model.copy()
    wider[WIDTH] *= 3
    lines = lines_on_view(np.array([lane.model, wider]), view.x_m, view.height_m).reshape(-1, len(view.x_m))
    waves = []
    for line in lines:
        astray = stripes.angle - np.arctan(np.gradient(line, view.x_m))[stripes.row]
        on_line = (np.abs(stripes.y_m - line[stripes.row]) < ON_LINE_M) & (np.abs(astray) < ALONG_LINE_RAD)
        painted = np.zeros(len(view.x_m))
        painted[stripes.row[on_line]] = 1
        wave = np.interp(np.arange(NEAR_M, VOTING_FAR_M, STEP_M), x_m[::-1], painted[::-1])
        if LEAST_SHARE < wave.mean() < MOST_SHARE:
            waves.append(wave)
    return waves


def _power(wave: np.ndarray) -> np.ndarray:
    """How much of a line's paint repeats with each of `PERIODS_M`: a windowed Fourier sum at those periods."""
    places = NEAR_M + STEP_M * np.arange(len(wave))
    window = np.hanning(len(wave))
    swing = wave - wave.mean()
    turned = np.exp(2j * np.pi * places[:, None] / PERIODS_M)
    return np.abs((swing * window) @ turned) ** 2 / (swing**2 * window).sum()
