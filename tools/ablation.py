"""What each mechanism of the engine is worth on real and on rendered roads, a row of a table for each.

    python -m tools.ablation --real FOLDER [--half A]      # labelled real stills and clips, see benchmark.real_roads
    python -m tools.ablation [--scenes NAME,...] [--seed 7] [--only NAME] [--workers N]

A mechanism is switched off by other settings; everything else stays the same. A row shows the result with it off minus
that of the engine as it is. On real roads: points of the share of label points, and images right, for each way to look
at them; choices are made on half A of the sets and confirmed on half B. On rendered drives, a variant that is not of
the tuning set: points of accuracy with their 95 % interval (bootstrap over drives), the 95th percentile of the lateral
error and NEES / 4.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.bootstrap import frame_clusters, mean_interval
from benchmark.consistency import consistency
from benchmark.errors import FrameErrors, NormalizedErrors, frame_errors, normalize_errors
from benchmark.evaluation import PreparedDrive, prepare_drive, read_truth, run_system
from benchmark.real_roads import WAYS, RoadSet, ScoredLane, read_road_sets, score_set
from benchmark.scored_drive import BenchmarkDrive, choose_drives, ensure_video
from benchmark.scores import score
from benchmark.systems import TRACKER
from lanes.console import bounded, progress_line
from lanes.detect.fit import FIT
from lanes.tracking.filter import FILTER
from lanes.tracking.tracker import TrackerSettings
from simulator.processes import run_all
from simulator.rendering.video import VIDEO_FPS


@dataclass(frozen=True)
class Mechanism:
    """A mechanism: its name, what it does, and the settings that switch it off, by their path in TrackerSettings."""

    name: str
    description: str
    off: dict[str, Any] = field(default_factory=dict)

    def settings(self) -> TrackerSettings:
        """The tracker's settings without the mechanism."""
        settings = TrackerSettings()
        for path, value in self.off.items():
            settings = with_value(settings, path.split("."), value)
        return settings


def with_value(settings: Any, path: Sequence[str], value: object) -> Any:
    """Nested settings with another value of the field at the end of a path."""
    name, *rest = path
    return replace(settings, **{name: with_value(getattr(settings, name), rest, value) if rest else value})


NONE, NEVER = 1e-9, float("inf")
# Mean, standard deviation and limit of a parameter of the road that stays 0.
STAYS_0 = (0.0, NONE, NONE)
PRIOR = "detector.fit.prior"
# Pairs of a standard deviation on straight roads and its growth.
GROWING = ("path_per_m_per_s", "rate_per_m2_per_m", "rate_step_per_m2_per_m", "vertical_per_m")
ALL_ON = Mechanism("all on", "the tracker as it is")
MECHANISMS = (
    Mechanism("double lines", "second width of the band filter", {"detector.paint.double_m": 0.15}),
    Mechanism("coarse columns", "columns averaged four at a time", {"detector.paint.coarse_columns": 1}),
    Mechanism("directions", "weights fall with the angle residual", {"detector.paint.angle_std_rad": 1e6}),
    Mechanism("five starts", "five start hypotheses, not one", {"detector.votes.lanes": 1}),
    Mechanism("undulation fit", "a search also fits a road that undulates", {"detector.fit.undulation_gain": NEVER}),
    Mechanism("small steps", "small steps of fits outwards", {"detector.fit.outwards": FIT.extend}),
    Mechanism("bend limit", "a radius of 15 m at least, far ahead", {"detector.fit.max_bend_per_m": (NEVER, 1.0)}),
    Mechanism("variance inflation", "stripes of a frame are correlated", {"detector.fit.variance_inflation": 1.0}),
    Mechanism("outward fits", "fits outwards after a poor fit", {"detector.fit.max_unexplained": 1.0}),
    Mechanism(
        "rate steps",
        "three changes of the curvature rate",
        {f"{PRIOR}.rate_step_per_m2": STAYS_0, f"{PRIOR}.rate_step_share": 0.0}
        | {"filter.rate_step_per_m2_per_m": (NONE, 0.0)},
    ),
    Mechanism(
        "vertical profile",
        "four vertical curvatures: crests and dips",
        {f"{PRIOR}.vertical_per_m": STAYS_0, f"{PRIOR}.vertical_bend_share": 0.0, f"{PRIOR}.vertical_share": 0.0}
        | {"filter.vertical_per_m": (NONE, 0.0), "filter.vertical_share": 0.0}
        | {"detector.fit.undulation_gain": NEVER},
    ),
    Mechanism(
        "shares of the prior",
        "deviations of the prior grow with the curvature",
        {f"{PRIOR}.transition_m": NEVER}
        | {f"{PRIOR}.{name}": 0.0 for name in ("curvature_share", "rate_step_share")}
        | {f"{PRIOR}.{name}": 0.0 for name in ("vertical_bend_share", "vertical_share")},
    ),
    Mechanism(
        "shares of the noise",
        "process noise grows with the curvature",
        {f"filter.{name}": (getattr(FILTER, name)[0], 0.0) for name in GROWING} | {"filter.vertical_share": 0.0},
    ),
    Mechanism("lever", "the rear axle moves along the car, not the camera", {"filter.lever_m": 0.0}),
    Mechanism("periodic search", "searches while tracking", {"search_period_s": NEVER}),
)


