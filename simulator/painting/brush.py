"""Draws polygons through the lens: clipping, projection, anti-aliasing and front-to-back compositing."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera import Camera

# Near clipping plane, metres ahead of the camera: the bonnet hides what is nearer, and projection degenerates at 0.
NEAR_PLANE_M = 0.5
# Fractional bits of OpenCV's polygon coordinates.
_SHIFT = 4
# Below this transmittance the background is not painted: it changes one pixel of ten thousand by one grey level.
MIN_TRANSMITTANCE = 1e-5


class Atmosphere(NamedTuple):
    """Air in front of an object, RGB or scalar: observed colour = colour * transmittance + airlight."""

    transmittance: np.ndarray | float = 1.0
    airlight: np.ndarray | float = 0.0


CLEAR_AIR = Atmosphere()


@lru_cache(maxsize=4)
def frustum_planes(camera: Camera, wider: float = 1.15) -> np.ndarray:
    """View frustum in the road frame: the half spaces in which a point can be projected.

    Rows (nx, ny, nz, d) of the result (5, 4); a point p is inside where n.p + d >= 0. The first row is the near plane,
    the others are the sides of a pyramid around the image, `wider` times its width, limited to the valid range of the
    distortion polynomial.
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
    pose = camera.require_pose()
    normals = sides @ pose.rotation
    planes = np.column_stack([normals, -normals[:, 2] * pose.height_m])
    return np.vstack([[1.0, 0, 0, -NEAR_PLANE_M], planes])


def inside_planes(points_m: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Mask (...,) of the points (..., 3) that lie inside all planes."""
    return (points_m @ planes[:, :3].T + planes[:, 3] >= -1e-9).all(axis=-1)


def outside_picture(points_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Mask (...,) of the point sets (..., N, 3) whose convex hull is outside the image, blur included."""
    planes = frustum_planes(camera, 1.05)
    return (points_m @ planes[:, :3].T + planes[:, 3] < 0).all(axis=-2).any(axis=-1)


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
    normal = np.cross(corners_m[:, 2] - corners_m[:, 0], corners_m[:, 3] - corners_m[:, 1])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)


def project_faces(camera: Camera, faces_m: np.ndarray) -> np.ndarray | list[np.ndarray | None]:
    """Pixels of the corners of each face (F, corners, 3), clipped to the view frustum.

    The array (F, corners, 2) if no face is clipped, otherwise a list of clipped polygons (N, 2); None for a face
    outside.
    """
    planes = frustum_planes(camera)
    count, corners = faces_m.shape[:2]
    # One matrix product for all corners: numpy multiplies a stack of small matrices one by one.
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
    atmosphere: Atmosphere = CLEAR_AIR,
    softness_px: float = 0.35,
    blend_px: float = 0.0,
) -> None:
    """Paint anti-aliased convex polygons behind the content of a canvas (4, H, W), in place; later ones are in front.

    `polygons_px` (F, N, 2), or a list of (N, 2) in which None is skipped, are raw pixels; `colours` (F, 3) linear RGB,
    `opacity` (F,) is 1 by default. `softness_px` is the standard deviation of the blur of the whole group, so that no
    edge is sharper than the lens allows, `blend_px` that of the colours within its outline, which hides the facets.
    """
    height, width = picture.shape[1:]
    seen, points, bounds = _concatenated(polygons_px)
    if not len(points):
        return
    margin = 2 + int(3 * softness_px)
    # cv2.reduce, because numpy is slow where the innermost axis has two elements.
    first, last = (cv2.reduce(points, 0, extreme)[0] for extreme in (cv2.REDUCE_MIN, cv2.REDUCE_MAX))
    low = np.maximum(np.floor(first).astype(int) - margin, 0)
    high = np.minimum(np.ceil(last).astype(int) + margin + 1, [width, height])
    if (high <= low).any():
        return
    if not uncovered_window(picture[3, low[1] : high[1], low[0] : high[0]]):
        return
    opacity = np.ones(len(polygons_px)) if opacity is None else opacity
    paint = np.column_stack([np.asarray(colours) * opacity[:, None], opacity])[seen].tolist()
    layer = _fill_polygons(points - low, bounds, paint, high - low)
    if blend_px > 0.3:
        spread = cv2.GaussianBlur(layer, (0, 0), blend_px)
        layer[..., :3] = spread[..., :3] * (layer[..., 3:] / np.maximum(spread[..., 3:], 1e-3))
    if softness_px > 0:
        layer = cv2.GaussianBlur(layer, (0, 0), softness_px)
    composite_behind(picture, split_channels(layer), int(low[0]), int(low[1]), atmosphere=atmosphere)


