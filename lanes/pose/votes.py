"""The first pose of a camera: what edges and lanes in the images vote for together.

*Pitch and yaw.* Lane lines, kerbs, barriers, parked cars and rows of houses run along
the road, and their images converge in one point. Its row gives the pitch of the camera,
its column the yaw. All edges of all images vote for it. It is accurate to a degree,
which is enough to look for the lane.

*Height.* From a lorry two lanes look like one lane seen from a car, with a dashed line
along its middle, and such a lane is found in every image. Each image is therefore
searched at several heights. A lane votes, with its odds, for the height at which it is
as wide as lanes are, and with less odds if a line runs along its middle.

*Roll.* A roll makes lanes of equal width look narrower on one side. The far lines of
the lanes next to it are then not where they are looked for; at the right roll they are.
One such line may belong to a shoulder or to a narrower lane: two or more are needed for
a roll that is unusual.
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
from lanes.detect.search import (
    HEIGHT_RANGE_M,
    DetectorSettings,
    StillDetection,
    search_at_heights,
    sums_of_products,
)

# Rolls and heights that are tried.
_ROLLS_RAD = np.radians(np.arange(-6, 6.01, 0.25))
_LOG_HEIGHTS = np.log(np.geomspace(*HEIGHT_RANGE_M, 221))
# Prior of the roll: cameras are installed level by eye, within about a degree; a few
# are tilted more. It has the shape of Cauchy's distribution, with this width.
PRIOR_ROLL_STD_RAD = np.radians(1.0)
# Prior of the camera height, log-normal: 1.1 to 1.6 m in passenger cars.
PRIOR_HEIGHT_M = 1.35
PRIOR_HEIGHT_LOG_STD = 0.25
# Vans, lorries, carts and motorcycles are rarer by a factor of 20 at most.
_LEAST_PRIOR = 0.05
# With these odds a lane is of no use for the height (an exit, a seam, parked cars): one
# image alone has little weight.
_USELESS_ODDS = 3.0
# Widths of lanes differ by a tenth.
_WIDTH_LOG_STD = 0.1
# Heights tried, as factors of the assumed one: a lane is found at heights from 0.7 to
# 1.3 times the true one.
_TRIED_HEIGHTS = 2.0 ** np.array([0.0, -1.0, -0.5, 0.5, 1.0])
# The view for these heights holds the far lines of the adjacent lanes at a roll of 3
# degrees.
_HALF_WIDTH_M = 8.5
# Heights and rolls are other ones if they differ by more than this: by a factor of 1.4.
_OTHER_LOG_HEIGHT = 0.35
_OTHER_ROLL_RAD = np.radians(1.0)
# Lines parallel to a lane, in lane widths from its middle: one along the middle itself,
# and the far lines of the lanes next to it and of those beyond.
_MIDDLE_LINE = (0.0,)
_FAR_LINES = (-2.5, -1.5, 1.5, 2.5)
# Their positions vary by this share of the lane width; with this weight of stripes a
# line is seen as likely as not; farther stripes do not count.
_LINE_POSITION_STD = 0.05
_SEEN_WEIGHT = 4.0
_SEEN_FAR_M = 45.0
# Logarithm of the odds against a lane with a line along its middle (a seam, arrows),
# and for a roll at which a far line is seen in all images.
_LINE_LOG_ODDS = 3.0
# Edges shorter than 20 px have no reliable direction; flatter or steeper ones belong to
# cross beams and poles.
_MIN_EDGE_PX = 20
_EDGE_SLOPES_DEG = (8, 75)
# Roads are not quite straight, by this angle; ends are known to 1.5 px at a focal
# length of 1000 px.
_EDGE_STD_RAD = np.radians(1.0)
_END_STD = 0.0015
# An edge has a vote for each such length in ray coordinates, up to a number of them.
_VOTE_LENGTH = 0.05
_MAX_EDGE_VOTES = 4.0
# A vote adds 1/2 to the log posterior: then errors and standard deviations agree on
# real drives.
_LOG_VOTE = 1 / 2


class Direction(NamedTuple):
    """Pitch and yaw of a camera, radians, each with its standard deviation."""

    pitch_rad: float
    pitch_std_rad: float
    yaw_rad: float
    yaw_std_rad: float

    def is_far_from(self, prior: Direction) -> bool:
        """Whether it is more than a standard deviation of a prior around 0 away."""
        pitch = self.pitch_rad / prior.pitch_std_rad
        yaw = self.yaw_rad / prior.yaw_std_rad
        return pitch**2 + yaw**2 > 1


# The prior: cameras are aimed ahead by hand. The yaw contains the heading of the car.
AHEAD = Direction(0.0, float(np.radians(6.0)), 0.0, float(np.radians(10.0)))


@dataclass(frozen=True, eq=False)
class Grid:
    """Pitches and yaws that are tried, radians."""

    pitches_rad: np.ndarray
    yaws_rad: np.ndarray

    def contains(self, direction: Direction) -> bool:
        """Whether a direction lies within the grid, not on its border."""
        is_pitch = abs(direction.pitch_rad) < self.pitches_rad[-1]
        return bool(is_pitch and abs(direction.yaw_rad) < self.yaws_rad[-1])


# The prior of the pitch alone has a standard deviation of 4.8 degrees on the usual one.
USUAL_GRID = Grid(
    pitches_rad=np.radians(np.arange(-10, 10.01, 0.25)),
    yaws_rad=np.radians(np.arange(-15, 15.01, 0.5)),
)
# Of cameras that look far up, down or aside: as coarse as needed to find a lane.
WIDE_GRID = Grid(
    pitches_rad=np.radians(np.arange(-25, 25.01, 0.5)),
    yaws_rad=np.radians(np.arange(-30, 30.01, 1.0)),
)


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Given numbers and settings of a pose estimate; see `lanes.estimate_pose`."""

    lane_width_m: float
    is_width_given: bool
    height_m: float | None
    markings: Markings | None
    settings: DetectorSettings
    roll_rad: float = 0.0
    prior: Direction = AHEAD

    def start_pose(self, direction: Direction) -> CameraPose:
        """The pose with a direction; by default at the usual height, and level."""
        return CameraPose(
            height_m=self.height_m or PRIOR_HEIGHT_M,
            pitch_rad=direction.pitch_rad,
            yaw_rad=direction.yaw_rad,
            roll_rad=self.roll_rad,
        )


