"""Sliders for the notebook: a picture beside what becomes of it, made anew whenever a slider moves.

Needs ipywidgets, which comes with Jupyter; without it a sentence says how to get it, and nothing else is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.drawing.pictures import to_rgb
from lanes.tracking.birdseye import BirdsEyeView

if TYPE_CHECKING:
    from ipywidgets import VBox

# Each of the two pictures is shown this wide.
SHOWN_PX = 560
HOW_TO_GET_IT = "The sliders need ipywidgets: run `pip install ipywidgets` and start the notebook again."


def tune_threshold(
    image: np.ndarray, make: Callable[..., np.ndarray], **sliders: tuple[float, float, float | tuple[float, float]]
) -> VBox | None:
    """Show a picture beside what a function makes of it, with sliders for the function's settings.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        RGB.
    make : callable
        Called as make(image, name=value, ...); returns a mask or a picture, for instance `saturation_mask`.
    **sliders : (least, most, start)
        For each setting; where `start` is a pair (low, high), so is the setting.

    Returns
    -------
    VBox or None
        To be shown as the last line of a cell; None without ipywidgets, after a sentence that says how to get it.

    Examples
    --------
    >>> tune_threshold(image, saturation_mask, saturation=(0, 255, (120, 255)))  # doctest: +SKIP
    """
    try:
        import ipywidgets
    except ImportError:
        print(HOW_TO_GET_IT)
        return None
    controls = {name: _slider(ipywidgets, name, *limits) for name, limits in sliders.items()}
    shown = ipywidgets.Image(format="png")

    def refresh(_change: object = None) -> None:
        made = make(image, **{name: control.value for name, control in controls.items()})
        shown.value = _png(np.hstack([_shrink(to_rgb(picture)) for picture in _same_height(image, made)]))

    for control in controls.values():
        control.observe(refresh, names="value")
    refresh()
    return ipywidgets.VBox([*controls.values(), shown])


def tune_view(image: np.ndarray, camera: Camera) -> VBox | None:
    """Show a picture beside the road from above, with sliders for the distance it shows and the camera's pitch.

    `camera` needs its pose. See `tune_threshold` for what is returned.
    """
    pose = camera.require_pose()

    def view_from_above(image: np.ndarray, far_m: float, half_width_m: float, pitch_deg: float) -> np.ndarray:
        tilted = camera.with_pose(replace(pose, pitch_rad=np.radians(pitch_deg)))
        view = BirdsEyeView(tilted, far_m=far_m, half_width_m=half_width_m)
        return view.blacken(view.warp(image))

    pitch_deg = float(np.degrees(pose.pitch_rad))
    limits = {"far_m": (20.0, 120.0, 70.0), "half_width_m": (3.0, 15.0, 9.0)}
    return tune_threshold(image, view_from_above, **limits, pitch_deg=(pitch_deg - 4, pitch_deg + 4, pitch_deg))


def _slider(ipywidgets, name: str, least: float, most: float, start: float | tuple[float, float]):
    """A slider for a number or, where it starts with a pair, for a range; whole numbers stay whole."""
    pair = isinstance(start, tuple)
    whole = all(isinstance(value, int) for value in (least, most, *(start if pair else (start,))))
    kind = f"{'Int' if whole else 'Float'}{'Range' if pair else ''}Slider"
    options = {} if whole else {"step": (most - least) / 100}
    # A picture for each step of the mouse would lag behind it.
    return getattr(ipywidgets, kind)(
        value=start, min=least, max=most, description=name, continuous_update=False, **options
    )


def _same_height(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return left, cv2.resize(right, (left.shape[1], left.shape[0]), interpolation=cv2.INTER_AREA)


def _shrink(picture: np.ndarray) -> np.ndarray:
    height = round(SHOWN_PX * picture.shape[0] / picture.shape[1])
    return cv2.resize(picture, (SHOWN_PX, height), interpolation=cv2.INTER_AREA)


def _png(picture: np.ndarray) -> bytes:
    return cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))[1].tobytes()
