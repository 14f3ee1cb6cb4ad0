"""Files named on the command line, sorted into videos and stills, and images sampled
from them.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from glob import glob
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from lanes.errors import VideoError
from lanes.files import (
    MESSAGES_SUFFIX,
    NO_PERMISSION,
    list_files,
    require_no_input_among,
    require_path,
)
from lanes.ros.log_files import file_of_log, is_bag_folder, is_robot_log
from lanes.video.images import kind_of_file, natural_key, read_image, read_orientation
from lanes.video.reader import (
    STAMP_TOLERANCE_S,
    TimedFrame,
    VideoInfo,
    inspect_video,
    read_timed_frames,
)


@dataclass(frozen=True)
class Sources:
    """Videos and stills without duplicates, in natural order within a folder.

    `skipped` files are neither, or messages of a lane that were written here.
    `skipped_folders` are in the folders that were named.
    """

    videos: tuple[Path, ...]
    stills: tuple[Path, ...]
    skipped: tuple[Path, ...] = ()
    skipped_folders: tuple[Path, ...] = ()

    @property
    def files(self) -> tuple[Path, ...]:
        """The stills, then the videos."""
        return self.stills + self.videos

    def warn(self) -> Sources:
        """The same, with a warning of what is skipped."""
        for note in self.notes():
            warnings.warn(note, stacklevel=3)
        return self

    def notes(self) -> list[str]:
        """What is skipped, in words; label files of the stills are not named."""
        labels = {still.with_suffix(".json") for still in self.stills}
        ours = []
        others = []
        for path in self.skipped:
            if path.name.endswith(MESSAGES_SUFFIX):
                ours.append(path)
            elif path not in labels:
                others.append(path)
        words = {
            "neither a video nor an image": others,
            "written by annotate": ours,
            "folders, which have to be named themselves": self.skipped_folders,
        }
        return [
            f"skipped, {reason}: {list_names(paths)}"
            for reason, paths in words.items()
            if paths
        ]


def list_names(paths: Sequence[Path]) -> str:
    """The first five paths, and how many more there are."""
    more = f" and {len(paths) - 5} more" if len(paths) > 5 else ""
    return ", ".join(map(str, paths[:5])) + more


def find_sources(names: Iterable[str]) -> Sources:
    """The videos and stills that `names` stand for.

    Names are files, folders (the videos and stills in the folder itself, not in its
    subfolders), or patterns such as ``drives/*.mp4``. The folder of a ROS 2 recording
    is one video, also in a folder or by a pattern that its parts match. Images and
    videos are distinguished by their names (`kind_of_file`). A file named directly that
    is not an image is read as a video. Raises FileNotFoundError for a name that stands
    for no file.
    """
    names = list(names)
    if not names:
        raise FileNotFoundError(
            "no file is named; give an image, a video, a folder or a pattern such as "
            "drives/*.mp4."
        )

    files: dict[Path, str] = {}
    skipped: list[Path] = []
    folders: list[Path] = []
    for name in names:
        in_folder = _is_folder_of_files(name)
        paths, others = _files(name)
        kinds = {path: _kind(path, in_folder) for path in paths}
        if in_folder and not any(kinds.values()):
            remedy = "name another folder"
            if others:
                remedy = f"name one of its folders, such as {others[0]}"
            raise FileNotFoundError(
                f"{name}: holds neither a video nor an image; {remedy}."
            )
        folders += others
        for path, kind in kinds.items():
            if kind is None:
                skipped.append(path)
            else:
                files[path] = kind
    if skipped and not files:
        raise FileNotFoundError(
            f"{skipped[0]}: was written by annotate; give the log that it was made "
            "from."
        )

    videos = [path for path, kind in files.items() if kind == "video"]
    stills = [path for path, kind in files.items() if kind == "image"]
    return Sources(tuple(videos), tuple(stills), tuple(skipped), tuple(folders))


def list_paths(source: object) -> list[str]:
    """The names in a path or in several; raises LaneError if it is neither."""
    if isinstance(source, Iterable) and not isinstance(source, str | Path):
        return [str(require_path(path)) for path in source]
    return [str(require_path(source))]


def _is_folder_of_files(name: str) -> bool:
    """Whether a name stands for a folder that is no recording; "" stands for none."""
    return bool(name) and Path(name).is_dir() and not is_bag_folder(name)


def _kind(path: Path, in_folder: bool) -> str | None:
    """The kind of a source; None for a file that is skipped."""
    if path.name.endswith(MESSAGES_SUFFIX):
        return None
    if is_bag_folder(path):
        return "video"
    kind = kind_of_file(path)
    if kind is None and not in_folder:
        return "video"
    return kind


def require_topic(files: Iterable[Path], topic: str | None) -> None:
    """Raise VideoError if a topic is given, but none of the files is a robot log."""
    files = list(files)
    if topic is None or not files:
        return
    if not any(map(is_robot_log, files)):
        raise VideoError(
            f"{files[0]}: is no robot log and has no topics, so none is named "
            f"{topic!r}; omit the topic."
        )


def files_of(source: Path) -> list[Path]:
    """The files of a source: those of a recording, which is a folder, or itself."""
    if not is_bag_folder(source):
        return [source]
    files = []
    for path in list_files(source):
        is_part = is_robot_log(path) and not path.name.endswith(MESSAGES_SUFFIX)
        if is_part or path == file_of_log(source):
            files.append(path)
    return files


def require_distinct_outputs(planned: Sequence[tuple[Path, Path]]) -> None:
    """Raise ValueError if an output would overwrite a source, or the output of another.

    `planned` are the sources and outputs, a pair for each output.
    """
    sources = [source for source, _ in planned]
    outputs = [output for _, output in planned]
    require_no_input_among(outputs, sources)
    source_of: dict[Path, Path] = {}
    for source, output in planned:
        other = source_of.setdefault(output.resolve(), source)
        if other != source:
            raise ValueError(
                f"{output}: would be written from {other} and from {source}; annotate "
                "them into different folders."
            )


def _files(name: str) -> tuple[list[Path], list[Path]]:
    """The files and recordings that a name stands for, and the folders it does not."""
    path = require_path(name)
    try:
        path.exists()
    except PermissionError as error:
        raise ValueError(NO_PERMISSION.format(name)) from error

    if _is_folder_of_files(name):
        folders = [entry for entry in path.iterdir() if entry.is_dir()]
        found = list_files(path)
        found += [folder for folder in folders if is_bag_folder(folder)]
        folders = [folder for folder in folders if not folder.name.startswith(".")]
    elif name and path.exists():
        return [path], []
    else:
        matches = list(map(Path, glob(name, recursive=True)))
        folders = [match for match in matches if match.is_dir()]
        found = _recordings_as_one(matches)
        if not found and folders:
            raise FileNotFoundError(
                f"{name}: stands for folders only, such as {folders[0]}; name them "
                f"themselves, or {Path(name, '*')} for the files in them."
            )
        if not found:
            raise FileNotFoundError(
                f"{name}: there is no such file or folder; check the name."
            )
    taken = set(found).union(*(path.parents for path in found))
    others = [folder for folder in folders if folder not in taken]
    return sorted(found, key=_order), sorted(others, key=_order)


def _recordings_as_one(matches: Iterable[Path]) -> list[Path]:
    """The files among matches, and the folders of recordings in place of their files,
    if the folder or its metadata matches.
    """
    files = []
    recordings = set()
    for match in matches:
        if is_bag_folder(match):
            recordings.add(match)
        elif match.is_file():
            files.append(match)
    for file in files:
        if is_bag_folder(file.parent) and file == file_of_log(file.parent):
            recordings.add(file.parent)
    alone = [file for file in files if file.parent not in recordings]
    return [*recordings, *alone]


def _order(path: Path) -> tuple[str, list]:
    return str(path.parent), natural_key(path)


def read_turn(file: Path) -> int:
    """The EXIF orientation of a still, or that which the display matrix of a video
    stands for.
    """
    if kind_of_file(file) == "image":
        return read_orientation(file)
    if is_robot_log(file):
        return 1
    return inspect_video(file).orientation


def sample_images(
    files: Iterable[Path],
    max_images: int,
    *,
    require: Callable[[np.ndarray, Path], object] | None = None,
    start_s: float = 0.0,
    end_s: float | None = None,
    infos: Mapping[Path, VideoInfo] | None = None,
    topic: str | None = None,
) -> Iterator[np.ndarray]:
    """Yield up to `max_images` RGB images (height, width, 3), uint8, evenly spaced over
    stills and videos.

    `require(image, file)` raises if an image cannot be used, as `Camera.require_size`
    does. `start_s` and `end_s` are the part of each video to sample, seconds since the
    first frame. Videos in `infos` are not inspected again. `topic` is as for
    `inspect_video`. Raises LaneError if a file cannot be read or a video ends before
    `start_s`.
    """
    # Each still, and up to `max_images` times of each video.
    candidates: list[tuple[Path, float | None]] = []
    for file in files:
        if kind_of_file(file) == "image":
            candidates.append((file, None))
            continue
        info = (infos or {}).get(file)
        if info is None:
            info = inspect_video(file, topic=topic)
        times_s = _times_s(file, info, max_images, start_s, end_s)
        candidates += [(file, time_s) for time_s in times_s]

    # Evenly spaced ones of them.
    count = min(max_images, len(candidates))
    places = np.linspace(0, len(candidates) - 1, count).round()
    indices = np.unique(places.astype(int))
    chosen = [candidates[index] for index in indices]

    for file, group in groupby(chosen, key=itemgetter(0)):
        wanted_s = [time_s for _, time_s in group]
        images: Iterable[np.ndarray]
        if wanted_s[0] is None:
            images = [read_image(file)]
        else:
            images = _frames_at(file, wanted_s, end_s, topic)
        for image in images:
            if require:
                require(image, file)
            yield image


def _times_s(
    video: Path, info: VideoInfo, max_times: int, start_s: float, end_s: float | None
) -> np.ndarray:
    """Up to `max_times` times, evenly spaced over a part of a video, at most one per
    frame.
    """
    until_s = info.duration_s
    if end_s is not None:
        until_s = min(until_s, end_s)
    length_s = until_s - start_s
    if length_s <= 0:
        raise VideoError(
            f"{video}: lasts {info.duration_s:g} s; begin before that, not at "
            f"{start_s:g} s."
        )

    frames = max(round(length_s * info.fps), 1)
    count = min(max_times, frames)
    return start_s + length_s * np.arange(count) / count


def _frames_at(
    video: Path, times_s: list[float], end_s: float | None, topic: str | None
) -> Iterator[np.ndarray]:
    """The frames shown at increasing times before `end_s`; seeks if the next time is
    more than two seconds ahead.

    Reading so much of a video takes about as long as reopening it at another time.
    """
    frames: Iterator[TimedFrame] = iter(())
    shape = None
    now_s = -np.inf
    for time_s in times_s:
        if time_s > now_s + 2.0:
            frames = read_timed_frames(video, start_s=time_s, end_s=end_s, topic=topic)
        earliest_s = time_s - STAMP_TOLERANCE_S
        try:
            frame = next((f for f in frames if f.time_s >= earliest_s), None)
        except VideoError:  # no frame from here to `end_s`
            if now_s < 0:
                raise
            return
        if frame is None:
            return
        shape = shape or frame.image.shape
        if frame.image.shape != shape:
            for _ in read_timed_frames(video, start_s=now_s, topic=topic):
                pass  # up to the change, which raises VideoError with its time
        now_s = frame.time_s
        yield frame.image
