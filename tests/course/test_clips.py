"""moviepy as the course uses it; the numbers are those that the course mentions."""

from __future__ import annotations

import pytest

from course.clips import open_clip
from lanes.canvas import write_text
from lanes.errors import VideoError
from lanes.video.reader import inspect_video
from tests.video.sample_videos import SIZE, make_video


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    return make_video(tmp_path_factory.mktemp("video") / "drive.mp4", 50)


def test_moviepy_with_a_drawing_function(video, tmp_path):
    def process(frame):
        assert not frame.flags.writeable
        return write_text(frame, "hello")

    with open_clip(video, start_s=0.4, end_s=0.8) as clip:
        clip.image_transform(process).write_videofile(str(tmp_path / "out.mp4"), audio=False, logger=None)
    info = inspect_video(tmp_path / "out.mp4")
    assert (info.frames, info.width, info.height) == (10, *SIZE)


def test_moviepy_calls_the_function_once_too_often(video):
    calls = []
    with open_clip(video, end_s=0.6) as clip:
        frames = list(clip.image_transform(lambda frame: calls.append(0) or frame).iter_frames())
    assert (len(frames), len(calls)) == (15, 16)


def test_part_after_the_end(video):
    with pytest.raises(VideoError, match="lasts 2.0 s"):
        open_clip(video, start_s=3)


def test_bad_file(tmp_path):
    (tmp_path / "drive.mp4").write_text("no video")
    with pytest.raises(VideoError, match="cannot be read as a video"):
        open_clip(tmp_path / "drive.mp4")
