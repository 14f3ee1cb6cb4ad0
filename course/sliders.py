"""Sliders for the notebook: an image next to its processed version, which follows them.

They need ipywidgets, which comes with Jupyter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import cv2
import numpy as np

from helpers import to_rgb

if TYPE_CHECKING:
    from ipywidgets import VBox

# Displayed width of the two images together.
SHOWN_PX = 1120
INSTALL_HINT = (
    "The sliders need ipywidgets: run `pip install ipywidgets` and start the notebook "
    "again."
)


def tune_threshold(
    image: np.ndarray,
    make: Callable[..., np.ndarray],
    **sliders: tuple[float, float, float | tuple[float, float]],
) -> VBox | None:
    """Show an image next to the result of a function, with sliders for its parameters.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    make : callable
        Called as make(image, name=value, ...); returns a mask or an image.
    **sliders : (minimum, maximum, start)
        One entry per parameter. If `start` is a pair (low, high), the parameter is a
        pair too.

    Returns
    -------
    VBox or None
        Displayed by Jupyter as the last value of a cell. None without ipywidgets.

    Examples
    --------
    >>> def bright_red(image, red):
    ...     return cv2.inRange(image[..., 0].copy(), red[0], red[1])
    >>> tune_threshold(image, bright_red, red=(0, 255, (210, 255)))  # doctest: +SKIP
    """
    try:
        import ipywidgets
    except ImportError:
        print(INSTALL_HINT)
        return None
    controls = {}
    for name, (minimum, maximum, start) in sliders.items():
        controls[name] = make_slider(name, minimum, maximum, start)
    shown = ipywidgets.Image(format="png")

    def refresh(_change: object = None) -> None:
        values = {name: control.value for name, control in controls.items()}
        made = make(image, **values)
        shown.value = encode_pair(image, made)

    for control in controls.values():
        control.observe(refresh, names="value")
    refresh()
    return ipywidgets.VBox([*controls.values(), shown])


def make_slider(
    name: str, minimum: float, maximum: float, start: float | tuple[float, float]
):
    """A slider for a number, or for a range if `start` is a pair.

    It moves in whole numbers if the limits and the start are whole.
    """
    import ipywidgets

    is_range = isinstance(start, tuple)
    is_whole = np.hstack([minimum, maximum, start]).dtype.kind == "i"
    number = "Int" if is_whole else "Float"
    kind = "RangeSlider" if is_range else "Slider"
    slider = getattr(ipywidgets, number + kind)
    return slider(
        value=start,
        min=minimum,
        max=maximum,
        step=1 if is_whole else (maximum - minimum) / 100,
        description=name,
        # drawing an image for every movement of the mouse is too slow
        continuous_update=False,
    )


def encode_pair(image: np.ndarray, made: np.ndarray) -> bytes:
    """A PNG of an image and what was made of it, side by side."""
    height, width = image.shape[:2]
    shown_width = SHOWN_PX // 2
    shown_size = (shown_width, round(shown_width * height / width))
    pair = []
    for one in (image, made):
        rgb = to_rgb(one)
        pair.append(cv2.resize(rgb, shown_size, interpolation=cv2.INTER_AREA))
    small = np.hstack(pair)
    _, png = cv2.imencode(".png", cv2.cvtColor(small, cv2.COLOR_RGB2BGR))
    return png.tobytes()
