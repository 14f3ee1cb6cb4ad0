"""Learned marking response: a small network states for each cell of the view the probability that it is paint.

A worn line and a row of Botts' dots are too faint in each row of the view for the band filter, but they line up over
many rows. The network sees three rows of a finer view for each row, and its surroundings: 47 rows, and 1.8 m to either
side. Its second output is the probability of an edge of the road. It has learned from rendered images only
(`tools/train_marking_network.py`). It takes much longer than the band filter: the tracker
uses it in five searches a second, while no sure lane is tracked.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.onnx_file import read_onnx
from lanes.detect.paint import PAINT, PaintSettings, lightness, yellowness

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
    # Grey levels, added to the mean lightness, so that black images have no contrast.
    lightness_floor: float = 16.0


NETWORK = NetworkParameters()
# A network keeps its input, so threads use it one after the other.
_NETWORK_IN_USE = threading.Lock()


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
    """Inputs of the network (4, fine rows, columns) float32, of an image (fine rows, columns, 3) of the finer view.

    Lightness and yellowness relative to their scatter make the response nearly independent of exposure. Lightness
    relative to its mean shows that a faint streak on a very smooth road is not paint. The fourth input is the width of
    a pixel in cells: far away, lines are as wide as their blur. `focal_px` is that of the raw image.
    """

    def window_mean(cells: np.ndarray, window_m: float) -> np.ndarray:
        return cv2.blur(cells, (round(window_m / fine.cell_m) | 1, NETWORK.window_rows))

    contrasts, means, scatters = [], [], []
    for channel in (lightness, yellowness):
        cells = channel(fine_image).astype(np.float32)
        means.append(window_mean(cells, NETWORK.mean_window_m))
        contrasts.append(cells - means[-1])
        # OpenCV's running sums may round a zero down
        variance = np.maximum(window_mean(contrasts[-1] ** 2, NETWORK.scatter_window_m), 0)
        scatters.append(np.sqrt(variance) + NETWORK.scatter_floor)
    pixel_width = np.log2(1 + fine.x_m / (focal_px * fine.cell_m)).astype(np.float32)
    relative = contrasts[0] / (means[0] + NETWORK.lightness_floor)
    widths = np.broadcast_to(pixel_width[:, None], relative.shape)
    return np.stack([contrasts[0] / scatters[0], contrasts[1] / scatters[1], relative, widths])


def network_strengths(image: np.ndarray, view: BirdsEyeView, settings: PaintSettings = PAINT) -> np.ndarray:
    """Strengths (2, rows, columns) float32 of paint and of road edges in the view of a raw image; 0 outside the image.

    The weight of a cell, `lanes.detect.paint.strength_weight`, is the probability that the network states.
    """
    fine = finer_view(view)
    inputs = network_inputs(fine.warp(image), fine, view.focal_px)
    # larger log odds are no more certain: rendered images are not real ones
    log_odds = np.minimum(run_network(NETWORK_FILE, inputs[None])[0], 6.0)
    return settings.half_weight_strength * np.exp(log_odds / 2) * view.seen


def run_network(file: Path, inputs: np.ndarray, *, output: str = "", digest: str = "") -> np.ndarray:
    """An output of the network in an ONNX file; by name if it has several. See `read_network` for `digest`."""
    with _NETWORK_IN_USE:
        network = read_network(file, digest)
        network.setInput(inputs)
        return network.forward(output)


@lru_cache(maxsize=2)
def read_network(file: Path, digest: str) -> cv2.dnn.Net:
    """The network in an ONNX file, in the cache until it is called with another `digest` of the file's content.

    Raises LaneError if the file has another digest.
    """
    # OpenCV cannot open all names of folders on Windows
    return cv2.dnn.readNetFromONNX(np.frombuffer(read_onnx(file, digest).data, np.uint8))
