"""Bird's-eye view: the road from above, on a grid in metres, straight from the raw
image.

The four-point warp of the course's first half has pixels of unknown size. Here each
cell has a known position on the road. The centre of each cell is projected through pose
and lens once, when the view is made; after that a frame costs one remap.

The distances of the rows form a geometric series, which matches the spacing of image
rows. A cell near the car covers many pixels and a distant one less than one. Each row
is therefore sampled from an image that is reduced until the cell covers about one of
its pixels, as with mip maps (L. Williams, "Pyramidal parametrics", SIGGRAPH 1983).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from lanes.camera.model import Camera
from lanes.detect.road import VIEW_END_M
from lanes.errors import CameraError

# Enough for images of 4000 columns.
REDUCTIONS = (1, 2, 4, 8, 16)


class LookupTable(NamedTuple):
    """The rows of a view that are sampled at one reduction, and the pixels to sample.

    The pixels are OpenCV's fixed-point maps (`cv2.convertMaps`).
    """

    reduction: int
    rows: slice
    position: np.ndarray
    fraction: np.ndarray


@dataclass(frozen=True, eq=False)
class BirdsEyeView:
    """A grid on the flat road ahead; row 0 is the farthest, column 0 the leftmost.

    Parameters
    ----------
    camera : Camera
        With a camera pose.
    near_m, far_m : float
        Distance ahead of the nearest and the farthest row.
    growth : float
        Relative increase of the distance from one row to the next.
    half_width_m : float
        Extent of the grid to the left and to the right. The default is wide enough for
        a hairpin.
    cell_m : float
        Distance between columns.
    """

    camera: Camera
    near_m: float = 5.0
    far_m: float = VIEW_END_M
    growth: float = 0.022
    half_width_m: float = 9.0
    cell_m: float = 0.05

    @classmethod
    def from_image_border(
        cls, camera: Camera, near_m: float, **options: float
    ) -> BirdsEyeView:
        """The view from the lower border of the image on, not nearer than `near_m`.

        Options are those of the class.
        """
        columns = np.linspace(0, camera.width - 1, 9)
        rows = np.full(9, camera.height - 1.0)
        border = np.column_stack([columns, rows])
        x_m = camera.pixels_to_road(border)[:, 0]
        seen_from_m = x_m[x_m > 0].min(initial=cls.far_m / 2)
        return cls(camera, near_m=max(near_m, float(seen_from_m)), **options)

    @cached_property
    def x_m(self) -> np.ndarray:
        """(rows,) distance ahead of each row, farthest first."""
        rows = int(np.log(self.far_m / self.near_m) / np.log1p(self.growth)) + 1
        return (self.near_m * (1 + self.growth) ** np.arange(rows))[::-1]

    @cached_property
    def row_columns(self) -> np.ndarray:
        """(rows,) depth of each row in columns."""
        return self.x_m * (self.growth / (1 + self.growth) / self.cell_m)

    @cached_property
    def y_m(self) -> np.ndarray:
        """(columns,) lateral position of each column, positive (left) first."""
        half = round(self.half_width_m / self.cell_m)
        return np.arange(half, -half - 1, -1) * self.cell_m

    @cached_property
    def height_m(self) -> float:
        """Height of the camera above the road."""
        return self.camera.require_pose().height_m

    @cached_property
    def focal_px(self) -> float:
        """Focal length along an image row."""
        return float(self.camera.matrix[0, 0])

    @cached_property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return len(self.x_m), len(self.y_m)

    @cached_property
    def pixels(self) -> np.ndarray:
        """(rows, columns, 2) raw pixel (u, v) of the centre of each cell.

        NaN where the lens model does not reach.
        """
        x, y = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        points_m = np.column_stack([x.ravel(), y.ravel()])
        return self.camera.road_to_pixels(points_m).reshape(*self.shape, 2)

    @cached_property
    def seen(self) -> np.ndarray:
        """(rows, columns) bool: the cell lies inside the image."""
        u = self.pixels[..., 0]
        v = self.pixels[..., 1]
        with np.errstate(invalid="ignore"):
            in_columns = (u >= 0) & (u <= self.camera.width - 1)
            in_rows = (v >= 0) & (v <= self.camera.height - 1)
        return in_columns & in_rows

    @cached_property
    def first_row_px(self) -> int:
        """First image row that any cell is sampled from, rounded down to whole reduced
        pixels.

        Raises
        ------
        CameraError
            If no cell is in the image.
        """
        if not self.seen.any():
            pose = self.camera.require_pose().describe()
            raise CameraError(
                f"the camera sees no road between {self.near_m:g} and {self.far_m:g} m "
                f"ahead ({pose}); check the angles of the camera pose, and whether the "
                "pictures show a road."
            )
        rows = np.where(self.seen, self.pixels[..., 1], np.nan)
        first = max(0, int(np.nanmin(rows)) - 2)
        coarsest = REDUCTIONS[-1]
        return first // coarsest * coarsest

    def at_height(self, height_m: float) -> BirdsEyeView:
        """The same cells of the image for another height of the camera.

        All distances are proportional to it.
        """
        factor = height_m / self.height_m
        pose = replace(self.camera.require_pose(), height_m=height_m)
        return RescaledView(
            camera=self.camera.with_pose(pose),
            near_m=factor * self.near_m,
            far_m=factor * self.far_m,
            growth=self.growth,
            half_width_m=factor * self.half_width_m,
            cell_m=factor * self.cell_m,
            cells_of=self,
        )

    def warp(self, image: np.ndarray) -> np.ndarray:
        """The bird's-eye view of a raw image: RGB (rows, columns, 3) uint8.

        Cells outside the image repeat the nearest cell of their row inside it, so that
        no filter sees the image's border as an edge on the road. Use `blacken` before
        display.

        Raises
        ------
        PictureError
            If the image is not RGB or not of the camera's size.
        CameraError
            If no cell is in the image.
        """
        reduced = self.camera.require_size(image)[self.first_row_px :]
        reduction = 1
        cells = np.empty((*self.shape, 3), np.uint8)
        for table in self._lookup_tables:
            if table.reduction != reduction:
                scale = reduction / table.reduction
                reduced = cv2.resize(
                    reduced, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA
                )
                reduction = table.reduction
            cv2.remap(
                reduced,
                table.position,
                table.fraction,
                cv2.INTER_LINEAR,
                dst=cells[table.rows],
                borderMode=cv2.BORDER_REPLICATE,
            )
        return cells

    def blacken(self, cells: np.ndarray) -> np.ndarray:
        """A copy of an image of the view, black where the cells lie outside the raw
        image.
        """
        return cv2.copyTo(cells, self.seen.view(np.uint8))

    @cached_property
    def _lookup_tables(self) -> list[LookupTable]:
        # the reduction of each row, at which a cell covers about one pixel
        cell_px = self.cell_m * self.focal_px / self.x_m
        level = np.floor(np.log2(np.maximum(cell_px, 1))).astype(int)
        level = np.minimum(level, len(REDUCTIONS) - 1)

        tables = []
        nearest_pixels = self._nearest_pixels()
        for index, reduction in enumerate(REDUCTIONS):
            rows = np.flatnonzero(level == index)
            if len(rows):
                part = slice(rows[0], rows[-1] + 1)
                tables.append(self._table(nearest_pixels, part, reduction))
        return tables

    def _nearest_pixels(self) -> np.ndarray:
        """`pixels`; cells outside the image repeat the nearest cell of their row."""
        columns = self.shape[1]
        first = self.seen.argmax(axis=1)
        last = columns - 1 - self.seen[:, ::-1].argmax(axis=1)
        nearest = np.clip(np.arange(columns), first[:, None], last[:, None])
        return np.take_along_axis(self.pixels, nearest[..., None], axis=1)

    def _table(self, pixels: np.ndarray, rows: slice, reduction: int) -> LookupTable:
        """The lookup table of some rows with raw pixels (rows, columns, 2)."""
        # far outside any image, so that the remap returns its border value where the
        # lens does not reach
        from_first_row = pixels[rows] - [0, self.first_row_px]
        from_first_row = np.nan_to_num(from_first_row, nan=-99.0)
        # pixel centres lie at integers: the first reduced pixel is centred on
        # (reduction - 1) / 2
        position = (from_first_row - (reduction - 1) / 2) / reduction
        # OpenCV's stubs do not say that the second map is optional
        maps = cv2.convertMaps(  # type: ignore[call-overload]
            position.astype(np.float32), None, cv2.CV_16SC2
        )
        return LookupTable(reduction, rows, *maps)


@dataclass(frozen=True, eq=False, kw_only=True)
class RescaledView(BirdsEyeView):
    """A view with the image cells of another one, for another height of the camera.

    Nothing is projected again. See `BirdsEyeView.at_height`.
    """

    cells_of: BirdsEyeView

    @cached_property
    def _factor(self) -> float:
        """Distances of this view relative to those of the other one."""
        return self.height_m / self.cells_of.height_m

    @cached_property
    def x_m(self) -> np.ndarray:
        return self._factor * self.cells_of.x_m

    @cached_property
    def y_m(self) -> np.ndarray:
        return self._factor * self.cells_of.y_m

    @cached_property
    def pixels(self) -> np.ndarray:
        return self.cells_of.pixels

    @cached_property
    def seen(self) -> np.ndarray:
        return self.cells_of.seen


def lightness(view_image: np.ndarray) -> np.ndarray:
    """Luma of an RGB view, (rows, columns) uint8, weights of ITU-R BT.601."""
    return cv2.cvtColor(view_image, cv2.COLOR_RGB2GRAY)


def yellowness(view_image: np.ndarray) -> np.ndarray:
    """min(R, G) - B as (rows, columns) int16: large for yellow paint, in sun and in
    shade.
    """
    red, green, blue = cv2.split(view_image)
    return cv2.subtract(cv2.min(red, green), blue, dtype=cv2.CV_16S)
