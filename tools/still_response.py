"""Run a command with the learned marking response for all stills (`network`), or with the band filter for all (`band`).

    python -m tools.still_response network benchmark --labels LABELS --hfov 60 --each-folder --system detector
    python -m tools.still_response band lanes detect --each PICTURE ... -o lanes.jsonl

`lanes` uses the network only where the pose was estimated from a single picture. docs/ablation.md has what this
command measured. The choice holds in this process only, and the benchmark's cache does not know it: scenes and
`--workers` are refused.
"""

from __future__ import annotations

import runpy
import sys

from lanes.tracking import learned_markings


def main() -> None:
    """Run a module of the project with one response for all stills."""
    if len(sys.argv) < 3 or sys.argv[1] not in ("network", "band"):
        sys.exit(__doc__)
    network, (command, *options) = sys.argv[1] == "network", sys.argv[2:]
    if "--workers" in options or (command == "benchmark" and "--labels" not in options):
        sys.exit("still_response: only stills in this process: give --labels to benchmark, and leave out --workers.")
    learned_markings.uses_network = lambda view: network
    sys.argv = [command, *options]
    runpy.run_module(command, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
