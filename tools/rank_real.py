"""Does the ranking on rendered drives agree with that on real ones? Prints a section of docs/benchmark in Markdown.

    python -m tools.rank_real ../shared/real

The argument is a folder with real pictures: camera_cal/ (boards), test_images/, stills/ (named after their drive) and
labels.jsonl. Both sides are measured alike: single pictures, the same rows, TuSimple's tolerance. On the real side the
pose is estimated for each drive from all of its stills; the rendered drives have their own.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmark.labels.stills import score_pictures, score_stills  # noqa: E402
from benchmark.labels.tusimple import LaneColumns, LineScore, read_labels  # noqa: E402
from benchmark.machine import describe_machine  # noqa: E402
from benchmark.suite_drives import list_drives  # noqa: E402
from benchmark.systems import SYSTEMS  # noqa: E402
from lanes.camera.calibration.boards import calibrate_folder  # noqa: E402
from lanes.camera.camera import Camera  # noqa: E402
from lanes.camera.camera_file import load_camera  # noqa: E402
from lanes.camera.pose_from_lanes.pose_from_files import pose_from_drive  # noqa: E402
from lanes.io.images import list_pictures  # noqa: E402
from lanes.io.video.reader import read_frames  # noqa: E402
from simulator.rendering.render import render_frame  # noqa: E402
from simulator.rendering.video import VIDEO_FPS  # noqa: E402
from simulator.road.truth import H_SAMPLES, line_pixels, visible_pixels  # noqa: E402
from simulator.scenes.suite import SUITE  # noqa: E402

EVERY = 10
# The rendered scene after each real drive, and how the names of its stills begin.
DRIVES = {
    "motorway": ("project", "test", "straight_lines"),
    "challenge": ("challenge",),
    "harder-challenge": ("harder",),
}
# Of a 95 % interval, percent.
RESAMPLINGS, BOUNDS = 4000, (2.5, 97.5)
TEXT = """\
## Does it agree with real roads?

The labelled stills of three real drives, and every tenth frame of the rendered drives after them, measured alike: each
picture on its own, share of the points met within TuSimple's tolerance (20 px / cos of the line's angle) in the rows in
which the real drive's labels have points; ego-lane variant, not the official score. Real labels are made by hand, the
rendered ones are the true lines where nothing stands before them. Real: lens calibrated, pose estimated from the same
stills; rendered: true lens and pose.

After +- is half the width of a 95 % interval (bootstrap over pictures; those of one drive resemble each other, so that
the true interval is wider). Two systems are *undecided* on a side if the interval of their difference there, picture by
picture, holds zero. Made by `python -m tools.rank_real FOLDER`, whose `FOLDER` is not part of the project, on
{machine}."""


@dataclass(frozen=True, eq=False)
class Side:
    """How many pictures, the share of points met (systems,), and what resampling makes of it (RESAMPLINGS, systems)."""

    pictures: int
    mean: np.ndarray
    means: np.ndarray

    @classmethod
    def of(cls, scores: dict[str, list[LineScore]], rng: np.random.Generator) -> Side:
        """From two scores a picture, left and right; a picture without a scored line is left out."""
        points = np.array([[np.nan if s.accuracy is None else s.accuracy for s in scores[name]] for name in SYSTEMS])
        lines = points.reshape(len(SYSTEMS), -1, 2)
        shares = np.nanmean(lines[:, np.isfinite(lines[0]).any(axis=1)], axis=2).T
        chosen = rng.integers(0, len(shares), (RESAMPLINGS, len(shares)))
        return cls(len(shares), shares.mean(axis=0), shares[chosen].mean(axis=1))

    @classmethod
    def joined(cls, sides: Sequence[Side]) -> Side:
        """All drives together, each as weighty as the others."""
        means = [np.mean([getattr(side, name) for side in sides], axis=0) for name in ("mean", "means")]
        return cls(sum(side.pictures for side in sides), *means)

    def cell(self, system: int) -> str:
        """Mean and half the width of its interval."""
        low, high = np.percentile(self.means[:, system], BOUNDS)
        return f"{self.mean[system]:.3f} +- {(high - low) / 2:.3f}"

    def order(self, first: int, second: int) -> int:
        """1 where the first system is surely better, -1 where the second one is, 0 where that is undecided."""
        low, high = np.percentile(self.means[:, first] - self.means[:, second], BOUNDS)
        return int(low > 0) - int(high < 0)


def score_real(real: Path, lens: Camera, labels: list[LaneColumns], begins: tuple[str, ...]) -> dict:
    """Scores of every system on a real drive's labelled stills."""
    pictures = [
        p for name in ("test_images", "stills") for p in list_pictures(real / name) if p.name.startswith(begins)
    ]
    camera, _ = pose_from_drive(lens, pictures)
    return score_stills(labels, real, camera, SYSTEMS)


