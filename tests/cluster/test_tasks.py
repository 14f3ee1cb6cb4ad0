"""Tasks of a worker: complete outputs and a manifest, returned permanent errors, raised temporary errors."""

from __future__ import annotations

import os
import pickle
import platform
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lanes import many as tasks
from lanes.annotate import DriveSettings
from lanes.errors import VideoError
from lanes.files import read_telemetry
from lanes.many import DriveJob, Manifest, Plan, begin_drive, finish_drive, run_piece
from tests.support.clips import write_drive
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, straight_road

SMALL = CAMERA.scaled((640, 360))
ROAD = PaintedDrive(straight_road(), lane_lines(), camera=SMALL)


@pytest.fixture
def job(tmp_path) -> DriveJob:
    video = write_drive(tmp_path / "drive.mp4", ROAD, 15)
    return DriveJob.from_video(video, DriveSettings(output=tmp_path / "out", camera=SMALL), 300.0)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def in_pieces(job: DriveJob) -> DriveJob:
    return DriveJob.from_video(job.video, job.settings, 0.2)


def test_job_has_absolute_paths(tmp_path, monkeypatch):
    write_drive(tmp_path / "drive.mp4", ROAD, 1)
    monkeypatch.chdir(tmp_path)
    job = DriveJob.from_video(Path("drive.mp4"), DriveSettings(output=Path("out"), camera=SMALL), 300.0)
    assert (job.video, job.settings.output) == (tmp_path / "drive.mp4", tmp_path / "out")
    assert not job.settings.progress and not job.settings.overlapped
    assert pickle.loads(pickle.dumps(job)).key == job.key


def test_short_drive_is_one_task(job, monkeypatch):
    out = job.settings.output
    out.mkdir()
    (out / "drive.partial.0123456789ab.mp4").write_text("half")
    (out / "drive.pieces.0123456789ab").mkdir()
    (out / "drive.pieces.mine").mkdir()
    manifest = begin_drive(job)
    assert isinstance(manifest, Manifest) and manifest.frames == 15 and manifest.cpu_s > 0.05
    assert names(out) == {"drive.mp4", "drive.csv", "drive.html", "drive.json", "summary", "drive.pieces.mine"}
    # A worker may die before it returns; the task is then not repeated.
    monkeypatch.setattr(tasks, "prepare_drive", lambda *_: pytest.fail("done again"))
    assert begin_drive(job) == manifest


def test_long_drive_is_cut_and_joined(job):
    job = in_pieces(job)
    plan = begin_drive(job)
    assert isinstance(plan, Plan) and len(plan.pieces) == 3
    assert not job.settings.output.exists()
    done = [run_piece(job, plan.drive, piece) for piece in pickle.loads(pickle.dumps(plan)).pieces]
    manifest = finish_drive(job, plan, done)
    assert (manifest.frames, manifest.pieces) == (15, 3)
    assert manifest.cpu_s > sum(piece.cpu_s for piece in done)
    assert names(job.settings.output) == {"drive.mp4", "drive.csv", "drive.html", "drive.json", "summary"}
    part = job.settings.output / "summary" / "telemetry" / "drive=drive" / "part.csv"
    np.testing.assert_array_equal(read_telemetry(part)["frame"], np.arange(15))
    assert finish_drive(job, plan, done) == manifest


def test_failed_piece_fails_the_drive(job):
    job = in_pieces(job)
    plan = begin_drive(job)
    assert finish_drive(job, plan, [VideoError("damaged")]).args == ("damaged",)


def test_damaged_piece_is_removed(job):
    job = in_pieces(job)
    plan = begin_drive(job)
    done = [run_piece(job, plan.drive, piece) for piece in plan.pieces]
    os.truncate(job.folder / "0001.mp4", 2000)
    assert isinstance(finish_drive(job, plan, done), VideoError)
    assert names(job.settings.output) == {"drive.csv"}
    done = [run_piece(job, plan.drive, piece) for piece in plan.pieces]
    assert finish_drive(job, plan, done).frames == 15


def test_permanent_errors_are_returned(job):
    job.video.write_bytes(b"no video at all")
    assert "cannot be read as a video" in str(begin_drive(job))
    job.video.unlink()
    error = begin_drive(job)
    assert isinstance(error, FileNotFoundError)
    assert f"no such video file; check the name and the folder. (worker on {platform.node()} in {Path.cwd()}" in str(
        error
    )


def test_temporary_errors_are_raised(job, monkeypatch):
    def full(*_) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tasks, "annotate_prepared", full)
    with pytest.raises(OSError, match="No space left"):
        begin_drive(job)


def test_worker_with_other_versions_returns_an_error(job):
    key = replace(job.key, versions={**job.key.versions, "OpenCV": "4.0.0"})
    error = begin_drive(replace(job, key=key))
    assert isinstance(error, ValueError) and "instead of 4.0.0, so that its results would differ" in str(error)
    assert not job.settings.output.exists()
