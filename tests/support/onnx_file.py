"""ONNX files of one convolution, built with the package `onnx`: tests need no torch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("onnx", reason="onnx is not installed: pip install onnx")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnx.external_data_helper import set_external_data

# A YAML file for outputs that are logits, the second channel those of paint.
LOGITS = {"input_size": [640, 360], "channel": 1, "values": "logits"}
# Grey levels of road and paint in an input of 0 to 1; difference of their logits.
ROAD, PAINT = 98 / 255, 215 / 255
STEEPNESS = 14.0
# What any build of ONNX Runtime reads.
OPSET, IR_VERSION = 13, 8
# Weights (channels, 3, rows, columns) and bias (channels,) of an output.
Output = tuple[np.ndarray, np.ndarray]


def write_model(  # noqa: PLR0913 (options, called by name)
    file: Path,
    outputs: Mapping[str, Output],
    entries: dict | str | None = LOGITS,
    *,
    sigmoid: bool = False,
    size: tuple[int, int] | None = None,
    last: str = "",
    pixels: bool = False,
    weights_in: str = "",
    opset: int = OPSET,
) -> Path:
    """Write a network with an output for each of `outputs`, and its YAML file.

    `entries` are those of the YAML file, or its text; it is not written if they are
    None. `size` (width, height) is that of the input; any size without it. With
    `sigmoid` the outputs are its values. Channels are the last axis of what `last`
    names: "input", "output" or both. With `pixels` the input is uint8, which the
    weights must allow for. With `weights_in` the weights are in a second file of this
    name, as ONNX's external data.
    """
    nodes = []
    image = "image"
    if pixels:
        kind = TensorProto.FLOAT
        nodes.append(helper.make_node("Cast", [image], ["floats"], to=kind))
        image = "floats"
    if "input" in last:
        nodes.append(_transpose(image, "first", [0, 3, 1, 2]))
        image = "first"

    weights = []
    for name, (kernel, bias) in outputs.items():
        weights.append(numpy_helper.from_array(np.float32(kernel), f"{name} kernel"))
        weights.append(numpy_helper.from_array(np.float32(bias), f"{name} bias"))
        nodes += _nodes_of(name, image, kernel, sigmoid, "output" in last)

    kind = TensorProto.UINT8 if pixels else TensorProto.FLOAT
    width, height = size or ("width", "height")
    source = _value("image", kind, (3, height, width), "input" in last)
    results = []
    for name, (_, bias) in outputs.items():
        shape = (len(bias), f"{name} rows", f"{name} columns")
        results.append(_value(name, TensorProto.FLOAT, shape, "output" in last))

    if weights_in:
        _move_weights(weights, file.parent, weights_in)
    graph = helper.make_graph(nodes, "graph", [source], results, weights)
    operators = [helper.make_opsetid("", opset)]
    model = helper.make_model(graph, opset_imports=operators, ir_version=IR_VERSION)
    file.write_bytes(model.SerializeToString())
    if entries is not None:
        text = entries if isinstance(entries, str) else yaml.safe_dump(entries)
        file.with_suffix(".yaml").write_text(text)
    return file


def _nodes_of(
    name: str, image: str, kernel: np.ndarray, sigmoid: bool, channels_last: bool
) -> list[onnx.NodeProto]:
    """A convolution, and what makes its output probabilities or has channels last."""
    logits = f"{name} logits" if sigmoid or channels_last else name
    size = list(kernel.shape[-2:])
    convolution = helper.make_node(
        "Conv",
        [image, f"{name} kernel", f"{name} bias"],
        [logits],
        kernel_shape=size,
        pads=[size[1] // 2] * 4,
    )
    nodes = [convolution]
    if sigmoid:
        nodes.append(helper.make_node("Sigmoid", [logits], [name]))
    if channels_last:
        nodes.append(_transpose(logits, name, [0, 2, 3, 1]))
    return nodes


def _transpose(source: str, target: str, axes: list[int]) -> onnx.NodeProto:
    return helper.make_node("Transpose", [source], [target], perm=axes)


def _value(
    name: str, kind: int, shape: tuple[int | str, ...], channels_last: bool
) -> onnx.ValueInfoProto:
    """An input or output of one image; `shape` is (channels, height, width)."""
    channels, *size = shape
    sizes = [1, *size, channels] if channels_last else [1, channels, *size]
    return helper.make_tensor_value_info(name, kind, sizes)


def _move_weights(weights: list[onnx.TensorProto], folder: Path, location: str) -> None:
    """Move the weights into a file, which may be outside of the folder."""
    moved = b""
    for tensor in weights:
        data = tensor.raw_data
        set_external_data(tensor, location, offset=len(moved), length=len(data))
        tensor.ClearField("raw_data")
        tensor.data_location = TensorProto.EXTERNAL
        moved += data
    (folder / location).write_bytes(moved)


def threshold(*colours: float, road: float = ROAD, paint: float = PAINT) -> Output:
    """Two channels of logits: 0 of the background, and of paint, positive on paint.

    `colours` are the weights of red, green and blue, by default their mean; `road` and
    `paint` the weighted sums of road and paint in the input.
    """
    slope = STEEPNESS / (paint - road)
    of_colours = colours if colours else np.full(3, 1 / 3)
    weights = np.zeros((2, 3), np.float32)
    weights[1] = np.multiply(slope, of_colours)

    between = (paint + road) / 2
    bias = np.array([0, -slope * between], np.float32)
    return weights.reshape(2, 3, 1, 1), bias
