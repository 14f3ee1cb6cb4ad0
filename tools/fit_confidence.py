"""Fit the weights of `lanes.detect.confidence` by logistic regression on drives with known truth.

    python -m tools.fit_confidence           fits; prints the weights and their calibration
    python -m tools.fit_confidence --real FOLDER   corrects RENDERED_WEIGHTS on labelled real roads, see
                                             benchmark.real_roads; prints weights fitted without each set in turn
    python -m tools.fit_confidence --check   prints the calibration of the present weights on other roads
    python -m tools.fit_confidence --markings model.onnx   prints `confidence_shift` for the YAML file of a network

The drives are painted roads, on which paint, light, motion and pose errors are random, and the scenes of the suite,
which add what paint on a plane cannot show: crests, hairpins, weather, traffic, and roads without a lane. Missing ones
are rendered, which takes some minutes. Images without a road are added (rooms, maps, tiles), and images of flat scenes
that are taken with random cameras, whose pose is estimated from the same image; correct means there: right in the
image. One set of weights is fitted to all lanes.
Calibration is measured by cross-validation: on scenes that were not part of the fit.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmark.bootstrap import mean_interval
from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import AHEAD_M, DriveEstimates
from benchmark.evaluation import read_truth
from benchmark.real_roads import WAYS, read_road_sets, score_set
from benchmark.scored_drive import BenchmarkDrive, drive_from_video
from benchmark.systems import lane_estimate
from lanes.camera import Camera, load_camera
from lanes.console import bounded
from lanes.detect.confidence import CORRECT_WITHIN_M, WEIGHTS, lane_features
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings, load_markings
from lanes.stills import find_lane
from lanes.track.tracker import LaneTracker, TrackerSettings
from lanes.video.reader import inspect_video, read_video
from simulator.not_roads import KINDS, not_a_road
from simulator.painted_drive import CAMERA, DASH_M, TAR, WORN_WHITE, WORN_YELLOW, PaintedDrive, Stripe
from simulator.processes import run_all
from simulator.rendering.drive import Motion
from simulator.road.geometry import RoadGeometry
from simulator.road.truth import truth_row
from simulator.scenes.suite import SUITE, render_scene
from tools.photos import Photo, find_with_own_pose, flat_scenes, right_in_picture, take_photo

DRIVES, SECONDS, FPS = 60, 3.0, 12.5
# Every fourth frame is also detected without the tracker.
STILL_EVERY = 4
RIDGE = 1.0
# The same for the correction of the present weights on real roads, chosen among 5, 8 and 14.
REAL_RIDGE = 14.0
# What is corrected: the weights that rendered and painted roads alone give.
RENDERED_WEIGHTS = (-4.53, -2.67, 5.72, -0.91, -4.73, -3.91, 0.93, 1.28)
# A set counts as this number of independent images at most, an image without a road as 6. A lane of a painted drive
# counts little: it keeps what labelled images say nothing about, since their lanes are right or wrong in pixels.
SET_IMAGES, NO_ROAD_WEIGHT, PAINTED_WEIGHT = 12, 6.0, 0.03
# Frames of one drive are correlated: together they count as this number of independent ones.
EFFECTIVE_FRAMES = 25.0
# Number of parts of the cross-validation; a drive is in one part only.
FOLDS = 12
# Variants of each scene of the suite.
SEEDS = (1,)
# Factors of brightness of the stills, and the weight of those that are not 1.
BRIGHTNESSES, OTHER_BRIGHTNESS_WEIGHT = (1.0, 0.5, 1.5), 0.5
# Pictures without a road, of each kind, and the frames for which each is shown.
NO_ROADS, NO_ROAD_FRAMES = 8, 12
# Painted drives with a wrong camera pose, their first seed, and their weight: few users have one.
WRONG_POSES, WRONG_POSE_SEED, WRONG_POSE_WEIGHT = 36, 200, 0.2
# Photos of each flat scene, and pictures of each kind without a road, whose camera pose is their own; for each seed.
PHOTOS, OWN_POSE_NO_ROADS, PHOTO_SEEDS, PHOTO_CHECK_SEEDS = 12, 16, (0, 1), (2,)
# Weight of the latter: few of them have a pose, and users do try them.
OWN_POSE_NO_ROAD_WEIGHT = 8.0
# Samples are of these kinds, in this order.
KINDS_OF_LANES = "tracked", "still", "own pose"


def draw_road(rng: np.random.Generator) -> tuple[RoadGeometry, float]:
    """A random road and its speed: motorway, country road or mountain road."""
    tightest, knot_m, speed_mps = ((400, 80, 28.0), (150, 45, 18.0), (45, 22, 10.0))[rng.choice(3, p=(0.6, 0.25, 0.15))]
    bends = np.round(rng.uniform(-1, 1, 60)) * rng.uniform(0.3, 1.0, 60) / tightest
    curvatures = np.repeat(bends, 2)
    return RoadGeometry(np.arange(len(curvatures)) * float(knot_m), curvatures), speed_mps


def draw_line(rng: np.random.Generator, lateral_m: float) -> Stripe:
    """A random lane line of any usual paint, sometimes worn, sometimes missing for a while."""
    gone = (np.inf, np.inf)
    if rng.random() < 0.3:
        start = rng.uniform(0, SECONDS)
        gone = (start, start + rng.uniform(0.5, 3))
    colour = WORN_YELLOW if rng.random() < 0.3 else WORN_WHITE
    dash = (None, DASH_M, (3.0, 9.0), (6.0, 18.0))[rng.choice(4, p=(0.4, 0.4, 0.1, 0.1))]
    wear = rng.choice([1.0, 0.5, 0.25], p=[0.6, 0.25, 0.15])
    colour = tuple(int(98 + wear * (c - 98)) for c in colour)
    return Stripe(lateral_m, rng.uniform(0.1, 0.2), colour, dash, rng.uniform(0, 12), gone)


def draw_clutter(rng: np.random.Generator, half_m: float) -> tuple[Stripe, ...]:
    """Random objects similar to lane lines: seams, cracks, kerbs, lines of other lanes."""
    things = [draw_line(rng, side * half_m * 3) for side in (1, -1) if rng.random() < 0.6]
    for _ in range(rng.poisson(0.7)):
        things.append(Stripe(rng.uniform(-3, 3), rng.uniform(0.04, 0.2), TAR))
    for _ in range(rng.poisson(0.4)):
        bright = tuple([int(rng.uniform(110, 170))] * 3)
        start = rng.uniform(0, 80)
        things.append(Stripe(rng.uniform(-4, 4), rng.uniform(0.05, 0.3), bright, along_m=(start, start + 60)))
    if rng.random() < 0.3:
        side = rng.choice([-1, 1])
        things.append(Stripe(side * rng.uniform(3, 6), rng.uniform(0.2, 1.5), (150, 150, 148)))
    return tuple(things)


def draw_drive(seed: int, camera: Camera = CAMERA) -> tuple[PaintedDrive, Camera]:
    """A random drive, and its camera with a random pose error."""
    rng = np.random.default_rng(seed)
    road, speed_mps = draw_road(rng)
    half_m = rng.uniform(1.5, 1.9)
    shades = [Stripe(0, 12, along_m=(a, a + rng.uniform(3, 25))) for a in rng.uniform(0, 120, rng.poisson(1.0))]
    drive = PaintedDrive(
        road,
        (draw_line(rng, half_m), draw_line(rng, -half_m)),
        motion=Motion(
            start_m=rng.uniform(0, 200),
            speed_mps=speed_mps,
            offset_m=rng.normal(0, 0.25),
            wander_m=rng.uniform(0, 0.3),
            wander_period_s=6.5,
            pitch_rad=abs(rng.normal(0, 0.004)),
        ),
        lane_m=(half_m, -half_m),
        ground=draw_clutter(rng, half_m),
        shades=tuple(shades),
        noise=rng.uniform(1.5, 8),
        black_s=(2.0, 2.3) if rng.random() < 0.1 else (np.inf, np.inf),
        camera=camera,
        seed=seed,
    )
    pose = camera.pose
    inexact_pose = replace(
        pose,
        height_m=pose.height_m * (1 + rng.normal(0, 0.01)),
        pitch_rad=pose.pitch_rad + rng.normal(0, 0.002),
        yaw_rad=pose.yaw_rad + rng.normal(0, 0.002),
    )
    return drive, camera.with_pose(inexact_pose)


def wrong_pose(camera: Camera, seed: int) -> Camera:
    """The camera with a pitch or yaw that is wrong by 2 to 4 degrees, or a height wrong by a quarter or a half.

    From half of the height two lanes look like one.
    """
    rng, pose = np.random.default_rng(seed), camera.require_pose()
    angle = np.radians(rng.uniform(2, 4)) * rng.choice([-1, 1])
    poses = (
        replace(pose, pitch_rad=pose.pitch_rad + angle),
        replace(pose, yaw_rad=pose.yaw_rad + angle),
        replace(pose, height_m=pose.height_m * (1 + 0.25 * np.sign(angle))),
        replace(pose, height_m=pose.height_m * 0.5),
    )
    return camera.with_pose(poses[rng.integers(len(poses))])


def samples_of_painted_drive(
    seed: int,
    camera: Camera = CAMERA,
    *,
    seconds: float = SECONDS,
    fps: float = FPS,
    pose_is_wrong: bool = False,
    markings: Markings | None = None,
) -> tuple[list, list]:
    """Samples of a painted drive with this seed, see `label_lanes`; those with a wrong pose have a smaller weight."""
    drive, camera = draw_drive(seed, camera)
    times = np.arange(int(seconds * fps)) / fps
    rows = [truth_row(drive.truth(time_s), frame=0) for time_s in times]
    truth = LaneTruth.from_columns({name: np.array([row[name] for row in rows], float) for name in rows[0]})
    camera, weight = (wrong_pose(camera, seed), WRONG_POSE_WEIGHT) if pose_is_wrong else (camera, 1.0)
    frames = map(drive.frame, times)
    return label_lanes(frames, camera, truth, fps=fps, number=seed, weight=weight, markings=markings)


def samples_of_no_road(kind: str, seed: int, number: int, *, markings: Markings | None = None) -> tuple[list, list]:
    """Samples of a picture without a road, see `label_lanes`."""
    shapes = ((2, len(AHEAD_M)), (2,), (), (), (), ())
    truth = LaneTruth(*(np.full((NO_ROAD_FRAMES, *shape), np.nan) for shape in shapes))
    frames = [not_a_road(kind, seed)] * NO_ROAD_FRAMES
    return label_lanes(frames, CAMERA, truth, fps=FPS, number=number, markings=markings)


def samples_of_video(drive: BenchmarkDrive, number: int, *, markings: Markings | None = None) -> tuple[list, list]:
    """Samples of a drive of the suite, see `label_lanes`."""
    camera, fps = load_camera(drive.video.with_suffix(".yaml")), inspect_video(drive.video).fps
    truth, options = read_truth(drive), {"brightnesses": BRIGHTNESSES, "markings": markings}
    return label_lanes(read_video(drive.video), camera, truth, fps=fps, number=number, **options)


def samples_of_photos(seed: int) -> list[list[float]]:
    """Samples (*features, correct, weight, number) of lanes whose camera pose is estimated from the same picture."""
    rows = []
    for number, scene in enumerate(flat_scenes()):
        rng = np.random.default_rng([seed, number])
        for _ in range(PHOTOS):
            photo = take_photo(scene, rng)
            rows += _label_photo(photo.frame.image, photo, number)
    for number, kind in enumerate(KINDS):
        for picture in range(OWN_POSE_NO_ROADS):
            rows += _label_photo(not_a_road(kind, 1000 * seed + picture), None, -1 - number)
    return rows


def _label_photo(image: np.ndarray, photo: Photo | None, number: int) -> list[list[float]]:
    """The sample of a picture of an unknown camera; none if no pose or no lane is found. `photo`: None without road."""
    camera, lane = find_with_own_pose(image)
    if camera is None or lane is None:
        return []
    correct = photo is not None and right_in_picture(lane, camera, photo.label)
    return [[*lane_features(lane).values(), correct, OWN_POSE_NO_ROAD_WEIGHT if photo is None else 1.0, number]]


def label_lanes(
    frames: Iterable[np.ndarray],
    camera: Camera,
    truth: LaneTruth,
    *,
    fps: float,
    number: int,
    weight: float = 1.0,
    brightnesses: tuple[float, ...] = (1.0,),
    markings: Markings | None = None,
) -> tuple[list, list]:
    """Samples (*features, correct, weight, `number`) of the lanes in the frames: tracked ones, and those in stills."""
    tracker = LaneTracker(camera, fps=fps, markings=markings)
    tracked: list[Lane | None] = []
    stills: dict[float, list[Lane | None]] = {brightness: [] for brightness in brightnesses}
    for frame, image in enumerate(frames):
        tracked.append(tracker.update(image))
        if frame % STILL_EVERY == 0:
            for brightness, lanes in stills.items():
                lanes.append(find_lane(cv2.convertScaleAbs(image, alpha=brightness), camera, markings=markings))
    other = weight * OTHER_BRIGHTNESS_WEIGHT
    some = truth.select(slice(0, len(tracked), STILL_EVERY))
    samples = [_label(lanes, some, weight if light == 1 else other, number) for light, lanes in stills.items()]
    return _label(tracked, truth, weight, number), sum(samples, [])


def _label(lanes: list[Lane | None], truth: LaneTruth, weight: float, number: int) -> list[list[float]]:
    """Samples of the lanes in the frames of a truth."""
    estimates = DriveEstimates.from_frames([lane_estimate(lane) for lane in lanes], [0.0] * len(lanes))
    correct = (frame_errors(estimates, truth).full_rms_m <= CORRECT_WITHIN_M) & truth.exists
    rows = zip(lanes, correct, strict=True)
    return [[*lane_features(lane).values(), right, weight, number] for lane, right in rows if lane is not None]


def fit_logistic(
    features: np.ndarray, correct: np.ndarray, drive: np.ndarray, weight: np.ndarray | float = 1.0
) -> np.ndarray:
    """Weights of a logistic regression of `correct` (lanes,) on features (lanes, F): Newton's method, L2 penalty.

    All drives, whose numbers are `drive` (lanes,), have the same sum of weights, before `weight` (lanes,) is applied.
    """
    _, of, count = np.unique(drive, return_inverse=True, return_counts=True)
    sample_weight, weights = weight * EFFECTIVE_FRAMES / count[of], np.zeros(features.shape[1])
    for _ in range(50):
        probability = logistic(features @ weights)
        spread = sample_weight * probability * (1 - probability)
        hessian = (features.T * spread) @ features + RIDGE * np.eye(len(weights))
        gradient = features.T @ (sample_weight * (correct - probability)) - RIDGE * weights
        weights += np.linalg.solve(hessian, gradient)
    return weights


def correct_weights(
    features: np.ndarray, right: np.ndarray, weight: np.ndarray, *, ridge: float = REAL_RIDGE
) -> np.ndarray:
    """`RENDERED_WEIGHTS` (F,), corrected on the features (lanes, F) of labelled real roads: they are the prior."""
    rendered = np.array(RENDERED_WEIGHTS)
    # a correction is measured by what it does to lanes that differ by the standard deviation of the feature
    information = ridge * np.square(np.maximum(features.std(axis=0), 0.05))
    information[0] = 0.1 * ridge
    # few real drives have a wrong yaw
    information[[*WEIGHTS].index("odd heading")] *= 100
    correction = np.zeros(len(rendered))
    for _ in range(40):
        probability = logistic(features @ (rendered + correction))
        hessian = (features.T * (weight * probability * (1 - probability))) @ features + np.diag(information)
        gradient = features.T @ (weight * (right - probability)) - information * correction
        correction += np.linalg.solve(hessian, gradient)
    return rendered + correction


def samples_of_real_roads(folder: Path, workers: int) -> tuple[np.ndarray, ...]:
    """Features (lanes, F), right (lanes,), weight (lanes,) and set (lanes,) of real and painted roads, and of no roads.

    The images without a road are searched with a pose of their own and with a given one.
    """
    tasks = [(roads, way) for roads in read_road_sets(folder) for way in WAYS]
    found = run_all(partial(score_set, settings=TrackerSettings()), tasks, workers=workers)
    rows = [
        (roads.name, lane_features(one.lane), bool(one.score.right))
        for (roads, _), some in zip(tasks, found, strict=True)
        for one in some
        if one.lane and one.score.right is not None
    ]
    for kind in KINDS:
        for seed in range(12):
            image = not_a_road(kind, seed)
            lanes = find_with_own_pose(image)[1], find_lane(image, CAMERA.scaled(image.shape[1::-1]))
            rows += [(f"no {kind}", lane_features(lane), False) for lane in lanes if lane]
    camera = CAMERA.scaled((640, 360))
    for seed, wrong in [(4000 + k, True) for k in range(20)] + [(4100 + k, False) for k in range(12)]:
        samples = samples_of_painted_drive(seed, camera, seconds=1.6, fps=12.5, pose_is_wrong=wrong)
        rows += [(f"painted {seed}", dict(zip(WEIGHTS, row, strict=False)), row[-3] > 0) for row in sum(samples, [])]
    name, features, right = zip(*rows, strict=True)
    _, of, count = np.unique(name, return_inverse=True, return_counts=True)
    kinds = {"no": NO_ROAD_WEIGHT, "painted": PAINTED_WEIGHT}
    weight = np.array([kinds.get(text.split()[0], 1.0) for text in name]) * np.minimum(1, SET_IMAGES / count[of])
    return np.array([[*some.values()] for some in features]), np.array(right), weight, np.array(name)


def fit_on_real_roads(folder: Path, workers: int) -> None:
    """Print the calibration of the present and of the corrected weights, left out set by set, and the latter."""
    features, right, weight, name = samples_of_real_roads(folder, workers)
    print_calibration("present", logistic(features @ np.array([*WEIGHTS.values()])), right, name)
    left_out = np.zeros(len(right))
    for one in np.unique(name):
        rest = name != one
        left_out[~rest] = logistic(features[~rest] @ correct_weights(features[rest], right[rest], weight[rest]))
    print_calibration("corrected, each set left out", left_out, right, name)
    print(dict(zip(WEIGHTS, np.round(correct_weights(features, right, weight), 2).tolist(), strict=True)))


def fit_shift(log_odds: np.ndarray, correct: np.ndarray, weight: np.ndarray) -> float:
    """The number that, added to the log odds (lanes,), makes the mean probability the share of correct lanes.

    Both are weighted; this is the logistic regression with one constant. Limited to 6 in either direction.
    """
    low, high = -6.0, 6.0
    for _ in range(40):
        shift = (low + high) / 2
        excess = weight @ (logistic(log_odds + shift) - correct)
        low, high = (low, shift) if excess > 0 else (shift, high)
    return shift


def print_shift(markings: Markings, data: list[tuple[list, list]]) -> None:
    """Print the constant of a network's confidence, fitted on tracked lanes and on those in stills."""
    rows = np.array([row for one in data for part in one for row in part], float).reshape(-1, len(WEIGHTS) + 3)
    if not rows[:, -3].any():
        raise SystemExit(f"{markings}: no lane found with this network is correct; check its YAML file.")
    _, of, count = np.unique(rows[:, -1], return_inverse=True, return_counts=True)
    log_odds, correct = rows[:, :-3] @ np.array([*WEIGHTS.values()]), rows[:, -3] > 0
    shift = fit_shift(log_odds, correct, rows[:, -2] / count[of])
    print_calibration(f"{markings}, without a shift", logistic(log_odds), correct, rows[:, -1])
    print_calibration(f"{markings}, with the shift", logistic(log_odds + shift), correct, rows[:, -1])
    print(f"confidence_shift: {shift:.2f}")


