"""Rendered frames: anti-aliased paint against brute force, truth against the picture, determinism."""

from __future__ import annotations

import multiprocessing
import re
from contextlib import closing
from dataclasses import replace

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from benchmark.dataset import PROJECT_ROOT
from lanes.camera.camera import Camera
from lanes.camera.camera_file import load_camera
from lanes.camera.camera_pose import CameraPose
from lanes.io.images import read_image
from simulator.landscape.sky import BackdropStyle
from simulator.light.lens import REFERENCE_LUMINANCE, Lens, develop
from simulator.light.sunlight import BridgeShade, Sun
from simulator.objects.placement import PlacedObject
from simulator.objects.scene_objects import Car
from simulator.rendering.drive import Drive, Motion
from simulator.rendering.render import render_frame
from simulator.rendering.video import VIDEO_FPS, write_video
from simulator.road.geometry import RoadGeometry, VehiclePose, line_polynomial
from simulator.road.ground import cast_on_ground, dash_coverage, edge_coverage, pixel_rays
from simulator.road.painted_lines import WHITE, Marking, paint_coverage, paint_markings
from simulator.road.road_ahead import RoadAhead
from simulator.road.surface import Zone, ground_albedo
from simulator.road.truth import H_SAMPLES, line_pixels, truth_entry, truth_row
from simulator.scenes.dashcam import DASHCAM
from simulator.scenes.freeway import LANE_WIDTH_M, freeway_markings, freeway_surface
from simulator.scenes.stills import project_video, still_scenes
from tests.support.command_line import main

POSE = CameraPose(1.3, np.radians(2.0), np.radians(-1.0), np.radians(0.6))
TINY = replace(DASHCAM.scaled((320, 180)), pose=POSE)
SMALL = replace(DASHCAM.scaled((640, 360)), pose=POSE)
PLAIN_LENS = Lens(noise=0.0, sharpening=0.0, blur_px=0.0, vignette=0.0, adaptation=0.0)


def small_drive(curvature: float = 1 / 250, **changes) -> Drive:
    """An off-centre car in a bend, small picture, no noise: cheap, and nothing cancels."""
    road = RoadGeometry([0.0, 40.0, 300.0, 340.0], [0.0, curvature, curvature, 0.0])
    base = Drive(
        camera=SMALL,
        road=road,
        line_laterals_m=(LANE_WIDTH_M / 2, -LANE_WIDTH_M / 2),
        markings=tuple(replace(m, wear=0.0, dots=False) for m in freeway_markings()),
        surface=freeway_surface(Zone(0.0, "fresh asphalt")),
        sun=Sun(1.0, 0.9),
        motion=Motion(60.0, offset_m=0.3, heading_rad=0.01),
        lens=PLAIN_LENS,
        # Woods take seconds to grow.
        backdrop=BackdropStyle(tree_density=0.0),
        bonnet=False,
        seed=5,
    )
    return replace(base, **changes)


@pytest.mark.parametrize(("a", "b"), [(1.0, 0.3), (0.2, 0.9), (0.5, 0.5), (0.7, 0.0)])
def test_edge_coverage_is_the_area_of_a_pixel_behind_an_edge(a, b):
    side = (np.arange(400) + 0.5) / 400 - 0.5
    u, v = np.meshgrid(side, side)
    for t in (-0.6, -0.31, 0.0, 0.17, 0.45):
        brute = (t + a * u + b * v > 0).mean()
        assert edge_coverage(np.float32(t), np.float32(a), np.float32(-b)) == pytest.approx(brute, abs=4e-3)


def test_dash_coverage_is_the_share_of_paint_in_the_footprint():
    s, reach = np.linspace(-5, 40, 97, dtype=np.float32), np.float32(2.7)
    fine = s[:, None] + np.linspace(-reach / 2, reach / 2, 4001)
    brute = (fine % 12.2 < 3.05).mean(axis=1)
    np.testing.assert_allclose(dash_coverage(s, np.full_like(s, reach), 3.05, 12.2), brute, atol=2e-3)


