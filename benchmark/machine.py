"""Description of the machine and its load, for every measured time."""

from __future__ import annotations

import os
import platform
from functools import lru_cache
from pathlib import Path

import av
import cv2
import numpy as np


@lru_cache(maxsize=1)
def describe_machine() -> str:
    """Processor, cores available to this process, operating system and versions, in one line."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return (
        f"{_processor()} ({cores} {'core' if cores == 1 else 'cores'}), {platform.system()} {platform.machine()}, "
        f"Python {platform.python_version()}, NumPy {np.__version__}, OpenCV {cv2.__version__}, PyAV {av.__version__}"
    )


def _processor() -> str:
    """Name of the processor; on Linux from /proc/cpuinfo, because `platform` knows only the architecture there."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(filter(None, [*names, platform.processor(), platform.machine()]), "unknown processor")


def describe_load() -> str:
    """Load average of the last minute, in words; unknown on systems without it."""
    return f"load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else "load unknown"
