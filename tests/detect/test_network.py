"""Evidence of band filter and network in a single image."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import Evidence, find_evidence
from lanes.detect.network import finer_view, network_inputs
from lanes.detect.paint import Stripes
from tests.support.painted_roads import ASPHALT, YELLOW, Road, dashcam

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
# Both lines of a lane.
LEFT_M, RIGHT_M = 1.8, -1.7


def lane(road: Road, **look: object) -> np.ndarray:
    """Picture of a road with both lines."""
    return road.lines(LEFT_M, RIGHT_M, **look).image()


def evidence_of(image: np.ndarray, view: BirdsEyeView = VIEW) -> Evidence:
    return find_evidence(image, view)


def stripes_of(image: np.ndarray, far_m: float = 30.0) -> Stripes:
    """The candidates that are paint, not edges of the road."""
    stripes = evidence_of(image).stripes
    return stripes.select((stripes.x_m < far_m) & ~stripes.edge)


def on_lines(stripes, within_m: float = 0.1) -> np.ndarray:
    return np.minimum(np.abs(stripes.y_m - LEFT_M), np.abs(stripes.y_m - RIGHT_M)) < within_m


def found_rows(stripes) -> float:
    """Share of the rows up to 20 m that have a candidate on the left line, weighted."""
    near = stripes.select((np.abs(stripes.y_m - LEFT_M) < 0.1) & (stripes.x_m < 20))
    weight = np.zeros(len(VIEW.x_m))
    np.maximum.at(weight, near.row, near.weight)
    return weight[VIEW.x_m < 20].mean()


@pytest.mark.parametrize("look", [{}, {"colour": YELLOW}, {"width_m": 0.2}, {"dash_m": (3, 12)}])
def test_candidates_lie_on_the_lines(look):
    stripes = stripes_of(lane(Road(CAMERA), **look))
    assert found_rows(stripes) > (0.15 if "dash_m" in look else 0.6)
    assert stripes.weight @ on_lines(stripes) > 0.95 * stripes.weight.sum()


def test_a_faint_line_is_seen_better_than_by_the_band_filter():
    faint = tuple(np.add(ASPHALT, 9))
    image = lane(Road(CAMERA, noise=5.0), colour=faint)
    band = find_evidence(image, VIEW, quick=True).stripes
    assert found_rows(stripes_of(image)) > 1.5 * found_rows(band)


def test_a_faint_streak_on_a_smooth_road_is_no_paint():
    """As clear relative to the noise as paint, but hardly brighter than the road: the third input of the network."""
    streak = lane(Road(CAMERA, noise=0.3), colour=tuple(np.add(ASPHALT, 3)))
    paint = lane(Road(CAMERA, noise=0.3))
    assert found_rows(stripes_of(streak)) < 0.3 < 0.7 < found_rows(stripes_of(paint))


def test_the_last_input_is_the_width_of_a_pixel_and_nothing_is_found_outside_the_picture():
    fine, focal_px = finer_view(VIEW), 2 * VIEW.focal_px
    widths = network_inputs(np.zeros((*fine.shape, 3), np.uint8), fine, focal_px)[3]
    np.testing.assert_allclose(widths[:, 0], np.log2(1 + fine.x_m / focal_px / VIEW.cell_m), rtol=1e-5)
    assert not evidence_of(lane(Road(CAMERA))).response.strength[~VIEW.seen].any()


def test_the_edge_of_a_shadow_is_no_paint():
    """It has less than a twentieth of the weight of a line at the same place."""
    line = Road(CAMERA).lines(LEFT_M)
    shadow = Road(CAMERA).shade(lambda x, y: (y > LEFT_M) & (y < 6), 0.35)
    edge_weight, line_weight = (stripes_of(road.image()).weight.sum() for road in (shadow, line))
    assert edge_weight < 0.05 * line_weight


def test_the_end_of_the_pavement_is_an_edge_of_the_road_and_no_paint():
    """Grass from 1.7 m to the right on."""
    road = Road(CAMERA).lines(LEFT_M).paint(lambda x, y: y < RIGHT_M, (96, 120, 60))
    stripes = evidence_of(road.image()).stripes
    near = stripes.select((stripes.x_m < 20) & (np.abs(stripes.y_m - RIGHT_M) < 0.3))
    assert near.weight @ near.edge > 0.9 * near.weight.sum() > 3
    assert (near.std_m[near.edge] > 0.4).all()
