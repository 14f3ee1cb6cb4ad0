"""Errors of a system in each frame of a drive with known truth, in metres and in stated standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from benchmark.estimates import AHEAD_M, DriveEstimates, road_points
from lanes.detect.confidence import CORRECT_WITHIN_M

# The near part of AHEAD_M, where a driver needs the lane most: from the bonnet to a second ahead in town.
NEAR = AHEAD_M <= 20.0
# Within this distance of a line the car is changing lanes: either adjacent lane counts as the ego lane.
LANE_CHANGE_M = 0.4
# A line is compared only as far as its direction differs from the car's by less than this. In a hairpin a true line
# turns back, and x does not determine its point.
MAX_LINE_ANGLE_RAD = np.radians(60)
# A wrong lane with this confidence or more is confident and wrong.
CONFIDENT = 0.9
# The numbers of the stated covariance with their fields, and all quantities whose z is reported.
NUMBERS = {"offset": "offset_m", "heading": "heading_rad", "curvature": "curvature_per_m", "width": "width_m"}
QUANTITIES = (*NUMBERS, *(f"lateral_{x:.0f}m" for x in AHEAD_M))
# With a larger error of a line, over 5 to 20 m, another lane was found. Its uncertainty is that of another lane, too.
OTHER_LANE_M = 1.0
# A lost or wrong lane has recovered after this number of correct frames in a row.
RECOVERED_FRAMES = 3


@dataclass(frozen=True, eq=False)
class LaneTruth:
    """The true lane in N frames; NaN where there is no lane, and beyond the end of a line.

    `lines_y_m` (N, 2, D) are lateral positions of the left and right line at AHEAD_M, `at_car_y_m` (N, 2) those at the
    car, x = 0. All others are (N,).
    """

    lines_y_m: np.ndarray
    at_car_y_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    width_m: np.ndarray

    @classmethod
    def from_columns(cls, columns: Mapping[str, np.ndarray]) -> LaneTruth:
        """From the columns of a truth CSV."""
        lines = [[columns[f"{side}_y{x:02.0f}_m"] for x in AHEAD_M] for side in ("left", "right")]
        at_car = [columns[f"{side}_c0_m"] for side in ("left", "right")]
        return cls(
            np.moveaxis(np.array(lines, float), 2, 0),
            np.array(at_car, float).T,
            *(np.asarray(columns[n], float) for n in ("offset_m", "heading_rad", "curvature_per_m", "lane_width_m")),
        )

    @property
    def exists(self) -> np.ndarray:
        """(N,) bool: frames with a lane."""
        return np.isfinite(self.lines_y_m[:, :, 0]).all(axis=1)

    @property
    def _positions_y_m(self) -> np.ndarray:
        """(N, 2, 1 + D) lateral positions at the car and at AHEAD_M."""
        return np.concatenate([self.at_car_y_m[..., None], self.lines_y_m], axis=2)

    @property
    def compared(self) -> np.ndarray:
        """(N, 2, D) bool: the line exists at AHEAD_M, and no chord up to there has MAX_LINE_ANGLE_RAD or more."""
        chords = np.abs(np.diff(self._positions_y_m, axis=2) / np.diff(AHEAD_M, prepend=0.0))
        return np.logical_and.accumulate(chords < np.tan(MAX_LINE_ANGLE_RAD), axis=2)

    @property
    def lane_change(self) -> np.ndarray:
        """(N,) bool: the car is within LANE_CHANGE_M of a line."""
        return (np.abs(self.at_car_y_m) < LANE_CHANGE_M).any(axis=1)

    def select(self, frames: slice) -> LaneTruth:
        """The truth of some of the frames."""
        return LaneTruth(**{field.name: getattr(self, field.name)[frames] for field in fields(self)})

    def adjacent(self) -> LaneTruth:
        """The lane on the other side of the line that the car is crossing; the same lane in all other frames.

        The adjacent lane gets the width of this one. That is exact for parallel lines on a straight road and good to
        a millimetre at a radius of 400 m.
        """
        left_near, right_near = (np.abs(self.at_car_y_m) < LANE_CHANGE_M).T
        step = np.where(left_near, 1.0, np.where(right_near, -1.0, 0.0))
        # Masked by step: in a hairpin one line may end before the other, and its NaN must not spread to other frames.
        y_m = self._positions_y_m
        y_m += step[:, None, None] * np.where(step[:, None, None] == 0, 0.0, y_m[:, :1] - y_m[:, 1:])
        return replace(
            self,
            lines_y_m=y_m[..., 1:],
            at_car_y_m=y_m[..., 0],
            offset_m=self.offset_m - step * self.width_m,
            # adjacent curves have the same centre
            curvature_per_m=self.curvature_per_m / (1 - step * self.width_m * self.curvature_per_m),
        )


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors of N frames; NaN if no lane is available, no lane exists, or the line ends before that distance.

    `exists`, `available` and `confident` are bool: a lane exists; the system reports a lane; it reports one with a
    confidence of CONFIDENT or more, or it states no confidence. `lateral_m` (N, D) are the `line_errors` of the worse
    line at AHEAD_M. `near_rms_m` and `full_rms_m` are the root mean square of the `line_errors` of the worse line: over
    5 to 20 m, and over 5 to 30 m, for which the confidence is defined. Offset, heading and curvature are absolute
    errors.

    The last ones are for errors in stated standard deviations, NaN where no lane exists or no covariance is stated: `z`
    (N, 4) of `NUMBERS`, `lines_z` (N, 2, D) of the lateral positions at AHEAD_M, and `nees` (N,), divided by 4.
    `lane_change` says whether the car is within LANE_CHANGE_M of a line.
    """

    exists: np.ndarray
    available: np.ndarray
    confident: np.ndarray
    lateral_m: np.ndarray
    near_rms_m: np.ndarray
    full_rms_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    confidence: np.ndarray
    time_ms: np.ndarray
    z: np.ndarray
    lines_z: np.ndarray
    nees: np.ndarray
    lane_change: np.ndarray

    @property
    def correct(self) -> np.ndarray:
        """(N,) bool: a lane exists and is available, and both lines are within 0.2 m (rms over 5 to 20 m)."""
        return self.exists & self.available & (self.near_rms_m <= CORRECT_WITHIN_M)

    @property
    def confident_and_wrong(self) -> np.ndarray:
        """(N,) bool: the lane is reported with confidence, but not correct."""
        return self.confident & ~self.correct

    @property
    def stated(self) -> np.ndarray:
        """(N,) bool: a lane exists, and the system states a covariance."""
        return np.isfinite(self.nees)

    @property
    def normalized(self) -> np.ndarray:
        """(N,) bool: frames whose z counts; not those of a lane change, where either adjacent lane is the ego lane."""
        return self.stated & ~self.lane_change & ~(self.near_rms_m > OTHER_LANE_M)

    def z_of(self, quantity: str) -> np.ndarray:
        """The finite z of one of `QUANTITIES` in the frames whose z counts; those of both lines for a position."""
        each = dict(zip(QUANTITIES, [*self.z.T, *np.moveaxis(self.lines_z, 2, 0)], strict=True))
        z = each[quantity][self.normalized]
        return z[np.isfinite(z)]


