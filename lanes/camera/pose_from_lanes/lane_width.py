"""What the widths of the lanes in a picture tell about the camera: its height and its roll.

Lines come from `vanishing`, where k is a line's lateral position (right) in camera heights. Two lines a lane
apart differ by lane width / camera height in k. Lanes are about equally wide, so where those on one side look wider
than those on the other, the camera is rolled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.camera.pose_from_lanes.vanishing_point import RoadLines

# Cameras of passenger cars sit at 1.1 to 1.6 m, of vans and lorries up to 2.5 m.
USUAL_HEIGHT_M, USUAL_HEIGHT_LOG_STD = 1.35, 0.25
# Heights that are tried, as multiples of the usual one.
HEIGHTS = np.geomspace(0.4, 2.5, 240)
# A camera is fixed by eye: level within about a degree.
USUAL_ROLL_STD = np.radians(1.0)
ROLLS = np.radians(np.linspace(-4, 4, 81))
# A roll that the pictures leave nearly as uncertain as before counts as not seen.
LEAST_GAIN = 0.85
# Lanes of one road differ by this share of their width, so many pictures say no more than these few.
LANE_SCATTER, INDEPENDENT_PICTURES = 0.04, 8
# A line with this many picture rows of paint is surely one.
SURE_ROWS = 40


@dataclass(frozen=True)
class LaneView:
    """What the widths of the lanes tell: height and roll of the camera, each with its standard deviation."""

    height_m: float
    height_std_m: float
    roll_rad: float
    roll_std_rad: float


def view_lanes(lines: list[RoadLines], lane_width_m: float, usual_height_m: float, roll_rad: float) -> LaneView:
    """Height and roll from how wide the lanes look.

    Parameters
    ----------
    lines : list of RoadLines
        Of pictures that `roll_rad` was taken out of already.
    lane_width_m : float
        How wide lanes are in truth.
    usual_height_m : float
        About where the camera sits; tells a lane from two lanes with the line between them worn off.
    roll_rad : float
        The roll assumed so far.

    Returns
    -------
    LaneView
        Roll 0 with the standard deviation of the prior where the pictures do not tell it.

    Notes
    -----
    A roll of r that is left takes a line at k to k + r (1 + k^2), so that a lane between k1 and k2 looks wider by
    1 + r (k1 + k2). Every two lines of a picture may be a lane or not, hence a mixture with a flat part. Evaluated on a
    grid of heights and rolls, which shows a second solution where there is one.
    """
    width, middle, _, weight = _pairs(lines)
    heights_m = usual_height_m * HEIGHTS
    level = width[:, None] * (1 - 2 * ROLLS * middle[:, None])
    miss = (level[:, None, :] * (heights_m / lane_width_m)[:, None] - 1) / LANE_SCATTER
    evidence = np.einsum("p,phr->hr", weight, np.log(0.05 + np.exp(-0.5 * miss**2)))
    evidence *= min(1.0, INDEPENDENT_PICTURES / len(lines))
    usual_height = np.log(HEIGHTS) / USUAL_HEIGHT_LOG_STD
    evidence -= 0.5 * (usual_height[:, None] ** 2 + ((roll_rad + ROLLS) / USUAL_ROLL_STD) ** 2)
    posterior = np.exp(evidence - evidence.max())
    height = _peak(heights_m, posterior.sum(axis=1))
    roll, roll_std = _peak(ROLLS, posterior.sum(axis=0))
    if roll_std > LEAST_GAIN * USUAL_ROLL_STD:
        return LaneView(*height, 0.0, USUAL_ROLL_STD)
    return LaneView(*height, roll_rad + roll, roll_std)


def _pairs(lines: list[RoadLines]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of every two lines of a picture: distance and middle in k, the picture's number, a weight between 0 and 1."""
    found = []
    for number, picture in enumerate(lines):
        left, right = np.triu_indices(len(picture.k), 1)
        k, sure = picture.k, np.minimum(picture.rows / SURE_ROWS, 1)
        weight = np.sqrt(sure[left] * sure[right])
        found.append(np.stack([k[right] - k[left], (k[right] + k[left]) / 2, np.full(len(left), number), weight]))
    return tuple(np.hstack(found))


def _peak(values: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """The density's highest point, and the standard deviation of the whole about it."""
    peak = values[np.argmax(density)]
    return float(peak), float(np.sqrt(np.average((values - peak) ** 2, weights=density)))


def lane_share(lines: list[RoadLines], lane: float) -> float:
    """Share of the pictures in which two lines are `lane` camera heights apart."""
    width, _, picture, _ = _pairs(lines)
    fitting = np.abs(width / lane - 1) < 3 * LANE_SCATTER
    return len(np.unique(picture[fitting])) / len(lines)
