"""A labelling session as a process, requests to its server, and where the lines of a painted drive are in a frame."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from email.message import Message
from http.client import HTTPConnection

import numpy as np

from simulator.road.geometry import offset_point
from tests.support.command_line import start
from tests.support.painted_drive import PaintedDrive

SHUT_DOWN_S = 20
# Places along a line, metres ahead of the car.
AHEAD_M = np.linspace(3, 70, 1400)


class Labelling:
    """A running session; `address` is that of its page, `summary` what it prints at its end."""

    def __init__(self, address: str) -> None:
        self.address, self.summary = address, ""
        self.port, self.root = re.fullmatch(r"http://127\.0\.0\.1:(\d+)(/[\w-]{40,}/)label\.html", address).groups()

    def ask(
        self, path: str, *, body: object = None, root: str | None = None, **headers: str
    ) -> tuple[int, bytes, Message]:
        """Status, content and headers of an answer; a POST with a `body`."""
        connection = HTTPConnection("127.0.0.1", int(self.port), timeout=SHUT_DOWN_S)
        data = None if body is None else json.dumps(body)
        connection.request("GET" if body is None else "POST", (root or self.root) + path, data, headers)
        answer = connection.getresponse()
        return answer.status, answer.read(), answer.headers

    def mark(self, number: int, points: list, *, save: bool = False) -> tuple[int, bytes]:
        return self.ask(f"still/{number}", body={"points": points, "save": save})[:2]


@contextmanager
def labelling(*arguments: object) -> Iterator[Labelling]:
    """A session in a process, ended as with the page's button."""
    with start("label", "--no-browser", *arguments) as child:
        line = child.stdout.readline()
        assert line.startswith("the page is at http"), line + child.stderr.read()
        session = Labelling(line.split()[4])
        try:
            yield session
            session.ask("end/0", body={})
            session.summary, err = child.communicate(timeout=SHUT_DOWN_S)
            assert child.returncode == 0 and "Traceback" not in err, err
        finally:
            child.kill()


def line_pixels(drive: PaintedDrive, time_s: float, lateral_m: float) -> np.ndarray:
    """Pixels (N, 2), from near to far, of a line in the frame at `time_s`."""
    pose = drive.motion.pose(time_s)
    along_m = offset_point(drive.road, pose.s_m + AHEAD_M, lateral_m)
    return drive.camera_at(time_s).road_to_pixels(pose.to_car(drive.road, along_m))


def is_painted(drive: PaintedDrive, time_s: float, lateral_m: float) -> np.ndarray:
    """Which of `line_pixels`, (N,) bool, are on a dash, or on a solid line."""
    (stripe,) = (line for line in drive.lines if line.lateral_m == lateral_m)
    pieces = stripe.pieces(drive.motion.pose(time_s).s_m)
    return np.any([(low < AHEAD_M) & (high > AHEAD_M) for low, high in pieces], axis=0)


def choose_clicks(drive: PaintedDrive, time_s: float, lateral_m: float, rng: np.random.Generator) -> np.ndarray:
    """Points (5, 2) that a person clicks on the paint of a line: most of them far away, each up to 2 px beside it."""
    pixels = line_pixels(drive, time_s, lateral_m)
    inside = ((pixels >= 3) & (pixels <= np.subtract(drive.camera.size, 4))).all(axis=1)
    pixels = pixels[inside & is_painted(drive, time_s, lateral_m)]
    rows = np.interp(np.linspace(0, 1, 5) ** 1.6, [0, 1], pixels[[-1, 0], 1])
    nearest = np.abs(pixels[:, 1, None] - rows).argmin(axis=0)
    return pixels[nearest] + rng.uniform(-2, 2, (5, 2))
