"""Colours: the tags of a source decide its RGB values, and the written file shows the
same, as BT.601.
"""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from lanes.video.reader import read_video
from lanes.video.writer import VideoWriter, process_video
from tests.support.clips import encode
from tests.video.sample_videos import unchanged

COLOURS = [
    (255, 0, 0),
    (0, 255, 0),
    (0, 0, 255),
    (255, 255, 255),
    (0, 0, 0),
    (250, 200, 20),
    (20, 60, 220),
    (130,) * 3,
]
# Luma coefficients of red and blue by matrix code point: ITU-T H.273, table 4.
LUMA = {
    1: (0.2126, 0.0722),
    4: (0.30, 0.11),
    6: (0.299, 0.114),
    7: (0.212, 0.087),
    9: (0.2627, 0.0593),
}


def patches(width: int = 128, height: int = 64) -> np.ndarray:
    """Columns of plain colours; the upper right is darker, so that no rotated picture
    equals another.
    """
    image = np.repeat(
        np.repeat(np.array(COLOURS, np.uint8), 16, axis=0)[None, :width], height, axis=0
    )
    image[: height // 2, width // 2 :] //= 2
    return image


# Matrix, range (1 limited, 2 full), primaries and transfer function of a codec.
TAGS = ("colorspace", "color_range", "color_primaries", "color_trc")


def make_frame(
    image: np.ndarray, tags: tuple[int, int, int, int], form: str
) -> av.VideoFrame:
    """A frame in YUV, whose values are computed here by H.273, clause 8.3."""
    red, blue = LUMA.get(tags[0], LUMA[6])
    luma = image @ np.array([red, 1 - red - blue, blue]) / 255
    chroma = (
        (image[..., 2] / 255 - luma) / (1 - blue) / 2,
        (image[..., 0] / 255 - luma) / (1 - red) / 2,
    )
    black, y_span, c_span = (0, 255, 255) if tags[1] == 2 else (16, 219, 224)
    planes = [black + y_span * luma, *(128 + c_span * plane for plane in chroma)]
    depth = 10 if "10le" in form else 8
    step_x = 1 if "444" in form else 2
    step_y = 2 if "420" in form else 1
    planes = [planes[0], planes[1][::step_y, ::step_x], planes[2][::step_y, ::step_x]]
    frame = av.VideoFrame(image.shape[1], image.shape[0], form)
    for target, values in zip(frame.planes, planes, strict=True):
        stored = np.frombuffer(target, np.uint8 if depth == 8 else np.uint16).reshape(
            target.height, -1
        )
        stored[:, : target.width] = np.rint(values * 2 ** (depth - 8)).clip(
            0, 2**depth - 1
        )
    return frame


def tags_of(path: Path) -> tuple[int, int, int, int]:
    with av.open(str(path)) as container:
        codec = container.streams.video[0].codec_context
        return tuple(getattr(codec, name) for name in TAGS)


def assert_shows(path: Path, image: np.ndarray, tolerance: float) -> None:
    seen = list(read_video(path))[3]
    assert seen.shape == image.shape
    np.testing.assert_allclose(
        seen[4:-4:8, 8::16].astype(int), image[4:-4:8, 8::16], atol=tolerance
    )


SPACES = {
    f"matrix {matrix}": ((matrix, 1 + k % 2, 1, 1), "yuv420p")
    for k, matrix in enumerate(LUMA)
}
SPACES |= {
    "BT.2020": ((9, 1, 9, 14), "yuv420p10le"),
    "HDR, PQ": ((9, 1, 9, 16), "yuv420p10le"),
    "HDR, HLG": ((9, 1, 9, 18), "yuv420p10le"),
    "P3": ((1, 1, 12, 13), "yuv420p"),
    "4:4:4": ((1, 2, 1, 1), "yuv444p"),
    "untagged": ((2, 1, 2, 2), "yuv420p"),
}


# Tags of the output, without which these look pale.
WIDE = {
    "BT.2020": (9, 1, 9, 14),
    "HDR, PQ": (9, 1, 9, 16),
    "HDR, HLG": (9, 1, 9, 18),
    "P3": (6, 1, 12, 1),
}


@pytest.mark.parametrize("name", SPACES)
def test_every_colour_space_shows_the_same_colours_in_the_output(tmp_path, name):
    """Untagged colours are taken for those of BT.601."""
    tags, form = SPACES[name]
    frames = [make_frame(patches(), tags, form) for _ in range(5)]
    header = dict(zip(TAGS, tags, strict=True))
    source = encode(
        tmp_path / "source.mkv", frames, pixels=form, options={"qp": "0"}, header=header
    )  # without loss
    assert_shows(source, patches(), 4)
    process_video(source, tmp_path / "out.mp4", unchanged, progress=False)
    assert tags_of(tmp_path / "out.mp4") == WIDE.get(name, (6, 1, 1, 1))
    assert_shows(tmp_path / "out.mp4", patches(), 12)


@pytest.mark.parametrize(("width", "height"), [(127, 63), (127, 64)])
def test_odd_sizes_are_padded(tmp_path, width, height):
    """An odd width or height is padded by repeating the last pixels."""
    with VideoWriter(tmp_path / "out.mp4", fps=25) as writer:
        for _ in range(5):
            writer.write(patches(width, height))
    assert tags_of(tmp_path / "out.mp4") == (6, 1, 1, 1)
    padded = np.pad(
        patches(width, height), ((0, height % 2), (0, width % 2), (0, 0)), "edge"
    )
    assert_shows(tmp_path / "out.mp4", padded, 6)
    np.testing.assert_allclose(
        next(read_video(tmp_path / "out.mp4"))[-1, ::16].astype(int),
        padded[-1, ::16],
        atol=6,
    )
