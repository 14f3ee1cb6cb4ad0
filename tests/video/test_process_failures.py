"""process_video that fails or is stopped: an earlier output is unchanged and nothing else remains."""

from __future__ import annotations

import re
import threading
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from lanes.errors import LaneError, PictureError, VideoError
from lanes.video.writer import VideoWriter, process_video
from tests.video.sample_videos import numbered, unchanged


@pytest.fixture
def earlier(tmp_path):
    """The name of an output that is there already, and must stay as it is."""
    path = tmp_path / "out" / "drive.mp4"
    path.parent.mkdir()
    path.write_bytes(b"earlier")
    yield path
    assert [p.name for p in path.parent.iterdir()] == ["drive.mp4"]
    assert path.read_bytes() == b"earlier"


@pytest.mark.parametrize("error", [ZeroDivisionError("radius"), KeyboardInterrupt(), PictureError("is too dark")])
def test_exception_in_the_function(video, earlier, error):
    """It names the frame, with a number of the file, also in a part."""
    calls = []

    def function(image):
        calls.append(image)
        if len(calls) == 15:
            raise error
        return image

    with pytest.raises(type(error)) as caught:
        process_video(video, earlier, function, progress=False, start_s=0.2)
    if isinstance(error, ZeroDivisionError):
        assert f"frame 19 of {video}" in caught.value.__notes__[0]
    if isinstance(error, PictureError):
        assert str(caught.value) == f"frame 19 of {video}: is too dark"


@pytest.mark.parametrize(
    ("results", "sentence"),
    [
        ([None], "frame 0 of .*the function returned NoneType"),
        ([np.zeros((96, 160), np.uint8)], r"frame 0 of .*the function returned uint8 of shape \(96, 160\)"),
        ([np.zeros((96, 160, 3))], "frame 0 of .*the function returned float64"),
        ([np.zeros((n, 160, 3), np.uint8) for n in (100, 99)], "frame 1 is .*99 pixels, the first one was 160x100"),
    ],
    ids=["none", "gray", "float", "other size"],
)
def test_functions_that_return_no_image_of_one_size(video, tmp_path, results, sentence):
    returned = iter(results)
    with pytest.raises(VideoError, match=sentence):
        process_video(video, tmp_path / "a.mp4", lambda image: next(returned), progress=False)


def test_error_while_writing(video, earlier, monkeypatch):
    """A disk that is full from the tenth frame on; the run stops after a few more frames."""

    def broken_encode(writer: VideoWriter, frame: av.VideoFrame) -> None:
        if frame.time >= 9 / 25:
            raise OSError(f"{writer.path}: cannot be written (No space left on device)")

    monkeypatch.setattr(VideoWriter, "encode", broken_encode)
    seen = []
    with pytest.raises(OSError, match=r"drive\.mp4: cannot be written \(No space left"):
        process_video(video, earlier, lambda image: seen.append(0) or image, progress=False)
    assert 10 <= len(seen) <= 15


def test_unusable_names(video, tmp_path):
    with pytest.raises(VideoError, match=r"out\.avi: .*\.mp4"):
        process_video(video, tmp_path / "out.avi", unchanged, progress=False)
    with pytest.raises(FileNotFoundError, match="nowhere.mp4"):
        process_video(tmp_path / "nowhere.mp4", tmp_path / "new" / "out.mp4", unchanged, progress=False)
    assert list(tmp_path.iterdir()) == []
    before = video.read_bytes()
    with pytest.raises(VideoError, match="is the source itself"):
        process_video(video, video, unchanged, progress=False)
    assert video.read_bytes() == before


@pytest.mark.parametrize("name", ["file/out.mp4", "long" * 62 + "longout.mp4"])
def test_unwritable_outputs_are_reported_before_processing(video, tmp_path, name):
    """A name may be as long as the file system allows."""
    longest = "\u00e4" * 117 + "x" * 17
    process_video(video, tmp_path / f"{longest}.mp4", unchanged, progress=False, start_s=1.9)
    (tmp_path / f"{longest}.mp4").unlink()
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OSError, match=r"out\.mp4: cannot be written"):
        process_video(video, tmp_path / name, pytest.fail, progress=False)
    with pytest.raises(OSError, match=r"rows\.csv: cannot be written"):
        process_video(video, tmp_path / "a.mp4", pytest.fail, progress=False, telemetry=tmp_path / "file" / "rows.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("function", [lambda image: 1 / 0, unchanged], ids=["fails", "succeeds"])
def test_no_thread_and_no_file_is_left_open(video, tmp_path, function):
    def in_use() -> tuple[int, int]:
        return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))

    before = in_use()
    with suppress(ZeroDivisionError):
        process_video(video, tmp_path / "out.mp4", function, progress=False, start_s=1.2)
    assert in_use() == before


@pytest.mark.parametrize(
    ("fps", "time_s", "words"),
    [
        (np.nan, None, "fps must be a positive number; got nan"),
        (0.01, None, "0.01 frames a second cannot be written; give 0.1 to 1000"),
        ("25", None, "fps must be a positive number; got '25'"),
        (Fraction(25), np.nan, "time_s must be a finite number; got nan"),
    ],
)
def test_numbers_that_are_none_are_refused(tmp_path, fps, time_s, words):
    with pytest.raises(LaneError, match=re.escape(words)), VideoWriter(tmp_path / "a.mp4", fps=fps) as writer:
        writer.write(numbered(0), time_s)
    assert list(tmp_path.iterdir()) == []
