"""labelme's files: the lines that a person draws on an image, in a JSON file beside it.

`lanes label` writes such files, `lanes score` reads them. Their form is that of labelme
6.3.1 (https://github.com/wkentaro/labelme). It shows an image upright, as its EXIF
orientation says; `imageWidth` and `imageHeight` are those of the upright image.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from lanes.files import write_atomically
from lanes.recording import MAX_PIXELS

LABELME_VERSION = "6.3.1"
# Labels of the lines: of the ego lane, and the far lines of the adjacent lanes.
LINE_NAMES = ("left", "right", "far left", "far right")
# A flag of the file, which labelme shows as a box to tick: a person has seen the lines.
CHECKED = "checked"
# labelme counts from the corner of the first pixel, we count from its centre, pixels.
_CORNER_TO_CENTRE_PX = 0.5
_LINE_SHAPES = ("linestrip", "line")


@dataclass(frozen=True, eq=False)
class LineStrip:
    """A line through points.

    Attributes
    ----------
    name : str
        Its label in labelme.
    points_px : ndarray (N, 2)
        Column and row of each point in the upright image, N >= 2.
    """

    name: str
    points_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Drawing:
    """The lines in a labelme file.

    Attributes
    ----------
    image : str
        Path of the image relative to the file, with / between folders.
    size : (int, int)
        Width and height of the upright image.
    strips : tuple of LineStrip
    checked : bool
        False as long as the file is as `lanes label` has written it.
    other_shapes : int
        Number of shapes that are no lines, such as boxes around cars.
    """

    image: str
    size: tuple[int, int]
    strips: tuple[LineStrip, ...]
    checked: bool = True
    other_shapes: int = 0

    @property
    def sides(self) -> tuple[str, ...]:
        """The names of the lines; empty if they do not say which line is which."""
        names = tuple(strip.name for strip in self.strips)
        return names if set(names) <= set(LINE_NAMES) else ()


def write_drawing(path: Path, drawing: Drawing) -> Path:
    """Write a labelme file atomically; returns the path. Raises OSError."""
    width, height = drawing.size
    content = {
        "version": LABELME_VERSION,
        "flags": {CHECKED: drawing.checked},
        "shapes": [_as_shape(strip) for strip in drawing.strips],
        "imagePath": drawing.image,
        "imageData": None,
        "imageHeight": height,
        "imageWidth": width,
    }
    # ASCII only: labelme then opens names with bytes that are not valid UTF-8.
    text = json.dumps(content, indent=2)
    write_atomically(path, text.encode())
    return path


def _as_shape(strip: LineStrip) -> dict[str, Any]:
    from_corner_px = strip.points_px + _CORNER_TO_CENTRE_PX
    return {
        "label": strip.name,
        "points": np.round(from_corner_px, 1).tolist(),
        "group_id": None,
        "description": "",
        "shape_type": "linestrip",
        "flags": {},
        "mask": None,
    }


def parse_json(text: str) -> Any:
    """The content of a JSON file; None if the text is none, such as JSON lines."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def has_shapes(content: object) -> bool:
    """Whether the content of a JSON file is that of a labelme file."""
    return isinstance(content, dict) and "shapes" in content


def parse_drawing(path: Path, content: Mapping[str, Any]) -> Drawing:
    """The lines in the content of the labelme file `path`.

    Raises ValueError if the file is damaged, or if a line has a wrong label: in a file
    of `lanes label`, or with one of `LINE_NAMES`, each line has another one of them.
    """
    try:
        image = content["imagePath"].replace("\\", "/")  # written on Windows
        size = _parse_size(content["imageWidth"], content["imageHeight"])
        flags = dict(content.get("flags") or {})
        shapes = [(shape["shape_type"], shape) for shape in content["shapes"]]
        lines = [shape for kind, shape in shapes if kind in _LINE_SHAPES]
        others = [shape for kind, shape in shapes if kind not in _LINE_SHAPES]
        strips = tuple(_parse_strip(shape) for shape in lines)
        other_names = {shape["label"] for shape in others}
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        missing = isinstance(error, KeyError)
        reason = f"entry {error} is missing" if missing else f"{error!s:.200}"
        raise ValueError(
            f"{path}: is not a file of labelme ({reason}); open it there, and save it."
        ) from error
    if not image:
        raise ValueError(f"{path}: names no image; write its name into imagePath.")
    names = [strip.name for strip in strips]
    named = CHECKED in flags or not set(names).isdisjoint(LINE_NAMES)
    if named:
        _require_line_names(path, names)
    misdrawn = other_names.intersection(LINE_NAMES)
    if named and misdrawn:
        raise ValueError(
            f"{path}: the shape {min(misdrawn)!r} is no line; draw it as a line strip."
        )
    checked = flags.get(CHECKED) is not False
    return Drawing(image, size, strips, checked, other_shapes=len(others))


def _parse_size(width: object, height: object) -> tuple[int, int]:
    if type(width) is not int or type(height) is not int:
        raise ValueError(f"imageWidth {width!r}, imageHeight {height!r}")
    if min(width, height) < 1 or width * height > MAX_PIXELS:
        raise ValueError(f"an image of {width}x{height} pixels")
    return width, height


def _parse_strip(shape: Mapping[str, Any]) -> LineStrip:
    name = shape["label"]
    if not isinstance(name, str):
        raise TypeError(f"label {name!r}")
    from_corner_px = np.array(shape["points"], float)
    if from_corner_px.ndim != 2 or from_corner_px.shape[1] != 2:
        raise ValueError(f"points of shape {from_corner_px.shape}")
    if len(from_corner_px) < 2:
        raise ValueError("a line with a single point")
    if not (np.abs(from_corner_px) < MAX_PIXELS).all():
        raise ValueError("a point far outside the image")
    return LineStrip(name, from_corner_px - _CORNER_TO_CENTRE_PX)


def _require_line_names(path: Path, names: Sequence[str]) -> None:
    """Raise ValueError unless each line has another one of `LINE_NAMES`."""
    for name, count in Counter(names).items():
        if name not in LINE_NAMES:
            nearest = get_close_matches(name, LINE_NAMES, n=1)
            hint = f" (perhaps {nearest[0]!r})" if nearest else ""
            raise ValueError(
                f"{path}: the label {name!r}{hint} is none of "
                f"{', '.join(LINE_NAMES)}; rename the line in labelme."
            )
        if count > 1:
            raise ValueError(
                f"{path}: has {count} lines {name!r}; join them in labelme, or rename "
                "those of other lanes."
            )


def columns_of(points_px: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Columns (R,) at rows (R,) of the line through points (N, 2); NaN beside it.

    The line is straight between two points, as labelme draws it. If it crosses a row
    more than once, the crossing that comes first from its lower end counts.
    """
    downwards = points_px[0, 1] < points_px[-1, 1]
    from_below_px = points_px[::-1] if downwards else points_px

    columns = np.full(len(rows), np.nan)
    for begin, end in zip(from_below_px[:-1], from_below_px[1:], strict=True):
        lower, upper = max(begin[1], end[1]), min(begin[1], end[1])
        if lower == upper:
            continue
        crossed = (rows >= upper) & (rows <= lower) & np.isnan(columns)
        columns_per_row = (end[0] - begin[0]) / (end[1] - begin[1])
        columns[crossed] = begin[0] + columns_per_row * (rows[crossed] - begin[1])
    return columns
