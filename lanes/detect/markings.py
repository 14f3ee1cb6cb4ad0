"""Networks that see lane markings: ours, and any other in an ONNX file.

Our network is small. It states for each cell of the bird's-eye view the probability
that it is paint. A worn line and a row of Botts' dots are too faint in each row of the
view for the band filter, but they line up over many rows. The network sees three rows
of a finer view for each row, and its surroundings: 47 rows, and 1.8 m to either side.
Its second output is the probability of an edge of the road. It has learned from
rendered images only (`tools/train_marking_network.py`). It takes much longer than the
band filter: the tracker uses it in five searches a second, while no sure lane is
tracked. OpenCV runs it.

The mask of another network, or of any function, takes the place of our evidence, or
joins it (docs/own_network.md). ONNX Runtime runs other networks: extra `network`.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from lanes.camera.model import Camera
from lanes.detect.birdseye import BirdsEyeView, lightness, yellowness
from lanes.errors import LaneError
from lanes.files import parse_yaml, read_text, require_file

# Our network.

NETWORK_FILE = Path(__file__).with_name("marking_network.onnx")
# Rows of the finer view for each row of the view.
FINE_ROWS = 3
# Largest log odds that our network states: rendered images are not real ones.
MAX_LOG_ODDS = 6.0
# A network of OpenCV keeps its input, so threads use it one after the other.
_NETWORK_IN_USE = threading.Lock()


@lru_cache(maxsize=2)
def finer_view(view: BirdsEyeView) -> BirdsEyeView:
    """The view with `FINE_ROWS` rows for each of its rows.

    Their middle one is at the same distance.
    """
    growth = (1 + view.growth) ** (1 / FINE_ROWS) - 1
    near_m = view.x_m[-1] / (1 + growth) ** (FINE_ROWS // 2)

    # half a row beyond the farthest one, so that rounding does not drop it
    rows = FINE_ROWS * len(view.x_m) - 0.5
    far_m = near_m * (1 + growth) ** rows
    return replace(view, near_m=near_m, far_m=far_m, growth=growth)


def network_inputs(
    fine_image: np.ndarray, fine: BirdsEyeView, focal_px: float
) -> np.ndarray:
    """Inputs of our network for an image of the finer view.

    Lightness and yellowness relative to their scatter make the response nearly
    independent of exposure. Lightness relative to its mean shows that a faint streak on
    a very smooth road is not paint. The fourth input is the width of a pixel in cells:
    far away, lines are as wide as their blur.

    The weights of the network have to be trained again if a number here changes.

    Parameters
    ----------
    fine_image : ndarray of shape (fine rows, columns, 3), uint8
    fine : BirdsEyeView
    focal_px : float
        Focal length of the raw image.

    Returns
    -------
    ndarray of shape (4, fine rows, columns), float32
    """
    light = lightness(fine_image).astype(np.float32)
    yellow = yellowness(fine_image).astype(np.float32)
    light_mean, light_contrast, light_scatter = _local_contrast(light, fine)
    _, yellow_contrast, yellow_scatter = _local_contrast(yellow, fine)

    # 16 grey levels, so that black images have no contrast
    relative = light_contrast / (light_mean + 16.0)

    cells_per_pixel = fine.x_m / (focal_px * fine.cell_m)
    pixel_width = np.log2(1 + cells_per_pixel).astype(np.float32)
    pixel_widths = np.broadcast_to(pixel_width[:, None], relative.shape)

    return np.stack(
        [
            light_contrast / light_scatter,
            yellow_contrast / yellow_scatter,
            relative,
            pixel_widths,
        ]
    )


def _local_contrast(
    channel: np.ndarray, view: BirdsEyeView
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Local mean of a channel, contrast to it, and the scatter of the contrast."""
    # wheel tracks are wider than the window of the mean, so they are no scatter
    mean = _window_mean(channel, 1.05, view)
    contrast = channel - mean

    # OpenCV's running sums may round a zero down
    variance = np.maximum(_window_mean(contrast**2, 2.5, view), 0)
    # rounding and sensor noise are about two grey levels
    scatter = np.sqrt(variance) + 2.0
    return mean, contrast, scatter


def _window_mean(
    channel: np.ndarray, window_m: float, view: BirdsEyeView
) -> np.ndarray:
    columns = round(window_m / view.cell_m) | 1
    return cv2.blur(channel, (columns, 15))


