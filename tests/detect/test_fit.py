from dataclasses import replace

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import fit_lanes, limit_bends, model_error_m
from lanes.detect.paint import marking_weight, position_std
from lanes.detect.residuals import stripe_residuals
from lanes.detect.road import (
    ADJACENT,
    BEND,
    CENTRE,
    CURVATURE,
    FAR_LINE,
    HEADING,
    LEFT_SIDE,
    LIMIT,
    PARAMETERS,
    PRIOR_MEAN,
    PRIOR_STD,
    RATE,
    RATE_STEPS,
    RIGHT_SIDE,
    WIDTH,
    bend_gradients,
    line_points,
    line_y,
    lines_on_view,
    prior_std,
    squared_mahalanobis,
)
from lanes.detect.votes import best_pairs, count_votes
from tests.support.shapes import a_lane, stripes_at

HEIGHT_M, FOCAL_PX = 1.3, 1150.0


def view_with(focal_px: float) -> BirdsEyeView:
    """The view of a camera at `HEIGHT_M` with this focal length."""
    matrix = np.array([[focal_px, 0, 640], [0, focal_px, 360], [0, 0, 1.0]])
    return BirdsEyeView(Camera(1280, 720, matrix, np.zeros(5), CameraPose(HEIGHT_M, 0.0, 0.0)))


VIEW = view_with(FOCAL_PX)
ROWS_M = 5 * 1.022 ** np.arange(121)


def stripes_on(lane, sides=(LEFT_SIDE, RIGHT_SIDE), *, noise_m=0.01, outliers=0, dash_m=None, seed=0):
    """Stripes as the evidence finds them on a lane, row by row, with others strewn between."""
    rng = np.random.default_rng(seed)
    parts = []
    for side in sides:
        y, ahead = line_y(ROWS_M, lane, side), line_y(ROWS_M + 0.01, lane, side)
        keep = np.isfinite(y + ahead) & (np.abs(y) < 12)
        if dash_m and side == RIGHT_SIDE:
            keep &= ROWS_M % dash_m[1] < dash_m[0]
        x, angle = ROWS_M[keep], np.arctan((ahead - y)[keep] / 0.01)
        parts.append((x, y[keep] + rng.normal(0, noise_m, len(x)), angle + rng.normal(0, 0.03, len(x)), 15.0))
    x = rng.choice(ROWS_M, outliers)
    parts.append((x, rng.uniform(-10, 10, outliers), rng.uniform(-1, 1, outliers), 6.0))
    x, y, angle = (np.concatenate([p[k] for p in parts]) for k in range(3))
    strength = np.concatenate([np.full(len(p[0]), p[3]) for p in parts])
    row = np.searchsorted(ROWS_M, x)
    return stripes_at(row, x, y, angle, strength)


def search(stripes):
    starts = best_pairs(count_votes(stripes, HEIGHT_M), 67)
    near = fit_lanes(starts, stripes, VIEW)
    return near.lane[near.weight.sum(axis=1).argmax()], near


ROADS = {
    "straight, off centre": a_lane(centre=0.4, width=3.6, heading=0.01),
    "left bend": a_lane(centre=-0.3, heading=-0.02, curvature=1 / 350),
    "right bend, nodding": a_lane(centre=0.2, width=3.3, heading=0.03, curvature=-1 / 200, pitch=0.008),
    "clothoid": a_lane(centre=0.1, width=3.7, curvature=1 / 900, rate=5e-5),
    "hairpin": a_lane(centre=0.2, width=3.2, heading=0.05, curvature=-1 / 18),
}


def test_squared_mahalanobis_distance_from_the_prior():
    odd = PRIOR_MEAN.copy()
    odd[[CENTRE, HEADING]] += [2, -3] * PRIOR_STD[[CENTRE, HEADING]]
    np.testing.assert_allclose(squared_mahalanobis(np.array([PRIOR_MEAN, odd])), [0, 4 + 9])
    # a road that bends may bend, and may change its bend: curvature itself counts for less than it would
    bent = PRIOR_MEAN.copy()
    bent[CURVATURE] = 2 * PRIOR_STD[CURVATURE]
    assert 0 < squared_mahalanobis(bent[None])[0] < 4
    assert (prior_std(bent[None]) >= PRIOR_STD).all()


