"""Slow assets that all frames of a drive share: each is made once, by one process, and cached on disk for all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import product

from simulator.landscape.backdrop import panorama
from simulator.landscape.foliage import plant_picture
from simulator.objects.placement import PlacedObject, PlacedWall
from simulator.objects.scene_objects import Tree
from simulator.objects.wall_textures import SLOW, wall_texture
from simulator.objects.walls import WALLS
from simulator.rendering.drive import Drive
from simulator.road.ground import pixel_rays

# Plants (species and seed) in backdrops and at the edge of a wood.
BACKDROP_PLANTS = set(product(("oak", "plane", "eucalyptus", "bush", "scrub"), range(2)))
WOOD_PLANTS = set(product(("redwood", "oak", "plane", "bush", "scrub"), range(6)))


def asset_jobs(drive: Drive) -> list[Callable[[], object]]:
    """Functions without arguments that fill the disk cache for a drive. They can run in any process.

    Plants come first, because panoramas and woods need them.
    """
    placed = [item.item for item in drive.objects if isinstance(item, PlacedObject)]
    walls = {(item.kind, item.seed) for item in drive.objects if isinstance(item, PlacedWall)}
    strips = {(name, seed + n) for kind, seed in walls for n, name in enumerate(WALLS[kind].textures)}
    plants = {(tree.species, tree.seed) for tree in placed if isinstance(tree, Tree)} | BACKDROP_PLANTS
    plants |= WOOD_PLANTS if "wood" in dict(strips) else set()
    return [
        partial(pixel_rays, drive.camera),
        *(partial(plant_picture, *plant) for plant in sorted(plants)),
        partial(panorama, drive.backdrop, drive.seed),
        *(partial(wall_texture, *strip) for strip in sorted(strips) if strip[0] in SLOW),
    ]
