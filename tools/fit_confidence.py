"""Fit the weights of `lanes.detect.confidence` by logistic regression.

    python -m tools.fit_confidence FOLDER [--workers 2] [--several-cameras NAME,...]
        prints weights, and the calibration with each set left out
    python -m tools.fit_confidence --markings model.onnx
        prints `confidence_shift` for the YAML file of a network

The folder has labelled real roads of many cameras (`benchmark.real_roads`): each still
alone, with the pose of its set, and the tracked clips. Images without a road are added
(rooms, maps, tiles), photos of flat scenes by random cameras, and painted drives with
random paint, light and motion. Some of these have a wrong camera pose.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from benchmark.errors import LaneTruth, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.real_roads.sets import (
    RoadSet,
    add_processing_arguments,
    read_road_sets,
)
from benchmark.real_roads.ways import WAYS, score_set
from benchmark.scores import mean_interval
from benchmark.systems import PROJECTED_AT_M, lane_estimate, project_lines
from lanes.camera.field_of_view import DEFAULT_HFOV_DEG
from lanes.camera.model import Camera, CameraPose
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
from simulator.painted_drive import (
    CAMERA,
    DASH_M,
    TAR,
    WORN_WHITE,
    WORN_YELLOW,
    PaintedDrive,
    Stripe,
)
from simulator.processes import run_all
from simulator.rendering.drive import Motion
from simulator.rendering.render import render_frame
from simulator.road.geometry import FLAT, RoadGeometry
from simulator.road.truth import truth_row
from simulator.scenes.suite import SUITE

# Painted drives with the right and with a wrong pose; every fourth frame is also
# detected without the tracker.
RIGHT_POSES = range(4100, 4116)
WRONG_POSES = range(4000, 4020)
SECONDS = 1.6
FPS = 12.5
STILL_EVERY = 4
# Images of each kind without a road, and photos of each flat scene.
NO_ROADS = 12
PHOTOS = 8
# What a lane of each source counts. Those of painted roads count little: metres decide
# there, and pixels elsewhere. All lanes of one set, scene or drive count as this number
# of independent ones at most.
REAL = "real"
NO_ROAD = "no road"
PHOTO = "photo"
PAINTED = "painted"
SOURCE_WEIGHTS = {REAL: 1.0, NO_ROAD: 6.0, PHOTO: 0.5, PAINTED: 0.03}
GROUP_LANES = 24.0
# Penalty on a weight, relative to the variance of its feature, and on the constant.
RIDGE = 3.0
CONSTANT_RIDGE = 0.1
# Weights that are not fitted, because few labelled roads have a wrong yaw or height:
# with these, as many lanes of painted drives with a wrong pose are sure (a fifth) as
# with weights that were fitted on such drives.
FIXED = {"odd heading": -3.0, "odd width": -0.5}


@dataclass(frozen=True)
class Sample:
    """A lane: where it comes from, the set, scene or drive that it belongs to, its
    features, whether it is right.
    """

    source: str
    group: str
    features: dict[str, float]
    right: bool


def draw_road(rng: np.random.Generator) -> tuple[RoadGeometry, float]:
    """A random road and its speed: motorway, country road or mountain road."""
    # Radius of the tightest bend (m), distance of the knots (m), speed (m/s).
    kinds = ((400, 80.0, 28.0), (150, 45.0, 18.0), (45, 22.0, 10.0))
    radius_m, knot_m, speed_mps = kinds[rng.choice(3, p=(0.6, 0.25, 0.15))]
    side = np.round(rng.uniform(-1, 1, 60))
    strength = rng.uniform(0.3, 1.0, 60)
    curvatures = np.repeat(side * strength / radius_m, 2)
    knots_m = np.arange(len(curvatures)) * knot_m
    return RoadGeometry(knots_m, curvatures), speed_mps


def draw_line(rng: np.random.Generator, lateral_m: float) -> Stripe:
    """A random lane line of any usual paint, sometimes worn, sometimes missing for a
    while.
    """
    gone = (np.inf, np.inf)
    if rng.random() < 0.3:
        start = rng.uniform(0, SECONDS)
        gone = (start, start + rng.uniform(0.5, 3))
    fresh = WORN_YELLOW if rng.random() < 0.3 else WORN_WHITE
    dashes = (None, DASH_M, (3.0, 9.0), (6.0, 18.0))
    dash_m = dashes[rng.choice(4, p=(0.4, 0.4, 0.1, 0.1))]
    wear = rng.choice([1.0, 0.5, 0.25], p=[0.6, 0.25, 0.15])
    colour = tuple(int(98 + wear * (value - 98)) for value in fresh)
    width_m = rng.uniform(0.1, 0.2)
    return Stripe(lateral_m, width_m, colour, dash_m, rng.uniform(0, 12), gone)


def draw_clutter(rng: np.random.Generator, half_m: float) -> tuple[Stripe, ...]:
    """Random clutter similar to lane lines: seams, cracks, kerbs, other lines."""
    clutter = []
    for side in (1, -1):
        if rng.random() < 0.6:
            clutter.append(draw_line(rng, side * half_m * 3))
    for _ in range(rng.poisson(0.7)):
        clutter.append(Stripe(rng.uniform(-3, 3), rng.uniform(0.04, 0.2), TAR))
    for _ in range(rng.poisson(0.4)):
        grey = int(rng.uniform(110, 170))
        start_m = rng.uniform(0, 80)
        bright = Stripe(
            rng.uniform(-4, 4),
            rng.uniform(0.05, 0.3),
            (grey, grey, grey),
            along_m=(start_m, start_m + 60),
        )
        clutter.append(bright)
    if rng.random() < 0.3:
        side = rng.choice([-1, 1])
        lateral_m = side * rng.uniform(3, 6)
        clutter.append(Stripe(lateral_m, rng.uniform(0.2, 1.5), (150, 150, 148)))
    return tuple(clutter)


def draw_drive(seed: int, camera: Camera = CAMERA) -> tuple[PaintedDrive, Camera]:
    """A random drive, and its camera with a random pose error."""
    rng = np.random.default_rng(seed)
    road, speed_mps = draw_road(rng)
    half_m = rng.uniform(1.5, 1.9)
    shades = []
    for start_m in rng.uniform(0, 120, rng.poisson(1.0)):
        end_m = start_m + rng.uniform(3, 25)
        shades.append(Stripe(0, 12, along_m=(start_m, end_m)))
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
    """The camera with a wrong pose.

    Its pitch or yaw is wrong by 2 to 4 degrees, or its height by a quarter or a half.
    From half of the height two lanes look like one.
    """
    rng = np.random.default_rng(seed)
    pose = camera.require_pose()
    angle_rad = np.radians(rng.uniform(2, 4)) * rng.choice([-1, 1])
    quarter = 1 + 0.25 * np.sign(angle_rad)
    poses = (
        replace(pose, pitch_rad=pose.pitch_rad + angle_rad),
        replace(pose, yaw_rad=pose.yaw_rad + angle_rad),
        replace(pose, height_m=pose.height_m * quarter),
        replace(pose, height_m=pose.height_m * 0.5),
    )
    return camera.with_pose(poses[rng.integers(len(poses))])


def samples_of_painted_drive(
    seed: int,
    camera: Camera = CAMERA,
    *,
    pose_is_wrong: bool = False,
    markings: Markings | None = None,
) -> tuple[list[Sample], list[Sample]]:
    """Samples of a painted drive as of `label_lanes`: tracked, and alone."""
    drive, camera = draw_drive(seed, camera)
    if pose_is_wrong:
        camera = wrong_pose(camera, seed)
    times_s = np.arange(int(SECONDS * FPS)) / FPS
    rows = [truth_row(drive.truth(time_s), frame=0) for time_s in times_s]
    columns = {name: np.array([row[name] for row in rows], float) for name in rows[0]}
    return label_lanes(
        map(drive.frame, times_s),
        camera,
        LaneTruth.from_columns(columns),
        group=f"painted {seed}",
        markings=markings,
    )


# Sizes of photos of scenes, and the distance of their labelled rows as a share of the
# width.
SIZES = ((640, 360), (960, 540), (640, 480), (854, 480))
ROW_STEP = 5 / 1280


def flat_scenes() -> list[str]:
    """Scenes on a flat road, with or without a lane.

    The label of a photo is right for no other.
    """
    return [name for name, scene in SUITE.items() if scene.drive().road.profile == FLAT]


def take_photo(scene: str, rng: np.random.Generator) -> tuple[np.ndarray, LaneColumns]:
    """A picture of a random moment of a scene, taken with a random camera, and its
    lines.
    """
    height_m = rng.uniform(1.1, 2.1)
    angles_rad = np.radians(rng.normal(0, [3.0, 2.0, 0.7]))
    pose = CameraPose(height_m, *angles_rad)
    size = SIZES[rng.integers(len(SIZES))]
    camera = Camera.from_fov(size, rng.uniform(50, 80), pose)
    drive = replace(SUITE[scene].drive(), camera=camera, bonnet=False)
    frame = render_frame(drive, rng.uniform(0, SUITE[scene].seconds))

    camera = drive.camera_at(frame.truth.time_s)
    [(_, horizon_row)] = camera.road_to_pixels(np.array([[1e5, 0.0]]))
    first_row = horizon_row + 0.06 * camera.height
    rows = np.arange(first_row, camera.height, ROW_STEP * camera.width)
    lines_m = [frame.truth.line_y(side, PROJECTED_AT_M) for side in (0, 1)]
    columns = project_lines(lines_m, camera, rows)
    return frame.image, LaneColumns(scene, rows, columns, EGO_SIDES)


def find_with_own_pose(image: np.ndarray) -> tuple[Camera | None, Lane | None]:
    """The camera with the pose that is estimated from this picture, and the lane.

    None where there is none.
    """
    lens = Camera.from_fov(image.shape[1::-1], DEFAULT_HFOV_DEG)
    try:
        estimate = estimate_pose(image, lens)
    except PoseError:
        return None, None
    return estimate.camera, estimate.still.lane


def label_lanes(
    frames: Iterable[np.ndarray],
    camera: Camera,
    truth: LaneTruth,
    *,
    group: str,
    markings: Markings | None = None,
) -> tuple[list[Sample], list[Sample]]:
    """Samples of the lanes in frames with known truth.

    They are of the lanes that are tracked, and of those in every fourth frame alone.
    """
    tracker = LaneTracker(camera, fps=FPS, markings=markings)
    tracked, alone = [], []
    for frame, image in enumerate(frames):
        tracker.update(image)
        tracked.append(tracker.tracked_lane)
        if frame % STILL_EVERY == 0:
            detection = detect_still(image, camera, markings=markings)
            alone.append(detection.lane)
    of_alone = truth.select(slice(0, len(tracked), STILL_EVERY))
    return _label(tracked, truth, group), _label(alone, of_alone, group)


def _label(lanes: list[Lane | None], truth: LaneTruth, group: str) -> list[Sample]:
    """Samples of the lanes in the frames of a truth."""
    of_frames = [lane_estimate(lane) for lane in lanes]
    estimates = DriveEstimates.from_frames(of_frames, [0.0] * len(lanes))
    errors = frame_errors(estimates, truth)
    right = truth.exists & (errors.full_rms_m <= CORRECT_WITHIN_M)
    samples = []
    for lane, is_right in zip(lanes, right, strict=True):
        if lane:
            samples.append(Sample(PAINTED, group, lane.features, bool(is_right)))
    return samples


def samples_of_roads(task: tuple[RoadSet, str]) -> list[Sample]:
    """Samples of a labelled set of real roads, in one of the ways to look at it."""
    roads, _ = task
    samples = []
    for one in score_set(task, TrackerSettings()):
        right = one.score.right
        if one.lane and right is not None:
            samples.append(Sample(REAL, roads.name, one.lane.features, right))
    return samples


def samples_of_no_road(kind: str) -> list[Sample]:
    """Samples of images without a road, searched with a pose of their own and with a
    given one.
    """
    lanes: list[Lane | None] = []
    for seed in range(NO_ROADS):
        image = not_a_road(kind, seed)
        camera = CAMERA.scaled(image.shape[1::-1])
        _, own = find_with_own_pose(image)
        lanes += [own, detect_still(image, camera).lane]
    return [Sample(NO_ROAD, kind, lane.features, False) for lane in lanes if lane]


def samples_of_photos(task: tuple[int, str]) -> list[Sample]:
    """Samples of photos of a flat scene, given with its number; the camera pose is
    estimated from the same image.
    """
    number, scene = task
    rng = np.random.default_rng([7, number])
    samples = []
    for _ in range(PHOTOS):
        image, label = take_photo(scene, rng)
        camera, lane = find_with_own_pose(image)
        if camera and lane:
            columns = lane.columns(camera, label.rows)
            found = LaneColumns("found", label.rows, columns, EGO_SIDES)
            right = bool(score_still(label, found, camera.size).right)
            samples.append(Sample(PHOTO, f"photo {number}", lane.features, right))
    return samples


def samples_of_painted_roads(
    markings: Markings | None = None, *, workers: int = 1
) -> list[Sample]:
    """Samples of painted drives with the right pose, and with a wrong one."""
    sample = partial(
        samples_of_painted_drive, camera=CAMERA.scaled((640, 360)), markings=markings
    )
    right = run_all(sample, RIGHT_POSES, workers=workers)
    wrong = run_all(partial(sample, pose_is_wrong=True), WRONG_POSES, workers=workers)
    samples = []
    for tracked, alone in right + wrong:
        samples += tracked + alone
    return samples


def collect_samples(sets: Sequence[RoadSet], *, workers: int) -> list[Sample]:
    """Samples of all sources; `sets` are the labelled real roads."""
    roads = [(one, way) for one in sets for way in WAYS]
    scenes = list(enumerate(flat_scenes()))
    return [
        *chain(*run_all(samples_of_roads, roads, workers=workers)),
        *chain(*run_all(samples_of_no_road, KINDS, workers=workers)),
        *chain(*run_all(samples_of_photos, scenes, workers=workers)),
        *samples_of_painted_roads(workers=workers),
    ]


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
        group = np.array([one.group for one in samples])
        _, number, count = np.unique(group, return_inverse=True, return_counts=True)
        of_group = np.minimum(1, GROUP_LANES / count[number])
        of_source = np.array([SOURCE_WEIGHTS[one.source] for one in samples])
        return cls(
            features=np.array([list(one.features.values()) for one in samples]),
            right=np.array([one.right for one in samples]),
            weight=of_source * of_group,
            source=np.array([one.source for one in samples]),
            group=group,
        )

    def select(self, lanes: np.ndarray) -> Table:
        """The table of some of the lanes, (N,) bool."""
        return Table(*(getattr(self, field.name)[lanes] for field in fields(self)))


def fit_logistic(
    features: np.ndarray,
    right: np.ndarray,
    weight: np.ndarray,
    fixed: dict[int, float] | None = None,
) -> np.ndarray:
    """Weights (F,) of a logistic regression of `right` (N,) on features (N, F).

    The first feature is 1. Newton's method with an L2 penalty on features of unit
    variance. `fixed` weights, by their column, are given.
    """
    # a feature that is the same in all lanes gets no weight
    penalty = RIDGE * np.maximum(features.var(axis=0), 1e-3)
    penalty[0] = CONSTANT_RIDGE
    given = np.zeros(features.shape[1])
    for column, value in (fixed or {}).items():
        penalty[column] = 1e9
        given[column] = value

    weights = given.copy()
    for _ in range(40):
        probability = logistic(features @ weights)
        variance = probability * (1 - probability)
        hessian = (features.T * (weight * variance)) @ features + np.diag(penalty)
        residual = weight * (right - probability)
        gradient = features.T @ residual - penalty * (weights - given)
        weights += np.linalg.solve(hessian, gradient)
    return weights


def left_out(table: Table, fixed: dict[int, float] | None = None) -> np.ndarray:
    """Probabilities (N,) from weights that were fitted without the lane's own group."""
    probability = np.zeros(len(table.right))
    for name in np.unique(table.group):
        own = table.group == name
        rest = table.select(~own)
        weights = fit_logistic(rest.features, rest.right, rest.weight, fixed)
        probability[own] = logistic(table.features[own] @ weights)
    return probability


