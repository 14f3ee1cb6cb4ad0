"""The three recipes on painted roads with ground truth, defects of their originals, and real stills."""

import re
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from helpers import RECIPES, LaneFinder, Levels, RoadLine, Thresholds, get_recipe
from lanes.errors import CameraError, PictureError
from lanes.video.images import read_image
from tests.support.classic_lane import lane_result
from tests.support.painted_roads import LANE_WIDTH_M, SUNLIT_WHITE, LaneRoad, paint_lane
from tests.support.painted_roads import RECIPE_CAMERA as CAMERA
from tests.support.project import REAL_DATA, ROOT

PUBLISHED_SCALES = (3.7 / 700, 30 / 720)
every_recipe = pytest.mark.parametrize("name", RECIPES)


def finder(name, camera=CAMERA, **options):
    return LaneFinder(get_recipe(name, camera.size), camera, **options)


@cache
def picture(road):
    """Cached for all tests and read-only, because a finder must not modify its input."""
    image = paint_lane(road)
    image.flags.writeable = False
    return image


def summary(result):
    return result.state, result.left, result.right, result.curvature_per_m, result.offset_m


LEFT_BEND = LaneRoad(1 / 400, 0.3)
RIGHT_BEND = LaneRoad(-1 / 400, -0.3)
DASHED = LaneRoad(1 / 600, 0.2, right_dashed=True)
STRAIGHT = LaneRoad(0.0, -0.25)
SHADOW = LaneRoad(-1 / 500, 0.1, shadow_m=(9, 14))
TWO_WHITE = LaneRoad(1 / 700, 0.0, left=SUNLIT_WHITE)
HALF_LANE = LaneRoad(1 / 500, 0.2, right=None)


# Recipe -> largest errors of curvature (relative), offset and width (m). The binaries of two recipes have steps of one
# pixel, which the warp enlarges to about 0.1 m far away.
EXACT = {"hls_sobel": (0.05, 0.015, 0.03), "equalized_hsv": (0.1, 0.03, 0.1), "best_channel": (0.1, 0.03, 0.1)}


@pytest.mark.parametrize(
    ("name", "road"),
    [("hls_sobel", road) for road in (RIGHT_BEND, SHADOW)]
    + [(name, road) for name in RECIPES for road in (LEFT_BEND, DASHED, STRAIGHT, TWO_WHITE)],
    ids=str,
)
def test_recipes_measure_the_truth(name, road):
    result = finder(name).find(picture(road))
    curvature, offset_m, width_m = EXACT[name]
    assert result.state == "found"
    assert result.curvature_per_m == pytest.approx(road.curvature_per_m, rel=curvature, abs=1e-4)
    assert result.offset_m == pytest.approx(road.offset_m, abs=offset_m)
    assert result.lane_width_m == pytest.approx(LANE_WIDTH_M, abs=width_m)


@every_recipe
def test_one_missing_line_leaves_the_other_and_no_lane(name):
    result = finder(name).find(picture(HALF_LANE))
    assert result.state == "lost"
    assert result.right is result.right_road is result.offset_m is None
    follow = finder(name)
    assert [follow.follow(picture(road)).state for road in (LEFT_BEND, HALF_LANE)] == ["found", "kept"]
    assert 1 / result.left_road.curvature_per_m() == pytest.approx(500 - LANE_WIDTH_M / 2, rel=0.1)


@pytest.mark.parametrize(("name", "mask"), [("equalized_hsv", "yellow"), ("best_channel", "lab b")])
def test_yellow_is_yellow_in_video(name, mask):
    """Frames are in RGB order; in BGR order, as in the originals, they have no yellow."""
    frame = picture(STRAIGHT)
    right_order = finder(name).follow(frame).masks[mask][460:]
    swapped = finder(name).follow(np.ascontiguousarray(frame[..., ::-1])).masks[mask][460:]
    assert (right_order > 0).sum() > 1000
    assert (swapped > 0).sum() < 0.02 * (right_order > 0).sum()