@dataclass(frozen=True)
class OtherPoses:
    """What other heights and rolls that the images allow add to standard deviations.

    `share` is the probability of other heights, `height_m` the most probable of these.
    """

    share: float
    log_height_std: float
    roll_std_rad: float
    height_m: float


class ShownPose(NamedTuple):
    """The camera pose that a lane in one image shows; NaN for what it does not show.

    That is everything if the lane is unlikely or has one line.
    """

    confidence: float
    log_height: float = np.nan
    pitch_rad: float = np.nan
    yaw_rad: float = np.nan
    roll_rad: float = np.nan
    edge: float = np.nan


def as_table(shown: Sequence[ShownPose]) -> np.ndarray:
    """Poses as a structured array (N,) with the fields of `ShownPose`."""
    return np.array(shown, [(name, float) for name in ShownPose._fields])


def pose_shown_by(still: StillDetection, lane_width_m: float) -> ShownPose:
    """The pose that the lane in an image shows.

    A camera that is rolled by r more than its pose says sees the lanes on its right
    wider, those on its left narrower: each by the share 2 r W / H, for lanes of width W
    and the camera height H.
    """
    lane = still.lane
    if lane is None or lane.confidence < LIKELY_CONFIDENCE:
        return ShownPose(0.0)
    if not (lane.left.seen and lane.right.seen):
        return ShownPose(0.0)

    pose = still.camera.require_pose()
    roll_rad = np.nan
    if any(lane.far_evidence):
        left_m, right_m = lane.model[ADJACENT]
        widening_m = float(right_m - left_m)
        turn_rad = widening_m * pose.height_m / (4 * lane.width_m**2)
        roll_rad = pose.roll_rad + turn_rad
    return ShownPose(
        confidence=lane.confidence,
        log_height=float(np.log(pose.height_m * lane_width_m / lane.width_m)),
        pitch_rad=pose.pitch_rad + lane.pitch_rad,
        yaw_rad=pose.yaw_rad - lane.heading_rad,
        roll_rad=roll_rad,
        edge=lane.left.edge or lane.right.edge,
    )


