"""Fit the weights of `lanes.detect.confidence` by logistic regression.

    python -m tools.fit_confidence FOLDER [--workers 2]    prints weights, and the calibration with each set left out
    python -m tools.fit_confidence --markings model.onnx   prints `confidence_shift` for the YAML file of a network

The folder has labelled real roads of many cameras (`benchmark.real_roads`): each still alone, with the pose of its set,
and the tracked clips. Images without a road are added (rooms, maps, tiles), photos of flat scenes by random cameras,
and painted drives with random paint, light and motion. Some of these have a wrong camera pose.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.real_roads import WAYS, RoadSet, read_road_sets, score_set
from benchmark.scores import mean_interval
from benchmark.systems import PROJECTED_AT_M, lane_estimate, project_lines
from lanes.camera.field_of_view import DEFAULT_HFOV_DEG
from lanes.camera.model import Camera, CameraPose
from lanes.console import bounded
from lanes.detect.confidence import CORRECT_WITHIN_M, WEIGHTS
from lanes.detect.lane import Lane
from lanes.detect.markings import Markings, load_markings
from lanes.detect.search import detect_still
from lanes.errors import PoseError
from lanes.labels import EGO_SIDES, LaneColumns
from lanes.pose.estimate import estimate_pose
from lanes.score import score_still
from lanes.tracking.tracker import LaneTracker, TrackerSettings
from simulator.not_roads import KINDS, not_a_road
from simulator.painted_drive import CAMERA, DASH_M, TAR, WORN_WHITE, WORN_YELLOW, PaintedDrive, Stripe
from simulator.processes import run_all
from simulator.rendering.drive import Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import FLAT, RoadGeometry
from simulator.road.truth import truth_row
from simulator.scenes.suite import SUITE

# Painted drives with the right and with a wrong pose; every fourth frame is also detected without the tracker.
RIGHT_POSES, WRONG_POSES, SECONDS, FPS, STILL_EVERY = range(4100, 4116), range(4000, 4020), 1.6, 12.5, 4
# Images of each kind without a road, and photos of each flat scene.
NO_ROADS, PHOTOS = 12, 8
# What a lane of each source counts. Those of painted roads count little: metres decide there, and pixels elsewhere.
# All lanes of one set, scene or drive count as this number of independent ones at most.
REAL, NO_ROAD, PHOTO, PAINTED = "real", "no road", "photo", "painted"
SOURCE_WEIGHTS, GROUP_LANES = {REAL: 1.0, NO_ROAD: 6.0, PHOTO: 0.5, PAINTED: 0.03}, 24.0
# Penalty on a weight, relative to the variance of its feature, and on the constant.
RIDGE, CONSTANT_RIDGE = 3.0, 0.1
# Weights that are not fitted, because few labelled roads have a wrong yaw or height: with these, as many lanes of
# painted drives with a wrong pose are sure (a fifth) as with weights that were fitted on such drives.
FIXED = {"odd heading": -3.0, "odd width": -0.5}


@dataclass(frozen=True)
class Sample:
    """A lane: where it comes from, the set, scene or drive that it belongs to, its features, whether it is right."""

    source: str
    group: str
    features: dict[str, float]
    right: bool


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
    seed: int, camera: Camera = CAMERA, *, pose_is_wrong: bool = False, markings: Markings | None = None
) -> tuple[list[Sample], list[Sample]]:
    """Samples of the tracked lanes of a painted drive, and of lanes in some of its frames alone."""
    drive, camera = draw_drive(seed, camera)
    times = np.arange(int(SECONDS * FPS)) / FPS
    rows = [truth_row(drive.truth(time_s), frame=0) for time_s in times]
    truth = LaneTruth.from_columns({name: np.array([row[name] for row in rows], float) for name in rows[0]})
    camera = wrong_pose(camera, seed) if pose_is_wrong else camera
    return label_lanes(map(drive.frame, times), camera, truth, group=f"painted {seed}", markings=markings)


# Sizes of photos of scenes, and the distance of their labelled rows as a share of the width.
SIZES, ROW_STEP = ((640, 360), (960, 540), (640, 480), (854, 480)), 5 / 1280


def flat_scenes() -> list[str]:
    """Scenes on a flat road, with or without a lane: the label of a photo is right for no other."""
    return [name for name, scene in SUITE.items() if scene.drive().road.profile == FLAT]


def take_photo(scene: str, rng: np.random.Generator) -> tuple[np.ndarray, LaneColumns]:
    """A picture of a random moment of a scene, taken with a random camera, and its lines."""
    pose = CameraPose(rng.uniform(1.1, 2.1), *np.radians(rng.normal(0, [3.0, 2.0, 0.7])))
    camera = Camera.from_fov(SIZES[rng.integers(len(SIZES))], rng.uniform(50, 80), pose)
    drive = replace(SUITE[scene].drive(), camera=camera, bonnet=False)
    frame = render_frame(drive, rng.uniform(0, SUITE[scene].seconds))
    camera = drive.camera_at(frame.truth.time_s)
    # from a little below the horizon on
    first_row = camera.road_to_pixels(np.array([[1e5, 0.0]]))[0, 1] + 0.06 * camera.height
    rows = np.arange(first_row, camera.height, ROW_STEP * camera.width)
    lines_m = [frame.truth.line_y(side, PROJECTED_AT_M) for side in (0, 1)]
    return frame.image, LaneColumns(scene, rows, project_lines(lines_m, camera, rows), EGO_SIDES)


def find_with_own_pose(image: np.ndarray) -> tuple[Camera | None, Lane | None]:
    """The camera with the pose that is estimated from this picture, and the lane; None where there is none."""
    try:
        estimate = estimate_pose(image, Camera.from_fov(image.shape[1::-1], DEFAULT_HFOV_DEG))
    except PoseError:
        return None, None
    return estimate.camera, estimate.still.lane


def label_lanes(
    frames: Iterable[np.ndarray], camera: Camera, truth: LaneTruth, *, group: str, markings: Markings | None = None
) -> tuple[list[Sample], list[Sample]]:
    """Samples of the lanes in frames with known truth: of those tracked, and of those in every fourth frame alone."""
    tracker = LaneTracker(camera, fps=FPS, markings=markings)
    tracked, alone = [], []
    for frame, image in enumerate(frames):
        tracker.update(image)
        tracked.append(tracker.tracked_lane)
        if frame % STILL_EVERY == 0:
            alone.append(detect_still(image, camera, markings=markings).lane)
    some = truth.select(slice(0, len(tracked), STILL_EVERY))
    return _label(tracked, truth, group), _label(alone, some, group)


def _label(lanes: list[Lane | None], truth: LaneTruth, group: str) -> list[Sample]:
    """Samples of the lanes in the frames of a truth."""
    estimates = DriveEstimates.from_frames([lane_estimate(lane) for lane in lanes], [0.0] * len(lanes))
    right = (frame_errors(estimates, truth).full_rms_m <= CORRECT_WITHIN_M) & truth.exists
    return [Sample(PAINTED, group, lane.features, bool(one)) for lane, one in zip(lanes, right, strict=True) if lane]


def samples_of_roads(task: tuple[RoadSet, str]) -> list[Sample]:
    """Samples of a labelled set of real roads, in one of the ways to look at it."""
    scored = [one for one in score_set(task, TrackerSettings()) if one.lane and one.score.right is not None]
    return [Sample(REAL, task[0].name, one.lane.features, one.score.right) for one in scored]


def samples_of_no_road(kind: str) -> list[Sample]:
    """Samples of images without a road, searched with a pose of their own and with a given one."""
    lanes: list[Lane | None] = []
    for seed in range(NO_ROADS):
        image = not_a_road(kind, seed)
        camera = CAMERA.scaled(image.shape[1::-1])
        lanes += [find_with_own_pose(image)[1], detect_still(image, camera).lane]
    return [Sample(NO_ROAD, kind, lane.features, False) for lane in lanes if lane]


def samples_of_photos(number: int) -> list[Sample]:
    """Samples of photos of a flat scene, whose camera pose is estimated from the same image."""
    rng, scene, samples = np.random.default_rng([7, number]), flat_scenes()[number], []
    for _ in range(PHOTOS):
        image, label = take_photo(scene, rng)
        camera, lane = find_with_own_pose(image)
        if camera and lane:
            found = LaneColumns("found", label.rows, lane.columns(camera, label.rows), EGO_SIDES)
            right = bool(score_still(label, found, camera.size).right)
            samples.append(Sample(PHOTO, f"photo {number}", lane.features, right))
    return samples


def samples_of_painted_roads(markings: Markings | None = None, *, workers: int = 1) -> list[Sample]:
    """Samples of painted drives with the right pose, and with a wrong one."""
    camera = CAMERA.scaled((640, 360))
    samples = []
    for wrong, seeds in ((False, RIGHT_POSES), (True, WRONG_POSES)):
        of_drive = partial(samples_of_painted_drive, camera=camera, pose_is_wrong=wrong, markings=markings)
        samples += [one for parts in run_all(of_drive, seeds, workers=workers) for part in parts for one in part]
    return samples


def collect_samples(folder: Path, *, workers: int) -> list[Sample]:
    """Samples of all sources; `folder` holds the labelled real roads."""
    roads = [(one, way) for one in read_road_sets(folder) for way in WAYS]
    parts = (
        run_all(samples_of_roads, roads, workers=workers),
        run_all(samples_of_no_road, KINDS, workers=workers),
        run_all(samples_of_photos, range(len(flat_scenes())), workers=workers),
    )
    return [one for part in parts for some in part for one in some] + samples_of_painted_roads(workers=workers)


@dataclass(frozen=True, eq=False)
class Table:
    """Samples as arrays: features (N, F), right, weight, source and group (N,)."""

    features: np.ndarray
    right: np.ndarray
    weight: np.ndarray
    source: np.ndarray
    group: np.ndarray

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Table:
        """The table of samples."""
        source, group = np.array([one.source for one in samples]), np.array([one.group for one in samples])
        _, of, count = np.unique(group, return_inverse=True, return_counts=True)
        weight = np.array([SOURCE_WEIGHTS[name] for name in source]) * np.minimum(1, GROUP_LANES / count[of])
        features = np.array([[*one.features.values()] for one in samples])
        return cls(features, np.array([one.right for one in samples]), weight, source, group)


def fit_logistic(
    features: np.ndarray, right: np.ndarray, weight: np.ndarray, fixed: dict[int, float] | None = None
) -> np.ndarray:
    """Weights (F,) of a logistic regression of `right` (N,) on features (N, F), the first of which is 1.

    Newton's method with an L2 penalty on features of unit variance. `fixed` weights, by their column, are given.
    """
    # a feature that is the same in all lanes gets no weight
    information = RIDGE * np.maximum(features.var(axis=0), 1e-3)
    information[0] = CONSTANT_RIDGE
    given = np.zeros(features.shape[1])
    for column, value in (fixed or {}).items():
        information[column], given[column] = 1e9, value
    weights = given.copy()
    for _ in range(40):
        probability = logistic(features @ weights)
        hessian = (features.T * (weight * probability * (1 - probability))) @ features + np.diag(information)
        gradient = features.T @ (weight * (right - probability)) - information * (weights - given)
        weights += np.linalg.solve(hessian, gradient)
    return weights


def left_out(table: Table, fixed: dict[int, float] | None = None) -> np.ndarray:
    """Probabilities (N,) from weights that were fitted without the lane's own group."""
    probability = np.zeros(len(table.right))
    for name in np.unique(table.group):
        rest = table.group != name
        weights = fit_logistic(table.features[rest], table.right[rest], table.weight[rest], fixed)
        probability[~rest] = logistic(table.features[~rest] @ weights)
    return probability


