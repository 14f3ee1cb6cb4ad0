"""Summary of a calibration: use and error of each picture, regions of the picture without corners, contact sheet.

The distortion is determined only where corners were detected. A fit to the centre of the picture does not extrapolate
to its corners.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from lanes.camera.calibration.boards import BoardDetections
from lanes.camera.calibration.corners import Board, draw_board
from lanes.camera.camera import Camera, resize_points
from lanes.drawing.canvas import LANE_COLOUR, LEFT_COLOUR, PANEL_COLOUR, TEXT_COLOUR, WINDOW_COLOUR, Colour
from lanes.drawing.pictures import to_rgb, write_text
from lanes.io.frames import PictureError
from lanes.io.images import read_image

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
# Contact sheet: tiles in a row, and sizes.
COLUMNS, TILE_PX, LABEL_PX, GAP_PX, TEXT_SIZE_PX = 5, (400, 225), 44, 6, 13


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
    report = camera.require_report()
    used, rejected = report.board_rms_px, report.rejected
    return {
        name: _describe_use(detections.boards[name], detections.pattern, camera) if name in used else rejected[name]
        for name in detections.paths
    }


def used_boards(detections: BoardDetections, camera: Camera) -> dict[str, Board]:
    """The boards used for the calibration, by the name of the picture."""
    used = camera.require_report().board_rms_px
    return {name: detections.boards[name] for name in detections.paths if name in used}


def format_boards(detections: BoardDetections, camera: Camera) -> str:
    """Text table with name, reprojection error in pixels and use of each picture."""
    uses, errors = describe_boards(detections, camera), camera.require_report().board_rms_px
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


def draw_contact_sheet(detections: BoardDetections, camera: Camera) -> np.ndarray:
    """All pictures of a calibration on one contact sheet.

    RGB (height, width, 3), uint8. The frame of a tile is green if the complete board was used, yellow if a part of it
    was used, and red if the picture was not used. The last tile shows the positions of all corners used, and their
    number by region. `camera` is the result of `calibrate_detections`.
    """
    uses, errors = describe_boards(detections, camera), camera.require_report().board_rms_px
    tiles = []
    for name, path in detections.paths.items():
        label = [name, f"{errors[name]:.2f} px, {uses[name]}"] if name in errors else [name, uses[name]]
        colour = LEFT_COLOUR if name not in errors else LANE_COLOUR if uses[name].startswith("used") else WINDOW_COLOUR
        tiles.append(_draw_tile(_draw_corners(detections, name, path), label, colour))
    tiles.append(_draw_tile(_draw_coverage(detections, camera), ["where corners were seen"], TEXT_COLOUR))
    columns = min(COLUMNS, len(tiles))
    blank = np.full_like(tiles[0], PANEL_COLOUR)
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    return np.vstack(rows)


def _draw_corners(detections: BoardDetections, name: str, path: Path) -> np.ndarray:
    """The picture with its corners, both resized to a tile; black if it cannot be read."""
    try:
        image = read_image(path)
    except PictureError:
        return np.zeros((TILE_PX[1], TILE_PX[0], 3), np.uint8)
    small = _fit_to_tile(image)
    if name not in detections.boards:
        return small
    board, scale = detections.boards[name], small.shape[1] / image.shape[1]
    corners = resize_points(board.corners_px, scale).astype(np.float32)
    return draw_board(small, replace(board, corners_px=corners, size=(small.shape[1], small.shape[0])))


def _fit_to_tile(image: np.ndarray) -> np.ndarray:
    scale = min(TILE_PX[0] / image.shape[1], TILE_PX[1] / image.shape[0])
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _draw_tile(image: np.ndarray, label: list[str], colour: Colour) -> np.ndarray:
    """The picture below its label, in a frame of that colour."""
    small = _fit_to_tile(image)
    tile = np.full((TILE_PX[1] + LABEL_PX, TILE_PX[0], 3), PANEL_COLOUR, np.uint8)
    left = (TILE_PX[0] - small.shape[1]) // 2
    tile[LABEL_PX : LABEL_PX + small.shape[0], left : left + small.shape[1]] = small
    tile[:LABEL_PX] = write_text(tile[:LABEL_PX], label, size_px=TEXT_SIZE_PX, panel_alpha=0)
    return cv2.copyMakeBorder(tile, GAP_PX, GAP_PX, GAP_PX, GAP_PX, cv2.BORDER_CONSTANT, value=colour)


def _draw_coverage(detections: BoardDetections, camera: Camera) -> np.ndarray:
    """All corners used as dots, the regions of the picture, and the number of corners in each."""
    width, height = 2 * TILE_PX[0], round(2 * TILE_PX[0] * camera.height / camera.width)
    boards = used_boards(detections, camera)
    drawn = to_rgb(np.full((height, width), 30, np.uint8))
    for board in boards.values():
        for u, v in (board.corners_px + 0.5) / board.size * (width, height):
            cv2.circle(drawn, (round(float(u)), round(float(v))), 3, LANE_COLOUR, -1, cv2.LINE_AA)
    for share in REGION_BORDERS[1:-1]:
        cv2.line(drawn, (0, round(share * height)), (width, round(share * height)), TEXT_COLOUR, 1)
        cv2.line(drawn, (round(share * width), 0), (round(share * width), height), TEXT_COLOUR, 1)
    edges_u, edges_v = (np.multiply(REGION_BORDERS, length).round().astype(int) for length in (width, height))
    counts = count_corners(boards)
    for row, column in np.ndindex(counts.shape):
        region = drawn[edges_v[row] : edges_v[row + 1], edges_u[column] : edges_u[column + 1]]
        region[:] = write_text(region, str(counts[row, column]), corner="bottom right", size_px=28)
    return drawn
