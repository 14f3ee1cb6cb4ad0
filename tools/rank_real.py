"""Compare the ranking of the systems on real and on rendered drives; print the section of docs/benchmark in Markdown.

    python -m tools.rank_real ../shared/real

The argument is a folder with real pictures: camera_cal/ (chessboards), test_images/, stills/ (named after their drive)
and labels.jsonl. Both sides are scored in the same way: single pictures, the same rows, TuSimple's tolerance. The pose
of a real drive is estimated from all of its stills; rendered drives have their true pose.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmark.labels.stills import score_pictures
from benchmark.labels.tusimple import LaneColumns, LineScore, read_labels
from benchmark.machine import describe_machine
from benchmark.suite_drives import ensure_video, list_drives
from benchmark.systems import STILL_SYSTEMS
from lanes.calibration import calibrate_folder
from lanes.camera import Camera, load_camera
from lanes.images import list_pictures, read_image
from lanes.pose import pose_from_drive
from lanes.video.reader import read_video
from simulator.rendering.render import render_frame
from simulator.rendering.video import VIDEO_FPS
from simulator.road.truth import H_SAMPLES, line_pixels, visible_pixels
from simulator.scenes.suite import SUITE

EVERY = 10
# Scene -> prefixes of the stills of the real drive that it is modelled on.
DRIVES = {
    "motorway": ("project", "test", "straight_lines"),
    "challenge": ("challenge",),
    "harder-challenge": ("harder",),
}
# Bootstrap: number of resamplings, and percentiles of a 95 % interval.
RESAMPLINGS, BOUNDS = 4000, (2.5, 97.5)
TEXT = """\
## Comparison with real roads

The labelled stills of three real drives, and every tenth frame of the scenes that were rendered after them, scored in
the same way. Each picture is processed independently. The score is the mean accuracy: the share of points within
TuSimple's tolerance (20 px / cos of the line's angle), in the rows in which the labels of the real drive have points.
It is the ego-lane variant, not the official score. Real labels are made by hand; rendered labels are the true lines
where nothing hides them. Real pictures: calibrated lens, pose of each drive estimated from all of its stills. Rendered
pictures: true lens and pose.

The number after +- is half the width of a 95 % interval (bootstrap over pictures; pictures of one drive are
correlated, so the true interval is wider). Two systems are *undecided* on a side if the interval of their difference
there, picture by picture, contains zero. Made with `python -m tools.rank_real FOLDER`, whose `FOLDER` is not part of
the project, on
{machine}."""


@dataclass(frozen=True, eq=False)
class Side:
    """Number of pictures, mean accuracy (systems,), and its bootstrap samples (RESAMPLINGS, systems)."""

    pictures: int
    mean: np.ndarray
    means: np.ndarray

    @classmethod
    def from_scores(cls, scores: dict[str, list[LineScore]], rng: np.random.Generator) -> Side:
        """From the left and right score of each picture in turn; pictures without a scored line are left out."""
        points = np.array(
            [[np.nan if s.accuracy is None else s.accuracy for s in scores[name]] for name in STILL_SYSTEMS]
        )
        lines = points.reshape(len(STILL_SYSTEMS), -1, 2)
        shares = np.nanmean(lines[:, np.isfinite(lines[0]).any(axis=1)], axis=2).T
        chosen = rng.integers(0, len(shares), (RESAMPLINGS, len(shares)))
        return cls(len(shares), shares.mean(axis=0), shares[chosen].mean(axis=1))

    @classmethod
    def joined(cls, sides: Sequence[Side]) -> Side:
        """All drives together, equally weighted."""
        means = [np.mean([getattr(side, name) for side in sides], axis=0) for name in ("mean", "means")]
        return cls(sum(side.pictures for side in sides), *means)

    def cell(self, system: int) -> str:
        """Mean accuracy and half the width of its interval."""
        low, high = np.percentile(self.means[:, system], BOUNDS)
        return f"{self.mean[system]:.3f} +- {(high - low) / 2:.3f}"

    def order(self, first: int, second: int) -> int:
        """1 if the first system is better, -1 if the second one is, 0 if their difference is undecided."""
        low, high = np.percentile(self.means[:, first] - self.means[:, second], BOUNDS)
        return int(low > 0) - int(high < 0)


def score_real(real: Path, lens: Camera, labels: list[LaneColumns], prefixes: tuple[str, ...]) -> dict:
    """Scores of every system on a real drive's labelled stills."""
    pictures = [
        p for name in ("test_images", "stills") for p in list_pictures(real / name) if p.name.startswith(prefixes)
    ]
    camera, _ = pose_from_drive(lens, pictures)
    return score_pictures(labels, (read_image(real / label.name) for label in labels), camera, STILL_SYSTEMS)


