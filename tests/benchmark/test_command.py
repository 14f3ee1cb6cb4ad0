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
from benchmark.speed import describe_machine
from benchmark.systems import SYSTEMS
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
    command = process(
        "benchmark", folder / "bend.mp4", "-o", folder / "out", "--workers", 2
    )
    # threads of several processes would wait for each other on a busy machine
    environment = {
        "LANES_CACHE": str(folder / "cache"),
        "PATH": "",
        "HOME": str(folder),
        "OMP_NUM_THREADS": "1",
    }
    return subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        env=environment,
    )


def custom(video: Path, difficulty: str = CUSTOM) -> BenchmarkDrive:
    return BenchmarkDrive(video.stem, difficulty, "", video)


@pytest.fixture(scope="module")
def prepared(folder) -> PreparedDrive:
    return prepare_drive(custom(folder / "bend.mp4"), estimated_pose=False)


def test_every_system_is_in_the_table_and_the_tracker_is_correct(done, folder):
    assert done.returncode == 0, done.stderr
    rows = read_scores(folder / "out" / "benchmark.csv")
    scenes = {row["system"]: row for row in rows if row["scene"] == "bend"}
    assert list(scenes) == list(SYSTEMS)
    assert len(rows) == 2 * len(scenes)  # with the totals
    tracker = scenes["tracker"]
    assert (tracker["frames"], tracker["available_share"], tracker["accuracy"]) == (
        FRAMES,
        1,
        1,
    )
    assert 0 < tracker["lateral_5_20m_p95_m"] < 0.1
    assert all(
        row["time_median_ms"] > 0.2 and row["workers"] == 2 for row in scenes.values()
    )
    assert {row["machine"] for row in rows} == {describe_machine()}
    assert read_image(folder / "out" / "reliability.png").std() > 5


def test_the_tables_fit_the_terminal_state_their_conditions_and_the_consistency(
    done, folder
):
    assert max(map(len, done.stdout.splitlines()[:-1])) <= 120
    conditions = (
        "camera pose: true",
        "measured with 2 workers",
        "recipes state no confidence",
        describe_machine(),
    )
    for words in (
        "bend (custom, 5 frames)",
        *conditions,
        "| all custom | detector | 5 |",
        "custom, detector",
    ):
        assert words in done.stdout
    rows = read_scores(folder / "out" / "consistency.csv", "nees_mean")
    expected = [
        (scene, system)
        for scene in ("bend", "all custom")
        for system in ("tracker", "detector")
    ]
    assert [(row["scene"], row["system"]) for row in rows] == expected
    assert all(row["frames"] == FRAMES and row["offset_z_rms"] > 0 for row in rows)


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


