"""A video shared by the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.video.sample_videos import make_video


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Path:
    return make_video(tmp_path_factory.mktemp("video") / "drive.mp4", 50, sound="aac")
