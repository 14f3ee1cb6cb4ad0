"""Accuracy of the fit if the evidence were perfect: stripes that lie exactly on the true lines of a scene.

    python -m tools.perfect_evidence [SCENE ...] [--seed N]

Each frame of the scenes (by default those with hairpins) is fitted alone, from the true lane as start. Only points of
the lines inside the picture are stripes; nothing is rendered. What is wrong here cannot be seen in a single picture, or
the lane model cannot describe it. A tracker can do better, because it remembers what it has seen before.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from benchmark.errors import FrameErrors, LaneTruth, frame_errors
from benchmark.estimates import ALONG_M, DriveEstimates, LaneEstimate
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.fit import FIT, fit_lanes
from lanes.detect.paint import Stripes
from lanes.detect.road import CENTRE, CURVATURE, HEADING, SIDES, line_points, parameter_vector
from simulator.rendering.drive import Drive
from simulator.road.truth import H_SAMPLES, Truth, line_pixels, truth_row
from simulator.scenes.suite import SUITE
from simulator.scenes.variants import vary_drive

HAIRPINS = ("harder-challenge", "hairpin-left", "hairpin-right", "switchback")
FPS = 25.0
# Strength of fresh paint, in units of the local noise.
STRENGTH = 50.0
# The true lane is known: a search in small steps, and one step that uses all stripes at once.
SCHEDULES = FIT.outwards, FIT.near


def perfect_errors(drive: Drive, seconds: float) -> FrameErrors:
    """Errors of the lanes fitted to the true stripes of each frame of a drive."""
    camera = drive.camera
    view = BirdsEyeView(camera)
    truths = [drive.truth(frame / FPS) for frame in range(round(seconds * FPS))]
    rows = [truth_row(truth, frame=frame) for frame, truth in enumerate(truths)]
    columns = {name: np.array([row[name] for row in rows], float) for name in rows[0]}
    estimates = DriveEstimates.from_frames([fit_truth(drive, truth, view) for truth in truths], np.zeros(len(truths)))
    return frame_errors(estimates, LaneTruth.from_columns(columns), camera)


def fit_truth(drive: Drive, truth: Truth, view: BirdsEyeView) -> LaneEstimate:
    """The lane fitted to the true stripes, from the true lane as start; of several fits the one that explains most."""
    stripes = true_stripes(drive, truth, view)
    start = parameter_vector(
        centre=-truth.offset_m,
        width=truth.lane_width_m,
        heading=truth.heading_rad,
        curvature=truth.curvature_per_m,
        rate=truth.curvature_rate_per_m2,
        pitch=truth.pitch_rad - drive.camera.require_pose().pitch_rad,
    )
    fits = [
        fit_lanes(start[None], stripes, view, schedule=schedule, extra_vertical_per_m=vertical)
        for schedule in SCHEDULES
        for vertical in (0.0, FIT.undulation_std_per_m)
    ]
    lane = max(fits, key=lambda fit: float(fit.explained[0])).lane[0]
    lines_m = line_points(lane, SIDES, ALONG_M)
    return LaneEstimate(lines_m, float(-lane[CENTRE]), float(lane[HEADING]), float(lane[CURVATURE]))


def true_stripes(drive: Drive, truth: Truth, view: BirdsEyeView) -> Stripes:
    """Stripes on both true lines, in each row of the view in which the picture shows the line."""
    camera, parts = drive.camera_at(truth.time_s), []
    for k in range(len(SIDES)):
        column = line_pixels(truth, k, camera)
        shown = column >= 0
        # the view does not know the pitch of this moment
        line = view.camera.pixels_to_road(np.column_stack([column[shown], H_SAMPLES[shown]]))
        if len(line) < 2:
            continue
        line = line[np.argsort(line[:, 0])]
        row = np.flatnonzero((view.x_m > line[0, 0]) & (view.x_m < line[-1, 0]))
        slope = np.interp(view.x_m[row], line[:, 0], np.gradient(line[:, 1], line[:, 0]))
        parts.append((row, np.interp(view.x_m[row], line[:, 0], line[:, 1]), np.arctan(slope)))
    row, y_m, angle = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Stripes(row, view.x_m[row], y_m, angle, view.row_columns[row], np.full(len(row), STRENGTH))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scenes", metavar="SCENE", nargs="*", default=HAIRPINS, help="of the suite (default: hairpins)")
    parser.add_argument("--seed", type=int, default=0, help="number of the variant of each scene (default: 0)")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the shares of correct frames."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    options = parser.parse_args(arguments)
    if unknown := sorted(set(options.scenes) - set(SUITE)):
        parser.error(f"there is no scene {', '.join(unknown)}; the scenes are {', '.join(SUITE)}")
    print(f"{'scene':20}{'correct':>9}{'in the picture':>16}")
    for name in options.scenes:
        errors = perfect_errors(vary_drive(SUITE[name].drive(), options.seed), SUITE[name].seconds)
        print(f"{name:20}{errors.correct.mean():9.1%}{errors.correct_in_picture.mean():16.1%}", flush=True)


if __name__ == "__main__":
    main()
