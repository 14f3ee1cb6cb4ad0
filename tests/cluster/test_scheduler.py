"""Many drives on Dask: the results of a serial run, also after workers died or errors occurred."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
import pytest

from lanes import many as cluster
from lanes import many as tasks
from lanes.annotate import DriveSettings, annotate_drive
from lanes.files import read_telemetry
from lanes.many import ClusterError, ClusterSettings, DriveJob, Manifest, annotate_all, annotate_many, connect
from lanes.video.reader import inspect_video
from simulator.rendering.drive import Motion
from tests.support.clips import write_drive
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend
from tests.support.project import ROOT

distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install -e '.[cluster]'")

# x264 makes the same bytes each time only of widths that are multiples of 256 (tests/io/video/conftest.py).
SMALL = CAMERA.scaled((768, 432))
# Even, so that two workers finish together.
DRIVES, FRAMES, LONG = 6, 20, 50


@pytest.fixture(scope="module")
def drives(tmp_path_factory) -> Path:
    """Different short drives and their camera."""
    folder = tmp_path_factory.mktemp("drives")
    for number in range(DRIVES):
        road = PaintedDrive(s_bend(), lane_lines(), motion=Motion(50.0 * number, 25.0, offset_m=0.3), camera=SMALL)
        write_drive(folder / f"drive{number}.mp4", road, FRAMES)
    return folder


@pytest.fixture(scope="module")
def long_drive(tmp_path_factory) -> Path:
    road = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0), camera=SMALL)
    return write_drive(tmp_path_factory.mktemp("long") / "long.mp4", road, LONG)


def videos_in(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mp4"))


def settings_for(output: Path) -> DriveSettings:
    return DriveSettings(output=output, camera=SMALL, progress=False)


def jobs_for(videos: list[Path], output: Path, piece_s: float = 300.0) -> list[DriveJob]:
    return [DriveJob.from_video(video, settings_for(output), piece_s) for video in videos]


def leftovers(output: Path) -> list[str]:
    return [path.name for path in output.rglob("*") if ".partial." in path.name or ".pieces." in path.name]


def finished_in(output: Path) -> list[Path]:
    """Videos whose manifest is written; a killed worker may leave a part of one."""
    manifests = (path for path in output.glob("*.json") if ".partial." not in path.name)
    return [path.with_suffix(".mp4") for path in manifests]


def check_whole(output: Path, videos: list[Path], frames: int = FRAMES) -> None:
    """Check that each drive exists once, with all its frames once and in order, and without partial files."""
    assert [path.name for path in videos_in(output)] == [video.name for video in videos]
    for video in videos:
        table = read_telemetry(output / f"{video.stem}.csv")
        np.testing.assert_array_equal(table["frame"], np.arange(frames))
        assert inspect_video(output / video.name).frames == frames
    parts = sorted((output / "summary" / "telemetry").glob("drive=*/part.csv"))
    assert [part.parent.name for part in parts] == [f"drive={video.stem}" for video in videos]
    assert leftovers(output) == []


def wait_for(condition: Callable[[], object], seconds: float = 180) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "waited too long"
        time.sleep(0.01)


@contextmanager
def in_this_process() -> Iterator[distributed.Client]:
    """A worker thread of this process: quick to start, and open to monkeypatch."""
    with distributed.Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        yield client


# --- two processes on this machine


@pytest.fixture(scope="module")
def two_workers() -> Iterator[distributed.Client]:
    with connect(ClusterSettings(workers=2)) as client:
        yield client


def test_results_equal_those_of_a_serial_run(two_workers, drives, tmp_path):
    videos = videos_in(drives)
    began_s = time.time()
    with distributed.get_task_stream(client=two_workers) as stream:
        found = dict(annotate_all(two_workers, jobs_for(videos, tmp_path / "many")))
    elapsed_s = time.time() - began_s
    check_whole(tmp_path / "many", videos)
    assert {job.video: outcome.frames for job, outcome in found.items()} == dict.fromkeys(videos, FRAMES)
    # How much longer one worker would take, on cores that nobody else uses; measured: 1.9 (docs/many_drives.md). On a
    # busy machine one of them may be left behind, but they never wait for each other.
    spans = [span for task in stream.data for span in task["startstops"] if span["action"] == "compute"]
    assert sum(span["stop"] - span["start"] for span in spans) / elapsed_s > 1.5
    serial = DriveSettings(output=tmp_path / "serial", camera=SMALL, progress=False, overlapped=False)
    for video in videos[::2]:
        annotate_drive(video, serial)
        assert (tmp_path / "many" / video.name).read_bytes() == (tmp_path / "serial" / video.name).read_bytes()
        tables = [read_telemetry(tmp_path / name / f"{video.stem}.csv") for name in ("many", "serial")]
        assert list(tables[0]) == list(tables[1])
        for name in set(tables[0]) - {"latency_ms"}:
            np.testing.assert_array_equal(tables[0][name], tables[1][name], err_msg=f"{video}: {name}")


def test_pieces_of_a_long_drive_run_in_parallel(two_workers, long_drive, tmp_path):
    [(_, manifest)] = annotate_all(two_workers, jobs_for([long_drive], tmp_path, piece_s=0.5))
    assert (manifest.pieces, manifest.frames) == (4, LONG)
    check_whole(tmp_path, [long_drive], LONG)
    serial = annotate_drive(long_drive, settings_for(tmp_path / "serial"))
    a, b = read_telemetry(tmp_path / "long.csv"), read_telemetry(serial.telemetry)
    for name in set(a) - {"latency_ms"}:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_killed_worker_loses_and_repeats_no_frame(two_workers, drives, tmp_path):
    videos = videos_in(drives)
    pids, outcomes = two_workers.run(os.getpid), {}

    def writes_here(pid: int) -> bool:
        for link in Path(f"/proc/{pid}/fd").iterdir():
            with suppress(OSError):  # closed meanwhile
                name = os.readlink(link)
                if name.startswith(str(tmp_path)) and ".partial." in name:
                    return True
        return False

    for job, outcome in annotate_all(two_workers, jobs_for(videos, tmp_path)):
        assert job.video not in outcomes
        outcomes[job.video] = outcome
        if len(outcomes) == 1:
            wait_for(lambda: any(map(writes_here, pids.values())))
            busy = next(filter(writes_here, pids.values()))
            os.kill(busy, signal.SIGKILL)
    assert sorted(outcomes) == videos and all(isinstance(found, Manifest) for found in outcomes.values())
    check_whole(tmp_path, videos)
    wait_for(lambda: len(two_workers.run(os.getpid)) == 2)
    assert busy not in two_workers.run(os.getpid).values()


# --- errors of single drives


def test_failed_drive_does_not_stop_the_others(drives, tmp_path, monkeypatch):
    """The next run annotates only the unfinished drive."""
    videos = [*videos_in(drives)[:2], tmp_path / "text.mp4"]
    videos[2].write_text("no video")
    output, messages = tmp_path / "out", []
    with in_this_process() as client:
        monkeypatch.setattr(cluster, "connect", lambda _: borrowed(client))
        finished, failures = annotate_many(
            videos, settings_for(output), ClusterSettings(workers=1), log=messages.append
        )
        assert len(finished) == 2 and [str(error) for error in failures] == [
            f"{videos[2]}: cannot be read as a video (Invalid data found when processing input): it is not a video, "
            "a playlist, or cut off; copy it again, or convert it to mp4."
        ]
        assert "1 workers; dashboard: " in messages[0] and messages[-1].startswith(
            "2 drives finished (0 of them before), 1 f"
        )
        assert (output / "summary" / "drives.csv").read_text().splitlines()[1].startswith("text,failed,")
        before = {path: path.stat().st_mtime_ns for path in output.iterdir() if path.is_file()}
        videos[2].write_bytes(videos[0].read_bytes())
        finished, failures = annotate_many(
            videos, settings_for(output), ClusterSettings(workers=1), log=messages.append
        )
    assert (len(finished), failures) == (3, [])
    assert "2 of 3 drives were finished before" in messages
    assert {path: path.stat().st_mtime_ns for path in before} == before
    check_whole(output, videos)
    # Nothing is left: Dask is not even started.
    monkeypatch.setattr(cluster, "connect", lambda _: pytest.fail("started"))
    finished, failures = annotate_many(videos, settings_for(output), ClusterSettings(workers=1), log=messages.append)
    assert (len(finished), failures) == (3, [])


@contextmanager
def borrowed(client: distributed.Client) -> Iterator[distributed.Client]:
    yield client


@pytest.mark.parametrize("retries", [1, 2])
def test_disk_errors_are_retried_a_limited_number_of_times(drives, tmp_path, monkeypatch, retries):
    attempts, annotate_prepared = [], tasks.annotate_prepared

    def fail_twice(drive, settings):
        attempts.append(drive.video)
        if len(attempts) <= 2:
            raise OSError(28, "No space left on device")
        return annotate_prepared(drive, settings)

    monkeypatch.setattr(tasks, "annotate_prepared", fail_twice)
    video = videos_in(drives)[0]
    with in_this_process() as client:
        [(_, outcome)] = annotate_all(client, jobs_for([video], tmp_path), retries=retries)
    assert len(attempts) == retries + 1
    if retries == 2:
        assert outcome.frames == FRAMES
    else:
        assert isinstance(outcome, OSError) and f"{video}: " in str(outcome) and "No space left" in str(outcome)


def test_bug_is_reported_and_does_not_stop_the_others(drives, tmp_path, monkeypatch):
    videos, annotate_prepared = videos_in(drives)[:2], tasks.annotate_prepared

    def fail_first(drive, settings):
        return annotate_prepared(drive, settings) if drive.video == videos[1] else 1 / 0

    monkeypatch.setattr(tasks, "annotate_prepared", fail_first)
    with in_this_process() as client:
        found = {job.video: outcome for job, outcome in annotate_all(client, jobs_for(videos, tmp_path), retries=0)}
    assert str(found[videos[0]]) == f"{videos[0]}: ZeroDivisionError: division by zero"
    assert found[videos[1]].frames == FRAMES


def test_outputs_written_elsewhere_are_reported(drives, tmp_path, monkeypatch):
    def elsewhere(job):
        manifest = tasks.begin_drive(job)
        (tmp_path / "drive0.mp4").unlink()
        return manifest

    monkeypatch.setattr(cluster, "begin_drive", elsewhere)
    with in_this_process() as client:
        [(_, outcome)] = annotate_all(client, jobs_for(videos_in(drives)[:1], tmp_path))
    assert re.search(r"drive0\.mp4: its worker wrote drive0\.mp4, but not into .*storage that all", str(outcome))


def test_no_scheduler_answers(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT_S", 0.3)
    message = "tcp://127.0.0.1:9: no Dask scheduler answers"
    with pytest.raises(ClusterError, match=message), connect(ClusterSettings(scheduler="tcp://127.0.0.1:9")):
        pass


# --- the command


def start(*arguments: object, cwd: Path = ROOT, before: str = "") -> subprocess.Popen:
    """`python -m lanes`, with code that runs before it."""
    program = f"import sys; {before}\nfrom lanes.__main__ import main\nif __name__ == '__main__': sys.exit(main())"
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return popen(command, cwd)


def popen(command: list[str], cwd: Path) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        command,
        env=environment,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def test_without_dask_a_message_says_how_to_install_it(drives, tmp_path):
    arguments = ["annotate", "--camera", drives / "drive0.yaml", drives / "drive0.mp4", "-o", tmp_path / "out"]
    with start(*arguments, "--workers", 2, before="sys.modules['distributed'] = None") as process:
        out, err = process.communicate(timeout=180)
    assert (process.returncode, out) == (1, "") and not (tmp_path / "out").exists()
    assert re.fullmatch(
        r"error: .* need Dask, which is not installed; run `pip install 'dask\[distributed\]' .*\n", err
    )
    with start(*arguments, before="sys.modules['distributed'] = sys.modules['dask'] = None") as process:
        assert process.communicate(timeout=180)[1] == "" and process.returncode == 0
    assert not (tmp_path / "out" / "summary").exists()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_killed_run_continues(drives, tmp_path, number):
    output = tmp_path / "out"
    arguments = ["annotate", "--camera", drives / "drive0.yaml", drives, "-o", output, "--workers", 2]
    with start(*arguments) as process:
        wait_for(lambda: finished_in(output) and leftovers(output) or process.poll() is not None)
        workers = psutil.Process(process.pid).children(recursive=True)
        # A terminal sends Ctrl-C to all processes.
        os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        _, err = process.communicate(timeout=180)
    # Its workers notice, and end.
    wait_for(lambda: not any(worker.is_running() and worker.status() != "zombie" for worker in workers))
    assert process.returncode == (130 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:
        assert "interrupted" in err and "Traceback" not in err and leftovers(output) == []
        return
    finished = finished_in(output)
    assert 0 < len(finished) < DRIVES
    before = {path: path.stat().st_mtime_ns for path in finished}
    with start(*arguments) as process:
        out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert f"{len(finished)} of {DRIVES} drives were finished before" in out
    assert f"{DRIVES} drives finished ({len(finished)} of them before), 0 failed" in out
    assert {path: path.stat().st_mtime_ns for path in finished} == before
    check_whole(output, videos_in(drives))


@pytest.mark.skipif(not Path("/proc/self/cwd").exists(), reason="needs a path that means another file to each process")
def test_remote_workers_of_which_only_one_has_the_drives(drives, tmp_path):
    here, bare, output = drives, tmp_path / "bare", tmp_path / "out"
    bare.mkdir()
    address = f"tcp://127.0.0.1:{free_port()}"
    dask = [sys.executable, "-m", "dask"]
    commands = (ROOT / "docs" / "many_drives.md").read_text(encoding="utf-8")
    # without this the scheduler cannot read the tasks of its workers
    assert "PYTHONPATH=$PWD .venv/bin/dask scheduler" in commands
    with ExitStack() as stack:
        options = ["--host", address, "--dashboard-address", "127.0.0.1:0", "--no-show"]
        processes = [popen([*dask, "scheduler", *options], tmp_path)]
        for folder in (here, bare):
            worker = [
                *dask,
                "worker",
                address,
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--name",
                folder.name,
            ]
            processes.append(popen([*worker, "--local-directory", str(tmp_path)], folder))
        for process in processes:
            stack.enter_context(process)
            stack.callback(process.kill)
        with distributed.Client(address, timeout=180) as client:
            client.wait_for_workers(2, timeout=180)
        arguments = ["--camera", drives / "drive0.yaml", "/proc/self/cwd", "-o", output, "--scheduler", address]
        with start("annotate", *arguments, cwd=here) as process:
            out, err = process.communicate(timeout=300)
    assert process.returncode == 1 and out.startswith("2 workers; dashboard: http://127.0.0.1:")
    reasons = re.findall(
        r"error: /proc/self/cwd/(drive\d)\.mp4: there is no such video file; .* \(worker on \S+ in (.*); all workers ",
        err,
    )
    assert reasons and {folder for _, folder in reasons} == {str(bare)}
    failed = {name for name, _ in reasons}
    videos = [video for video in videos_in(drives) if video.stem not in failed]
    assert videos and f"{len(videos)} drives finished (0 of them before), {len(failed)} failed" in out
    check_whole(output, videos)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
