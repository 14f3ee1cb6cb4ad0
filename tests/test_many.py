"""Many drives: the results of a serial run, once each, also after deaths and a stop.

Workers are processes of this machine, and those of a Dask cluster.
"""

from __future__ import annotations

import csv
import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest

import lanes
from lanes.annotation import DriveSettings
from lanes.camera.field_of_view import GIVEN, FieldOfView
from lanes.detect.markings import load_markings
from lanes.drive import annotate_drive
from lanes.files import locked, partial_files, read_telemetry
from lanes.many import (
    RETRIES,
    DriveJob,
    FinishedDrive,
    annotate_many,
    fingerprint,
    outcome_of,
    read_finished,
    run_job,
)
from lanes.video.reader import inspect_video
from simulator.rendering.drive import Motion
from tests.support.clips import encode, write_drive
from tests.support.command_line import start
from tests.support.faults import Fault, count_calls
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend
from tests.support.project import ROOT

# x264 makes the same bytes each time only of widths that are multiples of 256
# (tests/video/test_process.py).
SMALL = CAMERA.scaled((768, 432))
DRIVES, FRAMES = 4, 12


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> Path:
    """A folder of different short drives and their camera."""
    folder = tmp_path_factory.mktemp("drives")
    for number in range(DRIVES):
        motion = Motion(50.0 * number, 25.0, offset_m=0.3)
        drive = PaintedDrive(s_bend(), lane_lines(), motion=motion, camera=SMALL)
        write_drive(folder / f"drive{number}.mp4", drive, FRAMES)
    return folder


@pytest.fixture
def video(drives) -> Path:
    return drives / "drive0.mp4"


def videos_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mp4"))


def settings_for(output: Path, **changes: object) -> DriveSettings:
    return DriveSettings(output=output, camera=SMALL, progress=False, **changes)


def job_for(video: Path, output: Path, **changes: object) -> DriveJob:
    settings = settings_for(output, **changes)
    return DriveJob(video, settings, fingerprint(video, settings))


def leftovers(output: Path) -> list[str]:
    return [path.name for path in output.rglob("*.partial.*")]


def finished_in(output: Path) -> list[Path]:
    """Videos whose manifest is written; a killed worker may leave a part of one."""
    manifests = [path for path in output.glob("*.json") if ".partial." not in path.name]
    return [path.with_suffix(".mp4") for path in manifests]


def check_whole(output: Path, videos: list[Path]) -> None:
    """Each drive is there once, with all its frames in order, and nothing else."""
    assert [path.name for path in videos_in(output)] == [path.name for path in videos]
    for video in videos:
        table = read_telemetry(output / f"{video.stem}.csv")
        np.testing.assert_array_equal(table["frame"], np.arange(FRAMES))
        assert inspect_video(output / video.name).frames == FRAMES
    finished = [row["drive"] for row in summary(output) if row["state"] == "finished"]
    assert sorted(finished) == [video.stem for video in videos]
    assert leftovers(output) == []


def summary(output: Path) -> list[dict[str, str]]:
    """The rows of the table of all drives."""
    path = output / "summary" / "drives.csv"
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def wait_for(condition: Callable[[], object], seconds: float = 180) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "waited too long"
        time.sleep(0.01)


# Where the drives are annotated: the address of a scheduler, or None for this machine.


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a cluster of two processes, as of another program."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    quiet = {"dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, **quiet
    ) as local:
        yield local.scheduler_address


@pytest.fixture(params=["processes", "cluster"])
def where(request) -> dict[str, object]:
    """Options of `annotate_many` for both kinds of workers."""
    if request.param == "processes":
        return {"workers": 2}
    return {"scheduler": request.getfixturevalue("cluster")}


# Results.


@pytest.mark.slow
def test_results_equal_those_of_a_serial_run(drives, tmp_path, where):
    videos = videos_in(drives)
    many, serial = tmp_path / "many", tmp_path / "serial"
    finished, failures = annotate_many(videos, settings_for(many), **where)
    assert failures == []
    assert [drive.frames for drive in finished] == [FRAMES] * DRIVES
    check_whole(many, videos)

    require_as_serial(many, videos[1], serial)


