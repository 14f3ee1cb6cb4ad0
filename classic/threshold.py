"""Colour and gradient thresholds: binaries of the lane lines.

A binary is an ndarray of shape (height, width), uint8, 0 or 255, so that binaries combine with `&` and `|` and can be
warped or shown as they are. All ranges include both ends.

Gradients are in gray levels of a step edge: a Sobel filter is divided by its response to a unit step. A step of
`full_step` levels is scaled to 255. The originals divided by the largest gradient of the image instead, so that one
glint of light changed every threshold. The default values of `full_step` are the medians of that largest gradient over
66 motorway images, so that the published ranges keep their meaning: lightness of the bird's-eye view 78 levels, its
saturation 232, gray 180 with a kernel of 3 and 195 with 9. The two of recipe A are rounded to 75 and 255, which gives
results closer to the published ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import cv2
import numpy as np

from lanes.images import require_rgb

Range = tuple[float, float]

# OpenCV's 8-bit ranges: hue 0..179 (two degrees a level), everything else 0..255, neutral Lab a and b at 128.
_SPACES = ("HLS", "HSV", "LAB", "LUV")


def split_channels(image: np.ndarray, space: str) -> tuple[np.ndarray, ...]:
    """The three channels (height, width), uint8, of an RGB image in a colour space: RGB, HLS, HSV, LAB or LUV.

    Raises ValueError if `space` is not one of these, and PictureError if `image` is not an RGB image, as in all
    functions of this module that take one. OpenCV would silently ignore a fourth channel.
    """
    image = require_rgb(image)
    if space == "RGB":
        return tuple(cv2.split(image))
    if space not in _SPACES:
        raise ValueError(f"colour space {space!r} is not known; use one of RGB, {', '.join(_SPACES)}.")
    return tuple(cv2.split(cv2.cvtColor(image, getattr(cv2, f"COLOR_RGB2{space}"))))


def to_gray(image: np.ndarray) -> np.ndarray:
    """Gray image (height, width), uint8, of an RGB image, with the weights of ITU-R BT.601."""
    return cv2.cvtColor(require_rgb(image), cv2.COLOR_RGB2GRAY)


def range_mask(channel: np.ndarray, levels: Range) -> np.ndarray:
    """Binary of the pixels of one channel in the range `levels` (low, high)."""
    return cv2.inRange(channel, levels[0], levels[1])


def saturation_mask(image: np.ndarray, saturation: Range = (120, 255), lightness: Range = (30, 255)) -> np.ndarray:
    """Binary of saturated pixels (HLS) above a lightness; in dark pixels saturation is noise."""
    _, light, colour = split_channels(image, "HLS")
    return range_mask(colour, saturation) & range_mask(light, lightness)


def yellow_mask(
    image: np.ndarray, low: tuple[int, int, int] = (0, 70, 70), high: tuple[int, int, int] = (50, 255, 255)
) -> np.ndarray:
    """Binary of the pixels between two HSV colours (low, high); the default is red to yellow."""
    return cv2.inRange(cv2.cvtColor(require_rgb(image), cv2.COLOR_RGB2HSV), low, high)


def equalized_white_mask(image: np.ndarray, levels: Range = (251, 255)) -> np.ndarray:
    """Binary of the brightest few per cent of an image: gray levels after histogram equalization."""
    return range_mask(cv2.equalizeHist(to_gray(image)), levels)


def gradient_x_mask(channel: np.ndarray, levels: Range, *, full_step: float, kernel: int = 3) -> np.ndarray:
    """Binary of the pixels of a channel (height, width), uint8, with a horizontal gradient in a range.

    `levels` is the range on the scale 0..255, where 255 is a step of `full_step` gray levels. `kernel` is the odd size
    of the Sobel filter in pixels.
    """
    return _level_mask(np.abs(_sobel(channel, 1, 0, kernel)), levels, full_step)


def magnitude_mask(channel: np.ndarray, levels: Range, *, full_step: float, kernel: int = 3) -> np.ndarray:
    """Binary of the pixels with a gradient magnitude in a range; see `gradient_x_mask`."""
    return _level_mask(cv2.magnitude(*_gradient(channel, kernel)), levels, full_step)


def region_mask(size: tuple[int, int], polygon: tuple[Range, ...]) -> np.ndarray:
    """Binary of `size` (width, height) of a polygon's interior; its corners are fractions of width and height."""
    corners = np.round(np.array(polygon) * size).astype(np.int32)
    return cv2.fillPoly(np.zeros(size[::-1], np.uint8), [corners], 255)


def close_gaps(binary: np.ndarray, size_px: int = 5) -> np.ndarray:
    """Fill holes and gaps narrower than `size_px` (morphological closing)."""
    return cv2.morphologyEx(binary, cv2.MORPH_CLOSE, np.ones((size_px, size_px), np.uint8))


def _sobel(channel: np.ndarray, dx: int, dy: int, kernel: int) -> np.ndarray:
    """Sobel filter, scaled to the response k for a step of k levels with any kernel size."""
    derive, smooth = cv2.getDerivKernels(1, 0, kernel)
    gain = smooth.sum() * np.abs(np.cumsum(derive)).max()
    return cv2.Sobel(channel, cv2.CV_32F, dx, dy, ksize=kernel, scale=1 / gain)


def _gradient(channel: np.ndarray, kernel: int) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal and vertical gradient, in levels of a step edge."""
    return _sobel(channel, 1, 0, kernel), _sobel(channel, 0, 1, kernel)


def _level_mask(steps: np.ndarray, levels: Range, full_step: float) -> np.ndarray:
    # 255 is the end of the scale and includes all larger gradients.
    high = np.inf if levels[1] >= 255 else levels[1] * full_step / 255
    return cv2.inRange(steps, levels[0] * full_step / 255, high)


class Thresholds:
    """Base class of the threshold step of a recipe."""

    candidates: ClassVar[tuple[str, ...]] = ("combined",)

    def masks(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """All binaries by name: "combined" for stills, and the `candidates` for the choice in video."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Thresholds:
        """The same thresholds for images `factor` times as large; kernels have at least 3 pixels."""
        return self


