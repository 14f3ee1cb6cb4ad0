"""Pictures as videos store them: brightness for each pixel, two differences of colour for each four (YUV 4:2:0).

A frame that keeps this form from the decoder to the encoder needs no conversion, and all that nobody draws on is
encoded as it was decoded. Two ways to store the same colour differ in their weights of red and blue and in their range;
both are told by numbers of Recommendation ITU-T H.273.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np

# Weights of red and blue in brightness, by the number of the matrix: H.273, table 4.
WEIGHTS = {
    1: (0.2126, 0.0722),
    4: (0.30, 0.11),
    5: (0.299, 0.114),
    6: (0.299, 0.114),
    7: (0.212, 0.087),
    9: (0.2627, 0.0593),
}


@dataclass(frozen=True)
class YuvColourSpace:
    """What the numbers of a picture stand for; by default BT.601's colours within 16..235, of BT.709's primaries.

    Attributes
    ----------
    matrix : int
        A key of `WEIGHTS`.
    full_range : bool
        Brightness takes 0 to 255 instead of 16 to 235.
    primaries, transfer : int
        Numbers of H.273, tables 2 and 3; handed on to the player.
    """

    matrix: int = 6
    full_range: bool = False
    primaries: int = 1
    transfer: int = 1

    @cached_property
    def from_rgb(self) -> np.ndarray:
        """(3, 4) affine map of (red, green, blue) 0..255 to the stored numbers: H.273, clause 8.3."""
        red, blue = WEIGHTS[self.matrix]
        brightness = np.array([red, 1 - red - blue, blue])
        blueness, redness = np.eye(3)[2] - brightness, np.eye(3)[0] - brightness
        differences = np.array([brightness, blueness / (1 - blue) / 2, redness / (1 - red) / 2])
        low, spans = (0, (255, 255, 255)) if self.full_range else (16, (219, 224, 224))
        return np.column_stack([differences * (np.array(spans)[:, None] / 255), [low, 128, 128]])

    @cached_property
    def to_rgb(self) -> np.ndarray:
        """(3, 4) affine map of the stored numbers to (red, green, blue)."""
        inverse = np.linalg.inv(self.from_rgb[:, :3])
        return np.column_stack([inverse, -inverse @ self.from_rgb[:, 3]])


@lru_cache(maxsize=64)
def rgb_to_yuv(colour: tuple[int, int, int], colours: YuvColourSpace) -> tuple[float, float, float]:
    """The numbers that stand for an RGB colour; kept, because few colours are drawn in thousands of frames."""
    return tuple((colours.from_rgb @ [*colour, 1]).tolist())


@dataclass(frozen=True, eq=False)
class YuvFrame:
    """A picture in YUV 4:2:0.

    Attributes
    ----------
    data : ndarray, uint8
        The planes one behind the other: brightness, blue difference, red difference. An odd width or height is made
        even by repeating the last column or row.
    width, height : int
        Of the picture, without what was added.
    colours : YuvColourSpace
    """

    data: np.ndarray
    width: int
    height: int
    colours: YuvColourSpace = YuvColourSpace()

    @classmethod
    def from_rgb(cls, image: np.ndarray) -> YuvFrame:
        """Convert a picture (height, width, 3), uint8, to the default colours; 0.5 ms at 1280x720, FFmpeg takes 1.7."""
        require_rgb(image)
        height, width = image.shape[:2]
        if height % 2 or width % 2:
            image = cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
        return cls(cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420), width, height)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, 3), as of the same picture in RGB."""
        return self.height, self.width, 3

    @property
    def stored_size(self) -> tuple[int, int]:
        """(width, height), both even."""
        return self.width + self.width % 2, self.height + self.height % 2

    @cached_property
    def planes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Brightness (stored height, stored width), blue and red difference of half as much each; views of `data`."""
        width, height = self.stored_size
        ends = np.cumsum([width * height, width * height // 4])
        y, u, v = np.split(self.data.ravel(), ends)
        return y.reshape(height, width), u.reshape(height // 2, -1), v.reshape(height // 2, -1)

    def copy(self) -> YuvFrame:
        """The same on data of its own."""
        return replace(self, data=self.data.copy())

    def turned(self, quarters: int) -> YuvFrame:
        """The picture turned counterclockwise by so many quarters; sides must be even."""
        data = np.concatenate([np.rot90(plane, quarters).ravel() for plane in self.planes])
        width, height = (self.height, self.width) if quarters % 2 else (self.width, self.height)
        return replace(self, data=data, width=width, height=height)

    def to_rgb(self) -> np.ndarray:
        """Convert to (height, width, 3), uint8."""
        y, *differences = self.planes
        full = [cv2.resize(plane, self.stored_size, interpolation=cv2.INTER_LINEAR) for plane in differences]
        return cv2.transform(cv2.merge([y, *full]), self.colours.to_rgb)[: self.height, : self.width]


# What can be looked at and drawn on: RGB of shape (height, width, 3), uint8, or a frame as its video stores it.
Frame = np.ndarray | YuvFrame


def as_rgb(picture: Frame) -> np.ndarray:
    """The picture in RGB (height, width, 3), uint8; itself where it is already."""
    return picture.to_rgb() if isinstance(picture, YuvFrame) else picture


class PictureError(ValueError):
    """A picture cannot be used; the message names the file, what is wrong and what to do."""


def require_rgb(image: np.ndarray, name: object = "picture") -> None:
    """Refuse anything that is not an (H, W, 3) uint8 array with pixels in it, naming what it is instead."""
    if not isinstance(image, np.ndarray) or image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        got = f"shape {image.shape}, dtype {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
        raise PictureError(
            f"{name}: expected an RGB picture of shape (height, width, 3) and dtype uint8, got {got}; "
            "read it with read_image."
        )
    if not image.size:
        raise PictureError(f"{name}: holds no pixels (shape {image.shape}); check how it was cut out.")
