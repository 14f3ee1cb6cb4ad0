"""Train the network of `lanes.detect.markings` on rendered images, and on labelled
stills of real roads, and write its ONNX file.

Without --real, the network is trained as the one in use was: rendering the samples
(`tools.marking_samples`) takes about 40 minutes on two cores, training about 13. The
samples are kept in a file (2 GB), and used again if it exists. Another run gives
slightly other weights.

--real adds stills with labels of `lanes label` (labelme), TuSimple JSON lines, or a
folder of `benchmark.real_roads` (`tools.real_samples`). --start goes on with a trained
network, for which a tenth of the rendered images is enough. --teacher adds frames
between the labelled ones of clips. Printed are the losses of samples that are held out,
among them those of the last stills.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from benchmark.real_roads.sets import RoadSet, add_processing_arguments
from lanes.camera.model import load_camera
from lanes.console import bounded, progress_line, run_command, run_program
from lanes.detect.markings import (
    NETWORK_FILE,
    finer_view,
    load_markings,
    network_inputs,
)
from lanes.errors import LaneError
from simulator.processes import available_workers, run_all
from tools.marking_samples import VIEW, Sample, take_sample
from tools.real_samples import RealSamples, read_sets, take_real_samples

if TYPE_CHECKING:
    from tools.marking_network import TrainingData

PROGRAM = "python -m tools.train_marking_network"
EXAMPLES = """\
  {program}
  {program} --real my_labels --start lanes/detect/marking_network.onnx -o my.onnx
  {program} --real found_roads --half A --teacher twinlitenet.onnx -o half_a.onnx"""
EPOCHS = 10
LEARNING_RATE = 4e-3
# Share of the samples that are held out: the last ones, because successive samples show
# the same road.
HELD_OUT_SHARE = 1 / 12


def import_network() -> ModuleType:
    """`tools.marking_network`; LaneError if its packages are not installed."""
    try:
        from tools import marking_network
    except ImportError as error:
        raise LaneError(
            f"training needs two packages ({error}); run `pip install torch onnx`."
        ) from error
    return marking_network


# Rendered samples.


def load_rendered(path: Path, pictures: int) -> TrainingData:
    """The rendered samples in a file; it is made if it is missing."""
    if not path.exists():
        _write_samples(path, pictures)
    samples = []
    with np.load(path) as data:
        columns = (data["fine_image"], data["label"], data["focal_px"].tolist())
        for image, label, focal_px in zip(*columns, strict=True):
            samples.append(Sample(image, label, focal_px))
    held_out = max(round(len(samples) * HELD_OUT_SHARE), 1)
    print(f"{len(samples)} rendered samples from {path}")
    return as_data("rendered", samples, held_out)


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


def as_data(name: str, samples: Sequence[Sample], held_out: int) -> TrainingData:
    """Samples as inputs and labels of the network."""
    fine = finer_view(VIEW)
    inputs = []
    for sample in samples:
        of_sample = network_inputs(sample.fine_image, fine, sample.focal_px)
        inputs.append(of_sample.astype(np.float16))
    labels = np.stack([sample.label for sample in samples])
    network = import_network()
    return network.TrainingData(name, np.stack(inputs), labels, held_out)


# Real samples.


def take_real(options: argparse.Namespace) -> list[Sample]:
    """Samples of labelled stills; prints how many, and which stills gave none.

    Raises LaneError if there is no sample.
    """
    sets: list[RoadSet] = []
    for folder in options.real:
        some = read_sets(folder, options.camera, options.several_cameras)
        sets += [roads for roads in some if roads.half in options.half]
    teacher = load_markings(options.teacher) if options.teacher else None
    take = partial(take_real_samples, views=options.views, teacher=teacher)
    taken: list[RealSamples] = run_all(
        take, sets, workers=options.workers, progress=progress_line("sets")
    )

    samples = []
    for roads, of_set in zip(sets, taken, strict=True):
        print(f"{roads.name}: {len(of_set.samples)} samples of {of_set.images} images")
        for reason in of_set.skipped:
            print(f"  left out: {reason}")
        samples += of_set.samples
    if not samples:
        raise LaneError("no labelled still gives a sample; see what was left out.")
    return samples


def load_real(options: argparse.Namespace) -> TrainingData:
    """The samples of labelled stills; those of the last stills are held out."""
    samples = take_real(options)
    stills = round(len(samples) / options.views * HELD_OUT_SHARE)
    return as_data("real", samples, max(stills, 1) * options.views)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this command."""
    parser.add_argument(
        "--samples",
        type=Path,
        default=Path("marking_samples.npz"),
        metavar="FILE",
        help="rendered samples, made if missing (default: %(default)s)",
    )
    parser.add_argument(
        "--pictures",
        type=bounded(int, 32),
        default=4320,
        metavar="N",
        help="rendered images of a new file of samples (default: %(default)s)",
    )
    _add_real_arguments(parser)
    parser.add_argument(
        "--start", type=Path, metavar="FILE", help="network to go on with"
    )
    parser.add_argument(
        "--epochs",
        type=bounded(int, 1),
        default=EPOCHS,
        metavar="N",
        help="times that each sample is used (default: %(default)s)",
    )
    parser.add_argument(
        "--learning-rate",
        type=bounded(float, 1e-6),
        default=LEARNING_RATE,
        metavar="RATE",
        help="largest one (default: %(default)s)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=NETWORK_FILE,
        metavar="FILE",
        help="network that is written (default: the one in use)",
    )


def _add_real_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--real",
        type=Path,
        action="append",
        default=[],
        metavar="FOLDER",
        help="folder or file of labels, also several times",
    )
    parser.add_argument(
        "--half",
        choices=("A", "B", "AB"),
        default="AB",
        help="of the sets of --real (default: both halves)",
    )
    parser.add_argument(
        "--camera",
        type=load_camera,
        metavar="FILE",
        help="lens of these stills, and pose if it has one (default: as EXIF says, or "
        "60 degrees wide)",
    )
    parser.add_argument(
        "--views",
        type=bounded(int, 1),
        default=8,
        metavar="N",
        help="samples of each still (default: %(default)s)",
    )
    parser.add_argument(
        "--teacher",
        type=Path,
        metavar="ONNX",
        help="network that checks our tracked lanes in clips (docs/own_network.md)",
    )
    add_processing_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Take samples, train, write the network."""
    network = import_network()
    start = network.read_network(options.start) if options.start else None
    data = []
    if options.real:
        data.append(load_real(options))
    data.append(load_rendered(options.samples, options.pictures))
    trained = network.train(
        data,
        epochs=options.epochs,
        learning_rate=options.learning_rate,
        start=start,
    )
    network.export(trained, options.output)
    print(f"wrote {options.output}")
    return 0


def main() -> int:
    """Run the command; returns its exit status."""
    return run_command(sys.modules[__name__], PROGRAM, sys.argv[1:])


if __name__ == "__main__":
    run_program(main)
