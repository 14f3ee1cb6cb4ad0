"""Wrong usage of the commands and of `import lanes`: one sentence that names the fault
and the remedy, no traceback, and nothing is written.

Bad files are in tests/end_to_end/test_bad_input.py.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lanes
from lanes.video.images import write_image
from tests.support.clips import write_drive
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import names

IMAGE = BENDS.frame(0)

# Words of the message, and a command that is run in `folder`.
ANNOTATE = "annotate --camera drive.yaml drive.mp4"
DETECT = "detect --camera drive.yaml stills"
EXPLAIN = "explain --hfov 60 drive.mp4"
INVALID_NUMBERS = {
    "a word": ("invalid value wide", "annotate drive.mp4 --hfov wide"),
    "not finite": ("invalid value nan", f"{ANNOTATE} --start nan"),
    "negative start": (">= 0", f"{ANNOTATE} --start=-1"),
    "lane width": ("2 to 6", "pose --hfov 60 --lane-width 20 drive.mp4"),
    "height": ("0.5 to 4.5", "pose --hfov 60 --height 0 drive.mp4"),
    "one row": ("700 contains no rows", f"{DETECT} --rows 700"),
    "words for rows": ("a:b is not a row range", f"{DETECT} --rows a:b"),
    "rows above the picture": ("contains no rows", f"{DETECT} --rows=-20:300:10"),
    "infinite rate": ("a number >= 1", f"{DETECT} --sequence --fps inf"),
    "field of view": ("a number from 10 to 150", "detect --hfov 5 sky"),
    "75 seconds": ("1:75: expected less than 60", f"{EXPLAIN} --at 1:75"),
    "camera beside the car": ("-2 to 2", "annotate --camera-offset 65 drive.mp4"),
    "wide car": ("0.5 to 3.5", "annotate drive.mp4 --hfov 60 --car-width 9"),
    "pattern": ("9by6 is not a chessboard", "calibrate sky --pattern 9by6"),
    "long render": ("0.04 to 10", "simulator video --seconds 60"),
}
CONTRADICTIONS = {
    "ends first": ("not after --start", f"{ANNOTATE} --start 2 --end 1"),
    "topic of an mp4": ("drive.mp4: is no robot log", f"{ANNOTATE} --topic /front"),
    "lens without angle": (
        "--lens needs a field of view",
        "detect --lens pinhole sky",
    ),
    "each of a sequence": ("omit --each", "detect --each --sequence stills"),
    "each of a video": (
        "is a video, and --each is for stills",
        "detect --each drive.mp4",
    ),
    "second height": (
        "file holds a pose; omit --height",
        f"{DETECT} --height 1.3",
    ),
    "stream": ("is no file. Cameras and streams", "annotate rtsp://cam/1"),
    "stream for a pose": ("is no file. Cameras", "pose --hfov 60 http://cam/1.m3u8"),
    "number of a camera": ("is no file. Cameras and streams", "detect 0"),
    "unknown command": (
        "there is no command anotate; did you mean annotate?",
        "anotate drive.mp4",
    ),
}
ABSENT = {
    "starts after the end": ("lasts 0.8 s; begin before", f"{ANNOTATE} --start 50"),
    "time in a still": (
        "has no frame at 2 s",
        "explain sky/sky.png --hfov 60 --at 2",
    ),
    "time after the end": ("lasts 0.8 s; give an --at", f"{EXPLAIN} --at 3"),
    "time after the part": ("has no frame at 0.6 s", f"{EXPLAIN} --end 0.4 --at 0.6"),
    "boards for annotate": ("no chessboard", "annotate --boards sky drive.mp4"),
    "boards": (
        "no chessboard of 7x5 inner corners",
        "calibrate sky --pattern 7x5",
    ),
    "pictures to label": ("holds neither a video nor an image", "label empty"),
    "lane to estimate a pose from": (
        "none of 1 pictures shows a likely lane, so the pose",
        "pose sky --hfov 60",
    ),
}
OUTPUTS = {
    "annotate over its input": ("one of the inputs", f"{ANNOTATE} -o ."),
    "pose over its input": (
        "one of the inputs",
        "pose --hfov 60 drive.mp4 -o drive.mp4",
    ),
    "detect over its input": (
        "one of the inputs",
        "detect sky/sky.png -o sky/../sky/sky.png",
    ),
    "explain over its input": (
        "one of the inputs",
        "explain sky/sky.png -o sky/sky.png",
    ),
    "calibrate over its input": (
        "one of the inputs",
        "calibrate sky -o sky/sky.png",
    ),
    "sheet over its input": (
        "one of the inputs",
        "calibrate sky --sheet sky/sky.png",
    ),
    "detect over its camera": ("one of the inputs", f"{DETECT} -o link.yaml"),
    "pose over its camera": (
        "one of the inputs",
        "pose --camera drive.yaml drive.mp4 -o drive.yaml",
    ),
    "score over its camera": (
        "one of the inputs",
        "score --camera drive.yaml labels.jsonl labels.jsonl -o drive.yaml",
    ),
    "detect over a board": (
        "one of the inputs",
        "detect --boards sky drive.mp4 -o sky/sky.png",
    ),
    "explain over a board": (
        "one of the inputs",
        "explain --boards sky stills/still.png -o sky/sky.png",
    ),
    "annotate over the video of the boards": (
        "one of the inputs",
        "annotate --boards boards/drive.mp4 drive.mp4 -o boards",
    ),
    "many drives over the camera": (
        "one of the inputs",
        "annotate --camera boards/drive.json drive.mp4 --workers 2 -o boards",
    ),
    "table of many drives over the camera": (
        "one of the inputs",
        "annotate --camera drive.yaml drive.mp4 --workers 2 -o linked",
    ),
    "detect over a part of a recording": (
        "one of the inputs",
        "detect --hfov 60 bag -o bag/bag_0.db3",
    ),
    "camera over its sheet": (
        "is to be written twice",
        "calibrate sky -o both.png --sheet both.png",
    ),
    "table of stills over that of a video": (
        "would be written from",
        "annotate --camera drive.yaml stills boards/pictures.mp4 -o file",
    ),
    "videos of one name": ("would be written from", f"{ANNOTATE} sky/../drive.mp4"),
    "videos of one name in parallel": (
        "would be written from",
        f"{ANNOTATE} sky/../drive.mp4 --workers 2",
    ),
    "stills of one name": (
        "would be written from",
        "annotate --camera drive.yaml cut.png sky/../cut.png",
    ),
    "below a file": ("cannot be written", f"{ANNOTATE} -o file/out"),
    "bad input, below a file": (
        "cannot be written",
        f"{ANNOTATE} text.mp4 -o file/a",
    ),
    "kind of figure": (
        "cannot write this kind",
        "explain sky/sky.png --hfov 60 -o out.gif",
    ),
}
COMMAND_LINES = INVALID_NUMBERS | CONTRADICTIONS | ABSENT | OUTPUTS
# Good inputs, but the command failed: the exit status is 1.
FAILED = {"lane to estimate a pose from", "below a file"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where the commands run; its name has a space."""
    folder = tmp_path_factory.mktemp("a drive")
    write_drive(folder / "drive.mp4", BENDS, 20)
    write_image(folder / "stills" / "still.png", IMAGE)
    sky = write_image(folder / "sky" / "sky.png", np.full((360, 640, 3), 200, np.uint8))
    (folder / "cut.png").write_bytes(sky.read_bytes()[: sky.stat().st_size // 2])
    (folder / "text.mp4").write_text("no video at all")
    (folder / "file").write_text("in the way")
    (folder / "empty").mkdir()
    (folder / "boards").mkdir()
    for name in ("drive.mp4", "pictures.mp4"):
        shutil.copy(folder / "drive.mp4", folder / "boards" / name)
    shutil.copy(folder / "drive.yaml", folder / "boards" / "drive.json")
    (folder / "link.yaml").symlink_to("drive.yaml")
    (folder / "linked" / "summary").mkdir(parents=True)
    (folder / "linked" / "summary" / "drives.csv").symlink_to("../../drive.yaml")
    label = {"raw_file": "stills/still.png", "h_samples": [300], "lanes": [[100]]}
    (folder / "labels.jsonl").write_text(json.dumps(label))
    (folder / "bag").mkdir()
    (folder / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (folder / "bag" / "bag_0.db3").write_text("part of a recording")
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", COMMAND_LINES)
def test_a_wrong_command_is_refused_and_nothing_is_written(
    name, folder, tmp_path, run, monkeypatch
):
    words, command = COMMAND_LINES[name]
    arguments = command.split()
    if arguments[0] != "simulator" and "-o" not in arguments:
        arguments += ["-o", tmp_path / "out.png"]
    before = contents(folder)
    monkeypatch.chdir(folder)

    status, out, err = run(*arguments)

    assert status == (1 if name in FAILED else 2), (out, err)
    assert words in err
    assert "Traceback" not in err
    assert "Warning" not in err
    # A pose that was estimated is printed before the fault appears.
    assert out == "" or "explain" in command
    assert contents(folder) == before
    assert names(tmp_path) == set()


OF_ANNOTATE = [row for row in COMMAND_LINES.values() if row[1].startswith("annotate")]


@pytest.mark.parametrize(("words", "command"), OF_ANNOTATE)
def test_messages_of_annotate_name_its_own_options(
    words, command, folder, tmp_path, run, monkeypatch
):
    monkeypatch.chdir(folder)
    _, its_help, _ = run("annotate", "--help")

    _, _, err = run(*command.split(), "-o", tmp_path)

    message = err.rpartition("error: ")[2]
    assert options_in(message) <= options_in(its_help)


def options_in(text: str) -> set[str]:
    return set(re.findall(r"(?<![-\w])--[a-z][a-z-]*", text))


# Words of the error, and a call.
NO_CAMERA = "camera must be Camera, not NoneType; make one with Camera.from_fov"
STREAMS = "is no path; give that of one file. Cameras and streams: .*own_loop.md"
CALLS: dict[str, tuple[str, Callable[[], object]]] = {
    "find_lane without camera": (NO_CAMERA, lambda: lanes.find_lane(IMAGE, None)),
    "explain without camera": (NO_CAMERA, lambda: lanes.explain(IMAGE, None)),
    "draw_lane without camera": (NO_CAMERA, lambda: lanes.draw_lane(IMAGE, None, None)),
    "LaneTracker without camera": (NO_CAMERA, lambda: lanes.LaneTracker(None)),
    "a path for a camera": (
        "camera must be Camera, not str",
        lambda: lanes.annotate("a.mp4", "out", "camera.yaml"),
    ),
    "no focal length": (
        "a focal length is not between 64",
        lambda: lanes.Camera(640, 360, matrix=np.eye(3)),
    ),
    "words for a matrix": (
        r"matrix \(3, 3\)",
        lambda: lanes.Camera(640, 360, "lens.yaml"),
    ),
    "few coefficients": (
        "3 distortion coefficients, not 4, 5 or 8",
        lambda: replace(SMALL, distortion=[0.1, 0, 0]),
    ),
    "no size": ("0 x 360 is not a valid", lambda: replace(SMALL, width=0)),
    "degrees": (
        r"pitch_rad = 45 .* give radians: np\.radians\(45\)",
        lambda: lanes.CameraPose(1.3, 45),
    ),
    "settings of a still": (
        "settings must be DetectorSettings, not",
        lambda: lanes.find_lane(IMAGE, SMALL, {}),
    ),
    "settings of a pose": (
        "settings must be DetectorSettings",
        lambda: lanes.estimate_pose(IMAGE, settings={}),
    ),
    "settings of a tracker": (
        "settings must be TrackerSettings",
        lambda: lanes.LaneTracker(SMALL, settings={}),
    ),
    "an option": (
        "annotate has no option colour; .*, style",
        lambda: lanes.annotate("a.mp4", "out", colour="red"),
    ),
    "a camera for a video": (STREAMS, lambda: next(lanes.track(0))),
    "two videos at once": (STREAMS, lambda: next(lanes.track(["a.mp4", "a.mp4"]))),
    "a camera to annotate": (STREAMS, lambda: lanes.annotate(0, "out")),
    "two cameras to annotate": (STREAMS, lambda: lanes.annotate([0, 1], "out")),
    "a camera to calibrate": (STREAMS, lambda: lanes.calibrate(None)),
    "a camera to read": (STREAMS, lambda: next(lanes.read_video(0))),
    "a camera to process": (
        STREAMS,
        lambda: lanes.process_video(0, "out.mp4", lambda image: image),
    ),
    "a camera for a pose": (STREAMS, lambda: lanes.estimate_pose(0)),
    "two cameras for a pose": (STREAMS, lambda: lanes.estimate_pose([0, 1])),
    "a camera for a camera file": (STREAMS, lambda: lanes.load_camera(0)),
    "no image": ("no picture was given", lambda: lanes.estimate_pose([])),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_call_raises_one_sentence_and_writes_nothing(
    name, tmp_path, monkeypatch
):
    words, call = CALLS[name]
    Path(tmp_path, "a.mp4").write_bytes(b"no video")
    monkeypatch.chdir(tmp_path)

    with pytest.raises(lanes.LaneError, match=words) as raised:
        call()

    sentence = str(raised.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    assert names(tmp_path) == {"a.mp4"}


@pytest.mark.parametrize("name", ["rtsp://cam/1", "HTTPS://a.b/c.mp4", "0"])
@pytest.mark.parametrize("read", [lanes.track, lanes.read_video, lanes.read_image])
def test_the_address_of_a_stream_is_told_from_a_missing_file(name, read):
    with pytest.raises(FileNotFoundError, match=f"^{name}: is no file. Cameras and st"):
        next(iter(read(name)))


def test_a_file_may_have_the_name_of_a_stream(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_drive(Path("drive.mp4"), BENDS, 3).rename("7")
    assert len(list(lanes.read_video("7"))) == 3
