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

import numpy as np

from lanes.detect import search as detector
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.lane import Lane
from lanes.detect.network import learned_evidence
from lanes.detect.paint import FrameEvidence, extract_evidence
from lanes.detect.search import still_lane


def search_by_band(image: np.ndarray, view: BirdsEyeView) -> tuple[FrameEvidence, Lane | None]:
    """As `lanes.detect.search.search_still`, with the band filter alone."""
    band = extract_evidence(view.warp(image), view)
    return band, still_lane(band)


def search_by_network(image: np.ndarray, view: BirdsEyeView) -> tuple[FrameEvidence, Lane | None]:
    """As `lanes.detect.search.search_still`, with the network alone."""
    learned = learned_evidence(image, extract_evidence(view.warp(image), view))
    return learned, still_lane(learned)


SEARCHES = {"band": search_by_band, "network": search_by_network}


def main() -> None:
    """Run a module of the project with one response for all stills."""
    if len(sys.argv) < 3 or sys.argv[1] not in SEARCHES:
        sys.exit(__doc__)
    response, command, *options = sys.argv[1:]
    if "--workers" in options or (command == "benchmark" and "--labels" not in options):
        sys.exit("still_response: only stills in this process: give --labels to benchmark, and leave out --workers.")
    detector.search_still = SEARCHES[response]
    sys.argv = [command, *options]
    runpy.run_module(command, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
