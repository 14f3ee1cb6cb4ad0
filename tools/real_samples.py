"""Samples for `tools.train_marking_network` from labelled stills of real roads.

Labels are those that `lanes score` reads (TuSimple JSON lines, files of labelme), or a
folder of `benchmark.real_roads`. The camera pose is that of the stills of a set: of the
first folder in the names of the labels. A still without a pose is left out.

A labelled line is paint in the label of a sample, also between its dashes. If the band
filter sees hardly any paint along a line, it is an edge of the road. Cells between two
labelled lines are neither. All other cells are open, because not every line of a road
is labelled. Each still gives several views: the second and the next ones have a small
pose error, and are exposed, blurred and compressed at random as rendered images are.

A teacher adds frames between the labelled ones of clips. Their lines are those that our
tracker follows with a high confidence. Cells in which the mask of the teacher differs
are open.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from benchmark.real_roads.sets import LABELS, RoadSet, read_road_sets
from lanes.camera.field_of_view import find_field_of_view
from lanes.camera.model import Camera
from lanes.detect.birdseye import BirdsEyeView
from lanes.detect.evidence import PAINT, marking_response, mask_in_view
from lanes.detect.markings import Markings, as_source, crop_rows, finer_view
from lanes.drive import make_tracker, track_frames
from lanes.errors import CameraError, LaneError, PictureError, PoseError
from lanes.labels import (
    EGO_SIDES,
    LaneColumns,
    find_picture,
    labels_folder,
    read_labels,
    usual_rows,
)
from lanes.pose.estimate import ASSUMED, POSE_PICTURES, PoseEstimate, ensure_pose
from lanes.video.images import read_image
from lanes.video.reader import inspect_video, read_frames
from lanes.video.sources import sample_images
from tools.marking_samples import UNKNOWN, VARIETIES, Sample, degrade, with_pose_error

# Half width of the strip that is labelled as the line, without the error of the label:
# standard deviation of a labelled column in images of this width.
LINE_HALF_WIDTH_M = 0.075
LABEL_STD_PX = 1.6
LABEL_WIDTH_PX = 1280
# Cells up to this distance from a line are open: wide lines, the second stripe of a
# double line, the gutter of a kerb.
OPEN_M = 0.35
# A line along which the band filter sees paint in a smaller share of the rows is an
# edge; it looks this number of columns to both sides.
PAINTED_SHARE = 0.15
PAINT_REACH = 2
# Distance of the rows of an image between which a label is interpolated.
ROW_STEP_PX = 0.25
# Frames of a clip from one taught frame to the next, and the smallest confidence of
# their lanes.
TAUGHT_EVERY = 10
TAUGHT_CONFIDENCE = 0.95
# Probability of the teacher from which on a cell is a line.
TAUGHT_LINE = 0.5


@dataclass(eq=False)
class RealSamples:
    """Samples of labelled stills, and why other stills gave none."""

    samples: list[Sample] = field(default_factory=list)
    images: int = 0
    skipped: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class LabelledImage:
    """An RGB image, its lines, and its camera with a pose."""

    image: np.ndarray
    label: LaneColumns
    camera: Camera


def read_sets(
    path: Path, lens: Camera | None = None, several_cameras: Sequence[str] = ()
) -> list[RoadSet]:
    """The labelled sets in a folder of `benchmark.real_roads`, or in a file or folder
    that `lanes score` reads.

    `lens` is that of all stills, `several_cameras` are names of sets. Raises ValueError
    if there are no labels.
    """
    if (path / LABELS).is_file():
        return read_road_sets(path, lens, several_cameras)
    of_folder: dict[str, list[LaneColumns]] = {}
    for label in read_labels(path):
        of_folder.setdefault(label.folder, []).append(label)
    folder = labels_folder(path)
    sets = []
    for name in sorted(of_folder):
        several = name in several_cameras
        sets.append(RoadSet(name, folder, lens, several, of_folder[name]))
    return sets


def take_real_samples(
    roads: RoadSet, *, views: int = 1, teacher: Markings | None = None
) -> RealSamples:
    """Samples of the labelled stills of a set, `views` of each.

    With a `teacher` also of frames of its clips.
    """
    rng = np.random.default_rng(0)
    taken = RealSamples()
    for labelled in _labelled_images(roads, taken.skipped):
        _add_views(taken, labelled, views, rng)
    if teacher is not None:
        for clip in sorted(roads.clips):
            for labelled in _tracked_frames(roads, clip, taken.skipped):
                _add_views(taken, labelled, 1, rng, teacher)
    return taken


def _add_views(
    taken: RealSamples,
    labelled: LabelledImage,
    views: int,
    rng: np.random.Generator,
    teacher: Markings | None = None,
) -> None:
    """Add the samples of an image, or the reason why it has none."""
    try:
        taken.samples += list(sample_views(labelled, views, rng, teacher))
        taken.images += 1
    except CameraError as error:  # a pose without a road in view
        taken.skipped.append(f"{labelled.label.name}: {error}")


# Stills and their cameras.


def _labelled_images(roads: RoadSet, skipped: list[str]) -> Iterator[LabelledImage]:
    """The stills with a label and a pose; the reasons of others go to `skipped`."""
    size_of = _sizes_of_stills(roads, skipped)
    groups = [list(size_of)] if size_of else []
    if roads.several_cameras:
        groups = [[label] for label in size_of]
    for labels in groups:
        [(size, _)] = Counter(size_of[label] for label in labels).most_common(1)
        same = [label for label in labels if size_of[label] == size]
        for label in labels:
            if size_of[label] != size:
                skipped.append(f"{label.name}: is of another size than the others")
        try:
            yield from _with_pose(roads, same, size)
        except LaneError as error:
            name = labels[0].name if roads.several_cameras else roads.name
            skipped.append(f"{name}: {error}")


def _sizes_of_stills(
    roads: RoadSet, skipped: list[str]
) -> dict[LaneColumns, tuple[int, int]]:
    """Width and height of each still that can be used, by its label.

    The reasons of others go to `skipped`.
    """
    sizes = {}
    for label in roads.labels:
        if label.empty:
            skipped.append(f"{label.name}: has no line")
            continue
        try:
            image = read_image(find_picture(roads.folder, label.name))
        except (FileNotFoundError, PictureError) as error:
            skipped.append(str(error))
            continue
        size = image.shape[1::-1]
        if label.size in (None, size):
            sizes[label] = size
        else:
            skipped.append(f"{label.name}: its label is of an image of another size")
    return sizes


def _with_pose(
    roads: RoadSet, labels: Sequence[LaneColumns], size: tuple[int, int]
) -> Iterator[LabelledImage]:
    """The labelled stills of one camera, all of one size.

    Raises PoseError if they show no pose.
    """
    files = [find_picture(roads.folder, label.name) for label in labels]
    lens = _lens_of(roads, files, size)
    step = -(-len(files) // POSE_PICTURES)
    images = [read_image(file) for file in files[::step]]
    camera = require_shown(*ensure_pose(lens, images))
    for label, file in zip(labels, files, strict=True):
        yield LabelledImage(read_image(file), label, camera)


def _lens_of(roads: RoadSet, files: Sequence[Path], size: tuple[int, int]) -> Camera:
    """The lens of a set for images of `size` (width, height).

    Raises CameraError if it has another aspect ratio.
    """
    if roads.lens is None:
        return find_field_of_view(files).camera(size)
    return roads.lens if roads.lens.size == size else roads.lens.scaled(size)


def require_shown(camera: Camera, pose: PoseEstimate | None) -> Camera:
    """The camera, if its pose was given, or if the images show it.

    Otherwise raises PoseError.
    """
    if pose is not None and pose.state == ASSUMED:
        raise PoseError("no image shows the camera pose; give --camera with a pose")
    return camera


def _tracked_frames(
    roads: RoadSet, clip: Path, skipped: list[str]
) -> Iterator[LabelledImage]:
    """Frames of a clip between the labelled ones, with the lines that are tracked."""
    try:
        info = inspect_video(clip)
        size = (info.width, info.height)
        lens = _lens_of(roads, [clip], size)
        images = sample_images([clip], POSE_PICTURES)
        camera, pose = ensure_pose(lens, images)
        require_shown(camera, pose)
    except LaneError as error:
        skipped.append(f"{clip.name}: {error}")
        return

    tracker = make_tracker(info.fps, camera, pose, None)
    rows = np.asarray(usual_rows(info.height))
    with closing(read_frames(clip, info)) as frames:
        for frame, lane in track_frames(frames, tracker):
            is_labelled = frame.number in roads.clips[clip]
            is_sure = lane is not None and lane.confidence >= TAUGHT_CONFIDENCE
            if frame.number % TAUGHT_EVERY or is_labelled or not is_sure:
                continue
            camera = tracker.camera
            columns = lane.columns(camera, rows)
            name = f"{clip.name}#{frame.number}"
            yield LabelledImage(
                frame.image, LaneColumns(name, rows, columns, EGO_SIDES), camera
            )


# Labels of the cells of a view.


def sample_views(
    labelled: LabelledImage,
    views: int,
    rng: np.random.Generator,
    teacher: Markings | None = None,
) -> Iterator[Sample]:
    """Samples of an image: as it is, then with pose errors and as a worse picture."""
    exact = BirdsEyeView(labelled.camera)
    lines_m = lines_in_view(labelled.label, exact)
    painted = find_painted(labelled.image, exact, lines_m)
    for number in range(views):
        camera = labelled.camera
        image = labelled.image
        focal_px = exact.focal_px
        if number:
            camera = with_pose_error(camera, rng)
            variety = VARIETIES[number % len(VARIETIES)]
            worse, size = degrade(image, variety, rng)
            image = cv2.resize(worse, camera.size)
            focal_px *= size[0] / camera.width

        view = BirdsEyeView(camera)
        lines_m = lines_in_view(labelled.label, view)
        label = label_lines(view, lines_m, painted)
        if teacher is not None:
            label = with_teacher(label, labelled.image, view, teacher)
        yield Sample(finer_view(view).warp(image), label, focal_px)


def lines_in_view(label: LaneColumns, view: BirdsEyeView) -> np.ndarray:
    """Lateral positions (K, rows), metres, of labelled lines at the rows of a view.

    NaN where a line is not labelled.
    """
    order = np.argsort(label.rows)
    rows = label.rows[order]
    dense = np.arange(rows[0], rows[-1] + ROW_STEP_PX, ROW_STEP_PX)
    lines_m = np.full((len(label.columns), len(view.x_m)), np.nan)
    columns_at = label.at(dense)
    for line_m, columns, at_dense in zip(
        lines_m, label.columns[:, order], columns_at, strict=True
    ):
        known = columns >= 0
        if known.sum() < 2:
            continue
        # where a point is missing, the column beside it gives the distance of the row
        filled = np.interp(dense, rows[known], columns[known])
        points_m = view.camera.pixels_to_road(np.column_stack([filled, dense]))
        ahead = points_m[:, 0] > 0
        if not ahead.any():
            continue
        x_m, y_m = points_m[ahead].T
        y_m = np.where(at_dense[ahead] >= 0, y_m, np.nan)
        away = np.argsort(x_m)
        line_m[:] = np.interp(view.x_m, x_m[away], y_m[away], left=np.nan, right=np.nan)
    return lines_m


def find_painted(
    image: np.ndarray, view: BirdsEyeView, lines_m: np.ndarray
) -> np.ndarray:
    """(K,) bool: the band filter sees paint along the line; True without any row."""
    strength = marking_response(view.warp(image), view, PAINT).band_strength
    reach = np.ones((1, 2 * PAINT_REACH + 1))
    largest = cv2.dilate(strength, reach)
    painted = np.ones(len(lines_m), bool)
    for number, line_m in enumerate(lines_m):
        row = np.flatnonzero(np.abs(line_m) < view.half_width_m)
        column = np.rint((view.y_m[0] - line_m[row]) / view.cell_m).astype(int)
        seen = view.seen[row, column]
        if seen.any():
            is_paint = largest[row, column][seen] > PAINT.min_strength
            painted[number] = is_paint.mean() >= PAINTED_SHARE
    return painted


def label_lines(
    view: BirdsEyeView, lines_m: np.ndarray, painted: np.ndarray
) -> np.ndarray:
    """Labels (2, rows, columns) uint8 of paint and edges: 1 yes, 0 no, 255 open.

    `lines_m` (K, rows) are lateral positions, NaN without one; those that are not
    `painted` (K,) are edges.
    """
    labelled = np.isfinite(lines_m)
    leftmost = np.where(labelled, lines_m, -np.inf).max(axis=0)
    rightmost = np.where(labelled, lines_m, np.inf).min(axis=0)
    y_m = view.y_m
    between = (y_m < leftmost[:, None]) & (y_m > rightmost[:, None])
    label = np.full((2, *view.shape), UNKNOWN, np.uint8)
    label[:, between] = 0

    distance_m = np.abs(y_m - lines_m[..., None])
    label[:, (distance_m < OPEN_M).any(axis=0)] = UNKNOWN
    scale = view.camera.width / LABEL_WIDTH_PX
    label_std_m = LABEL_STD_PX * scale * view.x_m / view.focal_px
    half_width_m = np.hypot(LINE_HALF_WIDTH_M, label_std_m)
    on_line = distance_m <= half_width_m[:, None]
    label[0][on_line[painted].any(axis=0)] = 1
    label[1][on_line[~painted].any(axis=0)] = 1
    label[:, ~view.seen] = UNKNOWN
    return label


def with_teacher(
    label: np.ndarray, image: np.ndarray, view: BirdsEyeView, teacher: Markings
) -> np.ndarray:
    """The label, open where the mask of the teacher differs."""
    source = as_source(teacher)
    rows = source.window_rows(view.camera)
    mask = source.find_mask(crop_rows(image, rows))
    is_line = mask_in_view(mask, rows, view) >= TAUGHT_LINE
    differs = ((label == 1) & ~is_line) | ((label == 0) & is_line)
    return np.where(differs, np.uint8(UNKNOWN), label)
