"""Lane lines in images as TuSimple JSON lines: detected here, labelled, or predicted by any program.

Each line of a file is a JSON object. `raw_file` is the image; that of a label is relative to the file. `h_samples` are
rows; a prediction without them has the rows of its label. `lanes` are columns at these rows, -2 without a point.
Optional are `sides` (the name of each line, "left" and "right" for the ego lane), `confidence` (0 to 1) and `run_time`
(milliseconds). Names are the same in all forms of Unicode: macOS decomposes letters with accents.

Detections have all of these, and `state`, `offset_m`, `curvature_per_m`, and `frame` for videos. Their first two lines
are the left and the right one of the ego lane. Far lines of adjacent lanes follow only if they are seen, because
TuSimple counts a line without points as a false positive.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any
from unicodedata import normalize

import numpy as np

from lanes.camera.model import Camera
from lanes.detect.lane import LOST, Lane, columns_at
from lanes.drive import DriveSettings, detect_stills, make_tracker, prepare_drive, track_frames
from lanes.errors import LaneError
from lanes.files import read_json_lines
from lanes.video.images import MAX_PIXELS, read_image
from lanes.video.reader import MIRRORED_WORDS, TimedFrame, read_frames

NO_POINT, EGO_SIDES = -2.0, ("left", "right")
# Rows that are closer are the same: some programs compute them.
SAME_ROW_PX = 0.01


@dataclass(frozen=True, eq=False)
class LaneColumns:
    """The lines in an image, with columns (K, R) at rows (R,), pixels, -2 without a point; `sides` are their names.

    `name` is `raw_file`, with / between its folders; `run_time_ms` is the time that a prediction took, 0 if not known.
    """

    name: str
    rows: np.ndarray
    columns: np.ndarray
    sides: tuple[str, ...] = ()
    confidence: float | None = None
    run_time_ms: float = 0.0

    @property
    def empty(self) -> bool:
        """Whether no line has a point: the label of an image without a lane."""
        return not (self.columns >= 0).any()

    @property
    def folder(self) -> str:
        """The first folder in `name`; "." without one."""
        return [*PurePosixPath(self.name).parts[:-1], "."][0]

    def at(self, rows: np.ndarray) -> np.ndarray:
        """Columns (K, N) at rows (N,), linearly interpolated between two of `rows`; -2 beyond them or next to a gap."""
        order, wanted = np.argsort(self.rows), np.round(rows, 2)
        known = np.append(-1, np.round(self.rows[order], 2))  # a row without points above all others
        points = np.where(self.columns < 0, np.nan, self.columns)[:, order]
        lines: np.ndarray = np.pad(points, ((0, 0), (1, 0)), constant_values=np.nan)
        at = [np.interp(wanted, known, line, left=np.nan, right=np.nan) for line in lines]
        return np.nan_to_num(np.reshape(at, (len(lines), len(wanted))), nan=NO_POINT)

    def lacking(self, rows: np.ndarray) -> np.ndarray:
        """Those of `rows` (N,) that are beyond its own ones, so that it has no point there."""
        low, high = (self.rows.min(), self.rows.max()) if len(self.rows) else (np.inf, -np.inf)
        return rows[(rows < low - SAME_ROW_PX) | (rows > high + SAME_ROW_PX)]

    def ego_lane(self, size: tuple[int, int]) -> LaneColumns:
        """Its left and right line in an image of `size` (width, height); a line that is missing has no points.

        Without names they are the nearest ones left and right of the bottom centre; two lines are always both of them.
        """
        width, height = size
        feet = np.array([_foot(self.rows, line, height - 1) for line in self.columns]) - (width - 1) / 2
        if self.sides:
            chosen = [self.sides.index(side) if side in self.sides else -1 for side in EGO_SIDES]
        elif len(feet) == 2:
            chosen = [1, 0] if feet[0] > feet[1] else [0, 1]  # a line without points, whose foot is NaN, stays in place
        else:
            near = [np.where(side, np.abs(feet), np.inf) for side in (feet <= 0, feet > 0)]
            chosen = [int(far.argmin()) if np.isfinite(far).any() else -1 for far in near]
        with_empty = np.pad(self.columns, ((0, 1), (0, 0)), constant_values=NO_POINT)
        return replace(self, columns=with_empty[chosen], sides=EGO_SIDES)


def _foot(rows: np.ndarray, line: np.ndarray, bottom: int) -> float:
    """Column where the extended lower half of a line meets the bottom of the image; NaN with fewer than 2 points."""
    labelled = np.flatnonzero(line >= 0)
    if len(labelled) < 2:
        return np.nan
    low = labelled[np.argsort(rows[labelled])][-max(2, len(labelled) // 2) :]
    return float(np.polyfit(rows[low] - bottom, line[low], 1)[1])


def read_labels(path: str | Path) -> list[LaneColumns]:
    """The labelled lines of each image; ValueError if a line is not a label, or its image lies elsewhere."""
    labels = _read(path, "label")
    for name in (label.name for label in labels):
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or "\0" in name:
            where = "lies outside of the folder of the labels; put it there, and write its path relative to that folder"
            raise ValueError(f"{path}: the picture {name!r} {where}.")
    return labels


def read_predictions(path: str | Path, labels: Sequence[LaneColumns]) -> list[LaneColumns | None]:
    """The prediction for the image of each label; None without one.

    The files may use different folders: paths are compared from their end, over as many parts as tell the images
    apart. Raises ValueError if a line is not a prediction, if two labels or two predictions are for the same image,
    or if no prediction is for a labelled one.
    """
    predictions = _read(path, "prediction", {normalize("NFC", label.name): label.rows for label in labels})
    for depth in range(1, 1 + max((len(PurePosixPath(label.name).parts) for label in labels), default=1)):
        names, found = ([_parts(some.name)[-depth:] for some in lines] for lines in (labels, predictions))
        both = [name for name in found if name in set(names)]
        if len(set(names)) == len(names) and len(set(both)) == len(both):
            break
    else:
        raise ValueError(f"{path}: two labels or two predictions are for the same picture; remove one.")
    if labels and not both:
        raise ValueError(f"{path}: has no prediction for any labelled image; raw_file must be the same in both files.")
    by_name = dict(zip(found, predictions, strict=True))
    return [by_name.get(name) for name in names]


def find_picture(folder: Path, name: str) -> Path:
    """Path of the image of a label, in the Unicode form of the file in the folder; as named if there is none."""
    forms = [folder / name, folder / normalize("NFC", name), folder / normalize("NFD", name)]  # the last is of macOS
    return next((path for path in forms if path.is_file()), forms[0])


def _parts(name: str) -> tuple[str, ...]:
    return PurePosixPath(normalize("NFC", name)).parts


def _read(path: str | Path, kind: str, rows_of: Mapping[str, np.ndarray] | None = None) -> list[LaneColumns]:
    """The lines in a file; predictions without `h_samples` are at the rows in `rows_of`, or left out."""
    found = []
    # a hundred thousand images with six lines at 56 rows have fewer bytes
    for number, entry in read_json_lines(path, kind, max_bytes=200_000_000):
        try:
            name = entry["raw_file"].replace("\\", "/")  # a file written on Windows has backslashes
            of_label = None if rows_of is None else rows_of.get(normalize("NFC", name))
            if rows_of is None or "h_samples" in entry or of_label is not None:
                found.append(_parse(name, entry.get("h_samples", of_label), entry))
        except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
            reason = f"entry {error} is missing" if isinstance(error, KeyError) else str(error)
            needs = "it needs raw_file, h_samples, and lanes with a column for each of these rows"
            raise ValueError(f"{path}: line {number} is not a {kind} ({reason:.200}); {needs}.") from error
    if not found:
        raise ValueError(f"{path}: holds no lanes; give JSON lines with raw_file, h_samples and lanes.")
    return found


def _parse(name: str, h_samples: object, entry: dict) -> LaneColumns:
    sides, confidence, rows = entry.get("sides") or [], entry.get("confidence"), np.array(h_samples, float)
    columns = np.array(entry["lanes"] or np.empty((0, rows.size)), float)
    if not name or rows.ndim != 1 or columns.ndim != 2 or columns.shape[1] != len(rows):
        raise ValueError(f"raw_file {name!r}, h_samples of shape {rows.shape}, lanes of shape {columns.shape}")
    if not ((rows >= 0) & (rows < MAX_PIXELS)).all() or not (np.abs(columns) < MAX_PIXELS).all():
        raise ValueError("a point is outside the image")
    if len(sides) not in (0, len(columns)) or not 0 <= (confidence or 0) <= 1:
        raise ValueError("sides does not name each of the lanes, or confidence is not a number from 0 to 1")
    run_time = entry.get("run_time")
    run_time_ms = float(run_time) if isinstance(run_time, int | float) else 0.0
    return LaneColumns(name, rows, columns, tuple(sides), confidence, run_time_ms)


# Detections.


def detect_in_video(video: Path, settings: DriveSettings, rows: Sequence[int] | None = None) -> Iterator[dict]:
    """Track the lane through a video; yields a detection per frame, with the columns of the lines at image `rows`.

    By default the rows are `usual_rows`. Prints the pose if it is estimated. Errors are those of `annotate`.
    """
    info, camera, pose = prepare_drive(video, settings)
    if pose:
        print(pose.describe())
    if info.mirrored:
        print(f"{video}: {MIRRORED_WORDS}")
    tracker = make_tracker(info.fps, camera, pose, settings.markings)
    part: dict[str, Any] = {"start_s": settings.start_s, "end_s": settings.end_s}
    with closing(read_frames(video, info, progress=settings.progress, **part)) as frames:
        for frame, lane in track_frames(frames, tracker):
            names = {"raw_file": f"{video}#{frame.number}", "frame": frame.number}
            yield names | as_detection(lane, tracker.camera, rows, frame.latency_ms)


def detect_in_sequence(
    stills: Sequence[Path], settings: DriveSettings, rows: Sequence[int] | None = None, *, fps: float
) -> Iterator[dict]:
    """Track the lane through stills that are consecutive frames, `fps` per second; otherwise as `detect_in_video`."""
    camera = settings.camera_for(read_image(stills[0]).shape[1::-1], stills[0])
    camera, pose = settings.ensure_pose(camera, stills)
    if pose:
        print(pose.describe())
    images = (camera.require_size(read_image(path), path) for path in stills)
    frames = (TimedFrame(number, number / fps, image, 1 / fps) for number, image in enumerate(images))
    tracker = make_tracker(fps, camera, pose, settings.markings)
    for frame, lane in track_frames(frames, tracker):
        yield {"raw_file": str(stills[frame.number])} | as_detection(lane, tracker.camera, rows, frame.latency_ms)


def detect_in_stills(
    stills: Sequence[Path], settings: DriveSettings, rows: Sequence[int] | None, failures: list[LaneError]
) -> Iterator[dict]:
    """Find the lane in each still independently, as `detect_in_video`; errors of unusable stills go to `failures`."""
    said = None
    for still in detect_stills(stills, settings, failures):
        if still.pose and still.pose.still:
            print(f"{still.path}: {still.pose.summary_line()}{settings.describe_lens(still.path)}")
        elif still.pose and still.pose is not said:
            said = still.pose
            print(said.describe())
        lane = still.detection.lane
        yield {"raw_file": str(still.path)} | as_detection(lane, still.detection.camera, rows, still.run_time_ms)


def usual_rows(height: int) -> range:
    """The lower rows of an image at which a lane is detected; of one 720 px high 420, 430, ... 700."""
    step = max(round(height / 72), 1)
    return range(42 * step, min(71 * step, height), step)


def as_detection(
    lane: Lane | None, camera: Camera, rows: Sequence[int] | np.ndarray | None, run_time_ms: float
) -> dict:
    """The detection in one image, without the file's name."""
    rows = np.asarray(usual_rows(camera.height) if rows is None else rows)
    lanes = np.full((2, len(rows)), NO_POINT) if lane is None else lane.columns(camera, rows)
    adjacent = lane.adjacent if lane else (None, None)
    far = {f"far {side}": line for side, line in zip(("left", "right"), adjacent, strict=True) if line}
    far_columns = columns_at(rows, [line.pixels(camera) for line in far.values()], camera)
    return {
        "h_samples": rows.tolist(),
        "lanes": np.round(np.vstack([lanes, far_columns]), 1).tolist(),
        "sides": ["left", "right", *far],
        "run_time": round(run_time_ms, 2),
        "state": lane.state if lane else LOST,
        "confidence": round(lane.confidence, 4) if lane else 0.0,
        "offset_m": lane and round(lane.offset_m, 4),
        "curvature_per_m": lane and round(lane.curvature_per_m, 7),
    }
