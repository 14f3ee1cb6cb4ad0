"""Run a command with one marking response for stills: the learned one (`network`), or that of the band filter (`band`).

    python -m tools.still_response network benchmark --labels LABELS --hfov 60 --each-folder --system detector
    python -m tools.still_response band lanes detect --each PICTURE ... -o lanes.jsonl

`lanes` uses the band filter, and the network where the lane is not sure or the camera pose comes from the same picture.
docs/ablation.md has what this command measured. The choice holds in this process only, and the benchmark's cache does
not know it: scenes and `--workers` are refused.
"""

from __future__ import annotations

import runpy
import sys
from dataclasses import replace

import numpy as np

from lanes import stills
from lanes.camera import Camera


def detect_by_network(image: np.ndarray, camera: Camera) -> stills.StillDetection:
    """As `lanes.stills.detect_still`, with the network alone."""
    found = stills._search_with_network(image, camera)
    return replace(found, lane=found.lane and replace(found.lane, same_lane_share=None))


def main() -> None:
    """Run a module of the project with one response for all stills."""
    if len(sys.argv) < 3 or sys.argv[1] not in ("band", "network"):
        sys.exit(__doc__)
    response, command, *options = sys.argv[1:]
    if "--workers" in options or (command == "benchmark" and "--labels" not in options):
        sys.exit("still_response: only stills in this process: give --labels to benchmark, and leave out --workers.")
    if response == "network":
        stills.detect_still = detect_by_network
    else:
        stills.learned_evidence = lambda image, band: band
    sys.argv = [command, *options]
    runpy.run_module(command, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
