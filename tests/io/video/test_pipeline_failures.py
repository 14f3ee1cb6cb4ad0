"""process_video that fails or is stopped: an earlier output is unchanged and nothing else remains."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import threading
from contextlib import nullcontext
from pathlib import Path

import av
import numpy as np
import pytest

from lanes.camera import Camera, undistort
from lanes.errors import PictureError, VideoError
from lanes.files import read_telemetry
from lanes.video import process as annotate
from lanes.video.process import process_video
from lanes.video.reader import read_timed_frames, read_video
from lanes.video.writer import VideoWriter
from tests.io.video.sample_videos import (
    number_of,
    unchanged,
)
from tests.support.project import ROOT


class TestFailure:
    @pytest.fixture
    def target(self, tmp_path) -> Path:
        """An earlier result, which a failed run must leave as it was."""
        path = tmp_path / "out" / "drive.mp4"
        path.parent.mkdir()
        path.write_bytes(b"earlier")
        return path

    @staticmethod
    def assert_untouched(target: Path) -> None:
        assert [p.name for p in target.parent.iterdir()] == ["drive.mp4"]
        assert target.read_bytes() == b"earlier"

    @pytest.mark.parametrize("error", [ZeroDivisionError("radius"), KeyboardInterrupt(), SystemExit(1)])
    def test_exception_in_process(self, video, target, error):
        calls = []

        def process(frame):
            calls.append(frame)
            if len(calls) == 20:
                raise error
            return frame

        with pytest.raises(type(error)) as caught:
            process_video(video, target, process, progress=False)
        self.assert_untouched(target)
        if isinstance(error, ZeroDivisionError):
            assert f"frame 19 of {video}" in caught.value.__notes__[0]

    def test_a_refused_frame_is_named(self, video, target):
        camera = Camera.from_fov((640, 360), 60)
        with pytest.raises(PictureError, match=r"^frame 5 of .*drive\.mp4: is 160x96 .* that of pictures of 640x360"):
            process_video(video, target, lambda frame: undistort(frame, camera), progress=False, start_s=0.2)
        self.assert_untouched(target)

    @pytest.mark.parametrize("result", [None, np.zeros((96, 160), np.uint8), np.zeros((96, 160, 3))])
    def test_process_that_does_not_return_a_picture(self, video, target, result):
        with pytest.raises(VideoError, match="frame 0 of .*the function returned"):
            process_video(video, target, lambda frame: result, progress=False)
        self.assert_untouched(target)

    def test_process_that_changes_its_size(self, video, target):
        sizes = iter(range(100, 10, -1))
        with pytest.raises(VideoError, match="frame 1 is .*99 pixels, the first one was 160x100"):
            process_video(video, target, lambda f: np.zeros((next(sizes), 160, 3), np.uint8), progress=False)
        self.assert_untouched(target)

    @pytest.mark.parametrize(
        ("number", "status"), [(signal.SIGTERM, 128 + signal.SIGTERM), (signal.SIGINT, -signal.SIGINT)]
    )
    def test_stopped_from_outside(self, video, target, number, status):
        """A real process gets a real signal in the middle of its work."""
        code = (
            "import sys, time\n"
            "from lanes.video.process import process_video\n"
            "def slow(frame):\n"
            "    print('frame', flush=True)\n"
            "    time.sleep(0.05)\n"
            "    return frame\n"
            "process_video(sys.argv[1], sys.argv[2], slow)\n"
        )
        root = ROOT
        command = [sys.executable, "-c", code, str(video), str(target)]
        with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
            for _ in range(5):
                assert run.stdout.readline() == "frame\n"
            assert len(list(target.parent.iterdir())) == 2
            run.send_signal(number)
            assert run.wait(timeout=10) == status
            assert ("Traceback" in run.stderr.read()) == (number == signal.SIGINT)
        self.assert_untouched(target)

    def test_no_handler_is_left(self, video, tmp_path):
        before = signal.getsignal(signal.SIGTERM)
        process_video(video, tmp_path / "out.mp4", unchanged, progress=False, end_s=0.2)
        assert signal.getsignal(signal.SIGTERM) == before

    def test_damaged_middle(self, video, target, tmp_path):
        data = bytearray(video.read_bytes())
        start = data.index(b"mdat")
        middle = start + (len(data) - start) // 4
        data[middle : middle + 600] = b"\xff" * 600
        broken = tmp_path / "broken.mp4"
        broken.write_bytes(data)
        rows = tmp_path / "rows.csv"
        summary = process_video(broken, target, unchanged, progress=False, telemetry=rows)
        assert 1 <= summary.missing == 50 - summary.frames <= 25
        # The other frames keep their numbers and times. Frames predicted from a damaged one may show an older picture,
        # until the next key frame (every twelfth here).
        table = read_telemetry(rows)
        np.testing.assert_allclose(table["time_s"], table["frame"] / 25, atol=1e-3)
        shown = np.array([number_of(frame) for frame in read_video(target)])
        lost = sorted({*range(50)} - {*table["frame"]})
        sound = (table["frame"] < lost[0]) | (table["frame"] > lost[-1] + 12)
        assert sound.sum() >= 10 and (shown <= table["frame"]).all()
        np.testing.assert_array_equal(shown[sound], table["frame"][sound])

    def test_error_while_reading(self, video, target, monkeypatch):
        """The frames before the error are processed, those after it are not, and the error is passed on unchanged."""
        monkeypatch.setattr(annotate, "read_timed_frames", lambda *_, **__: broken_frames(video, 20))
        seen = []
        with pytest.raises(VideoError, match="frame 20 is damaged"):
            process_video(video, target, lambda frame: seen.append(number_of(frame)) or frame, progress=False)
        assert seen == list(range(20))
        self.assert_untouched(target)

    def test_error_while_writing(self, video, target, monkeypatch):
        """The run stops after a few more frames."""
        monkeypatch.setattr(VideoWriter, "encode", broken_encode)
        seen = []
        with pytest.raises(OSError, match=r"drive\.mp4: cannot be written \(No space left"):
            process_video(video, target, lambda frame: seen.append(0) or frame, progress=False)
        assert 10 <= len(seen) <= 15
        self.assert_untouched(target)

    def test_error_while_writing_the_last_frames(self, video, target, monkeypatch):
        monkeypatch.setattr(VideoWriter, "encode", broken_encode)
        with pytest.raises(OSError, match="No space left"):
            process_video(video, target, unchanged, progress=False, end_s=0.4)
        self.assert_untouched(target)

    @pytest.mark.parametrize("fails", [True, False])
    def test_no_thread_is_left(self, video, tmp_path, fails):
        before = threading.active_count()
        with pytest.raises(ZeroDivisionError) if fails else nullcontext():
            process_video(video, tmp_path / "out.mp4", (lambda frame: 1 / 0) if fails else unchanged, progress=False)
        assert threading.active_count() == before

    def test_other_suffix(self, video, tmp_path):
        with pytest.raises(VideoError, match=r"out\.avi: .*\.mp4"):
            process_video(video, tmp_path / "out.avi", unchanged, progress=False)

    def test_onto_itself(self, video):
        before = video.read_bytes()
        with pytest.raises(VideoError, match="is the source itself"):
            process_video(video, video, unchanged, progress=False)
        assert video.read_bytes() == before

    @pytest.mark.parametrize("name", ["file/out.mp4", "long" * 62 + "out.mp4"])
    def test_unwritable_target_is_reported_before_processing(self, video, tmp_path, name):
        (tmp_path / "file").write_text("not a folder")
        calls = []
        with pytest.raises(OSError, match=r"out\.mp4: cannot be written"):
            process_video(video, tmp_path / name, calls.append, progress=False)
        assert not calls
        assert [path.name for path in tmp_path.iterdir()] == ["file"]

    def test_unwritable_telemetry_is_reported_before_processing(self, video, target, tmp_path):
        (tmp_path / "file").write_text("not a folder")
        calls = []
        with pytest.raises(OSError, match=r"rows\.csv: cannot be written"):
            process_video(video, target, calls.append, progress=False, telemetry=tmp_path / "file" / "rows.csv")
        assert not calls
        self.assert_untouched(target)

    def test_missing_source_makes_no_folder(self, tmp_path):
        with pytest.raises(FileNotFoundError, match="nowhere.mp4"):
            process_video(tmp_path / "nowhere.mp4", tmp_path / "new" / "out.mp4", unchanged, progress=False)
        assert not (tmp_path / "new").exists()


def broken_frames(video: Path, number: int):
    yield from itertools.islice(read_timed_frames(video), number)
    raise VideoError(f"{video}: frame {number} is damaged")


def broken_encode(writer: VideoWriter, frame: av.VideoFrame) -> None:
    """A disk that is full from the tenth frame on."""
    if frame.time >= 9 / 25:
        raise OSError(f"{writer.path}: cannot be written (No space left on device)")
