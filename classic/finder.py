"""The classic lane finder: threshold, warp, search and fit of one recipe, on stills or with the memory of a drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import inf

import numpy as np

from classic.fit import LineFit, RoadLine, fit_line, mean_distance_px, ransac_line, road_line
from classic.memory import LineMemory
from classic.recipe import Recipe
from classic.search import Window, WindowSearch, band_pixels, binary_pixels, sliding_windows
from classic.threshold import Thresholds
from classic.warp import FourPointWarp, birdseye_to_road, scale_to_road
from lanes.camera import Camera, undistort
from lanes.errors import CameraError


@dataclass(frozen=True, eq=False)
class FoundLine:
    """One line of one frame, before the memory: fit, pixels (N, 2), name of the channel, search windows."""

    fit: LineFit | None
    pixels: np.ndarray
    channel: str
    windows: tuple[Window, ...] = ()


@dataclass(frozen=True, eq=False)
class LaneResult:
    """The lane in one frame with its intermediate results; a measurement is None if the lines it needs are missing.

    Signs: curvature > 0: the road bends left; offset > 0: the car is left of the lane centre.

    Parameters
    ----------
    left, right : LineFit or None
        Lines in the bird's-eye view, smoothed by the memory if there is one.
    left_road, right_road : RoadLine or None
        Lines on the road, metres.
    state : {"found", "kept", "lost"}
        "found": both lines measured in this frame; "kept": at least one line from memory; "lost": a line is missing.
    undistorted : ndarray of shape (height, width, 3), uint8
        The image without lens distortion, RGB.
    masks : dict of ndarray (height, width), uint8
        All binaries by name; of the bird's-eye view if the recipe warps first, otherwise of the undistorted image.
    warped_binary : ndarray of shape (height, width), uint8
        Binary with the pixels of both lines, in the bird's-eye view.
    left_found, right_found : FoundLine
        Lines of this frame without the memory.
    warp : FourPointWarp
        Homography between the undistorted image and the bird's-eye view.
    """

    left: LineFit | None
    right: LineFit | None
    left_road: RoadLine | None
    right_road: RoadLine | None
    state: str
    undistorted: np.ndarray
    masks: dict[str, np.ndarray]
    warped_binary: np.ndarray
    left_found: FoundLine
    right_found: FoundLine
    warp: FourPointWarp

    @property
    def lines_px(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Points (N, 2) of both lines in the undistorted image, from far to near; None for a line that is missing."""
        left, right = (
            None if line is None else self.warp.points_to_image(line.points(self.warp.size[1]))
            for line in (self.left, self.right)
        )
        return left, right

    @property
    def curvature_per_m(self) -> float | None:
        """Mean curvature of the available lines in 1/m, > 0 bends left."""
        lines = [line.curvature_per_m() for line in (self.left_road, self.right_road) if line]
        return sum(lines) / len(lines) if lines else None

    @property
    def offset_m(self) -> float | None:
        """Offset from the lane centre in metres, > 0: car left of the lane centre."""
        if self.left_road is None or self.right_road is None:
            return None
        return -(self.left_road.c0_m + self.right_road.c0_m) / 2

    @property
    def lane_width_m(self) -> float | None:
        """Distance between the lines at the car in metres, perpendicular to the lane."""
        if self.left_road is None or self.right_road is None:
            return None
        left, right = self.left_road, self.right_road
        return (left.c0_m - right.c0_m) / float(np.hypot(1, (left.c1 + right.c1) / 2))

    def lateral_m(self, x_m: np.ndarray) -> np.ndarray | None:
        """Lateral positions (2, N) of the left and right line at distances (N,), metres; None if a line is missing."""
        if self.left_road is None or self.right_road is None:
            return None
        return np.array([self.left_road.lateral_m(x_m), self.right_road.lateral_m(x_m)])

    def as_row(self) -> dict[str, str | float | None]:
        """Measurements by the column names of the telemetry."""
        row = {name: getattr(self, name) for name in ("state", "offset_m", "curvature_per_m", "lane_width_m")}
        for side, line in (("left", self.left_road), ("right", self.right_road)):
            for name in ("c0_m", "c1", "c2_per_m"):
                row[f"{side}_{name}"] = line and getattr(line, name)
        return row


@dataclass(frozen=True, eq=False)
class Channel:
    """One binary of a frame with the line search of a recipe; warping and window search run at most once.

    `mask` (height, width), uint8, is of the bird's-eye view if the recipe warps first, else of the undistorted image.
    """

    name: str
    mask: np.ndarray
    recipe: Recipe
    warp: FourPointWarp

    @cached_property
    def binary(self) -> np.ndarray:
        """The binary in the bird's-eye view."""
        return self.mask if self.recipe.warp_first else self.warp.image_to_birdseye(self.mask)

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
    """Lane detection with a classic recipe: `find` for a still, `follow` for the consecutive frames of one drive.

    Parameters
    ----------
    recipe : Recipe
        For images of the camera's size.
    camera : Camera
        Its intrinsics undistort the images; its pose projects pixels to the road.
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
        self.recipe, self.camera, self.warp = recipe, camera, recipe.four_point_warp()
        if metres_per_px is None:
            self._to_road = partial(birdseye_to_road, warp=self.warp, camera=camera)
        else:
            self._to_road = partial(scale_to_road, metres_per_px=metres_per_px, birdseye_size=recipe.size)
        self._memories = recipe.memories

    def find(self, image: np.ndarray) -> LaneResult:
        """The lane in one raw RGB image of the camera's size, "lost" if not both lines are found.

        The memory is neither used nor changed. Raises PictureError if the image is not an RGB image of the camera's
        size.
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
        masks = thresholds.masks(self.warp.image_to_birdseye(undistorted) if self.recipe.warp_first else undistorted)
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
        return LaneResult(
            left=left_fit,
            right=right_fit,
            left_road=left_road,
            right_road=right_road,
            state=state,
            undistorted=undistorted,
            masks={name: channel.mask for name, channel in channels.items()},
            warped_binary=channels[left.channel].binary | channels[right.channel].binary,
            left_found=left,
            right_found=right,
            warp=self.warp,
        )