def logistic(log_odds: np.ndarray) -> np.ndarray:
    """Probabilities from logarithmic odds."""
    return 1 / (1 + np.exp(-log_odds))


def cross_validated(
    features: np.ndarray,
    correct: np.ndarray,
    drive: np.ndarray,
    weight: np.ndarray | float = 1.0,
    *,
    parts: np.ndarray | None = None,
) -> np.ndarray:
    """Probabilities (lanes,) from weights that were fitted without the lane's own drive, or its `parts` (lanes,)."""
    weight, parts = np.broadcast_to(weight, correct.shape), drive if parts is None else parts
    numbers = np.random.default_rng(0).permutation(np.unique(parts))
    probability = np.zeros(len(correct))
    for fold in np.array_split(numbers, FOLDS):
        held_out = np.isin(parts, fold)
        weights = fit_logistic(features[~held_out], correct[~held_out], drive[~held_out], weight[~held_out])
        probability[held_out] = logistic(features[held_out] @ weights)
    return probability


def print_calibration(name: str, confidence: np.ndarray, correct: np.ndarray, drive: np.ndarray) -> None:
    """Print the accuracy of the lanes in bins of confidence, with 95 % intervals by drive."""
    log_loss = -np.mean(np.log(np.where(correct, confidence, 1 - confidence) + 1e-9))
    print(f"{name}: {len(correct)} lanes, {correct.mean():.1%} correct, log loss {log_loss:.3f}")
    for low, high in ((0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.97), (0.97, 1.01), (0.9, 1.01)):
        some = (confidence > low) & (confidence <= high)
        if some.any():
            mean, accuracy = confidence[some].mean(), correct[some].mean()
            bounds = f"{low:.2f} to {min(high, 1):.2f}"
            interval = " to ".join(f"{limit:.1%}" for limit in mean_interval(correct[some], drive[some]))
            print(f"  confidence {bounds}: {some.sum():5d} lanes, mean {mean:.1%}, {accuracy:.1%} correct ({interval})")
    print(f"  {(confidence[correct] >= 0.9).mean():.1%} of the correct lanes have a confidence of 0.9 or more")


