"""What each mechanism of the engine is worth on real and on rendered roads.

    python -m tools.ablation FOLDER [--half A] [--scenes NAME,...] [--seed 7]
        [--only NAME,...] [--together]

prints a table with a row for each mechanism. It is switched off by other settings;
everything else stays the same. The first columns are those of the labelled real roads
in FOLDER (`benchmark.real_roads`): with the mechanism off minus that of the engine as
it is, points of the share of label points, and images right, for each way to look at
them. Choices are made on half A of the sets and confirmed on half B. The other columns
are those of rendered drives, a variant that is not of the tuning set: points of
accuracy with their 95 % interval (bootstrap over drives), the 95th percentile of the
lateral error and NEES / 4. Without FOLDER there are only the rendered columns, with
`--scenes none` only the real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmark.consistency import consistency
from benchmark.errors import FrameErrors, frame_errors, joined
from benchmark.evaluation import (
    PreparedDrive,
    choose_drives,
    prepare_drive,
    read_truth,
    run_systems,
)
from benchmark.real_roads.scored import ScoredLane
from benchmark.real_roads.sets import RoadSet, add_road_arguments, choose_road_sets
from benchmark.real_roads.ways import WAYS, score_sets
from benchmark.scores import frame_clusters, mean_interval, score
from benchmark.systems import TRACKER
from benchmark.tables import markdown_row, markdown_table
from lanes.console import bounded, progress_line, split_names
from lanes.detect.fit import FitSettings
from lanes.score import summarize
from lanes.tracking.filter import FilterSettings
from lanes.tracking.tracker import TrackerSettings
from simulator.processes import run_all
from simulator.rendering.render import VIDEO_FPS

_FILTER = FilterSettings()


@dataclass(frozen=True)
class Mechanism:
    """A mechanism: its name, what it does, and the settings that switch it off.

    `off` has the values of the settings by their path in TrackerSettings.
    """

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
    if rest:
        value = with_value(getattr(settings, name), rest, value)
    return replace(settings, **{name: value})


NONE = 1e-9
NEVER = float("inf")
# Mean, standard deviation and limit of a parameter of the road that stays 0.
STAYS_0 = (0.0, NONE, NONE)
ALL_ON = Mechanism("all on", "the tracker as it is")
MECHANISMS = (
    Mechanism(
        "double lines",
        "second width of the band filter",
        {"detector.paint.double_m": 0.15},
    ),
    Mechanism(
        "coarse columns",
        "columns averaged four at a time",
        {"detector.paint.coarse_columns": 1},
    ),
    Mechanism(
        "directions",
        "weights fall with the angle residual",
        {"detector.paint.angle_std_rad": 1e6},
    ),
    Mechanism(
        "five starts",
        "five start hypotheses, not one",
        {"detector.votes.lanes": 1},
    ),
    Mechanism(
        "undulation fit",
        "a search also fits a road that undulates",
        {"detector.fit.undulation_gain": NEVER},
    ),
    Mechanism(
        "small steps",
        "small steps of fits outwards",
        {"detector.fit.outwards": FitSettings().extend},
    ),
    Mechanism(
        "variance inflation",
        "stripes of a frame are correlated",
        {"detector.fit.variance_inflation": 1.0},
    ),
    Mechanism(
        "outward fits",
        "fits outwards after a poor fit",
        {"detector.fit.max_unexplained": 1.0},
    ),
    Mechanism(
        "rate steps",
        "three changes of the curvature rate",
        {
            "detector.fit.prior.rate_step_per_m2": STAYS_0,
            "detector.fit.prior.rate_step_share": 0.0,
            "filter.rate_step_per_m2_per_m": (NONE, 0.0),
        },
    ),
    Mechanism(
        "vertical profile",
        "four vertical curvatures: crests and dips",
        {
            "detector.fit.prior.vertical_per_m": STAYS_0,
            "detector.fit.prior.vertical_bend_share": 0.0,
            "detector.fit.prior.vertical_share": 0.0,
            "filter.vertical_per_m": (NONE, 0.0),
            "filter.vertical_share": 0.0,
            "detector.fit.undulation_gain": NEVER,
        },
    ),
    Mechanism(
        "shares of the prior",
        "deviations of the prior grow with the curvature",
        {
            "detector.fit.prior.transition_m": NEVER,
            "detector.fit.prior.curvature_share": 0.0,
            "detector.fit.prior.rate_step_share": 0.0,
            "detector.fit.prior.vertical_bend_share": 0.0,
            "detector.fit.prior.vertical_share": 0.0,
        },
    ),
    # Pairs of a standard deviation on straight roads and its growth.
    Mechanism(
        "shares of the noise",
        "process noise grows with the curvature",
        {
            "filter.path_per_m_per_s": (_FILTER.path_per_m_per_s[0], 0.0),
            "filter.rate_per_m2_per_m": (_FILTER.rate_per_m2_per_m[0], 0.0),
            "filter.rate_step_per_m2_per_m": (_FILTER.rate_step_per_m2_per_m[0], 0.0),
            "filter.vertical_per_m": (_FILTER.vertical_per_m[0], 0.0),
            "filter.vertical_share": 0.0,
        },
    ),
    Mechanism(
        "lever",
        "the rear axle moves along the car, not the camera",
        {"filter.lever_m": 0.0},
    ),
    Mechanism(
        "static pattern",
        "stripes that never move are left out",
        {"static_period_s": NEVER},
    ),
    Mechanism(
        "wrong yaw",
        "a car that stands askew has an unknown yaw",
        {"filter.standing": (-1.0, 0.0, 0.0)},
    ),
    Mechanism(
        "periodic search",
        "searches while tracking",
        {"search_period_s": NEVER},
    ),
)


def measure(
    task: tuple[Mechanism, PreparedDrive], *, end_s: float | None = None
) -> FrameErrors:
    """The errors of the tracker without a mechanism on a drive before `end_s`."""
    mechanism, drive = task
    settings = mechanism.settings()
    (estimates,) = run_systems(drive, [(TRACKER, 1)], end_s=end_s, settings=settings)
    frames = slice(len(estimates.offset_m))
    return frame_errors(estimates, read_truth(drive.drive).select(frames))


def rendered_cells(off: Sequence[FrameErrors], on: Sequence[FrameErrors]) -> list[str]:
    """Cells of the table: the same rendered drives without and with a mechanism."""
    usual = joined(on)
    exists = usual.exists
    correct = joined(off).correct[exists].astype(int)
    gained = 100.0 * (correct - usual.correct[exists])

    frames = [len(of_drive.exists) for of_drive in on]
    clusters = frame_clusters(frames, [VIDEO_FPS] * len(on))
    low, high = mean_interval(gained, clusters[exists])
    row = score(off)
    return [
        f"{row['accuracy']:.1%}",
        f"{gained.mean():+.1f} ({low:+.1f} to {high:+.1f})",
        f"{row['lateral_5_20m_p95_m']:.3f} m",
        f"{consistency(off)['nees_mean']:.2f}",
    ]


def real_cells(
    off: Sequence[list[ScoredLane]], on: Sequence[list[ScoredLane]]
) -> list[str]:
    """Cells of the table: the lanes of the same labels without and with a mechanism.

    Both are those of each of the `WAYS`.
    """
    cells = []
    for lanes_off, lanes_on in zip(off, on, strict=True):
        gained = 100 * (_point_share(lanes_off) - _point_share(lanes_on))
        right = sum(bool(one.score.right) for one in lanes_off)
        cells += [f"{gained:+.1f}", f"{right} of {len(lanes_on)}"]
    return cells


def _point_share(lanes: Sequence[ScoredLane]) -> float:
    """Share of right label points; NaN without a lane."""
    if not lanes:
        return np.nan
    return summarize([one.score for one in lanes])["ego accuracy"]


REAL_COLUMNS = []
for _way in WAYS:
    REAL_COLUMNS += [f"{_way}, points", "right"]
RENDERED_COLUMNS = ["rendered", "off minus on", "95 % error", "NEES / 4"]


def choose_roads(
    options: argparse.Namespace,
) -> tuple[list[RoadSet], list[PreparedDrive]]:
    """The labelled sets and the rendered drives that are asked for."""
    sets = choose_road_sets(options) if options.folder else []
    chosen = []
    if options.scenes != ["none"]:
        chosen = choose_drives(options.scenes, seed=options.seed)
    progress = progress_line("scenes")
    drives = run_all(prepare_drive, chosen, workers=options.workers, progress=progress)
    return sets, drives


def measure_all(
    mechanism: Mechanism,
    sets: Sequence[RoadSet],
    drives: Sequence[PreparedDrive],
    *,
    workers: int,
) -> tuple[list[list[ScoredLane]], list[FrameErrors]]:
    """What is found without a mechanism.

    It is the lanes on real roads in each of the `WAYS`, and the errors in drives.
    """
    lanes = []
    if sets:
        for way in WAYS:
            of_sets = score_sets(sets, way, mechanism.settings(), workers=workers)
            lanes.append([one for of_set in of_sets for one in of_set])
    tasks = [(mechanism, drive) for drive in drives]
    return lanes, run_all(measure, tasks, workers=workers)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_road_arguments(parser, optional=True)
    parser.add_argument(
        "--scenes",
        type=split_names,
        default=[],
        metavar="NAME,...",
        help="scenes of the suite, or videos with truth and camera (default: all "
        "scenes)",
    )
    parser.add_argument(
        "--seed",
        type=bounded(int, 0),
        default=7,
        metavar="N",
        help="variant (default: %(default)s)",
    )
    parser.add_argument(
        "--only",
        type=split_names,
        default=[],
        metavar="NAME,...",
        help="some mechanisms",
    )
    parser.add_argument(
        "--together", action="store_true", help="switch them off together, in one row"
    )


def choose_mechanisms(names: Sequence[str]) -> list[Mechanism]:
    """The mechanisms with these names, or all; ValueError if there is no such one."""
    known = {mechanism.name: mechanism for mechanism in MECHANISMS}
    unknown = set(names) - known.keys()
    if unknown:
        raise ValueError(
            f"no mechanism {', '.join(unknown)}; they are {', '.join(known)}"
        )
    if not names:
        return list(MECHANISMS)
    return [mechanism for mechanism in MECHANISMS if mechanism.name in names]


def combine(mechanisms: Sequence[Mechanism]) -> Mechanism:
    """All of them as one mechanism."""
    off = {}
    for mechanism in mechanisms:
        off.update(mechanism.off)
    names = " + ".join(mechanism.name for mechanism in mechanisms)
    return Mechanism(names, "together", off)


def main() -> None:
    """Measure and print a row for each mechanism."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_arguments(parser)
    options = parser.parse_args()
    try:
        mechanisms = choose_mechanisms(options.only)
    except ValueError as error:
        parser.error(str(error))
    if options.together:
        mechanisms = [combine(mechanisms)]

    sets, drives = choose_roads(options)
    headings = ["switched off", "what it does"]
    headings += REAL_COLUMNS if sets else []
    headings += RENDERED_COLUMNS if drives else []
    print(markdown_table(headings, []), flush=True)

    lanes_on, errors_on = measure_all(ALL_ON, sets, drives, workers=options.workers)
    for mechanism in (ALL_ON, *mechanisms):
        lanes, errors = lanes_on, errors_on
        if mechanism is not ALL_ON:
            lanes, errors = measure_all(
                mechanism, sets, drives, workers=options.workers
            )
        cells = [mechanism.name, mechanism.description]
        cells += real_cells(lanes, lanes_on)
        if drives:
            cells += rendered_cells(errors, errors_on)
        print(markdown_row(cells), flush=True)


if __name__ == "__main__":
    main()
