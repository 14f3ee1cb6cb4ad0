"""ONNX files: their weights, also those in a second file, the form of their input, and the channels of their output.

OpenCV takes a model from memory, and would look for weights in another file in the working directory; here they are put
into the model first. Messages and field numbers are those of onnx.proto3
(https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from lanes.errors import LaneError
from lanes.files import protobuf_fields, require_file

# The messages inside a message, by field number, on the way from the model to its tensors.
_PARTS: Mapping[str, Mapping[int, str]] = {
    "model": {7: "graph", 25: "function"},
    "graph": {1: "node", 5: "tensor"},
    "function": {7: "node"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph"},
}
# Sizes of inputs, pixels: markings are seen from the first on, and the second costs half a gigabyte.
MIN_INPUT_PX, MAX_INPUT_PX = 8, 4096
# Types of inputs that OpenCV takes, by TensorProto.DataType.
_TYPES = {1: np.float32, 2: np.uint8, 10: np.float16, 11: np.float64}


@dataclass(frozen=True)
class NetworkForm:
    """Type and shape of the first input of the network in a file, with None for sizes that are free.

    The shape is empty if the file does not say it.
    """

    file: Path
    kind: int
    shape: tuple[int | None, ...]

    @property
    def channels_last(self) -> bool:
        """Whether the input is (1, height, width, 3)."""
        return self.shape[-1:] == (3,) and self.shape[-3:-2] != (3,)

    def require_image_input(self, size: Sequence[int]) -> None:
        """Raise LaneError if the input is no RGB image, or has width and height of `size` exchanged."""
        batch, image = self.shape[:-3], self.shape[-3:] or (3, None, None)
        channels, *place = (image[2], *image[:2]) if self.channels_last else image
        fits = len(self.shape) in (0, 3, 4) and channels in (3, None) and batch in ((), (1,), (None,))
        if self.kind not in _TYPES or not fits:
            found = f"of type {self.kind} and shape {_words(self.shape)}"
            raise LaneError(
                f"{self.file}: its input is {found}; a network for markings takes one RGB image, (1, 3, height, width) "
                "or (1, height, width, 3), as float or uint8."
            )
        if place == list(size) and size[0] != size[1]:
            width, height = place[1], place[0]
            raise LaneError(f"{self.file}: its input is {width} wide and {height} high; input_size is [width, height].")

    def as_input(self, pixels: np.ndarray, mean: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """The input, from RGB or BGR `pixels` (1, 3, height, width) and the mean and scale (-1, 1, 1) of its colours.

        Raises LaneError if whole numbers would be scaled.
        """
        if self.kind == 2:
            if mean.any() or not np.isin(np.round(scale * 255), (1, 255)).all():
                raise LaneError(f"{self.file}: its input is uint8, the pixels as they are; omit mean and scale.")
            mean, scale = np.zeros(1, np.float32), np.ones(1, np.float32)
        values = ((pixels - mean) * scale).astype(_TYPES[self.kind])
        values = np.moveaxis(values, 1, 3) if self.channels_last else values
        return np.ascontiguousarray(values[0] if len(self.shape) == 3 else values)

    def channels_of(self, output: np.ndarray, size: Sequence[int]) -> np.ndarray:
        """The channels (channels, rows, columns) of an output for an input of `size` (width, height).

        Raises LaneError if the output has not the shape of an image with the aspect ratio of the input.
        """
        width, height = size
        channels = output[0] if output.ndim == 4 else output[None] if output.ndim == 2 else output
        if channels.ndim == 3:
            for found in (channels, np.moveaxis(channels, 2, 0)):
                rows, columns = found.shape[1:]
                if min(abs(rows - columns * height / width), abs(columns - rows * width / height)) <= 1:
                    return found
        raise LaneError(
            f"{self.file}: its output of shape {output.shape} is no mask of its input, {width}x{height} pixels; "
            "expected (1, channels, rows, columns) or (1, rows, columns, channels) with the aspect ratio of the input."
        )


@dataclass(frozen=True, eq=False)
class OnnxFile:
    """A model with all its weights, the sha256 `digest` of both, and the form of its input."""

    data: bytes
    digest: str
    form: NetworkForm


def read_onnx(file: Path, digest: str = "") -> OnnxFile:
    """The model in a file with its weights; LaneError if it is damaged, or has another digest than `digest`, if any."""
    read = cache(lambda location: _read_weights(file, location))
    try:
        data = _embed("model", require_file(file, "ONNX", error=LaneError).read_bytes(), read)
        form = NetworkForm(file, *_first_input(data))
    except LaneError:
        raise
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise LaneError(f"{file}: cannot parse onnx: it is cut off, or no ONNX file; export it again.") from error
    found = hashlib.sha256(data).hexdigest()
    if digest not in ("", found):
        raise LaneError(f"{file}: changed during the run, or differs between machines; use one file for a run.")
    return OnnxFile(data, found, form)


def _read_weights(file: Path, location: str) -> bytes:
    """A file of weights beside the model, as ONNX demands; a name that leads elsewhere is refused."""
    path = PurePosixPath(location)
    if not location or path.is_absolute() or ".." in path.parts or PureWindowsPath(location).drive:
        raise LaneError(f"{file}: names weights outside of its folder ({location!r}); export it again.")
    return require_file(file.parent / path, "weights", error=LaneError).read_bytes()


def _embed(kind: str, data: bytes, read: Callable[[str], bytes]) -> bytes:
    """A message with the weights that its tensors have in other files; the same bytes if they have none."""
    if kind == "tensor":
        return _embed_tensor(data, read)
    pieces, changed = [], False
    for number, whole, content in protobuf_fields(data):
        if (part := _PARTS[kind].get(number)) and isinstance(content, bytes):
            new = _embed(part, content, read)
            changed |= new is not content
            whole = _field(number, new) if new is not content else whole
        pieces.append(whole)
    return b"".join(pieces) if changed else data


def _embed_tensor(data: bytes, read: Callable[[str], bytes]) -> bytes:
    fields = list(protobuf_fields(data))
    if not any(number == 14 and content == 1 for number, _, content in fields):  # data_location: EXTERNAL
        return data
    entries = [dict(_fields_of(content)) for number, _, content in fields if number == 13]
    where = {entry[1].decode(): entry[2].decode() for entry in entries}
    weights, begin = read(where["location"]), int(where.get("offset", 0))
    end = begin + int(where["length"]) if "length" in where else len(weights)
    if not 0 <= begin <= end <= len(weights):
        raise LaneError(f"its weights in {where['location']} are cut off; copy both files again.")
    return b"".join(whole for number, whole, _ in fields if number not in (13, 14)) + _field(9, weights[begin:end])


def _first_input(data: bytes) -> tuple[int, tuple[int | None, ...]]:
    """Type and shape of the first input of a model that is no weight."""
    (graph,) = (content for number, content in _fields_of(data) if number == 7)
    weights = {dict(_fields_of(content)).get(8) for number, content in _fields_of(graph) if number == 5}
    inputs = [dict(_fields_of(content)) for number, content in _fields_of(graph) if number == 11]
    (value, *_) = (value for value in inputs if value.get(1) not in weights)
    tensor = dict(_fields_of(dict(_fields_of(value[2]))[1]))
    sizes = [dict(_fields_of(content)).get(1) for _, content in _fields_of(tensor.get(2, b""))]
    return tensor.get(1, 1), tuple(size or None for size in sizes)


def _fields_of(data: bytes) -> Iterator[tuple[int, Any]]:
    return ((number, content) for number, _, content in protobuf_fields(data))


def _field(number: int, content: bytes) -> bytes:
    head = b""
    for value in (number << 3 | 2, len(content)):
        while value > 127:
            head, value = head + bytes([value & 127 | 128]), value >> 7
        head += bytes([value])
    return head + content


def _words(shape: tuple[int | None, ...]) -> str:
    return f"({', '.join('any' if size is None else str(size) for size in shape)})"
