"""ONNX files of one convolution, written as protocol buffers by hand: tests need neither torch nor the onnx package.

Field numbers are those of onnx.proto3 (https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

FLOAT = 1
# Grey levels of road and paint in an input of 0 to 1, and the difference of their logits.
ROAD, PAINT = 98 / 255, 215 / 255
STEEPNESS = 14.0


def write_model(
    file: Path,
    outputs: Mapping[str, tuple[np.ndarray, np.ndarray]],
    entries: dict | None,
    *,
    sigmoid: bool = False,
    size: tuple[int, int] | None = None,
    last: str = "",
    pixels: bool = False,
    weights_in: str = "",
) -> Path:
    """Write a network with an output for each of `outputs`: weights (channels, 3, k, k) and bias (channels,).

    `entries` are those of the YAML file, which is not written if they are None. `size` (width, height) is that of the
    input; any size without it. With `sigmoid` the outputs are its values. Channels are the last axis of what `last`
    names: "input", "output" or both. With `pixels` the input is uint8, which the weights must allow for. With
    `weights_in` the weights are in a second file of this name, as ONNX's external data.
    """
    nodes, weights, results, image, blob = [], [], [], "image", bytearray()
    if pixels:
        nodes.append(_node("Cast", [image], "floats", [_field(1, "to") + _field(3, FLOAT) + _field(20, 2)]))
        image = "floats"
    if "input" in last:
        nodes.append(_node("Transpose", [image], "first", [_integers("perm", [0, 3, 1, 2])]))
        image = "first"
    for name, (kernel, bias) in outputs.items():
        of_convolution = f"{name} logits" if sigmoid or "output" in last else name
        pads = [_integers("pads", [kernel.shape[-1] // 2] * 4), _integers("kernel_shape", kernel.shape[-2:])]
        nodes.append(_node("Conv", [image, f"{name} kernel", f"{name} bias"], of_convolution, pads))
        for part, values in (("kernel", kernel), ("bias", bias)):
            weights.append(_tensor(f"{name} {part}", values, blob if weights_in else None, weights_in))
        if sigmoid:
            nodes.append(_node("Sigmoid", [of_convolution], name, []))
        if "output" in last:
            nodes.append(_node("Transpose", [of_convolution], name, [_integers("perm", [0, 2, 3, 1])]))
        shape = [1, None, None, len(bias)] if "output" in last else [1, len(bias), None, None]
        results.append(_value(name, shape))
    width, height = size or (None, None)
    shape = [1, height, width, 3] if "input" in last else [1, 3, height, width]
    graph = b"".join(_field(1, node) for node in nodes) + _field(2, "graph")
    graph += b"".join(_field(5, tensor) for tensor in weights) + _field(11, _value("image", shape, 2 if pixels else 1))
    graph += b"".join(_field(12, result) for result in results)
    file.write_bytes(_field(1, 8) + _field(7, graph) + _field(8, _field(1, "") + _field(2, 13)))
    if weights_in:
        (file.parent / weights_in).write_bytes(blob)
    if entries is not None:
        file.with_suffix(".yaml").write_text(yaml.safe_dump(entries))
    return file


def threshold(
    *colours: float, kernel: int = 1, road: float = ROAD, paint: float = PAINT
) -> tuple[np.ndarray, np.ndarray]:
    """Two channels of logits: 0 for the background, and positive for paint, which is the second one.

    `colours` are the weights of red, green and blue, by default their mean; `road` and `paint` the weighted sums of
    road and paint in the input.
    """
    weights = np.zeros((2, 3, kernel, kernel), np.float32)
    weights[1] = STEEPNESS / (paint - road) / kernel**2 * np.array(colours or (1 / 3, 1 / 3, 1 / 3))[:, None, None]
    return weights, np.array([0, -STEEPNESS * (paint + road) / 2 / (paint - road)], np.float32)


def _field(number: int, content: int | bytes | str) -> bytes:
    if isinstance(content, int):
        return _varint(number << 3) + _varint(content)
    data = content.encode() if isinstance(content, str) else content
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _varint(number: int) -> bytes:
    return bytes([number]) if number < 128 else bytes([number & 127 | 128]) + _varint(number >> 7)


def _node(kind: str, inputs: list[str], output: str, attributes: list[bytes]) -> bytes:
    names = b"".join(_field(1, name) for name in inputs) + _field(2, output) + _field(3, output) + _field(4, kind)
    return names + b"".join(_field(5, attribute) for attribute in attributes)


def _integers(name: str, values: list[int] | tuple[int, ...]) -> bytes:
    return _field(1, name) + b"".join(_field(8, int(value)) for value in values) + _field(20, 7)


def _tensor(name: str, values: np.ndarray, blob: bytearray | None = None, location: str = "") -> bytes:
    """A tensor with its values, or with the place where they are appended to `blob`, the content of `location`."""
    data = values.astype("<f4").tobytes()
    head = b"".join(_field(1, int(size)) for size in values.shape) + _field(2, FLOAT) + _field(8, name)
    if blob is None:
        return head + _field(9, data)
    place = {"location": location, "offset": str(len(blob)), "length": str(len(data))}
    blob += data
    return head + b"".join(_field(13, _field(1, key) + _field(2, text)) for key, text in place.items()) + _field(14, 1)


def _value(name: str, shape: list[int | None], kind: int = FLOAT) -> bytes:
    sizes = (_field(2, "any") if size is None else _field(1, size) for size in shape)
    tensor = _field(1, kind) + _field(2, b"".join(_field(1, size) for size in sizes))
    return _field(1, name) + _field(2, _field(1, tensor))
