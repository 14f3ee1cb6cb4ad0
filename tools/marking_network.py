"""The network of `lanes.detect.markings` in PyTorch: its layers, training and ONNX
files. `tools.train_marking_network` is the command.

The mirrored picture has the mirrored response: filters come in mirrored pairs, so that
half of the weights are free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn
from torch.nn import functional as nnf

from lanes.detect.markings import FINE_ROWS
from tools.marking_samples import UNKNOWN, VIEW

# Layers: kernel and dilation (rows, columns). The first one reduces the finer view to
# the rows of the view; each other one adds to what the layers before it found. They
# reach over 47 rows, and 1.8 m to either side.
FIRST_KERNEL = (7, 5)
KERNEL = (3, 3)
DILATIONS = ((1, 1), (2, 2), (4, 4), (8, 8), (4, 16), (2, 2), (1, 1))
INPUTS = 4
CHANNELS = 16
OUTPUTS = 2
BATCH = 16
CROP_COLUMNS = 181
# Cells farther ahead than this count less, in proportion to the distance: the fit
# begins near the car.
WEIGHT_1_M = 15.0
ROW_WEIGHT = np.minimum(WEIGHT_1_M / VIEW.x_m, 1).astype(np.float32)


class MirroredConvolution(nn.Module):
    """A convolution whose filters come in pairs: the second half of them are the
    mirrored first half.

    The input has such pairs, too, unless it is the `first` layer. The mirrored input
    then has the mirrored output, in the other half of the channels.
    """

    def __init__(
        self,
        inputs: int,
        kernel: tuple[int, int],
        *,
        first: bool = False,
        **options: Any,
    ) -> None:
        super().__init__()
        self.first = first
        self.options = options
        # the layers that add to others begin with little
        gain = 2 if first else 0.5
        variance = gain / (inputs * kernel[0] * kernel[1])
        normal = torch.randn(CHANNELS // 2, inputs, *kernel)
        self.weight = nn.Parameter(normal * variance**0.5)
        self.bias = nn.Parameter(torch.zeros(CHANNELS // 2))

    def filters(self) -> tuple[torch.Tensor, torch.Tensor]:
        """All filters (outputs, inputs, rows, columns) and biases (outputs,)."""
        mirrored = self.weight.flip(3)
        if not self.first:
            # the inputs of a pair change places, too
            left, right = mirrored.chunk(2, dim=1)
            mirrored = torch.cat([right, left], dim=1)
        filters = torch.cat([self.weight, mirrored])
        biases = torch.cat([self.bias, self.bias])
        return filters, biases

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Filtered input."""
        filters, biases = self.filters()
        return nnf.conv2d(x, filters, biases, **self.options)


