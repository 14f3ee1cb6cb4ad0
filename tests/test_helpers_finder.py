"""The three recipes on painted roads with ground truth, and the defects mended."""

from dataclasses import fields, replace
from functools import cache

import cv2
import numpy as np
import pytest
from pytest import approx

from helpers import (
    RECIPES,
    LaneFinder,
    Line,
    Recipe,
    RoadLine,
    Thresholds,
    calibrate,
    distort_points,
    get_recipe,
    mean_distance_px,
    metres_per_pixel,
    nearest_line,
    read_image,
)
from lanes.camera.model import load_camera
from tests.support.classic_lane import (
    USUAL_SCALES,
    image_to_road,
    lane_result,
    lens_of,
    needs_real_data,
    start_finder,
)
from tests.support.painted_roads import LANE_WIDTH_M, SUNLIT_WHITE, LaneRoad, paint_lane
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA
from tests.support.project import REAL_DATA, ROOT

parametrize = pytest.mark.parametrize

LENS = lens_of(CAMERA)
TO_ROAD = image_to_road(CAMERA)
every_recipe = parametrize("name", RECIPES)


def finder(name, camera=CAMERA):
    return start_finder(name, camera)


@cache
def picture(road):
    """Cached, and read-only, because a finder must not change its input."""
    image = paint_lane(road)
    image.flags.writeable = False
    return image


def summary(result):
    lines = [
        None if line is None else line.tolist() for line in (result.left, result.right)
    ]
    return result.state, lines, result.curvature_per_m, result.offset_m


LEFT_BEND = LaneRoad(1 / 400, 0.3)
RIGHT_BEND = LaneRoad(-1 / 400, -0.3)
DASHED = LaneRoad(1 / 600, 0.2, right_dashed=True)
STRAIGHT = LaneRoad(0.0, -0.25)
SHADOW = LaneRoad(-1 / 500, 0.1, shadow_m=(9, 14))
TWO_WHITE = LaneRoad(1 / 700, 0.0, left=SUNLIT_WHITE)
HALF_LANE = LaneRoad(1 / 500, 0.2, right=None)
HALF_LANE_BEFORE = LaneRoad(1 / 500, 0.2)


# Largest errors of curvature (relative), offset and width (m). The binaries of two
# recipes have steps of one pixel, which the warp enlarges to about 0.1 m far away.
EXACT = {
    "hls_sobel": (0.05, 0.015, 0.03),
    "equalized_hsv": (0.1, 0.03, 0.1),
    "best_channel": (0.1, 0.03, 0.1),
}
ROADS = [LEFT_BEND, DASHED, STRAIGHT, TWO_WHITE]


@parametrize(
    ("name", "road"),
    [
        ("hls_sobel", RIGHT_BEND),
        ("hls_sobel", SHADOW),
        *[("hls_sobel", road) for road in ROADS],
        *[("equalized_hsv", road) for road in ROADS],
        *[("best_channel", road) for road in ROADS],
    ],
    ids=str,
)
def test_recipes_measure_the_truth(name, road):
    result = finder(name).find(picture(road))
    curvature, offset_m, width_m = EXACT[name]
    true_curvature = approx(road.curvature_per_m, rel=curvature, abs=1e-4)
    assert result.state == "found"
    assert result.curvature_per_m == true_curvature
    assert result.offset_m == approx(road.offset_m, abs=offset_m)
    assert result.lane_width_m == approx(LANE_WIDTH_M, abs=width_m)


@every_recipe
def test_one_missing_line_leaves_the_other_and_no_lane(name):
    result = finder(name).find(picture(HALF_LANE))
    assert result.state == "lost"
    assert result.right is None
    assert result.right_road is None
    assert result.offset_m is None
    radius_m = 1 / result.left_road.curvature_per_m()
    assert radius_m == approx(500 - LANE_WIDTH_M / 2, rel=0.1)


@parametrize("name", ["hls_sobel", "equalized_hsv"])
def test_a_line_that_disappears_is_kept(name):
    follow = finder(name)
    states = [follow.follow(picture(road)).state for road in (LEFT_BEND, HALF_LANE)]
    assert states == ["found", "kept"]


def test_recipe_c_takes_noise_around_a_line_that_disappears_for_it():
    """The rule of its author: the mean of an even band is its middle."""
    follow = finder("best_channel")
    first = follow.follow(picture(HALF_LANE_BEFORE))
    second = follow.follow(picture(HALF_LANE))
    assert second.right_found.binary in ("hue", "lab b")
    assert mean_distance_px(second.right, first.right, 720) < 5