def network_log_odds(image: np.ndarray, view: BirdsEyeView) -> np.ndarray:
    """Log odds of paint and of road edges that our network states.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        The raw image.
    view : BirdsEyeView

    Returns
    -------
    ndarray of shape (2, rows, columns), float32
        At most `MAX_LOG_ODDS`.
    """
    fine = finer_view(view)
    inputs = network_inputs(fine.warp(image), fine, view.focal_px)
    with _NETWORK_IN_USE:
        network = _own_network()
        network.setInput(inputs[None])
        (log_odds,) = network.forward()
    return np.minimum(log_odds, MAX_LOG_ODDS)


@lru_cache(maxsize=1)
def _own_network() -> cv2.dnn.Net:
    # from memory: OpenCV cannot open all names of folders on Windows
    data = np.frombuffer(NETWORK_FILE.read_bytes(), np.uint8)
    return cv2.dnn.readNetFromONNX(data)


# Masks of other networks and of functions.

# From a raw RGB image (height, width, 3), uint8, to the mask of its lane markings:
# probabilities (rows, columns), 0 to 1, of the whole image, also at a lower resolution.
MaskFunction = Callable[[np.ndarray], np.ndarray]


# Distance of a point that is on the horizon.
_HORIZON_M = 1e5
# A window is used if at least this share of it lies in the image.
_LEAST_IN_IMAGE = 0.25


@dataclass(frozen=True)
class TrainingWindow:
    """The part of an image that looks like the images that a network was trained on.

    It is as wide as the image, and the horizon is where it is in the training images.

    Attributes
    ----------
    horizon : float
        Row of the horizon in the training images, as a share of their height.
    aspect_ratio : float
        Width of the training images over their height.
    """

    horizon: float
    aspect_ratio: float = 16 / 9

    def rows(self, camera: Camera) -> tuple[int, int]:
        """First row of the window in the images of a camera with a pose, and the row
        below its last one; they may lie outside of the image.

        All rows of portrait images, in which such a window shows little road, and of
        images that the window hardly meets.
        """
        whole = (0, camera.height)
        height = camera.width / self.aspect_ratio
        horizon_px = horizon_row(camera)
        if camera.height > camera.width or not np.isfinite(horizon_px):
            return whole

        top = round(horizon_px - self.horizon * height)
        bottom = top + round(height)
        in_image = min(bottom, camera.height) - max(top, 0)
        return (top, bottom) if in_image > _LEAST_IN_IMAGE * height else whole


def horizon_row(camera: Camera) -> float:
    """Row of the horizon straight ahead in the raw images of a camera with a pose.

    NaN beyond the range of the lens model.
    """
    pixels = camera.road_to_pixels(np.array([[_HORIZON_M, 0.0]]))
    return float(pixels[0, 1])


def crop_rows(image: np.ndarray, rows: tuple[int, int]) -> np.ndarray:
    """The image from one row to another; outside of it the nearest row is repeated."""
    top, bottom = rows
    height = len(image)
    inside = image[max(top, 0) : bottom]
    above = max(-top, 0)
    below = max(bottom - height, 0)
    if not above and not below:
        return inside
    return cv2.copyMakeBorder(inside, above, below, 0, 0, cv2.BORDER_REPLICATE)


@dataclass(frozen=True)
class MarkingSource:
    """A function that finds lane markings, and how its mask is used.

    Attributes
    ----------
    function : callable
        From an RGB image (height, width, 3), uint8, to a mask (rows, columns) of
        probabilities, 0 to 1, of all of it, at any resolution.
    with_own : bool
        Whether the mask joins our evidence instead of replacing it.
    confidence_shift : float
        Added to the log odds of the confidence of lanes found with it.
    window : TrainingWindow, optional
        The part of each raw image that the function gets; by default all of it.
    """

    function: MaskFunction
    with_own: bool = False
    confidence_shift: float = 0.0
    window: TrainingWindow | None = None

    def __str__(self) -> str:
        return f"{self._name}{',own' if self.with_own else ''}"

    @property
    def _name(self) -> str:
        if isinstance(self.function, OnnxNetwork):
            return str(self.function.file)
        return getattr(self.function, "__name__", str(self.function))

    def window_rows(self, camera: Camera) -> tuple[int, int]:
        """First row of the window in the images of a camera with a pose, and the row
        below its last one; without a window those of the image.
        """
        return self.window.rows(camera) if self.window else (0, camera.height)

    def find_mask(self, image: np.ndarray) -> np.ndarray:
        """The mask (rows, columns) float32 of an image or of its window.

        Raises LaneError if it is no mask.
        """
        mask = np.asarray(self.function(image), np.float32)
        _require_probabilities(mask, self._name)
        if not isinstance(self.function, OnnxNetwork):
            _require_upright(mask, image, self._name)
        return np.clip(mask, 0, 1)


