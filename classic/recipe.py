"""The parameters of the three classic lane finders, their scaling to another image size, and to a camera pose.

- "hls_sobel" (A): warp the colour image; saturation or gradients; mean of the last five accepted fits;
- "equalized_hsv" (B): brightest and yellow pixels or strong gradients; mean of the last ten;
- "best_channel" (C): six binaries, the best one for each line; RANSAC; mean of the last thirty, with blended outliers.

The parameters are the published ones. The finder differs from the originals where those had defects;
tests/classic/test_finder.py has a test for each difference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from classic.memory import LineMemory
from classic.threshold import BestChannelThresholds, EqualizedHsvThresholds, HlsSobelThresholds, Thresholds
from classic.warp import FourPointWarp
from lanes.camera import Camera, resize_points
from lanes.errors import CameraError

Points = tuple[tuple[float, float], ...]

# Suffix of the name of a recipe with points from the camera pose.
POSE_SUFFIX = "_pose"
# Limit of the far edge from the pose, metres. The published top row is 41 m away in the embedded images. In a camera
# that looks farther up it is much farther away, or above the horizon.
MAX_FAR_EDGE_M = 60.0


@dataclass(frozen=True)
class Recipe:
    """Parameters of one classic lane finder, in pixels of images of `size`.

    Parameters
    ----------
    size : tuple of int
        (width, height) of the images.
    source_px, destination_px : tuple of four (u, v)
        Corresponding points of the homography, see `warp.FourPointWarp`.
    warp_first : bool
        If True, the colour image is warped and then thresholded; otherwise the binaries are warped.
    thresholds, video_thresholds : Thresholds
        For stills and for consecutive frames.
    histogram_rows_px : tuple of int
        First and end row of the histogram that finds the start of the lines.
    margin_px : float
        Half width of the windows, and of the search band around the line of the previous frames (video).
    still_band_px : float
        Half width of the search band around the line of the windows (stills).
    recentre_pixels, flood_pixels
        See `search.sliding_windows`.
    ransac_px : float or None
        Inlier threshold of RANSAC; None fits by least squares.
    ransac_samples : int
        See `fit.ransac_line`.
    min_inlier_ratio : float, in range 0..1
        Smallest share of the pixels in the search band that must be inliers of the line. A noisy channel fills the
        band evenly and would otherwise confirm the previous line forever. Measured on motorway stills: markings 0.5 to
        1.0, noise and flooded thresholds 0.2 to 0.38.
    min_span_px : float
        Smallest number of rows from the first to the last pixel of a line; a shorter line does not determine curvature.
    memories : tuple of LineMemory
        Empty memories of the left and the right line.
    """

    name: str
    source_px: Points
    destination_px: Points
    thresholds: Thresholds
    video_thresholds: Thresholds
    margin_px: float
    still_band_px: float
    memories: tuple[LineMemory, ...]
    size: tuple[int, int] = (1280, 720)
    warp_first: bool = False
    histogram_rows_px: tuple[int, int] = (360, 720)
    recentre_pixels: int = 50
    flood_pixels: int | None = None
    ransac_px: float | None = None
    ransac_samples: int = 150
    min_inlier_ratio: float = 0.4
    min_span_px: float = 160  # two windows

    def four_point_warp(self) -> FourPointWarp:
        """The homography from the undistorted image to the bird's-eye view."""
        return FourPointWarp(np.array(self.source_px), np.array(self.destination_px), self.size)

    def require_size(self, camera: Camera) -> None:
        """Raise CameraError unless the recipe is for images of the camera's size."""
        if self.size != camera.size:
            raise CameraError(
                f"recipe {self.name} is for {self.size[0]}x{self.size[1]} pictures, but the camera was "
                f"calibrated for {camera.width}x{camera.height}; use get_recipe(name, camera.size)."
            )

    def scaled(self, size: tuple[int, int]) -> Recipe:
        """The same recipe for images resized to `size` (width, height).

        Lengths, pixel counts and kernels are scaled. Gradients are not, because a smaller image has sharper edges.
        Raises ValueError if the size is not positive.
        """
        width, height = size
        if width < 1 or height < 1:
            raise ValueError(
                f"a picture size of {width}x{height} pixels is not valid; give the width and height of the pictures."
            )
        sx, sy = width / self.size[0], height / self.size[1]
        area = sx * sy
        first_row, end_row = self.histogram_rows_px
        return replace(
            self,
            size=(width, height),
            source_px=_to_tuples(resize_points(np.array(self.source_px), (sx, sy))),
            destination_px=_to_tuples(resize_points(np.array(self.destination_px), (sx, sy))),
            thresholds=self.thresholds.scaled(area**0.5),
            video_thresholds=self.video_thresholds.scaled(area**0.5),
            histogram_rows_px=(round(first_row * sy), round(end_row * sy)),
            margin_px=self.margin_px * sx,
            still_band_px=self.still_band_px * sx,
            recentre_pixels=max(round(self.recentre_pixels * area), 1),
            flood_pixels=self.flood_pixels and max(round(self.flood_pixels * area), 1),
            ransac_px=self.ransac_px and self.ransac_px * sx,
            min_span_px=self.min_span_px * sy,
            memories=tuple(m.scaled(sx, sy) for m in self.memories),
        )


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
    """A classic recipe by name, for images of `size` (width, height).

    Raises ValueError if there is no recipe of that name, or the size is not positive.
    """
    if name not in RECIPES:
        raise ValueError(f"there is no recipe {name!r}; the recipes are {', '.join(RECIPES)}.")
    return RECIPES[name].scaled(size)


def recipe_from_pose(recipe: Recipe, camera: Camera) -> Recipe:
    """The recipe, named "..._pose", with the source points of a true rectangle on the road.

    The published points were chosen for another camera pose. With these points the bird's-eye view is a map of the road
    with two constant scales. The edges of the rectangle are parallel to the car's axis and equally far to the left and
    right of the camera. Its near and far edge are where the centre column of the image crosses the published bottom and
    top row, the far edge at most `MAX_FAR_EDGE_M` ahead. Its width is the published one at the near edge. Points may
    lie outside the image. Raises CameraError if the camera has no pose or another size than the recipe, or the near
    edge is not on the road.
    """
    pose = camera.require_pose()
    recipe.require_size(camera)
    pinhole = replace(camera, distortion=np.zeros(5))  # the points are those of the undistorted image
    source = np.array(recipe.source_px)
    u, v = source.T
    left, near = u < u.mean(), v > v.mean()
    centre = (camera.width - 1) / 2
    near_m, far_m = pinhole.pixels_to_road(np.array([(centre, v[near].mean()), (centre, v[~near].mean())]))[:, 0]
    half_width_m = np.ptp(pinhole.pixels_to_road(source[near])[:, 1]) / 2
    x = np.where(near, near_m, np.fmin(far_m, MAX_FAR_EDGE_M))
    points = pinhole.road_to_pixels(np.column_stack([x, np.where(left, half_width_m, -half_width_m)]))
    if not (np.isfinite(points).all() and near_m < MAX_FAR_EDGE_M):
        raise CameraError(
            f"the bottom row of recipe {recipe.name}'s points is not on the road ahead ({pose.describe()}); "
            "correct the camera pose."
        )
    return replace(recipe, name=recipe.name + POSE_SUFFIX, source_px=_to_tuples(points))


def _to_tuples(points: np.ndarray) -> Points:
    return tuple(map(tuple, points.tolist()))
