"""Objects: projection, occlusion, shadows, walls, kerbs, bonnet and plants."""

import numpy as np
import pytest

from lanes.camera import Camera, CameraPose
from simulator.landscape.foliage import SPECIES, plant_sprites
from simulator.objects.bonnet import bonnet_outline, paint_bonnet
from simulator.objects.object_painter import paint_objects
from simulator.objects.scene_objects import Car, PlacedWall, Post, Sign, Tree, objects_in_view
from simulator.objects.shadows import shadow_polygons
from simulator.objects.walls import Wall
from simulator.painting.brush import (
    clip_polygon,
    composite_over,
    frustum_planes,
    inside_planes,
    new_canvas,
    uncovered_window,
)
from simulator.painting.noise import fractal_noise, fractal_profile
from simulator.road.geometry import RoadGeometry, VehiclePose, offset_point

SUN = np.array([-0.3, -0.5, 0.8]) / np.linalg.norm([-0.3, -0.5, 0.8])


def camera(*, distortion=(-0.24, -0.02, -0.001, 0.0003, -0.012), yaw=0.0, roll=0.0) -> Camera:
    matrix = np.array([[580.0, 0, 319.5], [0, 578.0, 190.0], [0, 0, 1]])
    return Camera(640, 360, matrix, np.array(distortion), CameraPose(1.3, np.radians(-1.5), yaw, roll))


def empty() -> np.ndarray:
    return np.full((360, 640, 3), 0.3, np.float32)


def draw(objects, lens=None, sun=SUN, haze=0.0) -> np.ndarray:
    picture = new_canvas(360, 640)
    paint_objects(picture, lens or camera(), objects, sun_direction=sun, haze=haze)
    return composite_over(picture, empty())


def changed(objects, lens=None) -> np.ndarray:
    return np.abs(draw(objects, lens) - empty()).max(axis=2) > 0.02


def straight_wall(y: float, kind: str, side: int, *, start: float = -4.0) -> Wall:
    x = np.arange(start, 150.0)
    return Wall(np.column_stack([x, np.full(len(x), y)]), kind, side)


EVERYTHING = [
    Car(14.0, -3.0, 0.02, "black"),
    Car(30.0, 0.0, 0.0, "red", "suv"),
    straight_wall(3.5, "jersey", 1),
    straight_wall(-9.0, "rail", -1),
    straight_wall(-12.0, "bank", -1),
    Tree(40.0, -11.0, 9.0, "oak", 1),
    Sign(35.0, -9.5, "green", 2.5, 1.4),
    Post(25.0, 5.0, 8.0, 0.15, arm_m=-2.0),
]


def test_drawing_is_repeatable():
    first, again = draw(EVERYTHING, haze=0.05), draw(EVERYTHING, haze=0.05)
    np.testing.assert_array_equal(first, again)
    assert first.dtype == np.float32 and np.isfinite(first).all() and first.min() >= 0


@pytest.mark.parametrize(("x", "y"), [(12.0, -3.2), (25.0, 2.5), (45.0, -1.0)])
def test_car_fills_its_projected_box(x, y):
    lens = camera(yaw=0.02, roll=0.01)
    rows, columns = np.nonzero(changed([Car(x, y, 0.0, "white")], lens))
    corners = np.array([[x + i, y + j, k] for i in (-2.42, 2.42) for j in (-0.92, 0.92) for k in (0.0, 1.46)])
    box = lens.road_to_pixels(corners)
    # Mirrors stick out of the box by 0.2 m, the contact shadow is soft, and edges are soft by a pixel.
    metre_px = 580 / (x - 2.4)
    assert columns.min() == pytest.approx(box[:, 0].min(), abs=3 + 0.2 * metre_px)
    assert columns.max() == pytest.approx(box[:, 0].max(), abs=3 + 0.2 * metre_px)
    assert rows.max() == pytest.approx(box[:, 1].max(), abs=3 + 0.12 * metre_px)
    assert box[:, 1].min() - 2 <= rows.min() <= box[:, 1].min() + 0.2 * (rows.max() - rows.min())


def test_wall_stands_between_its_lines():
    lens = camera()
    s = np.arange(2.0, 100, 1.0)
    mask = changed([Wall(np.column_stack([s, 3.0 + s**2 / 1600]), "jersey", 1)], lens)
    # Middle of the traffic face: half way up, 0.1 m behind the foot.
    x = np.array([8.0, 15.0, 30.0])
    face = lens.road_to_pixels(np.column_stack([x, 3.0 + x**2 / 1600 + 0.1, np.full(3, 0.4)]))
    foot = lens.road_to_pixels(np.column_stack([x, 3.0 + x**2 / 1600 - 0.25, np.zeros(3)]))
    for (u, v), (u0, v0) in zip(np.round(face).astype(int), np.round(foot).astype(int), strict=True):
        assert mask[v, u]
        assert not mask[v0, u0]


