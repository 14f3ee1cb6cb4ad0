"""Videos shared by the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.video.sample_videos import make_video


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Path:
    return make_video(tmp_path_factory.mktemp("video") / "drive.mp4", 50, sound="aac")


@pytest.fixture(scope="module")
def repeatable(tmp_path_factory) -> Path:
    """A video that x264 encodes to the same bytes each time.

    With AVX-512 x264 reads beyond its data (in the macroblock tree) if the width is not a multiple of 256 pixels: about
    10 of 60 runs of 160x96 differed, none of 256x96 and 1280x720.
    """
    return make_video(tmp_path_factory.mktemp("video") / "wide.mp4", 50, size=(256, 96), sound="aac")