@parametrize(("name", "mask"), [("equalized_hsv", "yellow"), ("best_channel", "lab b")])
def test_yellow_is_yellow_in_video(name, mask):
    """Frames are in RGB order; in BGR order, as in the originals, nothing is yellow."""
    frame = picture(STRAIGHT)
    swapped = np.ascontiguousarray(frame[..., ::-1])
    yellow = np.count_nonzero(finder(name).follow(frame).masks[mask][460:])
    blue = np.count_nonzero(finder(name).follow(swapped).masks[mask][460:])
    assert yellow > 300
    assert blue < 0.02 * yellow


RANDOM = np.random.default_rng(0)
NOISE = RANDOM.integers(0, 256, (720, 1280, 3), np.uint8)
HOSTILE = {
    "black": np.zeros_like(NOISE),
    "white": np.full_like(NOISE, 255),
    "noise": NOISE,
}
# Pictures without a lane in which a recipe still finds two lines: noise exceeds every
# threshold, and a white picture is all "brightest few per cent" to B.
# In metres: A and B start at the two columns next to the centre of the view.
FALSE_WIDTHS = {
    ("hls_sobel", "noise"): 0.3,
    ("equalized_hsv", "noise"): 0.3,
    ("equalized_hsv", "white"): 0.3,
    ("best_channel", "noise"): 2.5,
}


@every_recipe
@parametrize("kind", HOSTILE)
@parametrize("method", ["find", "follow"])
def test_an_image_without_a_lane_is_lost_or_too_narrow(name, kind, method):
    """As in a garage. No recipe has a gate for the width of the lane."""
    result = getattr(finder(name), method)(HOSTILE[kind])
    if (name, kind) in FALSE_WIDTHS:
        assert result.state == "found"
        assert 0 <= result.lane_width_m < FALSE_WIDTHS[name, kind]
    else:
        assert summary(result) == ("lost", [None, None], None, None)


@every_recipe
@parametrize("kind", HOSTILE)
def test_an_image_without_a_lane_does_not_move_a_known_one_far(name, kind):
    follow = finder(name)
    good = follow.follow(picture(LEFT_BEND))
    result = follow.follow(HOSTILE[kind])
    is_false = (name, kind) in FALSE_WIDTHS
    assert result.state == ("found" if is_false else "kept")
    assert result.offset_m == approx(good.offset_m, abs=0.05)
    assert result.curvature_per_m == approx(good.curvature_per_m, abs=5e-4)
    if kind == "black":
        assert summary(result)[1:] == summary(good)[1:]


def test_a_still_is_searched_with_windows_and_then_around_their_line():
    """In recipe C the band of 100 px is wider than the windows of 75 px."""
    still = finder("best_channel")
    line = still.find(picture(LEFT_BEND)).left
    spot_px = still.warp.points_to_image([(np.polyval(line, 650) + 88, 650)])
    u, v = distort_points(spot_px, LENS)[0].round().astype(int)
    image = picture(LEFT_BEND).copy()
    cv2.circle(image, (u, v), 3, (255, 255, 255), -1)

    found = still.find(image).left_found
    u, v = found.pixels.T
    off_px = np.abs(u - np.polyval(line, v))
    assert 80 < off_px.max() < 102
    assert found.windows.shape == (9, 4)


def test_recipe_c_begins_with_gradients_on_the_left_and_red_on_the_right():
    result = finder("best_channel").follow(picture(STRAIGHT))
    assert result.left_found.binary == "gradients"
    assert result.right_found.binary == "red"


def test_recipe_c_takes_lab_b_and_red_while_it_knows_no_line():
    follow = finder("best_channel")
    follow.follow(HOSTILE["black"])
    result = follow.follow(HOSTILE["black"])
    assert result.left_found.binary == "lab b"
    assert result.right_found.binary == "red"


def test_recipe_c_chooses_a_binary_for_each_line():
    """The one whose fit in the band is nearest to the line so far."""
    follow = finder("best_channel")
    first = follow.follow(picture(LaneRoad(1 / 600, 0.0)))
    second = follow.follow(picture(LaneRoad(1 / 600, 0.04)))
    for line_so_far, found in (
        (first.left, second.left_found),
        (first.right, second.right_found),
    ):
        chosen_px = mean_distance_px(found.fit, line_so_far, 720)
        assert chosen_px < 15
        assert found.windows.shape == (0, 4)
    binary = second.warped_binary
    for found in (second.left_found, second.right_found):
        u, v = found.pixels.T
        assert binary[v, u].all()


