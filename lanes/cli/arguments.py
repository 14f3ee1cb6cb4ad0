"""Command-line options shared by several commands: files, lens, part of the videos, and output."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.console import bounded_float, progress_line

if TYPE_CHECKING:
    from lanes.camera import Camera
    from lanes.field_of_view import FieldOfView


def add_footage(parser: argparse.ArgumentParser, *, files: str) -> None:
    """Add the FILE arguments, with `files` as their help text, and --size."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=files)
    parser.add_argument(
        "--size", type=size, metavar="WxH", help="picture size for --hfov (default: size of the first file)"
    )


def add_lens(parser: argparse._ActionsContainer) -> None:
    """Add the options for the lens: one of --camera, --hfov, --boards, or none; see `find_lens`."""
    lens = parser.add_mutually_exclusive_group()
    lens.add_argument("--camera", type=Path, metavar="YAML", help="camera file written by `calibrate` or `pose`")
    lens.add_argument(
        "--hfov",
        type=bounded_float(10, 150),
        metavar="DEG",
        help="horizontal field of view of an uncalibrated lens, degrees (default: from the EXIF entries of the stills, "
        "else 60)",
    )
    lens.add_argument(
        "--boards",
        type=Path,
        metavar="FOLDER",
        help="calibrate the lens from pictures of a chessboard with 9 x 6 inner corners",
    )


def add_piece(parser: argparse.ArgumentParser) -> None:
    """Add the options for a part of the videos; `require_piece` checks them."""
    parser.add_argument(
        "--start", type=bounded_float(0), default=0.0, metavar="S", help="start at this second of each video"
    )
    parser.add_argument("--end", type=bounded_float(0), metavar="S", help="stop at this second of each video")


def require_piece(options: argparse.Namespace) -> None:
    """Raise ValueError if --end is not after --start."""
    if options.end is not None and options.end <= options.start:
        raise ValueError(f"--end {options.end:g} is not after --start {options.start:g}; give a later end.")


def add_output(parser: argparse.ArgumentParser, default: str, what: str) -> None:
    """Add --output, with `what` as its help text."""
    parser.add_argument("-o", "--output", type=Path, default=Path(default), help=f"{what} (default: %(default)s)")


def given_camera(options: argparse.Namespace) -> Camera | None:
    """The camera of --camera or --boards; None without these options."""
    from lanes.calibration import calibrate_folder
    from lanes.camera import load_camera

    if options.camera:
        return load_camera(options.camera)
    if options.boards:
        quiet = getattr(options, "quiet", False)
        return calibrate_folder(options.boards, progress=None if quiet else progress_line("boards"))
    return None


def find_lens(options: argparse.Namespace) -> Camera:
    """The camera according to the options of `add_lens`, for pictures of the size of the first file.

    It has a pose only if it comes from a camera file with one.
    """
    from lanes.annotate import DriveSettings
    from lanes.sources import sample_images

    camera = given_camera(options)
    first = next(sample_images(options.files, 1))
    field = find_field(options, options.files) if camera is None else None
    settings = DriveSettings(output=options.output, camera=camera, field=field)
    size = getattr(options, "size", None) if camera is None else None
    return settings.camera_for(size or (first.shape[1], first.shape[0]), options.files[0])


def find_field(
    options: argparse.Namespace, files: Sequence[Path], *, each: Sequence[Path] | None = None
) -> FieldOfView:
    """The field of view of an uncalibrated lens; prints it to stderr unless it was given by --hfov.

    `each` are stills of different cameras. If the EXIF entries of each name its field of view, and there are no other
    files, nothing is printed.
    """
    from lanes.field_of_view import FieldOfView, find_field_of_view

    if options.hfov is not None:
        return FieldOfView(options.hfov, "as given")
    found = find_field_of_view(files)
    if each and not files and found.assumed and not any(find_field_of_view([still]).assumed for still in each):
        return found
    print(f"{'warning: ' if found.assumed else ''}{found.describe()}", file=sys.stderr)
    return found


def size(text: str) -> tuple[int, int]:
    """An argparse type: picture width and height, written like 1280x720."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text} is not a picture size; write it like 1280x720")
    return int(width), int(height)
