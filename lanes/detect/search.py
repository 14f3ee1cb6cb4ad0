"""Search without memory: the ego lane in a single image, and what is seen of its lines.

    stripes -> vote_lanes (start hypotheses) -> fit_starts -> Lane

The votes are the histogram of the course's first half, generalised to roads that bend.
For each hypothesis of heading, curvature and pitch the stripes are counted in bins of
their distance from its arc: a line that follows the hypothesis adds up in one bin,
whatever its shape on the road. Stripes whose own direction contradicts the hypothesis
have no weight (votes with directions: Ballard's generalised Hough transform, 1981).
Peaks to the left and to the right of the car are then paired to lanes, with a prior for
lane width and position.

A single image determines the height of its camera roughly, or not at all. With a wrong
height two lines that are not a lane apart are taken for the ego lane. Several heights
are therefore tried. If they show the same lane, the height does not matter; if they
show different ones, the lane is doubtful.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lanes.camera.model import Camera, require_camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Evidence, PaintSettings, Stripes, find_evidence
from lanes.detect.fit import Fit, FitSettings, fit_starts, near_stripes
from lanes.detect.lane import FarEvidence, Lane, LineEvidence, stated
from lanes.detect.line_type import MarkingProfile, marking_profile
from lanes.detect.markings import Markings
from lanes.detect.residuals import (
    MIN_SCALE,
    flatten,
    intersect_ground,
    stripe_residuals,
)
from lanes.detect.road import (
    CENTRE,
    CURVATURE,
    HEADING,
    LEFT_SIDE,
    PARAMETERS,
    PITCH,
    RIGHT_SIDE,
    SIDES,
    WIDTH,
    RoadPrior,
    UsualWidth,
    adjacent_lane_matrix,
    is_ego_lane,
    parameter_vector,
)
from lanes.errors import require_type


@dataclass(frozen=True)
class VoteSettings:
    """Hypotheses, bins and pairing; tuned on the labelled Udacity stills where no
    source is given.
    """

    # Votes come from stripes nearer than this, where one arc is enough; the fit
    # continues outwards.
    far_m: float = 22.0
    # Hypotheses of heading (rad) and curvature (1/m) to either side of 0: number, first
    # step, relative growth of the steps. They are dense where roads usually are; radii
    # go down to 15 m.
    headings: tuple[int, float, float] = (6, 0.03, 0.18)
    curvatures: tuple[int, float, float] = (11, 0.0015, 0.24)
    # Hypotheses of pitch are 0 and this, up and down: a degree, as cars pitch.
    pitch_rad: float = 0.018
    bin_m: float = 0.15
    bins: int = 60
    # Smallest and largest distance of a line of the lane to either side of the car.
    beside_m: tuple[float, float] = (0.3, 3.6)
    # Cost of one squared standard deviation from the prior, relative to the square root
    # of a line's share of votes.
    prior_weight: float = 0.05
    # Lanes that are returned.
    lanes: int = 5

    @cached_property
    def hypotheses(self) -> np.ndarray:
        """(H, 3): heading, curvature and pitch."""
        headings = _spread(*self.headings)
        curvatures = _spread(*self.curvatures)
        pitches = np.arange(-1, 2) * self.pitch_rad
        grid = np.meshgrid(headings, curvatures, pitches, indexing="ij")
        return np.stack(grid, axis=-1).reshape(-1, 3)

    @cached_property
    def bin_centres_m(self) -> np.ndarray:
        """(bins,) distance of each bin's centre to the left of a hypothesis' arc."""
        return (np.arange(self.bins) + 0.5 - self.bins / 2) * self.bin_m


def _spread(count: int, step: float, growth: float) -> np.ndarray:
    """Zero and `count` values to either side, first a `step` apart, then farther."""
    k = np.arange(-count, count + 1)
    return np.sign(k) * step * np.expm1(np.abs(k) * growth) / growth


def vote_lanes(
    stripes: Stripes,
    view: BirdsEyeView,
    prior: RoadPrior,
    settings: VoteSettings,
    usual_width: UsualWidth | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The vote table (hypotheses, bins), and the lanes (K, 15) that it suggests.

    The lanes are ordered, best first.
    """
    votes = count_votes(stripes, view.height_m, settings)
    rows = int((view.x_m < settings.far_m).sum())
    return votes, best_pairs(votes, rows, prior, settings, usual_width)


