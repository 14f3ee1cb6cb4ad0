"""Lane model, votes, residuals and the robust fit, with synthetic stripes on roads that
bend, pitch and undulate.
"""

from __future__ import annotations

import numpy as np
import pytest

from lanes.camera.model import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, Stripes, strength_weight
from lanes.detect.fit import (
    Fit,
    FitSettings,
    fit_lanes,
    fit_starts,
    near_stripes,
    predicted_prior,
)
from lanes.detect.residuals import flatten, intersect_ground, stripe_residuals
from lanes.detect.road import (
    CENTRE,
    FAR_LINE,
    LEFT_SIDE,
    PITCH,
    RIGHT_SIDE,
    SIDES,
    RoadPrior,
    line_coefficients,
    line_y,
    lines_on_view,
)
from lanes.detect.search import VoteSettings, vote_lanes
from tests.support.painted_roads import dashcam
from tests.support.shapes import a_lane

HEIGHT_M, FOCAL_PX = 1.3, 1150.0
MATRIX = np.array([[FOCAL_PX, 0, 640], [0, FOCAL_PX, 360], [0, 0, 1.0]])
VIEW = BirdsEyeView(
    Camera(1280, 720, MATRIX, np.zeros(5), CameraPose(HEIGHT_M, 0.0, 0.0))
)
ROWS_M = 5 * 1.022 ** np.arange(121)
PRIOR = RoadPrior()
FIT = FitSettings()


def stripes_at(x_m, y_m, angle, strength=30.0):
    """Stripes (N,) of these places, directions and strengths, as certain as those of
    the evidence.
    """
    number = len(x_m)
    columns = x_m * VIEW.growth / (1 + VIEW.growth) / VIEW.cell_m
    return Stripes(
        row=np.zeros(number, int),
        x_m=x_m,
        y_m=y_m,
        angle=angle,
        step=columns,
        weight=strength_weight(np.full(number, strength), PAINT),
        std_m=np.hypot(PAINT.position_std_m, x_m / FOCAL_PX),
        angle_std_rad=np.full(number, PAINT.angle_std_rad),
        edge=np.zeros(number, bool),
        full_weight=np.ones(number),
        measurable=np.ones(number, bool),
    )


def stripes_on(
    lane, sides=(LEFT_SIDE, RIGHT_SIDE), *, noise_m=0.01, outliers=0, seed=0
):
    """Stripes as the evidence finds them on a lane, with others between."""
    rng = np.random.default_rng(seed)
    x = ROWS_M
    clutter = (
        rng.choice(x, outliers),
        rng.uniform(-10, 10, outliers),
        rng.uniform(-1, 1, outliers),
    )
    found = stripes_at(*clutter, strength=6.0)
    for side in sides:
        y = line_y(x, lane, side)
        ahead = line_y(x + 0.01, lane, side)
        y_m = y + rng.normal(0, noise_m, len(x))
        angle = np.arctan((ahead - y) / 0.01) + rng.normal(0, 0.03, len(x))
        found = found.joined(
            stripes_at(x, y_m, angle, strength=15.0).select(np.abs(y) + 0 * ahead < 12)
        )
    return found


def found_in(stripes) -> Fit:
    """The lane that a search finds in stripes."""
    _, starts = vote_lanes(stripes, VIEW, PRIOR, VoteSettings())
    near = near_stripes(stripes, FIT)
    _, fit = fit_starts(starts, near, stripes, VIEW, FIT)
    return fit


ROADS = {
    "straight, off centre": a_lane(centre=0.4, width=3.6, heading=0.01),
    "left bend": a_lane(centre=-0.3, heading=-0.02, curvature=1 / 350),
    "right bend, pitched": a_lane(
        centre=0.2, width=3.3, heading=0.03, curvature=-1 / 200, pitch=0.008
    ),
    "clothoid": a_lane(centre=0.1, width=3.7, curvature=1 / 900, rate=5e-5),
    "hairpin": a_lane(centre=0.2, width=3.2, heading=0.05, curvature=-1 / 18),
    "into a hairpin": a_lane(centre=0.2, width=3.2, curvature=1 / 40, rate=1 / 600),
}


@pytest.mark.parametrize("road", ROADS.values(), ids=ROADS.keys())
def test_lane_is_found_among_clutter(road):
    stripes = stripes_on(road, outliers=300)
    fit = found_in(stripes)
    lane = fit.lanes[0]
    # the first row is 5 m ahead, and from there to the car a hairpin may have changed
    # its bend
    assert lane[0] == pytest.approx(road[0], abs=0.06 if abs(road[3]) > 0.01 else 0.03)
    assert lane[1] == pytest.approx(road[1], abs=0.05)
    x = np.array([6.0, 10.0, 14.0])
    for side in (LEFT_SIDE, RIGHT_SIDE):
        np.testing.assert_allclose(
            line_y(x, lane, side), line_y(x, road, side), atol=0.06
        )


