"""The road surface as data: pavement, patches, seams and verges; `simulator.road.albedo` paints it."""

from __future__ import annotations

from dataclasses import dataclass

TAR = (0.028, 0.027, 0.029)


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
