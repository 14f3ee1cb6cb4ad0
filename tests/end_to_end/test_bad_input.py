"""Every command with damaged, truncated and hostile files.

A command prints a sentence that names the file, the fault and the remedy, and exits
with status 2, without a traceback. It writes no output and keeps earlier results. The
commands run in this process; pytest ends one that hangs.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from lanes.camera.model import load_camera, save_camera
from lanes.files import read_telemetry
from lanes.video.images import read_image, write_image
from lanes.video.reader import inspect_video
from tests.support import bad_files as badfiles
from tests.support.clips import write_drive
from tests.support.command_line import main
from tests.support.labelme_files import labelme_file, line_strip
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import names

KINDS = {
    "png": ("still.png", badfiles.PNG),
    "jpg": ("still.jpg", badfiles.JPEG),
    "video": ("drive.mp4", badfiles.VIDEO),
    "camera": ("drive.yaml", badfiles.CAMERA),
    "labels": ("labels.jsonl", badfiles.LABELS | badfiles.OUTSIDE),
    "predictions": ("predictions.jsonl", badfiles.LABELS),
    "labelme": ("label.json", badfiles.LABELME),
}
# Inputs of the commands: the kind of the file BAD, and the arguments; {in} is a folder
# of good files.
CAMERA = ["--camera", "{in}/drive.yaml"]
INPUTS = {
    "annotate video": ("video", ["annotate", *CAMERA, "BAD", "-o", "{out}"]),
    "annotate still": ("png", ["annotate", *CAMERA, "BAD", "-o", "{out}"]),
    "annotate still, no lens": ("jpg", ["annotate", "BAD", "-o", "{out}"]),
    "annotate camera": (
        "camera",
        ["annotate", "--camera", "BAD", "{in}/drive.mp4", "-o", "{out}"],
    ),
    "pose video": ("video", ["pose", "--hfov", "60", "BAD", "-o", "{out}/drive.yaml"]),
    "pose still": ("jpg", ["pose", "--hfov", "60", "BAD", "-o", "{out}/drive.yaml"]),
    "pose still, no lens": ("png", ["pose", "BAD", "-o", "{out}/drive.yaml"]),
    "pose camera": (
        "camera",
        ["pose", "--camera", "BAD", "{in}/drive.mp4", "-o", "{out}/drive.yaml"],
    ),
    "detect video": (
        "video",
        ["detect", *CAMERA, "--rows", "200:300:20", "BAD", "-o", "{out}/lanes.jsonl"],
    ),
    "detect still": (
        "jpg",
        ["detect", *CAMERA, "--rows", "200:300:20", "BAD", "-o", "{out}/lanes.jsonl"],
    ),
    "detect camera": (
        "camera",
        ["detect", "--camera", "BAD", "{in}/still.png", "-o", "{out}/lanes.jsonl"],
    ),
    "explain video": (
        "video",
        ["explain", *CAMERA, "BAD", "-o", "{out}/explained.png"],
    ),
    "explain still": ("png", ["explain", *CAMERA, "BAD", "-o", "{out}/explained.png"]),
    "calibrate": ("jpg", ["calibrate", "BAD", "-o", "{out}/drive.yaml"]),
    "labels": (
        "labels",
        ["score", "BAD", "{in}/predictions.jsonl", "-o", "{out}/score.html"],
    ),
    "predictions": (
        "predictions",
        ["score", "{in}/labels.jsonl", "BAD", "-o", "{out}/score.html"],
    ),
    "labels of labelme": (
        "labelme",
        ["score", "BAD", "{in}/predictions.jsonl", "-o", "{out}/score.html"],
    ),
    "labels of a benchmark": (
        "labels",
        ["benchmark", *CAMERA, "--system", "tracker", "--labels", "BAD"],
    ),
    "labelled still": (
        "png",
        ["benchmark", *CAMERA, "--system", "tracker", "--labels", "{in}/bad.jsonl"],
    ),
}
# No faults: a truncated text file may still be valid.
FINE = {("camera", "cut at 90 %"), ("labels", "cut at 90 %"), ("labels", "cut at 50 %")}
FINE |= {("predictions", "cut at 90 %"), ("predictions", "cut at 50 %")}
# Files that belong to a video and are read by worker processes.
COMPANIONS = {".csv": badfiles.TRUTH, ".mp4": badfiles.VIDEO, ".yaml": badfiles.CAMERA}


# Faults that every command is given; the first command that reads a kind of file gets
# all others as well.
OF_EACH = {"missing", "folder", "pipe", "cut at 50 %", "text"}


def rows() -> Iterator:
    read: set[str] = set()
    for where, (kind, _) in INPUTS.items():
        for bad in badfiles.ANY | KINDS[kind][1]:
            if (kind, bad) not in FINE and (kind not in read or bad in OF_EACH):
                yield pytest.param(where, bad, id=f"{where}: {bad}")
        read.add(kind)


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    """Good files of every kind."""
    folder = tmp_path_factory.mktemp("good")
    write_drive(folder / "drive.mp4", BENDS, 5)
    for suffix in ("png", "jpg"):
        write_image(folder / f"still.{suffix}", BENDS.frame(0.0))
    label = {
        "h_samples": [200, 220, 240, 260, 280, 300],
        "lanes": [[300] * 6, [340] * 6],
    }
    *lines, bad = (
        json.dumps({"raw_file": f"{name}.png"} | label) + "\n"
        for name in ("a", "b", "c", "d", "bad/BAD")
    )
    content = labelme_file(
        "a.png", (640, 360), [line_strip("left", (300, 200), (300, 300))]
    )
    content["flags"] = {"checked": True}
    (folder / "label.json").write_text(json.dumps(content, indent=2))
    for name, text in {
        "bad": bad,
        "labels": "".join(lines),
        "predictions": "".join(lines),
    }.items():
        (folder / f"{name}.jsonl").write_text(text)
    return folder


@pytest.fixture
def out(tmp_path) -> Path:
    """Outputs of an earlier run."""
    folder = tmp_path / "out"
    folder.mkdir()
    files = "drive.mp4 drive.csv drive.html drive.yaml lanes.jsonl explained.png pictures.csv score.html"
    for name in files.split():
        (folder / name).write_text(f"old {name}")
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


@pytest.mark.parametrize(("where", "bad"), list(rows()))
def test_a_bad_file_is_named_and_nothing_is_written(
    where, bad, good, out, tmp_path, monkeypatch, capfd
):
    kind, arguments = INPUTS[where]
    name, own = KINDS[kind]
    spoil, words = (badfiles.ANY | own)[bad]
    folder = good / "bad" if where == "labelled still" else tmp_path
    shutil.rmtree(good / "bad", ignore_errors=True)
    folder.mkdir(exist_ok=True)
    path = folder / f"BAD{Path(name).suffix}"
    spoil(path, (good / name).read_bytes())
    if bad == "no right to read" and os.geteuid() == 0:
        access = os.access
        monkeypatch.setattr(
            os, "access", lambda file, mode: Path(file) != path and access(file, mode)
        )
    monkeypatch.chdir(tmp_path)
    before = contents(out)
    there = {*tmp_path.iterdir()}
    most_mb = peak_mb() + 300
    status = main(
        [
            str(path) if word == "BAD" else word.format(**{"in": good, "out": out})
            for word in arguments
        ]
    )
    printed, err = capfd.readouterr()
    sentence = err.rpartition("error: ")[2]
    assert status == 2, err
    assert re.search(words, sentence), err
    assert "BAD" in sentence or bad == "another shape", err
    assert (
        re.search(r"[;:] .*[a-z]", sentence)
        and sentence.rstrip().endswith(".")
        or "\n" in sentence.strip()
    ), err
    assert "Traceback" not in err
    assert "Warning" not in err
    assert contents(out) == before
    assert {*tmp_path.iterdir()} == there
    assert peak_mb() < most_mb


@pytest.mark.parametrize(
    ("suffix", "bad"),
    [
        (".csv", "no columns"),
        (".csv", "words for numbers"),
        (".mp4", "ffconcat"),
        (".yaml", "alias bomb"),
    ],
)
def test_a_drive_with_bad_truth_camera_or_video_is_not_scored(
    suffix, bad, good, tmp_path, monkeypatch, capfd
):
    """Only a few faults, because each starts worker processes."""
    monkeypatch.setenv("LANES_CACHE", str(tmp_path / "cache"))
    for companion in COMPANIONS:
        shutil.copy(good / f"drive{companion}", tmp_path / f"BAD{companion}")
    spoil, words = (badfiles.ANY | COMPANIONS[suffix])[bad]
    spoil(tmp_path / f"BAD{suffix}", (good / f"drive{suffix}").read_bytes())
    status = main(
        [
            "benchmark",
            "--system",
            "tracker",
            str(tmp_path / "BAD.mp4"),
            "-o",
            str(tmp_path / "out"),
        ]
    )
    err = capfd.readouterr().err
    assert status == 2, err
    assert f"BAD{suffix}" in err, err
    assert re.search(words, err), err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_odd_names_are_accepted(good, tmp_path, monkeypatch, capfd):
    """For inputs and outputs of every command; after -- a leading dash is not an
    option.
    """
    monkeypatch.chdir(tmp_path)
    for name in badfiles.ODD_NAMES:
        for suffix in (".mp4", ".png", ".yaml"):
            shutil.copy(
                good / {".png": "still.png"}.get(suffix, f"drive{suffix}"),
                f"{name}{suffix}",
            )
    videos, stills = (
        [f"{name}{suffix}" for name in badfiles.ODD_NAMES]
        for suffix in (".mp4", ".png")
    )
    name = badfiles.ODD_NAMES[-2]
    options = [
        "--end=0.04",
        "--quiet",
        f"--camera={name}.yaml",
        f"--output={name} out",
        "--",
    ]
    assert main(["annotate", *options, *videos, *stills[:2]]) == 0, (
        capfd.readouterr().err
    )
    written = {
        f"{other}{suffix}"
        for other in badfiles.ODD_NAMES
        for suffix in (".mp4", ".csv", ".html")
    }
    assert names(Path(f"{name} out")) == written | {*stills[:2], "pictures.csv"}
    page = Path(f"{name} out/<img src=x>.html").read_text(
        encoding="utf-8", errors="replace"
    )
    assert "<img src=x>" not in page
    assert "&lt;img src=x&gt;.mp4" in page
    name = badfiles.ODD_NAMES[-1]
    options = [
        "--rows=200:300:20",
        f"--camera={name}.yaml",
        f"--output={name}.jsonl",
        "--",
    ]
    assert main(["detect", *options, *stills[2:5]]) == 0
    assert len(Path(f"{name}.jsonl").read_text().splitlines()) == 3
    save_camera(SMALL.with_pose(None), "-lens.yaml")
    assert (
        main(
            [
                "pose",
                "--camera=-lens.yaml",
                "--output=-out \u2713.yaml",
                str(good / "still.png"),
            ]
        )
        == 0
    )
    assert load_camera("-out \u2713.yaml").pose is not None
    assert (
        main(["explain", "--camera=-rf.yaml", "--output=-why.png", "--", "-rf.mp4"])
        == 0
    )
    assert read_image("-why.png").size
    assert not Path("owned").exists()


@pytest.mark.parametrize(
    ("command", "size"),
    [
        ("pose", (1, 1)),
        ("annotate", (3, 360)),
        ("explain", (640, 3)),
        ("detect", (47, 64)),
    ],
)
def test_pictures_too_small_for_a_road_are_refused(
    command, size, good, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    write_image("tiny.png", read_image(good / "still.png")[: size[1], : size[0]])
    before = contents(tmp_path)
    assert main(
        [
            command,
            "--hfov",
            "60",
            "tiny.png",
            "-o",
            "out.png" if command == "explain" else "out",
        ]
    ) in (0, 1)
    err = capfd.readouterr().err
    assert "Traceback" not in err
    assert command == "explain" or "tiny.png" in err
    assert command == "explain" or contents(tmp_path) == before


def test_damaged_frames_are_counted_and_left_out(good, tmp_path, capfd):
    """In the message, the table, the report and the JSON lines; the other frames keep
    their numbers.
    """
    video = write_drive(tmp_path / "drive.mp4", BENDS, 12)
    data = bytearray(video.read_bytes())
    half = data.index(b"mdat") + (data.index(b"moov") - data.index(b"mdat")) // 2
    end = data.index(b"moov") - 4
    data[half : half + 3000], data[end - 2000 : end] = bytes(3000), bytes(2000)
    video.write_bytes(data)
    out = tmp_path / "out"
    camera = ["--camera", str(good / "drive.yaml")]
    assert main(["annotate", *camera, str(video), "-o", str(out)]) == 0
    words = r"drive\.mp4: (\d+) frames \((\d+) more (?:is|are) damaged or missing"
    frames, missing = map(int, re.search(words, capfd.readouterr().out).groups())
    assert frames + missing == 12
    assert missing >= 1
    table = read_telemetry(out / "drive.csv")
    assert len(table["frame"]) == frames == inspect_video(out / "drive.mp4").frames
    assert set(np.diff(table["frame"])) > {1.0} or table["frame"][-1] < 11
    np.testing.assert_allclose(table["time_s"], table["frame"] / 25, atol=1e-3)
    assert f"({missing} more " in (out / "drive.html").read_text()
    videos = [str(video), str(good / "drive.mp4")]
    assert (
        main(
            [
                "detect",
                *camera,
                "--rows=200:300:20",
                *videos,
                "-o",
                str(out / "lanes.jsonl"),
            ]
        )
        == 0
    )
    found = [json.loads(line)["frame"] for line in (out / "lanes.jsonl").open()]
    assert found == [*table["frame"].tolist(), *range(5)]
    assert re.search(
        rf"{frames + 5} pictures.*; {missing} more are damaged", capfd.readouterr().out
    )
    # truth and frames no longer belong together
    assert (
        main(
            [
                "benchmark",
                "--system",
                "tracker",
                str(video),
                "-o",
                str(tmp_path / "scores"),
            ]
        )
        == 2
    )
    assert "drive.mp4: " in capfd.readouterr().err
