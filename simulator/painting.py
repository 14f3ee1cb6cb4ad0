"""Seeded noise, and polygons drawn through the lens.

Noise is fields for hills, leaves, concrete and paint, and tiles that are sampled in
road coordinates. Polygons are clipped, projected, drawn with anti-aliasing, and
composited.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera.model import Camera

TILE = 512
# Texels in a wavelength: enough for bilinear sampling, and 64 wavelengths in a tile
# before it repeats.
TEXELS_PER_WAVE = 8
LIST_ROW = 1024


def fractal_noise(
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    cell_px: tuple[float, float],
    octaves: int = 5,
    gain: float = 0.5,
) -> np.ndarray:
    """Smooth random field of `shape`, float32, mean 0, standard deviation 1.

    It is periodic along the rows: a sum of value noise at `octaves` halving scales,
    without cells smaller than 1.5 pixels. `cell_px` is the height and width of the
    coarsest cell, `gain` the amplitude of each scale relative to the coarser one.
    """
    total = np.zeros(shape, np.float32)
    for octave in range(octaves):
        cell_height = cell_px[0] / 2**octave
        cell_width = cell_px[1] / 2**octave
        if octave and min(cell_height, cell_width) < 1.5:
            break
        layer = _value_noise(shape, rng, cell_height, cell_width)
        layer *= gain**octave
        total += layer

    # In place, because these fields are large.
    total -= total.mean()
    deviation = float(np.sqrt(np.square(total).mean()))
    total /= max(deviation, 1e-9)
    return total


def _value_noise(
    shape: tuple[int, int],
    rng: np.random.Generator,
    cell_height: float,
    cell_width: float,
) -> np.ndarray:
    """Cubic interpolation of random values on a grid, periodic along the rows."""
    rows, columns = shape
    grid_rows = int(np.ceil(rows / cell_height)) + 4
    grid_columns = max(1, round(columns / cell_width))
    grid = rng.standard_normal((grid_rows, grid_columns)).astype(np.float32)
    grid = np.pad(grid, ((0, 0), (2, 2)), mode="wrap")

    # Exact scale, so that the last column continues into the first one.
    to_grid = np.array(
        [
            [grid_columns / columns, 0, 2],
            [0, 1 / cell_height, 1],
        ]
    )
    return cv2.warpAffine(
        grid,
        to_grid,
        (columns, rows),
        flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REFLECT_101,
    )


def smoothstep(
    low: np.ndarray | np.floating | float,
    high: np.floating | float,
    x: np.ndarray,
) -> np.ndarray:
    """Smooth step: 0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def sample_noise(
    seed: int,
    s: np.ndarray,
    d: np.ndarray,
    wave_m: tuple[float, float],
    *,
    octaves: int = 1,
) -> np.ndarray:
    """Noise at road coordinates of any shape, float32, mean 0, standard deviation 1.

    `wave_m` are the wavelengths in s and d. More octaves add longer waves of half the
    slope each, which look cloudy instead of grainy.
    """
    u = _wrap_to_tile(s, wave_m[0])
    v = _wrap_to_tile(d, wave_m[1])
    return sample(_noise_tile(seed, octaves), u, v)


@lru_cache(maxsize=64)
def _noise_tile(seed: int, octaves: int) -> np.ndarray:
    """Periodic noise (TILE + 1, TILE + 1) float32 of waves of TEXELS_PER_WAVE."""
    rng = np.random.default_rng(seed)
    waves = np.fft.rfft2(rng.standard_normal((TILE, TILE)))
    waves *= _wave_amplitudes(octaves)
    tile = np.fft.irfft2(waves, s=(TILE, TILE))
    tile /= tile.std()
    # One more row and column, so that bilinear sampling wraps without a seam.
    return cv2.copyMakeBorder(tile.astype(np.float32), 0, 1, 0, 1, cv2.BORDER_WRAP)


