"""Markings from any network: an ONNX file that the tests make, and functions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import lanes
from lanes.annotation import DriveSettings
from lanes.detect.confidence import SURE_CONFIDENCE
from lanes.detect.markings import load_markings
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
from tests.support.painted_roads import ASPHALT, Arc, Road, dashcam

CAMERA = dashcam()
LEFT_M, RIGHT_M = 1.8, -1.7
AHEAD_M = np.array([6.0, 10.0, 15.0, 20.0, 30.0])
# As bright as the road, and less yellow: only a network that looks for its colour sees it.
PINK = (141, 68, 141)
PINK_PAINT = threshold(0.5, -1.0, 0.5, road=0.0, paint=73 / 255)


def wide_mask(road: Road, half_m: float = 0.25, left_m: float = 0.0) -> np.ndarray:
    """The true mask of both lines, dilated to twice `half_m` and moved to the left."""
    return road.cover(lambda x, y: np.minimum(*(np.abs(y - m - left_m) for m in (LEFT_M, RIGHT_M))) < half_m)[..., 0]


def errors_m(lane: lanes.Lane, arc: Arc) -> np.ndarray:
    return np.abs(lane.lateral_m(AHEAD_M) - [arc.lateral_m(side_m, AHEAD_M) for side_m in (LEFT_M, RIGHT_M)])


class TestMask:
    @pytest.mark.parametrize(("arc", "size"), [(Arc(1 / 150, offset_m=0.4), (640, 360)), (Arc(-1 / 80), (320, 180))])
    def test_a_wide_mask_gives_the_lane_of_a_road_without_visible_paint(self, arc, size):
        road = Road(CAMERA, arc=arc)
        mask, image = cv2.resize(wide_mask(road), size, interpolation=cv2.INTER_AREA), road.image()
        found = detect_still(image, CAMERA, markings=lambda _: mask)
        lane, stripes = found.lane, found.evidence.stripes
        assert errors_m(lane, arc).max() < 0.05 and lane.confidence > 0.9
        assert [line.kind or line.colour for line in lane.lines] == [None, None]
        # a stripe is as exact as a pixel of the mask
        exact_m = np.hypot(0.04, stripes.x_m / CAMERA.matrix[0, 0])
        np.testing.assert_allclose(stripes.std_m / exact_m, CAMERA.width / size[0], rtol=1e-3)

    def test_visible_paint_gives_the_place_and_the_kind_that_a_mask_lacks(self):
        """The mask lies 6 cm to the left of dashes; between them there is a mask, too."""
        road = Road(CAMERA).lines(LEFT_M, RIGHT_M, dash_m=(3.0, 9.0))
        mask = wide_mask(road, 0.2, 0.06)
        found = detect_still(road.image(), CAMERA, markings=lambda _: mask)
        stripes = found.evidence.stripes.select(found.evidence.stripes.x_m < 20)
        off_m = stripes.y_m - np.where(stripes.y_m > 0, LEFT_M, RIGHT_M)
        assert np.quantile(np.abs(off_m[stripes.measurable]), 0.85) < 0.02
        assert np.median(off_m[~stripes.measurable]) == pytest.approx(0.06, abs=0.01)
        assert [(line.kind, line.colour) for line in found.lane.lines] == [("dashed", "white")] * 2

    def test_with_own_a_mask_without_markings_leaves_what_our_network_finds(self):
        """Paint that is too faint for the band filter. Without our stripes there is none."""
        image = Road(CAMERA, noise=5.0).lines(LEFT_M, RIGHT_M, colour=tuple(np.add(ASPHALT, 8))).image()

        def nothing(_: np.ndarray) -> np.ndarray:
            return np.zeros((9, 16))

        assert lanes.find_lane(image, CAMERA, markings=nothing) is None
        nothing.with_own = True
        lane = lanes.find_lane(image, CAMERA, markings=nothing)
        np.testing.assert_allclose(lane.model, lanes.find_lane(image, CAMERA).model, atol=1e-3)

    @pytest.mark.parametrize(
        ("mask", "words"),
        [
            (np.full((9, 16), np.nan), "with values from nan to nan"),
            (np.full((9, 16), 255, np.uint8), "from 255 to 255; a mask has .* probabilities, 0 to 1"),
            (np.zeros((9, 16, 2)), r"shape \(9, 16, 2\)"),
            (None, r"shape \(\)"),
        ],
    )
    def test_what_is_no_mask_is_refused(self, mask, words):
        with pytest.raises(LaneError, match=words):
            lanes.find_lane(np.zeros((360, 640, 3), np.uint8), CAMERA, markings=lambda _: mask)


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """A road with both lines."""
    return Road(CAMERA).lines(LEFT_M, RIGHT_M).image()


class TestModel:
    """An ONNX file and the YAML file beside it."""

    @pytest.mark.parametrize(
        ("channels", "entries", "sigmoid"),
        [
            (threshold(), {"values": "probabilities"}, True),
            (threshold(), {"input_size": [320, 192]}, False),
            (threshold(1, 0, 0), {"colour_order": "RGB"}, False),
            (threshold(0, 0, 1), {"colour_order": "BGR"}, False),
            # one channel: the logarithm of the odds
            (tuple(part[1:] for part in threshold()), {"channel": 0}, False),
            # the probabilities of two kinds of markings add up
            (tuple(np.concatenate([part, part[1:]]) for part in threshold()), {"channel": [1, 2]}, False),
            # normalised like torchvision: (pixel / 255 - 0.5) / 0.25
            (threshold(road=(98 / 255 - 0.5) / 0.25, paint=(215 / 255 - 0.5) / 0.25),
             {"mean": [127.5] * 3, "scale": [4 / 255] * 3}, False),
        ],
        ids=["probabilities", "small", "RGB", "BGR", "one channel", "two kinds", "normalised"],
    )  # fmt: skip
    def test_it_gives_the_mask_and_the_lane(self, image, tmp_path, channels, entries, sigmoid):
        file = write_model(tmp_path / "m.onnx", {"lines": channels}, LOGITS | entries, sigmoid=sigmoid)
        model = load_markings(file)
        mask, (width, height) = model(image), entries.get("input_size", (640, 360))
        bright = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR).mean(axis=2)
        assert mask.shape == (height, width)
        assert mask[bright > 190].min() > 0.8 and mask[bright < 110].max() < 0.2
        lane = lanes.find_lane(image, CAMERA, markings=model)
        assert errors_m(lane, Arc()).max() < 0.05 and lane.left.colour == "white"

    def test_of_several_outputs_one_is_named_and_a_new_file_of_the_same_name_is_read(self, image, tmp_path):
        outputs = {"area": threshold(-1, 0, 0), "lines": threshold()}
        file = write_model(tmp_path / "m.onnx", outputs, LOGITS | {"output": "lines"})
        assert lanes.find_lane(image, CAMERA, markings=load_markings(file)).confidence > 0.9
        before = load_markings(file)(image)
        write_model(file, {"lines": threshold(-1, 0, 0)})
        assert np.abs(load_markings(file)(image) - before).max() > 0.5

    def test_the_confidence_has_its_own_constant(self, image, tmp_path):
        model = load_markings(write_model(tmp_path / "m.onnx", {"a": threshold()}, LOGITS | {"confidence_shift": -3}))
        unshifted = replace(model, confidence_shift=0.0)
        plain, shifted = (lanes.find_lane(image, CAMERA, markings=markings) for markings in (unshifted, model))
        assert plain.log_odds - shifted.log_odds == pytest.approx(3.0, abs=0.01)
        assert LaneTracker(CAMERA, markings=model).update(image).confidence_shift == -3


# A drive whose lines only the network sees.
HIDDEN = PaintedDrive(
    s_bend(),
    tuple(replace(line, colour=PINK, width_m=0.3, dash_m=None) for line in lane_lines()[:2]),
    motion=Motion(60.0, 25.0, offset_m=0.3),
    camera=SMALL,
)
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


class TestDrive:
    """Every command takes markings that only the network sees."""

    def test_only_with_the_network_the_lines_are_found_and_tracked(self, hidden):
        lane = lanes.find_lane(HIDDEN.frame(0.0), SMALL)
        assert lane is None or lane.confidence < SURE_CONFIDENCE
        tracker = LaneTracker(SMALL, markings=load_markings(f"{hidden}/pink.onnx,own"))
        for frame in range(4):
            lane = tracker.update(HIDDEN.frame(frame / 25))
            assert lane.offset_m == pytest.approx(true_offset_m(frame / 25), abs=0.05)
        assert lane.state == "tracking" and lane.confidence > 0.9 and lane.width_m == pytest.approx(3.6, abs=0.05)

    def test_a_video_and_stills_are_annotated_and_the_report_names_the_network(self, hidden, tmp_path, run):
        options = "--camera", hidden / "drive.yaml", "--markings", hidden / "pink.onnx", "-o", tmp_path
        assert run("annotate", hidden / "drive.mp4", hidden / "stills", *options)[0] == 0
        for name, last in (("drive.csv", (FRAMES - 1) / 25), ("pictures.csv", 0.0)):
            telemetry = read_telemetry(tmp_path / name)
            assert telemetry["offset_m"][-1] == pytest.approx(true_offset_m(last), abs=0.06)
        assert f"{hidden}/pink.onnx" in (tmp_path / "drive.html").read_text()

    @pytest.mark.slow
    def test_lines_are_detected_explained_show_the_pose_and_are_scored(self, hidden, tmp_path, run):
        camera, markings = ("--camera", hidden / "drive.yaml"), ("--markings", f"{hidden}/pink.onnx,own")
        still, labels = write_image(tmp_path / "a.png", HIDDEN.frame(0.0)), tmp_path / "labels.jsonl"
        rows = ("--rows", "200:350:10", "-o", labels)
        _, out, _ = run("detect", still, hidden / "drive.mp4", *camera, *markings, *rows)
        assert f"{FRAMES + 1} pictures, no lane in 0" in out
        _, out, _ = run("explain", still, *camera, *markings, "-o", tmp_path / "explained.png")
        assert "probability of paint up to 9" in out and "failed at" not in out
        _, out, _ = run("pose", still, "--camera", hidden / "lens.yaml", *markings, "-o", tmp_path / "camera.yaml")
        assert "1 of 1 used" in out
        labels.write_text(labels.read_text().splitlines()[-1].replace(f"{tmp_path}/", ""))
        blind = "--markings", write_model(tmp_path / "blind.onnx", {"lines": threshold(-1, -1, -1)})
        for used, right in ((markings, "1.000"), (blind, "0.000")):
            _, out, _ = run("benchmark", "--labels", labels, "--system", "tracker", *camera, *used)
            (line,) = (line for line in out.splitlines() if line.startswith("tracker"))
            assert line.split()[1:3] == ["1", right]

    def test_finished_drives_depend_on_them(self, hidden, tmp_path):
        model, settings = load_markings(hidden / "pink.onnx"), DriveSettings(output=tmp_path, camera=SMALL)
        prints = [fingerprint(hidden / "drive.mp4", replace(settings, markings=m))["settings"] for m in (None, model)]
        assert prints[0]["markings"] == "None" and model.digest in prints[1]["markings"]
