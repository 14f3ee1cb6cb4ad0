"""Renders a frame of a drive, or a video file, with its ground truth."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from lanes.camera.model import Camera, save_camera
from lanes.files import atomic_write, translate_write_errors
from lanes.video.reader import inspect_video
from simulator.backdrop import aerial_perspective, paint_backdrop
from simulator.light.lens import LUMINANCE, develop, road_luminance
from simulator.light.sunlight import (
    OVERCAST_LIGHT,
    SKY_SHARE,
    TreeShade,
    add_glare,
    add_sheen,
    light_along,
    light_on_ground,
    sky_on_ground,
    sun_along,
    sunlight_on_ground,
)
from simulator.objects.scene_objects import (
    MAX_SHADOW_M,
    SceneObject,
    cast_shadows,
    from_far_to_near,
    objects_in_view,
    shadow_polygons,
)
from simulator.objects.standing import Tree
from simulator.objects.vehicles import paint_bonnet
from simulator.painting import Atmosphere, Canvas, blend, split_channels, three_channels
from simulator.processes import map_ordered
from simulator.rendering.drive import Drive
from simulator.road.geometry import VehiclePose
from simulator.road.ground import (
    MAX_GROUND_M,
    Ground,
    RoadAhead,
    cast_on_ground,
    pixel_rays,
)
from simulator.road.markings import paint_markings
from simulator.road.surface import ground_albedo
from simulator.road.truth import Truth, truth_row, write_truth_csv
from simulator.weather import (
    WET_DARKENING,
    add_falling_drops,
    add_lamp_reflections,
    add_lamps,
    add_windscreen_drops,
    visible_lamps,
)

# Airlight in front of distant ground, and its length constant in metres.
AIR_LIGHT = np.array([0.42, 0.48, 0.56], np.float32)
AIR_LENGTH_M = 3500.0
# Ground nearer than this has no airlight.
NO_AIR_M = 40.0
# Light of the backdrop below an overcast sky, relative to a sunny day.
OVERCAST_BACKDROP = 0.55
# The reflection of the sky in a wet road is computed on every 6th pixel.
MIRROR_DOWNSAMPLING = 6
# Trees farther from the car than this, laterally, cast shadows on grass only.
MAX_SHADOW_LATERAL_M = 22.0
# The exposure is metered between these rows from the bottom; the sunlight of the bonnet
# is that below the second.
METERED_ROWS = 250
BOTTOM_ROWS = 60
# Place of the bonnet in the car's frame.
BONNET_M = np.array([[-1.0, 0.0]])
# Each segment of a wall is painted behind homogeneous air, so fog needs shorter
# segments than clear air.
CLEAR_GROWTH = 1.3
FOG_GROWTH = 1.12
# Displacement of the shadow edges of crowns by leaves, metres.
LEAF_NOISE_M = 0.13


@dataclass(frozen=True)
class Frame:
    """Rendered image (height, width, 3) uint8 RGB, and its ground truth.

    `hidden` (height, width) is True where an object is in front of ground or backdrop.
    """

    image: np.ndarray
    truth: Truth
    hidden: np.ndarray = field(repr=False)


@dataclass(frozen=True, eq=False)
class _View:
    """A moment of a drive.

    Camera with its pitch, pose and heading of the car, road, ground, sun and objects.
    """

    drive: Drive
    camera: Camera
    pose: VehiclePose
    heading_rad: float
    ahead: RoadAhead
    ground: Ground
    sun_direction: np.ndarray
    objects: list[SceneObject]


def render_frame(drive: Drive, time_s: float = 0.0) -> Frame:
    """Image of the drive's camera at `time_s`, with its ground truth."""
    truth = drive.truth(time_s)
    view = _look(drive, truth.pose, time_s)

    # The exposure is metered on the bare ground, without air, sky, vehicles and bonnet.
    sun = _sun_on_ground(view)
    ground_light = _ground_light(view, sun)
    road_light = _meter(ground_light)

    # From far to near: sky, ground, objects, and the windscreen.
    mirror = _add_shine(ground_light, sun, view)
    light = _backdrop(view)
    _composite_ground(light, ground_light, view)
    sunny = float(sun[-BOTTOM_ROWS:].mean())
    hidden = _paint_objects(light, view, sunny=sunny)
    _add_lamp_light(light, view, mirror, hidden)
    _add_glare(light, view)
    image = _photograph(light, drive, time_s, road_light=road_light)
    return Frame(image, truth, hidden)