@pytest.mark.parametrize("vertical", [(0, 2e-3, -3e-3, 1e-3), (3e-3, -6e-3, 6e-3, 0)])
def test_a_search_follows_a_road_that_undulates(vertical):
    """A fit of roads with less relief is wrong by 0.08 and 0.27 m."""
    road = a_lane(centre=0.2, width=3.5, vertical=vertical)
    shown, ahead = (
        lines_on_view(road[None], ROWS_M + more_m, HEIGHT_M)[0].ravel()
        for more_m in (0, 0.01)
    )
    seen = np.isfinite(shown + ahead) & (np.abs(shown) < 12)
    x_m = np.tile(ROWS_M, 2)[seen]
    y_m = shown[seen]
    slope = ((ahead - shown) / 0.01)[seen]
    stripes = stripes_at(x_m, y_m, np.arctan(slope), strength=15.0)
    fit = found_in(stripes)
    for side in SIDES:
        at_m = np.array([8.0, 15.0, 25.0])
        np.testing.assert_allclose(
            line_y(at_m, fit.lanes[0], side), line_y(at_m, road, side), atol=0.01
        )
    on_road_m = intersect_ground(np.sort(x_m)[[0, -1]], road, HEIGHT_M).x_m
    np.testing.assert_allclose(fit.extent_m[0], [on_road_m] * 2, rtol=0.02)


@pytest.mark.parametrize("curvature", [0.0, 1 / 90])
def test_derivatives_agree_with_differences(curvature):
    """For every parameter, beside all four lines, and far from them."""
    hills = dict(pitch=0.004, vertical=(2e-4, -8e-4, 6e-4, 3e-4), adjacent=(0.2, -0.1))
    lane = a_lane(centre=0.2, width=3.4, heading=0.05, curvature=curvature, **hills)
    stripes = stripes_on(
        lane,
        (LEFT_SIDE, RIGHT_SIDE, FAR_LINE * LEFT_SIDE, FAR_LINE * RIGHT_SIDE),
        outliers=50,
    )
    jacobian = stripe_residuals(lane[None], stripes, HEIGHT_M).jacobian()[0]
    tiny = dict(pitch=1e-6, vertical=1e-8, rate_steps=1e-9, adjacent=1e-5)
    steps = a_lane(
        centre=1e-5, width=1e-5, heading=1e-6, curvature=1e-7, rate=1e-9, **tiny
    )
    for derivative, shift in zip(jacobian, np.diag(steps), strict=True):
        above, below = (
            stripe_residuals((lane + s)[None], stripes, HEIGHT_M).residual_m[0]
            for s in (shift, -shift)
        )
        difference = (above - below) / (2 * shift.max())
        large = np.abs(difference) > 0.02 * np.quantile(np.abs(difference), 0.95)
        assert large.sum() > 5
        assert (
            np.median(
                np.abs(derivative - difference)[large] / np.abs(difference[large])
            )
            < 0.01
        )


@pytest.mark.parametrize(
    "prior",
    [None, predicted_prior(ROADS["left bend"], np.diag(PRIOR.std**2), FIT)],
    ids=["road", "prediction"],
)
def test_uncertainty_covers_the_error(prior):
    """Never surer than right, and not ten times too careful; with a prediction twice as
    careful.
    """
    road = ROADS["left bend"]
    errors = []
    claims = []
    for seed in range(20):
        fit = fit_lanes(
            road[None],
            stripes_on(road, noise_m=0.04, seed=seed),
            VIEW,
            FIT,
            prior=prior,
        )
        errors.append(fit.lanes[0] - road)
        claims.append(np.sqrt(np.diag(fit.covariance[0])))
    spread = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(claims, axis=0)
    assert (spread[:4] < (0.6 if prior else 1.2)).all()
    assert (spread[:4] > 0.1).all()


@pytest.mark.parametrize(("certainty", "moved_m"), [(1e-3, 0.0), (1.0, 0.1)])
def test_a_prediction_counts_as_much_as_it_is_certain(certainty, moved_m):
    """The stripes lie 10 cm to the left of the predicted lines."""
    road = ROADS["left bend"]
    stripes = stripes_on(road + a_lane(centre=0.1, width=0.0))
    covariance = np.diag((certainty * PRIOR.std) ** 2)
    fit = fit_lanes(
        road[None], stripes, VIEW, FIT, prior=predicted_prior(road, covariance, FIT)
    )
    assert fit.lanes[0, CENTRE] - road[CENTRE] == pytest.approx(moved_m, abs=0.02)