def main() -> None:
    """Collect samples, fit, print the calibration."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only check the present weights, on other roads")
    parser.add_argument("--markings", metavar="MODEL.onnx", help="fit the constant of the lanes of this network")
    parser.add_argument("--real", type=Path, metavar="FOLDER", help="correct the weights on labelled real roads")
    parser.add_argument("--workers", type=bounded(int, 1), default=1, metavar="N", help="processes, with --real")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.real:
        fit_on_real_roads(options.real, options.workers)
        return
    if options.markings:
        markings = load_markings(options.markings)
        print_shift(markings, collect_samples(markings))
        return
    if options.check:
        data = [samples_of_painted_drive(seed) for seed in range(1000, 1000 + DRIVES // 2)]
    else:
        data = collect_samples()
    seeds = PHOTO_CHECK_SEEDS if options.check else PHOTO_SEEDS
    samples = [[row for one in data for row in one[part]] for part in (0, 1)]
    samples.append([row for seed in seeds for row in samples_of_photos(seed)])
    kind = np.repeat(np.arange(len(samples)), [len(rows) for rows in samples])
    fit_weights(np.array(sum(samples, []), float), kind, only_check=options.check)


def fit_weights(rows: np.ndarray, kind: np.ndarray, *, only_check: bool) -> None:
    """Print the calibration of the present weights on samples (N, ...), by their kind (N,); fit new ones.

    With `only_check` none are fitted.
    """
    features, correct, weight, drive = rows[:, :-3], rows[:, -3] > 0, rows[:, -2], rows[:, -1]
    # A drive that is tracked, and its stills, are different drives.
    group = np.unique(np.stack([kind, drive]), axis=1, return_inverse=True)[1].ravel()
    fits = {"present": logistic(features @ np.array([*WEIGHTS.values()]))}
    if not only_check:
        fits["new, cross-validated"] = cross_validated(features, correct, group, weight, parts=drive)
    for name, confidence in fits.items():
        for number, kind_name in enumerate(KINDS_OF_LANES):
            some = (weight >= 1) & (kind == number)
            print_calibration(f"{kind_name}, {name}", confidence[some], correct[some], drive[some])
    if not only_check:
        weights = fit_logistic(features, correct, group, weight)
        print(dict(zip(WEIGHTS, np.round(weights, 2).tolist(), strict=True)))


def collect_samples(markings: Markings | None = None) -> list[tuple[list, list]]:
    """Samples of the painted drives and of the suite. Variants of a scene share a number."""
    data = [samples_of_painted_drive(seed, markings=markings) for seed in range(DRIVES)]
    wrong = range(WRONG_POSE_SEED, WRONG_POSE_SEED + WRONG_POSES)
    data += [samples_of_painted_drive(seed, pose_is_wrong=True, markings=markings) for seed in wrong]
    for number, kind in enumerate(KINDS):
        data += [samples_of_no_road(kind, seed, -1000 - number, markings=markings) for seed in range(NO_ROADS)]
    for number, (name, scene) in enumerate(SUITE.items()):
        for seed in SEEDS:
            drive = drive_from_video(render_scene(name, seed=seed), difficulty=scene.difficulty)
            data.append(samples_of_video(drive, -1 - number, markings=markings))
    return data


if __name__ == "__main__":
    main()
