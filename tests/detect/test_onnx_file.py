"""ONNX files as exporters write them, with the command: channels last, uint8, weights in a second file; bad ones."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest

import lanes
from lanes.camera.model import save_camera
from lanes.detect.markings import find_mask, load_markings, run_network
from lanes.errors import LaneError
from lanes.video.images import write_image
from tests.support.onnx_file import LOGITS, threshold, write_model
from tests.support.painted_roads import Road, dashcam

CAMERA = dashcam()
IMAGE = Road(CAMERA).lines(1.8, -1.7).image()
LINES, OF_PIXELS = {"lines": threshold()}, {"lines": threshold(1 / 765, 1 / 765, 1 / 765)}


@pytest.fixture
def detect(tmp_path, run):
    """A function that detects the lane in a still with a network; returns status, confidence, and the error."""
    camera, still = save_camera(CAMERA, tmp_path / "camera.yaml"), write_image(tmp_path / "still.png", IMAGE)

    def detect(model):
        output = tmp_path / "lanes.jsonl"
        output.unlink(missing_ok=True)
        status, _, err = run("detect", "--markings", model, "--camera", camera, still, "-o", output)
        return status, json.loads(output.read_text())["confidence"] if output.exists() else None, err

    return detect


@pytest.mark.parametrize("last", ["", "input", "output", "input output"])
@pytest.mark.parametrize(("pixels", "size"), [(False, None), (True, (640, 360))])
def test_channels_last_and_pixels_are_recognised_from_the_input(tmp_path, detect, last, pixels, size):
    outputs = OF_PIXELS if pixels else LINES
    status, confidence, err = detect(write_model(tmp_path / "m.onnx", outputs, last=last, pixels=pixels, size=size))
    assert status == 0 and confidence > 0.9, err


def test_weights_in_a_second_file_are_those_beside_the_model(tmp_path, detect, monkeypatch):
    """Not those in the working directory. The digest is that of both files."""
    folder, elsewhere = tmp_path / "model", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    model = write_model(folder / "m.onnx", LINES, weights_in="m.onnx.data")
    (elsewhere / "m.onnx.data").write_bytes(bytes((folder / "m.onnx.data").stat().st_size))
    monkeypatch.chdir(elsewhere)
    status, confidence, err = detect(model)
    assert status == 0 and confidence > 0.9, err
    inside, before = load_markings(write_model(elsewhere / "one.onnx", LINES)), load_markings(model)
    np.testing.assert_array_equal(inside(IMAGE), before(IMAGE))
    shutil.copy(elsewhere / "m.onnx.data", folder)
    assert load_markings(model).digest != before.digest
    assert detect(model)[1] < 0.5


@pytest.mark.parametrize("changed", ["m.onnx", "m.onnx.data"])
def test_the_digest_is_compared_where_the_network_is_loaded(tmp_path, changed):
    """A worker on another machine may have another file of this name."""
    model = load_markings(write_model(tmp_path / "m.onnx", LINES, weights_in="m.onnx.data"))
    other = write_model(tmp_path / "other.onnx", {"lines": threshold(1, 0, 0)}, None, weights_in="other.onnx.data")
    shutil.copy(other if changed == "m.onnx" else tmp_path / "other.onnx.data", tmp_path / changed)
    inputs = np.zeros((1, 3, 360, 640), np.float32)
    lanes.detect.markings.read_network.cache_clear()
    with pytest.raises(LaneError, match=r"m\.onnx: changed during the run"):
        run_network(model.file, inputs, digest=model.digest)


@pytest.mark.parametrize("location", ["../m.data", "inner/../../m.data", "{}/m.data"])
def test_weights_outside_of_the_folder_are_refused(tmp_path, detect, location):
    """The file is there, but the author of a model must not choose what is read."""
    (tmp_path / "model" / "inner").mkdir(parents=True)
    status, _, err = detect(write_model(tmp_path / "model" / "m.onnx", LINES, weights_in=location.format(tmp_path)))
    assert status == 2 and "names weights outside of its folder" in err and (tmp_path / "m.data").exists()


@pytest.mark.parametrize(("left_bytes", "words"), [(None, "no such weights file"), (-8, "are cut off")])
def test_weights_that_are_missing_or_cut_off_are_named(tmp_path, detect, left_bytes, words):
    model, weights = write_model(tmp_path / "m.onnx", LINES, weights_in="m.data"), tmp_path / "m.data"
    whole = weights.read_bytes()
    weights.unlink()
    if left_bytes:
        weights.write_bytes(whole[:left_bytes])
    status, found, err = detect(model)
    assert (status, found) == (2, None) and "m.data" in err and words in err and "Traceback" not in err


# one row high, with the padding of its width on all sides
HIGH = {"lines": (np.zeros((2, 3, 1, 99), np.float32), np.zeros(2, np.float32))}


@pytest.mark.parametrize(
    ("how", "entries", "words"),
    [
        ({"outputs": HIGH}, LOGITS,
         r"its output of shape \(1, 2, 458, 640\) is no mask of its input, 640x360 pixels; exp"),
        ({"outputs": OF_PIXELS, "pixels": True}, LOGITS | {"scale": 0.01},
         "its input is uint8, the pixels as they are; omit mean and scale"),
        ({"size": (640, 360)}, LOGITS | {"input_size": [360, 640]},
         r"its input is 640 wide and 360 high; input_size is \["),
        ({}, LOGITS | {"input_size": [100_000, 100_000]}, r"input_size is \[width, height\], 8 to 4096 pixels each"),
        ({}, None, "no such YAML file.*write what the network needs, such as `input_size: .*own_network.md"),
        ({}, "", "the file is empty"),
        ({}, "[1, 2]", "must be a mapping"),
        ({}, "a: [", "expected the node content"),
        ({}, "a: &a [1]\nb: *a", "has an alias, which is not allowed"),
        ({}, {"input_size": [640, 360], "channel": 1}, "missing 1 required positional argument: 'values'"),
        ({}, LOGITS | {"values": "logit"}, "values are logits or probabilities"),
        ({}, LOGITS | {"color": "RGB"}, "unexpected keyword argument 'color'"),
        ({}, LOGITS | {"channel": 7}, r"shape \(1, 2, 360, 640\) has no channel 7"),
        ({}, LOGITS | {"values": "probabilities"}, "returned .* with values from"),
        ({}, LOGITS | {"scale": "1/255"}, "could not convert string to float"),
        ({}, LOGITS | {"input_size": "640x360"}, "size"),
        ({}, LOGITS | {"output": "x"}, "the outputs are lines; write `output:`"),
        ({"outputs": {"area": threshold(-1, 0, 0)} | LINES}, LOGITS, "the outputs are area, lines; write `output:`"),
    ],
    ids=lambda value: str(value)[:20],
)  # fmt: skip
def test_a_network_that_does_not_fit_is_refused_at_loading(tmp_path, detect, how, entries, words):
    """The error names the YAML file and what to write."""
    status, found, err = detect(write_model(tmp_path / "m.onnx", entries=entries, **{"outputs": LINES, **how}))
    assert (status, found) == (2, None) and re.search(
        rf"^error: {tmp_path}/m\.yaml: cannot be used \(.*{words}", err
    ), err
    assert "Traceback" not in err and "Warning" not in err


def test_a_file_that_is_no_network_and_one_that_is_missing_are_refused(tmp_path, detect):
    file = write_model(tmp_path / "m.onnx", LINES)
    file.write_bytes(file.read_bytes()[:100])
    assert re.search("m.yaml: cannot be used .*parse onnx", detect(file)[2])
    assert "no.onnx: there is no such ONNX file" in detect(tmp_path / "no.onnx,own")[2]
    with pytest.raises(FileNotFoundError, match="no.onnx: there is no such ONNX file"):
        load_markings(tmp_path / "no.onnx,own")


@pytest.mark.parametrize("shape", [(640, 360), (64, 36)])
def test_a_mask_that_is_turned_is_refused(shape):
    image = np.zeros((720, 1280, 3), np.uint8)
    assert find_mask(image, lambda _: np.zeros(shape[::-1])).shape == shape[::-1]
    assert find_mask(image, lambda _: np.zeros((512, 512))) is not None  # of a stretched image
    with pytest.raises(LaneError, match=r"returned a mask \(rows, columns\) .* of an image \(720, 1280\); turn it"):
        find_mask(image, lambda _: np.zeros(shape))
