"""What some cameras draw into their pictures, and what stands in front of the road: it
never moves.
"""

from __future__ import annotations

import cv2
import numpy as np

WHITE = (245, 245, 245)
YELLOW = (255, 220, 0)


def draw_guide_lines(image: np.ndarray, *, spread: float = 0.33) -> np.ndarray:
    """Two lines that converge ahead, as parking and driving aids draw them; not towards
    the road's vanishing point.

    `spread` is their distance from the middle at the lower border, relative to the
    width.
    """
    height, width = image.shape[:2]
    top = np.array([0.5 * width, 0.6 * height])
    drawn = image.copy()
    for side in (-1, 1):
        bottom = np.array([(0.5 + spread * side) * width, height])
        start = top + 0.25 * (bottom - top)
        ends = [tuple(int(v) for v in point) for point in (start, bottom)]
        cv2.line(drawn, *ends, YELLOW, max(width // 200, 2), cv2.LINE_AA)
    return drawn


def draw_striped_bonnet(image: np.ndarray) -> np.ndarray:
    """A red bonnet with two white stripes in the lowest 14 % of the picture."""
    height, width = image.shape[:2]
    y, x = np.mgrid[0:height, 0:width]
    beside = (x - 0.5 * width) / (0.5 * width)
    bonnet = y > height * (0.86 + 0.1 * beside**2)
    growth = 1 + 0.6 * (y - 0.86 * height) / (0.14 * height)
    stripes = np.abs(np.abs(beside) - 0.36 * growth) < 0.036
    drawn = image.copy()
    drawn[bonnet] = (150, 20, 20)
    drawn[bonnet & stripes] = WHITE
    return drawn
