"""Markings from any network: the mask of a function takes the place of our marking response, or joins it.

A mask is wider than paint: it is thinned in the bird's-eye view, and a stripe is placed by the band filter where that
sees it, too. A network is an ONNX file, with a YAML file beside it (docs/own_network.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.network import read_network, run_network
from lanes.detect.onnx_file import MAX_INPUT_PX, MIN_INPUT_PX, NetworkForm, read_onnx
from lanes.detect.paint import PAINT, PaintSettings
from lanes.errors import LaneError
from lanes.files import parse_yaml, read_text, require_file

# From a raw RGB image (height, width, 3), uint8, to the mask of its lane markings: probabilities (rows, columns), 0 to
# 1, of the whole image, also at a lower resolution.
Markings = Callable[[np.ndarray], np.ndarray]
# The centre of a stripe is that of the mask within this distance, if it has this share of the largest probability
# there, and if the mean is below the other share of it: else it is an area. Larger probabilities are no more certain.
REACH_M, _CENTRE_SHARE, _AREA_SHARE, _MAX_PROBABILITY = 0.75, 0.5, 0.9, 0.99


@dataclass(frozen=True, eq=False)
class Mask:
    """Probabilities (rows, columns) float32 of lane markings in one image; see `find_mask`."""

    probability: np.ndarray
    with_own: bool
    confidence_shift: float

    def strength(self, view: BirdsEyeView, settings: PaintSettings = PAINT) -> np.ndarray:
        """Strengths (rows, columns) float32 of the mask's lines in a view."""
        of_image = cv2.convertScaleAbs(cv2.resize(self.probability, view.camera.size), alpha=255)
        in_view = view.warp(cv2.cvtColor(of_image, cv2.COLOR_GRAY2RGB))[..., 0] / np.float32(255)
        return thin(in_view, view, settings)


def thin(probability: np.ndarray, view: BirdsEyeView, settings: PaintSettings = PAINT) -> np.ndarray:
    """Strengths (rows, columns) float32: parabolas, three columns wide, at the centres of stripes in a view's mask."""
    reach = round(REACH_M / view.cell_m)
    kernels = np.ones(2 * reach + 1), np.arange(-reach, reach + 1.0)
    mass, moment = (cv2.sepFilter2D(probability, -1, k, np.ones(1), borderType=cv2.BORDER_REPLICATE) for k in kernels)
    columns = moment / np.maximum(mass, 1e-6)
    top = np.minimum(cv2.dilate(probability, np.ones((1, 2 * reach + 1))), _MAX_PROBABILITY)
    is_line = (probability > _CENTRE_SHARE * top) & (mass < _AREA_SHARE * top * (2 * reach + 1))
    strength = settings.half_weight_strength * np.sqrt(top / (1 - top)) * (1 - (columns / 3) ** 2)
    return np.where(is_line & (np.abs(columns) <= 1.5) & view.seen, strength, np.float32(0))


def find_mask(image: np.ndarray, markings: Markings | None) -> Mask | None:
    """The mask that a function finds, and its attributes `with_own` and `confidence_shift`, if any; None without one.

    Raises LaneError if it is no mask.
    """
    if not markings:
        return None
    mask, name = np.asarray(markings(image), np.float32), getattr(markings, "__name__", markings)
    low, high = (mask.min(), mask.max()) if mask.size else (np.nan, np.nan)
    if mask.ndim != 2 or not (low >= -1e-3 and high <= 1 + 1e-3):  # also for NaN
        found = f"an array of shape {mask.shape} with values from {low:g} to {high:g}"
        raise LaneError(f"{name}: returned {found}; a mask has shape (rows, columns) and probabilities, 0 to 1.")
    (rows, columns), (height, width) = mask.shape, image.shape[:2]
    if not isinstance(markings, MarkingModel) and rows != columns and abs(rows * height - columns * width) < rows:
        raise LaneError(f"{name}: returned a mask (rows, columns) {mask.shape} of an image {(height, width)}; turn it.")
    with_own, shift = getattr(markings, "with_own", False), getattr(markings, "confidence_shift", 0.0)
    return Mask(np.clip(mask, 0, 1), with_own, float(shift))


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
