"""The road surface as data: materials, pavement, patches, seams and verges; `simulator.road.albedo` paints it."""

from __future__ import annotations

from dataclasses import dataclass

TAR = (0.028, 0.027, 0.029)


@dataclass(frozen=True)
class Material:
    """Pavement material: mean reflectance (linear RGB, 1.0 = white paint) and the strength of each texture.

    Strengths are relative changes of reflectance: `grain` for single stones, `blotch` for uneven colour, `stain` for
    scattered dark spots, `streak` for wear along the road, `track` for the wheel tracks, `oil` for the middle of the
    lane. `slab_m` > 0 is the distance of transverse joints.
    """

    colour: tuple[float, float, float]
    grain: float
    blotch: float
    stain: float
    streak: float
    track: float
    oil: float
    slab_m: float = 0.0


MATERIALS = {
    "fresh asphalt": Material(
        (0.075, 0.070, 0.085), grain=0.15, blotch=0.05, stain=0.05, streak=0.05, track=0.07, oil=-0.08
    ),
    "asphalt": Material((0.106, 0.100, 0.105), grain=0.15, blotch=0.07, stain=0.12, streak=0.06, track=0.08, oil=-0.12),
    "grey asphalt": Material(
        (0.128, 0.124, 0.127), grain=0.13, blotch=0.05, stain=0.06, streak=0.04, track=0.05, oil=-0.06
    ),
    "grey concrete": Material(
        (0.262, 0.252, 0.250), grain=0.10, blotch=0.05, stain=0.07, streak=0.04, track=-0.04, oil=-0.06
    ),
    "old asphalt": Material(
        (0.165, 0.152, 0.148), grain=0.14, blotch=0.09, stain=0.16, streak=0.07, track=-0.07, oil=-0.16
    ),
    "concrete": Material(
        (0.60, 0.515, 0.445), grain=0.07, blotch=0.07, stain=0.20, streak=0.05, track=-0.06, oil=-0.15, slab_m=4.6
    ),
    "old concrete": Material(
        (0.27, 0.25, 0.235), grain=0.11, blotch=0.08, stain=0.16, streak=0.08, track=-0.06, oil=-0.14
    ),
    "dirt": Material((0.30, 0.235, 0.15), grain=0.20, blotch=0.16, stain=0.10, streak=0.10, track=0.24, oil=-0.16),
    "paint": Material((0.80, 0.79, 0.75), grain=0.08, blotch=0.08, stain=0.30, streak=0.05, track=0.0, oil=0.0),
}


@dataclass(frozen=True)
class Zone:
    """Pavement of one material from arc length `start_m` on; its edge crosses the road with slope `skew` (ds/dd)."""

    start_m: float
    material: str
    skew: float = 0.0


@dataclass(frozen=True)
class Patch:
    """Rectangle of another material: a repair or a trench."""

    start_m: float
    end_m: float
    low_m: float
    high_m: float
    material: str


@dataclass(frozen=True)
class Seam:
    """Line along the road at `lateral_m`, of tar or another colour: lateral noise `wander_m`, edges `soft_m` wide."""

    lateral_m: float
    width_m: float = 0.03
    wander_m: float = 0.02
    start_m: float = -1e5
    end_m: float = 1e5
    strength: float = 0.7
    colour: tuple[float, float, float] = TAR
    soft_m: float = 0.0


@dataclass(frozen=True)
class Surface:
    """Cross section of the ground: pavement, its flaws, and the verges.

    The first of the zones extends backwards without end. `lane_centres_m` are the centres of the lanes, which have
    wheel tracks. `gravel_m` is the width of the gravel strip between pavement and grass, `opposite_m` the lateral edges
    of the other carriageway, `verge_tint` a factor on the colours of gravel and grass.
    """

    zones: tuple[Zone, ...]
    right_edge_m: float
    left_edge_m: float
    lane_centres_m: tuple[float, ...] = (0.0,)
    gravel_m: float = 1.2
    opposite_m: tuple[float, float] | None = None
    patches: tuple[Patch, ...] = ()
    seams: tuple[Seam, ...] = ()
    verge_tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