NOISE = np.random.default_rng(0).integers(0, 256, (720, 1280, 3), np.uint8)
HOSTILE = {"black": np.zeros_like(NOISE), "white": np.full_like(NOISE, 255), "noise": NOISE}
# Pictures without a lane in which a recipe still finds two lines: noise exceeds every threshold of A and B, and a
# white picture is all "brightest few per cent" to B.
FALSE_LANES = {("hls_sobel", "noise"), ("equalized_hsv", "noise"), ("equalized_hsv", "white")}


@every_recipe
@pytest.mark.parametrize("kind", HOSTILE)
def test_an_image_without_a_lane_is_lost_or_too_narrow_and_does_not_move_a_known_lane_far(name, kind):
    """The first frame of a video, as in a garage, or one later. The recipes have no gate for the lane width."""
    is_false = (name, kind) in FALSE_LANES
    first, still = finder(name).follow(HOSTILE[kind]), finder(name).find(HOSTILE[kind])
    for result in (first, still):
        if is_false:  # both lines start at the two columns next to the centre of the view
            assert (result.state, 0 <= result.lane_width_m < 0.3) == ("found", True)
        else:
            assert summary(result) == ("lost", None, None, None, None)
    follow = finder(name)
    good, result = (follow.follow(image) for image in (picture(LEFT_BEND), HOSTILE[kind]))
    assert result.state == ("found" if is_false else "kept")
    assert result.offset_m == pytest.approx(good.offset_m, abs=0.05)
    assert result.curvature_per_m == pytest.approx(good.curvature_per_m, abs=5e-4)
    assert kind != "black" or summary(result)[1:] == summary(good)[1:]


def test_recipe_c_chooses_a_channel_for_each_line_and_no_noise():
    """A white line has no colour and a yellow one is not bright; noise in the search band is always close to a line."""
    follow = finder("best_channel")
    for offset in (0.0, 0.04, 0.08):
        result = follow.follow(picture(LaneRoad(1 / 600, offset)))
    assert (result.masks["hue"][500:] > 0).mean() > 0.05  # the hue of neutral asphalt is noise over the full range
    assert result.left_found.channel in {*get_recipe("best_channel").video_thresholds.candidates} - {"hue"}
    assert result.right_found.channel in ("red", "luv lightness", "gradients")
    assert all(result.warped_binary[v, u] for found in (result.left_found, result.right_found) for u, v in found.pixels)


@every_recipe
def test_stills_do_not_influence_each_other_nor_a_drive(name):
    """Each has its own thresholds; here those of stills let nothing through in a drive, and the other way around."""
    fresh = summary(finder(name).find(picture(LEFT_BEND)))
    shared, once = finder(name), finder(name)
    for follow in (shared, once):
        follow.follow(picture(STRAIGHT))
    assert summary(shared.find(picture(LEFT_BEND))) == fresh
    assert summary(shared.follow(picture(DASHED))) == summary(once.follow(picture(DASHED)))
    blind = Thresholds({"red": ((Levels("RGB R", 256, 256),),)}, combined=("red",), candidates=("red",))
    for of, states in (("thresholds", ["lost", "found"]), ("video_thresholds", ["found", "lost"])):
        half_blind = LaneFinder(replace(get_recipe(name), **{of: blind}), CAMERA)
        assert [half_blind.find(picture(STRAIGHT)).state, half_blind.follow(picture(STRAIGHT)).state] == states


@every_recipe
def test_half_size_pictures_measure_the_same_road(name):
    size = (640, 360)
    small = cv2.resize(picture(LEFT_BEND), size, interpolation=cv2.INTER_AREA)
    result = finder(name, CAMERA.scaled(size)).find(small)
    assert result.state == "found"
    assert result.curvature_per_m == pytest.approx(1 / 400, rel=0.12 if name != "equalized_hsv" else 0.25)
    assert result.offset_m == pytest.approx(0.3, abs=0.02 if name != "equalized_hsv" else 0.05)


def test_width_and_height_scale_apart():
    """A recipe for pictures of twice the height: columns are unchanged, rows are doubled about the border."""
    recipe = get_recipe("hls_sobel", (1280, 1440))
    u, v = np.array(recipe.source_px).T
    assert u.tolist() == [580, 740, 1100, 270]
    assert v.tolist() == [920.5, 920.5, 1340.5, 1340.5]
    assert recipe.histogram_rows_px == (720, 1440)
    assert (recipe.margin_px, recipe.min_span_px, recipe.recentre_pixels) == (80, 320, 100)


