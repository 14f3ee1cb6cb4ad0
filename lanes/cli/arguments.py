"""What commands share: the files and the lens, checked numbers, a line of progress, and what an error means."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lanes.io.console import bounded_float, progress_line

if TYPE_CHECKING:
    from lanes.camera.camera import Camera
    from lanes.camera.field_of_view import FieldOfView


def add_footage(parser: argparse.ArgumentParser, *, files: str) -> None:
    """The files that a command looks at (`files` is their help), and --size where they differ from the lens's."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=files)
    parser.add_argument("--size", type=size, metavar="WxH", help="picture size for --hfov (default: the first file's)")


def add_lens(parser: argparse._ActionsContainer) -> None:
    """The lens that took the pictures: --camera, --boards, --hfov, --dash-period or none; `find_lens` reads them."""
    lens = parser.add_mutually_exclusive_group()
    lens.add_argument("--camera", type=Path, metavar="YAML", help="camera file, as `calibrate` or `pose` writes it")
    lens.add_argument(
        "--hfov",
        type=bounded_float(10, 150),
        metavar="DEG",
        help="horizontal field of view, if never calibrated (default: what the stills' EXIF says, else 60 is assumed)",
    )
    lens.add_argument("--boards", type=Path, metavar="FOLDER", help="pictures of a chessboard with 9 x 6 inner corners")
    lens.add_argument(
        "--dash-period",
        type=bounded_float(3, 30),
        metavar="M",
        help="one dash and one gap of the road's broken lines, metres, which tells the field of view "
        "(motorways in the USA 12.19, in Germany and Austria 18)",
    )


def add_piece(parser: argparse.ArgumentParser) -> None:
    """The piece of the videos to work on; `require_piece` checks it."""
    parser.add_argument(
        "--start", type=bounded_float(0), default=0.0, metavar="S", help="second of the videos to begin at"
    )
    parser.add_argument("--end", type=bounded_float(0), metavar="S", help="second of the videos to stop at")


def require_piece(options: argparse.Namespace) -> None:
    """Refuse a piece that ends before it begins."""
    if options.end is not None and options.end <= options.start:
        raise ValueError(f"--end {options.end:g} is not after --start {options.start:g}; give a later end.")


def find_lens(options: argparse.Namespace) -> Camera:
    """The camera of the options of `add_lens`; with a camera pose only if it comes from a file that has one."""
    from lanes.camera.calibration.boards import calibrate_folder
    from lanes.camera.camera import Camera
    from lanes.camera.camera_file import load_camera
    from lanes.io.footage import pick_pictures

    if options.camera:
        return load_camera(options.camera)
    if options.boards:
        return calibrate_folder(options.boards, progress=progress_line("boards"))
    first = next(pick_pictures(options.files, 1))
    field = find_field(options, options.files)
    return Camera.from_fov(getattr(options, "size", None) or (first.shape[1], first.shape[0]), field.hfov_deg)


def find_field(options: argparse.Namespace, files: Sequence[Path]) -> FieldOfView:
    """The field of view of a lens that was never calibrated; what was not given is told on stderr."""
    from lanes.camera.field_of_view import FieldOfView
    from lanes.drives.own_camera import find_field_of_view

    if options.hfov is not None:
        return FieldOfView(options.hfov, "as given")
    found = find_field_of_view(files, dash_period_m=options.dash_period)
    print(f"{'warning: ' if found.assumed else ''}{found.describe()}", file=sys.stderr)
    return found


def size(text: str) -> tuple[int, int]:
    """An argparse type: a picture's width and height, written like 1280x720."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text} is no picture size; write it like 1280x720")
    return int(width), int(height)
