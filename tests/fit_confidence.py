"""Where the numbers of `lanes.metric.confidence` come from: drive along roads of known truth, count, fit.

    python tests/fit_confidence.py            drives (some minutes), fits, prints the weights and how well they hold
    python tests/fit_confidence.py --check    drives other roads and only says how well the present weights hold

Roads, paint, light, motion and errors of the mount are drawn at random, hard ones among them: worn paint, lines missing
for seconds, tar seams, bright cracks and kerbs that run along the lane, shadows, black pictures.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from drives import CAMERA, DASH_M, TAR, WHITE, YELLOW, PaintedDrive, Stripe  # noqa: E402

from lanes.camera import Camera  # noqa: E402
from lanes.metric.confidence import FEATURES, RIGHT_AT_M, RIGHT_M, STILL_WEIGHTS, TRACK_WEIGHTS, lane_features  # noqa: E402
from lanes.metric.lane import Lane, find_lane  # noqa: E402
from lanes.metric.lanemodel import SIDES  # noqa: E402
from lanes.metric.tracker import LaneTracker  # noqa: E402
from lanes.scenes.render import Motion  # noqa: E402
from lanes.scenes.road import RoadGeometry  # noqa: E402
from lanes.scenes.truth import Truth  # noqa: E402

DRIVES, SECONDS, FPS = 60, 3.0, 25.0
RIDGE = 1.0
# Frames of one drive are alike, so that drives are fewer than they look: the constant is lowered by this much.
CAUTION = 0.5


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
    mount = camera.mount
    believed = replace(
        mount,
        height_m=mount.height_m * (1 + rng.normal(0, 0.01)),
        pitch_rad=mount.pitch_rad + rng.normal(0, 0.002),
        yaw_rad=mount.yaw_rad + rng.normal(0, 0.002),
    )
    return drive, camera.with_mount(believed)


def is_right(lane: Lane, truth: Truth) -> bool:
    """Whether both lines are where they should be; see `lanes.metric.confidence`."""
    errors = [lane.line_y(RIGHT_AT_M, side) - truth.line_y(k, RIGHT_AT_M) for k, side in enumerate(SIDES)]
    return bool(np.all(np.sqrt(np.mean(np.square(errors), axis=1)) < RIGHT_M))


def drive_along(seed: int, camera: Camera = CAMERA, *, seconds: float = SECONDS, fps: float = FPS) -> tuple[list, list]:
    """Features, rightness and seed of each frame of a drive: followed, and each fifth picture on its own."""
    drive, camera = draw_drive(seed, camera)
    tracker = LaneTracker(camera, fps=fps)
    followed, alone = [], []
    for frame in range(int(seconds * fps)):
        time_s = frame / fps
        image, truth = drive.frame(time_s), drive.truth(time_s)
        tracked = tracker.update(image)
        if tracked.lane is not None:
            followed.append([*lane_features(tracked.lane), is_right(tracked.lane, truth), seed])
        if frame % 5 == 0 and (lane := find_lane(image, tracker.view)) is not None:
            alone.append([*lane_features(lane), is_right(lane, truth), seed])
    return followed, alone


def fit_logistic(features: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Weights by Newton's method on the log-likelihood, with a ridge so that no feature runs away."""
    weights = np.zeros(features.shape[1])
    for _ in range(50):
        chance = 1 / (1 + np.exp(-features @ weights))
        information = (features * (chance * (1 - chance))[:, None]).T @ features + RIDGE * np.eye(len(weights))
        weights += np.linalg.solve(information, features.T @ (right - chance) - RIDGE * weights)
    weights[0] -= CAUTION
    return weights


def tell(name: str, features: np.ndarray, right: np.ndarray, weights: np.ndarray) -> None:
    """Print how often lanes of each confidence are right."""
    chance = 1 / (1 + np.exp(-features @ weights))
    print(f"{name}: {len(right)} lanes, {right.mean():.1%} right")
    for low, high in ((0, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 0.97), (0.97, 1.01), (0.9, 1.01)):
        some = (chance > low) & (chance <= high)
        if some.any():
            share = right[some].mean()
            print(f"  confidence {low:.2f} to {min(high, 1):.2f}: {some.sum():5d} lanes, {share:.1%} right")


def main() -> None:
    """Drive, fit, tell."""
    cv2.setNumThreads(1)
    check = "--check" in sys.argv
    seeds = range(1000, 1000 + DRIVES // 2) if check else range(DRIVES)
    data = [drive_along(seed) for seed in seeds]
    for name, part, present in (("TRACK_WEIGHTS", 0, TRACK_WEIGHTS), ("STILL_WEIGHTS", 1, STILL_WEIGHTS)):
        rows = np.array([row for one in data for row in one[part]], float)
        features, right, seed = rows[:, :-2], rows[:, -2], rows[:, -1]
        if check:
            tell(name, features, right, present)
            continue
        half = seed % 2 == 0
        cross = fit_logistic(features[half], right[half])
        tell(f"{name}, fitted on half of the drives, on the others", features[~half], right[~half], cross)
        weights = fit_logistic(features, right)
        tell(f"{name}, fitted on all drives", features, right, weights)
        print(name, dict(zip(FEATURES, np.round(weights, 2).tolist(), strict=True)))


if __name__ == "__main__":
    main()
