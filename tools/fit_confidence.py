"""Where the numbers of `lanes.tracking.confidence` come from: drive along roads of known truth, count, fit.

    python -m tools.fit_confidence [VIDEO ...]   fits, prints the weights and how well they hold
    python -m tools.fit_confidence --check       drives other roads and only says how well the present weights hold

The roads are painted ones, and the drives of the suite: those given as VIDEO (with .csv and .yaml beside it), or all,
rendered where they have not been yet. It takes some minutes.

Painted roads: paint, light, motion and errors of the pose are drawn at random, hard ones among them: worn paint, lines
missing for seconds, tar seams, bright cracks and kerbs that run along the lane, shadows, black pictures. The suite has
what paint on a plane has not: crests, hairpins, weather, traffic, and roads without a lane. How well weights hold is
told by drives that took no part in their fit.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np

from benchmark.errors import LaneTruth, frame_errors  # noqa: E402
from benchmark.estimates import DriveEstimates  # noqa: E402
from benchmark.evaluation import read_truth  # noqa: E402
from benchmark.scored_drive import BenchmarkDrive  # noqa: E402
from benchmark.suite_drives import choose_drives  # noqa: E402
from benchmark.systems import tracker_estimate  # noqa: E402
from lanes.camera.camera import Camera  # noqa: E402
from lanes.camera.camera_file import load_camera  # noqa: E402
from lanes.io.video.reader import inspect_video, read_frames  # noqa: E402
from lanes.tracking.confidence import FEATURES, RIGHT_M, STILL_WEIGHTS, TRACK_WEIGHTS, lane_features  # noqa: E402
from lanes.tracking.detector import find_lane  # noqa: E402
from lanes.tracking.tracked_lane import TrackedLane  # noqa: E402
from lanes.tracking.tracker import LaneTracker  # noqa: E402
from simulator.rendering.drive import Motion  # noqa: E402
from simulator.road.geometry import RoadGeometry  # noqa: E402
from simulator.road.truth import truth_row  # noqa: E402
from tests.support.painted_drive import CAMERA, DASH_M, TAR, WHITE, YELLOW, PaintedDrive, Stripe  # noqa: E402

DRIVES, SECONDS, FPS = 60, 3.0, 12.5
# So often a picture is also looked at on its own.
ALONE_EVERY = 4
RIDGE = 1.0
# Frames of one drive are alike: all of them together count as so many independent ones.
WORTH = 25.0
# Drives are dealt into so many parts; each is told the chances by weights that were fitted on the others.
PARTS = 5


def draw_road(rng: np.random.Generator) -> tuple[RoadGeometry, float]:
    """A road and the speed that it is driven at: motorway, country road or mountain road."""
    tightest, knot_m, speed_mps = ((400, 80, 28.0), (150, 45, 18.0), (45, 22, 10.0))[rng.choice(3, p=(0.6, 0.25, 0.15))]
    bends = np.round(rng.uniform(-1, 1, 60)) * rng.uniform(0.3, 1.0, 60) / tightest
    curvatures = np.repeat(bends, 2)
    return RoadGeometry(np.arange(len(curvatures)) * float(knot_m), curvatures), speed_mps


def draw_line(rng: np.random.Generator, lateral_m: float) -> Stripe:
    """A line of the lane: any usual paint, sometimes worn, sometimes missing for a while."""
    gone = (np.inf, np.inf)
    if rng.random() < 0.3:
        start = rng.uniform(0, SECONDS)
        gone = (start, start + rng.uniform(0.5, 3))
    colour = YELLOW if rng.random() < 0.3 else WHITE
    dash = (None, DASH_M, (3.0, 9.0), (6.0, 18.0))[rng.choice(4, p=(0.4, 0.4, 0.1, 0.1))]
    wear = rng.choice([1.0, 0.5, 0.25], p=[0.6, 0.25, 0.15])
    colour = tuple(int(98 + wear * (c - 98)) for c in colour)
    return Stripe(lateral_m, rng.uniform(0.1, 0.2), colour, dash, rng.uniform(0, 12), gone)


def draw_clutter(rng: np.random.Generator, half_m: float) -> tuple[Stripe, ...]:
    """What looks a little like lines: seams, cracks, kerbs, the lines of other lanes."""
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
    """A drive, and the camera as the one who follows it believes it to be."""
    rng = np.random.default_rng(seed)
    road, speed_mps = draw_road(rng)
    half_m = rng.uniform(1.5, 1.9)
    shades = [Stripe(0, 12, along_m=(a, a + rng.uniform(3, 25))) for a in rng.uniform(0, 120, rng.poisson(1.0))]
    drive = PaintedDrive(
        road,
        (draw_line(rng, half_m), draw_line(rng, -half_m)),
        motion=Motion(
            rng.uniform(0, 200), speed_mps, rng.normal(0, 0.25), rng.uniform(0, 0.3), 6.5, abs(rng.normal(0, 0.004))
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
    believed = replace(
        pose,
        height_m=pose.height_m * (1 + rng.normal(0, 0.01)),
        pitch_rad=pose.pitch_rad + rng.normal(0, 0.002),
        yaw_rad=pose.yaw_rad + rng.normal(0, 0.002),
    )
    return drive, camera.with_pose(believed)


def drive_along(seed: int, camera: Camera = CAMERA, *, seconds: float = SECONDS, fps: float = FPS) -> tuple[list, list]:
    """Features, rightness and seed of each lane found on a painted road: followed, and in pictures on their own."""
    drive, camera = draw_drive(seed, camera)
    times = np.arange(int(seconds * fps)) / fps
    rows = [truth_row(drive.truth(time_s), frame=0) for time_s in times]
    truth = LaneTruth.from_columns({name: np.array([row[name] for row in rows], float) for name in rows[0]})
    return judge(map(drive.frame, times), camera, truth, fps=fps, number=seed)


def drive_through(drive: BenchmarkDrive, number: int) -> tuple[list, list]:
    """The same for a drive of the suite."""
    camera, fps = load_camera(drive.video.with_suffix(".yaml")), inspect_video(drive.video).fps
    return judge(read_frames(drive.video), camera, read_truth(drive), fps=fps, number=number)


def judge(
    frames: Iterable[np.ndarray], camera: Camera, truth: LaneTruth, *, fps: float, number: int
) -> tuple[list, list]:
    """Rows (features, right, `number`) of the lanes in the frames: followed, and in each ALONE_EVERY-th on its own."""
    tracker = LaneTracker(camera, fps=fps)
    followed, alone = [], []
    for frame, image in enumerate(frames):
        followed.append(tracker.update(image))
        if frame % ALONE_EVERY == 0:
            alone.append(TrackedLane.from_still(find_lane(image, tracker.view)))
    tables = []
    for said, every in ((followed, 1), (alone, ALONE_EVERY)):
        estimates = DriveEstimates.from_frames([tracker_estimate(tracked) for tracked in said], [0.0] * len(said))
        right = frame_errors(estimates, truth.select(slice(0, len(said) * every, every))).full_rms_m <= RIGHT_M
        rows = zip(said, right & truth.exists[: len(followed) : every], strict=True)
        tables.append([[*lane_features(one.lane), yes, number] for one, yes in rows if one.lane is not None])
    return tables[0], tables[1]


def fit_logistic(features: np.ndarray, right: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Weights by Newton's method on the log-likelihood, with a ridge so that no feature runs away.

    Parameters
    ----------
    features : ndarray (lanes, features)
    right : ndarray (lanes,)
        0 or 1.
    drive : ndarray (lanes,)
        Numbers of the drives: each drive counts as much as any other.
    """
    _, of, count = np.unique(drive, return_inverse=True, return_counts=True)
    worth, weights = WORTH / count[of], np.zeros(features.shape[1])
    for _ in range(50):
        chance = logistic(features @ weights)
        information = (features * (worth * chance * (1 - chance))[:, None]).T @ features + RIDGE * np.eye(len(weights))
        weights += np.linalg.solve(information, features.T @ (worth * (right - chance)) - RIDGE * weights)
    return weights