def seen(lines_m: tuple[float, ...], pitch: float) -> Stripes:
    """Stripes of straight lines up to 60 m, seen by a camera that has pitched by `pitch`.

    A point at x appears at X with H / X = H / x - pitch, and at y X / x.
    """
    rng = np.random.default_rng(4)
    rows_m = VIEW.x_m[VIEW.x_m < 60]
    x = np.tile(rows_m, len(lines_m))
    lines_y = np.repeat(lines_m, len(rows_m))
    y = lines_y * (1 + pitch * x / HEIGHT_M) + rng.normal(0, 0.01, len(x))
    return stripes_at(
        x, y, np.arctan(lines_y * pitch / HEIGHT_M) + rng.normal(0, 0.02, len(x))
    )


@pytest.mark.parametrize("side", SIDES)
def test_the_far_line_of_the_adjacent_lane_determines_the_pitch(side):
    """One line of the lane is out of sight; the next lane's far one runs parallel, as a
    camera that pitches cannot show.
    """
    pitch = 0.009
    start = a_lane()[None]
    own = side * 1.8
    far = side * 1.8 * FAR_LINE + side * 0.1
    fits = [fit_lanes(start, seen(y, pitch), VIEW, FIT) for y in ((own, far), (own,))]
    both, alone = (np.sqrt(f.covariance[0][PITCH, PITCH]) for f in fits)
    assert both < 0.002
    assert alone > 5 * both
    assert fits[0].lanes[0][PITCH] == pytest.approx(pitch, abs=0.0005)
    assert set(np.unique(fits[0].residuals.side[0])) == {side, FAR_LINE * side}
    x = np.array([8.0, 15.0, 25.0])
    np.testing.assert_allclose(line_y(x, fits[0].lanes[0], side), own, atol=0.02)


@pytest.mark.parametrize(
    ("pitch", "vertical"), [(0.012, 0.0), (-0.01, 0.0), (0.0, 6e-4), (0.006, -4e-4)]
)
def test_pitch_and_hills_are_undone(pitch, vertical):
    # a straight line and its direction, seen by a camera that has pitched, on a road
    # that bends upwards
    camera = dashcam(1280, yaw_rad=0.0)
    m = camera.pose
    pitched = camera.with_pose(
        CameraPose(m.height_m, m.pitch_rad + pitch, m.yaw_rad, m.roll_rad)
    )
    x = np.array([6.0, 12.0, 25.0, 40.0])
    points, ahead = (
        np.column_stack([x, 1.7 + 0.02 * x, vertical * x * x / 2])
        for x in (x, x + 1e-3)
    )
    flat, beyond = (
        camera.pixels_to_road(pitched.road_to_pixels(each)) for each in (points, ahead)
    )
    angle = np.arctan2(*(beyond - flat).T[::-1])
    lane = a_lane(
        centre=1.7, width=0.0, heading=np.arctan(0.02), pitch=pitch, vertical=vertical
    )
    ground = intersect_ground(flat[:, 0], lane, m.height_m)
    found_x, found_y, found_angle = flatten(
        flat[:, 0], flat[:, 1], angle, ground, m.height_m
    )
    np.testing.assert_allclose(found_x, x, rtol=0.01)
    np.testing.assert_allclose(found_y, points[:, 1], rtol=0.01)
    np.testing.assert_allclose(found_angle, np.arctan(0.02), atol=2e-3)
    shown = lines_on_view(lane[None], flat[:, 0], m.height_m)[0, 0]
    np.testing.assert_allclose(shown, flat[:, 1], rtol=0.01)


def test_a_line_that_turns_back_before_the_car_has_finite_coefficients():
    """40 degrees to the left and R 8.3 m to the right: its right line never comes
    beside the car.
    """
    beside = a_lane(width=3.6, heading=0.3, curvature=-0.03)
    away = a_lane(centre=-3.0, width=5.8, heading=0.7, curvature=-0.12)
    for side in SIDES:
        assert np.isfinite(line_coefficients(away, side)).all()
        y = line_y(np.array([0.0, 0.01]), beside, side)
        c0, c1, *_ = line_coefficients(beside, side)
        assert (c0, c1) == pytest.approx((y[0], (y[1] - y[0]) / 0.01), abs=1e-3)
    assert line_coefficients(away, -1.0)[1] > 2
