"""Detection in a single image, with a known camera pose or with one that has to come from the same image.

A single image determines the height of the camera roughly, or not at all. With a wrong height two lines that are not a
lane apart are taken for the ego lane. Several poses are therefore tried, with the stripes of the network, which decide
better between poses (docs/ablation.md). If the poses show the same lane, the pose does not matter; if they show
different ones, the lane is doubtful.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from lanes.camera import Camera, require_camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import SURE_CONFIDENCE, log_odds
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings, Mask, find_mask, look_closer
from lanes.detect.paint import FrameEvidence, extract_evidence
from lanes.detect.search import (
    CLOSE_HALF_WIDTH_M,
    DETECTOR,
    DetectorSettings,
    Search,
    more_probable,
    search_lane,
)
from lanes.errors import CameraError, require_type

# Heights of cameras in cars, vans and lorries, metres.
HEIGHT_RANGE_M = 0.5, 4.5
# Poses that are tried: steps of the logarithm of the height, in standard deviations of the estimate, and of the pitch,
# degrees; the second ones if the height is known. More poses did not improve the lanes (docs/ablation.md).
TRIED_STEPS = ((0.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (0.0, -0.4), (0.0, 0.4))
TRIED_PITCH_STEPS = ((0.0, 0.0), (0.0, -0.4), (0.0, 0.4), (0.0, -0.8), (0.0, 0.8))
# Standard deviation of the pitch of the road relative to the estimate, degrees.
PITCH_STD_DEG = 0.5
# Two lanes are the same if both lines are within this share of the image's width, in four of five rows.
SAME_LINE_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class StillDetection:
    """What was found in an image, and what it was found in.

    `evidence` is that of the band filter or of the network; `search` is None without stripes near the car, or if a
    tracker made none; `lane` is None if no lane is seen.
    """

    evidence: FrameEvidence
    search: Search | None = None
    lane: Lane | None = None

    @property
    def camera(self) -> Camera:
        """The camera with the pose that the lane was found with."""
        return self.evidence.view.camera

    @property
    def confidence(self) -> float:
        """Confidence of the lane; 0 without one."""
        return self.lane.confidence if self.lane else 0.0


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
    """What is found in a single image of a camera with a known pose; parameters and errors as for `find_lane`.

    The band filter finds the stripes. If its lane is not sure, the network finds them, too, and its lane is
    taken if it is clearly more probable, or if the band filter finds none. Stripes of a mask replace or join them.
    """
    image = require_camera(camera).require_size(image)
    view = _view_of(camera)
    band = extract_evidence(view.warp(image), view, require_type(settings, DetectorSettings, "settings").paint)
    mask = find_mask(image, markings)
    found = _search(mask.evidence(band, band) if mask else band, settings)
    if found.confidence >= SURE_CONFIDENCE or (mask and not mask.with_own):
        return found
    closer = _search_closely(image, mask, _view_of(camera, half_width_m=CLOSE_HALF_WIDTH_M), settings)
    return closer if more_probable(found.lane, closer.lane) is closer.lane else found


def detect_with_own_pose(
    image: np.ndarray,
    camera: Camera,
    height_log_std: float,
    markings: Markings | None = None,
    settings: DetectorSettings = DETECTOR,
) -> StillDetection:
    """What is found in a single image whose camera pose is only known roughly.

    Of the poses near the estimate, that with the most probable lane is taken. A pose has the probability of its
    distance from the estimate, times the odds of the lane that it shows. The lane with the largest sum over all poses
    that show it is taken, and of these poses the most probable one. The share of the poses tried that show this lane is
    `Lane.same_lane_share`.

    The pose of `camera` is the estimate; it is kept if no pose shows a lane. `height_log_std` is the standard deviation
    of the logarithm of its height; 0 if the height is known. Errors are those of `find_lane`.
    """
    mask = find_mask(camera.require_size(image), markings)
    tried = []
    for posed, log_prior in _poses_to_try(camera, height_log_std):
        with suppress(CameraError):
            view = BirdsEyeView(posed, half_width_m=CLOSE_HALF_WIDTH_M)
            tried.append((_search_closely(image, mask, view, settings), log_prior))
    # a lane has all poses on its side until they are compared
    found = [(d, replace(d.lane, same_lane_share=1.0), log_prior) for d, log_prior in tried if d.lane is not None]
    if not found:
        view = BirdsEyeView(camera, half_width_m=CLOSE_HALF_WIDTH_M)
        return tried[0][0] if tried else _search_closely(image, mask, view, settings)
    shown = [(detection, lane, log_prior + log_odds(lane)) for detection, lane, log_prior in found]
    detections, lanes, log_posterior = zip(*shown, strict=True)
    probability = np.exp(np.array(log_posterior) - max(log_posterior))
    # from the road 60 m ahead down to the lower border of the image
    top = camera.road_to_pixels(np.array([[60.0, 0.0]]))[0, 1]
    rows = np.linspace(top, 0.98 * camera.height, 25)
    same = _same_lane(np.array([lane.columns(detection.camera, rows) for detection, lane, _ in shown]), camera)
    of_lane = np.flatnonzero(same[(same @ probability).argmax()])
    best = of_lane[probability[of_lane].argmax()]
    share = float(same[best].sum() / len(TRIED_STEPS))  # of either kind
    return replace(detections[best], lane=replace(lanes[best], same_lane_share=share))


def _poses_to_try(camera: Camera, height_log_std: float) -> Iterator[tuple[Camera, float]]:
    """The camera with each pose that is tried, and the logarithm of the pose's probability."""
    estimate = camera.require_pose()
    for height_step, pitch_step_deg in TRIED_STEPS if height_log_std else TRIED_PITCH_STEPS:
        height_m = float(np.clip(estimate.height_m * np.exp(height_step * height_log_std), *HEIGHT_RANGE_M))
        pose = replace(estimate, height_m=height_m, pitch_rad=estimate.pitch_rad + np.radians(pitch_step_deg))
        yield camera.with_pose(pose), -0.5 * (height_step**2 + (pitch_step_deg / PITCH_STD_DEG) ** 2)


def _search_closely(
    image: np.ndarray, mask: Mask | None, view: BirdsEyeView, settings: DetectorSettings = DETECTOR
) -> StillDetection:
    """What `look_closer` shows in a view of the image."""
    band = extract_evidence(view.warp(image), view, settings.paint)
    return _search(look_closer(image, band, mask), settings)


def _search(evidence: FrameEvidence, settings: DetectorSettings = DETECTOR) -> StillDetection:
    """The search for the ego lane in the evidence of a single image."""
    search = search_lane(evidence, settings)
    return StillDetection(evidence, search, search.lane if search else None)


def _same_lane(columns: np.ndarray, camera: Camera) -> np.ndarray:
    """(N, N) bool: which of the lanes with these columns (N, 2, rows) are the same in the image; symmetric.

    Every lane is the same as itself, also if it is seen in too few rows to be compared.
    """
    first, second = columns[:, None], columns[None]
    common = (first >= 0) & (second >= 0)
    near = common & (np.abs(first - second) < SAME_LINE_SHARE * camera.width)
    count = common.sum(axis=-1)
    enough = (near.sum(axis=-1) >= 0.8 * count) & (count >= 4)
    return enough.all(axis=-1) | np.eye(len(columns), dtype=bool)


@lru_cache(maxsize=4)
def _view_of(camera: Camera, **options: float) -> BirdsEyeView:
    """The bird's-eye view, cached: making it takes half as long as a detection in it."""
    return BirdsEyeView(camera, **options)
