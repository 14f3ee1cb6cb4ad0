"""Pavement materials."""

from __future__ import annotations

from dataclasses import dataclass


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
