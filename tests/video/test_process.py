"""process_video: each frame once, in order and at its time; the same bytes for the same
input.
"""

from __future__ import annotations

import io
import re
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from lanes.errors import LaneError, PictureError, VideoError
from lanes.files import read_telemetry
from lanes.video.reader import read_timed_frames, read_video
from lanes.video.writer import VideoWriter, process_video
from tests.video.sample_videos import NTSC, make_video, number_of, numbered, unchanged


def make_stateful() -> Callable:
    """A function with a state that returns the same array every time: the worst case
    for threads.
    """
    canvas = np.zeros((96, 256, 3), np.uint8)

    def function(image: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
        canvas[:] = canvas // 2 + image // 2
        image[:] = 0
        return canvas, {"brightness": float(canvas.mean().round(3))}

    return function


@pytest.mark.parametrize(("fps", "frames"), [(25, 1), (NTSC, 20), (12, 20)])
def test_rate_and_duration_are_exact(tmp_path, fps, frames):
    path = make_video(tmp_path / "drive.mp4", frames, fps=fps)
    info = process_video(path, tmp_path / "out.mp4", unchanged, progress=False)
    with av.open(str(tmp_path / "out.mp4")) as container:
        assert container.streams.video[0].average_rate == fps
    assert (info.fps, info.frames, info.duration_s) == (
        float(fps),
        frames,
        round(float(frames / fps), 6),
    )


def test_each_frame_is_seen_once_in_order_and_browsers_can_play_the_output(
    video, tmp_path
):
    seen = []
    target = tmp_path / "out.mp4"
    info = process_video(
        video, target, lambda f: seen.append(number_of(f)) or f, progress=False
    )
    assert seen == [number_of(image) for image in read_video(target)] == list(range(50))
    assert (info.frames, info.missing) == (50, 0)
    with av.open(str(target)) as container:
        codec = container.streams.video[0].codec_context
        assert (codec.name, codec.pix_fmt, codec.profile) == ("h264", "yuv420p", "High")
        assert container.streams.audio[0].codec_context.name == "aac"
    # The index of the file stands before its frames.
    assert target.read_bytes().index(b"moov") < target.read_bytes().index(b"mdat")


def test_variable_rate_keeps_its_times_and_the_function_can_take_them(tmp_path):
    times_s = [0, 0.04, 0.08, 0.3, 0.34, 0.75, 0.9, 0.9, 1.0]
    told = []  # some recorders repeat a time stamp
    path = tmp_path / "variable.mp4"
    target = tmp_path / "out.mp4"
    with VideoWriter(path, fps=25) as writer:
        for number, time_s in enumerate(times_s):
            writer.write(numbered(number), time_s)

    def function(image: np.ndarray, *, elapsed_s: float | None = 9.0) -> np.ndarray:
        told.append(elapsed_s)
        return image

    process_video(path, target, function, progress=False)
    found_s = [f.time_s for f in read_timed_frames(target)]
    np.testing.assert_allclose(found_s, times_s, atol=1e-3)
    assert (np.diff(found_s) > 0).all()
    assert told[0] is None
    assert told[1:] == pytest.approx(np.diff(times_s), abs=1e-3)
    process_video(path, target, function, start_s=0.3, progress=False)
    assert told[9] is None
    assert told[10:] == pytest.approx(np.diff(times_s[3:]), abs=1e-3)
    # A function written in C has no signature; it gets the image only.
    process_video(path, target, cv2.bitwise_not, progress=False)
    assert next(read_video(target))[:8].mean() == pytest.approx(
        255 - numbered(0)[:8].mean(), abs=8
    )


def test_threads_change_nothing(tmp_path):
    """A loop without threads gives the same bytes and the same telemetry.

    With AVX-512 x264 reads beyond its data (in the macroblock tree) if the width is not
    a multiple of 256 pixels: about 10 of 60 runs of 160x96 differed, none of 256x96 and
    1280x720.
    """
    video = make_video(tmp_path / "wide.mp4", 50, size=(256, 96), sound="aac")
    plain = make_stateful()
    rows = []
    with VideoWriter(tmp_path / "plain.mp4", fps=25, sound_from=video) as writer:
        for frame in read_timed_frames(video, start_s=0.4):
            image, row = plain(frame.image)
            rows.append({"frame": frame.number, "time_s": frame.time_s} | row)
            writer.write(image, frame.time_s)
    options = {"start_s": 0.4, "progress": False, "telemetry": tmp_path / "rows.csv"}
    process_video(video, tmp_path / "out.mp4", make_stateful(), **options)
    assert (tmp_path / "plain.mp4").read_bytes() == (tmp_path / "out.mp4").read_bytes()
    table = read_telemetry(tmp_path / "rows.csv")
    name, latency_ms = table.popitem()
    assert name == "latency_ms"
    assert (latency_ms > 0).all()
    assert [
        dict(zip(table, values, strict=True))
        for values in zip(*table.values(), strict=True)
    ] == rows
    assert len(rows) == 40


@pytest.mark.parametrize(
    ("stream", "progress", "shown"),
    [("notebook", True, True), ("file", True, False), ("terminal", False, False)],
)
def test_progress_is_shown_in_terminals_and_notebooks_only(
    video, tmp_path, monkeypatch, stream, progress, shown
):
    kind = type("OutStream", (io.StringIO,), {"isatty": lambda _: stream == "terminal"})
    kind.__module__ = "ipykernel.iostream" if stream == "notebook" else "io"
    monkeypatch.setattr(sys, "stderr", kind())
    process_video(
        video, tmp_path / "out.mp4", unchanged, progress=progress, start_s=1.0
    )
    last = sys.stderr.getvalue().rpartition("\r")[2]
    assert (
        bool(re.search(r"25/25 \[\d\d:\d\d<00:00, +[\d.]+frame/s", last))
        == bool(last)
        == shown
    )


@pytest.fixture
def earlier(tmp_path):
    """The name of an output that is there already, and must stay as it is."""
    path = tmp_path / "out" / "drive.mp4"
    path.parent.mkdir()
    path.write_bytes(b"earlier")
    yield path
    assert [p.name for p in path.parent.iterdir()] == ["drive.mp4"]
    assert path.read_bytes() == b"earlier"


@pytest.mark.parametrize(
    "error",
    [ZeroDivisionError("radius"), KeyboardInterrupt(), PictureError("is too dark")],
)
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
        (
            [np.zeros((96, 160), np.uint8)],
            r"frame 0 of .*the function returned uint8 of shape \(96, 160\)",
        ),
        ([np.zeros((96, 160, 3))], "frame 0 of .*the function returned float64"),
        (
            [np.zeros((n, 160, 3), np.uint8) for n in (100, 99)],
            "frame 1 is .*99 pixels, the first one was 160x100",
        ),
    ],
    ids=["none", "gray", "float", "other size"],
)
def test_functions_that_return_no_image_of_one_size(video, tmp_path, results, sentence):
    returned = iter(results)
    with pytest.raises(VideoError, match=sentence):
        process_video(
            video, tmp_path / "a.mp4", lambda image: next(returned), progress=False
        )