@lru_cache(maxsize=8)
def _wave_amplitudes(octaves: int) -> np.ndarray:
    """Amplitude of each frequency of np.fft.rfft2 in a tile."""
    across = np.fft.rfftfreq(TILE)[None, :]
    down = np.fft.fftfreq(TILE)[:, None]
    frequency = np.hypot(down, across) * TEXELS_PER_WAVE
    total = np.zeros(frequency.shape)
    for octave in range(octaves):
        wave = 2.0**octave
        band = np.exp(-((frequency * wave - 1) ** 2) / 0.5)
        total += wave * band * 1.4**octave
    total[0, 0] = 0
    return total


def sample(
    image: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
) -> np.ndarray:
    """Bilinear samples of a one-channel image at pixels (u, v) of any shape, float32.

    Samples outside the image are 0.
    """
    if not u.size:
        return u
    # OpenCV refuses maps longer than 32767, so a list is reshaped to rows.
    spare = -u.size % LIST_ROW
    u_rows = np.pad(u.ravel(), (0, spare)).reshape(-1, LIST_ROW)
    v_rows = np.pad(v.ravel(), (0, spare)).reshape(-1, LIST_ROW)
    samples = cv2.remap(image, u_rows, v_rows, cv2.INTER_LINEAR)
    return samples.ravel()[: u.size].reshape(u.shape)


def fade(footprint: np.ndarray, wave_m: float) -> np.ndarray:
    """Share of a wave's amplitude left after averaging over a footprint.

    It is 1 for a short footprint, 0 for a long one.
    """
    return 1 / (1 + (footprint * (1.6 / wave_m)) ** 2)


def _wrap_to_tile(metres: np.ndarray, wave_m: float) -> np.ndarray:
    tiles = metres * (TEXELS_PER_WAVE / TILE / wave_m)
    return (tiles - np.floor(tiles)) * TILE


# Near clipping plane, metres ahead of the camera: the bonnet hides what is nearer, and
# projection degenerates at 0.
NEAR_PLANE_M = 0.5
# Fractional bits of OpenCV's polygon coordinates.
_SHIFT = 4


class Atmosphere(NamedTuple):
    """Air in front of an object, RGB or scalar.

    Observed colour = colour * transmittance + airlight.
    """

    transmittance: np.ndarray | float = 1.0
    airlight: np.ndarray | float = 0.0

    def dimmed(self, light: np.ndarray) -> Atmosphere:
        """The air in front of an object that gets a share `light` (3,) of daylight."""
        return self._replace(transmittance=self.transmittance * light)


@dataclass(frozen=True, eq=False)
class Canvas:
    """Image that objects are painted over, in place, and the camera that sees them.

    `image` (H, W, 3) float32 is linear RGB.
    """

    image: np.ndarray
    camera: Camera

    @cached_property
    def frustum(self) -> np.ndarray:
        """Half spaces in which a point can be projected; see `_frustum_planes`."""
        return _frustum_planes(self.camera, 1.15)

    @cached_property
    def _border(self) -> np.ndarray:
        return _frustum_planes(self.camera, 1.05)

    def misses(self, points_m: np.ndarray) -> np.ndarray:
        """Mask (...,) of the sets of points (..., N, 3) that are outside the image.

        The convex hull of such a set is outside, blur included.
        """
        outside = heights_above(self._border, points_m) < 0
        return np.asarray(outside.all(axis=-2).any(axis=-1))

    def project_faces(self, faces_m: np.ndarray) -> list[np.ndarray]:
        """Pixels (N, 2) of the corners of each face (F, 4, 3).

        They are clipped to the view frustum, and empty for a face outside.
        """
        polygons = [np.empty((0, 2)) for _ in faces_m]
        inside = heights_above(self.frustum, faces_m) >= -1e-9
        whole = inside.all(axis=(1, 2))

        corners = self.camera.road_to_pixels(faces_m[whole].reshape(-1, 3))
        quads = corners.reshape(-1, faces_m.shape[1], 2)
        for i, quad in zip(np.flatnonzero(whole), quads, strict=True):
            polygons[i] = quad

        cut = np.flatnonzero(~whole)
        for i in cut[~self.misses(faces_m[cut])]:
            points = clip_polygon(faces_m[i], self.frustum)
            if len(points) >= 3:
                polygons[i] = self.camera.road_to_pixels(points)
        return polygons


