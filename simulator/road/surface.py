"""The road surface: materials, pavement, patches, seams and verges, and their albedo at the ground points of a view."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from simulator.painting import blend_pixels, fade, sample_noise
from simulator.road.ground import Ground, dash_coverage, edge_coverage, strip_coverage

TAR = (0.028, 0.027, 0.029)
# Largest displacement of the edges of a patch: five standard deviations of the noise of 3 cm.
EDGE_NOISE_M = 0.15
# Linear reflectance in a dry summer, 1.0 = white paint.
GRAVEL = np.array([0.30, 0.255, 0.185], np.float32)
DIRT = np.array([0.34, 0.265, 0.165], np.float32)
VERGE_GRASS = np.array([0.40, 0.285, 0.135], np.float32)
DUST = (0.26, 0.235, 0.215)
# Index of the blotches in the noise layers.
BLOTCH = 1
# Width of the dust on the pavement, and its coverage at the edge.
DUST_REACH_M = 2.0
DUST_SHARE = 0.22


@dataclass(frozen=True)
class Material:
    """Pavement material: mean reflectance (linear RGB, 1.0 = white paint) and the strength of each texture.

    Strengths are relative changes of reflectance: `grain` for single stones, `blotch` for uneven colour, `stain` for
    scattered dark spots, `streak` for wear along the road, `track` for the wheel tracks, `oil` for the middle of the
    lane. `slab_m` > 0 is the distance of transverse joints.
    """

    colour: tuple[float, float, float]
    grain: float
    blotch: float
    stain: float
    streak: float
    track: float
    oil: float
    slab_m: float = 0.0


# Colour, then grain, blotch, stain, streak, track, oil.
MATERIALS = {
    "fresh asphalt": Material((0.075, 0.070, 0.085), 0.15, 0.05, 0.05, 0.05, 0.07, -0.08),
    "asphalt": Material((0.106, 0.100, 0.105), 0.15, 0.07, 0.12, 0.06, 0.08, -0.12),
    "grey asphalt": Material((0.128, 0.124, 0.127), 0.13, 0.05, 0.06, 0.04, 0.05, -0.06),
    "grey concrete": Material((0.262, 0.252, 0.250), 0.10, 0.05, 0.07, 0.04, -0.04, -0.06),
    "old asphalt": Material((0.165, 0.152, 0.148), 0.14, 0.09, 0.16, 0.07, -0.07, -0.16),
    "concrete": Material((0.60, 0.515, 0.445), 0.07, 0.07, 0.20, 0.05, -0.06, -0.15, slab_m=4.6),
    "old concrete": Material((0.27, 0.25, 0.235), 0.11, 0.08, 0.16, 0.08, -0.06, -0.14),
    "dirt": Material((0.30, 0.235, 0.15), 0.20, 0.16, 0.10, 0.10, 0.24, -0.16),
    "paint": Material((0.80, 0.79, 0.75), 0.08, 0.08, 0.30, 0.05, 0.0, 0.0),
}


@dataclass(frozen=True)
class Zone:
    """Pavement of one material from arc length `start_m` on; its edge crosses the road with slope `skew` (ds/dd)."""

    start_m: float
    material: str
    skew: float = 0.0


@dataclass(frozen=True)
class Patch:
    """Rectangle of another material: a repair or a trench."""

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    material: str


@dataclass(frozen=True)
class Seam:
    """Line along the road at `lateral_m`, of tar or another colour: lateral noise `wander_m`, edges `soft_m` wide."""

    lateral_m: float
    width_m: float = 0.03
    wander_m: float = 0.02
    start_m: float = -1e5
    end_m: float = 1e5
    strength: float = 0.7
    colour: tuple[float, float, float] = TAR
    soft_m: float = 0.0


@dataclass(frozen=True)
class Surface:
    """Cross section of the ground: pavement, its flaws, and the verges.

    The first of the zones extends backwards without end. `lane_centres_m` are the centres of the lanes, which have
    wheel tracks. `gravel_m` is the width of the gravel strip between pavement and grass, `opposite_m` the lateral edges
    of the other carriageway, `verge_tint` a factor on the colours of gravel and grass.
    """

    zones: tuple[Zone, ...]
    right_edge_m: float
    left_edge_m: float
    lane_centres_m: tuple[float, ...] = (0.0,)
    gravel_m: float = 1.2
    opposite_m: tuple[float, float] | None = None
    patches: tuple[Patch, ...] = ()
    seams: tuple[Seam, ...] = ()
    verge_tint: tuple[float, float, float] = (1.0, 1.0, 1.0)


def ground_albedo(surface: Surface, ground: Ground, *, seed: int) -> np.ndarray:
    """Reflectance (rows, width, 3) of the ground without markings, linear float32 RGB, 1.0 = white paint."""
    layers = _noise_layers(surface, ground, seed)
    albedo = _pavement(surface, ground, layers)
    for patch in surface.patches:
        _paint_patch(albedo, patch, ground, layers)
    for number, seam in enumerate(surface.seams):
        _paint_seam(albedo, seam, ground, seed + 50 + number)
    _paint_verge(albedo, surface, ground, layers[BLOTCH], seed=seed + 11)
    return albedo


def _noise_layers(surface: Surface, ground: Ground, seed: int) -> np.ndarray:
    """Noise (6, rows, width) shared by all materials: grain, blotch, stain, streak, and the wear track and oil.

    Each has about unit strength near the car, and is attenuated by the footprint.
    """
    footprint, s = ground.footprint_s, ground.along
    grain = np.zeros_like(s)
    for number, (wave, strength) in enumerate(((0.022, 1.0), (0.06, 0.7), (0.25, 0.25))):
        # Only rows near enough to resolve this grain.
        near = footprint[:, s.shape[1] // 2] < 3 * wave
        first = int(np.argmax(near)) if near.any() else len(s)
        if first < len(s):
            # Stretched along the road, because the car moves 2 to 3 cm during the exposure.
            near_ground = ground.rows(slice(first, None))
            grain[first:] += near_ground.noise(seed + number, (2 * wave, wave), fading_m=wave) * np.float32(strength)
    # Stains are stretched in the direction of travel.
    blotch = ground.noise(seed + 7, (2.2, 0.45), octaves=4, fading_m=10.0)
    streak = ground.noise(seed + 8, (18.0, 0.22), octaves=3) * fade(ground.footprint_d, 0.3)
    track, oil = _wear_profiles(surface, ground.d)
    uneven = 1 + np.float32(0.35) * ground.noise(seed + 7, (6.0, 1.3), octaves=4)
    spots = ground.noise(seed + 9, (0.7, 0.16), octaves=3)
    # Oil and rubber lie in the wheel tracks, so dark areas have more spots.
    stain = np.clip(spots - 1.1 + np.float32(0.35) * blotch + np.float32(0.3) * (oil + track), 0, 1.5)
    stain *= fade(footprint, 6.0)
    return np.stack([grain, blotch, stain, streak, track * uneven, oil * uneven])


def _wear_profiles(surface: Surface, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wheel tracks (0.85 m to either side of a lane's centre) and oil streak (centre), each evaluated at d."""
    step = 0.02
    at = np.arange(-40, 40, step)
    track, oil = np.zeros_like(at), np.zeros_like(at)
    for centre in surface.lane_centres_m:
        track += np.exp(-(((np.abs(at - centre) - 0.85) / 0.30) ** 2))
        oil += np.exp(-(((at - centre) / 0.38) ** 2))
    index = ((d + np.float32(40)) / np.float32(step)).astype(np.intp)
    # mode="clip" repeats the ends and saves numpy the bounds check.
    track, oil = (profile.astype(np.float32).take(index, mode="clip") for profile in (track, oil))
    return track, oil


