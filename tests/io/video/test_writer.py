"""Writing: colours of the output, and a writer without frames."""

from __future__ import annotations

import numpy as np
import pytest

from lanes.errors import VideoError
from lanes.video.reader import read_video
from lanes.video.writer import VideoWriter
from tests.io.video.sample_videos import (
    BLUE,
    RED,
    YELLOW,
    numbered,
)


@pytest.mark.parametrize("height", [96, 98])
def test_colours_arrive(tmp_path, height):
    image = numbered(0, (160, height))
    image[:30, :60], image[:30, 60:120] = RED, BLUE
    with VideoWriter(tmp_path / "colours.mp4", fps=25, crf=10) as writer:
        for _ in range(5):
            writer.write(image)
    frame = list(read_video(tmp_path / "colours.mp4"))[3]
    for place, colour in (((15, 30), RED), ((15, 90), BLUE), ((15, 140), YELLOW)):
        np.testing.assert_allclose(frame[place], colour, atol=6)


def test_writer_without_frames(tmp_path):
    with pytest.raises(VideoError, match="no frame was written"), VideoWriter(tmp_path / "out.mp4", fps=25):
        pass
    assert not list(tmp_path.iterdir())
