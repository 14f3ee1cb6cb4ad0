"""How a calibration went, picture by picture: which boards count, how well they fit, and where corners are missing.

A lens is only known where corners were seen: a distortion fitted in the middle says little about the picture's corners.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lanes.camera.calibration.boards import BoardSearch
from lanes.camera.calibration.corners import Board
from lanes.camera.camera import Camera

# The picture is divided here, as shares of width and height: the outer quarters are where lenses bend most.
DIVISIONS = (0.0, 0.25, 0.75, 1.0)
PLACES = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
# Fewer corners than this, a row or two of one board, do not tell how the lens bends there.
FEWEST_CORNERS = 10
# A board with corners so near to the picture's edge, in squares, goes on beyond it.
NEAR_EDGE_SQUARES = 1.5


def count_corners(boards: Mapping[str, Board]) -> np.ndarray:
    """Corners (3, 3) seen in each part of the picture, as `PLACES` names them."""
    counts = np.zeros((3, 3), int)
    for board in boards.values():
        u, v = ((board.corners_px + 0.5) / board.size).T
        counts += np.histogram2d(v, u, bins=[DIVISIONS, DIVISIONS])[0].astype(int)
    return counts


def describe_coverage(boards: Mapping[str, Board]) -> str:
    """A sentence that names the parts of the picture where corners are missing."""
    counts = count_corners(boards)
    missing = {
        "no": [PLACES[row][column] for row, column in np.argwhere(counts == 0)],
        "few": [PLACES[row][column] for row, column in np.argwhere((counts > 0) & (counts < FEWEST_CORNERS))],
    }
    parts = [f"{how} corners in the {_list(places)}" for how, places in missing.items() if places]
    if not parts:
        return "corners were seen in all parts of the picture"
    return f"{' and '.join(parts)}: add boards there"


def describe_boards(search: BoardSearch, camera: Camera) -> dict[str, str]:
    """What became of each picture: "used", "cut by the edge, 7x6 used", or why not."""
    used, rejected = camera.report.board_rms_px, camera.report.rejected
    return {
        name: _fate(search.boards[name], search.pattern, camera) if name in used else rejected[name]
        for name in search.paths
    }


def used_boards(search: BoardSearch, camera: Camera) -> dict[str, Board]:
    """The boards that the calibration rests on."""
    return {name: search.boards[name] for name in search.paths if name in camera.report.board_rms_px}


def format_boards(search: BoardSearch, camera: Camera) -> str:
    """A table: picture, error in pixels, what became of it."""
    fates, errors = describe_boards(search, camera), camera.report.board_rms_px
    width = max(map(len, fates))
    lines = [f"{'picture':<{width}}  error px  board"]
    for name, fate in fates.items():
        error = f"{errors[name]:8.2f}" if name in errors else f"{'-':>8}"
        lines.append(f"{name:<{width}}  {error}  {fate}")
    return "\n".join(lines)


def _fate(board: Board, pattern: tuple[int, int], camera: Camera) -> str:
    size = "" if board.size == camera.size else f", picture of {board.size[0]}x{board.size[1]}"
    if {board.columns, board.rows} == set(pattern):
        return f"used{size}"
    which = "cut by the edge" if _reaches_edge(board) else "partly hidden"
    return f"{which}, {board.columns}x{board.rows} corners of it used{size}"


def _reaches_edge(board: Board) -> bool:
    grid = board.corners_px.reshape(board.rows, board.columns, 2)
    square_px = np.median(np.hypot(*np.diff(grid, axis=1).reshape(-1, 2).T))
    to_edge = np.minimum(board.corners_px, np.array(board.size) - 1 - board.corners_px).min()
    return bool(to_edge < NEAR_EDGE_SQUARES * square_px)


def _list(places: list[str]) -> str:
    return places[0] if len(places) == 1 else f"{', '.join(places[:-1])} and {places[-1]}"
