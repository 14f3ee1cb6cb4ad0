"""Vanishing point of a road in raw images, before the camera pose is known.

First short straight segments of painted stripes are found. The width of a stripe along an image row grows linearly with
the distance of that row from the horizon, whatever the direction of the stripe, because one row of a level camera shows
one distance. A rough horizon row is therefore enough.

Then parallel lines, straight or curved, are fitted to the segments. Measure y downward from the horizon, in ray
coordinates, and all lengths in camera heights. On a flat road the image row y then shows the distance X = 1 / y. A lane
line with lateral position q (positive right), heading a and curvature b runs along Q = q + a X + b X^2 / 2. It appears
at x = Q / X, that is

    x = x0 + k (y - y0) + c / (y - y0)

with k = q, x0 = a (plus the yaw of the camera) and c = b / 2. Parallel lines share x0, y0 and c; only k differs between
lines. A curve therefore does not bias the horizon y0: its curvature goes into c. Among parallel arcs the inner one has
the larger curvature b / (1 - b q). The fit approximates this by c (1 + 2 c k); without it, a curve of 60 m radius
causes an error of 0.2 degrees.

A street with too few lane lines has other edges: kerbs, parked cars, barriers and rows of houses run along the road,
too, and converge in the same point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lanes.camera import Camera
from lanes.track.static_pattern import StaticPattern

# Stripe width over camera height: stripes of 0.10-0.20 m, cameras at 1.1-1.6 m. The filter also responds to half and
# to twice that width, so that one number serves cars and vans.
STRIPE_TO_HEIGHT = 0.09
# A pixel whose response is this many times the noise of its row belongs to a stripe candidate.
MIN_SIGNAL_TO_NOISE = 4.0
# Stripes are cut into segments at distances with this ratio, so that a curve is nearly straight within a segment.
DISTANCE_RATIO = 1.25
# Standard deviation of a stripe centre in pixels. Added because few rows can lie on a line by chance.
CENTRE_STD_PX = 0.4
# Grid of the static pattern, in pixels: segments are compared where they cross every eighth row.
STATIC_ROW_PX, STATIC_COLUMN_PX = 8, 2


@dataclass(frozen=True)
class Segments:
    """Stripe segments of one image in ray coordinates (x right, y down, at z = 1); all arrays have shape (N,).

    The standard deviations are from the scatter of the rows about the segment.
    """

    x: np.ndarray  # centre
    y: np.ndarray
    slope: np.ndarray  # dx/dy
    x_std: np.ndarray  # of x at y
    slope_std: np.ndarray
    rows: np.ndarray  # number of image rows that support the segment

    def select(self, chosen: np.ndarray) -> Segments:
        """The segments of a boolean mask or index array."""
        return Segments(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def without_roll(self, roll_rad: float) -> Segments:
        """The segments as seen by the same camera without its roll."""
        c, s = np.cos(roll_rad), np.sin(roll_rad)
        return replace(
            self,
            x=self.x * c - self.y * s,
            y=self.x * s + self.y * c,
            slope=(self.slope * c - s) / (self.slope * s + c),
        )


def find_segments(image: np.ndarray, camera: Camera, horizon_row: float) -> Segments:
    """Segments of painted stripes below a rough horizon in a raw RGB image (height, width, 3), uint8; can be empty.

    Only the intrinsics of `camera` are used. `horizon_row` is the approximate row of the horizon at the centre of the
    image. An error changes the expected stripe width far away, so that far segments are missed; near ones are still
    found.
    """
    # eight rows below the horizon, where a stripe is a pixel wide
    top = int(np.clip(horizon_row + 8, 0, image.shape[0] - 8))
    below_horizon_px = np.maximum(np.arange(top, image.shape[0]) - horizon_row, 1)
    half_widths = np.maximum(np.round(STRIPE_TO_HEIGHT / 2 * below_horizon_px), 1).astype(int)
    response = _stripe_response(image[top:], half_widths)
    rows, columns, segment = _stripe_centres(response, below_horizon_px, half_widths)
    rays = camera.rays(np.column_stack([columns, rows + top]))
    return _fit_segments(rays[:, 0], rays[:, 1], segment, 1 / camera.matrix[0, 0])


def _stripe_response(image: np.ndarray, half_widths: np.ndarray) -> np.ndarray:
    """Signal-to-noise ratio (rows, columns) float32 of a stripe brighter or yellower than both sides.

    The band filter is the mean over 2 half + 1 columns minus the greater of the means on both sides, so that an edge
    has no response.
    """
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2Lab)
    best = np.zeros(image.shape[:2], np.float32)
    for channel in (lab[..., 0], lab[..., 2]):
        response = np.zeros_like(best)
        for half in np.unique(half_widths):
            mean = cv2.boxFilter(channel[half_widths == half], cv2.CV_32F, (2 * int(half) + 1, 1))
            side = _side_distance_px(half)
            if 2 * side < channel.shape[1]:
                sides = np.maximum(mean[:, : -2 * side], mean[:, 2 * side :])
                response[half_widths == half, side:-side] = mean[:, side:-side] - sides
        # Digital images have at least one grey level of noise. The median is not affected by the few stripes.
        noise = 1.0 + 1.48 * np.median(np.abs(response[:, ::4]), axis=1, keepdims=True)
        best = np.maximum(best, response / noise)
    return best


def _side_distance_px(half_width_px: np.ndarray) -> np.ndarray:
    """Distance from the centre of the filter to that of its sides; a gap of one half width excludes soft edges."""
    return 3 * half_width_px + 1


def _stripe_centres(
    response: np.ndarray, below_horizon_px: np.ndarray, half_widths: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stripe centres in each row: rows (N,), sub-pixel columns (N,), and the index of their segment (N,)."""
    mask = response > MIN_SIGNAL_TO_NOISE
    _, blobs = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    v, u = np.nonzero(mask)
    # one centre for each row of each connected component
    keys, centre = np.unique(blobs[v, u].astype(np.int64) * len(response) + v, return_inverse=True)
    columns = np.bincount(centre, response[v, u] * u) / np.bincount(centre, response[v, u])
    # a stripe that is cut off where the filter ends would have a shifted centre
    border = _side_distance_px(half_widths)[v]
    complete = np.bincount(centre, (u <= border) | (u >= response.shape[1] - 1 - border)) == 0
    rows, blob = keys % len(response), keys // len(response)
    distance_band = np.floor(np.log(below_horizon_px[rows]) / np.log(DISTANCE_RATIO)).astype(int)
    segment = np.unique(blob * 64 + distance_band, return_inverse=True)[1]
    # the blurred ends of a dash run straight up and down and would make flat dashes look steeper
    row_response = np.bincount(centre, response[v, u]) / np.bincount(centre)
    mean_response = np.bincount(segment, row_response) / np.bincount(segment)
    valid = complete & (row_response > 0.75 * mean_response[segment])
    return rows[valid], columns[valid], np.unique(segment[valid], return_inverse=True)[1]