@pytest.mark.parametrize("kind", ["jersey", "parapet", "kerb", "bank"])
def test_wall_has_no_gaps_along_its_face(kind):
    lens = camera()
    mask = changed([straight_wall(3.5, kind, 1)], lens)
    # Its foot's height in every column from the picture's edge to 60 m away.
    end = lens.road_to_pixels(np.array([[60.0, 3.5, 0.0]]))[0, 0]
    assert mask[:, 2 : int(end)].any(axis=0).all()


def test_bank_hides_objects_around_the_bend():
    """In a right bend next to a cutting, far objects are hidden and near ones are not."""
    x = np.arange(-4.0, 300.0, 2.0)
    bank = Wall(np.column_stack([x, -8.0 - x**2 / 800]), "bank", -1)
    near, far = Post(30.0, -6.5, 3.0, 0.4), Post(260.0, -2.0 - 260.0**2 / 800, 3.0, 2.0)
    assert changed([far]).any()
    alone = draw([bank])
    np.testing.assert_array_equal(draw([bank, far]), alone)
    assert np.abs(draw([bank, near]) - alone).max() > 0.05


def test_bank_ends_in_one_smooth_outline_where_it_turns_away():
    x = np.arange(-4.0, 300.0, 2.0)
    mask = changed([Wall(np.column_stack([x, -8.0 - x**2 / 800]), "bank", -1)])
    columns = np.flatnonzero(mask.any(axis=0))
    np.testing.assert_array_equal(columns, np.arange(columns[0], 640))
    outline = mask[:, columns].argmax(axis=0)
    # It rises from left to right without jumps of several rows.
    steps = np.diff(outline[:-2])
    assert steps.max() <= 1 and steps.min() >= -6


def test_parts_behind_the_camera_are_clipped():
    beside = changed([Car(3.5, -2.6, 0.0, "white")])
    assert beside[:, 560:].any() and not beside[:, :400].any()
    assert not changed([Car(-6.0, 0.0), Tree(-3.0, 1.0, 8.0), Sign(-1.0, 3.0), Post(0.1, 0.0)]).any()


def test_polygons_are_clipped_at_the_plane():
    planes = np.array([[1.0, 0, 0, -0.5]])
    square = np.array([[-1.0, 0, 0], [2, 0, 0], [2, 1, 0], [-1, 1, 0]])
    part = clip_polygon(square, planes)
    assert sorted(part[:, 0].tolist()) == pytest.approx([0.5, 0.5, 2, 2])
    np.testing.assert_array_equal(clip_polygon(square + [5, 0, 0], planes), square + [5, 0, 0])
    assert len(clip_polygon(square - [5, 0, 0], planes)) == 0


def test_all_points_inside_the_frustum_can_be_projected():
    lens = camera(yaw=0.1, roll=-0.05)
    rng = np.random.default_rng(0)
    points = rng.uniform([-20, -60, 0], [80, 60, 30], (4000, 3))
    kept = points[inside_planes(points, frustum_planes(lens))]
    assert len(kept) > 100
    assert np.isfinite(lens.road_to_pixels(kept)).all()
    on_road = lens.pixels_to_road(np.array([[0.0, 359.0], [639.0, 359.0], [320.0, 300.0]]))
    assert inside_planes(np.column_stack([on_road, np.zeros(3)]), frustum_planes(lens)).all()


def test_near_objects_hide_far_ones_in_any_order():
    near, far = Car(12.0, 0.0, 0.0, "white"), Car(30.0, 0.0, 0.0, "red", "suv")
    one, other = draw([near, far]), draw([far, near])
    np.testing.assert_array_equal(one, other)
    u, v = np.round(camera().road_to_pixels(np.array([[10.0, 0.0, 0.8]]))[0]).astype(int)
    window = slice(v - 3, v + 3), slice(u - 3, u + 3)
    np.testing.assert_allclose(one[window], draw([near])[window], atol=1e-6)
    assert np.abs(draw([far])[window] - one[window]).max() > 0.05


def test_objects_are_painted_only_where_nearer_ones_leave_them_visible():
    """Objects behind an opaque canvas with a window are visible in the window only."""
    picture, window = new_canvas(360, 640), (slice(150, 260), slice(200, 460))
    picture[3] = 0
    picture[3][window] = 1
    assert uncovered_window(picture[3]) == window and uncovered_window(picture[3, :150]) is None
    paint_objects(picture, camera(), EVERYTHING, sun_direction=SUN, haze=0.0)
    seen = composite_over(picture, empty())
    np.testing.assert_allclose(seen[window], draw(EVERYTHING)[window], atol=1e-4)
    assert np.ptp(seen[window]) > 0.3
    seen[window] = 0
    assert not seen.any()


