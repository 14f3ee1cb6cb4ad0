"""Three classic lane finders with their published parameters, composed of the steps of this package.

- "hls_sobel" (A): warp the colour picture; saturation or gradients; mean of the last five accepted fits;
- "equalized_hsv" (B): brightest and yellow pixels or strong gradients; mean of the last ten;
- "best_channel" (C): six binaries, the best one for each line; RANSAC; mean of the last thirty, with blended outliers.

They differ from the originals where those had defects; tests/classic/test_finder.py has a test for each difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import inf

import numpy as np

from lanes.camera.camera import Camera, undistort
from lanes.camera.camera_pose import CameraError
from lanes.classic.channel import Channel, nearest_line
from lanes.classic.fit import LineFit
from lanes.classic.measure import road_line
from lanes.classic.memory import LineMemory
from lanes.classic.recipe import Recipe
from lanes.classic.result import FoundLine, LaneResult, Steps
from lanes.classic.threshold import BestChannelThresholds, EqualizedHsvThresholds, HlsSobelThresholds, Thresholds
from lanes.classic.warp import birdseye_to_road, scale_to_road

RECIPES = {
    "hls_sobel": Recipe(
        name="hls_sobel",
        source_px=((580, 460), (740, 460), (1100, 670), (270, 670)),
        destination_px=((200, 0), (1080, 0), (1080, 720), (200, 720)),
        warp_first=True,
        thresholds=HlsSobelThresholds(),
        video_thresholds=HlsSobelThresholds(gradient=(15, 255)),
        margin_px=80,
        still_band_px=80,
        memories=(LineMemory(length=5, accept_limits=(0.001, 1.0, 100)),) * 2,
    ),
    "equalized_hsv": Recipe(
        name="equalized_hsv",
        source_px=((1280, 710), (0, 710), (546, 460), (732, 460)),
        destination_px=((1280, 720), (0, 720), (0, 0), (1280, 0)),
        thresholds=EqualizedHsvThresholds(),
        video_thresholds=EqualizedHsvThresholds(),
        histogram_rows_px=(360, 690),
        margin_px=100,
        still_band_px=100,
        memories=(LineMemory(length=10, measured_length=20, search_again=False),) * 2,
    ),
    "best_channel": Recipe(
        name="best_channel",
        source_px=((249, 690), (579, 460), (704, 460), (1058, 690)),
        destination_px=((249, 720), (249, 0), (1058, 0), (1058, 720)),
        thresholds=BestChannelThresholds(),
        video_thresholds=BestChannelThresholds(),
        margin_px=75,
        still_band_px=100,
        flood_pixels=9500,
        ransac_px=15,
        memories=tuple(
            LineMemory(
                length=30,
                accept_limits=(7e-5, inf, 50),
                blend_limits=(blend_a, inf, 150),
                blend_weight=weight,
                max_missed=max_missed,
            )
            for blend_a, weight, max_missed in ((12e-5, 0.05, 8), (15e-5, 0.15, 10))
        ),
    ),
}


def get_recipe(name: str, size: tuple[int, int] = (1280, 720)) -> Recipe:
    """A classic recipe by name, for pictures of `size` (width, height).

    Raises
    ------
    ValueError
        If there is no recipe of that name, or the size is not positive.
    """
    if name not in RECIPES:
        raise ValueError(f"there is no recipe {name!r}; the recipes are {', '.join(RECIPES)}.")
    return RECIPES[name].scaled(size)


class LaneFinder:
    """Lane detection with a classic recipe: `find` for a still, `follow` for consecutive frames.

    Parameters
    ----------
    recipe : Recipe
        For pictures of the camera's size.
    camera : Camera
        Its intrinsics undistort the pictures; its pose projects pixels to the road.
    metres_per_px : tuple of float, optional
        (metres per column, metres per row) of the bird's-eye view, for example (3.7 / 700, 30 / 720) in the originals.
        By default, lines are projected to the road with homography and camera pose; see `warp.birdseye_to_road`.

    Raises
    ------
    CameraError
        If the recipe is for another size than the camera, or neither a camera pose nor scales are given.
    """

    def __init__(self, recipe: Recipe, camera: Camera, *, metres_per_px: tuple[float, float] | None = None) -> None:
        recipe.require_size(camera)
        if camera.pose is None and metres_per_px is None:
            raise CameraError(
                "this camera has no pose (height and angles), so nothing can be measured on the road; "
                "give it one, or give metres_per_px."
            )
        self.recipe, self.camera, self.warp = recipe, camera, recipe.warp()
        if metres_per_px is None:
            self._to_road = partial(birdseye_to_road, warp=self.warp, camera=camera)
        else:
            self._to_road = partial(scale_to_road, metres_per_px=metres_per_px, birdseye_size=recipe.size)
        self.reset()

    def reset(self) -> None:
        """Delete the memory of `follow`."""
        self._memories = self.recipe.memories

    def find(self, image: np.ndarray) -> LaneResult:
        """The lane in one raw RGB picture of the camera's size, "lost" if not both lines are found.

        The memory is neither used nor changed.

        Raises
        ------
        PictureError
            If the picture is not an RGB picture of the camera's size.
        """
        undistorted, channels = self._threshold(image, self.recipe.thresholds)
        lines = [channels["combined"].line_from_windows(side) for side in (0, 1)]
        fits = [line.fit for line in lines]
        state = "found" if all(fits) else "lost"
        return self._result(undistorted, channels, lines, fits, fits, state)

    def follow(self, image: np.ndarray) -> LaneResult:
        """The lane in the next frame of a drive, with the memory of the previous frames; see `find`.

        If a line is missing or not plausible in this frame, the memory is used and `state` is "kept".
        """
        undistorted, channels = self._threshold(image, self.recipe.video_thresholds)
        candidates = [channels[name] for name in self.recipe.video_thresholds.candidates]
        lines = [
            nearest_line(candidates, memory, side) if memory.average else channels["combined"].line_from_windows(side)
            for side, memory in enumerate(self._memories)
        ]
        self._memories = tuple(m.update(line.fit) for m, line in zip(self._memories, lines, strict=True))
        states = {memory.state for memory in self._memories}
        state = next(s for s in ("lost", "kept", "found") if s in states)
        shown, measured = zip(*((m.average, m.measured_average) for m in self._memories), strict=True)
        return self._result(undistorted, channels, lines, shown, measured, state)

    def _threshold(self, image: np.ndarray, thresholds: Thresholds) -> tuple[np.ndarray, dict[str, Channel]]:
        undistorted = undistort(image, self.camera)
        masks = thresholds.masks(self.warp.warp(undistorted) if self.recipe.warp_first else undistorted)
        return undistorted, {name: Channel(name, mask, self.recipe, self.warp) for name, mask in masks.items()}

    def _result(
        self,
        undistorted: np.ndarray,
        channels: dict[str, Channel],
        lines: Sequence[FoundLine],
        shown: Sequence[LineFit | None],
        measured: Sequence[LineFit | None],
        state: str,
    ) -> LaneResult:
        roads = [fit and road_line(fit, self._to_road, self.recipe.size[1]) for fit in measured]
        binary = channels[lines[0].channel].binary | channels[lines[1].channel].binary
        masks = {name: channel.mask for name, channel in channels.items()}
        return LaneResult(*shown, *roads, state, Steps(undistorted, masks, binary, *lines, self.warp))
