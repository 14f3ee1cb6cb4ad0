"""Summary of a calibration: use and reprojection error of each picture, and regions of the picture without corners.

The distortion is determined only where corners were detected. A fit to the centre of the picture does not extrapolate
to its corners.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lanes.camera.calibration.boards import BoardDetections
from lanes.camera.calibration.corners import Board
from lanes.camera.camera import Camera

# Borders of the 3 x 3 regions, as shares of width and height. Distortion is largest in the outer quarters.
REGION_BORDERS = (0.0, 0.25, 0.75, 1.0)
REGION_NAMES = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
# Fewer corners (one or two rows of one board) do not determine the distortion of a region.
MIN_CORNERS = 10
# A partial board with corners closer to the border of the picture, in squares, is cut off by it.
MAX_BORDER_DISTANCE_SQUARES = 1.5


def count_corners(boards: Mapping[str, Board]) -> np.ndarray:
    """Number of corners (3, 3) in each region of the picture; `REGION_NAMES` has their names."""
    counts = np.zeros((3, 3), int)
    for board in boards.values():
        u, v = ((board.corners_px + 0.5) / board.size).T
        counts += np.histogram2d(v, u, bins=[REGION_BORDERS, REGION_BORDERS])[0].astype(int)
    return counts


def describe_coverage(boards: Mapping[str, Board]) -> str:
    """One sentence that names the regions with no or few corners."""
    counts = count_corners(boards)
    missing = {
        "no": [REGION_NAMES[row][column] for row, column in np.argwhere(counts == 0)],
        "few": [REGION_NAMES[row][column] for row, column in np.argwhere((counts > 0) & (counts < MIN_CORNERS))],
    }
    clauses = [f"{amount} corners in the {_join(regions)}" for amount, regions in missing.items() if regions]
    if not clauses:
        return "corners were detected in all regions of the picture"
    return f"{' and '.join(clauses)}: add boards there"


def describe_boards(detections: BoardDetections, camera: Camera) -> dict[str, str]:
    """Use of each picture, by name: "used", "cut by the edge, 7x6 corners of it used", or why it was not used."""
    used, rejected = camera.report.board_rms_px, camera.report.rejected
    return {
        name: _describe_use(detections.boards[name], detections.pattern, camera) if name in used else rejected[name]
        for name in detections.paths
    }


def used_boards(detections: BoardDetections, camera: Camera) -> dict[str, Board]:
    """The boards used for the calibration, by the name of the picture."""
    return {name: detections.boards[name] for name in detections.paths if name in camera.report.board_rms_px}


def format_boards(detections: BoardDetections, camera: Camera) -> str:
    """Text table with name, reprojection error in pixels and use of each picture."""
    uses, errors = describe_boards(detections, camera), camera.report.board_rms_px
    width = max(map(len, uses))
    lines = [f"{'picture':<{width}}  error px  board"]
    for name, use in uses.items():
        error = f"{errors[name]:8.2f}" if name in errors else f"{'-':>8}"
        lines.append(f"{name:<{width}}  {error}  {use}")
    return "\n".join(lines)


def _describe_use(board: Board, pattern: tuple[int, int], camera: Camera) -> str:
    size = "" if board.size == camera.size else f", picture of {board.size[0]}x{board.size[1]}"
    if {board.columns, board.rows} == set(pattern):
        return f"used{size}"
    reason = "cut by the edge" if _is_cut_off(board) else "partly hidden"
    return f"{reason}, {board.columns}x{board.rows} corners of it used{size}"


def _is_cut_off(board: Board) -> bool:
    grid = board.corners_px.reshape(board.rows, board.columns, 2)
    square_px = np.median(np.hypot(*np.diff(grid, axis=1).reshape(-1, 2).T))
    to_border_px = np.minimum(board.corners_px, np.array(board.size) - 1 - board.corners_px).min()
    return bool(to_border_px < MAX_BORDER_DISTANCE_SQUARES * square_px)


def _join(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
