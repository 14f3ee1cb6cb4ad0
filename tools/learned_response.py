"""Run a command with the learned marking response in place of the band filter, for stills.

    python -m tools.learned_response benchmark --labels LABELS --hfov 60 --each-folder --system detector
    python -m tools.learned_response lanes detect --each PICTURE ... -o lanes.jsonl

docs/ablation.md has what this measured: the network is not part of `lanes`. A worn line and a row of Botts' dots are
too faint in each row of the view, but they line up over many rows. The network sees three rows of a finer view for each
row, and its surroundings: 27 rows, and half a metre to either side. `tools.train_marking_network` trains it.

Each cell is compared with its surroundings in three ways. Lightness and yellowness relative to their standard deviation
make the response independent of exposure. Lightness relative to its mean shows that a faint streak on a very smooth
road is not paint.
"""

from __future__ import annotations

import runpy
import sys
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from lanes.io.frames import Frame
from lanes.tracking import detector
from lanes.tracking.birdseye import BirdsEyeView
from lanes.tracking.lane import Lane
from lanes.tracking.markings import (
    MARKINGS,
    FrameEvidence,
    MarkingResponse,
    Stripes,
    find_stripes,
    lightness,
    marking_response,
    peak_position,
    yellowness,
)

NETWORK_FILE = Path(__file__).with_name("marking_network.onnx")


@dataclass(frozen=True)
class NetworkParameters:
    """Inputs of the network: its weights have to be trained again if one of these numbers changes."""

    # Rows of the finer view for each row of the view.
    fine_rows: int = 3
    # Window, along a row and in rows of the finer view, of the mean and the scatter that a cell is compared with.
    window_m: float = 2.5
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


def find_lane(image: Frame, view: BirdsEyeView) -> Lane | None:
    """As `lanes.tracking.detector.find_lane`, with the learned response."""
    return detector.search_lane(extract_learned_evidence(image, view))


def extract_learned_evidence(image: Frame, view: BirdsEyeView) -> FrameEvidence:
    """Learned marking response and stripe candidates of a single raw picture."""
    view_image = view.warp(image)
    band = marking_response(view_image, view)
    response = MarkingResponse(network_strength(finer_view(view).warp(image), view), band.channels)
    return FrameEvidence(view, view_image, response, place(find_stripes(response, view), band.strength, view))


@lru_cache(maxsize=2)
def finer_view(view: BirdsEyeView) -> BirdsEyeView:
    """The view with `NETWORK.fine_rows` rows for each of its rows; their middle one is at the same distance."""
    n = NETWORK.fine_rows
    growth = (1 + view.growth) ** (1 / n) - 1
    near_m = view.x_m[-1] / (1 + growth) ** (n // 2)
    # half a row beyond the farthest one, so that rounding does not drop it
    far_m = near_m * (1 + growth) ** (n * len(view.x_m) - 0.5)
    return replace(view, near_m=near_m, far_m=far_m, growth=growth)


def network_inputs(fine_image: np.ndarray, cell_m: float) -> np.ndarray:
    """Inputs of the network (3, fine rows, columns) float32, of a picture (fine rows, columns, 3) of a finer view."""
    window = round(NETWORK.window_m / cell_m) | 1, NETWORK.window_rows
    light, mean, scatter = _mean_and_scatter(lightness(fine_image), window)
    yellow, yellow_mean, yellow_scatter = _mean_and_scatter(yellowness(fine_image), window)
    contrast, floor = light - mean, NETWORK.scatter_floor
    return np.stack(
        [
            contrast / (scatter + floor),
            (yellow - yellow_mean) / (yellow_scatter + floor),
            contrast / (mean + NETWORK.lightness_floor),
        ]
    )


def _mean_and_scatter(channel: np.ndarray, window: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The channel (rows, columns) as float32, and its mean and standard deviation around each cell."""
    cells = channel.astype(np.float32)
    mean = cv2.blur(cells, window)
    variance = cv2.sqrBoxFilter(cells, cv2.CV_32F, window) - mean * mean
    return cells, mean, np.sqrt(np.maximum(variance, 0))


def network_strength(fine_image: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """Strength (rows, columns) float32 of each cell, from a picture of its finer view; 0 outside the picture.

    The weight of a stripe candidate, `lanes.tracking.markings.marking_weight`, is the probability that the network
    states.
    """
    network = _read_network()
    network.setInput(network_inputs(fine_image, view.cell_m)[None])
    log_odds = np.minimum(network.forward()[0, 0], MAX_LOG_ODDS)
    return cv2.copyTo(MARKINGS.half_weight_strength * np.exp(log_odds / 2), view.seen.view(np.uint8))


@lru_cache(maxsize=1)
def _read_network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(NETWORK_FILE))


def place(stripes: Stripes, band_strength: np.ndarray, view: BirdsEyeView) -> Stripes:
    """The stripes; those that are clear stripes for the band filter, too, at its position: it is more exact."""
    column = np.rint((view.y_m[0] - stripes.y_m) / view.cell_m).astype(int)
    nearby = np.clip(column[:, None] + PLACED_WITHIN, 1, view.shape[1] - 2)
    peak = nearby[np.arange(len(nearby)), band_strength[stripes.row[:, None], nearby].argmax(axis=1)]
    y_m = view.y_m[0] - peak_position(band_strength, stripes.row, peak) * view.cell_m
    clear = band_strength[stripes.row, peak] > MARKINGS.half_weight_strength
    return replace(stripes, y_m=np.where(clear, y_m, stripes.y_m))


def main() -> None:
    """Run a module of the project with the learned response."""
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    # before any other module imports it
    detector.find_lane = find_lane
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
