"""Backdrop: rotation with the car, seam of the panorama, clouds."""

import numpy as np

from simulator.backdrop import BackdropStyle, paint_backdrop

STYLE = BackdropStyle(tree_density=0.15)


def look(azimuth_rad: float, *, rows: int = 90, columns: int = 160, half_rad: float = 0.5) -> np.ndarray:
    """Directions of an image without distortion, centred at `azimuth_rad`, at elevations from -3 to +22 degrees."""
    across = azimuth_rad + np.linspace(half_rad, -half_rad, columns)[None, :]
    up = np.radians(np.linspace(22, -3, rows))[:, None]
    directions = np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up) + 0 * across
    return np.stack(directions).astype(np.float32)


def test_a_turn_by_40_columns_shifts_the_landscape_by_40_columns():
    ahead, turned = (paint_backdrop(look(0.2 - columns / 159), STYLE, seed=1) for columns in (0, 40))
    assert ahead.dtype == np.float32 and np.isfinite(ahead).all() and ahead.min() >= 0
    np.testing.assert_allclose(ahead[:, 40:], turned[:, :-40], atol=0.02)
    assert np.abs(ahead - turned)[60:].mean() > 0.01
