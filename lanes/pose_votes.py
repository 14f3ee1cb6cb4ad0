"""Height and roll of a camera from the lanes in images of a drive: all images vote together.

From a lorry two lanes look like one lane seen from a car, with a dashed line along its middle, and such a lane is found
in every image. Each image is therefore searched at several heights. A lane votes, with its odds, for the height at
which it is as wide as lanes are, and with less odds if a line runs along its middle.

A roll makes lanes of equal width look narrower on one side. The far lines of the lanes next to it are then not where
they are looked for; at the right roll they are. One such line may belong to a shoulder or to a narrower lane: two or
more are needed for a roll that is unusual.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lanes.camera import Camera, CameraPose
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.markings import Markings
from lanes.detect.road import ADJACENT, CENTRE, SIDES
from lanes.detect.search import DetectorSettings, StillDetection
from lanes.stills import HEIGHT_RANGE_M, search_at_heights

# Prior of the camera height, log-normal: 1.1 to 1.6 m in passenger cars. Vans, lorries, carts and motorcycles are
# rarer, by this factor at most.
PRIOR_HEIGHT_M, PRIOR_HEIGHT_LOG_STD, RARE_HEIGHT = 1.35, 0.25, 0.05
# Heights tried, as factors of the assumed one: a lane is found at heights from 0.7 to 1.3 times the true one.
TRIED_HEIGHTS = 2.0 ** np.array([0.0, -1.0, -0.5, 0.5, 1.0])
LOG_HEIGHTS = np.log(np.geomspace(*HEIGHT_RANGE_M, 221))
# Standard deviation of the logarithm of the height that one lane shows: lanes differ by a tenth in width.
LANE_LOG_STD = 0.1
# Odds that a lane is of no use for the height (an exit, a seam, parked cars): one image alone has little weight.
USELESS_ODDS = 3.0
# Rolls that are tried. Cameras are installed level by eye, within about a degree, a few of them askew: the prior has
# the shape of Cauchy's distribution, with this width.
ROLLS_RAD, PRIOR_ROLL_STD_RAD = np.radians(np.arange(-6, 6.01, 0.25)), np.radians(1.0)
# Other heights and rolls that the images allow are rivals if they differ by more than this: by a factor of 1.4.
RIVAL_LOG_HEIGHT, RIVAL_ROLL_RAD = 0.35, np.radians(1.0)
# Weight of the pose that the images were searched with; that of a lane is its confidence.
START_WEIGHT = 0.5
# Lines parallel to a lane, in lane widths from its middle: one along the middle itself, and the far lines of the lanes
# next to it and of those beyond; standard deviation of their positions. They are looked for up to this distance ahead.
# With this weight of stripes a line is seen as likely as not.
MIDDLE_LINE, FAR_LINES, LINE_STD, LINES_AHEAD_M, HALF_SEEN = (0.0,), (-2.5, -1.5, 1.5, 2.5), 0.05, 45.0, 4.0
# Logarithm of the odds against a lane with a line along its middle (a seam, arrows), and for a roll at which a far line
# is seen in all images.
LINE_LOG_ODDS = 3.0
# Half width of the view of the first images: it holds the far lines of the adjacent lanes at a roll of 3 degrees.
FIRST_HALF_WIDTH_M = 8.5


def vote_heights(odds: np.ndarray, log_heights: np.ndarray) -> np.ndarray:
    """Density over `LOG_HEIGHTS`, from the odds (images, N) of lanes and the log heights that they show.

    These are NaN where no lane is seen. Without lanes the density is the prior.
    """
    prior = np.exp(-0.5 * ((LOG_HEIGHTS - np.log(PRIOR_HEIGHT_M)) / PRIOR_HEIGHT_LOG_STD) ** 2)
    near = np.exp(-0.5 * ((log_heights[..., None] - LOG_HEIGHTS) / LANE_LOG_STD) ** 2)
    votes = np.nan_to_num(odds[..., None] * near).max(axis=1)
    return _normalised(np.log(np.maximum(prior, RARE_HEIGHT)) + np.log1p(votes / USELESS_ODDS).sum(axis=0))


def _vote(still: StillDetection) -> float:
    """Odds of the lane in an image, 0 without one; a line along its middle makes them less."""
    if still.lane is None:
        return 0.0
    middle = float(_lines_seen(still, MIDDLE_LINE, np.zeros(1))[0, 0])
    return float(np.exp(still.lane.log_odds - LINE_LOG_ODDS * middle))


def vote_rolls(stills: Sequence[StillDetection]) -> np.ndarray:
    """Density over `ROLLS_RAD`; the lanes of the images were found with poses without a roll."""
    log_density = -np.log1p((ROLLS_RAD / PRIOR_ROLL_STD_RAD) ** 2)
    if stills:
        seen = np.mean([_lines_seen(still, FAR_LINES, ROLLS_RAD) for still in stills], axis=0)
        log_density += LINE_LOG_ODDS * seen.sum(axis=0)
    return _normalised(log_density)


def _lines_seen(still: StillDetection, lines: Sequence[float], rolls_rad: np.ndarray) -> np.ndarray:
    """How much is seen of each of the `lines` along the lane if the camera is rolled: (lines, rolls), 0 to 1."""
    assert still.search and still.lane
    fit, lane, height_m = still.search.fit, still.lane, still.camera.require_pose().height_m
    along = fit.residuals.weights(np.full(len(fit.stripes), np.inf))[0]
    weight = fit.stripes.weight * along * (~fit.stripes.edge & (fit.stripes.x_m < LINES_AHEAD_M))
    # lines of a straight road converge in one point of the image, and a roll turns them around it
    turned = np.arctan(fit.residuals.coordinates.a[0] / height_m) + rolls_rad[:, None]
    of_lane = np.arctan((lane.model[CENTRE] + SIDES * lane.width_m / 2) / height_m)
    left, right = np.tan(of_lane[:, None] + rolls_rad)[..., None]
    position = (np.tan(np.clip(turned, -1.5, 1.5)) - (left + right) / 2) / (left - right)
    shown = np.array([np.exp(-0.5 * ((position - line) / LINE_STD) ** 2) @ weight for line in lines])
    return shown / (shown + HALF_SEEN)


def rival_std(values: np.ndarray, density: np.ndarray, chosen: float, apart: float) -> float:
    """Standard deviation that rivals of a chosen value, farther away than `apart`, contribute to its uncertainty."""
    return float(np.sqrt(density @ (np.square(values - chosen) * (np.abs(values - chosen) > apart))))


def _normalised(log_density: np.ndarray) -> np.ndarray:
    density = np.exp(log_density - log_density.max())
    return density / density.sum()


class Shown(NamedTuple):
    """What a lane in one image says about the camera pose; NaN for what it does not say.

    That is everything if the lane is unlikely or has one line.
    """

    confidence: float = 0.0
    log_height: float = np.nan
    pitch_rad: float = np.nan
    yaw_rad: float = np.nan
    roll_rad: float = np.nan
    edge: float = np.nan


def table(shown: Sequence[Shown]) -> np.ndarray:
    """What several lanes say, a structured array (N,) with the fields of `Shown`."""
    return np.array(shown, [(name, float) for name in Shown._fields])


def shown_by(still: StillDetection, lane_width_m: float) -> Shown:
    """What the lane in an image says about the pose.

    A camera that is rolled by r more than its pose says sees the lanes on its right wider, those on its left narrower:
    each by the share 2 r W / H, for lanes of width W and the camera height H.
    """
    lane, pose = still.lane, still.camera.require_pose()
    if lane is None or lane.confidence < LIKELY_CONFIDENCE or not (lane.left.seen and lane.right.seen):
        return Shown()
    log_height, roll_rad = float(np.log(pose.height_m * lane_width_m / lane.width_m)), np.nan
    if any(lane.far_evidence):
        left_m, right_m = lane.model[ADJACENT]
        roll_rad = pose.roll_rad + float(right_m - left_m) * pose.height_m / (4 * lane.width_m**2)
    pitch_rad, yaw_rad = pose.pitch_rad + lane.pitch_rad, pose.yaw_rad - lane.heading_rad
    return Shown(lane.confidence, log_height, pitch_rad, yaw_rad, roll_rad, lane.left.edge or lane.right.edge)


class Rivals(NamedTuple):
    """What other heights and rolls that the images allow contribute to the standard deviations.

    `share` is the probability of other heights, `height_m` the most probable of these.
    """

    share: float
    log_height_std: float
    roll_std_rad: float
    height_m: float


def first_pose(
    images: Iterable[np.ndarray],
    camera: Camera,
    lane_width_m: float,
    height_m: float | None,
    markings: Markings | None,
    settings: DetectorSettings,
) -> tuple[CameraPose, Rivals]:
    """The pose that the lanes in the first images show together, from that of the camera, and its rivals."""
    pose, wide = camera.require_pose(), replace(settings, half_width_m=FIRST_HALF_WIDTH_M)
    tried_m = pose.height_m * (np.ones(1) if height_m else TRIED_HEIGHTS)
    found = [search_at_heights(image, camera, tried_m, wide, markings=markings) for image in images]
    shown = np.array([table([shown_by(still, lane_width_m) for still in stills]) for stills in found])
    heights = vote_heights(np.array([[_vote(still) for still in stills] for stills in found]), shown["log_height"])
    log_height = float(LOG_HEIGHTS[heights.argmax()])
    # of each image the most probable lane that shows this height
    near = bool(height_m) | (np.abs(shown["log_height"] - log_height) < RIVAL_LOG_HEIGHT)
    confidence = np.where(near, shown["confidence"], 0.0)
    best = [(k, int(row.argmax())) for k, row in enumerate(confidence) if row.any()]
    rolls = vote_rolls([found[image][height] for image, height in best])
    roll_rad = float(ROLLS_RAD[rolls.argmax()])
    start = replace(pose, height_m=height_m or float(np.exp(log_height)))
    median = median_pose(np.array([shown[k] for k in best], shown.dtype), start, height_m)
    # a small roll is found by the fit of the adjacent lanes, with less noise
    turned = replace(median, roll_rad=roll_rad) if abs(roll_rad) > RIVAL_ROLL_RAD else median
    return turned, _find_rivals(heights, log_height, rolls, roll_rad)


def _find_rivals(heights: np.ndarray, log_height: float, rolls: np.ndarray, roll_rad: float) -> Rivals:
    """The rivals of a height and a roll, from the densities over `LOG_HEIGHTS` and `ROLLS_RAD`."""
    others = heights * (np.abs(LOG_HEIGHTS - log_height) > RIVAL_LOG_HEIGHT)
    log_height_std = rival_std(LOG_HEIGHTS, heights, log_height, RIVAL_LOG_HEIGHT)
    roll_std_rad = rival_std(ROLLS_RAD, rolls, roll_rad, RIVAL_ROLL_RAD)
    return Rivals(float(others.sum()), log_height_std, roll_std_rad, float(np.exp(LOG_HEIGHTS[others.argmax()])))


def median_pose(shown: np.ndarray, pose: CameraPose, height_m: float | None) -> CameraPose:
    """The pose whose numbers are the medians of those `shown` (images,), weighted by confidence."""
    numbers = {
        name: weighted_median(shown[name], shown["confidence"], getattr(pose, name))
        for name in ("pitch_rad", "yaw_rad", "roll_rad")
    }
    log_height = weighted_median(shown["log_height"], shown["confidence"], np.log(pose.height_m))
    return CameraPose(height_m or float(np.exp(log_height)), **numbers)


def weighted_median(values: np.ndarray, weights: np.ndarray, start: float) -> float:
    """Median of the start and of the values (N,) that are not NaN."""
    known = np.isfinite(values)
    values, weights = np.append(values[known], start), np.append(weights[known], START_WEIGHT)
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def std_of_median(values: np.ndarray, motion_std: float) -> float:
    """Standard deviation of the median of values (N,); `motion_std` is the prior scatter of one image."""
    known = values[np.isfinite(values)]
    if not len(known):
        return motion_std
    # The scatter of few values is uncertain, so the prior counts like two more values.
    scatter = 1.4826 * np.median(np.abs(known - np.median(known)))
    variance = (len(known) * scatter**2 + 2 * motion_std**2) / (len(known) + 2)
    # The median of n normal values has the variance pi / 2n.
    return float(np.sqrt(np.pi / 2 * variance / len(known)))
