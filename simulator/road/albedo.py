"""Albedo of the road surface and its verges at the ground points of a view."""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np

from simulator.painting.brush import blend_pixels
from simulator.painting.noise import band_noise_tile, fade, sample_noise
from simulator.road.ground import Ground, dash_coverage, edge_coverage, strip_coverage
from simulator.road.surface import MATERIALS, Material, Patch, Seam, Surface

# Largest displacement of the edges of a patch: five standard deviations of the noise of 3 cm.
EDGE_NOISE_M = 0.15
# Linear reflectance in a dry summer, 1.0 = white paint.
GRAVEL = np.array([0.30, 0.255, 0.185], np.float32)
DIRT = np.array([0.34, 0.265, 0.165], np.float32)
VERGE_GRASS = np.array([0.40, 0.285, 0.135], np.float32)
DUST = (0.26, 0.235, 0.215)
# Width of the dust on the pavement, and its coverage at the edge.
DUST_REACH_M = 2.0
DUST_SHARE = 0.22


@dataclass(frozen=True)
class _NoiseLayers:
    """Noise shared by all materials (rows, width): about unit strength near the car, attenuated by the footprint."""

    grain: np.ndarray
    blotch: np.ndarray
    stain: np.ndarray
    streak: np.ndarray
    track: np.ndarray
    oil: np.ndarray

    def crop(self, cut: slice, columns: slice = slice(None)) -> _NoiseLayers:
        """Part of the rows and columns."""
        return _NoiseLayers(*(getattr(self, field.name)[cut, columns] for field in fields(self)))


def ground_albedo(surface: Surface, ground: Ground, *, station_m: float, seed: int) -> np.ndarray:
    """Reflectance (rows, width, 3) of the ground without markings, linear float32 RGB, 1.0 = white paint.

    `station_m` is the arc length of the car.
    """
    s = ground.s + np.float32(station_m)
    layers = _noise_layers(surface, ground, s, seed)
    albedo = _pavement(surface, ground, s, layers)
    for patch in surface.patches:
        _paint_patch(albedo, patch, ground, s, layers)
    for number, seam in enumerate(surface.seams):
        _paint_seam(albedo, seam, ground, s, seed + 50 + number)
    _paint_verge(albedo, surface, ground, s, layers.blotch, seed=seed + 11)
    return albedo


