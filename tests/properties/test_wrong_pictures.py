"""Every function that expects a (height, width, 3) uint8 picture refuses other arrays with a sentence."""

from __future__ import annotations

import numpy as np
import pytest

from classic import threshold
from lanes.camera import undistort
from lanes.chessboard import Board, draw_board, find_board
from lanes.errors import PictureError
from lanes.images import require_rgb
from simulator.scenes.dashcam import DASHCAM

BOARD = Board(np.zeros((20, 2), np.float32), 5, 4, (40, 40))
COLOUR_FUNCTIONS = {
    "require_rgb": require_rgb,
    "undistort": lambda image: undistort(image, DASHCAM),
    "find_board": find_board,
    "draw_board": lambda image: draw_board(image, BOARD),
    "to_gray": threshold.to_gray,
    "split into RGB": lambda image: threshold.split_channels(image, "RGB"),
    "split into HLS": lambda image: threshold.split_channels(image, "HLS"),
    "saturation_mask": threshold.saturation_mask,
    "yellow_mask": threshold.yellow_mask,
    "equalized_white_mask": threshold.equalized_white_mask,
    "recipe A": threshold.HlsSobelThresholds().masks,
    "recipe B": threshold.EqualizedHsvThresholds().masks,
    "recipe C": threshold.BestChannelThresholds().masks,
}


@pytest.mark.parametrize("function", COLOUR_FUNCTIONS.values(), ids=COLOUR_FUNCTIONS)
@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (np.zeros((40, 40), np.uint8), r"expected an RGB image .* got shape \(40, 40\), dtype uint8"),
        (np.zeros((40, 40, 4), np.uint8), r"expected an RGB image .* got shape \(40, 40, 4\)"),
        (np.zeros((40, 40, 3)), "expected an RGB image .* dtype float64"),
        (np.zeros((0, 40, 3), np.uint8), r"holds no pixels \(shape \(0, 40, 3\)\)"),
        (None, "expected an RGB image .* got NoneType"),
    ],
    ids=["gray", "rgba", "float", "empty", "none"],
)
def test_other_arrays_are_refused(function, wrong, sentence):
    with pytest.raises(PictureError, match=sentence):
        function(wrong)