def test_error_while_writing(video, earlier, monkeypatch):
    """A disk that is full from the tenth frame on; the run stops after a few more
    frames.
    """

    def broken_encode(writer: VideoWriter, frame: av.VideoFrame) -> None:
        if frame.time >= 9 / 25:
            raise OSError(f"{writer.path}: cannot be written (No space left on device)")

    monkeypatch.setattr(VideoWriter, "encode", broken_encode)
    seen = []
    with pytest.raises(OSError, match=r"drive\.mp4: cannot be written \(No space left"):
        process_video(
            video, earlier, lambda image: seen.append(0) or image, progress=False
        )
    assert 10 <= len(seen) <= 15


def test_unusable_names_and_no_frames(video, tmp_path):
    with (
        pytest.raises(VideoError, match="no frame was written"),
        VideoWriter(tmp_path / "out.mp4", fps=25),
    ):
        pass
    with pytest.raises(VideoError, match=r"out\.avi: .*\.mp4"):
        process_video(video, tmp_path / "out.avi", unchanged, progress=False)
    with pytest.raises(FileNotFoundError, match="nowhere.mp4"):
        process_video(
            tmp_path / "nowhere.mp4",
            tmp_path / "new" / "out.mp4",
            unchanged,
            progress=False,
        )
    assert list(tmp_path.iterdir()) == []
    before = video.read_bytes()
    with pytest.raises(VideoError, match="is the source itself"):
        process_video(video, video, unchanged, progress=False)
    assert video.read_bytes() == before


@pytest.mark.parametrize("name", ["file/out.mp4", "long" * 62 + "longout.mp4"])
def test_unwritable_outputs_are_reported_before_processing(video, tmp_path, name):
    """A name may be as long as the file system allows."""
    longest = "\u00e4" * 117 + "x" * 17
    process_video(
        video, tmp_path / f"{longest}.mp4", unchanged, progress=False, start_s=1.9
    )
    (tmp_path / f"{longest}.mp4").unlink()
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(OSError, match=r"out\.mp4: cannot be written"):
        process_video(video, tmp_path / name, pytest.fail, progress=False)
    with pytest.raises(OSError, match=r"rows\.csv: cannot be written"):
        process_video(
            video,
            tmp_path / "a.mp4",
            pytest.fail,
            progress=False,
            telemetry=tmp_path / "file" / "rows.csv",
        )
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    "function", [lambda image: 1 / 0, unchanged], ids=["fails", "succeeds"]
)
def test_no_thread_and_no_file_is_left_open(video, tmp_path, function):
    def in_use() -> tuple[int, int]:
        return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))

    before = in_use()
    with suppress(ZeroDivisionError):
        process_video(
            video, tmp_path / "out.mp4", function, progress=False, start_s=1.2
        )
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
    with (
        pytest.raises(LaneError, match=re.escape(words)),
        VideoWriter(tmp_path / "a.mp4", fps=fps) as writer,
    ):
        writer.write(numbered(0), time_s)
    assert list(tmp_path.iterdir()) == []
