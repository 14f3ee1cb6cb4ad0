"""Run a command with the learned marking response for all stills (`network`), or with the band filter for all (`band`).

    python -m tools.still_response network benchmark --labels LABELS --hfov 60 --each-folder --system detector
    python -m tools.still_response band lanes detect --each PICTURE ... -o lanes.jsonl

`lanes` uses the network only where the pose was estimated from the same picture. docs/ablation.md has what this
command measured.
"""

from __future__ import annotations

import runpy
import sys

from lanes.tracking import learned_markings


def main() -> None:
    """Run a module of the project with one response for all stills."""
    if len(sys.argv) < 3 or sys.argv[1] not in ("network", "band"):
        sys.exit(__doc__)
    network = sys.argv[1] == "network"
    learned_markings.uses_network = lambda view: network
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