# What the parameters `markings` take.
Markings = MarkingSource | MaskFunction


def as_source(markings: Markings) -> MarkingSource:
    """A function as a source with the defaults; a source as it is."""
    if isinstance(markings, MarkingSource):
        return markings
    return MarkingSource(markings)


def _require_probabilities(mask: np.ndarray, name: str) -> None:
    low = np.nan
    high = np.nan
    if mask.size:
        low = mask.min()
        high = mask.max()

    # NaN fails the comparison
    within = low >= -1e-3 and high <= 1 + 1e-3
    if mask.ndim != 2 or not within:
        raise LaneError(
            f"{name}: returned an array of shape {mask.shape} with values from {low:g} "
            f"to {high:g}; a mask has shape (rows, columns) and probabilities, 0 to 1."
        )


def _require_upright(mask: np.ndarray, image: np.ndarray, name: str) -> None:
    """Refuse a mask with the aspect ratio of the turned image."""
    rows, columns = mask.shape
    height, width = image.shape[:2]
    is_turned = abs(rows * height - columns * width) < rows
    if rows != columns and is_turned:
        raise LaneError(
            f"{name}: returned a mask (rows, columns) {mask.shape} of an image "
            f"{(height, width)}; turn it."
        )


# Networks in ONNX files.

# Input sizes: markings are seen from the first on; the second costs half a gigabyte.
MIN_INPUT_PX, MAX_INPUT_PX = 8, 4096
# Types of inputs that an image is converted to, as ONNX Runtime names them.
_TYPES: Mapping[str, Any] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
}


@dataclass(frozen=True, kw_only=True)
class NetworkSettings:
    """Entries of the YAML file beside an ONNX file: see docs/own_network.md."""

    input_size: Sequence[int]
    channel: int | Sequence[int]
    values: str
    output: str = ""
    colour_order: str = "RGB"
    mean: float | Sequence[float] = 0.0
    scale: float | Sequence[float] = 1 / 255
    confidence_shift: float = 0.0
    horizon: float | None = None

    def __post_init__(self) -> None:
        for size in self.input_size:
            if not isinstance(size, int) or not MIN_INPUT_PX <= size <= MAX_INPUT_PX:
                limits = f"{MIN_INPUT_PX} to {MAX_INPUT_PX} pixels each"
                raise ValueError(f"input_size is [width, height], {limits}")
        if self.values not in ("logits", "probabilities"):
            raise ValueError("values are logits or probabilities")
        if self.colour_order not in ("RGB", "BGR"):
            raise ValueError("colour_order is RGB or BGR")
        if self.horizon is not None and not 0 < self.horizon < 1:
            raise ValueError(
                "horizon is a share of the height of the training images, 0 to 1"
            )

    @property
    def window(self) -> TrainingWindow | None:
        """The window with the aspect ratio of the input, if a horizon is given."""
        if self.horizon is None:
            return None
        width, height = self.input_size
        return TrainingWindow(float(self.horizon), width / height)


