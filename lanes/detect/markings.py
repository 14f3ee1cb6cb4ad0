"""Markings from any network: the mask of a function takes the place of our marking response, or joins it.

A mask is wider than paint: in the bird's-eye view each run of a row is thinned to its centre, and the stripe is placed
by the band filter where that sees it, too. A function is made of an ONNX file and of a YAML file beside it, which says
what the network needs (docs/own_network.md); OpenCV runs it.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import yaml

from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.network import learned_evidence, place
from lanes.detect.paint import PAINT, FrameEvidence, MarkingResponse, Stripes, find_stripes
from lanes.errors import LaneError
from lanes.files import read_text, require_file

# From a raw RGB image (height, width, 3), uint8, to the mask of its lane markings: probabilities (rows, columns), 0 to
# 1, of the whole image, also at a lower resolution.
Markings = Callable[[np.ndarray], np.ndarray]
# The cells of a run have at least this share of the largest probability within this distance. Wider runs are no lines.
RUN_SHARE, RUN_WINDOW_M, MAX_RUN_M = 0.5, 0.5, 2.0
# Larger probabilities are no more certain: many networks state nearly 1 for all that they find.
MAX_PROBABILITY = 0.99
# Follows the name of a file whose stripes join ours.
OWN = ",own"
# The networks keep their input, so threads use them one after the other.
_NETWORK_IN_USE = threading.Lock()


@dataclass(frozen=True, eq=False)
class Mask:
    """Probabilities (rows, columns) float32 of lane markings in one image; see `find_mask`."""

    probability: np.ndarray
    with_own: bool
    confidence_shift: float

    def evidence(self, own: FrameEvidence) -> FrameEvidence:
        """What the mask shows, in place of the `own` evidence of the same image, or joined with it."""
        view = own.view
        of_image = cv2.convertScaleAbs(cv2.resize(self.probability, view.camera.size), alpha=255)
        strength = thin(view.warp(cv2.cvtColor(of_image, cv2.COLOR_GRAY2RGB))[..., 0] / np.float32(255), view)
        stripes = find_stripes(MarkingResponse(strength, own.response.channels), view)
        # a cell of the mask may be larger than a pixel
        cell_m = view.camera.width / self.probability.shape[1] * stripes.x_m / view.focal_px
        stripes = replace(stripes, std_m=np.maximum(stripes.std_m, np.hypot(PAINT.position_std_m, cell_m)))
        if self.with_own:
            strength, stripes = np.maximum(strength, own.response.strength), _join(own.stripes, stripes, view)
        else:
            stripes, clear = place(stripes, own.response.strength, view)
            stripes = replace(stripes, measurable=clear)
        response = replace(own.response, strength=strength, learned=True)
        return replace(own, response=response, stripes=stripes, confidence_shift=self.confidence_shift)


def thin(probability: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """Strengths (rows, columns) float32: ridges at the centres of the runs in the rows of probabilities of a view.

    Runs that the border of the image or of the view cuts off are left out, because their centre is unknown.
    """
    window = np.ones((1, 2 * round(RUN_WINDOW_M / view.cell_m) + 1))
    run = probability >= np.maximum(RUN_SHARE * cv2.dilate(probability, window), 0.01)
    # all rows in one, with an empty column at either end of each
    run, seen, p = (np.pad(cells, ((0, 0), (1, 1))).ravel() for cells in (run, view.seen, probability))
    first, end = np.flatnonzero(run[1:] != run[:-1]).reshape(-1, 2).T + 1
    whole = seen[first - 1] & seen[end] & (end - first <= MAX_RUN_M / view.cell_m)
    bounds = np.stack([first[whole], end[whole]], axis=1).ravel()
    mass, moment = (np.add.reduceat(values, bounds)[::2] for values in (p, p * np.arange(float(len(p)))))
    row, column = np.divmod(moment / mass, view.shape[1] + 2)
    top = np.minimum(np.maximum.reduceat(p, bounds)[::2], MAX_PROBABILITY)
    ridges = np.zeros((view.shape[0], view.shape[1] + 2), np.float32)
    for cell in np.rint(column) + [[-1], [0], [1]]:
        # three samples of a parabola, from which `peak_position` finds its vertex
        height = PAINT.half_weight_strength * np.sqrt(top / (1 - top)) * (1 - ((cell - column) / 3) ** 2)
        np.maximum.at(ridges, (row.astype(int), cell.astype(int)), height)
    return ridges[:, 1:-1]


def _join(own: Stripes, of_mask: Stripes, view: BirdsEyeView) -> Stripes:
    """Both stripes; one of the mask within two columns of own paint adds to its weight, as independent evidence."""
    column, nearby = (np.rint((view.y_m[0] - stripes.y_m) / view.cell_m).astype(int) + 2 for stripes in (own, of_mask))
    index, paint = np.full((view.shape[0], view.shape[1] + 4), -1), np.flatnonzero(~own.edge)
    index[own.row[paint], column[paint]] = paint
    same = index[of_mask.row[:, None], nearby[:, None] + np.arange(-2, 3)].max(axis=1)
    doubt = 1 - own.weight
    np.multiply.at(doubt, same[same >= 0], 1 - of_mask.weight[same >= 0])
    return replace(own, weight=1 - doubt).joined(replace(of_mask, measurable=same >= 0).select(same < 0))


def find_mask(image: np.ndarray, markings: Markings | None) -> Mask | None:
    """The mask that a function finds in an image; None without a function. Raises LaneError if it is no mask.

    If the function has the attributes `with_own` (its stripes join ours) and `confidence_shift`, they are used.
    """
    if not markings:
        return None
    mask, name = np.asarray(markings(image)), getattr(markings, "__name__", markings)
    if mask.ndim != 2 or not mask.size or mask.dtype.kind not in "fbiu":
        raise LaneError(f"{name}: returned {mask.shape} {mask.dtype}; a mask has numbers of shape (rows, columns).")
    # also false for NaN
    if not (mask.min() >= -1e-3 and mask.max() <= 1 + 1e-3):
        found = f"a mask with values from {mask.min():g} to {mask.max():g}"
        raise LaneError(f"{name}: returned {found}; they must be probabilities, 0 to 1, not logits or grey levels.")
    with_own, shift = getattr(markings, "with_own", False), getattr(markings, "confidence_shift", 0.0)
    return Mask(np.clip(mask, 0, 1).astype(np.float32), with_own, float(shift))


def look_closer(image: np.ndarray, band: FrameEvidence, mask: Mask | None) -> FrameEvidence:
    """`learned_evidence`, joined with the mask; that of the mask alone if it takes the place of ours."""
    own = band if mask and not mask.with_own else learned_evidence(image, band)
    return mask.evidence(own) if mask else own


@dataclass(frozen=True)
class MarkingModel:
    """A network in an ONNX file, with the entries of its YAML file (docs/own_network.md): a function of `Markings`.

    It can be sent to another process, and called by several threads. `digest` is that of the ONNX file.
    """

    file: Path
    digest: str
    with_own: bool
    input_size: Sequence[int]
    channel: int | Sequence[int]
    values: str
    output: str = ""
    colour_order: str = "RGB"
    scale: float = 1 / 255
    mean: Sequence[float] = (0.0, 0.0, 0.0)
    std: Sequence[float] = (1.0, 1.0, 1.0)
    confidence_shift: float = 0.0

    def __str__(self) -> str:
        return f"{self.file}{OWN if self.with_own else ''}"

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """The mask of a raw image (height, width, 3), uint8, RGB. Raises LaneError if the YAML file is wrong."""
        pixels = cv2.resize(image, self.input_size, interpolation=cv2.INTER_AREA)
        pixels = pixels if self.colour_order == "RGB" else pixels[..., ::-1]
        inputs = (pixels * np.float32(self.scale) - np.array(self.mean)) / np.array(self.std)
        try:
            with _NETWORK_IN_USE:
                network = _read_network(self.file, self.digest)
                network.setInput(np.ascontiguousarray(inputs.transpose(2, 0, 1)[None], np.float32))
                output = network.forward(self.output)
        except cv2.error as error:
            raise LaneError(f"{self.file}: OpenCV cannot run it on {self.input_size} pixels ({error.err}).") from error
        channels, wanted = output[0] if output.ndim == 4 else output, np.ravel(self.channel)
        if channels.ndim != 3 or max(wanted) >= len(channels):
            reason = f"its output has the shape {output.shape}, not (1, channels, rows, columns) with the channel"
            raise LaneError(f"{self.file}: {reason} {max(wanted)}, counted from 0.")
        if self.values == "logits":
            # a single channel is that of two, of which one is 0
            channels = channels if len(channels) > 1 else np.concatenate([channels, np.zeros_like(channels)])
            channels = np.exp(channels - channels.max(axis=0))
            channels /= channels.sum(axis=0)
        return channels[wanted].sum(axis=0)


@lru_cache(maxsize=2)
def _read_network(file: Path, digest: str) -> cv2.dnn.Net:
    """The network in a file, which is read again if the `digest` of its content is another one."""
    # OpenCV cannot open all names of folders on Windows
    return cv2.dnn.readNetFromONNX(np.frombuffer(require_file(file, "ONNX").read_bytes(), np.uint8))


def load_markings(name: str | Path) -> MarkingModel:
    """The network in an ONNX file with its YAML file; if ",own" follows the name, its stripes join ours.

    >>> lanes.find_lane(image, camera, markings=load_markings("model.onnx"))  # doctest: +SKIP

    It is tried on a black image. Raises FileNotFoundError or LaneError if a file is missing or cannot be used.
    """
    file = Path(str(name).removesuffix(OWN)).absolute()
    digest = hashlib.sha256(require_file(file, "ONNX", error=LaneError).read_bytes()).hexdigest()
    path = file.with_suffix(".yaml")
    remedy = "it needs `input_size: [640, 360]`, `channel: 1` and `values: logits` or the like (docs/own_network.md)."
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file; write it: {remedy}")
    try:
        entries = yaml.safe_load(read_text(path, "YAML", error=LaneError, max_bytes=100_000))
        model = MarkingModel(file, digest, str(name).endswith(OWN), **entries)
        if model.values not in ("logits", "probabilities") or model.colour_order not in ("RGB", "BGR"):
            raise ValueError("values are logits or probabilities, colour_order is RGB or BGR")
        find_mask(np.zeros((8, 8, 3), np.uint8), model)
        names = _read_network(file, digest).getUnconnectedOutLayersNames()
        if len(names) > 1 and not model.output:
            raise ValueError(f"`output` is missing, one of {', '.join(names)}")
    except (yaml.YAMLError, cv2.error, RecursionError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise LaneError(f"{path}: does not fit the network ({reason}); {remedy}") from error
    return model
