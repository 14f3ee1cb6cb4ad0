"""Whether weaknesses are known of what requirements.lock pins: `make audit`. pip-audit asks PyPI's advisory service.

Exit status: 0 none is known, 1 some are, 2 the service could not be asked. pip-audit itself returns 0 in the last case.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

LOCK = Path(__file__).parents[1] / "requirements.lock"


def main() -> int:
    """Run pip-audit, which is beside this Python, and tell what it found."""
    command = [sys.executable, "-m", "pip_audit", "--requirement", str(LOCK), "--require-hashes", "--disable-pip"]
    done = subprocess.run([*command, "--format", "json", "--progress-spinner", "off"], capture_output=True, text=True)
    try:
        status, words = judge(json.loads(done.stdout)["dependencies"])
    except (ValueError, KeyError):
        status, words = 2, f"pip-audit did not get as far as an answer:\n{done.stderr.strip()}"
    print(words)
    return status


def judge(packages: list[dict]) -> tuple[int, str]:
    """Exit status and words for the packages in pip-audit's answer."""
    unknown = [package["name"] for package in packages if "skip_reason" in package]
    found = [
        f"{package['name']} {package['version']}: {', '.join(weakness['id'] for weakness in package['vulns'])}"
        for package in packages
        if package.get("vulns")
    ]
    if found:
        return 1, "\n".join(["known weaknesses:", *found])
    if unknown or not packages:
        return 2, (
            f"NOT AUDITED: for {len(unknown)} of {len(packages)} packages the advisory service gave no answer, so that "
            "nothing is known about them; try again where PyPI itself can be reached."
        )
    return 0, f"no weakness is known of the {len(packages)} packages in {LOCK.name}"


if __name__ == "__main__":
    sys.exit(main())