def find_edge_direction(
    edges: Sequence[np.ndarray], prior: Direction = AHEAD, grid: Grid = USUAL_GRID
) -> Direction:
    """The direction that the edges of all images share; without edges the prior.

    `edges` are those that `find_edges` finds in each image.
    """
    votes = np.zeros((len(grid.pitches_rad), len(grid.yaws_rad)))
    for ends in edges:
        votes = votes + _vote_of_edges(ends, grid)
    from_pitch = (grid.pitches_rad - prior.pitch_rad) / prior.pitch_std_rad
    from_yaw = (grid.yaws_rad - prior.yaw_rad) / prior.yaw_std_rad
    log_prior = -0.5 * from_pitch[:, None] ** 2 - 0.5 * from_yaw**2
    log_posterior = votes * _LOG_VOTE + log_prior
    posterior = np.exp(log_posterior - log_posterior.max())

    pitch = _mode_and_std(grid.pitches_rad, posterior.sum(axis=1))
    yaw = _mode_and_std(grid.yaws_rad, posterior.sum(axis=0))
    return Direction(*pitch, *yaw)


def _vote_of_edges(ends: np.ndarray, grid: Grid) -> np.ndarray:
    """Votes (pitches, yaws) of edges (N, 2, 2) that point at the vanishing points."""
    middle = ends.mean(axis=1)
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    std = np.hypot(_EDGE_STD_RAD, _END_STD / length)

    # the vanishing points, in ray coordinates
    x = (np.tan(grid.yaws_rad) / np.cos(grid.pitches_rad)[:, None]).ravel()
    y = np.repeat(-np.tan(grid.pitches_rad), len(grid.yaws_rad))
    one = np.ones(len(x))

    # of each point from each edge: squared distance, and distance across the edge, in
    # standard deviations of the angle
    mx, my = middle.T
    of_edges = ((middle**2).sum(axis=1), -2 * mx, -2 * my, np.ones(len(middle)))
    square = sums_of_products((one, x, y, x * x + y * y), of_edges)
    to_x, to_y = along.T / (length * std)
    turned = (to_y, -to_x, to_x * my - to_y * mx)
    across = sums_of_products((x, y, one), turned)

    # an edge that contains the point does not lead there
    angle = across**2 / np.maximum(square, 0.05**2)
    points = np.exp(-0.5 * angle) * (square > length**2 / 4)
    votes = np.minimum(length / _VOTE_LENGTH, _MAX_EDGE_VOTES)
    voted = points @ votes.astype(np.float32)
    return voted.reshape(len(grid.pitches_rad), -1)


def find_edges(image: np.ndarray, camera: Camera) -> np.ndarray:
    """Both ends (N, 2, 2) of the edges along the road, in ray coordinates.

    The image is RGB (height, width, 3), uint8.
    """
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found = cv2.createLineSegmentDetector().detect(gray)[0]
    if found is None:
        return np.empty((0, 2, 2))
    ends = found.reshape(-1, 2, 2).astype(float)
    across, down = np.abs(ends[:, 1] - ends[:, 0]).T
    slope_deg = np.degrees(np.arctan2(down, across))
    least_deg, most_deg = _EDGE_SLOPES_DEG
    is_long = np.hypot(across, down) > _MIN_EDGE_PX
    chosen = ends[is_long & (slope_deg > least_deg) & (slope_deg < most_deg)]
    rays = camera.rays(chosen.reshape(-1, 2))
    return rays[:, :2].reshape(-1, 2, 2)