def score_rendered(scene: str, rows: tuple[float, float]) -> dict:
    """The same on every tenth frame of a rendered drive, labelled by the truth between two rows."""
    video = list_drives()[scene].at_hand().video
    count = round(SUITE[scene].seconds * VIDEO_FPS)
    labels = [true_label(scene, number, rows) for number in range(0, count, EVERY)]
    pictures = (image for number, image in enumerate(read_frames(video)) if number % EVERY == 0)
    return score_pictures(labels, pictures, load_camera(video.with_suffix(".yaml")), SYSTEMS)


def true_label(scene: str, number: int, rows: tuple[float, float]) -> LaneColumns:
    """The lane in a frame, as a labeller would see it who knows where it is: not where things stand before it."""
    drive, time_s = SUITE[scene].drive(), number / VIDEO_FPS
    frame, camera = render_frame(drive, time_s), drive.camera_at(time_s)
    within = (rows[0] <= H_SAMPLES) & (rows[1] >= H_SAMPLES)
    columns = [visible_pixels(line_pixels(frame.truth, side, camera), frame.hidden)[within] for side in (0, 1)]
    return LaneColumns(f"{scene} {number}", H_SAMPLES[within], np.array(columns))


def labelled_rows(labels: list[LaneColumns]) -> tuple[float, float]:
    """Medians, over the labelled lines, of their first and their last row."""
    lines = [label.rows[column >= 0] for label in labels for column in label.columns if (column >= 0).any()]
    return float(np.median([line.min() for line in lines])), float(np.median([line.max() for line in lines]))


def tell(name: str, real: Side, rendered: Side) -> None:
    """A table, best on the real drive first, and which pairs of systems both sides put in the same order."""
    verdicts = {"same": [], "opposite": [], "undecided": []}
    for i, k in combinations(range(len(SYSTEMS)), 2):
        there, here = real.order(i, k), rendered.order(i, k)
        verdict = "undecided" if not there * here else "same" if there == here else "opposite"
        verdicts[verdict].append(f"{SYSTEMS[i]}/{SYSTEMS[k]}")
    counts = ", ".join(f"{len(pairs)} {verdict}" for verdict, pairs in verdicts.items())
    print(f"\n**{name} ({real.pictures} real pictures, {rendered.pictures} rendered); order of pairs: {counts}**\n")
    print("| | real | rendered |\n|---|---|---|")
    for system in np.argsort(-real.mean, kind="stable"):
        print(f"| {SYSTEMS[system]} | {real.cell(system)} | {rendered.cell(system)} |")
    told = [f"{verdict}: {', '.join(verdicts[verdict])}" for verdict in ("opposite", "undecided") if verdicts[verdict]]
    if told:
        print(f"\n{'; '.join(told)}.")


def main() -> None:
    """Score, compare, tell; for each drive and for all of them."""
    real = Path(sys.argv[1])
    lens, labels = calibrate_folder(real / "camera_cal"), read_labels(real / "labels.jsonl")
    rng = np.random.default_rng(0)
    sides = {}
    for scene, begins in DRIVES.items():
        mine = [label for label in labels if Path(label.name).name.startswith(begins)]
        there = Side.of(score_real(real, lens, mine, begins), rng)
        sides[scene] = there, Side.of(score_rendered(scene, labelled_rows(mine)), rng)
    print(TEXT.format(machine=describe_machine()))
    for scene, both in sides.items():
        tell(scene, *both)
    tell("all drives, each as weighty as the others", *map(Side.joined, zip(*sides.values(), strict=True)))


if __name__ == "__main__":
    main()