@dataclass(frozen=True, eq=False)
class Measurement:
    """What the tracker got wrong in the frames of a drive; `normalized` is None in scenes without a lane."""

    errors: FrameErrors
    normalized: NormalizedErrors | None


def measure(task: tuple[Mechanism, PreparedDrive], *, end_s: float | None = None) -> Measurement:
    """The errors of the tracker without a mechanism on a drive, before the time `end_s`."""
    mechanism, drive = task
    estimates = run_system(drive, TRACKER, end_s=end_s, settings=mechanism.settings())
    truth = read_truth(drive.drive).select(slice(len(estimates.offset_m)))
    return Measurement(frame_errors(estimates, truth), normalize_errors(estimates, truth))


def table_row(mechanism: Mechanism, off: Sequence[Measurement], on: Sequence[Measurement]) -> str:
    """A row of the Markdown table, from measurements of the same drives without and with a mechanism."""
    correct_off, correct_on, exists = (
        np.concatenate([getattr(one.errors, name) for one in some])
        for some, name in ((off, "correct"), (on, "correct"), (on, "exists"))
    )
    gained = 100.0 * (correct_off.astype(int) - correct_on)[exists]
    clusters = frame_clusters([len(one.errors.exists) for one in on], [VIDEO_FPS] * len(on))[exists]
    low, high = mean_interval(gained, clusters)
    change = f"{gained.mean():+.1f} ({low:+.1f} to {high:+.1f})" if mechanism.off else ""
    row = score([one.errors for one in off])
    nees = consistency(one.normalized for one in off if one.normalized)["nees_mean"]
    time_off, time_on = (sum(np.sum(one.errors.time_ms) for one in some) for some in (off, on))
    numbers = f"{row['accuracy']:.1%} | {change} | {row['lateral_5_20m_p95_m']:.3f} m | {nees:.2f}"
    return f"| {mechanism.name} | {mechanism.description} | {numbers} | {time_off / time_on:.2f} |"


def real_row(mechanism: Mechanism, off: Sequence[list[ScoredLane]], on: Sequence[list[ScoredLane]]) -> str:
    """A row of the table of real roads: label points (off minus on) and right images, for each way to look at them."""
    cells = []
    for some_off, some_on in zip(off, on, strict=True):
        points = [
            np.nanmean(np.concatenate([s.score.values["ego accuracy"] for s in some])) for some in (some_off, some_on)
        ]
        right_off, right_on = (sum(bool(s.score.right) for s in some) for some in (some_off, some_on))
        cells.append(f"{100 * (points[0] - points[1]):+.1f} | {right_on} -> {right_off} of {len(some_on)}")
    return f"| {mechanism.name} | {mechanism.description} | {' | '.join(cells)} |"


def score_roads(mechanism: Mechanism, sets: Sequence[RoadSet], *, workers: int) -> list[list[ScoredLane]]:
    """The lanes of all sets in each of the `WAYS`, without a mechanism."""
    tasks = [(roads, way) for way in WAYS for roads in sets]
    found = run_all(partial(score_set, settings=mechanism.settings()), tasks, workers=workers)
    return [[one for (_, w), some in zip(tasks, found, strict=True) if w == way for one in some] for way in WAYS]


def prepare(drive: BenchmarkDrive) -> PreparedDrive:
    """The drive with its video and camera."""
    return prepare_drive(ensure_video(drive, workers=1))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "--scenes",
        type=lambda text: text.split(","),
        default=[],
        metavar="NAME,...",
        help="scenes of the suite, or videos with truth and camera (default: all scenes)",
    )
    parser.add_argument("--seed", type=bounded(int, 0), default=7, metavar="N", help="variant (default: %(default)s)")
    parser.add_argument("--real", type=Path, metavar="FOLDER", help="folder of labelled sets of real roads")
    parser.add_argument("--half", choices=("A", "B", "AB"), default="AB", help="of the sets (default: both halves)")
    parser.add_argument("--only", choices=[m.name for m in MECHANISMS], metavar="NAME", help="a single mechanism")
    parser.add_argument(
        "--workers", type=bounded(int, 1), default=1, metavar="N", help="processes (default: %(default)s)"
    )


def main() -> None:
    """Measure and print a row for each mechanism."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    options = parser.parse_args()
    if options.real:
        print("| switched off | what it does | own pose, points | right | pose of the set | right | clips | right |")
        print("|---|---|---|---|---|---|---|---|")
        sets = [roads for roads in read_road_sets(options.real) if roads.half in options.half]
        look, row = partial(score_roads, sets=sets, workers=options.workers), real_row
    else:
        run = partial(run_all, workers=options.workers)
        drives = run(prepare, choose_drives(options.scenes, seed=options.seed), progress=progress_line("scenes"))
        print("| switched off | what it does | accuracy | off minus on, points | 95 % error | NEES / 4 | time |")
        print("|---|---|---|---|---|---|---|")
        look, row = (lambda mechanism: run(measure, [(mechanism, drive) for drive in drives])), table_row
    on = look(ALL_ON)
    for mechanism in (ALL_ON, *MECHANISMS):
        if mechanism is ALL_ON or options.only in (None, mechanism.name):
            print(row(mechanism, on if mechanism is ALL_ON else look(mechanism), on), flush=True)


if __name__ == "__main__":
    main()
