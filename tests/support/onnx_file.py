"""ONNX files of one convolution, written as protocol buffers by hand: tests need neither torch nor the onnx package.

Field numbers are those of onnx.proto3 (https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

FLOAT, UINT8 = 1, 2
# A YAML file for outputs that are logits, the second channel those of paint.
LOGITS = {"input_size": [640, 360], "channel": 1, "values": "logits"}
# Grey levels of road and paint in an input of 0 to 1, and the difference of their logits.
ROAD, PAINT = 98 / 255, 215 / 255
STEEPNESS = 14.0


def write_model(
    file: Path,
    outputs: Mapping[str, tuple[np.ndarray, np.ndarray]],
    entries: dict | str | None = LOGITS,
    *,
    sigmoid: bool = False,
    size: tuple[int, int] | None = None,
    last: str = "",
    pixels: bool = False,
    weights_in: str = "",
) -> Path:
    """Write a network with an output for each of `outputs`: weights (channels, 3, k, k) and bias (channels,).

    `entries` are those of the YAML file, or its text; it is not written if they are None. `size` (width, height) is
    that of the input; any size without it. With `sigmoid` the outputs are its values. Channels are the last axis of
    what `last` names: "input", "output" or both. With `pixels` the input is uint8, which the weights must allow for.
    With `weights_in` the weights are in a second file of this name, as ONNX's external data.
    """
    nodes, tensors, results, image, blob = [], [], [], "image", b""
    if pixels:
        nodes.append(_node("Cast", [image], "floats", to=FLOAT))
        image = "floats"
    if "input" in last:
        nodes.append(_node("Transpose", [image], "first", perm=[0, 3, 1, 2]))
        image = "first"
    for name, (kernel, bias) in outputs.items():
        logits = f"{name} logits" if sigmoid or "output" in last else name
        inputs, shape = [image, f"{name} kernel", f"{name} bias"], [*kernel.shape[-2:]]
        nodes.append(_node("Conv", inputs, logits, pads=[shape[1] // 2] * 4, kernel_shape=shape))
        for tensor, values in zip(inputs[1:], (kernel, bias), strict=True):
            data = values.astype("<f4").tobytes()
            place = {"location": weights_in, "offset": str(len(blob)), "length": str(len(data))}
            stored = {13: [{1: key, 2: text} for key, text in place.items()], 14: 1} if weights_in else {9: data}
            tensors.append({1: [*values.shape], 2: FLOAT, 8: tensor} | stored)
            blob += data
        if sigmoid:
            nodes.append(_node("Sigmoid", [logits], name))
        if "output" in last:
            nodes.append(_node("Transpose", [logits], name, perm=[0, 2, 3, 1]))
        results.append(_value(name, FLOAT, [len(bias), None, None], "output" in last))
    width, height = size or (None, None)
    source = _value("image", UINT8 if pixels else FLOAT, [3, height, width], "input" in last)
    graph = {1: nodes, 2: "graph", 5: tensors, 11: source, 12: results}
    file.write_bytes(_encode({1: 8, 7: graph, 8: {1: "", 2: 13}}))
    if weights_in:
        (file.parent / weights_in).write_bytes(blob)
    if entries is not None:
        file.with_suffix(".yaml").write_text(entries if isinstance(entries, str) else yaml.safe_dump(entries))
    return file


def threshold(*colours: float, road: float = ROAD, paint: float = PAINT) -> tuple[np.ndarray, np.ndarray]:
    """Two channels of logits: 0 for the background, and positive for paint, which is the second one.

    `colours` are the weights of red, green and blue, by default their mean; `road` and `paint` the weighted sums of
    road and paint in the input.
    """
    weights = np.zeros((2, 3, 1, 1), np.float32)
    weights[1, :, 0, 0] = STEEPNESS / (paint - road) * np.array(colours or (1 / 3, 1 / 3, 1 / 3))
    return weights, np.array([0, -STEEPNESS * (paint + road) / 2 / (paint - road)], np.float32)


def _node(kind: str, inputs: list[str], output: str, **attributes: int | list[int]) -> dict:
    lists = [{1: name, 8: value, 20: 7} for name, value in attributes.items() if isinstance(value, list)]
    numbers = [{1: name, 3: value, 20: 2} for name, value in attributes.items() if isinstance(value, int)]
    return {1: inputs, 2: output, 3: output, 4: kind, 5: lists + numbers}


def _value(name: str, kind: int, channels_and_size: list[int | None], channels_last: bool) -> dict:
    channels, *size = channels_and_size
    shape = [1, *size, channels] if channels_last else [1, channels, *size]
    sizes = [{2: "any"} if number is None else {1: number} for number in shape]
    return {1: name, 2: {1: {1: kind, 2: {1: sizes}}}}


def _encode(message: dict) -> bytes:
    """A message from the contents of its fields by number: numbers, text, bytes, messages, or lists of them."""
    data = b""
    for number, contents in message.items():
        for content in contents if isinstance(contents, list) else [contents]:
            if isinstance(content, int):
                data += _varint(number << 3) + _varint(content)
            else:
                inner = _encode(content) if isinstance(content, dict) else content
                inner = inner.encode() if isinstance(inner, str) else inner
                data += _varint(number << 3 | 2) + _varint(len(inner)) + inner
    return data


def _varint(number: int) -> bytes:
    return bytes([number]) if number < 128 else bytes([number & 127 | 128]) + _varint(number >> 7)
