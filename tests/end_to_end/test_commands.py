"""Every command as a process: help, success and misuse."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from lanes.camera import load_camera, save_camera
from lanes.files import read_telemetry
from lanes.images import read_image, write_image
from lanes.video.reader import inspect_video, read_video
from tests.support.clips import write_drive
from tests.support.command_line import PROGRAMS, process
from tests.support.painted_drive import BENDS, CAMERA, SMALL
from tests.support.project import ROOT

FRAMES = 30


def start(*arguments: object, python: tuple[str, ...] = ()) -> subprocess.Popen:
    command = process(*arguments, python=python)
    # One thread each, because several wait for each other on a busy machine.
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def run(*arguments: object, python: tuple[str, ...] = ()) -> tuple[int, str, str]:
    """Exit status, stdout, stderr."""
    with start(*arguments, python=python) as child:
        out, err = child.communicate(timeout=120)
    return child.returncode, out, err


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} if folder.exists() else set()


@pytest.fixture(scope="session")
def drive(tmp_path_factory) -> Path:
    """A folder with a drive, three of its frames as stills, camera files, and invalid files."""
    folder = tmp_path_factory.mktemp("a drive")
    write_drive(folder / "drive.mp4", BENDS, FRAMES)
    for number in range(3):
        write_image(folder / "stills" / f"still{number}.png", BENDS.frame(number / 2))
    save_camera(SMALL.with_pose(None), folder / "lens.yaml")
    save_camera(CAMERA.from_fov((640, 480), 60, CAMERA.pose), folder / "other.yaml")
    (folder / "bad.yaml").write_text("image_width: many\n")
    (folder / "text.mp4").write_text("no video at all")
    (folder / "empty").mkdir()
    (folder / "file").write_text("in the way")
    sky = write_image(folder / "sky" / "sky.png", np.full((360, 640, 3), 200, np.uint8))
    (folder / "cut.png").write_bytes(sky.read_bytes()[:-20])
    return folder


# --- help


def commands() -> list[str]:
    status, out, err = run("--help")
    assert (status, err) == (0, "")
    return re.findall(r"^  (\w+) ", out.partition("commands:\n")[2].partition("\n\n")[0], re.MULTILINE)


def test_the_list_of_commands_comes_quickly():
    before = os.times()
    assert {"pose", "annotate", "detect"} <= set(commands())
    after = os.times()
    # Processor time, because other jobs do not change it.
    assert after.children_user + after.children_system - before.children_user - before.children_system < 0.3


def test_help_ends_with_examples_and_loads_nothing_slow():
    listed = [*commands(), *PROGRAMS]
    running = {name: start(name, "--help", python=("-X", "importtime")) for name in listed}
    for name, child in running.items():
        out, err = child.communicate(timeout=60)
        program = f"python -m {name}" if name in PROGRAMS else f"python -m lanes {name}"
        assert child.returncode == 0, err
        assert out.startswith(f"usage: {program} ")
        examples = out.partition("\nexamples:\n")[2].splitlines()
        assert examples and all(line.startswith(f"  {program}") for line in examples)
        assert not re.search(r"\b(cv2|numpy|av|matplotlib)$", err, re.MULTILINE)


def test_every_command_is_listed():
    modules = {path.stem for path in (ROOT / "lanes" / "cli").glob("*.py")} - {"__init__", "arguments"}
    assert set(commands()) == modules


@pytest.mark.parametrize("arguments", [[], ["fly"], ["--fast"]])
def test_no_such_command(arguments):
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert "usage: python -m lanes" in err and "Traceback" not in err


# --- success


def test_annotate_a_video(drive, tmp_path):
    status, out, err = run("annotate", "--camera", drive / "drive.yaml", drive / "drive.mp4", "-o", tmp_path / "out")
    assert status == 0, err
    assert re.search(r"drive\.mp4: 30 frames, lane tracked in 9\d% of them, lost for 0\.0 s; \d+ frames/s; wrote", out)
    assert names(tmp_path / "out") == {"drive.mp4", "drive.csv", "drive.html"}
    assert inspect_video(tmp_path / "out" / "drive.mp4").frames == FRAMES
    found, truth = read_telemetry(tmp_path / "out" / "drive.csv"), read_telemetry(drive / "drive.csv")
    np.testing.assert_array_equal(found["frame"], truth["frame"])
    assert np.abs(found["offset_m"] - truth["offset_m"])[5:].max() < 0.05
    page = (tmp_path / "out" / "drive.html").read_text()
    assert "m high, pitch" in page and "drive.mp4: lane report" in page


def test_annotate_a_piece_of_an_uncalibrated_video(drive, tmp_path):
    hfov_deg = 2 * np.degrees(np.arctan(SMALL.width / 2 / SMALL.matrix[0, 0]))
    options = ["--hfov", hfov_deg, "--start", 0.4, "--end", 0.8, "--style", "mosaic", "--no-report"]
    status, out, err = run("annotate", *options, drive / "drive.mp4", "-o", tmp_path)
    assert status == 0, err
    assert names(tmp_path) == {"drive.mp4", "drive.csv"}
    np.testing.assert_array_equal(read_telemetry(tmp_path / "drive.csv")["frame"], np.arange(10, 20))
    # The estimated camera pose is printed with its standard deviations.
    assert float(re.search(r"height +([\d.]+) m +\+- [\d.]+", out)[1]) == pytest.approx(SMALL.pose.height_m, abs=0.15)


def test_annotate_goes_on_after_a_failure(drive, tmp_path):
    sources = [drive / "text.mp4", drive / "drive.mp4", drive / "stills", drive / "cut.png"]
    status, out, err = run(
        "annotate",
        "--camera",
        drive / "drive.yaml",
        *sources,
        "-o",
        tmp_path,
        "--style",
        "lines",
        "--quiet",
        "--end",
        0.2,
    )
    assert status == 1 and out == ""
    assert re.fullmatch(r"error: .*text\.mp4: cannot be read as a video.*\nerror: .*cut\.png: .* is cut off.*\n", err)
    stills = {f"still{n}.png" for n in range(3)}
    assert names(tmp_path) == {"drive.mp4", "drive.csv", "drive.html", "pictures.csv"} | stills
    assert (read_image(tmp_path / "still0.png") != read_image(drive / "stills" / "still0.png")).any()


def test_an_earlier_result_is_replaced_whole_or_kept(drive, tmp_path):
    for name in ("drive.mp4", "text.mp4"):
        (tmp_path / name).write_text("earlier")
    status, _, _ = run(
        "annotate", "--camera", drive / "drive.yaml", f"{drive}/*e*t.mp4", f"{drive}/d*.mp4", "-o", tmp_path
    )
    assert status == 1
    assert (tmp_path / "text.mp4").read_text() == "earlier"
    assert inspect_video(tmp_path / "drive.mp4").frames == FRAMES


def test_interrupted(drive, tmp_path):
    long = tmp_path / "long.mp4"
    write_drive(long, BENDS, 2)
    shutil.copy(ROOT / "test_videos" / "project_video.mp4", long)
    camera = ROOT / "test_videos" / "project_video.yaml"
    process = start("annotate", "--camera", camera, long, "-o", tmp_path / "out")
    while not names(tmp_path / "out") and process.poll() is None:
        time.sleep(0.02)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in err and "Traceback" not in err
    assert names(tmp_path / "out") == set()


def test_pose(drive, tmp_path):
    output = tmp_path / "camera.yaml"
    status, out, err = run("pose", "--camera", drive / "lens.yaml", *(drive / "stills").iterdir(), "-o", output)
    assert status == 0, err
    assert "from 3 of 3 pictures" in out and "camera.yaml" in out
    found = load_camera(output).pose
    assert found.height_m == pytest.approx(SMALL.pose.height_m, abs=0.1)
    assert found.pitch_rad == pytest.approx(SMALL.pose.pitch_rad, abs=np.radians(0.3))


def test_simulator(tmp_path):
    status, out, err = run("simulator", "video", "--seconds", 0.04, "--out", tmp_path)
    assert status == 0, err
    assert "project_video.mp4" in out and "3 files" in out
    videos = tmp_path / "test_videos", ROOT / "test_videos"
    again, committed = (next(read_video(folder / "project_video.mp4")).astype(int) for folder in videos)
    # A single frame is compressed slightly differently from the first of ten seconds.
    assert np.abs(again - committed).mean() < 2
    rows = [(folder / "project_video.csv").read_text().splitlines()[:2] for folder in videos]
    assert rows[0] == rows[1]


# --- misuse: a sentence that names the fault, no traceback, nothing written

ANNOTATE = ["annotate", "--camera", "{drive}/drive.yaml"]
MISUSE = {
    "missing video": (2, "nowhere.mp4: there is no such file", [*ANNOTATE, "nowhere.mp4"]),
    "not a video": (2, "text.mp4: cannot be read as a video", [*ANNOTATE, "{drive}/text.mp4"]),
    "empty folder": (2, "empty: holds neither a video nor a picture", [*ANNOTATE, "{drive}/empty"]),
    "pattern without match": (2, "*.webm: there is no such file", [*ANNOTATE, "{drive}/*.webm"]),
    "no source": (2, "SOURCE", ANNOTATE),
    "two lenses": (2, "not allowed with", [*ANNOTATE, "--hfov", "60", "{drive}/drive.mp4"]),
    "no such camera file": (2, "no.yaml: there is no such", ["annotate", "--camera", "no.yaml", "{drive}/drive.mp4"]),
    "bad camera file": (
        2,
        "not a usable camera file",
        ["annotate", "--camera", "{drive}/bad.yaml", "{drive}/drive.mp4"],
    ),
    "wrong shape": (2, "another aspect ratio", ["annotate", "--camera", "{drive}/other.yaml", "{drive}/drive.mp4"]),
    "boards without a chessboard": (2, "no chessboard", ["annotate", "--boards", "{drive}/sky", "{drive}/drive.mp4"]),
    "no road": (1, "sky.png: only 0 of 1", ["annotate", "--hfov", "60", "{drive}/sky"]),
    "not a number": (2, "wide does not do", ["annotate", "--hfov", "wide", "{drive}/drive.mp4"]),
    "not finite": (2, "nan does not do", [*ANNOTATE, "{drive}/drive.mp4", "--start", "nan"]),
    "negative start": (2, "0 or more", [*ANNOTATE, "{drive}/drive.mp4", "--start=-1"]),
    "ends before it starts": (2, "not after --start", [*ANNOTATE, "{drive}/drive.mp4", "--start", "2", "--end", "1"]),
    "starts after the end": (2, "lasts 1.2 s; begin before", [*ANNOTATE, "{drive}/drive.mp4", "--start", "50"]),
    "unknown style": (2, "invalid choice: 'neon'", [*ANNOTATE, "{drive}/drive.mp4", "--style", "neon"]),
    "unknown option": (2, "--colour", [*ANNOTATE, "{drive}/drive.mp4", "--colour", "red"]),
    "over its own input": (2, "one of the inputs", [*ANNOTATE, "{drive}/drive.mp4", "-o", "{drive}"]),
    "pose over its own input": (
        2,
        "drive.mp4: is one of the inputs",
        ["pose", "--hfov", "60", "{drive}/drive.mp4", "-o", "{drive}/drive.mp4"],
    ),
    "detect over its own input": (
        2,
        "sky.png: is one of the inputs",
        ["detect", "{drive}/drive.mp4", "{drive}/sky/sky.png", "-o", "{drive}/sky/../sky/sky.png"],
    ),
    "explain over its own input": (
        2,
        "sky.png: is one of the inputs",
        ["explain", "--hfov", "60", "{drive}/sky/sky.png", "-o", "{drive}/sky/sky.png"],
    ),
    "calibrate over its own input": (
        2,
        "sky.png: is one of the inputs",
        ["calibrate", "{drive}/sky", "-o", "{drive}/sky/sky.png"],
    ),
    "sheet over its own input": (
        2,
        "sky.png: is one of the inputs",
        ["calibrate", "{drive}/sky", "--sheet", "{drive}/sky/sky.png"],
    ),
    "folder as camera file": (
        2,
        "sky: is a folder; name a camera file",
        ["annotate", "--camera", "{drive}/sky", "{drive}/drive.mp4"],
    ),
    "boards in a file": (
        2,
        "drive.mp4: is a file; name the folder",
        ["annotate", "--boards", "{drive}/drive.mp4", "{drive}/drive.mp4"],
    ),
    "stills of videos": (2, "drive.mp4: is no still", ["detect", "--each", "{drive}/drive.mp4"]),
    "output not writable": (1, "cannot be written", [*ANNOTATE, "{drive}/drive.mp4", "-o", "{drive}/file/out"]),
    "pose: missing still": (2, "no such picture", ["pose", "--hfov", "60", "nowhere.jpg"]),
    "pose: no road": (1, "only 0 of 1 pictures", ["pose", "--hfov", "60", "{drive}/sky/sky.png"]),
    "pose: odd lane": (2, "2 to 6", ["pose", "--hfov", "60", "--lane-width", "20", "{drive}/drive.mp4"]),
    "pose: odd height": (2, "0.5 to 4.5", ["pose", "--hfov", "60", "--height", "0", "{drive}/drive.mp4"]),
    "pose: no pictures": (2, "1 or more", ["pose", "--hfov", "60", "--pictures", "0", "{drive}/drive.mp4"]),
    "pose: odd size": (2, "1280x720", ["pose", "--hfov", "60", "--size", "big", "{drive}/drive.mp4"]),
    "simulator: unknown": (2, "invalid choice", ["simulator", "snow"]),
    "simulator: too long": (2, "0.04 to 10", ["simulator", "video", "--seconds", "60"]),
    "simulator: not writable": (1, "cannot be written", ["simulator", "stills", "--out", "{drive}/file"]),
}


@pytest.mark.parametrize("name", MISUSE)
def test_misuse(drive, tmp_path, name):
    expected, words, arguments = MISUSE[name]
    arguments = [argument.format(drive=drive) for argument in arguments]
    if arguments[0] != "simulator" and "-o" not in arguments:
        arguments += ["-o", tmp_path / "out.yaml"]
    before = names(drive)
    status, out, err = run(*arguments)
    assert (status, out) == (expected, ""), err
    assert words in err and "Traceback" not in err and "Warning" not in err
    assert names(tmp_path) == set() and names(drive) == before
