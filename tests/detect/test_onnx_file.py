"""ONNX files as exporters write them, and files that cannot be used."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from lanes.camera.model import save_camera
from lanes.detect.markings import MarkingSource, load_markings, open_network
from lanes.errors import LaneError
from lanes.video.images import write_image
from tests.support.onnx_file import LOGITS, threshold, write_model
from tests.support.painted_roads import Road, dashcam

CAMERA = dashcam()
IMAGE = Road(CAMERA).lines(1.8, -1.7).image()
LINES = {"lines": threshold()}
# of an input with the pixels as they are
OF_PIXELS = {"lines": threshold(1 / 765, 1 / 765, 1 / 765)}


@dataclass(frozen=True)
class Detected:
    """What the command says about a still: confidence None without an output."""

    status: int
    confidence: float | None
    stderr: str


@pytest.fixture
def detect(tmp_path, run) -> Callable[[Path], Detected]:
    """A function that detects the lane in a still with a network."""
    camera = save_camera(CAMERA, tmp_path / "camera.yaml")
    still = write_image(tmp_path / "still.png", IMAGE)
    output = tmp_path / "lanes.jsonl"

    def detect(model: Path) -> Detected:
        output.unlink(missing_ok=True)
        options = ("--markings", model, "--camera", camera, "-o", output)
        status, _, stderr = run("detect", still, *options)
        confidence = None
        if output.exists():
            confidence = json.loads(output.read_text())["confidence"]
        return Detected(status, confidence, stderr)

    return detect


# Forms of networks.


@pytest.mark.parametrize("last", ["", "input", "output", "input output"])
@pytest.mark.parametrize(
    ("pixels", "size"), [(False, None), (True, (640, 360))], ids=["float", "uint8"]
)
def test_channels_last_and_pixels_are_recognised_from_the_input(
    tmp_path, detect, last, pixels, size
):
    outputs = OF_PIXELS if pixels else LINES
    form = {"last": last, "pixels": pixels, "size": size}
    found = detect(write_model(tmp_path / "m.onnx", outputs, **form))
    assert found.status == 0, found.stderr
    assert found.confidence > 0.9


@pytest.mark.parametrize("opset", [7, 13, 21])
def test_networks_of_old_and_new_operator_sets_are_read(tmp_path, detect, opset):
    found = detect(write_model(tmp_path / "m.onnx", LINES, opset=opset))
    assert found.status == 0, found.stderr
    assert found.confidence > 0.9


def test_a_network_has_as_many_threads_as_opencv(tmp_path):
    model = load_markings(write_model(tmp_path / "m.onnx", LINES)).function
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        open_network.cache_clear()
        session = open_network(model.file, model.digest)
    finally:
        cv2.setNumThreads(threads)
    assert session.get_session_options().intra_op_num_threads == 1


# Weights in a second file.


def test_weights_in_a_second_file_are_those_beside_the_model(
    tmp_path, detect, monkeypatch
):
    """Not those of the same name in the working directory."""
    model = write_model(tmp_path / "m.onnx", LINES, weights_in="m.onnx.data")
    size = (tmp_path / "m.onnx.data").stat().st_size
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "m.onnx.data").write_bytes(bytes(size))
    monkeypatch.chdir(elsewhere)

    found = detect(model)
    assert found.status == 0, found.stderr
    assert found.confidence > 0.9

    shutil.copy(elsewhere / "m.onnx.data", tmp_path)
    assert detect(model).confidence < 0.5


def test_a_network_is_the_same_with_its_weights_in_one_file_or_in_two(tmp_path):
    one = load_markings(write_model(tmp_path / "one.onnx", LINES))
    two = load_markings(write_model(tmp_path / "two.onnx", LINES, weights_in="w.data"))
    np.testing.assert_array_equal(one.find_mask(IMAGE), two.find_mask(IMAGE))


def test_the_digest_is_that_of_the_weights_as_well(tmp_path):
    model = write_model(tmp_path / "m.onnx", LINES, weights_in="m.data")
    before = load_markings(model).function.digest
    weights = tmp_path / "m.data"
    weights.write_bytes(bytes(weights.stat().st_size))
    assert load_markings(model).function.digest != before


@pytest.mark.parametrize("changed", ["m.onnx", "m.onnx.data"])
def test_the_digest_is_compared_where_the_network_is_loaded(tmp_path, changed):
    """A worker on another machine may have another file of this name."""
    model = write_model(tmp_path / "m.onnx", LINES, weights_in="m.onnx.data")
    source = load_markings(model)
    red = {"lines": threshold(1, 0, 0)}
    write_model(tmp_path / "other.onnx", red, None, weights_in="other.onnx.data")
    shutil.copy(tmp_path / changed.replace("m", "other", 1), tmp_path / changed)

    open_network.cache_clear()
    with pytest.raises(LaneError, match=r"m\.onnx: changed during the run"):
        source.find_mask(IMAGE)


@pytest.mark.parametrize("location", ["../m.data", "inner/../../m.data", "{}/m.data"])
def test_weights_outside_of_the_folder_are_refused(tmp_path, detect, location):
    """The file is there, but the author of a model must not choose what is read."""
    (tmp_path / "model" / "inner").mkdir(parents=True)
    location = location.format(tmp_path)
    model = write_model(tmp_path / "model" / "m.onnx", LINES, weights_in=location)
    found = detect(model)
    assert (tmp_path / "m.data").exists()
    assert found.status == 2
    assert re.search("outside the directory|an absolute path", found.stderr)


def test_weights_behind_a_link_out_of_the_folder_are_refused(tmp_path, detect):
    (tmp_path / "model").mkdir()
    model = write_model(tmp_path / "model" / "m.onnx", LINES, weights_in="m.data")
    (tmp_path / "model" / "m.data").rename(tmp_path / "secret")
    (tmp_path / "model" / "m.data").symlink_to(tmp_path / "secret")
    found = detect(model)
    assert found.status == 2
    assert "symbolic link" in found.stderr


@pytest.mark.parametrize("output", ["m.onnx", "m.yaml", "weights.bin"])
def test_files_of_the_network_are_never_overwritten(tmp_path, run, output):
    model = write_model(tmp_path / "m.onnx", LINES, weights_in="weights.bin")
    still = write_image(tmp_path / "still.png", IMAGE)
    before = (tmp_path / output).read_bytes()

    options = ("--hfov", 60, "--markings", f"{model},own", "-o", tmp_path / output)
    status, _, stderr = run("detect", still, *options)

    assert status == 2
    assert f"{output}: is one of the inputs" in stderr
    assert (tmp_path / output).read_bytes() == before


@pytest.mark.parametrize(
    ("left_bytes", "words"),
    [(None, r"m\.data, but it is not regular file"), (-8, "exceeds available data")],
    ids=["missing", "cut off"],
)
def test_weights_that_are_missing_or_cut_off_are_named(
    tmp_path, detect, left_bytes, words
):
    model = write_model(tmp_path / "m.onnx", LINES, weights_in="m.data")
    weights = tmp_path / "m.data"
    whole = weights.read_bytes()
    weights.unlink()
    if left_bytes:
        weights.write_bytes(whole[:left_bytes])

    found = detect(model)
    assert (found.status, found.confidence) == (2, None)
    assert re.search(words, found.stderr)
    assert "Traceback" not in found.stderr


# What cannot be used.

# one row high, with the padding of its width on all sides
HIGH = {"lines": (np.zeros((2, 3, 1, 99), np.float32), np.zeros(2, np.float32))}
TWO_OUTPUTS = {"area": threshold(-1, 0, 0), **LINES}

MISFITS = {
    "no mask": (
        {"outputs": HIGH},
        LOGITS,
        r"its output of shape \(1, 2, 458, 640\) is no mask of its input, 640x360 pix",
    ),
    "scaled pixels": (
        {"outputs": OF_PIXELS, "pixels": True},
        LOGITS | {"scale": 0.01},
        "its input is uint8, the pixels as they are; omit mean and scale",
    ),
    "exchanged": (
        {"size": (640, 360)},
        LOGITS | {"input_size": [360, 640]},
        r"its input is 640 wide and 360 high; input_size is \[width, height\]",
    ),
    "other size": ({"size": (320, 192)}, LOGITS, "Got: 640 Expected: 320"),
    "too large": (
        {},
        LOGITS | {"input_size": [100_000, 100_000]},
        r"input_size is \[width, height\], 8 to 4096 pixels each",
    ),
    "no entries": (
        {},
        None,
        "no such YAML file.*write what the network needs, such as `input_size: .*"
        r"own_network\.md",
    ),
    "empty": ({}, "", "the file is empty"),
    "a list": ({}, "[1, 2]", "must be a mapping"),
    "no YAML": ({}, "a: [", "expected the node content"),
    "alias": ({}, "a: &a [1]\nb: *a", "has an alias, which is not allowed"),
    "no values": (
        {},
        {"input_size": [640, 360], "channel": 1},
        "missing 1 required keyword-only argument: 'values'",
    ),
    "wrong values": ({}, LOGITS | {"values": "logit"}, "values are logits or prob"),
    "wrong order": ({}, LOGITS | {"colour_order": "GBR"}, "colour_order is RGB or BGR"),
    "wrong name": (
        {},
        LOGITS | {"color": "RGB"},
        "unexpected keyword argument 'color'",
    ),
    "no channel": ({}, LOGITS | {"channel": 7}, r"\(1, 2, 360, 640\) has no channel 7"),
    "negative channel": ({}, LOGITS | {"channel": -1}, "has no channel -1, from 0 on"),
    "no probabilities": (
        {},
        LOGITS | {"values": "probabilities"},
        "returned .* with values from",
    ),
    "text": ({}, LOGITS | {"scale": "1/255"}, "could not convert string to float"),
    "size as text": ({}, LOGITS | {"input_size": "640x360"}, "size"),
    "three sizes": ({}, LOGITS | {"input_size": [640, 360, 3]}, "size"),
    "no output": (
        {},
        LOGITS | {"output": "x"},
        "the outputs are lines; write `output:`",
    ),
    "two outputs": (
        {"outputs": TWO_OUTPUTS},
        LOGITS,
        "the outputs are area, lines; write `output:`",
    ),
}


@pytest.mark.parametrize(("form", "entries", "words"), MISFITS.values(), ids=MISFITS)
def test_a_network_that_does_not_fit_is_refused_at_loading(
    tmp_path, detect, form, entries, words
):
    """The error names the YAML file and what to write."""
    form = {"outputs": LINES, **form}
    found = detect(write_model(tmp_path / "m.onnx", entries=entries, **form))
    assert (found.status, found.confidence) == (2, None)
    expected = rf"^error: {tmp_path}/m\.yaml: cannot be used \(.*{words}"
    assert re.search(expected, found.stderr), found.stderr
    assert "Traceback" not in found.stderr
    assert "Warning" not in found.stderr


def test_a_file_that_is_no_network_is_refused(tmp_path, detect):
    file = write_model(tmp_path / "m.onnx", LINES)
    file.write_bytes(file.read_bytes()[:100])
    found = detect(file)
    assert found.status == 2
    assert re.search(r"m\.yaml: cannot be used .*onnx\.ModelProto", found.stderr)


def test_a_missing_file_is_refused(tmp_path, detect):
    missing = tmp_path / "no.onnx,own"
    assert "no.onnx: there is no such ONNX file" in detect(missing).stderr
    with pytest.raises(FileNotFoundError, match="no.onnx: there is no such ONNX file"):
        load_markings(missing)


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_without_its_packages_a_sentence_says_what_to_install(
    tmp_path, detect, monkeypatch, package
):
    model = write_model(tmp_path / "m.onnx", LINES)
    monkeypatch.setitem(sys.modules, package, None)
    found = detect(model)
    assert found.status == 2
    expected = r"error: .*/m\.onnx: .* need two packages .*pip install onnx onnxruntime"
    assert re.match(expected, found.stderr)


@pytest.mark.parametrize("shape", [(640, 360), (64, 36)])
def test_a_mask_that_is_turned_is_refused(shape):
    image = np.zeros((720, 1280, 3), np.uint8)
    turned = MarkingSource(lambda _: np.zeros(shape))
    words = r"returned a mask \(rows, columns\) .* of an image \(720, 1280\); turn it"
    with pytest.raises(LaneError, match=words):
        turned.find_mask(image)


@pytest.mark.parametrize(
    "shape", [(360, 640), (512, 512)], ids=["upright", "stretched"]
)
def test_a_mask_that_is_upright_or_square_is_taken(shape):
    image = np.zeros((720, 1280, 3), np.uint8)
    source = MarkingSource(lambda _: np.zeros(shape))
    assert source.find_mask(image).shape == shape