def test_of_two_equally_near_lines_the_first_one_is_taken():
    result = finder("best_channel").follow(picture(STRAIGHT))
    first = replace(result.left_found, binary="first")
    second = replace(result.left_found, binary="second")
    without_fit = replace(result.left_found, fit=None, binary="none")
    chosen = nearest_line([without_fit, first, second], first.fit + 3.0, 720)
    assert chosen.binary == "first"


def windows_of(result):
    """Whether the left and the right line were searched with windows."""
    return [len(found.windows) > 0 for found in (result.left_found, result.right_found)]


@parametrize(
    ("name", "searched"),
    [
        ("hls_sobel", [True, True]),
        ("equalized_hsv", [True, True]),
        ("best_channel", [False, True]),
    ],
)
def test_after_a_miss_a_and_b_search_both_lines_with_windows_and_c_that_one(
    name, searched
):
    image = picture(HALF_LANE_BEFORE)
    follow = finder(name)
    assert follow.follow(image).state == "found"
    assert windows_of(follow.follow(image)) == [False, False]
    follow.lines[1].update(None)
    assert windows_of(follow.follow(image)) == searched


def test_recipe_b_measures_the_mean_of_twenty_fits_in_metres():
    """And draws the mean of ten."""
    offsets_m = np.linspace(0.2, 0.3, 15)
    follow = finder("equalized_hsv")
    singles_m = []
    for offset_m in offsets_m:
        image = picture(LaneRoad(0.0, offset_m))
        result = follow.follow(image)
        found = [result.left_found.fit, result.right_found.fit]
        roads = [follow.place_on_road(fit) for fit in found]
        singles_m.append(lane_result(*roads).offset_m)
    assert result.offset_m == approx(np.mean(singles_m), abs=1e-6)
    drawn = [follow.place_on_road(line) for line in (result.left, result.right)]
    last_ten_m = np.mean(singles_m[-10:])
    assert lane_result(*drawn).offset_m == approx(last_ten_m, abs=0.002)


def test_recipe_b_measures_a_new_line_alone_after_the_restart():
    follow = finder("equalized_hsv")
    follow.follow(picture(LaneRoad(0.0, 0.5)))
    black = HOSTILE["black"]
    states = [follow.follow(black).state for _ in range(26)]
    assert states[-2:] == ["kept", "lost"]
    again = follow.follow(picture(LaneRoad(0.0, -0.5)))
    assert again.state == "found"
    assert again.offset_m == approx(-0.5, abs=0.03)


@every_recipe
def test_stills_do_not_influence_each_other_nor_a_drive(name):
    fresh = summary(finder(name).find(picture(LEFT_BEND)))
    shared = finder(name)
    once = finder(name)
    shared.follow(picture(STRAIGHT))
    once.follow(picture(STRAIGHT))
    assert summary(shared.find(picture(LEFT_BEND))) == fresh
    still_between = summary(shared.follow(picture(DASHED)))
    assert still_between == summary(once.follow(picture(DASHED)))


@every_recipe
def test_two_finders_of_a_recipe_have_no_common_memory(name):
    recipe = get_recipe(name)
    first = LaneFinder(recipe, LENS, TO_ROAD)
    first.follow(picture(LEFT_BEND))
    second = LaneFinder(recipe, LENS, TO_ROAD)
    black = second.follow(HOSTILE["black"])
    assert black.state == "lost"


NAMES = ("combined", "red", "gradients", "lab b")


def see_nothing(image):
    return dict.fromkeys(NAMES, np.zeros(image.shape[:2], np.uint8))


BLIND = Thresholds(see_nothing, candidates=NAMES)


@every_recipe
@parametrize(
    ("thresholds", "states"),
    [
        ("thresholds", ["lost", "found"]),
        ("video_thresholds", ["found", "lost"]),
    ],
)
def test_stills_and_drives_have_their_own_thresholds(name, thresholds, states):
    recipe = replace(get_recipe(name), **{thresholds: BLIND})
    half_blind = LaneFinder(recipe, LENS, TO_ROAD)
    image = picture(STRAIGHT)
    assert [half_blind.find(image).state, half_blind.follow(image).state] == states


