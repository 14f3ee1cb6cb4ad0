"""Train the network of `lanes.detect.network` on rendered pictures, and write its ONNX file.

    pip install torch onnx
    python -m tools.train_marking_network [--samples FILE] [--pictures N] [--epochs N] [-o FILE]

Rendering the samples (`tools.marking_samples`) takes about 36 minutes on two cores. They are kept in FILE (1.6 GB), and
used again if it exists. Training takes about 8 minutes. Another run gives slightly other weights.

The mirrored picture has the mirrored response: filters come in mirrored pairs, so that half of the weights are free.
"""

from __future__ import annotations

import argparse
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional as nnf

from lanes.camera import Camera, CameraPose
from lanes.console import bounded, progress_line
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.network import NETWORK, NETWORK_FILE, finer_view, network_inputs
from simulator.processes import available_workers, run_all
from tools.marking_samples import UNKNOWN, VARIETIES, take_sample

# Layers: kernel and dilation (rows, columns). The first one reduces the finer view to the rows of the view.
LAYERS = (((7, 5), (1, 1)), ((3, 5), (1, 1)), ((3, 5), (4, 1)), ((5, 5), (4, 2)))
INPUTS, CHANNELS, EPOCHS, BATCH, CROP_COLUMNS = 4, 16, 20, 16, 121
# Cells farther ahead than this count less, in proportion to the distance: the fit begins near the car.
WEIGHT_1_M = 15.0
LEARNING_RATE = 4e-3
# Every this many pictures are held out, with all their varieties: they show the same road.
HELD_OUT_EVERY = 12
VIEW = BirdsEyeView(Camera.from_fov((640, 360), 60, CameraPose(1.4)))
ROW_WEIGHT = np.minimum(WEIGHT_1_M / VIEW.x_m, 1).astype(np.float32)


