"""How accurate the tracker was on parts of the committed videos: what tests/end_to_end/test_regression.py holds it to.

    python -m tests.end_to_end.reference    measures again and writes reference.json beside it (some minutes)

To be run when the engine has become better, or a committed video was rendered anew; not to make a failing test pass.
A tolerance is the spread of the measurement itself: the largest difference that a little noise on the pictures makes;
or what moves a line by a millimetre 20 m ahead, or one frame, where that is more.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmark.errors import FrameErrors, frame_errors  # noqa: E402
from benchmark.estimates import DriveEstimates  # noqa: E402
from benchmark.evaluation import read_truth  # noqa: E402
from benchmark.scores import score  # noqa: E402
from benchmark.suite_drives import COMMITTED, list_drives  # noqa: E402
from benchmark.systems import TRACKER, start_system  # noqa: E402
from lanes.camera.camera_file import load_camera  # noqa: E402
from lanes.io.video.reader import inspect_video, read_frames  # noqa: E402

REFERENCE = Path(__file__).with_name("reference.json")
SECONDS = 3.6
# As much as decoders and processors differ: up to three levels.
NOISE_LEVELS, RUNS = 3, 8
# By the unit that a measure's name ends with.
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


def measure(scene: str, *, disturb: Callable[[np.ndarray], np.ndarray] = lambda image: image) -> FrameErrors:
    """The engine's errors in the first seconds of a committed video, whose pictures may be disturbed."""
    drive = list_drives()[scene]
    estimate = start_system(TRACKER, load_camera(drive.video.with_suffix(".yaml")), inspect_video(drive.video).fps)
    estimates = [estimate(disturb(image)) for image in read_frames(drive.video, end_s=SECONDS)]
    return frame_errors(
        DriveEstimates.from_frames(estimates, [0.0] * len(estimates)), read_truth(drive).select(slice(len(estimates)))
    )


def worse_than(reference: dict[str, dict[str, float]], errors: FrameErrors) -> list[str]:
    """What has become worse by more than its tolerance, in words; empty if nothing has."""
    now = score([errors])
    told = []
    for name, known in reference.items():
        # what had no bound cannot become worse: lines that turn back too soon are infinitely far off
        if np.isinf(known["value"]):
            continue
        worse = (known["value"] - now[name]) if name in HIGH_IS_GOOD else (now[name] - known["value"])
        if not worse <= known["tolerance"]:
            told.append(f"{name}: {now[name]:.5g}, was {known['value']:.5g} (tolerance {known['tolerance']:.2g})")
    return told


def make_reference(scene: str) -> dict[str, dict[str, float]]:
    """Values and tolerances for a scene; a share's tolerance is a frame at least."""
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
