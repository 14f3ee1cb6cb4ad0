"""Detection in a single image, with a known camera pose or with one that has to come from the same image.

A single image determines the height of the camera roughly, or not at all. With a wrong height two lines that are not a
lane apart are taken for the ego lane. Several heights are therefore tried. If they show the same lane, the height does
not matter; if they show different ones, the lane is doubtful.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from lanes.camera import Camera, require_camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Evidence, find_evidence
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings, find_mask
from lanes.detect.search import DETECTOR, DetectorSettings, StillDetection, search_lane
from lanes.errors import require_type

# Heights of cameras in cars, vans and lorries, metres.
HEIGHT_RANGE_M = 0.5, 4.5


def find_lane(
    image: np.ndarray | str | Path,
    camera: Camera,
    settings: DetectorSettings = DETECTOR,
    *,
    markings: Markings | None = None,
) -> Lane | None:
    """The ego lane in a single image; None if it is not seen.

    >>> lane = lanes.find_lane(image, camera)  # doctest: +SKIP

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8, or path
        RGB, raw.
    camera : Camera
        The camera that took it, with its pose.
    settings : DetectorSettings
    markings : callable, optional
        A function from the image to a mask (rows, columns), 0 to 1, of its lane markings, at any resolution, which
        takes the place of our own filters; see `lanes.detect.markings.load_markings`.

    Raises
    ------
    PictureError
        If the image is not RGB or not of the camera's size.
    CameraError, LaneError
        If the camera has no pose, or sees no road; if `markings` returns no mask.
    """
    return detect_still(image, camera, settings, markings=markings).lane


def detect_still(
    image: np.ndarray | str | Path,
    camera: Camera,
    settings: DetectorSettings = DETECTOR,
    *,
    markings: Markings | None = None,
) -> StillDetection:
    """What is found in a single image of a camera with a known pose; parameters and errors as for `find_lane`."""
    image = require_camera(camera).require_size(image)
    paint, mask = require_type(settings, DetectorSettings, "settings").paint, find_mask(image, markings)
    return _search(find_evidence(image, _view_of(camera, settings), paint, mask=mask), settings)


def search_at_heights(
    image: np.ndarray,
    camera: Camera,
    heights_m: np.ndarray,
    settings: DetectorSettings = DETECTOR,
    *,
    markings: Markings | None = None,
) -> list[StillDetection]:
    """What is found in a single image for each height of the camera; the evidence is found once, with its own pose.

    The lanes have a `Lane.same_lane_share` of 1: their confidence is that of a lane whose width is uncertain.
    """
    mask = find_mask(camera.require_size(image), markings)
    evidence = find_evidence(image, _view_of(camera, settings), settings.paint, mask=mask)
    found = [_search(evidence.at_height(float(h)), settings) for h in np.clip(heights_m, *HEIGHT_RANGE_M)]
    return [replace(f, lane=replace(f.lane, same_lane_share=1.0)) if f.lane else f for f in found]


def detect_with_own_pose(
    image: np.ndarray,
    camera: Camera,
    height_log_std: float,
    markings: Markings | None = None,
    settings: DetectorSettings = DETECTOR,
) -> StillDetection:
    """What is found in a single image whose camera pose is only known roughly.

    The evidence is found once and searched for several heights of the camera. A height has its prior probability times
    the odds of the lane that it shows. The lane with the largest sum over all heights that show it is taken, and of
    these heights the most probable one. The share of the heights, by their prior, that show this lane is
    `Lane.same_lane_share`. The fit itself finds the pitch.

    The pose of `camera` is the estimate; it is kept if no height shows a lane. `height_log_std` is the standard
    deviation of the logarithm of its height; 0 if the height is known. Errors are those of `find_lane`.
    """
    steps = np.array(settings.tried_heights if height_log_std else (0.0,))
    log_prior, factors = -0.5 * steps**2, np.exp(steps * height_log_std)
    found = search_at_heights(image, camera, camera.require_pose().height_m * factors, settings, markings=markings)
    shown = [k for k, detection in enumerate(found) if detection.lane]
    lanes = [detection.lane for detection in found if detection.lane]
    if not shown:
        return found[0]
    log_posterior = log_prior[shown] + [lane.log_odds for lane in lanes]
    probability = np.exp(log_posterior - log_posterior.max())
    # from the road 60 m ahead down to the lower border of the image
    top = camera.road_to_pixels(np.array([[60.0, 0.0]]))[0, 1]
    rows = np.linspace(top, 0.98 * camera.height, 25)
    columns = [lane.columns(found[k].camera, rows) for k, lane in zip(shown, lanes, strict=True)]
    same = _same_lane(np.array(columns), camera)
    of_lane = np.flatnonzero(same[(same @ probability).argmax()])
    best = of_lane[probability[of_lane].argmax()]
    prior = np.exp(log_prior)
    share = float(same[best] @ prior[shown] / prior.sum())
    return replace(found[shown[best]], lane=replace(lanes[best], same_lane_share=share))


def _search(evidence: Evidence, settings: DetectorSettings) -> StillDetection:
    """The search for the ego lane in the evidence of a single image."""
    search = search_lane(evidence, settings)
    return StillDetection(evidence, search, search.lane if search else None)


def _same_lane(columns: np.ndarray, camera: Camera) -> np.ndarray:
    """(N, N) bool: which of the lanes with these columns (N, 2, rows) are the same in the image; symmetric.

    Both lines are within 2 % of the image's width in four of five rows. Every lane is the same as itself, also if it is
    seen in too few rows to be compared.
    """
    first, second = columns[:, None], columns[None]
    common = (first >= 0) & (second >= 0)
    near = common & (np.abs(first - second) < 0.02 * camera.width)
    count = common.sum(axis=-1)
    enough = (near.sum(axis=-1) >= 0.8 * count) & (count >= 4)
    return enough.all(axis=-1) | np.eye(len(columns), dtype=bool)


@lru_cache(maxsize=4)
def _view_of(camera: Camera, settings: DetectorSettings) -> BirdsEyeView:
    """The bird's-eye view, cached: making it takes half as long as a detection in it."""
    return BirdsEyeView.from_image_border(camera, settings.near_m, half_width_m=settings.half_width_m)
