"""`python -m benchmark` as a process, and the evaluation of drives."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import helpers
from benchmark import estimates, evaluation, systems
from benchmark.estimates import DriveEstimates
from benchmark.evaluation import (
    CUSTOM,
    NO_LANE,
    BenchmarkDrive,
    PreparedDrive,
    cached_estimates,
    choose_drives,
    list_drives,
    prepare_drive,
    read_truth,
    run_benchmark,
    run_systems,
)
from benchmark.scores import Result, Row
from benchmark.speed import describe_machine
from benchmark.systems import DETECTOR, SYSTEMS, TRACKER
from benchmark.tables import read_scores
from lanes.camera import model
from lanes.detect import birdseye
from lanes.video import images, reader
from lanes.video.images import read_image
from lanes.video.writer import VideoWriter
from tests.support.clips import write_drive
from tests.support.command_line import WAIT_S, main, process
from tests.support.painted_drive import BENDS, SMALL
from tests.support.project import ROOT

FRAMES = 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("drives")
    write_drive(folder / "bend.mp4", BENDS, FRAMES)
    return folder


@pytest.fixture(scope="module")
def done(folder) -> subprocess.CompletedProcess:
    """The command with two processes, its output below `folder`/out."""
    words = [folder / "bend.mp4", "-o", folder / "out", "--workers", 2]
    environment = {
        "LANES_CACHE": str(folder / "cache"),
        "PATH": "",
        "HOME": str(folder),
        # threads of several processes would wait for each other on a busy machine
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        process("benchmark", *words),
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def rows(done, folder) -> list[Row]:
    return read_scores(folder / "out" / "benchmark.csv")


def test_every_system_has_a_row_and_a_total(rows):
    assert [row["scene"] for row in rows] == ["bend"] * 8 + ["all custom"] * 8
    assert [row["system"] for row in rows] == [*SYSTEMS, *SYSTEMS]


@pytest.mark.parametrize(
    ("column", "value"),
    [("frames", FRAMES), ("available_share", 1), ("accuracy", 1)],
)
def test_the_tracker_is_correct_in_every_frame(rows, column, value):
    assert rows[SYSTEMS.index(TRACKER)][column] == value


def test_the_tracker_has_a_small_error(rows):
    assert 0 < rows[SYSTEMS.index(TRACKER)]["lateral_5_20m_p95_m"] < 0.1


def test_the_rows_have_the_conditions_of_their_times(rows):
    assert {row["workers"] for row in rows} == {2}
    assert {row["machine"] for row in rows} == {describe_machine()}
    assert min(row["time_median_ms"] for row in rows) > 0.2


def test_the_tables_fit_the_terminal(done):
    *tables, _ = done.stdout.splitlines()
    assert max(map(len, tables)) <= 120


@pytest.mark.parametrize(
    "words",
    [
        "bend (custom, 5 frames)",
        "camera pose: true",
        "measured with 2 workers",
        "recipes state no confidence",
        describe_machine(),
        "| all custom | detector | 5 |",
        "custom, detector",
    ],
)
def test_the_tables_state_their_conditions(done, words):
    assert words in done.stdout


def test_the_consistency_is_that_of_tracker_and_detector(done, folder):
    rows = read_scores(folder / "out" / "consistency.csv", "nees_mean")
    assert [(row["scene"], row["system"]) for row in rows] == [
        ("bend", TRACKER),
        ("bend", DETECTOR),
        ("all custom", TRACKER),
        ("all custom", DETECTOR),
    ]
    assert {row["frames"] for row in rows} == {FRAMES}
    assert min(row["offset_z_rms"] for row in rows) > 0


def test_the_reliability_is_drawn(done, folder):
    assert read_image(folder / "out" / "reliability.png").std() > 5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no-such-scene"], "there is no scene 'no-such-scene'"),
        (["no-such-video.mp4"], "no-such-video.mp4: there is no such video file"),
        (
            ["--system", "tracker", "--system", "tracker,yolo", "motorway"],
            "there is no system 'yolo'",
        ),
        (["--seed", "-1"], "invalid value -1: expected an integer >= 0"),
    ],
)
def test_wrong_usage_is_reported(arguments, words, capsys):
    with pytest.raises(SystemExit, match="2"):
        sys.exit(main(["benchmark", *arguments]))
    assert words in capsys.readouterr().err


def test_the_scenes_are_listed(capsys):
    assert main(["benchmark", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(list_drives())


@pytest.mark.parametrize("flags", [["--estimated-pose"], []])
def test_the_options_reach_the_run(folder, tmp_path, capsys, monkeypatch, flags):
    monkeypatch.setenv("LANES_CACHE", str(tmp_path))
    words = [str(folder / "bend.mp4"), "--system", "tracker,detector", *flags]
    assert main(["benchmark", *words, "-o", str(tmp_path / "out")]) == 0
    rows = read_scores(tmp_path / "out" / "benchmark.csv")
    assert [row["system"] for row in rows] == [TRACKER, DETECTOR] * 2
    assert {row["pose"] for row in rows} == {"estimated" if flags else "true"}


def test_a_scene_with_a_committed_video_is_its_variant_0():
    (drive,) = choose_drives(["motorway"])
    assert drive.require_video().name == "project_video.mp4"
    assert drive.label == "motorway"


class EndOfTestError(Exception):
    """What is asked for is known, and need not be done."""


def test_the_seed_chooses_the_variant_that_is_run(monkeypatch):
    asked = []

    def run_benchmark(drives: list[BenchmarkDrive], *_, **options: object) -> None:
        asked.extend(drives)
        raise EndOfTestError

    monkeypatch.setattr(evaluation, "run_benchmark", run_benchmark)
    with pytest.raises(EndOfTestError):
        main(["benchmark", "motorway", "--seed", "3"])
    assert [drive.label for drive in asked] == ["motorway-3"]


def test_another_variant_of_a_scene_is_rendered(monkeypatch):
    asked = []

    def render_scene(name: str, *, seed: int, workers: int) -> Path:
        asked.append((name, seed))
        return Path("rendered.mp4")

    monkeypatch.setattr("simulator.scenes.suite.render_scene", render_scene)
    (drive,) = choose_drives(["motorway"])
    (variant,) = choose_drives(["motorway"], seed=3)
    assert variant.require_video() == Path("rendered.mp4")
    assert asked == [("motorway", 3)]
    assert variant.label == "motorway-3"
    assert variant.difficulty == drive.difficulty


def custom(video: Path, difficulty: str = CUSTOM) -> BenchmarkDrive:
    return BenchmarkDrive(video.stem, difficulty, "", video)


@pytest.fixture(scope="module")
def prepared(folder) -> PreparedDrive:
    return prepare_drive(custom(folder / "bend.mp4"), estimated_pose=False)


class TestCache:
    @pytest.fixture(autouse=True)
    def computed(self, monkeypatch) -> list[PreparedDrive]:
        """The drives whose estimates are computed."""
        computed = []

        def run(prepared: PreparedDrive, *_) -> list[DriveEstimates]:
            computed.append(prepared)
            return [DriveEstimates.from_frames([], [])]

        monkeypatch.setattr(evaluation, "run_systems", run)
        return computed

    def test_finished_estimates_are_not_computed_again(
        self, prepared, tmp_path, computed
    ):
        paths = {
            cached_estimates((prepared, TRACKER), folder=tmp_path, workers=1)
            for _ in range(2)
        }
        assert len(paths) == 1
        assert computed == [prepared]

    @pytest.mark.parametrize("change", ["pose", "system", "markings"])
    def test_other_conditions_are_computed(self, prepared, tmp_path, computed, change):
        drive, system = prepared, TRACKER
        if change == "pose":
            level = replace(prepared.camera.pose, pitch_rad=0.0)
            drive = replace(prepared, camera=prepared.camera.with_pose(level))
        elif change == "markings":
            drive = replace(prepared, markings=len)
        else:
            system = "best_channel"
        cached_estimates((prepared, TRACKER), folder=tmp_path, workers=1)
        cached_estimates((drive, system), folder=tmp_path, workers=1)
        assert len(computed) == 2

    @pytest.mark.parametrize(
        ("system", "source"),
        [
            ("tracker", birdseye),
            ("hls_sobel", helpers),
            (f"{systems.__file__}:load_finder", model),
        ],
        ids=["tracker", "recipe", "own finder"],
    )
    def test_finished_estimates_depend_on_all_sources(
        self, prepared, monkeypatch, tmp_path, system, source
    ):
        read_bytes = Path.read_bytes
        seen = set()
        monkeypatch.setattr(
            Path, "read_bytes", lambda path: seen.add(path) or read_bytes(path)
        )
        cached_estimates((prepared, system), folder=tmp_path, workers=1)
        modules = (estimates, evaluation, systems, images, reader, model, source)
        assert {Path(module.__file__) for module in modules} <= seen


class TestBlankDrive:
    """A drive without lines, with its estimated pose."""

    @pytest.fixture
    def drive(self, tmp_path) -> BenchmarkDrive:
        blank = replace(BENDS, lines=())
        return custom(write_drive(tmp_path / "blank.mp4", blank, 2))

    def test_its_pose_is_estimated(self, drive):
        assert prepare_drive(drive, estimated_pose=True).camera.pose != SMALL.pose

    def test_it_has_no_lane(self, drive, tmp_path):
        [result] = run_benchmark(
            [drive], [TRACKER], estimated_pose=True, folder=tmp_path
        )
        assert result.pose == "estimated"
        assert not result.errors.available.any()


class TestElapsedTime:
    """Of a drive whose frames are at 0, 0.04, 0.2 and 0.24 s."""

    @pytest.fixture
    def told(self, tmp_path, monkeypatch) -> dict[float, list[float | None]]:
        """By the frame rate of a system, the times that it is told."""
        with VideoWriter(tmp_path / "a.mp4", fps=25) as video:
            for time_s in (0.0, 0.04, 0.2, 0.24):
                video.write(BENDS.frame(time_s), time_s)
        told: dict[float, list[float | None]] = {}

        def start(system: object, camera: object, fps: float, **_: object) -> tuple:
            told[fps] = []
            return (lambda _, elapsed_s: told[fps].append(elapsed_s)), (lambda _: {})

        monkeypatch.setattr(evaluation, "start_system", start)
        drive = PreparedDrive(custom(tmp_path / "a.mp4"), SMALL, "true")
        run_systems(drive, [(TRACKER, 1), (TRACKER, 2)])
        return told

    def test_a_system_for_every_second_frame_has_half_the_rate(self, told):
        every, every_second = told
        assert every == 2 * every_second

    def test_a_system_is_told_the_time_since_its_last_frame(self, told):
        every, every_second = told.values()
        assert every == pytest.approx([None, 0.04, 0.16, 0.04])
        assert every_second == pytest.approx([None, 0.2])


@pytest.mark.parametrize(("difficulty", "exists"), [(CUSTOM, True), (NO_LANE, False)])
def test_a_scene_without_a_lane_has_no_true_lane(folder, difficulty, exists):
    truth = read_truth(custom(folder / "bend.mp4", difficulty))
    assert set(truth.exists) == {exists}


class TestFilesOfADrive:
    """Video and truth must belong together."""

    @pytest.fixture
    def video(self, folder, tmp_path) -> Path:
        for suffix in (".mp4", ".csv", ".yaml"):
            data = (folder / f"bend{suffix}").read_bytes()
            (tmp_path / f"bend{suffix}").write_bytes(data)
        return tmp_path / "bend.mp4"

    def run(self, video: Path) -> list[Result]:
        return run_benchmark([custom(video)], [TRACKER], folder=video.parent)

    def test_a_missing_row_is_an_error(self, video):
        truth = video.with_suffix(".csv")
        *rows, _ = truth.read_text().splitlines()
        truth.write_text("\n".join(rows) + "\n")
        message = "bend.mp4: 5 frames of estimates cannot .* 4 frames of truth"
        with pytest.raises(ValueError, match=message):
            self.run(video)

    def test_a_missing_column_is_an_error(self, video):
        video.with_suffix(".csv").write_text("frame\n0\n")
        message = "bend.csv: lacks the column 'left_y05_m'"
        with pytest.raises(ValueError, match=message):
            read_truth(custom(video))

    def test_a_missing_truth_is_an_error(self, video):
        video.with_suffix(".csv").unlink()
        message = "bend.csv: there is no such truth file"
        with pytest.raises(FileNotFoundError, match=message):
            choose_drives([str(video)])