def _frustum_planes(camera: Camera, wider: float) -> np.ndarray:
    """View frustum in the road frame: rows (nx, ny, nz, d) of half spaces (5, 4).

    A point p is inside if n.p + d >= 0. The first is the near plane, the others are the
    sides of a pyramid around the image, `wider` times its width, limited to the valid
    range of the distortion polynomial.
    """
    across = np.linspace(0, camera.width - 1, 9)
    down = np.linspace(0, camera.height - 1, 9)
    u, v = np.meshgrid(across, down)
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()]))

    x, y = np.abs(rays[:, :2]).max(axis=0) * wider
    valid = min(1.0, 0.98 * camera.largest_ray / np.hypot(x, y))
    x *= valid
    y *= valid

    pose = camera.require_pose()
    normals = (
        np.array(
            [
                [1, 0, x],
                [-1, 0, x],
                [0, 1, y],
                [0, -1, y],
            ]
        )
        @ pose.rotation
    )
    sides = np.column_stack([normals, -normals[:, 2] * pose.height_m])
    return np.vstack([[1.0, 0, 0, -NEAR_PLANE_M], sides])


def heights_above(
    planes: np.ndarray,
    points_m: np.ndarray,
) -> np.ndarray:
    """Distances (..., P) of points (..., 3) from planes (P, 4), > 0 inside."""
    # One matrix product, because numpy multiplies a stack of small matrices one by one.
    normals = planes[:, :3]
    heights = points_m.reshape(-1, 3) @ normals.T + planes[:, 3]
    return heights.reshape(*points_m.shape[:-1], len(planes))


def clip_polygon(
    points_m: np.ndarray,
    planes: np.ndarray,
) -> np.ndarray:
    """Corners (M, 3) of a polygon (N, 3) clipped to all `planes` (P, 4).

    M is 0 for a polygon outside. Sutherland and Hodgman, Reentrant polygon clipping,
    CACM 1974.
    """
    points = np.asarray(points_m, float)
    for plane in planes:
        if len(points) == 0:
            break
        height = points @ plane[:3] + plane[3]
        kept = []
        for i in range(len(points)):
            before = i - 1
            if (height[before] >= 0) != (height[i] >= 0):
                share = height[before] / (height[before] - height[i])
                crossing = points[before] + share * (points[i] - points[before])
                kept.append(crossing)
            if height[i] >= 0:
                kept.append(points[i])
        points = np.array(kept).reshape(-1, 3)
    return points


