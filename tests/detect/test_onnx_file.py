"""ONNX files as exporters write them, with the command: channels last, uint8, weights in a second file; bad ones."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import lanes
from lanes.camera import save_camera
from lanes.detect.markings import find_mask, load_markings, run_network
from lanes.errors import LaneError
from lanes.images import write_image
from tests.support.command_line import main
from tests.support.onnx_file import threshold, write_model
from tests.support.painted_roads import Road, dashcam

CAMERA = dashcam()
ENTRIES = {"input_size": [640, 360], "channel": 1, "values": "logits"}
OF_PIXELS = threshold(1 / 765, 1 / 765, 1 / 765)


@pytest.fixture
def detect(tmp_path, capsys):
    """A function that detects the lane in a still with a network; returns status, confidence, and the error."""
    save_camera(CAMERA, tmp_path / "camera.yaml")
    write_image(tmp_path / "still.png", Road(CAMERA).lines(1.8, -1.7).image())

    def run(model: Path) -> tuple[int, float | None, str]:
        output = tmp_path / "lanes.jsonl"
        output.unlink(missing_ok=True)
        files = "--camera", tmp_path / "camera.yaml", tmp_path / "still.png", "-o", output
        status = main(["detect", "--markings", *map(str, (model, *files))])
        found = json.loads(output.read_text())["confidence"] if output.exists() else None
        return status, found, capsys.readouterr().err

    return run


@pytest.mark.parametrize("last", ["", "input", "output", "input output"])
@pytest.mark.parametrize(("pixels", "size"), [(False, None), (True, (640, 360))])
def test_channels_last_and_pixels_are_recognised_from_the_input(tmp_path, detect, last, pixels, size):
    weights = OF_PIXELS if pixels else threshold()
    model = write_model(tmp_path / "m.onnx", {"lines": weights}, ENTRIES, last=last, pixels=pixels, size=size)
    status, confidence, err = detect(model)
    assert status == 0 and confidence > 0.9, err


def test_weights_in_a_second_file_are_those_beside_the_model(tmp_path, detect, monkeypatch):
    """Not those in the working directory. The digest is that of both files."""
    folder, elsewhere = tmp_path / "model", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    model = write_model(folder / "m.onnx", {"lines": threshold()}, ENTRIES, weights_in="m.onnx.data")
    (elsewhere / "m.onnx.data").write_bytes(bytes((folder / "m.onnx.data").stat().st_size))
    monkeypatch.chdir(elsewhere)
    status, confidence, err = detect(model)
    assert status == 0 and confidence > 0.9, err
    inside = load_markings(write_model(elsewhere / "one.onnx", {"lines": threshold()}, ENTRIES))
    image = Road(CAMERA).lines(1.8, -1.7).image()
    before = load_markings(model)
    np.testing.assert_array_equal(inside(image), before(image))
    shutil.copy(elsewhere / "m.onnx.data", folder)
    assert load_markings(model).digest != before.digest
    assert detect(model)[1] < 0.5


@pytest.mark.parametrize("changed", ["m.onnx", "m.onnx.data"])
def test_the_digest_is_compared_where_the_network_is_loaded(tmp_path, changed):
    """A worker on another machine may have another file of this name."""
    model = load_markings(write_model(tmp_path / "m.onnx", {"lines": threshold()}, ENTRIES, weights_in="m.onnx.data"))
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
    location = location.format(tmp_path)
    model = write_model(tmp_path / "model" / "m.onnx", {"lines": threshold()}, ENTRIES, weights_in=location)
    status, _, err = detect(model)
    assert status == 2 and "names weights outside of its folder" in err and (tmp_path / "m.data").exists()


@pytest.mark.parametrize("fault", ["missing", "cut off"])
def test_weights_that_are_missing_or_cut_off_are_named(tmp_path, detect, fault):
    model = write_model(tmp_path / "m.onnx", {"lines": threshold()}, ENTRIES, weights_in="m.data")
    whole = (tmp_path / "m.data").read_bytes()
    (tmp_path / "m.data").unlink()
    if fault == "cut off":
        (tmp_path / "m.data").write_bytes(whole[:-8])
    status, found, err = detect(model)
    assert (status, found) == (2, None) and "m.data" in err and "Traceback" not in err
    assert ("no such weights file" if fault == "missing" else "are cut off") in err


@pytest.mark.parametrize(
    ("how", "entries", "words"),
    [
        ({"kernel": 99}, {}, r"its output of shape \(1, 2, 458, 640\) is no mask of its input, 640x360 pixels; exp"),
        ({"pixels": True}, {"scale": 0.01}, "its input is uint8, the pixels as they are; omit mean and scale"),
        ({"size": (640, 360)}, {"input_size": [360, 640]}, r"its input is 640 wide and 360 high; input_size is \["),
        ({}, {"input_size": [100_000, 100_000]}, r"input_size is \[width, height\], 8 to 4096 pixels each"),
    ],
)  # fmt: skip
def test_a_network_that_does_not_fit_is_refused_at_loading(tmp_path, detect, how, entries, words):
    weights = OF_PIXELS if how.get("pixels") else threshold()
    if kernel := how.pop("kernel", 0):
        # one row high, with the padding of its width on all sides
        weights = np.zeros((2, 3, 1, kernel), np.float32), weights[1]
    model = write_model(tmp_path / "m.onnx", {"lines": weights}, ENTRIES | entries, **how)
    status, found, err = detect(model)
    assert (status, found) == (2, None) and re.search(words, err), err
    assert "Traceback" not in err and "Warning" not in err


@pytest.mark.parametrize("shape", [(640, 360), (64, 36)])
def test_a_mask_that_is_turned_is_refused(shape):
    image = np.zeros((720, 1280, 3), np.uint8)
    assert find_mask(image, lambda _: np.zeros(shape[::-1])).shape == shape[::-1]
    assert find_mask(image, lambda _: np.zeros((512, 512))) is not None  # of a stretched image
    with pytest.raises(LaneError, match=r"returned a mask \(rows, columns\) .* of an image \(720, 1280\); turn it"):
        find_mask(image, lambda _: np.zeros(shape))
