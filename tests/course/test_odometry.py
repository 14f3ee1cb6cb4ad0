"""The driven path against closed forms: arcs and clothoids."""

from __future__ import annotations

import numpy as np
import pytest

from course.odometry import integrate_path

TIME_S = np.arange(0, 20, 0.04)
SPEED_MPS = 25.0


def rows(curvature, heading=0.0) -> dict[str, np.ndarray]:
    return {"time_s": TIME_S, "curvature_per_m": curvature + 0 * TIME_S, "heading_rad": heading + 0 * TIME_S}


@pytest.mark.parametrize("curvature", [1 / 300, -1 / 80])
def test_an_arc_comes_out_as_an_arc(curvature):
    turn = curvature * SPEED_MPS * TIME_S
    true = np.column_stack([np.sin(turn), 1 - np.cos(turn)]) / curvature
    np.testing.assert_allclose(integrate_path(rows(curvature), SPEED_MPS), true, atol=1e-6)


def test_a_clothoid_turns_by_half_its_rate_times_the_square_of_its_length():
    rate, length = 2e-5, SPEED_MPS * TIME_S
    path = integrate_path(rows(rate * length), SPEED_MPS)
    # Fresnel's integrals, as series: x = s (1 - t^2 / 10 + t^4 / 216), y = s (t / 3 - t^3 / 42 + t^5 / 1320), t = turn
    s, t = length[250], rate * length[250] ** 2 / 2
    x = s * (1 - t**2 / 10 + t**4 / 216 - t**6 / 9360)
    y = s * (t / 3 - t**3 / 42 + t**5 / 1320 - t**7 / 75600)
    np.testing.assert_allclose(path[250], [x, y], atol=0.01)


def test_a_car_that_weaves_along_a_straight_road_stays_on_it():
    # 0.3 m to either side in 7 s; seen from a car that points left, the road points right
    rate = 2 * np.pi / 7
    weaving = np.arctan(0.3 * rate / SPEED_MPS * np.cos(rate * TIME_S))
    path = integrate_path(rows(0.0, -weaving), SPEED_MPS)
    assert path[:, 1] == pytest.approx(0.3 * np.sin(rate * TIME_S) - weaving[0] * path[:, 0], abs=0.01)


def test_speed_may_change():
    path = integrate_path(rows(0.0), np.linspace(10, 30, len(TIME_S)))
    assert path[-1] == pytest.approx([20 * TIME_S[-1], 0])


def test_a_gap_is_left_out_and_bridged_and_nothing_known_is_an_error():
    with_gap = rows(1 / 300)
    with_gap["curvature_per_m"] = with_gap["curvature_per_m"].copy()
    with_gap["curvature_per_m"][[0, *range(100, 150)]] = np.nan
    path, whole = integrate_path(with_gap, SPEED_MPS), integrate_path(rows(1 / 300), SPEED_MPS)
    assert np.isnan(path[100:150]).all() and np.isnan(path[0]).all()
    assert path[1] == pytest.approx([0, 0])
    assert np.hypot(*(path[-1] - path[150])) == pytest.approx(np.hypot(*(whole[-1] - whole[150])))
    with pytest.raises(ValueError, match="known in 1 of 500 frames"):
        integrate_path(rows(np.where(TIME_S == 0, 0.001, np.nan)), SPEED_MPS)