def _look(drive: Drive, pose: VehiclePose, time_s: float) -> _View:
    camera = drive.camera_at(time_s)
    heading_rad = pose.absolute_heading(drive.road)
    ahead = RoadAhead(drive.road, pose)
    return _View(
        drive=drive,
        camera=camera,
        pose=pose,
        heading_rad=heading_rad,
        ahead=ahead,
        ground=cast_on_ground(pixel_rays(drive.camera), camera, ahead),
        sun_direction=drive.sun.direction(heading_rad),
        objects=objects_in_view(drive.objects, drive.road, pose, time_s=time_s),
    )


def _sun_on_ground(view: _View) -> np.ndarray:
    """Share of sunlight on the ground of each pixel.

    Shades and shadows of objects take it away.
    """
    drive = view.drive
    if drive.sun.overcast or drive.night is not None:
        return np.zeros_like(view.ground.s)
    sun = sunlight_on_ground(drive.shades, view.ground, seed=drive.seed)

    trees: list[SceneObject] = []
    solid: list[SceneObject] = []
    for item in view.objects:
        if not isinstance(item, Tree):
            solid.append(item)
        elif item.x_m < MAX_SHADOW_M and abs(item.y_m) < MAX_SHADOW_LATERAL_M:
            trees.append(item)
    for group, noise_m in ((trees, LEAF_NOISE_M), (solid, 0.0)):
        cast_shadows(
            sun,
            shadow_polygons(group, view.sun_direction),
            view.camera,
            view.ground,
            view.ahead,
            edge_noise_m=noise_m,
        )
    return sun


def _ground_light(view: _View, sun: np.ndarray) -> np.ndarray:
    """Light of the ground (rows, width, 3) float32."""
    drive = view.drive
    ground = view.ground
    night = drive.night
    light = ground_albedo(drive.surface, ground, seed=drive.seed)
    if drive.wet is not None:
        light *= WET_DARKENING
    markings = drive.markings if night is None else night.markings(drive.markings)
    paint_markings(light, markings, ground, seed=drive.seed + 100)
    paint_markings(light, drive.symbols, ground, seed=drive.seed + 200)

    if night is not None:
        light *= night.ground_light(ground, view.objects)
        return light
    light *= light_on_ground(sun, sky_on_ground(drive.shades, ground))
    if drive.sun.overcast:
        light *= OVERCAST_LIGHT
    return light


def _meter(ground_light: np.ndarray) -> float:
    """Mean luminance of every fourth row and every eighth column of the road ahead."""
    rows = len(ground_light)
    first = max(rows - METERED_ROWS, 0)
    metered = ground_light[first : rows - BOTTOM_ROWS : 4, ::8]
    return float((metered @ LUMINANCE).mean())


def _add_shine(
    light: np.ndarray,
    sun: np.ndarray,
    view: _View,
) -> np.ndarray | None:
    """Add reflections and fog to the ground, in place.

    Returns the reflectance (rows, width) of a wet road, or None.
    """
    drive = view.drive
    height_m = view.camera.require_pose().height_m
    mirror = None
    if drive.glare is not None:
        add_sheen(
            light,
            view.ground,
            sun,
            view.sun_direction,
            strength=drive.glare.sheen,
            height_m=height_m,
        )
    if drive.wet is not None:
        mirror = drive.wet.mirror_share(view.ground, height_m, seed=drive.seed)
        light += _mirrored_sky(view) * three_channels(mirror)
    if drive.fog is not None:
        drive.fog.apply_to_ground(light, view.ground)
    return mirror