@pytest.mark.parametrize(("dashed", "worst", "mean"), [(False, 0.02, 5e-4), (True, 0.3, 2e-3)])
def test_paint_coverage_equals_brute_force_supersampling(dashed, worst, mean):
    """Exact along a line; only where a dash ends within a pixel on the line's edge is it an approximation."""
    road, pose = RoadGeometry([0.0, 300.0], [1 / 300, 1 / 300]), VehiclePose(50.0, 0.3, 0.01)
    marking = Marking(-1.8, 0.12, WHITE, dashed=dashed, phase_m=1.0)
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, RoadAhead(road, pose))
    pixels, coverage = paint_coverage(marking, ground, station_m=50.0)
    picture = np.zeros(ground.s.shape, np.float32)
    picture.ravel()[pixels] = coverage
    # Seventeen by seventeen rays in each of the pixels of a window with the line from 15 m to 40 m ahead.
    rows, columns, n = np.arange(197, 232), np.arange(335, 425), 17
    inner = (np.arange(n) + 0.5) / n - 0.5
    v, u = np.meshgrid((rows[:, None] + inner).ravel(), (columns[:, None] + inner).ravel(), indexing="ij")
    points = SMALL.pixels_to_road(np.column_stack([u.ravel(), v.ravel()])).astype(np.float32)
    s, d = RoadAhead(road, pose).locate(points[:, 0], points[:, 1])
    painted = (np.abs(d + 1.8) < 0.06) & (((s + 49.0) % 12.2 < 3.05) | (not dashed))
    brute = painted.reshape(len(rows), n, len(columns), n).mean(axis=(1, 3))
    got = picture[rows[0] - ground.top : rows[-1] + 1 - ground.top, columns]
    assert brute.max() == 1.0
    assert np.abs(got - brute).mean() < mean
    assert np.abs(got - brute).max() < worst


def stripes_at(markings: tuple[Marking, ...], x_m: float) -> list[tuple[float, float]]:
    """(centre, width) in metres of the stripes that a row of the picture crosses `x_m` ahead, from left to right."""
    camera = replace(DASHCAM, pose=POSE)
    ground = cast_on_ground(
        pixel_rays(camera), camera, RoadAhead(RoadGeometry([0.0, 300.0], [0.0, 0.0]), VehiclePose(50.0))
    )
    black = np.zeros((*ground.s.shape, 3), np.float32)
    paint_markings(black, markings, ground, station_m=50.0, seed=1)
    row = round(float(camera.road_to_pixels(np.array([[x_m, markings[0].lateral_m]]))[0, 1])) - ground.top
    paint, d, step = black[row, :, 0], ground.d[row], np.abs(ground.d_u[row])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], paint > 0.02, [0]]).astype(int))).reshape(-1, 2)
    runs = [slice(a, b) for a, b in edges]
    return [(float(np.average(d[run], weights=paint[run])), float((paint * step)[run].sum())) for run in runs]


@pytest.mark.parametrize(("width_m", "gap_m"), [(0.12, 0.10), (0.10, 0.20)])
@pytest.mark.parametrize("x_m", [7.0, 14.0])
def test_double_line_is_two_stripes_of_the_right_width_with_the_right_gap(width_m, gap_m, x_m):
    (left, left_width), (right, right_width) = stripes_at((Marking(1.8, width_m, double_gap_m=gap_m, wear=0.0),), x_m)
    assert (left_width, right_width) == pytest.approx((width_m, width_m), rel=0.03)
    assert left - right - width_m == pytest.approx(gap_m, abs=0.004)
    assert (left + right) / 2 == pytest.approx(1.8, abs=0.003)