def test_helpers_uses_of_lanes_only_the_camera_files_images_texts_and_drawing():
    """import-linter sees packages only. Finding lanes by the engine would be no classic pipeline."""
    text = (ROOT / "helpers.py").read_text(encoding="utf-8")
    modules = set(re.findall(r"^(?:from|import) (lanes[\w.]*)", text, re.M))
    allowed = {"calibration", "camera", "canvas", "describe", "errors", "images", "video.reader", "video.writer"}
    assert modules - {"lanes"} == {f"lanes.{name}" for name in allowed - {"canvas"}}
    assert re.findall(r"^from lanes import (.*)", text, re.M) == ["canvas"]


def test_measures_need_both_lines_except_the_curvature():
    left, right = RoadLine(1.7, 0.0, 0.002), RoadLine(-2.0, 0.0, 0.004)
    both, one, none = lane_result(left, right), lane_result(left, None, "lost"), lane_result(None, None, "lost")
    assert (both.curvature_per_m, both.offset_m, both.lane_width_m) == pytest.approx((0.003, 0.15, 3.7))
    assert (one.curvature_per_m, one.offset_m, one.lane_width_m) == (0.002, None, None)
    assert (none.curvature_per_m, none.offset_m, none.lateral_m(np.zeros(1))) == (None, None, None)
    row = one.as_row()
    assert (row["state"], row["left_c0_m"], row["offset_m"], row["right_c0_m"]) == ("lost", 1.7, None, None)
    # curvature and width are measured across the lane
    assert RoadLine(0.0, 0.75, 0.01).curvature_per_m() == pytest.approx(0.01 / 1.25**3)
    heading = 0.1
    left, right = (RoadLine(side * 1.85 / np.cos(heading), np.tan(heading), 0.0) for side in (1, -1))
    assert lane_result(left, right).lane_width_m == pytest.approx(3.7)


def test_a_line_that_jumped_is_searched_with_windows_after_a_miss():
    """A metre: outside the band around the line so far, and more than the gate accepts."""
    follow = finder("hls_sobel")
    _, missed, seen = (follow.follow(picture(LaneRoad(0.0, offset_m))) for offset_m in (0.5, -0.5, -0.5))
    assert missed.left_found.fit is None and seen.left_found.fit is not None
    assert (missed.state, seen.state) == ("kept", "kept")


def test_recipes_sizes_and_cameras_that_do_not_fit_are_named():
    with pytest.raises(ValueError, match="no recipe 'hls'; the recipes are hls_sobel, equalized_hsv, best_channel"):
        get_recipe("hls")
    with pytest.raises(ValueError, match="0x720 pixels is not valid"):
        get_recipe("hls_sobel", (0, 720))
    with pytest.raises(PictureError, match="720x1280 pixels, but the camera was calibrated for 1280x720"):
        finder("hls_sobel").find(np.zeros((1280, 720, 3), np.uint8))
    with pytest.raises(CameraError, match="recipe hls_sobel is for 640x360 pictures"):
        LaneFinder(get_recipe("hls_sobel", (640, 360)), CAMERA)
    without_pose = replace(CAMERA, pose=None)
    with pytest.raises(CameraError, match="has no pose .* or give metres_per_px"):
        finder("hls_sobel", without_pose)
    scaled = finder("hls_sobel", without_pose, metres_per_px=PUBLISHED_SCALES)
    assert scaled.find(picture(LEFT_BEND)).state == "found"


@pytest.mark.skipif(not (REAL_DATA / "test_images").is_dir(), reason="needs the real stills in the folder LANES_DATA")
def test_recipe_a_gives_its_published_numbers():
    """With a lens near the one that the real boards give. The published numbers have no signs."""
    image = read_image(REAL_DATA / "test_images" / "test5.jpg")
    result = finder("hls_sobel", metres_per_px=PUBLISHED_SCALES).find(image)
    # The road bends right and the car is right of the centre.
    assert 1 / result.left_road.curvature_per_m() == pytest.approx(-724, rel=0.1)
    assert 1 / result.right_road.curvature_per_m() == pytest.approx(-1614, rel=0.1)
    assert result.offset_m == pytest.approx(-0.170, rel=0.1)
