"""Long drives in pieces: each frame once, and the telemetry of the whole drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.scored_drive import PROJECT_ROOT
from lanes.annotate import DriveSettings, PreparedDrive, annotate_drive, prepare_drive
from lanes.camera import load_camera
from lanes.files import read_telemetry
from lanes.pieces import WARM_UP_S, annotate_piece, cut_drive, join_pieces
from lanes.track.tracker import LaneTracker
from lanes.video.reader import VideoInfo, inspect_video, read_frames
from tests.support.clips import write_drive
from tests.support.painted_drive import BENDS, SMALL

# As stated in the docstring of lanes.pieces.
TOLERANCES = {"offset_m": 0.01, "heading_rad": np.radians(0.1), "curvature_per_m": 1e-4}


@pytest.mark.parametrize("fps", [25.0, 30000 / 1001, 59.94, 7.5])
@pytest.mark.parametrize(("start_s", "end_s", "count"), [(0.0, None, 7), (12.34, 61.7, 5), (0.0, 14.9, 1)])
def test_each_frame_is_in_exactly_one_piece(tmp_path, fps, start_s, end_s, count):
    info = VideoInfo(640, 360, fps, round(70 * fps), 70.0, False)
    settings = DriveSettings(output=tmp_path, camera=SMALL, start_s=start_s, end_s=end_s)
    pieces = cut_drive(PreparedDrive(tmp_path / "drive.mp4", info, SMALL, None), settings, 10.0)
    assert [piece.number for piece in pieces] == list(range(count))
    assert (pieces[0].start_s, pieces[-1].end_s) == (start_s, end_s)
    times_s = np.arange(info.frames) / fps
    inside = [
        (times_s >= piece.start_s - 1e-3) & (times_s <= (np.inf if piece.end_s is None else piece.end_s) - 1e-3)
        for piece in pieces
    ]
    whole = (times_s >= start_s - 1e-3) & (times_s <= (np.inf if end_s is None else end_s) - 1e-3)
    np.testing.assert_array_equal(np.sum(inside, axis=0), whole)
    frames = [part.sum() for part in inside]
    assert max(frames) - min(frames) <= 2


def test_joined_pieces_equal_the_whole_drive(tmp_path):
    """All pieces warm up from the start of the drive, so that the numbers must be equal."""
    video = write_drive(tmp_path / "drive.mp4", BENDS, 45)
    whole = annotate_drive(video, DriveSettings(output=tmp_path / "whole", camera=SMALL, overlapped=False))
    settings = DriveSettings(output=tmp_path / "joined", camera=SMALL, overlapped=False)
    drive, folder = prepare_drive(video, settings), tmp_path / "pieces"
    pieces = cut_drive(drive, settings, 0.6)
    assert len(pieces) == 3
    elapsed_s = sum(annotate_piece(drive, piece, settings, folder) for piece in pieces)
    joined = join_pieces(drive, pieces, settings, folder, elapsed_s)
    assert replace(joined, video=whole.video, telemetry=whole.telemetry, report=whole.report) == replace(
        whole, camera=joined.camera, frames_per_s=joined.frames_per_s
    )
    tables = read_telemetry(whole.telemetry), read_telemetry(joined.telemetry)
    assert list(tables[0]) == list(tables[1])
    for name in set(tables[0]) - {"latency_ms"}:
        np.testing.assert_array_equal(tables[0][name], tables[1][name], err_msg=name)
    assert inspect_video(joined.video) == inspect_video(whole.video)
    for a, b in zip(read_frames(whole.video), read_frames(joined.video), strict=True):
        assert np.abs(a.astype(int) - b).mean() < 2
    assert "drive.mp4: lane report" in joined.report.read_text()


def test_finished_piece_is_not_repeated(tmp_path):
    video = write_drive(tmp_path / "drive.mp4", BENDS, 12)
    settings = DriveSettings(output=tmp_path, camera=SMALL)
    drive, folder = prepare_drive(video, settings), tmp_path / "pieces"
    first, second = cut_drive(drive, settings, 0.24)
    annotate_piece(drive, first, settings, folder)
    (folder / "0001.partial.0123456789ab.mp4").write_text("half")
    before = (folder / "0000.mp4").stat().st_mtime_ns
    assert annotate_piece(drive, first, settings, folder) > 0
    annotate_piece(drive, second, settings, folder)
    assert (folder / "0000.mp4").stat().st_mtime_ns == before
    assert {path.name for path in folder.iterdir()} == {"0000.mp4", "0000.csv", "0001.mp4", "0001.csv"}


def test_warm_up_is_necessary_and_sufficient():
    """Compared with the whole drive: a tracker after `WARM_UP_S` of warm-up, and one without warm-up."""
    video = PROJECT_ROOT / "test_videos" / "project_video.mp4"
    camera, fps = load_camera(video.with_suffix(".yaml")), inspect_video(video).fps
    serial, late, cold = (LaneTracker(camera, fps=fps) for _ in range(3))
    compared, worst = [], dict.fromkeys(TOLERANCES, 0.0)
    for number, image in enumerate(read_frames(video, end_s=1 + WARM_UP_S + 1.2)):
        expected = serial.update(image)
        if number < fps:
            continue
        found = late.update(image)
        if number < (1 + WARM_UP_S) * fps:
            continue
        compared.append((found.state, found.marking_types) == (expected.state, expected.marking_types))
        without = cold.update(image)
        for name, tolerance in TOLERANCES.items():
            true = getattr(expected.lane, name)
            assert abs(getattr(found.lane, name) - true) < tolerance, (number, name)
            worst[name] = max(worst[name], abs(getattr(without.lane, name) - true))
        assert abs(found.lane.offset_m - expected.lane.offset_m) < expected.lane.offset_std_m
        assert abs(found.lane.curvature_per_m - expected.lane.curvature_per_m) < expected.lane.curvature_std_per_m
    assert compared == [True] * 30
    assert any(worst[name] > tolerance for name, tolerance in TOLERANCES.items())
