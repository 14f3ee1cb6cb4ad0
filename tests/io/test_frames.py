"""YUV frames: colours, positions of pixels, drawing, and the bird's-eye view made from them."""

from __future__ import annotations

import av
import numpy as np
import pytest
from av.video.reformatter import ColorRange, Colorspace, VideoReformatter

from lanes.canvas import LANE_COLOUR, LEFT_COLOUR, blend_polygon, draw_polyline, put_text
from lanes.detect.birdseye import BirdsEyeView
from lanes.draw import draw_tracked
from lanes.errors import PictureError
from lanes.images import YuvColourSpace, YuvFrame, as_rgb, rgb_to_yuv
from lanes.video.reader import to_upright_rgb, to_upright_yuv
from tests.support.painted_drive import SMALL, tracked_bends

COLOURS = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255), (0, 0, 0), (250, 200, 20), (20, 60, 220)]


def patches(width: int = 112, height: int = 64) -> np.ndarray:
    """Columns of plain colours; the upper right is darker, so that no rotated picture equals another."""
    image = np.repeat(np.repeat(np.array(COLOURS, np.uint8), 16, axis=0)[None, :width], height, axis=0)
    image[: height // 2, width // 2 :] //= 2
    return image


def stored(image: np.ndarray, form: str, matrix: int = Colorspace.ITU601, span: ColorRange = ColorRange.MPEG):
    """The picture as a decoded frame, converted by FFmpeg."""
    frame = av.VideoFrame.from_ndarray(image)
    return frame.reformat(format=form, dst_colorspace=matrix, src_color_range=ColorRange.JPEG, dst_color_range=span)


@pytest.mark.parametrize("span", [ColorRange.MPEG, ColorRange.JPEG])
@pytest.mark.parametrize(("matrix", "number"), [(Colorspace.ITU601, 6), (Colorspace.ITU709, 1), (Colorspace.BT2020, 9)])
def test_colours_are_those_of_ffmpeg(matrix, number, span):
    frame = stored(patches(), "yuv444p", matrix, span)
    colours = YuvColourSpace(number, full_range=span == ColorRange.JPEG)
    expected = [rgb_to_yuv(colour, colours) for colour in COLOURS]
    np.testing.assert_allclose(frame.to_ndarray()[:, 50, 8::16].T, expected, atol=1)
    picture = to_upright_yuv(frame, VideoReformatter())
    assert picture.colour_space == colours
    np.testing.assert_allclose(picture.to_rgb()[50, 8::16], COLOURS, atol=3)


@pytest.mark.parametrize(
    ("form", "span"),
    [
        ("yuv420p", ColorRange.MPEG),
        ("yuvj420p", ColorRange.JPEG),
        ("yuv420p10le", ColorRange.MPEG),
        ("yuv422p", ColorRange.JPEG),
        ("yuv444p12le", ColorRange.MPEG),
        ("nv12", ColorRange.MPEG),
        ("bgr24", ColorRange.JPEG),
        ("gbrp", ColorRange.JPEG),
    ],
)
def test_every_pixel_format_gives_the_same_picture(form, span):
    frame = stored(patches(), form, span=span)
    picture = to_upright_yuv(frame, VideoReformatter())
    seen = picture.to_rgb()
    assert picture.shape == seen.shape == (64, 112, 3)
    np.testing.assert_allclose(seen[50, 8::16], COLOURS, atol=3)
    np.testing.assert_allclose(seen[4:-4:8, 8::16], to_upright_rgb(frame, VideoReformatter())[4:-4:8, 8::16], atol=4)


def test_unspecified_colours_are_taken_for_bt601():
    frame = stored(patches(), "yuv420p")
    frame.colorspace, frame.color_range, frame.color_primaries, frame.color_trc = 2, 0, 2, 2
    assert to_upright_yuv(frame, VideoReformatter()).colour_space == YuvColourSpace()


def test_planes_are_copies_of_the_decoder_s():
    frame = stored(np.random.default_rng(3).integers(0, 256, (66, 90, 3)).astype(np.uint8), "yuv420p")
    picture = to_upright_yuv(frame, VideoReformatter())
    for plane, source in zip(picture.planes, frame.planes, strict=True):
        rows = np.frombuffer(source, np.uint8).reshape(source.height, source.line_size)[:, : source.width]
        np.testing.assert_array_equal(plane, rows)
        assert not np.shares_memory(plane, rows)
        assert np.shares_memory(plane, picture.data)
    copied = picture.copy()
    copied.planes[0][:] = 0
    assert picture.planes[0].any()


@pytest.mark.parametrize(("width", "height"), [(111, 63), (111, 64), (112, 63)])
def test_odd_sizes_repeat_the_last_pixels(width, height):
    image = patches(width, height)
    picture = YuvFrame.from_rgb(image)
    assert picture.shape == image.shape
    assert picture.padded_size == (112, 64)
    np.testing.assert_allclose(picture.to_rgb()[4:-4:8, 8::16], image[4:-4:8, 8::16], atol=3)
    np.testing.assert_array_equal(picture.planes[0][-1, :width], picture.planes[0][height - 1, :width])
    odd = to_upright_yuv(stored(image, "yuv444p"), VideoReformatter())
    assert odd.shape == image.shape
    np.testing.assert_allclose(odd.to_rgb()[4:-4:8, 8::16], image[4:-4:8, 8::16], atol=4)


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_rotation_is_that_of_rgb(quarters):
    image = patches()
    turned = YuvFrame.from_rgb(image).rotated(quarters)
    expected = np.rot90(image, quarters)
    assert turned.shape == expected.shape
    assert turned.data.flags.c_contiguous
    for place in ((50, 8), (20, 40), (40, 56)):
        row, column = (place[1], place[0]) if quarters % 2 else place
        np.testing.assert_allclose(turned.to_rgb()[row, column], expected[row, column], atol=3)


def test_only_rgb_is_converted():
    with pytest.raises(PictureError, match="float64"):
        YuvFrame.from_rgb(patches() / 255)
    image = patches()
    assert as_rgb(image) is image


class TestDrawing:
    """Each function on a gray RGB picture and YUV frame; they differ in colours along edges, up to two pixels wide."""

    @pytest.mark.parametrize(
        "draw",
        [
            lambda p: draw_polyline(p, np.array([[12.3, 8.6], [140.2, 70.7]]), LEFT_COLOUR, 9.0),
            lambda p: blend_polygon(p, np.array([[31.0, 15], [129.5, 20], [140, 77.3], [7, 80]]), LANE_COLOUR, 0.3),
            lambda p: blend_polygon(p, np.array([[-50.0, 15], [300, 20], [50, 777]]), LANE_COLOUR, 1.0),
        ],
        ids=["line", "area", "area beyond the picture"],
    )
    def test_lands_where_it_does_in_rgb(self, draw):
        image = np.full((96, 160, 3), 100, np.uint8)
        picture = YuvFrame.from_rgb(image)
        draw(image)
        draw(picture)
        difference = np.abs(picture.to_rgb().astype(int) - image).max(axis=2)
        assert (image != 100).any(axis=2).sum() > 500
        assert np.median(difference[(image != 100).any(axis=2)]) <= 3
        # brightness is drawn at full resolution: no pixel of it may be off by more than rounding
        expected = YuvFrame.from_rgb(image).planes[0].astype(int)
        np.testing.assert_allclose(picture.planes[0], expected, atol=2)
        assert (difference > 40).mean() < 0.03

    def test_nothing_else_changes(self):
        picture = YuvFrame.from_rgb(np.random.default_rng(4).integers(0, 256, (96, 160, 3)).astype(np.uint8))
        before = picture.copy()
        blend_polygon(picture, np.array([[31.0, 15], [129.5, 20], [140, 77.3]]), LANE_COLOUR, 0.3)
        draw_polyline(picture, np.array([[31.0, 15], [100, 60]]), LEFT_COLOUR, 4.0)
        for plane, old, step in zip(picture.planes, before.planes, (1, 2, 2), strict=True):
            np.testing.assert_array_equal(plane[: 10 // step], old[: 10 // step])
            np.testing.assert_array_equal(plane[:, : 24 // step], old[:, : 24 // step])
            assert (plane != old).mean() > 0.1

    def test_text_is_white_on_a_neutral_dark_panel(self):
        image = np.empty((96, 160, 3), np.uint8)
        image[:] = 60, 120, 250
        picture = YuvFrame.from_rgb(image)
        put_text(picture, "lost", size_px=20)
        seen = picture.to_rgb()
        panel = seen[2:20, 2:40]
        assert panel.max() > 240
        assert np.ptp(panel, axis=2).max() < 4
        assert np.median(panel) < 80
        np.testing.assert_allclose(seen[60:], np.broadcast_to([60, 120, 250], seen[60:].shape), atol=2)


def test_the_road_looks_the_same():
    """The bird's-eye views of both differ by rounding and the coarser chroma only."""
    image, _ = tracked_bends()
    view = BirdsEyeView(SMALL)
    rgb, yuv = view.warp(image), view.warp(YuvFrame.from_rgb(image))
    assert yuv.dtype == np.uint8 and yuv.shape == rgb.shape
    difference = np.abs(rgb.astype(int) - yuv)[view.seen]
    assert difference.mean() < 2
    assert np.percentile(difference, 99) < 15


def test_the_lane_is_drawn_on_either():
    image, result = tracked_bends()
    drawn = draw_tracked(image, result, SMALL)
    picture = YuvFrame.from_rgb(image)
    assert draw_tracked(picture, result, SMALL, onto=picture) is picture
    # below the panel, where chroma differs on purpose
    difference = np.abs(drawn.astype(int) - picture.to_rgb())[80:]
    assert difference.mean() < 3
    with pytest.raises(PictureError, match="1280x720"):
        draw_tracked(YuvFrame.from_rgb(np.zeros((720, 1280, 3), np.uint8)), result, SMALL)
