"""`python -m benchmark` as a process, its runner, its tables and its figures."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from benchmark import runner
from benchmark.evaluation import Staged, follow_drive, score_video, true_lane
from benchmark.machine import describe_machine
from benchmark.reporting.tables import read_scores
from benchmark.runner import measure, stage
from benchmark.scored_drive import BenchmarkDrive
from benchmark.suite_drives import choose_drives, list_drives
from benchmark.systems import SYSTEMS
from lanes.io.images import read_image
from simulator.rendering.drive import Motion
from tests.support.clips import write_drive
from tests.support.command_line import process
from tests.support.painted_drive import CAMERA, PaintedDrive, lane_lines, s_bend

ROOT = Path(__file__).parents[2]
SMALL = CAMERA.scaled((640, 360))
DRIVE = PaintedDrive(s_bend(), lane_lines(), motion=Motion(60.0, 25.0, offset_m=0.3, wander_m=0.2), camera=SMALL)
FRAMES = 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("drives")
    write_drive(folder / "bend.mp4", DRIVE, FRAMES)
    return folder


@pytest.fixture(scope="module")
def done(folder) -> subprocess.CompletedProcess:
    return run(folder, folder / "bend.mp4", "-o", folder / "out", "--workers", 2)


def run(folder: Path, *arguments: object) -> subprocess.CompletedProcess:
    command = process("benchmark", *arguments)
    environment = {"LANES_CACHE": str(folder / "cache"), "PATH": "", "HOME": str(folder)}
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, env=environment)


def own(video: Path, difficulty: str = "own") -> BenchmarkDrive:
    return BenchmarkDrive(video.stem, difficulty, "", video)


class TestCommand:
    def test_every_system_is_in_the_table_and_the_best_is_the_engine(self, done, folder):
        assert done.returncode == 0, done.stderr
        rows = read_scores(folder / "out" / "benchmark.csv")
        scenes = [row for row in rows if row["scene"] == "bend"]
        assert [row["system"] for row in scenes] == list(SYSTEMS)
        assert len(rows) == 2 * len(scenes)  # with the totals
        metric = scenes[-1]
        assert (metric["frames"], metric["available_share"], metric["right_share"]) == (FRAMES, 1, 1)
        assert 0 < metric["lateral_5_20m_p95_m"] < 0.1
        assert all(row["time_median_ms"] > 0 and row["workers"] == 2 for row in scenes)
        assert {row["machine"] for row in rows} == {describe_machine()}

    def test_the_table_fits_on_the_terminal_and_says_under_which_conditions(self, done):
        assert max(map(len, done.stdout.splitlines()[:-1])) <= 120
        assert "bend (own, 5 frames)" in done.stdout
        for words in ("pose was: true", "measured with 2 workers", "recipes state no confidence", describe_machine()):
            assert words in done.stdout

    def test_one_video_scored_in_python_is_its_row(self, done, folder):
        table = {row["system"]: row for row in read_scores(folder / "out" / "benchmark.csv") if row["scene"] == "bend"}
        for system in ("hls_sobel", "tracker"):
            here = score_video(folder / "bend.mp4", system)
            for name in ("frames", "right_share", "lateral_5_20m_p95_m", "offset_p95_m"):
                assert here[name] == pytest.approx(table[system][name], nan_ok=True, abs=1e-6)
        assert score_video(folder / "bend.mp4", "tracker", end_s=0.1)["frames"] == 3

    def test_figures_are_pictures(self, done, folder):
        for name in ("benchmark.png", "reliability.png"):
            assert read_image(folder / "out" / name).std() > 5

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (["no-such-scene"], "there is no scene 'no-such-scene'"),
            (["no-such-video.mp4"], "no-such-video.mp4: there is no such video"),
            (["--system", "tracker,yolo", "motorway"], "there is no system 'yolo'"),
            (["--system", "tracker", "--system", "hough", "motorway"], "there is no system 'hough'"),
        ],
    )
    def test_misuse_is_told(self, folder, arguments, words):
        told = run(folder, *arguments)
        assert told.returncode == 2
        assert words in told.stderr
        assert "Traceback" not in told.stderr

    def test_the_scenes_are_listed(self, folder):
        listed = run(folder, "--list")
        assert listed.returncode == 0
        assert [line.split()[0] for line in listed.stdout.splitlines()] == list(list_drives())


class TestRunner:
    def test_what_is_finished_is_not_done_again(self, folder, tmp_path, monkeypatch):
        staged = stage(own(folder / "bend.mp4"), estimated_pose=False)
        path = measure(staged, "tracker", tmp_path, 1)
        monkeypatch.setattr(runner, "follow_drive", lambda *_: pytest.fail("it was done again"))
        assert measure(staged, "tracker", tmp_path, 1) == path
        other = Staged(staged.drive, staged.camera.with_pose(replace(staged.camera.pose, pitch_rad=0.0)), "true")
        for task in [(other, "tracker"), (staged, "best_channel")]:
            with pytest.raises(pytest.fail.Exception, match="done again"):
                measure(*task, tmp_path, 1)

    def test_an_interrupted_one_leaves_nothing(self, folder, tmp_path, monkeypatch):
        def interrupted(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(runner, "follow_drive", interrupted)
        with pytest.raises(KeyboardInterrupt):
            measure(stage(own(folder / "bend.mp4"), estimated_pose=False), "tracker", tmp_path, 1)
        assert not list(tmp_path.iterdir())

    def test_another_engine_is_another_result(self, folder, tmp_path, monkeypatch):
        staged = stage(own(folder / "bend.mp4"), estimated_pose=False)
        first = runner._key(staged, "tracker")
        monkeypatch.setitem(runner.SOURCES, "tracker", (Path(__file__),))
        assert runner._key(staged, "tracker") != first

    def test_the_estimated_pose_is_another_one(self, folder):
        staged = stage(own(folder / "bend.mp4"), estimated_pose=True)
        assert staged.pose == "estimated"
        assert staged.camera.pose != SMALL.pose
        assert staged.camera.pose.pitch_rad == pytest.approx(SMALL.pose.pitch_rad, abs=0.01)

    def test_without_a_pose_no_lane_is_given(self, folder, tmp_path):
        blank = replace(DRIVE, lines=())
        video = write_drive(tmp_path / "blank.mp4", blank, 2)
        staged = stage(own(video), estimated_pose=True)
        assert (staged.camera, staged.pose) == (None, "not found")
        assert not follow_drive(staged, "tracker").given.any()

    def test_no_lane_scenes_have_no_true_lane(self, folder):
        assert true_lane(own(folder / "bend.mp4")).exists.all()
        assert not true_lane(own(folder / "bend.mp4", "no lane")).exists.any()

    def test_video_and_truth_must_belong_together(self, folder, tmp_path):
        for suffix in (".mp4", ".csv", ".yaml"):
            (tmp_path / f"bend{suffix}").write_bytes((folder / f"bend{suffix}").read_bytes())
        rows = (tmp_path / "bend.csv").read_text().splitlines()
        (tmp_path / "bend.csv").write_text("\n".join(rows[:-1]) + "\n")
        drive = own(tmp_path / "bend.mp4")
        staged = stage(drive, estimated_pose=False)
        with pytest.raises(ValueError, match="bend.mp4: a system's 5 frames cannot be held against a truth of 4"):
            runner._result(staged, "tracker", measure(staged, "tracker", tmp_path, 1))
        (tmp_path / "bend.csv").write_text("frame\n0\n")
        with pytest.raises(ValueError, match="bend.csv: lacks the column 'left_y05_m'"):
            true_lane(drive)

    def test_truth_and_camera_must_be_beside_the_video(self, folder, tmp_path):
        (tmp_path / "bend.mp4").write_bytes((folder / "bend.mp4").read_bytes())
        with pytest.raises(FileNotFoundError, match="bend.csv: there is no such truth"):
            choose_drives([str(tmp_path / "bend.mp4")])
