"""Does the ranking on rendered drives agree with that on real ones?

    python -m lanes benchmark -o results
    python tests/rank_real.py ../shared/real results/benchmark.csv

The first argument is a folder with real pictures: camera_cal/ (boards), test_images/, stills/ (named after their drive)
and labels.jsonl. Each still is looked at on its own, the mount is estimated for each drive from all of its stills. The
rendered drives are looked at both ways, still by still and followed (from benchmark.csv); the measure is the share of
frames in which the lane is right.
"""

from __future__ import annotations

import sys
from itertools import combinations
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from lanes.benchmark.drives import list_drives  # noqa: E402
from lanes.benchmark.errors import frame_errors  # noqa: E402
from lanes.benchmark.labelled import score_stills  # noqa: E402
from lanes.benchmark.labels import LaneColumns, LineScore, read_labels, summarize_lines  # noqa: E402
from lanes.benchmark.readings import Readings  # noqa: E402
from lanes.benchmark.runner import true_lane  # noqa: E402
from lanes.benchmark.scores import score  # noqa: E402
from lanes.benchmark.systems import SYSTEMS, look_with  # noqa: E402
from lanes.benchmark.tables import format_table, read_scores  # noqa: E402
from lanes.calibration.boards import calibrate_folder  # noqa: E402
from lanes.camera import Camera  # noqa: E402
from lanes.camerafile import load_camera  # noqa: E402
from lanes.drives.mounts import mount_from_drive  # noqa: E402
from lanes.images import list_pictures  # noqa: E402
from lanes.video.videofile import read_frames  # noqa: E402

EVERY = 10
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


def score_scene(scene: str) -> dict[str, float]:
    """Share of a rendered drive's frames, every tenth and each on its own, in which a system is right."""
    drive = list_drives()[scene].at_hand()
    camera, truth = load_camera(drive.video.with_suffix(".yaml")), true_lane(drive).cut(slice(None, None, EVERY))
    images = [image for number, image in enumerate(read_frames(drive.video)) if number % EVERY == 0]
    right = {}
    for system in SYSTEMS:
        said = list(map(look_with(system, camera), images))
        right[system] = score([frame_errors(Readings.of(said, [0.0] * len(said)), truth)])["right_share"]
    return right


def agreement(first: list[float], second: list[float]) -> tuple[int, int]:
    """Pairs of systems that both put in the same order, and pairs in all; ties agree with nothing but ties."""
    pairs = list(combinations(zip(first, second, strict=True), 2))
    sign = [((a > c) - (a < c), (b > d) - (b < d)) for (a, b), (c, d) in pairs]
    return sum(one == other for one, other in sign), len(pairs)


def tell(name: str, real: dict[str, list[LineScore]], rendered: dict[str, float], followed: dict[str, float]) -> None:
    """Print what both say of each system, best on the real drive first, and how many pairs they order alike."""
    scores = {system: summarize_lines(lines) for system, lines in real.items()}
    order = sorted(scores, key=lambda system: -scores[system]["accuracy"])
    columns = ["real: points", "real: lines", "rendered: stills", "rendered: followed"]
    rows = {s: [scores[s]["accuracy"], scores[s]["matched"], rendered[s], followed[s]] for s in order}
    print(format_table(columns, {s: [f"{value:.3f}" for value in values] for s, values in rows.items()}))
    same, pairs = agreement([rows[s][0] for s in order], [rows[s][2] for s in order])
    print(f"{name}: {same} of {pairs} pairs of systems in the same order (real points, rendered stills)\n")


def main() -> None:
    """Score, compare, tell; for each drive and for all of them."""
    real, table = Path(sys.argv[1]), read_scores(sys.argv[2])
    lens, labels = calibrate_folder(real / "camera_cal"), read_labels(real / "labels.jsonl")
    drives = [scene for scene in DRIVES if scene in list_drives()]
    scores = {scene: score_drive(real, lens, labels, DRIVES[scene]) for scene in drives}
    rendered = {scene: score_scene(scene) for scene in drives}
    followed = {s: {row["system"]: row["right_share"] for row in table if row["scene"] == s} for s in drives}
    for scene in drives:
        tell(scene, scores[scene], rendered[scene], followed[scene])
    every = {system: [score for scene in drives for score in scores[scene][system]] for system in SYSTEMS}
    means = [{s: sum(part[d][s] for d in drives) / len(drives) for s in SYSTEMS} for part in (rendered, followed)]
    tell("all (rendered: mean of the drives)", every, *means)


if __name__ == "__main__":
    main()
