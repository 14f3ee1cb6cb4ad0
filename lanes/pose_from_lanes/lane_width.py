"""Camera height and roll from the apparent width of the lanes.

The lateral position k of a line is in camera heights (see `vanishing_point`). Two lines that bound a lane therefore
differ by lane width / camera height in k. Lanes of one road have about the same width. Where the lanes on one side look
wider than those on the other, the camera is rolled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lanes.pose_from_lanes.vanishing_point import RoadLines

# Prior of the camera height, log-normal: 1.1 to 1.6 m in passenger cars, up to 2.5 m in vans and lorries.
PRIOR_HEIGHT_M, PRIOR_HEIGHT_LOG_STD = 1.35, 0.25
# Grid of heights, as multiples of the prior height.
HEIGHT_RATIOS = np.geomspace(0.4, 2.5, 240)
# Prior of the roll: cameras are installed level by eye, within about a degree.
PRIOR_ROLL_STD_RAD = np.radians(1.0)
ROLL_GRID_RAD = np.radians(np.linspace(-4, 4, 81))
# The roll counts as not observed if its posterior standard deviation is above this share of the prior one.
MAX_STD_RATIO = 0.85
# Relative standard deviation of the lane widths of one road. It is common to all pictures of a drive, which therefore
# count as at most this number of independent ones.
LANE_WIDTH_SCATTER, MAX_INDEPENDENT_PICTURES = 0.04, 8
# Standard deviation of the car's distance from the middle of its lane.
OFFSET_STD_M = 0.4
# A line that is seen in this many picture rows has full weight.
FULL_WEIGHT_ROWS = 40
# Likelihood of a pair of lines that do not bound one lane, relative to the peak for those that do.
OUTLIER_LIKELIHOOD = 0.05


@dataclass(frozen=True)
class HeightAndRoll:
    """Camera height and roll with their standard deviations."""

    height_m: float
    height_std_m: float
    roll_rad: float
    roll_std_rad: float


def estimate_height_and_roll(
    lines: list[RoadLines], lane_width_m: float, prior_height_m: float, roll_rad: float
) -> HeightAndRoll:
    """Camera height and roll from the apparent width of the lanes.

    `lines` are those of each picture, corrected for the current estimate `roll_rad`. The approximate height
    `prior_height_m` distinguishes one lane from two lanes whose common line is worn off. The roll is 0 with the
    standard deviation of the prior if the pictures do not determine it.

    A remaining roll r moves a line from k to k + r (1 + k^2). A lane between k1 and k2 then looks 1 + r (k1 + k2) times
    as wide. A pair of lines may bound a lane or not, so the likelihood is a mixture with a constant. It is smaller for
    a pair around the car that the car is not in the middle of. It is evaluated on a grid of heights and rolls, because
    it can have several maxima.
    """
    width, centre, _, weight = _line_pairs(lines)
    heights_m = prior_height_m * HEIGHT_RATIOS
    level_width = width[:, None] * (1 - 2 * ROLL_GRID_RAD * centre[:, None])
    residual = (level_width[:, None, :] * (heights_m / lane_width_m)[:, None] - 1) / LANE_WIDTH_SCATTER
    likelihood = _ego_likelihood(width, centre, lane_width_m)[:, None, None] * np.exp(-0.5 * residual**2)
    log_posterior = np.einsum("p,phr->hr", weight, np.log(OUTLIER_LIKELIHOOD + likelihood))
    log_posterior *= min(1.0, MAX_INDEPENDENT_PICTURES / len(lines))
    height_stds = np.log(HEIGHT_RATIOS) / PRIOR_HEIGHT_LOG_STD
    log_posterior -= 0.5 * (height_stds[:, None] ** 2 + ((roll_rad + ROLL_GRID_RAD) / PRIOR_ROLL_STD_RAD) ** 2)
    posterior = np.exp(log_posterior - log_posterior.max())
    any_roll = posterior.sum(axis=1)
    roll, roll_std = mode_and_std(ROLL_GRID_RAD, posterior.sum(axis=0))
    if roll_std > MAX_STD_RATIO * PRIOR_ROLL_STD_RAD:
        # the height of a nearly level camera: another one may belong to lines that are a lane only with a large roll
        tilt_rad = np.abs(roll_rad + ROLL_GRID_RAD)
        nearly_level = tilt_rad <= max(PRIOR_ROLL_STD_RAD / 2, tilt_rad.min())
        height_m = float(heights_m[np.argmax(posterior[:, nearly_level].sum(axis=1))])
        return HeightAndRoll(height_m, _std_about(height_m, heights_m, any_roll), 0.0, PRIOR_ROLL_STD_RAD)
    return HeightAndRoll(*mode_and_std(heights_m, any_roll), roll_rad + roll, roll_std)


def _ego_likelihood(width: np.ndarray, centre: np.ndarray, lane_width_m: float) -> np.ndarray:
    """Likelihood (pairs,), at most 1, of the car's distance from the middle of pairs of lines on both sides of it.

    Two lanes whose common line is worn off look like one wide lane, but the car is far from its middle.
    """
    offset_m = centre / width * lane_width_m
    around = np.abs(offset_m) < lane_width_m / 2
    return np.where(around, np.exp(-0.5 * (offset_m / OFFSET_STD_M) ** 2), 1.0)


def share_with_lane(lines: list[RoadLines], lane_width: float) -> float:
    """Share of the pictures with two lines that are `lane_width` camera heights apart, 0..1."""
    width, _, picture, _ = _line_pairs(lines)
    is_lane = np.abs(width / lane_width - 1) < 3 * LANE_WIDTH_SCATTER
    return len(np.unique(picture[is_lane])) / len(lines)


def _line_pairs(lines: list[RoadLines]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All pairs of lines of one picture: distance and centre in k, index of the picture, weight 0..1."""
    pairs = []
    for number, picture in enumerate(lines):
        left, right = np.triu_indices(len(picture.lateral), 1)
        k, weight = picture.lateral, np.minimum(picture.rows / FULL_WEIGHT_ROWS, 1)
        pair_weight = np.sqrt(weight[left] * weight[right])
        pairs.append(np.stack([k[right] - k[left], (k[right] + k[left]) / 2, np.full(len(left), number), pair_weight]))
    return tuple(np.hstack(pairs))


def mode_and_std(values: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """Maximum of a density given on a grid, and the standard deviation about it."""
    mode = float(values[np.argmax(density)])
    return mode, _std_about(mode, values, density)


def _std_about(value: float, values: np.ndarray, density: np.ndarray) -> float:
    """Root mean square distance from `value` of a density given on a grid."""
    return float(np.sqrt(np.average((values - value) ** 2, weights=density)))
