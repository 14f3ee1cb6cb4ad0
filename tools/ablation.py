"""Ablation of the lane engine: accuracy and time with each mechanism switched off, one at a time.

    python -m tools.ablation [--scenes NAME,...] [--only NAME] [--labels labels.jsonl --camera camera.yaml]

The default scenes are the three committed videos; other scenes of the suite are rendered when they are missing. With
labels, hand-labelled stills are scored, too. The result is a Markdown table. A mechanism is switched off by other
parameters or another function, in every module of `lanes.detect` and `lanes.track` that uses it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np

from benchmark.errors import FrameErrors, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.evaluation import PreparedDrive, prepare_drive, read_truth, run_system
from benchmark.labels.stills import score_pictures
from benchmark.labels.tusimple import LaneColumns, read_labels, summarize_lines
from benchmark.scored_drive import COMMITTED, choose_drives, ensure_video
from benchmark.scores import score
from benchmark.systems import TRACKER as SYSTEM
from lanes.camera import Camera, load_camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import FIT, LaneFit, fit_near
from lanes.detect.paint import MARKINGS, Stripes, yellowness
from lanes.detect.road import (
    BEND,
    BENDS_AT_NODES,
    CURVATURE,
    NODES_M,
    PARAMETERS,
    PRIOR,
    RATE_STEPS,
    bend_gradients,
    height_and_grade,
    max_curvature,
)
from lanes.detect.votes import best_pairs
from lanes.images import read_image
from lanes.track.filter import CAR_PARAMETERS, PROCESS_NOISE, UPDATE, KalmanState, update_lane
from lanes.track.tracker import TRACKER

# A parameter instance or function of `lanes.detect` and `lanes.track`, and what takes its place.
Replacement = tuple[object, object]


@dataclass(frozen=True)
class Switch:
    """A mechanism: its name, what it does, and the replacements that switch it off."""

    name: str
    description: str
    replacements: tuple[Replacement, ...]


@dataclass(frozen=True, eq=False)
class Measurement:
    """Errors of the frames of each drive, and the accuracy on labelled stills (NaN without any)."""

    drives: list[FrameErrors]
    stills_accuracy: float = float("nan")


def no_yellowness(view_image: np.ndarray) -> np.ndarray:
    """In place of `yellowness`: 0 everywhere."""
    return np.zeros(view_image.shape[:2], np.int16)


def no_steps(along_m: np.ndarray) -> np.ndarray:
    """In place of `bend_gradients`: rate steps have no effect and stay 0."""
    gradients = bend_gradients(along_m)
    gradients[:, np.isin(BEND, np.arange(PARAMETERS)[RATE_STEPS])] = 0
    return gradients


def flat_road(x_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """In place of `height_and_grade`: vertical curvature has no effect and stays 0."""
    heights, grades = height_and_grade(x_m)
    return np.zeros_like(heights), np.zeros_like(grades)


def curvature_at_car(lane: np.ndarray) -> float:
    """In place of `max_curvature`: that at the car."""
    return abs(float(lane[CURVATURE]))


def update_near(stripes: Stripes, estimate: KalmanState, view: BirdsEyeView, *, outwards: bool = True) -> LaneFit:
    """In place of `update_lane`: only the fit near the prediction."""
    return fit_near(stripes, estimate.lane, estimate.lane_covariance, view)


def _parameters(name: str, description: str, instance: object, **changes: object) -> Switch:
    return Switch(name, description, ((instance, replace(instance, **changes)),))


_NO_SHARES = {"rate_step_share": 0.0, "vertical_bend_share": 0.0, "vertical_share": 0.0}
_SMALL_PRIOR = {"curvature_share": 0.0, "transition_m": np.inf} | _NO_SHARES
_SMALL_NOISE = {"path_share_per_s": 0.0, "rate_square_share": 0.0} | _NO_SHARES
ALL_ON = Switch("all on", "the engine as it is", ())
SWITCHES = (
    Switch("yellowness", "second channel for yellow markings", ((yellowness, no_yellowness),)),
    _parameters("double lines", "second width of the band filter", MARKINGS, double_m=MARKINGS.single_m),
    _parameters("coarse columns", "directions from columns averaged four at a time", MARKINGS, coarse_columns=1),
    _parameters("directions", "weights fall with the angle residual", MARKINGS, angle_std_rad=1e6),
    Switch("five starts", "five start hypotheses, not one", ((best_pairs, partial(best_pairs, most=1)),)),
    _parameters("three fits", "three start hypotheses are fitted to the end, not one", FIT, hypotheses=1),
    _parameters("undulation fit", "a search also fits a road that undulates", FIT, undulation_gain=np.inf),
    _parameters("small steps", "small steps of fits outwards", FIT, outwards=FIT.extend),
    Switch("outward fits", "both fits outwards after a poor fit near the prediction", ((update_lane, update_near),)),
    _parameters("inflated covariance", "second fit outwards, with inflated covariance", UPDATE, inflated_gain=np.inf),
    _parameters("bend limit", "roads bend with a radius of 15 m at most, far ahead", FIT, max_bend_per_m=np.inf),
    _parameters("model error", "standard deviation that grows with the distance", FIT, model_error_m=0.0),
    _parameters("variance inflation", "correlated errors of the stripes of a frame", FIT, variance_inflation=1.0),
    Switch(
        "rate steps",
        "three changes of the curvature rate",
        ((bend_gradients, no_steps), (BENDS_AT_NODES, no_steps(NODES_M))),
    ),
    Switch("vertical profile", "four vertical curvatures: crests and dips", ((height_and_grade, flat_road),)),
    _parameters("shares of the prior", "prior deviations grow with the curvature", PRIOR, **_SMALL_PRIOR),
    _parameters("shares of the noise", "process noise grows with the curvature", PROCESS_NOISE, **_SMALL_NOISE),
    Switch("bend ahead", "a bend ahead counts as if the car were in it", ((max_curvature, curvature_at_car),)),
    _parameters("camera lever", "distance of the camera from the rear axle", CAR_PARAMETERS, lever_m=0.0),
    _parameters(
        "periodic search",
        "searches while tracking",
        TRACKER,
        search_period_s=np.inf,
        sure_search_period_s=np.inf,
    ),
)


def importers(value: object) -> list[tuple[ModuleType, str]]:
    """Modules of `lanes.detect` and `lanes.track` that hold an object, and its name there."""
    modules = [module for name, module in sys.modules.items() if name.startswith(("lanes.detect", "lanes.track"))]
    return [(module, name) for module in modules for name, own in vars(module).items() if own is value]


@contextmanager
def switched_off(switch: Switch) -> Iterator[None]:
    """The engine without a mechanism, in the `with` block."""
    patches = [(*place, old, new) for old, new in switch.replacements for place in importers(old)]
    try:
        for module, name, _, new in patches:
            setattr(module, name, new)
        yield
    finally:
        for module, name, old, _ in patches:
            setattr(module, name, old)


def measure(
    switch: Switch,
    drives: Sequence[PreparedDrive],
    *,
    labels: Sequence[LaneColumns] = (),
    pictures: Sequence[np.ndarray] = (),
    camera: Camera | None = None,
    end_s: float | None = None,
) -> Measurement:
    """Errors without a mechanism.

    Parameters
    ----------
    switch : Switch
    drives : sequence of PreparedDrive
        With their videos.
    labels, pictures : sequence of LaneColumns, sequence of ndarray
        Stills that `camera` took.
    end_s : float, optional
        Only the frames of each drive before this time.
    """
    with switched_off(switch):
        estimates = [run_system(drive, SYSTEM, end_s=end_s) for drive in drives]
        lines = score_pictures(labels, pictures, camera, [SYSTEM])[SYSTEM] if labels else []
    errors = [_errors(drive, own) for drive, own in zip(drives, estimates, strict=True)]
    return Measurement(errors, summarize_lines(lines)["accuracy"])


def _errors(drive: PreparedDrive, estimates: DriveEstimates) -> FrameErrors:
    truth = read_truth(drive.drive).select(slice(len(estimates.offset_m)))
    return frame_errors(estimates, truth, drive.camera)


def table_row(switch: Switch, result: Measurement, all_on: Measurement) -> str:
    """A row of the Markdown table."""
    row = score(result.drives)
    stills = "" if np.isnan(result.stills_accuracy) else f"{result.stills_accuracy:.1%}"
    time_ms, all_on_ms = (sum(float(np.sum(errors.time_ms)) for errors in own.drives) for own in (result, all_on))
    numbers = f"{row['accuracy']:.1%} | {row['lateral_5_20m_p95_m']:.3f} m | {stills} | {time_ms / all_on_ms:.2f}"
    return f"| {switch.name} | {switch.description} | {numbers} |"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "--scenes",
        type=lambda text: text.split(","),
        default=list(COMMITTED),
        metavar="NAME,...",
        help="scenes of the suite, or videos with truth and camera (default: the committed videos)",
    )
    parser.add_argument("--only", choices=[s.name for s in SWITCHES], metavar="NAME", help="a single mechanism")
    parser.add_argument("--labels", type=Path, metavar="JSONL", help="labelled stills in TuSimple's format")
    parser.add_argument("--camera", type=Path, metavar="YAML", help="camera of the labelled stills, with pose")


def main() -> None:
    """Measure and print a row for each mechanism."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    options = parser.parse_args()
    if bool(options.labels) != bool(options.camera):
        parser.error("--labels and --camera belong together")
    cv2.setNumThreads(1)
    drives = [prepare_drive(ensure_video(drive)) for drive in choose_drives(options.scenes)]
    run = partial(measure, drives=drives)
    if options.labels:
        labels, camera = read_labels(options.labels), load_camera(options.camera)
        pictures = [read_image(options.labels.parent / label.name) for label in labels]
        run = partial(run, labels=labels, pictures=pictures, camera=camera)
    print(
        "| switched off | what it does | accuracy | 95 % error, 5 to 20 m | stills | time |\n|---|---|---|---|---|---|"
    )
    all_on = run(ALL_ON)
    print(table_row(ALL_ON, all_on, all_on), flush=True)
    for switch in SWITCHES:
        if options.only in (None, switch.name):
            print(table_row(switch, run(switch), all_on), flush=True)


if __name__ == "__main__":
    main()