@dataclass(frozen=True)
class HlsSobelThresholds(Thresholds):
    """Recipe A, on the warped colour image: saturation, or a gradient of lightness or of saturation.

    The published range of gradient directions is left out, because 0..pi/2 includes all directions.
    """

    saturation: Range = (120, 255)
    lightness: Range = (30, 255)
    gradient: Range = (20, 255)
    lightness_full_step: float = 75
    # Saturation changes by nearly its full range next to white pixels, so the scale is the full range.
    saturation_full_step: float = 255

    def masks(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """Binaries of an RGB image (height, width, 3): saturation, gradient x, magnitude, combined."""
        _, light, colour = split_channels(image, "HLS")
        masks = {
            "saturation": range_mask(colour, self.saturation) & range_mask(light, self.lightness),
            "gradient x": gradient_x_mask(light, self.gradient, full_step=self.lightness_full_step),
            "magnitude": magnitude_mask(colour, self.gradient, full_step=self.saturation_full_step),
        }
        masks["combined"] = masks["saturation"] | masks["gradient x"] | masks["magnitude"]
        return masks


@dataclass(frozen=True)
class EqualizedHsvThresholds(Thresholds):
    """Recipe B, on the undistorted image: yellow, or the brightest few per cent, or a strong gradient."""

    white: Range = (251, 255)
    yellow_low: tuple[int, int, int] = (0, 70, 70)
    yellow_high: tuple[int, int, int] = (50, 255, 255)
    magnitude: Range = (51, 255)
    magnitude_kernel: int = 9
    full_step: float = 195
    close_px: int = 5

    def masks(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """Binaries of an RGB image (height, width, 3): white, yellow, magnitude, combined (with gaps closed)."""
        gray = to_gray(image)
        masks = {
            "white": equalized_white_mask(image, self.white),
            "yellow": yellow_mask(image, self.yellow_low, self.yellow_high),
            "magnitude": magnitude_mask(gray, self.magnitude, full_step=self.full_step, kernel=self.magnitude_kernel),
        }
        masks["combined"] = close_gaps(masks["white"] | masks["yellow"] | masks["magnitude"], self.close_px)
        return masks

    def scaled(self, factor: float) -> EqualizedHsvThresholds:
        """The same thresholds for images `factor` times as large."""
        kernel, close_px = (2 * round((size * factor - 1) / 2) + 1 for size in (self.magnitude_kernel, self.close_px))
        # OpenCV has Sobel filters of 3 to 31 pixels.
        return replace(self, magnitude_kernel=min(max(kernel, 3), 31), close_px=max(close_px, 1))


@dataclass(frozen=True)
class BestChannelThresholds(Thresholds):
    """Recipe C, on the undistorted image: six separate binaries, so that the best one is used for each line."""

    red: Range = (210, 255)
    hue: Range = (20, 80)
    saturation: Range = (85, 255)
    luv_lightness: Range = (225, 255)
    lab_b: Range = (155, 200)
    gradient: Range = (100, 200)
    magnitude: Range = (10, 225)
    direction_rad: Range = (0.7, 1.2)
    full_step: float = 180
    # Region of interest, as fractions of width and height; it excludes the sky and the adjacent lanes.
    region: tuple[Range, ...] = ((0, 1), (0.45, 1 / 1.8), (0.55, 1 / 1.8), (0.99, 1))
    candidates: ClassVar[tuple[str, ...]] = ("red", "gradients", "hue", "saturation", "luv lightness", "lab b")

    def masks(self, image: np.ndarray) -> dict[str, np.ndarray]:
        """Binaries of an RGB image (height, width, 3): the six candidates and combined (saturation, red or b)."""
        image = require_rgb(image)
        region = region_mask(image.shape[1::-1], self.region)
        # The rows above the region are 0 and need no computation.
        top = int(region.any(axis=1).argmax())
        masks = self._road_masks(image[top:], region[top:])
        return {name: cv2.copyMakeBorder(mask, top, 0, 0, 0, cv2.BORDER_CONSTANT) for name, mask in masks.items()}

    def _road_masks(self, image: np.ndarray, region: np.ndarray) -> dict[str, np.ndarray]:
        hue, _, saturation = split_channels(image, "HLS")
        # One gradient for the four binaries that use it.
        gradient_x, gradient_y = _gradient(to_gray(image), 3)
        angles = cv2.phase(np.abs(gradient_x), np.abs(gradient_y))
        direction = cv2.inRange(angles, self.direction_rad[0], self.direction_rad[1]) & region
        step = self.full_step
        both_gradients = _level_mask(np.abs(gradient_x), self.gradient, step) & region
        both_gradients &= _level_mask(np.abs(gradient_y), self.gradient, step)
        magnitude = _level_mask(cv2.magnitude(gradient_x, gradient_y), self.magnitude, step)
        masks = {
            "red": range_mask(np.ascontiguousarray(image[..., 0]), self.red) & region,
            "gradients": both_gradients | (magnitude & direction),
            "hue": range_mask(hue, self.hue) & direction,
            "saturation": range_mask(saturation, self.saturation) & region,
            "luv lightness": range_mask(split_channels(image, "LUV")[0], self.luv_lightness) & region,
            "lab b": range_mask(split_channels(image, "LAB")[2], self.lab_b) & direction,
        }
        masks["combined"] = masks["saturation"] | masks["red"] | masks["lab b"]
        return masks
