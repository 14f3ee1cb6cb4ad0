"""Check the packages in requirements.lock for known vulnerabilities with pip-audit: `make audit`.

Exit status: 0 no known vulnerability, 1 known vulnerabilities, 2 no answer from PyPI's advisory service. pip-audit
itself returns 0 in the last case.
"""

from __future__ import annotations

import json
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter

from benchmark.scored_drive import PROJECT_ROOT

LOCK = PROJECT_ROOT / "requirements.lock"


def main() -> int:
    """Run the pip-audit of this Python environment and print the result."""
    ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter).parse_args()
    command = [sys.executable, "-m", "pip_audit", f"--requirement={LOCK}", "--require-hashes", "--disable-pip"]
    done = subprocess.run([*command, "--format", "json", "--progress-spinner", "off"], capture_output=True, text=True)
    try:
        status, message = assess(json.loads(done.stdout)["dependencies"])
    except (ValueError, KeyError):
        status, message = 2, f"pip-audit gave no answer:\n{done.stderr.strip()}"
    print(message)
    return status


def assess(packages: list[dict]) -> tuple[int, str]:
    """Exit status and message for the packages in pip-audit's answer."""
    unknown = [package["name"] for package in packages if "skip_reason" in package]
    found = [
        f"{package['name']} {package['version']}: {', '.join(known['id'] for known in package['vulns'])}"
        for package in packages
        if package.get("vulns")
    ]
    if found:
        return 1, "\n".join(["known vulnerabilities:", *found])
    if unknown or not packages:
        return 2, (
            f"NOT AUDITED: the advisory service gave no answer for {len(unknown)} of {len(packages)} packages; try "
            "again on a machine that can reach PyPI."
        )
    return 0, f"no known vulnerability in the {len(packages)} packages of requirements.lock"


if __name__ == "__main__":
    sys.exit(main())
