"""Renders a frame of a drive, with its ground truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from lanes.camera import Camera
from simulator.backdrop import paint_backdrop
from simulator.light.glare import add_glare, add_sheen
from simulator.light.lens import LUMINANCE, RoadLight, develop
from simulator.light.sunlight import (
    OVERCAST_LIGHT,
    SKY_SHARE,
    TreeShade,
    light_along,
    light_on_ground,
    sky_on_ground,
    sun_along,
    sunlight_on_ground,
)
from simulator.objects.bonnet import first_hidden_row, paint_bonnet
from simulator.objects.object_painter import paint_objects
from simulator.objects.scene_objects import SceneObject, Tree, objects_in_view
from simulator.objects.shadows import MAX_SHADOW_M, cast_shadows, shadow_polygons
from simulator.painting.brush import (
    MIN_TRANSMITTANCE,
    Atmosphere,
    composite_over,
    new_canvas,
    split_channels,
    uncovered_window,
)
from simulator.rendering.drive import Drive
from simulator.road.albedo import ground_albedo
from simulator.road.geometry import VehiclePose
from simulator.road.ground import MAX_GROUND_M, Ground, cast_on_ground, pixel_rays
from simulator.road.markings import paint_markings, paint_symbols
from simulator.road.road_ahead import RoadAhead
from simulator.road.truth import Truth
from simulator.weather.night import add_lamps, visible_lamps
from simulator.weather.rain import add_falling_drops, add_lamp_reflections, add_windscreen_drops

# Airlight in front of distant ground, and its length constant in metres.
AIR_LIGHT = np.array([0.42, 0.48, 0.56], np.float32)
AIR_LENGTH_M = 3500.0
# Light of the backdrop below an overcast sky, relative to a sunny day.
OVERCAST_BACKDROP = 0.55
# The reflection of the sky in a wet road is computed on every 6th pixel.
MIRROR_DOWNSAMPLING = 6
BLOCK_ROWS = 32
# Trees farther from the car than this, laterally, cast shadows on grass only.
MAX_SHADOW_LATERAL_M = 22.0
# Rows at the bottom whose sunlight is that of the bonnet. The exposure is metered above them.
BOTTOM_ROWS = 60
# Displacement of the shadow edges of crowns by leaves, metres.
LEAF_NOISE_M = 0.13


@dataclass(frozen=True)
class Frame:
    """Rendered image (height, width, 3) uint8 RGB, its ground truth, and the mask of what objects hide.

    `hidden` (height, width) is True where an object is in front of ground or backdrop.
    """

    image: np.ndarray
    truth: Truth
    hidden: np.ndarray = field(repr=False)


def render_frame(drive: Drive, time_s: float = 0.0) -> Frame:
    """Image of the drive's camera at `time_s`, with its ground truth."""
    truth = drive.truth(time_s)
    camera = drive.camera_at_pitch(truth.pitch_rad)
    heading = truth.pose.absolute_heading(drive.road)
    ahead = RoadAhead(drive.road, truth.pose)
    ground = cast_on_ground(pixel_rays(drive.camera), camera, ahead)
    view = _FrameGeometry(camera, heading, ahead, ground, drive.sun.direction(heading), truth.pose.s_m)
    objects = objects_in_view(drive.objects, drive.road, truth.pose, time_s=time_s)
    sun = _sun_on_ground(drive, objects, view)
    seen = slice(0, _rows_before_bonnet(drive) - ground.top)
    visible_ground = ground.crop(seen)
    picture = _paint_foreground(drive, objects, view, sunny=float(sun[-BOTTOM_ROWS:].mean()))
    # The exposure is metered on the bare ground, without air, sky, vehicles and bonnet.
    metered = slice(max(len(sun) - 250, 0), len(sun) - BOTTOM_ROWS, 4), slice(None, None, 8)
    needed = picture[3, ground.top :][seen] > MIN_TRANSMITTANCE
    needed[metered] = True
    ground_light = _ground_light(drive, visible_ground, sun[seen], objects, station_m=view.station_m, needed=needed)
    road_light = float((ground_light[metered] @ LUMINANCE).mean())
    mirror = _add_shine(ground_light, drive, sun[seen], replace(view, ground=visible_ground))
    bare = _backdrop(drive, view, picture[3])
    _composite_ground(bare, ground_light, visible_ground, daylight=drive.night is None)
    light = composite_over(picture, bare)
    same = cv2.compare(light, bare, cv2.CMP_EQ)
    hidden = cv2.inRange(same, (255, 255, 255), (255, 255, 255)) == 0
    if mirror is not None or drive.night is not None:
        lamps = visible_lamps(objects, camera)
        if mirror is not None:
            add_lamp_reflections(light, camera, lamps, mirror, ~hidden)
        add_lamps(light, camera, lamps)
    if drive.glare is not None:
        sun_ray = camera.require_pose().rotation @ view.sun_direction
        add_glare(light, pixel_rays(drive.camera), sun_ray, drive.glare, sunshine=_sunshine(drive, truth.pose))
    return Frame(_photograph(light, drive, time_s, road_light=road_light), truth, hidden)


