"""Pictures without a road: walls, rooms, tiles, maps, text, test patterns."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

HEIGHT = 720
WIDTH = 1280
# Paper and streets of a map.
MAP_PAPER = (240, 236, 228)
STREETS = (
    (255, 255, 255),
    (250, 220, 120),
    (200, 200, 200),
    (160, 200, 250),
)
# Bright edge between walls, and wood of a shelf.
EDGE = (240, 240, 235)
SHELF = (90, 60, 30)
LETTERS = "abcdefghijklmnopqrstuvwxyz      "
Colour = tuple[int, int, int]


def not_a_road(kind: str, seed: int) -> np.ndarray:
    """Picture (720, 1280, 3) uint8 RGB of a kind of `KINDS`; with sensor noise."""
    rng = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    image = KINDS[kind](rng).astype(np.float32)
    noise = rng.normal(0, rng.uniform(1, 8), image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _colour(
    rng: np.random.Generator,
    low: int = 0,
    high: int = 255,
) -> Colour:
    red, green, blue = rng.integers(low, high, 3).tolist()
    return red, green, blue


def _plain(colour: Colour) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), colour, np.uint8)


def _fill(
    image: np.ndarray,
    corner: tuple[int, int],
    opposite: tuple[int, int],
    colour: Colour,
) -> None:
    cv2.rectangle(image, corner, opposite, colour, cv2.FILLED)


def _wall(rng: np.random.Generator) -> np.ndarray:
    return _plain(_colour(rng, 60, 220))


def _bricks(rng: np.random.Generator) -> np.ndarray:
    image = _wall(rng)
    height = int(rng.integers(30, 80))
    mortar = _colour(rng, 120, 240)
    for row, y in enumerate(range(0, HEIGHT, height)):
        thickness = int(rng.integers(2, 6))
        cv2.line(image, (0, y), (WIDTH, y), mortar, thickness)
        shift = row % 2 * height
        for x in range(shift, WIDTH, 2 * height):
            cv2.line(image, (x, y), (x, y + height), mortar, 3)
    return image


def _tiles(rng: np.random.Generator) -> np.ndarray:
    """A floor of tiles with a vanishing point."""
    image = _wall(rng)
    joint = _colour(rng, 150, 250)
    thickness = int(rng.integers(2, 7))
    u = WIDTH // 2 + int(rng.integers(-100, 100))
    v = int(rng.integers(250, 420))
    image[v:] = _colour(rng, 90, 200)

    distance = int(rng.integers(90, 260))
    for x in range(-3 * WIDTH, 4 * WIDTH, distance):
        cv2.line(image, (u, v), (x, HEIGHT), joint, thickness)
    for below in np.geomspace(8, HEIGHT, 16):
        y = int(v + below)
        cv2.line(image, (0, y), (WIDTH, y), joint, thickness - 1)
    return image


def _room(rng: np.random.Generator) -> np.ndarray:
    """Four walls in perspective with bright edges, and furniture."""
    image = _wall(rng)
    middle = np.array([WIDTH / 2, HEIGHT / 2]) + rng.integers(-60, 60, 2)
    outer = np.array(
        [
            [0.0, 0.0],
            [WIDTH, 0],
            [WIDTH, HEIGHT],
            [0, HEIGHT],
        ]
    )
    inner = middle + 0.35 * (outer - middle)
    for k in range(4):
        after = (k + 1) % 4
        corners = [outer[k], outer[after], inner[after], inner[k]]
        face = np.array(corners, np.int32)
        cv2.fillPoly(image, [face], _colour(rng, 100, 230))
        near = face[0].tolist()
        far = face[3].tolist()
        thickness = int(rng.integers(3, 12))
        cv2.line(image, near, far, EDGE, thickness)

    for _ in range(5):
        x, y = rng.integers([100, 300], [WIDTH - 200, HEIGHT - 150]).tolist()
        width, height = rng.integers([60, 40], [260, 140]).tolist()
        _fill(image, (x, y), (x + width, y + height), _colour(rng))
    return image


def _map(rng: np.random.Generator) -> np.ndarray:
    image = _plain(MAP_PAPER)
    for _ in range(25):
        start = rng.uniform(0, [WIDTH, HEIGHT])
        steps = rng.normal(0, 90, (8, 2))
        path = (start + np.cumsum(steps, axis=0)).astype(np.int32)
        colour = STREETS[rng.integers(4)]
        thickness = int(rng.integers(4, 16))
        cv2.polylines(image, [path], False, colour, thickness)
    return image


def _text(rng: np.random.Generator) -> np.ndarray:
    image = _plain((250, 250, 250))
    font = cv2.FONT_HERSHEY_SIMPLEX
    for y in range(40, HEIGHT, 34):
        line = "".join(LETTERS[k] for k in rng.integers(0, 32, 60))
        cv2.putText(image, line, (40, y), font, 0.9, (20, 20, 20), 2)
    return image


def _colour_bars(rng: np.random.Generator) -> np.ndarray:
    count = int(rng.integers(5, 14))
    bars = rng.integers(0, 255, (1, count, 3)).astype(np.uint8)
    return cv2.resize(bars, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)


def _circles(rng: np.random.Generator) -> np.ndarray:
    image = _wall(rng)
    for _ in range(6):
        centre = rng.integers([WIDTH, HEIGHT]).tolist()
        radius = int(rng.integers(40, 260))
        colour = _colour(rng)
        thickness = int(rng.choice([cv2.FILLED, 12, 25]))
        cv2.circle(image, centre, radius, colour, thickness)
    return image


def _clouds(rng: np.random.Generator) -> np.ndarray:
    coarse = rng.normal(120, 60, (HEIGHT // 16, WIDTH // 16, 3))
    fine = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.clip(fine, 0, 255)


def _blinds(rng: np.random.Generator) -> np.ndarray:
    image = _wall(rng)
    period = rng.uniform(20, 60)
    angle = rng.uniform(0, np.pi)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    across = x * np.cos(angle) + y * np.sin(angle)
    image[across % period < 0.3 * period] = _colour(rng, 150, 255)
    return image


def _books(rng: np.random.Generator) -> np.ndarray:
    image = _wall(rng)
    for y in range(0, HEIGHT, 180):
        bottom = y + 165
        for x in np.cumsum(rng.integers(15, 60, 60)).tolist():
            top = y + int(rng.integers(10, 50))
            _fill(image, (x, top), (x + 40, bottom), _colour(rng))
        _fill(image, (0, bottom), (WIDTH, y + 180), SHELF)
    return image


KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "wall": _wall,
    "bricks": _bricks,
    "tiles": _tiles,
    "room": _room,
    "map": _map,
    "text": _text,
    "colour bars": _colour_bars,
    "circles": _circles,
    "clouds": _clouds,
    "blinds": _blinds,
    "books": _books,
}