def _paint_objects(
    light: np.ndarray,
    view: _View,
    *,
    sunny: float,
) -> np.ndarray:
    """Paint objects and bonnet from far to near, in place.

    Returns the mask (height, width) of what they hide. `sunny` is the share of sunlight
    on the near ground.
    """
    drive = view.drive
    canvas = Canvas(light, view.camera)
    bare = light.copy()
    clear = drive.fog is None and drive.night is None
    growth = CLEAR_GROWTH if clear else FOG_GROWTH
    parts = from_far_to_near(view.objects, growth=growth)

    # One call for all positions, because there are hundreds of objects.
    places = [BONNET_M, *(part.places_m for _, part in parts)]
    ends = np.cumsum([len(place) for place in places])
    daylight = _object_light(view, np.concatenate(places))
    at_bonnet, *daylights = np.split(daylight, ends[:-1])

    crest_m, near_side = _crest(view)
    for before_crest in (False, True):
        for (distance_m, part), share in zip(parts, daylights, strict=True):
            if (distance_m < crest_m) == before_crest:
                air = _air(drive, distance_m)
                part.paint_over(canvas, view.sun_direction, air, share)
        if near_side is not None and not before_crest:
            # The near side of the crest hides everything painted so far.
            cv2.copyTo(bare, near_side, light)

    if drive.bonnet:
        paint_bonnet(light, light=(0.2 + 0.8 * sunny) * float(at_bonnet.mean()))
    changed = cv2.compare(light, bare, cv2.CMP_NE)
    return cv2.transform(changed, np.ones((1, 3))) > 0


def _air(drive: Drive, distance_m: float) -> Atmosphere:
    """Air in front of an object at a distance: fog, haze by day, none at night."""
    if drive.fog is not None:
        return drive.fog.atmosphere_at(distance_m)
    if drive.night is not None:
        return Atmosphere()
    return aerial_perspective(distance_m, drive.backdrop.haze_per_km)


def _object_light(view: _View, points_m: np.ndarray) -> np.ndarray:
    """Share of daylight (N, 3) at positions (N, 2) in the car's road frame.

    Tree crowns shade no objects.
    """
    drive = view.drive
    if drive.night is not None:
        return drive.night.object_light(points_m)
    closed = tuple(s for s in drive.shades if not isinstance(s, TreeShade))
    overcast = drive.sun.overcast
    if not closed and not overcast:
        return np.ones((len(points_m), 3))
    clouds = float((OVERCAST_LIGHT * SKY_SHARE).mean()) if overcast else 1.0
    s, d = view.ahead.locate(*points_m.T.astype(np.float32))
    station = s + view.ground.station_m
    return light_along(closed, station, d, seed=drive.seed) * clouds


def _crest(view: _View) -> tuple[float, np.ndarray | None]:
    """Distance of the first crest that hides road, and mask of its near side.

    The mask (height, width) uint8 is that of the ground.
    """
    distance_m = view.ahead.crest_distance_m(view.camera.require_pose().height_m)
    if np.isinf(distance_m):
        return distance_m, None
    ground = view.ground
    near_side = np.zeros((view.camera.height, view.camera.width), np.uint8)
    near_side[ground.top :] = ground.visible & (ground.distance < distance_m)
    return distance_m, near_side


def _backdrop(view: _View) -> np.ndarray:
    """Image (height, width, 3) of the backdrop, down to the first row of ground."""
    rays = pixel_rays(view.drive.camera)
    ground = view.ground
    near = ground.distance.max(axis=1) < MAX_GROUND_M / 3
    covered = ground.visible.all(axis=1) & near
    bottom = ground.top + int(np.argmax(covered)) + 1
    light = np.zeros_like(rays)
    light[:bottom] = _backdrop_light(view, *_directions(rays[:bottom], view))
    return light


