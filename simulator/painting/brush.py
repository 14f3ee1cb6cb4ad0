"""Painting solid things into a picture through the lens: clipping, projecting, and edges without steps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from lanes.camera.camera import Camera

# Nothing nearer than this before the camera is drawn: the own bonnet hides it, and projection degenerates at 0.
NEAR_PLANE_M = 0.5
# Subpixel bits of OpenCV's polygon coordinates.
_SHIFT = 4
# Less than this of what is behind is not worth painting: it changes one pixel of ten thousand by a grey level.
MIN_TRANSMITTANCE = 1e-5


@lru_cache(maxsize=4)
def frustum_planes(camera: Camera, wider: float = 1.15) -> np.ndarray:
    """Half spaces, in the road frame, inside which a point can be projected.

    Parameters
    ----------
    camera : Camera
    wider : float
        How much wider than the picture they are.

    Returns
    -------
    ndarray of shape (5, 4)
        Rows (nx, ny, nz, d): a point p is inside where n.p + d >= 0. First x > NEAREST_M, then the sides of
        a pyramid around the picture, narrower than what the distortion polynomial can take.
    """
    width, height = camera.size
    across, down = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    border = np.vstack(
        [np.column_stack([across, np.full(9, v)]) for v in (0, height - 1)]
        + [np.column_stack([np.full(9, u), down]) for u in (0, width - 1)]
    )
    reach = np.abs(camera.rays(border)[:, :2]).max(axis=0) * wider
    reach *= min(1.0, 0.98 * camera.largest_ray / np.hypot(*reach))
    sides = np.array([[1, 0, reach[0]], [-1, 0, reach[0]], [0, 1, reach[1]], [0, -1, reach[1]]])
    normals = sides @ camera.pose.rotation()
    planes = np.column_stack([normals, -normals[:, 2] * camera.pose.height_m])
    return np.vstack([[1.0, 0, 0, -NEAR_PLANE_M], planes])


def inside_planes(points_m: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """(...,) bool: which points (..., 3) lie inside all planes."""
    return (points_m @ planes[:, :3].T + planes[:, 3] >= -1e-9).all(axis=-1)


def outside_picture(points_m: np.ndarray, camera: Camera) -> np.ndarray:
    """(...,) bool: which hulls of points (..., N, 3) leave nothing in the picture, not even blurred."""
    planes = frustum_planes(camera, 1.05)
    return (points_m @ planes[:, :3].T + planes[:, 3] < 0).all(axis=-2).any(axis=-1)


def clip_polygon(points_m: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """The part of a polygon inside all planes.

    Parameters
    ----------
    points_m : ndarray of shape (N, 3)
        Corners in the road frame, metres.
    planes : ndarray of shape (P, 4)
        As from `frustum_planes`.

    Returns
    -------
    ndarray of shape (M, 3)
        M is 0 when nothing remains.

    References
    ----------
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


def project_faces(camera: Camera, faces_m: np.ndarray) -> np.ndarray | list[np.ndarray | None]:
    """Pixels of each face (F, corners, 3), clipped to what the lens can see; None for a face out of sight.

    An array (F, corners, 2) where all are seen whole, as most things are.
    """
    planes = frustum_planes(camera)
    count, corners = faces_m.shape[:2]
    # One product of all corners: numpy multiplies a stack of small matrices one by one.
    height = (faces_m.reshape(-1, 3) @ planes[:, :3].T + planes[:, 3]).reshape(count, corners, -1)
    whole = (height >= -1e-9).all(axis=(1, 2))
    if whole.all():
        return camera.road_to_pixels(faces_m.reshape(-1, 3)).reshape(-1, corners, 2)
    pixels = np.full((count, corners, 2), np.nan)
    if whole.any():
        pixels[whole] = camera.road_to_pixels(faces_m[whole].reshape(-1, 3)).reshape(-1, corners, 2)
    result: list[np.ndarray | None] = [face if seen else None for face, seen in zip(pixels, whole, strict=True)]
    for i in np.flatnonzero(~whole)[~outside_picture(faces_m[~whole], camera)]:
        points = clip_polygon(faces_m[i], planes)
        result[i] = camera.road_to_pixels(points) if len(points) >= 3 else None
    return result


