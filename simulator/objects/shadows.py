"""Shadows of objects on the ground: their polygons, drawn into the share of sunlight."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.objects.scene_objects import SceneObject
from simulator.painting.noise import band_noise_tile, sample_noise
from simulator.road.ground import Ground
from simulator.road.road_ahead import RoadAhead

# Range of shadows ahead; the bonnet hides nearer ones.
MIN_SHADOW_M = 1.5
MAX_SHADOW_M = 160.0
LEAF_SEED = 61
# Longest edge that is not subdivided, metres.
EDGE_M = 1.5
# Margin for the blur of shadow edges.
PENUMBRA_PX = 6
# Bounds of the displacement of edges: standard deviations of the noise, and the smallest step of a row on the ground.
MAX_NOISE, MIN_STEP_M = 6.0, 1e-2
# Limit of coordinates, far outside any image.
MAX_PX = 1e6


def shadow_polygons(objects: Iterable[SceneObject], sun_direction: np.ndarray) -> list[np.ndarray]:
    """Polygons (N, 2) of the shadows on the ground, metres in the road frame, float32; their union is the shadow.

    A tree has a polygon for each lump of leaves. `sun_direction` (3,) points towards the sun, in the road frame.
    """
    offset_per_m = -sun_direction[:2] / sun_direction[2]
    return [polygon.astype(np.float32, copy=False) for item in objects for polygon in item.shadows(offset_per_m)]


def cast_shadows(
    sun: np.ndarray,
    polygons_m: list[np.ndarray],
    camera: Camera,
    ground: Ground,
    road: RoadAhead,
    *,
    edge_noise_m: float = 0.0,
) -> None:
    """Remove the sunlight `sun` (rows, width) inside shadow polygons (N, 2), metres in the car's road frame, in place.

    `ground` is that of the same rows; the vertical profile of the road carries the shadows. `edge_noise_m` is the
    displacement of the outlines by leaves; 0 keeps them sharp.
    """
    near = [p for p in polygons_m if p[:, 0].max() > MIN_SHADOW_M and p[:, 0].min() < MAX_SHADOW_M]
    if not near:
        return
    points, ends = _densify(near)
    points = points if road.profile.level else road.lift_to_surface(points)
    outlines = camera.road_to_pixels(points) - [0, ground.top]
    starts = np.concatenate([[0], ends[:-1]])
    out_of_sight = np.logical_or.reduceat(np.isnan(outlines[:, 0]), starts)
    # points close to the camera are projected so far away that 32 bits do not hold them
    corners = np.rint(np.nan_to_num(outlines).clip(-MAX_PX, MAX_PX) * 16).astype(np.int32)
    mask = np.zeros(sun.shape, np.uint8)
    for first, last in zip(starts[~out_of_sight].tolist(), ends[~out_of_sight].tolist(), strict=True):
        cv2.fillPoly(mask, [corners[first:last]], 255, cv2.LINE_AA, 4)
    shaded = np.flatnonzero(mask.any(axis=1))
    if not len(shaded):
        return
    margin = PENUMBRA_PX + int(MAX_NOISE * edge_noise_m / MIN_STEP_M)
    rows = slice(max(shaded[0] - margin, 0), shaded[-1] + margin + 1)
    shadow = _perturb_edges(mask, ground, rows, edge_noise_m) if edge_noise_m else mask[rows]
    # A penumbra of about a pixel; it is a few centimetres wide at car height.
    sun[rows] *= 1 - cv2.GaussianBlur(shadow, (0, 0), 0.8).astype(np.float32) * np.float32(0.97 / 255)


def _perturb_edges(mask: np.ndarray, ground: Ground, rows: slice, shift_m: float) -> np.ndarray:
    """Rows of the mask, with edges displaced by noise of about `shift_m` on the ground, as by twigs and leaves."""
    part, tile = ground.crop(rows), band_noise_tile(LEAF_SEED, octaves=3)
    shift_d, shift_s = (sample_noise(tile, part.along, part.d + add, wave_s_m=0.20, wave_d_m=0.15) for add in (0, 7))
    v, u = np.indices(part.s.shape, np.float32)
    u += np.float32(shift_m) * shift_d / np.maximum(np.abs(part.d_u), 1e-3)
    v += rows.start + np.float32(shift_m) * shift_s / np.maximum(part.footprint_s, MIN_STEP_M)
    return cv2.remap(mask, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _densify(polygons: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) of all polygons, one after the other, and the index after the last point of each.

    Long edges are subdivided, because the lens distorts straight lines. Points are clipped to MIN_SHADOW_M ahead.
    """
    points = np.concatenate(polygons).astype(float)
    last = np.cumsum([len(p) for p in polygons]) - 1
    following = np.arange(1, len(points) + 1)
    following[last] = np.concatenate([[0], last[:-1] + 1])
    edges = points[following] - points
    parts = np.clip(np.hypot(*edges.T) / EDGE_M, 1, 12).astype(int)
    until = np.cumsum(parts)
    share = (np.arange(until[-1]) - np.repeat(until - parts, parts)) / np.repeat(parts, parts)
    dense = np.repeat(points, parts, axis=0) + share[:, None] * np.repeat(edges, parts, axis=0)
    dense[:, 0] = np.maximum(dense[:, 0], MIN_SHADOW_M)
    return dense, until[last]
