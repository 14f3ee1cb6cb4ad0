"""Networks that see lane markings: ours, and any other in an ONNX file with a YAML file (docs/own_network.md).

Our network is small. It states for each cell of the bird's-eye view the probability that it is paint. A worn line and a
row of Botts' dots are too faint in each row of the view for the band filter, but they line up over many rows. The
network sees three rows of a finer view for each row, and its surroundings: 47 rows, and 1.8 m to either side. Its
second output is the probability of an edge of the road. It has learned from rendered images only
(`tools/train_marking_network.py`). It takes much longer than the band filter: the tracker uses it in five searches a
second, while no sure lane is tracked.

The mask of another network, or of any function, takes the place of our evidence, or joins it.

OpenCV takes an ONNX model from memory, and would look for weights in another file in the working directory; here they
are put into the model first. Messages and field numbers are those of onnx.proto3
(https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3).
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import cv2
import numpy as np
import yaml

from lanes.detect.birdseye import BirdsEyeView, lightness, yellowness
from lanes.errors import LaneError
from lanes.files import parse_yaml, protobuf_fields, read_text, require_file

NETWORK_FILE = Path(__file__).with_name("marking_network.onnx")


# Rows of the finer view for each row of the view.
FINE_ROWS = 3
# A network keeps its input, so threads use it one after the other.
_NETWORK_IN_USE = threading.Lock()


@lru_cache(maxsize=2)
def finer_view(view: BirdsEyeView) -> BirdsEyeView:
    """The view with `FINE_ROWS` rows for each of its rows; their middle one is at the same distance."""
    growth = (1 + view.growth) ** (1 / FINE_ROWS) - 1
    near_m = view.x_m[-1] / (1 + growth) ** (FINE_ROWS // 2)
    # half a row beyond the farthest one, so that rounding does not drop it
    far_m = near_m * (1 + growth) ** (FINE_ROWS * len(view.x_m) - 0.5)
    return replace(view, near_m=near_m, far_m=far_m, growth=growth)


def network_inputs(fine_image: np.ndarray, fine: BirdsEyeView, focal_px: float) -> np.ndarray:
    """Inputs of the network (4, fine rows, columns) float32, of an image (fine rows, columns, 3) of the finer view.

    Lightness and yellowness relative to their scatter make the response nearly independent of exposure. Lightness
    relative to its mean shows that a faint streak on a very smooth road is not paint. The fourth input is the width of
    a pixel in cells: far away, lines are as wide as their blur. `focal_px` is that of the raw image.

    The weights of the network have to be trained again if one of the numbers here changes.
    """

    def window_mean(cells: np.ndarray, window_m: float) -> np.ndarray:
        return cv2.blur(cells, (round(window_m / fine.cell_m) | 1, 15))

    contrasts, means, scatters = [], [], []
    for channel in (lightness, yellowness):
        cells = channel(fine_image).astype(np.float32)
        # wheel tracks are wider than the window of the mean, so they are no scatter
        means.append(window_mean(cells, 1.05))
        contrasts.append(cells - means[-1])
        # OpenCV's running sums may round a zero down
        variance = np.maximum(window_mean(contrasts[-1] ** 2, 2.5), 0)
        # rounding and sensor noise are about two grey levels
        scatters.append(np.sqrt(variance) + 2.0)
    pixel_width = np.log2(1 + fine.x_m / (focal_px * fine.cell_m)).astype(np.float32)
    relative = contrasts[0] / (means[0] + 16.0)  # grey levels, so that black images have no contrast
    widths = np.broadcast_to(pixel_width[:, None], relative.shape)
    return np.stack([contrasts[0] / scatters[0], contrasts[1] / scatters[1], relative, widths])


def network_log_odds(image: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """Log odds (2, rows, columns) float32 of paint and of road edges in the view of a raw image."""
    fine = finer_view(view)
    inputs = network_inputs(fine.warp(image), fine, view.focal_px)
    # larger log odds are no more certain: rendered images are not real ones
    return np.minimum(run_network(NETWORK_FILE, inputs[None])[0], 6.0)


# From a raw RGB image (height, width, 3), uint8, to the mask of its lane markings: probabilities (rows, columns), 0 to
# 1, of the whole image, also at a lower resolution.
Markings = Callable[[np.ndarray], np.ndarray]


def find_mask(image: np.ndarray, markings: Markings) -> np.ndarray:
    """The mask (rows, columns) float32 that a function finds; raises LaneError if it is no mask."""
    mask, name = np.asarray(markings(image), np.float32), getattr(markings, "__name__", markings)
    low, high = (mask.min(), mask.max()) if mask.size else (np.nan, np.nan)
    if mask.ndim != 2 or not (low >= -1e-3 and high <= 1 + 1e-3):  # also for NaN
        found = f"an array of shape {mask.shape} with values from {low:g} to {high:g}"
        raise LaneError(f"{name}: returned {found}; a mask has shape (rows, columns) and probabilities, 0 to 1.")
    (rows, columns), (height, width) = mask.shape, image.shape[:2]
    if not isinstance(markings, MarkingModel) and rows != columns and abs(rows * height - columns * width) < rows:
        raise LaneError(f"{name}: returned a mask (rows, columns) {mask.shape} of an image {(height, width)}; turn it.")
    return np.clip(mask, 0, 1)


@dataclass(frozen=True)
class MarkingModel:
    """A function of `Markings`: the network in an ONNX file with this `digest`, run as its YAML file says."""

    file: Path
    digest: str
    with_own: bool
    form: NetworkForm
    input_size: Sequence[int]
    channel: int | Sequence[int]
    values: str
    output: str = ""
    colour_order: str = "RGB"
    mean: float | Sequence[float] = 0.0
    scale: float | Sequence[float] = 1 / 255
    confidence_shift: float = 0.0

    def __str__(self) -> str:
        return f"{self.file}{',own' if self.with_own else ''}"

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """The mask of a raw image (height, width, 3), uint8, RGB. Raises LaneError if there is no such channel."""
        pixels = cv2.dnn.blobFromImage(image, 1.0, self.input_size, swapRB=self.colour_order == "BGR")
        mean, scale = (np.reshape(np.array(value, np.float32), (-1, 1, 1)) for value in (self.mean, self.scale))
        inputs = self.form.as_input(pixels, mean, scale)
        output = run_network(self.file, inputs, output=self.output, digest=self.digest)
        channels, wanted = self.form.channels_of(output, self.input_size), np.ravel(self.channel)
        if not 0 <= min(wanted) <= max(wanted) < len(channels):
            wrong = min(wanted) if min(wanted) < 0 else max(wanted)
            raise LaneError(f"{self.file}: its output of shape {output.shape} has no channel {wrong}, from 0 on.")
        if self.values == "logits":
            # a single one is the logarithm of the odds
            logits = channels if len(channels) > 1 else np.stack([channels[0], np.zeros_like(channels[0])])
            channels = np.exp(channels - np.logaddexp.reduce(logits))
        return channels[wanted].sum(axis=0)


def load_markings(name: str | Path) -> MarkingModel:
    """The network in an ONNX file with its YAML file; if ",own" follows the name, its stripes join ours.

    >>> lanes.find_lane(image, camera, markings=load_markings("model.onnx"))  # doctest: +SKIP

    It is tried on a black image. Raises FileNotFoundError or LaneError if a file is missing or cannot be used.
    """
    file = Path(str(name).removesuffix(",own")).absolute()
    path = require_file(file, "ONNX", error=LaneError).with_suffix(".yaml")
    try:
        entries = parse_yaml(read_text(path, "YAML", error=LaneError, max_bytes=100_000))
        network = read_onnx(file)
        digest = network.digest
        model = MarkingModel(file, digest, str(name).endswith(",own"), network.form, **entries)
        if not all(isinstance(size, int) and MIN_INPUT_PX <= size <= MAX_INPUT_PX for size in model.input_size):
            raise ValueError(f"input_size is [width, height], {MIN_INPUT_PX} to {MAX_INPUT_PX} pixels each")
        network.form.require_image_input(model.input_size)
        if model.values not in ("logits", "probabilities") or model.colour_order not in ("RGB", "BGR"):
            raise ValueError("values are logits or probabilities, colour_order is RGB or BGR")
        names = read_network(file, digest).getUnconnectedOutLayersNames()
        if model.output not in names and (model.output or len(names) > 1):
            raise ValueError(f"the outputs are {', '.join(names)}; write `output:` and one of them")
        find_mask(np.zeros((8, 8, 3), np.uint8), model)
    except (yaml.YAMLError, cv2.error, FileNotFoundError, RecursionError, TypeError, ValueError) as error:
        reason = " ".join(str(getattr(error, "err", error)).split()).rstrip(".")
        remedy = "write what the network needs, such as `input_size: [640, 360]`, `channel: 1` and `values: logits`"
        raise LaneError(f"{path}: cannot be used ({reason}); {remedy} (docs/own_network.md).") from error
    return model


def run_network(file: Path, inputs: np.ndarray, *, output: str = "", digest: str = "") -> np.ndarray:
    """An output of the network in an ONNX file; by name if it has several. See `read_network` for `digest`."""
    with _NETWORK_IN_USE:
        network = read_network(file, digest)
        network.setInput(inputs)
        return network.forward(output)


@lru_cache(maxsize=2)
def read_network(file: Path, digest: str) -> cv2.dnn.Net:
    """The network in an ONNX file, in the cache until it is called with another `digest` of the file's content.

    Raises LaneError if the file has another digest.
    """
    # OpenCV cannot open all names of folders on Windows
    return cv2.dnn.readNetFromONNX(np.frombuffer(read_onnx(file, digest).data, np.uint8))


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