class MarkingNetwork(nn.Module):
    """Log odds (N, 2, rows, columns) of paint and of a road edge, of inputs (N, 4, fine
    rows, columns).
    """

    def __init__(self) -> None:
        super().__init__()
        # the middle row of the first group of rows is row 1
        rows, columns = FIRST_KERNEL
        self.first = MirroredConvolution(
            INPUTS,
            FIRST_KERNEL,
            first=True,
            stride=(FINE_ROWS, 1),
            padding=(rows // 2 - FINE_ROWS // 2, columns // 2),
        )
        self.layers = nn.ModuleList()
        for dilation in DILATIONS:
            layer = MirroredConvolution(
                CHANNELS, KERNEL, dilation=dilation, padding=dilation
            )
            self.layers.append(layer)
        self.last = nn.Parameter(torch.randn(OUTPUTS, CHANNELS // 2, 1, 1) * 0.1)
        self.bias = nn.Parameter(torch.full((OUTPUTS,), -4.0))

    def last_filter(self) -> torch.Tensor:
        """Filters (2, channels, 1, 1) of the last layer.

        Both filters of a pair have the same weight.
        """
        return torch.cat([self.last, self.last], dim=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Log odds."""
        found = features(x, self.first, self.layers)
        return nnf.conv2d(found, self.last_filter(), self.bias)


def features(x: torch.Tensor, first: nn.Module, layers: nn.ModuleList) -> torch.Tensor:
    """Output of the first layer, to which each of the others adds."""
    x = nnf.relu(first(x))
    for layer in layers:
        x = nnf.relu(x + layer(x))
    return x


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Samples of one kind.

    Attributes
    ----------
    name : str
    inputs : ndarray (N, 4, fine rows, columns), float16
    labels : ndarray (N, 2, rows, columns), uint8
    held_out : int
        Number of the last samples that only measure the network.
    """

    name: str
    inputs: np.ndarray
    labels: np.ndarray
    held_out: int


def train(
    data: Sequence[TrainingData],
    *,
    epochs: int,
    learning_rate: float,
    start: MarkingNetwork | None = None,
) -> MarkingNetwork:
    """The network trained on samples of all kinds together; prints the losses.

    Training begins with the weights of `start`, otherwise with random ones.
    """
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    network = start or MarkingNetwork()
    network = network.to(memory_format=torch.channels_last)
    places = []
    for kind, some in enumerate(data):
        for number in range(len(some.labels) - some.held_out):
            places.append((kind, number))
    batches = len(places) // BATCH
    optimiser = torch.optim.Adam(network.parameters(), lr=learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, learning_rate, total_steps=epochs * batches
    )

    for epoch in range(epochs):
        total = 0.0
        order = rng.permutation(places)[: batches * BATCH]
        for batch in order.reshape(batches, BATCH, 2):
            inputs, labels = _crop(data, batch, rng)
            loss = loss_of(network, inputs, labels)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item()
        losses = describe_held_out(network, data)
        print(f"epoch {epoch + 1}: loss {total / batches:.4f}, {losses}", flush=True)
    return network


def _crop(
    data: Sequence[TrainingData], batch: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and labels of some columns of samples: (N, 2) kind and number of each."""
    columns = data[0].labels.shape[3]
    left = int(rng.integers(columns - CROP_COLUMNS + 1))
    cropped = slice(left, left + CROP_COLUMNS)
    inputs = [data[kind].inputs[number][..., cropped] for kind, number in batch]
    labels = [data[kind].labels[number][..., cropped] for kind, number in batch]
    return np.stack(inputs), np.stack(labels)


def describe_held_out(network: MarkingNetwork, data: Sequence[TrainingData]) -> str:
    """The mean losses of the samples of each kind that are held out, in words."""
    words = []
    for some in data:
        first = len(some.labels) - some.held_out
        losses = []
        with torch.no_grad():
            for number in range(first, len(some.labels)):
                one = [number]
                loss = loss_of(network, some.inputs[one], some.labels[one])
                losses.append(float(loss))
        words.append(f"{some.name} held out {np.mean(losses):.4f}")
    return ", ".join(words)


def loss_of(
    network: MarkingNetwork, inputs: np.ndarray, labels: np.ndarray
) -> torch.Tensor:
    """Mean cross-entropy (nats) of the cells with a label, weighted by distance."""
    batch = torch.from_numpy(inputs.astype(np.float32))
    batch = batch.contiguous(memory_format=torch.channels_last)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        log_odds = network(batch).float()
    label = torch.from_numpy(labels)
    weight = torch.from_numpy(ROW_WEIGHT)[:, None] * (label != UNKNOWN)
    target = (label == 1).float()
    losses = nnf.binary_cross_entropy_with_logits(log_odds, target, reduction="none")
    return (weight * losses).sum() / weight.sum().clamp(min=1.0)


class PlainNetwork(nn.Module):
    """A trained network with all filters written out, for export."""

    def __init__(self, network: MarkingNetwork) -> None:
        super().__init__()
        self.first = _plain_layer(network.first)
        self.layers = nn.ModuleList(map(_plain_layer, network.layers))
        self.last = plain_convolution(network.last_filter(), network.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Log odds."""
        return self.last(features(x, self.first, self.layers))


def _plain_layer(layer: MirroredConvolution) -> nn.Conv2d:
    filters, biases = layer.filters()
    return plain_convolution(filters, biases, **layer.options)


def plain_convolution(
    filters: torch.Tensor, bias: torch.Tensor, **options: Any
) -> nn.Conv2d:
    """A convolution with all filters (outputs, inputs, rows, columns) written out."""
    outputs, inputs, *kernel = filters.shape
    convolution = nn.Conv2d(inputs, outputs, tuple(kernel), **options)
    convolution.load_state_dict({"weight": filters, "bias": bias})
    return convolution


def export(network: MarkingNetwork, path: Path) -> None:
    """Write the network as ONNX, for views of any size."""
    axes = {
        "inputs": {2: "fine_rows", 3: "columns"},
        "log_odds": {2: "rows", 3: "columns"},
    }
    torch.onnx.export(
        PlainNetwork(network).eval(),
        (torch.zeros(1, INPUTS, 366, 361),),
        str(path),
        input_names=["inputs"],
        output_names=["log_odds"],
        dynamic_axes=axes,
        dynamo=False,
    )


def read_network(path: Path) -> MarkingNetwork:
    """The network in a file that `export` has written.

    Raises ValueError if it is another network.
    """
    weights = {}
    for tensor in onnx.load(path).graph.initializer:
        weights[tensor.name] = torch.from_numpy(numpy_helper.to_array(tensor).copy())
    network = MarkingNetwork()
    half = CHANNELS // 2
    try:
        free = {"last": weights["last.weight"][:, :half], "bias": weights["last.bias"]}
        for name in network.state_dict():
            if name not in free:
                free[name] = weights[name][:half]
        network.load_state_dict(free)
        plain = PlainNetwork(network).state_dict()
        is_same = all(torch.equal(plain[name], weights[name]) for name in plain)
    except (KeyError, RuntimeError) as error:
        raise ValueError(f"{path}: is another network ({error!s:.200}).") from error
    if not is_same:
        raise ValueError(f"{path}: is another network: its filters are no pairs.")
    return network