@dataclass(frozen=True, eq=False)
class _FrameGeometry:
    """Geometry of a frame: camera with its pitch, heading, road, ground, sun direction and arc length of the car."""

    camera: Camera
    heading_rad: float
    ahead: RoadAhead
    ground: Ground
    sun_direction: np.ndarray
    station_m: float


def _add_shine(ground_light: np.ndarray, drive: Drive, sun: np.ndarray, view: _FrameGeometry) -> np.ndarray | None:
    """Add reflections and fog to the ground, in place; returns the reflectance (rows, width) of a wet road, or None."""
    height_m, mirror = view.camera.require_pose().height_m, None
    if drive.glare is not None:
        strength = drive.glare.sheen
        add_sheen(ground_light, view.ground, sun, view.sun_direction, strength=strength, height_m=height_m)
    if drive.wet is not None:
        mirror = drive.wet.mirror_share(view.ground, height_m, station_m=view.station_m, seed=drive.seed)
        sky = _mirrored_sky(drive, view.camera, view.heading_rad, view.ground)
        sky *= cv2.merge([mirror] * 3)
        ground_light += sky
    if drive.fog is not None:
        drive.fog.apply_to_ground(ground_light, view.ground)
    return mirror


def _paint_foreground(drive: Drive, objects: list[SceneObject], view: _FrameGeometry, *, sunny: float) -> np.ndarray:
    """Canvas with bonnet and objects; `sunny` is the share of sunlight on the near ground."""
    light_at = _object_light(drive, view.ahead, station_m=view.station_m)
    picture = new_canvas(view.camera.height, view.camera.width)
    if drive.bonnet:
        open_sky = 1.0 if light_at is None else float(light_at(np.array([[-1.0, 0.0]])).mean())
        paint_bonnet(picture, light=(0.2 + 0.8 * sunny) * open_sky)
    paint_objects(
        picture,
        view.camera,
        objects,
        sun_direction=view.sun_direction,
        haze=drive.backdrop.haze_per_km,
        light_at=light_at,
        atmosphere_at=_atmosphere(drive),
        crest=_crest(view.ahead, view.ground, view.camera),
    )
    return picture


def _photograph(light: np.ndarray, drive: Drive, time_s: float, *, road_light: float) -> np.ndarray:
    """Image that the camera stores of the light in front of the windscreen."""
    seed = drive.seed * 7919 + round(time_s * 1000)
    if drive.rain is not None:
        add_falling_drops(light, drive.rain, seed=seed)
        light = add_windscreen_drops(light, drive.rain, time_s, seed=drive.seed)
    lens = drive.lens
    if drive.exposure is not None:
        road = RoadLight(drive.surface, drive.shades, drive.seed)
        road_light = drive.exposure.adapted_light(lambda t: drive.motion.pose(t).s_m, road, time_s)
        lens = drive.exposure.lens(lens, road_light)
    return develop(light, lens, road_light=road_light, seed=seed)


