"""What the frames of a drive have in common and takes long to make: made once, by any process, and kept for all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import product

from lanes.scenes.backdrop import panorama
from lanes.scenes.drive import Drive
from lanes.scenes.foliage import SPECIES, grown_plant
from lanes.scenes.ground import picture_rays
from lanes.scenes.roadside import Along
from lanes.scenes.wall_textures import wall_texture

# Scenes and woods choose among so many plants of a kind.
PLANTS_OF_A_KIND = 6


def ingredients(drive: Drive) -> list[Callable[[], object]]:
    """Calls, in any processes, that leave everything to be found that a frame of the drive would have to wait for.

    Plants come first: country and woods are full of them.
    """
    plants = [partial(grown_plant, species, seed) for species, seed in product(SPECIES, range(PLANTS_OF_A_KIND))]
    seeds = sorted({thing.seed for thing in drive.things if isinstance(thing, Along) and thing.kind == "wood"})
    woods = [partial(wall_texture, "wood", seed) for seed in seeds]
    return [partial(picture_rays, drive.camera), *plants, partial(panorama, drive.backdrop, drive.seed), *woods]
