"""Disk cache of arrays."""

from __future__ import annotations

import time

import numpy as np

from simulator.disk_cache import cached_array
from simulator.processes import map_ordered


def test_array_is_computed_once_and_again_after_a_broken_file_or_changed_source(monkeypatch, tmp_path):
    made, expected = [], np.arange(6.0).reshape(2, 3)

    def make() -> np.ndarray:
        made.append(1)
        return expected

    monkeypatch.setenv("LANES_CACHE", str(tmp_path / "cache"))
    source = tmp_path / "source.py"
    source.write_text("a = 1")
    for _ in range(2):
        np.testing.assert_array_equal(cached_array("arrays/a", [source], make), expected)
        assert len(made) == 1
    (file,) = (tmp_path / "cache" / "arrays").iterdir()
    file.write_bytes(file.read_bytes()[:90])
    np.testing.assert_array_equal(cached_array("arrays/a", [source], make), expected)
    source.write_text("a = 2")
    cached_array("arrays/a", [source], make)
    assert len(made) == 3
    (tmp_path / "no folder").write_text("")
    monkeypatch.setenv("LANES_CACHE", str(tmp_path / "no folder"))
    np.testing.assert_array_equal(cached_array("arrays/a", [source], make), expected)


def cache_slowly(number: int) -> tuple[int, float]:
    """Cached array for several processes: number of computations in this process, and sum."""
    made = []

    def make() -> np.ndarray:
        made.append(number)
        time.sleep(0.3)
        return np.full(3, 7.0)

    array = cached_array("arrays/slow", [], make)
    return len(made), float(array.sum())


def test_one_of_several_processes_computes_the_array_and_old_files_are_removed(monkeypatch, tmp_path):
    monkeypatch.setenv("LANES_CACHE", str(tmp_path))
    made, sums = zip(*map_ordered(cache_slowly, range(6), workers=3), strict=True)
    assert sum(made) == 1 and set(sums) == {21.0}
    for number in range(4):
        cached_array(f"few/{number}", [], lambda n=number: np.arange(n + 1.0), max_files=2)
        # The resolution of file times is 0.01 s.
        time.sleep(0.02)
    assert sorted(path.name[0] for path in (tmp_path / "few").iterdir()) == ["2", "3"]
