"""Backdrop: sky, clouds, hills and woods, painted once as a panorama.

The backdrop is at infinity: it moves in the image when the car turns, not when it drives. Directions are unit vectors
in the world frame (x along the start of the road, y left, z up). The panorama is an equal-area cylindrical projection:
columns are azimuths, rows are z components of the direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from simulator.painting import Atmosphere, blend, fractal_noise, smoothstep

# Half the resolution of a dashcam: the backdrop has no detail that matters.
COLUMNS = 4096
PIXELS_PER_RAD = COLUMNS / (2 * np.pi)
Z_TOP, Z_BOTTOM = 0.64, -0.06
ROWS = round((Z_TOP - Z_BOTTOM) * PIXELS_PER_RAD)
AZIMUTH_RAD = ((np.arange(COLUMNS) + 0.5) / PIXELS_PER_RAD).astype(np.float32)
Z = (Z_TOP - (np.arange(ROWS) + 0.5) / PIXELS_PER_RAD).astype(np.float32)[:, None]

# Linear RGB radiance of a dry summer sky (sunlit white paint is 1): at the zenith, the addition at the horizon, and its
# decay with z. Red decays fastest, so the sky is blue above.
ZENITH = np.array([0.020, 0.120, 0.380], np.float32)
HORIZON_GLOW = np.array([0.43, 0.47, 0.32], np.float32)
GLOW_FALL = np.array([5.0, 3.1, 1.9], np.float32)
# Airlight of infinite distance: the sky just above the horizon, a little darker and bluer.
HAZE_COLOUR = (ZENITH + HORIZON_GLOW) * np.array([0.62, 0.72, 0.90], np.float32)
# Reflectance in the sun: dry grass, spring grass, scrub, and woods.
GRASS, GREEN_GRASS = (
    np.array([0.28, 0.19, 0.10], np.float32),
    np.array([0.14, 0.16, 0.05], np.float32),
)
SCRUB, WOOD = (
    np.array([0.050, 0.050, 0.022], np.float32),
    np.array([0.035, 0.042, 0.020], np.float32),
)
# Layers from far to near: distance in km, height relative to the style's ridge or hills, size of the hills in radians.
RIDGES = ((14.0, 1.0, 0.45), (7.0, 0.72, 0.45))
HILLS = ((4.0, 0.62, 0.38), (1.6, 0.75, 0.45), (0.7, 1.0, 0.54))
# Trees on the plain: distance in km, and height as an angle.
WOODS = ((1.0, 0.012), (0.5, 0.026))


@dataclass(frozen=True)
class BackdropStyle:
    """Style of sky and landscape.

    `cloud_cover` is the share of the sky covered by cumulus clouds. `hill_height_rad` and `ridge_height_rad` are
    typical elevations of the near hills and of the far wooded ridge. `greenness` is the colour of the grass from dry
    gold (0) to spring green (1), `tree_density` that of the woods from bare (0) to closed (1). `haze_per_km` is the
    extinction of the air; 0.06 is a clear day, 0.4 a hazy one. The sun's position is in the world frame (azimuth > 0 is
    left of the road's first heading).
    """

    cloud_cover: float = 0.0
    hill_height_rad: float = 0.060
    ridge_height_rad: float = 0.062
    greenness: float = 0.0
    tree_density: float = 0.5
    haze_per_km: float = 0.06
    sun_azimuth_rad: float = 0.9
    sun_elevation_rad: float = 0.9


def aerial_perspective(distance_m: float, haze_per_km: float) -> Atmosphere:
    """Attenuation and airlight (3,) in front of objects; `haze_per_km` is the extinction in 1/km.

    Koschmieder's law of contrast; blue is scattered most.
    """
    transmittance = np.exp(
        -np.float32(distance_m * haze_per_km / 1000)
        * np.array([0.8, 1.0, 1.3], np.float32)
    )
    return Atmosphere(transmittance, HAZE_COLOUR * (1 - transmittance))


def paint_backdrop(
    directions: Sequence[np.ndarray], style: BackdropStyle, *, seed: int = 0
) -> np.ndarray:
    """Radiance (H, W, 3) of the backdrop in each direction, linear float32 RGB; 1 is white paint in the sun.

    `directions` are x, y and z (H, W) float32 of unit vectors in the world frame, already turned by the car's heading.
    Each seed gives another landscape of the same style.
    """
    x, y, z = directions
    # cv2.phase is 0 to 2 pi. The panorama is padded by a column on each side, so that it wraps.
    column = cv2.phase(x, y) * np.float32(PIXELS_PER_RAD) + np.float32(0.5)
    row = (np.float32(Z_TOP) - z) * np.float32(PIXELS_PER_RAD) - np.float32(0.5)
    return cv2.remap(
        _panorama(style, seed),
        column,
        row,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )


@lru_cache(maxsize=3)
def _panorama(style: BackdropStyle, seed: int) -> np.ndarray:
    """Panorama (ROWS, COLUMNS + 2, 3) float32; row 0 is at Z_TOP, column 1 at azimuth 0."""
    rng = np.random.default_rng([seed, 20])
    picture = _sky(style)
    if style.cloud_cover > 0:
        _paint_clouds(picture, style, rng)
    for distance_km, share, size_rad in RIDGES:
        skyline = _hills(rng, size_rad) * share * style.ridge_height_rad
        _paint_layer(picture, skyline, (WOOD, 0.5 * WOOD), distance_km, style, rng)
    grass = GRASS + style.greenness * (GREEN_GRASS - GRASS)
    # The road runs along a valley, so near hills and woods are low ahead and behind.
    valley = smoothstep(0.02, 0.55, np.abs(np.sin(AZIMUTH_RAD)))
    for distance_km, share, size_rad in HILLS:
        low = 1 - (1 - valley) * 0.85 * min(1.0, 1.2 / distance_km)
        skyline = _hills(rng, size_rad) * share * style.hill_height_rad * low
        _paint_layer(picture, skyline, (grass, SCRUB), distance_km, style, rng)
    for distance_km, height_rad in WOODS if style.tree_density else ():
        trees = fractal_noise(
            (1, COLUMNS), rng, cell_px=(450, 450), octaves=8, gain=0.7
        )[0]
        skyline = (
            height_rad
            * valley**0.3
            * np.clip(0.5 * trees + 1.4 * style.tree_density - 0.4, -0.1, 1)
        )
        _paint_layer(
            picture, skyline, (1.6 * SCRUB, 0.6 * WOOD), distance_km, style, rng
        )
    return np.pad(picture, ((0, 0), (1, 1), (0, 0)), mode="wrap")


def _sky(style: BackdropStyle) -> np.ndarray:
    """Clear sky (ROWS, COLUMNS, 3): vertical gradient, and the brightening towards the sun."""
    gradient = ZENITH + HORIZON_GLOW * np.exp(-GLOW_FALL * np.maximum(Z, 0))
    facing = np.cos(AZIMUTH_RAD - np.float32(style.sun_azimuth_rad)) * np.float32(
        np.cos(style.sun_elevation_rad)
    )
    away = (
        1
        - np.sqrt(1 - Z * Z) * facing
        - Z * np.float32(np.sin(style.sun_elevation_rad))
    )
    # Aureole (forward scattering), weak brightening of the sun's side, and haze that whitens both.
    glow = 0.30 * np.exp(-away / 0.05) + (0.05 + 0.35 * style.haze_per_km) * np.exp(
        -away / 0.5
    )
    sky = gradient[:, None] * (1.06 - 0.06 * away)[..., None] + glow[
        ..., None
    ] * np.array([0.85, 0.97, 1.0])
    return sky.astype(np.float32)


def _paint_clouds(
    picture: np.ndarray, style: BackdropStyle, rng: np.random.Generator
) -> None:
    """Paint cumulus clouds into a panorama, in place: noise on a flat layer, seen in perspective."""
    size = 2048
    noise = fractal_noise((size, size), rng, cell_px=(420, 420), octaves=8, gain=0.55)
    sky = picture[: int(Z_TOP * PIXELS_PER_RAD)]
    z = np.maximum(Z[: len(sky)], 0.004)
    # The exponent is 1 for thin clouds; a smaller one gives them the height of cumulus.
    reach = 330 * np.sqrt(1 - z * z) / (z + 0.06) ** 0.55
    map_x, map_y = (
        reach * turn + size / 2 for turn in (np.cos(AZIMUTH_RAD), np.sin(AZIMUTH_RAD))
    )
    density = cv2.remap(noise, map_x.astype(np.float32), map_y.astype(np.float32), cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_WRAP)  # fmt: skip
    edge = np.float32(np.quantile(density[::8, ::8], 1 - style.cloud_cover))
    cover = smoothstep(edge - 0.08, edge + 0.40, density) * np.exp(-0.012 / z)
    # Tops, with less cloud above them, are lit; thick bases are grey.
    lit = density - np.roll(cv2.GaussianBlur(density, (0, 0), 5), 12, axis=0)
    bright = np.clip(
        0.84 - 0.46 * smoothstep(edge + 0.1, edge + 1.7, density) + 0.22 * lit,
        0.26,
        1.05,
    )
    blend(
        sky,
        bright[..., None] * np.float32(0.95) + np.array([0.0, 0.01, 0.04], np.float32),
        cover,
    )


def _hills(rng: np.random.Generator, size_rad: float) -> np.ndarray:
    """Skyline (COLUMNS,) of hills about 1 high and `size_rad` wide, partly below the horizon."""
    size_px = size_rad * PIXELS_PER_RAD
    profile = fractal_noise(
        (1, COLUMNS), rng, cell_px=(size_px, size_px), octaves=9, gain=0.38
    )[0]
    return np.clip(0.62 + 0.42 * profile, -0.3, 1.6)


def _paint_layer(
    picture: np.ndarray,
    skyline: np.ndarray,
    colours: tuple[np.ndarray, np.ndarray],
    distance_km: float,
    style: BackdropStyle,
    rng: np.random.Generator,
) -> None:
    """Paint everything below a skyline (COLUMNS,) of z in patches of two colours, seen through the air, in place."""
    skyline = np.maximum(skyline, -0.002).astype(np.float32)
    first = int(np.argmax(Z[:, 0] < skyline.max()))
    below, z = picture[first:], Z[first:]
    noise = fractal_noise(
        z.shape[:1] + skyline.shape, rng, cell_px=(20, 70), octaves=6, gain=0.65
    )
    patches = smoothstep(
        1.2 - 2.4 * style.tree_density, 2.2 - 2.4 * style.tree_density, noise
    )[..., None]
    colour = (colours[0] + patches * (colours[1] - colours[0])) * (
        1 + np.float32(0.12) * noise
    )[..., None]
    air = aerial_perspective(1000 * distance_km, style.haze_per_km)
    share = np.clip((skyline - z) * np.float32(PIXELS_PER_RAD) + np.float32(0.5), 0, 1)
    blend(below, colour * air.transmittance + air.airlight, share)
