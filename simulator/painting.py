"""Seeded noise, and polygons drawn through the lens.

Noise is fields for hills, leaves, concrete and paint, and tiles that are sampled in road coordinates. Polygons are
clipped, projected, drawn with anti-aliasing, and composited.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera.model import Camera

TILE = 512
# Texels in a wavelength: enough for bilinear sampling, and 64 wavelengths in a tile before it repeats.
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
    """Smooth random field of `shape`, float32, mean 0, standard deviation 1, periodic along the rows.

    It is a sum of value noise at `octaves` halving scales, without cells smaller than 1.5 pixels. `cell_px` is the
    height and width of the coarsest cell, `gain` the amplitude of each scale relative to the coarser one.
    """
    rows, columns = shape
    total = np.zeros(shape, np.float32)
    for octave in range(octaves):
        cell_rows, cell_columns = cell_px[0] / 2**octave, cell_px[1] / 2**octave
        if octave and min(cell_rows, cell_columns) < 1.5:
            break
        across = max(1, round(columns / cell_columns))
        grid = rng.standard_normal((int(np.ceil(rows / cell_rows)) + 4, across)).astype(np.float32)
        grid = np.pad(grid, ((0, 0), (2, 2)), mode="wrap")
        # Exact scale, so that the last column continues into the first one.
        to_grid = np.array([[across / columns, 0, 2], [0, 1 / cell_rows, 1]])
        look: dict = {"flags": cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, "borderMode": cv2.BORDER_REFLECT_101}
        layer: np.ndarray = cv2.warpAffine(grid, to_grid, (columns, rows), **look)
        layer *= gain**octave
        total += layer
    # In place, because these fields are large.
    total -= total.mean()
    total /= max(float(np.sqrt(np.square(total).mean())), 1e-9)
    return total


def smoothstep(low: np.ndarray | np.floating | float, high: np.floating | float, x: np.ndarray) -> np.ndarray:
    """Smooth step: 0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def sample_noise(
    seed: int, s: np.ndarray, d: np.ndarray, wave_m: tuple[float, float], *, octaves: int = 1
) -> np.ndarray:
    """Noise at road coordinates of any shape, float32, mean 0, standard deviation 1, wavelengths `wave_m` in s and d.

    More octaves add longer waves of half the slope each, which look cloudy instead of grainy.
    """
    return sample(_noise_tile(seed, octaves), _wrapped(s, wave_m[0]), _wrapped(d, wave_m[1]))


@lru_cache(maxsize=64)
def _noise_tile(seed: int, octaves: int) -> np.ndarray:
    """Periodic noise (TILE + 1, TILE + 1) float32 of wavelengths of about TEXELS_PER_WAVE."""
    rng = np.random.default_rng(seed)
    waves = np.fft.rfft2(rng.standard_normal((TILE, TILE)))
    waves *= _gain(octaves)
    tile = np.fft.irfft2(waves, s=(TILE, TILE))
    tile /= tile.std()
    # One more row and column, so that bilinear sampling wraps without a seam.
    return cv2.copyMakeBorder(tile.astype(np.float32), 0, 1, 0, 1, cv2.BORDER_WRAP)


@lru_cache(maxsize=8)
def _gain(octaves: int) -> np.ndarray:
    """Amplitude of each frequency of np.fft.rfft2 in a tile."""
    frequency = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TEXELS_PER_WAVE
    gain = sum(2.0**k * np.exp(-(((frequency * 2.0**k) - 1) ** 2) / 0.5) * 1.4**k for k in range(octaves))
    gain[0, 0] = 0
    return gain