@every_recipe
def test_half_size_pictures_measure_the_same_road(name):
    size = (640, 360)
    small = cv2.resize(picture(LEFT_BEND), size, interpolation=cv2.INTER_AREA)
    result = finder(name, CAMERA.scaled(size)).find(small)
    curvature = 0.25 if name == "equalized_hsv" else 0.12
    offset_m = 0.05 if name == "equalized_hsv" else 0.02
    assert result.state == "found"
    assert result.curvature_per_m == approx(1 / 400, rel=curvature)
    assert result.offset_m == approx(0.3, abs=offset_m)


def test_width_and_height_scale_apart():
    """Pictures of twice the height: columns stay, rows double about the border."""
    recipe = get_recipe("hls_sobel", (1280, 1440))
    u, v = np.array(recipe.source_px).T
    assert u.tolist() == [580, 740, 1100, 270]
    assert v.tolist() == [920.5, 920.5, 1340.5, 1340.5]
    assert recipe.histogram_rows_px == (720, 1440)
    assert (recipe.margin_px, recipe.min_span_px) == (80, 320)
    assert recipe.recentre_pixels == 100
    assert get_recipe("best_channel", (640, 360)).flood_pixels == 2375


def test_measures_need_both_lines_except_the_curvature():
    left = RoadLine(1.7, 0.0, 0.002)
    right = RoadLine(-2.0, 0.0, 0.004)
    both = lane_result(left, right)
    one = lane_result(left, None, "lost")
    none = lane_result(None, None, "lost")
    assert both.curvature_per_m == approx(0.003)
    assert both.offset_m == approx(0.15)
    assert both.lane_width_m == approx(3.7)
    assert (one.curvature_per_m, one.offset_m, one.lane_width_m) == (0.002, None, None)
    assert (none.curvature_per_m, none.offset_m) == (None, None)
    assert none.lateral_m(np.zeros(1)) is None


def test_the_telemetry_has_a_column_for_each_measurement():
    row = lane_result(RoadLine(1.7, 0.0, 0.002), None, "lost").as_row()
    assert (row["state"], row["left_c0_m"]) == ("lost", 1.7)
    assert (row["offset_m"], row["right_c0_m"]) == (None, None)


def test_curvature_and_width_are_measured_across_the_lane():
    assert RoadLine(0.0, 0.75, 0.01).curvature_per_m() == approx(0.01 / 1.25**3)
    heading = 0.1
    half_width_m = 1.85 / np.cos(heading)
    left = RoadLine(half_width_m, np.tan(heading), 0.0)
    right = RoadLine(-half_width_m, np.tan(heading), 0.0)
    assert lane_result(left, right).lane_width_m == approx(3.7)


def test_a_line_that_jumped_is_searched_with_windows_after_a_miss():
    """A metre: outside the band around the line so far, and more than A accepts."""
    follow = finder("hls_sobel")
    follow.follow(picture(LaneRoad(0.0, 0.5)))
    missed = follow.follow(picture(LaneRoad(0.0, -0.5)))
    seen = follow.follow(picture(LaneRoad(0.0, -0.5)))
    assert missed.left_found.fit is None
    assert seen.left_found.fit is not None
    assert (missed.state, seen.state) == ("kept", "kept")


@parametrize(
    ("name", "size", "sentence"),
    [
        (
            "hls",
            (1280, 720),
            "no recipe 'hls'; the recipes are hls_sobel, equalized_hsv",
        ),
        ("hls_sobel", (0, 720), "0x720 pixels is not possible"),
    ],
)
def test_recipes_and_sizes_that_do_not_exist_are_named(name, size, sentence):
    with pytest.raises(ValueError, match=sentence):
        get_recipe(name, size)


def test_images_recipes_and_lenses_that_do_not_fit_are_named():
    turned = np.zeros((1280, 720, 3), np.uint8)
    with pytest.raises(
        ValueError, match="720x1280 pixels, but this lens is for 1280x720"
    ):
        finder("hls_sobel").find(turned)
    small = get_recipe("hls_sobel", (640, 360))
    with pytest.raises(ValueError, match="recipe hls_sobel is for images of 640x360"):
        LaneFinder(small, LENS, TO_ROAD)
    with pytest.raises(ValueError, match="give image_to_road, or metres_per_px"):
        LaneFinder(get_recipe("hls_sobel"), LENS)


