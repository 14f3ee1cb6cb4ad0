"""Learned marking response: a small network states for each cell of the view the probability that it is paint.

A worn line and a row of Botts' dots are too faint in each row of the view for the band filter, but they line up over
many rows. The network sees three rows of a finer view for each row, and its surroundings: 27 rows, and half a metre to
either side. It has learned from rendered pictures only (`tools/train_marking_network.py`).

It is used for stills (`lanes.stills`): where the camera pose was estimated from a single picture, and where the lane
of the band filter is not sure. It takes sixty times as long as the band filter of
`lanes.detect.paint`, too long for the tracker, which sees each line in many frames.

Each cell is compared with its wider surroundings in three ways. Lightness and yellowness relative to their scatter make
the response nearly independent of exposure. Lightness relative to its mean shows that a faint streak on a very smooth
road is not paint. A fourth input is the width of a pixel in cells: far away, lines are as wide as their blur.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.paint import (
    MARKINGS,
    FrameEvidence,
    MarkingResponse,
    Stripes,
    find_stripes,
    lightness,
    peak_position,
    yellowness,
)

NETWORK_FILE = Path(__file__).with_name("marking_network.onnx")


@dataclass(frozen=True)
class NetworkParameters:
    """Inputs of the network: its weights have to be trained again if one of these numbers changes."""

    # Rows of the finer view for each row of the view.
    fine_rows: int = 3
    # Windows along a row, and rows of the finer view, of the mean that a cell is compared with, and of the scatter
    # around such means: wheel tracks are wider than the first, so they are no scatter.
    mean_window_m: float = 1.05
    scatter_window_m: float = 2.5
    window_rows: int = 15
    # Grey levels, added to the scatter: rounding and sensor noise.
    scatter_floor: float = 2.0
    # Grey levels, added to the mean lightness, so that black pictures have no contrast.
    lightness_floor: float = 16.0


NETWORK = NetworkParameters()
# Larger log odds are no more certain: rendered pictures are not real ones.
MAX_LOG_ODDS = 6.0
# Columns in which the band filter's peak is the same stripe as the network's, nearest first.
PLACED_WITHIN = np.array([0, -1, 1, -2, 2])
# The network keeps its input, so threads use it one after the other.
_NETWORK_IN_USE = threading.Lock()


def learned_evidence(image: np.ndarray, band: FrameEvidence) -> FrameEvidence:
    """Learned marking response and stripe candidates of a raw picture, from the evidence of the band filter in it."""
    view = band.view
    response = MarkingResponse(network_strength(image, view), band.response.channels, learned=True)
    return replace(band, response=response, stripes=place(find_stripes(response, view), band.response.strength, view))


@lru_cache(maxsize=2)
def finer_view(view: BirdsEyeView) -> BirdsEyeView:
    """The view with `NETWORK.fine_rows` rows for each of its rows; their middle one is at the same distance."""
    n = NETWORK.fine_rows
    growth = (1 + view.growth) ** (1 / n) - 1
    near_m = view.x_m[-1] / (1 + growth) ** (n // 2)
    # half a row beyond the farthest one, so that rounding does not drop it
    far_m = near_m * (1 + growth) ** (n * len(view.x_m) - 0.5)
    return replace(view, near_m=near_m, far_m=far_m, growth=growth)


def network_inputs(fine_image: np.ndarray, fine: BirdsEyeView, focal_px: float) -> np.ndarray:
    """Inputs of the network (4, fine rows, columns) float32, of a picture (fine rows, columns, 3) of the finer view.

    `focal_px` is that of the raw picture.
    """
    light, yellow = (channel(fine_image).astype(np.float32) for channel in (lightness, yellowness))
    mean, yellow_mean = (_window_mean(cells, NETWORK.mean_window_m, fine) for cells in (light, yellow))
    contrast, yellow_contrast = light - mean, yellow - yellow_mean
    pixel_width = np.log2(1 + fine.x_m / (focal_px * fine.cell_m)).astype(np.float32)
    return np.stack(
        [
            contrast / (_scatter(contrast, fine) + NETWORK.scatter_floor),
            yellow_contrast / (_scatter(yellow_contrast, fine) + NETWORK.scatter_floor),
            contrast / (mean + NETWORK.lightness_floor),
            np.broadcast_to(pixel_width[:, None], light.shape),
        ]
    )


def _window_mean(cells: np.ndarray, window_m: float, fine: BirdsEyeView) -> np.ndarray:
    """Mean of the cells (rows, columns), float32, around each cell."""
    return cv2.blur(cells, (round(window_m / fine.cell_m) | 1, NETWORK.window_rows))


def _scatter(contrast: np.ndarray, fine: BirdsEyeView) -> np.ndarray:
    """Root mean square of the contrast (rows, columns) around each cell."""
    # OpenCV's running sums may round a zero down
    return np.sqrt(np.maximum(_window_mean(contrast * contrast, NETWORK.scatter_window_m, fine), 0))


def network_strength(image: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """Strength (rows, columns) float32 of each cell of the view of a raw picture; 0 outside the picture.

    The weight of a cell, `lanes.detect.paint.strength_weight`, is the probability that the network states.
    """
    fine = finer_view(view)
    inputs = network_inputs(fine.warp(image), fine, view.focal_px)
    with _NETWORK_IN_USE:
        network = _read_network()
        network.setInput(inputs[None])
        log_odds = np.minimum(network.forward()[0, 0], MAX_LOG_ODDS)
    return cv2.copyTo(MARKINGS.half_weight_strength * np.exp(log_odds / 2), view.seen.view(np.uint8))


@lru_cache(maxsize=1)
def _read_network() -> cv2.dnn.Net:
    # OpenCV cannot open all names of folders on Windows
    return cv2.dnn.readNetFromONNX(np.frombuffer(NETWORK_FILE.read_bytes(), np.uint8))


def place(stripes: Stripes, band_strength: np.ndarray, view: BirdsEyeView) -> Stripes:
    """The stripes; those that are clear stripes for the band filter, too, at its position: it is more exact."""
    column = np.rint((view.y_m[0] - stripes.y_m) / view.cell_m).astype(int)
    nearby = np.clip(column[:, None] + PLACED_WITHIN, 1, view.shape[1] - 2)
    peak = nearby[np.arange(len(nearby)), band_strength[stripes.row[:, None], nearby].argmax(axis=1)]
    y_m = view.y_m[0] - peak_position(band_strength, stripes.row, peak) * view.cell_m
    clear = band_strength[stripes.row, peak] > MARKINGS.half_weight_strength
    return replace(stripes, y_m=np.where(clear, y_m, stripes.y_m))
