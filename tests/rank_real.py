"""Does the ranking on rendered drives agree with that on real ones?

    python -m lanes benchmark -o results
    python tests/rank_real.py ../shared/real results/benchmark.csv

The first argument is a folder with real pictures: camera_cal/ (boards), test_images/, stills/ (named after their drive)
and labels.jsonl. Each still is looked at on its own, the mount is estimated for each drive from all of its stills. The
rendered drives were followed with memory; there the measure is the share of frames in which the lane is right.
"""

from __future__ import annotations

import sys
from itertools import combinations
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from lanes.benchmark.labelled import score_stills  # noqa: E402
from lanes.benchmark.labels import LaneColumns, LineScore, read_labels, summarize_lines  # noqa: E402
from lanes.benchmark.systems import SYSTEMS  # noqa: E402
from lanes.benchmark.tables import format_table, read_scores  # noqa: E402
from lanes.calibration.boards import calibrate_folder  # noqa: E402
from lanes.camera import Camera  # noqa: E402
from lanes.drives.mounts import mount_from_drive  # noqa: E402
from lanes.images import list_pictures  # noqa: E402

# The rendered scene after each real drive, and how the names of its stills begin.
DRIVES = {
    "motorway": ("project", "test", "straight_lines"),
    "challenge": ("challenge",),
    "harder-challenge": ("harder",),
}


def score_drive(real: Path, lens: Camera, labels: list[LaneColumns], begins: tuple[str, ...]) -> dict[str, list]:
    """Scores of every system on a real drive's labelled stills."""
    pictures = [
        p for name in ("test_images", "stills") for p in list_pictures(real / name) if p.name.startswith(begins)
    ]
    camera, _ = mount_from_drive(lens, pictures)
    mine = [label for label in labels if Path(label.name).name.startswith(begins)]
    return score_stills(mine, real, camera, SYSTEMS)


def agreement(first: list[float], second: list[float]) -> tuple[int, int]:
    """Pairs of systems that both put in the same order, and pairs in all; ties agree with nothing but ties."""
    pairs = list(combinations(zip(first, second, strict=True), 2))
    sign = [((a > c) - (a < c), (b > d) - (b < d)) for (a, b), (c, d) in pairs]
    return sum(one == other for one, other in sign), len(pairs)


def tell(name: str, real: dict[str, list[LineScore]], rendered: dict[str, float]) -> None:
    """Print what both say of each system, best on the real drive first, and how many pairs they order alike."""
    matched = {system: summarize_lines(lines) for system, lines in real.items()}
    order = sorted(matched, key=lambda system: -matched[system]["accuracy"])
    print(
        format_table(
            ["real: points", "real: lines", "rendered: frames"],
            {s: [f"{matched[s]['accuracy']:.3f}", f"{matched[s]['matched']:.3f}", f"{rendered[s]:.3f}"] for s in order},
        )
    )
    same, pairs = agreement([matched[s]["accuracy"] for s in order], [rendered[s] for s in order])
    print(f"{name}: {same} of {pairs} pairs of systems in the same order\n")


def main() -> None:
    """Score, compare, tell; for each drive and for all three."""
    real, table = Path(sys.argv[1]), read_scores(sys.argv[2])
    lens, labels = calibrate_folder(real / "camera_cal"), read_labels(real / "labels.jsonl")
    everything: dict[str, list[LineScore]] = {system: [] for system in SYSTEMS}
    frames = dict.fromkeys(SYSTEMS, 0.0)
    for scene, begins in DRIVES.items():
        scores = score_drive(real, lens, labels, begins)
        rendered = {row["system"]: row["right_share"] for row in table if row["scene"] == scene}
        for system in SYSTEMS:
            everything[system] += scores[system]
            frames[system] += rendered.get(system, float("nan")) / len(DRIVES)
        if rendered:
            tell(scene, scores, rendered)
    tell("all three (rendered: mean of the three)", everything, frames)


if __name__ == "__main__":
    main()