def test_double_line_that_one_side_may_cross_is_a_solid_and_a_broken_marking():
    """A dash from 6 m to 9.05 m ahead, then 9.15 m of gap, on the right-hand side only."""
    solid, broken = Marking(1.91, wear=0.0), Marking(1.69, dashed=True, phase_m=56.0, wear=0.0)
    assert [d for d, _ in stripes_at((solid, broken), 7.5)] == pytest.approx([1.91, 1.69], abs=0.003)
    assert [d for d, _ in stripes_at((solid, broken), 13.0)] == pytest.approx([1.91], abs=0.003)
    assert [w for _, w in stripes_at((solid, broken), 7.5)] == pytest.approx([0.12, 0.12], rel=0.03)
    # Both stripes of one double marking are broken together.
    both = (Marking(1.8, dashed=True, phase_m=56.0, double_gap_m=0.1, wear=0.0),)
    assert len(stripes_at(both, 7.5)) == 2 and stripes_at(both, 13.0) == []


@pytest.mark.parametrize("curvature", [1 / 250, -1 / 250])
def test_truth_lies_on_the_paint_of_the_picture(curvature):
    drive = small_drive(curvature)
    camera = replace(DASHCAM, pose=POSE)
    drive = replace(
        drive,
        camera=camera,
        markings=(Marking(LANE_WIDTH_M / 2, 0.15, WHITE, wear=0.0), Marking(-LANE_WIDTH_M / 2, 0.15, WHITE, wear=0.0)),
    )
    frame = render_frame(drive)
    light = frame.image[..., 2].astype(float)
    errors = []
    for side in (0, 1):
        for row, u in zip(H_SAMPLES, line_pixels(frame.truth, side, camera), strict=True):
            if u > 50 and row > 440 and u < camera.width - 50:
                at = np.arange(round(u) - 45, round(u) + 46)
                weight = np.clip(light[row, at] - 120, 0, None)
                errors.append((weight * at).sum() / weight.sum() - u)
    assert len(errors) > 30
    assert np.abs(errors).max() < 0.35
    assert abs(np.mean(errors)) < 0.1


def test_truth_agrees_with_itself():
    truth = small_drive().truth(0.5)
    row = truth_row(truth, frame=3)
    assert row["offset_m"] == pytest.approx(0.3)
    assert row["heading_rad"] == pytest.approx(-0.01)
    assert row["left_c0_m"] - row["right_c0_m"] == pytest.approx(row["lane_width_m"], rel=1e-3)
    assert row["left_c1"] == pytest.approx(np.tan(row["heading_rad"]), abs=2e-4)
    x = 5.0
    cubic = row["left_c0_m"] + row["left_c1"] * x + row["left_c2_per_m"] * x**2 / 2 + row["left_c3_per_m2"] * x**3 / 6
    assert row["left_y05_m"] == pytest.approx(cubic, abs=1e-3)


def test_heading_follows_from_wander():
    motion = Motion(0.0, 25.0, 0.1, wander_m=0.3, wander_period_s=6.0)
    before, now, after = (motion.pose(t) for t in (1.99, 2.0, 2.01))
    slope = (after.lateral_m - before.lateral_m) / (after.s_m - before.s_m)
    assert now.heading_rad == pytest.approx(np.arctan(slope), abs=1e-6)


def test_same_seed_same_picture_other_seed_another():
    drive = small_drive(lens=Lens())
    first, again = render_frame(drive, 0.2), render_frame(drive, 0.2)
    assert np.array_equal(first.image, again.image)
    road = RoadAhead(drive.road, drive.motion.pose(0.2))
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, road)
    one, other = (ground_albedo(drive.surface, ground, station_m=60.0, seed=seed) for seed in (5, 6))
    assert not np.array_equal(one, other)


def test_hidden_ground_may_be_left_unpainted_but_what_is_wanted_is_the_same():
    drive = small_drive()
    ground = cast_on_ground(pixel_rays(SMALL), SMALL, RoadAhead(drive.road, drive.motion.pose(0.2)))
    needed = np.random.default_rng(1).random(ground.s.shape) < 0.5
    whole = ground_albedo(drive.surface, ground, station_m=60.0, seed=5)
    part = ground_albedo(drive.surface, ground, station_m=60.0, seed=5, needed=needed)
    np.testing.assert_array_equal(part[needed], whole[needed])
    assert (part[~needed] != whole[~needed]).any(axis=-1).mean() > 0.2


