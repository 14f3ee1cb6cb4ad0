"""What the frames of a drive have in common and takes long to make: made once, by any process, and kept for all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import product

from simulator.landscape.backdrop import panorama
from simulator.landscape.foliage import grown_plant
from simulator.objects.roadside import Along, Placed
from simulator.objects.solids import Tree
from simulator.objects.wall_textures import SLOW, wall_texture
from simulator.objects.walls import WALLS
from simulator.rendering.drive import Drive
from simulator.road.ground import picture_rays

# Plants, by species and number, of which the country far away and the edge of a wood are made.
IN_COUNTRY = set(product(("oak", "plane", "eucalyptus", "bush", "scrub"), range(2)))
IN_WOOD = set(product(("redwood", "oak", "plane", "bush", "scrub"), range(6)))


def ingredients(drive: Drive) -> list[Callable[[], object]]:
    """Calls, in any processes, that leave everything to be found that a frame of the drive would have to wait for.

    Plants come first: country and woods are full of them.
    """
    placed = [thing.thing for thing in drive.things if isinstance(thing, Placed)]
    walls = {(thing.kind, thing.seed) for thing in drive.things if isinstance(thing, Along)}
    strips = {(name, seed + n) for kind, seed in walls for n, name in enumerate(WALLS[kind].textures)}
    plants = {(tree.species, tree.seed) for tree in placed if isinstance(tree, Tree)} | IN_COUNTRY
    plants |= IN_WOOD if "wood" in dict(strips) else set()
    return [
        partial(picture_rays, drive.camera),
        *(partial(grown_plant, *plant) for plant in sorted(plants)),
        partial(panorama, drive.backdrop, drive.seed),
        *(partial(wall_texture, *strip) for strip in sorted(strips) if strip[0] in SLOW),
    ]
