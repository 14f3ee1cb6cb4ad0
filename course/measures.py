"""Results of the course against the truth: lateral errors of lanes, precision and recall of marking pixels.

Truth is a frame of truth.json (see course.dataset): points of both lines in the road frame, metres.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from helpers import FourPointWarp
from lanes.camera import Camera

# The range that a driver needs: from the bonnet to about a second ahead on a motorway.
NEAR_M, FAR_M = 5.0, 30.0
# Ends of the steps of a line that have a marking on them, or not.
STEPS_M = np.arange(NEAR_M, FAR_M + 0.1, 0.5)
# Points count up to the first distance outside the lane. A point within the second one of the centre of a line lies on
# it: half the width of a line, and the same again for blur.
MARGIN_M, TOLERANCE_M = 1.0, 0.2


class HasLines(Protocol):
    """A result with two lane lines."""

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; None without both lines."""


def worst_lateral_error_m(result: HasLines | None, truth: dict | None) -> float | None:
    """Largest lateral distance between detected and true lines, 5 to 30 m ahead, metres.

    Infinite if a line was not detected, because one line is no lane. None if both were detected but there is no truth.
    """
    x_m = np.array(truth["x_m"] if truth else [NEAR_M])
    ahead = (x_m >= NEAR_M) & (x_m <= FAR_M)
    detected = result and result.lateral_m(x_m[ahead])
    if detected is None:
        return np.inf
    if truth is None:
        return None
    true = np.array([truth["left_y_m"], truth["right_y_m"]])[:, ahead]
    return float(np.abs(detected - true).max())


def lane_widths_px(warp: FourPointWarp, camera: Camera, lines_m: ArrayLike, x_m: ArrayLike) -> np.ndarray:
    """Width (N,), in columns of the bird's-eye view, of a straight lane at distances (N,), metres.

    It is negative where the view is mirrored.

    Parameters
    ----------
    lines_m : array_like of shape (2, 2)
        Lateral position at the car, metres, and heading, of the left and the right line.
    """
    x = np.asarray(x_m, float)
    lines = (np.column_stack([x, c0 + heading * x]) for c0, heading in np.asarray(lines_m, float))
    left, right = (warp.points_to_birdseye(camera.undistort_points(camera.road_to_pixels(line))) for line in lines)
    return right[:, 0] - left[:, 0]


class ComparedMarkings(NamedTuple):
    """N points compared with S steps of the true lines of the ego lane.

    Whether a point counts for the precision (N,), and lies on the left or the right line (2, N); whether a step of
    these lines has a point on it (2, S).
    """

    counted: np.ndarray
    on_line: np.ndarray
    covered: np.ndarray


def compare_markings(points_m: np.ndarray, truth: dict) -> ComparedMarkings:
    """Compare marking points (N, 2) with the truth; see `marking_precision` and `marking_recall`."""
    x, y = np.asarray(points_m, float).reshape(-1, 2).T
    left, right = lines = np.array([np.interp(x, truth["x_m"], truth[key]) for key in ("left_y_m", "right_y_m")])
    counted = (x >= NEAR_M) & (x <= FAR_M) & (y < left + MARGIN_M) & (y > right - MARGIN_M)
    on_line: np.ndarray = np.abs(y - lines) <= TOLERANCE_M
    return ComparedMarkings(counted, on_line, np.array([np.histogram(x[on], STEPS_M)[0] > 0 for on in on_line]))


def marking_precision(points_m: np.ndarray, truth: dict | None) -> float | None:
    """Precision of marking points: the share of them that lies on a line of the ego lane, in range 0..1.

    The points (N, 2) 5 to 30 m ahead (x forward, y left, metres) count, in the ego lane and up to 1 m outside it. A
    point lies on a line if it is within 0.2 m of its centre. None without truth, which is a frame of truth.json, or
    without any point in that range.
    """
    if truth is None:
        return None
    compared = compare_markings(points_m, truth)
    on_line = compared.on_line[:, compared.counted].any(axis=0)
    return float(on_line.mean()) if on_line.size else None


def marking_recall(points_m: np.ndarray, truth: dict | None) -> float | None:
    """Recall of marking points: the share of both lines, 5 to 30 m ahead, with a point on it; None without truth.

    The lines are divided into steps of half a metre. Gaps of a dashed line count as well, so its recall cannot exceed
    the share of its dashes unless noise fills the gaps.
    """
    return None if truth is None else float(compare_markings(points_m, truth).covered.mean())


def describe_error(error_m: float | None) -> str:
    """An error in words: "0.12 m", "lost" if infinite (no lane), "unknown" if None (no truth)."""
    if error_m is None:
        return "unknown"
    return f"{error_m:.2f} m" if np.isfinite(error_m) else "lost"


def check(name: str, measured: float, truth: float | None, unit: str, *, within: float, digits: int = 2) -> str:
    """Compare a number with the truth: "offset: 0.12 m, truth 0.10 m, off by 0.02 m (allowed 0.05 m)".

    The difference may be `within` at most, in `unit`; `truth` is None if unknown, as for real pictures. `digits` are
    the decimals printed.

    Raises
    ------
    AssertionError
        If the difference to a known truth is larger than `within`.
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


def check_error(name: str, error: float | None, unit: str, *, within: float, digits: int = 1) -> str:
    """Compare an error with the largest one allowed: "paint, median: error 0.1 px (allowed 1 px)".

    `error` is None if no truth is known, as for real pictures. `digits` are the decimals printed.

    Raises
    ------
    AssertionError
        If the error is larger than `within`.
    """
    if error is None:
        return f"{name}: error not known (no truth for these pictures)"
    sentence = f"{name}: error {error:.{digits}f} {unit} (allowed {within:g} {unit})"
    if not error <= within:
        raise AssertionError(sentence)
    return sentence
