"""Pictures without a road: walls, rooms, tiles, maps, text, test patterns."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

HEIGHT, WIDTH = 720, 1280
Colour = tuple[int, int, int]


def not_a_road(kind: str, seed: int) -> np.ndarray:
    """Picture (720, 1280, 3) uint8 RGB of a kind of `KINDS`; with sensor noise."""
    rng = np.random.default_rng([seed, sorted(KINDS).index(kind)])
    image = KINDS[kind](rng).astype(np.float32)
    return np.clip(
        image + rng.normal(0, rng.uniform(1, 8), image.shape), 0, 255
    ).astype(np.uint8)


def _colour(rng: np.random.Generator, low: int = 0, high: int = 255) -> Colour:
    red, green, blue = rng.integers(low, high, 3).tolist()
    return red, green, blue


def _wall(rng: np.random.Generator) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), _colour(rng, 60, 220), np.uint8)


def _bricks(rng: np.random.Generator) -> np.ndarray:
    image, high, mortar = _wall(rng), int(rng.integers(30, 80)), _colour(rng, 120, 240)
    for row, y in enumerate(range(0, HEIGHT, high)):
        cv2.line(image, (0, y), (WIDTH, y), mortar, int(rng.integers(2, 6)))
        for x in range(row % 2 * high, WIDTH, 2 * high):
            cv2.line(image, (x, y), (x, y + high), mortar, 3)
    return image


def _tiles(rng: np.random.Generator) -> np.ndarray:
    """A floor of tiles with a vanishing point."""
    image, joint, thick = _wall(rng), _colour(rng, 150, 250), int(rng.integers(2, 7))
    u, v = WIDTH // 2 + int(rng.integers(-100, 100)), int(rng.integers(250, 420))
    image[v:] = _colour(rng, 90, 200)
    for x in range(-3 * WIDTH, 4 * WIDTH, int(rng.integers(90, 260))):
        cv2.line(image, (u, v), (x, HEIGHT), joint, thick)
    for y in v + np.geomspace(8, HEIGHT, 16):
        cv2.line(image, (0, int(y)), (WIDTH, int(y)), joint, max(1, thick - 1))
    return image


def _room(rng: np.random.Generator) -> np.ndarray:
    """Four walls in perspective with bright edges, and furniture."""
    image, middle = (
        _wall(rng),
        np.array([WIDTH / 2, HEIGHT / 2]) + rng.integers(-60, 60, 2),
    )
    outer = np.array([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]], float)
    inner = middle + 0.35 * (outer - middle)
    for k in range(4):
        face = np.array(
            [outer[k], outer[(k + 1) % 4], inner[(k + 1) % 4], inner[k]], np.int32
        )
        cv2.fillPoly(image, [face], _colour(rng, 100, 230))
        cv2.line(
            image,
            face[0].tolist(),
            face[3].tolist(),
            (240, 240, 235),
            int(rng.integers(3, 12)),
        )
    for _ in range(5):
        x, y = rng.integers([100, 300], [WIDTH - 200, HEIGHT - 150]).tolist()
        w, h = rng.integers([60, 40], [260, 140]).tolist()
        cv2.rectangle(image, (x, y), (x + w, y + h), _colour(rng), cv2.FILLED)
    return image


def _map(rng: np.random.Generator) -> np.ndarray:
    image = np.full((HEIGHT, WIDTH, 3), (240, 236, 228), np.uint8)
    streets = ((255, 255, 255), (250, 220, 120), (200, 200, 200), (160, 200, 250))
    for _ in range(25):
        path = rng.uniform(0, [WIDTH, HEIGHT]) + np.cumsum(
            rng.normal(0, 90, (8, 2)), axis=0
        )
        cv2.polylines(
            image,
            [path.astype(np.int32)],
            False,
            streets[rng.integers(4)],
            int(rng.integers(4, 16)),
        )
    return image


def _text(rng: np.random.Generator) -> np.ndarray:
    image = np.full((HEIGHT, WIDTH, 3), 250, np.uint8)
    for y in range(40, HEIGHT, 34):
        line = "".join(
            "abcdefghijklmnopqrstuvwxyz      "[k] for k in rng.integers(0, 32, 60)
        )
        cv2.putText(
            image, line, (40, y), cv2.FONT_HERSHEY_SIMPLEX, 0.9, (20, 20, 20), 2
        )
    return image


def _colour_bars(rng: np.random.Generator) -> np.ndarray:
    bars = rng.integers(0, 255, (1, int(rng.integers(5, 14)), 3)).astype(np.uint8)
    return cv2.resize(bars, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)


def _circles(rng: np.random.Generator) -> np.ndarray:
    image = _wall(rng)
    for _ in range(6):
        centre, radius = (
            rng.integers([WIDTH, HEIGHT]).tolist(),
            int(rng.integers(40, 260)),
        )
        cv2.circle(
            image, centre, radius, _colour(rng), int(rng.choice([cv2.FILLED, 12, 25]))
        )
    return image


def _clouds(rng: np.random.Generator) -> np.ndarray:
    coarse = rng.normal(120, 60, (HEIGHT // 16, WIDTH // 16, 3))
    return np.clip(
        cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC), 0, 255
    )


def _blinds(rng: np.random.Generator) -> np.ndarray:
    image, period, angle = _wall(rng), rng.uniform(20, 60), rng.uniform(0, np.pi)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    image[(x * np.cos(angle) + y * np.sin(angle)) % period < 0.3 * period] = _colour(
        rng, 150, 255
    )
    return image


def _books(rng: np.random.Generator) -> np.ndarray:
    image = _wall(rng)
    for y in range(0, HEIGHT, 180):
        for x in np.cumsum(rng.integers(15, 60, 60)).tolist():
            cv2.rectangle(
                image,
                (x, y + int(rng.integers(10, 50))),
                (x + 40, y + 165),
                _colour(rng),
                cv2.FILLED,
            )
        cv2.rectangle(image, (0, y + 165), (WIDTH, y + 180), (90, 60, 30), cv2.FILLED)
    return image


KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    **{
        "wall": _wall,
        "bricks": _bricks,
        "tiles": _tiles,
        "room": _room,
        "map": _map,
        "text": _text,
    },
    **{
        "colour bars": _colour_bars,
        "circles": _circles,
        "clouds": _clouds,
        "blinds": _blinds,
        "books": _books,
    },
}
