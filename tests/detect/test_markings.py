"""Markings from any network: an ONNX file that the tests make, the network of this project, and functions."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import lanes
from benchmark.evaluation import prepare_drive
from benchmark.runner import cached_estimates
from benchmark.scored_drive import drive_from_video
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.confidence import SURE_CONFIDENCE
from lanes.detect.evidence import find_evidence
from lanes.detect.markings import Mask, find_mask, load_markings, thin
from lanes.detect.network import network_strengths
from lanes.detect.paint import lightness, strength_weight
from lanes.drive import DriveSettings
from lanes.errors import LaneError
from lanes.files import read_telemetry, read_text
from lanes.images import write_image
from lanes.many import fingerprint
from lanes.pose import estimate_pose
from lanes.stills import detect_still
from lanes.tracking.tracker import LaneTracker
from simulator.rendering.drive import Motion
from tests.support.clips import write_drive
from tests.support.command_line import main
from tests.support.onnx_file import threshold, write_model
from tests.support.painted_drive import GREY, SMALL, PaintedDrive, lane_lines, s_bend
from tests.support.painted_roads import ASPHALT, Arc, Road, dashcam

CAMERA = dashcam()
VIEW = BirdsEyeView(CAMERA)
LEFT_M, RIGHT_M = 1.8, -1.7
AHEAD_M = np.array([6.0, 10.0, 15.0, 20.0, 30.0])
LOGITS = {"input_size": [640, 360], "channel": 1, "values": "logits"}
# As bright as the road, and less yellow: only a network that looks for its colour sees it.
PINK = (141, 68, 141)
PINK_PAINT = threshold(0.5, -1.0, 0.5, road=0.0, paint=73 / 255)


def wide_mask(road: Road, half_m: float = 0.25) -> np.ndarray:
    """The true mask of both lines, dilated to twice `half_m`."""
    return road.cover(lambda x, y: np.minimum(np.abs(y - LEFT_M), np.abs(y - RIGHT_M)) < half_m)[..., 0]


def errors_m(lane: lanes.Lane, arc: Arc) -> np.ndarray:
    return np.abs(lane.lateral_m(AHEAD_M) - [arc.lateral_m(side_m, AHEAD_M) for side_m in (LEFT_M, RIGHT_M)])


class TestMask:
    @pytest.mark.parametrize("size", [None, (640, 360), (320, 180)])
    @pytest.mark.parametrize(
        "arc", [Arc(), Arc(1 / 150, offset_m=0.4), Arc(-1 / 80)], ids=["straight", "left", "right"]
    )
    def test_a_wide_mask_gives_the_lane_of_a_road_without_visible_paint(self, arc, size):
        road = Road(CAMERA, arc=arc)
        mask, image = wide_mask(road), road.image()
        mask = mask if size is None else cv2.resize(mask, size, interpolation=cv2.INTER_AREA)
        lane = lanes.find_lane(image, CAMERA, markings=lambda _: mask)
        assert errors_m(lane, arc).max() < 0.05 and lane.confidence > 0.9
        assert [line.kind or line.colour for line in lane.lines] == [None, None]
        unseen = lanes.find_lane(image, CAMERA)
        assert unseen is None or unseen.confidence < 0.5

    def test_stripes_are_where_the_band_filter_sees_them_and_profiles_are_measured_only_there(self):
        """The mask lies 6 cm to the left of dashes; between them there is a mask, too."""
        road = Road(CAMERA).lines(LEFT_M, RIGHT_M, dash_m=(3.0, 9.0))
        mask = road.cover(lambda x, y: np.minimum(np.abs(y - LEFT_M - 0.06), np.abs(y - RIGHT_M - 0.06)) < 0.2)[..., 0]
        found = detect_still(road.image(), CAMERA, markings=lambda _: mask)
        stripes = found.evidence.stripes.select(found.evidence.stripes.x_m < 20)
        off_m = stripes.y_m - np.where(stripes.y_m > 0, LEFT_M, RIGHT_M)
        assert np.quantile(np.abs(off_m[stripes.measurable]), 0.85) < 0.02
        assert np.median(off_m[~stripes.measurable]) == pytest.approx(0.06, abs=0.01)
        assert 0.2 < stripes.measurable.mean() < 0.6
        assert [(line.kind, line.colour) for line in found.lane.lines] == [("dashed", "white")] * 2

    def test_a_mask_is_thinned_to_the_centres_of_its_stripes(self):
        """Of a wide and of a narrow stripe, but not of an area."""
        mask = np.zeros(VIEW.shape, np.float32)
        mask[:, 200:210], mask[:, 259:262], mask[:, 60:100] = 0.8, 0.4, 1.0
        thinned = thin(mask, VIEW)
        inside = VIEW.seen[:, 195:265].all(axis=1)
        columns = np.flatnonzero(thinned[inside].any(axis=0))
        assert set(columns) == {203, 204, 205, 206, 259, 260, 261}
        weight = strength_weight(thinned[inside])
        assert weight[:, 205] == pytest.approx(0.8, abs=0.02) and weight[:, 260] == pytest.approx(0.4, abs=0.02)

    def test_with_own_no_stripe_counts_twice_and_a_mask_adds_those_that_only_it_sees(self):
        """The left line is painted, the right one is only in the mask."""
        road = Road(CAMERA).lines(LEFT_M)
        image, mask = road.image(), 0.9 * wide_mask(road)
        own = find_evidence(image, VIEW).stripes
        joined = find_evidence(image, VIEW, mask=Mask(mask, True, 0.0)).stripes
        near_left = np.abs(joined.y_m - LEFT_M) < 0.5
        own_left = np.abs(own.y_m - LEFT_M) < 0.5
        assert near_left.sum() == own_left.sum() and (joined.weight[near_left] >= own.weight[own_left] - 0.03).all()
        assert (np.abs(joined.y_m - RIGHT_M) < 0.1).sum() > 70
        only_mask = find_evidence(image, VIEW, mask=Mask(mask, False, 0.0)).stripes
        assert len(only_mask) <= len(joined) and only_mask.measurable[only_mask.y_m > 0].mean() > 0.9

    def test_with_own_a_mask_without_markings_leaves_what_our_network_finds(self):
        """Paint that is too faint for the band filter. Without our stripes there is none."""
        image = Road(CAMERA, noise=5.0).lines(LEFT_M, RIGHT_M, colour=tuple(np.add(ASPHALT, 8))).image()

        def nothing(_: np.ndarray) -> np.ndarray:
            return np.zeros((9, 16))

        assert lanes.find_lane(image, CAMERA, markings=nothing) is None
        nothing.with_own = True
        lane = lanes.find_lane(image, CAMERA, markings=nothing)
        np.testing.assert_allclose(lane.model, lanes.find_lane(image, CAMERA).model, atol=1e-3)

    def test_the_network_of_this_project_is_such_a_function(self):
        """Its strengths in the view are put back into the image; the lane is the same as with its own stripes."""
        image = Road(CAMERA).lines(LEFT_M, RIGHT_M).image()
        rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width].reshape(2, -1)
        with np.errstate(all="ignore"):
            x_m, y_m = CAMERA.pixels_to_road(np.column_stack([columns, rows]).astype(float)).T
            row = np.log(VIEW.far_m / x_m) / np.log1p(VIEW.growth)
        at = (np.nan_to_num(a, nan=-9).reshape(CAMERA.size[::-1]) for a in ((VIEW.y_m[0] - y_m) / VIEW.cell_m, row))
        column_map, row_map = (a.astype(np.float32) for a in at)

        def ours(image: np.ndarray) -> np.ndarray:
            probability = strength_weight(network_strengths(image, VIEW)[0])
            return cv2.remap(probability.astype(np.float32), column_map, row_map, cv2.INTER_LINEAR)

        lane = lanes.find_lane(image, CAMERA, markings=ours)
        assert errors_m(lane, Arc()).max() < 0.05 and lane.confidence > 0.9

    @pytest.mark.parametrize(
        ("mask", "words"),
        [
            (np.full((9, 16), np.nan), r"broken: returned .*\(9, 16\) with values from nan to nan"),
            (np.full((9, 16), 255, np.uint8), "from 255 to 255; a mask has .* probabilities, 0 to 1"),
            (np.full((9, 16), -3.0), "from -3 to -3"),
            (np.zeros((9, 16, 2)), r"shape \(9, 16, 2\)"),
            (np.zeros((0, 16)), r"shape \(0, 16\)"),
            (None, r"shape \(\)"),
        ],
    )
    def test_what_is_no_mask_is_refused(self, mask, words):
        def broken(_: np.ndarray) -> np.ndarray:
            return mask

        with pytest.raises(LaneError, match=words):
            find_mask(np.zeros((9, 16, 3), np.uint8), broken)


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """A road with both lines."""
    return Road(CAMERA).lines(LEFT_M, RIGHT_M).image()


class TestModel:
    """An ONNX file and the YAML file beside it."""

    @pytest.mark.parametrize(
        ("channels", "entries", "sigmoid"),
        [
            (threshold(), {}, False),
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
        ids=["logits", "probabilities", "small", "RGB", "BGR", "one channel", "two kinds", "normalised"],
    )  # fmt: skip
    def test_it_gives_the_mask_and_the_lane(self, image, tmp_path, channels, entries, sigmoid):
        file = write_model(tmp_path / "m.onnx", {"lines": channels}, LOGITS | entries, sigmoid=sigmoid)
        model = load_markings(file)
        mask = model(image)
        width, height = entries.get("input_size", (640, 360))
        small = cv2.resize(image, (width, height), interpolation=cv2.INTER_LINEAR)
        bright = small.mean(axis=2)
        assert mask.shape == (height, width)
        assert mask[bright > 190].min() > 0.8 and mask[bright < 110].max() < 0.2
        lane = lanes.find_lane(image, CAMERA, markings=model)
        assert errors_m(lane, Arc()).max() < 0.05 and lane.left.colour == "white"

    def test_of_several_outputs_one_is_named(self, image, tmp_path):
        outputs = {"area": threshold(-1, 0, 0), "lines": threshold()}
        model = load_markings(write_model(tmp_path / "m.onnx", outputs, LOGITS | {"output": "lines"}))
        assert lanes.find_lane(image, CAMERA, markings=model).confidence > 0.9
        with pytest.raises(LaneError, match="the outputs are area, lines; write `output:`"):
            load_markings(write_model(tmp_path / "m.onnx", outputs, LOGITS))

    def test_it_can_be_sent_to_another_process_and_a_new_file_of_the_same_name_is_read(self, image, tmp_path):
        file = write_model(tmp_path / "m.onnx", {"lines": threshold()}, LOGITS)
        model = load_markings(file)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(model))(image), model(image))
        before = model(image)
        write_model(file, {"lines": threshold(-1, 0, 0)}, LOGITS)
        other = load_markings(file)
        assert repr(other) != repr(model) and np.abs(other(image) - before).max() > 0.5

    def test_the_confidence_has_its_own_constant(self, image, tmp_path):
        model = load_markings(write_model(tmp_path / "m.onnx", {"a": threshold()}, LOGITS | {"confidence_shift": -3}))
        shifted = lanes.find_lane(image, CAMERA, markings=model)
        plain = lanes.find_lane(image, CAMERA, markings=replace(model, confidence_shift=0.0))
        odds = [lane.confidence / (1 - lane.confidence) for lane in (plain, shifted)]
        assert np.log(odds[0] / odds[1]) == pytest.approx(3.0, abs=0.01)
        tracker = LaneTracker(CAMERA, markings=model)
        assert tracker.update(image).confidence_shift == -3

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            (None, "no such YAML file.*write what the network needs, such as `input_size: .*own_network.md"),
            ("", "the file is empty"),
            ("[1, 2]", "must be a mapping"),
            ("input_size: [640, 360]\nchannel: 1", "missing 1 required positional argument: 'values'"),
            ("input_size: [640, 360]\nchannel: 1\nvalues: logit", "values are logits or probabilities"),
            ("input_size: [640, 360]\nchannel: 1\nvalues: logits\ncolor: RGB", "unexpected keyword argument 'color'"),
            ("input_size: [640, 360]\nchannel: 7\nvalues: logits", r"shape \(1, 2, 360, 640\) has no channel 7"),
            ("input_size: [640, 360]\nchannel: 1\nvalues: probabilities", "returned .* with values from"),
            ("input_size: [640, 360]\nchannel: 1\nvalues: logits\nscale: 1/255", "could not convert string to float"),
            ("input_size: [640, 360]\nchannel: 1\nvalues: logits\nmean: [1, 2]", "could not be broadcast"),
            ("input_size: 640x360\nchannel: 1\nvalues: logits", "size"),
            ("input_size: [640, 360]\nchannel: 1\nvalues: logits\noutput: x", "the outputs are lines; write `output:`"),
            ("a: [", "expected the node content"),
        ],
    )
    def test_errors_name_the_yaml_file_and_what_to_write(self, tmp_path, text, words):
        file = write_model(tmp_path / "m.onnx", {"lines": threshold()}, None)
        if text is not None:
            file.with_suffix(".yaml").write_text(text)
        with pytest.raises(LaneError, match=rf"^{tmp_path}/m\.yaml: cannot be used \(.*{words}"):
            load_markings(file)

    def test_a_file_that_is_no_network_and_one_that_is_missing_are_refused(self, tmp_path):
        file = write_model(tmp_path / "m.onnx", {"lines": threshold()}, LOGITS)
        file.write_bytes(file.read_bytes()[:100])
        with pytest.raises(LaneError, match="m.yaml: cannot be used .*parse onnx"):
            load_markings(file)
        with pytest.raises(FileNotFoundError, match="no.onnx: there is no such ONNX file"):
            load_markings(tmp_path / "no.onnx,own")


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
    """A folder with the drive, stills of it, its camera with and without pose, and the network."""
    folder = tmp_path_factory.mktemp("hidden")
    write_drive(folder / "drive.mp4", HIDDEN, FRAMES)
    write_image(folder / "stills" / "a.png", HIDDEN.frame(0.0))
    lanes.save_camera(replace(SMALL, pose=None), folder / "lens.yaml")
    write_model(folder / "pink.onnx", {"lines": PINK_PAINT}, LOGITS)
    return folder


def true_offset_m(time_s: float = 0.0) -> float:
    return HIDDEN.truth(time_s).offset_m


class TestDrive:
    """Everything works with markings that only the network sees."""

    def test_only_the_network_sees_these_lines(self, hidden):
        assert np.ptp(lightness(np.uint8([[PINK, GREY]]))) < 2
        lane = lanes.find_lane(HIDDEN.frame(0.0), SMALL)
        assert lane is None or lane.confidence < SURE_CONFIDENCE
        found = lanes.find_lane(HIDDEN.frame(0.0), SMALL, markings=load_markings(hidden / "pink.onnx"))
        assert found.confidence > 0.9 and found.offset_m == pytest.approx(true_offset_m(), abs=0.05)

    @pytest.mark.parametrize("own", ["", ",own"])
    def test_the_tracker_follows_them(self, hidden, own):
        tracker = LaneTracker(SMALL, markings=load_markings(f"{hidden}/pink.onnx{own}"))
        for frame in range(FRAMES):
            lane = tracker.update(HIDDEN.frame(frame / 25))
            assert lane.offset_m == pytest.approx(true_offset_m(frame / 25), abs=0.05)
        assert lane.state == "tracking" and lane.confidence > 0.9 and lane.width_m == pytest.approx(3.6, abs=0.05)

    @pytest.mark.slow
    def test_the_camera_pose_is_estimated_with_them(self, hidden):
        images = [HIDDEN.frame(time_s) for time_s in (0.0, 3.0, 6.0)]
        model, lens = load_markings(hidden / "pink.onnx"), replace(SMALL, pose=None)
        estimate = estimate_pose(images, lens, lane_width_m=3.6, markings=model)
        assert estimate.frames_used == 3 and estimate.pose.height_m == pytest.approx(1.3, abs=0.05)
        assert estimate.pose.pitch_rad == pytest.approx(SMALL.pose.pitch_rad, abs=np.radians(0.5))
        assert estimate_pose(images, lens, lane_width_m=3.6).frames_used <= 1
        still = estimate_pose(images[0], lens, markings=model).still
        assert still.lane.confidence > 0.5

    def test_a_video_and_stills_are_annotated_and_the_report_names_the_network(self, hidden, tmp_path):
        options = "--camera", hidden / "drive.yaml", "--markings", hidden / "pink.onnx", "-o", tmp_path
        assert main(["annotate", *map(str, (hidden / "drive.mp4", hidden / "stills", *options))]) == 0
        for name, last in (("drive.csv", (FRAMES - 1) / 25), ("pictures.csv", 0.0)):
            telemetry = read_telemetry(tmp_path / name)
            assert telemetry["offset_m"][-1] == pytest.approx(true_offset_m(last), abs=0.06)
        assert f"{hidden}/pink.onnx" in read_text(tmp_path / "drive.html", "report")

    @pytest.mark.slow
    def test_lines_are_detected_and_explained(self, hidden, tmp_path, capsys):
        options = "--camera", hidden / "drive.yaml", "--markings", f"{hidden}/pink.onnx,own"
        still = hidden / "stills" / "a.png"
        assert main(["detect", *map(str, (still, hidden / "drive.mp4", *options, "-o", tmp_path / "lanes.jsonl"))]) == 0
        assert f"{FRAMES + 1} pictures, no lane in 0" in capsys.readouterr().out
        for file in (still, hidden / "drive.mp4"):
            assert main(["explain", *map(str, (file, *options, "-o", tmp_path / "explained.png"))]) == 0
            out = capsys.readouterr().out
            assert "probability of paint up to 9" in out and "failed at" not in out
        options = "--camera", hidden / "lens.yaml", *options[2:], "-o", tmp_path / "camera.yaml"
        assert main(["pose", *map(str, (still, *options))]) == 0
        assert "1 of 1 used" in capsys.readouterr().out

    def test_the_benchmark_scores_with_them_and_finished_drives_depend_on_them(self, hidden, tmp_path):
        drive, model = drive_from_video(hidden / "drive.mp4"), load_markings(hidden / "pink.onnx")
        true, paths = read_telemetry(hidden / "drive.csv")["offset_m"], set()
        for markings in (model, replace(model, with_own=True)):
            prepared = prepare_drive(drive, markings=markings)
            for system in ("tracker", "detector"):
                paths.add(path := cached_estimates(prepared, system, tmp_path, 1))
                np.testing.assert_allclose(np.load(path)["offset_m"], true, atol=0.06)
        assert len(paths) == 4
        settings = DriveSettings(output=tmp_path, camera=SMALL)
        prints = [fingerprint(hidden / "drive.mp4", replace(settings, markings=m))["settings"] for m in (None, model)]
        assert prints[0]["markings"] == "None" and model.digest in prints[1]["markings"]

    def test_labelled_stills_are_scored_with_them(self, hidden, tmp_path, capsys):
        options = "--camera", hidden / "drive.yaml", "--markings", hidden / "pink.onnx"
        write_image(tmp_path / "a.png", HIDDEN.frame(0.0))
        rows = "--rows", "200:350:10", "-o", tmp_path / "labels.jsonl"
        assert main(["detect", *map(str, (tmp_path / "a.png", *options, *rows))]) == 0
        (tmp_path / "labels.jsonl").write_text(
            read_text(tmp_path / "labels.jsonl", "labels").replace(f"{tmp_path}/", "")
        )
        labels = "--labels", tmp_path / "labels.jsonl", "--system", "tracker"
        for more, matched in ((options, "1.000"), (options[:2], "0.000")):
            assert main(["benchmark", *map(str, (*labels, *more))]) == 0
            (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("tracker"))
            assert matched in line.split()

    def test_a_wrong_file_is_an_error_with_exit_status_2(self, hidden, tmp_path, capsys):
        assert main(["annotate", str(hidden / "stills"), "--markings", "nothing.onnx", "-o", str(tmp_path)]) == 2
        assert "nothing.onnx: there is no such ONNX file" in capsys.readouterr().err