def _rows_before_bonnet(drive: Drive) -> int:
    """Number of rows in which ground light is computed; the bonnet hides a twelfth of the ground."""
    height = drive.camera.height
    # Wet roads and glare are computed on coarse grids of the whole image.
    if not drive.bonnet or drive.wet is not None or drive.night is not None or drive.glare is not None:
        return height
    return max(first_hidden_row(drive.camera.size), height - BOTTOM_ROWS)


def _ground_light(
    drive: Drive, ground: Ground, sun: np.ndarray, objects: list[SceneObject], *, station_m: float, needed: np.ndarray
) -> np.ndarray:
    """Light of the ground (rows, width, 3) float32, valid in the mask `needed`."""
    light = ground_albedo(drive.surface, ground, station_m=station_m, seed=drive.seed, needed=needed)
    if drive.wet is not None:
        light *= np.float32(drive.wet.darkening)
    markings = drive.markings if drive.night is None else drive.night.markings(drive.markings)
    paint_markings(light, markings, ground, station_m=station_m, seed=drive.seed + 100)
    paint_symbols(light, drive.symbols, ground, station_m=station_m, seed=drive.seed + 200)
    if drive.night is not None:
        light *= drive.night.ground_light(ground, objects)
    else:
        light *= light_on_ground(sun, sky_on_ground(drive.shades, ground, station_m=station_m))
        if drive.sun.overcast:
            # OpenCV's stubs miss scalars
            cv2.multiply(light, (*OVERCAST_LIGHT.tolist(), 0.0), dst=light)  # type: ignore[call-overload]
    return light


def _atmosphere(drive: Drive) -> Callable[[float], Atmosphere] | None:
    """Air in front of objects by distance: fog, none at night, or None for the default haze."""
    if drive.fog is not None:
        return drive.fog.atmosphere_at
    if drive.night is not None:
        return lambda distance_m: Atmosphere(np.ones(3, np.float32), np.zeros(3, np.float32))
    return None


def _object_light(drive: Drive, ahead: RoadAhead, *, station_m: float) -> Callable[[np.ndarray], np.ndarray] | None:
    """Share of daylight at positions in the car's road frame; None if only trees cast shade."""
    closed = tuple(shade for shade in drive.shades if not isinstance(shade, TreeShade))
    if drive.night is not None:
        return drive.night.object_light
    if not closed and not drive.sun.overcast:
        return None
    clouds = float((OVERCAST_LIGHT * SKY_SHARE).mean()) if drive.sun.overcast else 1.0
    if not closed:
        return lambda points_m: np.full((len(points_m), 3), clouds)

    def light_at(points_m: np.ndarray) -> np.ndarray:
        s, d = ahead.locate(*points_m.T.astype(np.float32))
        return light_along(closed, s + station_m, d, seed=drive.seed) * clouds

    return light_at


def _sunshine(drive: Drive, pose: VehiclePose) -> float:
    """Share of sunlight on the windscreen."""
    return float(sun_along(drive.shades, np.array([pose.s_m]), np.array([pose.lateral_m]), seed=drive.seed)[0])


def _sun_on_ground(drive: Drive, objects: list[SceneObject], view: _FrameGeometry) -> np.ndarray:
    """Share of sunlight on the ground of each pixel, after shades and shadows of objects."""
    ground, station_m = view.ground, view.station_m
    if drive.sun.overcast or drive.night is not None:
        return np.zeros_like(ground.s)
    sun = sunlight_on_ground(drive.shades, ground, station_m=station_m, seed=drive.seed)
    trees: list[SceneObject] = [
        t for t in objects if isinstance(t, Tree) and t.x_m < MAX_SHADOW_M and abs(t.y_m) < MAX_SHADOW_LATERAL_M
    ]
    solid: list[SceneObject] = [t for t in objects if not isinstance(t, Tree)]
    for group, edge_noise_m in ((trees, LEAF_NOISE_M), (solid, 0.0)):
        polygons = shadow_polygons(group, view.sun_direction)
        cast_shadows(sun, polygons, view.camera, ground, view.ahead, station_m=station_m, edge_noise_m=edge_noise_m)
    return sun