def require_as_serial(many: Path, video: Path, serial: Path) -> None:
    """A drive's results are those of `annotate_drive`, which writes into `serial`."""
    annotate_drive(video, settings_for(serial))
    expected = (serial / video.name).read_bytes()
    assert (many / video.name).read_bytes() == expected
    expected = read_telemetry(serial / f"{video.stem}.csv")
    found = read_telemetry(many / f"{video.stem}.csv")
    assert list(found) == list(expected)
    for name in found.keys() - {"latency_ms"}:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


def write_gray(path: Path) -> Path:
    """A road without a lane, where two frames are missing."""
    images = [np.full((432, 768, 3), 128, np.uint8)] * 5
    return encode(path, images, "mjpeg", "yuvj420p", numbers=(0, 1, 4, 5, 6))


@pytest.fixture
def gray(tmp_path) -> Path:
    return write_gray(tmp_path / "a gray=road.avi")


@pytest.fixture
def empty(tmp_path) -> Path:
    path = tmp_path / "empty.mp4"
    path.touch()
    return path


@pytest.mark.slow
def test_failed_drives_are_named_and_the_others_go_on(
    video, gray, empty, tmp_path, where
):
    fault = Fault(tmp_path / "calls", "bug", of_gray=True)
    settings = settings_for(tmp_path / "out", markings=fault)
    finished, failures = annotate_many([gray, empty, video], settings, **where)
    assert [drive.fingerprint["source"] for drive in finished] == [str(video)]
    assert {str(failure) for failure in failures} == {
        f"{gray}: ZeroDivisionError: division by zero",
        f"{empty}: the file is empty; copy it again from its source.",
    }


class TestTable:
    """Of two empty videos, a gray one and a road."""

    @pytest.fixture(scope="class")
    @classmethod
    def folder(cls, drives, tmp_path_factory) -> Path:
        folder = tmp_path_factory.mktemp("table")
        shutil.copy(drives / "drive0.mp4", folder)
        write_gray(folder / "a gray=road.avi")
        for name in ("empty.mp4", "also empty.mp4"):
            (folder / name).touch()
        return folder

    @pytest.fixture(scope="class")
    @classmethod
    def failures(cls, folder) -> list[Exception]:
        videos = [path for path in folder.iterdir() if path.is_file()]
        settings = settings_for(folder / "out")
        _, failures = annotate_many(videos, settings, workers=2)
        return failures

    @pytest.fixture
    def rows(self, folder, failures) -> list[dict[str, str]]:
        return summary(folder / "out")

    def test_failed_drives_and_bad_tracks_come_first(self, rows, folder):
        found = [(row["state"], row["drive"], row["source"]) for row in rows]
        assert found == [
            ("failed", "also empty", str(folder / "also empty.mp4")),
            ("failed", "empty", str(folder / "empty.mp4")),
            ("finished", "a gray=road", str(folder / "a gray=road.avi")),
            ("finished", "drive0", str(folder / "drive0.mp4")),
        ]

    def test_failed_drives_have_their_reasons(self, rows, failures):
        assert {row["reason"] for row in rows[:2]} == set(map(str, failures))

    def test_finished_drives_have_their_measures(self, rows):
        of_drive = {}
        for row in rows[2:]:
            names = ("frames", "missing", "length_s", "lost_s", "tracked_share")
            of_drive[row["drive"]] = [float(row[name]) for name in names]
        assert of_drive["a gray=road"] == pytest.approx([5, 2, 0.28, 0.28, 0])
        frames, missing, length_s, lost_s, tracked = of_drive["drive0"]
        assert (frames, missing, length_s) == pytest.approx((FRAMES, 0, FRAMES / 25))
        assert lost_s <= 0.11
        assert tracked > 0.8


# Faults that may pass.


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["full disk", "death"])
class TestRepeatedTasks:
    def test_a_drive_is_finished_after_faults(self, video, tmp_path, where, kind):
        fault = Fault(tmp_path / "calls", kind, times=RETRIES)
        settings = settings_for(tmp_path / "out", markings=fault)
        finished, failures = annotate_many([video], settings, **where)
        assert failures == []
        assert finished[0].frames == FRAMES
        assert leftovers(tmp_path / "out") == []

    def test_a_drive_fails_after_too_many(self, video, tmp_path, kind):
        fault = Fault(tmp_path / "calls", kind)
        settings = settings_for(tmp_path / "out", markings=fault)
        _, (failure,) = annotate_many([video], settings, workers=2)
        words = {"full disk": "No space left", "death": "its worker died 3 times"}
        assert re.search(rf"drive0\.mp4: .*{words[kind]}", str(failure))
        assert count_calls(fault.calls) == RETRIES + 1
        assert leftovers(tmp_path / "out") == []