def _pavement(surface: Surface, ground: Ground, layers: np.ndarray) -> np.ndarray:
    """Reflectance (rows, width, 3) of the zones, each computed only in the rows that show it."""
    s, zones = ground.along, sorted(surface.zones, key=lambda zone: zone.start_m)
    first = max(sum(zone.start_m < s.min() - 10 for zone in zones), 1)
    albedo = cv2.merge([*_material(zones[first - 1].material, ground, layers)])
    for zone in zones[first:]:
        rows = (s > zone.start_m - 10).any(axis=1, keepdims=True)
        pixels = np.flatnonzero(np.broadcast_to(rows, s.shape))
        part, part_layers = ground.at(pixels), _at(pixels, layers)
        # The edge is irregular by a few centimetres.
        t = part.along - np.float32(zone.start_m) - np.float32(zone.skew) * part.d
        t += np.float32(0.05) * part_layers[BLOTCH]
        share = edge_coverage(t, part.s_u, part.s_v)
        blend_pixels(albedo, pixels, share, _material(zone.material, part, part_layers))
    return albedo


def _material(name: str, ground: Ground, layers: np.ndarray) -> np.ndarray:
    """Reflectance (3, ...) of a material on ground (...), with the noise layers (6, ...) there."""
    material, (grain, blotch, stain, streak, track, oil) = MATERIALS[name], layers
    tone = 1 + np.float32(material.grain) * grain + np.float32(material.blotch) * blotch
    tone += np.float32(material.streak) * streak - np.float32(material.stain) * stain
    tone += np.float32(material.track) * track + np.float32(material.oil) * oil
    if material.slab_m:
        joint = dash_coverage(ground.along, ground.footprint_s, 0.02, material.slab_m)
        tone -= np.float32(0.35) * joint
    return np.multiply.outer(np.array(material.colour, np.float32), np.maximum(tone, np.float32(0.25)))


def _at(pixels: np.ndarray, layers: np.ndarray) -> np.ndarray:
    """Noise layers (6, K) at indices (K,) into the raveled rows and columns."""
    return layers.reshape(len(layers), -1)[:, pixels]


