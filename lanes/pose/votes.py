"""The first pose of a camera: what edges and lanes in the images of a drive vote for together.

*Pitch and yaw.* Lane lines, kerbs, barriers, parked cars and rows of houses run along the road, and their images
converge in one point. Its row gives the pitch of the camera, its column the yaw. All edges of all images vote for it.
It is accurate to a degree, which is enough to look for the lane.

*Height.* From a lorry two lanes look like one lane seen from a car, with a dashed line along its middle, and such a
lane is found in every image. Each image is therefore searched at several heights. A lane votes, with its odds, for the
height at which it is as wide as lanes are, and with less odds if a line runs along its middle.

*Roll.* A roll makes lanes of equal width look narrower on one side. The far lines of the lanes next to it are then not
where they are looked for; at the right roll they are. One such line may belong to a shoulder or to a narrower lane: two
or more are needed for a roll that is unusual.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera.model import Camera, CameraPose
from lanes.detect.confidence import LIKELY_CONFIDENCE
from lanes.detect.markings import Markings
from lanes.detect.road import ADJACENT, CENTRE, SIDES
from lanes.detect.search import HEIGHT_RANGE_M, DetectorSettings, StillDetection, search_at_heights, sums_of_products

# Pitches, yaws and rolls that are tried. The prior of the pitch alone has a standard deviation of 4.8 degrees on them.
_PITCHES_RAD, _YAWS_RAD = np.radians(np.arange(-10, 10.01, 0.25)), np.radians(np.arange(-15, 15.01, 0.5))
_ROLLS_RAD = np.radians(np.arange(-6, 6.01, 0.25))
_LOG_HEIGHTS = np.log(np.geomspace(*HEIGHT_RANGE_M, 221))
# Prior of the roll: cameras are installed level by eye, within about a degree; a few are tilted more. It has the shape
# of Cauchy's distribution, with this width.
PRIOR_ROLL_STD_RAD = np.radians(1.0)
# Prior of the camera height, log-normal: 1.1 to 1.6 m in passenger cars.
PRIOR_HEIGHT_M, PRIOR_HEIGHT_LOG_STD = 1.35, 0.25
# Heights tried, as factors of the assumed one: a lane is found at heights from 0.7 to 1.3 times the true one.
_TRIED_HEIGHTS = 2.0 ** np.array([0.0, -1.0, -0.5, 0.5, 1.0])
# Other heights and rolls that the images allow are rivals if they differ by more than this: by a factor of 1.4.
_RIVAL_LOG_HEIGHT, _RIVAL_ROLL_RAD = 0.35, np.radians(1.0)
# Lines parallel to a lane, in lane widths from its middle: one along the middle itself, and the far lines of the lanes
# next to it and of those beyond.
_MIDDLE_LINE, _FAR_LINES = (0.0,), (-2.5, -1.5, 1.5, 2.5)
# Logarithm of the odds against a lane with a line along its middle (a seam, arrows), and for a roll at which a far line
# is seen in all images.
_LINE_LOG_ODDS = 3.0


class Direction(NamedTuple):
    """Pitch and yaw of a camera, radians, each with its standard deviation."""

    pitch_rad: float
    pitch_std_rad: float
    yaw_rad: float
    yaw_std_rad: float


# The prior: cameras are aimed ahead by hand. The yaw contains the heading of the car.
AHEAD = Direction(0.0, float(np.radians(6.0)), 0.0, float(np.radians(10.0)))


class Given(NamedTuple):
    """Given numbers and settings of a pose estimate; see `lanes.estimate_pose`."""

    lane_width_m: float
    height_m: float | None
    markings: Markings | None
    settings: DetectorSettings


@dataclass(frozen=True)
class Rivals:
    """What other heights and rolls that the images allow contribute to the standard deviations.

    `share` is the probability of other heights, `height_m` the most probable of these.
    """

    share: float
    log_height_std: float
    roll_std_rad: float
    height_m: float


class Shown(NamedTuple):
    """The camera pose that a lane in one image shows; NaN for numbers that it does not show.

    That is everything if the lane is unlikely or has one line.
    """

    confidence: float
    log_height: float
    pitch_rad: float
    yaw_rad: float
    roll_rad: float
    edge: float


def table(shown: Sequence[Shown]) -> np.ndarray:
    """What several lanes say, a structured array (N,) with the fields of `Shown`."""
    return np.array(shown, [(name, float) for name in Shown._fields])


def shown_by(still: StillDetection, lane_width_m: float) -> Shown:
    """The pose that the lane in an image shows.

    A camera that is rolled by r more than its pose says sees the lanes on its right wider, those on its left narrower:
    each by the share 2 r W / H, for lanes of width W and the camera height H.
    """
    lane, pose = still.lane, still.camera.require_pose()
    if lane is None or lane.confidence < LIKELY_CONFIDENCE or not (lane.left.seen and lane.right.seen):
        return Shown(0.0, *[np.nan] * 5)
    log_height, roll_rad = float(np.log(pose.height_m * lane_width_m / lane.width_m)), np.nan
    if any(lane.far_evidence):
        left_m, right_m = lane.model[ADJACENT]
        roll_rad = pose.roll_rad + float(right_m - left_m) * pose.height_m / (4 * lane.width_m**2)
    pitch_rad, yaw_rad = pose.pitch_rad + lane.pitch_rad, pose.yaw_rad - lane.heading_rad
    return Shown(lane.confidence, log_height, pitch_rad, yaw_rad, roll_rad, lane.left.edge or lane.right.edge)


def find_edge_direction(images: Iterable[np.ndarray], camera: Camera) -> Direction:
    """The direction that all edges of RGB images (height, width, 3), uint8, have in common; without edges `AHEAD`."""
    votes = sum((_vote_of_edges(image, camera) for image in images), np.zeros((len(_PITCHES_RAD), len(_YAWS_RAD))))
    pitch_penalty = 0.5 * (_PITCHES_RAD / AHEAD.pitch_std_rad)[:, None] ** 2
    log_prior = -pitch_penalty - 0.5 * (_YAWS_RAD / AHEAD.yaw_std_rad) ** 2
    # A vote adds 1/2 to the log posterior: then errors and standard deviations agree on real drives.
    log_posterior = votes / 2.0 + log_prior
    posterior = np.exp(log_posterior - log_posterior.max())
    of_pitch, of_yaw = posterior.sum(axis=1), posterior.sum(axis=0)
    return Direction(*_mode_and_std(_PITCHES_RAD, of_pitch), *_mode_and_std(_YAWS_RAD, of_yaw))


def _vote_of_edges(image: np.ndarray, camera: Camera) -> np.ndarray:
    """Votes of the edges that point at the vanishing point of each pitch and yaw: (pitches, yaws).

    An edge has a vote for each length of 0.05 in ray coordinates, up to four. Edges shorter than 20 px have no reliable
    direction; flatter or steeper ones belong to cross beams and poles.
    """
    found = cv2.createLineSegmentDetector().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))[0]
    ends = np.empty((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(float)
    across, down = np.abs(ends[:, 1] - ends[:, 0]).T
    slope_deg = np.degrees(np.arctan2(down, across))
    ends = ends[(np.hypot(across, down) > 20) & (slope_deg > 8) & (slope_deg < 75)]
    ends = camera.rays(ends.reshape(-1, 2))[:, :2].reshape(-1, 2, 2)
    middle, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    # roads are not quite straight, by 1 degree; ends are known to 1.5 px at a focal length of 1000 px
    std = np.hypot(np.radians(1.0), 0.0015 / length)
    x = (np.tan(_YAWS_RAD) / np.cos(_PITCHES_RAD)[:, None]).ravel()
    y, one = np.repeat(-np.tan(_PITCHES_RAD), len(_YAWS_RAD)), np.ones(len(x))
    # of each point from each edge: squared distance, and distance across the edge, in standard deviations of the angle
    of_edges = (middle**2).sum(axis=1), *(-2 * middle.T), np.ones(len(middle))
    square = sums_of_products((one, x, y, x * x + y * y), of_edges)
    to_x, to_y = along.T / (length * std)
    across = sums_of_products((x, y, one), (to_y, -to_x, to_x * middle[:, 1] - to_y * middle[:, 0]))
    # an edge that contains the point does not lead there
    points = np.exp(-0.5 * across**2 / np.maximum(square, 0.05**2)) * (square > length**2 / 4)
    return (points @ np.minimum(length / 0.05, 4.0).astype(np.float32)).reshape(len(_PITCHES_RAD), -1)


def _mode_and_std(values: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """Maximum of a density given on a grid, and the standard deviation about it."""
    mode = float(values[np.argmax(density)])
    return mode, float(np.sqrt(np.average((values - mode) ** 2, weights=density)))


def first_pose(images: Iterable[np.ndarray], camera: Camera, given: Given) -> tuple[CameraPose, Rivals]:
    """The pose that the lanes in the first images show together, from that of the camera, and its rivals."""
    pose, lane_width_m = camera.require_pose(), given.lane_width_m
    # the view holds the far lines of the adjacent lanes at a roll of 3 degrees
    wide = replace(given.settings, half_width_m=8.5)
    tried_m = pose.height_m * (np.ones(1) if given.height_m else _TRIED_HEIGHTS)
    found = [search_at_heights(image, camera, tried_m, wide, markings=given.markings) for image in images]
    shown = np.array([table([shown_by(still, lane_width_m) for still in stills]) for stills in found])
    heights = _vote_for_heights(np.array([[_odds(still) for still in stills] for stills in found]), shown["log_height"])
    log_height = float(_LOG_HEIGHTS[heights.argmax()])
    # of each image the most probable lane that shows this height
    near = bool(given.height_m) | (np.abs(shown["log_height"] - log_height) < _RIVAL_LOG_HEIGHT)
    confidence = np.where(near, shown["confidence"], 0.0)
    best = [(k, int(row.argmax())) for k, row in enumerate(confidence) if row.any()]
    rolls = _vote_for_rolls([found[image][height] for image, height in best])
    roll_rad = float(_ROLLS_RAD[rolls.argmax()])
    start = replace(pose, height_m=given.height_m or float(np.exp(log_height)))
    median = median_pose(np.array([shown[k] for k in best], shown.dtype), start, given.height_m)
    # a small roll is found by the fit of the adjacent lanes, with less noise
    turned = replace(median, roll_rad=roll_rad) if abs(roll_rad) > _RIVAL_ROLL_RAD else median
    others = heights * (np.abs(_LOG_HEIGHTS - log_height) > _RIVAL_LOG_HEIGHT)
    return turned, Rivals(
        share=float(others.sum()),
        log_height_std=_std_of_rivals(_LOG_HEIGHTS, heights, log_height, _RIVAL_LOG_HEIGHT),
        roll_std_rad=_std_of_rivals(_ROLLS_RAD, rolls, roll_rad, _RIVAL_ROLL_RAD),
        height_m=float(np.exp(_LOG_HEIGHTS[others.argmax()])),
    )


def _odds(still: StillDetection) -> float:
    """Odds of the lane in an image, 0 without one; a line along its middle makes them less."""
    if still.lane is None:
        return 0.0
    middle = float(_lines_seen(still, _MIDDLE_LINE, np.zeros(1))[0, 0])
    return float(np.exp(still.lane.log_odds - _LINE_LOG_ODDS * middle))


def _vote_for_heights(odds: np.ndarray, log_heights: np.ndarray) -> np.ndarray:
    """Density over `_LOG_HEIGHTS`, from the odds (images, N) of lanes and the log heights that they show.

    These are NaN where no lane is seen. Without lanes the density is the prior.
    """
    prior = np.exp(-0.5 * ((_LOG_HEIGHTS - np.log(PRIOR_HEIGHT_M)) / PRIOR_HEIGHT_LOG_STD) ** 2)
    # lanes differ by a tenth in width
    near = np.exp(-0.5 * ((log_heights[..., None] - _LOG_HEIGHTS) / 0.1) ** 2)
    votes = np.nan_to_num(odds[..., None] * near).max(axis=1)
    # Vans, lorries, carts and motorcycles are rarer by a factor of 20 at most. With odds of 3 a lane is of no use for
    # the height (an exit, a seam, parked cars): one image alone has little weight.
    return _normalised(np.log(np.maximum(prior, 0.05)) + np.log1p(votes / 3.0).sum(axis=0))


def _vote_for_rolls(stills: Sequence[StillDetection]) -> np.ndarray:
    """Density over `_ROLLS_RAD`; the lanes of the images were found with poses without a roll."""
    log_density = -np.log1p((_ROLLS_RAD / PRIOR_ROLL_STD_RAD) ** 2)
    if stills:
        seen = np.mean([_lines_seen(still, _FAR_LINES, _ROLLS_RAD) for still in stills], axis=0)
        log_density += _LINE_LOG_ODDS * seen.sum(axis=0)
    return _normalised(log_density)


def _lines_seen(still: StillDetection, lines: Sequence[float], rolls_rad: np.ndarray) -> np.ndarray:
    """How much is seen of each of the `lines` along the lane if the camera is rolled: (lines, rolls), 0 to 1."""
    assert still.search and still.lane
    fit, lane, height_m = still.search.fit, still.lane, still.camera.require_pose().height_m
    along = fit.residuals.weights(np.full(len(fit.stripes), np.inf))[0]
    weight = fit.stripes.weight * along * (~fit.stripes.edge & (fit.stripes.x_m < 45.0))
    # lines of a straight road converge in one point of the image, and a roll turns them around it
    turned = np.arctan(fit.residuals.coordinates.a[0] / height_m) + rolls_rad[:, None]
    of_lane = np.arctan((lane.model[CENTRE] + SIDES * lane.width_m / 2) / height_m)
    left, right = np.tan(of_lane[:, None] + rolls_rad)[..., None]
    position = (np.tan(np.clip(turned, -1.5, 1.5)) - (left + right) / 2) / (left - right)
    # their positions vary by 0.05 lane widths; with a weight of 4 a line is seen as likely as not
    shown = np.array([np.exp(-0.5 * ((position - line) / 0.05) ** 2) @ weight for line in lines])
    return shown / (shown + 4.0)


def _std_of_rivals(values: np.ndarray, density: np.ndarray, chosen: float, apart: float) -> float:
    """Standard deviation that rivals of a chosen value, farther away than `apart`, contribute to its uncertainty."""
    return float(np.sqrt(density @ (np.square(values - chosen) * (np.abs(values - chosen) > apart))))


def _normalised(log_density: np.ndarray) -> np.ndarray:
    density = np.exp(log_density - log_density.max())
    return density / density.sum()


def median_pose(shown: np.ndarray, pose: CameraPose, height_m: float | None) -> CameraPose:
    """The pose whose numbers are the medians of those `shown` (images,), weighted by confidence."""
    start = {"pitch_rad": pose.pitch_rad, "yaw_rad": pose.yaw_rad, "roll_rad": pose.roll_rad}
    angles = {name: weighted_median(shown[name], shown["confidence"], value) for name, value in start.items()}
    log_height = weighted_median(shown["log_height"], shown["confidence"], np.log(pose.height_m))
    return CameraPose(height_m or float(np.exp(log_height)), **angles)


def weighted_median(values: np.ndarray, weights: np.ndarray, start: float) -> float:
    """Median of the values (N,) that are not NaN, and of a start, which has half the weight of a certain lane."""
    known = np.isfinite(values)
    values, weights = np.append(values[known], start), np.append(weights[known], 0.5)
    return float(np.quantile(values, 0.5, weights=weights, method="inverted_cdf"))


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
