"""Evidence: what one image shows of lane markings in a bird's-eye view, from all sources combined.

Each source states for each cell how much it looks like paint: the band filter (`lanes.detect.paint`), our network
(`lanes.detect.network`) and the mask of a foreign network (`lanes.detect.markings`). Their strengths have one scale,
the root of the odds of paint. Band filter and network fail in different places; their combined strength has the mean
of their log odds. A foreign mask takes their place or joins them. The network also states where the road ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.markings import Mask
from lanes.detect.network import network_strengths
from lanes.detect.paint import (
    PAINT,
    MarkingResponse,
    PaintSettings,
    Stripes,
    find_stripes,
    marking_response,
    peak_position,
)


@dataclass(frozen=True, eq=False)
class Evidence:
    """What one image shows in a view; `view_image` (rows, columns, 3), uint8, is its bird's-eye view.

    `response` is the combined one, `sources` names what it was combined from.
    """

    view: BirdsEyeView
    view_image: np.ndarray
    response: MarkingResponse
    stripes: Stripes
    sources: tuple[str, ...] = ("band filter",)
    confidence_shift: float = 0.0

    def at_height(self, height_m: float) -> Evidence:
        """The same evidence for another height of the camera, to which all distances on the road are proportional."""
        factor, stripes = height_m / self.view.height_m, self.stripes
        scaled = {name: factor * getattr(stripes, name) for name in ("x_m", "y_m", "std_m")}
        return replace(self, view=self.view.at_height(height_m), stripes=replace(stripes, **scaled))


def find_evidence(
    image: np.ndarray,
    view: BirdsEyeView,
    settings: PaintSettings = PAINT,
    *,
    mask: Mask | None = None,
    quick: bool = False,
) -> Evidence:
    """The evidence in a raw RGB image.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
    view : BirdsEyeView
    settings : PaintSettings
    mask : Mask, optional
        That of a foreign network. Unless it goes with our own, it takes the place of the other sources.
    quick : bool
        Leave our network out: it takes sixty times as long as the band filter.
    """
    view_image = view.warp(image)
    band = marking_response(view_image, view, settings)
    strength, sources, edges = band.strength, ["band filter"], None
    own = mask is None or mask.with_own
    if own and not quick:
        paint, edges = network_strengths(image, view, settings)
        # the mean of the log odds; a response below the noise says nothing against paint
        strength = np.sqrt(np.maximum(strength, np.float32(settings.least_strength) * view.seen) * paint)
        sources.append("network")
    if mask is not None:
        of_mask = mask.strength(view, settings)
        strength, sources = (np.maximum(strength, of_mask), [*sources, "mask"]) if own else (of_mask, ["mask"])
    response = replace(band, strength=strength)
    stripes = find_stripes(response, view, settings)
    if strength is not band.strength:
        stripes, band_strength = place(stripes, band.strength, view, settings)
        if mask is not None:
            # a stripe of a mask alone is as exact as its pixels, and has no profile
            cell_px = 1 if own else max(view.camera.width / mask.probability.shape[1], 1)
            std_m = np.where(band_strength > settings.half_weight_strength, 1, cell_px) * stripes.std_m
            stripes = replace(stripes, std_m=std_m, measurable=band_strength > settings.min_strength)
    if edges is not None:
        stripes = stripes.joined(_edge_stripes(replace(band, strength=edges), view, settings))
    shift = mask.confidence_shift if mask else 0.0
    return Evidence(view, view_image, response, stripes, tuple(sources), shift)


def _edge_stripes(response: MarkingResponse, view: BirdsEyeView, settings: PaintSettings) -> Stripes:
    """Candidates for edges of the road, with less weight and a larger standard deviation than paint."""
    edges = find_stripes(response, view, settings)
    std_m, weight = np.hypot(edges.std_m, settings.edge_std_m), settings.edge_weight * edges.weight
    return replace(edges, weight=weight, std_m=std_m, edge=np.ones(len(edges), bool))


def place(
    stripes: Stripes, band_strength: np.ndarray, view: BirdsEyeView, settings: PaintSettings = PAINT
) -> tuple[Stripes, np.ndarray]:
    """The stripes, at the more exact position of the band filter where they are clear for it; its strength at each."""
    column = np.rint((view.y_m[0] - stripes.y_m) / view.cell_m).astype(int)
    # within two columns a peak of the band filter is the same stripe, the nearest one first
    nearby = np.clip(column[:, None] + [0, -1, 1, -2, 2], 1, view.shape[1] - 2)
    peak = nearby[np.arange(len(nearby)), band_strength[stripes.row[:, None], nearby].argmax(axis=1)]
    y_m = view.y_m[0] - peak_position(band_strength, stripes.row, peak) * view.cell_m
    strength = band_strength[stripes.row, peak]
    return replace(stripes, y_m=np.where(strength > settings.half_weight_strength, y_m, stripes.y_m)), strength
