"""The road from above, on a grid in metres, straight from the raw picture.

The four-point warp of the course's first half has pixels of unknown size. Here every cell has a place on the road:
its centre goes through pose and lens once, when the view is made, and from then on a frame costs one lookup.

Rows follow a geometric series: each is a fixed share farther than the last, as pixel rows are. A cell near the car
covers many pixels, one far away less than one; the lookup therefore reads from a picture reduced so far that the cell
covers about one of its pixels (the idea of mip maps, L. Williams, "Pyramidal parametrics", SIGGRAPH 1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from lanes.camera.camera import Camera
from lanes.camera.camera_pose import CameraError
from lanes.io.frames import Frame, YuvFrame, rgb_to_yuv

# Enough for pictures of 4000 columns.
REDUCTIONS = (1, 2, 4, 8, 16)


@dataclass(frozen=True, eq=False)
class BirdsEyeView:
    """A grid on the flat road ahead; row 0 is the farthest, column 0 the leftmost, as one looks.

    Parameters
    ----------
    camera : Camera
        With a camera pose.
    near_m, far_m : float
        Distance ahead of the nearest and the farthest row.
    growth : float
        Each row lies this share farther than the one before it.
    half_width_m : float
        How far the grid reaches to the left and to the right; wide enough for a hairpin.
    cell_m : float
        Distance between columns.
    """

    camera: Camera
    near_m: float = 5.0
    far_m: float = 70.0
    growth: float = 0.022
    half_width_m: float = 9.0
    cell_m: float = 0.05

    @cached_property
    def x_m(self) -> np.ndarray:
        """(rows,) distance ahead of each row, farthest first."""
        rows = int(np.log(self.far_m / self.near_m) / np.log1p(self.growth)) + 1
        return (self.near_m * (1 + self.growth) ** np.arange(rows))[::-1]

    @cached_property
    def y_m(self) -> np.ndarray:
        """(columns,) lateral place of each column, positive (left) first."""
        half = round(self.half_width_m / self.cell_m)
        return np.arange(half, -half - 1, -1) * self.cell_m

    @property
    def height_m(self) -> float:
        """Height of the camera above the road."""
        return self.camera.pose.height_m

    @property
    def focal_px(self) -> float:
        """Focal length along a picture row."""
        return float(self.camera.matrix[0, 0])

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return len(self.x_m), len(self.y_m)

    @cached_property
    def pixels(self) -> np.ndarray:
        """(rows, columns, 2) raw pixel (u, v) of each cell's centre; NaN where the lens is blind."""
        x, y = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        return self.camera.road_to_pixels(np.column_stack([x.ravel(), y.ravel()])).reshape(*self.shape, 2)

    @cached_property
    def seen(self) -> np.ndarray:
        """(rows, columns) bool: the cell lies inside the picture."""
        u, v = np.moveaxis(self.pixels, 2, 0)
        with np.errstate(invalid="ignore"):
            return (u >= 0) & (u <= self.camera.width - 1) & (v >= 0) & (v <= self.camera.height - 1)

    def seen_around(self, columns: int) -> np.ndarray:
        """(rows, columns) uint8: 1 where so many cells to the left and to the right lie inside the picture, too."""
        if columns not in self._seen_around:
            self._seen_around[columns] = cv2.erode(self.seen.astype(np.uint8), np.ones((1, 2 * columns + 1), np.uint8))
        return self._seen_around[columns]

    @cached_property
    def _seen_around(self) -> dict[int, np.ndarray]:
        """Worked out once, not in every frame."""
        return {}

    def seen_share(self, rows: int, columns: int) -> np.ndarray:
        """(rows, columns) float32: which share of a window around each cell lies inside the picture."""
        if (rows, columns) not in self._seen_share:
            self._seen_share[rows, columns] = cv2.blur(self.seen.astype(np.float32), (columns, rows))
        return self._seen_share[rows, columns]

    @cached_property
    def _seen_share(self) -> dict[tuple[int, int], np.ndarray]:
        """Worked out once, not in every frame."""
        return {}

    @cached_property
    def _nearest_pixels(self) -> np.ndarray:
        """As `pixels`; for a cell outside the picture, that of the nearest cell of its row that is inside."""
        columns = self.shape[1]
        first, last = self.seen.argmax(axis=1), columns - 1 - self.seen[:, ::-1].argmax(axis=1)
        nearest = np.clip(np.arange(columns), first[:, None], last[:, None])
        return np.take_along_axis(self.pixels, nearest[..., None], axis=1)

    @cached_property
    def _fine(self) -> list[tuple[int, slice, np.ndarray, np.ndarray]]:
        return self._lookups(0)

    @cached_property
    def _coarse(self) -> list[tuple[int, slice, np.ndarray, np.ndarray]]:
        return self._lookups(1)

    def _lookups(self, first: int) -> list[tuple[int, slice, np.ndarray, np.ndarray]]:
        """(reduction, rows, map, map fraction): which rows are read from which reduced picture, and where.

        The picture itself is already reduced by the first of `REDUCTIONS`.
        """
        cell_px = self.cell_m * self.focal_px / self.x_m
        level = np.clip(np.floor(np.log2(np.maximum(cell_px, 1))).astype(int), first, len(REDUCTIONS) - 1)
        lookups = []
        for index, reduction in enumerate(REDUCTIONS):
            rows = np.flatnonzero(level == index)
            if len(rows):
                part = slice(rows[0], rows[-1] + 1)
                # pixel centres lie at integers: the first reduced pixel is centred on (reduction - 1) / 2
                place = (
                    np.nan_to_num(self._nearest_pixels[part] - [0, self.top_px], nan=-99.0) - (reduction - 1) / 2
                ) / reduction
                lookups.append((reduction, part, *cv2.convertMaps(place.astype(np.float32), None, cv2.CV_16SC2)))
        return lookups

    @cached_property
    def top_px(self) -> int:
        """First picture row that any cell is read from, rounded down to whole reduced pixels.

        Raises
        ------
        CameraError
            If no cell is in the picture.
        """
        if not self.seen.any():
            raise CameraError(
                f"a camera mounted like this sees no road between {self.near_m:g} and {self.far_m:g} m ahead "
                f"({self.camera.pose}); check the camera pose's angles, or estimate it from the drive's own pictures."
            )
        top = int(np.nanmin(np.where(self.seen, self.pixels[..., 1], np.nan)))
        return max(0, top - 2) // REDUCTIONS[-1] * REDUCTIONS[-1]

    def warp(self, image: Frame) -> np.ndarray:
        """The road in `image` (raw) from above: RGB (rows, columns, 3) uint8.

        Beyond the picture's edges each row goes on as it ends there, so that no filter takes them for edges of the
        road; `blacken` what people are to look at.
        """
        self.camera.require_size(image)
        if not isinstance(image, YuvFrame):
            return self._look_up(image[self.top_px :], 1, self._fine, 0)
        y, *differences = image.planes
        dark, gray, _ = rgb_to_yuv((0, 0, 0), image.colour_space)
        found = [
            self._look_up(y[self.top_px :], 1, self._fine, dark),
            *(self._look_up(plane[self.top_px // 2 :], 2, self._coarse, gray) for plane in differences),
        ]
        # only the cells of the view become RGB, not the whole picture
        return cv2.transform(cv2.merge(found), image.colour_space.to_rgb)

    def blacken(self, cells: np.ndarray) -> np.ndarray:
        """A copy of what `warp` returned, or of another picture of the view, black where unseen."""
        return cv2.copyTo(cells, self.seen.view(np.uint8))

    def _look_up(self, reduced: np.ndarray, done: int, lookups: list, outside: float) -> np.ndarray:
        """The cells' values in the rows from `top_px` on of the picture reduced `done` times."""
        view = np.empty((*self.shape, *reduced.shape[2:]), np.uint8)
        for reduction, rows, place, fraction in lookups:
            if reduction != done:
                share = done / reduction
                reduced = cv2.resize(reduced, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
                done = reduction
            border = {"borderMode": cv2.BORDER_CONSTANT, "borderValue": outside}
            cv2.remap(reduced, place, fraction, cv2.INTER_LINEAR, dst=view[rows], **border)
        return view
