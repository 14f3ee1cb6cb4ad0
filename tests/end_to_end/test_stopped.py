"""Runs that are stopped, killed or out of disk space: each file is the old one or the
whole new one.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from lanes.camera.model import load_camera
from lanes.files import read_telemetry
from lanes.video.images import read_image, write_image
from lanes.video.reader import inspect_video
from simulator.rendering import render
from simulator.scenes.motorway import project_video
from tests.support import command_line
from tests.support.clips import write_drive
from tests.support.command_line import WAIT_S, popen, run, start
from tests.support.painted_drive import BENDS
from tests.support.project import ROOT, names

FRAMES = 40

# Writes each kind of file repeatedly, as the commands do, and prints a line before it
# starts.
WRITES = """
import sys
from pathlib import Path
import numpy as np
from lanes.camera.model import Camera, save_camera
from lanes.video.images import write_image
from lanes.files import write_atomically, write_json_lines, write_telemetry
from lanes.video.writer import VideoWriter
folder = Path(sys.argv[1])
image = np.random.default_rng(0).integers(0, 255, (90, 160, 3), np.uint8)
print("ready", flush=True)
for turn in range(int(sys.argv[2])):
    write_image(folder / "a.png", image)
    write_json_lines(folder / "a.jsonl", [{"raw_file": "a", "turn": turn}] * 200)
    write_telemetry(folder / "a.csv", [{"frame": n, "turn": turn} for n in range(200)])
    save_camera(Camera.from_fov((160, 90), 60), folder / "a.yaml")
    write_atomically(folder / "a.html", b"<p>" + bytes(100_000) + b"</p>")
    with VideoWriter(folder / "a.mp4", fps=25) as writer:
        for n in range(4):
            writer.write(image)