def test_mirrored_world_gives_the_mirrored_picture():
    """With a symmetric lens, mirrored cars and walls give the mirrored picture."""
    matrix = np.array([[580.0, 0, 319.5], [0, 580.0, 190.0], [0, 0, 1]])
    lens = Camera(640, 360, matrix, np.array([-0.24, -0.02, 0, 0, 0]), CameraPose(1.3, np.radians(-1.5)))
    left = [Car(15.0, 2.5, 0.1, "silver"), straight_wall(3.9, "jersey", 1, start=1.0)]
    right = [Car(15.0, -2.5, -0.1, "silver"), straight_wall(-3.9, "jersey", -1, start=1.0)]
    one = draw(left, lens)
    other = draw(right, lens, sun=SUN * [1, -1, 1])[:, ::-1]
    difference = np.abs(one - other).max(axis=2)
    assert difference.mean() < 2e-3
    assert (difference > 0.1).mean() < 2e-3
    assert np.abs(one - one[:, ::-1]).mean() > 0.01, "the scene itself is not symmetric"


def test_side_towards_the_sun_is_brighter():
    u, v = np.round(camera().road_to_pixels(np.array([[10.0, 3.1, 0.5]]))[0]).astype(int)
    wall = [straight_wall(3.0, "jersey", 1)]
    lit, backlit = (draw(wall, sun=np.array([0.0, y, 0.6]))[v, u].mean() for y in (-0.8, 0.8))
    assert lit > 2 * backlit


def test_shadows_fall_away_from_the_sun():
    polygon = shadow_polygons([Car(20.0, -2.0)], np.array([0.0, -0.6, 0.8]))[0]
    assert polygon.dtype == np.float32 and polygon.shape[1] == 2
    # The shadow of the roof is 0.75 m farther left for each metre of height.
    assert polygon[:, 1].max() == pytest.approx(-2.0 + 0.75 * 1.41 + 0.57, abs=0.15)
    assert polygon[:, 1].min() > -2.0 - 0.95
    tree = np.vstack(shadow_polygons([Tree(30.0, 5.0, 10.0, "oak", 1)], np.array([0.6, 0.0, 0.8])))
    assert tree[:, 0].min() < 30 - 5 and tree[:, 0].mean() < 28
    post = shadow_polygons([Post(10.0, 0.0, 4.0)], np.array([0.0, 0.6, 0.8]))[0]
    assert post[:, 1].min() == pytest.approx(-3.0, abs=0.1)


def test_every_wall_but_a_bank_casts_a_shadow_along_its_path():
    path = np.column_stack([np.arange(0.0, 50), np.full(50, 4.0)])
    every = np.vstack(shadow_polygons([Wall(path, "jersey", 1)], np.array([0.0, 0.6, 0.8])))
    assert every[:, 0].min() == pytest.approx(0, abs=0.1) and every[:, 0].max() == pytest.approx(49, abs=1.1)
    assert every[:, 1].min() == pytest.approx(4.0 - 0.75 * 0.81 + 0.2, abs=0.05)
    assert shadow_polygons([Wall(path, "bank", 1)], SUN) == []


def test_kerb_follows_the_road():
    road, pose, lens = RoadGeometry([0.0, 400.0], [1 / 200, 1 / 200]), VehiclePose(100.0, 0.3, 0.01), camera()
    kerb = objects_in_view((PlacedWall(-4.0, "kerb"),), road, pose, time_s=0.0)
    mask = changed(kerb, lens)
    s = pose.s_m + np.array([10.0, 15.0, 25.0])
    for lateral, height, painted in ((-4.01, 0.06, True), (-4.12, 0.14, True), (-3.8, 0.0, False), (-4.8, 0.14, False)):
        place = pose.to_car(road, offset_point(road, s, lateral))
        u, v = np.round(lens.road_to_pixels(np.column_stack([place, np.full(3, height)]))).astype(int).T
        assert (mask[v, u] == painted).all()


@pytest.mark.parametrize(("distance_m", "scale"), [(6.5, 1.0), (9.0, 1.0), (9.0, 2.0)])
def test_kerb_is_fourteen_centimetres_high(distance_m, scale):
    lens, x = camera(distortion=(0.0,) * 5), np.arange(-4.0, 150.0)
    mask = changed([Wall(np.column_stack([x, np.full(len(x), -3.0)]), "kerb", -1, height_scale=scale)], lens)
    # One column shows the foot, and the back edge of the top at a proportionally larger distance.
    foot, back = lens.road_to_pixels(
        np.array([[distance_m, -3.0, 0.0], [distance_m * 3.2 / 3.0, -3.2, 0.14 * scale]]),
    )
    rows = np.flatnonzero(mask[:, round(foot[0])])
    assert (rows.min(), rows.max()) == pytest.approx((back[1], foot[1]), abs=1)