def count_votes(
    stripes: Stripes, height_m: float, settings: VoteSettings
) -> np.ndarray:
    """Histogram (H, bins) of the stripes by their distance from each hypothesis' arc.

    The stripes are weighted, the distance is to the left of the arc. The bins are
    centred on `settings.bin_centres_m`.
    """
    near = stripes.select(stripes.x_m < settings.far_m)
    weight = near.weight.astype(np.float32)
    heading, curvature, pitch = settings.hypotheses.T
    votes = np.zeros((len(heading), settings.bins))
    for pitch_rad in np.unique(pitch):
        # the stripes on the road of this pitch
        lane = parameter_vector(pitch=pitch_rad)
        ground = intersect_ground(near.x_m, lane, height_m)
        x, y, angle = flatten(near.x_m, near.y_m, near.angle, ground, height_m)

        # distances from the arcs of all hypotheses with this pitch, and their bins
        of_pitch = np.flatnonzero(pitch == pitch_rad)
        a, agreement = _distances_and_agreement(
            x,
            y,
            angle,
            near.angle_std_rad,
            heading[of_pitch],
            curvature[of_pitch],
        )
        # in place: half of the time is memory allocation
        a *= 1 / settings.bin_m
        a += settings.bins / 2
        bins = np.clip(a, 0, settings.bins - 1, out=a).astype(np.intp)
        bins += settings.bins * np.arange(len(of_pitch))[:, None]

        agreement *= weight
        size = len(of_pitch) * settings.bins
        counts = np.bincount(bins.ravel(), agreement.ravel(), size)
        votes[of_pitch] = counts.reshape(-1, settings.bins)
    # the outermost bins also hold everything beyond them
    votes[:, [0, -1]] = 0
    return votes