@pytest.mark.slow
def test_a_worker_that_dies_takes_no_other_drive_with_it(drives, gray, tmp_path):
    """A gray drive always kills its worker."""
    fault = Fault(tmp_path / "calls", "death", of_gray=True)
    settings = settings_for(tmp_path / "out", markings=fault)
    videos = [gray, *videos_in(drives)]
    finished, (failure,) = annotate_many(videos, settings, workers=2)
    assert str(failure).startswith(f"{gray}: its worker died")
    assert len(finished) == DRIVES


@pytest.mark.slow
def test_a_worker_that_is_killed_is_replaced(drives, tmp_path):
    """As by a system without memory, while it writes."""
    output = tmp_path / "out"
    killed: list[psutil.Process] = []

    def kill_a_writer() -> bool:
        for child in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                paths = [file.path for file in child.open_files()]
                if any(path.startswith(f"{output}/drive") for path in paths):
                    child.kill()
                    killed.append(child)
                    return True
        return False

    def log(message: str) -> None:
        if "frames/s" in message and not killed:
            wait_for(kill_a_writer)

    videos = videos_in(drives)
    settings = settings_for(output)
    finished, failures = annotate_many(videos, settings, workers=2, log=log)
    assert killed
    assert failures == []
    assert [drive.frames for drive in finished] == [FRAMES] * DRIVES
    check_whole(output, videos)
    for video in videos[::2]:
        require_as_serial(output, video, tmp_path / "serial")