def _fill_polygons(points: np.ndarray, bounds: Sequence[int], paint: list[list[float]], size: np.ndarray) -> np.ndarray:
    """Anti-aliased RGBA layer (height, width, 4) of polygons, each filled with its entry of `paint`."""
    # Supersampling by 4 in each direction; 2 is enough for a large object.
    fine = 4 if size[0] * size[1] < 60_000 else 2
    layer = np.zeros((size[1] * fine, size[0] * fine, 4), np.float32)
    corners = np.rint(((points + 0.5) * fine - 0.5) * (1 << _SHIFT)).astype(np.int32)
    for first, last, rgba in zip(bounds[:-1], bounds[1:], paint, strict=True):
        cv2.fillConvexPoly(layer, corners[first:last], rgba, cv2.LINE_8, _SHIFT)
    # Halve once or twice, because OpenCV is faster at halving than at quartering.
    while fine > 1:
        fine //= 2
        layer = cv2.resize(layer, (size * fine).tolist(), interpolation=cv2.INTER_AREA)
    return layer


def _concatenated(
    polygons_px: np.ndarray | list[np.ndarray | None],
) -> tuple[slice | list[int], np.ndarray, Sequence[int]]:
    """Indices of the polygons that are not None, their points (N, 2), and the bounds of each polygon among them."""
    if isinstance(polygons_px, np.ndarray):
        points = polygons_px.reshape(-1, 2)
        return slice(None), points, range(0, len(points) + 1, polygons_px.shape[1])
    seen = [i for i, polygon in enumerate(polygons_px) if polygon is not None]
    polygons = [polygon for polygon in polygons_px if polygon is not None]
    return seen, np.concatenate([np.empty((0, 2)), *polygons]), [0, *np.cumsum([len(p) for p in polygons]).tolist()]


def split_channels(image: np.ndarray) -> np.ndarray:
    """Channels of an image (h, w, channels) as planes (channels, h, w).

    cv2.split with preallocated outputs is five times as fast as without.
    """
    planes = np.empty((image.shape[2], *image.shape[:2]), image.dtype)
    cv2.split(image, list(planes))
    return planes


def new_canvas(height: int, width: int) -> np.ndarray:
    """Empty canvas (4, height, width) float32 for front-to-back compositing.

    Planes 0 to 2 are radiance (linear RGB), plane 3 is the transmittance: the share of the background that is still
    visible. Objects are painted from near to far, so that covered pixels can be skipped. The channels are separate
    planes, because splitting and merging hundreds of small rectangles would take as long as painting them.
    """
    picture = np.zeros((4, height, width), np.float32)
    picture[3] = 1
    return picture


def uncovered_window(clear: np.ndarray) -> tuple[slice, slice] | None:
    """Bounding rows and columns of the pixels with visible background in a part of plane 3; None if there are none."""
    seen = clear > MIN_TRANSMITTANCE
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    return (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)) if len(rows) else None


def composite_over(picture: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Image (H, W, 3): the canvas `picture` (4, H, W) composited over the background `image` (H, W, 3)."""
    *lights, clear = picture
    behind = split_channels(image.astype(np.float32, copy=False))
    for plane, light in zip(behind, lights, strict=True):
        plane *= clear
        plane += light
    return cv2.merge(list(behind))


def composite_behind(
    picture: np.ndarray,
    planes: np.ndarray | Sequence[np.ndarray],
    left: int,
    top: int,
    *,
    atmosphere: Atmosphere = CLEAR_AIR,
) -> None:
    """Composite an image behind the content of a canvas (4, H, W) of `new_canvas`, in place.

    `planes` are four float32 arrays (h, w), RGB times coverage, and coverage; they are overwritten. `left`, `top` is
    the position of the image, which must be inside the canvas; `atmosphere` is the air in front of it.
    """
    *colours, alpha = planes
    *lights, clear = picture[:, top : top + alpha.shape[0], left : left + alpha.shape[1]]
    transmittance, airlight = (np.full(3, value) for value in atmosphere)
    for light, colour, factor, offset in zip(lights, colours, transmittance, airlight, strict=True):
        # cv2 makes one pass over the data in each call, numpy would make five.
        cv2.addWeighted(colour, factor, alpha, offset, 0, dst=colour)
        cv2.accumulateProduct(colour, clear, light)
    clear *= np.subtract(1, alpha, out=alpha)