def _distances_and_agreement(
    x: np.ndarray,
    y: np.ndarray,
    angle: np.ndarray,
    angle_std: np.ndarray,
    heading: np.ndarray,
    curvature: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of each stripe from each hypothesis' arc, and agreement of directions.

    Both are (hypotheses, stripes), the agreement 0 to 1. The geometry is that of
    `lanes.detect.residuals`, written as two products of matrices in float32: bins are
    coarse, and this table takes most of the time of a search.
    """
    # twice the distance, were the arc a straight line with a small correction
    sin = np.sin(heading)
    cos = np.cos(heading)
    square = x * x + y * y
    twice = sums_of_products((2 * cos, -2 * sin, -curvature), (y, x, square))

    # sine of the angle between stripe and arc, in standard deviations
    across = np.sin(angle)
    front = np.cos(angle)
    turn = (x * front + y * across) / angle_std
    of_stripes = (front / angle_std, across / angle_std, turn)
    angle_residual = sums_of_products((sin, -cos, curvature), of_stripes)

    # in place: half of the time is memory allocation
    scale_square = 1 - curvature.astype(np.float32)[:, None] * twice
    np.maximum(scale_square, MIN_SCALE**2, out=scale_square)
    variance = np.square(angle_residual, out=angle_residual)
    variance += scale_square
    ratio = np.divide(scale_square, variance, out=variance)
    agreement = np.square(ratio, out=ratio)
    scale = np.sqrt(scale_square, out=scale_square)
    distance = np.divide(twice, 1 + scale, out=twice)
    return distance, agreement


def sums_of_products(
    of_hypotheses: tuple[np.ndarray, ...], of_stripes: tuple[np.ndarray, ...]
) -> np.ndarray:
    """(hypotheses, stripes) float32: sums over pairs of factors.

    One factor is of each hypothesis, the other of each stripe.
    """
    rows = np.stack(of_hypotheses, axis=1).astype(np.float32)
    columns = np.stack(of_stripes).astype(np.float32)
    return rows @ columns


def best_pairs(
    votes: np.ndarray,
    rows: int,
    prior: RoadPrior,
    settings: VoteSettings,
    usual_width: UsualWidth | None = None,
) -> np.ndarray:
    """At most `settings.lanes` lanes (K, 15), best first, from pairs of lines in the
    votes.

    There are no duplicates. The score of a lane is the sum of the square roots of its
    lines' shares of `rows`, the votes of a solid line. Two fair lines therefore beat
    one good line alone.
    """
    hypothesis = settings.hypotheses
    middle = settings.bin_centres_m
    # a stripe between two bins also counts in the other one
    shared = votes.copy()
    shared[:, 1:-1] += 0.6 * (votes[:, :-2] + votes[:, 2:])
    # float32, because there are 400,000 pairs of bins
    support = np.sqrt(shared / rows).astype(np.float32)

    # all pairs of a line to the left and one to the right of the car, less their
    # distance from the prior
    nearest_m, farthest_m = settings.beside_m
    left = np.flatnonzero((middle > nearest_m) & (middle < farthest_m))
    right = np.flatnonzero((middle < -nearest_m) & (middle > -farthest_m))
    width = middle[left, None] - middle[right]
    centre = (middle[left, None] + middle[right]) / 2
    from_width = (width - prior.mean[WIDTH]) / prior.std[WIDTH]
    from_centre = centre / prior.std[CENTRE]
    pair_distance = from_width**2 + from_centre**2
    score = support[:, left, None] + support[:, None, right]
    score -= (settings.prior_weight * pair_distance).astype(np.float32)
    if usual_width:
        score -= usual_width.cost(width).astype(np.float32)

    # the best pair of each hypothesis
    score = score.reshape(len(hypothesis), -1)
    pair = score.argmax(axis=1)
    from_prior = hypothesis / prior.std[[HEADING, CURVATURE, PITCH]]
    penalty = settings.prior_weight * (from_prior**2).sum(1)
    best = score[np.arange(len(pair)), pair] - penalty
    lanes = np.zeros((len(pair), PARAMETERS))
    lanes[:, CENTRE] = centre.ravel()[pair]
    lanes[:, WIDTH] = width.ravel()[pair]
    lanes[:, [HEADING, CURVATURE, PITCH]] = hypothesis
    order = np.argsort(-best, kind="stable")
    return _suppress_non_maxima(lanes[order], settings.lanes)


def _suppress_non_maxima(lanes: np.ndarray, count: int) -> np.ndarray:
    """The first `count` of the lanes (N, 15) that do not lead to the same fit as a
    better.

    They are ordered, best first. Two lanes lead to the same fit if centre and width
    differ by less than 0.35 m, and the curvatures by less than 0.002 1/m and 30 %.
    """
    chosen: list[int] = []
    free = np.ones(len(lanes), bool)
    while len(chosen) < count and free.any():
        best = int(free.argmax())
        chosen.append(best)
        difference = np.abs(lanes - lanes[best])
        moved_m = np.maximum(difference[:, CENTRE], difference[:, WIDTH])
        same_bend = 0.002 + 0.3 * np.abs(lanes[:, CURVATURE])
        free &= (moved_m > 0.35) | (difference[:, CURVATURE] > same_bend)
    return lanes[chosen]


# Clutter: stripes between the lines of a lane, farther from the lines than this, up to
# the distance ahead in which lanes are rated.
CLUTTER_FROM_M = 0.5
CLUTTER_FAR_M = 30.0
# This number of stripes on the lines is added, so that a few dots of a worn line are no
# clutter.
CLUTTER_STRIPES = 5.0
# Smallest support of a far line that is seen, and smallest distance from its first to
# its last stripe: one dash, an arrow or a car is shorter. On the eight stills and 36
# scenes of the rendered suite, variants 3 to 6, 89 far lines are seen. Two are wrong,
# as are their ego lanes.
FAR_SUPPORT = 0.05
FAR_SPAN_M = 10.0
# A line is an edge of the road, not painted, if the band filter sees paint in less than
# this share of its rows: kerbs and ends of pavements had at most 0.2, faint lines that
# the network took for edges 0.4 to 1.
EDGE_PAINT_BELOW = 0.3


@dataclass(frozen=True)
class DetectorSettings:
    """Settings of the steps of a detection."""

    paint: PaintSettings = field(default_factory=PaintSettings)
    votes: VoteSettings = field(default_factory=VoteSettings)
    fit: FitSettings = field(default_factory=FitSettings)
    # Views begin where images do, but not nearer than this, also those of the tracker.
    near_m: float = 2.5
    # That of a single image holds the adjacent lines: in a wider one the network finds
    # more false stripes. The tracker has its own widths (`half_widths_m`).
    half_width_m: float = 6.5


DETECTOR = DetectorSettings()


@dataclass(frozen=True, eq=False)
class Search:
    """The steps of a search: vote table, fit of all start hypotheses to the near
    stripes, and the final fit.
    """

    votes: np.ndarray
    starts: Fit
    fit: Fit


@dataclass(frozen=True, eq=False)
class StillDetection:
    """The result of a detection in an image, with its intermediate results.

    `settings` are those that it was made with. `search` is None without stripes near
    the car, or if a tracker made none; `lane` is None if no lane is seen.
    """

    evidence: Evidence
    settings: DetectorSettings
    search: Search | None = None
    lane: Lane | None = None

    @property
    def camera(self) -> Camera:
        """The camera with the pose that the lane was found with."""
        return self.evidence.view.camera

    @property
    def confidence(self) -> float:
        """Confidence of the lane; 0 without one."""
        return self.lane.confidence if self.lane else 0.0


def search_lane(
    evidence: Evidence,
    settings: DetectorSettings,
    usual_width: UsualWidth | None = None,
) -> StillDetection:
    """Search the ego lane in the evidence of one image.

    `usual_width` is that of the drive, if it is known.
    """
    stripes = evidence.stripes
    near = near_stripes(stripes, settings.fit)
    if not len(near):
        return StillDetection(evidence, settings)
    votes, starts = vote_lanes(
        stripes, evidence.view, settings.fit.prior, settings.votes, usual_width
    )
    begun, fit = fit_starts(
        starts, near, stripes, evidence.view, settings.fit, usual_width=usual_width
    )
    search = Search(votes, begun, fit)
    if not fit.seen[0]:
        return StillDetection(evidence, settings, search)
    return StillDetection(evidence, settings, search, _found_lane(fit, evidence))


def _found_lane(fit: Fit, evidence: Evidence) -> Lane:
    """The lane of a fit of one lane, with what the image shows of its lines."""
    left, right = observe_lines(fit, evidence, (LineEvidence(), LineEvidence()))
    model = fit.lanes[0] + inner_stripe_shift(left.profile, right.profile)
    from_centres = inner_stripe_shift(left.double_profile, right.double_profile)
    # a lane that the car is not in starts no track
    penalty = not is_ego_lane(fit.lanes)[0]
    return Lane(
        model=model,
        centres=model - from_centres,
        fit_covariance=fit.covariance[0],
        # rows are counted again in the next frame, because its view may be narrower
        evidence=(replace(left, rows=None), replace(right, rows=None)),
        score=lane_score((left, right)) - penalty,
        clear_share=clear_share(fit),
        far_evidence=observe_far_lines(fit, evidence),
        confidence_shift=evidence.confidence_shift,
        camera=evidence.view.camera,
    )


def lane_score(lines: Sequence[LineEvidence]) -> float:
    """Sum of the square roots of both lines' supports."""
    return float(sum(np.sqrt(line.support) for line in lines))


def clear_share(fit: Fit) -> float:
    """Share of the stripes along the fitted lane that lie on its lines, 0 to 1.

    The others, between the lines, are clutter.
    """
    side = fit.residuals.side[0]
    inwards_m = -side * fit.residuals.residual_m[0]
    of_lane = (fit.stripes.x_m < CLUTTER_FAR_M) & (np.abs(side) == 1)
    is_clutter = of_lane & (inwards_m > CLUTTER_FROM_M)
    # stripes that run across the lane do not count
    any_distance = np.full(len(side), np.inf)
    along = fit.residuals.weights(any_distance)[0]
    clutter = float(fit.stripes.weight @ (is_clutter * along))
    on_lines = CLUTTER_STRIPES + float(fit.weight[0] @ of_lane)
    return on_lines / (on_lines + clutter)


def observe_lines(
    fit: Fit,
    evidence: Evidence,
    previous: Sequence[LineEvidence],
    *,
    profiles_of: Sequence[int] = (0, 1),
) -> tuple[LineEvidence, LineEvidence]:
    """What one image shows of the left and the right line of a fitted lane.

    The profiles of the lines `profiles_of` are measured, and vote. If there are any,
    the visible rows of both lines are counted, too: they change slowly. Profiles and
    rows that are not measured are those of the `previous` frame.
    """
    rows: list[Any] = [line.rows for line in previous]
    if len(profiles_of) or None in rows:
        rows = fit.visible_rows[0].tolist()
    observed = []
    for k, line in enumerate(previous):
        measured_in = evidence if k in profiles_of else None
        observed.append(_observe_line(fit, (0, k), rows[k], line, measured_in))
    return observed[0], observed[1]


def observe_far_lines(fit: Fit, evidence: Evidence) -> FarEvidence:
    """What one image shows of the far lines of the lanes to the left and right.

    None for a line that is not seen.
    """
    lanes = np.array([adjacent_lane_matrix(side) @ fit.lanes[0] for side in SIDES])
    residuals = stripe_residuals(lanes, fit.stripes, fit.view.height_m)
    adjacent = replace(fit, lanes=lanes, residuals=residuals)
    # the left line of the lane to the left, and the right line of the lane to the right
    lines: list[LineEvidence | None] = [None, None]
    for k in range(2):
        marked_m = fit.stripes.x_m[adjacent.members[k, k]]
        is_long = len(marked_m) > 0 and np.ptp(marked_m) >= FAR_SPAN_M
        if is_long and adjacent.support[k, k] >= FAR_SUPPORT:
            rows = int(adjacent.visible_rows[k, k])
            unknown = LineEvidence()
            lines[k] = _observe_line(adjacent, (k, k), rows, unknown, evidence)
    return lines[0], lines[1]


def _observe_line(
    fit: Fit,
    line: tuple[int, int],
    rows: int,
    previous: LineEvidence,
    evidence: Evidence | None,
) -> LineEvidence:
    """What one image shows of the `line` (lane, side) of a fit.

    Without `evidence` no profile is measured.
    """
    members = fit.members[line]
    # the cross-section, and the votes on the type of the line
    profile = previous.profile
    votes = previous.votes
    if evidence is not None:
        measured = _line_profile(fit, line, evidence)
        if measured is not None:
            profile = measured
            votes = votes.add(measured)

    # by weight, because there are edges beside painted lines, too, and between dashes
    weight = fit.weight[line[0]] * members
    is_edge = bool(weight @ fit.stripes.edge > weight @ ~fit.stripes.edge)
    if is_edge and evidence is not None:
        stripe_rows = fit.stripes.row[members]
        painted = _painted_share(evidence, fit.lines_y_m[line], stripe_rows)
        is_edge = painted < EDGE_PAINT_BELOW

    support = float(fit.marked_rows[line] / rows)
    start_m, reach_m = fit.extent_m[line].tolist()
    starts_m = [value for value in (start_m, previous.start_m) if value]
    return LineEvidence(
        support=support,
        seen=support >= fit.settings.min_support,
        reach_m=reach_m,
        edge=is_edge,
        rows=rows,
        profile=profile,
        votes=votes,
        start_m=min(starts_m, default=0.0),
    )


def _line_profile(
    fit: Fit, line: tuple[int, int], evidence: Evidence
) -> MarkingProfile | None:
    """The profile of a `line` (lane, side) of a fit, from its painted stripes."""
    painted = fit.members[line] & fit.stripes.measurable & ~fit.stripes.edge
    return marking_profile(
        evidence.response,
        fit.view,
        line_y_m=fit.lines_y_m[line],
        stripe_rows=fit.stripes.row[painted],
        side=float(SIDES[line[1]]),
        paint=evidence.settings,
        coloured=evidence.has_colours,
    )


def _painted_share(
    evidence: Evidence, line_y_m: np.ndarray, stripe_rows: np.ndarray
) -> float:
    """Share of the rows between the stripes of a line with paint within 0.15 m of it.

    Paint is what the band filter sees.
    """
    rows = np.arange(stripe_rows.min(), stripe_rows.max() + 1)
    strength = evidence.response.band_strength[rows]
    is_paint = strength > evidence.settings.min_strength
    beside = np.abs(evidence.view.y_m - line_y_m[rows, None]) < 0.15
    return float((is_paint & beside).any(axis=1).mean())


def inner_stripe_shift(
    left: MarkingProfile | None, right: MarkingProfile | None
) -> np.ndarray:
    """Shift (15,) of the parameters from the fitted lines to the stripes next to the
    lane.

    Fits follow the centre of a double line. The profiles are those of the left and the
    right line; None shifts nothing.
    """
    left_m = left.stripe_m(LEFT_SIDE) if left else 0.0
    right_m = right.stripe_m(RIGHT_SIDE) if right else 0.0
    shift = np.zeros(PARAMETERS)
    shift[CENTRE] = (left_m + right_m) / 2
    shift[WIDTH] = left_m - right_m
    return shift


# Heights of cameras in cars, vans and lorries, metres.
HEIGHT_RANGE_M = 0.5, 4.5


def find_lane(
    image: np.ndarray | str | Path,
    camera: Camera,
    settings: DetectorSettings = DETECTOR,
    *,
    markings: Markings | None = None,
) -> Lane | None:
    """The ego lane in a single image; None if it is not seen.

    A lane with a confidence below 0.15 is none.

    >>> lane = lanes.find_lane(image, camera)  # doctest: +SKIP

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8, or path
        RGB, raw.
    camera : Camera
        The camera that took it, with its pose.
    settings : DetectorSettings
    markings : callable, optional
        A function from the image to a mask (rows, columns), 0 to 1, of its lane
        markings, at any resolution. It replaces our own filters; see
        `lanes.detect.markings.load_markings`.

    Raises
    ------
    PictureError
        If the image is not RGB or not of the camera's size.
    CameraError, LaneError
        If the camera has no pose, or sees no road; if `markings` returns no mask.
    """
    return stated(detect_still(image, camera, settings, markings=markings).lane)


def detect_still(
    image: np.ndarray | str | Path,
    camera: Camera,
    settings: DetectorSettings = DETECTOR,
    *,
    markings: Markings | None = None,
) -> StillDetection:
    """The detection in a single image of a camera with a known pose.

    Parameters and errors are those of `find_lane`.
    """
    image = require_camera(camera).require_size(image)
    settings = require_type(settings, DetectorSettings, "settings")
    view = _view_of(camera, settings)
    evidence = find_evidence(image, view, settings.paint, markings=markings)
    return search_lane(evidence, settings)


def search_at_heights(
    image: np.ndarray,
    camera: Camera,
    heights_m: np.ndarray,
    settings: DetectorSettings,
    *,
    markings: Markings | None = None,
) -> list[StillDetection]:
    """The detection in a single image for each height of the camera.

    The evidence is extracted once, with the camera's own pose. The lanes have a
    `Lane.single_image_pose`: their confidence is that of a lane whose width is
    uncertain.
    """
    view = _view_of(camera, settings)
    evidence = find_evidence(image, view, settings.paint, markings=markings)
    detections = []
    for height_m in np.clip(heights_m, *HEIGHT_RANGE_M):
        found = search_lane(evidence.at_height(float(height_m)), settings)
        if found.lane:
            lane = replace(found.lane, single_image_pose=True)
            found = replace(found, lane=lane)
        detections.append(found)
    return detections


def detect_with_own_pose(
    image: np.ndarray,
    camera: Camera,
    height_log_std: float,
    settings: DetectorSettings,
    *,
    markings: Markings | None = None,
) -> StillDetection:
    """The detection in a single image whose camera pose is only known roughly.

    The evidence is found once and searched for several heights of the camera. A height
    has its prior probability times the odds of the lane that it shows. The lane with
    the largest sum over all heights that show it is taken, and of these heights the
    most probable one. The share of the heights, by their prior, that show this lane is
    `Lane.same_lane_share`. The fit itself finds the pitch.

    The pose of `camera` is the estimate; it is kept if no height shows a lane.
    `height_log_std` is the standard deviation of the logarithm of its height; 0 if the
    height is known. Errors are those of `find_lane`.
    """
    # heights at the mean of the prior and a standard deviation of their logarithm aside
    steps = np.array([0.0, -1.0, 1.0] if height_log_std else [0.0])
    log_prior = -0.5 * steps**2
    heights_m = camera.require_pose().height_m * np.exp(steps * height_log_std)
    found = search_at_heights(image, camera, heights_m, settings, markings=markings)
    shown = [k for k, detection in enumerate(found) if detection.lane]
    if not shown:
        return found[0]

    # posterior probability of each height that shows a lane
    lanes = [detection.lane for detection in found if detection.lane]
    log_posterior = log_prior[shown] + [lane.log_odds for lane in lanes]
    probability = np.exp(log_posterior - log_posterior.max())

    # the lane that is most probable over all heights, and the best height that shows it
    rows = _compared_rows(camera)
    columns = []
    for k, lane in zip(shown, lanes, strict=True):
        columns.append(lane.columns(found[k].camera, rows))
    same = _same_lane(np.array(columns), camera)
    most_probable = (same @ probability).argmax()
    of_lane = np.flatnonzero(same[most_probable])
    best = of_lane[probability[of_lane].argmax()]

    prior = np.exp(log_prior)
    share = float(same[best] @ prior[shown] / prior.sum())
    lane = replace(lanes[best], same_lane_share=share)
    return replace(found[shown[best]], lane=lane)


def _compared_rows(camera: Camera) -> np.ndarray:
    """Rows (25,) of the image, from the road 60 m ahead down to the lower border."""
    top = camera.road_to_pixels(np.array([[60.0, 0.0]]))[0, 1]
    return np.linspace(top, 0.98 * camera.height, 25)


def _same_lane(columns: np.ndarray, camera: Camera) -> np.ndarray:
    """(N, N) bool: which of the lanes with these columns (N, 2, rows) are the same.

    They are the same in the image if both lines are within 2 % of the image's width in
    four of five rows. Every lane is the same as itself, also if it is seen in too few
    rows to be compared.
    """
    first = columns[:, None]
    second = columns[None]
    common = (first >= 0) & (second >= 0)
    near = common & (np.abs(first - second) < 0.02 * camera.width)
    count = common.sum(axis=-1)
    enough = (near.sum(axis=-1) >= 0.8 * count) & (count >= 4)
    return enough.all(axis=-1) | np.eye(len(columns), dtype=bool)


@lru_cache(maxsize=4)
def _view_of(camera: Camera, settings: DetectorSettings) -> BirdsEyeView:
    """The bird's-eye view, cached: making it takes half as long as a
    detection in it.
    """
    return BirdsEyeView.from_image_border(
        camera, settings.near_m, half_width_m=settings.half_width_m
    )