def _noise_layers(surface: Surface, ground: Ground, s: np.ndarray, seed: int) -> _NoiseLayers:
    """Noise layers, including the wear across the lanes."""
    footprint = ground.footprint_s
    grain = np.zeros_like(s)
    for number, (wave, strength) in enumerate(((0.022, 1.0), (0.06, 0.7), (0.25, 0.25))):
        # Only rows near enough to resolve this grain.
        near = footprint[:, s.shape[1] // 2] < 3 * wave
        first = int(np.argmax(near)) if near.any() else len(s)
        if first < len(s):
            # Stretched along the road, because the car moves 2 to 3 cm during the exposure.
            part = sample_noise(
                band_noise_tile(seed + number), s[first:], ground.d[first:], wave_s_m=2 * wave, wave_d_m=wave
            )
            grain[first:] += part * fade(footprint[first:], wave) * np.float32(strength)
    tile = band_noise_tile(seed + 7, octaves=4)
    # Stains are stretched in the direction of travel.
    blotch = sample_noise(tile, s, ground.d, wave_s_m=2.2, wave_d_m=0.45) * fade(footprint, 10.0)
    streak = sample_noise(band_noise_tile(seed + 8, octaves=3), s, ground.d, wave_s_m=18.0, wave_d_m=0.22)
    track, oil = _wear_profiles(surface, ground.d)
    uneven = 1 + np.float32(0.35) * sample_noise(tile, s, ground.d, wave_s_m=6.0, wave_d_m=1.3)
    spots = sample_noise(band_noise_tile(seed + 9, octaves=3), s, ground.d, wave_s_m=0.7, wave_d_m=0.16)
    # Oil and rubber lie in the wheel tracks, so dark areas have more spots.
    stain = np.clip(spots - 1.1 + np.float32(0.35) * blotch + np.float32(0.3) * (oil + track), 0, 1.5)
    stain *= fade(footprint, 6.0)
    return _NoiseLayers(grain, blotch, stain, streak * fade(ground.footprint_d, 0.3), track * uneven, oil * uneven)


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


def _pavement(surface: Surface, ground: Ground, s: np.ndarray, layers: _NoiseLayers) -> np.ndarray:
    """Reflectance of the zones, each computed only in the rows that show it."""
    zones = sorted(surface.zones, key=lambda zone: zone.start_m)
    started = [z for z in zones if z.start_m < s.min() - 10]
    albedo = _material(MATERIALS[(started or zones)[-1 if started else 0].material], ground, s, layers)
    for zone in zones[len(started) if started else 1 :]:
        beyond = np.flatnonzero((s > zone.start_m - 10).any(axis=1))
        if not len(beyond):
            break
        cut = slice(0, beyond[-1] + 1)
        part = ground.crop(cut)
        part_layers = layers.crop(cut)
        # The edge is irregular by a few centimetres.
        t = s[cut] - np.float32(zone.start_m) - np.float32(zone.skew) * part.d
        t += np.float32(0.05) * part_layers.blotch
        share = edge_coverage(t, part.s_u, part.s_v)
        _blend(albedo[cut], _material(MATERIALS[zone.material], part, s[cut], part_layers), share)
    return albedo


def _material(material: Material, ground: Ground, s: np.ndarray, layers: _NoiseLayers) -> np.ndarray:
    tone = 1 + np.float32(material.grain) * layers.grain + np.float32(material.blotch) * layers.blotch
    tone += np.float32(material.streak) * layers.streak - np.float32(material.stain) * layers.stain
    tone += np.float32(material.track) * layers.track + np.float32(material.oil) * layers.oil
    if material.slab_m:
        joint = dash_coverage(s, ground.footprint_s, 0.02, material.slab_m)
        tone -= np.float32(0.35) * joint
    np.maximum(tone, np.float32(0.25), out=tone)
    return cv2.merge([tone * np.float32(channel) for channel in material.colour])


def _blend(below: np.ndarray, above: np.ndarray, share: np.ndarray) -> None:
    """Blend `above` over `below` in place with opacity `share`."""
    above -= below
    # cv2.merge, because numpy is slow where the innermost axis has three elements.
    above *= cv2.merge([share] * 3)
    below += above


def _paint_patch(albedo: np.ndarray, patch: Patch, ground: Ground, s: np.ndarray, layers: _NoiseLayers) -> None:
    # Only the rows and columns that show the patch, because a parking stall fills 2 % of the image.
    margin_s, margin_d = (half / 2 + np.float32(EDGE_NOISE_M) for half in (ground.footprint_s, ground.footprint_d))
    near: np.ndarray = cv2.inRange(s, np.float32(patch.start_m) - margin_s, np.float32(patch.end_m) + margin_s)
    near &= cv2.inRange(ground.d, np.float32(patch.low_m) - margin_d, np.float32(patch.high_m) + margin_d)
    rows, columns = (np.flatnonzero(near.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return
    cut = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    part, s, part_layers = ground.crop(*cut), s[cut], layers.crop(*cut)
    wobble = np.float32(0.03) * part_layers.blotch
    ends = np.array([patch.start_m, patch.end_m], np.float32)[:, None, None]
    beyond_start, beyond_end = edge_coverage(s - ends + wobble, part.s_u, part.s_v)
    share = (beyond_start - beyond_end) * strip_coverage(part.d + wobble, part.d_u, part.d_v, patch.low_m, patch.high_m)
    _blend(albedo[cut], _material(MATERIALS[patch.material], part, s, part_layers), share)


def _paint_seam(albedo: np.ndarray, seam: Seam, ground: Ground, s: np.ndarray, seed: int) -> None:
    margin = seam.width_m + 3 * seam.wander_m + seam.soft_m
    pixels = ground.pixels_between(seam.lateral_m - margin, seam.lateral_m + margin)
    along = s.ravel()[pixels]
    pixels = pixels[(along > seam.start_m) & (along < seam.end_m)]
    if not len(pixels):
        return
    d, d_u, d_v, along = (array.ravel()[pixels] for array in (ground.d, ground.d_u, ground.d_v, s))
    tile = band_noise_tile(seed, octaves=3)
    bend, thick = (sample_noise(tile, along, np.full_like(along, d0), wave_s_m=2.4, wave_d_m=1.0) for d0 in (0, 31))
    width = np.float32(seam.width_m) * (1 + np.float32(0.4) * np.clip(thick, -2, 2))
    offset = d - np.float32(seam.lateral_m) - np.float32(seam.wander_m) * bend
    d_u = np.abs(d_u) + np.float32(seam.soft_m)
    beyond_low, beyond_high = edge_coverage(offset + np.stack([width, -width]) / 2, d_u, d_v)
    share = np.clip(beyond_low - beyond_high, 0, 1) * np.float32(seam.strength)
    blend_pixels(albedo, pixels, share, np.array(seam.colour, np.float32))


def _paint_verge(
    albedo: np.ndarray, surface: Surface, ground: Ground, s: np.ndarray, blotch: np.ndarray, *, seed: int
) -> None:
    """Paint the ground next to the pavement onto the reflectance (rows, width, 3), in place.

    `s` (rows, width) are arc lengths from the road's start, `blotch` (rows, width) is noise.
    """
    beyond = np.maximum(ground.d - np.float32(surface.left_edge_m), np.float32(surface.right_edge_m) - ground.d)
    pixels = np.flatnonzero(beyond > -ground.footprint_d - np.float32(DUST_REACH_M))
    if not len(pixels):
        return
    arrays = (s, ground.d, ground.d_u, ground.d_v, ground.footprint_s, beyond)
    s, d, d_u, d_v, footprint, beyond = (array.ravel()[pixels] for array in arrays)
    cloudy = band_noise_tile(seed, octaves=4)
    rough = sample_noise(cloudy, s, d, wave_s_m=0.5, wave_d_m=0.3) * fade(footprint, 3.0)
    broad = sample_noise(cloudy, s, d + 5, wave_s_m=5.0, wave_d_m=1.8) * fade(footprint, 30.0)
    fine = sample_noise(band_noise_tile(seed + 1), s, d, wave_s_m=0.12, wave_d_m=0.07) * fade(footprint, 0.2)
    tufts = sample_noise(band_noise_tile(seed + 2), s, d, wave_s_m=0.6, wave_d_m=0.22)
    tufts = np.minimum(tufts, 0.6) * fade(footprint, 1.5)
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
        verge += strip_coverage(d, d_u, d_v, *surface.opposite_m) * (asphalt - verge)
    share = edge_coverage(beyond + np.float32(0.02) * rough + np.float32(0.04) * broad, d_u, d_v)
    dust = np.clip(1 + beyond / np.float32(DUST_REACH_M), 0, 1) ** 2 * np.maximum(1 + 0.5 * rough + 0.3 * broad, 0)
    share += (1 - share) * np.float32(DUST_SHARE) * dust
    blend_pixels(albedo, pixels, share, verge)
