"""Train the network of `lanes.detect.markings` on rendered pictures, and write its ONNX
file.

    pip install torch onnx
    python -m tools.train_marking_network [--samples FILE] [--pictures N]
        [--epochs N] [-o FILE]

Rendering the samples (`tools.marking_samples`) takes about 40 minutes on two cores.
They are kept in FILE (2 GB), and used again if it exists. Training takes about 13
minutes. Another run gives slightly other weights.

The mirrored picture has the mirrored response: filters come in mirrored pairs, so that
half of the weights are free.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional as nnf

from lanes.camera.model import Camera, CameraPose
from lanes.console import bounded, progress_line
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.markings import FINE_ROWS, NETWORK_FILE, finer_view, network_inputs
from simulator.processes import available_workers, run_all
from tools.marking_samples import UNKNOWN, take_sample

# Layers: kernel and dilation (rows, columns). The first one reduces the finer view to
# the rows of the view; each other one adds to what the layers before it found. They
# reach over 47 rows, and 1.8 m to either side.
FIRST_KERNEL = (7, 5)
KERNEL = (3, 3)
DILATIONS = ((1, 1), (2, 2), (4, 4), (8, 8), (4, 16), (2, 2), (1, 1))
INPUTS = 4
CHANNELS = 16
OUTPUTS = 2
EPOCHS = 10
BATCH = 16
CROP_COLUMNS = 181
# Cells farther ahead than this count less, in proportion to the distance: the fit
# begins near the car.
WEIGHT_1_M = 15.0
LEARNING_RATE = 4e-3
# Share of the samples that are held out: the last ones, because successive samples show
# the same road.
HELD_OUT_SHARE = 1 / 12
VIEW = BirdsEyeView(Camera.from_fov((640, 360), 60, CameraPose(1.4)))
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


def train(inputs: np.ndarray, labels: np.ndarray, *, epochs: int) -> MarkingNetwork:
    """The network trained on inputs (N, 4, fine rows, columns); prints the losses.

    `labels` are (N, 2, rows, columns).
    """
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    network = MarkingNetwork().to(memory_format=torch.channels_last)
    trained_on = round(len(labels) * (1 - HELD_OUT_SHARE))
    held_out = range(trained_on, len(labels))
    batches = trained_on // BATCH
    optimiser = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, LEARNING_RATE, total_steps=epochs * batches
    )

    for epoch in range(epochs):
        total = 0.0
        order = rng.permutation(trained_on)[: batches * BATCH]
        for batch in order.reshape(batches, BATCH):
            left = int(rng.integers(labels.shape[3] - CROP_COLUMNS + 1))
            columns = slice(left, left + CROP_COLUMNS)
            cropped = inputs[batch][..., columns]
            loss = loss_of(network, cropped, labels[batch][..., columns])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item()

        with torch.no_grad():
            losses = [
                float(loss_of(network, inputs[[n]], labels[[n]])) for n in held_out
            ]
        print(
            f"epoch {epoch + 1}: loss {total / batches:.4f}, "
            f"held out {np.mean(losses):.4f}",
            flush=True,
        )
    return network


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
    return (weight * losses).sum() / weight.sum()


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


def load_samples(path: Path, pictures: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (N, 4, fine rows, columns) and labels (N, 2, rows, columns) from a file.

    It is made if it is missing.
    """
    if not path.exists():
        _write_samples(path, pictures)
    with np.load(path) as data:
        fine_images = data["fine_image"]
        focal_px = data["focal_px"].tolist()
        labels = data["label"]
    fine = finer_view(VIEW)
    inputs = []
    for image, focal in zip(fine_images, focal_px, strict=True):
        inputs.append(network_inputs(image, fine, focal).astype(np.float16))
    print(f"{len(inputs)} samples from {path}")
    return np.stack(inputs), labels


def _write_samples(path: Path, pictures: int) -> None:
    taken = run_all(
        take_sample,
        range(pictures),
        workers=available_workers(),
        progress=progress_line("pictures"),
    )
    samples = [sample for sample in taken if sample is not None]
    np.savez(
        path,
        fine_image=[sample.fine_image for sample in samples],
        label=[sample.label for sample in samples],
        focal_px=[sample.focal_px for sample in samples],
    )


def main() -> None:
    """Take samples, train, write the network."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--samples", type=Path, default=Path("marking_samples.npz"), metavar="FILE"
    )
    parser.add_argument("--pictures", type=bounded(int, 1), default=4320, metavar="N")
    parser.add_argument("--epochs", type=bounded(int, 1), default=EPOCHS, metavar="N")
    parser.add_argument(
        "-o", "--output", type=Path, default=NETWORK_FILE, metavar="FILE"
    )
    options = parser.parse_args()
    inputs, labels = load_samples(options.samples, options.pictures)
    network = train(inputs, labels, epochs=options.epochs)
    export(network, options.output)


if __name__ == "__main__":
    main()