@pytest.mark.parametrize(("y", "side"), [(3.0, 1), (-3.0, -1)])
def test_kerb_has_a_lit_top_and_a_shaded_face_with_the_sun_behind_it(y, side):
    lens, kerb = camera(), [straight_wall(y, "kerb", side)]
    places = np.array([[x, y + side * out, z] for out, z in ((0.01, 0.06), (0.12, 0.14)) for x in np.arange(6, 7, 0.1)])
    u, v = np.round(lens.road_to_pixels(places)).astype(int).T
    for toward, low, high in ((side, 0.0, 0.45), (-side, 0.6, 1.6)):
        face, top = draw(kerb, sun=np.array([0.0, 0.6 * toward, 0.8]))[v, u].mean(axis=1).reshape(2, -1).mean(axis=1)
        assert low < face / top < high
    shadow = np.vstack(shadow_polygons(kerb, np.array([0.0, 0.6 * side, 0.8])))
    assert (side * (y - shadow[:, 1])).max() == pytest.approx(0.75 * 0.14 - 0.05, abs=0.01)


def test_bonnet_hides_the_bottom_edge_only_and_is_soft():
    before = np.full((720, 1280, 3), 0.5, np.float32)
    lens = camera().scaled((1280, 720))

    def with_bonnet(seed):
        picture = new_canvas(720, 1280)
        paint_bonnet(picture, seed=seed)
        return composite_over(picture, before)

    after = with_bonnet(3)
    edge = bonnet_outline(lens.size)
    assert edge.shape == (1280,) and edge.min() > 650 and edge.max() < 692
    np.testing.assert_array_equal(after[:640], before[:640])
    assert after[700:].mean() < 0.3 and after[700:, :, 0].mean() > after[700:, :, 2].mean()
    steps = np.abs(np.diff(after.mean(axis=2), axis=0)).max(axis=0)
    assert np.median(steps) < 0.2, "the edge is a ramp, not a step"
    np.testing.assert_array_equal(after, with_bonnet(3))
    assert np.abs(after - with_bonnet(4)).max() > 0.01


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: draw([Car(10, 0, paint="tartan")]), "tartan"),
        (lambda: draw([Car(10, 0, body="tank")]), "tank"),
        (lambda: draw([Tree(10, 0, species="lamp")]), "lamp"),
        (lambda: draw([Sign(10, 0, kind="pub")]), "pub"),
        (lambda: Wall(np.zeros((4, 2)), "hedge"), "hedge"),
        (lambda: Wall(np.zeros((4, 4))), r"\(4, 4\)"),
        (lambda: shadow_polygons([], np.array([1.0, 0, -0.1])), "sun"),
    ],
)
def test_message_names_an_unknown_kind(make, named):
    with pytest.raises(ValueError, match=named):
        make()


def test_refuses_an_object_of_another_type():
    with pytest.raises(TypeError, match="str"):
        draw(["car"])


@pytest.mark.parametrize("species", sorted(SPECIES))
def test_plant_stands_on_its_foot_and_is_green_or_brown(species):
    sprites = plant_sprites(species, 3)
    whole = sprites[0]
    assert whole.dtype == np.float32 and (whole[..., 3] <= 1 + 1e-6).all() and (whole >= 0).all()
    rows = np.flatnonzero((whole[..., 3] > 0.5).any(axis=1))
    assert rows[0] < 0.06 * len(whole) and rows[-1] >= len(whole) - 2
    # Colours are premultiplied: zero where the coverage is zero.
    assert whole[whole[..., 3] == 0].max(initial=0) == 0
    red, green, blue, cover = whole.reshape(-1, 4).sum(axis=0)
    assert blue < 0.8 * min(red, green) and 0.005 < green / cover < 0.2
    # The smaller levels show the same plant.
    for smaller in sprites[1:3]:
        assert smaller[..., 3].mean() == pytest.approx(whole[..., 3].mean(), rel=0.03)


def test_noise_is_periodic_and_normalised():
    noise = fractal_noise((60, 200), np.random.default_rng(5), cell_px=(20, 33), octaves=4)
    assert noise.mean() == pytest.approx(0, abs=1e-4) and noise.std() == pytest.approx(1, abs=1e-4)
    inner = np.abs(np.diff(noise, axis=1)).mean()
    assert np.abs(noise[:, 0] - noise[:, -1]).mean() < 2 * inner
    profile = fractal_profile(500, np.random.default_rng(5), cell_px=60)
    assert abs(profile[0] - profile[-1]) < 4 * np.abs(np.diff(profile)).mean()
