"""Which places of a picture are the same over a drive."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.track.static_pattern import STATIC, StaticPattern

ROWS, COLUMNS = 60, 400
# Places that are the same in every sample: a line down the picture.
ROW = np.arange(ROWS)
STAYS = ROW, 100 + ROW // 3


def sample(rng: np.random.Generator, *, sway: float = 0.0, others: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """The static line, a solid line of the road that sways by a standard deviation in columns, and other stripes."""
    road = np.full(ROWS, 250 + rng.normal(0, sway)).round().astype(int)
    return (
        np.concatenate([ROW, ROW, rng.integers(0, ROWS, others)]),
        np.concatenate([STAYS[1], road, rng.integers(0, COLUMNS, others)]),
    )


def drive(samples: int, **options) -> StaticPattern:
    rng, pattern = np.random.default_rng(0), StaticPattern(ROWS, COLUMNS)
    for _ in range(samples):
        pattern.add(*sample(rng, **options))
    return pattern


def test_what_stays_is_static_after_a_few_samples():
    few = int(STATIC.min_samples)
    assert not drive(few, sway=4).is_static(*STAYS).any()
    assert drive(few + 2, sway=4).is_static(*STAYS).all()


@pytest.mark.parametrize("samples", [10, 30, 200])
def test_a_line_that_sways_by_a_few_centimetres_is_not(samples):
    pattern = drive(samples, sway=3)
    near = np.repeat(np.arange(245, 256), ROWS)
    assert pattern.is_static(np.tile(ROW, 11), near).mean() < 0.1


def test_places_beside_are_static_up_to_one_column():
    pattern = drive(20, sway=4)
    for shift, static in ((-1, True), (1, True), (-3, False), (3, False)):
        assert pattern.is_static(ROW, STAYS[1] + shift).all() == static


def test_nothing_becomes_static_while_the_car_stands():
    rng, pattern = np.random.default_rng(1), StaticPattern(ROWS, COLUMNS)
    row, column = sample(rng)
    for _ in range(100):
        # noise hides some stripes and moves others by a column
        shown = rng.random(len(row)) < 0.9
        pattern.add(row[shown], np.minimum(column[shown] + rng.integers(0, 2, shown.sum()), COLUMNS - 1))
    assert not pattern.is_static(row, column).any()


def test_what_was_static_and_is_gone_is_forgotten():
    rng, pattern = np.random.default_rng(2), drive(30, sway=4)
    for _ in range(60):
        row, column = sample(rng, sway=4)
        pattern.add(row[ROWS:], column[ROWS:])
    assert not pattern.is_static(*STAYS).any()


def test_pictures_without_stripes_and_places_at_the_border_are_accepted():
    pattern = StaticPattern(ROWS, COLUMNS)
    for _ in range(3):
        pattern.add(np.empty(0, int), np.empty(0, int))
        pattern.add(ROW, np.full(ROWS, COLUMNS - 1))
        pattern.add(ROW, np.zeros(ROWS, int))
    assert not pattern.is_static(ROW, np.zeros(ROWS, int)).any()