@dataclass(frozen=True)
class OnnxNetwork:
    """A function from an image to the mask of its markings: a network in a file.

    `digest` is that of the model and its weights. It can be sent to other processes,
    which open the file there.
    """

    file: Path
    digest: str
    settings: NetworkSettings

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """The mask (rows, columns) of a raw RGB image (height, width, 3), uint8."""
        network = open_network(self.file, self.digest)
        inputs = self._inputs_of(image, network.get_inputs()[0])
        names = [self.settings.output] if self.settings.output else None
        output = network.run(names, {network.get_inputs()[0].name: inputs})[0]
        channels = self._channels_of(output)

        wanted = np.ravel(self.settings.channel)
        for channel in wanted:
            if not 0 <= channel < len(channels):
                raise LaneError(
                    f"{self.file}: its output of shape {output.shape} has no channel "
                    f"{channel}, from 0 on."
                )
        if self.settings.values == "logits":
            channels = _softmax(channels)
        return channels[wanted].sum(axis=0)

    def _inputs_of(self, image: np.ndarray, expected: Any) -> np.ndarray:
        """The image as the network's first input, which is `expected`."""
        swap = self.settings.colour_order == "BGR"
        pixels = cv2.dnn.blobFromImage(
            image, 1.0, self.settings.input_size, swapRB=swap
        )
        mean = np.reshape(np.array(self.settings.mean, np.float32), (-1, 1, 1))
        scale = np.reshape(np.array(self.settings.scale, np.float32), (-1, 1, 1))

        if expected.type == "tensor(uint8)":
            is_usual = np.isin(np.round(scale * 255), (1, 255)).all()
            if mean.any() or not is_usual:
                raise LaneError(
                    f"{self.file}: its input is uint8, the pixels as they are; "
                    "omit mean and scale."
                )
            values = pixels
        else:
            values = (pixels - mean) * scale

        if _has_channels_last(expected.shape):
            values = np.moveaxis(values, 1, 3)
        if len(expected.shape) == 3:
            values = values[0]
        return np.ascontiguousarray(values, dtype=_TYPES[expected.type])

    def _channels_of(self, output: np.ndarray) -> np.ndarray:
        """The channels (channels, rows, columns) of an output, channels first or last.

        Raises LaneError if it has not the aspect ratio of the input.
        """
        width, height = self.settings.input_size
        channels = output[0] if output.ndim == 4 else output
        channels = channels[None] if channels.ndim == 2 else channels
        if channels.ndim == 3:
            for found in (channels, np.moveaxis(channels, 2, 0)):
                rows, columns = found.shape[1:]
                too_high = abs(rows - columns * height / width)
                too_wide = abs(columns - rows * width / height)
                if min(too_high, too_wide) <= 1:
                    return found
        raise LaneError(
            f"{self.file}: its output of shape {output.shape} is no mask of its input, "
            f"{width}x{height} pixels; expected (1, channels, rows, columns) or "
            "(1, rows, columns, channels) with the aspect ratio of the input."
        )


def _softmax(logits: np.ndarray) -> np.ndarray:
    """Probabilities of the channels; a single one is the logarithm of the odds."""
    compared = logits
    if len(logits) == 1:
        compared = np.concatenate([logits, np.zeros_like(logits)])
    return np.exp(logits - np.logaddexp.reduce(compared))


def load_markings(name: str | Path) -> MarkingSource:
    """The network in an ONNX file with its YAML file.

    If ",own" follows the name, its stripes join ours. It is tried on a black image.

    >>> markings = load_markings("model.onnx")  # doctest: +SKIP
    >>> lanes.find_lane(image, camera, markings=markings)  # doctest: +SKIP

    Raises
    ------
    FileNotFoundError, LaneError
        If a file is missing or cannot be used, or a package of the extra `network` is
        not installed.
    """
    file = Path(str(name).removesuffix(",own")).absolute()
    with_own = str(name).endswith(",own")
    path = require_file(file, "ONNX", error=LaneError).with_suffix(".yaml")
    _import_onnx(file)
    try:
        settings = _read_settings(path)
        network = OnnxNetwork(file, read_onnx(file)[1], settings)
        _require_fit(network)
        source = MarkingSource(
            network,
            with_own=with_own,
            confidence_shift=float(settings.confidence_shift),
            window=settings.window,
        )
        source.find_mask(np.zeros((8, 8, 3), np.uint8))
    except Exception as error:  # the libraries raise many types
        reason = " ".join(str(getattr(error, "err", error)).split()).rstrip(".")
        raise LaneError(
            f"{path}: cannot be used ({reason}); write what the network needs, such as "
            "`input_size: [640, 360]`, `channel: 1` and `values: logits` "
            "(docs/own_network.md)."
        ) from error
    return source


def _read_settings(path: Path) -> NetworkSettings:
    text = read_text(path, "YAML", error=LaneError, max_bytes=100_000)
    entries = parse_yaml(text)
    if not isinstance(entries, dict):
        raise yaml.YAMLError(
            "its content must be a mapping, `name: value` in each line"
        )
    return NetworkSettings(**entries)