def fit_shift(log_odds: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """The number to add to the log odds (N,).

    With it the mean probability is the share of right lanes, both weighted. This is the
    logistic regression with one constant. Limited to 6 in either direction.
    """
    features = np.column_stack([np.ones(len(log_odds)), log_odds])
    shift, _ = fit_logistic(features, right, weight / weight.mean(), {1: 1.0})
    return float(np.clip(shift, -6, 6))


def logistic(log_odds: np.ndarray) -> np.ndarray:
    """Probabilities from logarithmic odds."""
    return 1 / (1 + np.exp(-log_odds))


# Bins of the printed calibration: above the first, up to the second.
BINS = (
    (0.0, 0.1),
    (0.1, 0.3),
    (0.3, 0.5),
    (0.5, 0.7),
    (0.7, 0.9),
    (0.9, 0.97),
    (0.97, 1.0),
    (0.9, 1.0),
)


def print_calibration(
    name: str, confidence: np.ndarray, correct: np.ndarray, drive: np.ndarray
) -> None:
    """Print the accuracy of the lanes in bins of confidence, with 95 % intervals."""
    likelihood = np.where(correct, confidence, 1 - confidence)
    log_loss = -np.mean(np.log(likelihood + 1e-9))
    print(
        f"{name}: {len(correct)} lanes, {correct.mean():.1%} correct, "
        f"log loss {log_loss:.3f}"
    )
    for low, high in BINS:
        some = (confidence > low) & (confidence <= high)
        if not some.any():
            continue
        lowest, highest = mean_interval(correct[some], drive[some])
        print(
            f"  confidence {low:.2f} to {high:.2f}: {some.sum():5d} lanes, "
            f"mean {confidence[some].mean():.1%}, {correct[some].mean():.1%} correct "
            f"({lowest:.1%} to {highest:.1%})"
        )
    if correct.any():
        sure = (confidence[correct] >= 0.9).mean()
        print(f"  {sure:.1%} of the correct lanes have a confidence of 0.9 or more")


def main() -> None:
    """Collect samples, fit, print the calibration."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "folder",
        nargs="?",
        type=Path,
        help="labelled real roads, see benchmark.real_roads",
    )
    what.add_argument(
        "--markings",
        metavar="MODEL.onnx",
        help="fit the constant of the lanes of this network",
    )
    add_processing_arguments(parser)
    options = parser.parse_args()

    cv2.setNumThreads(1)
    if options.markings:
        print_shift(options.markings)
    else:
        sets = read_road_sets(options.folder, several_cameras=options.several_cameras)
        samples = collect_samples(sets, workers=options.workers)
        print_weights(Table.of(samples))


def print_shift(model: str) -> None:
    """Fit the constant of a network, and print it with the calibration."""
    samples = samples_of_painted_roads(load_markings(model))
    if not any(one.right for one in samples):
        raise SystemExit(
            f"{model}: no lane found with this network is right; check its YAML file."
        )
    table = Table.of(samples)
    log_odds = table.features @ list(WEIGHTS.values())
    shift = fit_shift(log_odds, table.right, table.weight)
    for name, added in (("without a shift", 0.0), ("with the shift", shift)):
        confidence = logistic(log_odds + added)
        print_calibration(f"{model}, {name}", confidence, table.right, table.group)
    print(f"confidence_shift: {shift:.2f}")


def print_weights(table: Table) -> None:
    """Fit the weights, and print them with the calibration of each source."""
    names = list(WEIGHTS)
    fixed = {names.index(name): value for name, value in FIXED.items()}
    present = logistic(table.features @ list(WEIGHTS.values()))
    confidences = {"present": present, "left out": left_out(table, fixed)}
    for name, confidence in confidences.items():
        for source in SOURCE_WEIGHTS:
            lanes = table.source == source
            some = table.select(lanes)
            print_calibration(
                f"{source}, {name}", confidence[lanes], some.right, some.group
            )
    weights = fit_logistic(table.features, table.right, table.weight, fixed)
    print(dict(zip(names, np.round(weights, 2).tolist(), strict=True)))


if __name__ == "__main__":
    main()
