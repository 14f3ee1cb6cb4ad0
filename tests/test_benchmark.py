from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lanes.benchmark import describe_error, format_table, paint_share, worst_lateral_error_m
from lanes.camera import Camera, Mount
from lanes.measure import RoadLine
from lanes.view import FourPointWarp, view_to_road

X = np.arange(0.0, 45, 5)
CAMERA = Camera.from_fov((640, 360), 60, Mount(1.4, pitch_rad=0.03))
WARP = FourPointWarp(
    [(220, 200), (420, 200), (640, 350), (0, 350)], [(0, 0), (640, 0), (640, 360), (0, 360)], (640, 360)
)


def truth() -> dict:
    left, right = RoadLine(1.6, 0.02, 0.001), RoadLine(-2.0, 0.02, 0.001)
    return {"x_m": X.tolist(), "left_y_m": left.lateral_m(X).tolist(), "right_y_m": right.lateral_m(X).tolist()}


class TestWorstLateralError:
    def test_it_is_the_largest_of_both_lines_within_the_range(self):
        found = SimpleNamespace(left_road=RoadLine(1.65, 0.02, 0.001), right_road=RoadLine(-2.0, 0.03, 0.001))
        # the right line leaves the truth by 0.01 a metre, so by 0.3 m at 30 m; what lies beyond does not count
        assert worst_lateral_error_m(found, truth()) == pytest.approx(0.3)

    def test_a_missing_line_is_infinitely_wrong(self):
        assert worst_lateral_error_m(SimpleNamespace(left_road=None, right_road=RoadLine(-2, 0, 0)), truth()) == np.inf

    def test_without_truth_there_is_no_error(self):
        assert worst_lateral_error_m(SimpleNamespace(left_road=None, right_road=None), None) is None


class TestPaintShare:
    def result(self, binary):
        return SimpleNamespace(steps=SimpleNamespace(warped_binary=binary), warp=WARP)

    def binary(self, *, within_m: float, of: float) -> np.ndarray:
        """All view pixels whose road point lies within `within_m` of a line `of` metres left of the true ones."""
        rows, columns = np.mgrid[0:360, 0:640]
        points = view_to_road(np.column_stack([columns.ravel(), rows.ravel()]), WARP, CAMERA)
        left, right = (np.interp(points[:, 0], X, truth()[key]) + of for key in ("left_y_m", "right_y_m"))
        near = np.minimum(np.abs(points[:, 1] - left), np.abs(points[:, 1] - right)) <= within_m
        return (near.reshape(360, 640) * 255).astype(np.uint8)

    def test_paint_on_the_lines_is_all_paint(self):
        assert paint_share(self.result(self.binary(within_m=0.15, of=0)), truth(), CAMERA) == 1

    def test_a_stripe_beside_the_line_is_none(self):
        assert paint_share(self.result(self.binary(within_m=0.15, of=0.6)), truth(), CAMERA) == 0

    def test_a_flooded_binary_has_the_share_of_the_paint_in_the_lane(self):
        share = paint_share(self.result(np.full((360, 640), 255, np.uint8)), truth(), CAMERA)
        # two stripes of 0.4 m in 3.6 m of lane and a metre on each side
        assert share == pytest.approx(0.8 / 5.6, abs=0.05)

    def test_nothing_set_or_nothing_known_is_none(self):
        assert paint_share(self.result(np.zeros((360, 640), np.uint8)), truth(), CAMERA) is None
        assert paint_share(self.result(np.zeros((360, 640), np.uint8)), None, CAMERA) is None


def test_errors_are_worded():
    assert [describe_error(e) for e in (None, np.inf, 0.123)] == ["unknown", "lost", "0.12 m"]


def test_a_table_is_aligned_to_the_right():
    assert format_table(["a", "long"], {"one": ["1", "2"], "three": ["lost", "4"]}).splitlines() == [
        "          a  long",
        "one       1     2",
        "three  lost     4",
    ]
