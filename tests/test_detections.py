"""The command `python -m lanes detect`: TuSimple JSON lines of stills, sequences and
videos.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from lanes.camera.model import Camera, CameraPose, save_camera
from lanes.labels import usual_rows
from lanes.video.images import write_image
from tests.support.clips import write_clip
from tests.support.painted_drive import BENDS, CAMERA, SMALL
from tests.support.painted_roads import paint_motorway

DRIVE = replace(BENDS, motion=replace(BENDS.motion, wander_m=0.2))
ROWS = range(230, 351, 10)
BLACK = np.zeros((360, 640, 3), np.uint8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("drive")
    for number in range(4):
        write_image(folder / f"frame{number}.png", DRIVE.frame(number / 25))
    write_image(folder / "black.png", BLACK)
    save_camera(SMALL, folder / "camera.yaml")
    save_camera(CAMERA, folder / "large.yaml")
    return folder


@dataclass(frozen=True)
class Detected:
    """The status of the command, the detections, and what it printed."""

    status: int
    rows: list[dict]
    out: str
    err: str

    def values(self, name: str) -> list:
        return [row.get(name) for row in self.rows]


@pytest.fixture
def detect(tmp_path, run):
    """A function that runs the command."""

    def detect(
        *arguments: object, rows: Sequence[str] = ("--rows", "230:351:10")
    ) -> Detected:
        output = tmp_path / "lanes.jsonl"
        status, out, err = run("detect", *arguments, *rows, "-o", output)
        lines = output.read_text().splitlines()
        return Detected(status, list(map(json.loads, lines)), out, err)

    return detect


def require_true_columns(detection: dict, frame: int, tolerance_px: float = 3) -> None:
    truth = DRIVE.truth(frame / 25)
    x = np.geomspace(2, 100, 400)
    for side, columns in enumerate(detection["lanes"][:2]):
        along_m = np.column_stack([x, truth.line_y(side, x)])
        u, v = SMALL.road_to_pixels(along_m).T
        true = np.interp(ROWS, v[::-1], u[::-1])
        inside = (true > 5) & (true < 635)
        errors_px = np.abs(np.array(columns) - true)[inside]
        assert errors_px.max() < tolerance_px


@pytest.mark.parametrize(
    ("options", "state"),
    [([], "found"), (["--sequence"], "tracking")],
    ids=["independent", "sequence"],
)
class TestStills:
    @pytest.fixture
    def frames(self, folder) -> list[Path]:
        return [folder / f"frame{number}.png" for number in range(4)]

    @pytest.fixture
    def found(self, folder, frames, detect, options) -> Detected:
        return detect("--camera", folder / "camera.yaml", *frames, *options)

    def test_have_a_row_each_and_are_counted(self, found, frames, state):
        assert found.status == 0
        assert "4 pictures, no lane in 0" in found.out
        assert found.values("raw_file") == list(map(str, frames))
        assert found.values("state") == [state] * 4

    def test_have_the_true_columns_at_the_rows(self, found, state):
        assert found.values("h_samples") == [list(ROWS)] * 4
        for number, row in enumerate(found.rows):
            require_true_columns(row, number)

    def test_have_the_true_offset_and_curvature(self, found, state):
        truths = [DRIVE.truth(number / 25) for number in range(4)]
        offsets_m = [truth.offset_m for truth in truths]
        curvatures = [truth.curvature_per_m for truth in truths]
        assert found.values("offset_m") == pytest.approx(offsets_m, abs=0.05)
        assert found.values("curvature_per_m") == pytest.approx(curvatures, abs=5e-4)

    def test_have_their_time_in_milliseconds(self, found, state):
        assert min(found.values("run_time")) > 1
        assert max(found.values("run_time")) < 10_000


def test_a_still_has_far_lines_that_are_seen(folder, detect):
    (row,) = detect("--camera", folder / "camera.yaml", folder / "frame0.png").rows
    assert row["sides"] == ["left", "right", "far right"]
    assert max(row["lanes"][2]) > 500


class TestPartOfAVideo:
    """A file that is named twice counts once. A still comes after the video."""

    @pytest.fixture
    def video(self, tmp_path) -> Path:
        frames = map(DRIVE.frame, np.arange(10) / 25)
        return write_clip(tmp_path / "drive.mp4", frames)

    @pytest.fixture
    def found(self, folder, video, detect) -> Detected:
        files = [video, video, folder / "frame0.png"]
        part = ["--start", 0.2, "--end", 0.3]
        return detect("--camera", folder / "camera.yaml", *files, *part, rows=())

    def test_has_a_row_for_each_frame(self, found, video, folder):
        of_video = [f"{video}#{number}" for number in (5, 6, 7)]
        still = str(folder / "frame0.png")
        assert found.status == 0
        assert found.values("raw_file") == [*of_video, still]
        assert found.values("frame") == [5, 6, 7, None]

    def test_is_counted_without_missing_frames(self, found):
        assert "4 pictures" in found.out
        assert "missing" not in found.out

    def test_is_tracked(self, found):
        assert found.values("state")[2:] == ["tracking", "found"]
        true_m = DRIVE.truth(0.28).offset_m
        assert found.rows[2]["offset_m"] == pytest.approx(true_m, abs=0.05)

    def test_has_the_rows_of_its_height(self, found):
        assert found.rows[0]["h_samples"] == list(range(210, 355, 5))
        assert min(found.rows[2]["lanes"][0]) > 0


def test_the_usual_rows_are_those_of_tusimple_at_720():
    assert list(usual_rows(720)) == list(range(420, 701, 10))
    assert max(usual_rows(540)) < 540


@pytest.mark.parametrize(("fps", "last"), [(25, "coasting"), (2, "lost")])
def test_the_time_between_the_frames_of_a_sequence_is_that_of_its_rate(
    folder, detect, tmp_path, fps, last
):
    """After eight frames of the lane it is black.

    The tracker coasts for one second, however many frames that are.
    """
    images = [DRIVE.frame(number / 25) for number in range(8)] + [BLACK] * 3
    stills = []
    for number, image in enumerate(images):
        stills.append(write_image(tmp_path / f"{number}.png", image))
    options = ["--sequence", "--fps", fps]
    found = detect("--camera", folder / "camera.yaml", *options, *stills)
    assert found.values("state")[-4::3] == ["tracking", last]


def test_a_camera_of_larger_images_is_scaled(folder, detect):
    (row,) = detect("--camera", folder / "large.yaml", folder / "frame0.png").rows
    require_true_columns(row, 0)


def test_a_still_without_a_lane_has_no_columns(folder, detect):
    (row,) = detect("--camera", folder / "camera.yaml", folder / "black.png").rows
    assert (row["state"], row["confidence"], row["offset_m"]) == ("lost", 0.0, None)
    assert row["lanes"] == [[-2.0] * len(ROWS)] * 2
    assert row["sides"] == ["left", "right"]


def test_an_unusable_still_is_named_and_the_others_go_on(folder, detect, tmp_path):
    cut = tmp_path / "cut.png"
    cut.write_bytes((folder / "frame0.png").read_bytes()[:2000])
    stills = [folder / "frame0.png", folder / "black.png", cut]
    found = detect("--camera", folder / "camera.yaml", *stills)
    assert found.status == 1
    assert re.search(r"error: .*cut\.png: cannot be decoded", found.err)
    assert found.values("state") == ["found", "lost"]


class TestStillsOfDifferentCameras:
    """One names its field of view, and one shows no road."""

    @pytest.fixture
    def other(self, tmp_path) -> Path:
        path = tmp_path / "other.jpg"
        camera = Camera.from_fov((960, 540), 62.6, CameraPose(1.3, np.radians(3.0)))
        exif = Image.Exif()
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm.value] = 31
        Image.fromarray(paint_motorway(camera)).save(path, exif=exif)
        return path

    @pytest.fixture
    def files(self, folder, other) -> list[Path]:
        return [folder / "frame0.png", other, folder / "black.png"]

    @pytest.fixture
    def found(self, files, detect) -> Detected:
        return detect("--each", *files)

    def test_are_found_if_they_show_a_lane(self, found, files):
        """None is refused.

        The true field of view of the first is not the assumed one, which hardly matters
        in the image.
        """
        assert found.status == 0
        assert found.values("raw_file") == list(map(str, files))
        assert found.values("state") == ["found", "found", "lost"]
        require_true_columns(found.rows[0], 0, tolerance_px=4)

    def test_have_a_pose_each(self, found):
        assert re.search(
            r"frame0.png: pose: .*\n.*other.jpg: .*pitch 3.0\d ±", found.out
        )
        assert "black.png: pose: height 1.35 ± 0.34 m (assumed)" in found.out

    def test_are_warned_of_if_their_field_of_view_is_assumed(self, found):
        assert "field of view 60.0 deg, assumed" in found.out
        assert "warning: field of view 60.0 deg" in found.err

    def test_are_not_warned_of_if_they_name_it(self, other, detect):
        found = detect("--each", other)
        assert found.status == 0
        assert "warning" not in found.err
        assert "field of view 62.6 deg, as other.jpg says (EXIF)" in found.out