class MirroredConvolution(nn.Module):
    """A convolution whose filters come in pairs: the second half of them are the mirrored first half.

    The input has such pairs, too, unless it is the `first` layer. The mirrored input then has the mirrored output, in
    the other half of the channels.
    """

    def __init__(self, inputs: int, outputs: int, kernel: tuple[int, int], *, first: bool, **options: Any) -> None:
        super().__init__()
        self.first, self.options = first, options
        fan_in = inputs * kernel[0] * kernel[1]
        self.weight = nn.Parameter(torch.randn(outputs // 2, inputs, *kernel) * (2 / fan_in) ** 0.5)
        self.bias = nn.Parameter(torch.zeros(outputs // 2))

    def filters(self) -> tuple[torch.Tensor, torch.Tensor]:
        """All filters (outputs, inputs, rows, columns) and biases (outputs,)."""
        half = self.weight.shape[1] // 2
        swapped = self.weight if self.first else torch.cat([self.weight[:, half:], self.weight[:, :half]], dim=1)
        return torch.cat([self.weight, swapped.flip(3)]), torch.cat([self.bias, self.bias])

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Filtered input."""
        return nnf.conv2d(x, *self.filters(), **self.options)


class MarkingNetwork(nn.Module):
    """Log odds of paint (N, 1, rows, columns) of inputs (N, 4, fine rows, columns)."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for number, (kernel, dilation) in enumerate(LAYERS):
            first = number == 0
            stride = (NETWORK.fine_rows, 1) if first else (1, 1)
            padding = tuple(d * (k // 2) for k, d in zip(kernel, dilation, strict=True))
            # the middle row of the first group of rows is row 1
            padding = (kernel[0] // 2 - NETWORK.fine_rows // 2, padding[1]) if first else padding
            options: dict[str, Any] = {"stride": stride, "padding": padding, "dilation": dilation}
            layers += [
                MirroredConvolution(INPUTS if first else CHANNELS, CHANNELS, kernel, first=first, **options),
                nn.ReLU(),
            ]
        self.layers = nn.Sequential(*layers)
        self.last = nn.Parameter(torch.randn(1, CHANNELS // 2, 1, 1) * 0.1)
        self.bias = nn.Parameter(torch.full((1,), -4.0))

    def last_filter(self) -> torch.Tensor:
        """Filter (1, channels, 1, 1) of the last layer: both filters of a pair have the same weight."""
        return torch.cat([self.last, self.last], dim=1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Log odds of paint."""
        return nnf.conv2d(self.layers(x), self.last_filter(), self.bias)


def train(inputs: np.ndarray, labels: np.ndarray, *, epochs: int) -> MarkingNetwork:
    """The network trained on inputs (N, 4, fine rows, columns) and labels (N, rows, columns); prints the losses."""
    torch.manual_seed(0)
    rng, network = np.random.default_rng(0), MarkingNetwork()
    held_out = np.arange(len(labels)) // len(VARIETIES) % HELD_OUT_EVERY == 0
    train_on = np.flatnonzero(~held_out)
    batches = len(train_on) // BATCH
    optimiser = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING_RATE, total_steps=epochs * batches)
    for epoch in range(epochs):
        total = 0.0
        for batch in rng.permutation(train_on)[: batches * BATCH].reshape(batches, BATCH):
            left = int(rng.integers(labels.shape[2] - CROP_COLUMNS + 1))
            columns = slice(left, left + CROP_COLUMNS)
            loss = loss_of(network, inputs[batch][..., columns], labels[batch][..., columns])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item()
        loss_held_out = held_out_loss(network, inputs, labels, held_out)
        print(f"epoch {epoch + 1}: loss {total / batches:.4f}, held out {loss_held_out:.4f}", flush=True)
    return network


def loss_of(network: MarkingNetwork, inputs: np.ndarray, labels: np.ndarray) -> torch.Tensor:
    """Mean cross-entropy (nats) of the cells with a known label, weighted by distance."""
    log_odds = network(torch.from_numpy(inputs.astype(np.float32)))[:, 0]
    label = torch.from_numpy(labels)
    weight = torch.from_numpy(ROW_WEIGHT)[:, None] * (label != UNKNOWN)
    losses = nnf.binary_cross_entropy_with_logits(log_odds, (label == 1).float(), reduction="none")
    return (weight * losses).sum() / weight.sum()


def held_out_loss(network: MarkingNetwork, inputs: np.ndarray, labels: np.ndarray, held_out: np.ndarray) -> float:
    """Mean loss of the held-out pictures."""
    with torch.no_grad():
        return float(np.mean([loss_of(network, inputs[[n]], labels[[n]]) for n in np.flatnonzero(held_out)]))


def plain_convolution(filters: torch.Tensor, bias: torch.Tensor, **options: Any) -> nn.Conv2d:
    """A convolution with all filters (outputs, inputs, rows, columns) written out."""
    outputs, inputs, *kernel = filters.shape
    convolution = nn.Conv2d(inputs, outputs, tuple(kernel), **options)
    convolution.load_state_dict({"weight": filters, "bias": bias})
    return convolution


def export(network: MarkingNetwork, path: Path) -> None:
    """Write the network as ONNX, for views of any size."""
    axes = {"inputs": {2: "fine_rows", 3: "columns"}, "log_odds": {2: "rows", 3: "columns"}}
    layers = [
        plain_convolution(*layer.filters(), **layer.options) if isinstance(layer, MirroredConvolution) else layer
        for layer in network.layers
    ]
    plain = nn.Sequential(*layers, plain_convolution(network.last_filter(), network.bias))
    torch.onnx.export(
        plain.eval(),
        (torch.zeros(1, INPUTS, 366, 361),),
        str(path),
        input_names=["inputs"],
        output_names=["log_odds"],
        dynamic_axes=axes,
        dynamo=False,
    )


def load_samples(path: Path, pictures: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (N, 4, fine rows, columns) float16 and labels (N, rows, columns); taken and written unless they exist."""
    if not path.exists():
        samples = run_all(take_sample, range(pictures), workers=available_workers(), progress=progress_line("pictures"))
        found = [sample for sample in samples if sample is not None]
        columns = zip(*(astuple(sample) for sample in found), strict=True)
        np.savez(path, **dict(zip(("fine_image", "label", "focal_px"), columns, strict=True)))
    with np.load(path) as data:
        fine, views = finer_view(VIEW), zip(data["fine_image"], data["focal_px"].tolist(), strict=True)
        inputs = [network_inputs(image, fine, focal_px).astype(np.float16) for image, focal_px in views]
        print(f"{len(inputs)} samples from {path}")
        return np.stack(inputs), data["label"]


def main() -> None:
    """Take samples, train, write the network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=Path, default=Path("marking_samples.npz"), metavar="FILE")
    parser.add_argument("--pictures", type=bounded(int, 1), default=3600, metavar="N")
    parser.add_argument("--epochs", type=bounded(int, 1), default=EPOCHS, metavar="N")
    parser.add_argument("-o", "--output", type=Path, default=NETWORK_FILE, metavar="FILE")
    options = parser.parse_args()
    inputs, labels = load_samples(options.samples, options.pictures)
    network = train(inputs, labels, epochs=options.epochs)
    export(network, options.output)


if __name__ == "__main__":
    main()