def test_prior_is_wider_for_roads_that_bend():
    bent = PRIOR_MEAN.copy()
    bent[[CURVATURE, RATE]] = -0.03, -1e-3
    std = prior_std(bent[None])[0]
    assert std[CURVATURE] == pytest.approx(PRIOR_STD[CURVATURE] + 0.03)
    assert std[RATE] == pytest.approx(PRIOR_STD[RATE] + 0.03 / 15)
    np.testing.assert_allclose(std[RATE_STEPS], PRIOR_STD[RATE_STEPS] + 1.5 * (0.03 / 15 + 1e-3))
    assert (prior_std(PRIOR_MEAN[None]) == PRIOR_STD).all()


def one_stripe(*, x_m, aside_m=0.0, strength=6.6):
    """A stripe on the left line of a straight lane that is 3.6 m wide, or so far to its left."""
    stripes = stripes_on(np.array(ROADS["straight, off centre"])).select([0])
    places = {"x_m": np.array([x_m]), "y_m": np.array([1.8 + aside_m]), "angle": np.zeros(1)}
    return replace(stripes, strength=np.array([strength]), **places)


def test_marking_weight_position_std_and_model_error():
    strengths = [marking_weight(one_stripe(x_m=10.0, strength=strength))[0] for strength in (0.0, 6.6, 19.8)]
    np.testing.assert_allclose(strengths, [0, 0.5, 0.9])
    for x_m, stray in ((20.0, 0.01), (40.0, 0.08), (80.0, 0.64)):
        assert position_std(one_stripe(x_m=x_m), 1000.0) == pytest.approx(np.sqrt(0.04**2 + (x_m / 1000) ** 2))
        assert model_error_m(one_stripe(x_m=x_m)) == pytest.approx(stray)


@pytest.mark.parametrize("aside_m", [0.0, 0.1, -0.1])
def test_weight_of_a_stripe_by_position_distance_and_strength(aside_m):
    """Held fast by a prior that is much surer, the lane stays; what a stripe adds to the information is seen alone."""
    lane = np.zeros(len(PRIOR_MEAN))
    lane[WIDTH] = 3.6
    held = {"prior_mean": lane, "prior_information": 1e12 * np.eye(len(lane))}
    stripe = one_stripe(x_m=30.0, aside_m=aside_m)
    fit = fit_lanes(lane[None], stripe, view_with(1000.0), schedule=((70, 2.0),), **held)
    # half as strong as paint; twice as far astray is let pass as is usual
    variance, stray = 0.04**2 + 0.03**2, 0.08 * (30 / 40) ** 3
    agreement = 1 / (1 + aside_m**2 / (4 * variance)) ** 2
    added = fit.information[0] - held["prior_information"]
    assert added[CENTRE, CENTRE] == pytest.approx(0.5 * agreement / (4 * variance + stray**2), rel=1e-3)
    assert fit.weight[0, 0] == pytest.approx(0.5 / (1 + aside_m**2 / variance) ** 2, rel=1e-2)
    assert fit.side[0, 0] == LEFT_SIDE
    near = fit_lanes(lane[None], stripe, view_with(1000.0), schedule=((30.0, 2.0),), **held)
    np.testing.assert_array_equal(near.information[0], held["prior_information"])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_lane_never_leaves_its_limits(sign):
    nothing = one_stripe(x_m=30.0).select([])
    far = {"prior_mean": 2 * sign * LIMIT, "prior_information": np.eye(len(LIMIT))}
    fit = fit_lanes(PRIOR_MEAN[None].astype(int), nothing, VIEW, schedule=((70, 1),), **far)
    # the curvature ahead has a limit of its own, and the bend may be within the limits of its parameters
    assert (np.abs(fit.lane[0]) <= LIMIT).all()
    others = np.setdiff1d(np.arange(PARAMETERS), BEND[1:])
    np.testing.assert_array_equal(fit.lane[0, others], sign * LIMIT[others])


