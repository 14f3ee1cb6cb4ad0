"""Many drives on Dask: the results of a serial run, once each, also after workers died, errors or a stop."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from pickle import dumps, loads

import av
import numpy as np
import psutil
import pytest

from lanes import many
from lanes.annotation import DriveSettings
from lanes.camera.field_of_view import FieldOfView
from lanes.detect.markings import load_markings, read_network
from lanes.drive import annotate_drive
from lanes.errors import VideoError
from lanes.files import locked, partial_files, read_telemetry
from lanes.many import annotate_many
from lanes.video.reader import inspect_video
from simulator.rendering.drive import Motion
from tests.support.clips import encode, write_drive
from tests.support.command_line import start
from tests.support.onnx_file import threshold, write_model
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'dask[distributed]' bokeh")

# x264 makes the same bytes each time only of widths that are multiples of 256 (tests/video/test_process.py).
SMALL = CAMERA.scaled((768, 432))
DRIVES, FRAMES = 4, 12
LOGITS = {"input_size": [640, 360], "channel": 1, "values": "logits"}


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> Path:
    """Different short drives and their camera."""
    folder = tmp_path_factory.mktemp("drives")
    for number in range(DRIVES):
        road = PaintedDrive(s_bend(), lane_lines(), motion=Motion(50.0 * number, 25.0, offset_m=0.3), camera=SMALL)
        write_drive(folder / f"drive{number}.mp4", road, FRAMES)
    return folder


def videos_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mp4"))


def settings_for(output: Path, **changes: object) -> DriveSettings:
    return DriveSettings(output=output, camera=SMALL, progress=False, **changes)


def leftovers(output: Path) -> list[str]:
    return [path.name for path in output.rglob("*.partial.*")]


def finished_in(output: Path) -> list[Path]:
    """Videos whose manifest is written; a killed worker may leave a part of one."""
    manifests = (path for path in output.glob("*.json") if ".partial." not in path.name)
    return [path.with_suffix(".mp4") for path in manifests]


def check_whole(output: Path, videos: list[Path]) -> None:
    """Check that each drive is there once, with all its frames once and in order, and nothing else."""
    assert [path.name for path in videos_in(output)] == [video.name for video in videos]
    for video in videos:
        table = read_telemetry(output / f"{video.stem}.csv")
        np.testing.assert_array_equal(table["frame"], np.arange(FRAMES))
        assert inspect_video(output / video.name).frames == FRAMES
    finished = [row["drive"] for row in summary(output) if row["state"] == "finished"]
    assert sorted(finished) == [video.stem for video in videos]
    assert leftovers(output) == []


def summary(output: Path) -> list[dict[str, str]]:
    """The rows of the table of all drives."""
    with (output / "summary" / "drives.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def wait_for(condition: Callable[[], object], seconds: float = 180) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "waited too long"
        time.sleep(0.01)


# --- two processes on this machine


@pytest.mark.slow
def test_results_equal_those_of_a_serial_run_although_a_worker_is_killed(drives, tmp_path):
    videos, killed = videos_in(drives), []

    def busy_workers() -> Iterator[psutil.Process]:
        for child in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                if any(file.path.startswith(f"{tmp_path}/many/drive") for file in child.open_files()):
                    yield child

    def kill_one(message: str) -> None:
        if "frames/s" in message and not killed:
            # the worker that was seen busy: a second look may find none
            wait_for(lambda: killed.extend(islice(busy_workers(), 1)) or killed)
            killed[0].kill()

    finished, failures = annotate_many(videos, settings_for(tmp_path / "many"), workers=2, log=kill_one)
    assert killed and failures == [] and [drive.frames for drive in finished] == [FRAMES] * DRIVES
    check_whole(tmp_path / "many", videos)
    for video in videos[::2]:
        annotate_drive(video, settings_for(tmp_path / "serial"))
        assert (tmp_path / "many" / video.name).read_bytes() == (tmp_path / "serial" / video.name).read_bytes()
        tables = [read_telemetry(tmp_path / name / f"{video.stem}.csv") for name in ("many", "serial")]
        assert list(tables[0]) == list(tables[1])
        for name in set(tables[0]) - {"latency_ms"}:
            np.testing.assert_array_equal(tables[0][name], tables[1][name], err_msg=f"{video}: {name}")


# --- one thread of this process


@pytest.fixture(scope="module")
def client() -> Iterator[distributed.Client]:
    """A worker thread of this process: quick to start, and open to monkeypatch."""
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        yield client


@pytest.fixture
def in_this_process(client, monkeypatch) -> None:
    monkeypatch.setattr(many, "connect", lambda *_: nullcontext(client))


def test_failed_drives_do_not_stop_the_others_and_come_first_in_the_table(
    drives, tmp_path, in_this_process, monkeypatch
):
    """Two frames of the grey road, which has no lane, are missing."""
    images = [np.full((432, 768, 3), 128, np.uint8)] * 5
    grey = encode(tmp_path / "a grey=road.avi", images, "mjpeg", "yuvj420p", numbers=(0, 1, 4, 5, 6))
    videos, output = [*videos_in(drives)[:2], grey, tmp_path / "empty.mp4"], tmp_path / "out"
    videos[3].touch()
    monkeypatch.setattr(many, "annotate_drive", lambda v, s: annotate_drive(v, s) if v != videos[1] else 1 / 0)
    finished, failures = annotate_many(videos, settings_for(output), log=lambda _: None)
    words = "the file is empty; copy it again from its source.", "ZeroDivisionError: division by zero"
    assert {str(e) for e in failures} == {f"{videos[3]}: {words[0]}", f"{videos[1]}: {words[1]}"} and len(finished) == 2
    *failed, worst, best = summary(output)
    assert [(row["drive"], row["state"], row["reason"]) for row in failed][1] == ("empty", "failed", str(failures[0]))
    assert (worst["drive"], worst["source"], best["drive"]) == ("a grey=road", str(grey), "drive0")
    measures = ("tracked_share", "lost_s", "frames", "missing", "length_s")
    assert [float(worst[name]) for name in measures] == pytest.approx([0, 0.28, 5, 2, 0.28])
    assert [float(best[name]) for name in measures] == pytest.approx([0.9, 0, FRAMES, 0, FRAMES / 25], abs=0.11)


def test_a_changed_drive_or_manifest_is_annotated_again(drives, tmp_path, in_this_process, monkeypatch):
    """Also after a change that is taken back: the manifest is that of the last run. Anyone may have written it."""
    video, out = shutil.copy(drives / "drive1.mp4", tmp_path / "drive.mp4"), tmp_path / "out"
    manifest = out / "drive.json"

    def annotated(**changes: object) -> bool:
        before = (out / "drive.csv").stat().st_mtime_ns if out.exists() else 0
        finished, failures = annotate_many([video], replace(settings_for(out), **changes), log=lambda _: None)
        assert len(finished) == 1 and failures == []
        return (out / "drive.csv").stat().st_mtime_ns != before

    def rewrite(**entries: object) -> None:
        manifest.write_text(json.dumps(json.loads(manifest.read_text()) | entries))

    assert annotated() and not annotated(progress=True)
    other = {"fingerprint": json.loads(manifest.read_text())["fingerprint"] | {"versions": {}}}
    changes = {
        "input grown": lambda: video.write_bytes(video.read_bytes() + b"x"),
        "input touched": lambda: os.utime(video, ns=(0, 10**18)),
        "output removed": lambda: (out / "drive.html").unlink(),
        "output cut": lambda: os.truncate(out / "drive.mp4", 100),
        "no manifest": lambda: manifest.unlink(),
        "cut manifest": lambda: os.truncate(manifest, 99),
        "nested manifest": lambda: manifest.write_text("[" * 99_999),
        "other outputs": lambda: rewrite(outputs={"/etc/passwd": 1}),
        "words": lambda: rewrite(frames="many"),
        "other versions": lambda: rewrite(**other),
    }
    for name, change in changes.items():
        change()
        assert annotated() and not annotated(), name
    moved = SMALL.with_pose(replace(SMALL.pose, height_m=1.4))
    for settings in ({"style": "lines"}, {"camera": moved}, {"camera": None, "field": FieldOfView(60.0, "as given")}):
        assert annotated(**settings) and not annotated(**settings), settings
    with monkeypatch.context() as patch:  # without unfinished drives nothing is started
        patch.setattr(many, "connect", lambda *_: pytest.fail("started"))
        assert not annotated(**settings)
    manifest.unlink()
    os.mkfifo(manifest)
    finished, failures = annotate_many([video], settings_for(out))
    assert finished == [] and "drive.json: cannot be written (it is a pipe" in str(failures[0])


@pytest.mark.parametrize("faults", [many.RETRIES, many.RETRIES + 1])
def test_disk_errors_are_retried_a_limited_number_of_times(faults, drives, tmp_path, in_this_process, monkeypatch):
    attempts: list[Path] = []

    def fail(video: Path, settings: DriveSettings):
        attempts.append(video)
        if len(attempts) <= faults:
            raise OSError(28, "No space left on device")
        return annotate_drive(video, settings)

    monkeypatch.setattr(many, "annotate_drive", fail)
    video = videos_in(drives)[0]
    finished, failures = annotate_many([video], settings_for(tmp_path))
    assert len(attempts) == many.RETRIES + 1 and len(finished) + len(failures) == 1
    assert bool(failures) == (faults > many.RETRIES)
    assert not failures or f"{video}: " in str(failures[0]) and "No space left" in str(failures[0])


def test_a_worker_with_other_versions_or_another_disk_is_reported(drives, tmp_path, in_this_process, monkeypatch):
    video, versions = videos_in(drives)[0], many.all_versions()
    answers = iter([versions, versions | {"OpenCV": "4.0.0"}])
    with monkeypatch.context() as patch:
        patch.setattr(many, "all_versions", lambda: next(answers))
        _, (failure,) = annotate_many([video], settings_for(tmp_path))
    assert re.search(r"drive0\.mp4: the worker on \S+ has OpenCV 4\.0\.0, so that its results would diff", str(failure))
    assert not (tmp_path / "drive0.mp4").exists()

    run_job = many.run_job

    def run_elsewhere(job: many.DriveJob) -> many.FinishedDrive:
        finished = run_job(job)
        (tmp_path / "drive0.mp4").unlink()
        return finished

    monkeypatch.setattr(many, "run_job", run_elsewhere)
    _, (failure,) = annotate_many([video], settings_for(tmp_path))
    assert re.search(r"drive0\.mp4: its worker wrote drive0\.mp4, but not into .*storage that all", str(failure))


def test_an_interrupted_run_leaves_what_another_run_is_writing(drives, tmp_path, monkeypatch):
    """Its lock covers the partial file of the first drive; that of the second is of a killed run."""
    videos, output = videos_in(drives)[:2], tmp_path / "out"
    output.mkdir()
    for video in videos:
        for file in (*partial_files(output / video.name), *partial_files(output / f"{video.stem}.lane.mcap")):
            file.write_bytes(b"written so far")
    with locked(partial_files(output / videos[0].name)[1]):

        @contextmanager
        def interrupted(*_: object) -> Iterator[None]:
            raise KeyboardInterrupt
            yield

        monkeypatch.setattr(many, "connect", interrupted)
        with pytest.raises(KeyboardInterrupt):
            annotate_many(videos, settings_for(output))
        assert {path.name for path in output.iterdir()} == {"drive0.partial.mp4", "drive0.partial.mp4.lock"}
        assert (output / "drive0.partial.mp4").read_bytes() == b"written so far"


def run_job(video: Path, output: Path) -> object:
    settings = settings_for(output)
    return many.run_job(many.DriveJob(video, settings, many.fingerprint(video, settings)))


def test_a_warning_of_a_worker_is_one_line_with_its_drive(drives, tmp_path, monkeypatch, capsys):
    video = videos_in(drives)[0]
    monkeypatch.setattr(many, "annotate_drive", lambda video, _: warnings.warn(f"{video.name}: odd", stacklevel=1))
    with suppress(AttributeError):  # nothing was annotated
        run_job(video, tmp_path)
    assert capsys.readouterr().err == "warning: drive0.mp4: odd\n"


@pytest.mark.parametrize("kind", [av.error.OSError, av.error.PermissionError, av.error.InvalidDataError])
@pytest.mark.parametrize("reworded", [False, True])
def test_errors_of_pyav_reach_the_user_as_in_a_local_run(kind, reworded, drives, tmp_path, monkeypatch):
    """A worker sends them to another process, which needs plain errors, also as the cause of ours."""
    video, error = videos_in(drives)[0], kind(5, "Input/output error", "drive.mp4")

    def fail(*_: object) -> None:
        if not reworded:
            raise error
        raise (OSError if isinstance(error, OSError) else VideoError)(str(error)) from error

    monkeypatch.setattr(many, "annotate_drive", fail)
    try:
        sent = run_job(video, tmp_path)
    except OSError as raised:
        sent = raised
    received = loads(dumps(sent))
    assert type(received) in (OSError, ValueError, VideoError)
    assert isinstance(received, OSError) == isinstance(error, OSError) and str(received) == str(error)


def test_a_worker_with_another_network_is_reported(drives, tmp_path, in_this_process):
    """A file of the same name on another machine."""
    file = write_model(tmp_path / "m.onnx", {"lines": threshold()}, LOGITS)
    settings = settings_for(tmp_path / "out", markings=load_markings(file))
    write_model(file, {"lines": threshold(1, 0, 0)}, None)
    read_network.cache_clear()
    _, (failure,) = annotate_many(videos_in(drives)[:1], settings)
    assert re.search(r"drive0\.mp4: .*m\.onnx: changed during the run, or differs between machines", str(failure))


# --- the command


def test_no_scheduler_and_no_dask_are_reported(drives, tmp_path, monkeypatch, run):
    arguments = "annotate", "--camera", drives / "drive0.yaml", drives / "drive0.mp4", "-o", tmp_path / "out"
    monkeypatch.setattr(many, "CONNECT_TIMEOUT_S", 0.5)
    status, _, err = run(*arguments, "--scheduler", "tcp://127.0.0.1:9")
    assert status == 1 and err.startswith("error: tcp://127.0.0.1:9: no Dask scheduler answers")
    for name in ("dask", "distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    status, out, err = run(*arguments, "--workers", 2)
    assert (status, out) == (1, "") and not (tmp_path / "out").exists()
    words = r"error: .* need Dask, which is not installed; run `pip install 'dask\[distributed\]' .*\n"
    assert re.fullmatch(words, err)
    status, _, err = run(*arguments)
    assert (status, err) == (0, "") and not (tmp_path / "out" / "summary").exists()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_killed_run_continues(number, drives, tmp_path):
    output = tmp_path / "out"
    arguments = ["annotate", "--camera", drives / "drive0.yaml", drives, "-o", output, "--workers", 2]
    with start(*arguments, new_session=True) as child:
        wait_for(lambda: finished_in(output) and leftovers(output) or child.poll() is not None)
        workers = psutil.Process(child.pid).children(recursive=True)
        # A terminal sends Ctrl-C to all processes.
        os.killpg(child.pid, number) if number == signal.SIGINT else child.send_signal(number)
        _, err = child.communicate(timeout=180)
    # Its workers notice, and end.
    wait_for(lambda: not any(worker.is_running() and worker.status() != "zombie" for worker in workers))
    assert child.returncode == (130 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:
        assert "interrupted" in err and "Traceback" not in err and leftovers(output) == []
        return
    finished = finished_in(output)
    assert 0 < len(finished) < DRIVES
    before = {path: path.stat().st_mtime_ns for path in finished}
    with start(*arguments) as child:
        out, err = child.communicate(timeout=300)
    assert child.returncode == 0, err
    assert f"{DRIVES} drives finished, 0 failed; {len(finished)} of {DRIVES} drives were finished before" in out
    assert {path: path.stat().st_mtime_ns for path in finished} == before
    check_whole(output, videos_in(drives))
