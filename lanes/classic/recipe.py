"""Parameters of a classic lane finder, for pictures of one size, and their scaling to another size."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lanes.classic.memory import LineMemory
from lanes.classic.threshold import Thresholds
from lanes.classic.warp import FourPointWarp

Points = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Recipe:
    """Parameters of one classic lane finder, in pixels of pictures of `size`.

    Parameters
    ----------
    size : tuple of int
        (width, height) of the pictures.
    source_px, destination_px : tuple of four (u, v)
        Corresponding points of the homography, see `warp.FourPointWarp`.
    warp_first : bool
        If True, the colour picture is warped and then thresholded; otherwise the binaries are warped.
    thresholds, video_thresholds : Thresholds
        For stills and for consecutive frames.
    histogram_rows_px : tuple of int
        First and end row of the histogram that finds the start of the lines.
    margin_px : float
        Half width of the windows, and of the search band around the line of the previous frames (video).
    still_band_px : float
        Half width of the search band around the line of the windows (stills).
    windows, recentre_pixels, flood_pixels
        See `search.sliding_windows`.
    ransac_px : float or None
        Inlier threshold of RANSAC; None fits by least squares.
    ransac_trials, ransac_samples : int
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
    memories: tuple[LineMemory, LineMemory]
    size: tuple[int, int] = (1280, 720)
    warp_first: bool = False
    histogram_rows_px: tuple[int, int] = (360, 720)
    windows: int = 9
    recentre_pixels: int = 50
    flood_pixels: int | None = None
    ransac_px: float | None = None
    ransac_trials: int = 100
    ransac_samples: int = 150
    min_inlier_ratio: float = 0.4
    min_span_px: float = 160  # two windows

    def warp(self) -> FourPointWarp:
        """The homography from the undistorted picture to the bird's-eye view."""
        return FourPointWarp(self.source_px, self.destination_px, self.size)

    def scaled(self, size: tuple[int, int]) -> Recipe:
        """The same recipe for pictures resized to `size` (width, height).

        Lengths, pixel counts and kernels are scaled. Gradients are not, because a smaller picture has sharper edges.

        Raises
        ------
        ValueError
            If the size is not positive.
        """
        width, height = size
        if width < 1 or height < 1:
            raise ValueError(
                f"a picture size of {width}x{height} pixels is not valid; give the width and height of the pictures."
            )
        sx, sy = width / self.size[0], height / self.size[1]
        area = sx * sy
        return replace(
            self,
            size=(width, height),
            source_px=_scale_points(self.source_px, sx, sy),
            destination_px=_scale_points(self.destination_px, sx, sy),
            thresholds=self.thresholds.scaled(area**0.5),
            video_thresholds=self.video_thresholds.scaled(area**0.5),
            histogram_rows_px=tuple(round(row * sy) for row in self.histogram_rows_px),
            margin_px=self.margin_px * sx,
            still_band_px=self.still_band_px * sx,
            recentre_pixels=max(round(self.recentre_pixels * area), 1),
            flood_pixels=self.flood_pixels and max(round(self.flood_pixels * area), 1),
            ransac_px=self.ransac_px and self.ransac_px * sx,
            min_span_px=self.min_span_px * sy,
            memories=tuple(m.scaled(sx, sy) for m in self.memories),
        )


def _scale_points(points: Points, sx: float, sy: float) -> Points:
    """Pixel centres are at integers, so the picture begins at -0.5: shift by half a pixel, scale, shift back."""
    return tuple(((u + 0.5) * sx - 0.5, (v + 0.5) * sy - 0.5) for u, v in points)