def test_mirrored_scene_gives_mirrored_lines():
    """Mirror road, car, paint and camera: the columns of the lines mirror too."""
    drive = small_drive()
    flipped_matrix = SMALL.matrix.copy()
    flipped_matrix[0, 2] = SMALL.width - 1 - SMALL.matrix[0, 2]
    distortion = SMALL.distortion * [1, 1, 1, -1, 1]
    pose = replace(POSE, yaw_rad=-POSE.yaw_rad, roll_rad=-POSE.roll_rad)
    camera = Camera(SMALL.width, SMALL.height, flipped_matrix, distortion, pose)
    mirrored = replace(
        drive,
        camera=camera,
        road=drive.road.mirrored(),
        motion=replace(drive.motion, offset_m=-0.3, heading_rad=-0.01),
        markings=tuple(m.mirrored() for m in drive.markings),
        surface=drive.surface.mirrored(),
    )
    assert mirrored.truth().offset_m == -drive.truth().offset_m
    ours = (render_frame(drive).image[..., 2] > 180)[200:]
    theirs = (render_frame(mirrored).image[..., 2] > 180)[200:, ::-1]
    assert ours.sum() > 300
    assert (ours != theirs).mean() < 2e-3


def test_pitch_moves_the_horizon():
    """Nodding changes the truth's pitch and where the line is seen, not where it is."""
    drive = small_drive(motion=Motion(60.0, 20.0, 0.3, pitch_rad=0.01, pitch_period_s=1.0))
    still, camera_at_pitch = drive.truth(0.0), drive.truth(0.25)
    assert abs(camera_at_pitch.pitch_rad - POSE.pitch_rad) > 0.003
    assert camera_at_pitch.pitch_rad != still.pitch_rad
    assert line_polynomial(drive.road, camera_at_pitch.pose, 1.83) == camera_at_pitch.left


def test_committed_still_is_rendered_again():
    committed = read_image(PROJECT_ROOT / "test_images" / "test2.jpg").astype(int)
    again = render_frame(still_scenes()["test2"]).image.astype(int)
    # JPEG at quality 92 moves texture by a few levels; another scene by dozens.
    assert np.abs(committed - again).mean() < 2.5


def test_project_video_bends_both_ways():
    drive = project_video()
    truths = [drive.truth(i / VIDEO_FPS) for i in range(250)]
    radii = 1 / np.array([t.curvature_per_m for t in truths if t.curvature_per_m])
    assert truths[0].curvature_per_m == 0
    assert 350 < radii[radii > 0].min() < 600
    assert -450 < radii[radii < 0].max() < -350
    assert np.ptp([t.offset_m for t in truths]) > 0.2


def test_car_hides_the_line_behind_it():
    item = PlacedObject(60.0 + 12.5, LANE_WIDTH_M / 2, Car(0, 0, 0.0, "red"))
    drive = small_drive(0.0, camera=replace(DASHCAM, pose=POSE))
    open_road, behind = (
        truth_entry(frame.truth, raw_file="x.jpg", camera=drive.camera, hidden=frame.hidden)
        for frame in (render_frame(drive), render_frame(replace(drive, objects=(item,))))
    )
    left_open, left_hidden = (np.array(entry["lanes"][0]) for entry in (open_road, behind))
    hidden = (left_open >= 0) & (left_hidden < 0)
    assert 4 < hidden.sum() < 12
    # The nearest part is before the car, and the other line is free.
    assert not hidden[left_open >= 0][-5:].any()
    assert open_road["lanes"][1] == behind["lanes"][1]


def test_bridge_darkens_its_stretch_of_road_and_no_other():
    drive = small_drive(0.0, motion=Motion(100.0))
    shaded = replace(drive, shades=(BridgeShade(110.0, 120.0),))
    ratio = render_frame(shaded).image.astype(float) / np.maximum(render_frame(drive).image, 1)
    under, before, beyond = SMALL.road_to_pixels(np.array([[15.0, 0.5], [7.0, 0.5], [30.0, 0.5]])).round().astype(int)
    assert ratio[under[1], under[0]].max() < 0.6
    assert ratio[before[1], before[0]].min() > 0.9
    assert ratio[beyond[1], beyond[0]].min() > 0.9


