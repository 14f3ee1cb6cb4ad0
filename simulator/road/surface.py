"""The road surface: materials, pavement, patches, seams, verges, and their albedo."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from simulator.painting import blend_pixels, fade, sample_noise
from simulator.road.ground import Ground, dash_coverage, edge_coverage, strip_coverage

TAR = (0.028, 0.027, 0.029)
# Displacement of the edges of a patch by noise, and its largest value: five standard
# deviations.
EDGE_STD_M = 0.03
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
# Grain of stones: wavelengths in metres, and strengths.
GRAINS = ((0.022, 1.0), (0.06, 0.7), (0.25, 0.25))


@dataclass(frozen=True)
class Material:
    """Pavement material: mean reflectance (linear RGB, 1.0 = white paint) and texture.

    Strengths of a texture are relative changes of reflectance: `grain` for single
    stones, `blotch` for uneven colour, `stain` for scattered dark spots, `streak` for
    wear along the road, `track` for the wheel tracks, `oil` for the middle of the lane.
    `slab_m` > 0 is the distance of transverse joints.
    """

    colour: tuple[float, float, float]
    grain: float
    blotch: float
    stain: float
    streak: float
    track: float
    oil: float
    slab_m: float = 0.0


MATERIALS = {
    "fresh asphalt": Material(
        colour=(0.075, 0.07, 0.085),
        grain=0.15,
        blotch=0.05,
        stain=0.05,
        streak=0.05,
        track=0.07,
        oil=-0.08,
    ),
    "asphalt": Material(
        colour=(0.106, 0.1, 0.105),
        grain=0.15,
        blotch=0.07,
        stain=0.12,
        streak=0.06,
        track=0.08,
        oil=-0.12,
    ),
    "grey asphalt": Material(
        colour=(0.128, 0.124, 0.127),
        grain=0.13,
        blotch=0.05,
        stain=0.06,
        streak=0.04,
        track=0.05,
        oil=-0.06,
    ),
    "grey concrete": Material(
        colour=(0.262, 0.252, 0.25),
        grain=0.1,
        blotch=0.05,
        stain=0.07,
        streak=0.04,
        track=-0.04,
        oil=-0.06,
    ),
    "old asphalt": Material(
        colour=(0.165, 0.152, 0.148),
        grain=0.14,
        blotch=0.09,
        stain=0.16,
        streak=0.07,
        track=-0.07,
        oil=-0.16,
    ),
    "concrete": Material(
        colour=(0.6, 0.515, 0.445),
        grain=0.07,
        blotch=0.07,
        stain=0.2,
        streak=0.05,
        track=-0.06,
        oil=-0.15,
        slab_m=4.6,
    ),
    "old concrete": Material(
        colour=(0.27, 0.25, 0.235),
        grain=0.11,
        blotch=0.08,
        stain=0.16,
        streak=0.08,
        track=-0.06,
        oil=-0.14,
    ),
    "dirt": Material(
        colour=(0.3, 0.235, 0.15),
        grain=0.2,
        blotch=0.16,
        stain=0.1,
        streak=0.1,
        track=0.24,
        oil=-0.16,
    ),
    "paint": Material(
        colour=(0.8, 0.79, 0.75),
        grain=0.08,
        blotch=0.08,
        stain=0.3,
        streak=0.05,
        track=0.0,
        oil=0.0,
    ),
}


@dataclass(frozen=True)
class Zone:
    """Pavement of one material from arc length `start_m` on.

    Its edge crosses the road with slope `skew` (ds/dd).
    """

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
    """Line along the road at `lateral_m`, of tar or another colour.

    `wander_m` is its lateral noise, `soft_m` the width of its edges.
    """

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

    The first of the zones extends backwards without end. `lane_centres_m` are the
    centres of the lanes, which have wheel tracks. `gravel_m` is the width of the gravel
    strip between pavement and grass, `opposite_m` the lateral edges of the other
    carriageway, `verge_tint` a factor on the colours of gravel and grass.
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


def ground_albedo(
    surface: Surface,
    ground: Ground,
    *,
    seed: int,
) -> np.ndarray:
    """Reflectance (rows, width, 3) of the ground without markings.

    Linear float32 RGB, 1.0 = white paint.
    """
    layers = _noise_layers(surface, ground, seed)
    albedo = _pavement(surface, ground, layers)
    for patch in surface.patches:
        _paint_patch(albedo, patch, ground, layers)
    for number, seam in enumerate(surface.seams):
        _paint_seam(albedo, seam, ground, seed + 50 + number)
    _paint_verge(albedo, surface, ground, layers[BLOTCH], seed=seed + 11)
    return albedo


def _noise_layers(
    surface: Surface,
    ground: Ground,
    seed: int,
) -> np.ndarray:
    """Noise (6, rows, width) shared by all materials.

    The layers are grain, blotch, stain, streak, and the wear track and oil. Each has
    about unit strength near the car, and is attenuated by the footprint.
    """
    # Blotches are stretched in the direction of travel.
    blotch = ground.noise(seed + 7, (2.2, 0.45), octaves=4, fading_m=10.0)
    streak = ground.noise(seed + 8, (18.0, 0.22), octaves=3)
    streak = streak * fade(ground.footprint_d, 0.3)
    track, oil = _wear_profiles(surface, ground.d)

    # Oil and rubber lie in the wheel tracks, so dark areas have more spots.
    spots = ground.noise(seed + 9, (0.7, 0.16), octaves=3)
    stain = np.clip(spots - 1.1 + 0.35 * blotch + 0.3 * (oil + track), 0, 1.5)
    stain *= fade(ground.footprint_s, 6.0)

    uneven = 1 + 0.35 * ground.noise(seed + 7, (6.0, 1.3), octaves=4)
    grain = _grain(ground, seed)
    return np.stack([grain, blotch, stain, streak, track * uneven, oil * uneven])


def _grain(ground: Ground, seed: int) -> np.ndarray:
    """Noise (rows, width) of single stones."""
    grain = np.zeros_like(ground.s)
    footprint = ground.footprint_s[:, ground.s.shape[1] // 2]
    for number, (wave_m, strength) in enumerate(GRAINS):
        # Only rows near enough to resolve this grain.
        near = footprint < 3 * wave_m
        if not near.any():
            continue
        first = int(np.argmax(near))
        part = ground.rows(slice(first, None))
        # Stretched along the road, because the car moves 2 to 3 cm during the exposure.
        stretched = (2 * wave_m, wave_m)
        noise = part.noise(seed + number, stretched, fading_m=wave_m)
        grain[first:] += noise * strength
    return grain


def _wear_profiles(
    surface: Surface,
    d: np.ndarray,
) -> list[np.ndarray]:
    """Wheel tracks and oil streak of the lanes, each evaluated at d.

    The tracks are 0.85 m to either side of a lane's centre, the oil is at the centre.
    """
    reach_m = 40
    step_m = 0.02
    lateral = np.arange(-reach_m, reach_m, step_m)
    track = np.zeros_like(lateral)
    oil = np.zeros_like(lateral)
    for centre in surface.lane_centres_m:
        off_track = np.abs(lateral - centre) - 0.85
        track += np.exp(-((off_track / 0.30) ** 2))
        oil += np.exp(-(((lateral - centre) / 0.38) ** 2))

    index = ((d + reach_m) / step_m).astype(np.intp)
    # mode="clip" repeats the ends and saves numpy the bounds check.
    return [
        profile.astype(np.float32).take(index, mode="clip") for profile in (track, oil)
    ]


def _pavement(
    surface: Surface,
    ground: Ground,
    layers: np.ndarray,
) -> np.ndarray:
    """Reflectance (rows, width, 3) of the zones.

    Each is computed only in the rows that show it.
    """
    s = ground.along
    zones = sorted(surface.zones, key=lambda zone: zone.start_m)
    passed = sum(zone.start_m < s.min() - 10 for zone in zones)
    first = max(passed, 1)
    albedo = cv2.merge([*_reflectance(zones[first - 1].material, ground, layers)])
    for zone in zones[first:]:
        rows = (s > zone.start_m - 10).any(axis=1, keepdims=True)
        pixels = np.flatnonzero(np.broadcast_to(rows, s.shape))
        part = ground.at(pixels)
        noise = _at(pixels, layers)
        # The edge is irregular by a few centimetres.
        t = part.along - np.float32(zone.start_m) - np.float32(zone.skew) * part.d
        t += 0.05 * noise[BLOTCH]
        share = edge_coverage(t, part.s_u, part.s_v)
        blend_pixels(albedo, pixels, share, _reflectance(zone.material, part, noise))
    return albedo


def _reflectance(
    name: str,
    ground: Ground,
    layers: np.ndarray,
) -> np.ndarray:
    """Reflectance (3, ...) of a material on ground (...).

    `layers` (6, ...) are the noise layers there.
    """
    material = MATERIALS[name]
    grain, blotch, stain, streak, track, oil = layers
    tone = 1 + material.grain * grain + material.blotch * blotch
    tone += material.streak * streak - material.stain * stain
    tone += material.track * track + material.oil * oil
    if material.slab_m:
        joint = dash_coverage(ground.along, ground.footprint_s, 0.02, material.slab_m)
        tone -= 0.35 * joint
    colour = np.array(material.colour, np.float32)
    return np.multiply.outer(colour, np.maximum(tone, 0.25))


def _at(
    pixels: np.ndarray,
    layers: np.ndarray,
) -> np.ndarray:
    """Noise layers (6, K) at indices (K,) into the raveled rows and columns."""
    return layers.reshape(len(layers), -1)[:, pixels]


def _paint_patch(
    albedo: np.ndarray,
    patch: Patch,
    ground: Ground,
    layers: np.ndarray,
) -> None:
    low = patch.low_m - EDGE_NOISE_M
    high = patch.high_m + EDGE_NOISE_M
    pixels = ground.pixels_between(low, high)
    # A parking stall fills 2 % of the image.
    along = ground.along.ravel()[pixels]
    reach = ground.footprint_s.ravel()[pixels] / 2 + EDGE_NOISE_M
    inside = (along + reach > patch.start_m) & (along - reach < patch.end_m)
    pixels = pixels[inside]
    part = ground.at(pixels)
    layers = _at(pixels, layers)

    wobble = EDGE_STD_M * layers[BLOTCH]
    s = part.along
    start, end = np.array([patch.start_m, patch.end_m], np.float32)
    beyond_start = edge_coverage(s - start + wobble, part.s_u, part.s_v)
    beyond_end = edge_coverage(s - end + wobble, part.s_u, part.s_v)
    across = strip_coverage(
        part.d + wobble, part.d_u, part.d_v, patch.low_m, patch.high_m
    )
    share = (beyond_start - beyond_end) * across
    blend_pixels(albedo, pixels, share, _reflectance(patch.material, part, layers))


def _paint_seam(
    albedo: np.ndarray,
    seam: Seam,
    ground: Ground,
    seed: int,
) -> None:
    margin = seam.width_m + 3 * seam.wander_m + seam.soft_m
    pixels = ground.pixels_between(seam.lateral_m - margin, seam.lateral_m + margin)
    along = ground.along.ravel()[pixels]
    pixels = pixels[(along > seam.start_m) & (along < seam.end_m)]
    part = ground.at(pixels)

    # Noise along the seam alone bends it and changes its width.
    s = part.along
    middle = np.zeros_like(part.d)
    bend = sample_noise(seed, s, middle, (2.4, 1.0), octaves=3)
    thick = sample_noise(seed, s, middle + 31, (2.4, 1.0), octaves=3)
    width = np.float32(seam.width_m) * (1 + 0.4 * np.clip(thick, -2, 2))
    wander = np.float32(seam.wander_m) * bend
    offset = part.d - np.float32(seam.lateral_m) - wander

    d_u = np.abs(part.d_u) + np.float32(seam.soft_m)
    beyond_low = edge_coverage(offset + width / 2, d_u, part.d_v)
    beyond_high = edge_coverage(offset + -width / 2, d_u, part.d_v)
    share = np.clip(beyond_low - beyond_high, 0, 1) * np.float32(seam.strength)
    blend_pixels(albedo, pixels, share, np.array(seam.colour, np.float32))


def _paint_verge(
    albedo: np.ndarray,
    surface: Surface,
    ground: Ground,
    blotch: np.ndarray,
    *,
    seed: int,
) -> None:
    """Paint the ground next to the pavement onto the reflectance, in place.

    `blotch` (rows, width) is noise.
    """
    left = ground.d - np.float32(surface.left_edge_m)
    right = np.float32(surface.right_edge_m) - ground.d
    beyond = np.maximum(left, right)
    pixels = np.flatnonzero(beyond > -ground.footprint_d - DUST_REACH_M)
    part = ground.at(pixels)
    beyond = beyond.ravel()[pixels]
    d_u = part.d_u
    d_v = part.d_v

    rough = part.noise(seed, (0.5, 0.3), octaves=4, fading_m=3.0)
    broad = part.noise(seed, (5.0, 1.8), octaves=4, fading_m=30.0, shift_m=5)
    fine = part.noise(seed + 1, (0.12, 0.07), fading_m=0.2)
    tufts = np.minimum(part.noise(seed + 2, (0.6, 0.22)), 0.6)
    tufts = tufts * fade(part.footprint_s, 1.5)

    # Dry grass in tufts, with bare soil and dark gaps.
    grass = VERGE_GRASS[:, None] * (1 + 0.20 * broad)
    grass += np.clip(0.35 * broad - 0.2, 0, 0.6) * (DIRT[:, None] - grass)
    grass *= np.maximum(1 + 0.22 * rough + 0.35 * fine + 0.25 * tufts, 0.12)

    # Its border with the gravel follows the tufts.
    border = beyond - np.float32(surface.gravel_m) + 0.15 * rough + 0.2 * broad
    to_grass = edge_coverage(border, d_u + 0.5, d_v)
    verge = GRAVEL[:, None] * (1 + 0.16 * rough + 0.15 * fine)
    verge += to_grass * (grass - verge)
    verge *= np.array(surface.verge_tint, np.float32)[:, None]

    if surface.opposite_m is not None:
        # Plain asphalt, because barriers hide most of it.
        colour = np.array(MATERIALS["asphalt"].colour, np.float32)
        asphalt = colour[:, None] * (1 + 0.1 * blotch.ravel()[pixels])
        opposite = strip_coverage(part.d, d_u, d_v, *surface.opposite_m)
        verge += opposite * (asphalt - verge)

    # Dust on the edge of the pavement.
    share = edge_coverage(beyond + 0.02 * rough + 0.04 * broad, d_u, d_v)
    reach = np.clip(1 + beyond / DUST_REACH_M, 0, 1) ** 2
    dust = reach * np.maximum(1 + 0.5 * rough + 0.3 * broad, 0)
    share += (1 - share) * DUST_SHARE * dust
    blend_pixels(albedo, pixels, share, verge)
