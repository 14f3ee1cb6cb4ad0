import pytest

from lanes import describe


@pytest.mark.parametrize(
    ("curvature", "text"),
    [
        (-1 / 644, "bends right, R 640 m"),
        (1 / 2990, "bends left, R 2990 m"),
        (1 / 54_000, "straight (R > 3 km)"),
        (-1 / 3001, "straight (R > 3 km)"),
        (0.0, "straight (R > 3 km)"),
        (1 / 37.4, "bends left, R 37 m"),
        (None, "bend unknown"),
    ],
)
def test_describe_bend(curvature, text):
    assert describe.describe_bend(curvature) == text


@pytest.mark.parametrize(
    ("offset", "text"),
    [
        (0.124, "0.12 m left of centre"),
        (-0.3, "0.30 m right of centre"),
        (-0.004, "in the centre"),
        (None, "offset unknown"),
    ],
)
def test_describe_offset(offset, text):
    assert describe.describe_offset(offset) == text


def test_no_standard_deviation_is_stated_as_zero():
    assert describe.describe_offset(0.124, 0.023) == "0.12 ± 0.02 m left of centre"
    assert describe.describe_offset(-0.3, 0.004) == "0.30 ± 0.01 m right of centre"