def joined(drives: Sequence[FrameErrors]) -> FrameErrors:
    """The errors of the frames of all drives."""
    arrays = ([getattr(drive, field.name) for drive in drives] for field in fields(FrameErrors))
    return FrameErrors(*map(np.concatenate, arrays))


def frame_errors(estimates: DriveEstimates, truth: LaneTruth) -> FrameErrors:
    """Errors of the estimates against the truth of the same N frames.

    While the car crosses a line, the estimate is compared with the lanes on both sides, and the nearer one counts.
    Raises ValueError if the numbers of frames differ.
    """
    if len(estimates.offset_m) != len(truth.offset_m):
        raise ValueError(
            f"{len(estimates.offset_m)} frames of estimates cannot be compared with {len(truth.offset_m)} frames of "
            "truth; the video and its CSV must belong together."
        )
    ego, other = (_errors_against(estimates, lane) for lane in (truth, truth.adjacent()))
    swap = np.nan_to_num(other["near_rms_m"], nan=np.inf) < np.nan_to_num(ego["near_rms_m"], nan=np.inf)
    chosen = {name: np.where(swap[(...,) + (None,) * (e.ndim - 1)], other[name], e) for name, e in ego.items()}
    confident = estimates.available & ~(estimates.confidence < CONFIDENT)
    others = {"confidence": estimates.confidence, "time_ms": estimates.time_ms, "lane_change": truth.lane_change}
    normalized = _normalized_errors(estimates, truth)
    return FrameErrors(truth.exists, estimates.available, confident, **chosen, **normalized, **others)


