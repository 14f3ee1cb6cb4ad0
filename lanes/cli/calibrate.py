"""Calibrate the lens from 10 to 20 pictures of a chessboard, and write a camera file. Tilt the board in
another direction for each picture, and cover all parts of the picture. A table lists for each picture
whether it was used, and its error. The sheet shows the corners found.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from lanes.cli.arguments import add_output, size
from lanes.console import progress_line

EXAMPLES = """\
  {program} my_boards -o lens.yaml
  {program} --pattern 8x5 --sheet sheet.png boards/*.jpg"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this command."""
    parser.add_argument(
        "pictures", nargs="+", type=Path, metavar="PICTURE", help="picture of a chessboard, or folder of pictures"
    )
    parser.add_argument(
        "--pattern",
        type=pattern,
        default=(9, 6),
        metavar="CxR",
        help="inner corners of the board, columns x rows: one less than its squares (default: 9x6)",
    )
    parser.add_argument(
        "--sheet", type=Path, metavar="FILE", help="also write a picture of all boards with their corners"
    )
    add_output(parser, "camera.yaml", "camera file to write")


def run(options: argparse.Namespace) -> int:
    """Calibrate, print the table, and write the camera file."""
    from lanes.calibration import (
        calibrate_detections,
        describe_calibration,
        draw_contact_sheet,
        find_boards,
        list_board_pictures,
    )
    from lanes.camera import save_camera
    from lanes.files import require_no_input_among
    from lanes.images import write_image

    paths = list_board_pictures(options.pictures)
    require_no_input_among(filter(None, (options.output, options.sheet)), paths)
    detections = find_boards(paths, options.pattern, progress=progress_line("calibrate"))
    camera = calibrate_detections(detections, ", ".join(map(str, options.pictures[:3])))
    print(describe_calibration(detections, camera))
    print(f"wrote {save_camera(camera, options.output)}")
    if options.sheet:
        print(f"wrote {write_image(options.sheet, draw_contact_sheet(detections, camera))}")
    return 0


def pattern(text: str) -> tuple[int, int]:
    """An argparse type: inner corners of a chessboard, columns and rows, written like 9x6."""
    try:
        columns, rows = size(text)
    except argparse.ArgumentTypeError:
        columns = rows = 0
    if min(columns, rows) < 3:
        raise argparse.ArgumentTypeError(
            f"{text} is not a chessboard pattern; write its inner corners like 9x6, at least 3x3"
        )
    return columns, rows