def _fit_segments(x: np.ndarray, y: np.ndarray, segment: np.ndarray, pixel: float) -> Segments:
    """Least-squares line through the centres of each segment; short, curved or irregular segments are dropped."""
    rows = np.bincount(segment).astype(float)
    mean_x, mean_y = np.bincount(segment, x) / rows, np.bincount(segment, y) / rows
    dx, dy = x - mean_x[segment], y - mean_y[segment]
    spread = np.maximum(np.bincount(segment, dy**2), 1e-12)
    slope = np.bincount(segment, dx * dy) / spread
    variance = np.bincount(segment, (dx - slope[segment] * dy) ** 2) / np.maximum(rows - 2, 1)
    std = np.sqrt(variance + (CENTRE_STD_PX * pixel) ** 2)
    # The ends of a segment are uncertain within their rows: 0.25 row in position, 0.35 row in length.
    x_std = np.hypot(std / np.sqrt(rows), 0.25 * slope * pixel)
    slope_std = np.hypot(std / np.sqrt(spread), 0.35 * slope / rows)
    found = Segments(mean_x, mean_y, slope, x_std, slope_std, rows)
    # Steepest lines, in columns per row: 10 m to the side of a camera at 1.25 m.
    return found.select((rows >= 6) & (std < 4 * pixel) & (np.abs(slope) < 8.0))


