"""Lane lines in images: detected here, labelled, or predicted by any program.

They are read from TuSimple JSON lines, and from the line strips of labelme, one file
(`lanes.labelme`) or a folder of them with its subfolders. Detections are written as
JSON lines.

Each of the JSON lines is an object. `raw_file` is the image; that of a label is
relative to the file. `h_samples` are rows; a prediction without them has the rows of
its label. `lanes` are columns at these rows, -2 without a point. Optional are `sides`
(the name of each line, "left" and "right" for the ego lane), `confidence` (0 to 1) and
`run_time` (milliseconds). Names are the same in all forms of Unicode: macOS decomposes
letters with accents.

Detections have all of these, and `state`, `offset_m`, `curvature_per_m`, and `frame`
for videos. Their first two lines are the left and the right one of the ego lane. Far
lines of adjacent lanes follow only if they are seen, because TuSimple counts a line
without points as a false positive.
"""

from __future__ import annotations

import posixpath
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any
from unicodedata import normalize

import numpy as np

from lanes.annotation import DriveSettings
from lanes.camera.model import Camera
from lanes.detect.lane import Lane, columns_at
from lanes.drive import make_tracker, prepare_drive, track_frames
from lanes.drive_camera import camera_for, describe_lens, pose_for
from lanes.errors import LaneError
from lanes.files import read_json_lines, read_text
from lanes.labelme import (
    CHECKED,
    LINE_NAMES,
    Drawing,
    columns_of,
    has_shapes,
    parse_drawing,
    parse_json,
)
from lanes.recording import MAX_PIXELS
from lanes.stills import detect_stills
from lanes.telemetry import LOST
from lanes.video.images import read_image
from lanes.video.reader import MIRRORED_WORDS, TimedFrame, read_frames

NO_POINT = -2.0
EGO_SIDES = LINE_NAMES[:2]
# Rows that are closer are the same: some programs compute them.
SAME_ROW_PX = 0.01
# More than a hundred thousand images with six lines at 56 rows need.
_MAX_BYTES = 200_000_000


@dataclass(frozen=True, eq=False)
class LaneColumns:
    """The lines in an image, as columns at rows.

    Attributes
    ----------
    name : str
        `raw_file`, with / between its folders.
    rows : ndarray (R,)
        Rows of the image, pixels, in any order.
    columns : ndarray (K, R)
        Column of each line at the rows, pixels; -2 without a point.
    sides : tuple of str
        Name of each line; empty if the lines have no names.
    confidence : float or None
        Probability, 0 to 1, that a program states for its prediction.
    run_time_ms : float
        Time that a prediction took, 0 if not known.
    size : (int, int) or None
        Width and height of the image that was labelled, if the file says them.
    checked : bool
        False for a label that is still as `lanes label` has written it.
    """

    name: str
    rows: np.ndarray
    columns: np.ndarray
    sides: tuple[str, ...] = ()
    confidence: float | None = None
    run_time_ms: float = 0.0
    size: tuple[int, int] | None = None
    checked: bool = True

    @property
    def empty(self) -> bool:
        """Whether no line has a point: the label of an image without a lane."""
        return not (self.columns >= 0).any()

    @property
    def folder(self) -> str:
        """The first folder in `name`; "." without one."""
        folders = PurePosixPath(self.name).parts[:-1]
        return folders[0] if folders else "."

    def at(self, rows: np.ndarray) -> np.ndarray:
        """Columns (K, N) at rows (N,), interpolated linearly between two of `rows`.

        They are -2 beyond the rows, and next to a row without a point.
        """
        order = np.argsort(self.rows)
        # Above all others a row without points, so that there is one to interpolate.
        known_rows = np.append(-1, np.round(self.rows[order], 2))
        points = np.where(self.columns < 0, np.nan, self.columns)[:, order]
        above = np.full((len(points), 1), np.nan)
        lines = np.hstack([above, points])

        wanted_rows = np.round(rows, 2)
        columns = np.full((len(lines), len(wanted_rows)), np.nan)
        for line, column in zip(lines, columns, strict=True):
            column[:] = np.interp(
                wanted_rows, known_rows, line, left=np.nan, right=np.nan
            )
        return np.nan_to_num(columns, nan=NO_POINT)

    def lacking(self, rows: np.ndarray) -> np.ndarray:
        """Those of `rows` (N,) beyond its own, so that it has no point there."""
        if not len(self.rows):
            return rows
        above = rows < self.rows.min() - SAME_ROW_PX
        below = rows > self.rows.max() + SAME_ROW_PX
        return rows[above | below]

    def ego_lane(self, size: tuple[int, int]) -> LaneColumns:
        """Its left and right line in an image of `size` (width, height).

        Without names they are the nearest ones left and right of the bottom centre;
        two lines are always both of them. A line that is missing has no points.
        """
        numbers = [_index_of(side, self.sides) for side in EGO_SIDES]
        if not self.sides:
            numbers = self._nearest_lines(size)
        missing = np.full((1, len(self.rows)), NO_POINT)
        with_missing = np.vstack([self.columns, missing])
        return replace(self, columns=with_missing[numbers], sides=EGO_SIDES)

    def _nearest_lines(self, size: tuple[int, int]) -> list[int]:
        """Numbers of the lines left and right of the bottom centre; -1 for none."""
        width, height = size
        centre = (width - 1) / 2
        feet = np.array([_foot(self.rows, line, height - 1) for line in self.columns])
        from_centre_px = feet - centre
        if len(feet) == 2:
            # A line without points, whose foot is NaN, stays in its place.
            swapped = bool(from_centre_px[0] > from_centre_px[1])
            return [1, 0] if swapped else [0, 1]
        left_px = np.where(from_centre_px <= 0, -from_centre_px, np.inf)
        right_px = np.where(from_centre_px > 0, from_centre_px, np.inf)
        return [_nearest(left_px), _nearest(right_px)]