def fit_shift(log_odds: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """The number that, added to the log odds (N,), makes the mean probability the share of right lanes.

    Both are weighted; this is the logistic regression with one constant. Limited to 6 in either direction.
    """
    features = np.column_stack([np.ones(len(log_odds)), log_odds])
    return float(np.clip(fit_logistic(features, right, weight / weight.mean(), {1: 1.0})[0], -6, 6))


def logistic(log_odds: np.ndarray) -> np.ndarray:
    """Probabilities from logarithmic odds."""
    return 1 / (1 + np.exp(-log_odds))


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
    if correct.any():
        print(f"  {(confidence[correct] >= 0.9).mean():.1%} of the correct lanes have a confidence of 0.9 or more")


def main() -> None:
    """Collect samples, fit, print the calibration."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("folder", nargs="?", type=Path, help="labelled real roads, see benchmark.real_roads")
    what.add_argument("--markings", metavar="MODEL.onnx", help="fit the constant of the lanes of this network")
    parser.add_argument("--workers", type=bounded(int, 1), default=1, metavar="N", help="processes")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.markings:
        print_shift(options.markings)
    else:
        print_weights(Table.of(collect_samples(options.folder, workers=options.workers)))


def print_shift(model: str) -> None:
    """Fit the constant of a network, and print it with the calibration."""
    samples = samples_of_painted_roads(load_markings(model))
    if not any(one.right for one in samples):
        raise SystemExit(f"{model}: no lane found with this network is right; check its YAML file.")
    table = Table.of(samples)
    log_odds = table.features @ [*WEIGHTS.values()]
    shift = fit_shift(log_odds, table.right, table.weight)
    for name, added in (("without a shift", 0.0), ("with the shift", shift)):
        print_calibration(f"{model}, {name}", logistic(log_odds + added), table.right, table.group)
    print(f"confidence_shift: {shift:.2f}")


def print_weights(table: Table) -> None:
    """Fit the weights, and print them with the calibration of each source."""
    fixed = {[*WEIGHTS].index(name): value for name, value in FIXED.items()}
    present = logistic(table.features @ [*WEIGHTS.values()])
    for name, confidence in (("present", present), ("left out", left_out(table, fixed))):
        for source in SOURCE_WEIGHTS:
            of = table.source == source
            print_calibration(f"{source}, {name}", confidence[of], table.right[of], table.group[of])
    weights = fit_logistic(table.features, table.right, table.weight, fixed)
    print(dict(zip(WEIGHTS, np.round(weights, 2).tolist(), strict=True)))


if __name__ == "__main__":
    main()
