"""Errors of a system in each frame of a drive with known truth, in metres and in stated
standard deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from benchmark.estimates import AHEAD_M, DriveEstimates, road_points
from lanes.detect.confidence import CORRECT_WITHIN_M

# The near part of AHEAD_M, where a driver needs the lane most: from the bonnet to a
# second ahead in town.
NEAR = AHEAD_M <= 20.0
# Within this distance of a line the car is changing lanes: either adjacent lane counts
# as the ego lane.
LANE_CHANGE_M = 0.4
# A line is compared only as far as its direction differs from the car's by less than
# this. In a hairpin a true line turns back, and x does not determine its point.
MAX_LINE_ANGLE_RAD = np.radians(60)
# A wrong lane with this confidence or more is confident and wrong.
CONFIDENT = 0.9
# The numbers of the stated covariance with their fields, and all quantities whose z is
# reported.
NUMBERS = {
    "offset": "offset_m",
    "heading": "heading_rad",
    "curvature": "curvature_per_m",
    "width": "width_m",
}
QUANTITIES = (*NUMBERS, *(f"lateral_{x:.0f}m" for x in AHEAD_M))
# With a larger error of a line, over 5 to 20 m, another lane was found. Its uncertainty
# is that of another lane, too.
OTHER_LANE_M = 1.0
# A lost or wrong lane has recovered after this number of correct frames in a row.
RECOVERED_FRAMES = 3


@dataclass(frozen=True, eq=False)
class LaneTruth:
    """The true lane in N frames.

    NaN where there is no lane, and beyond the end of a line.

    `lines_y_m` (N, 2, D) are lateral positions of the left and right line at AHEAD_M,
    `at_car_y_m` (N, 2) those at the car, x = 0. All others are (N,).
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
        lines_y_m = []
        at_car_y_m = []
        for side in ("left", "right"):
            line = [columns[f"{side}_y{x:02.0f}_m"] for x in AHEAD_M]
            lines_y_m.append(np.column_stack(line))
            at_car_y_m.append(columns[f"{side}_c0_m"])
        return cls(
            lines_y_m=np.stack(lines_y_m, axis=1).astype(float),
            at_car_y_m=np.column_stack(at_car_y_m).astype(float),
            offset_m=np.asarray(columns["offset_m"], float),
            heading_rad=np.asarray(columns["heading_rad"], float),
            curvature_per_m=np.asarray(columns["curvature_per_m"], float),
            width_m=np.asarray(columns["lane_width_m"], float),
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
        """(N, 2, D) bool: the line exists at AHEAD_M, and no chord up to there has
        MAX_LINE_ANGLE_RAD or more.
        """
        rise_m = np.diff(self._positions_y_m, axis=2)
        run_m = np.diff(AHEAD_M, prepend=0.0)
        is_flat = np.abs(rise_m / run_m) < np.tan(MAX_LINE_ANGLE_RAD)
        return np.logical_and.accumulate(is_flat, axis=2)

    @property
    def lane_change(self) -> np.ndarray:
        """(N,) bool: the car is within LANE_CHANGE_M of a line."""
        return (np.abs(self.at_car_y_m) < LANE_CHANGE_M).any(axis=1)

    def select(self, frames: slice) -> LaneTruth:
        """The truth of some of the frames."""
        return LaneTruth(*(getattr(self, field.name)[frames] for field in fields(self)))

    def adjacent(self) -> LaneTruth:
        """The lane on the other side of the line that the car is crossing.

        The same lane in all other frames.

        The adjacent lane gets the width of this one. That is exact for parallel lines
        on a straight road and good to a millimetre at a radius of 400 m.
        """
        left_near, right_near = (np.abs(self.at_car_y_m) < LANE_CHANGE_M).T
        step = np.select([left_near, right_near], [1.0, -1.0], 0.0)
        step_m = step * self.width_m

        positions_m = self._positions_y_m
        width_m = positions_m[:, :1] - positions_m[:, 1:]
        # In a hairpin one line may end before the other, and its NaN must not spread to
        # other frames.
        of_lines = step[:, None, None]
        positions_m += of_lines * np.where(of_lines == 0, 0.0, width_m)
        return replace(
            self,
            lines_y_m=positions_m[..., 1:],
            at_car_y_m=positions_m[..., 0],
            offset_m=self.offset_m - step_m,
            # adjacent curves have the same centre
            curvature_per_m=self.curvature_per_m / (1 - step_m * self.curvature_per_m),
        )


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors of N frames.

    NaN if no lane is available, no lane exists, or the line ends before that distance.

    `exists`, `available` and `confident` are bool: a lane exists; the system reports a
    lane; it reports one with a confidence of CONFIDENT or more, or it states no
    confidence. `lateral_m` (N, D) are the `line_errors` of the worse line at AHEAD_M.
    `near_rms_m` and `full_rms_m` are the root mean square of the `line_errors` of the
    worse line: over 5 to 20 m, and over 5 to 30 m, for which the confidence is defined.
    Offset, heading and curvature are absolute errors.

    The last ones are for errors in stated standard deviations, NaN where no lane exists
    or no covariance is stated: `z` (N, 4) of `NUMBERS`, `lines_z` (N, 2, D) of the
    lateral positions at AHEAD_M, and `nees` (N,), divided by 4. `lane_change` says
    whether the car is within LANE_CHANGE_M of a line.
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
        """(N,) bool: a lane exists and is available, and both lines are within 0.2 m
        (rms over 5 to 20 m).
        """
        is_near = self.near_rms_m <= CORRECT_WITHIN_M
        return self.exists & self.available & is_near

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
        """(N,) bool: frames whose z counts.

        Not those of a lane change, where either adjacent lane is the ego lane.
        """
        other_lane = self.near_rms_m > OTHER_LANE_M
        return self.stated & ~self.lane_change & ~other_lane

    def z_of(self, quantity: str) -> np.ndarray:
        """The finite z of one of `QUANTITIES` in the frames whose z counts.

        Those of both lines for a position.
        """
        number = QUANTITIES.index(quantity)
        if number < len(NUMBERS):
            z = self.z[self.normalized, number]
        else:
            z = self.lines_z[self.normalized, :, number - len(NUMBERS)]
        return z[np.isfinite(z)]


def joined(drives: Sequence[FrameErrors]) -> FrameErrors:
    """The errors of the frames of all drives."""
    arrays = []
    for field in fields(FrameErrors):
        of_drives = [getattr(drive, field.name) for drive in drives]
        arrays.append(np.concatenate(of_drives))
    return FrameErrors(*arrays)


def frame_errors(estimates: DriveEstimates, truth: LaneTruth) -> FrameErrors:
    """Errors of the estimates against the truth of the same N frames.

    While the car crosses a line, the estimate is compared with the lanes on both sides,
    and the nearer one counts. Raises ValueError if the numbers of frames differ.
    """
    estimated, true = len(estimates.offset_m), len(truth.offset_m)
    if estimated != true:
        raise ValueError(
            f"{estimated} frames of estimates cannot be compared with {true} frames of "
            "truth; the video and its CSV must belong together."
        )

    errors = _errors_against(estimates, truth)
    adjacent = _errors_against(estimates, truth.adjacent())
    adjacent_rms_m = np.nan_to_num(adjacent["near_rms_m"], nan=np.inf)
    is_adjacent = adjacent_rms_m < np.nan_to_num(errors["near_rms_m"], nan=np.inf)
    for name, values in errors.items():
        values[is_adjacent] = adjacent[name][is_adjacent]

    # A system that states no confidence counts as confident.
    is_confident = ~(estimates.confidence < CONFIDENT)
    return FrameErrors(
        exists=truth.exists,
        available=estimates.available,
        confident=estimates.available & is_confident,
        confidence=estimates.confidence,
        time_ms=estimates.time_ms,
        lane_change=truth.lane_change,
        **errors,
        **_normalized_errors(estimates, truth),
    )


def recovery_lengths(correct: np.ndarray) -> list[int]:
    """Lengths of all losses: frames from the first wrong one to the first of
    RECOVERED_FRAMES correct ones in a row.

    A lane that is not correct in the first frame counts as lost there. A loss at the
    end counts up to the last frame.
    """
    lengths = []
    start = None
    for frame, is_correct in enumerate(correct):
        if start is None and not is_correct:
            start = frame
        elif start is not None and correct[frame : frame + RECOVERED_FRAMES].all():
            lengths.append(frame - start)
            start = None
    if start is not None:
        lengths.append(len(correct) - start)
    return lengths


def _errors_against(
    estimates: DriveEstimates, truth: LaneTruth
) -> dict[str, np.ndarray]:
    """The errors that depend on which lane counts as the ego lane."""
    error = line_errors(estimates, truth)
    errors = {
        "lateral_m": np.fmax(error[:, 0], error[:, 1]),
        "near_rms_m": worse_rms(error[..., NEAR]),
        "full_rms_m": worse_rms(error),
    }
    for name in ("offset_m", "heading_rad", "curvature_per_m"):
        difference = getattr(estimates, name) - getattr(truth, name)
        errors[name] = np.where(truth.exists, np.abs(difference), np.nan)
    return errors


def line_errors(estimates: DriveEstimates, truth: LaneTruth) -> np.ndarray:
    """(N, 2, D) distances, metres, of the true points at AHEAD_M from the nearest
    points of the estimated lines.

    NaN where no lane is available, or the true line is not compared. Unlike a
    difference in y, the distance is that to the line, however much the line is slanted,
    and it exists where the estimated line has turned back.
    """
    start = estimates.lines_m[:, :, :-1]
    chord = np.diff(estimates.lines_m, axis=2)
    squared_length = np.maximum((chord**2).sum(axis=-1), 1e-12)
    points_m = np.moveaxis(road_points(AHEAD_M, truth.lines_y_m), 2, 0)

    def distance_m(points: np.ndarray) -> np.ndarray:
        """(N, 2) distances of a point (N, 2, 2) of each line."""
        to_point = points[:, :, None] - start
        share = (to_point * chord).sum(axis=-1) / squared_length
        on_chord = np.clip(share, 0.0, 1.0)[..., None] * chord
        return np.linalg.norm(to_point - on_chord, axis=-1).min(axis=-1)

    distances = np.stack([distance_m(points) for points in points_m], axis=-1)
    compared = truth.compared & estimates.available[:, None, None]
    return np.where(compared, distances, np.nan)


def worse_rms(error: np.ndarray) -> np.ndarray:
    """(N,) from errors (N, 2, K): the larger root mean square of the two lines, NaN
    left out; NaN if all are NaN.
    """
    known = ~np.isnan(error)
    count = known.sum(axis=2)
    square = np.where(known, error, 0.0) ** 2
    mean = square.sum(axis=2) / np.maximum(count, 1)
    rms = np.sqrt(mean)
    left, right = np.where(count > 0, rms, np.nan).T
    return np.fmax(left, right)


def _normalized_errors(
    estimates: DriveEstimates, truth: LaneTruth
) -> dict[str, np.ndarray]:
    """The errors against the ego lane, divided by what the system states."""
    covariance = np.where(truth.exists[:, None, None], estimates.covariance, np.nan)
    differences = [
        getattr(estimates, name) - getattr(truth, name) for name in NUMBERS.values()
    ]
    errors = np.column_stack(differences)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    weighted = np.linalg.solve(covariance, errors[..., None])[..., 0]
    lateral_m = np.where(truth.compared, estimates.lines_y_m - truth.lines_y_m, np.nan)
    return {
        "z": errors / std,
        "lines_z": lateral_m / estimates.lines_std_m,
        "nees": np.einsum("ni,ni->n", errors, weighted) / len(NUMBERS),
    }
