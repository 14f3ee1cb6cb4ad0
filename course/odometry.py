"""Visual odometry: the driven path, integrated from curvature and heading of the lane.

The road turns by its curvature per metre driven, the car points away from the road by the heading, and the position is
the sum of steps in that direction. Errors accumulate: a constant curvature error of 1e-5 per metre moves the path by
5 m after one kilometre and by 20 m after two.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def integrate_path(rows: Mapping[str, np.ndarray], speed_mps: float | np.ndarray) -> np.ndarray:
    """Driven path (N, 2), metres, x ahead and y to the left in the frame of the car in the first known frame.

    NaN where the lane was lost; in such gaps curvature and heading are interpolated.

    Parameters
    ----------
    rows : mapping of str to ndarray of shape (N,)
        Telemetry: time_s, heading_rad, curvature_per_m; NaN where the lane was lost.
    speed_mps : float or ndarray of shape (N,)
        Speed of the car, which sets the length of the path.

    Raises
    ------
    ValueError
        If the lane was known in fewer than two frames.
    """
    time_s, curvature, heading = (np.asarray(rows[k], float) for k in ("time_s", "curvature_per_m", "heading_rad"))
    known = np.isfinite(curvature) & np.isfinite(heading)
    if known.sum() < 2:
        raise ValueError(f"the lane was known in {known.sum()} of {len(known)} frames; a path needs at least two.")
    curvature, heading = (np.interp(time_s, time_s[known], values[known]) for values in (curvature, heading))
    step_m = np.diff(time_s) * _between(np.broadcast_to(speed_mps, time_s.shape).astype(float))
    road_rad = np.concatenate([[0.0], np.cumsum(_between(curvature) * step_m)])
    car_rad = road_rad - heading
    car_rad -= car_rad[known][0]
    # over a step the car turns evenly: the chord is shorter than the arc by sinc
    direction, turn = _between(car_rad), np.diff(car_rad)
    chord = step_m * np.sinc(turn / (2 * np.pi))
    steps = chord[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    path = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    return np.where(known[:, None], path - path[known][0], np.nan)


def _between(values: np.ndarray) -> np.ndarray:
    """(N - 1,) means of neighbours."""
    return (values[1:] + values[:-1]) / 2
