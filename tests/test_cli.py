"""The commands: what they print and write, and one sentence for each kind of misuse.

They run in this process; tests/end_to_end/test_commands.py starts them as processes.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import lanes
from lanes.__main__ import Annotate
from lanes.camera.model import Camera, CameraPose, load_camera, save_camera
from lanes.files import read_telemetry
from lanes.video.images import read_image, write_image
from lanes.video.reader import inspect_video
from lanes.video.writer import VideoWriter
from tests.support.clips import write_drive
from tests.support.painted_drive import BENDS, SMALL
from tests.support.painted_roads import paint_motorway
from tests.support.project import names

FRAMES = 20


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    """A folder with a drive, three of its frames as stills, camera files, and invalid
    files.
    """
    folder = tmp_path_factory.mktemp("a drive")
    write_drive(folder / "drive.mp4", BENDS, FRAMES)
    for number in range(3):
        write_image(folder / "stills" / f"still{number}.png", BENDS.frame(number / 2))
    write_image(folder / "half.png", cv2.resize(BENDS.frame(0.0), (320, 180)))
    save_camera(SMALL.with_pose(None), folder / "lens.yaml")
    (folder / "text.mp4").write_text("no video at all")
    (folder / "empty").mkdir()
    (folder / "file").write_text("in the way")
    sky = write_image(folder / "sky" / "sky.png", np.full((360, 640, 3), 200, np.uint8))
    (folder / "cut.png").write_bytes(sky.read_bytes()[: sky.stat().st_size // 2])
    return folder


# --- annotate


def test_annotate_a_part_of_an_uncalibrated_video(drive, tmp_path, run):
    hfov_deg = 2 * np.degrees(np.arctan(SMALL.width / 2 / SMALL.matrix[0, 0]))
    options = [
        "--hfov",
        hfov_deg,
        "--start",
        0.4,
        "--end",
        0.72,
        "--style",
        "mosaic",
        "--no-report",
    ]
    status, out, err = run("annotate", *options, drive / "drive.mp4", "-o", tmp_path)
    assert (status, err) == (0, "")
    assert re.search(
        r"drive\.mp4: 8 frames, confidence 0\.9 or more in \d+%, 0\.5 to 0\.9 in \d+%, below 0\.5 in 0%, "
        r"no lane in 0% of them; lost for 0\.0 s, median confidence [01]\.\d\d;",
        out,
    )
    assert names(tmp_path) == {"drive.mp4", "drive.csv"}
    np.testing.assert_array_equal(
        read_telemetry(tmp_path / "drive.csv")["frame"], np.arange(10, 18)
    )
    # The estimated camera pose is printed with its standard deviations.
    assert float(re.search(r"height +([\d.]+) ± [\d.]+ m", out)[1]) == pytest.approx(
        SMALL.pose.height_m, abs=0.15
    )


def test_annotate_goes_on_after_a_failure(drive, tmp_path, run):
    for name in ("drive.mp4", "text.mp4"):
        (tmp_path / name).write_text("earlier")
    sources = [
        drive / "text.mp4",
        f"{drive}/d*.mp4",
        drive / "stills",
        drive / "cut.png",
    ]
    options = [
        "--camera",
        drive / "drive.yaml",
        "--style",
        "lines",
        "--quiet",
        "--end",
        0.2,
    ]
    status, out, err = run("annotate", *options, *sources, "-o", tmp_path)
    assert (status, out) == (1, "")
    assert re.fullmatch(
        r"error: .*text\.mp4: cannot be read as a video.*\nerror: .*cut\.png: .* is cut off.*\n",
        err,
    )
    stills = {f"still{n}.png" for n in range(3)}
    assert (
        names(tmp_path)
        == {"drive.mp4", "drive.csv", "drive.html", "pictures.csv", "text.mp4"} | stills
    )
    assert (
        read_image(tmp_path / "still0.png")
        != read_image(drive / "stills" / "still0.png")
    ).any()
    # Of a failed source an earlier result is kept.
    assert (tmp_path / "text.mp4").read_text() == "earlier"
    assert inspect_video(tmp_path / "drive.mp4").frames == 5


# --- pose


@pytest.fixture(scope="module")
def motorway(tmp_path_factory) -> Path:
    """Two stills and a video of six frames, 2 a second, of a camera that looks down,
    left, and is rolled.
    """
    folder = tmp_path_factory.mktemp("motorway")
    camera = Camera.from_fov(
        (960, 540),
        66,
        CameraPose(1.3, np.radians(3.0), np.radians(1.5), np.radians(-0.6)),
    )
    save_camera(replace(camera, pose=None), folder / "lens.yaml")
    for i in range(2):
        write_image(
            folder / f"still{i}.jpg",
            paint_motorway(camera, offset_m=0.3 * i, phase_m=5 * i, seed=i),
        )
    with VideoWriter(folder / "drive.mp4", fps=2) as video:
        for i in range(6):
            video.write(
                paint_motorway(camera, offset_m=0.1 * i, phase_m=3 * i, seed=i), i / 2
            )
    return folder


def test_pose_from_stills_with_a_calibrated_lens(motorway, tmp_path, run):
    options = (
        "--lane-width",
        3.2,
        "--camera",
        motorway / "lens.yaml",
    )  # the height is proportional to the width
    status, out, _ = run(
        "pose", *options, *motorway.glob("*.jpg"), "-o", tmp_path / "camera.yaml"
    )
    found = load_camera(tmp_path / "camera.yaml")
    lens = load_camera(motorway / "lens.yaml")
    assert status == 0
    np.testing.assert_array_equal(found.matrix, lens.matrix)
    assert np.degrees(found.pose.pitch_rad) == pytest.approx(3.0, abs=0.2)
    assert np.degrees(found.pose.yaw_rad) == pytest.approx(1.5, abs=0.4)
    assert found.pose.height_m == pytest.approx(1.3 * 3.2 / 3.66, abs=0.05)
    assert "pictures 2 of 2 used" in out
    assert "looks left" in out
    assert "camera.yaml" in out
    assert re.search(
        r"offset and lane width to be good to \d+ cm and \d+% .*curvature twice as much",
        out,
    )


def test_pose_from_a_video_with_a_field_of_view_and_a_measured_height(
    motorway, tmp_path, run
):
    options = ["--hfov", 66, "--start", 1, "--end", 2.5, "--height", 1.4]
    status, out, _ = run(
        "pose", *options, motorway / "drive.mp4", "-o", tmp_path / "camera.yaml"
    )
    found = load_camera(tmp_path / "camera.yaml")
    assert status == 0
    assert "pictures 3 of 3 used" in out
    assert (found.size, found.pose.height_m) == ((960, 540), 1.4)
    assert np.degrees(found.pose.pitch_rad) == pytest.approx(3.0, abs=0.2)


# --- explain


def test_explain_a_picture_of_half_the_size(drive, tmp_path, run):
    figure = tmp_path / "new" / "explained.png"
    status, out, err = run(
        "explain", drive / "half.png", "--camera", drive / "drive.yaml", "-o", figure
    )
    assert (status, err) == (0, "")
    assert "offset     0.2" in out
    assert "failed at" not in out
    assert out.endswith(f"wrote {figure}\n")
    assert read_image(figure).shape[1] > 1200


def test_explain_names_the_failed_step(drive, tmp_path, run):
    status, out, _ = run(
        "explain", drive / "sky" / "sky.png", "--hfov", 60, "-o", tmp_path / "why.png"
    )
    assert status == 0
    assert (tmp_path / "why.png").is_file()
    assert "height and roll are assumed" in out.partition("failed at  pose:")[2]
    assert (
        "what to do The pose was estimated from these files: give the field of view (--hfov)"
        in out
    )


def test_explain_a_frame_of_a_video_as_annotate_tracks_it(drive, tmp_path, run):
    source = ["--camera", drive / "drive.yaml", drive / "drive.mp4"]
    run("annotate", *source, "--start", 0.2, "--no-report", "-o", tmp_path)
    status, out, _ = run(
        "explain", *source, "--start", 0.2, "--at", 0.6, "-o", tmp_path / "why.png"
    )
    rows = read_telemetry(tmp_path / "drive.csv")
    (row,) = np.flatnonzero(np.isclose(rows["time_s"], 0.6))
    assert status == 0
    assert (tmp_path / "why.png").is_file()
    assert (
        f"prediction {rows['state'][row - 1]}, lane known for 0.40 s and last seen 0.04 s ago"
        in out
    )
    assert f"offset     {abs(rows['offset_m'][row]):.2f} ± " in out
    assert f"confidence {rows['confidence'][row]:.0%}" in out
    status, out, _ = run("explain", *source, "-o", tmp_path / "why.png")
    assert status == 0
    assert re.search("state      (searching|tracking)", out)
    assert "prediction" not in out


def test_messages_of_annotate_name_its_own_options():
    parser = argparse.ArgumentParser()
    Annotate().add_arguments(parser)
    folder = Path(lanes.annotate.__code__.co_filename).parent
    # label.py prints a command of labelme
    others = ("__main__.py", "explanation.py", "label.py")
    for file in folder.rglob("*.py"):
        for option in re.findall(
            r"(?<![-\w])--[a-z][a-z-]*",
            file.read_text() if file.name not in others else "",
        ):
            # the report names the command that explains a moment: `explain --at`
            assert option in {*parser._option_string_actions, "--at"}, (file, option)


# --- misuse: a sentence that names the fault, no traceback, nothing written
# (more bad files: tests/end_to_end/test_bad_input.py)

ANNOTATE = "annotate --camera {drive}/drive.yaml"
TWICE = "{drive}/drive.mp4 {drive}/sky/../drive.mp4"
DETECT = "detect --camera {drive}/drive.yaml"
# Exit status, words of the message, and the command; -o is added where it has none.
MISUSE = {
    "no chessboard": (
        2,
        "no chessboard",
        "annotate --boards {drive}/sky {drive}/drive.mp4",
    ),
    "not a number": (2, "invalid value wide", "annotate --hfov wide {drive}/drive.mp4"),
    "not finite": (
        2,
        "invalid value nan",
        f"{ANNOTATE} {{drive}}/drive.mp4 --start nan",
    ),
    "negative start": (2, ">= 0", f"{ANNOTATE} {{drive}}/drive.mp4 --start=-1"),
    "ends before it starts": (
        2,
        "not after --start",
        f"{ANNOTATE} {{drive}}/drive.mp4 --start 2 --end 1",
    ),
    "starts after the end": (
        2,
        "lasts 0.8 s; begin before",
        f"{ANNOTATE} {{drive}}/drive.mp4 --start 50",
    ),
    "over its own input": (
        2,
        "one of the inputs",
        f"{ANNOTATE} {{drive}}/drive.mp4 -o {{drive}}",
    ),
    "outputs of one name": (2, "would be written from", f"{ANNOTATE} {TWICE}"),
    "outputs of one name on Dask": (
        2,
        "would be written from",
        f"{ANNOTATE} {TWICE} --workers 2",
    ),
    "stills of one name": (
        2,
        "would be written from",
        f"{ANNOTATE} {{drive}}/cut.png {{drive}}/sky/../cut.png",
    ),
    "not writable": (
        1,
        "cannot be written",
        f"{ANNOTATE} {{drive}}/drive.mp4 -o {{drive}}/file/out",
    ),
    "two faults": (
        2,
        "cannot be written",
        f"{ANNOTATE} {{drive}}/text.mp4 {{drive}}/drive.mp4 -o {{drive}}/file/a",
    ),
    "unknown command": (
        2,
        "there is no command anotate; did you mean annotate?",
        "anotate {drive}/drive.mp4",
    ),
    "topic of an mp4": (
        2,
        "drive.mp4: is no robot log",
        f"{ANNOTATE} {{drive}}/drive.mp4 --topic /front",
    ),
    "pose: no lane": (
        1,
        "none of 1 pictures shows a likely lane, so the pose",
        "pose {drive}/sky --hfov 60",
    ),
    "pose: over its input": (
        2,
        "one of the inputs",
        "pose --hfov 60 {drive}/drive.mp4 -o {drive}/drive.mp4",
    ),
    "detect: over its input": (
        2,
        "one of the inputs",
        "detect {drive}/sky/sky.png -o {drive}/sky/../sky/sky.png",
    ),
    "explain: over its input": (
        2,
        "one of the inputs",
        "explain {drive}/sky/sky.png -o {drive}/sky/sky.png",
    ),
    "sheet over its input": (
        2,
        "one of the inputs",
        "calibrate {drive}/sky --sheet {drive}/sky/sky.png",
    ),
    "pose: odd lane": (2, "2 to 6", "pose --hfov 60 --lane-width 20 {drive}/drive.mp4"),
    "pose: odd height": (
        2,
        "0.5 to 4.5",
        "pose --hfov 60 --height 0 {drive}/drive.mp4",
    ),
    "detect: one row": (
        2,
        "700 contains no rows",
        f"{DETECT} {{drive}}/stills --rows 700",
    ),
    "detect: odd rows": (
        2,
        "a:b is not a row range",
        f"{DETECT} {{drive}}/stills --rows a:b",
    ),
    "detect: rows above the picture": (
        2,
        "contains no rows",
        f"{DETECT} {{drive}}/stills --rows=-20:300:10",
    ),
    "detect: no rate": (
        2,
        "expected a number >= 1",
        f"{DETECT} {{drive}}/stills --sequence --fps inf",
    ),
    "detect: lens of no angle": (
        2,
        "--lens needs a field of view",
        "detect --lens pinhole {drive}/sky",
    ),
    "detect: odd lens": (
        2,
        "expected a number from 10 to 150",
        "detect --hfov 5 {drive}/sky",
    ),
    "detect: each of a sequence": (
        2,
        "omit --each",
        "detect --each --sequence {drive}/stills",
    ),
    "detect: each of a video": (
        2,
        "is a video, and --each is for stills",
        "detect --each {drive}/drive.mp4",
    ),
    "explain: time in a still": (
        2,
        "has no frame at 2 s",
        "explain {drive}/sky/sky.png --hfov 60 --at 2",
    ),
    "explain: bad minutes": (
        2,
        "1:75: expected less than 60",
        "explain {drive}/drive.mp4 --hfov 60 --at 1:75",
    ),
    "annotate: camera beside the car": (
        2,
        "-2 to 2",
        "annotate --camera-offset 65 {drive}/drive.mp4",
    ),
    "detect: height again": (
        2,
        "file holds a pose; omit --height",
        f"{DETECT} {{drive}}/stills --height 1.3",
    ),
    "annotate: wide car": (
        2,
        "0.5 to 3.5",
        "annotate {drive}/drive.mp4 --hfov 60 --car-width 9",
    ),
    "explain: late time": (
        2,
        "lasts 0.8 s; give an --at",
        "explain {drive}/drive.mp4 --hfov 60 --at 3",
    ),
    "explain: behind the part": (
        2,
        "has no frame at 0.6 s",
        "explain {drive}/drive.mp4 --hfov 60 --end 0.4 --at 0.6",
    ),
    "explain: odd figure": (
        2,
        "cannot write this kind",
        "explain {drive}/sky/sky.png --hfov 60 -o out.gif",
    ),
    "label: no pictures": (
        2,
        "holds neither a video nor an image",
        "label {drive}/empty",
    ),
    "calibrate: no board": (
        2,
        "no chessboard of 7x5 inner corners",
        "calibrate {drive}/sky --pattern 7x5",
    ),
    "calibrate: odd pattern": (
        2,
        "9by6 is not a chessboard pattern",
        "calibrate {drive}/sky --pattern 9by6",
    ),
    "calibrate: over its input": (
        2,
        "one of the inputs",
        "calibrate {drive}/sky -o {drive}/sky/sky.png",
    ),
    "simulator: too long": (2, "0.04 to 10", "simulator video --seconds 60"),
}


@pytest.mark.parametrize("name", MISUSE)
def test_misuse(name, drive, tmp_path, run, monkeypatch):
    expected, words, command = MISUSE[name]
    arguments = [argument.format(drive=drive) for argument in command.split()]
    if arguments[0] != "simulator" and "-o" not in arguments:
        arguments += ["-o", tmp_path / "out.png"]
    monkeypatch.chdir(tmp_path)
    before = {path: path.read_bytes() for path in drive.rglob("*") if path.is_file()}
    status, out, err = run(*arguments)
    # A pose that was estimated is printed before the fault appears.
    assert status == expected, (out, err)
    assert out == "" or "explain" in command, (out, err)
    assert words in err
    assert "Traceback" not in err
    assert "Warning" not in err
    assert names(tmp_path) == set()
    assert {
        path: path.read_bytes() for path in drive.rglob("*") if path.is_file()
    } == before
