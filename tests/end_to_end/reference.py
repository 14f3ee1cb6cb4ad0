"""Accuracy of the tracker on parts of the committed videos: the reference of tests/end_to_end/test_regression.py.

    python -m tests.end_to_end.reference    measures again and writes reference.json into this folder (some minutes)

Run it when the tracker has improved or a committed video was rendered again, not to make a failing test pass.
A tolerance is the spread of the measurement itself: the largest change that a little noise on the frames causes. It is
at least the change that moves a line by 1 mm 20 m ahead, or one frame.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmark.errors import FrameErrors, frame_errors
from benchmark.estimates import DriveEstimates
from benchmark.evaluation import read_truth
from benchmark.scored_drive import COMMITTED, list_drives
from benchmark.scores import score
from benchmark.systems import TRACKER, start_system
from lanes.camera import load_camera
from lanes.video.reader import inspect_video, read_video

REFERENCE = Path(__file__).with_name("reference.json")
SECONDS = 3.6
# Decoders and processors differ by up to three grey levels.
NOISE_LEVELS, RUNS = 3, 8
# Smallest tolerance by the unit at the end of a measure's name.
LEAST = {"share": 1.0, "accuracy": 1.0, "frames": 1.0, "rad": 0.001 / 20, "per_m": 2 * 0.001 / 20**2, "m": 0.001}
HIGH_IS_GOOD = ("available_share", "accuracy")
LOW_IS_GOOD = (
    "confident_and_wrong_share",
    *[f"lateral_{at}_{part}_m" for at in ("5m", "15m", "30m", "5_20m") for part in ("median", "p95")],
    "offset_p95_m",
    "heading_p95_rad",
    "curvature_p95_per_m",
    "recovery_longest_frames",
)
MEASURES = (*HIGH_IS_GOOD, *LOW_IS_GOOD)


def measure(
    scene: str,
    *,
    begin_s: float = 0.0,
    end_s: float = SECONDS,
    disturb: Callable[[np.ndarray], np.ndarray] = lambda image: image,
) -> FrameErrors:
    """The tracker's errors in a piece of a committed video, with each frame changed by `disturb`."""
    drive = list_drives()[scene]
    camera, fps = load_camera(drive.video.with_suffix(".yaml")), inspect_video(drive.video).fps
    find, to_estimate = start_system(TRACKER, camera, fps)
    estimates = [to_estimate(find(disturb(image))) for image in read_video(drive.video, start_s=begin_s, end_s=end_s)]
    first = round(begin_s * inspect_video(drive.video).fps)
    truth = read_truth(drive).select(slice(first, first + len(estimates)))
    return frame_errors(DriveEstimates.from_frames(estimates, [0.0] * len(estimates)), truth)


def worse_than(reference: dict[str, dict[str, float]], errors: FrameErrors) -> list[str]:
    """One sentence for each measure that is worse by more than its tolerance."""
    now = score([errors])
    worse_measures = []
    for name, known in reference.items():
        worse = (known["value"] - now[name]) if name in HIGH_IS_GOOD else (now[name] - known["value"])
        if not worse <= known["tolerance"]:
            worse_measures.append(
                f"{name}: {now[name]:.5g}, was {known['value']:.5g} (tolerance {known['tolerance']:.2g})"
            )
    return worse_measures


def make_reference(scene: str) -> dict[str, dict[str, float]]:
    """Values and tolerances of a scene; the tolerance of a share is at least one frame."""
    errors = measure(scene)
    values = score([errors])
    noisy = [score([measure(scene, disturb=_noise(np.random.default_rng(seed)))]) for seed in range(RUNS)]
    reference = {}
    for name in MEASURES:
        spread = max(abs(run[name] - values[name]) for run in noisy)
        least = next(smallest for unit, smallest in LEAST.items() if name.endswith(unit))
        tolerance = max(spread, least / len(errors.available) if name.endswith(("share", "accuracy")) else least)
        reference[name] = {"value": float(f"{values[name]:.6g}"), "tolerance": float(f"{tolerance:.3g}")}
    return reference


def _noise(rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    def disturb(image: np.ndarray) -> np.ndarray:
        noise = rng.integers(-NOISE_LEVELS, NOISE_LEVELS + 1, image.shape, np.int8)
        return cv2.add(image, noise, dtype=cv2.CV_8U)

    return disturb


def main() -> None:
    """Measure all committed videos and write the file."""
    cv2.setNumThreads(1)
    reference = {
        name: make_reference(name) for name in COMMITTED if list_drives().get(name) and list_drives()[name].video
    }
    REFERENCE.write_text(json.dumps(reference, indent=1) + "\n")
    print(f"wrote {REFERENCE}: {', '.join(reference)}")


if __name__ == "__main__":
    main()
