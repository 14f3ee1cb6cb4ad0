"""A sheet of all pictures of a calibration, with the corners found, and where in the picture corners were seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from lanes.camera.calibration.boards import BoardSearch
from lanes.camera.calibration.corners import draw_board
from lanes.camera.calibration.coverage import DIVISIONS, count_corners, describe_boards, used_boards
from lanes.camera.camera import Camera
from lanes.drawing.canvas import LANE_COLOUR, LEFT_COLOUR, PANEL_COLOUR, TEXT_COLOUR, WINDOW_COLOUR, Colour
from lanes.drawing.pictures import to_rgb, write_text
from lanes.io.frames import PictureError
from lanes.io.images import read_image

COLUMNS, TILE_PX, LABEL_PX, GAP_PX, LETTERS_PX = 5, (400, 225), 44, 6, 13


def draw_sheet(search: BoardSearch, camera: Camera) -> np.ndarray:
    """All pictures of a calibration on one sheet.

    Parameters
    ----------
    search : BoardSearch
    camera : Camera
        What `calibrate_found` made of it.

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        RGB. Framed green where the board counts, yellow where a part of it does, red where it does not. The last tile
        shows all corners that count, where in the picture they lie, and their number in each of its parts.
    """
    fates, errors = describe_boards(search, camera), camera.report.board_rms_px
    tiles = []
    for name, path in search.paths.items():
        words = [name, f"{errors[name]:.2f} px, {fates[name]}"] if name in errors else [name, fates[name]]
        colour = LEFT_COLOUR if name not in errors else LANE_COLOUR if fates[name].startswith("used") else WINDOW_COLOUR
        tiles.append(_tile(_picture(search, name, path), words, colour))
    tiles.append(_tile(_draw_coverage(search, camera), ["where corners were seen"], TEXT_COLOUR))
    columns = min(COLUMNS, len(tiles))
    blank = np.full_like(tiles[0], PANEL_COLOUR)
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[start : start + columns]) for start in range(0, len(tiles), columns)]
    return np.vstack(rows)


def _picture(search: BoardSearch, name: str, path: Path) -> np.ndarray:
    """The picture with its corners, both shrunk to a tile; black where it cannot be read."""
    try:
        image = read_image(path)
    except PictureError:
        return np.zeros((TILE_PX[1], TILE_PX[0], 3), np.uint8)
    small = _shrink(image)
    if name not in search.boards:
        return small
    board, scale = search.boards[name], small.shape[1] / image.shape[1]
    corners = ((board.corners_px + 0.5) * scale - 0.5).astype(np.float32)
    return draw_board(small, replace(board, corners_px=corners, size=(small.shape[1], small.shape[0])))


def _shrink(image: np.ndarray) -> np.ndarray:
    scale = min(TILE_PX[0] / image.shape[1], TILE_PX[1] / image.shape[0])
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _tile(image: np.ndarray, words: list[str], colour: Colour) -> np.ndarray:
    """The picture below its words, in a frame of that colour."""
    small = _shrink(image)
    tile = np.full((TILE_PX[1] + LABEL_PX, TILE_PX[0], 3), PANEL_COLOUR, np.uint8)
    left = (TILE_PX[0] - small.shape[1]) // 2
    tile[LABEL_PX : LABEL_PX + small.shape[0], left : left + small.shape[1]] = small
    tile[:LABEL_PX] = write_text(tile[:LABEL_PX], words, size_px=LETTERS_PX, panel_alpha=0)
    return cv2.copyMakeBorder(tile, *[GAP_PX] * 4, cv2.BORDER_CONSTANT, value=colour)


def _draw_coverage(search: BoardSearch, camera: Camera) -> np.ndarray:
    """All corners that count as dots, the parts of the picture, and the number of corners in each."""
    width, height = 2 * TILE_PX[0], round(2 * TILE_PX[0] * camera.height / camera.width)
    boards = used_boards(search, camera)
    drawn = to_rgb(np.full((height, width), 30, np.uint8))
    for board in boards.values():
        for u, v in (board.corners_px + 0.5) / board.size * (width, height):
            cv2.circle(drawn, (round(float(u)), round(float(v))), 3, LANE_COLOUR, -1, cv2.LINE_AA)
    for share in DIVISIONS[1:-1]:
        cv2.line(drawn, (0, round(share * height)), (width, round(share * height)), TEXT_COLOUR, 1)
        cv2.line(drawn, (round(share * width), 0), (round(share * width), height), TEXT_COLOUR, 1)
    edges_u, edges_v = (np.multiply(DIVISIONS, length).round().astype(int) for length in (width, height))
    counts = count_corners(boards)
    for row, column in np.ndindex(counts.shape):
        part = drawn[edges_v[row] : edges_v[row + 1], edges_u[column] : edges_u[column + 1]]
        part[:] = write_text(part, str(counts[row, column]), corner="bottom right", size_px=28)
    return drawn
