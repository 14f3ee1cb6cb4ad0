"""Are the stated uncertainties true? Errors in units of their standard deviations, and NEES.

z = error / stated standard deviation has a root mean square of 1, and 68 and 95 % of its values lie within 1 and 2, if
the errors are normal and their covariance is as stated. NEES, the normalized estimation error squared e^T P^-1 e of the
errors e and their covariance P, also checks the correlations; divided by the number of errors its mean is 1 (Y.
Bar-Shalom et al., "Estimation with applications to tracking and navigation", 2001, section 5.4).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmark.errors import LANE_CHANGE_M, NEAR, LaneTruth, line_errors, worse_rms
from benchmark.estimates import AHEAD_M, DriveEstimates

# The numbers of the stated covariance, and all whose z is reported.
NUMBERS = ("offset", "heading", "curvature", "width")
QUANTITIES = (*NUMBERS, *(f"lateral_{x:.0f}m" for x in AHEAD_M))
# With a larger error of a line, over 5 to 20 m, another lane was found. Its uncertainty is that of another lane, too.
OTHER_LANE_M = 1.0


@dataclass(frozen=True, eq=False)
class NormalizedErrors:
    """Errors of M frames in units of the stated standard deviations.

    `z` (M, 4) are those of `NUMBERS`, `lines_z` (M, 2, D) those of the lateral positions at AHEAD_M, NaN where a line
    has ended; `nees` (M,) is divided by 4. Two kinds of frames are left out and counted: in `lane_change_frames` the
    car is within 0.4 m of a line, and either adjacent lane counts as the ego lane; in `other_lane_frames` another lane
    was found.
    """

    z: np.ndarray
    lines_z: np.ndarray
    nees: np.ndarray
    lane_change_frames: int
    other_lane_frames: int

    @classmethod
    def joined(cls, drives: Sequence[NormalizedErrors]) -> NormalizedErrors:
        """The frames of all drives."""
        return cls(
            np.concatenate([drive.z for drive in drives]),
            np.concatenate([drive.lines_z for drive in drives]),
            np.concatenate([drive.nees for drive in drives]),
            sum(drive.lane_change_frames for drive in drives),
            sum(drive.other_lane_frames for drive in drives),
        )

    def of(self, quantity: str) -> np.ndarray:
        """The finite z of one of `QUANTITIES`; those of both lines for a lateral position."""
        number = QUANTITIES.index(quantity)
        z = self.z[:, number] if number < len(NUMBERS) else self.lines_z[:, :, number - len(NUMBERS)].ravel()
        return z[np.isfinite(z)]


def normalize_errors(estimates: DriveEstimates, truth: LaneTruth) -> NormalizedErrors | None:
    """Errors of the estimates, divided by what the system states, against the truth of the same N frames.

    None if the system states no covariance in any frame with a true lane.
    """
    compared = np.isfinite(estimates.covariance).all(axis=(1, 2)) & truth.exists
    if not compared.any():
        return None
    change = (np.abs(truth.at_car_y_m) < LANE_CHANGE_M).any(axis=1)
    lateral = np.where(truth.compared, estimates.lines_y_m - truth.lines_y_m, np.nan)
    other = worse_rms(line_errors(estimates, truth)[..., NEAR]) > OTHER_LANE_M
    used = compared & ~change & ~other
    errors = np.column_stack([_of(estimates, name) - _of(truth, name) for name in NUMBERS])[used]
    covariance = estimates.covariance[used]
    return NormalizedErrors(
        errors / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        lateral[used] / estimates.lines_std_m[used],
        np.einsum("ni,ni->n", errors, np.linalg.solve(covariance, errors[..., None])[..., 0]) / len(NUMBERS),
        int((compared & change).sum()),
        int((compared & ~change & other).sum()),
    )


def _of(lanes: DriveEstimates | LaneTruth, name: str) -> np.ndarray:
    """(N,) values of one of `NUMBERS`."""
    units = {"heading": "rad", "curvature": "per_m"}
    return getattr(lanes, f"{name}_{units.get(name, 'm')}")


def z_summary(z: np.ndarray) -> dict[str, float]:
    """Root mean square of z, and its shares within 1 and 2; NaN without any z."""
    if not len(z):
        return dict.fromkeys(("z_rms", "within_1", "within_2"), float("nan"))
    shares = {f"within_{k}": float(np.mean(np.abs(z) <= k)) for k in (1, 2)}
    return {"z_rms": float(np.sqrt(np.mean(z**2)))} | shares


def consistency(drives: Iterable[NormalizedErrors]) -> dict[str, float]:
    """Numbers of frames, mean and median NEES / 4, and `z_summary` of each quantity, over the frames of some drives."""
    some = NormalizedErrors.joined(list(drives))
    row = {
        "frames": float(len(some.nees)),
        "lane_change_frames": float(some.lane_change_frames),
        "other_lane_frames": float(some.other_lane_frames),
        "nees_mean": float(some.nees.mean()) if len(some.nees) else float("nan"),
        "nees_median": float(np.median(some.nees)) if len(some.nees) else float("nan"),
    }
    for quantity in QUANTITIES:
        row |= {f"{quantity}_{name}": value for name, value in z_summary(some.of(quantity)).items()}
    return row
