"""Markings from any network: an ONNX file that the tests make, and functions."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import lanes
from lanes.annotation import DriveSettings
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import SURE_CONFIDENCE
from lanes.detect.evidence import PAINT, Evidence, Stripes, find_evidence
from lanes.detect.markings import (
    MarkingSource,
    TrainingWindow,
    crop_rows,
    horizon_row,
    load_markings,
)
from lanes.detect.search import detect_still
from lanes.errors import LaneError
from lanes.files import read_telemetry
from lanes.many import fingerprint
from lanes.tracking.tracker import LaneTracker
from lanes.video.images import write_image
from simulator.rendering.drive import Motion
from tests.support.clips import write_drive
from tests.support.onnx_file import LOGITS, threshold, write_model
from tests.support.painted_drive import SMALL, PaintedDrive, lane_lines, s_bend
from tests.support.painted_roads import ASPHALT, Arc, Road, bushes, dashcam

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
LEFT_M = 1.8
RIGHT_M = -1.7
AHEAD_M = np.array([6.0, 10.0, 15.0, 20.0, 30.0])
# As bright as the road, and less yellow: only a network for its colour sees it.
PINK = (141, 68, 141)
PINK_PAINT = threshold(0.5, -1.0, 0.5, road=0.0, paint=73 / 255)


def wide_mask(road: Road, half_m: float = 0.25, left_m: float = 0.0) -> np.ndarray:
    """The true mask of both lines, dilated to twice `half_m` and moved to the left."""

    def is_marking(_: np.ndarray, y_m: np.ndarray) -> np.ndarray:
        from_left_m = np.abs(y_m - LEFT_M - left_m)
        from_right_m = np.abs(y_m - RIGHT_M - left_m)
        return np.minimum(from_left_m, from_right_m) < half_m

    return road.cover(is_marking)[..., 0]


def largest_error_m(lane: lanes.Lane, arc: Arc) -> float:
    """Largest distance of both lines from their true places."""
    left_m = arc.lateral_m(LEFT_M, AHEAD_M)
    right_m = arc.lateral_m(RIGHT_M, AHEAD_M)
    error_m = lane.lateral_m(AHEAD_M) - [left_m, right_m]
    return np.abs(error_m).max()


# Masks of functions.


@pytest.mark.parametrize(
    ("arc", "size"),
    [
        (Arc(1 / 150, offset_m=0.4), (640, 360)),
        (Arc(-1 / 80), (320, 180)),
    ],
)
class TestMaskWithoutVisiblePaint:
    @pytest.fixture
    def found(self, arc, size):
        road = Road(CAMERA, arc=arc)
        mask = cv2.resize(wide_mask(road), size, interpolation=cv2.INTER_AREA)
        return detect_still(road.image(), CAMERA, markings=lambda _: mask)

    def test_gives_the_lane(self, found, arc):
        assert largest_error_m(found.lane, arc) < 0.05
        assert found.lane.confidence > 0.9

    def test_gives_neither_kind_nor_colour(self, found):
        for line in found.lane.lines:
            assert line.kind is None
            assert line.colour is None

    def test_gives_stripes_as_exact_as_a_pixel_of_the_mask(self, found, size):
        stripes = found.evidence.stripes
        exact_m = np.hypot(0.04, stripes.x_m / CAMERA.matrix[0, 0])
        ratio = stripes.std_m / exact_m
        np.testing.assert_allclose(ratio, CAMERA.width / size[0], rtol=1e-3)


class TestMaskBesideVisiblePaint:
    """The mask lies 6 cm to the left of dashes; between them there is a mask, too."""

    @pytest.fixture(scope="class")
    @classmethod
    def found(cls):
        road = Road(CAMERA).lines(LEFT_M, RIGHT_M, dash_m=(3.0, 9.0))
        mask = wide_mask(road, 0.2, 0.06)
        road.surround(bushes(CAMERA))
        return detect_still(road.image(), CAMERA, markings=lambda _: mask)

    @pytest.fixture(scope="class")
    @classmethod
    def stripes(cls, found):
        stripes = found.evidence.stripes
        return stripes.select(stripes.x_m < 20)

    @pytest.fixture(scope="class")
    @classmethod
    def off_m(cls, stripes):
        true_m = np.where(stripes.y_m > 0, LEFT_M, RIGHT_M)
        return stripes.y_m - true_m

    def test_stripes_on_paint_are_where_the_paint_is(self, stripes, off_m):
        distance_m = np.abs(off_m[stripes.measurable])
        assert np.quantile(distance_m, 0.85) < 0.02

    def test_other_stripes_are_where_the_mask_is(self, stripes, off_m):
        of_mask_m = np.median(off_m[~stripes.measurable])
        assert of_mask_m == pytest.approx(0.06, abs=0.01)

    def test_the_lines_have_the_kind_and_colour_of_the_paint(self, found):
        for line in found.lane.lines:
            assert line.kind == "dashed"
            assert line.colour == "white"


class TestMaskWithoutMarkings:
    """Paint that is too faint for the band filter: only our network sees it."""

    @pytest.fixture(scope="class")
    @classmethod
    def faint(cls) -> np.ndarray:
        colour = tuple(np.add(ASPHALT, 8))
        road = Road(CAMERA, noise=5.0)
        return road.lines(LEFT_M, RIGHT_M, colour=colour).image()

    def test_alone_gives_no_lane(self, faint):
        assert lanes.find_lane(faint, CAMERA, markings=no_markings) is None

    def test_with_own_leaves_what_our_network_finds(self, faint):
        source = MarkingSource(no_markings, with_own=True)
        lane = lanes.find_lane(faint, CAMERA, markings=source)
        own = lanes.find_lane(faint, CAMERA)
        np.testing.assert_allclose(lane.model, own.model, atol=1e-3)


def no_markings(_: np.ndarray) -> np.ndarray:
    return np.zeros((9, 16))


# Joined masks: the mean of the log odds.


class TestJoinedMask:
    @pytest.fixture(scope="class")
    @classmethod
    def road(cls) -> Road:
        return Road(CAMERA).lines(LEFT_M, RIGHT_M)

    def joined(self, road: Road, mask: np.ndarray, quick: bool = False) -> Evidence:
        source = MarkingSource(lambda _: mask, with_own=True)
        return find_evidence(road.image(), VIEW, PAINT, markings=source, quick=quick)

    @pytest.mark.parametrize("quick", [False, True])
    def test_has_the_mean_of_the_log_odds(self, road, quick):
        own = find_evidence(road.image(), VIEW, PAINT, quick=quick).response.strength
        even = np.full((360, 640), 0.95)
        found = self.joined(road, even, quick).response.strength
        of_mask = PAINT.half_weight_strength * np.sqrt(0.95 / 0.05)
        # away from the border of the mask, whose centre is not there
        inside = VIEW.seen & (np.abs(VIEW.y_m) < 2) & (VIEW.x_m[:, None] > 10)
        weaker = inside & (own > 3) & (own < of_mask)
        expected = np.sqrt(own * of_mask)[weaker]
        np.testing.assert_allclose(found[weaker], expected, rtol=0.03)

    def test_gives_what_both_show_more_weight(self):
        faint = Road(CAMERA, noise=5.0)
        faint = faint.lines(LEFT_M, RIGHT_M, colour=tuple(np.add(ASPHALT, 8)))
        own = find_evidence(faint.image(), VIEW, PAINT).stripes
        joined = self.joined(faint, wide_mask(faint)).stripes
        assert paint_weight(joined, LEFT_M) > paint_weight(own, LEFT_M) + 0.05

    def test_never_takes_weight_from_paint(self, road):
        own = find_evidence(road.image(), VIEW, PAINT).stripes
        stripes = self.joined(road, wide_mask(road, left_m=1.0)).stripes
        assert 0 < paint_weight(stripes, LEFT_M + 1.0) < paint_weight(stripes, LEFT_M)
        weight = paint_weight(own, LEFT_M)
        assert paint_weight(stripes, LEFT_M) == pytest.approx(weight, abs=0.02)


def paint_weight(stripes: Stripes, y_m: float) -> float:
    """Median weight of the painted stripes near a line; 0 without any."""
    near = ~stripes.edge & (np.abs(stripes.y_m - y_m) < 0.15) & (stripes.x_m < 20)
    return float(np.median(stripes.weight[near])) if near.any() else 0.0


# Windows.


class TestTrainingWindow:
    @pytest.mark.parametrize(
        ("size", "pitch_deg"), [((640, 360), 0.0), ((640, 480), 6.0), ((640, 180), -3)]
    )
    def test_has_the_horizon_of_the_training_images(self, size, pitch_deg):
        camera = looking(size, pitch_deg)
        top, bottom = TrainingWindow(0.4).rows(camera)
        assert bottom - top == 360
        horizon = (horizon_row(camera) - top) / 360
        assert horizon == pytest.approx(0.4, abs=0.002)

    @pytest.mark.parametrize(
        ("size", "pitch_deg"), [((360, 640), 0.0), ((640, 360), 40.0)]
    )
    def test_is_the_whole_image(self, size, pitch_deg):
        """In portrait, and if the horizon is far outside of the image."""
        assert TrainingWindow(0.4).rows(looking(size, pitch_deg)) == (0, size[1])

    def test_is_what_the_function_gets(self):
        camera = looking((640, 480), 2.0)
        seen = []

        def markings(image: np.ndarray) -> np.ndarray:
            seen.append(image.shape)
            return np.zeros((9, 16))

        source = MarkingSource(markings, window=TrainingWindow(0.45))
        lanes.find_lane(np.zeros((480, 640, 3), np.uint8), camera, markings=source)
        assert seen == [(360, 640, 3)]

    @pytest.mark.parametrize("pitch_deg", [-5.0, 0.0, 5.0])
    def test_its_mask_is_where_the_image_is(self, pitch_deg):
        camera = looking((640, 480), pitch_deg)
        road = Road(camera)
        mask = wide_mask(road)
        window = TrainingWindow(0.45)
        of_window = crop_rows(mask, window.rows(camera))
        source = MarkingSource(lambda _: of_window, window=window)
        lane = lanes.find_lane(road.image(), camera, markings=source)
        assert largest_error_m(lane, Arc()) < 0.05

    def test_leaves_our_evidence_beyond_it(self):
        camera = looking((640, 640), 0.0)
        image = Road(camera).lines(LEFT_M, RIGHT_M).image()
        view = BirdsEyeView(camera)
        window = TrainingWindow(0.9)
        source = MarkingSource(no_markings, with_own=True, window=window)
        own = find_evidence(image, view, PAINT).response.strength
        joined = find_evidence(image, view, PAINT, markings=source).response.strength
        beyond = view.pixels[..., 1] > window.rows(camera)[1]
        assert beyond.any()
        np.testing.assert_array_equal(joined[beyond], own[beyond])


def looking(size: tuple[int, int], pitch_deg: float) -> lanes.Camera:
    """A camera of this size with a pitch, degrees, positive down."""
    pose = replace(CAMERA.pose, pitch_rad=np.radians(pitch_deg))
    return lanes.Camera.from_fov(size, hfov_deg=60, pose=pose)


@pytest.mark.parametrize("horizon", [0, 1.2, "high"])
def test_a_horizon_outside_of_the_training_images_is_refused(tmp_path, horizon):
    entries = LOGITS | {"horizon": horizon}
    file = write_model(tmp_path / "m.onnx", {"lines": threshold()}, entries)
    with pytest.raises(LaneError, match="m.yaml: cannot be used"):
        load_markings(file)


def test_the_window_of_a_network_has_the_aspect_ratio_of_its_input(tmp_path):
    entries = LOGITS | {"input_size": [640, 320], "horizon": 0.45}
    file = write_model(tmp_path / "m.onnx", {"lines": threshold()}, entries)
    assert load_markings(file).window == TrainingWindow(0.45, 2.0)


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (np.full((9, 16), np.nan), "with values from nan to nan"),
        (np.full((9, 16), 255, np.uint8), "from 255 to 255; a mask has .* 0 to 1"),
        (np.zeros((9, 16, 2)), r"shape \(9, 16, 2\)"),
        (np.zeros((0, 0)), r"shape \(0, 0\)"),
        (None, r"shape \(\)"),
    ],
)
def test_what_is_no_mask_is_refused(mask, words):
    image = np.zeros((360, 640, 3), np.uint8)
    with pytest.raises(LaneError, match=words):
        lanes.find_lane(image, CAMERA, markings=lambda _: mask)


# Networks in files.


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """A road with both lines between bushes."""
    return Road(CAMERA).lines(LEFT_M, RIGHT_M).surround(bushes(CAMERA)).image()


BACKGROUND_AND_PAINT = threshold()
KERNEL, BIAS = BACKGROUND_AND_PAINT
# of inputs that are normalised like torchvision: (pixel / 255 - 0.5) / 0.25
NORMALISED = threshold(
    road=(98 / 255 - 0.5) / 0.25,
    paint=(215 / 255 - 0.5) / 0.25,
)
NORMALISATION = {"mean": [127.5] * 3, "scale": [4 / 255] * 3}
# two channels of paint, whose probabilities add up
TWO_KINDS = (
    np.concatenate([KERNEL, KERNEL[1:]]),
    np.concatenate([BIAS, BIAS[1:]]),
)

NETWORKS = {
    "probabilities": (BACKGROUND_AND_PAINT, {"values": "probabilities"}, True),
    "small": (BACKGROUND_AND_PAINT, {"input_size": [320, 192]}, False),
    "RGB": (threshold(1, 0, 0), {"colour_order": "RGB"}, False),
    "BGR": (threshold(0, 0, 1), {"colour_order": "BGR"}, False),
    # one channel: the logarithm of the odds
    "one channel": ((KERNEL[1:], BIAS[1:]), {"channel": 0}, False),
    "two kinds": (TWO_KINDS, {"channel": [1, 2]}, False),
    "normalised": (NORMALISED, NORMALISATION, False),
}


@pytest.mark.parametrize(
    ("channels", "entries", "sigmoid"), NETWORKS.values(), ids=NETWORKS
)
class TestNetwork:
    @pytest.fixture
    def source(self, tmp_path, channels, entries, sigmoid) -> MarkingSource:
        file = tmp_path / "m.onnx"
        write_model(file, {"lines": channels}, LOGITS | entries, sigmoid=sigmoid)
        return load_markings(file)

    def test_gives_the_mask(self, image, source, entries):
        mask = source.find_mask(image)
        width, height = entries.get("input_size", (640, 360))
        assert mask.shape == (height, width)
        brightness = cv2.resize(image, (width, height)).mean(axis=2)
        assert mask[brightness > 190].min() > 0.8
        assert mask[brightness < 110].max() < 0.2

    def test_gives_the_lane(self, image, source):
        lane = lanes.find_lane(image, CAMERA, markings=source)
        assert largest_error_m(lane, Arc()) < 0.05
        assert lane.left.colour == "white"


def test_of_several_outputs_one_is_named(image, tmp_path):
    outputs = {"area": threshold(-1, 0, 0), "lines": threshold()}
    file = write_model(tmp_path / "m.onnx", outputs, LOGITS | {"output": "lines"})
    lane = lanes.find_lane(image, CAMERA, markings=load_markings(file))
    assert lane.confidence > 0.9


def test_a_new_file_of_the_same_name_is_read(image, tmp_path):
    file = write_model(tmp_path / "m.onnx", {"lines": threshold()})
    before = load_markings(file).find_mask(image)
    write_model(file, {"lines": threshold(-1, 0, 0)})
    after = load_markings(file).find_mask(image)
    assert np.abs(after - before).max() > 0.5


def test_another_process_gets_the_same_network(image, tmp_path):
    source = load_markings(write_model(tmp_path / "m.onnx", {"lines": threshold()}))
    received = pickle.loads(pickle.dumps(source))
    mask = received.find_mask(image)
    np.testing.assert_array_equal(mask, source.find_mask(image))


class TestConfidenceShift:
    @pytest.fixture
    def source(self, tmp_path) -> MarkingSource:
        entries = LOGITS | {"confidence_shift": -3}
        outputs = {"lines": threshold()}
        return load_markings(write_model(tmp_path / "m.onnx", outputs, entries))

    def test_is_added_to_the_log_odds(self, image, source):
        unshifted = replace(source, confidence_shift=0.0)
        plain = lanes.find_lane(image, CAMERA, markings=unshifted)
        shifted = lanes.find_lane(image, CAMERA, markings=source)
        difference = plain.log_odds - shifted.log_odds
        assert difference == pytest.approx(3.0, abs=0.01)

    def test_is_that_of_a_track(self, image, source):
        lane = LaneTracker(CAMERA, markings=source).update(image)
        assert lane.confidence_shift == -3


# A drive whose lines only the network sees.


def pink_lines() -> tuple:
    changes = {"colour": PINK, "width_m": 0.3, "dash_m": None}
    return tuple(replace(line, **changes) for line in lane_lines()[:2])


MOTION = Motion(60.0, 25.0, offset_m=0.3)
HIDDEN = PaintedDrive(s_bend(), pink_lines(), motion=MOTION, camera=SMALL)
FRAMES = 10


@pytest.fixture(scope="module")
def hidden(tmp_path_factory) -> Path:
    """A folder with the drive, a still of it, its lens, and the network."""
    folder = tmp_path_factory.mktemp("hidden")
    write_drive(folder / "drive.mp4", HIDDEN, FRAMES)
    write_image(folder / "stills" / "a.png", HIDDEN.frame(0.0))
    lanes.save_camera(replace(SMALL, pose=None), folder / "lens.yaml")
    write_model(folder / "pink.onnx", {"lines": PINK_PAINT})
    return folder


def true_offset_m(time_s: float = 0.0) -> float:
    return HIDDEN.truth(time_s).offset_m


def test_without_the_network_no_sure_lane_is_found():
    lane = lanes.find_lane(HIDDEN.frame(0.0), SMALL)
    assert lane is None or lane.confidence < SURE_CONFIDENCE


def test_with_the_network_the_lines_are_tracked(hidden):
    tracker = LaneTracker(SMALL, markings=load_markings(f"{hidden}/pink.onnx,own"))
    for frame in range(4):
        time_s = frame / 25
        lane = tracker.update(HIDDEN.frame(time_s))
        assert lane.offset_m == pytest.approx(true_offset_m(time_s), abs=0.05)
    assert lane.state == "tracking"
    assert lane.confidence > 0.9
    assert lane.width_m == pytest.approx(3.6, abs=0.05)


# Every command takes markings that only the network sees.


@pytest.fixture
def command(hidden, run):
    """A function that runs a command with a network; returns its output."""

    def command(name: str, *arguments: object, network: str = "pink.onnx,own") -> str:
        camera = ("--camera", hidden / "drive.yaml")
        markings = ("--markings", hidden / network)
        status, out, err = run(name, *camera, *markings, *arguments)
        assert status == 0, err
        return out

    return command


def test_annotate_finds_the_lane_of_videos_and_stills(hidden, tmp_path, command):
    sources = hidden / "drive.mp4", hidden / "stills"
    command("annotate", *sources, "-o", tmp_path, network="pink.onnx")
    offset_m = read_telemetry(tmp_path / "drive.csv")["offset_m"][-1]
    expected_m = true_offset_m((FRAMES - 1) / 25)
    assert offset_m == pytest.approx(expected_m, abs=0.06)
    offset_m = read_telemetry(tmp_path / "pictures.csv")["offset_m"][-1]
    assert offset_m == pytest.approx(true_offset_m(), abs=0.06)
    assert f"{hidden}/pink.onnx" in (tmp_path / "drive.html").read_text()


@pytest.mark.slow
def test_detect_finds_a_lane_in_each_image(hidden, tmp_path, command):
    sources = hidden / "stills", hidden / "drive.mp4"
    out = command("detect", *sources, "-o", tmp_path / "lanes.jsonl")
    assert f"{FRAMES + 1} pictures, no lane in 0" in out


@pytest.mark.slow
def test_explain_shows_paint(hidden, tmp_path, command):
    still = hidden / "stills" / "a.png"
    out = command("explain", still, "-o", tmp_path / "explained.png")
    assert re.search(r"probability of paint up to [6-9]\d%", out)
    assert "failed at" not in out


@pytest.mark.slow
def test_pose_uses_the_lane(hidden, tmp_path, command):
    still = hidden / "stills" / "a.png"
    lens = ("--camera", hidden / "lens.yaml")
    assert "1 of 1 used" in command("pose", still, *lens, "-o", tmp_path / "a.yaml")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("network", "right"),
    [
        ("pink.onnx", "1.000"),
        ("pink.onnx,own", "1.000"),
        ("blind.onnx", "0.000"),
    ],
)
def test_benchmark_scores_the_network(hidden, tmp_path, command, network, right):
    """The labels are what the network that sees the lines finds."""
    labels = hidden / "stills" / "labels.jsonl"
    rows = ("--rows", "200:350:10", "-o", labels)
    command("detect", hidden / "stills" / "a.png", *rows)
    labels.write_text(labels.read_text().replace(f"{labels.parent}/", ""))
    write_model(hidden / "blind.onnx", {"lines": threshold(-1, -1, -1)})

    scored = ("--labels", labels, "--system", "tracker")
    out = command("benchmark", *scored, network=network)
    (line,) = [row for row in out.splitlines() if row.startswith("tracker")]
    assert line.split()[1:3] == ["1", right]


def test_finished_drives_depend_on_the_network(hidden, tmp_path):
    video = hidden / "drive.mp4"
    plain = DriveSettings(output=tmp_path, camera=SMALL)
    source = load_markings(hidden / "pink.onnx")
    without = fingerprint(video, plain)
    found = fingerprint(video, replace(plain, markings=source))
    assert without["settings"]["markings"] == "None"
    assert source.function.digest in found["settings"]["markings"]
    assert without["versions"].keys() < found["versions"].keys()