def test_the_usual_scales_need_no_pose():
    recipe = get_recipe("hls_sobel")
    scaled = LaneFinder(recipe, LENS, metres_per_px=USUAL_SCALES)
    assert scaled.find(picture(LEFT_BEND)).state == "found"


# Of the embedded camera: by how much an offset is too large and a radius too small. A
# radius is proportional to (metres per row)^2 / metres per column.
SCALE_ERRORS = {
    "hls_sobel": (0.055, 0.278),
    "equalized_hsv": (0.154, 0.377),
    "best_channel": (0.073, 0.315),
}


@every_recipe
def test_the_usual_scales_are_wrong_by_what_the_course_says(name):
    camera = load_camera(ROOT / "test_videos" / "project_video.yaml")
    warp = get_recipe(name).four_point_warp()
    across_m, along_m = metres_per_pixel(warp, image_to_road(camera))
    usual_across_m, usual_along_m = USUAL_SCALES

    offset_share = usual_across_m / across_m - 1
    radius_share = (usual_along_m / along_m) ** 2 / (usual_across_m / across_m)
    errors = (offset_share, 1 - radius_share)
    assert errors == approx(SCALE_ERRORS[name], abs=0.002)


@needs_real_data
def test_recipe_a_gives_its_published_numbers():
    """Calibrated with the real boards. The published numbers have no signs."""
    lens = calibrate(REAL_DATA / "camera_cal")
    recipe = get_recipe("hls_sobel")
    published = LaneFinder(recipe, lens, metres_per_px=USUAL_SCALES)
    result = published.find(read_image(REAL_DATA / "test_images" / "test5.jpg"))
    # the road bends right and the car is right of the centre
    assert 1 / result.left_road.curvature_per_m() == approx(-724.0, rel=0.1)
    assert 1 / result.right_road.curvature_per_m() == approx(-1613.9, rel=0.1)
    assert result.offset_m == approx(-0.170, rel=0.1)


# A setting of a recipe, and another value of it, which changes what is found.
SETTINGS = [
    ("hls_sobel", "source_px", ((570, 460), (750, 460), (1100, 670), (270, 670))),
    ("hls_sobel", "destination_px", ((300, 0), (980, 0), (980, 720), (300, 720))),
    ("hls_sobel", "thresholds", RECIPES["equalized_hsv"].thresholds),
    ("hls_sobel", "video_thresholds", RECIPES["equalized_hsv"].thresholds),
    ("hls_sobel", "margin_px", 20),
    ("hls_sobel", "still_band_px", 5),
    ("hls_sobel", "left_line", Line(1)),
    ("hls_sobel", "right_line", Line(1)),
    ("hls_sobel", "warp_first", False),
    ("hls_sobel", "recentre_pixels", 100_000),
    ("hls_sobel", "min_span_px", 721),
    ("hls_sobel", "search_together", False),
    ("equalized_hsv", "histogram_rows_px", (0, 100)),
    ("equalized_hsv", "measured_fits", None),
    ("best_channel", "flood_pixels", 10),
    ("best_channel", "first_binaries", ("red", "gradients")),
    ("best_channel", "unknown_binaries", ("red", "hue")),
]


def results_with(recipe: Recipe) -> list:
    """Of a still, and of a drive whose right line comes, fades and comes back."""
    still = LaneFinder(recipe, LENS, TO_ROAD).find(picture(LEFT_BEND))
    drive = LaneFinder(recipe, LENS, TO_ROAD)
    roads = (HALF_LANE, LEFT_BEND, STRAIGHT, HALF_LANE, HALF_LANE, DASHED)
    results = [still, *[drive.follow(picture(road)) for road in roads]]
    return [summary(result) for result in results]


@cache
def usual_results(name: str) -> list:
    return results_with(RECIPES[name])


@parametrize(
    ("name", "setting", "value"),
    SETTINGS,
    ids=[f"{one[0]}-{one[1]}" for one in SETTINGS],
)
def test_each_setting_of_a_recipe_changes_a_result(name, setting, value):
    recipe = RECIPES[name]
    other = replace(recipe, **{setting: value})
    assert results_with(other) != usual_results(name)


def test_no_setting_of_a_recipe_is_forgotten():
    """But its name and its size, which is tested with half-size pictures."""
    tested = {setting for _, setting, _ in SETTINGS}
    assert {one.name for one in fields(Recipe)} - tested == {"name", "size"}