def _require_fit(network: OnnxNetwork) -> None:
    """Refuse a network that takes no image, or an output that it does not have."""
    session = open_network(network.file, network.digest)
    expected = session.get_inputs()[0]
    shape = [size if isinstance(size, int) else None for size in expected.shape]
    _require_image_input(network.file, expected.type, shape)

    height_and_width = shape[-3:-1] if _has_channels_last(shape) else shape[-2:]
    width, height = network.settings.input_size
    if height_and_width == [width, height] and width != height:
        raise LaneError(
            f"{network.file}: its input is {height} wide and {width} high; "
            "input_size is [width, height]."
        )

    names = [output.name for output in session.get_outputs()]
    wanted = network.settings.output
    if wanted not in names and (wanted or len(names) > 1):
        outputs = ", ".join(names)
        raise ValueError(f"the outputs are {outputs}; write `output:` and one of them")


def _require_image_input(file: Path, kind: str, shape: Sequence[int | None]) -> None:
    """Refuse a first input that is no RGB image; without a shape it may be one."""
    channels = shape[-1] if _has_channels_last(shape) else shape[-3] if shape else None
    is_single = list(shape[:-3]) in ([], [1], [None])
    has_shape = len(shape) in (0, 3, 4) and channels in (3, None)
    if kind not in _TYPES or not has_shape or not is_single:
        sizes = ", ".join("any" if size is None else str(size) for size in shape)
        raise LaneError(
            f"{file}: its input is {kind} of shape ({sizes}); a network for markings "
            "takes one RGB image, (1, 3, height, width) or (1, height, width, 3), as "
            "float or uint8."
        )


def _has_channels_last(shape: Sequence[Any]) -> bool:
    """Whether an input is (1, height, width, 3)."""
    return len(shape) >= 3 and shape[-1] == 3 and shape[-3] != 3


@lru_cache(maxsize=2)
def open_network(file: Path, digest: str) -> Any:
    """ONNX Runtime's session of the network in a file, as it was with this digest.

    It is cached until it is called with another digest. Raises LaneError if the file
    has another one.
    """
    onnxruntime = _import_onnx(file)
    data, found = read_onnx(file)
    if found != digest:
        raise LaneError(
            f"{file}: changed during the run, or differs between machines; "
            "use one file for a run."
        )
    options = onnxruntime.SessionOptions()
    # as OpenCV: a worker of many drives has one thread
    options.intra_op_num_threads = cv2.getNumThreads()
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    # layouts for one kind of CPU round differently, and TwinLiteNet takes 0.69 s
    # instead of 0.40 s with them (one thread of an Intel Xeon, ONNX Runtime 1.32)
    levels = onnxruntime.GraphOptimizationLevel
    options.graph_optimization_level = levels.ORT_ENABLE_EXTENDED
    # errors are raised; they need not be printed as well
    options.log_severity_level = 4
    providers = ["CPUExecutionProvider"]
    return onnxruntime.InferenceSession(data, options, providers=providers)


def read_onnx(file: Path) -> tuple[bytes, str]:
    """The model in a file with the weights in its folder, and the digest of both.

    The package `onnx` refuses weights that are cut off, or in another folder. It reads
    all weights into the model, so that what is run is what has the digest.
    """
    import onnx

    require_file(file, "ONNX", error=LaneError)
    model = onnx.load(file)
    data = model.SerializeToString(deterministic=True)
    return data, hashlib.sha256(data).hexdigest()


def network_files(markings: Markings) -> list[Path]:
    """The files that a network is read from: model, YAML file, weights."""
    network = as_source(markings).function
    if not isinstance(network, OnnxNetwork):
        return []
    import onnx

    model = onnx.load(network.file, load_external_data=False)
    files = {network.file, network.file.with_suffix(".yaml")}
    for weights in model.graph.initializer:
        for entry in weights.external_data:
            if entry.key == "location":
                files.add(network.file.with_name(entry.value))
    return sorted(files)


def runtime_versions(markings: Markings) -> dict[str, str]:
    """Versions of what runs a network, by name; empty for a function."""
    if not isinstance(as_source(markings).function, OnnxNetwork):
        return {}
    try:
        import onnxruntime
    except ImportError:
        return {"ONNX Runtime": "missing"}
    return {"ONNX Runtime": onnxruntime.__version__}


def _import_onnx(file: Path) -> Any:
    """The package `onnxruntime`; LaneError if the extra `network` is not installed."""
    try:
        import onnx  # noqa: F401  # reads the file
        import onnxruntime
    except ImportError as error:
        raise LaneError(
            f"{file}: networks of others need two packages ({error}); "
            "run `pip install onnx onnxruntime`."
        ) from error
    return onnxruntime