def logistic(odds: np.ndarray) -> np.ndarray:
    """Chances of logarithmic odds."""
    return 1 / (1 + np.exp(-odds))


def chances_of_others(features: np.ndarray, right: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Chances (lanes,) by weights that were fitted without the lane's own drive."""
    numbers = np.random.default_rng(0).permutation(np.unique(drive))
    chance = np.zeros(len(right))
    for part in np.array_split(numbers, PARTS):
        mine = np.isin(drive, part)
        chance[mine] = logistic(features[mine] @ fit_logistic(features[~mine], right[~mine], drive[~mine]))
    return chance


def tell(name: str, chance: np.ndarray, right: np.ndarray) -> None:
    """Print how often lanes of each confidence are right."""
    surprise = -np.mean(np.log(np.where(right, chance, 1 - chance) + 1e-9))
    print(f"{name}: {len(right)} lanes, {right.mean():.1%} right, {surprise:.3f} nats a lane")
    for low, high in ((0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.97), (0.97, 1.01), (0.9, 1.01)):
        some = (chance > low) & (chance <= high)
        if some.any():
            stated, share = chance[some].mean(), right[some].mean()
            print(
                f"  confidence {low:.2f} to {min(high, 1):.2f}: {some.sum():5d} lanes, {stated:.1%}, {share:.1%} right"
            )


def main() -> None:
    """Drive, fit, tell."""
    cv2.setNumThreads(1)
    check = "--check" in sys.argv
    suite = [] if check else choose_drives(sys.argv[1:])
    data = [drive_along(seed) for seed in (range(1000, 1000 + DRIVES // 2) if check else range(DRIVES))]
    data += [drive_through(drive.at_hand(), -1 - number) for number, drive in enumerate(suite)]
    for name, part, present in (("TRACK_WEIGHTS", 0, TRACK_WEIGHTS), ("STILL_WEIGHTS", 1, STILL_WEIGHTS)):
        rows = np.array([row for one in data for row in one[part]], float)
        features, right, drive = rows[:, :-2], rows[:, -2] > 0, rows[:, -1]
        tell(f"{name} as they are", logistic(features @ present), right)
        if not check:
            tell(f"{name}, of drives that were not in the fit", chances_of_others(features, right, drive), right)
            weights = fit_logistic(features, right, drive)
            print(name, dict(zip(FEATURES, np.round(weights, 2).tolist(), strict=True)))


if __name__ == "__main__":
    main()
