"""Results against truth: how far a found lane is from the true one, and how much of a binary is paint.

Truth is a frame of truth.json (see benchmark.dataset): points of both lines in the road frame, metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from lanes.camera.camera import Camera
from lanes.classic.result import LaneResult
from lanes.classic.search import binary_pixels
from lanes.classic.warp import view_to_road

# Where a driver needs the lane: from the bonnet to about a second ahead on a motorway.
NEAR_M, VOTING_FAR_M = 5.0, 30.0
# The distances in that range at which a drive's truth is written down.
DRIVE_X_M = (5, 10, 15, 20, 30)


class HasLines(Protocol):
    """Any result that can say where its two lines are."""

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral places (2, N) of the left and right line at distances (N,), metres; None if not both are known."""


def worst_lateral_error_m(result: HasLines | None, truth: dict | None) -> float | None:
    """Largest lateral distance between found and true lines, 5 to 30 m ahead, metres.

    Infinite where a line was not found: a lane that is lost is not half right. None where one was found and no truth
    is known.
    """
    x_m = np.array(truth["x_m"] if truth else [NEAR_M])
    ahead = (x_m >= NEAR_M) & (x_m <= VOTING_FAR_M)
    found = result and result.lateral_m(x_m[ahead])
    if found is None:
        return np.inf
    if truth is None:
        return None
    true = np.array([truth["left_y_m"], truth["right_y_m"]])[:, ahead]
    return float(np.abs(found - true).max())


def drive_errors_m(rows: Mapping[str, np.ndarray], truth: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest lateral distance between found and true lines in each frame of a drive, 5 to 30 m ahead.

    Parameters
    ----------
    rows : mapping of str to ndarray of shape (N,)
        Telemetry: left_c0_m, left_c1, left_c2_per_m, where known left_c3_per_m2, and the same for right.
    truth : mapping of str to ndarray of shape (M,), M >= N
        The drive's truth: left_y05_m, left_y10_m ... at these distances ahead.

    Returns
    -------
    ndarray of shape (N,)
        Metres; infinite where a line is not known.
    """
    worst = np.zeros(len(rows["left_c0_m"]))
    for side in ("left", "right"):
        c = [rows[f"{side}_{name}"] for name in ("c0_m", "c1", "c2_per_m")]
        c.append(rows.get(f"{side}_c3_per_m2", np.zeros_like(worst)))
        for x_m in DRIVE_X_M:
            found = c[0] + c[1] * x_m + c[2] * x_m**2 / 2 + c[3] * x_m**3 / 6
            worst = np.maximum(worst, np.abs(found - truth[f"{side}_y{x_m:02d}_m"][: len(worst)]))
    return np.where(np.isnan(worst), np.inf, worst)


def binary_on_road(result: LaneResult, camera: Camera) -> np.ndarray:
    """Road points (N, 2), metres, of the set pixels of a classic result's binary."""
    return view_to_road(binary_pixels(result.steps.warped_binary), result.warp, camera)


def paint_share(
    points_m: np.ndarray, truth: dict | None, *, beside_m: float = 1.0, paint_m: float = 0.2
) -> float | None:
    """Share of the points taken for paint that lie on the paint of the own lane.

    Counted are the points from 5 to 30 m ahead in the own lane and `beside_m` to each side of it; right are those
    within `paint_m` of the centre of a line (half a painted line, and as much again for blur).

    Parameters
    ----------
    points_m : ndarray of shape (N, 2)
        x forward, y left, metres.
    truth : dict or None
        A frame of truth.json.

    Returns
    -------
    float or None
        In range 0..1; None where no truth is known or no point is counted.
    """
    if truth is None:
        return None
    x, y = np.asarray(points_m, float).reshape(-1, 2).T
    left, right = (np.interp(x, truth["x_m"], truth[key]) for key in ("left_y_m", "right_y_m"))
    counted = (x >= NEAR_M) & (x <= VOTING_FAR_M) & (y < left + beside_m) & (y > right - beside_m)
    if not counted.any():
        return None
    on_paint = np.minimum(np.abs(y - left), np.abs(y - right)) <= paint_m
    return float(on_paint[counted].mean())


def line_coverage(points_m: np.ndarray, truth: dict | None, *, paint_m: float = 0.2) -> float | None:
    """Share of both lines, 5 to 30 m ahead, beside which a point taken for paint lies; None without truth.

    Looked at is every half metre, whether painted or a gap: a dashed line counts at most with its dashes.
    """
    if truth is None:
        return None
    x, y = np.asarray(points_m, float).reshape(-1, 2).T
    edges = np.arange(NEAR_M, VOTING_FAR_M + 0.1, 0.5)
    covered = []
    for key in ("left_y_m", "right_y_m"):
        on_line = np.abs(y - np.interp(x, truth["x_m"], truth[key])) <= paint_m
        covered.append(np.histogram(x[on_line], edges)[0] > 0)
    return float(np.mean(covered))


def describe_error(error_m: float | None) -> str:
    """Words for an error: "0.12 m", "lost" where nothing was found, "unknown" where there is no truth."""
    if error_m is None:
        return "unknown"
    return f"{error_m:.2f} m" if np.isfinite(error_m) else "lost"


def check(name: str, measured: float, truth: float | None, unit: str, *, within: float, digits: int = 2) -> str:
    """Hold a number against the truth and put the outcome in words.

    Parameters
    ----------
    name, unit : str
        For the sentence.
    measured : float
    truth : float or None
        None where it is not known, as in real pictures.
    within : float
        The difference that counts as right, in `unit`.
    digits : int
        Decimals printed.

    Returns
    -------
    str
        "offset: 0.12 m, truth 0.10 m, off by 0.02 m (allowed 0.05 m)"

    Raises
    ------
    AssertionError
        If the truth is known and missed by more than `within`: a check that cannot fail would be none.
    """
    if truth is None:
        return f"{name}: {measured:.{digits}f} {unit} (no truth known for these pictures)"
    error = abs(measured - truth)
    sentence = (
        f"{name}: {measured:.{digits}f} {unit}, truth {truth:.{digits}f} {unit}, "
        f"off by {error:.{digits}f} {unit} (allowed {within:g} {unit})"
    )
    if not error <= within:
        raise AssertionError(sentence)
    return sentence