"""
NAMES = {f"a.{suffix}" for suffix in ("png", "jsonl", "csv", "yaml", "html", "mp4")}


def require_whole(folder: Path) -> None:
    """Check that every existing file of WRITES can be read to its end."""
    whole: dict[str, Callable[[Path], object]] = {
        "a.png": read_image,
        "a.jsonl": lambda path: [
            json.loads(line) for line in path.read_text().splitlines()
        ][199],
        "a.csv": lambda path: read_telemetry(path)["turn"][199],
        "a.yaml": load_camera,
        "a.html": lambda path: path.read_bytes().index(b"</p>"),
        "a.mp4": lambda path: [inspect_video(path).frames][
            4 - inspect_video(path).frames
        ],
    }
    for name in names(folder) & NAMES:
        whole[name](folder / name)


def test_stopped_at_any_moment_files_are_old_or_new_and_whole(tmp_path):
    """A process that writes the files again and again is stopped soon after
    it starts.
    """
    command = [sys.executable, "-c", WRITES, str(tmp_path)]
    for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
        with popen([*command, "999999"]) as child:
            assert child.stdout.readline() == "ready\n"
            time.sleep(random.Random(int(number)).uniform(0.05, 0.5))
            child.send_signal(number)
            with suppress(subprocess.TimeoutExpired):
                child.communicate(timeout=10)
            # Python ignores an interrupt in a destructor, here in one of 300 runs: then
            # a user presses Ctrl-C again.
            child.send_signal(number)
            child.communicate(timeout=WAIT_S)
        require_whole(tmp_path)
    # The next run removes the partial files.
    with popen([*command, "1"]) as child:
        _, err = child.communicate(timeout=WAIT_S)
    assert child.returncode == 0, err
    assert names(tmp_path) == NAMES
    require_whole(tmp_path)


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("drive")
    write_drive(folder / "drive.mp4", BENDS, FRAMES)
    write_image(folder / "still.png", BENDS.frame(0.0))
    return folder


def annotate(drive: Path, out: Path) -> list:
    return [
        "annotate",
        "--camera",
        drive / "drive.yaml",
        drive / "drive.mp4",
        "-o",
        out,
        "--quiet",
    ]


def test_of_two_runs_on_one_output_the_first_wins(drive, tmp_path):
    out = tmp_path / "out"
    with start(*annotate(drive, out)) as first:
        while first.poll() is None and not (out.is_dir() and names(out)):
            time.sleep(0.005)
        first.send_signal(signal.SIGSTOP)
        status, _, err = run(*annotate(drive, out), "--end", "0.2")
        first.send_signal(signal.SIGCONT)
        assert first.wait(timeout=WAIT_S) == 0
    assert status == 1
    assert "drive.mp4: cannot be written (another run is writing it" in err
    assert names(out) == {"drive.mp4", "drive.csv", "drive.html"}
    assert (
        inspect_video(out / "drive.mp4").frames
        == len(read_telemetry(out / "drive.csv")["frame"])
        == FRAMES
    )


OLD = {
    "drive.mp4",
    "drive.csv",
    "drive.html",
    "still.png",
    "pictures.csv",
    "lanes.jsonl",
    "camera.yaml",
}
# Commands, and a limit on the size of their files that is too small for one of them.
FULL = {
    "video": (20_000, annotate),
    "table": (1_000, annotate),
    "still": (
        1_000,
        lambda drive, out: [
            "annotate",
            "--camera",
            drive / "drive.yaml",
            drive / "still.png",
            "-o",
            out,
        ],
    ),
    "lines": (
        100,
        lambda d, out: [
            "detect",
            "--camera",
            d / "drive.yaml",
            d / "still.png",
            "-o",
            out / "lanes.jsonl",
        ],
    ),
    "camera": (
        100,
        lambda d, out: [
            "pose",
            "--camera",
            d / "drive.yaml",
            d / "still.png",
            "-o",
            out / "camera.yaml",
        ],
    ),
}


@pytest.mark.parametrize("what", FULL)
def test_file_size_limit(what, drive, tmp_path):
    """The system refuses to write more, as on a full disk: a sentence, status 1, and
    the old files stay.
    """
    limit_bytes, arguments = FULL[what]
    for name in OLD:
        (tmp_path / name).write_text(f"old {name}")
    status, _, err = run(*arguments(drive, tmp_path), limit_bytes=limit_bytes)
    assert status == 1, err
    assert "cannot be written" in err, err
    assert "Traceback" not in err, err
    assert {path.name for path in tmp_path.rglob("*") if path.is_file()} == OLD
    assert {
        name for name in OLD if (tmp_path / name).read_text() != f"old {name}"
    } == set()


def test_the_output_of_a_killed_encoder_is_refused(tmp_path, monkeypatch):
    """The encoder of the renderer is a separate process; here it wrote half of the
    frames.
    """

    def half(path: Path, *_: object) -> list[dict]:
        write_drive(path, BENDS, 2)
        return [{"frame": number} for number in range(4)]

    monkeypatch.setattr(render, "_encode", half)
    with pytest.raises(
        OSError,
        match=r"a\.mp4: cannot be written \(the encoder wrote fewer than 4 frames",
    ):
        render.write_video(tmp_path / "a.mp4", drive=project_video(), seconds=4 / 25)
    assert not (tmp_path / "a.mp4").exists()


@pytest.mark.parametrize("output", [">/dev/full", "| true", ">&-"])
def test_files_are_written_although_nobody_can_read_the_words(drive, tmp_path, output):
    """A full disk, `| head` that has read enough, none as under some schedulers; nor in
    ASCII. The files decide.
    """
    out = tmp_path / "hin und zur\u00fcck"
    words = [
        "annotate",
        "--camera",
        drive / "drive.yaml",
        drive / "drive.mp4",
        drive / "still.png",
        "-o",
        out,
    ]
    script = f'set -o pipefail; export PYTHONIOENCODING=ascii; "$@" {output}'
    with popen(["bash", "-c", script, "bash", *command_line.process(*words)]) as child:
        _, err = child.communicate(timeout=WAIT_S)
    assert (child.returncode, err) == (0, "")
    assert names(out) == {
        "drive.mp4",
        "drive.csv",
        "drive.html",
        "still.png",
        "pictures.csv",
    }
    assert inspect_video(out / "drive.mp4").frames == FRAMES


# Sends Ctrl-C when a module is looked for.
STOPS_AT = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "{}":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
"""


def run_stopped_at(
    module: str, folder: Path, *command: str
) -> subprocess.CompletedProcess:
    """A Python that is stopped while it loads a module."""
    (folder / "sitecustomize.py").write_text(STOPS_AT.format(module))
    paths = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.run(
        [sys.executable, *command],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
    )


@pytest.mark.parametrize("module", ["cv2", "lanes.drive", "lanes.many"])
def test_ctrl_c_while_modules_are_loaded_is_no_traceback(tmp_path, sigint, module):
    stopped = run_stopped_at(module, tmp_path, "-m", "lanes", "--help")
    assert stopped.returncode == 130
    assert stopped.stderr == "\ninterrupted; nothing was written\n"


def test_a_program_that_imports_lanes_handles_ctrl_c_itself(tmp_path, sigint):
    code = "try:\n import lanes\nexcept KeyboardInterrupt:\n print('its own')"
    stopped = run_stopped_at("lanes.drive", tmp_path, "-c", code)
    assert (stopped.returncode, stopped.stdout) == (0, "its own\n")