def face_normals(corners_m: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3) of faces (F, 4, 3) from their diagonals."""
    a = corners_m[:, 2] - corners_m[:, 0]
    b = corners_m[:, 3] - corners_m[:, 1]
    # The cross product; np.cross takes several times as long.
    ahead = [1, 2, 0]
    behind = [2, 0, 1]
    normal = a[:, ahead] * b[:, behind] - a[:, behind] * b[:, ahead]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.maximum(length, 1e-12)


def paint_polygons(
    canvas: Canvas,
    polygons_px: list[np.ndarray],
    colours: np.ndarray,
    *,
    atmosphere: Atmosphere,
    opacity: np.ndarray | None = None,
    softness_px: float = 0.35,
) -> None:
    """Paint anti-aliased convex polygons over a canvas, in place.

    `polygons_px` (N, 2) are raw pixels; later ones are in front, empty ones are
    skipped. `colours` (F, 3) are linear RGB, `opacity` (F,) is 1 by default.
    `softness_px` is the standard deviation of the blur of the whole group, so that no
    edge is sharper than the lens allows.
    """
    points = np.concatenate([np.empty((0, 2)), *polygons_px])
    if not len(points):
        return

    # Window of the image around the polygons and their blur.
    margin = 2 + int(3 * softness_px)
    low = np.floor(points.min(axis=0)).astype(int) - margin
    high = np.ceil(points.max(axis=0)).astype(int) + margin + 1
    low = np.maximum(low, 0)
    high = np.minimum(high, canvas.camera.size)
    if (high <= low).any():
        return

    if opacity is None:
        opacity = np.ones(len(polygons_px))
    paint = np.column_stack([np.asarray(colours) * opacity[:, None], opacity])
    ends = np.cumsum([len(polygon) for polygon in polygons_px])
    layer = _fill_polygons(points - low, ends.tolist(), paint.tolist(), high - low)
    layer = cv2.GaussianBlur(layer, (0, 0), softness_px)
    composite(canvas.image, layer, int(low[0]), int(low[1]), atmosphere)


def _fill_polygons(
    points: np.ndarray,
    ends: list[int],
    paint: list[list[float]],
    size: np.ndarray,
) -> np.ndarray:
    """Anti-aliased RGBA layer (height, width, 4) of polygons.

    `points` (N, 2) are those of all polygons, `ends` the index after the last point of
    each, `paint` the RGBA of each.
    """
    width, height = size.tolist()
    # Supersampling by 4 in each direction; 2 is enough for a large object.
    fine = 4 if width * height < 60_000 else 2
    layer = np.zeros((height * fine, width * fine, 4), np.float32)
    fine_points = (points + 0.5) * fine - 0.5
    corners = np.rint(fine_points * (1 << _SHIFT)).astype(np.int32)
    first = 0
    for last, rgba in zip(ends, paint, strict=True):
        if first < last:
            polygon = corners[first:last]
            cv2.fillConvexPoly(layer, polygon, rgba, cv2.LINE_8, _SHIFT)
        first = last

    # Halve once or twice, because OpenCV is faster at halving than at quartering.
    while fine > 1:
        fine //= 2
        halved = (width * fine, height * fine)
        layer = cv2.resize(layer, halved, interpolation=cv2.INTER_AREA)
    return layer


def composite(
    image: np.ndarray,
    layer: np.ndarray,
    left: int,
    top: int,
    air: Atmosphere,
) -> None:
    """Composite a layer over an image (H, W, 3) at `left`, `top`, in place.

    `layer` (h, w, 4) is RGB times coverage, and coverage.
    """
    height, width = layer.shape[:2]
    window = image[top : top + height, left : left + width]
    *paint, alpha = split_channels(layer)
    transmittance = np.full(3, air.transmittance)
    airlight = np.full(3, air.airlight)
    seen = [
        cv2.addWeighted(channel, transmittance[k], alpha, airlight[k], 0)
        for k, channel in enumerate(paint)
    ]
    window *= three_channels(1 - alpha)
    window += cv2.merge(seen)


def blend(
    below: np.ndarray,
    above: np.ndarray,
    share: np.ndarray,
) -> None:
    """Blend an image or a colour over an image `below` (H, W, 3), in place.

    `share` (H, W) is the opacity.
    """
    # cv2.merge refuses empty images.
    if share.size:
        below += three_channels(share) * (above - below)


def blend_pixels(
    image: np.ndarray,
    pixels: np.ndarray,
    share: np.ndarray,
    colour: np.ndarray,
) -> None:
    """Blend a colour, (3,) or (3, K) float32, over an image (H, W, 3), in place.

    `pixels` (K,) are indices into the raveled rows and columns, `share` (K,) is the
    opacity in each of them.
    """
    # Channel by channel, because numpy is slow in a short innermost axis.
    for channel, value in zip(image.reshape(-1, 3).T, colour, strict=True):
        below = channel[pixels]
        channel[pixels] = below + share * (value - below)


def three_channels(plane: np.ndarray) -> np.ndarray:
    """Image (h, w, 3) with a plane (h, w) in each channel.

    cv2.merge, because numpy is slow in a short innermost axis.
    """
    return cv2.merge([plane] * 3)


def split_channels(image: np.ndarray) -> np.ndarray:
    """Channels of an image (h, w, channels) as planes (channels, h, w).

    cv2.split with preallocated outputs is five times as fast as without.
    """
    rows, columns, count = image.shape
    planes = np.empty((count, rows, columns), image.dtype)
    cv2.split(image, list(planes))
    return planes
