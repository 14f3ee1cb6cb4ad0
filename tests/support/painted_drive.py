"""Painted drives (`simulator.painted_drive`) that many tests share, for what happens
over time.

`tests.support.painted_roads` paints single pictures more exactly.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from lanes.detect.lane import Lane
from lanes.tracking.tracker import LaneTracker
from simulator.painted_drive import CAMERA as CAMERA
from simulator.painted_drive import DASH_M, WORN_YELLOW, PaintedDrive, Stripe
from simulator.painted_drive import GREY as GREY
from simulator.painted_drive import TAR as TAR
from simulator.painted_drive import WORN_WHITE as WORN_WHITE
from simulator.rendering.drive import Motion
from simulator.road.geometry import RoadGeometry


def straight_road() -> RoadGeometry:
    """Two kilometres of straight road."""
    return RoadGeometry([0.0, 2000.0], [0.0, 0.0])


def s_bend(radius_m: float = 450.0, knot_m: float = 80.0) -> RoadGeometry:
    """Bends to the left and right in turn: arcs and the clothoids between them, each
    `knot_m` long.
    """
    bends = np.tile([0.0, 1.0, 1.0, 0.0, -1.0, -1.0], 4) / radius_m
    return RoadGeometry(np.arange(len(bends)) * knot_m, bends)


def lane_lines(
    *, left: dict | None = None, right: dict | None = None
) -> tuple[Stripe, ...]:
    """Solid yellow line on the left, dashed white line on the right, and the dashed
    line of the next lane.
    """
    return (
        Stripe(1.8, **({"colour": WORN_YELLOW} | (left or {}))),
        Stripe(-1.8, **({"dash_m": DASH_M} | (right or {}))),
        Stripe(-5.4, dash_m=DASH_M, phase_m=4.0),
    )


SMALL = CAMERA.scaled((640, 360))
# From 60 m on, along bends of 450 m, a little left of the lane centre.
BENDS = PaintedDrive(
    s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3), camera=SMALL
)


@lru_cache(maxsize=1)
def tracked_bends() -> tuple[np.ndarray, Lane | None]:
    """The fourth frame of `BENDS`, read-only, and the tracker's result for it."""
    tracker = LaneTracker(SMALL)
    for frame in range(4):
        image = BENDS.frame(frame / 25)
        result = tracker.update(image)
    image.flags.writeable = False
    return image, result
