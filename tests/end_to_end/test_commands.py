"""The commands as processes: help, runs, and Ctrl-C; tests/test_cli.py tests what they
print and write.
"""

from __future__ import annotations

import re
import shutil
import signal
import sys
import time

import numpy as np
import pytest

from lanes.video.reader import read_video
from tests.support.clips import write_drive
from tests.support.command_line import PROGRAMS, WAIT_S, main, popen, run, start
from tests.support.painted_drive import BENDS
from tests.support.project import ROOT, names
from tests.test_report import page_data


def commands() -> list[str]:
    status, out, err = run("--help")
    assert (status, err) == (0, "")
    return re.findall(
        r"^  (\w+) ", out.partition("commands:\n")[2].partition("\n\n")[0], re.MULTILINE
    )


def test_the_list_of_commands():
    assert commands() == [
        "calibrate",
        "pose",
        "annotate",
        "detect",
        "explain",
        "label",
        "score",
    ]


def test_help_ends_with_examples_and_loads_no_plots():
    running = {
        name: start(name, "--help", python=("-X", "importtime"))
        for name in (*commands(), *PROGRAMS)
    }
    for name, child in running.items():
        out, err = child.communicate(timeout=WAIT_S)
        program = f"python -m {name}" if name in PROGRAMS else f"python -m lanes {name}"
        assert child.returncode == 0, err
        assert out.startswith(f"usage: {program} ")
        examples = out.partition("\nexamples:\n")[2].splitlines()
        assert examples
        assert all(line.startswith(f"  {program}") for line in examples)
        assert not re.search(r"\b(matplotlib|dask|scipy)$", err, re.MULTILINE)


def test_a_process_says_nothing_of_its_own(tmp_path):
    """Tests of the commands run in this process; at the exit of an interpreter more may
    be printed.
    """
    write_drive(tmp_path / "drive.mp4", BENDS, 5)
    options = ["--camera", tmp_path / "drive.yaml", tmp_path / "drive.mp4"]
    for command, output in (("annotate", "out"), ("explain", "why.png")):
        status, _, err = run(command, *options, "-o", tmp_path / output)
        assert (status, err) == (0, "")
    assert names(tmp_path / "out") == {"drive.mp4", "drive.csv", "drive.html"}
    status, out, err = run("fly")
    assert (status, out) == (2, "")
    assert "usage: python -m lanes" in err
    assert "Traceback" not in err


def test_the_command_to_copy_from_a_report_has_the_options_of_the_camera(tmp_path):
    drive = write_drive(tmp_path / "my drive.mp4", BENDS, 2)
    given = "--hfov 110.0 --lens pinhole --camera-offset 0.2 --car-width 1.7 --lane-width 3.5 --height 1.3"
    assert (
        main(["annotate", *given.split(), str(drive), "-o", str(tmp_path / "out")]) == 0
    )
    page = (tmp_path / "out" / "my drive.html").read_text()
    command = f"python -m lanes explain {given} '{drive}' --at "
    assert page_data(page)["command"] == command
    assert "0.20 m left of centre of the car, which is 1.7 m wide" in page


@pytest.mark.parametrize(
    ("number", "ended"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)]
)
def test_interrupted(tmp_path, number, ended):
    long = tmp_path / "long.mp4"
    shutil.copy(ROOT / "test_videos" / "project_video.mp4", long)
    camera = ROOT / "test_videos" / "project_video.yaml"
    with start("annotate", "--camera", camera, long, "-o", tmp_path / "out") as child:
        while not names(tmp_path / "out") and child.poll() is None:
            time.sleep(0.02)
        time.sleep(0.3)
        child.send_signal(number)
        _, err = child.communicate(timeout=WAIT_S)
    assert child.returncode == ended
    assert ("interrupted" in err) == (ended == 130)
    assert "Traceback" not in err
    assert names(tmp_path / "out") == set()


def test_simulator(tmp_path, capsys):
    assert (
        main(["simulator", "video", "--seconds", "0.04", "--out", str(tmp_path)]) == 0
    )
    assert re.search(r"project_video\.mp4.* 3 files", capsys.readouterr().out)
    videos = tmp_path / "test_videos", ROOT / "test_videos"
    road = np.s_[520:660, 300:900]
    again, committed = (
        next(read_video(folder / "project_video.mp4"))[road].astype(int)
        for folder in videos
    )
    # A single frame is compressed slightly differently from the first of ten seconds.
    assert np.abs(again - committed).mean() < 2
    rows = [
        (folder / "project_video.csv").read_text().splitlines()[:2] for folder in videos
    ]
    assert rows[0] == rows[1]


@pytest.mark.parametrize(
    "words", [["-m", "lanes", "annotate", "drive.mp4"], ["-c", "import lanes"]]
)
def test_an_older_opencv_ends_with_one_sentence(tmp_path, words):
    (tmp_path / "cv2").mkdir()
    (tmp_path / "cv2" / "__init__.py").write_text('__version__ = "4.11.0"\n')
    with popen([sys.executable, *words], cwd=tmp_path) as child:
        _, err = child.communicate(timeout=WAIT_S)
    assert child.returncode == 1
    assert (
        "OpenCV 4.11.0 is installed, but lanes needs 5; run pip"
        in err.strip().splitlines()[-1]
    )
    assert ("Traceback" in err) == (
        words[0] == "-c"
    )  # of an import, as Python prints it