def curvature_at(lane, along_m):
    return float(lane[BEND] @ bend_gradients(np.array([along_m]))[1][:, 0])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_transition_does_not_continue_into_a_tighter_bend_than_roads_have(sign):
    """Only the beginning of the transition is seen; its rate would lead to a radius of 5 m in 24 m."""
    begins = sign * a_lane(curvature=0.02, rate=7.5e-3)
    lanes = np.array([begins, sign * a_lane(curvature=0.06), sign * a_lane(curvature=0.01, rate=1e-3)])
    certain = dict(centre=0.1, width=0.1, heading=0.02, curvature=5e-3, adjacent=0.1)
    std = a_lane(**certain, rate=2e-3, pitch=0.01, vertical=1e-3, rate_steps=4e-3)
    information = np.diag(1 / np.square(std))
    limited = limit_bends(lanes, np.tile(information, (3, 1, 1)))
    np.testing.assert_array_equal(limited[1:], lanes[1:])
    assert curvature_at(begins, 24.0) * sign == pytest.approx(0.2)
    assert 1 / 15 < curvature_at(limited[0], 24.0) * sign < 0.075
    # the bend near the car, which is certain, hardly changes
    assert abs(curvature_at(limited[0], 5.0) - curvature_at(begins, 5.0)) < 0.02
    # a bend that is measured stays as it is
    np.testing.assert_allclose(limit_bends(begins[None], 1e12 * np.eye(PARAMETERS)[None])[0], begins, atol=1e-6)


@pytest.mark.parametrize("road", ROADS.values(), ids=ROADS.keys())
def test_lane_is_found_among_clutter(road):
    lane, _ = search(stripes_on(road, outliers=300))
    # the first row is 5 m ahead, and from there to the car a hairpin may have changed its bend
    assert lane[0] == pytest.approx(road[0], abs=0.06 if abs(road[3]) > 0.01 else 0.03)
    assert lane[1] == pytest.approx(road[1], abs=0.05)
    x = np.array([6.0, 10.0, 14.0])
    for side in (LEFT_SIDE, RIGHT_SIDE):
        np.testing.assert_allclose(line_y(x, lane, side), line_y(x, road, side), atol=0.06)


def test_dashes_suffice():
    road = ROADS["left bend"]
    lane, _ = search(stripes_on(road, outliers=150, dash_m=(3.0, 12.0)))
    x = np.array([6.0, 15.0, 30.0])
    np.testing.assert_allclose(line_y(x, lane, RIGHT_SIDE), line_y(x, road, RIGHT_SIDE), atol=0.05)


@pytest.mark.parametrize("side", [LEFT_SIDE, RIGHT_SIDE])
def test_one_line_suffices_and_the_other_is_uncertain(side):
    road = a_lane(centre=0.1, heading=0.01, curvature=1 / 500)
    lane, fit = search(stripes_on(road, (side,), outliers=60))
    x = np.array([6.0, 15.0, 30.0])
    # One line does not determine the pitch, so the lines on the view are compared.
    shown, true = lines_on_view(np.array([lane, road]), x, HEIGHT_M)[:, 0 if side == LEFT_SIDE else 1]
    np.testing.assert_allclose(shown, true, atol=0.02)
    best = fit.weight.sum(axis=1).argmax()
    covariance = np.linalg.inv(fit.information[best])
    near, far = (a_lane(centre=1.0, width=s / 2) for s in (side, -side))
    assert np.sqrt(near @ covariance @ near) < 0.15 < 0.3 < np.sqrt(far @ covariance @ far)


def test_mirrored_stripes_give_the_mirrored_lane():
    stripes = stripes_on(ROADS["right bend, nodding"], outliers=200)
    mirrored = replace(stripes, y_m=-stripes.y_m, angle=-stripes.angle)
    lane, _ = search(stripes)
    other, _ = search(mirrored)
    signs = a_lane(
        centre=-1, width=1, heading=-1, curvature=-1, rate=-1, pitch=1, vertical=1, rate_steps=-1, adjacent=1
    )
    expected = lane * signs
    expected[ADJACENT] = expected[ADJACENT][::-1]
    off = np.abs(other - expected)
    most = dict(width=1e-3, heading=1e-4, curvature=1e-5, rate=1e-6, pitch=1e-4, vertical=1e-5, rate_steps=1e-6)
    assert (off < a_lane(centre=1e-3, adjacent=1e-3, **most)).all()


PARTS = dict(heading=0.05, curvature=1 / 90, pitch=0.004, vertical=(2e-4, -8e-4, 6e-4, 3e-4), adjacent=(0.2, -0.1))


ALL = dict(centre=0.01, width=0.01, heading=0.01, curvature=0.01)


