"""Backdrop: sky, clouds, hills and woods, painted once as a panorama.

The backdrop is at infinity: it moves in the image when the car turns, not when it
drives. Directions are unit vectors in the world frame (x along the start of the road, y
left, z up). The panorama is an equal-area cylindrical projection: columns are azimuths,
rows are z components of the direction.
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
Z_TOP = 0.64
Z_BOTTOM = -0.06
ROWS = round((Z_TOP - Z_BOTTOM) * PIXELS_PER_RAD)
# Azimuth of each column, and z component (ROWS, 1) of each row.
_COLUMN = np.arange(COLUMNS)
_ROW = np.arange(ROWS)[:, None]
AZIMUTH_RAD = ((_COLUMN + 0.5) / PIXELS_PER_RAD).astype(np.float32)
Z = (Z_TOP - (_ROW + 0.5) / PIXELS_PER_RAD).astype(np.float32)

# Linear RGB radiance of a dry summer sky (sunlit white paint is 1): at the zenith, the
# addition at the horizon, and its decay with z. Red decays fastest, so the sky is blue
# above.
ZENITH = np.array([0.020, 0.120, 0.380], np.float32)
HORIZON_GLOW = np.array([0.43, 0.47, 0.32], np.float32)
GLOW_FALL = np.array([5.0, 3.1, 1.9], np.float32)
# Brightening around the sun, and the blue of the clouds' light.
AUREOLE = np.array([0.85, 0.97, 1.0])
CLOUD_TINT = np.array([0.0, 0.01, 0.04], np.float32)
# Airlight of infinite distance: the sky just above the horizon, a little darker and
# bluer; and the extinction of its colours relative to that of green. Blue is scattered
# most.
HAZE_COLOUR = (ZENITH + HORIZON_GLOW) * np.array([0.62, 0.72, 0.90], np.float32)
EXTINCTION = np.array([0.8, 1.0, 1.3], np.float32)
# Reflectance in the sun: dry grass, spring grass, scrub, and woods.
GRASS = np.array([0.28, 0.19, 0.10], np.float32)
GREEN_GRASS = np.array([0.14, 0.16, 0.05], np.float32)
SCRUB = np.array([0.050, 0.050, 0.022], np.float32)
WOOD = np.array([0.035, 0.042, 0.020], np.float32)
# Layers from far to near: distance in km, height relative to the style's ridge or
# hills, size of the hills in radians.
RIDGES = ((14.0, 1.0, 0.45), (7.0, 0.72, 0.45))
HILLS = ((4.0, 0.62, 0.38), (1.6, 0.75, 0.45), (0.7, 1.0, 0.54))
# Trees on the plain: distance in km, and height as an angle.
WOODS = ((1.0, 0.012), (0.5, 0.026))


@dataclass(frozen=True)
class BackdropStyle:
    """Style of sky and landscape.

    `cloud_cover` is the share of the sky covered by cumulus clouds. `hill_height_rad`
    and `ridge_height_rad` are typical elevations of the near hills and of the far
    wooded ridge. `greenness` is the colour of the grass from dry gold (0) to spring
    green (1), `tree_density` that of the woods from bare (0) to closed (1).
    `haze_per_km` is the extinction of the air; 0.06 is a clear day, 0.4 a hazy one. The
    sun's position is in the world frame (azimuth > 0 is left of the road's first
    heading).
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
    """Attenuation and airlight (3,) in front of objects.

    `haze_per_km` is the extinction in 1/km. Koschmieder's law of contrast.
    """
    depth = np.float32(distance_m * haze_per_km / 1000)
    transmittance = np.exp(-depth * EXTINCTION)
    return Atmosphere(transmittance, HAZE_COLOUR * (1 - transmittance))


def paint_backdrop(
    directions: Sequence[np.ndarray], style: BackdropStyle, *, seed: int
) -> np.ndarray:
    """Radiance (H, W, 3) of the backdrop in each direction, linear float32 RGB.

    1 is white paint in the sun. `directions` are x, y and z (H, W) float32 of unit
    vectors in the world frame, already turned by the car's heading. Each seed gives
    another landscape of the same style.
    """
    x, y, z = directions
    # cv2.phase is 0 to 2 pi. The panorama is padded by a column on each side, so that
    # it wraps.
    column = cv2.phase(x, y) * PIXELS_PER_RAD + 0.5
    row = (Z_TOP - z) * PIXELS_PER_RAD - 0.5
    panorama = _panorama(style, seed)
    return cv2.remap(
        panorama, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )


@lru_cache(maxsize=3)
def _panorama(style: BackdropStyle, seed: int) -> np.ndarray:
    """Panorama (ROWS, COLUMNS + 2, 3) float32.

    Row 0 is at Z_TOP, column 1 at azimuth 0.
    """
    panorama = _Panorama(style, np.random.default_rng([seed, 20]))
    if style.cloud_cover > 0:
        panorama.paint_clouds()
    panorama.paint_ridges()
    panorama.paint_hills()
    if style.tree_density:
        panorama.paint_woods()
    return cv2.copyMakeBorder(panorama.image, 0, 0, 1, 1, cv2.BORDER_WRAP)