def _directions(
    rays: np.ndarray,
    view: _View,
) -> tuple[np.ndarray, ...]:
    """Unit vectors in the world frame of rays (rows, columns, 3) in camera axes.

    They are x, y and z (rows, columns).
    """
    cosine = np.cos(view.heading_rad)
    sine = np.sin(view.heading_rad)
    to_world = np.array(
        [
            [cosine, sine, 0],
            [-sine, cosine, 0],
            [0, 0, 1],
        ]
    )
    turn = view.camera.require_pose().rotation @ to_world
    x, y, z = split_channels(cv2.transform(rays, turn.T))
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def _backdrop_light(
    view: _View,
    x: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
) -> np.ndarray:
    """Light (rows, columns, 3) of the backdrop in directions from `_directions`."""
    drive = view.drive
    light = paint_backdrop((x, y, z), drive.backdrop, seed=drive.seed)
    if drive.sun.overcast:
        light *= OVERCAST_BACKDROP
    if drive.night is not None:
        drive.night.darken_sky(light, z)
    if drive.fog is not None:
        drive.fog.apply_to_sky(light, z)
    return light


def _mirrored_sky(view: _View) -> np.ndarray:
    """Backdrop mirrored in level ground (rows, width, 3).

    It is blurred by the roughness of the road.
    """
    coarse = MIRROR_DOWNSAMPLING
    rays = pixel_rays(view.drive.camera)[view.ground.top :: coarse, ::coarse]
    x, y, z = _directions(rays, view)
    light = _backdrop_light(view, x, y, np.abs(z))
    tall_px = view.camera.height / 60 / coarse
    light = cv2.GaussianBlur(light, (0, 0), sigmaX=1.0, sigmaY=tall_px)
    size = view.ground.s.shape[::-1]
    return cv2.resize(light, size, interpolation=cv2.INTER_LINEAR)


def _composite_ground(
    light: np.ndarray,
    radiance: np.ndarray,
    view: _View,
) -> None:
    """Composite the ground over the backdrop, in place.

    It gets airlight by day, and fades out in the distance.
    """
    # Beyond a crest, rows below the horizon can show sky.
    ground = view.ground
    far = int(np.argmax(ground.distance.min(axis=1) < NO_AIR_M))
    with_sky = np.flatnonzero(~ground.visible.all(axis=1))
    if len(with_sky):
        far = max(far, with_sky[-1] + 1)

    distance = ground.distance[:far]
    if view.drive.night is None:
        air = 1 - np.exp(-distance / AIR_LENGTH_M)
        blend(radiance[:far], AIR_LIGHT, air)
    share = np.clip((MAX_GROUND_M - distance) / (MAX_GROUND_M / 2), 0, 1)
    share = share * ground.visible[:far]
    bottom = ground.top + far
    blend(light[ground.top : bottom], radiance[:far], share)
    light[bottom:] = radiance[far:]


def _add_lamp_light(
    light: np.ndarray,
    view: _View,
    mirror: np.ndarray | None,
    hidden: np.ndarray,
) -> None:
    """Add lamps of vehicles, and their reflections on a wet road, in place."""
    if mirror is None and view.drive.night is None:
        return
    lamps = visible_lamps(view.objects, view.camera)
    if mirror is not None:
        add_lamp_reflections(light, view.camera, lamps, mirror, ~hidden)
    add_lamps(light, view.camera, lamps)


def _add_glare(light: np.ndarray, view: _View) -> None:
    """Add the glare of the sun in the windscreen, in place."""
    drive = view.drive
    if drive.glare is None:
        return
    sun_ray = view.camera.require_pose().rotation @ view.sun_direction
    s = np.array([view.pose.s_m])
    d = np.array([view.pose.lateral_m])
    sunshine = float(sun_along(drive.shades, s, d, seed=drive.seed)[0])
    rays = pixel_rays(drive.camera)
    add_glare(light, rays, sun_ray, drive.glare, sunshine=sunshine)


