"""Where the car has driven, from what the camera says of the lane: a map without satellites.

The road turns by its curvature for each metre driven, the car points away from it by the heading, and the place follows
by adding up steps in that direction. Every error stays in the sum, so the drift grows: a curvature that is off by 1e-5
per metre throughout puts the map off by 5 m after a kilometre, by 20 m after two.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def integrate_path(rows: Mapping[str, np.ndarray], speed_mps: float | np.ndarray) -> np.ndarray:
    """Add up the driven path.

    Parameters
    ----------
    rows : mapping of str to ndarray of shape (N,)
        Telemetry: time_s, heading_rad, curvature_per_m; NaN where the lane was not known.
    speed_mps : float or ndarray of shape (N,)
        How fast the car drove; the path is as long as this says.

    Returns
    -------
    ndarray of shape (N, 2)
        Metres, x ahead and y to the left of where and how the first known frame points. NaN where the lane was not
        known: the path goes on behind such a gap as if the curvature had changed evenly in it.

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
    # Over a step the car turns evenly: its chord is shorter than the arc by sinc.
    direction, turn = _between(car_rad), np.diff(car_rad)
    chord = step_m * np.sinc(turn / (2 * np.pi))
    steps = chord[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    path = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    return np.where(known[:, None], path - path[known][0], np.nan)


def _between(values: np.ndarray) -> np.ndarray:
    """Means of neighbours."""
    return (values[1:] + values[:-1]) / 2
