"""How wrong a system is in each frame of a drive whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from benchmark.estimates import AT_M, Readings
from lanes.camera.camera import Camera
from lanes.tracking.confidence import RIGHT_M

# Where a driver needs the lane most: from the bonnet to a second ahead in town; the near part of AT_M.
NEAR = AT_M <= 20.0
# While the car's middle is this close to a line, that line may be called the left or the right one of the lane.
CHANGING_M = 0.4
# A line that runs across the car's way at this angle or more is not judged any farther: in a hairpin its place at a
# given x says little, and ends where the line turns back.
MOST_ACROSS_RAD = np.radians(60)
# From this confidence on a lane that is wrong is confidently wrong.
CONFIDENT = 0.9
# A lane that was lost or wrong is back when it is right in so many frames in a row.
SETTLED = 3


@dataclass(frozen=True, eq=False)
class LaneTruth:
    """The true lane in N frames; NaN where there is none, and where the road does not reach so far.

    Parameters
    ----------
    lines_y_m : ndarray of shape (N, 2, D)
        Lateral places of the left and right line at AT_M.
    beside_y_m : ndarray of shape (N, 2)
        The same beside the car.
    offset_m, heading_rad, curvature_per_m, width_m : ndarray of shape (N,)
    """

    lines_y_m: np.ndarray
    beside_y_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    width_m: np.ndarray

    @classmethod
    def of(cls, columns: Mapping[str, np.ndarray]) -> LaneTruth:
        """From the columns of a drive's CSV."""
        lines = [[columns[f"{side}_y{x:02.0f}_m"] for x in AT_M] for side in ("left", "right")]
        beside = [columns[f"{side}_c0_m"] for side in ("left", "right")]
        return cls(
            np.moveaxis(np.array(lines, float), 2, 0),
            np.array(beside, float).T,
            *(np.asarray(columns[n], float) for n in ("offset_m", "heading_rad", "curvature_per_m", "lane_width_m")),
        )

    @property
    def exists(self) -> np.ndarray:
        """(N,) bool: frames with a lane."""
        return np.isfinite(self.lines_y_m[:, :, 0]).all(axis=1)

    @property
    def across(self) -> np.ndarray:
        """(N, 2, D): distance across a line for each metre of y beside it; NaN from MOST_ACROSS_RAD on.

        The cosine of the line's direction. That of the flatter of the two chords to its next points is taken, so that
        no error comes out smaller than it is.
        """
        places = np.concatenate([self.beside_y_m[..., None], self.lines_y_m], axis=2)
        chords = np.abs(np.diff(places, axis=2) / np.diff(AT_M, prepend=0.0))
        slope = np.fmin(chords, np.concatenate([chords[..., 1:], chords[..., -1:]], axis=2))
        return np.where(slope < np.tan(MOST_ACROSS_RAD), 1 / np.hypot(1, slope), np.nan)

    def in_picture(self, camera: Camera | None) -> np.ndarray:
        """(N, 2, D) bool: the line is in the camera's picture at AT_M, hidden or not; everywhere without camera."""
        if camera is None:
            return np.ones(self.lines_y_m.shape, bool)
        places = np.stack([np.broadcast_to(AT_M, self.lines_y_m.shape), self.lines_y_m], axis=-1)
        # neither bumps nor hills move a place across the picture by much: the flat road's column will do
        column = camera.road_to_pixels(places.reshape(-1, 2))[:, 0].reshape(self.lines_y_m.shape)
        return (column >= 0) & (column <= camera.width - 1)

    def cut(self, frames: slice) -> LaneTruth:
        """The truth of some of the frames."""
        return LaneTruth(**{field.name: getattr(self, field.name)[frames] for field in fields(self)})

    def beside(self) -> LaneTruth:
        """The lane on the other side of the line that the car is on, where it is; elsewhere the same lane.

        Its far line is put as far beyond the shared one as this lane is wide, which is exact for parallel lines on a
        straight road and good to a millimetre on one of 400 m radius.
        """
        left_near, right_near = (np.abs(self.beside_y_m) < CHANGING_M).T
        step = np.where(left_near, 1.0, np.where(right_near, -1.0, 0.0))
        # In a hairpin one line may reach farther than the other: what is not known of that one is no matter elsewhere.
        across = np.where(step[:, None, None] == 0, 0.0, self.lines_y_m[:, :1] - self.lines_y_m[:, 1:])
        return replace(
            self,
            lines_y_m=self.lines_y_m + step[:, None, None] * across,
            offset_m=self.offset_m - step * self.width_m,
            # a curve beside another one, of the same centre
            curvature_per_m=self.curvature_per_m / (1 - step * self.width_m * self.curvature_per_m),
        )


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors of N frames; NaN where no lane is given, none is there, or the road does not reach so far.

    Parameters
    ----------
    exists, given : ndarray of shape (N,), bool
        Whether there is a lane, and whether the system gives one.
    confident : ndarray of shape (N,), bool
        A lane is given, with a confidence of CONFIDENT or more, or by a system that states none.
    lateral_m : ndarray of shape (N, D)
        Distance between found and true line at AT_M, square to the true one, of the line that is farther off there.
    near_m, far_m : ndarray of shape (N,)
        Root mean square of a line's lateral errors, of the worse line: over 5 to 20 m, and over 5 to 30 m, which is
        what the confidence speaks of. Infinite where the found line has turned back before the true one.
    in_picture_m : ndarray of shape (N,)
        As `near_m`, over those places that are in the picture: in a hairpin the inner line leaves it at its side.
    offset_m, heading_rad, curvature_per_m : ndarray of shape (N,)
        Absolute errors.
    confidence, time_ms : ndarray of shape (N,)
    """

    exists: np.ndarray
    given: np.ndarray
    confident: np.ndarray
    lateral_m: np.ndarray
    near_m: np.ndarray
    far_m: np.ndarray
    in_picture_m: np.ndarray
    offset_m: np.ndarray
    heading_rad: np.ndarray
    curvature_per_m: np.ndarray
    confidence: np.ndarray
    time_ms: np.ndarray

    @property
    def right(self) -> np.ndarray:
        """(N,) bool: a lane is there and given, and both lines are within RIGHT_M of it over 5 to 20 m."""
        return self.exists & self.given & (self.near_m <= RIGHT_M)

    @property
    def right_in_picture(self) -> np.ndarray:
        """(N,) bool: as `right`, judged only where the lines are in the picture."""
        return self.exists & self.given & ~(self.in_picture_m > RIGHT_M)

    @property
    def confidently_wrong(self) -> np.ndarray:
        """(N,) bool: a lane is given confidently where it is not right."""
        return self.confident & ~self.right


def frame_errors(readings: Readings, truth: LaneTruth, camera: Camera | None = None) -> FrameErrors:
    """Hold what a system says against the truth, frame by frame.

    Where the car is on a line, the lane on either side of it will do: the one that the lines found are nearer to.
    The camera, with its pose, tells what is in the picture; without one, all is.

    Raises
    ------
    ValueError
        If the two are not of the same number of frames.
    """
    if len(readings.offset_m) != len(truth.offset_m):
        raise ValueError(
            f"a system's {len(readings.offset_m)} frames cannot be held against a truth of {len(truth.offset_m)}; "
            "the video and the CSV beside it must belong together."
        )
    named, other = (_errors_of(readings, lane, camera) for lane in (truth, truth.beside()))
    swap = np.nan_to_num(other["near_m"], nan=np.inf) < np.nan_to_num(named["near_m"], nan=np.inf)
    chosen = {name: np.where(swap[(...,) + (None,) * (e.ndim - 1)], other[name], e) for name, e in named.items()}
    confident = readings.given & ~(readings.confidence < CONFIDENT)
    return FrameErrors(
        truth.exists, readings.given, confident, **chosen, confidence=readings.confidence, time_ms=readings.time_ms
    )


def recoveries(right: np.ndarray) -> list[int]:
    """How long each loss lasted: frames from the first one not right to the first of SETTLED right ones in a row.

    A lane that is not right at the beginning counts as lost there; a loss that lasts to the end counts with the frames
    there are.
    """
    lengths, at = [], 0
    while at < len(right):
        start = at
        while not right[at : at + (1 if at == start else SETTLED)].all():
            at += 1
        if at > start:
            lengths.append(at - start)
        at += 1
    return lengths


def _errors_of(readings: Readings, truth: LaneTruth, camera: Camera | None) -> dict[str, np.ndarray]:
    """The errors that depend on how the lines are named."""
    error = np.abs(readings.lines_y_m - truth.lines_y_m) * truth.across
    judged = readings.given[:, None, None] & np.isfinite(truth.across)
    error = np.where(judged, np.where(np.isnan(error), np.inf, error), np.nan)
    errors = {
        "lateral_m": np.fmax(error[:, 0], error[:, 1]),
        "near_m": _worse_rms(error[..., NEAR]),
        "far_m": _worse_rms(error),
        "in_picture_m": _worse_rms(np.where(truth.in_picture(camera), error, np.nan)[..., NEAR]),
    }
    for name in ("offset_m", "heading_rad", "curvature_per_m"):
        errors[name] = np.where(truth.exists, np.abs(getattr(readings, name) - getattr(truth, name)), np.nan)
    return errors


def _worse_rms(error: np.ndarray) -> np.ndarray:
    """(N,) from errors (N, 2, K): the larger of both lines' root mean squares over what is known; NaN if nothing is."""
    known = ~np.isnan(error)
    count = known.sum(axis=2)
    square = np.where(known, error, 0.0) ** 2
    rms = np.sqrt(square.sum(axis=2) / np.maximum(count, 1))
    left, right = np.where(count > 0, rms, np.nan).T
    return np.fmax(left, right)