def paint_polygons(
    picture: np.ndarray,
    polygons_px: np.ndarray | list[np.ndarray | None],
    colours: np.ndarray,
    *,
    opacity: np.ndarray | None = None,
    through: np.ndarray | float = 1.0,
    air: np.ndarray | float = 0.0,
    softness_px: float = 0.35,
    blend_px: float = 0.0,
) -> None:
    """Paint convex polygons, each over those before it, behind all that is in the picture, with smooth edges.

    Parameters
    ----------
    picture : ndarray of shape (4, H, W), float32
        As from `new_canvas`, changed.
    polygons_px : ndarray of shape (F, N, 2), or list of (N, 2) arrays or None
        Raw pixels; None is skipped.
    colours : ndarray of shape (F, 3)
        Linear RGB of each polygon.
    opacity : ndarray of shape (F,), optional
        1 hides what is behind.
    through, air
        What the air leaves of the colour and what it adds, RGB or scalar (see `backdrop.aerial_perspective`).
    softness_px : float
        Blur of the whole group: a lens never shows a harder edge.
    blend_px : float
        Blur of the colours within the group's outline: shading without facets.
    """
    height, width = picture.shape[1:]
    seen, points, bounds = _concatenated(polygons_px)
    if not len(points):
        return
    margin = 2 + int(3 * softness_px)
    # OpenCV, because numpy is slow where the innermost axis has two elements.
    first, last = (cv2.reduce(points, 0, extreme)[0] for extreme in (cv2.REDUCE_MIN, cv2.REDUCE_MAX))
    low = np.maximum(np.floor(first).astype(int) - margin, 0)
    high = np.minimum(np.ceil(last).astype(int) + margin + 1, [width, height])
    if (high <= low).any():
        return
    if not uncovered_window(picture[3, low[1] : high[1], low[0] : high[0]]):
        return
    size = high - low
    # Four samples a pixel each way; two are enough where a thing fills a good part of the picture.
    fine = 4 if size[0] * size[1] < 60_000 else 2
    layer = np.zeros((size[1] * fine, size[0] * fine, 4), np.float32)
    opacity = np.ones(len(polygons_px)) if opacity is None else opacity
    paint = np.column_stack([np.asarray(colours) * opacity[:, None], opacity])[seen].tolist()
    corners = np.rint(((points - low + 0.5) * fine - 0.5) * (1 << _SHIFT)).astype(np.int32)
    for first, last, rgba in zip(bounds[:-1], bounds[1:], paint, strict=True):
        cv2.fillConvexPoly(layer, corners[first:last], rgba, cv2.LINE_8, _SHIFT)
    # Halved once or twice: OpenCV has a quicker way for that than for quarters.
    while fine > 1:
        fine //= 2
        layer = cv2.resize(layer, (size * fine).tolist(), interpolation=cv2.INTER_AREA)
    if blend_px > 0.3:
        spread = cv2.GaussianBlur(layer, (0, 0), blend_px)
        layer[..., :3] = spread[..., :3] * (layer[..., 3:] / np.maximum(spread[..., 3:], 1e-3))
    if softness_px > 0:
        layer = cv2.GaussianBlur(layer, (0, 0), softness_px)
    composite_behind(picture, split_channels(layer), int(low[0]), int(low[1]), through=through, air=air)


def _concatenated(
    polygons_px: np.ndarray | list[np.ndarray | None],
) -> tuple[slice | list[int], np.ndarray, Sequence[int]]:
    """Which polygons are seen, all their points (N, 2), and where in that row each begins and the last one ends."""
    if isinstance(polygons_px, np.ndarray):
        points = polygons_px.reshape(-1, 2)
        return slice(None), points, range(0, len(points) + 1, polygons_px.shape[1])
    seen = [i for i, polygon in enumerate(polygons_px) if polygon is not None]
    points = [polygons_px[i] for i in seen]
    return seen, np.concatenate([np.empty((0, 2)), *points]), [0, *np.cumsum([len(p) for p in points]).tolist()]


def split_channels(image: np.ndarray) -> np.ndarray:
    """The channels of an image (h, w, channels) as planes (channels, h, w): cv2.split, given where to put them.

    Left to make its results itself it takes five times as long.
    """
    planes = np.empty((image.shape[2], *image.shape[:2]), image.dtype)
    cv2.split(image, list(planes))
    return planes


def new_canvas(height: int, width: int) -> np.ndarray:
    """Planes (4, height, width) float32 to paint things into, the nearest first.

    Three are the light that they send (linear RGB), the last is how much of what is behind them is still seen: so
    nothing need be painted where that is nothing. Planes, because hundreds of things cover small parts of a picture,
    and taking these apart and putting them together again would cost as much as the painting.
    """
    picture = np.zeros((4, height, width), np.float32)
    picture[3] = 1
    return picture


def uncovered_window(clear: np.ndarray) -> tuple[slice, slice] | None:
    """The rows and columns of a part of the last plane in which anything behind is seen; None if there are none."""
    seen = clear > MIN_TRANSMITTANCE
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    return (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)) if len(rows) else None


def composite_over(picture: np.ndarray, image: np.ndarray) -> np.ndarray:
    """The image (H, W, 3) with what is in the picture (4, H, W) before it."""
    *lights, clear = picture
    behind = split_channels(image.astype(np.float32, copy=False))
    for plane, light in zip(behind, lights, strict=True):
        plane *= clear
        plane += light
    return cv2.merge(behind)


def composite_behind(
    picture: np.ndarray,
    planes: Sequence[np.ndarray],
    left: int,
    top: int,
    *,
    through: np.ndarray | float = 1.0,
    air: np.ndarray | float = 0.0,
) -> None:
    """Lay an image behind what is in the picture (4, H, W), in place.

    `planes` are its RGB times coverage, and coverage, each (h, w); they are used up. All of it is inside the picture.
    """
    *colours, alpha = planes
    *lights, clear = picture[:, top : top + alpha.shape[0], left : left + alpha.shape[1]]
    for light, colour, left_over, added in zip(lights, colours, np.full(3, through), np.full(3, air), strict=True):
        # Each in one go over the numbers, where numpy goes five times.
        cv2.addWeighted(colour, left_over, alpha, added, 0, dst=colour)
        cv2.accumulateProduct(colour, clear, light)
    clear *= np.subtract(1, alpha, out=alpha)