def drop_static(images: Sequence[Sequence[Segments]], camera: Camera) -> list[Segments]:
    """The segments of images of one drive, in order, without those at the same place of most images.

    Guide lines that a camera draws, and stripes on a bonnet, would give their own vanishing point. Each image may have
    several sets of segments; the result has all of them.
    """
    pattern = StaticPattern(camera.height // STATIC_ROW_PX + 1, camera.width // STATIC_COLUMN_PX + 1)
    for sets in images:
        pattern.add(*np.hstack([_places(segments, camera) for segments in sets]))
    every = [segments for sets in images for segments in sets]
    return [segments.select(~pattern.is_static(*_places(segments, camera))) for segments in every]


def _places(segments: Segments, camera: Camera) -> np.ndarray:
    """Rows and columns (2, N), int, of the grid of the static pattern at which segments cross the nearest row."""
    (fx, _, cx), (_, fy, cy) = camera.matrix[:2]
    row = np.clip(np.round((fy * segments.y + cy) / STATIC_ROW_PX), 0, camera.height // STATIC_ROW_PX)
    x = segments.x + segments.slope * ((row * STATIC_ROW_PX - cy) / fy - segments.y)
    column = np.clip(np.round((fx * x + cx) / STATIC_COLUMN_PX), 0, camera.width // STATIC_COLUMN_PX)
    return np.stack([row, column]).astype(int)


# Parallel lines of one image. The derivative of the equation of the module docstring eliminates k. Each segment
# (x, y, slope) then votes for
#
#     x0 = x - slope (y - y0) - 2 c / (y - y0)

# Bins of the Hough accumulator. y0: camera pitches from -14 to 19 degrees. x0: directions within 27 degrees. c: curve
# radii down to 33 m at a camera height of 1.3 m (c = height / 2R), with finer steps for nearly straight roads.
Y0_BINS = np.arange(-0.34, 0.25, 0.005)
X0_BINS = np.arange(-0.5, 0.5, 0.006)
HALF_CURVATURE_BINS = 2e-4 * np.arange(-10, 11) * np.abs(np.arange(-10, 11))
# Segments closer to the horizon (beyond about 40 m) are not used: hills and changes of curvature dominate there.
MIN_BELOW_HORIZON = 0.03
# Lines farther to the side, in camera heights, do not belong to the ego lane or to its neighbours.
MAX_LATERAL = 6.0
# Segments closer than this (about 0.25 m) belong to one line: a double line, or two segments of one line.
SAME_LINE_DISTANCE = 0.18
# Standard deviation of the model. Near: half a pixel at a focal length of 1000 px. Far: hills and changes of curvature,
# whose effect grows with the square of the distance in camera heights: 2 px at 25 m, 8 px at 50 m.
NEAR_STD, FAR_STD = 5e-4, 5e-6
# Prior standard deviation of c; a radius of about 60 m is one standard deviation.
HALF_CURVATURE_STD = 0.01


@dataclass(frozen=True)
class RoadLines:
    """Parallel lines of one image, in the symbols of the module docstring; `y0_std` includes the prior."""

    x0: float
    y0: float
    half_curvature: float  # c
    y0_std: float
    lateral: np.ndarray  # k of each line (M,), from left to right
    rows: np.ndarray  # number of image rows that support each line (M,)


def hough_votes(segments: Segments, y0_bins: np.ndarray = Y0_BINS) -> np.ndarray:
    """Hough accumulator of one image over y0, c and x0: the number of stripe rows that agree with each bin.

    Its shape is (len(y0_bins), len(HALF_CURVATURE_BINS), len(X0_BINS)).
    """
    t = segments.y - y0_bins[:, None, None]
    below = t > MIN_BELOW_HORIZON
    t = np.where(below, t, 1.0)
    x0 = segments.x - segments.slope * t - 2 * HALF_CURVATURE_BINS[:, None] / t
    k = segments.slope + HALF_CURVATURE_BINS[:, None] / t**2
    step = X0_BINS[1] - X0_BINS[0]
    x0_bin = np.round((x0 - X0_BINS[0]) / step).astype(int)
    valid = below & (np.abs(k) < MAX_LATERAL) & (x0_bin >= 0) & (x0_bin < len(X0_BINS))
    std = np.hypot(_model_std(segments, t), t * segments.slope_std)
    # An uncertain segment would spread over many bins; it votes for one, with a proportionally smaller weight.
    weight = np.broadcast_to(segments.rows * step / np.maximum(std, step), x0_bin.shape)
    shape = (len(y0_bins), len(HALF_CURVATURE_BINS), len(X0_BINS))
    flat_bin = x0_bin + len(X0_BINS) * np.arange(shape[0] * shape[1]).reshape(shape[0], -1, 1)
    votes = np.bincount(flat_bin[valid], weight[valid], np.prod(shape)).reshape(shape)
    # a part of each vote goes to the bins of x0 beside it, because segments scatter by about a bin
    neighbours = np.zeros(shape)
    neighbours[..., 1:] += votes[..., :-1]
    neighbours[..., :-1] += votes[..., 1:]
    return votes + 0.7 * neighbours


def fit_parallel_lines(segments: Segments, y0: float, y0_std: float) -> RoadLines | None:
    """One set of parallel lines fitted to the segments of one image; None if fewer than two lines agree.

    The start comes from Hough votes; then outlier rejection and robust least squares alternate. `y0` and `y0_std` are
    the prior mean and standard deviation of the horizon.
    """
    s = segments.select(segments.y - y0 > MIN_BELOW_HORIZON)
    y0_bins = y0 + y0_std * np.linspace(-2, 2, 9)
    votes = hough_votes(s, y0_bins) * np.exp(-0.5 * ((y0_bins - y0) / y0_std) ** 2)[:, None, None]
    if votes.max() <= 0:
        return None
    best = np.unravel_index(votes.argmax(), votes.shape)
    start = np.array([X0_BINS[best[2]], y0_bins[best[0]], HALF_CURVATURE_BINS[best[1]]])
    # the start is only as accurate as the bins
    x0_tolerance = X0_BINS[1] - X0_BINS[0]
    for _ in range(5):
        inliers, line = _assign_to_lines(s, start, x0_tolerance)
        if line.max(initial=-1) < 1:
            return None
        solution, covariance = _solve(s.select(inliers), line, start, (y0, y0_std))
        start, x0_tolerance = solution[:3], 0.0
    x0, y0, half_curvature = solution[:3]
    rows = np.bincount(line, s.rows[inliers])
    return RoadLines(x0, y0, half_curvature, np.sqrt(covariance[1, 1]), solution[3:], rows)


def _model_std(s: Segments, t: np.ndarray) -> np.ndarray:
    return np.sqrt(s.x_std**2 + NEAR_STD**2 + (FAR_STD / t**2) ** 2)


def _assign_to_lines(s: Segments, start: np.ndarray, x0_tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the segments that agree with (x0, y0, c), and for each the index of its line, from left to right."""
    x0, y0, c = start
    t = s.y - y0
    below = t > MIN_BELOW_HORIZON / 2
    t = np.where(below, t, 1.0)
    k = (s.x - x0 - c / t) / t
    line_c = c * (1 + 2 * c * k)
    k = (s.x - x0 - line_c / t) / t
    residual = s.slope + line_c / t**2 - k
    std = np.hypot(_model_std(s, t) / t, s.slope_std) + x0_tolerance / t
    inliers = np.flatnonzero(below & (np.abs(residual) < 3 * std) & (np.abs(k) < MAX_LATERAL))
    inliers = inliers[np.argsort(k[inliers])]
    return inliers, np.cumsum(np.diff(k[inliers], prepend=-np.inf) > SAME_LINE_DISTANCE) - 1


def _solve(
    s: Segments, line: np.ndarray, start: np.ndarray, horizon: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Robust least squares for (x0, y0, c, k of each line) by Gauss-Newton; the solution and its covariance."""
    one_hot = np.eye(line[-1] + 1)[line]
    x_std = _model_std(s, s.y - start[1])
    std = np.concatenate([x_std, np.hypot(s.slope_std, x_std)])
    parameters = np.concatenate([start, np.zeros(one_hot.shape[1])])
    # prior of the horizon and of c; the small value keeps the normal matrix invertible
    prior, information = np.zeros_like(parameters), np.full_like(parameters, 1e-6)
    prior[1], information[1:3] = horizon[0], (horizon[1] ** -2, HALF_CURVATURE_STD**-2)
    for _ in range(4):
        residual, jacobian = _residuals(s, parameters, line, one_hot)
        residual, jacobian = residual / std, jacobian / std[:, None]
        # Cauchy weights: a segment at two standard deviations has half the weight
        weight = 1 / (1 + (residual / 2) ** 2)
        normal = jacobian.T @ (jacobian * weight[:, None]) + np.diag(information)
        gradient = jacobian.T @ (residual * weight) + information * (prior - parameters)
        parameters = parameters + np.linalg.solve(normal, gradient)
    return parameters, np.linalg.inv(normal)


def _residuals(
    s: Segments, parameters: np.ndarray, line: np.ndarray, one_hot: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (2N,) of the positions and slopes of N segments, and the Jacobian (2N, parameters) of the model."""
    x0, y0, c, k = parameters[0], parameters[1], parameters[2], parameters[3:][line]
    t = np.maximum(s.y - y0, MIN_BELOW_HORIZON / 2)
    # curvature of each line, and its derivatives with respect to c and k
    line_c, by_c, by_k = c * (1 + 2 * c * k), 1 + 4 * c * k, 2 * c**2
    residual = np.concatenate([s.x - x0 - k * t - line_c / t, s.slope - k + line_c / t**2])
    of_x = np.column_stack([np.ones_like(t), line_c / t**2 - k, by_c / t, one_hot * (t + by_k / t)[:, None]])
    of_slope = np.column_stack(
        [np.zeros_like(t), -2 * line_c / t**3, -by_c / t**2, one_hot * (1 - by_k / t**2)[:, None]]
    )
    return residual, np.vstack([of_x, of_slope])


# All edges of one image. Each votes for the camera angles at which it points at the vanishing point.

# Prior of pitch and yaw: cameras are aimed ahead by hand. The yaw contains the heading of the car.
PRIOR_PITCH_STD_RAD, PRIOR_YAW_STD_RAD = np.radians(6.0), np.radians(10.0)
# Angles that are tried. The prior alone has a standard deviation of 4.8 degrees on this grid of pitches.
PITCH_GRID_RAD, YAW_GRID_RAD = np.radians(np.arange(-10, 10.01, 0.25)), np.radians(np.arange(-15, 15.01, 0.5))
# Standard deviations of an edge's direction, because roads are not quite straight, and of the position of its ends, in
# ray coordinates: 1.5 px at a focal length of 1000 px.
DIRECTION_STD_RAD, END_STD = np.radians(1.0), 0.0015
# An edge has a vote for each of these lengths, in ray coordinates, up to four.
VOTE_LENGTH = 0.05


def find_edge_direction(
    images: list[np.ndarray], camera: Camera, max_independent: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Pitch and yaw of a camera, each with its standard deviation, radians, from all edges of its RGB images.

    The images are (height, width, 3), uint8; they count as at most `max_independent` ones. Where no edges converge, the
    result is the prior: a camera that looks ahead.
    """
    votes = np.zeros((len(PITCH_GRID_RAD), len(YAW_GRID_RAD)))
    for image in images:
        middle, along = _find_edges(image, camera)
        votes += _vote(middle, along, np.minimum(np.hypot(*along.T) / VOTE_LENGTH, 4.0))
    pitch_penalty = 0.5 * (PITCH_GRID_RAD / PRIOR_PITCH_STD_RAD)[:, None] ** 2
    log_prior = -pitch_penalty - 0.5 * (YAW_GRID_RAD / PRIOR_YAW_STD_RAD) ** 2
    # two votes for each factor e: chosen so that errors and standard deviations agree on real drives
    log_posterior = votes / 2.0 * min(1.0, max_independent / len(images)) + log_prior
    posterior = np.exp(log_posterior - log_posterior.max())
    return mode_and_std(PITCH_GRID_RAD, posterior.sum(axis=1)), mode_and_std(YAW_GRID_RAD, posterior.sum(axis=0))


def _find_edges(image: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Middles (N, 2) and vectors from end to end (N, 2) of the slanting edges, in ray coordinates.

    Edges shorter than 20 px have no reliable direction. Flatter or steeper ones belong to cross beams and poles.
    """
    found = cv2.createLineSegmentDetector().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))[0]
    ends = np.empty((0, 2, 2)) if found is None else found.reshape(-1, 2, 2).astype(float)
    across, down = np.abs(ends[:, 1] - ends[:, 0]).T
    slope_deg = np.degrees(np.arctan2(down, across))
    ends = ends[(np.hypot(across, down) > 20) & (slope_deg > 8) & (slope_deg < 75)]
    ends = camera.rays(ends.reshape(-1, 2))[:, :2].reshape(-1, 2, 2)
    return ends.mean(axis=1), ends[:, 1] - ends[:, 0]


def _vote(middle: np.ndarray, along: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Sum of the weights of the edges that point at the vanishing point of each pitch and yaw: (pitches, yaws)."""
    length = np.hypot(*along.T)
    to_x = np.tan(YAW_GRID_RAD)[:, None] / np.cos(PITCH_GRID_RAD)[:, None, None] - middle[:, 0]
    to_y = -np.tan(PITCH_GRID_RAD)[:, None, None] - middle[:, 1]
    distance = np.hypot(to_x, to_y)
    angle = np.abs(to_x * along[:, 1] - to_y * along[:, 0]) / length / np.maximum(distance, VOTE_LENGTH)
    std = np.hypot(DIRECTION_STD_RAD, END_STD / length)
    # An edge that contains the point does not lead there.
    return (weight * np.exp(-0.5 * (angle / std) ** 2) * (distance > length / 2)).sum(axis=-1)


def mode_and_std(values: np.ndarray, density: np.ndarray) -> tuple[float, float]:
    """Maximum of a density given on a grid, and the standard deviation about it."""
    mode = float(values[np.argmax(density)])
    return mode, std_about(mode, values, density)


def std_about(value: float, values: np.ndarray, density: np.ndarray) -> float:
    """Root mean square distance from `value` of a density given on a grid."""
    return float(np.sqrt(np.average((values - value) ** 2, weights=density)))