def _sky(style: BackdropStyle) -> np.ndarray:
    """Clear sky (ROWS, COLUMNS, 3).

    Vertical gradient, and the brightening towards the sun.
    """
    gradient = ZENITH + HORIZON_GLOW * np.exp(-GLOW_FALL * np.maximum(Z, 0))

    # 1 minus the cosine of the angle to the sun.
    level = np.float32(np.cos(style.sun_elevation_rad))
    up = np.float32(np.sin(style.sun_elevation_rad))
    facing = np.cos(AZIMUTH_RAD - np.float32(style.sun_azimuth_rad)) * level
    away = 1 - np.sqrt(1 - Z * Z) * facing - Z * up

    # Aureole (forward scattering), weak brightening of the sun's side, and haze that
    # whitens both.
    hazy = 0.05 + 0.35 * style.haze_per_km
    glow = 0.30 * np.exp(-away / 0.05) + hazy * np.exp(-away / 0.5)
    side = (1.06 - 0.06 * away)[..., None]
    sky = gradient[:, None] * side + glow[..., None] * AUREOLE
    return sky.astype(np.float32)


class _Panorama:
    """Panorama that is painted from far to near.

    `image` (ROWS, COLUMNS, 3) starts with the clear sky.
    """

    def __init__(
        self,
        style: BackdropStyle,
        rng: np.random.Generator,
    ) -> None:
        self.style = style
        self.rng = rng
        self.image = _sky(style)
        # The road runs along a valley, so near hills and woods are low ahead and
        # behind.
        self.valley = smoothstep(0.02, 0.55, np.abs(np.sin(AZIMUTH_RAD)))

    def paint_clouds(self) -> None:
        """Paint cumulus clouds: noise on a flat layer, seen in perspective."""
        size = 2048
        noise = fractal_noise(
            (size, size), self.rng, cell_px=(420, 420), octaves=8, gain=0.55
        )
        sky = self.image[: int(Z_TOP * PIXELS_PER_RAD)]
        z = np.maximum(Z[: len(sky)], 0.004)

        # The exponent is 1 for thin clouds; a smaller one gives them the height of
        # cumulus.
        reach = 330 * np.sqrt(1 - z * z) / (z + 0.06) ** 0.55
        map_x = reach * np.cos(AZIMUTH_RAD) + size / 2
        map_y = reach * np.sin(AZIMUTH_RAD) + size / 2
        density = cv2.remap(
            noise, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        clear = 1 - self.style.cloud_cover
        edge = np.float32(np.quantile(density[::8, ::8], clear))
        cover = smoothstep(edge - 0.08, edge + 0.40, density) * np.exp(-0.012 / z)

        # Tops, with less cloud above them, are lit; thick bases are grey.
        above = np.roll(cv2.GaussianBlur(density, (0, 0), 5), 12, axis=0)
        thick = smoothstep(edge + 0.1, edge + 1.7, density)
        bright = 0.84 - 0.46 * thick + 0.22 * (density - above)
        bright = np.clip(bright, 0.26, 1.05)[..., None]
        blend(sky, bright * 0.95 + CLOUD_TINT, cover)

    def paint_ridges(self) -> None:
        """Paint the far wooded ridges."""
        for distance_km, share, size_rad in RIDGES:
            skyline = self._hills(size_rad) * share * self.style.ridge_height_rad
            self._paint_layer(skyline, WOOD, 0.5 * WOOD, distance_km)

    def paint_hills(self) -> None:
        """Paint the near hills of grass and scrub."""
        grass = GRASS + self.style.greenness * (GREEN_GRASS - GRASS)
        for distance_km, share, size_rad in HILLS:
            near = min(1.0, 1.2 / distance_km)
            low = 1 - (1 - self.valley) * 0.85 * near
            skyline = self._hills(size_rad) * share * self.style.hill_height_rad * low
            self._paint_layer(skyline, grass, SCRUB, distance_km)

    def paint_woods(self) -> None:
        """Paint the trees on the plain."""
        for distance_km, height_rad in WOODS:
            noise = fractal_noise(
                (1, COLUMNS), self.rng, cell_px=(450, 450), octaves=8, gain=0.7
            )
            tops = 0.5 * noise[0] + 1.4 * self.style.tree_density - 0.4
            skyline = height_rad * self.valley**0.3 * np.clip(tops, -0.1, 1)
            self._paint_layer(skyline, 1.6 * SCRUB, 0.6 * WOOD, distance_km)

    def _hills(self, size_rad: float) -> np.ndarray:
        """Skyline (COLUMNS,) of hills about 1 high, partly below the horizon."""
        size_px = size_rad * PIXELS_PER_RAD
        profile = fractal_noise(
            (1, COLUMNS), self.rng, cell_px=(size_px, size_px), octaves=9, gain=0.38
        )
        return np.clip(0.62 + 0.42 * profile[0], -0.3, 1.6)

    def _paint_layer(
        self,
        skyline: np.ndarray,
        colour: np.ndarray,
        patch_colour: np.ndarray,
        distance_km: float,
    ) -> None:
        """Paint everything below a skyline (COLUMNS,) of z, seen through the air.

        There are patches of another colour.
        """
        skyline = np.maximum(skyline, -0.002).astype(np.float32)
        first = int(np.argmax(Z[:, 0] < skyline.max()))
        z = Z[first:]
        noise = fractal_noise(
            (len(z), COLUMNS), self.rng, cell_px=(20, 70), octaves=6, gain=0.65
        )
        trees = 2.4 * self.style.tree_density
        patches = smoothstep(1.2 - trees, 2.2 - trees, noise)[..., None]
        mixed = colour + patches * (patch_colour - colour)
        mixed = mixed * (1 + 0.12 * noise)[..., None]

        air = aerial_perspective(1000 * distance_km, self.style.haze_per_km)
        share = np.clip((skyline - z) * PIXELS_PER_RAD + 0.5, 0, 1)
        seen = mixed * air.transmittance + air.airlight
        blend(self.image[first:], seen, share)
