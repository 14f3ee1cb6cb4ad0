"""Sliders for the notebook: an image next to its processed version, which follows the sliders.

They need ipywidgets, which comes with Jupyter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import cv2
import numpy as np

from lanes.video.images import to_rgb

if TYPE_CHECKING:
    from ipywidgets import VBox

# Displayed width of the two images together.
SHOWN_PX = 1120
INSTALL_HINT = "The sliders need ipywidgets: run `pip install ipywidgets` and start the notebook again."


def tune_threshold(
    image: np.ndarray, make: Callable[..., np.ndarray], **sliders: tuple[float, float, float | tuple[float, float]]
) -> VBox | None:
    """Show an image next to the result of a function, with sliders for the parameters of the function.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    make : callable
        Called as make(image, name=value, ...); returns a mask or an image.
    **sliders : (minimum, maximum, start)
        One entry per parameter. If `start` is a pair (low, high), the parameter is a pair too.

    Returns
    -------
    VBox or None
        Displayed by Jupyter as the last value of a cell. None without ipywidgets.

    Examples
    --------
    >>> bright_red = lambda image, red: cv2.inRange(image[..., 0].copy(), *red)
    >>> tune_threshold(image, bright_red, red=(0, 255, (210, 255)))  # doctest: +SKIP
    """
    try:
        import ipywidgets
    except ImportError:
        print(INSTALL_HINT)
        return None
    controls = {name: _slider(ipywidgets, name, *limits) for name, limits in sliders.items()}
    shown = ipywidgets.Image(format="png")

    def refresh(_change: object = None) -> None:
        made = make(image, **{name: control.value for name, control in controls.items()})
        made = cv2.resize(made, image.shape[1::-1], interpolation=cv2.INTER_AREA)
        both = cv2.cvtColor(np.hstack([to_rgb(image), to_rgb(made)]), cv2.COLOR_RGB2BGR)
        scale = SHOWN_PX / both.shape[1]
        small = cv2.resize(both, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        shown.value = cv2.imencode(".png", small)[1].tobytes()

    for control in controls.values():
        control.observe(refresh, names="value")
    refresh()
    return ipywidgets.VBox([*controls.values(), shown])


def _slider(ipywidgets, name: str, minimum: float, maximum: float, start: float | tuple[float, float]):
    """A slider for a number, or for a range if `start` is a pair; integer limits give an integer slider."""
    kind = "RangeSlider" if isinstance(start, tuple) else "Slider"
    whole = np.hstack([minimum, maximum, start]).dtype.kind == "i"
    # Without continuous updates: drawing an image for every mouse movement is too slow.
    options = {"value": start, "min": minimum, "max": maximum, "description": name, "continuous_update": False}
    if not whole:
        options["step"] = (maximum - minimum) / 100
    return getattr(ipywidgets, ("Int" if whole else "Float") + kind)(**options)
