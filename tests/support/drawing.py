"""Pictures to draw on, and what holds for every function that draws on a copy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from lanes.errors import PictureError


def read_only_noise() -> np.ndarray:
    """Read-only noise: a function that writes on its input raises, one that copies does not."""
    image = np.random.default_rng(4).integers(0, 256, (96, 160, 3)).astype(np.uint8)
    image.flags.writeable = False
    return image


def gray_picture() -> np.ndarray:
    return np.full((96, 160, 3), 100, np.uint8)


def assert_draws_on_a_copy(function: Callable[[np.ndarray], np.ndarray]) -> None:
    """The input is not changed, whether writable or not; floats are refused with a sentence."""
    for image in (read_only_noise(), gray_picture()):
        before = image.copy()
        drawn = function(image)
        np.testing.assert_array_equal(image, before)
        assert not np.shares_memory(drawn, image)
        assert (drawn.shape, drawn.dtype) == (image.shape, np.uint8)
        assert drawn.flags.writeable
    with pytest.raises(PictureError, match="float64"):
        function(gray_picture() / 255)