def _photograph(
    light: np.ndarray,
    drive: Drive,
    time_s: float,
    *,
    road_light: float,
) -> np.ndarray:
    """Image that the camera stores of the light in front of the windscreen."""
    seed = drive.seed * 7919 + round(time_s * 1000)
    lens = drive.lens
    if drive.rain:
        add_falling_drops(light, seed=seed)
        add_windscreen_drops(light, time_s, seed=drive.seed)
    if drive.exposure is not None:
        luminance = partial(
            road_luminance,
            surface=drive.surface,
            shades=drive.shades,
            seed=drive.seed,
        )
        road_light = drive.exposure.adapted_light(
            lambda t: drive.motion.pose(t).s_m, luminance, time_s
        )
        lens = drive.exposure.lens(lens, road_light)
    return develop(light, lens, road_light=road_light, seed=seed)


Progress = Callable[[int, int], None]

# CRF 21 preserves the texture of asphalt at about 6 Mbit/s.
VIDEO_CRF = 21
# Smaller files for 0.08 s more a frame, because videos are committed.
VIDEO_PRESET = "slow"
# One encoder thread, because x264 output depends on the number of threads.
# faststart: browsers can play the file while it loads.
ENCODER = ["-threads", "1", "-movflags", "+faststart", "-bitexact"]

VIDEO_SECONDS = 10.0
VIDEO_FPS = 25


def write_video(
    path: str | Path,
    *,
    drive: Drive,
    seconds: float = VIDEO_SECONDS,
    crf: int = VIDEO_CRF,
    preset: str = VIDEO_PRESET,
    progress: Progress | None = None,
    workers: int | None = None,
) -> list[Path]:
    """Files written: a drive as H.264 video (.mp4), its ground truth and its camera.

    The ground truth (.csv) has a row for each frame, the camera is a .yaml. `crf` and
    `preset` are quality and speed of x264. `progress` is called as progress(frames
    done, number of frames). `workers` is the number of processes (default: one for each
    available CPU) and does not change the files. Raises OSError if the folder cannot be
    written to or the encoder fails.
    """
    path = Path(path)
    count = round(seconds * VIDEO_FPS)
    quality = ["-crf", str(crf), "-preset", preset]
    with atomic_write(path) as unfinished, translate_write_errors(path):
        rows = _encode(unfinished, drive, count, quality, progress, workers)
        # The encoder is a separate process, which can be killed or run out of disk
        # space silently.
        if inspect_video(unfinished).frames != count:
            raise OSError(f"the encoder wrote fewer than {count} frames")
    table = path.with_suffix(".csv")
    camera = path.with_suffix(".yaml")
    write_truth_csv(table, rows)
    save_camera(drive.camera, camera)
    return [path, table, camera]


def _encode(
    path: Path,
    drive: Drive,
    count: int,
    quality: list[str],
    progress: Progress | None,
    workers: int | None,
) -> list[dict]:
    """Render and encode `count` frames; returns the rows of the truth CSV."""
    # Imported here, because it is slow and only rendering needs it.
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path),
        drive.camera.size,
        fps=VIDEO_FPS,
        codec="libx264",
        quality=None,
        macro_block_size=1,
        output_params=[*quality, *ENCODER],
    )
    rows = []
    frames = map_ordered(partial(_video_frame, drive), range(count), workers=workers)
    with closing(writer), closing(frames):
        writer.send(None)
        for image, row in frames:
            writer.send(image)
            rows.append(row)
            if progress:
                progress(len(rows), count)
    return rows


def _video_frame(
    drive: Drive,
    number: int,
) -> tuple[bytes, dict]:
    """Bytes of a frame, and its row of the truth CSV."""
    frame = render_frame(drive, number / VIDEO_FPS)
    return frame.image.tobytes(), truth_row(frame.truth, frame=number)
