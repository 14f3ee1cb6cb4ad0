"""The classic lane finder: threshold, warp, search and fit of one recipe, on stills or with the memory of a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import inf

import numpy as np

from classic.fit import LineFit, fit_line, mean_distance_px, ransac_line
from classic.memory import LineMemory
from classic.recipe import Recipe
from classic.result import FoundLine, LaneResult, Steps, road_line
from classic.search import WindowSearch, band_pixels, binary_pixels, sliding_windows
from classic.threshold import Thresholds
from classic.warp import FourPointWarp, birdseye_to_road, scale_to_road
from lanes.camera import Camera, undistort
from lanes.errors import CameraError


@dataclass(frozen=True, eq=False)
class Channel:
    """One binary of a frame with the line search of a recipe; warping and window search run at most once.

    `mask` (height, width), uint8, is of the bird's-eye view if the recipe warps first, else of the undistorted picture.
    """

    name: str
    mask: np.ndarray
    recipe: Recipe
    warp: FourPointWarp

    @cached_property
    def binary(self) -> np.ndarray:
        """The binary in the bird's-eye view."""
        return self.mask if self.recipe.warp_first else self.warp.warp(self.mask)

    @cached_property
    def pixels(self) -> np.ndarray:
        """Set pixels (N, 2) of the bird's-eye view."""
        return binary_pixels(self.binary)

    @cached_property
    def search(self) -> WindowSearch:
        """Sliding-window search of both lines."""
        r = self.recipe
        return sliding_windows(
            self.binary,
            margin_px=r.margin_px,
            recentre_pixels=r.recentre_pixels,
            flood_pixels=r.flood_pixels,
            histogram_rows_px=r.histogram_rows_px,
        )

    def line_from_windows(self, side: int) -> FoundLine:
        """Left (0) or right (1) line: fit the pixels in the windows, then those in a band around that fit."""
        search = self.search
        pixels = (search.left_pixels, search.right_pixels)[side]
        windows = (search.left_windows, search.right_windows)[side]
        first = self._fit(pixels)
        if first is None:
            return FoundLine(None, pixels, self.name, windows)
        return replace(self.line_near(first, self.recipe.still_band_px), windows=windows)

    def line_near(self, known: LineFit, margin_px: float) -> FoundLine:
        """Fit the pixels within `margin_px` of a known line, along the row."""
        pixels = band_pixels(self.pixels, known, margin_px)
        return FoundLine(self._fit(pixels), pixels, self.name)

    def _fit(self, pixels: np.ndarray) -> LineFit | None:
        r = self.recipe
        if r.ransac_px is None:
            return fit_line(pixels, min_span_px=r.min_span_px)
        fit = ransac_line(pixels, samples=r.ransac_samples, residual_px=r.ransac_px, min_span_px=r.min_span_px)
        return fit if fit and fit.pixels >= r.min_inlier_ratio * len(pixels) else None


def nearest_line(channels: Sequence[Channel], memory: LineMemory, side: int) -> FoundLine:
    """The line of the channel whose fit is closest to the average in `memory`."""
    prior, average = memory.search_prior, memory.average
    lines = [c.line_near(prior, c.recipe.margin_px) if prior else c.line_from_windows(side) for c in channels]
    height = channels[0].recipe.size[1]
    return min(lines, key=lambda line: mean_distance_px(line.fit, average, height) if line.fit and average else inf)


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
        (left, right), (left_fit, right_fit) = lines, shown
        left_road, right_road = (
            None if fit is None else road_line(fit, self._to_road, self.recipe.size[1]) for fit in measured
        )
        binary = channels[left.channel].binary | channels[right.channel].binary
        masks = {name: channel.mask for name, channel in channels.items()}
        steps = Steps(undistorted, masks, binary, left, right, self.warp)
        return LaneResult(left_fit, right_fit, left_road, right_road, state, steps)