def score_rendered(scene: str, rows: tuple[float, float]) -> dict:
    """Scores on every tenth frame of a rendered drive; the labels are the truth between two rows."""
    video = ensure_video(list_drives()[scene]).video
    count = round(SUITE[scene].seconds * VIDEO_FPS)
    labels = [true_label(scene, number, rows) for number in range(0, count, EVERY)]
    pictures = (image for number, image in enumerate(read_video(video)) if number % EVERY == 0)
    return score_pictures(labels, pictures, load_camera(video.with_suffix(".yaml")), STILL_SYSTEMS)


def true_label(scene: str, number: int, rows: tuple[float, float]) -> LaneColumns:
    """The true lane in a frame as a label: without the points that objects hide."""
    drive, time_s = SUITE[scene].drive(), number / VIDEO_FPS
    frame, camera = render_frame(drive, time_s), drive.camera_at(time_s)
    within = (rows[0] <= H_SAMPLES) & (rows[1] >= H_SAMPLES)
    columns = [visible_pixels(line_pixels(frame.truth, side, camera), frame.hidden)[within] for side in (0, 1)]
    return LaneColumns(f"{scene} {number}", H_SAMPLES[within], np.array(columns))


def labelled_rows(labels: list[LaneColumns]) -> tuple[float, float]:
    """Median of the first row, and of the last row, over all labelled lines."""
    lines = [label.rows[column >= 0] for label in labels for column in label.columns if (column >= 0).any()]
    return float(np.median([line.min() for line in lines])), float(np.median([line.max() for line in lines]))


def print_section(name: str, real: Side, rendered: Side) -> None:
    """Print a table, best system on the real drive first, and how both sides order the pairs of systems."""
    verdicts = {"same": [], "opposite": [], "undecided": []}
    for i, k in combinations(range(len(STILL_SYSTEMS)), 2):
        there, here = real.order(i, k), rendered.order(i, k)
        verdict = "undecided" if not there * here else "same" if there == here else "opposite"
        verdicts[verdict].append(f"{STILL_SYSTEMS[i]}/{STILL_SYSTEMS[k]}")
    counts = ", ".join(f"{len(pairs)} {verdict}" for verdict, pairs in verdicts.items())
    print(f"\n**{name} ({real.pictures} real pictures, {rendered.pictures} rendered); order of pairs: {counts}**\n")
    print("| | real | rendered |\n|---|---|---|")
    for system in np.argsort(-real.mean, kind="stable"):
        print(f"| {STILL_SYSTEMS[system]} | {real.cell(system)} | {rendered.cell(system)} |")
    if verdicts["opposite"]:
        print(f"\nopposite: {', '.join(verdicts['opposite'])}.")


def main() -> None:
    """Score and compare each drive, then all of them together."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="real pictures with their labels")
    real = parser.parse_args().folder
    lens, labels = calibrate_folder(real / "camera_cal"), read_labels(real / "labels.jsonl")
    rng = np.random.default_rng(0)
    sides = {}
    for scene, prefixes in DRIVES.items():
        own = [label for label in labels if Path(label.name).name.startswith(prefixes)]
        there = Side.from_scores(score_real(real, lens, own, prefixes), rng)
        sides[scene] = there, Side.from_scores(score_rendered(scene, labelled_rows(own)), rng)
    print(TEXT.format(machine=describe_machine()))
    for scene, both in sides.items():
        print_section(scene, *both)
    print_section("all drives, equally weighted", *map(Side.joined, zip(*sides.values(), strict=True)))


if __name__ == "__main__":
    main()
