"""python -m lanes mount: how the camera sits on the car, from pictures of a drive, written into camera.yaml."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from lanes.camera import Camera, load_camera, save_camera
from lanes.images import PICTURE_SUFFIXES, read_image
from lanes.mount import LANE_WIDTH_M, estimate_mount
from lanes.videofile import TimedFrame, inspect_video, read_timed_frames

# Reading on for this long costs about as much as opening the video again at another place.
SEEK_S = 2.0

DESCRIPTION = """\
Estimate height, pitch, yaw and roll of the camera from stills or videos of one drive, and write them, with the lens,
into a camera file. Best are 20 pictures or more of a marked road by day; one will do, less surely."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.description = DESCRIPTION
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="stills or videos of one drive")
    lens = parser.add_mutually_exclusive_group(required=True)
    lens.add_argument("--camera", type=Path, metavar="YAML", help="the calibrated lens")
    lens.add_argument("--hfov", type=float, metavar="DEG", help="horizontal field of view, if never calibrated")
    parser.add_argument("--size", type=_size, metavar="WxH", help="picture size for --hfov (default: the first file's)")
    parser.add_argument("--lane-width", type=float, default=LANE_WIDTH_M, metavar="M", help="default: %(default)s")
    parser.add_argument("--height", type=float, metavar="M", help="measured height of the camera above the road")
    parser.add_argument("--pictures", type=_count, default=40, metavar="N", help="use at most (default: %(default)s)")
    parser.add_argument("-o", "--output", type=Path, default=Path("camera.yaml"), help="default: %(default)s")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Estimate, write and print; what cannot be done is raised as OSError or ValueError."""
    camera = load_camera(options.camera) if options.camera else _uncalibrated(options)
    estimate = estimate_mount(
        pick_pictures(options.files, options.pictures),
        camera,
        lane_width_m=options.lane_width,
        height_m=options.height,
        progress=_show_progress if sys.stderr.isatty() else None,
    )
    print(estimate.describe())
    print(f"wrote {save_camera(camera.with_mount(estimate.mount), options.output)}")
    return 0


def pick_pictures(files: list[Path], most: int) -> Iterator[np.ndarray]:
    """At most `most` pictures, spread evenly over stills and videos; RGB (height, width, 3) uint8.

    Raises
    ------
    FileNotFoundError, PictureError, VideoError
        If a file cannot be read.
    """
    places: list[tuple[Path, float | None]] = []
    for file in files:
        if file.suffix.lower() in PICTURE_SUFFIXES:
            places.append((file, None))
        else:
            info = inspect_video(file)
            count = min(most, info.frames)
            places += [(file, info.duration_s * i / count) for i in range(count)]
    chosen = np.unique(np.linspace(0, len(places) - 1, min(most, len(places))).round().astype(int))
    for file, group in groupby((places[at] for at in chosen), key=itemgetter(0)):
        times_s = [time_s for _, time_s in group]
        yield from [read_image(file)] if times_s[0] is None else _frames_at(file, times_s)


def _frames_at(video: Path, times_s: list[float]) -> Iterator[np.ndarray]:
    """The frames shown at rising times; reads on where the next is near, and seeks where it is far."""
    frames: Iterator[TimedFrame] = iter(())
    now_s = -np.inf
    for time_s in times_s:
        if time_s > now_s + SEEK_S:
            frames = read_timed_frames(video, start_s=time_s)
        frame = next((f for f in frames if f.time_s >= time_s - 1e-3), None)
        if frame is None:
            return
        now_s = frame.time_s
        yield frame.image


def _uncalibrated(options: argparse.Namespace) -> Camera:
    if options.size is None:
        height, width = next(pick_pictures(options.files[:1], 1)).shape[:2]
        options.size = (width, height)
    return Camera.from_fov(options.size, options.hfov)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text} is no picture size; write it like 1280x720")
    return int(width), int(height)


def _count(text: str) -> int:
    if not (text.isdecimal() and int(text)):
        raise argparse.ArgumentTypeError(f"{text} is no number of pictures; give 1 or more")
    return int(text)


def _show_progress(done: int, total: int) -> None:
    print(f"\rpicture {done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)