def _index_of(side: str, sides: Sequence[str]) -> int:
    return sides.index(side) if side in sides else -1


def _nearest(distances_px: np.ndarray) -> int:
    """Index of the smallest finite distance (K,); -1 for none."""
    if not np.isfinite(distances_px).any():
        return -1
    return int(distances_px.argmin())


def _foot(rows: np.ndarray, line: np.ndarray, bottom: int) -> float:
    """Column where the lower half of a line, extended, meets the bottom of the image.

    NaN with fewer than two points.
    """
    labelled = np.flatnonzero(line >= 0)
    if len(labelled) < 2:
        return np.nan
    downwards = labelled[np.argsort(rows[labelled])]
    lower_half = downwards[-max(2, len(labelled) // 2) :]
    _, foot = np.polyfit(rows[lower_half] - bottom, line[lower_half], 1)
    return float(foot)


# Files of labels and predictions.


def read_labels(path: str | Path) -> list[LaneColumns]:
    """The labelled lines of each image, from a file, or from a folder of labelme files.

    Labels that nobody has checked are left out, with a warning. Raises ValueError if a
    file holds no label, if none is checked, or if an image is outside of the folder.
    """
    labels = _read(Path(path), "label")
    for label in labels:
        _require_inside(path, label.name)
    _require_one_each(path, "labels", [_parts(label.name) for label in labels])

    checked = [label for label in labels if label.checked]
    if not checked:
        raise ValueError(
            f"{path}: none of its {len(labels)} labels is checked; correct the lines "
            f"in labelme, and tick {CHECKED} under Flags."
        )
    if len(checked) < len(labels):
        left_out = [label.name for label in labels if not label.checked]
        more = " and more" if len(left_out) > 5 else ""
        warnings.warn(
            f"{path}: {len(left_out)} of {len(labels)} labels are left out, because "
            f"{CHECKED} is not ticked in labelme: {', '.join(left_out[:5])}{more}",
            stacklevel=2,
        )
    return checked


def _require_inside(path: str | Path, name: str) -> None:
    """Raise ValueError if an image lies outside of the folder of its label."""
    image = PurePosixPath(name)
    if image.is_absolute() or ".." in image.parts or "\0" in name:
        raise ValueError(
            f"{path}: the picture {name!r} lies outside of the folder of the labels; "
            "put it there, or give the folder that holds both."
        )


def labels_folder(path: str | Path) -> Path:
    """The folder that the names of the labels in a file or folder are relative to."""
    path = Path(path)
    return path if path.is_dir() else path.parent


def _require_one_each(
    path: str | Path, kind: str, names: Iterable[tuple[str, ...]]
) -> None:
    """Raise ValueError if a name, in its parts, is there twice."""
    (name, count), *_ = Counter(names).most_common(1) or [((), 0)]
    if count > 1:
        raise ValueError(
            f"{path}: {count} {kind} are for the same picture, {'/'.join(name)}; "
            "keep one of them."
        )


def files_of_labels(path: Path) -> list[Path]:
    """The files that labels or predictions are read from."""
    return sorted(path.rglob("*.json")) if path.is_dir() else [path]


def read_predictions(
    path: str | Path, labels: Sequence[LaneColumns]
) -> list[LaneColumns | None]:
    """The prediction for the image of each label; None without one.

    The files may use different folders: paths are compared from their end, over as many
    parts as tell the images apart. Raises ValueError if a line is not a prediction, if
    two labels or two predictions are for the same image, or if no prediction is for a
    labelled one.
    """
    predictions = _read(Path(path), "prediction")
    longest = max((len(_parts(label.name)) for label in labels), default=1)
    for depth in range(1, 1 + longest):
        names = [_parts(label.name)[-depth:] for label in labels]
        predicted = [_parts(found.name)[-depth:] for found in predictions]
        labelled = set(names)
        both = [name for name in predicted if name in labelled]
        if len(labelled) == len(names) and len(set(both)) == len(both):
            break
    _require_one_each(path, "predictions", both)
    if labels and not both:
        raise ValueError(
            f"{path}: has no prediction for any labelled image; raw_file must be the "
            "same in both files."
        )
    by_name = dict(zip(predicted, predictions, strict=True))
    matched: list[LaneColumns | None] = []
    for name, label in zip(names, labels, strict=True):
        found = by_name.get(name)
        if found and np.isnan(found.rows).any():
            found = _at_rows_of(label, found, path)
        matched.append(found)
    return matched


def _at_rows_of(
    label: LaneColumns, prediction: LaneColumns, path: str | Path
) -> LaneColumns:
    """A prediction without rows, at those of its label."""
    lines, columns = prediction.columns.shape
    if lines and columns != len(label.rows):
        raise ValueError(
            f"{path}: the prediction for {prediction.name} has no h_samples and "
            f"{columns} columns a line, but its label {len(label.rows)} rows; write "
            "h_samples."
        )
    columns_px = prediction.columns.reshape(lines, len(label.rows))
    return replace(prediction, rows=label.rows, columns=columns_px)


def find_picture(folder: Path, name: str) -> Path:
    """Path of the image of a label, in the Unicode form of the file in the folder.

    As named if there is none.
    """
    # macOS decomposes: NFD.
    forms = [name, normalize("NFC", name), normalize("NFD", name)]
    for form in forms:
        if (folder / form).is_file():
            return folder / form
    return folder / name


def _parts(name: str) -> tuple[str, ...]:
    return PurePosixPath(normalize("NFC", name)).parts


def _read(path: Path, kind: str) -> list[LaneColumns]:
    """The lines in a file, or in a folder of labelme files; `kind` is for messages."""
    if path.is_dir():
        return _read_folder(path)
    content = parse_json(read_text(path, kind, max_bytes=_MAX_BYTES))
    if has_shapes(content):
        return _as_columns({path: parse_drawing(path, content)}, path)
    return _read_lines(path, kind)


def _read_folder(folder: Path) -> list[LaneColumns]:
    """The lines in the labelme files of a folder and its subfolders, by their names.

    Other JSON files, such as those of a data set, are left out. Raises ValueError if a
    file is not JSON, or if there is none of labelme.
    """
    drawings = {}
    for file in sorted(folder.rglob("*.json")):
        hidden = file.name.startswith(".")  # macOS writes such as ._still.json
        if hidden or not file.is_file():
            continue
        content = parse_json(read_text(file, "label", max_bytes=_MAX_BYTES))
        if content is None:
            raise ValueError(
                f"{file}: is not JSON, as a file of labelme is; restore it, or move it "
                "out of the folder."
            )
        if has_shapes(content):
            drawings[file] = parse_drawing(file, content)
    if not drawings:
        raise ValueError(
            f"{folder}: is a folder without files of labelme; name another one, or a "
            "file of JSON lines."
        )
    return _as_columns(drawings, folder)


def _as_columns(drawings: Mapping[Path, Drawing], path: Path) -> list[LaneColumns]:
    """The lines of labelme files, with names relative to the folder of `path`."""
    strips = sum(len(drawing.strips) for drawing in drawings.values())
    other_shapes = sum(drawing.other_shapes for drawing in drawings.values())
    if other_shapes and not strips:
        raise ValueError(
            f"{path}: has {other_shapes} shapes, but no line strip; draw the lines "
            "as line strips."
        )

    file_of: dict[str, Path] = {}
    labels = []
    for file, drawing in drawings.items():
        beside = file.parent.relative_to(labels_folder(path)).as_posix()
        name = posixpath.normpath(posixpath.join(beside, drawing.image))
        other = file_of.setdefault(name, file)
        if other != file:
            raise ValueError(
                f"{file}: is of the same picture as {other}, {name}; remove one."
            )
        labels.append(_columns_of_drawing(name, drawing))
    return labels


def _columns_of_drawing(name: str, drawing: Drawing) -> LaneColumns:
    """Its lines at `label_rows`; those that cross none of them are left out."""
    width, height = drawing.size
    rows = label_rows(height)
    columns = np.full((len(drawing.strips), len(rows)), np.nan)
    for line, strip in zip(columns, drawing.strips, strict=True):
        line[:] = columns_of(strip.points_px, rows)

    # Half a pixel belongs to the pixel at the border.
    inside: np.ndarray = (columns >= -0.5) & (columns <= width - 0.5)
    columns = np.where(inside, columns.clip(0, width - 1), NO_POINT)
    has_points = np.flatnonzero(inside.any(axis=1))
    return LaneColumns(
        name,
        rows,
        columns[has_points],
        sides=tuple(drawing.sides[line] for line in has_points if drawing.sides),
        size=drawing.size,
        checked=drawing.checked,
    )


def label_rows(height: int) -> np.ndarray:
    """The rows (R,) of line strips that are compared, in an image `height` pixels high.

    At 720 px they are those of TuSimple: 160, 170, ..., 710.
    """
    step = max(round(height / 72), 1)
    return np.arange(16 * step, height, step)


def _read_lines(path: Path, kind: str) -> list[LaneColumns]:
    """The lines in a file of JSON lines; rows of predictions without them are NaN."""
    found = []
    for number, entry in read_json_lines(path, kind, max_bytes=_MAX_BYTES):
        try:
            name = entry["raw_file"].replace("\\", "/")  # written on Windows
            rows = entry.get("h_samples")
            if kind == "prediction" and "h_samples" not in entry:
                rows = np.full(max(map(len, entry["lanes"] or []), default=1), np.nan)
            found.append(_parse(name, rows, entry))
        except (
            AttributeError,
            KeyError,
            TypeError,
            ValueError,
            OverflowError,
        ) as error:
            missing = isinstance(error, KeyError)
            reason = f"entry {error} is missing" if missing else str(error)
            raise ValueError(
                f"{path}: line {number} is not a {kind} ({reason:.200}); it needs "
                "raw_file, h_samples, and lanes with a column for each of these rows."
            ) from error
    if not found:
        raise ValueError(
            f"{path}: holds no lanes; give JSON lines with raw_file, h_samples and "
            "lanes."
        )
    return found


def _parse(name: str, h_samples: object, entry: dict) -> LaneColumns:
    rows = np.array(h_samples, float)
    lanes = entry["lanes"] or np.empty((0, rows.size))
    columns = np.array(lanes, float)
    fits = rows.ndim == 1 and columns.ndim == 2 and columns.shape[1] == len(rows)
    if not name or not fits:
        raise ValueError(
            f"raw_file {name!r}, h_samples of shape {rows.shape}, "
            f"lanes of shape {columns.shape}"
        )
    rows_inside = np.isnan(rows) | ((rows >= 0) & (rows < MAX_PIXELS))
    columns_inside = np.abs(columns) < MAX_PIXELS
    if not rows_inside.all() or not columns_inside.all():
        raise ValueError("a point is outside the image")

    sides = entry.get("sides") or []
    if len(sides) not in (0, len(columns)):
        raise ValueError("sides does not name each of the lanes")
    confidence = entry.get("confidence")
    if not 0 <= (confidence or 0) <= 1:
        raise ValueError("confidence is not a number from 0 to 1")
    run_time = entry.get("run_time")
    run_time_ms = float(run_time) if isinstance(run_time, int | float) else 0.0
    return LaneColumns(name, rows, columns, tuple(sides), confidence, run_time_ms)


# Detections.


def detect_in_video(
    video: Path, settings: DriveSettings, rows: Sequence[int] | None = None
) -> Iterator[dict]:
    """Track the lane through a video; yields a detection per frame, lines at `rows`.

    By default the rows are `usual_rows`. Prints the pose if it is estimated. Errors are
    those of `annotate`.
    """
    info, camera, pose = prepare_drive(video, settings)
    if pose:
        print(pose.describe())
    if info.mirrored:
        print(f"{video}: {MIRRORED_WORDS}")

    tracker = make_tracker(info.fps, camera, pose, settings.markings)
    frames = read_frames(
        video,
        info,
        start_s=settings.start_s,
        end_s=settings.end_s,
        progress=settings.progress,
    )
    with closing(frames):
        for frame, lane in track_frames(frames, tracker):
            detection = as_detection(lane, tracker.camera, rows, frame.latency_ms)
            raw_file = f"{video}#{frame.number}"
            yield {"raw_file": raw_file, "frame": frame.number} | detection


def detect_in_sequence(
    stills: Sequence[Path],
    settings: DriveSettings,
    rows: Sequence[int] | None = None,
    *,
    fps: float,
) -> Iterator[dict]:
    """Track the lane through stills that are consecutive frames, `fps` per second.

    Otherwise as `detect_in_video`.
    """
    size = read_image(stills[0]).shape[1::-1]
    lens = camera_for(settings, size, stills[0])
    camera, pose = pose_for(settings, lens, stills)
    if pose:
        print(pose.describe())

    tracker = make_tracker(fps, camera, pose, settings.markings)
    frames = _frames_of_stills(stills, camera, fps)
    for frame, lane in track_frames(frames, tracker):
        detection = as_detection(lane, tracker.camera, rows, frame.latency_ms)
        yield {"raw_file": str(stills[frame.number])} | detection


def _frames_of_stills(
    stills: Sequence[Path], camera: Camera, fps: float
) -> Iterator[TimedFrame]:
    for number, path in enumerate(stills):
        image = read_image(path)
        camera.require_size(image, path)
        yield TimedFrame(number, number / fps, image, 1 / fps)


def detect_in_stills(
    stills: Sequence[Path],
    settings: DriveSettings,
    rows: Sequence[int] | None,
    failures: list[LaneError],
) -> Iterator[dict]:
    """Find the lane in each still independently, as `detect_in_video`.

    Errors of unusable stills go to `failures`.
    """
    printed_pose = None
    for still in detect_stills(stills, settings, failures):
        pose = still.pose
        if pose and pose.still:
            lens = describe_lens(settings, still.path)
            print(f"{still.path}: {pose.summary_line()}{lens}")
        elif pose and pose is not printed_pose:
            printed_pose = pose
            print(pose.describe())
        camera = still.detection.camera
        detection = as_detection(still.lane, camera, rows, still.run_time_ms)
        yield {"raw_file": str(still.path)} | detection


def usual_rows(height: int) -> range:
    """The lower rows of an image at which a lane is detected.

    Of an image 720 px high 420, 430, ... 700.
    """
    step = max(round(height / 72), 1)
    return range(42 * step, min(71 * step, height), step)


def as_detection(
    lane: Lane | None,
    camera: Camera,
    rows: Sequence[int] | np.ndarray | None,
    run_time_ms: float,
) -> dict[str, Any]:
    """The detection in one image, without the file's name."""
    if rows is None:
        rows = usual_rows(camera.height)
    rows = np.asarray(rows)
    detection = {
        "h_samples": rows.tolist(),
        "lanes": [[NO_POINT] * len(rows)] * 2,
        "sides": list(EGO_SIDES),
        "run_time": round(run_time_ms, 2),
        "state": LOST,
        "confidence": 0.0,
        "offset_m": None,
        "curvature_per_m": None,
    }
    if lane is None:
        return detection

    adjacent = zip(LINE_NAMES[2:], lane.adjacent, strict=True)
    far = {name: line.pixels(camera) for name, line in adjacent if line is not None}
    near_columns = lane.columns(camera, rows)
    far_columns = columns_at(rows, list(far.values()), camera)
    columns = np.vstack([near_columns, far_columns])
    return detection | {
        "lanes": np.round(columns, 1).tolist(),
        "sides": [*EGO_SIDES, *far],
        "state": lane.state,
        "confidence": round(lane.confidence, 4),
        "offset_m": round(lane.offset_m, 4),
        "curvature_per_m": round(lane.curvature_per_m, 7),
    }
