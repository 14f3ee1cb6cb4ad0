"""Sky of the backdrop: style, geometry of the panorama, sky gradient, clouds and aerial perspective.

Directions are unit vectors in the world frame (x along the start of the road, y left, z up). The panorama is an
equal-area cylindrical projection: columns are azimuths, rows are z components of the direction. A lookup therefore
costs one arc tangent and one remap.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from simulator.painting.brush import Atmosphere
from simulator.painting.noise import fractal_noise, smoothstep

# 1304 px/rad, a little finer than the 1160 px/rad of a 63 degree wide picture of 1280 columns.
PANORAMA_COLUMNS = 8192
PIXELS_PER_RAD = PANORAMA_COLUMNS / (2 * np.pi)
Z_TOP, Z_BOTTOM = 0.64, -0.06
PANORAMA_ROWS = round((Z_TOP - Z_BOTTOM) * PIXELS_PER_RAD)
HORIZON_ROW = Z_TOP * PIXELS_PER_RAD

# Linear RGB radiance of a dry summer sky (sunlit white paint is 1): at the zenith, the addition at the horizon, and its
# decay with z. Red decays fastest, so the sky is blue above.
ZENITH = np.array([0.020, 0.120, 0.380], np.float32)
HORIZON_GLOW = np.array([0.43, 0.47, 0.32], np.float32)
GLOW_FALL = np.array([5.0, 3.1, 1.9], np.float32)
# Airlight of infinite distance: the sky just above the horizon, a little darker and bluer.
HAZE_COLOUR = (ZENITH + HORIZON_GLOW) * np.array([0.62, 0.72, 0.90], np.float32)


@dataclass(frozen=True)
class BackdropStyle:
    """Style of sky and landscape.

    `cloud_cover` is the share of the sky covered by cumulus clouds. `hill_height_rad` and `ridge_height_rad` are
    typical elevations of the near hills and of the far wooded ridge. `greenness` is the colour of the grass from dry
    gold (0) to spring green (1), `tree_density` that of the woods from bare (0) to closed (1). `haze_per_km` is the
    extinction of the air; 0.06 is a clear day, 0.4 a hazy one. The sun's position is in the world frame (azimuth > 0 is
    left of the road's first heading).

    Raises
    ------
    ValueError
        If a value is outside its range.
    """

    cloud_cover: float = 0.0
    hill_height_rad: float = 0.060
    ridge_height_rad: float = 0.062
    greenness: float = 0.0
    tree_density: float = 0.5
    haze_per_km: float = 0.06
    sun_azimuth_rad: float = 0.9
    sun_elevation_rad: float = 0.9

    def __post_init__(self) -> None:
        for name in ("cloud_cover", "greenness", "tree_density"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} is a share from 0 to 1, not {getattr(self, name)}.")
        if not 0 < self.sun_elevation_rad <= np.pi / 2:
            raise ValueError(f"the sun must be above the horizon, not at {self.sun_elevation_rad} rad.")
        if self.haze_per_km < 0:
            raise ValueError(f"haze_per_km is an extinction, 0 or more, not {self.haze_per_km}.")

    def sun_direction(self) -> np.ndarray:
        """Unit vector (3,) towards the sun in the world frame."""
        level = np.cos(self.sun_elevation_rad)
        x, y = level * np.cos(self.sun_azimuth_rad), level * np.sin(self.sun_azimuth_rad)
        return np.array([x, y, np.sin(self.sun_elevation_rad)])


def aerial_perspective(distance_m: np.ndarray | float, haze_per_km: float) -> Atmosphere:
    """Attenuation and airlight for objects at distances of any shape; both get one more axis (3,) for RGB.

    `haze_per_km` is the extinction in 1/km. Koschmieder's law of contrast; blue is scattered most.
    """
    extinction = haze_per_km / 1000 * np.array([0.8, 1.0, 1.3], np.float32)
    transmittance = np.exp(-np.multiply.outer(np.asarray(distance_m, np.float32), extinction))
    return Atmosphere(transmittance, HAZE_COLOUR * (1 - transmittance))


def column_azimuths() -> np.ndarray:
    """Azimuth in radians of each column of the panorama."""
    return (np.arange(PANORAMA_COLUMNS, dtype=np.float32) + 0.5) / np.float32(PIXELS_PER_RAD)


def row_z() -> np.ndarray:
    """z component of the direction of each row of the panorama."""
    return (Z_TOP - (np.arange(PANORAMA_ROWS, dtype=np.float32) + 0.5) / PIXELS_PER_RAD).astype(np.float32)


def paint_sky(style: BackdropStyle) -> np.ndarray:
    """Clear sky (PANORAMA_ROWS, PANORAMA_COLUMNS, 3): vertical gradient, and the brightening towards the sun."""
    coarse = 4
    z = cv2.resize(row_z()[:, None], (1, PANORAMA_ROWS // coarse), interpolation=cv2.INTER_AREA).ravel()
    azimuth = column_azimuths().reshape(-1, coarse).mean(axis=1)
    gradient = ZENITH + HORIZON_GLOW * np.exp(-GLOW_FALL * np.maximum(z, 0)[:, None])
    sun = style.sun_direction().astype(np.float32)
    facing = np.cos(azimuth - style.sun_azimuth_rad) * np.hypot(sun[0], sun[1])
    away = 1 - (np.sqrt(1 - z * z)[:, None] * facing[None, :] + z[:, None] * sun[2])[..., None]
    # Aureole (forward scattering), weak brightening of the sun's side, and haze that whitens both.
    glow = 0.30 * np.exp(-away / 0.05) + (0.05 + 0.35 * style.haze_per_km) * np.exp(-away / 0.5)
    sky = gradient[:, None, :] * (1.06 - 0.06 * away) + glow * np.array([0.85, 0.97, 1.0], np.float32)
    return cv2.resize(sky.astype(np.float32), (PANORAMA_COLUMNS, PANORAMA_ROWS), interpolation=cv2.INTER_LINEAR)


def paint_clouds(panorama: np.ndarray, style: BackdropStyle, rng: np.random.Generator) -> None:
    """Paint cumulus clouds into a panorama (3, PANORAMA_ROWS, PANORAMA_COLUMNS), in place.

    The clouds are noise on a flat layer in perspective, so they get smaller towards the horizon.
    """
    size, coarse = 2048, 2
    noise = fractal_noise((size, size), rng, cell_px=(420, 420), octaves=8, gain=0.55)
    rows = int(HORIZON_ROW) // coarse
    z = np.maximum(row_z()[: rows * coarse : coarse], 0.004)[:, None]
    # The exponent is 1 for thin clouds; a smaller one gives them the height of cumulus.
    reach = 330 * np.sqrt(1 - z * z) / (z + 0.06) ** 0.55
    azimuth = column_azimuths()[::coarse]
    map_x = (reach * np.cos(azimuth) + size / 2).astype(np.float32)
    map_y = (reach * np.sin(azimuth) + size / 2).astype(np.float32)
    density = cv2.remap(noise, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    # Tops, with less cloud above them, are lit. Bases are grey.
    lit = density - np.roll(cv2.GaussianBlur(density, (0, 0), 5), 12, axis=0)
    edge = np.float32(np.quantile(density[::8, ::8], 1 - style.cloud_cover))
    cover = smoothstep(edge - 0.08, edge + 0.40, density)
    thick = smoothstep(edge + 0.1, edge + 1.7, cv2.GaussianBlur(density, (0, 0), 3))
    brightness = np.clip(0.84 - 0.46 * thick + 0.22 * lit, 0.26, 1.05)
    cover *= np.exp(-0.012 / z)
    size_px = (PANORAMA_COLUMNS, rows * coarse)
    clear = 1 - cv2.resize(cover, size_px, interpolation=cv2.INTER_LINEAR)
    for plane, bright, dark in zip(panorama[:, : rows * coarse], (1.0, 1.0, 1.01), (0.03, 0.05, 0.09), strict=True):
        colour = brightness * np.float32(bright) + (1 - brightness) * np.float32(dark)
        plane *= clear
        plane += cv2.resize(colour * cover, size_px, interpolation=cv2.INTER_LINEAR)