def test_the_scenes_are_listed_and_the_options_reach_the_run(monkeypatch, capsys):
    """The committed video is variant 0 of its scene; another one is rendered."""
    assert main(["benchmark", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(
        list_drives()
    )
    asked = []
    monkeypatch.setattr(
        evaluation,
        "run_benchmark",
        lambda *given, **options: asked.append((*given, options)) or 1 / 0,
    )
    words = [
        "motorway",
        "--seed",
        "3",
        "--estimated-pose",
        "--workers",
        "2",
        "--system",
        "tracker,detector",
    ]
    with pytest.raises(ZeroDivisionError):
        main(["benchmark", *words])
    (((variant,), systems_asked, options),) = asked
    assert (options["workers"], options["estimated_pose"]) == (2, True)
    assert systems_asked == ["tracker", "detector"]
    (drive,) = choose_drives(["motorway"])
    assert (drive.video.name, drive.label) == ("project_video.mp4", "motorway")
    assert (variant.video, variant.label, variant.difficulty) == (
        None,
        "motorway-3",
        drive.difficulty,
    )
    monkeypatch.setattr(
        "simulator.scenes.suite.render_scene",
        lambda name, *, seed, **_: Path(f"{name}, seed {seed}"),
    )
    assert variant.require_video() == Path("motorway, seed 3")


class TestEvaluation:
    def test_finished_estimates_are_not_computed_again(
        self, prepared, tmp_path, monkeypatch
    ):
        path = cached_estimates((prepared, "tracker"), folder=tmp_path, workers=1)
        monkeypatch.setattr(
            evaluation, "run_systems", lambda *_: pytest.fail("computed again")
        )
        assert (
            cached_estimates((prepared, "tracker"), folder=tmp_path, workers=1) == path
        )
        pose = replace(prepared.camera.pose, pitch_rad=0.0)
        other = replace(prepared, camera=prepared.camera.with_pose(pose))
        for task in [
            (other, "tracker"),
            (prepared, "best_channel"),
            (replace(prepared, markings=len), "tracker"),
        ]:
            with pytest.raises(pytest.fail.Exception, match="computed again"):
                cached_estimates(task, folder=tmp_path, workers=1)

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
        monkeypatch.setattr(
            evaluation, "run_systems", lambda *_: [DriveEstimates.from_frames([], [])]
        )
        cached_estimates((prepared, system), folder=tmp_path, workers=1)
        common = (estimates, evaluation, systems, images, reader, model)
        assert {Path(module.__file__) for module in (*common, source)} <= seen

    def test_a_drive_without_lines_has_an_estimated_pose_and_no_lane(self, tmp_path):
        video = write_drive(tmp_path / "blank.mp4", replace(BENDS, lines=()), 2)
        assert (
            prepare_drive(custom(video), estimated_pose=True).camera.pose != SMALL.pose
        )
        (result,) = run_benchmark(
            [custom(video)], ["tracker"], estimated_pose=True, folder=tmp_path
        )
        assert result.pose == "estimated"
        assert not result.errors.available.any()

    def test_a_system_is_told_the_time_since_its_last_frame(
        self, tmp_path, monkeypatch
    ):
        with VideoWriter(tmp_path / "a.mp4", fps=25) as video:
            for time_s in (0.0, 0.04, 0.2, 0.24):
                video.write(BENDS.frame(time_s), time_s)
        told: list[float | None] = []
        started = (lambda _, elapsed_s=None: told.append(elapsed_s)), (lambda _: {})
        monkeypatch.setattr(
            evaluation,
            "start_system",
            lambda *given, **_: told.append(given[2]) or started,
        )
        run_systems(
            PreparedDrive(custom(tmp_path / "a.mp4"), SMALL, "true"),
            [("tracker", 1), ("tracker", 2)],
        )
        assert told[0] == 2 * told[1]
        assert told[2:] == pytest.approx([None, None, 0.04, 0.16, 0.2, 0.04])

    def test_video_and_truth_must_belong_together(self, folder, tmp_path):
        assert read_truth(custom(folder / "bend.mp4")).exists.all()
        assert not read_truth(custom(folder / "bend.mp4", "no lane")).exists.any()
        for suffix in (".mp4", ".csv", ".yaml"):
            (tmp_path / f"bend{suffix}").write_bytes(
                (folder / f"bend{suffix}").read_bytes()
            )
        rows = (tmp_path / "bend.csv").read_text().splitlines()
        (tmp_path / "bend.csv").write_text("\n".join(rows[:-1]) + "\n")
        drive = custom(tmp_path / "bend.mp4")
        with pytest.raises(
            ValueError,
            match="bend.mp4: 5 frames of estimates cannot .* 4 frames of truth",
        ):
            run_benchmark([drive], ["tracker"], folder=tmp_path)
        (tmp_path / "bend.csv").write_text("frame\n0\n")
        with pytest.raises(ValueError, match="bend.csv: lacks the column 'left_y05_m'"):
            read_truth(drive)
        (tmp_path / "bend.csv").unlink()
        with pytest.raises(
            FileNotFoundError, match="bend.csv: there is no such truth file"
        ):
            choose_drives([str(tmp_path / "bend.mp4")])