def _paint_patch(albedo: np.ndarray, patch: Patch, ground: Ground, layers: np.ndarray) -> None:
    pixels = ground.pixels_between(patch.low_m - EDGE_NOISE_M, patch.high_m + EDGE_NOISE_M)
    # A parking stall fills 2 % of the image.
    along, reach = ground.along.ravel()[pixels], ground.footprint_s.ravel()[pixels] / 2 + EDGE_NOISE_M
    pixels = pixels[(along + reach > patch.start_m) & (along - reach < patch.end_m)]
    part, layers = ground.at(pixels), _at(pixels, layers)
    wobble = np.float32(0.03) * layers[BLOTCH]
    ends = np.array([patch.start_m, patch.end_m], np.float32)[:, None]
    beyond_start, beyond_end = edge_coverage(part.along - ends + wobble, part.s_u, part.s_v)
    share = (beyond_start - beyond_end) * strip_coverage(part.d + wobble, part.d_u, part.d_v, patch.low_m, patch.high_m)
    blend_pixels(albedo, pixels, share, _material(patch.material, part, layers))


def _paint_seam(albedo: np.ndarray, seam: Seam, ground: Ground, seed: int) -> None:
    margin = seam.width_m + 3 * seam.wander_m + seam.soft_m
    pixels = ground.pixels_between(seam.lateral_m - margin, seam.lateral_m + margin)
    along = ground.along.ravel()[pixels]
    pixels = pixels[(along > seam.start_m) & (along < seam.end_m)]
    part = ground.at(pixels)
    middle = np.zeros_like(part.d)
    bend, thick = (sample_noise(seed, part.along, middle + d, (2.4, 1.0), octaves=3) for d in (0, 31))
    width = np.float32(seam.width_m) * (1 + np.float32(0.4) * np.clip(thick, -2, 2))
    offset = part.d - np.float32(seam.lateral_m) - np.float32(seam.wander_m) * bend
    d_u = np.abs(part.d_u) + np.float32(seam.soft_m)
    beyond_low, beyond_high = edge_coverage(offset + np.stack([width, -width]) / 2, d_u, part.d_v)
    share = np.clip(beyond_low - beyond_high, 0, 1) * np.float32(seam.strength)
    blend_pixels(albedo, pixels, share, np.array(seam.colour, np.float32))


def _paint_verge(albedo: np.ndarray, surface: Surface, ground: Ground, blotch: np.ndarray, *, seed: int) -> None:
    """Paint the ground next to the pavement onto the reflectance, in place; `blotch` (rows, width) is noise."""
    beyond = np.maximum(ground.d - np.float32(surface.left_edge_m), np.float32(surface.right_edge_m) - ground.d)
    pixels = np.flatnonzero(beyond > -ground.footprint_d - np.float32(DUST_REACH_M))
    ground, beyond = ground.at(pixels), beyond.ravel()[pixels]
    d_u, d_v = ground.d_u, ground.d_v
    rough = ground.noise(seed, (0.5, 0.3), octaves=4, fading_m=3.0)
    broad = ground.noise(seed, (5.0, 1.8), octaves=4, fading_m=30.0, shift_m=5)
    fine = ground.noise(seed + 1, (0.12, 0.07), fading_m=0.2)
    tufts = np.minimum(ground.noise(seed + 2, (0.6, 0.22)), 0.6) * fade(ground.footprint_s, 1.5)
    # Dry grass in tufts, with bare soil and dark gaps; its border follows the tufts.
    grass = VERGE_GRASS[:, None] * (1 + 0.20 * broad)
    grass += np.clip(0.35 * broad - 0.2, 0, 0.6) * (DIRT[:, None] - grass)
    grass *= np.maximum(1 + 0.22 * rough + 0.35 * fine + 0.25 * tufts, 0.12)
    to_grass = edge_coverage(beyond - np.float32(surface.gravel_m) + 0.15 * rough + 0.2 * broad, d_u + 0.5, d_v)
    verge = GRAVEL[:, None] * (1 + 0.16 * rough + 0.15 * fine)
    verge += to_grass * (grass - verge)
    verge *= np.array(surface.verge_tint, np.float32)[:, None]
    if surface.opposite_m is not None:
        # Plain asphalt, because barriers hide most of it.
        asphalt = np.array(MATERIALS["asphalt"].colour, np.float32)[:, None] * (1 + 0.1 * blotch.ravel()[pixels])
        verge += strip_coverage(ground.d, d_u, d_v, *surface.opposite_m) * (asphalt - verge)
    share = edge_coverage(beyond + np.float32(0.02) * rough + np.float32(0.04) * broad, d_u, d_v)
    dust = np.clip(1 + beyond / np.float32(DUST_REACH_M), 0, 1) ** 2 * np.maximum(1 + 0.5 * rough + 0.3 * broad, 0)
    share += (1 - share) * np.float32(DUST_SHARE) * dust
    blend_pixels(albedo, pixels, share, verge)