def test_light_concrete_is_brighter_than_asphalt_but_darker_than_paint():
    levels = []
    for material in ("fresh asphalt", "asphalt", "old asphalt", "concrete"):
        surface = freeway_surface(Zone(0.0, material))
        image = render_frame(small_drive(0.0, surface=surface, lens=Lens(noise=0.0))).image
        levels.append(np.median(image[270:320, 250:420]))
    assert levels == sorted(levels)
    assert 60 < levels[0] < 85
    assert 155 < levels[3] < 190


def test_video_and_its_truth_do_not_depend_on_the_number_of_processes(tmp_path):
    drive = small_drive(motion=Motion(60.0, 20.0), camera=TINY)
    calls = []
    for workers in (1, 2):
        video, csv_file, camera_file = write_video(
            tmp_path / f"{workers}.mp4",
            drive=drive,
            seconds=0.28,
            progress=lambda done, total: calls.append((done, total)),
            workers=workers,
        )
    assert calls == 2 * [(number, 7) for number in range(1, 8)]
    for suffix in (".mp4", ".csv", ".yaml"):
        assert (tmp_path / f"1{suffix}").read_bytes() == (tmp_path / f"2{suffix}").read_bytes()
    rows = csv_file.read_text().splitlines()[1:]
    assert [int(row.split(",")[0]) for row in rows] == list(range(7))
    assert load_camera(camera_file).pose == POSE
    with closing(imageio_ffmpeg.read_frames(str(video))) as frames:
        size = next(frames)["size"]
        pictures = [np.frombuffer(frame, np.uint8).reshape(*size[::-1], 3).astype(float) for frame in frames]
    assert len(pictures) == 7
    # Every picture is the one of its own moment, not of a neighbour's.
    rendered = [render_frame(drive, number / VIDEO_FPS).image for number in range(7)]
    nearest = [np.argmin([np.abs(picture - other).mean() for other in rendered]) for picture in pictures]
    assert nearest == list(range(7))


@pytest.mark.parametrize("workers", [1, 2])
def test_interrupted_video_leaves_nothing(tmp_path, workers):
    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(
            tmp_path / "a.mp4", drive=small_drive(camera=TINY), seconds=0.2, progress=interrupt, workers=workers
        )
    assert list(tmp_path.iterdir()) == []
    assert multiprocessing.active_children() == []


def test_an_unwritable_folder_is_named(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["simulator", "--out", str(tmp_path / "file")]) == 1
    assert re.search(r"file: cannot be written .*; choose another folder", capsys.readouterr().err)


def test_refuses_a_sun_below_the_horizon():
    with pytest.raises(ValueError, match="-0.1"):
        BackdropStyle(sun_elevation_rad=-0.1)


def test_a_camera_that_keeps_colour_coarsely_spreads_it_and_nothing_else():
    light = np.full((60, 80, 3), 0.2, np.float32)
    light[:, 38:42] = (0.5, 0.3, 0.05)
    crisp, coarse = (
        develop(light, replace(PLAIN_LENS, chroma_blur_px=blur), road_light=REFERENCE_LUMINANCE, seed=0)
        for blur in (0.0, 4.0)
    )
    luma, yellow = (
        [cv2.cvtColor(i, cv2.COLOR_RGB2YCrCb)[30, :, k].astype(int) for i in (crisp, coarse)] for k in (0, 2)
    )
    assert np.abs(luma[0] - luma[1]).max() <= 1
    assert yellow[0][36] == 128 > yellow[1][34] + 5  # spread over what was grey
    assert yellow[1][40] > yellow[0][40] + 15  # and paler itself
    assert abs(yellow[1][5] - 128) <= 1