@pytest.mark.parametrize(
    ("lane", "most"),
    [
        (a_lane(centre=0.2, width=3.4, **PARTS), a_lane(**ALL, rate=0.01, pitch=0.01, vertical=0.01, rate_steps=0.01)),
        (a_lane(centre=-0.1, width=3.6), a_lane(**ALL, rate=0.01, pitch=0.01, vertical=0.01, rate_steps=0.01)),
        # where it swerves, second-order terms are left out
        (
            a_lane(centre=0.2, width=3.4, rate=1e-4, rate_steps=(1e-4, -1e-4, 1e-4), **PARTS),
            a_lane(**ALL, rate=0.02, pitch=0.06, vertical=0.25, rate_steps=0.15),
        ),
    ],
    ids=["bend", "straight", "swerving"],
)
def test_derivatives_agree_with_differences(lane, most):
    """For every number, beside all four lines and far out; ROAD_M is close enough that lookups bend nothing."""
    stripes = stripes_on(lane, (LEFT_SIDE, RIGHT_SIDE, FAR_LINE * LEFT_SIDE, FAR_LINE * RIGHT_SIDE), outliers=50)
    derivative = stripe_residuals(lane[None], stripes, HEIGHT_M).jacobian[0]
    tiny = dict(pitch=1e-6, vertical=1e-8, rate_steps=1e-9, adjacent=1e-5)
    for k, step in enumerate(a_lane(centre=1e-5, width=1e-5, heading=1e-6, curvature=1e-7, rate=1e-9, **tiny)):
        shift = np.eye(PARAMETERS)[k] * step
        above, below = (stripe_residuals((lane + s)[None], stripes, HEIGHT_M).residual_m[0] for s in (shift, -shift))
        measured = (above - below) / (2 * step)
        # what hardly moves shows nothing but how places are looked up
        moved = np.abs(measured) > 0.02 * np.quantile(np.abs(measured), 0.95)
        assert moved.sum() > 5, k
        error = np.abs(measured - derivative[k])[moved] / np.abs(measured[moved])
        assert np.median(error) < most[k] + 1e-6, k
        # no stripe moves that is said not to, but for the few that change sides
        assert np.mean((np.abs(measured) > 1e-6) > (derivative[k] != 0)) < 0.01, k


def test_uncertain_directions_have_less_weight():
    """A stripe that moves aside by many columns a row may seem to run elsewhere, and one that does not may not."""
    lane, ease = a_lane(heading=0.6, centre=-3.0), 3.0
    stripes = stripes_on(lane, noise_m=0.0)
    stripes = replace(stripes, angle=stripes.angle - 0.25)
    fine, coarse = (
        stripe_residuals(lane[None], replace(stripes, step=stripes.step * k), HEIGHT_M) for k in (0.1, 10.0)
    )
    std = np.full(len(stripes), 0.05)
    assert (coarse.weights(std) >= fine.weights(std)).all()
    assert np.median(coarse.weights(std)) > 0.9 > 0.1 > np.median(fine.weights(std))
    assert (fine.weights(std, angle_scale=ease) > 3 * fine.weights(std)).mean() > 0.9


def test_a_prediction_holds_where_there_is_no_evidence():
    expected = a_lane(centre=0.2, width=3.4, heading=0.01, curvature=1 / 300)
    nothing = stripes_on(expected, ())
    fit = fit_lanes(
        expected[None],
        nothing,
        VIEW,
        prior_mean=expected,
        prior_information=np.eye(PARAMETERS) * 1e4,
    )
    np.testing.assert_allclose(fit.lane[0], expected)
    np.testing.assert_allclose(fit.information[0], np.eye(PARAMETERS) * 1e4)


def test_uncertainty_covers_the_error():
    road = ROADS["left bend"]
    errors, claims = [], []
    for seed in range(30):
        fit = fit_lanes(road[None], stripes_on(road, noise_m=0.04, seed=seed), VIEW)
        errors.append(fit.lane[0] - road)
        claims.append(np.sqrt(np.diag(np.linalg.inv(fit.information[0]))))
    spread = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(claims, axis=0)
    # offset, width, heading, curvature: never surer than right, and not ten times too careful
    assert (spread[:4] < 1.2).all() and (spread[:4] > 0.1).all()


def test_line_points_run_through_the_stripes():
    road = ROADS["hairpin"]
    points = line_points(road, RIGHT_SIDE, np.linspace(0, 35, 50))
    x, y = points.T
    # a hairpin of 18 m turns back: its line is not a function of x
    assert x.max() < 18 and y.min() < -15 and np.diff(x)[-1] < 0
