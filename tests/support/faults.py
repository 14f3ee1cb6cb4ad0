"""Functions for `markings` that fail in the processes where drives are annotated."""

from __future__ import annotations

import errno
import os
import signal
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np


@dataclass(frozen=True)
class Fault:
    """A mask without markings; the first calls fail in the way of `kind`.

    With `of_gray` only images of one shade fail. The file `calls` counts the failures
    in all processes.
    """

    calls: Path
    kind: str
    times: int = 1000
    of_gray: bool = False

    def __call__(self, image: np.ndarray) -> np.ndarray:
        is_meant = not self.of_gray or image.std() < 5
        if is_meant and count_calls(self.calls) < self.times:
            with self.calls.open("ab") as file:
                file.write(b".")
            self._fail()
        return np.zeros((9, 16))

    def _fail(self) -> None:
        if self.kind == "death":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.kind == "full disk":
            raise OSError(errno.ENOSPC, "No space left on device")
        if self.kind == "bug":
            raise ZeroDivisionError("division by zero")
        # errors of PyAV, by their name
        error = getattr(av.error, self.kind)
        raise error(errno.EIO, "Input/output error", "drive.mp4")


def count_calls(calls: Path) -> int:
    return calls.stat().st_size if calls.exists() else 0
