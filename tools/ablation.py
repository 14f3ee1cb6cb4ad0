"""What each mechanism of the engine is worth on real and on rendered roads: a table with a row for each.

    python -m tools.ablation FOLDER [--half A] [--scenes NAME,...] [--seed 7] [--only NAME,...] [--together]

A mechanism is switched off by other settings; everything else stays the same. The first columns are those of the
labelled real roads in FOLDER (`benchmark.real_roads`): with the mechanism off minus that of the engine as it is, points
of the share of label points, and images right, for each way to look at them. Choices are made on half A of the sets and
confirmed on half B. The other columns are those of rendered drives, a variant that is not of the tuning set: points of
accuracy with their 95 % interval (bootstrap over drives), the 95th percentile of the lateral error and NEES / 4.
Without FOLDER there are only the rendered columns, with `--scenes none` only the real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from benchmark.consistency import consistency
from benchmark.errors import FrameErrors, frame_errors, joined
from benchmark.evaluation import PreparedDrive, choose_drives, prepare_drive, read_truth, run_systems
from benchmark.real_roads import WAYS, RoadSet, ScoredLane, add_road_arguments, read_road_sets, score_sets
from benchmark.scores import frame_clusters, mean_interval, score
from benchmark.systems import TRACKER
from benchmark.tables import markdown_table
from lanes.console import bounded, progress_line
from lanes.detect.fit import FIT
from lanes.score import summarize
from lanes.tracking.filter import FILTER
from lanes.tracking.tracker import TrackerSettings
from simulator.processes import run_all
from simulator.rendering.render import VIDEO_FPS


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
    Mechanism("static pattern", "stripes that never move are left out", {"static_period_s": NEVER}),
    Mechanism("wrong yaw", "a car that stands askew has an unknown yaw", {"filter.standing": (-1.0, 0.0, 0.0)}),
    Mechanism("periodic search", "searches while tracking", {"search_period_s": NEVER}),
)


def measure(task: tuple[Mechanism, PreparedDrive], *, end_s: float | None = None) -> FrameErrors:
    """The errors of the tracker without a mechanism on a drive, before the time `end_s`."""
    mechanism, drive = task
    (estimates,) = run_systems(drive, [(TRACKER, 1)], end_s=end_s, settings=mechanism.settings())
    return frame_errors(estimates, read_truth(drive.drive).select(slice(len(estimates.offset_m))))


def rendered_cells(off: Sequence[FrameErrors], on: Sequence[FrameErrors]) -> list[str]:
    """Cells of the table from the errors in the same rendered drives without and with a mechanism."""
    without, usual = joined(off), joined(on)
    exists = usual.exists
    gained = 100.0 * (without.correct.astype(int) - usual.correct)[exists]
    clusters = frame_clusters([len(one.exists) for one in on], [VIDEO_FPS] * len(on))[exists]
    low, high = mean_interval(gained, clusters)
    row, nees = score(off), consistency(off)["nees_mean"]
    change = f"{gained.mean():+.1f} ({low:+.1f} to {high:+.1f})"
    return [f"{row['accuracy']:.1%}", change, f"{row['lateral_5_20m_p95_m']:.3f} m", f"{nees:.2f}"]


def real_cells(off: Sequence[list[ScoredLane]], on: Sequence[list[ScoredLane]]) -> list[str]:
    """Cells of the table from lanes of the same labels, in each of the `WAYS`, without and with a mechanism."""
    cells = []
    for some in zip(off, on, strict=True):
        scores = [[one.score for one in scored] for scored in some]
        points = [summarize(of_way)["ego accuracy"] if of_way else np.nan for of_way in scores]
        right = [sum(bool(score.right) for score in of_way) for of_way in scores]
        cells += [f"{100 * (points[0] - points[1]):+.1f}", f"{right[0]} of {len(some[1])}"]
    return cells


REAL_COLUMNS = [heading for way in WAYS for heading in (f"{way}, points", "right")]
RENDERED_COLUMNS = ["rendered", "off minus on", "95 % error", "NEES / 4"]


def choose_roads(options: argparse.Namespace) -> tuple[list[RoadSet], list[PreparedDrive]]:
    """The labelled sets and the rendered drives that are asked for."""
    sets = read_road_sets(options.folder) if options.folder else []
    chosen = choose_drives(options.scenes, seed=options.seed) if options.scenes != ["none"] else []
    drives = run_all(prepare_drive, chosen, workers=options.workers, progress=progress_line("scenes"))
    return [roads for roads in sets if roads.half in options.half], drives


def measure_all(
    mechanism: Mechanism, sets: Sequence[RoadSet], drives: Sequence[PreparedDrive], *, workers: int
) -> tuple[list[list[ScoredLane]], list[FrameErrors]]:
    """What is found without a mechanism: the lanes on real roads in each of the `WAYS`, and the errors in drives."""
    ways = (score_sets(sets, way, mechanism.settings(), workers=workers) for way in WAYS if sets)
    errors = run_all(measure, [(mechanism, drive) for drive in drives], workers=workers)
    return [[one for some in of_way for one in some] for of_way in ways], errors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_road_arguments(parser, optional=True)
    scenes = "scenes of the suite, or videos with truth and camera (default: all scenes)"
    split = partial(str.split, sep=",")
    parser.add_argument("--scenes", type=split, default=[], metavar="NAME,...", help=scenes)
    parser.add_argument("--seed", type=bounded(int, 0), default=7, metavar="N", help="variant (default: %(default)s)")
    parser.add_argument("--only", type=split, default=[], metavar="NAME,...", help="some mechanisms")
    parser.add_argument("--together", action="store_true", help="switch them off together, in one row")


def main() -> None:
    """Measure and print a row for each mechanism."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    options = parser.parse_args()
    if unknown := set(options.only) - {mechanism.name for mechanism in MECHANISMS}:
        parser.error(f"no mechanism {', '.join(unknown)}; they are {', '.join(m.name for m in MECHANISMS)}")
    rows = [mechanism for mechanism in MECHANISMS if not options.only or mechanism.name in options.only]
    if options.together:
        off = {path: value for mechanism in rows for path, value in mechanism.off.items()}
        rows = [Mechanism(" + ".join(mechanism.name for mechanism in rows), "together", off)]
    sets, drives = choose_roads(options)
    columns = (REAL_COLUMNS if sets else []) + (RENDERED_COLUMNS if drives else [])
    print(markdown_table(["switched off", "what it does", *columns], []), flush=True)
    lanes_on, errors_on = measure_all(ALL_ON, sets, drives, workers=options.workers)
    for mechanism in (ALL_ON, *rows):
        lanes, errors = lanes_on, errors_on
        if mechanism is not ALL_ON:
            lanes, errors = measure_all(mechanism, sets, drives, workers=options.workers)
        cells = real_cells(lanes, lanes_on) + (rendered_cells(errors, errors_on) if drives else [])
        print(f"| {' | '.join([mechanism.name, mechanism.description, *cells])} |", flush=True)


if __name__ == "__main__":
    main()