def sample(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Bilinear samples of an image of one channel at pixels (u, v), float32 of any shape; 0 outside."""
    if not u.size:
        return u
    # OpenCV refuses maps longer than 32767, so a list is reshaped to rows.
    u_rows, v_rows = (np.pad(x.ravel(), (0, -x.size % LIST_ROW)).reshape(-1, LIST_ROW) for x in (u, v))
    return cv2.remap(image, u_rows, v_rows, cv2.INTER_LINEAR).ravel()[: u.size].reshape(u.shape)


def fade(footprint: np.ndarray, wave_m: float) -> np.ndarray:
    """Share of a wave's amplitude left after averaging over a footprint: 1 for a short footprint, 0 for a long one."""
    return 1 / (1 + (footprint * np.float32(1.6 / wave_m)) ** 2)


def _wrapped(metres: np.ndarray, wave_m: float) -> np.ndarray:
    tiles = metres * np.float32(TEXELS_PER_WAVE / TILE / wave_m)
    return (tiles - np.floor(tiles)) * np.float32(TILE)


# Near clipping plane, metres ahead of the camera: the bonnet hides what is nearer, and projection degenerates at 0.
NEAR_PLANE_M = 0.5
# Fractional bits of OpenCV's polygon coordinates.
_SHIFT = 4


class Atmosphere(NamedTuple):
    """Air in front of an object, RGB or scalar: observed colour = colour * transmittance + airlight."""

    transmittance: np.ndarray | float = 1.0
    airlight: np.ndarray | float = 0.0

    def dimmed(self, light: np.ndarray) -> Atmosphere:
        """The air in front of an object in the shade; `light` (3,) is the share of daylight on the object."""
        return self._replace(transmittance=self.transmittance * light)


@dataclass(frozen=True, eq=False)
class Canvas:
    """Image (H, W, 3) float32 of linear RGB that objects are painted over, in place, and the camera that sees them."""

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
        """Mask (...,) of the point sets (..., N, 3) whose convex hull is outside the image, blur included."""
        return np.asarray((heights_above(self._border, points_m) < 0).all(axis=-2).any(axis=-1))

    def project_faces(self, faces_m: np.ndarray) -> list[np.ndarray]:
        """Pixels (N, 2) of the corners of each face (F, 4, 3), clipped to the view frustum; empty for one outside."""
        whole = (heights_above(self.frustum, faces_m) >= -1e-9).all(axis=(1, 2))
        pixels = np.zeros((*faces_m.shape[:2], 2))
        pixels[whole] = self.camera.road_to_pixels(faces_m[whole].reshape(-1, 3)).reshape(-1, faces_m.shape[1], 2)
        result = list(pixels)
        for i, missed in zip(np.flatnonzero(~whole), self.misses(faces_m[~whole]), strict=True):
            points = np.empty((0, 3)) if missed else clip_polygon(faces_m[i], self.frustum)
            result[i] = self.camera.road_to_pixels(points) if len(points) >= 3 else np.empty((0, 2))
        return result


def _frustum_planes(camera: Camera, wider: float) -> np.ndarray:
    """View frustum in the road frame: rows (nx, ny, nz, d) of half spaces (5, 4); a point p is inside if n.p + d >= 0.

    The first is the near plane, the others are the sides of a pyramid around the image, `wider` times its width,
    limited to the valid range of the distortion polynomial.
    """
    width, height = camera.size
    across, down = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    border = [(u, v) for u in across for v in (0, height - 1)] + [(u, v) for u in (0, width - 1) for v in down]
    reach = np.abs(camera.rays(np.array(border))[:, :2]).max(axis=0) * wider
    reach *= min(1.0, 0.98 * camera.largest_ray / np.hypot(*reach))
    sides = np.array([[1, 0, reach[0]], [-1, 0, reach[0]], [0, 1, reach[1]], [0, -1, reach[1]]])
    pose = camera.require_pose()
    normals = sides @ pose.rotation
    planes = np.column_stack([normals, -normals[:, 2] * pose.height_m])
    return np.vstack([[1.0, 0, 0, -NEAR_PLANE_M], planes])


def heights_above(planes: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Distances (..., P) of points (..., 3) from planes (P, 4), > 0 inside."""
    # One matrix product, because numpy multiplies a stack of small matrices one by one.
    return (points_m.reshape(-1, 3) @ planes[:, :3].T + planes[:, 3]).reshape(*points_m.shape[:-1], len(planes))


def clip_polygon(points_m: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Corners (M, 3) of a polygon (N, 3) clipped to all `planes` (P, 4) of `frustum_planes`; M is 0 outside.

    Sutherland and Hodgman, Reentrant polygon clipping, CACM 1974.
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
                kept.append(points[before] + share * (points[i] - points[before]))
            if height[i] >= 0:
                kept.append(points[i])
        points = np.array(kept).reshape(-1, 3)
    return points


def face_normals(corners_m: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3) of faces (F, 4, 3) from their diagonals."""
    a, b = corners_m[:, 2] - corners_m[:, 0], corners_m[:, 3] - corners_m[:, 1]
    # The cross product; np.cross takes several times as long.
    normal = a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


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

    `polygons_px` (N, 2) are raw pixels; later ones are in front, empty ones are skipped. `colours` (F, 3) are linear
    RGB, `opacity` (F,) is 1 by default. `softness_px` is the standard deviation of the blur of the whole group, so that
    no edge is sharper than the lens allows.
    """
    points = np.concatenate([np.empty((0, 2)), *polygons_px])
    if not len(points):
        return
    margin = 2 + int(3 * softness_px)
    low = np.maximum(np.floor(points.min(axis=0)).astype(int) - margin, 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int) + margin + 1, canvas.camera.size)
    if (high <= low).any():
        return
    opacity = np.ones(len(polygons_px)) if opacity is None else opacity
    paint = np.column_stack([np.asarray(colours) * opacity[:, None], opacity]).tolist()
    ends = np.cumsum([len(polygon) for polygon in polygons_px]).tolist()
    layer = _fill_polygons(points - low, ends, paint, high - low)
    composite(canvas.image, cv2.GaussianBlur(layer, (0, 0), softness_px), int(low[0]), int(low[1]), atmosphere)


def _fill_polygons(points: np.ndarray, ends: list[int], paint: list[list[float]], size: np.ndarray) -> np.ndarray:
    """Anti-aliased RGBA layer (height, width, 4) of polygons, each filled with its entry of `paint`.

    `points` (N, 2) are those of all polygons, `ends` the index after the last point of each.
    """
    # Supersampling by 4 in each direction; 2 is enough for a large object.
    fine = 4 if size[0] * size[1] < 60_000 else 2
    layer = np.zeros((size[1] * fine, size[0] * fine, 4), np.float32)
    corners = np.rint(((points + 0.5) * fine - 0.5) * (1 << _SHIFT)).astype(np.int32)
    for first, last, rgba in zip([0, *ends[:-1]], ends, paint, strict=True):
        if first < last:
            cv2.fillConvexPoly(layer, corners[first:last], rgba, cv2.LINE_8, _SHIFT)
    # Halve once or twice, because OpenCV is faster at halving than at quartering.
    while fine > 1:
        fine //= 2
        layer = cv2.resize(layer, (size * fine).tolist(), interpolation=cv2.INTER_AREA)
    return layer


def composite(image: np.ndarray, layer: np.ndarray, left: int, top: int, air: Atmosphere) -> None:
    """Composite a layer (h, w, 4), RGB times coverage and coverage, over an image (H, W, 3) at `left`, `top`."""
    window = image[top : top + layer.shape[0], left : left + layer.shape[1]]
    planes, (transmittance, airlight) = split_channels(layer), (np.full(3, value) for value in air)
    alpha = planes[3]
    colour = [cv2.addWeighted(planes[k], transmittance[k], alpha, airlight[k], 0) for k in range(3)]
    window *= cv2.merge([1 - alpha] * 3)
    window += cv2.merge(colour)


def blend(below: np.ndarray, above: np.ndarray, share: np.ndarray) -> None:
    """Blend an image or a colour over an image `below` (H, W, 3), in place, with the opacity `share` (H, W)."""
    if share.size:
        # cv2.merge, because numpy is slow where the innermost axis has three elements. It refuses empty images.
        below += cv2.merge([share] * 3) * (above - below)


def blend_pixels(image: np.ndarray, pixels: np.ndarray, share: np.ndarray, colour: np.ndarray) -> None:
    """Blend a colour, (3,) or (3, K) float32, over an image (H, W, 3), in place.

    `pixels` (K,) are indices into the raveled rows and columns, `share` (K,) is the opacity in each of them.
    """
    # Channel by channel, because numpy is slow where the innermost axis has three elements.
    for channel, value in zip(image.reshape(-1, 3).T, colour, strict=True):
        below = channel[pixels]
        channel[pixels] = below + share * (value - below)


def split_channels(image: np.ndarray) -> np.ndarray:
    """Channels of an image (h, w, channels) as planes (channels, h, w), because numpy is slow in short inner axes.

    cv2.split with preallocated outputs is five times as fast as without.
    """
    planes = np.empty((image.shape[2], *image.shape[:2]), image.dtype)
    cv2.split(image, list(planes))
    return planes
