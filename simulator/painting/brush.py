"""Draws polygons through the lens: clipping, projection, anti-aliasing and compositing."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera import Camera

# Near clipping plane, metres ahead of the camera: the bonnet hides what is nearer, and projection degenerates at 0.
NEAR_PLANE_M = 0.5
# Fractional bits of OpenCV's polygon coordinates.
_SHIFT = 4


class Atmosphere(NamedTuple):
    """Air in front of an object, RGB or scalar: observed colour = colour * transmittance + airlight."""

    transmittance: np.ndarray | float = 1.0
    airlight: np.ndarray | float = 0.0


@lru_cache(maxsize=4)
def frustum_planes(camera: Camera, wider: float = 1.15) -> np.ndarray:
    """View frustum in the road frame: the half spaces in which a point can be projected.

    Rows (nx, ny, nz, d) of the result (5, 4); a point p is inside where n.p + d >= 0. The first row is the near plane,
    the others are the sides of a pyramid around the image, `wider` times its width, limited to the valid range of the
    distortion polynomial.
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


def project_faces(camera: Camera, faces_m: np.ndarray) -> list[np.ndarray]:
    """Pixels (N, 2) of the corners of each face (F, 4, 3), clipped to the view frustum; empty for a face outside."""
    planes = frustum_planes(camera)
    whole = inside_planes(faces_m, planes).all(axis=1)
    pixels = np.zeros((*faces_m.shape[:2], 2))
    pixels[whole] = camera.road_to_pixels(faces_m[whole].reshape(-1, 3)).reshape(-1, faces_m.shape[1], 2)
    result = list(pixels)
    for i in np.flatnonzero(~whole):
        points = np.empty((0, 3)) if outside_picture(faces_m[i], camera) else clip_polygon(faces_m[i], planes)
        result[i] = camera.road_to_pixels(points) if len(points) >= 3 else np.empty((0, 2))
    return result


def paint_polygons(
    image: np.ndarray,
    polygons_px: list[np.ndarray],
    colours: np.ndarray,
    *,
    atmosphere: Atmosphere,
    opacity: np.ndarray | None = None,
    softness_px: float = 0.35,
) -> None:
    """Paint anti-aliased convex polygons over an image (H, W, 3) float32 of linear RGB, in place.

    `polygons_px` (N, 2) are raw pixels; later ones are in front, empty ones are skipped. `colours` (F, 3) are linear
    RGB, `opacity` (F,) is 1 by default. `softness_px` is the standard deviation of the blur of the whole group, so that
    no edge is sharper than the lens allows.
    """
    height, width = image.shape[:2]
    points = np.concatenate([np.empty((0, 2)), *polygons_px])
    if not len(points):
        return
    margin = 2 + int(3 * softness_px)
    low = np.maximum(np.floor(points.min(axis=0)).astype(int) - margin, 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int) + margin + 1, [width, height])
    if (high <= low).any():
        return
    opacity = np.ones(len(polygons_px)) if opacity is None else opacity
    paint = np.column_stack([np.asarray(colours) * opacity[:, None], opacity]).tolist()
    ends = np.cumsum([len(polygon) for polygon in polygons_px])
    layer = _fill_polygons(np.split(points - low, ends[:-1]), paint, high - low)
    composite(image, cv2.GaussianBlur(layer, (0, 0), softness_px), int(low[0]), int(low[1]), atmosphere)


def _fill_polygons(polygons: list[np.ndarray], paint: list[list[float]], size: np.ndarray) -> np.ndarray:
    """Anti-aliased RGBA layer (height, width, 4) of polygons, each filled with its entry of `paint`."""
    # Supersampling by 4 in each direction; 2 is enough for a large object.
    fine = 4 if size[0] * size[1] < 60_000 else 2
    layer = np.zeros((size[1] * fine, size[0] * fine, 4), np.float32)
    for polygon, rgba in zip(polygons, paint, strict=True):
        if len(polygon):
            corners = np.rint(((polygon + 0.5) * fine - 0.5) * (1 << _SHIFT)).astype(np.int32)
            cv2.fillConvexPoly(layer, corners, rgba, cv2.LINE_8, _SHIFT)
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


def split_channels(image: np.ndarray) -> np.ndarray:
    """Channels of an image (h, w, channels) as planes (channels, h, w), because numpy is slow in short inner axes.

    cv2.split with preallocated outputs is five times as fast as without.
    """
    planes = np.empty((image.shape[2], *image.shape[:2]), image.dtype)
    cv2.split(image, list(planes))
    return planes