PYAV_ERRORS = ["OSError", "PermissionError", "InvalidDataError"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", PYAV_ERRORS)
def test_errors_of_pyav_reach_the_user_as_in_a_local_run(kind, video, tmp_path, where):
    """A worker sends them to another process, which needs plain errors."""
    fault = Fault(tmp_path / "calls", kind)
    settings = settings_for(tmp_path / "out", markings=fault)
    with pytest.raises((OSError, ValueError)) as local:
        annotate_drive(video, settings)
    _, (failure,) = annotate_many([video], settings, **where)
    assert str(failure) == f"{video}: {local.value}"


def test_errors_that_were_caused_by_pyav_can_be_sent(tmp_path):
    """A damaged video: our error has PyAV's as its cause."""
    video = tmp_path / "damaged.mp4"
    video.write_bytes(b"\0\0\0\x20ftypisom" + bytes(2000))
    with pytest.raises(ValueError, match=r"damaged\.mp4") as local:
        annotate_drive(video, settings_for(tmp_path / "out"))
    sent = run_job(job_for(video, tmp_path / "out"))
    received = pickle.loads(pickle.dumps(sent))
    assert type(received) is type(local.value)
    assert str(received) == str(local.value)
    assert sent.__cause__ is None


@pytest.mark.slow
def test_a_warning_of_a_worker_is_one_line_with_its_drive(tmp_path, capfd):
    """A portrait video with the field of view of its longer side."""
    images = [np.full((768, 432, 3), 128, np.uint8)] * 2
    video = encode(tmp_path / "portrait.avi", images, "mjpeg", "yuvj420p")
    field = FieldOfView(90.0, GIVEN)
    settings = DriveSettings(output=tmp_path / "out", progress=False, field=field)
    annotate_many([video], settings, workers=1)
    err = capfd.readouterr().err
    assert re.fullmatch(rf"warning: {video}: the images are in portrait.*\n", err), err


WITH_A_BAR = """
from lanes.console import progress_bar
from lanes.many import LocalProcesses

def work(_):
    progress_bar(None, "frame", 1).close()

if __name__ == "__main__":
    with LocalProcesses(4) as processes:
        list(processes.map(work, range(4)))
"""


@pytest.mark.slow
def test_workers_leave_no_semaphores_of_progress_bars(tmp_path):
    """Python warns of them when it ends."""
    script = tmp_path / "work.py"
    script.write_text(WITH_A_BAR)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


# Workers on other machines.


def test_a_worker_with_other_versions_is_reported(video, tmp_path):
    job = job_for(video, tmp_path)
    versions = job.fingerprint["versions"] | {"OpenCV": "4.0.0"}
    other = replace(job, fingerprint={**job.fingerprint, "versions": versions})
    words = r"the worker on \S+ has OpenCV 5\S+, so that its results would differ"
    assert re.search(words, str(run_job(other)))
    assert not (tmp_path / "drive0.mp4").exists()


def test_a_worker_with_another_code_is_reported(video, tmp_path):
    """Of a release that has the same version but for one line."""
    package = tmp_path / "other" / "lanes"
    shutil.copytree(Path(lanes.__file__).parent, package)
    with (package / "tracking" / "filter.py").open("a") as code:
        code.write("# changed\n")
    job = tmp_path / "job"
    job.write_bytes(pickle.dumps(job_for(video, tmp_path)))
    worker = (
        "import pathlib, pickle; from lanes.many import run_job; "
        f"print(run_job(pickle.loads(pathlib.Path({str(job)!r}).read_bytes())))"
    )
    done = subprocess.run(
        [sys.executable, "-c", worker],
        cwd=package.parent,
        env={**os.environ, "PYTHONPATH": str(package.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    words = r"the worker on \S+ has lanes \w+, so that its results would differ"
    assert re.search(words, done.stdout)


def test_a_worker_on_another_disk_is_reported(video, tmp_path):
    job = job_for(video, tmp_path)
    future: Future = Future()
    future.set_result(run_job(job))
    assert isinstance(outcome_of(job, future), FinishedDrive)
    (tmp_path / "drive0.mp4").unlink()
    words = (
        r"drive0\.mp4: its worker wrote drive0\.mp4, but not into .*storage that all"
    )
    assert re.search(words, str(outcome_of(job, future)))


def test_a_worker_without_the_drive_is_reported(video, tmp_path):
    copy = shutil.copy(video, tmp_path / "copy.mp4")
    job = job_for(copy, tmp_path / "out")
    copy.unlink()
    error = run_job(job)
    assert isinstance(error, FileNotFoundError)
    assert re.search("all workers must see the drives by the same path", str(error))


def test_a_worker_with_another_network_is_reported(video, tmp_path):
    """A file of the same name on another machine."""
    networks = pytest.importorskip("tests.support.onnx_file")
    lines = {"lines": networks.threshold()}
    file = networks.write_model(tmp_path / "m.onnx", lines)
    settings = settings_for(tmp_path / "out", markings=load_markings(file))
    networks.write_model(file, {"lines": networks.threshold(1, 0, 0)})
    _, (failure,) = annotate_many([video], settings, workers=1)
    words = r"m\.onnx: changed during the run, or differs between machines"
    assert re.search(rf"drive0\.mp4: .*{words}", str(failure))


# Finished drives.


def drive_of(manifest: Path) -> Path:
    return manifest.parent.with_name("drive.mp4")


CHANGED_FILES = {
    "grown input": lambda path: os.truncate(drive_of(path), 10**6),
    "touched input": lambda path: os.utime(drive_of(path), ns=(0, 10**18)),
    "no report": lambda path: path.with_suffix(".html").unlink(),
    "cut video": lambda path: os.truncate(path.with_suffix(".mp4"), 100),
}


class TestFinishedDrive:
    @pytest.fixture(scope="class")
    @classmethod
    def run_before(cls, drives, tmp_path_factory) -> Path:
        """A folder with a drive and what was written of it."""
        folder = tmp_path_factory.mktemp("finished")
        drive = shutil.copy(drives / "drive0.mp4", folder / "drive.mp4")
        run_job(job_for(drive, folder / "out"))
        shutil.copytree(folder, folder.with_name("backup"))
        return folder

    @pytest.fixture
    def manifest(self, run_before) -> Iterator[Path]:
        """The manifest of the drive, which is finished."""
        yield run_before / "out" / "drive.json"
        shutil.rmtree(run_before)
        shutil.copytree(run_before.with_name("backup"), run_before)

    def is_skipped(self, manifest: Path, **changes: object) -> bool:
        settings = replace(settings_for(manifest.parent), **changes)
        video = drive_of(manifest)
        job = DriveJob(video, settings, fingerprint(video, settings))
        return read_finished(job) is not None

    def test_is_skipped_without_a_worker(self, manifest):
        """Nobody answers at the address of the scheduler."""
        videos, settings = [drive_of(manifest)], settings_for(manifest.parent)
        nobody = "tcp://127.0.0.1:9"
        finished, _ = annotate_many(videos, settings, scheduler=nobody)
        assert [drive.frames for drive in finished] == [FRAMES]

    def test_is_skipped_with_another_progress(self, manifest):
        assert self.is_skipped(manifest, progress=True)

    @pytest.mark.parametrize(
        "changes",
        [
            {"style": "lines"},
            {"camera": SMALL.with_pose(replace(SMALL.pose, height_m=1.4))},
            {"camera": None, "field": FieldOfView(60.0, "as given")},
        ],
        ids=["style", "camera", "field of view"],
    )
    def test_is_not_skipped_with_other_settings(self, manifest, changes):
        assert not self.is_skipped(manifest, **changes)

    @pytest.mark.parametrize("change", CHANGED_FILES.values(), ids=CHANGED_FILES)
    def test_is_not_skipped_with_another_input_or_output(self, manifest, change):
        change(manifest)
        assert not self.is_skipped(manifest)

    @pytest.mark.parametrize("text", ["", "{", "[" * 99_999, "[]"])
    def test_is_not_skipped_with_a_damaged_manifest(self, manifest, text):
        manifest.write_text(text)
        assert not self.is_skipped(manifest)

    @pytest.mark.parametrize(
        "entries",
        [
            {"outputs": {"/etc/passwd": 1}},
            {"frames": "many"},
            {"other": 1},
            {"fingerprint": {}},
        ],
        ids=lambda entries: next(iter(entries)),
    )
    def test_is_not_skipped_with_the_manifest_of_somebody(self, manifest, entries):
        content = json.loads(manifest.read_text()) | entries
        manifest.write_text(json.dumps(content))
        assert not self.is_skipped(manifest)

    def test_is_not_skipped_with_that_of_other_versions(self, manifest):
        text = manifest.read_text()
        version = f'"OpenCV": "{cv2.__version__}"'
        assert version in text
        manifest.write_text(text.replace(version, '"OpenCV": "4.0.0"'))
        assert not self.is_skipped(manifest)

    def test_is_annotated_again_and_then_skipped(self, manifest):
        os.truncate(manifest.with_suffix(".csv"), 100)
        videos, settings = [drive_of(manifest)], settings_for(manifest.parent)
        assert len(annotate_many(videos, settings, workers=1)[0]) == 1
        assert len(read_telemetry(manifest.with_suffix(".csv"))["frame"]) == FRAMES
        assert self.is_skipped(manifest)

    def test_whose_manifest_cannot_be_written_has_failed(self, manifest):
        manifest.unlink()
        os.mkfifo(manifest)
        with pytest.raises(
            OSError, match=r"drive\.json: cannot be written \(it is a pipe"
        ):
            run_job(job_for(drive_of(manifest), manifest.parent))


# The command.


def test_a_scheduler_that_does_not_answer_is_named(drives, tmp_path, run):
    dask = pytest.importorskip("dask")
    camera, output = drives / "drive0.yaml", tmp_path / "out"
    options = ("--camera", camera, "-o", output, "--scheduler", "tcp://127.0.0.1:9")
    with dask.config.set({"distributed.comm.timeouts.connect": "500ms"}):
        status, _, err = run("annotate", drives / "drive0.mp4", *options)
    assert status == 1
    assert err.startswith("error: tcp://127.0.0.1:9: no Dask scheduler answers")


class TestWithoutDask:
    @pytest.fixture
    def annotate(self, drives, tmp_path, monkeypatch, run) -> Callable:
        for name in ("dask", "distributed"):
            monkeypatch.setitem(sys.modules, name, None)
        video, camera = drives / "drive0.mp4", drives / "drive0.yaml"
        options = ("--camera", camera, "-o", tmp_path / "out")
        return lambda *more: run("annotate", video, *options, *more)

    def test_a_scheduler_cannot_be_used(self, annotate, tmp_path):
        status, out, err = annotate("--scheduler", "tcp://127.0.0.1:9")
        assert (status, out) == (1, "")
        assert not (tmp_path / "out").exists()
        words = (
            r"error: --scheduler needs Dask, which .*`pip install 'dask\[distrib.*\n"
        )
        assert re.fullmatch(words, err)

    def test_workers_of_this_machine_can_be_used(self, annotate, tmp_path):
        status, out, err = annotate("--workers", 2)
        assert (status, err) == (0, "")
        assert "2 workers on this machine; 0 of 1 drives were finished before" in out
        assert (tmp_path / "out" / "summary" / "drives.csv").exists()

    def test_one_drive_after_the_other_has_no_table(self, annotate, tmp_path):
        status, _, err = annotate()
        assert (status, err) == (0, "")
        assert not (tmp_path / "out" / "summary").exists()


@pytest.mark.slow
class TestStoppedRun:
    @pytest.fixture
    def arguments(self, drives, tmp_path) -> list:
        options = ["--camera", drives / "drive0.yaml", "-o", tmp_path / "out"]
        return ["annotate", *options, "--workers", 2, drives]

    def stop(self, arguments: list, output: Path, number: int, group: bool) -> tuple:
        """Start a run, stop it between drives; its process and what it said."""
        with start(*arguments, new_session=True) as child:
            wait_for(lambda: finished_in(output) and leftovers(output))
            workers = psutil.Process(child.pid).children(recursive=True)
            if group:  # a terminal sends Ctrl-C to all processes
                os.killpg(child.pid, number)
            else:
                child.send_signal(number)
            _, err = child.communicate(timeout=180)
        wait_for(lambda: not any(is_alive(worker) for worker in workers))
        return child, err

    @pytest.mark.parametrize("group", [True, False], ids=["terminal", "process"])
    def test_by_ctrl_c_leaves_no_partial_files(self, arguments, tmp_path, group):
        output = tmp_path / "out"
        child, err = self.stop(arguments, output, signal.SIGINT, group)
        assert child.returncode == 130
        assert "interrupted" in err
        assert "Traceback" not in err
        assert leftovers(output) == []

    def test_that_was_killed_is_continued(self, arguments, drives, tmp_path):
        output = tmp_path / "out"
        child, _ = self.stop(arguments, output, signal.SIGKILL, False)
        assert child.returncode == -signal.SIGKILL
        finished = finished_in(output)
        assert 0 < len(finished) < DRIVES
        before = {path: path.stat().st_mtime_ns for path in finished}

        with start(*arguments) as child:
            out, err = child.communicate(timeout=300)
        assert child.returncode == 0, err
        words = (
            f"{DRIVES} drives finished, 0 failed; {len(finished)} of {DRIVES} drives "
            "were finished before"
        )
        assert words in out
        assert {path: path.stat().st_mtime_ns for path in finished} == before
        check_whole(output, videos_in(drives))


def is_alive(process: psutil.Process) -> bool:
    with suppress(psutil.NoSuchProcess):
        return process.status() != psutil.STATUS_ZOMBIE
    return False


@pytest.mark.slow
def test_an_interrupted_run_leaves_what_another_run_is_writing(drives, tmp_path):
    """It locks a part of the first drive; that of the last is of a killed run."""
    output = tmp_path / "out"
    output.mkdir()
    of_other_run, _ = partial_files(output / "drive0.mp4")
    of_killed_run, _ = partial_files(output / "drive3.lane.mcap")
    for path in (of_other_run, of_killed_run):
        path.write_bytes(b"written so far")

    options = ["--camera", drives / "drive0.yaml", "-o", output, "--workers", 1]
    with locked(partial_files(output / "drive0.mp4")[1]):
        with start("annotate", *options, drives) as child:
            wait_for(lambda: finished_in(output))
            child.send_signal(signal.SIGINT)
            child.communicate(timeout=180)
        assert child.returncode == 130
        lock = f"{of_other_run.name}.lock"
        assert set(leftovers(output)) == {of_other_run.name, lock}
        assert of_other_run.read_bytes() == b"written so far"