def _mode_and_std(values: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """Maximum of a density given on a grid, and the standard deviation about it."""
    mode = float(values[np.argmax(density)])
    variance = np.average((values - mode) ** 2, weights=density)
    return mode, float(np.sqrt(variance))


def first_pose(
    images: Iterable[np.ndarray], camera: Camera, options: PoseOptions
) -> tuple[CameraPose, OtherPoses]:
    """The pose that the lanes in the first images show together, and other ones.

    It begins with the pose of the camera.
    """
    # the lane in each image at each height
    pose = camera.require_pose()
    wide = replace(options.settings, half_width_m=_HALF_WIDTH_M)
    factors = np.ones(1) if options.height_m else _TRIED_HEIGHTS
    tried_m = pose.height_m * factors
    found: list[list[StillDetection]] = []
    tables = []
    odds = []
    for image in images:
        stills = search_at_heights(
            image, camera, tried_m, wide, markings=options.markings
        )
        found.append(stills)
        shown_poses = [pose_shown_by(still, options.lane_width_m) for still in stills]
        tables.append(as_table(shown_poses))
        odds.append([_odds(still) for still in stills])
    shown = np.array(tables)

    # the height, by votes, and of each image the most probable lane that shows it
    heights = _vote_for_heights(np.array(odds), shown["log_height"])
    log_height = float(_LOG_HEIGHTS[heights.argmax()])
    is_near = np.abs(shown["log_height"] - log_height) < _OTHER_LOG_HEIGHT
    if options.height_m:
        is_near[:] = True
    confidence = np.where(is_near, shown["confidence"], 0.0)
    best = [(k, int(row.argmax())) for k, row in enumerate(confidence) if row.any()]

    # the roll, by votes; a small one is found by the fit of the adjacent lanes, with
    # less noise
    rolls = _vote_for_rolls([found[image][height] for image, height in best])
    roll_rad = float(_ROLLS_RAD[rolls.argmax()])
    start = replace(pose, height_m=options.height_m or float(np.exp(log_height)))
    lanes = np.array([shown[k] for k in best], shown.dtype)
    first = median_pose(lanes, start, options.height_m)
    if abs(roll_rad) > _OTHER_ROLL_RAD:
        first = replace(first, roll_rad=roll_rad)

    is_other = np.abs(_LOG_HEIGHTS - log_height) > _OTHER_LOG_HEIGHT
    other_heights = heights * is_other
    return first, OtherPoses(
        share=float(other_heights.sum()),
        log_height_std=_std_of_others(
            _LOG_HEIGHTS, heights, log_height, _OTHER_LOG_HEIGHT
        ),
        roll_std_rad=_std_of_others(_ROLLS_RAD, rolls, roll_rad, _OTHER_ROLL_RAD),
        height_m=float(np.exp(_LOG_HEIGHTS[other_heights.argmax()])),
    )


def _odds(still: StillDetection) -> float:
    """Odds of the lane in an image, 0 without one.

    A line along its middle makes them less.
    """
    if still.lane is None:
        return 0.0
    middle = float(_lines_seen(still, _MIDDLE_LINE, np.zeros(1))[0, 0])
    return float(np.exp(still.lane.log_odds - _LINE_LOG_ODDS * middle))


def _vote_for_heights(odds: np.ndarray, log_heights: np.ndarray) -> np.ndarray:
    """Density over `_LOG_HEIGHTS`, from the odds (images, N) of lanes.

    `log_heights` (images, N) are those that the lanes show, NaN where no lane is seen.
    Without lanes the density is the prior.
    """
    from_prior = (_LOG_HEIGHTS - np.log(PRIOR_HEIGHT_M)) / PRIOR_HEIGHT_LOG_STD
    prior = np.exp(-0.5 * from_prior**2)
    from_lane = (log_heights[..., None] - _LOG_HEIGHTS) / _WIDTH_LOG_STD
    near = np.exp(-0.5 * from_lane**2)
    votes = np.nan_to_num(odds[..., None] * near).max(axis=1)
    log_votes = np.log1p(votes / _USELESS_ODDS).sum(axis=0)
    return _normalised(np.log(np.maximum(prior, _LEAST_PRIOR)) + log_votes)


def _vote_for_rolls(stills: Sequence[StillDetection]) -> np.ndarray:
    """Density over `_ROLLS_RAD`; the lanes were found with poses without a roll."""
    log_density = -np.log1p((_ROLLS_RAD / PRIOR_ROLL_STD_RAD) ** 2)
    if stills:
        seen = [_lines_seen(still, _FAR_LINES, _ROLLS_RAD) for still in stills]
        log_density += _LINE_LOG_ODDS * np.mean(seen, axis=0).sum(axis=0)
    return _normalised(log_density)


def _lines_seen(
    still: StillDetection, lines: Sequence[float], rolls_rad: np.ndarray
) -> np.ndarray:
    """How much is seen of each of the `lines` along the lane if the camera is rolled.

    The result is (lines, rolls), 0 to 1.
    """
    assert still.search and still.lane
    fit = still.search.fit
    lane = still.lane
    height_m = still.camera.require_pose().height_m

    # stripes along the lane, at any distance from its lines
    any_distance = np.full(len(fit.stripes), np.inf)
    along = fit.residuals.weights(any_distance)[0]
    is_paint = ~fit.stripes.edge & (fit.stripes.x_m < _SEEN_FAR_M)
    weight = fit.stripes.weight * along * is_paint

    # lines of a straight road converge in one point of the image, and a roll turns them
    # around it
    of_stripes = np.arctan(fit.residuals.coordinates.a[0] / height_m)
    turned = of_stripes + rolls_rad[:, None]
    sides_m = lane.model[CENTRE] + SIDES * lane.width_m / 2
    of_lane = np.arctan(sides_m / height_m)
    left, right = np.tan(of_lane[:, None] + rolls_rad)[..., None]

    # positions in lane widths from the middle of the lane
    lateral = np.tan(np.clip(turned, -1.5, 1.5))
    position = (lateral - (left + right) / 2) / (left - right)
    shown = []
    for line in lines:
        from_line = (position - line) / _LINE_POSITION_STD
        shown.append(np.exp(-0.5 * from_line**2) @ weight)
    total = np.array(shown)
    return total / (total + _SEEN_WEIGHT)


def _std_of_others(
    values: np.ndarray, density: np.ndarray, chosen: float, apart: float
) -> float:
    """What values farther than `apart` from the chosen one add to its uncertainty."""
    difference = values - chosen
    is_other = np.abs(difference) > apart
    return float(np.sqrt(density @ (np.square(difference) * is_other)))


def _normalised(log_density: np.ndarray) -> np.ndarray:
    density = np.exp(log_density - log_density.max())
    return density / density.sum()


def median_pose(
    shown: np.ndarray, pose: CameraPose, height_m: float | None
) -> CameraPose:
    """The pose whose numbers are medians of those `shown` (images,).

    They are weighted by confidence.
    """
    confidence = shown["confidence"]
    if height_m is None:
        start = np.log(pose.height_m)
        height_m = float(
            np.exp(weighted_median(shown["log_height"], confidence, start))
        )
    return CameraPose(
        height_m=height_m,
        pitch_rad=weighted_median(shown["pitch_rad"], confidence, pose.pitch_rad),
        yaw_rad=weighted_median(shown["yaw_rad"], confidence, pose.yaw_rad),
        roll_rad=weighted_median(shown["roll_rad"], confidence, pose.roll_rad),
    )


def weighted_median(values: np.ndarray, weights: np.ndarray, start: float) -> float:
    """Median of the values (N,) that are not NaN, and of a start.

    The start has half the weight of a certain lane.
    """
    known = np.isfinite(values)
    values = np.append(values[known], start)
    weights = np.append(weights[known], 0.5)
    median = np.quantile(values, 0.5, weights=weights, method="inverted_cdf")
    return float(median)


def std_of_median(values: np.ndarray, motion_std: float) -> float:
    """Standard deviation of the median of values (N,).

    `motion_std` is the prior scatter of one image.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return motion_std
    # the scatter of few values is uncertain, so the prior counts like two more values
    scatter = 1.4826 * np.median(np.abs(known - np.median(known)))
    squares = len(known) * scatter**2 + 2 * motion_std**2
    variance = squares / (len(known) + 2)
    # the median of n normal values has the variance pi / 2n
    return float(np.sqrt(np.pi / 2 * variance / len(known)))