def _backdrop(drive: Drive, view: _FrameGeometry, clear: np.ndarray) -> np.ndarray:
    """Image (height, width, 3) of the backdrop, where no object covers it, down to the first row of ground only."""
    rays, ground = pixel_rays(drive.camera), view.ground
    covered = ground.visible.all(axis=1) & (ground.distance.max(axis=1) < MAX_GROUND_M / 3)
    bottom = ground.top + int(np.argmax(covered)) + 1
    light = np.zeros_like(rays)
    # In blocks of rows, because woods cover most of them.
    for top in range(0, bottom, BLOCK_ROWS):
        band = slice(top, min(top + BLOCK_ROWS, bottom))
        seen = uncovered_window(clear[band])
        if seen is not None:
            columns = seen[1]
            directions = _directions(rays[band, columns], view.camera, view.heading_rad)
            light[band, columns] = _backdrop_light(drive, directions)
    return light


def _directions(rays: np.ndarray, camera: Camera, heading_rad: float) -> tuple[np.ndarray, ...]:
    """Unit vectors in the world frame, x, y and z (rows, columns), of rays (rows, columns, 3) in camera axes."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    to_world = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    # Axis by axis, because numpy is slow where the innermost axis has three elements.
    x, y, z = split_channels(cv2.transform(rays, (camera.require_pose().rotation @ to_world).T))
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def _backdrop_light(drive: Drive, directions: tuple[np.ndarray, ...]) -> np.ndarray:
    """Light (rows, columns, 3) of the backdrop in directions from `_directions`."""
    light = paint_backdrop(directions, drive.backdrop, seed=drive.seed)
    if drive.sun.overcast:
        light *= np.float32(OVERCAST_BACKDROP)
    if drive.night is not None:
        drive.night.darken_sky(light, directions[2])
    if drive.fog is not None:
        drive.fog.apply_to_sky(light, directions[2])
    return light


def _crest(ahead: RoadAhead, ground: Ground, camera: Camera) -> tuple[float, np.ndarray] | None:
    """Distance of the first crest that hides road, and mask (height, width) of the ground on its near side."""
    if ahead.profile.level:
        return None
    distance_m = ahead.crest_distance_m(camera.require_pose().height_m)
    near_side = np.zeros((camera.height, camera.width), bool)
    near_side[ground.top :] = ground.visible & (ground.distance < distance_m)
    return (distance_m, near_side) if np.isfinite(distance_m) else None


def _mirrored_sky(drive: Drive, camera: Camera, heading_rad: float, ground: Ground) -> np.ndarray:
    """Backdrop mirrored in level ground (rows, width, 3), blurred by the roughness of the road."""
    rays = pixel_rays(drive.camera)[ground.top :: MIRROR_DOWNSAMPLING, ::MIRROR_DOWNSAMPLING]
    x, y, z = _directions(rays, camera, heading_rad)
    light = cv2.GaussianBlur(
        _backdrop_light(drive, (x, y, np.abs(z))), (0, 0), sigmaX=1.0, sigmaY=camera.height / 60 / MIRROR_DOWNSAMPLING
    )
    return cv2.resize(light, ground.s.shape[::-1], interpolation=cv2.INTER_LINEAR)


def _composite_ground(light: np.ndarray, radiance: np.ndarray, ground: Ground, *, daylight: bool) -> None:
    """Composite the ground over the backdrop, in place, with airlight and a fade-out in the distance."""
    # Beyond a crest, rows below the horizon can show sky.
    hidden = np.flatnonzero(~ground.visible.all(axis=1))
    far = max(int(np.argmax(ground.distance.min(axis=1) < 40.0)), hidden[-1] + 1 if len(hidden) else 0)
    if daylight:
        air = (1 - np.exp(-ground.distance[:far] / np.float32(AIR_LENGTH_M)))[..., None]
        radiance[:far] += air * (AIR_LIGHT - radiance[:far])
    share = np.clip((MAX_GROUND_M - ground.distance[:far]) / np.float32(MAX_GROUND_M / 2), 0, 1) * ground.visible[:far]
    before = light[ground.top : ground.top + far]
    before += share[..., None] * (radiance[:far] - before)
    light[ground.top + far : ground.top + len(radiance)] = radiance[far:]
