"""Manifests and summary: a drive is finished if nothing has changed and its outputs are complete."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lanes.annotate import DriveSettings, annotate_drive
from lanes.field_of_view import FieldOfView
from lanes.files import read_telemetry
from lanes.many import (
    DriveKey,
    Manifest,
    add_to_data_set,
    describe_totals,
    manifest_path,
    read_finished,
    write_manifest,
    write_summary,
)
from tests.support.clips import write_drive
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, straight_road

SMALL = CAMERA.scaled((640, 360))


@pytest.fixture
def drive(tmp_path) -> tuple[Path, DriveSettings]:
    """A finished drive with its manifest."""
    video = write_drive(tmp_path / "drive.mp4", PaintedDrive(straight_road(), lane_lines(), camera=SMALL), 6)
    settings = DriveSettings(output=tmp_path / "out", camera=SMALL)
    write_manifest(DriveKey.from_video(video, settings, 300.0), annotate_drive(video, settings), cpu_s=1.5, pieces=1)
    return video, settings


def finished(video: Path, settings: DriveSettings, piece_s: float = 300.0) -> Manifest | None:
    return read_finished(DriveKey.from_video(video, settings, piece_s), settings.output)


def test_finished_drive_is_recognised(drive):
    video, settings = drive
    manifest = finished(video, settings)
    assert (manifest.frames, manifest.cpu_s, manifest.length_s) == (6, 1.5, 0.24)
    assert manifest.outputs == {
        path.name: path.stat().st_size for path in settings.output.iterdir() if path.suffix != ".json"
    }
    assert manifest.description.startswith(f"{video}: 6 frames")


def grow_input(video: Path, settings: DriveSettings) -> None:
    with video.open("ab") as file:
        file.write(b"x")


def touch_input(video: Path, settings: DriveSettings) -> None:
    os.utime(video, ns=(0, video.stat().st_mtime_ns + 1000))


def remove_output(video: Path, settings: DriveSettings) -> None:
    (settings.output / "drive.html").unlink()


def truncate_output(video: Path, settings: DriveSettings) -> None:
    os.truncate(settings.output / "drive.mp4", 100)


def forget_manifest(video: Path, settings: DriveSettings) -> None:
    manifest_path(video, settings.output).unlink()


def spoil_manifest(video: Path, settings: DriveSettings) -> None:
    manifest_path(video, settings.output).write_text('{"key": [1, 2')


def other_version(video: Path, settings: DriveSettings) -> None:
    path = manifest_path(video, settings.output)
    content = json.loads(path.read_text())
    content["key"]["versions"]["OpenCV"] = "4.0"
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "change",
    [grow_input, touch_input, remove_output, truncate_output, forget_manifest, spoil_manifest, other_version],
)
def test_changed_drive_is_not_finished(drive, change):
    assert finished(*drive)
    change(*drive)
    assert finished(*drive) is None


def test_invalid_manifests_are_rejected(drive):
    """Anyone with write access to the output folder may have written the manifest."""
    path = manifest_path(drive[0], drive[1].output)
    good = path.read_text()
    entries = [{"outputs": []}, {"outputs": {"/etc/passwd": 1}}, {"outputs": {"../drive.mp4": 1}}]
    entries += [{"frames": "many"}, {"description": None}, {"key": 3}, {"more": 1}]
    for text in ["", "7", "[" * 99_999, *(json.dumps(json.loads(good) | entry) for entry in entries)]:
        path.write_text(text)
        assert finished(*drive) is None, text[:99]
    path.unlink()
    os.mkfifo(path)
    assert finished(*drive) is None
    path.unlink()
    path.write_text(good)
    assert finished(*drive)


@pytest.mark.parametrize(
    "changes",
    [
        {"style": "lines"},
        {"start_s": 0.04},
        {"end_s": 0.2},
        {"report": False},
        {"camera": SMALL.with_pose(None)},
        {"camera": None, "field": FieldOfView(60.0, "as given")},
    ],
    ids=lambda changes: "-".join(changes),
)
def test_other_settings_give_another_key(drive, changes):
    video, settings = drive
    assert finished(video, replace(settings, **changes)) is None
    assert finished(video, replace(settings, progress=False))
    keys = {DriveKey.from_video(video, s, 300.0).digest() for s in (settings, replace(settings, **changes))}
    assert len(keys) == 2


def test_piece_length_is_part_of_the_key(drive):
    assert finished(*drive, piece_s=60.0) is None


def test_key_of_a_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="gone.mp4: there is no such video"):
        DriveKey.from_video(tmp_path / "gone.mp4", DriveSettings(output=tmp_path), 300.0)


def test_worst_drive_is_first(tmp_path):
    def manifest(name: str, tracked_share: float, lost_s: float, frames: int) -> Manifest:
        key = DriveKey(f"/drives/{name}.mp4", 1, 1, {}, {})
        return Manifest(key, {}, frames, 0, frames / 25, tracked_share, lost_s, frames / 10, 1, "")

    finished = [manifest("good", 1.0, 0, 100), manifest("bad", 0.5, 1, 300), manifest("worse", 0.5, 2, 100)]
    failed = {Path("/drives/none.mp4"): ValueError("none.mp4: is empty, copy it")}
    table = read_telemetry_text(write_summary(tmp_path, finished, failed))
    assert [row[0] for row in table] == ["drive", "none", "worse", "bad", "good"]
    assert "none.mp4: is empty, copy it" in table[1]
    words = describe_totals(finished, 1, 2)
    assert words.startswith("3 drives finished (2 of them before), 1 failed: 0.00556 hours of video, 500 frames")
    assert "tracked in 60% of them, lost for 3.0 s; 150 s of processor" in words and "Worst: worse.mp4" in words
    assert describe_totals([], 4, 0) == "0 drives finished (0 of them before), 4 failed."


def test_data_set_is_partitioned_by_drive(drive, tmp_path):
    _, settings = drive
    telemetry = settings.output / "a=b ö.csv"
    (settings.output / "drive.csv").rename(telemetry)
    part = add_to_data_set(telemetry, settings.output)
    assert part.relative_to(settings.output).as_posix() == "summary/telemetry/drive=a%3Db %C3%B6/part.csv"
    np.testing.assert_array_equal(read_telemetry(part)["frame"], np.arange(6))


def test_a_drive_that_fails_now_leaves_the_data_set(drive):
    video, settings = drive
    part = add_to_data_set(settings.output / "drive.csv", settings.output)
    write_summary(settings.output, [], {video: ValueError("drive.mp4: is empty, copy it")})
    assert not part.exists()


def read_telemetry_text(path: Path) -> list[list[str]]:
    import csv

    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))