def recovery_lengths(correct: np.ndarray) -> list[int]:
    """Lengths of all losses: frames from the first wrong one to the first of RECOVERED_FRAMES correct ones in a row.

    A lane that is not correct in the first frame counts as lost there. A loss at the end counts up to the last frame.
    """
    lengths, at = [], 0
    while at < len(correct):
        start = at
        while not correct[at : at + (1 if at == start else RECOVERED_FRAMES)].all():
            at += 1
        if at > start:
            lengths.append(at - start)
        at += 1
    return lengths


def _errors_against(estimates: DriveEstimates, truth: LaneTruth) -> dict[str, np.ndarray]:
    """The errors that depend on which lane counts as the ego lane."""
    error = line_errors(estimates, truth)
    worse_m = np.fmax(error[:, 0], error[:, 1])
    errors = {"lateral_m": worse_m, "near_rms_m": worse_rms(error[..., NEAR]), "full_rms_m": worse_rms(error)}
    for name in ("offset_m", "heading_rad", "curvature_per_m"):
        errors[name] = np.where(truth.exists, np.abs(getattr(estimates, name) - getattr(truth, name)), np.nan)
    return errors


def line_errors(estimates: DriveEstimates, truth: LaneTruth) -> np.ndarray:
    """(N, 2, D) distances, metres, of the true points at AHEAD_M from the nearest points of the estimated lines.

    NaN where no lane is available, or the true line is not compared. Unlike a difference in y, the distance is that to
    the line, however much the line is slanted, and it exists where the estimated line has turned back.
    """
    start, end = estimates.lines_m[:, :, :-1], estimates.lines_m[:, :, 1:]
    chord = end - start
    squared_length = np.maximum((chord**2).sum(axis=-1), 1e-12)
    points_m = np.moveaxis(road_points(AHEAD_M, truth.lines_y_m), 2, 0)

    def distance_m(points: np.ndarray) -> np.ndarray:
        """(N, 2) distances of a point (N, 2, 2) of each line."""
        to_point = points[:, :, None] - start
        along = np.clip((to_point * chord).sum(axis=-1) / squared_length, 0.0, 1.0)
        return np.linalg.norm(to_point - along[..., None] * chord, axis=-1).min(axis=-1)

    distances = np.stack([distance_m(points) for points in points_m], axis=-1)
    return np.where(truth.compared & estimates.available[:, None, None], distances, np.nan)


def worse_rms(error: np.ndarray) -> np.ndarray:
    """(N,) from errors (N, 2, K): the larger root mean square of the two lines, NaN left out; NaN if all are NaN."""
    known = ~np.isnan(error)
    count = known.sum(axis=2)
    square = np.where(known, error, 0.0) ** 2
    rms = np.sqrt(square.sum(axis=2) / np.maximum(count, 1))
    left, right = np.where(count > 0, rms, np.nan).T
    return np.fmax(left, right)


def _normalized_errors(estimates: DriveEstimates, truth: LaneTruth) -> dict[str, np.ndarray]:
    """The errors against the ego lane, divided by what the system states."""
    covariance = np.where(truth.exists[:, None, None], estimates.covariance, np.nan)
    errors = np.column_stack([getattr(estimates, name) - getattr(truth, name) for name in NUMBERS.values()])
    lateral = np.where(truth.compared, estimates.lines_y_m - truth.lines_y_m, np.nan)
    return {
        "z": errors / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        "lines_z": lateral / estimates.lines_std_m,
        "nees": np.einsum("ni,ni->n", errors, np.linalg.solve(covariance, errors[..., None])[..., 0]) / len(NUMBERS),
    }
